"""What forces must satisfy."""

import numpy as np
import pytest

from pdsurrogate.testing.subject import forces_at


def fourth_order(function, step):
    """Derivative at zero by central differences of fourth order."""
    return (8 * (function(step) - function(-step)) - (function(2 * step) - function(-2 * step))) / (
        12 * step
    )


def assert_slope(force, positions, directions, step=2e-5, tolerance=1e-7):
    """Forces against the slopes of the energy along directions by differences of fourth order, to
    a part of the greatest force; return the forces.
    """
    out = forces_at(force, positions)
    for direction in directions:

        def energy(way, direction=direction):
            forces_at(force, positions + way * direction)
            return force.energy()

        scale = np.abs(out).max() * np.linalg.norm(direction)
        assert abs((out * direction).sum() + fourth_order(energy, step)) < tolerance * scale
    return out


def directions_of(random, body, number, targets):
    """So many random directions, and some that move the single points nearest to targets."""
    found = [random.standard_normal(body.points.shape) for _ in range(number)]
    for target in targets:
        single = np.zeros_like(body.points)
        nearest = np.linalg.norm(body.points - target, axis=1).argmin()
        single[nearest] = [0.6, 0.8] if body.dimension == 2 else [0.6, 0.48, 0.64]
        found.append(single)
    return found


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
