"""Commands that simulate: run and scenes."""

from __future__ import annotations

import json
import math
import re
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from .application import Bar, Rate, bad_input, ended, err, note, only_the_first_speaks, out, print_json, show, writing
from .common import AsJson, MaxTime, command
from .interrupts import INTERRUPTED

LEAST_SHARE = 0.01
"""Of the moment over the extent of the body: what is turned has smaller forces, of which the table tells nothing."""

LEAST_SHOWN = 5e-6
"""Forces below it are printed as zero; where none is as large as 1, over the greatest."""

CAUTION = 0.01
"""Relative RMS error stated by an artefact's card from which a run says so."""


def how_to_resume(folder: Path | None) -> str:
    """Return how the user can resume after an interrupt."""
    from ..results.checkpoint import NAME

    if folder is None:
        return "nothing was kept: give --out to be able to resume"
    if not (folder / NAME).is_file():
        return "it had not come to its first checkpoint"
    return f"the checkpoint is in {folder}: the same command with --resume goes on from it"


@command()
def run(
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="Name of a built-in scene, or path of a scene file (.toml).")],
    force: Annotated[
        str | None,
        typer.Option(
            metavar="REF",
            help="analytic, bond-energy, nosb, ba-nosb, or an artefact (NAME, NAME@VERSION, path); default: chosen for the scene.",
        ),
    ] = None,
    change: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a scene key; may be repeated.")] = None,
    out_folder: Annotated[
        str | None, typer.Option("--out", metavar="DIR", help="Write summary, history, VTU/PVD files and a figure here.")
    ] = None,
    threads: Annotated[
        int | None, typer.Option(help="Number of threads (default: as many as speed it up); the result does not depend on it.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Resume from the checkpoint in DIR; the result is the same.")] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Overwrite results of other runs, or of this run if interrupted, in DIR.")
    ] = False,
    max_time: MaxTime = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON instead of tables.")] = False,
) -> None:
    """Run a scene and compare it with its reference."""
    from ..artifacts import ArtifactError, default_force, with_material
    from ..artifacts.material import in_words
    from ..ranks import NotUnderMPI, communicator
    from ..results.checkpoint import CheckpointError
    from ..results.files import check_writable
    from ..results.folder import FolderTaken, occupied
    from ..run.simulate import SimulationFailed, SimulationInterrupted, simulate
    from ..scenes import SceneError, load_scene

    with bad_input(NotUnderMPI):
        only_the_first_speaks()
        first = communicator().rank == 0
    with bad_input(SceneError, ArtifactError):
        asked = load_scene(scene, change or [])
        described, model = (asked, default_force(asked)) if force is None else with_material(asked, force)
    if described is not asked:
        err.print(f"Material of {escape(model.name)}: {escape(in_words(described.material.build()))}", soft_wrap=True)
    folder = None if out_folder is None else Path(out_folder)
    if out_folder == "":
        raise ended(2, "[red]pdsurrogate:[/]", "--out needs the name of a folder, and it is empty")
    if model.stated and model.stated["rms"] > CAUTION:
        err.print(
            f"[yellow]The card of {escape(model.name)} states an RMS error of {100 * model.stated['rms']:.2g} %: "
            "results will be off by as much; force=analytic is exact.[/]",
            soft_wrap=True,
        )
    if resume and folder is None:
        raise ended(2, "[red]pdsurrogate:[/]", "--resume needs --out, the folder with the checkpoint")
    if folder is not None and first:
        with bad_input(OSError):
            check_writable(folder)
    failure = None
    with ExitStack() as held:
        if folder is not None and first:
            with bad_input(FolderTaken), writing(folder):
                held.enter_context(occupied(folder))
        try:
            with bad_input(SceneError, CheckpointError, ValueError), writing(folder), _Bar(described) as bar:
                options = {"folder": folder, "resume": resume, "overwrite": overwrite, "max_time": max_time}
                result = simulate(described, model, threads=threads, progress=bar, **options)
        except SimulationFailed as error:
            failure, result = error, error.result
        print_cells(result)
        (print_levels if described.stretched else _print_outputs)(result)
        if folder is not None and first:
            if not isinstance(failure, SimulationInterrupted):  # whose tables are there, and pictures take their time
                with writing(folder):
                    result.save(folder)
            note(f"Results in {folder}")
            if result.in_pieces:
                note(f"The body is in pieces, and no picture of it is drawn: open {described.name}.pvd in ParaView")
        if as_json and first:
            print_json(result.summary)
        communicator().barrier()  # whoever is alone with an error ends the others
    if any(level.get("stability") == "not checked" for level in result.levels):
        pushed = "The grips push" if described.stretched else "Parts of the body are compressed"
        if model.family == "bond energy":
            why = "these loads have no potential, as a pressure on a part of a surface that ends within the body's boundary has none"
            instead = ""
        else:
            why = f"{escape(model.name)} has no energy"
            instead = "; it is with a force that has one, as bond-energy does"
        err.print(f"[yellow]{pushed}, and {why}: whether the body would buckle is not checked{instead}.[/]", soft_wrap=True)
    outside = result.summary["fraction_outside_domain"]
    if outside and described.outside != "raise":
        what = (
            "the exact bond force stood in for the surrogate"
            if described.outside in (None, "fallback")
            else "the surrogate was extrapolated"
        )
        err.print(
            f"[yellow]{100 * outside:.2g} % of the bond evaluations were outside the surrogate's domain; {what} there.[/]", soft_wrap=True
        )
    _print_beyond_data(result.summary)
    if isinstance(failure, SimulationInterrupted):
        raise ended(INTERRUPTED, "[yellow]pdsurrogate:[/]", f"{failure}; {how_to_resume(folder)}")
    if failure is not None:
        raise ended(1, "[red]pdsurrogate: the run failed:[/]", str(failure))


