"""Text of tables: its encoding, separators and decimal sign, and its lines as rows of cells."""

import csv
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest

from .quantities import FACTS, KINDS, LENGTHS, found_in, plain

ENCODINGS = ["cp1252", "gb18030", "cp932", "euc_jp", "latin_1"]
"""Encodings of machines, beside UTF-8 and UTF-16."""

MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
"""First bytes that state an encoding."""

SEPARATORS = ("\t", ";", ",", "|", " ")

SAMPLE = 2000
"""Lines by which the separator and the decimal sign are found."""

GROUPS = "'\u2019\u00a0\u202f"
"""Signs between thousands, beside the point or comma that is not the decimal sign."""

NUMBERS = {
    sign: re.compile(
        rf"[+\u2212-]?(?:\d{{1,3}}(?P<group>[{other}{GROUPS}])\d{{3}}(?:(?P=group)\d{{3}})*|\d+"
        rf"|(?=[{sign}]\d))(?:[{sign}]\d*)?(?:[eE][+-]?\d+)?"
    )
    for sign, other in (".,", ",.")
}
"""Numbers by their decimal sign."""

PLAIN = {sign: str.maketrans(",\u2212", ".-", other + GROUPS) for sign, other in (".,", ",.")}
"""Tables of characters that turn them into numbers of Python, by decimal sign."""

MISSING = {"", "-", "--", "---", "n/a", "na", "nan", "null", "#n/a", "*", "*****"}
"""Cells without a value, in small letters."""


@dataclass
class Row:
    """A line of a file: its number from 1, and numbers and text."""

    number: int
    cells: list[float | str]
    comment: bool = False

    @cached_property
    def filled(self) -> dict[int, float | str]:
        """The cells that have a value, by their places."""
        return {
            place: cell
            for place, cell in enumerate(self.cells)
            if not isinstance(cell, str) or cell.lower() not in MISSING
        }

    def text(self, place: int) -> str:
        """Return a cell as text, empty beyond the end."""
        cell = self.cells[place] if place < len(self.cells) else ""
        return cell if isinstance(cell, str) else f"{cell:.12g}"


def decode(data: bytes) -> tuple[str, str] | None:
    """Return the text of a file and its encoding; None for a binary file.

    Numbers have the same bytes in all encodings but UTF-16: a wrong guess makes headings that
    nobody understands, and leaves the numbers.
    """
    from charset_normalizer import from_bytes

    name = next((name for mark, name in MARKS.items() if data.startswith(mark)), "utf-8")
    zeros = [data[start:4000:2].count(0) for start in (0, 1)]
    if name != "utf-16" and max(zeros):
        if min(zeros) or max(zeros) < len(data[:4000]) / 4:
            return None
        name = ("utf-16-be", "utf-16-le")[zeros[1] > 0]
    try:
        text = data.decode(name)
    except UnicodeDecodeError:
        # Few bytes tell encodings apart badly; known words do it well.
        found = [*from_bytes(data, cp_isolation=ENCODINGS, threshold=0.5)]
        if name != "utf-8":
            return None
        best = max(found, key=lambda one: _known_words(str(one)), default=None)
        text, name = (str(best), best.encoding) if best else (data.decode("latin_1"), "latin_1")
    return None if re.search(r"[\x00-\x08\x0e-\x19]", text[:4000]) else (text, name)


def _known_words(text: str) -> int:
    """Number of words with other letters than those of English that `KINDS` and `FACTS` know."""
    words = plain(text[:20000]).lower()
    return len(re.findall("m²|µm|°C", text)) + sum(
        not found[0].isascii()
        for table in (KINDS, FACTS)
        for pattern in table.values()
        for found in re.finditer(pattern, words)
    )


def numeric(cell: str) -> bool:
    """Whether a cell is a number with either decimal sign."""
    return any(pattern.fullmatch(cell) for pattern in NUMBERS.values())


def lines_in(text: str) -> list[str]:
    """Return the lines of the text of a table; raise ValueError if one is too long."""
    lines = [line.strip("\ufeff\x1a") for line in text.splitlines()]
    if any(len(line) > csv.field_size_limit() for line in lines):
        raise ValueError("a line is too long for a table")
    return lines


def split(lines: list[str], separator: str) -> list[list[str]]:
    """Return the cells of lines; quotes protect separators, but not the ends of lines."""
    lines = [line.replace('"', "") if line.count('"') % 2 else line for line in lines]
    if separator == " ":
        return [line.replace('"', "").split() for line in lines]
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    return [[cell.strip() for cell in row] for row in reader]


def _numbers(cells: list[str]) -> int:
    """Return 2 for a row of numbers, two at least, 1 if as many other cells stand with them."""
    filled = [cell for cell in cells if cell.lower() not in MISSING]
    numbers = sum(map(numeric, filled))
    return 0 if numbers < 2 else 2 if numbers == len(filled) else int(2 * numbers >= len(filled))


