"""The command that measures force models against each other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from .application import Rate, bad_input, err, law_of, note, print_json, progress_bar, show, writing
from .common import AsJson, Overwrite, command


@command()
def compare(
    material: Annotated[str, typer.Option(help="Material law.")] = "neo-hookean",
    change: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="A parameter of the law; may be repeated.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A look in under a minute, not for quoting.")] = False,
    folder: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Write CSV, JSON and the Pareto figure here.")] = None,
    overwrite: Overwrite = False,
    threads: Annotated[int | None, typer.Option(help="Most threads that are measured; by default all.")] = None,
    as_json: AsJson = False,
) -> None:
    """Measure every force model: speed against error, on one thread and on all."""
    from ..reports import compare as report_module
    from ..reports import presentation
    from ..results import figures
    from ..results.files import check_writable, write_json, write_text
    from ..results.folder import check_report

    with bad_input(ValueError):
        law = law_of(material, change)
    asked = {"law": law.describe(), "quick": quick, "threads": threads}
    if folder is not None:
        with bad_input(OSError, ValueError):
            check_writable(folder)
            check_report(folder / "compare.json", asked, overwrite)
    rates = {stage: Rate("models") for stage in (report_module.FITTING, report_module.ERRORS, report_module.SCENE)}
    with bad_input(ValueError), progress_bar(report_module.FITTING) as told:

        def say(stage: str, done: float, of: int, text: str) -> None:
            counted = ""
            if stage in rates:
                if not done:
                    rates[stage].begin()
                counted = f"{int(done)} of {of} models{rates[stage].after(done)}, now "
            told(done / of, f"{counted}{text}", stage)

        report = report_module.compare(law, quick, say, threads)
    if as_json:
        print_json(report)
    header, rows = presentation.table(report)
    machine = report["machine"]
    table = Table(title=f"{law.name}, {machine['processor']}, {machine['threads']} threads", title_justify="left")
    for number, title in enumerate(header):
        table.add_column(title, justify="right" if number else "left")
    for row in rows:
        table.add_row(*row)
    show(table)
    if caution := presentation.caution(report["models"]):
        err.print(caution, soft_wrap=True)
    if folder is not None:
        with writing(folder):
            write_text(folder / "compare.csv", presentation.as_csv(report))
            figures.save(presentation.pareto_figure(report), folder / "compare.png")
            write_json(folder / "compare.json", {"asked": asked, **report})
        note(f"Results in {folder}")
