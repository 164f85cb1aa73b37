"""Commands ``identify`` for parameters of laws from test data, ``fit`` for surrogates of laws,
and ``evaluate`` for their errors.
"""

from collections.abc import Callable
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, get_type_hints

import numpy as np
from typer import Argument, Option

from .. import learning
from ..artifacts.store import (
    find_artifact,
    load_card,
    load_surrogate,
    new_artifact,
    next_version,
    own_folder,
)
from ..artifacts.store import law_of as stored_law
from ..forces import FORCES, EnergySurrogate, ForceSurrogate
from ..identification import figure, fitted_laws, load_test_data, reporting
from ..identification.data import TestData
from ..identification.regressor import N_TERMS
from ..identification.stress_regressor import StressRegressor, bulk_arguments
from ..learning.fitting import TooInexact
from ..learning.sampling import checked_range
from ..learning.settings import FitSettings
from ..learning.target import REPORT_SEED, REPORTED_STATES
from ..results import figures
from ..results.files import write_json
from .command import OneLaw, Overwrite, ReportFolder, SetLaw, check_folder, law_of
from .terminal import (
    FAILED,
    Bar,
    bad_input,
    note,
    out,
    print_json,
    print_rows,
    print_table,
    warn,
    writing,
)

FOLDER_HELP = (
    "Folder of artifacts (default: $PDSURROGATE_ARTIFACTS, or the folder artifacts; in a checkout"
    " own-artifacts)."
)

STIFFNESS = {
    "at_rest": "force or stress at rest",
    "shear_modulus": "shear modulus at rest",
    "least_slope": "least slope of the force along a bond",
    "least_acoustic": "least stiffness of shear waves",
    "least_curvature": "least curvature of the energy",
}
"""Words for the entries of a report of `learning.evaluate` on the state at rest and on stiffness;
those of the law are ``KEY_exact``.
"""

ERRORS = {"rms": "RMS", "max": "greatest", "energy_rms": "RMS of the energy"}
"""Words for relative errors in such a report."""

DATA_HELP = (
    "Test data: treloar, kawabata, or a CSV file with the columns mode, stretch and nominal_stress."
)

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


Loading = Annotated[
    bool,
    Option("--loading", help="Take the rows of first loading only, without those of unloading."),
]


