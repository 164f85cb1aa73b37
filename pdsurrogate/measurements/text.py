"""Text of tables: its encoding, separators and decimal sign, and its lines as rows of cells."""

import csv
import re
from collections import Counter
from typing import NamedTuple

from .quantities import FACTS, KINDS, plain

ENCODINGS = ["utf_8", "cp1252", "gb18030", "cp932", "euc_jp"]
"""Encodings of machines, beside UTF-16, which is seen by its zeros."""

MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}

SEPARATORS = ("\t", ";", ",", "|", " ")

NUMBER = re.compile(
    r"[+-]?(\d{1,3}(?P<group>[.,'\u2019 \u00a0\u202f])\d{3}((?P=group)\d{3})*|\d+)?"
    r"((?P<sign>[.,])\d*)?([eE][+-]?\d+)?"
)
"""A number with either decimal sign and with groups of thousands."""

MISSING = {"", "-", "--", "---", "n/a", "na", "nan", "null", "#n/a", "*", "inf"} - {"inf"}
"""Cells without a value, in small letters."""


class Row(NamedTuple):
    """A line of a file: its number from 1, and numbers and text; "" is an empty cell."""

    number: int
    cells: list[float | str]
    comment: bool = False


def decode(data: bytes) -> tuple[str, str] | None:
    """Return the text of a file and its encoding; None for a binary file.

    Numbers have the same bytes in all encodings but UTF-16: a wrong guess makes headings that
    nobody understands, and leaves the numbers.
    """
    from charset_normalizer import from_bytes

    marked = next((name for mark, name in MARKS.items() if data.startswith(mark)), None)
    if marked is None and b"\0" in data[:4000]:
        zeros = [data[start:4000:2].count(0) for start in (0, 1)]
        marked = ("utf-16-be", "utf-16-le")[zeros[1] > zeros[0]]
        if max(zeros) < len(data[:4000]) / 4 or min(zeros):
            return None
    try:
        name = marked or "utf-8"
        text = data.decode(name)
    except UnicodeDecodeError:
        if marked:
            return None
        found = list(from_bytes(data, cp_isolation=ENCODINGS, threshold=0.5))
        if not found:
            return None
        # Few bytes tell encodings apart badly; known words do it well.
        best = max(found, key=lambda one: _known_words(str(one)))
        text, name = str(best), best.encoding
    if re.search(r"[\x01-\x08\x0e-\x19]", text[:4000]):
        return None
    return text, name


def _known_words(text: str) -> int:
    """Number of words with other letters than those of English that `KINDS` and `FACTS` know."""
    words = plain(text[:20000]).lower()
    return sum(
        not found[0].isascii()
        for table in (KINDS, FACTS)
        for pattern in table.values()
        for found in re.finditer(pattern, words)
    )


def numeric(cell: str) -> bool:
    """Whether a cell is a number with either decimal sign."""
    found = NUMBER.fullmatch(cell)
    return bool(found) and any(letter.isdigit() for letter in cell)


def split(lines: list[str], separator: str) -> list[list[str]]:
    """Return the cells of lines; quotes protect separators."""
    if separator == " ":
        return [line.replace('"', "").split() for line in lines]
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    return [[cell.strip().strip("'").strip() for cell in row] for row in reader]


def _is_table(cells: list[str]) -> int:
    """Number of numbers in a row that has nothing but numbers, two at least."""
    filled = [cell for cell in cells if cell.lower() not in MISSING]
    return len(filled) if len(filled) > 1 and all(map(numeric, filled)) else 0


