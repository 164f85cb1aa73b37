"""Statements and figures of docs/theory.md that no other test has."""

import numpy as np
import pytest
from conftest import LAWS
from scipy.optimize import brentq

from pdsurrogate.forces import AnalyticBondForce
from pdsurrogate.learning.bond_force import stiffness_slopes
from pdsurrogate.materials import InvariantLaw, NeoHookean, homogeneous, plane_stress

LAW = NeoHookean()
INVARIANT_LAWS = [law for law in LAWS if isinstance(law, InvariantLaw)]


def stress_of_eq_9(F, exponent):
    """P11 of the paper's (8), with C33 from its (9) with the given exponent in the first term; mu = 1, K = 100."""
    trace, J = plane_stress.invariants(F)

    def residual(C33):
        shear = (2 / 3 * C33**exponent - trace / 3 * C33 ** (-1 / 3)) * J ** (-2 / 3)
        return shear + LAW.bulk_modulus / 4 * (C33 * J * J - 1 / (C33 * J * J))

    C33 = brentq(residual, 1e-4, 1e2, xtol=1e-15)
    return (F[0, 0] - C33 / F[0, 0]) * C33 ** (-1 / 3) * J ** (-2 / 3)


def test_the_printed_eq_9_makes_the_stress_too_large():
    """By 0.5 % in uniaxial tension, by 2.4 % at an equibiaxial stretch of 4."""
    for stretch, kind, excess in ((2.0, "uniaxial", 0.0047), (4.0, "uniaxial", 0.0057), (4.0, "equibiaxial", 0.0243)):
        state = getattr(homogeneous, kind)(LAW, stretch)
        F = np.diag([stretch, state.lateral_stretch])
        assert stress_of_eq_9(F, 2 / 3) == pytest.approx(state.nominal_stress, rel=1e-10)
        assert stress_of_eq_9(F, -2 / 3) / state.nominal_stress - 1 == pytest.approx(excess, abs=1e-4)


def test_the_incompressible_formula_is_up_to_one_and_a_half_per_cent_off():
    for stretch, stress, excess in ((1.5, 1.0495, 0.0057), (2.0, 1.7337, 0.0094), (2.5, 2.3071, 0.0142)):
        exact = homogeneous.uniaxial(LAW, stretch).nominal_stress
        assert exact == pytest.approx(stress, abs=1e-4)
        assert (stretch - stretch**-2) / exact - 1 == pytest.approx(excess, abs=1e-4)


def test_neo_hookean_force_along_the_bond_and_its_slope(random):
    """Theory (12), in states off the plane-stress surface too."""
    stretch, rotation, C33, J = random.uniform((0.5, -0.5, 0.2, 0.5), (3.0, 0.5, 2.0, 3.0), (200, 4)).T
    states = np.stack([stretch, rotation, np.ones(200), C33, J], axis=1)
    force, c = AnalyticBondForce(LAW).bond_force, (J * J * C33) ** (-1 / 3)
    np.testing.assert_allclose(force(*states.T)[:, 0], c * (stretch - C33 / stretch), rtol=1e-11, atol=1e-11)
    slopes = c * (1 + C33 / stretch**2)
    assert slopes.min() > 0
    np.testing.assert_allclose(stiffness_slopes(force, states), slopes, rtol=1e-6)


def energy_in_space(law, F):
    """Psi of a deformation gradient in three dimensions, and the I1bar, I2bar and J that it is made of."""
    C, J = F.T @ F, np.linalg.det(F)
    I1, I2 = np.trace(C) * J ** (-2 / 3), (np.trace(C) ** 2 - np.trace(C @ C)) / 2 * J ** (-4 / 3)
    return law.isochoric(I1, I2, law.parameters)[0] + law.volumetric(J, law.parameters)[0], I1, I2, J


@pytest.mark.parametrize("law", INVARIANT_LAWS, ids=lambda law: f"{law.name}-{law.bulk_modulus:g}")
def test_stress_in_space_and_in_plane_strain(law, random):
    """Theory (40), against differences of the energy; theory (41), the same in the plane at a held thickness."""
    plane = np.eye(3)
    plane[:2, :2] += random.uniform(-0.2, 0.2, (2, 2))
    for F in (np.eye(3) + random.uniform(-0.2, 0.2, (3, 3)), plane):
        _, I1, I2, J = energy_in_space(law, F)
        _, W1, W2, *_ = law.isochoric(I1, I2, law.parameters)
        c, C, cofactor = J ** (-2 / 3), F.T @ F, J * np.linalg.inv(F).T
        p, r = 2 * c * (W1 + I1 * W2), -2 * c * c * W2
        q = law.volumetric(J, law.parameters)[1] - 2 / (3 * J) * (I1 * W1 + 2 * I2 * W2)
        P, h = p * F + q * cofactor + r * F @ C, 1e-6
        for at in np.ndindex(3, 3):
            step = np.zeros((3, 3))
            step[at] = h
            difference = energy_in_space(law, F + step)[0] - energy_in_space(law, F - step)[0]
            assert P[at] == pytest.approx(difference / (2 * h), rel=1e-6, abs=1e-6)
    inner = plane[:2, :2]
    trace = (inner**2).sum()
    in_plane = (p + r * trace) * inner + (J * q - J * J * r) * np.linalg.inv(inner).T
    np.testing.assert_allclose(in_plane, P[:2, :2], rtol=1e-12, atol=1e-12)
