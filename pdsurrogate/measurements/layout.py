"""Tables in the rows of a file: what is a heading, units, facts, and which columns belong
together.
"""

import re
from dataclasses import dataclass, field

import numpy as np

from .quantities import (
    FACTS,
    GEOMETRY,
    KINDS,
    MODES,
    found_in,
    heading_and_unit,
    plain,
    quantities_of,
    unit_in,
)
from .table import Block, Column
from .text import MISSING, Row

TEXT = ("mode", "specimen")
"""Quantities whose cells are text."""


@dataclass
class Segment:
    """A table: rows before it that are no numbers, its rows, and what is found in them."""

    above: list[Row]
    rows: list[Row]
    headings: dict[int, tuple[str, str | None]] = field(default_factory=dict)
    titles: list[Row] = field(default_factory=list)

    @property
    def columns(self) -> list[int]:
        """Places of columns that have cells."""
        return sorted({place for row in self.rows for place in filled(row)})


def filled(row: Row) -> dict[int, float | str]:
    """Return the cells of a row that have a value, by their places."""
    return {
        place: cell
        for place, cell in enumerate(row.cells)
        if not isinstance(cell, str) or cell.lower() not in MISSING
    }


def text_of(cell: float | str) -> str:
    """Return a cell as text."""
    return cell.strip() if isinstance(cell, str) else f"{cell:.12g}"


def kind_of(heading: str) -> str | None:
    """Return the kind of a heading without its unit."""
    return found_in(KINDS, heading_and_unit(heading)[0])


def segments(rows: list[Row]) -> tuple[list[Segment], list[Row]]:
    """Return the tables of a file, and the rows after the last one.

    Raises
    ------
    ValueError
        If a cell inside a table is no number.
    """
    found: list[Segment] = []
    above: list[Row] = []
    run: list[Row] = []
    texts: set[int] = set()
    for row in rows:
        cells = filled(row)
        words = {place for place, cell in cells.items() if isinstance(cell, str)}
        numbers = cells.keys() - words
        if run and not cells:
            above = above or [row]
            continue
        if row.comment and run and not facts_of([row]):
            continue
        starts = len(numbers) > 1 and words <= _text_columns(above, words, numbers)
        goes_on = run and numbers and words <= texts and not numbers & texts
        if row.comment or not ((goes_on and not above) or starts):
            if run and numbers and not row.comment and min(cells) in numbers and not above:
                wrong = text_of(cells[min(words - texts)])
                raise ValueError(f"line {row.number}: {wrong!r} is no number")
            run = []
            above.append(row)
            continue
        if not run or above:
            run, texts = [], words
            found.append(Segment([one for one in above if filled(one)], run))
            above = []
        run.append(row)
    return found, [row for row in above if filled(row)]


def _text_columns(above: list[Row], words: set[int], numbers: set[int]) -> set[int]:
    """Return which of the places of text are columns by the heading: fewer than numbers."""
    heads = [filled(row) for row in above if filled(row)][-1:]
    return {
        place
        for head in heads
        for place in words
        if len(words) < len(numbers) or kind_of(text_of(head.get(place, ""))) in TEXT
        if isinstance(head.get(place), str)
        and not any(isinstance(one, float) for one in head.values())
    }


def take_headings(segment: Segment, before: Segment | None) -> None:
    """Find headings, units and titles of a table in the rows above it, and take these away.

    A table without a heading after another one with as many columns has the heading of that.
    """
    columns = segment.columns
    wordy = [
        row
        for row in segment.above[-4:]
        if all(isinstance(cell, str) for cell in row.cells) and set(columns) & filled(row).keys()
    ]
    if segment.above[-1:] != wordy[-1:]:
        wordy = []
    units: dict[int, str] = {}
    if wordy and _are_units(wordy[-1], columns):
        last = wordy.pop()
        units = {place: text_of(last.cells[place]) for place in columns if place < len(last.cells)}
        segment.above.remove(last)
    wide = [row for row in wordy if len(filled(row)) >= max(2, len(columns) / 2)]
    head = max(
        wide[-2:][::-1],
        key=lambda row: sum(kind_of(text_of(cell)) is not None for cell in filled(row).values()),
        default=None,
    )
    if head is None and not units and before and before.columns == columns:
        segment.headings = before.headings
        return
    if head is not None:
        place = segment.above.index(head)
        segment.titles = [row for row in segment.above[:place][-2:] if _is_title(row)]
        segment.above = [row for row in segment.above[:place] if row not in segment.titles]
    for place in columns:
        text = text_of(head.cells[place]) if head and place < len(head.cells) else ""
        heading, unit = heading_and_unit(text)
        stated = re.sub(r"^[(\[{<](.*)[)\]}>]$", r"\1", units.get(place, "")).strip()
        segment.headings[place] = (heading, stated or unit)


def _is_title(row: Row) -> bool:
    """Whether a row above headings has titles: one entry alone, or several that are apart."""
    cells = filled(row)
    if len(cells) == 1:
        return not facts_of([row])
    return all(isinstance(cell, str) for cell in cells.values()) and 1 not in cells


