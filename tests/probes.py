"""Small compiled callers of block functions, and what every response must satisfy."""

import numba
import numpy as np
import pytest

from pdsurrogate.engine.block_arrays import BLOCK
from pdsurrogate.engine.compile import call_block
from pdsurrogate.materials import plane_stress


@numba.njit
def _call_response(address, states, parameters, result):
    call_block(address, states, parameters, result)


def compiled_response(law, *state, response=plane_stress.response):
    """A compiled response on vectors of any length, rows of its result."""
    n = len(state[0])
    columns = []
    for at in range(0, n, BLOCK):
        size = min(BLOCK, n - at)
        states = np.stack([np.pad(values[at : at + size], (0, BLOCK - size), "edge") for values in state])
        result = np.zeros((response.rows, BLOCK))
        _call_response(response.block(law).address, states, law.parameters, result)
        columns.append(result[:, :size])
    return np.concatenate(columns, axis=1)


def assert_stress_is_the_derivative_of_the_energy(response, law, F):
    """P of a response against central differences of its energy, over gradients of shape (n, d, d)."""
    P, h = response.first_piola_stress(law, F), 1e-5
    for i, j in np.ndindex(F.shape[1:]):
        step = np.zeros(F.shape[1:])
        step[i, j] = h
        numeric = (response.energy_density(law, F + step) - response.energy_density(law, F - step)) / (2 * h)
        # Central differences in double precision: error about h^2 |P''| + eps |Psi|/h.
        np.testing.assert_allclose(P[:, i, j], numeric, rtol=1e-6, atol=1e-6 * law.bulk_modulus)


def assert_forces_are_slopes_of_the_energy(force, positions, found, random, step):
    """Forces found at given positions against central differences of the energy along three random directions, to 1e-8."""
    out = np.empty_like(positions)
    for _ in range(3):
        direction = random.uniform(-1, 1, positions.shape)
        ends = []
        for sign in (1, -1):
            force(positions + sign * step * direction, out)
            ends.append(force.energy())
        assert (ends[1] - ends[0]) / (2 * step) == pytest.approx((found * direction).sum(), abs=1e-8 * np.abs(found * direction).sum())


def assert_dilatation_is_linearized(force, positions, random):
    """The linearized dilatation of a force in its present state against differences of volume ratios, and its transpose."""
    dilatation = force.linearized_dilatation()
    dilatation.take()
    moved, values, ratios = random.standard_normal(positions.shape), random.standard_normal(len(positions)), []
    for sign in (1, -1):
        force.place(positions + sign * 1e-6 * moved)
        ratios.append(force.volume_ratios())
    change = dilatation.changes(moved)
    np.testing.assert_allclose(change, (ratios[0] - ratios[1]) / 2e-6, rtol=0, atol=1e-6 * np.abs(change).max())
    assert np.vdot(dilatation.forces(values), moved) == pytest.approx(
        values @ change, abs=1e-6 * np.linalg.norm(values) * np.linalg.norm(change)
    )