def _print_beyond_data(summary: dict) -> None:
    """Warn of the output at which the largest share of bonds was beyond the fitted test data."""
    rows = summary.get("beyond_data", [])
    worst = max(rows, key=lambda row: row["share"], default=None)
    if worst is None or worst["share"] == 0:
        return
    farthest = max(row["log_stretch"] for row in rows)
    at = f"stretch {worst['stretch']:.4g}" if "stretch" in worst else f"t = {worst['t']:.4g}"
    err.print(
        f"[yellow]{100 * worst['share']:.2g} % of the bonds were beyond the test data of {escape(summary['force'])} at {at}, where most "
        f"were; the farthest of all outputs by {farthest:.2g} in log-stretch. There the energy goes on as its powers do.[/]",
        soft_wrap=True,
    )


class _Bar:
    """Progress of a simulation on the terminal; the residual falls over many decades, so the bar counts decades."""

    def __init__(self, scene) -> None:
        self._scene = scene
        self._progress = Bar()
        self._task = None
        self._first = None
        self._moving = False
        self._account = ""
        self._rate: Rate | None = None

    def __enter__(self) -> _Bar:
        self._progress.start()
        return self

    def __exit__(self, *exception) -> None:
        self._progress.stop()

    def compiling(self) -> None:
        """Print that kernels are being compiled."""
        note("Compiling kernels, once on this machine; later runs load them from the cache.")

    def level(self, number: int, parameter: float) -> None:
        """Start the progress bar of the next output."""
        if self._scene.stretched:
            self._begin(f"{self._scene.name}: stretch {parameter:g} ({number + 1}/{len(self._scene.stretches)})")
        else:
            self._begin(f"{self._scene.name}: t = {parameter:g} (step {number + 1}/{len(self._scene.steps)})")
        self._moving = False

    def _begin(self, title: str) -> None:
        if self._task is not None:
            self._progress.remove_task(self._task)
        self._task, self._first = self._progress.add_task(title, total=1.0, state=""), None
        self._rate = None

    def _rate_of(self, what: str, count: int) -> str:
        """Return the rate of evaluations or steps since the first call for this output."""
        if self._rate is None:
            self._rate = Rate(what)
            self._rate.begin(count)
        return self._rate.after(count)

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        """Show the progress of the residual towards its tolerance."""
        if self._first is None or residual > self._first:
            self._first = residual
        span = math.log10(max(self._first, 1e-300) / tolerance)
        done = math.log10(max(self._first, 1e-300) / max(residual, 1e-300)) / span if span > 0 else 1.0
        state = f"residual {residual:.1e}, {evaluations} evaluations{self._rate_of('evaluations', evaluations)}"
        self._progress.update(self._task, completed=min(max(done, 0.0), 1.0), state=state)

    def dynamics(self, done: float, parameter: float, broken_bonds: int) -> None:
        """Show the progress of a dynamic stage."""
        if not self._moving:
            self._begin(f"{self._scene.name}: dynamics")
            self._moving = True
        broken = f", {broken_bonds} bonds broken" if self._scene.fracture is not None else ""
        state = f"{'stretch ' if self._scene.stretched else 't = '}{parameter:.4f}{broken}{self._account}"
        self._progress.update(self._task, completed=done, state=state)

    def account(self, steps: int, kinetic_energy: float, strain_energy: float) -> None:
        """Store the energies that the next progress line shows."""
        rate = self._rate_of("steps", steps)
        self._account = f", energies {strain_energy:.3g} strain, {kinetic_energy:.2g} kinetic{rate}"


