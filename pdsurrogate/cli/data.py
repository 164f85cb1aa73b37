"""Command ``data``, which says and draws what files of machines, cameras and mesh programs are, and
completes tests to a table of test data.
"""

import hashlib
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from typer import Argument, Option

from ..decks import files_of
from ..discretization.mesh_facts import describe_mesh
from ..identification.campaign import Source, TestFacts, Up, option_of, read_sources, sources
from ..identification.data import test_data_of
from ..identification.written import table_of
from ..measurements import files_at, is_field, read_fields
from ..measurements.plausible import SOURCES
from ..measurements.quantities import UNITS
from ..measurements.specimens import MechanicalTests
from ..measurements.table import Column
from ..results import figures, measured
from ..results.files import write_text
from ..scenes.model import with_unit
from .command import check_folder, with_fields
from .identify import AT_BREAK, break_rows
from .terminal import note, print_json, print_rows, warn, writing

FILES_HELP = (
    "Tables of machines (FILE:MODE states the mode of one), fields of cameras, meshes, or a"
    " campaign (tests.toml)."
)

MESHES = {".msh", ".vtk", ".vtu", ".inp", ".med", ".xdmf", ".stl", ".obj", ".ply", ".mesh", ".bdf"}
"""Suffixes of mesh files, as far as those of tables are others."""

SIGNS = {",": "comma", ";": "semicolon", "\t": "tab", " ": "blanks", ".": "point", "|": "bar"}
"""Names of separators and decimal signs."""

SHOWN = ("specimen", "mode", "taken", "branches", "stretch", "nominal_stress")
"""Columns of the table of specimens."""

MARK = "# Test data, written by pdsurrogate data\n"
"""First line of a written table; only such a file is replaced."""


class Seen(NamedTuple):
    """Description of files: their name, plain values for JSON with remarks and what is missing,
    tables by title, and a function that draws them.
    """

    name: str
    values: dict[str, Any]
    tables: dict[str, Sequence[dict]]
    draw: Callable[[], Figure]


@with_fields(facts=TestFacts)
def data(
    files: Annotated[list[str], Argument(metavar="FILE...", help=FILES_HELP)],
    *,
    plot: Annotated[
        Path | None,
        Option(metavar="PLACE", help="Draw into this file (.png), or into files of this folder."),
    ] = None,
    facts: TestFacts,
    up: Up = None,
    table: Annotated[
        Path | None,
        Option("--out", metavar="FILE.csv", help="Write the completed tests as test data."),
    ] = None,
) -> None:
    """Print what files are, draw them, and write tests as a table of test data."""
    fields: dict[str, list[str]] = {}
    meshes, tests = [], []
    for file in (str(one) for given in files for one in files_at(given)):
        form = is_field(file)
        those = fields.setdefault(form, []) if form else meshes if _is_mesh(Path(file)) else tests
        those.append(file)
    stated = facts.stated(bool(fields))
    if not tests and (stated or table):
        option = "--out" if table else option_of(next(iter(stated)))
        raise ValueError(f"{option} is for tables of tests, and there is none among the files")
    seen = [_seen_mesh(file) for file in meshes]
    seen += [_seen_field(form, those, facts.field_unit, up) for form, those in fields.items()]
    found = sources(tests, stated)
    if tests:
        read = read_sources(found)
        seen.append(_seen_tests(read))
    _check_places(plot, table, len(seen))
    for one in seen:
        for title, rows in one.tables.items():
            print_rows(title, [{k: _in_words(v) for k, v in row.items()} for row in rows])
        for text in one.values["remarks"]:
            note(text)
        for text in one.values.get("missing", ()):
            warn(f"missing: {text}")
    print_json([one.values for one in seen])
    for one in seen if plot else ():
        place = plot if plot.suffix else plot / f"{one.name}.png"
        with writing(place):
            figures.save(one.draw(), place)
        note(f"Wrote {place}")
    if table:
        if read.missing:
            raise ValueError("; ".join(read.missing))
        if read.tears:
            raise ValueError(f"--out {table}: tear tests are no rows of test data: leave them out")
        with writing(table):
            write_text(table, MARK + _heading(found, read) + table_of(test_data_of(read)))
        note(f"Wrote {table}")