def rows_of(text: str) -> tuple[list[Row], str, str]:
    """Return the rows of a text, its separator and its decimal sign.

    Raises
    ------
    ValueError
        If there is no table of two columns, or the decimal sign is ambiguous.
    """
    lines = [line.strip("\ufeff\x1a\0") for line in text.splitlines()]
    comments = [bool(re.match(r"\s*(#|//|\*\*)", line)) for line in lines]
    bare = [re.sub(r"^\s*(#|//|\*\*)+\s?", "", line) for line in lines]
    body = [line for line, comment in zip(lines, comments, strict=True) if not comment]
    # An unbalanced quote must not swallow lines.
    bare = [line.replace('"', "") if line.count('"') % 2 else line for line in bare]
    body = [line.replace('"', "") if line.count('"') % 2 else line for line in body]
    scores = {one: sum(map(bool, map(_partly, split(body, one)))) for one in SEPARATORS}
    separator = max(scores, key=lambda one: scores[one])
    if not scores[separator]:
        raise ValueError(
            "there is no table: no line has two numbers that are separated by a tab, semicolon,"
            " comma or blanks"
        )
    cells = split(bare, separator)
    if separator == " ":
        cells = _words(bare, cells)
    sign = decimal_sign(
        cell for row, comment in zip(cells, comments, strict=True) if not comment for cell in row
    )
    return (
        [
            Row(number, [value(cell, sign) for cell in row], comment)
            for number, (row, comment) in enumerate(zip(cells, comments, strict=True), start=1)
        ],
        separator,
        sign,
    )


def _partly(cells: list[str]) -> bool:
    """Whether a row has two numbers and at most as much else."""
    filled = [cell for cell in cells if cell.lower() not in MISSING]
    numbers = sum(map(numeric, filled))
    return numbers > 1 and 2 * numbers >= len(filled)


def _words(lines: list[str], cells: list[list[str]]) -> list[list[str]]:
    """Return cells of lines that blanks separate, where headings and notes have blanks inside."""
    width = Counter(len(row) for row in cells if _is_table(row)).most_common(1)
    wanted = width[0][0] if width else 0
    found = []
    for line, row in zip(lines, cells, strict=True):
        ways = [re.split(pattern, line.strip()) for pattern in (r"\t+|\s{2,}", r"\s+(?![(\[])")]
        fitting = [way for way in ways if len(way) == wanted]
        if not _is_table(row) and len(row) != wanted:
            row = [cell.strip('" ') for cell in (fitting or ways)[0]]
        found.append(row)
    return found


def decimal_sign(cells) -> str:
    """Return the decimal sign of numbers: a point, unless some of them need a comma.

    Raises
    ------
    ValueError
        If some numbers need a comma and others a point, or a comma can be either.
    """
    needs: dict[str, str] = {}
    unclear = ""
    for cell in cells:
        found = NUMBER.fullmatch(cell)
        if not found or not ("," in cell or "." in cell):
            continue
        group, sign = found["group"], found["sign"]
        if sign and group != sign:
            needs.setdefault(sign, cell)
        elif group in (".", ",") and (found[2] or re.match(r"[+-]?0\d*[.,]", cell)):
            one = re.match(r"[+-]?0", cell) is not None
            repeated = cell.count(group) > 1
            if repeated:
                needs.setdefault("," if group == "." else ".", cell)
            elif one:
                needs.setdefault(group, cell)
            elif group == ",":
                unclear = unclear or cell
        elif group == ",":
            unclear = unclear or cell
    if len(needs) > 1:
        raise ValueError(
            f"the decimal sign is a comma in {needs[',']} and a point in {needs['.']}: use one"
        )
    if unclear and not needs:
        raise ValueError(
            f"{unclear} can be {unclear.replace(',', '.')} or {unclear.replace(',', '')}, and no"
            " other number settles it: export it with decimal points"
        )
    return next(iter(needs), ".")


def value(cell: str, sign: str) -> float | str:
    """Return the number in a cell, or its text."""
    if not numeric(cell):
        return "" if cell.lower() in MISSING - {"-"} else cell
    other = "," if sign == "." else "."
    digits = re.sub(rf"[{other}'\u2019 \u00a0\u202f]", "", cell)
    return float(digits.replace(sign, "."))
