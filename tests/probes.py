"""What forces must satisfy."""

import numpy as np
import pytest


def assert_forces_are_slopes_of_the_energy(force, positions, found, random, step):
    """Forces found at given positions against central differences of the energy along three
    random directions, to 1e-8.
    """
    out = np.empty_like(positions)
    for _ in range(3):
        direction = random.uniform(-1, 1, positions.shape)
        ends = []
        for sign in (1, -1):
            force(positions + sign * step * direction, out)
            ends.append(force.energy())
        assert (ends[1] - ends[0]) / (2 * step) == pytest.approx(
            (found * direction).sum(), abs=1e-8 * np.abs(found * direction).sum()
        )


def assert_dilatation_is_linearized(force, positions, random):
    """The linearized dilatation of a force in its present state against differences of volume
    ratios, and its transpose.
    """
    dilatation = force.linearized_dilatation()
    dilatation.linearize()
    moved, values, ratios = (
        random.standard_normal(positions.shape),
        random.standard_normal(len(positions)),
        [],
    )
    for sign in (1, -1):
        force.place(positions + sign * 1e-6 * moved)
        ratios.append(force.volume_ratios())
    change = dilatation.changes(moved)
    np.testing.assert_allclose(
        change, (ratios[0] - ratios[1]) / 2e-6, rtol=0, atol=1e-6 * np.abs(change).max()
    )
    assert np.vdot(dilatation.forces(values), moved) == pytest.approx(
        values @ change, abs=1e-6 * np.linalg.norm(values) * np.linalg.norm(change)
    )