def _is_mesh(path: Path) -> bool:
    """Return whether a file is a mesh; a deck is one if it has elements."""
    suffix = path.suffix.lower()
    if suffix != ".inp" or not path.is_file():
        return suffix in MESHES
    return any(re.search(rb"(?im)^\s*\*element\b", each.read_bytes()) for each in files_of(path))


def _check_places(plot: Path | None, table: Path | None, pictures: int) -> None:
    """Check that files can be written: a picture for all needs a folder, and a table replaces
    only another one.
    """
    if plot is not None and plot.suffix not in ("", ".png"):
        raise ValueError(f"--plot {plot}: pictures are PNG files: name a file .png, or a folder")
    if plot is not None and plot.suffix and pictures > 1:
        raise ValueError(f"--plot {plot}: there are {pictures} pictures: name a folder for them")
    if table is not None and table.exists() and not table.read_bytes().startswith(MARK.encode()):
        raise ValueError(f"--out {table}: this file is no table of this command: use another name")
    for place in (plot and (plot.parent if plot.suffix else plot), table and table.parent):
        check_folder(place)


def _seen_mesh(file: str) -> Seen:
    """Return what is known of a mesh."""
    found = describe_mesh(file)
    summary, groups, mesh = found.summary(), found.groups(), found.mesh
    box = zip(summary.pop("lower"), summary.pop("upper"), strict=True)
    summary |= {f"x{axis}": list(ends) for axis, ends in enumerate(box, start=1)}
    values = {"file": file, "kind": "mesh", "form": found.form, "elements": found.elements}
    elements = [{"element": name, "count": count} for name, count in found.elements.items()]
    facts = [{"body": key, "value": value} for key, value in summary.items()]
    return Seen(
        Path(file).stem,
        {**values, **summary, "groups": groups, "remarks": found.remarks},
        {f"{file}: {found.form}": elements, "Body": facts, "Groups": groups},
        lambda: measured.mesh_figure(mesh.cells, mesh.cell_groups, mesh.side_groups, file),
    )


def _seen_field(form: str, files: Sequence[str], unit: str | None, up: bool | None) -> Seen:
    """Return what is known of a field in one file or in several."""
    field = read_fields(*files, unit=unit, up=up)
    known = field.deviation[np.isfinite(field.deviation)]
    size = np.linalg.norm(field.displacements, axis=1)
    rows = [
        {
            "image": int(step),
            "points": int(count),
            "greatest": float(size[field.step == step].max()),
        }
        for step, count in zip(*np.unique(field.step, return_counts=True), strict=True)
    ]
    values = {
        "unit": field.unit or "that of the scene",
        **{f"x{n}": _span(places) for n, places in enumerate(field.places.T, start=1)},
        "lost": field.lost,
        "subset": field.subset,
        "deviation": float(np.median(known)) if len(known) else None,
    }
    name = ", ".join(files)
    return Seen(
        Path(files[0]).stem,
        {
            "file": name,
            "kind": "field",
            "form": form,
            **values,
            "images": rows,
            "remarks": field.notes,
        },
        {
            f"{name}: {form}": [{"field": key, "value": one} for key, one in values.items()],
            f"Displacements ({values['unit']})": rows,
        },
        lambda: measured.field_figure(field),
    )


