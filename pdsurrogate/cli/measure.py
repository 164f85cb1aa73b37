"""Command ``compare``, which measures speed and error of force models."""

from typing import Annotated

from typer import Option

from ..artifacts import load_card
from ..artifacts.store import law_of as stored_law
from ..forces import FORCES
from ..reports import compare as comparison
from ..results import figures, tables
from ..results.files import write_json, write_text
from .command import Forces, OneLaw, Overwrite, ReportFolder, SetLaw, Threads, check_folder, law_of
from .terminal import Bar, note, out, print_json, print_table, warn, writing


def compare(
    force: Forces = None,
    law: OneLaw = None,
    change: SetLaw = None,
    quick: Annotated[bool, Option("--quick", help="Fewer models and shorter timings: half a minute, not for publication.")] = False,
    folder: ReportFolder = None,
    overwrite: Overwrite = False,
    threads: Threads = None,
) -> None:
    """Print tables of cost and error of force models, and write them and a figure to a folder, if given."""
    own = next((name for name in force or () if name not in FORCES), None)
    material = law_of(law or "neo-hookean", change) if law or change or own is None else stored_law(load_card(own))
    asked = {"law": material.describe(), "quick": quick, "threads": threads, **({"forces": force} if force else {})}
    check_folder(folder, "compare.json", asked, overwrite)
    with Bar(material.name):
        report = comparison.compare(material, quick, threads, force)
    print_json(report)
    out.print("{}, {processor}, {threads} threads".format(material.name, **report["machine"]))
    for title in comparison.TABLES:
        print_table(title, *comparison.table(report, title), left=1)
    if caution := comparison.caution(report["models"]):
        warn(caution)
    if folder is not None:
        with writing(folder):
            write_text(folder / "compare.csv", tables.as_csv(report["models"]))
            figures.save(comparison.pareto_figure(report), folder / "compare.png")
            write_json(folder / "compare.json", {"asked": asked, **report})
        note(f"Results in {folder}")
