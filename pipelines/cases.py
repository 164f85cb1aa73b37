"""One form for what the documentation measures: cases whose figures are stored as JSON, and tables
made of these.

Figures of a study go to docs/figures/NAME.json case by case, so that cases can be measured one by
one, and from there into the blocks of the pages of docs/validation.
"""

import argparse
import fcntl
import json
import os
import time
import tomllib
from collections.abc import Callable, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from unittest.mock import patch

from pages import FIGURES, markdown_table, replace_block, rounded, shown

import pdsurrogate as pds
from pdsurrogate.results.files import write_json
from pdsurrogate.run.tearing import Tearing

DATA = Path(__file__).parent / "data"
LISTED = tomllib.loads((DATA / "cases.toml").read_text("utf-8"))
"""Cases of scripts, and texts of theirs, by name."""
HEADS = tomllib.loads((DATA / "heads.toml").read_text("utf-8"))
"""Heads of tables by the names of their blocks."""


def listed(name):
    """Cases of a name, as their parameters."""
    return [tuple(case) for case in LISTED[name]]


Figures = Mapping[str, list]
"""Rows by the names of their cases."""


@dataclass(frozen=True)
class Study:
    """Cases with figures of one kind.

    Attributes
    ----------
    name : str
        Name of the JSON.
    cases : dict of callable
        Functions by the name of the case, which give the rows of its figures.
    tables : dict of callable
        Functions by the name of the block on a page, which make its text of all `Figures`.
    """

    name: str
    cases: Mapping[str, Callable[[], Iterable]]
    tables: Mapping[str, Callable[[Figures], str]]


def rows_of(figures):
    """Rows of all cases."""
    return [row for rows in figures.values() for row in rows]


def of_rows(name, measure, cases=((),), rows=rows_of, head=None):
    """A study of one table: `measure` takes the parameters of a case, or its only one, and gives
    its rows. The name of a case has its texts and numbers. `rows` gives those of the table of all
    figures, and `head` its head, if these are others than all and that of the name.
    """
    several = (case if isinstance(case, tuple) else (case,) for case in cases)
    named = {
        ", ".join(str(one) for one in case if isinstance(one, str | int | float)): partial(
            measure, *case
        )
        for case in several
    }
    return Study(name, named, {name: table_of(rows, head or HEADS[name])})


def table_of(rows, head):
    """A function of all figures that makes the table of rows, which `rows` gives of them; its head
    has titles, with a format after a colon.
    """
    titles, _, forms = zip(*(column.partition(": ") for column in head), strict=True)
    return lambda figures: markdown_table(
        list(titles), [list(map(shown, row, forms)) for row in rows(figures)]
    )


def stored(name):
    """Figures of a study that were measured so far."""
    path = FIGURES / f"{name}.json"
    return json.loads(path.read_text("utf-8")) if path.exists() else {}


def report(told, *studies):
    """Measure the cases that the command line names, or all; with ``--docs`` write the tables of
    all stored figures, and without names measure none. `told` is the docstring of the script.
    """
    parser = argparse.ArgumentParser(
        description=told, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "words", nargs="*", help="cases that have all parts of one of these in their names"
    )
    parser.add_argument("--lacking", action="store_true", help="cases without stored figures alone")
    parser.add_argument("--docs", action="store_true", help="put the tables into the documentation")
    arguments = parser.parse_args()
    words = arguments.words or [""] * (arguments.lacking or not arguments.docs)
    for study in studies:
        found = stored(study.name)
        known = found if arguments.lacking else {}
        for case in study.cases:
            name = f"{study.name}: {case}"
            wanted = any(all(part in name for part in word.split()) for word in words)
            if wanted and not known.get(case):
                measure(study, case, dropped=found.keys() - study.cases.keys())
        if arguments.docs:
            write_tables(study)


