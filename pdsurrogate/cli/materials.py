"""Commands about laws: what there are, and their parameters from test data."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from .application import Rate, bad_input, err, note, out, print_json, progress_bar, show, writing
from .common import AsJson, Overwrite, command

DIGITS = 16
"""Of the digest by which a report knows its test data."""

LARGE_GROWTH = 1.05
"""Volume ratio of a law in the tests from which it is said: rubber's grows by a per cent or so."""

BulkModulus = Annotated[
    float | None, typer.Option(help="Bulk modulus of the law, in the unit of the stresses: such tests do not tell it; see --bulk-ratio.")
]
BulkRatio = Annotated[float | None, typer.Option(help="Bulk modulus over shear modulus instead; 1000 by default.")]

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


def identified(data: Path, law: str, terms: int, stretch: float | None, bulk: dict):
    """A fitted regressor, and the test data that it was fitted to."""
    from ..identification import LawRegressor, fitted_laws, load_test_data
    from ..materials import LAWS

    if law not in LAWS:
        raise ValueError(f"unknown law {law!r}; there are {', '.join(sorted(LAWS))}")
    if law not in fitted_laws():
        raise ValueError(f"the terms of {law} are found from test data by fit --free, which names no law")
    rows = load_test_data(data)
    if stretch is not None:
        rows = rows.up_to(stretch)
    return LawRegressor(law, n_terms=terms, **bulk).fit(rows.stretches, rows.nominal_stress, rows.balanced_weights()), rows


def free_energy(data: Path, bulk: dict):
    """An energy fitted to test data without a law, and the data."""
    from ..identification import EnergyRegressor, load_test_data

    rows = load_test_data(data)
    return EnergyRegressor(**bulk).fit(rows.stretches, rows.nominal_stress, rows.balanced_weights()), rows


def bulk_of(modulus: float | None, ratio: float | None) -> dict:
    """Return the arguments of a regressor for the bulk modulus, of which at most one option is given."""
    if modulus is not None and ratio is not None:
        raise ValueError("--bulk-modulus and --bulk-ratio say the same: choose one")
    given = {"bulk_modulus": modulus, "bulk_ratio": ratio}
    for key, value in given.items():
        if value is not None and not 0 < value < float("inf"):
            raise ValueError(f"--{key.replace('_', '-')} must be positive and finite, not {value:g}")
    return {key: value for key, value in given.items() if value is not None}


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
    out.print(f"law against tests, greatest difference by mode: {differences_in_words(found['differences'])}")
    if found["at_bound"]:
        warn(f"{form}: {', '.join(found['at_bound'])} ended at the bound of the search: the data do not tell it, or want another law.")
    if found["volume_ratio"] and found["volume_ratio"] > LARGE_GROWTH:
        warn(
            f"{form}: with this bulk modulus the volume grows by {100 * (found['volume_ratio'] - 1):.0f} % in the tests, more than that of "
            "rubber: a greater one is given by --bulk-modulus."
        )


def differences_in_words(found: dict) -> str:
    """Greatest difference from the tests by mode, in parts of the mode's greatest stress."""
    return ", ".join(
        f"{mode} no stress" if row["difference"] is None else f"{mode} {100 * row['difference']:+.2g} % at stretch {row['stretch']:g}"
        for mode, row in found.items()
    )


def warn(text: str) -> None:
    """Say what should be looked at, on standard error."""
    err.print(f"[yellow]{escape(text)}[/]", soft_wrap=True)


@command()
def identify(
    data: Annotated[Path, typer.Argument(metavar="DATA", help=DATA_HELP)],
    law: Annotated[list[str] | None, typer.Option(help="Law; may be repeated; all laws by default.")] = None,
    terms: Annotated[int, typer.Option(help="Terms of Ogden's law.", min=1, max=4)] = 3,
    stretch: Annotated[float | None, typer.Option("--up-to", help="Leave out rows beyond this stretch.")] = None,
    bulk_modulus: BulkModulus = None,
    bulk_ratio: BulkRatio = None,
    hold_out: Annotated[bool, typer.Option("--hold-out", help="Hold out each mode in turn, and report how the others predict it.")] = False,
    folder: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Write identify.json and identify.png here.")] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Find a law's parameters from test data."""
    from sklearn.base import clone

    from ..forces.identity import digest_of
    from ..identification import examine, figure, fitted_laws, held_out_modes, load_test_data, report
    from ..results import figures
    from ..results.files import check_writable, write_json
    from ..results.folder import check_report

    with bad_input(ValueError):
        bulk = bulk_of(bulk_modulus, bulk_ratio)
    asked = {"laws": list(law or fitted_laws()), "terms": terms, "up_to": stretch, **bulk}
    if folder is not None:
        with bad_input(OSError, ValueError):
            rows = load_test_data(data)
            asked |= {"data": rows.name, "rows": len(rows), "digest": digest_of(dataclasses.asdict(rows))[:DIGITS]}
            check_writable(folder)
            check_report(folder / "identify.json", asked, overwrite)
    found, models, held_out = [], [], []
    names, rate = list(law or fitted_laws()), Rate("laws")
    with bad_input(ValueError), progress_bar("Fitting") as told:
        for number, name in enumerate(names):
            counted = f"{number} of {len(names)} laws{rate.after(number)}, now {name}"
            told(number / len(names), counted)
            model, rows = identified(data, name, terms, stretch, bulk)
            models.append(model)
            found.append(report(model, rows))
            if hold_out:
                told((number + 0.5) / len(names), f"{counted}, each mode held out in turn")
                held_out += held_out_modes([clone(model)], rows)
    examined = [examine(model, rows, models) for model in models]
    for one, said in zip(found, examined, strict=True):
        one["refusals"], one["remarks"] = said.refusals, said.remarks
        print_identified(one)
    # What is said of the data is said of every law's fit, but once.
    for text in dict.fromkeys(text for said in examined for text in (*said.refusals, *said.remarks)):
        warn(text)
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
