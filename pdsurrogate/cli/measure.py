"""Commands ``compare``, which measures speed and error of force models, and ``stress-test``, which runs hard cases with them."""

from typing import Annotated, Literal

from rich.markup import escape
from typer import Option

from ..forces.settings import WHERE
from ..reports import compare as comparison
from ..results import figures, tables
from ..results.files import write_json, write_text
from ..stress_test import report as hard_cases
from .command import Overwrite, ReportFolder, SetLaw, Threads, check_folder, law_of
from .terminal import Bar, err, note, out, print_json, print_table, writing


def compare(
    material: Annotated[str, Option(help="Material law.")] = "neo-hookean",
    change: SetLaw = None,
    quick: Annotated[bool, Option("--quick", help="A look in under a minute, not for quoting.")] = False,
    folder: ReportFolder = None,
    overwrite: Overwrite = False,
    threads: Threads = None,
) -> None:
    """Measure every force model: speed against error, on one thread and on all."""
    law = law_of(material, change)
    asked = {"law": law.describe(), "quick": quick, "threads": threads}
    check_folder(folder, "compare.json", asked, overwrite)
    with Bar(comparison.FITTING) as bar:
        report = comparison.compare(law, quick, lambda stage, done, of, text: bar.count("models", done, of, f"now {text}", stage), threads)
    print_json(report)
    header, rows = comparison.table(report)
    machine = report["machine"]
    print_table(f"{law.name}, {machine['processor']}, {machine['threads']} threads", header, rows, left=1)
    if caution := comparison.caution(report["models"]):
        err.print(caution, soft_wrap=True)
    if folder is not None:
        with writing(folder):
            write_text(folder / "compare.csv", tables.as_csv(report["models"]))
            figures.save(comparison.pareto_figure(report), folder / "compare.png")
            write_json(folder / "compare.json", {"asked": asked, **report})
        note(f"Results in {folder}")


def stress_test(
    force: Annotated[list[str] | None, Option(metavar="REF", help="Force model; may be repeated; all by default.")] = None,
    plane: Annotated[Literal["stress", "space"] | None, Option(help="Sheets or solids; both by default.")] = None,
    quick: Annotated[bool, Option("--quick", help="A fiftieth of the explicit steps.")] = False,
    folder: ReportFolder = None,
    overwrite: Overwrite = False,
    threads: Threads = None,
) -> None:
    """Run hard cases with every force model: for each the limit, the value, and a pass or a named weakness."""
    asked = {"forces": force or "all", "plane": plane or "both", "quick": quick}
    check_folder(folder, "stress-test.json", asked, overwrite)
    known = hard_cases.BODIES
    planes = tuple(known) if plane is None else (plane,)
    with Bar("Hard cases") as bar:
        report = hard_cases.stress_test(force, quick, lambda done, of, case: bar.count("cases", done, of, f"now {case}"), planes, threads)
    print_json(report)
    for tested in hard_cases.planes_of(report):
        header, rows = hard_cases.table(report, tested)
        cells = ([f"[yellow]{escape(cell)}[/]" if cell.startswith("WEAK") else escape(cell) for cell in row] for row in rows)
        print_table(f"Hard cases of {known[tested]}", header, cells, show_lines=True)
    for name, meaning in report["weaknesses"].items():
        out.print(f"[yellow]{name}[/]: {escape(meaning)}")
    for model in report["models"]:
        counts = ", ".join(f"{number} {verdict}" for verdict, number in hard_cases.count(model).items() if number)
        out.print(f"{model['force']}{WHERE[model['plane']]}: {counts}")
    if folder is not None:
        with writing(folder):
            write_json(folder / "stress-test.json", {"asked": asked, **report})
        note(f"Results in {folder}")
