"""Strengths of two numbers: uniform states break on the surface of Drucker and Prager, discs have
the factor of its field, and numbers that no surface has are refused.
"""

import numpy as np
import pytest
import scipy
from described import SCENES
from refusals import raising
from runs import started

import pdsurrogate as pds
from pdsurrogate.materials import PLANES, homogeneous
from pdsurrogate.problem.strength import least_trace_of
from pdsurrogate.problem.strength_surface import surface_of
from pdsurrogate.problem.tip_factor import factor_of
from pdsurrogate.scenes.strength import Strength

LAW = pds.materials.NeoHookean(0.52, 86.0)
EQUIBIAXIAL = 0.9 / 3.3
"""Of these two numbers: 3 s_h s_t / (3 s_h + s_t)."""

SHEET = SCENES["sheet with two strengths"]
"""Sheet beside two planes of symmetry, so that it follows any stretches of its sides."""

BLOCK = SCENES["block with two strengths"]


def stretch_at(stress_at, stress):
    """The stretch at which a nominal stress of the law is reached."""
    return scipy.optimize.brentq(lambda one: stress_at(one) - stress, 1 + 1e-9, 2.0)


def uniaxial(stress):
    stretch = stretch_at(lambda one: homogeneous.uniaxial(LAW, one).nominal_stress, stress)
    state = homogeneous.uniaxial(LAW, stretch)
    return state.stretch, state.lateral_stretch, state.thickness_stretch


def equibiaxial(stress):
    stretch = stretch_at(lambda one: homogeneous.equibiaxial(LAW, one).nominal_stress, stress)
    return stretch, stretch, homogeneous.equibiaxial(LAW, stretch).thickness_stretch


def hydrostatic(stress):
    def of(stretch):
        return PLANES["space"].first_piola_stress(LAW, stretch * np.eye(3))[0, 0]

    return 3 * (stretch_at(of, stress),)


STATES = [
    (uniaxial, 0.3, "sheet"),
    (uniaxial, 0.3, "block"),
    (equibiaxial, EQUIBIAXIAL, "sheet"),
    (equibiaxial, EQUIBIAXIAL, "block"),
    (hydrostatic, 1.0, "block"),
]


@pytest.mark.parametrize(("state", "strength", "body"), STATES)
def test_uniform_states_break_at_the_given_numbers(state, strength, body):
    """No bond breaks at 0.99 of the nominal stress of the state, and some do at 1.01."""
    run = started(pds.Scene.model_validate(SHEET | (BLOCK if body == "block" else {})))
    for factor in (0.99, 1.01):
        run.force.place(run.body.points * state(factor * strength)[: run.body.dimension])
        failing = run.damage.failing(run.force)
        assert failing.by_strength.all()
        assert bool(len(failing.pairs)) == (factor > 1)
    told = run.problem.strengths.summary[0]
    np.testing.assert_allclose((told["equibiaxial"], told["hydrostatic"]), (EQUIBIAXIAL, 1.0))


def test_plane_strain_breaks_on_the_surface():
    """Equal stretches in the plane, far from the state of equal energy in uniaxial tension: the
    three stresses are those of the law.
    """
    run = started(pds.Scene.model_validate(SHEET | {"plane": "strain"}))

    def load(stretch):
        stress = np.diag(PLANES["space"].first_piola_stress(LAW, np.diag([stretch, stretch, 1.0])))
        mises = np.sqrt(1.5 * np.square(stress - stress.mean()).sum())
        return 0.9 * mises + 0.1 * stress.sum()

    stretch = stretch_at(load, 0.3)
    assert homogeneous.biaxial(LAW, stretch, stretch, "strain").energy_density < 0.5 * (
        run.problem.strengths.zones[0].work
    )
    for factor in (0.98, 1.02):
        run.force.place(run.body.points * (1 + factor * (stretch - 1)))
        assert bool(len(run.damage.failing(run.force).pairs)) == (factor > 1)


