"""The command that puts force models to hard cases."""

from __future__ import annotations

from typing import Annotated

from rich.markup import escape
from typer import Option

from ..forces.settings import WHERE
from ..results.files import write_json
from ..stress_test import report as report_of
from .command import AsJson, Overwrite, ReportFolder, Threads, check_folder, command
from .endings import writing
from .terminal import counting_bar, note, out, print_json, print_table


@command
def stress_test(
    *,
    force: Annotated[list[str] | None, Option(metavar="REF", help="Force model; may be repeated; all by default.")] = None,
    plane: Annotated[str | None, Option("--plane", metavar="stress|space", help="Sheets or bodies in space; both by default.")] = None,
    quick: Annotated[bool, Option("--quick", help="A fiftieth of the explicit steps.")] = False,
    folder: ReportFolder = None,
    overwrite: Overwrite = False,
    threads: Threads = None,
    as_json: AsJson = False,
) -> None:
    """Run hard cases with every force model: for each the limit, the value, and a pass or a named weakness."""
    asked = {"forces": force or "all", "plane": plane or "both", "quick": quick}
    check_folder(folder, "stress-test.json", asked, overwrite)
    known = report_of.BODIES
    if plane not in (None, *known):
        raise ValueError(f"--plane: must be {' or '.join(known)}, for {' or '.join(known.values())}, not {plane}")
    with counting_bar("cases", "Hard cases") as counted:
        planes = tuple(known) if plane is None else (plane,)
        report = report_of.stress_test(force, quick, lambda done, of, case: counted(done, of, f"now {case}"), planes, threads)
    if as_json:
        print_json(report)
    for tested in report_of.planes_of(report):
        header, rows = report_of.table(report, tested)
        cells = ([f"[yellow]{escape(cell)}[/]" if cell.startswith("WEAK") else escape(cell) for cell in row] for row in rows)
        print_table(f"Hard cases of {known[tested]}", header, cells, show_lines=True)
    for name, meaning in report["weaknesses"].items():
        out.print(f"[yellow]{name}[/]: {escape(meaning)}", soft_wrap=True)
    for model in report["models"]:
        counts = ", ".join(f"{number} {verdict}" for verdict, number in report_of.count(model).items() if number)
        out.print(f"{model['force']}{WHERE[model['plane']]}: {counts}", soft_wrap=True)
    if folder is not None:
        with writing(folder):
            write_json(folder / "stress-test.json", {"asked": asked, **report})
        note(f"Results in {folder}")
