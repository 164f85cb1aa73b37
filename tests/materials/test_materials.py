"""Laws, plane stress and exact solutions, each against something that does not share its code."""

import numpy as np
import pytest
from scipy.optimize import brentq

from pdsurrogate.materials import LAWS, PLANES, Gent, NeoHookean, Yeoh, homogeneous, plane_stress
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


@pytest.mark.parametrize("plane", PLANES)
def test_shear_waves_along_a_principal_direction_have_the_speed_of_ericksens_formula(law, plane):
    """rho c^2 = (l1 P1 - l2 P2)/(l1^2 - l2^2) for every isotropic law, since a shear of this kind
    only turns the principal directions.

    Differences of fourth order leave some 1e-9; with the greatest bulk modulus of the laws,
    rounding as much.
    """
    F = np.diag([1.7, 0.8, 1.05][: 2 if plane != "space" else 3])
    P = np.diag(PLANES[plane].first_piola_stress(law, F))
    expected = (1.7 * P[0] - 0.8 * P[1]) / (1.7**2 - 0.8**2)
    speeds = homogeneous.wave_speeds(law, F, [3.0, *[0.0] * (len(F) - 1)], density=2.0, plane=plane)
    assert np.abs(2.0 * speeds**2 / expected - 1).min() < 1e-7


def test_waves_in_neo_hookean_rubber_against_closed_solutions():
    """Shear waves of a stretched body, rho c^2 = mu J^(-2/3) for every stretch; small strains in
    a solid, and in a sheet that may thin.
    """
    law, density = NeoHookean(3.0, 40.0), 1.2
    for plane, F in (
        ("stress", np.diag([2.5, 1.6])),
        ("strain", np.diag([1.6, 0.7])),
        ("space", np.diag([1.4, 0.8, 1.1])),
    ):
        J3 = PLANES[plane].volume_ratio(law, *PLANES[plane].invariants(F))
        along = homogeneous.wave_speeds(law, F, np.eye(len(F))[0], density, plane)
        assert np.abs(along / np.sqrt(3.0 * J3 ** (-2 / 3) / density) - 1).min() < 1e-8, plane
    young, poisson = 9 * 40.0 * 3.0 / (3 * 40.0 + 3.0), (3 * 40.0 - 2 * 3.0) / (6 * 40.0 + 2 * 3.0)
    moduli = {
        "stress": young / (1 - poisson**2),
        "strain": 40.0 + 4 / 3 * 3.0,
        "space": 40.0 + 4 / 3 * 3.0,
    }
    for plane, modulus in moduli.items():
        d = 3 if plane == "space" else 2
        speeds = homogeneous.wave_speeds(law, np.eye(d), np.ones(d), density, plane)
        np.testing.assert_allclose(speeds**2 * density, [3.0] * (d - 1) + [modulus], rtol=1e-7)


def test_wave_speeds_do_not_depend_on_the_position_of_the_observer(law):
    F, normal, turn = (
        np.array([[1.8, 0.3], [-0.1, 1.1]]),
        np.array([0.6, 0.8]),
        np.array([[0.8, -0.6], [0.6, 0.8]]),
    )
    speeds = homogeneous.wave_speeds(law, F, normal, 1.0)
    np.testing.assert_allclose(
        homogeneous.wave_speeds(law, turn @ F, normal, 1.0), speeds, rtol=1e-7
    )
    np.testing.assert_allclose(
        homogeneous.wave_speeds(law, F @ turn.T, turn @ normal, 1.0), speeds, rtol=1e-7
    )


def test_waves_that_do_not_exist_are_refused():
    """The Yeoh law with C20 close to its bound softens between stretches of 2 and 3 of pure
    shear.
    """
    law, F = NeoHookean(), np.diag([2.0, 1.0])
    with pytest.raises(
        ValueError, match=r"yeoh: unstable at F = .*: waves along \[1.0, 0.0\] would grow"
    ):
        homogeneous.wave_speeds(
            Yeoh(second=-0.17, third=0.01), np.diag([2.41, 1.0]), [1.0, 0.0], 1.0
        )
    with pytest.raises(ValueError, match="gent: no plane-stress state"):
        homogeneous.wave_speeds(Gent(1.0, 200.0, 10.0), np.diag([6.0, 6.0]), [1.0, 0.0], 1.0)
    for changes, message in (
        ({"plane": "shell"}, "plane must be stress or strain or space, not shell"),
        (
            {"plane": "space"},
            (
                r"F must have the shape \(3, 3\) and normal \(3,\) for plane = space, not \(2, 2\)"
                r" and \(2,\)"
            ),
        ),
        ({"F": np.diag([2.0, -1.0])}, "F must be finite with a positive determinant"),
        ({"F": np.diag([2.0, np.nan])}, "F must be finite with a positive determinant"),
        (
            {"normal": [0.0, 0.0]},
            r"normal must have a finite length other than 0, not \[0.0, 0.0\]",
        ),
        ({"density": 0.0}, "density must be positive and finite, not 0.0"),
    ):
        with pytest.raises(ValueError, match=message):
            homogeneous.wave_speeds(
                **({"law": law, "F": F, "normal": [1.0, 0.0], "density": 1.0} | changes)
            )
