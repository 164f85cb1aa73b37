"""Branches and softening in sheets under plane stress: learned energies, and single pairs."""

import numpy as np
import pytest
from test_pair_memory import check_gradient, evaluate

import pdsurrogate as pds
from pdsurrogate.forces.internal_force import stored_by
from pdsurrogate.materials import Branch, Gent, Memory, NeoHookean, Ogden, Softening
from pdsurrogate.testing.bodies import lattice, of_points

MEMORY = Memory((Branch(2.0, 1.0), Branch(0.5, 20.0)), Softening(1.6, 0.1, 0.2))
HOMOGENEOUS = [[1.4, 0.2], [-0.1, 0.8]]


def bound(name, memory, sides=(0.6, 0.5), precision="float64"):
    body = of_points(lattice(*sides))
    law = NeoHookean(shear_modulus=2.0, bulk_modulus=200.0, memory=memory)
    return pds.load_surrogate(name).bind(body, law, pds.ForceSettings(precision=precision))


def after_a_step(force, wild=0.01):
    """Return the positions after a step from an accepted state."""
    rng = np.random.default_rng(3)
    points = force.body.points
    for F in (np.diag([1.8, 0.9]), np.array(HOMOGENEOUS)):
        positions = points @ F.T + wild * rng.normal(size=points.shape)
        force.elapse(0.4)
        out = evaluate(force, positions)
        if F[0, 0] == 1.8:
            force.accept(positions)
    return positions, out


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_learned_energies_get_the_difference_of_the_exact_law(precision):
    found = {}
    for name in ("neo-hookean-energy", "bond-energy"):
        for memory in (MEMORY, Memory()):
            force = bound(name, memory, (3.0, 1.0), precision)  # of several blocks and chunks
            _, out = after_a_step(force)
            energies = np.array([force.energy(), stored_by(force)])
            found[name, bool(memory)] = out, energies, *force.stress_and_energy()
    rounding = 1e-4 if precision == "float32" else 1e-11
    for learned, exact, elastic, law in zip(
        *(
            found[name, memory]
            for memory in (True, False)
            for name in ("neo-hookean-energy", "bond-energy")
        ),
        strict=True,
    ):
        np.testing.assert_allclose(learned - elastic, exact - law, atol=rounding)


@pytest.mark.parametrize("name", ["neo-hookean-energy", "bond-energy"])
def test_stress_of_points_is_that_of_bonds(name):
    force = bound(name, MEMORY)
    after_a_step(force, wild=0.0)
    stress, _ = force.stress_and_energy()
    expected = np.zeros((3, 3))
    expected[:2, :2] = force.mean_stress()
    np.testing.assert_allclose(stress, np.broadcast_to(expected, stress.shape), atol=1e-11)


@pytest.mark.parametrize("softening", [None, MEMORY.softening])
@pytest.mark.parametrize("kind", [Gent, Ogden])
def test_forces_of_every_law_are_the_derivative_of_their_energy(kind, softening):
    memory = Memory(MEMORY.branches, softening)
    body = of_points(lattice(0.6, 0.5))
    law = kind(bulk_modulus=20.0, memory=memory)
    force = pds.BondEnergyForce().bind(body, law, pds.ForceSettings(precision="float64"))
    positions, _ = after_a_step(force)
    check_gradient(force, positions)


@pytest.mark.parametrize("stretch", [1.3, 20.0])
def test_learned_forces_are_the_derivative_of_their_energy(stretch):
    """Within the domain, and outside of it, where the exact energy takes over."""
    force = bound("neo-hookean-energy", MEMORY)
    positions, _ = after_a_step(force)
    check_gradient(force, positions * [stretch / 1.3, 1.0])


@pytest.mark.parametrize("softening", [None, MEMORY.softening])
def test_thickness_of_a_pair_depends_on_no_other(softening):
    """Pairs of a block of which one is far from rest take as many steps as if it were not."""
    force = bound("bond-energy", Memory(MEMORY.branches, softening), sides=(2.0, 0.3))
    positions, _ = after_a_step(force)
    moved = positions.copy()
    moved[np.argmax(positions[:, 0])] += 0.03
    n = len(positions)
    far = np.flatnonzero(
        (force.body.bonds.second < n) & (force.body.points[:, 0][force.body.bonds.first] < 1.0)
    )
    found = []
    for each in (positions, moved):
        evaluate(force, each)
        found.append(force.pair_forces(far))
    assert np.array_equal(*found)


def test_threads_share_no_working_memory():
    force = bound("neo-hookean-energy", MEMORY, sides=(5.0, 5.0))
    positions, out = after_a_step(force)
    for _ in range(5):
        assert np.array_equal(evaluate(force, positions), out)
