"""Command ``evaluate``, which compares a surrogate with its material law; its tables of errors are also printed by ``fit``."""

from typing import Annotated

from typer import Argument, Option

from .. import learning
from ..artifacts import load_card, load_surrogate
from ..forces import FORCES, EnergySurrogate, ForceSurrogate, IsochoricNetwork
from ..learning.sampling import checked_range
from ..learning.target import REPORT_SEED, REPORTED_STATES
from ..scenes import MaterialSpec
from .command import law_of
from .terminal import out, print_json, print_table


def evaluate(
    reference: Annotated[str, Argument(metavar="REF", help="analytic, bond-energy, or an artefact: NAME, NAME@VERSION or a path.")],
    least: Annotated[float | None, Option(help="Least principal stretch, below 1; the artefact's own domain by default.")] = None,
    greatest: Annotated[float | None, Option(help="Greatest principal stretch, above 1.")] = None,
    samples: Annotated[int, Option(help="States in each set.", min=100)] = REPORTED_STATES,
    seed: Annotated[int, Option(help="Seed of the states.", min=0)] = REPORT_SEED + 1_000_000,
    law: Annotated[str | None, Option(help="Law to compare with; the artefact's own by default.")] = None,
) -> None:
    """Compare a bond force or an energy with the exact one: by strain, at rest, in stiffness, off plane stress."""
    model = load_surrogate(reference)
    if not isinstance(model, ForceSurrogate | EnergySurrogate | IsochoricNetwork):
        raise ValueError(f"{reference} has no bond force of its own to evaluate")
    if law is None and reference not in FORCES:
        material = MaterialSpec(**load_card(reference).material.trained_with).build()
    else:
        material = law_of(law or "neo-hookean")
    model.check_material(material)
    if reference in FORCES and isinstance(model, ForceSurrogate):
        model.law = material
    low, high = (model.domain.least_stretch, model.domain.greatest_stretch) if model.domain else learning.reachable_stretches(material)
    stretches = checked_range((low if least is None else least, high if greatest is None else greatest))
    report = learning.evaluate(model, material, stretches, samples, seed)
    print_json(report)
    print_errors(report)


def print_errors(report: dict) -> None:
    """Print tables of the errors of a surrogate of a bond force or of an energy."""
    low, high = report["stretch_range"]
    which = f"stretches {low:g} to {high:g}, {report['n_samples']} states"
    force, rows = "off_surface" in report, {"all": report["on_surface"]}
    if force:
        rows = {"on the plane-stress surface": report["on_surface"], "off it": report["off_surface"]}
    rows |= {f"strain {row['strain'][0]:g} to {row['strain'][1]:g}": row for row in report["by_strain"]}
    columns = {"RMS": "rms", "greatest": "max"} if force else {"stress, RMS": "rms", "greatest": "max", "energy, RMS": "energy_rms"}
    cells = ([title, *(f"{row[key]:.1e}" for key in columns.values())] for title, row in rows.items())
    print_table(f"Relative {'force error' if force else 'errors'}, {which}", ("states", *columns), cells, left=1)
    if force:
        slope, exact = report["least_slope"], report["least_slope_exact"]
        out.print(f"force at rest {report['at_rest']:.1e}; least stiffness slope {slope:.3g} (exact: {exact:.3g})")
        return
    if "shear_modulus" in report:
        more = f"shear modulus at rest {report['shear_modulus']:.7g} (exact: 1)"
    else:
        more = f"least curvature by log-stretches {report['least_curvature']:.3g} (exact: {report['least_curvature_exact']:.3g})"
    stiffness = f"least acoustic stiffness {report['least_acoustic']:.3g} (exact: {report['least_acoustic_exact']:.3g})"
    out.print(f"at rest {report['at_rest']:.1e}; {stiffness}; {more}")
