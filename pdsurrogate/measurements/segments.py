"""Rows of a file by what they are: rows of numbers, and the headings, units, titles and facts above
them.
"""

import dataclasses
import re

import numpy as np

from .quantities import (
    FACTS,
    KINDS,
    LENGTHS,
    MODES,
    STATISTICS,
    found_in,
    heading_and_unit,
    plain,
    unit_in,
    within_brackets,
)
from .text import Row, value

TEXT = ("mode", "specimen", "broke")
"""Quantities whose cells are text."""


ENTRY = re.compile(r"(.*?\S)\s*(?:[:=]\s*|\t+|\s{2,})(\S.*)")
"""Name and value of an entry in one cell."""

AMOUNT = re.compile(r"([+-]?[\d.,'\u2019\u00a0\u202f]+(?:[eE][+-]?\d+)?)\s*(\D.*)?")
"""Number and unit of a size in one cell."""


@dataclasses.dataclass
class Segment:
    """A table: rows before it that are no numbers, its rows, and what is found in them."""

    above: list[Row]
    rows: list[Row]
    headings: dict[int, tuple[str, str | None]] = dataclasses.field(default_factory=dict)
    titles: list[Row] = dataclasses.field(default_factory=list)

    @property
    def columns(self) -> list[int]:
        """Places of columns that have cells."""
        return sorted({place for row in self.rows for place in row.filled})


def lines_of(rows: list[Row]) -> str:
    """Return the first and last line of rows, for messages."""
    first, last = rows[0].number, rows[-1].number
    return f"line {first}" if first == last else f"lines {first} to {last}"


def kind_of(heading: str) -> str | None:
    """Return the kind of a heading with its unit."""
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
    texts: set[int] = set()
    going = False  # whether the row before was one of a table, apart from comments
    for row in rows:
        cells = row.filled
        words = {place for place, cell in cells.items() if isinstance(cell, str)}
        numbers = cells.keys() - words
        if row.comment and going and not facts_of([row]):
            continue
        if row.comment or not cells:
            going = False
        elif going and numbers and words <= texts and not numbers & texts:
            found[-1].rows.append(row)
            continue
        elif (
            going
            and numbers
            and ((texts and texts < words) or re.match(r"[+-]?[.,]?\d", row.text(min(cells))))
        ):
            wrong = min((words - texts) or (numbers & texts))
            raise ValueError(f"line {row.number}: {row.text(wrong)!r} is no number")
        elif (found and not above and numbers and words <= texts and not numbers & texts) or (
            (len(numbers) > 1 and words <= texts | _text_columns(above, words, numbers))
            or (_under_headings(row, above) and numbers and not words)
        ):
            found.append(Segment(above, [row]))
            above, texts, going = [], words, True
            continue
        going = False
        if cells:
            above.append(row)
    return found, above


def _under_headings(row: Row, above: list[Row]) -> bool:
    """Whether a row has as many cells as a row of text above it, two at least."""
    texts = above and all(isinstance(cell, str) for cell in above[-1].cells)
    return bool(texts) and len(row.cells) == len(above[-1].cells) > 1


def _text_columns(above: list[Row], words: set[int], numbers: set[int]) -> set[int]:
    """Return which places of text are columns by the row above: those of modes and specimens,
    and others if they are fewer than the numbers, which have headings.
    """
    if not above or any(isinstance(cell, float) for cell in above[-1].cells):
        return set()
    few = len(words) < len(numbers) and all(above[-1].text(place) for place in numbers)
    return {
        place
        for place in words
        if few or any(kind_of(row.text(place)) in TEXT for row in above[-2:])
    }


