"""The command that finds the parameters of laws from test data, and what ``fit`` prints of them as well."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from ..forces.identity import digest_of
from ..identification import figure, fitted_laws, load_test_data
from ..identification.regressor import N_TERMS
from ..identification.reporting import IdentificationSettings
from ..identification.reporting import identify as identify_laws
from ..results import figures
from ..results.files import write_json
from .command import AsJson, Overwrite, ReportFolder, check_folder, command
from .endings import writing
from .terminal import counting_bar, note, out, print_json, print_table, warn

DIGITS = 16
"""Number of digits of the digest by which a report knows its test data."""

LARGE_GROWTH = 1.05
"""Volume ratio of a law in the tests above which the user is warned: that of rubber grows by a per cent or so."""

DATA_HELP = "Test data: treloar, kawabata, or a CSV with mode, stretch and nominal_stress."

BulkModulus = Annotated[float | None, Option(help="Bulk modulus of the law, in the unit of the stresses: such tests do not tell it.")]
BulkRatio = Annotated[float | None, Option(help="Bulk modulus over shear modulus instead; 1000 by default.")]
Terms = Annotated[int | None, Option(help=f"Terms of Ogden's law; {N_TERMS} by default.", min=1, max=4)]


@command
def identify(
    data: Annotated[Path, Argument(metavar="DATA", help=DATA_HELP)],
    *,
    law: Annotated[list[str] | None, Option(help="Law; may be repeated; all laws by default.")] = None,
    terms: Terms = None,
    stretch: Annotated[float | None, Option("--up-to", help="Leave out rows beyond this stretch.")] = None,
    bulk_modulus: BulkModulus = None,
    bulk_ratio: BulkRatio = None,
    hold_out: Annotated[bool, Option("--hold-out", help="Hold out each mode in turn, and report how the others predict it.")] = False,
    folder: ReportFolder = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Find a law's parameters from test data."""
    laws, rows = law or fitted_laws(), load_test_data(data)
    if terms is not None and "ogden" not in laws:
        raise ValueError(f"--terms is of the law ogden, which --law {', '.join(laws)} leaves out")
    settings = IdentificationSettings(terms or N_TERMS, bulk_modulus, bulk_ratio)
    asked = {"laws": laws, "terms": settings.n_terms, "up_to": stretch, **settings.bulk}
    asked |= {"data": rows.name, "rows": len(rows), "digest": digest_of(asdict(rows))[:DIGITS]}
    check_folder(folder, "identify.json", asked, overwrite)
    if stretch is not None:
        rows = rows.up_to(stretch)
    with counting_bar("laws", "Fitting") as counted:
        models, reports, held_out = identify_laws(
            rows, laws, settings, hold_out, lambda done, text: counted(done, len(laws), f"now {text}")
        )
    for report in reports:
        print_identified(report)
    # Remarks on the data are in the report of every law, and are printed once.
    for text in dict.fromkeys(text for report in reports for text in (*report["refusals"], *report["remarks"])):
        warn(text)
    if as_json:
        print_json({"laws": reports, "held_out": held_out})
    if held_out:
        cells = []
        for row in held_out:
            scores = ", ".join(f"{mode} {value:.3f}" for mode, value in row["held_out"].items())
            cells.append((row["law"], ", ".join(row["fitted_to"]), scores, f"{row['relative_rms']:.3f}"))
        print_table("Modes held out", ("law", "fitted to", "R^2 of the mode held out", "relative RMS"), cells)
    if folder is not None:
        with writing(folder):
            write_json(folder / "identify.json", {"asked": asked, "laws": reports})
            figures.save(figure(models, rows), folder / "identify.png")
        note(f"Results in {folder}")


def print_identified(report: dict) -> None:
    """Print parameters with their standard errors, and R^2 and the greatest difference by mode."""
    form, cells = report.get("form", report["law"]["law"]), []
    for name, value in report["parameters"].items():
        error = report["standard_errors"][name]
        shown = "at its bound" if name in report["at_bound"] else "not told by the data" if error is None else f"{error:.2g}"
        cells.append((name, f"{value:.5g}", shown))
    print_table(f"{form} from {report['data']}, {report['rows']} rows", ("parameter", "value", "standard error"), cells, left=1)
    out.print(", ".join(f"R^2 {mode} {value:.4f}" for mode, value in report["r_squared"].items()))
    out.print(f"law against tests, greatest difference by mode: {differences_in_words(report['differences'])}")
    if report["at_bound"]:
        warn(f"{form}: {', '.join(report['at_bound'])} ended at the bound of the search: the data do not tell it, or want another law.")
    if report["volume_ratio"] and report["volume_ratio"] > LARGE_GROWTH:
        growth = f"the volume grows by {100 * (report['volume_ratio'] - 1):.0f} % in the tests, more than that of rubber"
        warn(f"{form}: with this bulk modulus {growth}: a greater one is given by --bulk-modulus.")


def differences_in_words(differences: dict) -> str:
    """Return the greatest difference from the tests by mode, in per cent of the greatest stress of the mode."""
    return ", ".join(
        f"{mode} no stress" if row["difference"] is None else f"{mode} {100 * row['difference']:+.2g} % at stretch {row['stretch']:g}"
        for mode, row in differences.items()
    )
