"""Branches and softening in sheets under plane stress: laws, and single pairs."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import raising
from test_pair_memory import check_gradient

import pdsurrogate as pds
from pdsurrogate.engine.threads import thread_count
from pdsurrogate.materials import Branch, Gent, Memory, NeoHookean, Ogden, Softening
from pdsurrogate.testing.bodies import lattice, of_points
from pdsurrogate.testing.subject import forces_at

MEMORY = Memory((Branch(2.0, 1.0), Branch(0.5, 20.0)), Softening(1.6, 0.1, 0.2))
HOMOGENEOUS = [[1.4, 0.2], [-0.1, 0.8]]


LAW = NeoHookean(shear_modulus=2.0, bulk_modulus=200.0, memory=MEMORY)


def bound(memory, sides=(0.6, 0.5)):
    body, law = of_points(lattice(*sides)), replace(LAW, memory=memory)
    return pds.BondEnergyForce().bind(body, law, pds.ForceSettings(precision="float64"))


def test_learned_energies_of_sheets_have_no_memory():
    """The exact energy with memory takes less time than a learned one and what memory adds."""
    body = of_points(lattice(0.6, 0.5))
    with raising("plane=stress; use force=bond-energy"):
        pds.load_surrogate("neo-hookean-energy").bind(body, LAW, pds.ForceSettings())
    scene = pds.Scene(
        name="sheet",
        spacing=0.25,
        body={"shape": "rectangle", "size": [1.0, 1.0]},
        material=LAW,
        grips=[{"edge": "left"}, {"edge": "right", "travel": 1.0}],
        stretches=[1.2],
        times=[1.0],
    )
    with pytest.warns(UserWarning, match="the exact energy of its material is used"):
        assert pds.simulate(scene, "neo-hookean-energy").summary["force"] == "bond-energy"


def after_a_step(force, wild=0.01):
    """Return the positions after a step from an accepted state."""
    rng = np.random.default_rng(3)
    points = force.body.points
    for F in (np.diag([1.8, 0.9]), np.array(HOMOGENEOUS)):
        positions = points @ F.T + wild * rng.normal(size=points.shape)
        force.elapse(0.4)
        out = forces_at(force, positions)
        if F[0, 0] == 1.8:
            force.accept(positions)
    return positions, out


def test_stress_of_points_is_that_of_bonds():
    force = bound(MEMORY)
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


@pytest.mark.parametrize("softening", [None, MEMORY.softening])
def test_thickness_of_a_pair_depends_on_no_other(softening):
    """Pairs of a block of which one is far from rest take as many steps as if it were not."""
    force = bound(Memory(MEMORY.branches, softening), sides=(2.0, 0.3))
    positions, _ = after_a_step(force)
    moved = positions.copy()
    moved[np.argmax(positions[:, 0])] += 0.03
    n = len(positions)
    far = np.flatnonzero(
        (force.body.bonds.second < n) & (force.body.points[:, 0][force.body.bonds.first] < 1.0)
    )
    found = []
    for each in (positions, moved):
        forces_at(force, each)
        found.append(force.pair_forces(far))
    assert np.array_equal(*found)


def test_threads_share_no_working_memory():
    with thread_count(2):
        force = bound(MEMORY, sides=(5.0, 5.0))
    positions, out = after_a_step(force)
    for _ in range(5):
        assert np.array_equal(forces_at(force, positions), out)
