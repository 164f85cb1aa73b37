"""The command that measures force models against each other."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from ..reports import compare as report_of
from ..reports import presentation
from ..results import figures
from ..results.files import write_json, write_text
from .command import AsJson, Overwrite, ReportFolder, SetLaw, Threads, check_folder, command, law_of
from .endings import writing
from .terminal import counting_bar, err, note, print_json, print_table


@command
def compare(
    *,
    material: Annotated[str, Option(help="Material law.")] = "neo-hookean",
    change: SetLaw = None,
    quick: Annotated[bool, Option("--quick", help="A look in under a minute, not for quoting.")] = False,
    folder: ReportFolder = None,
    overwrite: Overwrite = False,
    threads: Threads = None,
    as_json: AsJson = False,
) -> None:
    """Measure every force model: speed against error, on one thread and on all."""
    law = law_of(material, change)
    asked = {"law": law.describe(), "quick": quick, "threads": threads}
    check_folder(folder, "compare.json", asked, overwrite)
    with counting_bar("models", report_of.FITTING) as counted:
        report = report_of.compare(law, quick, lambda stage, done, of, text: counted(done, of, f"now {text}", stage), threads)
    if as_json:
        print_json(report)
    header, rows = presentation.table(report)
    machine = report["machine"]
    print_table(f"{law.name}, {machine['processor']}, {machine['threads']} threads", header, rows, left=1)
    if caution := presentation.caution(report["models"]):
        err.print(caution, soft_wrap=True)
    if folder is not None:
        with writing(folder):
            write_text(folder / "compare.csv", presentation.as_csv(report))
            figures.save(presentation.pareto_figure(report), folder / "compare.png")
            write_json(folder / "compare.json", {"asked": asked, **report})
        note(f"Results in {folder}")
