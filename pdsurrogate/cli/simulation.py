"""Simulation by the command ``run``, and functions that print its result."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from ..artifacts import with_material
from ..artifacts.material import in_words
from ..forces import ForceModel
from ..ranks import Communicator
from ..results import Result
from ..results.checkpoint import NAME
from ..results.folder import occupied
from ..run.interruption import heard
from ..run.simulate import SimulationFailed, SimulationInterrupted, simulate
from ..scenes import Scene
from .command import check_folder
from .terminal import (
    FAILED,
    INTERRUPTED,
    WARNING,
    Bar,
    ended,
    note,
    out,
    print_json,
    print_rows,
    print_table,
    warn,
    writing,
)

LEAST_SHOWN = 5e-6
"""Size of a number, relative to the greatest one of the table, up to which it is printed as 0:
equilibria are not more accurate. Forces and moments are compared with each other, too, through the
body's distance from the origin.
"""


def simulated(
    ranks: Communicator, asked: Scene, force: str | None, threads: int | None, options: dict
) -> None:
    """Run a scene with a force model, print its result, and write it to a folder, if given;
    `options` are those of `simulate`.
    """
    described, model = with_material(asked, force)
    if described is not asked:
        of = (asked.material and asked.material.artifact) or model.name
        note(f"Material of {of}: {in_words(described.law())}")
    folder = None if options["folder"] is None else Path(options["folder"])
    writes = folder if ranks.rank == 0 else None
    check_folder(writes)
    failure = None
    with ExitStack() as held:
        if writes is not None:
            with writing(writes):
                held.enter_context(occupied(writes))
        try:
            with writing(folder), Bar(described.name):
                result = simulate(described, model, threads=threads, **options)
        except SimulationFailed as error:
            failure = error
            result = error.result
        late = failure is None and heard.is_set()
        print_result(result)
        if writes is not None:
            # The tables of an interrupted run are written, and pictures take their time.
            if not (late or isinstance(failure, SimulationInterrupted)):
                with writing(writes):
                    result.save(writes)
            note(f"Results in {writes}")
            if result.states.in_pieces:
                note(
                    "Each rank wrote its own part of the fields, so no picture is drawn; open"
                    f" {described.name}.pvd in ParaView"
                )
        print_json(result.summary)
        ranks.barrier()  # a rank that is alone with an error ends the others
    _warn_of(result, described, model)
    if late:
        raise ended(
            INTERRUPTED, "interrupted after the last output: only the pictures are missing", WARNING
        )
    if isinstance(failure, SimulationInterrupted):
        raise ended(INTERRUPTED, f"{failure}; {how_to_resume(folder)}", WARNING)
    if failure is not None:
        raise ended(FAILED, str(failure), "[red]pdsurrogate: the run failed:[/]")


def how_to_resume(folder: Path | None) -> str:
    """Return a text that tells the user how to resume an interrupted run, or why it cannot be
    resumed.
    """
    if folder is None:
        return "the run cannot be resumed: only runs with --out write checkpoints"
    if not (folder / NAME).is_file():
        return "the run cannot be resumed: it had not yet written a checkpoint"
    return f"to resume from the checkpoint in {folder}, add --resume to the command"


def _warn_of(result: Result, scene: Scene, model: ForceModel) -> None:
    """Print warnings if stability was not checked, or if states lay outside the test data of the
    surrogate.
    """
    if any(level.get("stability") == "not checked" for level in result.levels):
        pushed = (
            "The grips compress the body" if scene.stretched else "Parts of the body are compressed"
        )
        why = f"{model.name} defines no energy; use a force that does, such as bond-energy"
        if model.family == "bond energy":
            why = (
                "a pressure has no potential on a part of a closed boundary, and none in plane"
                " stress unless its thickness is undeformed"
            )
        warn(f"{pushed}, but whether it buckles was not checked: {why}.")
    rows = result.summary.get("beyond_data", [])
    worst = max(rows, key=lambda row: row["share"], default=None)
    if worst is not None and worst["share"]:
        farthest = max(row["log_stretch"] for row in rows)
        at = f"stretch {worst['stretch']:.4g}" if "stretch" in worst else f"t = {worst['t']:.4g}"
        warn(
            f"Up to {100 * worst['share']:.3g} % of the bonds (at {at}) were outside the range of"
            f" the test data of {result.summary['force']}, by at most {farthest:.2g} in logarithmic"
            " stretch; the fitted energy was extrapolated there."
        )


def print_result(result: Result) -> None:
    """Print the result of a run: size of the cells, values at the outputs, cracks, error of the
    energy balance, and cost.
    """
    print_cells(result)
    if result.levels:
        (print_levels if result.scene.stretched else _print_outputs)(result)
    summary = result.summary
    _print_rates(result)
    if "crack" in summary:
        _print_crack(result)
    slow = [summary["quasi_static"]] if "quasi_static" in summary else []
    for account in [*slow, *summary.get("dynamics", ())]:
        if account["energy_gap"] is None:
            out.print(f"Energy balance: {account['remark']}")
        else:
            put_in = result.scene.units.amount(account["energy_put_in"], "energy", ".4g")
            out.print(
                f"Energy balance: closed to {account['energy_gap']:+.2g} % of the {put_in} put in"
            )
    threads = f"{summary['threads']} thread{'s' if summary['threads'] != 1 else ''}"
    if summary.get("ranks", 1) > 1:
        threads = f"{summary['ranks']} ranks of {threads}"
    out.print(
        f"{summary['n_force_evaluations']} force evaluations,"
        f" {summary['ns_per_directed_bond']:.2f} ns per directed bond on"
        f" {threads}\n{summary['seconds_total']:.1f} s in total, {summary['seconds_compile']:.1f}"
        " s of it compilation"
    )


def print_cells(result: Result) -> None:
    """Print the size of the cells, if it differs from the spacing in the scene, and the horizon."""
    summary = result.summary
    units = result.scene.units
    if any(side != result.scene.spacing for side in summary["cell_size"]):
        cells = units.amount(" x ".join(f"{side:.6g}" for side in summary["cell_size"]), "length")
        horizon = units.amount(summary["horizon"], "length", ".6g")
        out.print(f"The cells measure {cells}; the horizon is {horizon}")


def print_levels(result: Result) -> None:
    """Print a table of stress and lateral displacement at every stretch, with the exact solution
    or the reference if there is one.
    """
    units = result.scene.units
    levels = result.levels
    # The mean narrowing if the exact solution is homogeneous, else the greatest one.
    homogeneous = any("lateral_displacement_reference" in level for level in levels)
    lateral = "lateral" if homogeneous else "greatest lateral"
    columns = [("stretch", [f"{level['stretch']:.10g}" for level in levels])]
    if result.scene.times:
        columns.append((units.label("time", "time"), [f"{level['time']:.6g}" for level in levels]))
    for key, quantity, kind in (
        (f"{lateral}_displacement".replace(" ", "_"), lateral, "length"),
        ("nominal_stress", "stress", "stress"),
    ):
        for ending, heading in (
            ("", units.label(quantity, kind)),
            ("_reference", "exact" if homogeneous else "reference"),
            ("_error", "error (%)"),
        ):
            known = {
                n: level[key + ending] for n, level in enumerate(levels) if key + ending in level
            }
            if known:
                greatest = max(map(abs, known.values()))
                form = ".5f" if greatest == 0 or 0.01 <= greatest < 1e7 else ".4e"
                shown = {
                    n: f"{100 * value:+.4f}" if ending == "_error" else f"{value:{form}}"
                    for n, value in known.items()
                }
                columns.append((heading, [shown.get(n, "") for n in range(len(levels))]))
    headings, cells = zip(*columns, strict=True)
    print_table(_title(result), headings, zip(*cells, strict=True), left=0)
    areas = result.summary["grip_areas"]
    used = levels[-1]["nominal_stress_grip"]
    if not np.allclose([*areas.values()], areas[used], rtol=1e-6, atol=0):
        area = units.amount(areas[used], "area", ".5g")
        out.print(
            f"Nominal stress: force of the {used} grip divided by its cross-section of {area}"
        )


def _print_outputs(result: Result) -> None:
    """Print the forces on each region at every output, the displacements of the probes, and contact
    with obstacles.

    Moments are printed in space, and in the plane where a region is turned.
    """
    scene = result.scene
    units = result.scene.units
    levels = result.levels
    out.print(_title(result), style="bold", highlight=False)
    axes = ("x1", "x2", "x3")[: scene.dimension]
    far = np.abs(result.body.points).max()
    force, moment = (
        max((np.abs(value).max() for level in levels for value in level[key].values()), default=0.0)
        for key in ("forces", "moments")
    )
    about = axes if scene.dimension == 3 else ("counter-clockwise",)
    contact = units.label("area", "area"), units.label("penetration", "length")
    tables = {
        "forces": ("Forces on the body", "force", axes, max(force, moment / far)),
        "moments": ("Moments about the origin", "energy", about, max(moment, force * far)),
        "probes": ("Displacements of the probes", "length", axes, 0.0),
        "contact": ("Contact with obstacles", "", contact, 0.0),
    }
    if scene.dimension == 2 and not any(entry.rotation for entry in scene.prescribed):
        del tables["moments"]
    for key, (title, kind, headings, size) in tables.items():
        found = {
            name: [_numbers(level[key][name]) for level in levels]
            for level in levels
            for name in level.get(key, ())
        }
        least = LEAST_SHOWN * max([size, *(np.abs(all_).max() for all_ in found.values())])
        rows = []
        for name, values in found.items():
            for level, numbers in zip(levels, values, strict=True):
                at = f"{level['t']:g}"
                at += f", {units.amount(level['time'], 'time', '.4g')}" if "time" in level else ""
                shown = np.where(np.abs(numbers) <= least, 0.0, numbers).tolist()
                rows.append({"name": name, "t": at, **dict(zip(headings, shown, strict=True))})
        print_rows(units.label(title, kind) if kind else title, rows, ".5g")


def _numbers(found: Any) -> np.ndarray:
    """Return the numbers of a region, probe or obstacle at an output, shape (components,)."""
    if isinstance(found, dict):
        found = found.get("displacement", [*found.values()])
    return np.atleast_1d(found)


def _print_rates(result: Result) -> None:
    """Print the energy release rates of cracks that grow from precuts, at the last output that
    has them.
    """
    units = result.scene.units
    tips = result.summary.get("crack", {}).get("tips", [])
    unit = f" {units.stress} {units.length}" if units.stress and units.length else ""
    rows = [row["cracks"] for row in [*result.levels, *tips] if row.get("cracks")]
    for crack in rows[-1] if rows else ():
        rate = crack["energy_release_rate"]
        length = units.amount(crack["length"], "length", ".4g")
        told = f"no G: {crack['remark']}" if rate is None else f"G = {rate:.4g}{unit}"
        if crack.get("closed") and rate is not None:
            told += "; its faces touch and pass through one another, so G has no meaning"
        out.print(f"Crack to {_place(crack['tip'])}, length {length}: {told}")


def _print_crack(result: Result) -> None:
    summary = result.summary
    units = result.scene.units
    crack = summary["crack"]
    if crack["start"] is None:
        materials = [summary, *summary.get("materials", ()), *summary.get("interfaces", ())]
        stretches = sorted(
            {f"{one['critical_stretch']:.4g}" for one in materials if "critical_stretch" in one}
        )
        strong = ", and no disc the strength" if "strength" in summary else ""
        told = " or ".join(stretches)
        out.print(f"No bond broke: none reached the critical stretch {told}{strong}")
        return
    start = crack["start"]
    where = " and ".join(map(_place, start["tips"]))
    at = f"stretch {start['stretch']:.4f}" if "stretch" in start else f"t = {start['t']:.4f}"
    cause = f", by {start['cause']}" if "cause" in start else ""
    out.print(f"First broken bond: at {where}, {at}{cause}")
    peak = crack["peak"]
    if peak:
        out.print(
            f"Peak nominal stress: {units.amount(peak['nominal_stress'], 'stress', '.5g')} at"
            f" stretch {peak['stretch']:.4f}"
            if "stretch" in peak
            else f"Greatest force: {units.amount(peak['force'], 'force', '.5g')} of"
            f" {peak['name']} at t = {peak['t']:.4f}"
        )
    if crack["through"]:
        body = "the body has come apart"
    elif summary["status"] == "failed":
        body = "the run failed before the body came apart: its peak is a lower bound"
    else:
        # A row before bonds that have broken since is not the last state.
        now = {"broken_bonds": crack["broken_bonds"]}
        last = now | (result.history[-1] if result.history else {})
        at_peak = {key: each for key, each in (peak or {}).items() if key not in ("force", "name")}
        rising = peak and (at_peak | now).items() <= last.items()
        body = f"the body holds together{', and its force was still rising' if rising else ''}"
    out.print(
        f"{crack['broken_bonds']} bonds broken, {summary['unsupported_points']} points with too few"
        f" bonds left; {body}"
    )


def _title(result: Result) -> str:
    return (
        f"{result.summary['scene']}, force {result.summary['force']}, {result.summary['n_points']}"
        " points"
    )


def _place(coordinates: Sequence[float]) -> str:
    return f"({', '.join(f'{value:.3g}' for value in coordinates)})"
