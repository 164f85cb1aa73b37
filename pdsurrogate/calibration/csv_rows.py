"""Rows of CSV files of measurements, with their places for messages."""

import csv

import numpy as np


def read_table(file, name: str) -> tuple[list[str], list[tuple[str, dict[str, str]]]]:
    """Return the columns of a CSV file, and its rows by column with their places for messages;
    raise ValueError for text that is not UTF-8, and for lines of another length.

    Lines that begin with # are comments.
    """
    try:
        text = file.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"cannot read {name}: it is not UTF-8 text") from None
    reader = csv.reader(
        "" if line.isspace() or line.lstrip().startswith("#") else line
        for line in text.splitlines()
    )
    (_, columns), *rows = [(reader.line_num, row) for row in reader if row] or [(0, [])]
    found = []
    for number, values in rows:
        where = f"{name}, line {number}"
        if len(values) != len(columns):
            raise ValueError(
                f"{where}: the line has {len(values)} values for {len(columns)} columns; decimals"
                " have points, not commas"
            )
        found.append((where, dict(zip(columns, values, strict=True))))
    return columns, found


def number_in(row: dict[str, str], key: str, where: str) -> float:
    """Return the number in a column of a row; raise ValueError for text or a number that is not
    finite.
    """
    try:
        found = float(row[key])
    except ValueError:
        raise ValueError(f"{where}: {key} is not a number: {row[key]!r}") from None
    if not np.isfinite(found):
        raise ValueError(f"{where}: {key} must be finite")
    return found
