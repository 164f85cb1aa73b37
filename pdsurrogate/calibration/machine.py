"""Forces of a testing machine at the steps of a scene."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..measurements import read_tables
from ..measurements.quantities import amount_in, factor
from ..measurements.table import Block, Column
from ..problem.program import stages_of
from ..results.tables import column_name
from ..scenes import Scene
from .asked import times_of


def is_machine(path: Path) -> bool:
    """Return whether a table has no column ``step``, the form of measurements of this package."""
    columns = (column for block in read_tables(path).blocks for column in block.columns)
    return "step" not in [column_name(column.heading) for column in columns]


def machine_forces(
    scene: Scene, path: Path, stated: Mapping[str, Any], times: str | None
) -> tuple[np.ndarray, list[str]]:
    """Return steps and forces, (n, 2), from a machine's table, in the units of the scene, for
    sheets per unit of thickness; and words for the place of each.

    `times` has the time of each step in seconds, with commas between them, or is a table with a
    column of them; by default times are those of the scene, if its steps have some and the table
    too. Without times row k is that of step k.

    Raises
    ------
    ValueError
        If force, unit, thickness or step are not known; the message says what states them.
    """
    block = _table(path, stated)
    force = _column(path, block, "force")
    if force.unit is None:
        raise ValueError(f"{path}: {force.heading!r} has no unit: state it, as --unit force=N")
    units = scene.units
    if units.length is None or units.stress is None:
        raise ValueError(
            f"{path}: to convert forces, scene {scene.name} needs its units, such as units ="
            " { length = 'mm', stress = 'MPa' }"
        )
    try:
        length = factor(units.length, "m")
        size = factor(force.unit, "N") / factor(units.stress, "Pa") / length**2
        thickness = stated.get("thickness") or block.facts.get("thickness")
        if scene.dimension == 2:
            if thickness is None:
                raise ValueError(
                    "forces of a sheet are per thickness: state it, as --thickness 2mm"
                )
            size /= amount_in(thickness, "m", "the thickness") / length
        elif "thickness" in stated:
            raise ValueError("--thickness is for sheets, and this scene has a solid")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    values = force.values * size
    count = (
        len(scene.stretches)
        if scene.stretched
        else sum(stage.outputs for stage in stages_of(scene))
    )
    wanted = np.zeros(0)
    if times is not None:
        wanted = _times(times)
        if len(wanted) != count:
            raise ValueError(f"--times: {len(wanted)} times for {count} steps of {scene.name}")
    elif any("time" in one.quantities for one in block.columns):
        wanted = times_of(scene) * factor(units.time or "s", "s")
    if count == len(wanted):
        clock = _seconds(path, block)
        slack = 1e-9 * np.ptp(clock)
        if (
            not (np.diff(clock) > 0).all()
            or wanted.min() < clock[0] - slack
            or wanted.max() > clock[-1] + slack
        ):
            whose = f"of scene {scene.name}" if times is None else "by --times"
            raise ValueError(
                f"{path}: times must increase, and contain those of the steps: {clock[0]:g} to"
                f" {clock[-1]:g} s, and {wanted.min():g} to {wanted.max():g} s {whose}"
            )
        values = np.interp(wanted, clock, values)
    elif len(values) != count:
        raise ValueError(
            f"{path}: {len(values)} rows for {count} steps of {scene.name}: state the time of each"
            " step, as --times 10,20,30 or --times images.csv, or number rows in a column step"
        )
    places = [f"{path}, step {step}" for step in range(1, count + 1)]
    return np.column_stack([np.arange(1, count + 1), values]), places


def _table(path: Path, stated: Mapping[str, Any]) -> Block:
    """Return the only table of a file."""
    blocks = read_tables(path, columns=stated.get("columns"), units=stated.get("units")).blocks
    if len(blocks) > 1:
        raise ValueError(
            f"{path}: there are {len(blocks)} tables"
            f" ({', '.join(block.title for block in blocks)}): give a file with one"
        )
    return blocks[0]


def _column(path: Path, block: Block, quantity: str) -> Column:
    """Return the only column of a quantity."""
    found = [one for one in block.columns if one.quantities == (quantity,)]
    if len(found) != 1:
        known = ", ".join(repr(one.heading) for one in found or block.columns)
        raise ValueError(
            f"{path}: there {'are several columns' if found else 'is no column'} of {quantity}"
            f" {'' if found else 'among '}{known}: state it, as --column {quantity}=HEADING"
        )
    return found[0]


def _seconds(path: Path, block: Block) -> np.ndarray:
    """Return the times of the rows of a table in seconds, which its unit says, or nothing."""
    column = _column(path, block, "time")
    return column.values * factor(column.unit or "s", "s")


def _times(text: str) -> np.ndarray:
    """Return the times of the steps in seconds that an option states, or a file."""
    path = Path(text)
    if path.is_file():
        return _seconds(path, _table(path, {}))
    try:
        return np.array([float(one) for one in text.split(",")])
    except ValueError:
        raise ValueError(
            f"--times {text}: neither a file nor seconds with commas between them, as 10,20,30"
        ) from None