def _print_crack(result) -> None:
    summary, units = result.summary, result.scene.units
    crack = summary["crack"]
    if crack["start"] is None:
        out.print(f"No bond reached the critical stretch {summary['critical_stretch']:.4g}.")
        return
    start, peak = crack["start"], crack.get("peak")
    where = " and ".join(f"({', '.join(f'{value:.3g}' for value in tip)})" for tip in start["tips"])
    at = f"stretch {start['stretch']:.4f}" if "stretch" in start else f"t = {start['t']:.4f}"
    most = ""
    if peak:
        most = f"peak nominal stress {units.amount(peak['nominal_stress'], 'stress', '.5g')} at stretch {peak['stretch']:.4f}; "
    out.print(
        f"First bond broken at {where} at {at}; {most}"
        f"{crack['broken_bonds']} bonds broken, {'the body came apart' if crack['through'] else 'the body still holds'}; "
        f"{summary['unsupported_points']} points without support",
        soft_wrap=True,
    )


def print_cells(result) -> None:
    """Print the cell size where it differs from the requested spacing."""
    summary, asked, units = result.summary, result.scene.spacing, result.scene.units
    horizon = units.amount(summary["horizon"], "length", ".6g")
    if result.scene.body.shape == "mesh":
        spacing = units.amount(summary["spacing"], "length", ".6g")
        out.print(f"The mesh has a spacing of {spacing}; the horizon is {horizon}", soft_wrap=True)
    elif any(side != asked for side in summary["cell_size"]):
        out.print(
            f"Cells of {units.amount(' x '.join(f'{side:.6g}' for side in summary['cell_size']), 'length')} fill the body, the nearest to "
            f"the spacing of {asked:g}; the horizon is {horizon}",
            soft_wrap=True,
        )


def print_levels(result) -> None:
    """Print a table of the levels of a stretched body, with the exact solution where there is one."""
    summary, units = result.summary, result.scene.units
    compared = any("nominal_stress_reference" in level for level in summary["levels"])
    # The mean narrowing where the exact solution is homogeneous, the greatest where it is not.
    homogeneous = any("lateral_displacement_reference" in level for level in summary["levels"])
    lateral = "lateral_displacement" if homogeneous else "greatest_lateral_displacement"
    table = Table(title=f"{summary['scene']}, force {summary['force']}, {summary['n_points']} points", title_justify="left")
    table.add_column("stretch", justify="right")
    quantities = [
        (lateral, "lateral" if homogeneous else "greatest lateral", "length"),
        ("nominal_stress", "stress", "stress"),
    ]
    quantities = [row for row in quantities if any(row[0] in level for level in summary["levels"])]
    for _, quantity, unit in quantities:
        table.add_column(units.label(quantity, unit), justify="right")
        if compared:
            table.add_column("exact" if homogeneous else "reference", justify="right")
            table.add_column("error (%)", justify="right")
    columns = {}
    for key, *_ in quantities:
        greatest = max((abs(level[key]) for level in summary["levels"] if key in level), default=0.0)
        for column in (key, f"{key}_reference"):
            columns[column] = _figures([level.get(column) for level in summary["levels"]], greatest)
    for number, level in enumerate(summary["levels"]):
        cells = [f"{level['stretch']:.10g}"]
        for key, *_ in quantities:
            cells.append(columns[key][number])
            if compared:
                error = level.get(f"{key}_error")
                cells += [columns[f"{key}_reference"][number], "" if error is None else f"{100 * error:+.4f}"]
        table.add_row(*cells)
    if summary["levels"]:
        show(table)
        print_grip(result)
    _print_end(result)