def measure(study, case, dropped=()):
    """Measure a case, print and store its figures; those of a case that fails stay as they are.
    Cases that others have added meanwhile stay too, and those that are `dropped` go.
    """
    name, began = f"{study.name}: {case}", time.perf_counter()
    try:
        rows = rounded(list(study.cases[case]()))
    except (pds.SimulationFailed, ValueError) as failure:
        print(f"{name}: {failure}", flush=True)
        return
    print(f"{name}: {rows}, {time.perf_counter() - began:.0f} s", flush=True)
    with alone():
        known = stored(study.name) | {case: rows}
        names = [name for name in {**study.cases, **known} if name in known.keys() - dropped]
        write_json(FIGURES / f"{study.name}.json", {name: known[name] for name in names})


@contextmanager
def alone():
    """Context in which no other process stores figures."""
    folder = os.open(FIGURES, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


def write_tables(study):
    """Put the tables of all stored figures into the documentation."""
    for name, table in study.tables.items():
        replace_block(name, table(stored(study.name)))


@contextmanager
def ending_at(bonds):
    """Slow tears end as if separated once they have broken so many bonds: past their peak."""
    whole = Tearing.break_bonds

    def part(tear, pairs, cause):
        found = whole(tear, pairs, cause)
        tear.through |= tear.run.state.crack["broken_bonds"] >= bonds
        return found

    with patch.object(Tearing, "break_bonds", part):
        yield


def scene_of(name, changes):
    """A scene file of the pipelines, with changes by dotted keys."""
    return pds.load_scene(DATA / f"{name}.toml", changes)


@contextmanager
def drawing(name, size, dpi=150):
    """Context with the axes of a figure of the documentation, which gets a legend."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    yield axes
    axes.legend()
    figure.savefig(FIGURES / f"{name}.png", dpi=dpi)


CLAMPS = [{"edge": "bottom"}, {"edge": "top", "travel": 1.0}]
ROLLERS = [{**one, "holds": "normal"} for one in CLAMPS]
"""Grips that pull a body up."""


Errors = Iterable[tuple[str, float, int]]
"""Names of quantities with their error in percent, and the number of force evaluations of the
run.
"""


@dataclass(frozen=True)
class Case:
    """A comparison with a reference at several spacings.

    Attributes
    ----------
    measure : callable
        Of a spacing; gives `Errors`.
    spacings : tuple of float
        From coarse to fine.
    title : str
        What is compared, if the name of the case does not say it.
    """

    measure: Callable[[float], Errors]
    spacings: tuple[float, ...]
    title: str = ""


def percent(found, expected):
    """By how much a value is off."""
    return 100 * (found / expected - 1)


def plane_strain_modulus(shear_modulus, bulk_modulus):
    """E / (1 - nu^2), with Young's modulus E and Poisson's ratio nu, of linear elasticity."""
    stiffness = 3 * bulk_modulus + shear_modulus
    return 4 * shear_modulus * stiffness / (stiffness + 3 * shear_modulus)


def at_spacings(name, cases):
    """A study of errors: a row of its table has those of a quantity at all spacings of a case."""
    named = {
        f"{title}, spacing {spacing:.4g}": partial(case.measure, spacing)
        for title, case in cases.items()
        for spacing in case.spacings
    }

    def table(figures):
        lines = []
        for title, case in cases.items():
            spacings = [f"{spacing:.4g}" for spacing in case.spacings]
            found = [
                {
                    quantity: figure
                    for quantity, *figure in figures.get(f"{title}, spacing {at}", [])
                }
                for at in spacings
            ]
            first = f"{case.title} (`{title}`)" if case.title else title
            for quantity in dict.fromkeys(quantity for at in found for quantity in at):
                errors, counts = zip(*(at.get(quantity, (None, None)) for at in found), strict=True)
                words = ["-" if one is None else error_in_words(one) for one in errors]
                columns = (shown(column, "") for column in (spacings, words, list(counts)))
                lines.append([first, quantity, *columns])
                first = ""
        head = ["case", "quantity", "spacing", "error (%)", "evaluations"]
        return markdown_table(head, lines)

    return Study(name, named, {name: table})


def error_in_words(value):
    """An error, with few digits where it is small."""
    return f"{value:+.2f}" if abs(value) >= 0.005 or not value else f"{value:+.0e}"
