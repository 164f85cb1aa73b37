"""Command ``study``, which runs many scenes, or fits many surrogates."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from .. import studies
from ..studies.study import FIGURE, MEANS, TABLE
from .command import MaxTime
from .terminal import FAILED, INTERRUPTED, WARNING, Bar, ended, note, print_json, warn, writing


def study(
    description: Annotated[
        Path,
        Argument(
            metavar="STUDY",
            help="Study file (.toml): a scene or a fit, and the parameters to vary.",
        ),
    ],
    folder: Annotated[
        Path | None,
        Option("--out", metavar="DIR", help="Folder for the results (default: named after STUDY)."),
    ] = None,
    jobs: Annotated[
        int | None, Option(help="Number of parallel runs (default: number of cores).", min=1)
    ] = None,
    threads: Annotated[
        int | None,
        Option(help="Number of threads of each run (default: cores divided by jobs).", min=1),
    ] = None,
    scheduler: Annotated[
        str | None,
        Option(metavar="ADDRESS", help="Dask scheduler for the runs, such as tcp://host:8786."),
    ] = None,
    overwrite: Annotated[
        bool,
        Option(
            "--overwrite", help="Overwrite the table of a different study in DIR; runs are kept."
        ),
    ] = False,
    max_time: MaxTime = None,
) -> None:
    """Carry out the runs of a study that are not finished yet, and write its table and figure."""
    folder = Path(description.stem) if folder is None else folder
    interrupted = None
    try:
        with writing(folder), Bar(description.stem):
            result = studies.study(
                description,
                folder,
                jobs=jobs,
                threads=threads,
                scheduler=scheduler,
                overwrite=overwrite,
                max_time=max_time,
            )
    except studies.StudyInterrupted as error:
        interrupted = error
        result = error.result
    if result.failures:
        first = result.failures[0]
        warn(
            f"{len(result.failures)} of {len(result.rows)} runs failed; {result.folder / TABLE} has"
            f" the reasons, the first of which ({first['run']}) is: {first['failure']}"
        )
    for caution in result.cautions():
        warn(caution)
    print_json(result.rows)
    written = " and ".join(
        name for name in (TABLE, MEANS, FIGURE) if (result.folder / name).exists()
    )
    note(f"Wrote {written} of {len(result.rows)} runs in {folder}")
    if interrupted is not None:
        raise ended(INTERRUPTED, str(interrupted), WARNING)
    if result.failures:
        raise typer.Exit(FAILED)
    if result.not_done:
        raise ended(
            INTERRUPTED,
            f"{len(result.not_done)} runs reached --max-time; repeat the command to resume them"
            " from their checkpoints",
            WARNING,
        )
