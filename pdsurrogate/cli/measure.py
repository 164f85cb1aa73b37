"""Commands ``compare``, which measures speed and error of force models, and ``stress-test``, which runs hard cases with them."""

from typing import Annotated, Literal

from rich.markup import escape
from typer import Option

from ..artifacts import load_card
from ..artifacts.store import law_of as stored_law
from ..forces import FORCES
from ..forces.settings import WHERE
from ..reports import compare as comparison
from ..results import figures, tables
from ..results.files import write_json, write_text
from ..stress_test import report as hard_cases
from .command import REF_HELP, Forces, OneLaw, Overwrite, ReportFolder, SetLaw, Threads, check_folder, law_of
from .completion import forces
from .terminal import Bar, note, out, print_json, print_table, warn, writing

SOME = f"{REF_HELP}; may be repeated (default: the exact ones and two surrogates)."
SomeForces = Annotated[list[str] | None, Option(metavar="REF", autocompletion=forces, help=SOME)]


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


def stress_test(
    force: SomeForces = None,
    plane: Annotated[Literal["stress", "space"] | None, Option(help="Sheets in plane stress, or solids (default: both).")] = None,
    full: Annotated[bool, Option("--full", help="Test all force models, in all time steps of the dynamic cases.")] = False,
    folder: ReportFolder = None,
    overwrite: Overwrite = False,
    threads: Threads = None,
) -> None:
    """Print tables of the results of the hard cases, and write them to a folder, if given."""
    asked = {"forces": force or ("all" if full else list(hard_cases.BRIEF)), "plane": plane or "both", "full": full}
    check_folder(folder, "stress-test.json", asked, overwrite)
    known = hard_cases.BODIES
    planes = tuple(known) if plane is None else (plane,)
    with Bar():
        report = hard_cases.stress_test(force, full, planes, threads)
    print_json(report)
    for tested in hard_cases.planes_of(report):
        header, rows = hard_cases.table(report, tested)
        cells = ([f"[yellow]{escape(cell)}[/]" if cell.startswith("WEAK") else escape(cell) for cell in row] for row in rows)
        print_table(f"Hard cases of {known[tested]}", header, cells, leading=1)
    for name, meaning in report["weaknesses"].items():
        out.print(f"[yellow]{name}[/]: {escape(meaning)}")
    for model in report["models"]:
        counts = ", ".join(f"{number} {verdict}" for verdict, number in hard_cases.count(model).items() if number)
        out.print(f"{model['force']}{WHERE[model['plane']]}: {counts}")
    if folder is not None:
        with writing(folder):
            write_json(folder / "stress-test.json", {"asked": asked, **report})
        note(f"Results in {folder}")
    if not full:
        left = "" if force else f"{', '.join(hard_cases.BRIEF)} were tested, "
        note(f"{left}dynamic cases for a fiftieth of their time steps; --full runs {'all steps' if force else 'all models and steps'}")
