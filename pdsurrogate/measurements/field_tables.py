"""Tables that programs for image correlation write, as text."""

import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .dialects import DIALECTS, OWN, Dialect, RawField
from .text import decode, lines_in, split

EMPTY = {"", "-", "nan", "-nan", "null", "none", "na", "n/a"}
"""Entries that stand for no number."""

UNITS = {"pixel": "px", "pixels": "px", "pix": "px", "µm": "um"}
"""Units by other spellings."""

STEPS = ("step", "FRAME", "frame", "Frame", "stage", "Stage", "image", "Image")
"""Columns that number the images."""


class Headings(NamedTuple):
    """Headings of a table: all lines of the file, the number of theirs from 0, separator, names
    and units of columns, and the dialects that have them.
    """

    lines: list[str]
    line: int
    separator: str
    names: list[str]
    units: dict[str, str]
    dialects: list[Dialect]


def headings_of(path: Path) -> Headings | None:
    """Return the headings of a table of displacements, None for another file."""
    text = decode(path.read_bytes())
    lines = lines_in(text[0]) if text else []
    for number, line in enumerate(lines[:200]):
        for separator in ",;\t ":
            found = [
                re.fullmatch(r"(.*?)(?:\s*[\[(]\s*([^\])]*?)\s*[\])])?", cell)
                for cell in split([line.lstrip("# ")], separator)[0]
            ]
            units = {
                one[1]: UNITS.get((one[2] or "").lower(), one[2] or "") for one in found if one
            }
            if fits := [
                one
                for one in DIALECTS.values()
                if {*one.places[:2], *one.displacements[:2], *one.needs} <= units.keys()
            ]:
                names = [one[1] for one in found if one]
                return Headings(lines, number, separator, names, units, fits)
    return None


def rows_of_table(path: Path, unit: str | None, dimension: int) -> RawField:
    """Return the rows of a table; see `read_fields`."""
    try:
        table = headings_of(path)
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if table is None:
        raise ValueError(
            f"{path}: no line names columns of places and displacements; write a table with"
            " step,x1,x2,u1,u2 in the units of the scene, or export it from one of the programs"
            " that the guide on fields lists"
        )
    in_unit = {}
    for one in table.dialects:
        read = (*one.places[:dimension], *one.displacements[:dimension])
        stated = {table.units.get(name, "") for name in read} - {""}
        in_unit[one] = " and ".join(sorted(stated)) or one.unit
    chosen = [
        one
        for one, its in in_unit.items()
        if not its or (" and " not in its and unit in (None, its))
    ]
    dialect = (chosen or table.dialects)[0]
    its_unit = in_unit[dialect] or unit or in_unit[dialect]
    head = "\n".join(table.lines[: table.line])
    columns = (*dialect.places[:dimension], *dialect.displacements[:dimension])
    image = next((name for name in STEPS if name in table.units), "")
    if not chosen:
        fault = f"the file is in {its_unit}, not in {unit or 'one unit'}"
    elif "Incremental correlation: true" in head:
        fault = (
            "an incremental correlation adds displacements from image to image at fixed pixels, not"
            " those of the points of the body: correlate each image with the reference image"
        )
    elif absent := [name for name in columns if name not in table.units]:
        fault = f"there is no column {absent[0]}"
    elif twice := [name for name in columns if table.names.count(name) > 1]:
        fault = f"there are two columns {twice[0]}"
    elif dialect is OWN and not image:
        fault = "there is no column step"
    else:
        fault = dialect.refused
    if fault:
        raise ValueError(f"{path}: {dialect.form}: {fault}")
    extra = (*dialect.lost, *dialect.pixels, dialect.deviation, image)
    wanted = [*columns, *dict.fromkeys(name for name in extra if name in table.units)]
    found, block = _numbers(path, table, wanted)
    values = dict(zip(wanted, found.T, strict=True))
    places, displacements = found[:, :dimension], found[:, dimension : len(columns)]
    notes = []
    marks = [values[name] < 0 for name in dialect.lost if name in values]
    if dialect.zeros:
        marks.append(~found[:, : len(columns)].any(axis=1))
    if not marks and dialect is not OWN:
        notes.append("no column marks lost points, but for empty entries")
    lost = np.any([np.isnan(found[:, : len(columns)]).any(axis=1), *marks], axis=0)
    if len(chosen) > 1 and unit is None and chosen[1].unit == "px":
        notes.append(f"columns in {its_unit} are read, not those in pixels (--unit px)")
    scale = 1.0 if its_unit == "px" else np.nan
    if dialect.pixels and {*dialect.pixels} <= values.keys() and not lost.all():
        pixels = np.column_stack([values[name] for name in dialect.pixels])[~lost]
        pixels, real = (part - part.mean(axis=0) for part in (pixels, places[~lost, :2]))
        scale = np.sqrt((real**2).sum() / (pixels**2).sum())
        down = pixels[:, 1] @ real[:, 1] > 0
        dialect = replace(dialect, down="yzvw" if down else "", said="")
        notes.append(f"y points {'down' if down else 'up'} by the columns in pixels")
    if "alignment_translation_x" in head:
        notes.append("ARAMIS has taken the rigid motion out of the displacements")
    subset = re.search(r"\*\*\* Subset size: (\d+)", head)
    return RawField(
        dialect,
        its_unit,
        values.get(image, block),
        places,
        displacements,
        values.get(dialect.deviation, np.full(len(found), np.nan))
        * (scale if table.units.get(dialect.deviation) != its_unit else 1.0),
        lost,
        bool(image),
        float(subset[1]) if subset else None,
        tuple(notes),
    )


def _numbers(path: Path, table: Headings, wanted: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return columns of the rows, (n, columns), and the block of each row, from 1: headings that
    come again begin another one.
    """
    indices = [table.names.index(name) for name in wanted]
    found, blocks, block = [], [], 1
    signs: dict[str, str] = {}
    for number, line in enumerate(table.lines[table.line + 1 :], table.line + 2):
        if line.strip() == table.lines[table.line].strip():
            block += 1
        if line.strip() == table.lines[table.line].strip() or line.strip()[:1] in ("", "#", "*"):
            continue
        cells = split([line], table.separator)[0]
        if len(cells) == len(table.names) + 1 and not cells[-1]:
            cells.pop()
        if len(cells) != len(table.names):
            raise ValueError(
                f"{path}, line {number}: the line has {len(cells)} values for"
                f" {len(table.names)} columns; decimals have points, not commas"
            )
        row = []
        for index in indices:
            cell = cells[index]
            signs |= {sign: cell for sign in ",." if sign in cell}
            if len(signs) > 1:
                raise ValueError(
                    f"{path}, line {number}: {signs['.']} has a point and {signs[',']} a comma:"
                    " write decimals with one of them, and thousands without a sign"
                )
            try:
                row.append(float(cell.replace(",", ".")) if cell.lower() not in EMPTY else np.nan)
            except ValueError:
                row.append(np.inf)
            if np.isinf(row[-1]):
                raise ValueError(
                    f"{path}, line {number}: {table.names[index]} is not a finite number: {cell!r}"
                )
        found.append(row)
        blocks.append(block)
    if not found:
        raise ValueError(f"{path}: there are no rows")
    return np.array(found), np.array(blocks)