def take_headings(segment: Segment, before: Segment | None, sign: str) -> None:
    """Find headings, units and titles of a table in the rows above it, and take these away.

    A table without a heading after another one with as many columns has the heading of that.

    Raises
    ------
    ValueError
        If rows have more cells than there are headings.
    """
    columns, above = segment.columns, segment.above
    units: dict[int, str] = {}
    if above and _are_units(above, columns):
        last = above.pop()
        units = {place: within_brackets(last.text(place)) for place in columns}
    wide = [
        row
        for row in above[:-3:-1]
        if not any(isinstance(cell, float) for cell in row.cells)
        and len({*columns} & row.filled.keys()) >= max(2, len(columns) / 2)
        and (len(row.cells) > min(columns[-1], 2) or any(map(kind_of, map(str, row.cells))))
    ]
    head = max(
        wide,
        key=lambda row: sum(kind_of(row.text(place)) is not None for place in row.filled),
        default=Row(0, []),
    )
    if not wide and not units and before and before.columns == columns:
        one = above[-1] if above else segment.rows[0]
        alone = before.rows[-1].number + 1 == one.number == segment.rows[0].number - 1
        if alone and len(one.filled) == len(columns) and not {*facts_of([one], sign)} & {*FACTS}:
            raise ValueError(f"line {one.number}: {one.text(0)!r} is no number")
        segment.headings = before.headings
        if above and _is_title(above[-1], columns):
            segment.titles = [above.pop()]
        return
    if wide and len(head.cells) <= columns[-1]:
        raise ValueError(
            f"line {segment.rows[0].number} has {columns[-1] + 1} values for"
            f" {len(head.cells)} columns; decimals have points, or other separators than commas"
        )
    if wide:
        del above[above.index(head) :]
    while above and len(segment.titles) < 2 and _is_title(above[-1], columns):
        segment.titles.append(above.pop())
    segment.titles += [
        row
        for row in above[::-1]
        if len(row.filled) == 1 and kind_of(row.text(*row.filled)) == "specimen"
        if not facts_of([row])
    ]
    for place in columns:
        heading, unit = heading_and_unit(head.text(place))
        segment.headings[place] = (heading, units.get(place) or unit)


def _is_title(row: Row, columns: list[int]) -> bool:
    """Whether a row above headings has titles: one entry alone, or several that are apart,
    repeated, or specimens.
    """
    cells = row.filled
    if len(cells) == 1:
        text = row.text(*cells)
        said = kind_of(text) == "specimen" or found_in(MODES, text)
        alone = not row.comment and (len(row.cells) == 1 or len(row.cells) > columns[-1])
        return not facts_of([row]) and bool(said or alone)
    texts = [cell for cell in cells.values() if isinstance(cell, str)]
    apart = min(np.diff(sorted(cells))) > 1 or 2 * len({*texts}) <= len(texts)
    return len(texts) == len(cells) and (
        apart or all(kind_of(text) == "specimen" for text in texts)
    )


def _are_units(above: list[Row], columns: list[int]) -> bool:
    """Whether the last row above a table has units: all of its cells are, or half of them below
    as many headings.
    """
    cells = [above[-1].text(place) for place in columns]
    known = [unit_in(cell) for cell in cells if cell]
    headings = len(above) > 1 and len(above[-2].filled) >= len(known)
    return any(known) and known.count(None) <= (len(known) / 2 if headings else 0)


def facts_of(rows: list[Row], sign: str = ".") -> dict[str, str]:
    """Return entries above a table, by the names in `FACTS` or their own: "Width,6.0,mm",
    "Thickness (mm);2", "Messlänge: 25 mm".
    """
    facts: dict[str, str] = {}
    for row in rows:
        cells = [*row.filled.values()]
        entries = [ENTRY.fullmatch(str(cell)) for cell in cells]
        if len(cells) == 1 and not entries[0]:
            loose = re.match(r"(\D*[^\d\W])\s+([+-]?[\d.,].*)", str(cells[0]))
            entries = [loose if loose and found_in(FACTS, loose[1]) in LENGTHS else None]
        if all(entries):
            cells = [part for entry in entries if entry for part in entry.groups()]
        while len(cells) > 1 and isinstance(title := cells[0], str):
            (name, unit), entry = heading_and_unit(title.rstrip(":= ")), cells[1]
            if re.search(STATISTICS, title.lower()) or isinstance(value(name, sign), float):
                break
            third = within_brackets(str(cells[2])) if len(cells) > 2 else ""
            # Of rates, which no quantity of a table has, only entries have the units.
            if unit_in(third) or re.fullmatch(r"\w+/[^\W\d]+", third):
                cells, unit = cells[3:], third
            else:
                cells = cells[2:]
            known = found_in(FACTS, name)
            if isinstance(entry, str):
                entry = plain(entry)
                if known in LENGTHS and (parts := AMOUNT.fullmatch(entry)):
                    entry, unit = value(parts[1], sign), parts[2] or unit
            if known in LENGTHS and not (
                isinstance(entry, float) and unit_in(unit or "") and "inal" not in name
            ):
                known = None
            entry = f"{entry:.12g}" if isinstance(entry, float) else entry
            facts.setdefault(known or name, f"{entry} {unit}" if unit else entry)
    return facts
