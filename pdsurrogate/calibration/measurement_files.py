"""Tables of measurements from the files of displacements and forces that the command
``pdsurrogate calibrate`` takes.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..identification.campaign import option_of
from ..measurements import files_at, read_tables
from ..results.tables import column_name
from ..scenes import Scene
from .field_files import FieldFacts, FieldRows, displacement_rows, field_rows, is_own
from .machine import is_machine, machine_forces

OUTPUTS = {
    "force": "force",
    "force_(.+)_([123])": "forces.{}",
    "moment_(.+)_([123])": "moments.{}",
    "moment_(.+)": "moments.{}",
    "displacement_(.+)_([123])": "displacements.{}",
    "(.+)_displacement_([123])": "probes.{}.displacement",
    "probe_(.+)_u([123])": "probes.{}.displacement",
    "nominal_stress": "nominal_stress",
    "strain_energy": "energy",
}
"""Dotted keys of measured outputs by their columns, as in ``history.csv``; groups are the name
of a region or probe, and a component.
"""


def output_of(column: str) -> str | None:
    """Return the dotted key of the output that a column of a file contains; None for another
    column.
    """
    for pattern, key in OUTPUTS.items():
        if found := re.fullmatch(pattern, column):
            name, *component = found.groups() or (None,)
            return ".".join([key.format(name), *(str(int(number) - 1) for number in component)])
    return None


def read_columns(
    path: Path, columns: tuple[str, ...], others: Callable[[str], object] = lambda name: False
) -> tuple[np.ndarray, list[str], list[str]]:
    """Return columns of numbers from a table with a line of headings, (n, columns), the place of
    each row, and the names of the columns.

    They are those of `columns`, and then further ones that `others` chooses by their names, where
    an empty entry is NaN. Headers may have units in brackets, as those of ``history.csv``.

    Raises
    ------
    ValueError
        If the file cannot be read (`read_tables`), lacks a column or has it twice, or an entry is
        no finite number; the message names the line.
    """
    blocks = read_tables(path).blocks
    tables = [{column_name(one.heading): one.values for one in block.columns} for block in blocks]
    lines = np.concatenate([block.lines for block in blocks])
    if len({*lines}) < len(lines):
        twice = [name for name in tables[1] if name in tables[0]]
        raise ValueError(f"{path}: there are two columns {twice[-1]}")
    if any([*table] != [*tables[0]] for table in tables):
        raise ValueError(f"{path}: there are several tables, of which one is needed")
    table = {name: np.concatenate([one[name] for one in tables]) for name in tables[0]}
    if missing := [name for name in columns if name not in table]:
        raise ValueError(
            f"{path}: the columns must be {', '.join(columns)}; there is no {missing[0]} among"
            f" {', '.join(table)}"
        )
    names = [*columns, *(name for name in table if name not in columns and others(name))]
    places = [f"{path}, line {line}" for line in lines]
    for name in names:
        wrong = [
            isinstance(one, str) or (name in columns and not np.isfinite(one))
            for one in table[name]
        ]
        if any(wrong):
            raise ValueError(f"{places[wrong.index(True)]}: {name} is not a number")
    return np.array([table[name] for name in names], dtype=float).T, places, names


def _check_rows(scene: Scene, found: np.ndarray, places: list[str]) -> None:
    """Raise ValueError with the place of a step, the first column, that the scene does not have,
    or of a copy of an earlier row.
    """
    most = len(scene.stretches) if scene.stretched else np.inf
    for step, where in zip(found[:, 0], places, strict=True):
        if step != round(step) or not 1 <= step <= most:
            known = (
                f"1 to {most}, the stretches of scene {scene.name}"
                if scene.stretched
                else f"the outputs of scene {scene.name} from 1"
            )
            raise ValueError(f"{where}: step {step:g}, but the steps are whole numbers: {known}")
    first = np.unique(found, axis=0, return_index=True)[1]
    if len(first) < len(found):
        where = places[np.delete(np.arange(len(found)), first)[0]]
        raise ValueError(f"{where}: this row is a copy of an earlier one")


def measurements(
    scene: Scene,
    fields: list[Path] | None,
    forces: Path | None,
    stated: Mapping[str, Any],
    times: str | None,
    image: FieldFacts,
    unit: str | None,
) -> tuple[np.ndarray, np.ndarray, dict[str, str], FieldRows | None]:
    """Return the table of measurements and their values, as `SceneRegressor` takes them, from
    files of fields, in a `unit`, and one of outputs or of a machine (`machine_forces`, with what is
    stated of it).

    The third item has, by the names of their columns, the dotted keys of the outputs, which are the
    quantities 0, -1, and so on; the fourth one the first rows, those of fields of a camera.
    """
    images = None
    d = scene.dimension
    tables = []
    values = []
    outputs = {}
    if not fields and forces is None:
        raise ValueError("there is nothing to fit: give --fields, --forces or both")
    machine = forces is not None and is_machine(forces)
    if not machine and (stated or times is not None):
        option = option_of(next(iter(stated), "times"))
        raise ValueError(f"{option} is for --forces with the table of a machine")
    if fields and not is_own(fields, image):
        images = field_rows(scene, fields, image, unit)
        tables.append(images.X)
        values.append(images.y)
    elif fields:
        axes = range(1, d + 1)
        columns = ("step", *(f"x{axis}" for axis in axes), *(f"u{axis}" for axis in axes))
        found, places, _ = read_columns(*files_at(*fields), columns)
        _check_rows(scene, found, places)
        tables.append(displacement_rows(found[:, 0], found[:, 1 : 1 + d]))
        values.append(found[:, 1 + d :].T.ravel())
    if forces is not None:
        if machine:
            found, places = machine_forces(scene, forces, stated, times)
            names = ["force"]
        else:
            found, places, (_, *names) = read_columns(
                forces, ("step",), lambda name: output_of(name) or name == "evaluations"
            )
        if "evaluations" in names:
            raise ValueError(
                f"{forces}: this is the history of a run, whose step is that of the scene: number"
                " the outputs from 1"
            )
        if not names:
            raise ValueError(
                f"{forces}: there is no column force, nor another one with a measurement, as"
                " history.csv of a run has them (force_right_1, tip_displacement_2)"
            )
        _check_rows(scene, found, places)
        outputs = {name: str(output_of(name)) for name in names}
        for number, column in enumerate(found[:, 1:].T):
            there = np.isfinite(column)
            tables.append(
                np.column_stack(
                    [found[there, 0], np.full(there.sum(), -number), np.zeros((there.sum(), d))]
                )
            )
            values.append(column[there])
    if not sum(map(len, values)):
        raise ValueError(
            f"{forces}: there are no measurements, all entries of {', '.join(outputs)} are empty"
        )
    return np.vstack(tables), np.concatenate(values), outputs, images
