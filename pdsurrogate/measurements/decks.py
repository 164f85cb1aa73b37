"""Test data in decks of Abaqus and programs with its keywords, ``*UNIAXIAL TEST DATA`` and the
like: the stress comes first, then the nominal strain.
"""

import re
from collections import Counter

from .text import Row, value

CURVE = ["nominal stress", "nominal strain", "lateral strain", "temperature"]

TESTS = {
    "uniaxial": CURVE,
    "biaxial": CURVE,
    "planar": CURVE,
    "volumetric": ["pressure", "volume ratio", "temperature"],
}
"""Columns of tests by their keywords."""

KEYWORD = re.compile(r"\s*\*\s*((\w+)\s+test\s+data)\b", re.IGNORECASE)


def is_deck(text: str) -> bool:
    """Whether a text has test data by keywords."""
    return any(
        (found := KEYWORD.match(line)) and found[2].lower() in TESTS for line in text.splitlines()
    )


def rows_of_deck(text: str) -> tuple[list[Row], list[str]]:
    """Return the tests of a deck as rows with titles and headings, and a note that counts the
    keywords that are skipped.

    Raises
    ------
    ValueError
        If a line of a test has fewer than two cells, or one that is no number.
    """
    rows: list[Row] = []
    skipped: Counter = Counter()
    heading = None
    for number, line in enumerate(text.splitlines(), start=1):
        cells = [value(cell.strip(), ".") for cell in line.strip(" ,").split(",")]
        if line.lstrip().startswith("*") and not line.lstrip().startswith("**"):
            found = KEYWORD.match(line)
            heading = TESTS.get(found[2].lower()) if found else None
            if found and heading:
                rows += [Row(number, [found[1].lower()]), Row(number, [*heading])]
            else:
                skipped[str(cells[0]).upper()] += 1
        elif heading and line.strip() and not line.lstrip().startswith("**"):
            if len(cells) < 2 or any(isinstance(cell, str) for cell in cells):
                raise ValueError(
                    f"line {number}: {line.strip()!r} is no row of {', '.join(heading[:2])} and at"
                    f" most {' and '.join(heading[2:])}"
                )
            rows.append(Row(number, cells))
    words = ", ".join(f"{count} {keyword}" for keyword, count in skipped.items())
    return rows, [f"keywords that are not read: {words}"] if words else []
