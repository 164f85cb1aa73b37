"""Reading of material cards of other programs."""

import re
from collections.abc import Iterator, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..materials import LAWS, Law, Memory, Softening
from .constants import law_keys
from .programs import PROGRAMS, Form, Program, compact

SEEN = 1e-3
"""Share of the pressure at J = 0.9 from which volumetric terms that are left out are named."""


class _Line(NamedTuple):
    """Number of a line from 1, its text without a comment, and the same without blanks."""

    number: int
    text: str
    compact: str


class _Head(NamedTuple):
    """Head of a material: its place among the lines, its name, and the parts of its line."""

    at: int
    name: str
    parts: dict[str, str | None]


def read_card(path: str | Path, name: str = "") -> tuple[dict[str, Any], Form, tuple[str, ...]]:
    r"""Return the material that a file of another program states.

    Parameters
    ----------
    path : str or path
        Deck of Abaqus or CalculiX (.inp), or a file of another of `PROGRAMS`.
    name : str
        Name of the material, needed if the file has several.

    Returns
    -------
    keys : dict
        Keys of the material of a scene, in the units of the file; without ``bulk_modulus`` if the
        card states an incompressible material, or leaves it to the program.
    form : Form
        The law in the program, with its volumetric energy.
    remarks : tuple of str
        What the card states beside, which is left out.

    Raises
    ------
    ValueError
        If the file has no card of a law that is known here; the message names line and reason.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pdsurrogate.cards.reading import read_card
    >>> text = "*Material, name=Rubber\n*Hyperelastic, neo hooke\n 0.2, 0.05\n"
    >>> _ = Path("rubber.inp").write_text(text)
    >>> read_card("rubber.inp")[0]
    {'law': 'neo-hookean', 'shear_modulus': 0.4, 'bulk_modulus': 40.0}
    """
    try:
        text = Path(path).read_text("utf-8", errors="replace")
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from None
    return read_text(text, str(path), name)


def built(keys: dict[str, Any]) -> Law:
    """Return the law of the keys of a material."""
    given = {key: tuple(value) if type(value) is list else value for key, value in keys.items()}
    softening = given.pop("softening", None)
    memory = Memory(softening=softening and Softening(**softening))
    return LAWS[given.pop("law")](**given, memory=memory)


def read_text(text: str, source: str, name: str = "") -> tuple[dict, Form, tuple[str, ...]]:
    """Return what `read_card` does for the text of a file, which messages call `source`."""
    for program in PROGRAMS.values():
        lines = list(_lines(program, text))
        if heads := list(_heads(program, lines)):
            break
    else:
        names = ", ".join(program.program for program in PROGRAMS.values())
        seen = re.search(r"(?im)^\s*((\*(hyper|elas|mat_|user)|TB,|/MAT/|<mat|@Beh).*)$", text)
        other = f", but line {text.count(chr(10), 0, seen.start(1)) + 1}: {seen[1]}" if seen else ""
        raise ValueError(f"{source}: no line begins a hyperelastic material of {names}{other}")
    chosen = [head for head in heads if not name or compact(head.name) == compact(name)]
    if len(chosen) != 1:
        names = ", ".join(head.name for head in heads)
        raise ValueError(f"{source}: name one of its hyperelastic materials: {names}")
    number = lines[chosen[0].at].number
    try:
        return _read(program, lines, [head.at for head in heads], chosen[0])
    except ValueError as error:
        at, reason = error.args if len(error.args) == 2 else (number, error)
        raise ValueError(f"{source}, line {at}: {reason}") from None


def _lines(program: Program, text: str) -> Iterator[_Line]:
    """Yield the lines that are not comments."""
    mark = program.comment.split("{}")[0].strip()
    if program.comments:
        text = re.sub(program.comments, lambda found: "\n" * found[0].count("\n"), text)
    number, last = 1, 0
    for found in re.finditer(program.line, text):
        number += text.count("\n", last, found.start())
        last = found.start()
        content = found[0].partition(mark)[0]
        if content.strip() or not found[0].strip():
            yield _Line(number, content, re.sub(r"\s", "", content))


def _matched(pattern: str, line: _Line) -> re.Match | None:
    return re.fullmatch(pattern, line.compact, re.IGNORECASE) if pattern else None


def _heads(program: Program, lines: list[_Line]) -> Iterator[_Head]:
    """Yield the heads of all materials."""
    name = ""
    for at, line in enumerate(lines):
        if named := _matched(program.names, line):
            name = named[1].strip('"')
        if head := _matched(program.heads, line):
            parts = head.groupdict()
            yield _Head(at, name or parts.get("name") or f"line {line.number}", parts)


