"""Files of testing machines, whatever their form: text, workbooks, decks."""

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path

from ..arguments import check_known, check_path
from .decks import is_deck, rows_of_deck
from .layout import Found, read_rows, with_specimens
from .quantities import UNITS, factor, fits, plain, quantities_of, unit_in
from .table import FAMILIES, QUANTITIES, Block, Column, TableFile
from .text import Row, decimal_sign, decode, lengths_in, rows_of, value

BINARY = {
    b"%PDF": "a PDF document",
    b"\x89PNG": "a picture (PNG)",
    b"\xff\xd8\xff": "a picture (JPEG)",
    b"GIF8": "a picture (GIF)",
    b"BM": "a picture (BMP)",
    b"II*\0": "a picture (TIFF)",
    b"MM\0*": "a picture (TIFF)",
    b"\x1f\x8b": "a compressed file (gzip)",
    b"\x89HDF": "an HDF5 file",
    b"MATLAB": "a file of MATLAB",
    b"\x93NUMPY": "a file of NumPy",
    b"<": "an HTML or XML document",
    b"{": "a JSON document",
}
"""First bytes of files that are no tables, apart from blanks."""

WORKBOOKS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")

FORMS = {
    "Zwick testXpert": r"standardkraft|standardweg|traversenweg|testxpert|prüfzeit",
    "Shimadzu Trapezium": r"trapezium|\b1 _ ?1\b",
    "MTS": r"axial (force|displacement|count)|testsuite|testworks|data acquisition",
    "Instron Bluehill": r"bluehill|specimen_rawdata|results table|^\s*\"?\(s\)|^\"?\((mm|N|in)\)",
    "table of this project": r"^\s*(mode\s*,\s*)?stretch\s*,\s*(lateral_stretch|nominal_stress)",
}
"""Words by which the programs of machines are known."""

MEASURED = {*QUANTITIES} - {"time", "mode", "cycle", "specimen", "weight", "temperature", "broke"}
"""Quantities that make a table one of a test."""

NEEDED = "a table of text, a workbook or a deck with test data is needed"


def read_tables(
    path: str | Path,
    *,
    columns: Mapping[str, str | int] | None = None,
    units: Mapping[str, str] | None = None,
) -> TableFile:
    r"""Return the tables in a file of a testing machine.

    Text with any separators, decimal sign and encoding, workbooks (.xlsx, .xls, .ods; with the
    extra ``xlsx``), and decks with ``*UNIAXIAL TEST DATA`` and the like are known by what they
    contain, not by their names.

    Parameters
    ----------
    path : str or path
    columns : dict of str to str or int, optional
        Headings by quantity, such as ``{"force": "Kraft"}``, in place of what the headings say; a
        number, from 1, names a column by its place.
    units : dict of str to str, optional
        Units by quantity, such as ``{"stress": "kPa"}``, where the file has none.

    Returns
    -------
    TableFile

    Raises
    ------
    ValueError
        If the file cannot be read, has no table of numbers, is ambiguous, or has no column for an
        entry of `columns` or `units`; the message says what is there.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from pdsurrogate.measurements import read_tables
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "test.csv"
    ...     _ = path.write_text("Dehnung in %;Kraft (N)\n0;0\n2,5;1,2\n")
    ...     (block,) = read_tables(path).blocks
    >>> [(column.quantities, column.unit) for column in block.columns]
    [(('engineering-strain',), '%'), (('force',), 'N')]
    """
    check_path(path, "file of test data")
    path = Path(path)
    try:
        found = _read(path)
        blocks = _with_units(_with_columns(found.blocks, columns or {}), units or {})
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    for column in (one for block in blocks for one in block.columns):
        _check_unit(path, column)
    understood = tuple(one for one in blocks if MEASURED & _meant(one))
    unknown = [str(one.lines[0]) for one in blocks if not MEASURED & _meant(one)]
    if understood and unknown:
        note = f"tables of which no column is understood, from lines {', '.join(unknown)}"
        return dataclasses.replace(found, blocks=understood, notes=(*found.notes, note))
    return dataclasses.replace(found, blocks=blocks)


def _check_unit(path: Path, column: Column) -> None:
    """Raise ValueError for a column whose heading and unit contradict each other."""
    heading, unit = column.heading, column.unit
    meant = quantities_of(heading, None)
    if unit_in(unit or "") is None or column.quantities or not meant:
        return
    if not quantities_of(heading, unit):
        raise ValueError(
            f"{path}: column {heading!r} is in {unit}, which is no unit of {' or '.join(meant)}:"
            f" name what it is, such as columns={{'force': {heading!r}}} (--column"
            f" force={heading})"
        )


def _meant(block: Block) -> set[str]:
    """Return the quantities that the columns of a table may mean."""
    return {one for column in block.columns for one in column.quantities}


def _read(path: Path) -> TableFile:
    """Return the tables of a file by what its first bytes are."""
    if (size := path.stat().st_size) > 200_000_000:
        raise ValueError(f"a file of {size / 1e9:.1f} GB is no table of a test; {NEEDED}")
    data = path.read_bytes()
    if not data.strip():
        raise ValueError(f"the file is empty; {NEEDED}")
    for mark, what in BINARY.items():
        if data.lstrip().startswith(mark):
            raise ValueError(f"this is {what}; {NEEDED}")
    if data.startswith(WORKBOOKS):
        return _whole(path, "workbook", "", "", "", _workbook(path))
    decoded = decode(data)
    if decoded is None:
        raise ValueError(f"this is a binary file; {NEEDED}")
    text, encoding = decoded
    found, form, separator, sign = Found(), "Abaqus test data", ",", "."
    if is_deck(text):
        rows, found.notes = rows_of_deck(text)
    else:
        rows, separator, sign = rows_of(text)
        flags = re.IGNORECASE | re.MULTILINE
        forms = [form for form, words in FORMS.items() if re.search(words, text[:5000], flags)]
        form = [*forms, "plain columns"][0]
    read_rows(rows, found, sign=sign)
    return _whole(path, form, encoding, separator, sign, found)


