"""Standard errors of results by the covariance of a law, against runs with other laws and
against closed solutions.
"""

import numpy as np
import pytest
from refusals import raising, refused

import pdsurrogate as pds
from pdsurrogate.materials import Gent, LawCovariance, NeoHookean, Ogden, Polyconvex
from pdsurrogate.materials.covariance import covariance_of_numbers
from pdsurrogate.scenes.reading import leaves

OUTPUTS = ["nominal_stress", "energy", "probes.side.displacement"]
ERRORS = 0.02
"""Relative standard errors of the parameters."""

SECOND_ORDER = 0.03
"""What a sample of simulations may differ from the first-order errors, relative to these: stresses
bend by about the relative change of a parameter, 0.02, which in a sample without skewness enters in
the second order alone; the skewness of 16 draws is some 0.6.
"""


def sheet(law, **changes):
    changes |= {
        "reference": None,
        "probes": [{"name": "side", "at": [1.4, 0.0]}],
        "precision": "float64",
    }
    return pds.load_scene("hole", {"spacing": 0.25, "stretches": [1.3], "material": law, **changes})


def drawn(mean, covariance, count, random):
    """Draw normal parameters whose sample has exactly this mean and covariance, which leaves
    none of the scatter of a small sample.
    """
    z = random.standard_normal((count, len(mean)))
    z -= z.mean(axis=0)
    z = z @ np.linalg.inv(np.linalg.cholesky(np.cov(z.T, ddof=0))).T
    return mean + z @ np.linalg.cholesky(covariance).T


def of_parameters(law_of, parameters, correlation):
    """Return the covariance of parameters with relative errors `ERRORS`, and that of the numbers
    of their law.
    """
    covariance = (
        np.outer(parameters, parameters)
        * ERRORS**2
        * (correlation + (1 - correlation) * np.eye(len(parameters)))
    )
    return covariance, covariance_of_numbers(
        law_of, [f"p{n}" for n in range(len(parameters))], parameters, covariance, ()
    )


LAWS = {
    "gent": (lambda p: Gent(p[0], 100 * p[0], p[1]), np.array([0.8, 12.0])),
    "ogden": (
        lambda p: Ogden(moduli=(p[0], -p[1]), exponents=(p[2], -2.0)),
        np.array([0.6, 0.05, 1.5]),
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_standard_errors_are_the_scatter_of_simulations_with_drawn_parameters(name, random):
    law_of, parameters = LAWS[name]
    covariance, of_numbers = of_parameters(law_of, parameters, 0.6)
    result = pds.simulate(sheet(law_of(parameters)), "bond-energy")
    found = result.standard_errors(OUTPUTS, of_numbers)
    rows = [
        dict(leaves(pds.simulate(sheet(law_of(one)), "bond-energy").levels[-1]))
        for one in drawn(parameters, covariance, 16, random)
    ]
    scatter = {key: np.std([row[key] for row in rows]) for key in found}
    greatest = max(error for key, error in found.items() if key.startswith("probes"))
    for key, error in found.items():
        # By symmetry the side moves across the load alone; its other component is rounding.
        assert error == pytest.approx(
            scatter[key], rel=SECOND_ORDER, abs=1e-3 * greatest if key.startswith("probes") else 0
        ), key


def test_a_modulus_alone_changes_stresses_in_its_proportion_and_no_displacements():
    """At a given K/mu, exactly; also with the covariance in another unit of stress."""
    law = NeoHookean(800.0, 80000.0)
    covariance = LawCovariance(
        NeoHookean(0.8, 80.0),
        ("shear_modulus", "bulk_modulus"),
        1e-4 * np.outer([0.8, 80.0], [0.8, 80.0]),
    )
    result = pds.simulate(sheet(law), "bond-energy")
    found = result.standard_errors(OUTPUTS, covariance)
    assert found["nominal_stress"] == pytest.approx(
        0.01 * result.levels[-1]["nominal_stress"], rel=1e-5
    )
    assert found["energy"] == pytest.approx(0.01 * result.levels[-1]["energy"], rel=1e-5)
    assert found["probes.side.displacement.0"] < 1e-6


def test_regions_of_one_law_change_together():
    """A sheet of which a part is declared a region of the same law is the same sheet; one of a
    certain law has smaller errors.
    """
    law = NeoHookean(0.8, 80.0)
    covariance = LawCovariance(law, ("shear_modulus",), [[1e-4]])
    half = {"half_plane": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}}

    def error(other):
        parts = [{"region": half, "material": other}]
        scene = pds.load_scene(
            "uniaxial", {"spacing": 0.25, "stretches": [1.3], "material": law, "materials": parts}
        )
        return pds.simulate(scene, "bond-energy").standard_errors(["nominal_stress"], covariance)[
            "nominal_stress"
        ]

    whole = pds.simulate(
        pds.load_scene("uniaxial", spacing=0.25, stretches=[1.3], material=law), "bond-energy"
    )
    assert error(law) == pytest.approx(
        whole.standard_errors(["nominal_stress"], covariance)["nominal_stress"], rel=1e-4
    )
    assert error(NeoHookean(0.9, 90.0)) < 0.8 * error(law)


def test_a_result_without_a_covariance_or_with_that_of_another_law_is_refused():
    result = pds.simulate(sheet(NeoHookean()), "neo-hookean")
    with raising(r"neo-hookean@\d has no covariance of its law.*pdsurrogate calibrate"):
        result.standard_errors(OUTPUTS)
    with raising(r"the covariance is that of .*chain_limit.* but the scene has .*neo-hookean"):
        result.standard_errors(OUTPUTS, LawCovariance(Gent(), ("chain_limit",), [[1.0]]))
    with raising("it must be the same law, at most in another unit of stress"):
        result.standard_errors(
            OUTPUTS, LawCovariance(NeoHookean(1.0, 200.0), ("shear_modulus",), [[1.0]])
        )


@refused("covariances")
def test_what_is_no_covariance_is_refused(names, values, message):
    with raising(message):
        LawCovariance(NeoHookean(), names, values)


def test_moduli_of_all_terms_scale_with_the_unit_of_stress():
    law = Polyconvex(moduli=(0.2,), exponents=(3.0,), first=(0.3, 0.01), roots=(0.1, 0.0))
    names = ("moduli.0", "exponents.0", "first.1", "roots.0")
    scaled = LawCovariance(law, names, np.eye(4)).scaled_to(law.scaled(1000.0))
    assert np.sqrt(np.diag(scaled)) == pytest.approx([1000, 1, 1000, 1000])