def test_equal_strengths_are_those_of_mises():
    """An equibiaxial strength as great as the uniaxial one has Mises' surface, of small strains
    that of the energy of an incompressible material, with its factors around a tip.
    """
    soft = pds.materials.NeoHookean(1.0, 1e5)
    stress = homogeneous.uniaxial(soft, 1.01).nominal_stress
    surface = surface_of(soft, 1.01, Strength(stretch=1.01, equibiaxial=stress))
    assert surface.hydrostatic is None
    for plane in ("stress", "strain"):
        given = soft, 1.0001, plane
        np.testing.assert_allclose(factor_of(*given, surface), factor_of(*given), rtol=1e-4)
    F = np.array([np.diag([1.004, 0.999]), np.diag([1.002, 1.003])])
    J3 = PLANES["stress"].volume_ratio(soft, np.square(F).sum((1, 2)), F[:, 0, 0] * F[:, 1, 1])
    energy = PLANES["stress"].energy_at(soft, F, J3)
    np.testing.assert_allclose(surface.energy(soft, "stress", F, J3), energy, rtol=0.01)
    work = energy[0]
    np.testing.assert_allclose(
        least_trace_of(soft, work, surface), least_trace_of(soft, work), rtol=1e-6
    )


def test_energies_of_uniaxial_tension_are_those_of_the_law():
    """Also beyond the break, near the limit of chains; turned states are the same."""
    law = pds.materials.LAWS["gent"](shear_modulus=0.5, bulk_modulus=50.0, chain_limit=10.0)
    surface = surface_of(law, 2.5, Strength(stretch=2.5, hydrostatic=2.0))
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    for stretch in (1.02, 1.4, 2.5, 3.2):
        state = homogeneous.uniaxial(law, stretch)
        F = turn @ np.diag([state.lateral_stretch, stretch])
        found = surface.energy(law, "stress", F[None], np.array([state.volume_ratio]))
        np.testing.assert_allclose(found, state.energy_density, rtol=1e-3)


REFUSED = [
    ({"hydrostatic": 0.09}, "greater than a third of .* 0.1, not 0.09"),
    ({"equibiaxial": 0.14}, "0.15 to 0.3, not 0.14"),
    ({"equibiaxial": 0.31}, "pressure would break the material"),
    ({"hydrostatic": 1e9}, "reaches .* at most in equal tension .*; a greater bulk modulus"),
    ({"hydrostatic": 1.0, "equibiaxial": 0.27}, "not both: the surface has two numbers"),
]


@pytest.mark.parametrize(("second", "told"), REFUSED)
def test_numbers_that_no_surface_has_are_refused(second, told):
    fracture = {"energy": 0.041, "strength": {"uniaxial": 0.3, **second}}
    with raising(rf"strength: .*{told}", pds.SceneError):
        started(pds.Scene.model_validate(SHEET | {"fracture": fracture}))


def test_materials_and_interfaces_have_their_own_surfaces():
    """Of two halves of one law under equibiaxial tension the one of the smaller second number
    breaks; an interface has its own surface as well.
    """
    weak = {"energy": 0.041, "strength": {"uniaxial": 0.3, "equibiaxial": 0.2}}
    part = {"region": "upper", "material": LAW.describe(), "fracture": weak}
    data = SHEET | {"regions": {"upper": {"box": [[-1, 0.4], [5, 2]]}}, "materials": [part]}
    run = started(pds.Scene.model_validate(data))
    run.force.place(run.body.points * equibiaxial(0.21)[:2])
    found = run.damage.failing(run.force).pairs
    assert len(found)
    assert (run.body.all_points[run.body.bonds.first[found], 1] > 0.4).all()
    between = {"between": ["rest", "upper"], **weak}
    data["materials"] = [part | {"fracture": SHEET["fracture"]}]
    data["fracture"] = SHEET["fracture"] | {"interfaces": [between]}
    run = started(pds.Scene.model_validate(data))
    for stress in (0.19, 0.21):
        run.force.place(run.body.points * equibiaxial(stress)[:2])
        found = run.damage.failing(run.force).pairs
        assert bool(len(found)) == (stress > 0.2)
    heights = run.body.all_points[:, 1] > 0.4
    assert (heights[run.body.bonds.first[found]] != heights[run.body.bonds.second[found]]).all()