def _whole(path, form, encoding, separator, sign, found: Found) -> TableFile:
    """Return a file of tables; raise ValueError if it has none."""
    if not found.blocks:
        notes = f" ({'; '.join(found.notes)})" if found.notes else ""
        raise ValueError(f"there is no table of two columns of numbers{notes}; {NEEDED}")
    blocks = tuple(with_specimens(found))
    return TableFile(path, form, encoding, separator, sign, blocks, tuple(found.notes))


def _workbook(path: Path) -> Found:
    """Return the tables of the sheets of a workbook."""
    try:
        import python_calamine
    except ImportError:
        raise ValueError(
            "this is a workbook, which needs python-calamine: pip install pdsurrogate[xlsx]"
        ) from None
    try:
        book = python_calamine.CalamineWorkbook.from_path(path)
        sheets = {
            name: book.get_sheet_by_name(name).to_python(skip_empty_area=False)
            for name in book.sheet_names
        }
    except python_calamine.CalamineError as error:
        raise ValueError(f"this is no workbook that can be read ({error}); {NEEDED}") from None
    found = Found()
    for name, cells in sheets.items():
        texts = [[one.strip() for one in row if isinstance(one, str)] for row in cells]
        sign = decimal_sign(texts, lengths_in(texts))
        rows = [
            Row(
                number,
                [
                    float(one)
                    if isinstance(one, int | float) and not isinstance(one, bool)
                    else value(str(one).strip(), sign)
                    for one in row
                ],
            )
            for number, row in enumerate(cells, start=1)
        ]
        read_rows(rows, found, name, sign)
    return found


def _named(quantity: str) -> None:
    """Raise ValueError for a name that is no quantity."""
    check_known(quantity, (*QUANTITIES, *FAMILIES), f"there is no quantity {quantity}")


def _headings(blocks: tuple[Block, ...]) -> str:
    """Return the headings of tables for a message."""
    words = dict.fromkeys(
        column.heading or f"column {number} without heading"
        for block in blocks
        for number, column in enumerate(block.columns, start=1)
    )
    return ", ".join(words)


def _with_columns(blocks: tuple[Block, ...], columns: Mapping[str, str | int]) -> tuple[Block, ...]:
    """Return tables whose columns mean what the user says."""
    for quantity, name in columns.items():
        _named(quantity)
        places = [_place(block, plain(str(name)).lower()) for block in blocks]
        if not any(place is not None for place in places):
            raise ValueError(f"there is no column {name}; there are {_headings(blocks)}")
        blocks = tuple(
            block if place is None else _meaning(block, place, FAMILIES.get(quantity, quantity))
            for block, place in zip(blocks, places, strict=True)
        )
    return blocks


def _place(block: Block, name: str) -> int | None:
    """Return the place of the column with a heading, or a number from 1; None if there is none."""
    heads = [(plain(column.heading).lower(), column.unit or "") for column in block.columns]
    found = [
        place
        for place, (head, unit) in enumerate(heads)
        if name in (head, f"{head} ({unit.lower()})")
    ]
    if len(found) > 1:
        numbers = " or ".join(str(place + 1) for place in found)
        raise ValueError(f"there are several columns {name}: give the number, {numbers}")
    number = int(name) if name.isdigit() else 0
    return found[0] if found else number - 1 if 0 < number <= len(heads) else None


def _meaning(block: Block, place: int, quantity: str) -> Block:
    """Return a table in which the column at a place alone means a quantity."""
    named = block.columns[place]
    unit = unit_in(named.unit or "")
    if unit is not None and not fits(unit, quantity):
        raise ValueError(
            f"column {named.heading} is in {named.unit}, which is no unit of {quantity}"
        )
    columns = tuple(
        dataclasses.replace(
            column,
            quantities=(quantity,)
            if column is named
            else tuple(one for one in column.quantities if one != quantity),
        )
        for column in block.columns
    )
    return dataclasses.replace(block, columns=columns)


def _with_units(blocks: tuple[Block, ...], units: Mapping[str, str]) -> tuple[Block, ...]:
    """Return tables with the units that the user gives: for a quantity, or for all stresses or
    strains.
    """
    for quantity, unit in units.items():
        _named(quantity)
        meant = {one for one in QUANTITIES if one == quantity or one.endswith(f"-{quantity}")}
        factor(unit, UNITS.get(next(iter(meant)), "1"))  # refuses units of another kind
        columns = [one for block in blocks for one in block.columns if meant & {*one.quantities}]
        if not columns:
            raise ValueError(f"there is no column of {quantity}; there are {_headings(blocks)}")
        for one in columns:
            if unit_in(one.unit or "") is not None and factor(str(one.unit), unit) != 1.0:
                raise ValueError(
                    f"{unit} is stated for {quantity}, but the file says that {one.heading} is in"
                    f" {one.unit}"
                )
        blocks = tuple(
            dataclasses.replace(
                block,
                columns=tuple(
                    dataclasses.replace(one, unit=unit) if meant & {*one.quantities} else one
                    for one in block.columns
                ),
            )
            for block in blocks
        )
    return blocks
