"""Laws of rubber: identification from test data, and where a surrogate earns its keep.

python pipelines/materials_report.py                   measures all, and draws the fits
python pipelines/materials_report.py identification    one of identification, published and laws
"""

from cases import listed, of_rows, report
from clock import TimedModel, measure_speed, sheet
from pages import FIGURES

import pdsurrogate as pds
from pdsurrogate.identification import figure, fitted_laws
from pdsurrogate.learning import surrogate_of
from pdsurrogate.results import figures

DEGREES = ((1, 0), (4, 2), (5, 2), (6, 3), (7, 3), (8, 3), (9, 3), (10, 3), (12, 6))
"""Of the polynomials that are tried, from cheap to dear."""

TOLERANCE = 2e-3
"""Relative RMS force error, on and off the surface, that a surrogate must keep."""

INCOMPRESSIBLE = 1e7
"""K/mu at which constants are compared with published ones, which are of rubber that keeps its
volume.
"""

ALL = "all modes, weighted by scatter"
PUBLISHED = listed("published")
"""Constants of Treloar's rubber, in MPa, as others give them: law, the data fitted to and their
weights, constant, its value and source.
"""

CONSTANTS = {
    "shear modulus": lambda law: law.shear_modulus,
    "chain links": lambda law: law.chain_links,
    "chain limit": lambda law: law.chain_limit,
    "C10": lambda law: law.shear_modulus / 2,
    "C20": lambda law: law.shear_modulus / 2 * law.second,
    "C30": lambda law: law.shear_modulus / 2 * law.third,
}
"""The same of a law fitted here."""


TRELOAR, KAWABATA = pds.load_test_data("treloar"), pds.load_test_data("kawabata")


def identified(name):
    """A law on Treloar's data; Kawabata's grid is predicted with the same parameters."""
    model = fitted(name)
    pairs = zip(model.parameter_names_, model.parameters_, model.standard_errors_, strict=True)
    found = ", ".join(f"{key} {value:.4g} ({error:.1g})" for key, value, error in pairs)
    r_squared = TRELOAR.r_squared(model.predict(TRELOAR.stretches))
    modes = (r_squared[mode] for mode in ("uniaxial", "equibiaxial", "pure-shear"))
    if name == "gent":
        drawn = figure([fitted(law) for law in ("yeoh", "gent", "ogden")], TRELOAR)
        figures.save(drawn, FIGURES / "identification.png")
    yield name, found, *modes, KAWABATA.r_squared(model.predict(KAWABATA.stretches))["biaxial"]


def fitted(name, data=TRELOAR, weights=True, **more):
    """A law fitted to the three modes weighted alike, or to given data with equal weights."""
    model = pds.identification.LawRegressor(name, **more)
    return model.fit(
        data.stretches, data.nominal_stress, data.balanced_weights() if weights else None
    )


def beside_published(name, fitted_to, constant, value, source):
    """A constant found here and by others."""
    data = TRELOAR if fitted_to == ALL else TRELOAR.of("uniaxial")
    law = fitted(name, data, fitted_to == ALL, bulk_ratio=INCOMPRESSIBLE).law_
    yield name, fitted_to, constant, CONSTANTS[constant](law), value, source


def surrogate(law, degree):
    """Polynomial surrogate of a law."""
    samples = pds.training_samples(law, 8000, pds.learning.reachable_stretches(law), random_state=0)
    regressor = pds.learning.ChebyshevRegressor(degree)
    model = pds.surrogate_pipeline(regressor, features="isochoric").fit(samples.X, samples.y)
    return surrogate_of(model, law, samples)


def errors_of(model, law):
    """Relative RMS force error on and off the surface."""
    found = pds.evaluate(model.bond_force, law, pds.learning.reachable_stretches(law))
    return [found["on_surface"]["rms"], found["off_surface"]["rms"]]


def timed(name):
    """Cost of the exact bond force of a law and of its cheapest surrogate."""
    law, body = pds.materials.LAWS[name](), sheet()
    exact = pds.AnalyticBondForce(law)
    model, errors = next(
        (model, errors)
        for model in (surrogate(law, degree) for degree in DEGREES)
        if max(errors := errors_of(model, law)) <= TOLERANCE
    )
    costs = measure_speed(
        [TimedModel(exact, "float64", body), TimedModel(model, "float32", body)], law
    )
    dear, cheap = (one["ns_per_directed_bond_1"] for one in costs)
    reach = pds.learning.reachable_stretches(law)
    slope = pds.evaluate(exact.bond_force, law, reach, 5000)["least_slope_exact"]
    yield name, dear, cheap, dear / cheap, model.size.removeprefix("degrees "), errors, slope


if __name__ == "__main__":
    laws = fitted_laws()
    report(
        __doc__,
        of_rows("identification", identified, laws),
        of_rows("published", beside_published, PUBLISHED),
        of_rows("laws", timed, laws),
    )
