"""Commands about laws: what there are, and their parameters from test data."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from .application import Rate, bad_input, err, note, out, print_json, progress_bar, show, writing
from .common import AsJson, Overwrite, command

DIGITS = 16
"""Of the digest by which a report knows its test data."""

DATA_HELP = "Test data: treloar, kawabata, or a CSV with mode, stretch and nominal_stress."


@command()
def materials(as_json: AsJson = False) -> None:
    """List the material laws with their parameters."""
    from ..materials import LAWS

    if as_json:
        print_json([{**law().describe(), "bounds": law.bounds, "source": law.reference} for law in LAWS.values()])
    table = Table(title="Laws; every parameter is set by --set material.NAME=VALUE", title_justify="left")
    for title in ("law", "parameter", "default", "bounds in identification", "source"):
        table.add_column(title)
    for law in LAWS.values():
        default = law()
        for number, field in enumerate(dataclasses.fields(law)):
            value = getattr(default, field.name)
            shown = ", ".join(f"{item:.4g}" for item in value) if isinstance(value, tuple) else f"{value:g}"
            low, high = law.bounds.get(field.name, (0, None))
            bounds = f"{low:g} to {high:g}" if high is not None else "positive" if field.name.endswith("modulus") else ""
            table.add_row(law.name if number == 0 else "", field.name, shown, bounds, law.reference if number == 0 else "")
        table.add_section()
    show(table)


def identified(data: Path, law: str, terms: int, stretch: float | None):
    """A fitted regressor, and the test data that it was fitted to."""
    from ..identification import LawRegressor, load_test_data
    from ..materials import LAWS

    if law not in LAWS:
        raise ValueError(f"unknown law {law!r}; there are {', '.join(sorted(LAWS))}")
    rows = load_test_data(data)
    if stretch is not None:
        rows = rows.up_to(stretch)
    return LawRegressor(law, n_terms=terms).fit(rows.stretches, rows.nominal_stress, rows.balanced_weights()), rows


def free_energy(data: Path):
    """An energy fitted to test data without a law, and the data."""
    from ..identification import EnergyRegressor, load_test_data

    rows = load_test_data(data)
    return EnergyRegressor().fit(rows.stretches, rows.nominal_stress, rows.balanced_weights()), rows


def members_of(model, rows, count: int, seed: int) -> list:
    """Laws of the same regressor fitted to drawings from the test data."""
    from ..identification import committee

    drawn = committee(model, rows.stretches, rows.nominal_stress, count, rows.tests, seed, 1, rows.balanced_weights())
    return [member.law_ for member in drawn]


def print_identified(found: dict) -> None:
    """Parameters with their standard errors, and R^2 by mode."""
    form = found.get("form", found["law"]["law"])
    table = Table(title=f"{form} from {found['data']}, {found['rows']} rows", title_justify="left")
    for title in ("parameter", "value", "standard error"):
        table.add_column(title, justify="left" if title == "parameter" else "right")
    for name, value in found["parameters"].items():
        error = found["standard_errors"][name]
        shown = "at its bound" if name in found["at_bound"] else "not told by the data" if error is None else f"{error:.2g}"
        table.add_row(name, f"{value:.5g}", shown)
    show(table)
    out.print(", ".join(f"R^2 {mode} {value:.4f}" for mode, value in found["r_squared"].items()))
    law = form
    if found["at_bound"]:
        err.print(
            f"[yellow]{law}: {', '.join(found['at_bound'])} ended at the bound of the search: "
            "the data do not tell it, or want another law.[/]",
            soft_wrap=True,
        )
    if worse := [mode for mode, value in found["r_squared"].items() if value < 0]:
        err.print(f"[yellow]{law} describes {', '.join(worse)} worse than the mean stress does (R^2 below 0).[/]", soft_wrap=True)


@command()
def identify(
    data: Annotated[Path, typer.Argument(metavar="DATA", help=DATA_HELP)],
    law: Annotated[list[str] | None, typer.Option(help="Law; may be repeated; all laws by default.")] = None,
    terms: Annotated[int, typer.Option(help="Terms of Ogden's law.", min=1, max=4)] = 3,
    stretch: Annotated[float | None, typer.Option("--up-to", help="Leave out rows beyond this stretch.")] = None,
    hold_out: Annotated[bool, typer.Option("--hold-out", help="Hold out each mode in turn, and report how the others predict it.")] = False,
    folder: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Write identify.json and identify.png here.")] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Find a law's parameters from test data."""
    from sklearn.base import clone

    from ..forces.identity import digest_of
    from ..identification import figure, held_out_modes, load_test_data, report
    from ..materials import LAWS
    from ..results import figures
    from ..results.files import check_writable, write_json
    from ..results.folder import check_report

    asked = {"laws": list(law or LAWS), "terms": terms, "up_to": stretch}
    if folder is not None:
        with bad_input(OSError, ValueError):
            rows = load_test_data(data)
            asked |= {"data": rows.name, "rows": len(rows), "digest": digest_of(dataclasses.asdict(rows))[:DIGITS]}
            check_writable(folder)
            check_report(folder / "identify.json", asked, overwrite)
    found, models, held_out = [], [], []
    names, rate = list(law or LAWS), Rate("laws")
    with bad_input(ValueError), progress_bar("Fitting") as told:
        for number, name in enumerate(names):
            counted = f"{number} of {len(names)} laws{rate.after(number)}, now {name}"
            told(number / len(names), counted)
            model, rows = identified(data, name, terms, stretch)
            models.append(model)
            found.append(report(model, rows))
            if hold_out:
                told((number + 0.5) / len(names), f"{counted}, each mode held out in turn")
                held_out += held_out_modes([clone(model)], rows)
    for one in found:
        print_identified(one)
    if as_json:
        print_json({"laws": found, "held_out": held_out})
    if held_out:
        table = Table(title="Modes held out", title_justify="left")
        for title in ("law", "fitted to", "R^2 of the mode held out", "relative RMS"):
            table.add_column(title)
        for row in held_out:
            scores = ", ".join(f"{mode} {value:.3f}" for mode, value in row["held_out"].items())
            table.add_row(row["law"], ", ".join(row["fitted_to"]), scores, f"{row['relative_rms']:.3f}")
        show(table)
    if folder is not None:
        with writing(folder):
            write_json(folder / "identify.json", {"asked": asked, "laws": found})
            figures.save(figure(models, rows), folder / "identify.png")
        note(f"Results in {folder}")
