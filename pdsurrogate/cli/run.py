"""The command that runs a scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from ..artifacts import default_force, with_material
from ..artifacts.material import in_words
from ..forces import ForceModel
from ..ranks import NotUnderMPI, communicator
from ..results import Result
from ..results.checkpoint import NAME
from ..results.folder import occupied
from ..run.simulate import Progress, SimulationFailed, SimulationInterrupted, simulate
from ..scenes import Scene, load_scene
from .command import AsJson, MaxTime, Overwrite, SetScene, check_folder, command
from .endings import FAILED, INTERRUPTED, bad_input, ended, share, writing
from .run_tables import print_result
from .terminal import WARNING, Rate, err, note, print_json, progress_bar, warn

FORCE_HELP = "analytic, bond-energy, nosb, ba-nosb, or an artefact (NAME, NAME@VERSION, path); default: chosen for the scene."

CAUTION = 0.01
"""Relative RMS error on the card of an artefact above which the user is warned."""


@command
def run(
    scene: Annotated[str, Argument(metavar="SCENE", help="Name of a built-in scene, or path of a scene file (.toml).")],
    *,
    force: Annotated[str | None, Option(metavar="REF", help=FORCE_HELP)] = None,
    change: SetScene = None,
    out_folder: Annotated[str | None, Option("--out", metavar="DIR", help="Write tables, states and a figure here.")] = None,
    threads: Annotated[int | None, Option(help="Number of threads (default: as many as speed it up); results are the same.")] = None,
    resume: Annotated[bool, Option("--resume", help="Resume from the checkpoint in DIR; the result is the same.")] = False,
    overwrite: Overwrite = False,
    max_time: MaxTime = None,
    as_json: AsJson = False,
) -> None:
    """Run a scene and compare it with its reference."""
    with bad_input(NotUnderMPI):
        ranks = communicator()
    share(ranks)
    first = ranks.rank == 0
    asked = load_scene(scene, change or [])
    described, model = (asked, default_force(asked)) if force is None else with_material(asked, force)
    if described is not asked:
        err.print(f"Material of {model.name}: {in_words(described.material.build())}", soft_wrap=True, markup=False)
    if out_folder == "":
        raise ValueError("--out needs the name of a folder, and it is empty")
    if model.stated and model.stated["rms"] > CAUTION:
        error = f"The card of {model.name} states an RMS error of {100 * model.stated['rms']:.2g} %"
        warn(f"{error}: results will be off by as much; force=analytic is exact.")
    if resume and out_folder is None:
        raise ValueError("--resume needs --out, the folder with the checkpoint")
    folder = None if out_folder is None else Path(out_folder)
    writes = folder if first else None
    check_folder(writes)
    failure = None
    with ExitStack() as held:
        with writing(folder):
            if writes is not None:
                held.enter_context(occupied(writes))
            options = {"folder": folder, "resume": resume, "overwrite": overwrite, "max_time": max_time}
            try:
                with progress_bar() as shown:
                    result = simulate(described, model, threads=threads, progress=_Shown(described, shown), **options)
            except SimulationFailed as error:
                failure, result = error, error.result
        print_result(result)
        if writes is not None:
            if not isinstance(failure, SimulationInterrupted):  # its tables are there, and pictures would take their time
                with writing(writes):
                    result.save(writes)
            note(f"Results in {writes}")
            if result.in_pieces:
                note(f"The body is in pieces, and no picture of it is drawn: open {described.name}.pvd in ParaView")
        if as_json and first:
            print_json(result.summary)
        ranks.barrier()  # a rank that is alone with an error ends the others
    _warn_of(result, described, model)
    if isinstance(failure, SimulationInterrupted):
        raise ended(INTERRUPTED, f"{failure}; {how_to_resume(folder)}", WARNING)
    if failure is not None:
        raise ended(FAILED, str(failure), "[red]pdsurrogate: the run failed:[/]")


def how_to_resume(folder: Path | None) -> str:
    """Return how the user can resume after an interrupt."""
    if folder is None:
        return "nothing was kept: give --out to be able to resume"
    if not (folder / NAME).is_file():
        return "it had not come to its first checkpoint"
    return f"the checkpoint is in {folder}: the same command with --resume goes on from it"


def _warn_of(result: Result, scene: Scene, model: ForceModel) -> None:
    """Warn of stability that was not checked, and of states outside the domain or the test data of a surrogate."""
    if any(level.get("stability") == "not checked" for level in result.levels):
        pushed = "The grips push" if scene.stretched else "Parts of the body are compressed"
        why, instead = f"{model.name} has no energy", "; it is with a force that has one, as bond-energy does"
        if model.family == "bond energy":
            why = "these loads have no potential, as a pressure on a part of a surface that ends within the body's boundary has none"
            instead = ""
        warn(f"{pushed}, and {why}: whether the body would buckle is not checked{instead}.")
    outside = result.summary["fraction_outside_domain"]
    if outside and scene.outside != "raise":
        exact = scene.outside in (None, "fallback")
        instead = "the exact bond force stood in for the surrogate" if exact else "the surrogate was extrapolated"
        warn(f"{100 * outside:.2g} % of the bond evaluations were outside the surrogate's domain; {instead} there.")
    rows = result.summary.get("beyond_data", [])
    worst = max(rows, key=lambda row: row["share"], default=None)
    if worst is not None and worst["share"]:
        farthest = max(row["log_stretch"] for row in rows)
        at = f"stretch {worst['stretch']:.4g}" if "stretch" in worst else f"t = {worst['t']:.4g}"
        warn(
            f"{100 * worst['share']:.2g} % of the bonds were beyond the test data of {result.summary['force']} at {at}, where most were; "
            f"the farthest of all outputs by {farthest:.2g} in log-stretch. There the energy goes on as its powers do."
        )


class _Shown(Progress):
    """Progress of a simulation, shown by a bar; the residual falls over many decades, so the bar counts decades."""

    def __init__(self, scene: Scene, shown: Callable[..., None]) -> None:
        self._scene, self._shown = scene, shown
        self._title, self._first, self._account = "", 0.0, ""
        self._rate: Rate | None = None

    def compiling(self) -> None:
        """Print that kernels are being compiled."""
        note("Compiling kernels, once on this machine; later runs load them from the cache.")

    def level(self, number: int, parameter: float) -> None:
        """Begin the bar of the next output."""
        if self._scene.stretched:
            self._begin(f"{self._scene.name}: stretch {parameter:g} ({number + 1}/{len(self._scene.stretches)})")
        else:
            self._begin(f"{self._scene.name}: t = {parameter:g} (step {number + 1}/{len(self._scene.steps)})")

    def _begin(self, title: str) -> None:
        if title != self._title:
            self._title, self._first, self._rate = title, 0.0, None
            self._shown(0.0, title=title)

    def _rate_of(self, items: str, count: int) -> str:
        """Return the rate of evaluations or steps since the first call for this output."""
        if self._rate is None:
            self._rate = Rate(items, count)
        return self._rate.after(count)

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        """Show how many of the decades between the greatest residual and the tolerance are done."""
        self._first = max(self._first, residual, 1e-300)
        span = math.log10(self._first / tolerance)
        done = math.log10(self._first / max(residual, 1e-300)) / span if span > 0 else 1.0
        state = f"residual {residual:.1e}, {evaluations} evaluations{self._rate_of('evaluations', evaluations)}"
        self._shown(min(max(done, 0.0), 1.0), state, self._title)

    def dynamics(self, done: float, parameter: float, broken_bonds: int) -> None:
        """Show the share of a dynamic stage that is done."""
        self._begin(f"{self._scene.name}: dynamics")
        broken = f", {broken_bonds} bonds broken" if self._scene.fracture is not None else ""
        state = f"{'stretch ' if self._scene.stretched else 't = '}{parameter:.4f}{broken}{self._account}"
        self._shown(done, state, self._title)

    def account(self, steps: int, kinetic_energy: float, strain_energy: float) -> None:
        """Keep the energies for the next call of `dynamics`."""
        rate = self._rate_of("steps", steps)
        self._account = f", energies {strain_energy:.3g} strain, {kinetic_energy:.2g} kinetic{rate}"
