"""Command ``run``, which runs a scene, and functions that print its result."""

import math
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Argument, Option

from ..artifacts import default_force, with_material
from ..artifacts.material import in_words
from ..forces import ForceModel
from ..ranks import communicator
from ..results import Result
from ..results.checkpoint import NAME
from ..results.folder import occupied
from ..run.simulate import Progress, SimulationFailed, SimulationInterrupted, simulate
from ..scenes import Scene, load_scene
from .command import MaxTime, Overwrite, SetScene, check_folder
from .terminal import FAILED, INTERRUPTED, WARNING, Bar, ended, err, note, out, print_json, print_table, share, warn, writing

FORCE_HELP = "analytic, bond-energy, nosb, ba-nosb, or an artifact (NAME, NAME@VERSION, path); default: chosen for the scene."

LEAST_SHARE = 0.01
"""Force on a region, divided by its moment per extent of the body, below which the force is not printed: a part that is turned has
such small forces. Chosen: with a smaller ratio tables have columns of them, with a greater one small forces that are meant are missing."""

LEAST_SHOWN = 5e-6
"""Force below which a component has no column in a table of five decimals; if the greatest force is below 1, relative to that force."""


Column = tuple[str, Sequence[str | float | None]]
"""Heading and cells of a column of a table: texts, or numbers that are all printed alike; None is an empty cell."""


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
) -> None:
    """Run a scene and compare it with its reference."""
    ranks = communicator()
    share(ranks)
    asked = load_scene(scene, change or [])
    described, model = (asked, default_force(asked)) if force is None else with_material(asked, force)
    if described is not asked:
        err.print(f"Material of {model.name}: {in_words(described.material.build())}", soft_wrap=True, markup=False)
    folder = None if out_folder is None else Path(out_folder)
    writes = folder if ranks.rank == 0 else None
    check_folder(writes)
    failure = None
    with ExitStack() as held:
        if writes is not None:
            with writing(writes):
                held.enter_context(occupied(writes))
        options = {"folder": out_folder, "resume": resume, "overwrite": overwrite, "max_time": max_time}
        try:
            with writing(folder), Bar() as bar:
                result = simulate(described, model, threads=threads, progress=_Shown(described, bar), **options)
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
        print_json(result.summary)
        ranks.barrier()  # a rank that is alone with an error ends the others
    _warn_of(result, described, model)
    if isinstance(failure, SimulationInterrupted):
        raise ended(INTERRUPTED, f"{failure}; {how_to_resume(folder)}", WARNING)
    if failure is not None:
        raise ended(FAILED, str(failure), "[red]pdsurrogate: the run failed:[/]")


def how_to_resume(folder: Path | None) -> str:
    """Return a text that tells the user how to resume an interrupted run, or why it cannot be resumed."""
    if folder is None:
        return "nothing was kept: give --out to be able to resume"
    if not (folder / NAME).is_file():
        return "it had not come to its first checkpoint"
    return f"the checkpoint is in {folder}: the same command with --resume goes on from it"


def _warn_of(result: Result, scene: Scene, model: ForceModel) -> None:
    """Print warnings if stability was not checked, or if states lay outside the domain or the test data of the surrogate."""
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
    """Progress of a simulation on a progress bar; the bar shows the logarithm of the residual, which falls over many decades."""

    def __init__(self, scene: Scene, bar: Bar) -> None:
        self._scene, self._bar = scene, bar
        self._first, self._account = 0.0, ""

    def compiling(self) -> None:
        """Print that kernels are being compiled."""
        note("Compiling kernels, once on this machine; later runs load them from the cache.")

    def level(self, number: int, parameter: float) -> None:
        """Begin a new bar for entry `number` (from 0) of the scene's ``stretches``, or of its ``steps`` if it has none.

        `parameter` is the value of that entry: a stretch, or a loading parameter t.
        """
        if self._scene.stretched:
            at = f"stretch {parameter:g} ({number + 1}/{len(self._scene.stretches)})"
        else:
            at = f"t = {parameter:g} (step {number + 1}/{len(self._scene.steps)})"
        self._first = 0.0
        self._bar.show(0.0, title=f"{self._scene.name}: {at}")

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        """Show the residual, and as the share done how far its logarithm has come from the greatest residual to the tolerance."""
        self._first = max(self._first, residual, 1e-300)
        span = math.log10(self._first / tolerance)
        done = math.log10(self._first / max(residual, 1e-300)) / span if span > 0 else 1.0
        rate = self._bar.rate("evaluations", evaluations)
        self._bar.show(min(max(done, 0.0), 1.0), f"residual {residual:.1e}, {evaluations} evaluations{rate}")

    def dynamics(self, done: float, parameter: float, broken_bonds: int) -> None:
        """Show the share done of a stage in dynamics, with the loading parameter and the number of broken bonds."""
        broken = f", {broken_bonds} bonds broken" if self._scene.fracture is not None else ""
        state = f"{'stretch ' if self._scene.stretched else 't = '}{parameter:.4f}{broken}{self._account}"
        self._bar.show(done, state, f"{self._scene.name}: dynamics")

    def account(self, steps: int, kinetic_energy: float, strain_energy: float) -> None:
        """Store the energies and the number of time steps per second as text, which the next call of `dynamics` shows."""
        rate = self._bar.rate("steps", steps)
        self._account = f", energies {strain_energy:.3g} strain, {kinetic_energy:.2g} kinetic{rate}"