def identify(
    data: Annotated[Path, Argument(metavar="DATA", help=DATA_HELP)],
    *,
    law: Annotated[
        list[str] | None, Option(metavar="LAW", help="Law; may be repeated (default: all).")
    ] = None,
    terms: Terms = None,
    stretch: Annotated[
        float | None, Option("--up-to", help="Leave out rows with a greater stretch.")
    ] = None,
    loading: Loading = False,
    bulk_modulus: BulkModulus = None,
    bulk_ratio: BulkRatio = None,
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
    names, rows = law or fitted_laws(), load_test_data(data)
    if terms is not None and "ogden" not in names:
        raise ValueError(f"--terms needs --law ogden; the laws are {', '.join(names)}")
    terms, bulk = terms or N_TERMS, bulk_arguments(bulk_modulus=bulk_modulus, bulk_ratio=bulk_ratio)
    check_folder(folder, "identify.json", overwrite)
    if loading:
        rows = rows.loading()
    if stretch is not None:
        rows = rows.up_to(stretch)
    with Bar(rows.name):
        models, reports, held_out = reporting.identify(rows, names, terms, bulk, hold_out)
    for report in reports:
        print_identified(report)
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
            figures.save(figure(models, rows), folder / "identify.png")
        note(f"Results in {folder}")


def print_identified(report: dict) -> None:
    """Print a report of an identification: parameters, differences from the tests, and modes
    that were not measured.
    """
    form = report.get("form", report["law"]["law"])
    title = f"{form} fitted to {report['data']}, {report['rows']} rows"
    print_parameters(title, report)
    scores = report["r_squared"]
    _print_by_mode(
        f"{title}: fit compared with the tests",
        {mode: {"R^2": scores.get(mode), **row} for mode, row in report["differences"].items()},
    )
    print_rows(f"{title}: modes that were not measured", report.get("unmeasured", []))


def print_parameters(title: str, report: dict) -> None:
    """Print the parameters of a report with their standard errors."""
    errors = {
        name: "not determined by the data" if error is None else f"{error:.2g}"
        for name, error in report["standard_errors"].items()
    } | dict.fromkeys(report["at_bound"], "at its bound")
    cells = [(name, f"{value:.5g}", errors[name]) for name, value in report["parameters"].items()]
    print_table(title, ("parameter", "value", "standard error"), cells, left=1)


def _print_by_mode(title: str, rows: dict[str, dict]) -> None:
    print_rows(title, [{"mode": mode, **row} for mode, row in rows.items()])


def _with_settings(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with one option for each field of `FitSettings`, which it receives
    together as its argument `settings`.
    """
    kinds = get_type_hints(FitSettings, include_extras=True)
    fields = [
        Parameter(key, Parameter.KEYWORD_ONLY, default=one.default, annotation=kinds[key])
        for key, one in FitSettings.model_fields.items()
    ]
    own = [
        parameter
        for parameter in signature(command).parameters.values()
        if parameter.name != "settings"
    ]

    @wraps(command)
    def run(**given) -> None:
        command(
            settings=FitSettings(**{key: given.pop(key) for key in FitSettings.model_fields}),
            **given,
        )

    run.__signature__ = Signature([*own, *fields])
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in (*own, *fields)}
    return run


@_with_settings
def fit(
    name: Annotated[str, Argument(metavar="NAME", help="Name of the new artifact.")],
    *,
    version: Annotated[
        str | None,
        Option(help="Version of the artifact, which must be new (default: the next one)."),
    ] = None,
    law: OneLaw = None,
    change: SetLaw = None,
    data: Annotated[
        Path | None,
        Option(metavar="DATA", help=f"Identify the parameters of the law first. {DATA_HELP}"),
    ] = None,
    terms: Terms = None,
    free: Annotated[
        bool, Option("--free", help="With --data: identify a polyconvex energy instead of a law.")
    ] = False,
    loading: Loading = False,
    bulk_modulus: BulkModulus = None,
    bulk_ratio: BulkRatio = None,
    force_fit: Annotated[
        bool,
        Option(
            "--force-fit",
            help="With --data: continue even if the data or the fit would be refused.",
        ),
    ] = False,
    settings: FitSettings,
    folder: Annotated[Path | None, Option("--out", metavar="DIR", help=FOLDER_HELP)] = None,
) -> None:
    """Identify a law if there are test data, fit a surrogate to it, store the surrogate, and
    print its errors.
    """
    with bad_input(OSError):
        folder = own_folder() if folder is None else folder
        new_artifact(folder, name, next_version(folder, name) if version is None else version)
    check_folder(folder)
    if free and law is not None:
        raise ValueError(
            "--free identifies an energy instead of a law, --law names a law: choose one"
        )
    if terms is not None and (data is None or law != "ogden"):
        raise ValueError(
            "--terms needs --law ogden and --data; without data, set the parameters of the law with"
            " --set"
        )
    law, bulk = (
        law or "neo-hookean",
        bulk_arguments(bulk_modulus=bulk_modulus, bulk_ratio=bulk_ratio),
    )
    if data is None:
        if bulk or force_fit or free or loading:
            options = "--free, --loading, --bulk-modulus, --bulk-ratio and --force-fit"
            raise ValueError(f"{options} need --data; without data, set parameters with --set")
        tests, report, hull, material = None, None, None, law_of(law, change)
    else:
        if change:
            raise ValueError(
                "--data identifies the parameters of the law, --set sets them: choose one"
            )
        with Bar(f"Fitting {'an energy' if free else law} to {data}"):
            rows = load_test_data(data)
            rows = rows.loading() if loading else rows
            model = reporting.fitted(rows, None if free else law, terms or N_TERMS, bulk)
            report = reporting.examined(model, rows)
        tests, hull, material = (rows, model), None, model.law_
        if free:
            settings, hull = settings.within(*model.stretch_range_), model.domain_hull()
        print_identified(report)
        refusals = report["refusals"]
        for text in (*report["remarks"], *(refusals if force_fit else ())):
            warn(text)
        if refusals and not force_fit:
            raise ValueError(f"{'; '.join(refusals)}; --force-fit continues anyway")
    with Bar(name):
        write = settings.train(material, hull, report)
    with writing(folder), bad_input(TooInexact, status=FAILED):
        # The next version is that of now: another fit of the same name may have ended since.
        path = write(folder, name, version)
    card = load_card(path)
    simulated = {} if tests is None else _simulate_tests(path, *tests)
    print_json(
        {
            "artifact": f"{card.name}@{card.version}",
            "path": str(path),
            "errors": card.errors,
            "training": card.training,
            **simulated,
        }
    )
    print_errors(card.errors["box"])
    for row in card.training["cross_validation"]:
        out.print(
            f"Fold {row['fold'] + 1}: relative RMS error {row['rms']:.2e} on the held-out samples"
        )
    note(f"Wrote {path}")


def _simulate_tests(path: Path, data: TestData, model: StressRegressor) -> dict:
    """Simulate the material tests with the stored surrogate in `path`, and print how much the
    stresses differ from the tests and the law.

    Write a picture of tests, law and simulation next to the folder of the surrogate, unless the
    picture exists.

    Return, for the output as JSON, the differences from the tests, the number of rows of test data
    that lie outside the surrogate's domain, and the simulated stresses.
    """
    with Bar(f"Simulating the tests with {path}"):
        surrogate = load_surrogate(path)
        stress, off_law, outside = reporting.simulate_tests(surrogate, data, model)
    against_measured = reporting.differences(data, stress)
    _print_by_mode("Tests simulated with the artifact, compared with the data", against_measured)
    off = (
        "no stress in a test"
        if np.isnan(off_law)
        else f"{100 * off_law:.2g} % of the greatest stress"
    )
    out.print(f"Greatest difference of the simulated tests from the fitted law: {off}")
    if outside:
        domain, stretches = surrogate.domain, data.stretches
        warn(
            f"{outside} of {len(data)} rows lie outside the artifact's domain (stretches from"
            f" {domain.least_stretch:.4g} to {domain.greatest_stretch:.4g}), where simulations use"
            " the exact force, so these rows do not test the artifact. The data have stretches"
            f" from {stretches.min():.4g} to {stretches.max():.4g}: set the domain with --least and"
            " --greatest; a larger domain needs a higher --degree or more --units."
        )
    picture = path.with_name(f"{path.name}.png")
    if not picture.exists():
        with writing(path.parent):
            figures.save(figure([model], data, stress), picture)
        note(f"Wrote {picture}, a figure of the tests, the law and the simulation")
    values = [float(value) if np.isfinite(value) else None for value in stress]
    return {
        "simulated": {
            "against_measured": against_measured,
            "rows_outside_domain": outside,
            "nominal_stress": values,
        }
    }


EVALUATED = [
    name for name, kind in FORCES.items() if issubclass(kind, ForceSurrogate | EnergySurrogate)
]
"""Exact force models with a bond force or an energy of their own, which ``evaluate`` takes
besides artifacts.
"""

EVALUATED_HELP = f"{', '.join(EVALUATED)}, or an artifact (NAME, NAME@VERSION or a path)"


def evaluate(
    reference: Annotated[str, Argument(metavar="REF", help=f"Force model: {EVALUATED_HELP}.")],
    least: Annotated[
        float | None,
        Option(help="Least principal stretch (default: that of the artifact's domain)."),
    ] = None,
    greatest: Annotated[
        float | None,
        Option(help="Greatest principal stretch (default: that of the artifact's domain)."),
    ] = None,
    samples: Annotated[
        int, Option(help="Number of states in each set.", min=100)
    ] = REPORTED_STATES,
    seed: Annotated[int, Option(help="Seed of the random states.", min=0)] = REPORT_SEED
    + 1_000_000,
    law: Annotated[
        str | None, Option(metavar="LAW", help="Law of an exact model (default: neo-hookean).")
    ] = None,
) -> None:
    """Print the errors of an artifact against the law on its card, or of an exact force model
    against a law.
    """
    if reference in EVALUATED:
        model, material = load_surrogate(reference), law_of(law or "neo-hookean")
        if isinstance(model, ForceSurrogate):
            model.law = material
    elif reference in FORCES:
        raise ValueError(
            f"{reference} has no bond force or energy of its own; evaluate takes {EVALUATED_HELP}"
        )
    else:
        find_artifact(reference, EVALUATED)
        model, material = load_surrogate(reference), stored_law(load_card(reference))
        if law not in (None, material.name):
            raise ValueError(
                f"--law {law}: {model.name} is compared with its own law, {material.name}; leave"
                " out --law"
            )
    low, high = (
        (model.domain.least_stretch, model.domain.greatest_stretch)
        if model.domain
        else learning.reachable_stretches(material)
    )
    stretches = checked_range(
        (low if least is None else least, high if greatest is None else greatest)
    )
    report = learning.evaluate(model, material, stretches, samples, seed)
    print_json(report)
    print_errors(report)


def print_errors(report: dict) -> None:
    """Print, from a report of `learning.evaluate`, the errors of a bond force or an energy, and
    its state at rest and stiffness.
    """
    low, high = report["stretch_range"]
    rows = {"all": report["on_surface"]}
    if "off_surface" in report:
        rows = {
            "in plane stress": report["on_surface"],
            "not in plane stress": report["off_surface"],
        }
    rows |= {
        f"strain {row['strain'][0]:g} to {row['strain'][1]:g}": row for row in report["by_strain"]
    }
    errors = [
        {"states": title, **{word: row[key] for key, word in ERRORS.items() if key in row}}
        for title, row in rows.items()
    ]
    print_rows(
        f"Relative errors, stretches {low:g} to {high:g}, {report['n_samples']} states", errors
    )
    of_law = {"at_rest_exact": 0.0, "shear_modulus_exact": 1.0, **report}
    rest = [
        {"quantity": word, "model": report[key], "exact": of_law[f"{key}_exact"]}
        for key, word in STIFFNESS.items()
        if key in report
    ]
    print_rows("State at rest, and stiffness", rest)