def _figures(values: list[float | None], greatest: float) -> list[str]:
    """Values of a column as they are shown, blanks for None: with five decimals, or in powers of ten where the greatest asks for them."""
    form = ".5f" if greatest == 0 or 0.01 <= greatest < 1e7 else ".4e"
    # Rounded first: no minus before a zero.
    return ["" if value is None else format(round(value, 5) + 0.0 if form == ".5f" else value, form) for value in values]


def _print_outputs(result) -> None:
    """Print the forces on the body at every output, without components that are always zero."""
    summary = result.summary
    units, moving, columns = result.scene.units, any("time" in level for level in summary["levels"]), {}
    title = f"{summary['scene']}, force {summary['force']}, {summary['n_points']} points: forces on the body"
    table = Table(title=title, title_justify="left")
    table.add_column("t", justify="right")
    if moving:
        table.add_column(units.label("time", "time"), justify="right")
    # Components that are zero throughout are left out; of what has next to no force, as turned parts have, the moment is told.
    extent = float(np.ptp(result.body.points, axis=0).max())
    greatest = max((abs(value) for level in summary["levels"] for force in level["forces"].values() for value in force), default=0.0)
    nothing = LEAST_SHOWN * min(1.0, greatest)
    for name in dict.fromkeys(name for level in summary["levels"] for name in level["forces"]):
        forces = [level["forces"][name] for level in summary["levels"]]
        # About x3 alone in the plane, about all three axes in space.
        moments = np.array([np.atleast_1d(level["moments"][name]) for level in summary["levels"]])
        least = max(nothing, LEAST_SHARE * np.abs(moments).max() / extent)
        shown = [component for component in range(len(forces[0])) if any(abs(force[component]) >= least for force in forces)]
        for component in shown:
            columns[units.label(f"{name} x{component + 1}", "force")] = [force[component] for force in forces]
        turned = np.flatnonzero(np.abs(moments).max(axis=0) >= nothing * min(1.0, extent)) if moments.shape[1] == 3 else [0] * (not shown)
        for component in turned:
            which = f" about x{component + 1}" if moments.shape[1] == 3 else ""
            columns[units.label(f"{name} moment{which}", "energy")] = moments[:, component].tolist()
    for title in columns:
        table.add_column(title, justify="right")
    greatest = max((abs(value) for values in columns.values() for value in values), default=0.0)
    shown_columns = [_figures(values, greatest) for values in columns.values()]
    for number, level in enumerate(summary["levels"]):
        cells = [f"{level['t']:g}"]
        if moving:
            cells.append(f"{level['time']:.4g}" if "time" in level else "")
        table.add_row(*cells, *(figures[number] for figures in shown_columns))
    if summary["levels"]:
        show(table)
        if "probes" in summary["levels"][0]:
            _print_probes(summary, units)
    _print_end(result)


def _print_probes(summary, units) -> None:
    """Print the displacements of the probes at every output."""
    table = Table(title="displacements of the probes", title_justify="left")
    table.add_column("t", justify="right")
    names = list(summary["levels"][0]["probes"])
    for name in names:
        for component in range(1, len(summary["levels"][0]["probes"][name]["displacement"]) + 1):
            table.add_column(units.label(f"{name} x{component}", "length"), justify="right")
    rows = [[value for name in names for value in level["probes"][name]["displacement"]] for level in summary["levels"]]
    greatest = max((abs(value) for row in rows for value in row), default=0.0)
    columns = [_figures(list(values), greatest) for values in zip(*rows, strict=True)]
    for number, level in enumerate(summary["levels"]):
        table.add_row(f"{level['t']:g}", *(figures[number] for figures in columns))
    show(table)


def _print_accounts(result) -> None:
    """Print the energy balance of every dynamic stage."""
    for told in result.summary.get("dynamics", ()):
        if told["energy_gap"] is None:
            out.print(f"No account of energy: {told['remark']}", soft_wrap=True)
        else:
            put_in = result.scene.units.amount(told["energy_put_in"], "energy", ".4g")
            out.print(f"Account of energy: off by {told['energy_gap']:+.2g} % of the {put_in} put in", soft_wrap=True)


