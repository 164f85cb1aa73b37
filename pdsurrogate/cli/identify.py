"""Command ``identify``, which finds parameters of laws from test data."""

from collections.abc import Sequence
from typing import Annotated, Any

from typer import Argument, Option

from ..identification import TestData, figure, fitted_laws, load_test_data, reporting
from ..identification.campaign import TestFacts
from ..identification.history_regressor import MOST_STATED
from ..identification.history_report import figure_of_history, report_of_history
from ..identification.regressor import N_TERMS
from ..identification.stress_regressor import bulk_arguments
from ..results import figures
from ..results.files import write_json
from ..scenes.model import with_unit
from .command import Overwrite, ReportFolder, check_folder, with_fields
from .terminal import (
    Bar,
    note,
    out,
    print_json,
    print_rows,
    print_table,
    warn,
    writing,
)

DATA_HELP = (
    "Test data: treloar, kawabata, files of testing machines (FILE:MODE states the mode of one), or"
    " a campaign (tests.toml); may be repeated."
)

AT_BREAK = "At break: stress and work per volume"
"""Title of a table of states at break."""

BulkModulus = Annotated[
    float | None,
    Option(help="Bulk modulus in the unit of the stresses; the tests do not determine it."),
]
BulkRatio = Annotated[
    float | None,
    Option(
        help="Ratio of bulk modulus to shear modulus, instead of --bulk-modulus (default: 1000)."
    ),
]
Terms = Annotated[
    int | None, Option(help=f"Number of terms of Ogden's law (default: {N_TERMS}).", min=1, max=4)
]
Branches = Annotated[
    str | None,
    Option(
        metavar="auto|N",
        help="Fit viscoelastic branches to tests with times as well: so many, or as many as"
        " describe curves that are left out.",
    ),
]
Softens = Annotated[
    bool,
    Option(
        "--softening",
        help="Fit softening (Mullins) to loading and unloading of new specimens as well.",
    ),
]


FallingTimes = Annotated[
    bool,
    Option(
        "--falling-times",
        help="Let the relaxation times of --branches fall with the overstress.",
    ),
]


def memory_of(branches: str | None, softening: bool, falling_times: bool) -> dict[str, Any]:
    """Return the arguments of a `HistoryRegressor` that options state, none without such options.

    The number of branches is None for a choice of the number.
    """
    if branches is None and not (softening or falling_times):
        return {}
    number = branches or "0"
    if number != "auto" and not (number.isdigit() and int(number) <= MOST_STATED):
        raise ValueError(
            f"--branches must be auto, or a number from 0 to {MOST_STATED}, not {branches!r}"
        )
    return {
        "branches": None if number == "auto" else int(number),
        "softening": softening,
        "falling_times": falling_times,
    }


@with_fields(facts=TestFacts)
def identify(
    data: Annotated[list[str], Argument(metavar="DATA...", help=DATA_HELP)],
    *,
    law: Annotated[
        list[str] | None, Option(metavar="LAW", help="Law; may be repeated (default: all).")
    ] = None,
    terms: Terms = None,
    stretch: Annotated[
        float | None, Option("--up-to", help="Leave out rows with a greater stretch.")
    ] = None,
    facts: TestFacts,
    bulk_modulus: BulkModulus = None,
    bulk_ratio: BulkRatio = None,
    branches: Branches = None,
    softening: Softens = False,
    falling_times: FallingTimes = False,
    hold_out: Annotated[
        bool,
        Option(
            "--hold-out",
            help="Also leave out each mode in turn, and report how the fit predicts it.",
        ),
    ] = False,
    folder: ReportFolder = None,
    overwrite: Overwrite = False,
) -> None:
    """Print a report of each law that is fitted to the tests, and write it to a folder, if
    given.
    """
    names = law or fitted_laws()
    memory = memory_of(branches, softening, falling_times)
    rows = load_test_data(*data, history=bool(memory), **facts.stated())
    if terms is not None and "ogden" not in names:
        raise ValueError(f"--terms needs --law ogden; the laws are {', '.join(names)}")
    bulk = bulk_arguments(bulk_modulus=bulk_modulus, bulk_ratio=bulk_ratio)
    check_folder(folder, "identify.json", overwrite)
    if memory:
        if stretch is not None or hold_out:
            raise ValueError("--up-to and --hold-out do not go with --branches and --softening")
        if terms is not None and law is None:
            raise ValueError("--terms needs --law ogden; without --law an energy is identified")
    if stretch is not None:
        rows = rows.up_to(stretch)
    n_terms = terms or N_TERMS
    with Bar(rows.name):
        if memory:
            models = [
                reporting.fitted(rows, name, n_terms, bulk, **memory) for name in law or [None]
            ]
            reports, held_out = [report_of_history(model, rows) for model in models], []
        else:
            models, reports, held_out = reporting.identify(rows, names, n_terms, bulk, hold_out)
    for report in reports:
        print_identified(report)
    print_break(rows)
    # Remarks on the data are in the report of every law, and are printed once.
    for text in dict.fromkeys(
        text for report in reports for text in (*report["refusals"], *report["remarks"])
    ):
        warn(text)
    print_json({"laws": reports, "held_out": held_out})
    predicted = [
        {
            "law": row["law"],
            "held out": mode,
            "R^2": score,
            "relative RMS error": row["relative_rms"],
        }
        for row in held_out
        for mode, score in row["held_out"].items()
    ]
    print_rows("Prediction of held-out modes", predicted)
    if folder is not None:
        with writing(folder):
            write_json(folder / "identify.json", {"laws": reports})
            if not memory:
                figures.save(figure(models, rows), folder / "identify.png")
            for model in models if memory else ():
                name = "identify" if len(models) == 1 else f"identify-{model.law}"
                figures.save(figure_of_history(model, rows), folder / f"{name}.png")
        note(f"Results in {folder}")