def print_result(result: Result) -> None:
    """Print the result of a run: size of the cells, values at the outputs, cracks, error of the energy balance, and cost."""
    print_cells(result)
    if result.levels:
        (print_levels if result.scene.stretched else _print_outputs)(result)
    summary = result.summary
    if "crack" in summary:
        _print_crack(result)
    for account in summary.get("dynamics", ()):
        if account["energy_gap"] is None:
            out.print(f"No account of energy: {account['remark']}")
        else:
            put_in = result.scene.units.amount(account["energy_put_in"], "energy", ".4g")
            out.print(f"Account of energy: off by {account['energy_gap']:+.2g} % of the {put_in} put in")
    threads = f"{summary['threads']} thread{'s' if summary['threads'] != 1 else ''}"
    cost = f"{summary['n_force_evaluations']} force evaluations, {summary['ns_per_directed_bond']:.2f} ns per directed bond on {threads}"
    out.print(f"{cost}, {summary['seconds_total']:.1f} s in all, of which {summary['seconds_compile']:.1f} s compiling")


def print_cells(result: Result) -> None:
    """Print the spacing of a mesh, or the size of the cells if it differs from the spacing in the scene, and the horizon."""
    summary, asked, units = result.summary, result.scene.spacing, result.scene.units
    horizon = f"the horizon is {units.amount(summary['horizon'], 'length', '.6g')}"
    if result.scene.body.shape == "mesh":
        out.print(f"The mesh has a spacing of {units.amount(summary['spacing'], 'length', '.6g')}; {horizon}")
    elif any(side != asked for side in summary["cell_size"]):
        cells = units.amount(" x ".join(f"{side:.6g}" for side in summary["cell_size"]), "length")
        out.print(f"Cells of {cells} fill the body, the nearest to the spacing of {asked:g}; {horizon}")


def print_levels(result: Result) -> None:
    """Print a table of stress and lateral displacement at every stretch, with the exact solution or the reference if there is one."""
    units, levels = result.scene.units, result.levels
    compared = any("nominal_stress_reference" in level for level in levels)
    # The mean narrowing if the exact solution is homogeneous, else the greatest one.
    homogeneous = any("lateral_displacement_reference" in level for level in levels)
    lateral = ("lateral_displacement", "lateral") if homogeneous else ("greatest_lateral_displacement", "greatest lateral")
    columns = [("stretch", [f"{level['stretch']:.10g}" for level in levels])]
    for key, quantity, unit in ((*lateral, "length"), ("nominal_stress", "stress", "stress")):
        values, references, errors = ([level.get(name) for level in levels] for name in (key, f"{key}_reference", f"{key}_error"))
        if all(value is None for value in values):
            continue
        columns.append((units.label(quantity, unit), values))
        if compared:
            percent = ["" if error is None else f"{100 * error:+.4f}" for error in errors]
            columns += [("exact" if homogeneous else "reference", references), ("error (%)", percent)]
    _print_columns(_title(result), columns)
    print_grip(result)


def print_grip(result: Result) -> None:
    """Print to which grip's cross-section the nominal stress refers, if the cross-sections at the two grips differ."""
    units, areas, used = result.scene.units, result.summary["grip_areas"], result.levels[-1]["nominal_stress_grip"]
    other = next(edge for edge in areas if edge != used)
    if not math.isclose(areas[used], areas[other], rel_tol=1e-6):
        area, another = (units.amount(areas[edge], "length", ".5g", "^2") for edge in (used, other))
        force = f"Stress: force of the {used} grip over its cross-section of {area}"
        out.print(f"{force}; the {other} grip's is {another}.")


