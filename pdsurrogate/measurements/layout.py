"""Tables in the rows of a file: which columns belong together, and what they mean."""

import dataclasses
import re

import numpy as np

from .quantities import (
    FACTS,
    GEOMETRY,
    KINDS,
    LENGTHS,
    MECHANICAL,
    MODES,
    STATISTICS,
    found_in,
    is_of_unit,
    quantities_of,
)
from .segments import TEXT, Segment, facts_of, kind_of, lines_of, segments, take_headings
from .table import Block, Column
from .text import Row


@dataclasses.dataclass
class Found:
    """Contents of the sheets of a file found so far: tables, facts of all of them and of
    specimens by their names, and notes.
    """

    blocks: list[Block] = dataclasses.field(default_factory=list)
    general: dict[str, str] = dataclasses.field(default_factory=dict)
    specimens: list[tuple[str, dict[str, str]]] = dataclasses.field(default_factory=list)
    notes: list[str] = dataclasses.field(default_factory=list)


def groups(segment: Segment) -> list[list[int]]:
    """Return the columns of each specimen of a table: a heading that is repeated begins another
    one, and columns before the first repeated one belong to all.
    """
    columns = segment.columns
    heads = [segment.headings[place] for place in columns]
    repeated = [heads.count(head) > 1 and head[0] != "" for head in heads]
    if not any(repeated):
        return [columns]
    shared = columns[: repeated.index(True)]
    found: list[list[int]] = []
    seen: set = set()
    for place, head in zip(columns[len(shared) :], heads[len(shared) :], strict=True):
        if not found or head in seen:
            found.append([*shared])
            seen = set()
        seen.add(head)
        found[-1].append(place)
    return found


def title_at(segment: Segment, place: int) -> str:
    """Return the title of a column: the last entry of the row of titles up to it."""
    for row in segment.titles:
        entries = [row.text(one) for one in row.filled if one <= place]
        if entries:
            return entries[-1].rstrip(": ")
    return ""


def read_rows(rows: list[Row], found: Found, sheet: str = "", sign: str = ".") -> None:
    """Add the tables of the rows of a file or a sheet to what is found.

    Raises
    ------
    ValueError
        If a cell inside a table is no number, or a column has a unit that is none of its heading.
    """
    tables, after = segments(rows)
    general = found.general | ({"sheet": sheet} if sheet else {})
    kept: list[tuple[Segment, dict[str, str]]] = []
    for segment in tables:
        take_headings(segment, kept[-1][0] if kept else None, sign)
        facts = facts_of(segment.above, sign)
        kinds = {found_in(KINDS, heading) for heading, _ in segment.headings.values()}
        if not kinds & MECHANICAL and ("no measurement" in kinds or _measures(segment)):
            found.specimens += _specimens(segment)
            general = general | facts
            what = "sizes of specimens" if _measures(segment) else "results, which are not read"
            found.notes.append(f"{sheet} {lines_of(segment.rows)}: {what}".strip())
            continue
        same = facts.get("specimen") in (None, general.get("specimen"))
        if {*facts} & {*GEOMETRY}:
            general = {name: one for name, one in general.items() if name not in LENGTHS}
        general = general | facts
        if kept and same and _goes_on(segment, kept[-1][0]):
            kept[-1][0].rows += segment.rows
        else:
            kept.append((segment, general))
            # sizes are also those of the specimens that follow, how a test ended is not
            general = {
                name: one
                for name, one in general.items()
                if name != "broke" or name in found.general
            }
    for segment, facts in kept:
        split = groups(segment)
        if common := {*split[0]}.intersection(*split[1:]) if len(split) > 1 else ():
            heads = ", ".join(repr(segment.headings[place][0]) for place in sorted(common))
            found.notes.append(f"{sheet} {len(split)} specimens side by side share {heads}".strip())
        for places in split:
            title = title_at(segment, places[-1] if len(split) > 1 else places[0])
            found.blocks.append(block(segment, places, title or sheet, facts))
    if not tables:
        found.general |= facts_of(after, sign)
    elif after:
        found.notes.append(f"{sheet} {lines_of(after)} after the tables: not read".strip())


def _goes_on(segment: Segment, before: Segment) -> bool:
    """Whether a table continues the one before: without a title, at later times."""
    times = [place for place, head in segment.headings.items() if quantities_of(*head) == ("time",)]
    if segment.headings != before.headings or segment.titles or len(times) != 1:
        return False
    old, new = (row.filled.get(times[0]) for row in (before.rows[-1], segment.rows[0]))
    return isinstance(old, float) and isinstance(new, float) and new > old


def _measures(segment: Segment) -> dict[int, str]:
    """Return the places of columns with lengths of specimens."""
    found = {place: found_in(FACTS, head) for place, (head, _) in segment.headings.items()}
    return {place: name for place, name in found.items() if name in LENGTHS}


def _specimens(segment: Segment) -> list[tuple[str, dict[str, str]]]:
    """Return the names of specimens and their facts, of a table with a line for each."""
    measures = _measures(segment)
    names = [place for place, (head, _) in segment.headings.items() if kind_of(head) == "specimen"]
    name = (names or segment.columns)[0]
    return [
        (
            row.text(name),
            {
                name: f"{row.text(place)} {segment.headings[place][1] or ''}".strip()
                for place, name in measures.items()
                if place in row.filled
            },
        )
        for row in segment.rows
        if measures and not re.search(STATISTICS, row.text(name).lower())
    ]


def with_specimens(found: Found) -> list[Block]:
    """Return the tables with the facts of their specimens, by the titles or in order."""
    facts = dict(found.specimens)
    blocks = []
    for number, one in enumerate(found.blocks):
        more = facts.get(one.title) or facts.get(one.title.split(" ")[-1])
        if more is None and len(found.specimens) in (1, len(found.blocks)):
            more = found.specimens[number % len(found.specimens)][1]
        blocks.append(dataclasses.replace(one, facts={**one.facts, **(more or {})}))
    return blocks


def block(segment: Segment, places: list[int], title: str, facts: dict[str, str]) -> Block:
    """Return the columns at some places as a block, without rows that are empty there."""
    rows = [row for row in segment.rows if {*places} & row.filled.keys()]
    columns = []
    for place in places:
        heading, unit = segment.headings[place]
        cells = [row.filled.get(place, np.nan) for row in rows]
        texts = any(isinstance(cell, str) for cell in cells)
        quantities = quantities_of(heading, unit)
        if texts and not {*quantities} <= {*TEXT, "cycle"}:
            quantities = ()
        values = np.array([row.text(place) for row in rows] if texts else cells)
        columns.append(Column(heading, unit, quantities, values))
    meant = {one for column in columns for one in column.quantities}
    for quantity in {"force", "time"} - meant:  # a unit says it where no heading does
        unknown = [
            place
            for place, one in enumerate(columns)
            if is_of_unit(one.heading, one.unit, quantity)
        ]
        if len(unknown) == 1:
            columns[unknown[0]] = dataclasses.replace(columns[unknown[0]], quantities=(quantity,))
    mode = next(
        (mode for text in (title, *facts.values()) if (mode := found_in(MODES, text))), None
    )
    return Block(
        title or facts.get("specimen", ""),
        tuple(columns),
        np.array([row.number for row in rows]),
        "biaxial" if "lateral-stress" in meant else mode,
        dict(facts),
    )
