"""Laws, plane stress and exact solutions, each against something that does not share its code."""

import numpy as np
import pytest
from scipy.optimize import brentq

from pdsurrogate.materials import LAWS, PLANES, Gent, NeoHookean, homogeneous, plane_stress
from pdsurrogate.testing.laws import compiled_response


def random_gradients(random, n, low=0.5, high=4.0):
    """Rotation times stretch times rotation, det F > 0."""

    def rotation(angle):
        return np.stack(
            [np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=-1
        ).reshape(-1, 2, 2)

    stretch = np.zeros((n, 2, 2))
    stretch[:, 0, 0], stretch[:, 1, 1] = np.exp(random.uniform(np.log(low), np.log(high), (2, n)))
    return (
        rotation(random.uniform(0, 2 * np.pi, n))
        @ stretch
        @ rotation(random.uniform(0, 2 * np.pi, n))
    )


def test_neo_hookean_is_the_papers_eq_8_and_the_corrected_eq_9(random):
    law = NeoHookean(3.06, 306.0)
    F = random_gradients(random, 200)
    trace, J = plane_stress.invariants(F)
    C33 = plane_stress.thickness_stretch_squared(law, trace, J)
    # Eq. (9) with 2/3 C33^(+2/3); as printed, with -2/3, it is not P33 = 0.
    residual = (
        law.shear_modulus * (2 / 3 * C33 ** (2 / 3) - trace / 3 * C33 ** (-1 / 3)) * J ** (-2 / 3)
    )
    residual += law.bulk_modulus / 4 * (C33 * J**2 - 1 / (C33 * J**2))
    assert np.abs(residual).max() < 1e-9 * law.bulk_modulus
    inverse_transpose = np.linalg.inv(F).transpose(0, 2, 1)
    P = (
        law.shear_modulus
        * (F - C33[:, None, None] * inverse_transpose)
        * (C33 ** (-1 / 3) * J ** (-2 / 3))[:, None, None]
    )
    np.testing.assert_allclose(plane_stress.first_piola_stress(law, F), P, rtol=1e-11, atol=1e-11)


def test_energy_is_the_papers_eq_6(neo_hookean, random):
    law = neo_hookean
    F = random_gradients(random, 50)
    trace, J = plane_stress.invariants(F)
    J3 = plane_stress.volume_ratio(law, trace, J)
    C = np.zeros((50, 3, 3))
    C[:, :2, :2] = F.transpose(0, 2, 1) @ F
    C[:, 2, 2] = (J3 / J) ** 2
    full = np.sqrt(np.linalg.det(C))
    energy = (
        law.shear_modulus / 2 * (np.trace(C, axis1=1, axis2=2) * full ** (-2 / 3) - 3)
        + law.bulk_modulus / 8 * (full - 1 / full) ** 2
    )
    np.testing.assert_allclose(plane_stress.energy_density(law, F), energy, rtol=1e-9)


def test_uniaxial_solution_against_finite_element_reference(fem_uniaxial):
    law = NeoHookean(fem_uniaxial["material"]["mu"], fem_uniaxial["material"]["K"])
    for row in fem_uniaxial["results"].values():
        state = homogeneous.uniaxial(law, row["stretch"])
        assert state.nominal_stress == pytest.approx(row["nominal_stress_P11"], rel=1e-12)
        assert state.lateral_stretch == pytest.approx(row["lateral_stretch_lam2"], rel=1e-12)
        assert state.thickness_stretch == pytest.approx(row["thickness_stretch_lam3"], rel=1e-12)
        assert state.volume_ratio == pytest.approx(row["J"], rel=1e-12)
        assert state.energy_density == pytest.approx(row["energy_density"], rel=1e-11)
        assert (1 - state.lateral_stretch) / 2 == pytest.approx(row["u2_bottom_edge"], rel=1e-11)


def test_gent_ends_at_its_chain_limit_and_says_so():
    law = Gent(1.0, 200.0, 10.0)
    # Just short of the limit I1bar = 13 (stretch 3.51 in uniaxial tension) there is a state,
    # stiffer than without the limit.
    near = homogeneous.uniaxial(law, 3.4)
    assert (
        near.nominal_stress > 5 * homogeneous.uniaxial(NeoHookean(1.0, 200.0), 3.4).nominal_stress
    )
    with pytest.raises(
        ValueError,
        match=r"gent: no plane-stress state .* I1bar - 3 = 69 exceeds .* chain_limit = 10",
    ):
        homogeneous.equibiaxial(law, 6.0)
    trace, J = np.array([72.0]), np.array([36.0])
    assert np.isnan(plane_stress.response(law, trace, J, np.ones(1))[0]).all()
    assert np.isnan(compiled_response(law, trace, J, np.ones(1))[:, 0]).all()


def test_pure_shear_and_equibiaxial_against_two_equations(neo_hookean):
    """Roots of P33 = 0 for Eq. (6) in principal stretches, found without the code under test."""
    law = neo_hookean
    mu, K = law.shear_modulus, law.bulk_modulus

    def cauchy(a, stretches):
        J = np.prod(stretches)
        squares = np.square(stretches)
        return mu * J ** (-5 / 3) * (squares[a] - squares.sum() / 3) + K / 4 * (J - J**-3)

    for make, second in (
        (homogeneous.pure_shear, lambda stretch: 1.0),
        (homogeneous.equibiaxial, lambda stretch: stretch),
    ):
        for stretch in (0.6, 1.5, 3.0):
            lateral = second(stretch)
            thickness = brentq(
                lambda t, s=stretch, q=lateral: cauchy(2, [s, q, t]), 0.02, 5, xtol=1e-15
            )
            state = make(law, stretch)
            assert state.thickness_stretch == pytest.approx(thickness, rel=1e-11)
            assert state.nominal_stress == pytest.approx(
                cauchy(0, [stretch, lateral, thickness]) * lateral * thickness, rel=1e-9
            )


def test_bond_traction_equals_the_stress_for_consistent_states(law, random):
    """Theory (10), (11): with F = R U, T = R^T P in the frame of the bond."""
    F = random_gradients(random, 100)
    trace, J = plane_stress.invariants(F)
    C33 = plane_stress.thickness_stretch_squared(law, trace, J)
    P = plane_stress.first_piola_stress(law, F) / law.shear_modulus
    W, _, Vt = np.linalg.svd(F)
    R = W @ Vt
    angle = random.uniform(0, 2 * np.pi, 100)
    n = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    m = np.stack([-n[:, 1], n[:, 0]], axis=1)
    U = R.transpose(0, 2, 1) @ F

    def component(A, u, v):
        return np.einsum("bi,bij,bj->b", u, A, v)

    T = R.transpose(0, 2, 1) @ P
    got = plane_stress.bond_traction(law, component(U, n, n), component(U, n, m), J, C33)
    for value, expected in zip(
        got, (component(T, n, n), component(T, n, m), component(T, m, m)), strict=True
    ):
        np.testing.assert_allclose(value, expected, rtol=1e-10, atol=1e-10)


def test_residual_and_slope_are_derivatives_of_the_energy(law, random):
    """J3 dPsi/dJ3 at fixed F in the plane, and its derivative."""
    stretch = np.exp(random.uniform(np.log(0.5), np.log(3), (2, 50)))
    trace, J = (stretch**2).sum(axis=0), stretch.prod(axis=0)
    J3 = np.exp(random.uniform(-0.1, 0.1, 50))
    h = 1e-5
    _, _, residual, slope, _ = plane_stress.response(law, trace, J, J3)
    energy = [plane_stress.response(law, trace, J, J3 + sign * h)[4] for sign in (-1, 1)]
    residuals = [plane_stress.response(law, trace, J, J3 + sign * h)[2] for sign in (-1, 1)]
    scale = law.bulk_modulus / law.shear_modulus
    np.testing.assert_allclose(
        residual, J3 * (energy[1] - energy[0]) / (2 * h), rtol=1e-6, atol=1e-7 * scale
    )
    np.testing.assert_allclose(
        slope, (residuals[1] - residuals[0]) / (2 * h), rtol=1e-6, atol=1e-7 * scale
    )


@pytest.mark.parametrize(
    "parameters",
    [
        {"shear_modulus": 0},
        {"shear_modulus": -1},
        {"bulk_modulus": 0},
        {"shear_modulus": np.nan},
        {"bulk_modulus": np.inf},
    ],
)
def test_unphysical_parameters_are_refused_by_name(parameters):
    with pytest.raises(ValueError, match=next(iter(parameters))):
        NeoHookean(**parameters)


def test_states_without_a_solution_are_refused():
    law = NeoHookean()
    with pytest.raises(ValueError, match="det F must be positive"):
        plane_stress.volume_ratio(law, 2.0, -0.1)
    with pytest.raises(ValueError, match="stretch must be positive"):
        homogeneous.biaxial(law, -1.0, 1.0)


def test_laws_are_registered_under_their_names():
    assert all(name == law.name for name, law in LAWS.items())


def test_uniaxial_tension_in_space_leaves_both_sides_free():
    """Against the stresses of the three stretches by the law itself; two stretches are refused
    in space.
    """
    law = NeoHookean(1.0, 100.0)
    state = homogeneous.uniaxial(law, 1.5, "space")
    F = np.diag([state.stretch, state.lateral_stretch, state.thickness_stretch])
    P = PLANES["space"].first_piola_stress(law, F)
    np.testing.assert_allclose(np.diag(P), [state.nominal_stress, 0, 0], atol=1e-10)
    with pytest.raises(ValueError, match=r"plane must be stress or strain .*, not space"):
        homogeneous.biaxial(law, 1.5, 1.0, "space")


@pytest.mark.parametrize("name", sorted(LAWS))
@pytest.mark.parametrize(
    ("along", "normal"), [(1.5, 0.7), (2.0, 0.6), (0.9, 1.02), (1.2, 1.0), (1.0, 0.8)]
)
def test_the_thickness_at_an_edge_under_pressure_is_that_of_the_homogeneous_state(
    name, along, normal
):
    """The stress across the edge of a homogeneous sheet, taken as a pressure on its deformed
    thickness, of either sign.
    """
    law = LAWS[name]()
    state = homogeneous.biaxial(law, along, normal)
    pressure = -state.lateral_stress / (along * state.thickness_stretch)
    found = plane_stress.thickness_at_edge(law, [along, 1.0], [pressure, 0.0])
    assert found == pytest.approx([state.thickness_stretch, 1.0], rel=1e-9)


def test_no_thickness_at_an_edge_is_found_beyond_the_limit_of_a_law():
    assert np.isnan(plane_stress.thickness_at_edge(Gent(chain_limit=10.0), [50.0], 0.1)).all()