def _print_outputs(result: Result) -> None:
    """Print the forces on the body at every output, without components that are always zero, and the displacements of probes."""
    units, levels = result.scene.units, result.levels
    columns = [("t", [f"{level['t']:g}" for level in levels])]
    times = [f"{level['time']:.4g}" if "time" in level else "" for level in levels]
    timed = [(units.label("time", "time"), times)] if any(times) else []
    _print_columns(f"{_title(result)}: forces on the body", columns + timed + _force_columns(result))
    if "probes" in levels[0]:
        for name in levels[0]["probes"]:
            moved = zip(*(level["probes"][name]["displacement"] for level in levels), strict=True)
            columns += [(units.label(f"{name} x{component}", "length"), values) for component, values in enumerate(moved, 1)]
        _print_columns("displacements of the probes", columns)


def _force_columns(result: Result) -> list[Column]:
    """Return the columns of forces and moments of each region at all outputs, without negligible components.

    In the plane a region has a column for the moment only if its forces are negligible.
    """
    units, levels, columns = result.scene.units, result.levels, []
    extent = float(np.ptp(result.body.points, axis=0).max())
    greatest = max((abs(value) for level in levels for force in level["forces"].values() for value in force), default=0.0)
    zero = LEAST_SHOWN * min(1.0, greatest)
    for name in dict.fromkeys(name for level in levels for name in level["forces"]):
        # Moments are about x3 only in the plane, in three dimensions about all three axes.
        forces, moments = (np.array([np.atleast_1d(level[kind][name]) for level in levels]).T for kind in ("forces", "moments"))
        in_space, sizes = len(moments) == 3, np.abs(moments).max(axis=1)
        pulled = np.flatnonzero(np.abs(forces).max(axis=1) >= max(zero, LEAST_SHARE * sizes.max() / extent))
        turned = np.flatnonzero(sizes >= zero * min(1.0, extent)) if in_space else [0] * (not len(pulled))
        columns += [(units.label(f"{name} x{axis + 1}", "force"), forces[axis].tolist()) for axis in pulled]
        for axis in turned:
            about = f" about x{axis + 1}" if in_space else ""
            columns.append((units.label(f"{name} moment{about}", "energy"), moments[axis].tolist()))
    return columns


def _print_crack(result: Result) -> None:
    summary, units = result.summary, result.scene.units
    crack = summary["crack"]
    if crack["start"] is None:
        out.print(f"No bond reached the critical stretch {summary['critical_stretch']:.4g}.")
        return
    start = crack["start"]
    where = " and ".join(f"({', '.join(f'{value:.3g}' for value in tip)})" for tip in start["tips"])
    at = f"stretch {start['stretch']:.4f}" if "stretch" in start else f"t = {start['t']:.4f}"
    told = [f"First bond broken at {where} at {at}"]
    if peak := crack.get("peak"):
        told += [f"peak nominal stress {units.amount(peak['nominal_stress'], 'stress', '.5g')} at stretch {peak['stretch']:.4f}"]
    told += [f"{crack['broken_bonds']} bonds broken, {'the body came apart' if crack['through'] else 'the body still holds'}"]
    out.print("; ".join([*told, f"{summary['unsupported_points']} points without support"]))


def _title(result: Result) -> str:
    return f"{result.summary['scene']}, force {result.summary['force']}, {result.summary['n_points']} points"


def _print_columns(title: str, columns: Sequence[Column]) -> None:
    """Print a table given by columns, each a heading with its cells."""
    print_table(title, [heading for heading, _ in columns], zip(*(_figures(cells) for _, cells in columns), strict=True), left=0)


def _figures(cells: Sequence[str | float | None]) -> list[str]:
    """Return the cells of a column as text: all numbers with five decimals, or all in the form 1.2345e-06 if the greatest does not fit."""
    greatest = max((abs(cell) for cell in cells if isinstance(cell, float)), default=0.0)
    form = ".5f" if greatest == 0 or 0.01 <= greatest < 1e7 else ".4e"

    def text(cell: str | float | None) -> str:
        if cell is None or isinstance(cell, str):
            return cell or ""
        # Rounded first, so that no zero has a minus.
        return format(round(cell, 5) + 0.0 if form == ".5f" else cell, form)

    return [text(cell) for cell in cells]
