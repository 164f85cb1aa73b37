"""Command ``evaluate``, which measures the errors of surrogates and exact force models."""

from typing import Annotated

from typer import Argument, Option

from .. import learning
from ..artifacts.places import find_artifact
from ..artifacts.store import law_of as stored_law
from ..artifacts.store import load_card, load_surrogate
from ..forces import FORCES, EnergySurrogate, ForceSurrogate
from ..learning.sampling import checked_range
from ..learning.target import REPORT_SEED, REPORTED_STATES
from .command import law_of
from .terminal import (
    print_json,
    print_rows,
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
        model = load_surrogate(reference)
        material = law_of(law or "neo-hookean")
        if isinstance(model, ForceSurrogate):
            model.law = material
    elif reference in FORCES:
        raise ValueError(
            f"{reference} has no bond force or energy of its own; evaluate takes {EVALUATED_HELP}"
        )
    else:
        find_artifact(reference, EVALUATED)
        model = load_surrogate(reference)
        material = stored_law(load_card(reference))
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
