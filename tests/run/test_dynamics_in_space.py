"""Explicit dynamics of bodies in space: what a free block keeps, what viscosity takes, and runs
that are killed.
"""

import numpy as np
import pytest
from bodies import nothing_held

from pdsurrogate.body import Body
from pdsurrogate.discretization.cells import lattice_of
from pdsurrogate.forces import FORCES, ForceSettings
from pdsurrogate.materials import NeoHookean
from pdsurrogate.results import measures

SPACING, LAW = 0.2, NeoHookean(1.0, 20.0)


def free_block(counts, velocities, viscosity=0.0, damping=0.0, safety=0.7):
    """A block of density 1 that nothing holds, with velocities given at its places."""
    axes = [(np.arange(count) + 0.5) * SPACING for count in counts]
    points = lattice_of(*axes)
    body = Body(points, np.full(len(points), SPACING**3), 1.75 * SPACING, SPACING)
    force = FORCES["bond-energy"]().bind(body, LAW, ForceSettings(plane="space"))
    integrator = nothing_held(
        force, body, velocities(points), damping=damping, viscosity=viscosity, safety=safety
    )
    integrator.center()
    return integrator


def thrown(points):
    """Translation, a spin about a skew axis of some 8 degrees per unit time, and stretching
    along x1.
    """
    arms = points - points.mean(axis=0)
    velocities = np.array([0.3, -0.2, 0.5]) + np.cross([0.1, 0.08, -0.06], arms)
    velocities[:, 0] += 0.2 * np.sin(np.pi * arms[:, 0] / np.ptp(points[:, 0]))
    return velocities


def energies(block):
    """Of motion and of strain, at the positions; their forces are found again, so that a next
    step is as it would have been.
    """
    kinetic = block.balance().leaving
    forces = np.empty_like(block.forces)
    block.force(block.positions, forces)
    return kinetic, measures.strain_energy(block.force)


def test_a_free_block_keeps_its_momenta_and_its_energy():
    """Over three swings of its length.

    Central differences keep both momenta to rounding, sum m y x v with the velocities of the half
    step after.  The energy is kept but for what is not linear within a step, of the second order in
    it: no drift, a ninth with a third of the step.
    """
    strayed = {}
    for safety, steps in ((0.6, 200), (0.2, 600)):
        block = free_block((6, 4, 3), thrown, safety=safety)
        mass = block.force.body.volumes[:, None]
        found = []
        for _ in range(steps):
            before = block.positions.copy()
            block.move()
            linear, angular = (
                (mass * block.velocities).sum(axis=0),
                (mass * np.cross(before, block.velocities)).sum(axis=0),
            )
            block.evaluate()
            found.append([*linear, *angular, sum(energies(block))])
        found = np.array(found)
        for start in (0, 3):
            momenta = found[:, start : start + 3]
            np.testing.assert_allclose(
                momenta,
                momenta[:1].repeat(len(momenta), axis=0),
                rtol=0,
                atol=1e-12 * np.abs(momenta).max(),
            )
        # Of the energy of the swing, which is what the translation and the spin do not have.
        swing = 0.5 * 0.2**2 * 0.5 * mass.sum()
        strayed[safety] = np.abs(found[:, 6] - found[0, 6]).max() / swing
        thirds = np.array_split(found[:, 6], 3)
        assert abs(thirds[2].mean() - thirds[0].mean()) < 0.3 * strayed[safety] * swing
    assert strayed[0.6] < 4e-3
    assert strayed[0.2] < 0.2 * strayed[0.6]


def test_viscosity_in_space_takes_short_waves_and_leaves_long_ones():
    """Of the first longitudinal mode of a bar exp(-tau omega^2 t) is left, of a checkerboard 1 %;
    what is gone is in the account.

    omega is pi over the length times the speed of a bar's waves, sqrt(E/rho): 6 % for the nonlocal
    bar, 10 points long.  The elastic forces that are followed from step to step are exact but for
    what is not linear: strains of a hundredth, of the second order in them.
    """
    viscosity, young = 0.02, 9 * 20.0 / 61
    omega = np.pi / (10 * SPACING) * np.sqrt(young)

    def long(points):
        return np.outer(np.cos(np.pi * points[:, 0] / (10 * SPACING)), [0.01, 0.0, 0.0])

    def short(points):
        return np.outer((-1.0) ** np.round(points / SPACING - 0.5).sum(axis=1), [0.01, 0.01, 0.01])

    left = {}
    for wave in (long, short):
        bar = free_block((10, 2, 2), wave, viscosity)
        start, taken = sum(energies(bar)), 0.0
        bar.find_elastic()
        power = bar.balance()
        steps = round(2 * np.pi / omega / bar.time_step)
        for _ in range(steps):
            bar.move()
            bar.evaluate()
            last, power = power, bar.balance()
            taken += 0.5 * bar.last_step * (last.taken_after + power.taken_before)
        left[wave] = sum(energies(bar))
        assert left[wave] + taken == pytest.approx(start, rel=1e-4)
        left[wave] /= start
    assert left[long] == pytest.approx(
        np.exp(-viscosity * omega**2 * steps * bar.time_step), rel=0.06
    )
    assert left[short] < 0.02