def print_identified(report: dict) -> None:
    """Print a report of an identification: parameters, differences from the tests, and modes
    that were not measured.
    """
    form = report.get("form", report["law"]["law"])
    title = f"{form} fitted to {report['data']}, {report['rows']} rows"
    print_parameters(title, report)
    scores = report["r_squared"]
    print_by_mode(
        f"{title}: fit compared with the tests",
        {mode: {"R^2": scores.get(mode), **row} for mode, row in report["differences"].items()},
    )
    if report.get("rates"):
        least, greatest = report["rates"]
        out.print(f"Rates of stretch from {least:.3g} to {greatest:.3g} per second")
    unit = f"{report['stress_unit']} mm" if "stress_unit" in report else None
    print_rows(
        with_unit(f"{title}: tearing energy", unit),
        [
            {"mode": mode, "torn": row["specimens"], "energy": _in_words(row["energy"])}
            for mode, row in report.get("tearing", {}).items()
        ],
    )
    print_rows(f"{title}: modes that were not measured", report.get("unmeasured", []))
    print_rows(f"{title}: curves", report.get("curves", []))
    print_rows(f"{title}: stresses left out of the fit", report.get("cross_validation", []))


def print_break(rows: TestData) -> None:
    """Print the states in which specimens broke."""
    if rows.tests is not None:
        print_rows(with_unit(AT_BREAK, rows.unit), break_rows(rows.tests.at_break))


def break_rows(at_break: dict[str, dict]) -> list[dict]:
    """Return rows of a table of states at break: mean and standard deviation by mode."""
    return [
        {
            "mode": mode,
            "broken": row["specimens"],
            **{
                name: _in_words(row[name])
                for name in ("stretch", "nominal_stress", "work", "weibull_modulus")
                if name in row
            },
        }
        for mode, row in at_break.items()
    ]


def _in_words(pair: Sequence[float | None]) -> str:
    """Return a mean and its standard deviation, if there is one, in words."""
    mean, deviation = pair
    return f"{mean:.4g}" if deviation is None else f"{mean:.4g} ± {deviation:.2g}"


def print_parameters(title: str, report: dict) -> None:
    """Print the parameters of a report with their standard errors."""
    errors = {
        name: "not determined by the data" if error is None else f"{error:.2g}"
        for name, error in report["standard_errors"].items()
    } | dict.fromkeys(report["at_bound"], "at its bound")
    cells = [(name, f"{value:.5g}", errors[name]) for name, value in report["parameters"].items()]
    print_table(title, ("parameter", "value", "standard error"), cells, left=1)


def print_by_mode(title: str, rows: dict[str, dict]) -> None:
    """Print rows of numbers by mode of loading."""
    print_rows(title, [{"mode": mode, **row} for mode, row in rows.items()])