def _read(
    program: Program, lines: list[_Line], heads: list[int], head: _Head
) -> tuple[dict, Form, tuple[str, ...]]:
    """Return keys, form and remarks of a material; a ValueError has the number of its line, if
    that is not the head's, and its reason.
    """
    if head.parts.get("other"):
        raise ValueError(
            f"{head.parts['other']} is not read, only the constants of a law; identify and fit take"
            " test data from decks"
        )
    form = program.form_of(head.parts["key"] or "")
    stated = int(head.parts.get("terms") or 0)
    if form.terms and head.parts.get("terms") == "":
        raise ValueError(f"state the number of terms of {form.keys[0]} in its line")
    if form.only and stated not in (0, form.only):
        raise ValueError(f"{form.keys[0]} is read with {form.only} terms, not with {stated}")
    begins = [at for at, line in enumerate(lines) if _matched(program.names, line)] or heads
    begin = max((at for at in begins if at <= head.at), default=head.at)
    end = min((at for at in begins if at > head.at), default=len(lines))
    keys: dict[str, Any] = {}
    remarks = []

    def is_of(pattern: str, at: int) -> bool:
        found = _matched(pattern, lines[at])
        if found is None:
            return False
        name, own = found.groupdict().get("name"), head.parts.get("name")
        return begin <= at < end if name is None else name == own or "" in (name, own)

    for at, line in enumerate(lines):
        if is_of(program.refused, at):
            raise ValueError(line.number, f"{line.text.strip()} means what no law here does")
        if is_of(program.beside, at):
            remarks.append(f"line {line.number}: {line.text.strip()} is left out")
        if is_of(re.escape(compact(program.softening)), at):
            keys["softening"] = _softening(line, _rows(program, lines[at + 1 :]))
    start = head.at + 1 + program.skip + bool(head.parts.get("title"))
    texts = _texts(program, _rows(program, lines[start:]))
    for number, text in texts.values():
        if program.longest and len(text) > program.longest:
            remarks.append(
                f"line {number}: of {text}, CalculiX would read {text[: program.longest]} alone"
            )
    values: dict[str, list[float]] = {}
    used = 0
    unstated = 0 if "terms" in head.parts else form.most
    for row, fields in enumerate(form.fields(form.only or stated or form.terms or unstated or 1)):
        for column, field in enumerate(fields, start=1):
            slot = field.label if program.named else (row if program.width else 0, column)
            number, text = texts.pop(slot, (0, ""))
            used = max(used, number)
            if field.name[0] == "?":
                continue
            value = _number(number, text)
            if not field.name.isdigit():
                values.setdefault(field.name, []).append(value)
            elif value != float(field.name):
                raise ValueError(number, f"{field.label} = {text} means what no law here does")
    for slot, (number, text) in texts.items():
        if program.named:
            remarks.append(f"line {number}: {slot} = {text} is left out")
        elif _number(number, text):
            if number > used or program.width:
                raise ValueError(number, f"{text} is of temperature, rate or another law")
            remarks.append(f"line {number}: {text} is left out")
    D = [one or np.inf for one in values.get("D", [0.0])]
    extra = sum(i * 0.1 ** (2 * i - 2) * D[0] / one for i, one in enumerate(D[1:], start=2))
    if extra >= SEEN:
        remarks.append(f"D2 and further are left out, {extra:.1%} of the pressure at J = 0.9")
    keys |= law_keys(values)
    built(keys)  # the law checks its parameters
    return keys, form, tuple(remarks)


def _rows(program: Program, lines: Sequence[_Line]) -> list[_Line]:
    """Return the lines before one that ends rows."""
    return list(takewhile(lambda line: not _matched(program.ends, line), lines))


def _softening(keyword: _Line, lines: Sequence[_Line]) -> dict[str, float]:
    """Return r, m and beta of the lines below a keyword."""
    rows = [line for line in lines if line.compact]
    cells = [*",".join(line.text for line in rows).split(","), ""]
    if len(rows) != 1 or any(cell.strip() for cell in cells[3:]):
        raise ValueError(keyword.number, "one row of r, m and beta is read, without temperatures")
    numbers = [_number(rows[0].number, cell.strip()) for cell in cells]
    return dict(zip(("r", "m", "beta"), numbers, strict=False))


def _texts(program: Program, lines: Sequence[_Line]) -> dict[Any, tuple[int, str]]:
    """Return number of line and text of the fields of rows, by label, or by row and column."""
    found: dict[Any, tuple[int, str]] = {}
    size = program.width
    row = filled = 0
    for line in lines:
        match = _matched(program.rows, line)
        if not (line.compact or size):
            continue
        if program.rows and not match:
            raise ValueError(line.number, f"{line.text.strip()} is not read")
        parts = match.groupdict() if match else {"fields": line.text}
        if parts["fields"] is None:
            continue
        cells = parts["fields"].split(",")
        if size and len(cells) == 1:
            cells = [line.text[at : at + size] for at in range(0, len(line.text), size)]
        begin = int(parts.get("first") or filled + 1) if program.rows else row * program.per_row + 1
        for column, cell in enumerate(cells, start=1 if size else begin):
            slot = parts["label"] if program.named else (row if size else 0, column)
            if slot in found and cell:
                raise ValueError(line.number, f"{cell} is a second value, as for temperatures")
            if cell.strip():
                found[slot] = (line.number, cell.strip())
                filled = column
        row += 1
    return found


def _number(number: int, text: str) -> float:
    """Return the number in a field of a line, 0 if it is empty; exponents may be Fortran's D."""
    try:
        return float(text.upper().replace("D", "E") or 0)
    except ValueError:
        raise ValueError(number, f"{text!r} is not a number") from None
