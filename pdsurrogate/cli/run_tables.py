"""Tables and lines on the result of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..results import Result
from .terminal import out, print_table

LEAST_SHARE = 0.01
"""Share of the moment over the extent of the body below which a force is not printed: a part that is turned has smaller ones."""

LEAST_SHOWN = 5e-6
"""Force that is printed as zero, relative to the greatest one where that is below 1: tables have five decimals."""

Column = tuple[str, Sequence[str]]


def print_result(result: Result) -> None:
    """Print the result of a run: cells, outputs, cracks, the account of energy, and the time taken."""
    print_cells(result)
    (print_levels if result.scene.stretched else _print_outputs)(result)
    summary = result.summary
    if "crack" in summary:
        _print_crack(result)
    for account in summary.get("dynamics", ()):
        if account["energy_gap"] is None:
            out.print(f"No account of energy: {account['remark']}", soft_wrap=True)
        else:
            put_in = result.scene.units.amount(account["energy_put_in"], "energy", ".4g")
            out.print(f"Account of energy: off by {account['energy_gap']:+.2g} % of the {put_in} put in", soft_wrap=True)
    threads = f"{summary['threads']} thread{'s' if summary['threads'] != 1 else ''}"
    out.print(
        f"{summary['n_force_evaluations']} force evaluations, {summary['ns_per_directed_bond']:.2f} ns per directed bond on {threads}, "
        f"{summary['seconds_total']:.1f} s in all, of which {summary['seconds_compile']:.1f} s compiling",
        soft_wrap=True,
    )


def print_cells(result: Result) -> None:
    """Print the size of the cells if it differs from the spacing asked for."""
    summary, asked, units = result.summary, result.scene.spacing, result.scene.units
    horizon = f"the horizon is {units.amount(summary['horizon'], 'length', '.6g')}"
    if result.scene.body.shape == "mesh":
        out.print(f"The mesh has a spacing of {units.amount(summary['spacing'], 'length', '.6g')}; {horizon}", soft_wrap=True)
    elif any(side != asked for side in summary["cell_size"]):
        cells = units.amount(" x ".join(f"{side:.6g}" for side in summary["cell_size"]), "length")
        out.print(f"Cells of {cells} fill the body, the nearest to the spacing of {asked:g}; {horizon}", soft_wrap=True)


def print_levels(result: Result) -> None:
    """Print the levels of a stretched body, with the exact solution or the reference if there is one."""
    units, levels = result.scene.units, result.levels
    if not levels:
        return
    compared = any("nominal_stress_reference" in level for level in levels)
    # The mean narrowing if the exact solution is homogeneous, else the greatest one.
    homogeneous = any("lateral_displacement_reference" in level for level in levels)
    lateral = ("lateral_displacement", "lateral") if homogeneous else ("greatest_lateral_displacement", "greatest lateral")
    columns: list[Column] = [("stretch", [f"{level['stretch']:.10g}" for level in levels])]
    for key, quantity, unit in ((*lateral, "length"), ("nominal_stress", "stress", "stress")):
        values, references, errors = ([level.get(name) for level in levels] for name in (key, f"{key}_reference", f"{key}_error"))
        greatest = _greatest(values)
        if all(value is None for value in values):
            continue
        columns.append((units.label(quantity, unit), _figures(values, greatest)))
        if compared:
            columns.append(("exact" if homogeneous else "reference", _figures(references, greatest)))
            columns.append(("error (%)", ["" if error is None else f"{100 * error:+.4f}" for error in errors]))
    _print_columns(_title(result), columns)
    print_grip(result)


def print_grip(result: Result) -> None:
    """Print which of two unequal cross-sections the nominal stress refers to."""
    units, areas, used = result.scene.units, result.summary["grip_areas"], result.levels[-1]["nominal_stress_grip"]
    other = next(edge for edge in areas if edge != used)
    if not math.isclose(areas[used], areas[other], rel_tol=1e-6):
        area, another = (units.amount(areas[edge], "length", ".5g", "^2") for edge in (used, other))
        force = f"Stress: force of the {used} grip over its cross-section of {area}"
        out.print(f"{force}; the {other} grip's is {another}.", soft_wrap=True)


def _print_outputs(result: Result) -> None:
    """Print the forces on the body at every output, without components that are always zero, and the displacements of probes."""
    units, levels = result.scene.units, result.levels
    if not levels:
        return
    columns: list[Column] = [("t", [f"{level['t']:g}" for level in levels])]
    if any("time" in level for level in levels):
        columns.append((units.label("time", "time"), [f"{level['time']:.4g}" if "time" in level else "" for level in levels]))
    values = _force_columns(result)
    greatest = _greatest([value for column in values.values() for value in column])
    columns += ((title, _figures(column, greatest)) for title, column in values.items())
    _print_columns(f"{_title(result)}: forces on the body", columns)
    if "probes" in levels[0]:
        moved = {name: np.array([level["probes"][name]["displacement"] for level in levels]) for name in levels[0]["probes"]}
        greatest = max((float(np.abs(column).max()) for column in moved.values()), default=0.0)
        columns = columns[:1]
        for name, values in moved.items():
            headings = (units.label(f"{name} x{component}", "length") for component in range(1, values.shape[1] + 1))
            columns += ((heading, _figures(column.tolist(), greatest)) for heading, column in zip(headings, values.T, strict=True))
        _print_columns("displacements of the probes", columns)


def _force_columns(result: Result) -> dict[str, list[float]]:
    """Return the non-negligible forces and moments of each region by heading; in the plane the moment only if there is no force."""
    units, levels, columns = result.scene.units, result.levels, {}
    extent = float(np.ptp(result.body.points, axis=0).max())
    zero = LEAST_SHOWN * min(1.0, _greatest([value for level in levels for force in level["forces"].values() for value in force]))
    for name in dict.fromkeys(name for level in levels for name in level["forces"]):
        forces = np.array([level["forces"][name] for level in levels])
        # In the plane about x3 only, in three dimensions about all three axes.
        moments = np.array([np.atleast_1d(level["moments"][name]) for level in levels])
        in_space, sizes = moments.shape[1] == 3, np.abs(moments).max(axis=0)
        shown = np.flatnonzero(np.abs(forces).max(axis=0) >= max(zero, LEAST_SHARE * sizes.max() / extent))
        for component in shown:
            columns[units.label(f"{name} x{component + 1}", "force")] = forces[:, component].tolist()
        for component in np.flatnonzero(sizes >= zero * min(1.0, extent)) if in_space else [0] * (not len(shown)):
            heading = f"{name} moment{f' about x{component + 1}' if in_space else ''}"
            columns[units.label(heading, "energy")] = moments[:, component].tolist()
    return columns


def _print_crack(result: Result) -> None:
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


def _title(result: Result) -> str:
    return f"{result.summary['scene']}, force {result.summary['force']}, {result.summary['n_points']} points"


def _print_columns(title: str, columns: Sequence[Column]) -> None:
    """Print a table of numbers column by column."""
    headings, cells = zip(*columns, strict=True)
    print_table(title, headings, zip(*cells, strict=True), left=0)


def _greatest(values: Sequence[float | None]) -> float:
    return max((abs(value) for value in values if value is not None), default=0.0)


def _figures(values: Sequence[float | None], greatest: float) -> list[str]:
    """Return the cells of a column, empty for None: with five decimals, or in powers of ten if the greatest value needs them."""
    form = ".5f" if greatest == 0 or 0.01 <= greatest < 1e7 else ".4e"
    # Rounded first, so that no zero has a minus.
    return ["" if value is None else format(round(value, 5) + 0.0 if form == ".5f" else value, form) for value in values]
