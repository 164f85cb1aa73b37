"""Tables that programs for image correlation write, as text."""

import csv
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from .dialects import DIALECTS, OWN, STEPS, Dialect, Rows

HEAD = 200
"""Lines of a file among which the headings of columns are sought."""

EMPTY = {"", "-", "nan", "-nan", "null", "none", "na", "n/a"}
"""Entries that stand for no number."""

UNITS = {"pixel": "px", "pixels": "px", "pix": "px", "µm": "um"}
"""Units by other spellings."""


def _lines(path: Path) -> list[str]:
    """Return the lines of a text file, in UTF-8 or the encoding that fits."""
    raw = path.read_bytes()
    try:
        return raw.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        from charset_normalizer import from_bytes

        if (found := from_bytes(raw).best()) is None:
            raise ValueError(f"cannot read {path}: it is no text") from None
        return str(found).splitlines()


def form_of(path: Path) -> str | None:
    """Return the form of a table of displacements, None for another file."""
    try:
        found = next(_headings(_lines(path)[:HEAD]), None)
    except (OSError, ValueError):
        return None
    return found[2][0].form if found else None


def _cells(line: str, separator: str) -> list[str]:
    """Return the entries of a line without blanks and quotation marks around them; an empty
    separator stands for blanks.
    """
    if not separator:
        return line.split()
    cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return [cell.strip().strip('"').strip() for cell in cells]


def _named(heading: str) -> tuple[str, str]:
    """Return the name of a column and its unit in brackets, empty without one."""
    found = re.fullmatch(r"(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]", heading)
    name, unit = found.groups() if found else (heading, "")
    return name, UNITS.get(unit.lower(), unit)


def _headings(lines: list[str]) -> Iterator[tuple[int, str, list[Dialect], list[str], list[str]]]:
    """Yield lines of headings: number, separator, dialects that fit, names and units."""
    for number, line in enumerate(lines):
        for separator in (",", ";", "\t", ""):
            named = [_named(cell) for cell in _cells(line.lstrip("# "), separator)]
            names = [name for name, _ in named]
            if fits := [
                one
                for one in DIALECTS
                if {*one.places[:2], *one.displacements[:2], *one.needs} <= {*names}
            ]:
                yield number, separator, fits, names, [unit for _, unit in named]


