"""The command that puts force models to hard cases."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from .application import Rate, bad_input, note, out, print_json, progress_bar, show, writing
from .common import AsJson, Overwrite, command


@command("stress-test")
def stress_test(
    force: Annotated[
        list[str] | None, typer.Option(metavar="REF", help="Force model (NAME, NAME@VERSION, path); may be repeated; all by default.")
    ] = None,
    plane: Annotated[
        str | None, typer.Option("--plane", metavar="stress|space", help="Sheets or bodies in space alone; both by default.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A fiftieth of the explicit steps.")] = False,
    folder: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Write stress-test.json here.")] = None,
    overwrite: Overwrite = False,
    threads: Annotated[int | None, typer.Option(help="Most threads of the kernels; by default all.")] = None,
    as_json: AsJson = False,
) -> None:
    """Run hard cases with every force model, and report for each the limit, the value, and a pass or a named weakness."""
    from ..artifacts import ArtifactError
    from ..forces.settings import WHERE
    from ..results.files import check_writable, write_json
    from ..results.folder import check_report
    from ..stress_test import report as report_module

    asked = {"forces": force or "all", "plane": plane or "both", "quick": quick}
    if folder is not None:
        with bad_input(OSError, ValueError):
            check_writable(folder)
            check_report(folder / "stress-test.json", asked, overwrite)
    known = report_module.BODIES
    with bad_input(ArtifactError, ValueError), progress_bar("Hard cases") as told:
        if plane not in (None, *known):
            raise ValueError(f"--plane: must be {' or '.join(known)}, for {' or '.join(known.values())}, not {plane}")
        planes = tuple(known) if plane is None else (plane,)
        rate = Rate("cases")

        def say(done: int, of: int, what: str) -> None:
            told(done / of, f"{done} of {of} cases{rate.after(done)}, now {what}" if done else what)

        report = report_module.stress_test(force, quick, say, planes, threads)
    if as_json:
        print_json(report)
    for tested in report_module.planes_of(report):
        header, rows = report_module.table(report, tested)
        printed = Table(title=f"Hard cases of {known[tested]}", title_justify="left", show_lines=True)
        for title in header:
            printed.add_column(title)
        for row in rows:
            printed.add_row(*(f"[yellow]{escape(cell)}[/]" if cell.startswith("WEAK") else escape(cell) for cell in row))
        show(printed)
    for name, what in report["weaknesses"].items():
        out.print(f"[yellow]{name}[/]: {escape(what)}", soft_wrap=True)
    for model in report["models"]:
        counts = report_module.count(model)
        name = f"{model['force']}{WHERE[model['plane']]}"
        out.print(f"{name}: {', '.join(f'{number} {verdict}' for verdict, number in counts.items() if number)}", soft_wrap=True)
    if folder is not None:
        with writing(folder):
            write_json(folder / "stress-test.json", {"asked": asked, **report})
        note(f"Results in {folder}")
