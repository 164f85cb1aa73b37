"""Command ``fit``, which fits surrogates of laws, identified from test data or given."""

from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Argument, Option

from ..artifacts.places import new_artifact, next_version, own_folder
from ..artifacts.store import load_card, load_surrogate
from ..identification import figure, load_test_data, reporting
from ..identification.campaign import TestFacts
from ..identification.data import TestData
from ..identification.history_report import report_of_history
from ..identification.regressor import N_TERMS
from ..identification.stress_regressor import StressRegressor, bulk_arguments
from ..learning.fitting import TooInexact
from ..learning.settings import FitSettings
from ..results import figures
from .command import OneLaw, SetLaw, check_folder, law_of, with_fields
from .evaluate import print_errors
from .identify import (
    DATA_HELP,
    Branches,
    BulkModulus,
    BulkRatio,
    FallingTimes,
    Softens,
    Terms,
    memory_of,
    print_break,
    print_by_mode,
    print_identified,
)
from .terminal import (
    FAILED,
    Bar,
    bad_input,
    note,
    out,
    print_json,
    warn,
    writing,
)

FOLDER_HELP = (
    "Folder of artifacts (default: $PDSURROGATE_ARTIFACTS, or the folder artifacts; in a checkout"
    " own-artifacts)."
)


@with_fields(settings=FitSettings, facts=TestFacts)
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
        list[str] | None,
        Option(metavar="DATA", help=f"Identify the parameters of the law first. {DATA_HELP}"),
    ] = None,
    facts: TestFacts,
    terms: Terms = None,
    free: Annotated[
        bool, Option("--free", help="With --data: identify a polyconvex energy instead of a law.")
    ] = False,
    branches: Branches = None,
    softening: Softens = False,
    falling_times: FallingTimes = False,
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
    law = law or "neo-hookean"
    bulk = bulk_arguments(bulk_modulus=bulk_modulus, bulk_ratio=bulk_ratio)
    memory = memory_of(branches, softening, falling_times)
    if data is None:
        if bulk or force_fit or free or memory or facts.stated():
            raise ValueError(
                "--free, --branches, --softening, --falling-times, --bulk-modulus, --bulk-ratio,"
                " --force-fit and what is said of tests need --data; without data, set parameters"
                " with --set"
            )
        tests = report = hull = None
        material = law_of(law, change)
    else:
        if change:
            raise ValueError(
                "--data identifies the parameters of the law, --set sets them: choose one"
            )
        with Bar(f"Fitting {'an energy' if free else law} to {', '.join(data)}"):
            rows = load_test_data(*data, history=bool(memory), **facts.stated())
            name_of_law = None if free else law
            model = reporting.fitted(rows, name_of_law, terms or N_TERMS, bulk, **memory)
            report = (report_of_history if memory else reporting.examined)(model, rows)
        tests = None if memory else (rows, model)
        if memory:  # bond forces have no history: the artifact is of the elastic energy
            settings = settings.model_copy(update={"energy": True})
        material = model.law_
        if free:
            settings = settings.within(*model.stretch_range_)
        hull = model.domain_hull() if free else None
        print_identified(report)
        print_break(rows)
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
    print_by_mode("Tests simulated with the artifact, compared with the data", against_measured)
    off = (
        "no stress in a test"
        if np.isnan(off_law)
        else f"{100 * off_law:.2g} % of the greatest stress"
    )
    out.print(f"Greatest difference of the simulated tests from the fitted law: {off}")
    if outside:
        domain = surrogate.domain
        stretches = data.stretches
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
