"""Command ``show``, which draws the saved results of a run and prints their history."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from ..results import Result, figures, load_result
from ..results.drawings import SHOWN_SHARE
from ..results.files import write_text
from ..results.folder import RUNNING
from ..results.page import MOST_OUTPUTS, html_page
from ..results.places import MEASURED, read_measured
from ..results.tables import column_unit, columns_of
from ..scenes.model import with_unit
from .command import PictureFolder, check_folder
from .exchange import check_new, write_grid, write_machine
from .terminal import (
    WARNING,
    Bar,
    bad_input,
    complain,
    note,
    out,
    print_json,
    print_rows,
    warn,
    writing,
)

FIELD_HELP = (
    "Field to draw, such as von_mises or stress_22; may be repeated (default: damage if there is"
    " any, else displacement)."
)

MARK = b'content="pdsurrogate show"'
"""Bytes near the beginning of every HTML file that ``show --html`` writes; it replaces an
existing file only if it has them.
"""


def show(
    folder: Annotated[
        Path, Argument(metavar="DIR", help="Folder with results of a run (its --out DIR).")
    ],
    *,
    field: Annotated[list[str] | None, Option(metavar="FIELD", help=FIELD_HELP)] = None,
    level: Annotated[
        int | None,
        Option(
            help="Number of the output, from 0, or from the end: -1 is the last one (default: -1)."
        ),
    ] = None,
    pictures: PictureFolder = None,
    html: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Write one HTML page instead: fields to explore in a browser, curves, tables.",
        ),
    ] = None,
    outputs: Annotated[
        int,
        Option(
            metavar="N",
            min=1,
            help="Greatest number of outputs on the page; with fewer of them more fields fit.",
        ),
    ] = MOST_OUTPUTS,
    grid: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Write displacements (and --field) on the pixels of an image: .npz or .csv.",
        ),
    ] = None,
    pixels_per: Annotated[
        tuple[str, float] | None,
        Option(metavar="UNIT N", help="Pixels of the image in a unit of length, as cm 152."),
    ] = None,
    origin: Annotated[
        tuple[float, float] | None,
        Option(metavar="X Y", help="Pixel, column and row, of the origin of the scene."),
    ] = None,
    machine: Annotated[
        Path | None,
        Option(
            metavar="FILE.csv",
            help="Write extension and load of the pulled region as a testing machine does.",
        ),
    ] = None,
    thickness: Annotated[
        str | None, Option(metavar="LENGTH", help="Thickness of a sheet for --machine, as 2mm.")
    ] = None,
) -> None:
    """Print the history of saved results, and write pictures of fields or an HTML page."""
    with bad_input(OSError):
        if (grid is None) != (pixels_per is None) or (grid is None) != (origin is None):
            raise ValueError("--grid FILE, --pixels-per UNIT N and --origin X Y go together")
        if thickness is not None and machine is None:
            raise ValueError("--thickness is for --machine FILE.csv")
        files = grid is not None or machine is not None
        for option, given, needed, used in (
            ("--level", level is not None, "pictures", not files),
            ("--out", pictures is not None, "pictures", not files),
            ("--outputs", outputs != MOST_OUTPUTS, "--html", html is not None),
            ("--field", bool(field), "pictures, --html or --grid", machine is None or html or grid),
        ):
            if given and not used:
                raise ValueError(f"{option} is for {needed}: leave it out")
        if files and grid == machine:
            raise ValueError(f"--grid and --machine are both {grid}: name two files")
        check_new("--grid", grid, ".npz", ".csv")
        check_new("--machine", machine, ".csv")
        if html is not None and (pictures is not None or level is not None):
            raise ValueError("--html writes all outputs to one file: leave out --out and --level")
        if html is not None and html.is_file() and MARK not in html.read_bytes():
            raise ValueError(
                f"--html {html}: this file was not written by pdsurrogate show and would be"
                " overwritten; choose another name"
            )
        result = load_result(folder)
        measured = read_measured(folder / MEASURED, result.scene.dimension) if html else None
    if measured is not None and not {*measured[:, 0]} <= {*range(1, len(result.states) + 1)}:
        warn(
            f"{folder / MEASURED}: the run has the outputs 1 to {len(result.states)}; measured"
            " displacements of other steps are not shown"
        )
    pictures = pictures or Path()
    level = -1 if level is None else level
    check_folder(pictures if html is None else html.parent)
    print_json({"fields": result.field_names() if result.states else [], "history": result.history})
    _print_history(result)
    if result.status != "done":
        warn(
            f"{folder}: the run did not finish ({result.summary['failure']}); its outputs so far"
            " are shown."
        )
    for path in filter(None, (grid, machine)):
        with writing(path.parent):
            if path == grid:
                write_grid(path, result, pixels_per, origin, field or [])
            else:
                write_machine(path, result, thickness)
        note(f"Wrote {path}")
    if html is not None:
        with Bar(result.scene.name), writing(html):
            write_text(html, html_page(result, field or (), outputs, measured))
        note(f"Wrote {html}")
    elif grid or machine:
        return
    elif not result.states:
        why = (
            "the run has not finished; resume it with --resume"
            if result.status == RUNNING
            else "the run stopped before its first output"
        )
        complain(f"{folder}: there is no output to draw: {why}", WARNING)
    else:
        for name in field or (["damage"] if "damage" in result.field_names() else ["displacement"]):
            path = pictures / f"{result.summary['scene']}-{name}.png"
            with bad_input(IndexError), writing(pictures):
                figures.save(result.plot(name, level), path)
            note(f"Wrote {path}")


def _print_history(result: Result) -> None:
    """Print the rows of the history in equilibrium and the last ten in dynamics, and the names of
    the fields.

    Columns of moments and displacements are left out, as are columns of zeros, and columns of
    forces that nowhere exceed `SHOWN_SHARE` times the greatest force.
    """
    rows = [row for row in result.history if "kinetic_energy" not in row]
    rows += [row for row in result.history if "kinetic_energy" in row][-10:]
    greatest = {
        column: max(abs(row.get(column, 0)) for row in rows)
        for column in columns_of(rows)
        if not (column.startswith("moment_") or "displacement_" in column)
    }
    least = SHOWN_SHARE * max(
        (size for column, size in greatest.items() if column.startswith("force_")), default=0.0
    )
    titles = {
        column: with_unit(column.replace("_", " "), column_unit(column, result.scene.units))
        for column, size in greatest.items()
        if size > least * column.startswith("force_")
    }
    print_rows(
        repr(result)[1:-1],
        [{title: row.get(column) for column, title in titles.items()} for row in rows],
    )
    out.print(
        f"Fields: {', '.join(result.field_names())}" if result.states else "No fields were saved."
    )
