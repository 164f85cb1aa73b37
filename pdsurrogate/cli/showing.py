"""The command that draws what a run has saved."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from .application import Rate, bad_input, err, note, out, print_json, progress_bar, show, writing
from .common import AsJson, command

MARK, MARK_WITHIN = b'content="pdsurrogate show"', 400
"""What a page of a result has among its first bytes."""


@command("show")
def show_result(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with the results of a run.")],
    field: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FIELD", help="What to colour by, as von_mises or stress_22; may be repeated; by default what suits the scene."
        ),
    ] = None,
    level: Annotated[int, typer.Option(help="Number of the output, from 0; -1 is the last one.")] = -1,
    pictures: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where pictures go.")] = Path(),
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="One page of HTML with all of it in the place of pictures.")] = None,
    as_json: AsJson = False,
) -> None:
    """Draw what a run has saved: a picture of a field, or one page with fields over all outputs, curves and tables."""
    from ..results import load_result
    from ..results.files import check_writable, write_text
    from ..results.folder import RUNNING

    with bad_input(ValueError, OSError):
        if html is not None and html.is_file() and MARK not in html.read_bytes()[:MARK_WITHIN]:
            raise ValueError(f"--html {html} is no page of a result and would be replaced; give another name")
        result = load_result(folder)
        check_writable(pictures if html is None else html.parent)
    if as_json:
        print_json({"fields": result.field_names() if result.states else [], "history": result.history})
    _print_history(result)
    if result.status != "done":
        err.print(
            f"[yellow]{escape(str(folder))}: {escape(str(result.summary['failure']))}; what it had come to is shown.[/]", soft_wrap=True
        )
    if html is not None:
        from ..results.page import html_page

        with bad_input(ValueError), progress_bar("drawing") as told, writing(html):
            rate = Rate("pictures")
            page = html_page(result, field or (), lambda done, of: told(done / of, f"{done} of {of} pictures{rate.after(done)}"))
            write_text(html, page)
        note(f"Wrote {html}")
        return
    if not result.states:
        why = "its summary lists none yet; --resume goes on with the run" if result.status == RUNNING else "the run came to no output"
        err.print(f"[yellow]pdsurrogate:[/] {escape(str(folder))} holds no state to draw: {why}", soft_wrap=True)
        return
    from ..results import figures

    name = result.summary["scene"]
    chosen = field or (["damage"] if "damage" in result.field_names() else ["displacement"])
    with bad_input(ValueError, IndexError):
        for one in chosen:
            path = pictures / f"{name}-{one}.png"
            with writing(pictures):
                figures.save(result.plot(one, level), path)
            note(f"Wrote {path}")


def _print_history(result) -> None:
    """The history at outputs in equilibrium, or its last rows: where it is, forces and energies."""
    from ..results.tables import column_title

    rows = [row for row in result.history if "time" not in row] or result.history[-10:]
    if not rows:
        return
    greatest = {column: max(abs(row.get(column, 0)) for row in rows) for column in dict.fromkeys(key for row in rows for key in row)}
    most = max((value for column, value in greatest.items() if column.startswith("force_")), default=0.0)
    # Of forces those that are more than rounding; moments and displacements are for the page and the file.
    columns = [
        column
        for column, value in greatest.items()
        if not column.startswith(("moment_", "displacement_")) and value > (1e-4 * most if column.startswith("force_") else 0)
    ]
    table = Table(title=repr(result)[1:-1], title_justify="left")
    for column in columns:
        table.add_column(column_title(column, result.scene.units).replace("_", " "), justify="right")
    for row in rows:
        table.add_row(*(f"{row[column]:.5g}" if column in row else "" for column in columns))
    show(table)
    out.print(f"fields: {', '.join(result.field_names())}" if result.states else "no states", soft_wrap=True)
