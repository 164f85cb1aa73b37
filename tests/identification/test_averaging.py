"""Averages of energies without a law: what linear equations determine comes back, and what they
leave open is in the spread.
"""

import numpy as np
import pytest
from refusals import raising

from pdsurrogate.identification import MODES
from pdsurrogate.identification.averaging import average, columns_of, isochoric
from pdsurrogate.materials.dictionary import OF_INVARIANTS as TERMS
from pdsurrogate.materials.dictionary import line_curvatures, wave_margin

MARGIN = wave_margin(TERMS)

STRETCHES = np.linspace(1.05, 2.0, 20)


def stresses(mode, stretches=STRETCHES):
    """Return the stresses of all terms with the coefficient 1 in a homogeneous test, shape (n,
    n_terms).
    """
    states = np.stack([stretches, MODES[mode](stretches)], axis=1)
    return columns_of(isochoric(states, np.ones(len(states))), states[:, 0], TERMS)


def known(least):
    """Return the variance of measurements in units of their standard deviations."""
    return 1.0


def coefficients(**sizes):
    """Return the coefficients of all terms from those of some, as kind_number."""
    named = {
        f"{term.kind}_{term.number:g}".replace("-", "m"): number
        for number, term in enumerate(TERMS)
    }
    found = np.zeros(len(TERMS))
    for name, size in sizes.items():
        found[named[name]] = size
    return found


LAWS = {
    "Mooney, Rivlin": coefficients(stretches_2=1.0, stretches_m2=0.5),
    "Gent, Thomas": coefficients(stretches_2=1.0, second_logarithm_1=0.6),
    "Carroll": coefficients(stretches_2=1.0, first_3=0.01, roots_2=0.4),
}


@pytest.mark.parametrize("law", LAWS)
def test_equibiaxial_tension_is_within_the_spread_of_energies_from_other_tests(law, random):
    """Uniaxial tension and pure shear with an error of 0.5 %; the stresses up to a stretch of 2 are
    within twice the spread, which is the standard error of a normal distribution at least as wide:
    of ten laws drawn with errors, at most two can be outside.
    """
    J, equibiaxial = (
        np.vstack([stresses("uniaxial"), stresses("pure-shear")]),
        stresses("equibiaxial"),
    )
    exact, outside = J @ LAWS[law], 0
    for _ in range(10):
        deviation = 0.005 * exact
        right = exact + deviation * random.standard_normal(len(exact))
        found = average(TERMS, J / deviation[:, None], right / deviation, known, MARGIN)
        spread = np.sqrt(np.einsum("ij,jk,ik->i", equibiaxial, found.covariance, equibiaxial))
        outside += np.mean(np.abs(equibiaxial @ (found.mean - LAWS[law])) > 2 * spread) > 0.1
        assert (found.mean >= 0).all()
    assert outside <= 2


def test_exact_measurements_of_two_modes_determine_the_third():
    J, equibiaxial = (
        np.vstack([stresses("uniaxial"), stresses("pure-shear")]),
        stresses("equibiaxial"),
    )
    for law in LAWS.values():
        deviation = 1e-5 * (J @ law)
        found = average(TERMS, J / deviation[:, None], (J @ law) / deviation, known, MARGIN)
        np.testing.assert_allclose(equibiaxial @ found.mean, equibiaxial @ law, rtol=5e-3)


def test_correlated_measurements_widen_the_spread():
    """With the same equations, the variance within a set of terms rises in proportion."""
    J = np.vstack([stresses("uniaxial"), stresses("pure-shear")])
    right, deviation = J @ LAWS["Gent, Thomas"], 1e-4
    narrow, wide = (
        average(TERMS, J / deviation, right / deviation, lambda least, one=one: one, MARGIN)
        for one in (1.0, 4.0)
    )
    assert np.trace(wide.covariance) > 2 * np.trace(narrow.covariance)


def test_energies_with_unstable_waves_are_left_out():
    """A logarithm with a fiftieth of I1bar - 3 fits its own stresses, but is unstable in simple
    shear.
    """
    unstable = coefficients(stretches_2=0.04, second_logarithm_1=1.0)
    curvatures = line_curvatures(TERMS)
    assert (curvatures @ unstable).min() < -0.01
    J = np.vstack([stresses("uniaxial"), stresses("pure-shear")])
    found = average(TERMS, J / 0.01, J @ unstable / 0.01, known, MARGIN, 8)
    for energy in (found.mean, *found.members):
        assert (curvatures @ energy).min() > -1e-5 * energy.max()


def test_every_set_has_stiffness_at_rest():
    """Stresses that fall below zero are fitted by none."""
    J = np.vstack([stresses("uniaxial"), stresses("pure-shear")])
    with raising(
        "no sum of the terms with positive coefficients and stable waves describes the measurements"
    ):
        average(TERMS, J, -J @ LAWS["Carroll"], known, MARGIN)
