"""Writing and reading of a run's tables: history and convergence as CSV or HTML, with units in
the headers, and the summary.
"""

import csv
import io
import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from ..html_tables import html_facts, html_table
from ..scenes import Units
from .files import write_json, write_text
from .folder import CONVERGENCE, HISTORY, SUMMARY

UNITS_OF_COLUMNS = {
    r"time": "time",
    r"nominal_stress": "stress",
    r"energy|work|(kinetic|damped|strain|released)_energy|dissipated_by_.*|moment_.*": "energy",
    r"force_.*": "force",
    r"(.*_)?displacement_.*|contact_penetration_.*": "length",
    r"contact_area_.*": "area",
}
"""Units of the columns of tables: from a regular expression of the names of columns to the name
of a unit in `Units`.
"""


def column_title(column: str, units: Units) -> str:
    """Return the header of a column of the history: its name, followed by its unit in brackets
    if it has one.
    """
    unit = column_unit(column, units)
    return f"{column} [{unit}]" if unit else column


def column_name(title: str) -> str:
    """Return the name of a column of the history from its header, see `column_title`."""
    return title.split(" [")[0]


def column_unit(column: str, units: Units) -> str | None:
    """Return the unit of a column of the history as text, such as "mm"; None if it has no unit
    or the scene names none.
    """
    kind = kind_of(column)
    return kind and getattr(units, kind)


def kind_of(column: str) -> str | None:
    """Return the name in `Units` of the unit of a column of the history; None if it has none."""
    return next(
        (kind for pattern, kind in UNITS_OF_COLUMNS.items() if re.fullmatch(pattern, column)), None
    )


def columns_of(rows: Iterable[dict]) -> list[str]:
    """Return the names of the columns that occur in any row of a table, in order of appearance;
    rows may have different columns.
    """
    return list(dict.fromkeys(column for row in rows for column in row))


def write_tables(
    folder: Path, summary: dict, history: list[dict], convergence: list[dict], units: Units
) -> None:
    """Write ``history.csv``, ``convergence.csv`` (if it has rows) and, last, ``summary.json`` of
    a run to a folder.
    """
    title = partial(column_title, units=units)
    write_text(folder / HISTORY, as_csv(history, title))
    if convergence:
        write_text(folder / CONVERGENCE, as_csv(convergence, title))
    write_json(folder / SUMMARY, summary)


def as_csv(rows: list[dict], title: Callable[[str], str] = str) -> str:
    """Return rows, which are dictionaries by column, as CSV with the headers that `title`
    returns; missing values are empty.
    """
    text = io.StringIO()
    columns = columns_of(rows)
    if rows:
        writer = csv.DictWriter(text, columns, lineterminator="\n")
        writer.writerow({column: title(column) for column in columns})
        writer.writerows(rows)
    return text.getvalue()


def read_table(path: Path) -> list[dict]:
    """Return the rows of a CSV table that `write_tables` wrote, without units in the names; an
    empty list if there is no file.
    """
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [
            {column_name(key): _plain(value) for key, value in row.items() if value != ""}
            for row in csv.DictReader(file)
        ]


def _plain(text: str) -> int | float | str:
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


def html_history(rows: Sequence[dict], units: Units, without: str = "", digits: int = 5) -> str:
    """Return an HTML table of rows of the history, with numbers of `digits` significant digits;
    empty text if there are no rows.

    Columns whose names begin with `without` are left out, if it is not empty.
    """
    columns = [
        column for column in columns_of(rows) if not (without and column.startswith(without))
    ]
    cells = [
        [f"{row[column]:.{digits}g}" if column in row else "" for column in columns] for row in rows
    ]
    return html_table([column_title(column, units) for column in columns], cells) if rows else ""


def facts(result) -> str:
    """Return a run's force, material, size, cost and ending as a table in HTML, for notebooks
    and for `html_page`.
    """
    summary = result.summary
    found = {
        "force": summary["force"],
        "material": ", ".join(f"{key} {value}" for key, value in summary["material"].items()),
        "points, bonds": f"{summary['n_points']:,}, {summary['n_bonds']:,}",
        "spacing, horizon": (
            f"{summary['spacing']:g},"
            f" {result.scene.units.amount(summary['horizon'], 'length', 'g')}"
        ),
        "states": len(result.states),
        "evaluations": f"{summary['n_force_evaluations']:,} in {summary['seconds_total']:.3g} s",
        "ended": "as asked" if summary["converged"] else summary["failure"],
    }
    return html_facts(f"Result of {summary['scene']}", found)
