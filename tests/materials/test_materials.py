"""Laws, plane stress and exact solutions, each against something that does not share its code."""

import numpy as np
import pytest
from refusals import raising

from pdsurrogate.materials import LAWS, Gent, NeoHookean, homogeneous, plane_stress


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


def test_states_without_a_solution_are_refused():
    law = NeoHookean()
    with raising("det F must be positive"):
        plane_stress.volume_ratio(law, 2.0, -0.1)
    with raising("stretch must be positive"):
        homogeneous.biaxial(law, -1.0, 1.0)
    with raising(r"plane must be stress or strain .*, not space"):
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