def _seen_tests(read: MechanicalTests) -> Seen:
    """Return what is known of tables of machines, and of the tests in them."""
    titles, forms = {}, []
    for file in read.tables:
        rows = [
            {
                "table": block.title or f"{number}",
                "rows": len(block.lines),
                "lines": _span(block.lines),
                "states": ({"mode": block.mode} if block.mode else {}) | block.facts,
            }
            for number, block in enumerate(file.blocks, start=1)
        ]
        words = [file.form]
        if file.encoding:
            words += [f"{file.encoding}, separated by {SIGNS.get(file.separator, 'blanks')}"]
            words += [f"decimal {SIGNS[file.decimal_sign]}"]
        titles[f"{file.path.name}: {', '.join(words)}"] = rows
        form = {key: vars(file)[key] for key in ("form", "encoding", "separator", "decimal_sign")}
        forms.append({"file": str(file.path), **form, "tables": rows})
    tests = [
        {
            "specimen": one.name,
            "mode": one.mode,
            "rows": len(one.row),
            "taken": int(one.chosen.sum()),
            "branches": dict(Counter(one.branch.tolist())),
            "cycles": int(one.cycle.max()),
            "stretch": _span(one.stretch),
            "nominal_stress": _span(one.nominal_stress),
        }
        for one in read.specimens
    ]
    columns = [
        {"table": f"{file.path.name} {block.title}".strip(), **_seen_column(one)}
        for file in read.tables
        for block in file.blocks
        for one in block.columns
        if one.values.dtype.kind == "f" and np.isfinite(one.values).any()
    ]
    broken = break_rows(read.at_break)
    torn = [asdict(one) for one in read.tears]
    return Seen(
        read.tables[0].path.stem,
        {
            "file": read.name,
            "kind": "tests",
            "files": forms,
            "columns": columns,
            "unit": read.unit,
            "specimens": tests,
            "at_break": broken,
            "tears": torn,
            "remarks": read.assumed,
            "missing": read.missing,
        },
        {
            **titles,
            "Columns": columns,
            with_unit("Tests: stretch and nominal stress", read.unit): [
                {key: row[key] for key in SHOWN} for row in tests
            ],
            with_unit(AT_BREAK, read.unit): broken,
            with_unit("Tears: nominal stress", read.unit): torn,
        },
        lambda: _drawn_tests(read),
    )


def _seen_column(column: Column) -> dict:
    """Return what is known of a column of numbers: in mm, N, s and MPa where it has a unit."""
    quantity = column.quantities[0] if column.quantities else ""
    known = bool(quantity and column.unit) and quantity != "temperature"
    return {
        "column": column.heading,
        "quantity": " or ".join(column.quantities) or "not understood",
        "range": _span(column.in_unit_of(quantity) if known else column.values),
        "unit": UNITS.get(quantity, "1") if known else column.unit or "",
    }


def _span(values: np.ndarray) -> list[float]:
    """Return the least and the greatest number."""
    return [np.nanmin(values).item(), np.nanmax(values).item()]


def _in_words(value: Any) -> Any:
    """Return an entry of a table as text: a range, or numbers by name."""
    if isinstance(value, list):
        return " to ".join(f"{one:.4g}" for one in value)
    return ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else value


def _drawn_tests(read: MechanicalTests) -> Figure:
    """Return a figure of the branches of tests, or of columns that are no tests yet."""
    if read.specimens:
        curves = []
        for one in read.specimens:
            curve = np.array([one.stretch, one.nominal_stress])
            names = dict.fromkeys(one.branch.tolist())
            curves.append((one.name, {name: tuple(curve[:, one.branch == name]) for name in names}))
        return measured.tests_figure(curves, "stretch", with_unit("nominal stress", read.unit))
    # What looks like strain and stress, else the first and the last column.
    file = read.tables[0]
    numbers = [one for one in file.blocks[0].columns if one.values.dtype.kind == "f"]
    chosen = [
        next((one for one in numbers if {*one.quantities} & {*SOURCES[group]}), numbers[place])
        for group, place in (("strain", 0), ("stress", -1))
    ]
    labels = [with_unit(one.heading, one.unit) for one in chosen]
    drawn = {"not complete": tuple(one.values for one in chosen)}
    return measured.tests_figure([(file.path.name, drawn)], *labels)


def _heading(found: list[Source], read: MechanicalTests) -> str:
    """Return the comment lines of a written table: files with digests, facts, and assumptions."""
    lines = [
        f"from {path.name}, sha256 {hashlib.sha256(path.read_bytes()).hexdigest()};"
        f" stated: {_in_words(stated) or 'nothing'}"
        for path, stated in found
    ]
    return "".join(f"# {' '.join(line.split())}\n" for line in [*lines, *read.assumed])
