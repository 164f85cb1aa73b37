"""Command ``run``, which runs a scene."""

from typing import Annotated

from typer import Argument, Option

from ..ranks import communicator
from ..scenes import load_scene
from .command import REF_HELP, SCENE_HELP, MaxTime, Overwrite, SetScene
from .terminal import use_ranks

FORCE_HELP = f"{REF_HELP} (default: depends on the scene)."


def run(
    scene: Annotated[str, Argument(metavar="SCENE", help=f"{SCENE_HELP}.")],
    *,
    force: Annotated[str | None, Option(metavar="REF", help=FORCE_HELP)] = None,
    change: SetScene = None,
    out_folder: Annotated[
        str | None,
        Option("--out", metavar="DIR", help="Folder for the results (default: none are written)."),
    ] = None,
    threads: Annotated[
        int | None,
        Option(
            help="Number of threads (default: as many as speed it up); results do not depend on it."
        ),
    ] = None,
    resume: Annotated[
        bool, Option("--resume", help="Resume an interrupted run from the checkpoint in DIR.")
    ] = False,
    overwrite: Overwrite = False,
    max_time: MaxTime = None,
) -> None:
    """Run a scene on one process or several ranks, print its result, and write it to a folder,
    if given.
    """
    ranks = communicator()
    use_ranks(ranks)
    asked = load_scene(scene, change or [])
    # here, because a scene that is refused needs neither numba nor forces
    from .simulation import (
        simulated,
    )

    simulated(
        ranks,
        asked,
        force,
        threads,
        {"folder": out_folder, "resume": resume, "overwrite": overwrite, "max_time": max_time},
    )
