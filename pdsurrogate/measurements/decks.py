"""Test data in decks of Abaqus and programs with its keywords, ``*UNIAXIAL TEST DATA`` and the
like: the stress comes first, then the nominal strain.
"""

import re
from collections import Counter

import numpy as np

from .layout import Found
from .table import Block, Column

TESTS = {
    "uniaxial": ("uniaxial", "nominal-stress", "engineering-strain", "lateral-strain"),
    "biaxial": ("equibiaxial", "nominal-stress", "engineering-strain", "lateral-strain"),
    "planar": ("pure-shear", "nominal-stress", "engineering-strain", "lateral-strain"),
    "volumetric": ("volumetric", "pressure", "volume-ratio"),
}
"""Mode and columns of a test by its keyword; what follows in a line is a temperature."""

KEYWORD = re.compile(r"\s*\*\s*(\w+)\s+test\s+data\b(.*)", re.IGNORECASE)


def is_deck(text: str) -> bool:
    """Whether a text has test data by keywords."""
    return any(
        (found := KEYWORD.match(line)) and found[1].lower() in TESTS for line in text.splitlines()
    )


def tests_of(text: str) -> Found:
    """Return the tests of a deck, and a note that counts the keywords that are skipped.

    Raises
    ------
    ValueError
        If a line of a test has a cell that is no number, or another number of cells.
    """
    tests: list[tuple[str, dict[int, list[float]]]] = []
    skipped: Counter = Counter()
    rows: dict[int, list[float]] | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("**"):
            continue
        if line.lstrip().startswith("*"):
            found = KEYWORD.match(line)
            rows = None
            if found and found[1].lower() in TESTS:
                rows = {}
                tests.append((found[1].lower(), rows))
            else:
                skipped[line.split(",")[0].strip().upper()] += 1
        elif rows is not None:
            try:
                cells = [float(cell) for cell in line.strip().rstrip(",").split(",")]
            except ValueError:
                raise ValueError(
                    f"line {number}: {line.strip()!r} has a cell that is no number"
                ) from None
            if len(cells) < 2 or (rows and len(cells) != len(next(iter(rows.values())))):
                raise ValueError(
                    f"line {number} has {len(cells)} numbers: a stress, a strain and at most a"
                    " lateral strain and a temperature, as many as the line before"
                )
            rows[number] = cells
    words = ", ".join(f"{count} {keyword}" for keyword, count in skipped.items())
    notes = [f"keywords that are not read: {words}"] if words else []
    return Found([_block(keyword, rows) for keyword, rows in tests if rows], notes=notes)


def _block(keyword: str, rows: dict[int, list[float]]) -> Block:
    """Return a test as a block."""
    mode, *names = TESTS[keyword]
    values = np.array(list(rows.values())).T
    names = [*names, *["temperature"] * len(values)][: len(values)]
    columns = [
        Column(name.replace("-", " "), None, () if name == "pressure" else (name,), column)
        for name, column in zip(names, values, strict=True)
    ]
    return Block(f"{keyword} test data", tuple(columns), np.array(list(rows)), mode)