def rows_of(text: str) -> tuple[list[Row], str, str]:
    """Return the rows of a text, its separator and its decimal sign.

    Raises
    ------
    ValueError
        If there is no table of two columns, or the decimal sign is ambiguous.
    """
    lines = lines_in(text)
    marks = [re.match(r"\s*(#+|//|\*\*|sep=)\s?", line) for line in lines]
    bare = [line[mark.end() :] if mark else line for line, mark in zip(lines, marks, strict=True)]
    body = [line for line, mark in zip(lines, marks, strict=True) if line.strip() and not mark]
    middle = max(0, len(body) - SAMPLE) // 2
    sample = body[middle : middle + SAMPLE]
    scores = {one: sum(map(_numbers, split(sample, one))) for one in SEPARATORS}
    # Words and numbers of notes count for blanks.
    separator = next(one for one in SEPARATORS if scores[one] >= 0.8 * max(scores.values()))
    if not scores[separator]:
        raise ValueError(
            "no line has two numbers with a tab, semicolon, comma, bar or blanks between them"
        )
    cells = split(bare, separator)
    if separator == " ":
        cells = _words(bare, cells)
    table = [row for row, mark in zip(cells, marks, strict=True) if not mark][:SAMPLE]
    sign = decimal_sign(table, lengths_in(cells))
    rows = [
        Row(number, [value(cell, sign) for cell in row], mark is not None)
        for number, (row, mark) in enumerate(zip(cells, marks, strict=True), start=1)
    ]
    return rows, separator, sign


def _words(lines: list[str], cells: list[list[str]]) -> list[list[str]]:
    """Return cells of lines that blanks separate: headings and notes have blanks inside."""
    width = Counter(len(row) for row in cells if _numbers(row)).most_common(1)[0][0]
    found = []
    for line, row in zip(lines, cells, strict=True):
        ways = [
            row,
            *(re.split(pattern, line.strip()) for pattern in (r"\t+|\s{2,}", r"\s+(?![(\[])")),
        ]
        whole = row if _numbers(row) == 2 else [line.strip()]
        found.append(next((way for way in ways if len(way) == width), whole))
    return found


def lengths_in(cells: list[list[str]]) -> list[str]:
    """Return the numbers in rows that state sizes of a specimen."""
    return [
        word.strip(":=")
        for row in cells
        if not _numbers(row) and any(found_in(FACTS, cell) in LENGTHS for cell in row)
        for cell in row
        for word in re.split(r"[\s:=]+|(?<=\d)(?=[^\W\d])", cell)
    ]


def decimal_sign(cells: list[list[str]], lengths: Iterable[str]) -> str:
    """Return the decimal sign of numbers: a point, unless some of them need a comma; the sizes of
    specimens settle it where tables do not.

    Raises
    ------
    ValueError
        If some numbers need a comma and others a point, or a comma can be either.
    """
    needs, unclear = _signs(cell for row in cells if _numbers(row) for cell in row)
    if grouped := _in_groups(cells, next(iter(needs), ".")):
        raise ValueError(
            f"{grouped} can be {grouped.replace(',', '.')} or {re.sub('[.,]', '', grouped)}: other"
            " numbers of its column have no decimals: export it without signs between thousands"
        )
    if len(needs) > 1:
        raise ValueError(
            f"the decimal sign is a comma in {needs[',']} and a point in {needs['.']}: use one"
        )
    sizes, size = _signs(lengths)
    settled = needs or sizes
    needs = settled or _signs(cell for row in cells for cell in row)[0]
    if len(needs) == 1:
        # Points stand in versions and dates as well, which settle no size; commas do not.
        unclear, size = "", "" if settled or "," in needs else size
    if unclear := unclear or size:
        raise ValueError(
            f"{unclear} can be {unclear.replace(',', '.')} or {unclear.replace(',', '')}, and no"
            " other number settles it: export it with decimal points"
        )
    sign = next(iter(needs)) if len(needs) == 1 else "."
    other = "," if sign == "." else "."
    grouped = next(
        (one for one in lengths if re.fullmatch(rf"[1-9]\d{{0,2}}[{other}]\d{{3}}", one)), None
    )
    if grouped and other in sizes:
        raise ValueError(
            f"the decimal sign of the table is {sign}, and a size of the specimen is"
            f" {sizes[other]}, so {grouped} can be two numbers: use one decimal sign"
        )
    return sign


def _in_groups(cells: list[list[str]], sign: str) -> str | None:
    """Return a number with a decimal sign that seems to stand between thousands: its column has
    only such ones and numbers below a thousand without decimals.
    """
    for column in zip_longest(*(row for row in cells if _numbers(row) == 2), fillvalue=""):
        grouped = {
            cell for cell in column if re.fullmatch(rf"[+-]?[1-9]\d{{0,2}}[{sign}]\d{{3}}", cell)
        }
        others = {cell for cell in column if cell.lower() not in MISSING} - grouped
        whole = all(re.fullmatch(r"[+-]?\d{1,3}", cell) for cell in others)
        if grouped and whole and any(len(cell.lstrip("+-")) == 3 for cell in others):
            return min(grouped)
    return None


def _signs(cells: Iterable[str]) -> tuple[dict[str, str], str]:
    """Return a number for each decimal sign that numbers need, and one that is unclear."""
    needs: dict[str, str] = {}
    unclear = ""
    for cell in cells:
        marks = re.findall("[.,]", cell)
        if not marks or not numeric(cell):
            continue
        if len(marks) > len({*marks}) == 1:
            needs.setdefault("." if marks[0] == "," else ",", cell)
        elif len(marks) > 1 or not re.fullmatch(r"[+-]?[1-9]\d{0,2}[.,]\d{3}", cell):
            needs.setdefault(marks[-1], cell)
        elif marks[0] == ",":
            unclear = cell
    return needs, unclear


def value(cell: str, sign: str) -> float | str:
    """Return the number in a cell, or its text."""
    return float(cell.translate(PLAIN[sign])) if NUMBERS[sign].fullmatch(cell) else cell