def rows_of_table(path: Path, unit: str | None, dimension: int) -> Rows:
    """Return the rows of a text file; see `read_fields`."""
    try:
        lines = _lines(path)
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror}") from None
    found = next(_headings(lines[:HEAD]), None)
    if found is None:
        raise ValueError(
            f"{path}: no line names columns of places and displacements; write a table with"
            " step,x1,x2,u1,u2 in the units of the scene, or export it from one of the programs"
            " that the guide on fields lists"
        )
    start, separator, fits, names, units = found
    head = "\n".join(lines[:start])
    stated = {
        one: {units[names.index(name)] for name in (*one.places[:2], *one.displacements[:2])} - {""}
        for one in fits
    }
    in_unit = {one: next(iter(those), one.unit) for one, those in stated.items()}
    chosen = [one for one in fits if unit is None or in_unit[one] in (None, "", unit)]
    chosen = [one for one in chosen if len(stated[one]) < 2]
    if not chosen:
        raise ValueError(
            f"{path}: {fits[0].form} is in {' and '.join(sorted(stated[fits[0]])) or fits[0].unit},"
            f" not in {unit or 'one unit'}"
        )
    dialect = chosen[0]
    its_unit = in_unit[dialect] or unit or in_unit[dialect]
    if its_unit is None:
        raise ValueError(
            f"{path}: {dialect.form}: the file states no unit of places and displacements; state"
            " it: --unit px, --unit mm"
        )
    if "Incremental correlation: true" in head:
        raise ValueError(
            f"{path}: DICe's incremental correlation adds displacements from image to image at"
            " fixed pixels, not those of the points of the body: correlate each image with the"
            " reference image"
        )
    columns = (*dialect.places[:dimension], *dialect.displacements[:dimension])
    for name in columns:
        if names.count(name) != 1:
            there = "two columns" if name in names else "no column"
            raise ValueError(f"{path}: {dialect.form}: there is {there} {name}")
    image_column = next((name for name in STEPS if name in names), "")
    if dialect is OWN and not image_column:
        raise ValueError(f"{path}: there is no column step")
    extra = [
        name
        for name in (*dialect.lost, *dialect.image, dialect.deviation, image_column)
        if name and name in names
    ]
    wanted = [*columns, *dict.fromkeys(extra)]
    table, image = _numbers(path, lines, start, separator, names, wanted)
    values = dict(zip(wanted, table.T, strict=True))
    places, displacements = table[:, :dimension], table[:, dimension : 2 * dimension]
    notes = []
    marks = [values[name] < 0 for name in dialect.lost if name in values]
    lost = np.any(marks, axis=0) if marks else np.zeros(len(table), dtype=bool)
    if dialect.zeros:
        lost = lost | ~table[:, : 2 * dimension].any(axis=1)
    if not marks and dialect is not OWN:
        notes.append("no column marks lost points, but for empty entries")
    if len(chosen) > 1 and unit is None and chosen[1].unit == "px":
        notes.append(f"columns in {its_unit} are read, not those in pixels (--unit px)")
    scale = 1.0 if its_unit == "px" else np.nan
    if all(name in values for name in dialect.image) and dialect.image:
        pixels = np.stack([values[name] for name in dialect.image], axis=1)
        kept = ~lost & ~np.isnan(table).any(axis=1)
        if kept.sum() > 2:
            spread = pixels[kept] - pixels[kept].mean(axis=0)
            real = places[kept, :2] - places[kept, :2].mean(axis=0)
            scale = np.sqrt((real**2).sum() / (spread**2).sum())
            turned = (spread[:, 1] * real[:, 1]).sum() > 0
            dialect = replace(dialect, down="yzvw" if turned else "")
            notes.append(f"y points {'down' if turned else 'up'} by the columns in pixels")
    deviation = values.get(dialect.deviation)
    if deviation is None:
        deviation = np.full(len(table), np.nan)
    elif units[names.index(dialect.deviation)] != its_unit:
        deviation = deviation * scale
    subset = re.search(r"\*\*\* Subset size: (\d+)", head)
    if "alignment_translation_x" in head:
        notes.append("ARAMIS has taken the rigid motion out of the displacements")
    return Rows(
        dialect,
        its_unit,
        values.get(image_column, image),
        places,
        displacements,
        deviation,
        lost,
        bool(image_column),
        float(subset[1]) if subset else None,
        tuple(notes),
    )


def _numbers(
    path: Path, lines: list[str], start: int, separator: str, names: list[str], wanted: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns `wanted` of the rows below headings, (n, columns), and the number of the
    block, from 1, that each row is in: the headings again begin another one.
    """
    indices = [names.index(name) for name in wanted]
    found, block = [], [1]
    for number, line in enumerate(lines[start + 1 :], start + 2):
        if line.strip() == lines[start].strip():
            block.append(block.pop() + 1)
            continue
        if not line.strip() or line.lstrip().startswith(("#", "*")):
            continue
        cells = _cells(line, separator)
        if len(cells) == len(names) + 1 and not cells[-1]:
            cells.pop()
        if len(cells) != len(names):
            raise ValueError(
                f"{path}, line {number}: the line has {len(cells)} values for {len(names)}"
                " columns; decimals have points, not commas"
            )
        row = []
        for index in indices:
            cell = cells[index] if separator == "," else cells[index].replace(",", ".")
            try:
                row.append(np.nan if cell.lower() in EMPTY else float(cell))
            except ValueError:
                raise ValueError(
                    f"{path}, line {number}: {names[index]} is not a number: {cell!r}"
                ) from None
            if np.isinf(row[-1]):
                raise ValueError(f"{path}, line {number}: {names[index]} must be finite")
        found.append((block[0], *row))
    if not found:
        raise ValueError(f"{path}: there are no rows")
    table = np.array(found)
    return table[:, 1:], table[:, 0]