def _print_end(result) -> None:
    summary = result.summary
    if "crack" in summary:
        _print_crack(result)
    _print_accounts(result)
    threads = f"{summary['threads']} thread{'s' if summary['threads'] != 1 else ''}"
    out.print(
        f"{summary['n_force_evaluations']} force evaluations, {summary['ns_per_directed_bond']:.2f} ns per directed bond on {threads}, "
        f"{summary['seconds_total']:.1f} s in all, "
        f"of which {summary['seconds_compile']:.1f} s compiling",
        soft_wrap=True,
    )


def print_grip(result) -> None:
    """Print which of two unequal cross-sections the nominal stress refers to."""
    summary, units = result.summary, result.scene.units
    level, areas = summary["levels"][-1], summary["grip_areas"]
    used = level["nominal_stress_grip"]
    other = next(edge for edge in areas if edge != used)
    if not math.isclose(areas[used], areas[other], rel_tol=1e-6):
        out.print(
            f"Stress: force of the {used} grip over its cross-section of {units.amount(areas[used], 'length', '.5g', '^2')}; "
            f"the {other} grip's is {units.amount(areas[other], 'length', '.5g', '^2')}.",
            soft_wrap=True,
        )


@command()
def scenes(
    name: Annotated[str | None, typer.Argument(metavar="[SCENE]", help="Scene to show: a name, or the path of a scene file.")] = None,
    plot: Annotated[
        bool, typer.Option("--plot", help="Plot the scene with its regions, grips, loads and probes, without running it.")
    ] = False,
    change: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a scene key (same as in `run`); may be repeated.")
    ] = None,
    pictures: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the picture.")] = Path(),
    as_json: AsJson = False,
) -> None:
    """List the built-in scenes, or show (and plot) one of them."""
    from ..scenes import SceneError, load_scene, scene_names

    if name is None:
        with bad_input(ValueError):
            if plot or change:
                raise ValueError(f"{'--plot' if plot else '--set'} needs the scene that is meant: pdsurrogate scenes NAME")
        known = [load_scene(one) for one in scene_names()]
        if as_json:
            print_json([{"name": one.name, "dimension": one.dimension, "title": one.title} for one in known])
        table = Table(title="Scenes", title_justify="left")
        for title in ("scene", "body", "what it is"):
            table.add_column(title)
        for one in known:
            table.add_row(one.name, "in space" if one.dimension == 3 else "in the plane", one.title)
        show(table)
        return
    with bad_input(SceneError):
        scene = load_scene(name, change or [])
    given = scene.model_dump(mode="json", by_alias=True, exclude_defaults=True, exclude_none=True)
    if as_json:
        print_json(given)
    table = Table(title=f"Scene {scene.name}", title_justify="left", show_header=False)
    table.add_column("key")
    table.add_column("value", overflow="fold")
    for key, value in given.items():
        for number, entry in enumerate(value) if isinstance(value, list) and value and isinstance(value[0], dict) else ((None, value),):
            shown = ", ".join(f"{inner} = {json.dumps(said)}" for inner, said in entry.items()) if isinstance(entry, dict) else entry
            table.add_row(key if number is None else f"{key}.{number}", escape(shown if isinstance(shown, str) else json.dumps(shown)))
    show(table)
    if plot:
        from ..results import figures
        from ..results.files import check_writable
        from ..run.preview import preview

        path = pictures / f"{scene.name}-scene.png"
        with bad_input(SceneError, OSError):
            check_writable(pictures)
            figure = preview(scene)
        with writing(pictures):
            figures.save(figure, path)
        note(f"Wrote {path}")


@command()
def new(
    file: Annotated[Path, typer.Argument(metavar="FILE.toml", help="Path of the scene file to create.")],
) -> None:
    """Write a commented scene to start from."""
    from importlib import resources

    from ..results.files import write_text
    from ..scenes import load_scene

    with bad_input(ValueError):
        if file.suffix != ".toml":
            raise ValueError(f"{file}: the file of a scene ends in .toml")
        if file.exists():
            raise ValueError(f"{file}: the file already exists; choose another name")
        name = re.sub(r"[^A-Za-z0-9 ._-]", "-", file.stem).lstrip(" ._-")[:64] or "scene"
    text = (resources.files(__package__) / "template.toml").read_text("utf-8")
    with writing(file):
        write_text(file, text.format(name=name, file=file))
    load_scene(file)
    note(f"Wrote {file}; look at it with: pdsurrogate scenes {file} --plot; run it with: pdsurrogate run {file} --out out")