def _are_units(row: Row, columns: list[int]) -> bool:
    """Whether half of the cells of a row, at least, are units, and some have a dimension."""
    cells = [text_of(cell) for place, cell in enumerate(row.cells) if place in columns and cell]
    known = [unit_in(cell) for cell in cells]
    return any(known) and 2 * (len(known) - known.count(None)) >= len(cells)


def facts_of(rows: list[Row]) -> dict[str, str]:
    """Return entries above a table, by the names in `FACTS` or their own: "Width,6.0,mm",
    "Thickness (mm);2", "Messlänge: 25 mm".
    """
    facts: dict[str, str] = {}
    for row in rows:
        cells = [text_of(cell) for cell in filled(row).values()]
        if len(cells) == 1:
            cells = [one for one in re.split(r"\s*[:=\t]\s*|\s{2,}", cells[0], maxsplit=2) if one]
        while len(cells) > 1:
            (name, unit), entry = heading_and_unit(cells[0].rstrip(":= ")), plain(cells[1])
            taken = 3 if len(cells) > 2 and unit_in(cells[2]) else 2
            unit = unit_in(cells[2]) if taken == 3 else unit
            cells = cells[taken:]
            known = found_in(FACTS, name)
            facts.setdefault(known or name, f"{entry} {unit}" if unit else entry)
    return facts


def mode_in(text: str) -> str | None:
    """Return the mode of loading that a text states."""
    return found_in(MODES, text)


def groups(segment: Segment) -> list[list[int]]:
    """Return the columns of each specimen of a table: a heading that is repeated begins another
    one, and columns before the first repeated one belong to all.
    """
    columns = segment.columns
    heads = [segment.headings[place] for place in columns]
    repeated = [heads.count(head) > 1 and head != ("", None) for head in heads]
    if not any(repeated):
        return [columns]
    shared = columns[: repeated.index(True)]
    found: list[list[int]] = []
    seen: set = set()
    for place, head in zip(columns[len(shared) :], heads[len(shared) :], strict=True):
        if not found or head in seen:
            found.append(list(shared))
            seen = set()
        seen.add(head)
        found[-1].append(place)
    return found


def title_at(segment: Segment, places: list[int]) -> str:
    """Return the title of a group of columns: the last entry of the row of titles up to them."""
    for row in segment.titles[::-1]:
        entries = [text_of(cell) for place, cell in filled(row).items() if place <= places[0]]
        if entries:
            return re.sub(r"^[#\s]+|[:\s]+$", "", entries[-1])
    return ""


def blocks_of(rows: list[Row], sheet: str = "") -> tuple[list[Block], list[str]]:
    """Return the tables of the rows of a file or a sheet, and notes of what was left out.

    Raises
    ------
    ValueError
        If a cell inside a table is no number, or a column has a unit that is none of its heading.
    """
    found: list[Block] = []
    notes: list[str] = []
    general: dict[str, str] = {}
    tables, after = segments(rows)
    before = None
    for segment in tables:
        take_headings(segment, before)
        kinds = {place: found_in(KINDS, head) for place, (head, _) in segment.headings.items()}
        facts = facts_of(segment.above)
        lines = f"lines {segment.rows[0].number} to {segment.rows[-1].number}"
        if "no measurement" in kinds.values() and not {*kinds.values()} - {
            "no measurement",
            "specimen",
            None,
        }:
            notes.append(f"{lines}: a table of results, which is not read")
            continue
        before = segment
        inherited = {} if {*GEOMETRY} & {*facts} else general
        general = {**inherited, **facts}
        split = groups(segment)
        for places in split:
            title = title_at(segment, places[-1:] if len(split) > 1 else places)
            found.append(block(segment, places, title, sheet, general))
    if after:
        notes.append(f"lines {after[0].number} to {after[-1].number} after the tables are not read")
    return found, notes


def block(
    segment: Segment, places: list[int], title: str, sheet: str, facts: dict[str, str]
) -> Block:
    """Return the columns at some places as a block, without rows that are empty there."""
    rows = [row for row in segment.rows if {*places} & filled(row).keys()]
    columns = []
    for place in places:
        heading, unit = segment.headings[place]
        cells = [row.cells[place] if place < len(row.cells) else "" for row in rows]
        texts = any(isinstance(cell, str) and cell.lower() not in MISSING for cell in cells)
        values = np.array(
            [text_of(cell) for cell in cells]
            if texts
            else [np.nan if isinstance(cell, str) else cell for cell in cells]
        )
        columns.append(Column(heading, unit, quantities_of(heading, unit), values))
    mode = next((mode for text in (title, sheet, *facts.values()) if (mode := mode_in(text))), None)
    return Block(
        title or facts.get("specimen", sheet) or sheet,
        tuple(columns),
        np.array([row.number for row in rows]),
        mode,
        facts,
    )
