"""The plane-stress energy of a sheet, psi(tr C, det F) with C33 eliminated, as block functions: exact for any law, and learnt.

Both give psi and its two derivatives, dimensionless, from the two invariants. By the envelope theorem the derivatives at the C33 that
solves P33 = 0 are those at fixed C33: 2 dpsi/dtr C = p and J dpsi/dJ = q, the coefficients of R^T P = p U + q U^-1
(`pdsurrogate.materials.plane_stress`).
"""

from functools import cache

import numpy as np
from numba import carray

from ..engine.block_arrays import BLOCK, SCRATCH_ROWS, block_rows
from ..engine.compile import bond_force_signature, call_block, compile_block_function, expanded, inlined, widest_vectors
from .elementary import logarithm
from .feature_sets import like
from .node_state import solve_volume_ratios

INVARIANT_ROWS = 2
"""Rows of the states: tr C and J = det F, in the plane."""

ENERGY_ROWS = 3
"""Rows of the result: psi, dpsi/dtr C, dpsi/dJ."""

energy_density_signature = bond_force_signature
"""Signature ``energy_density(states, sizes, weights, response, parameters, work, scratch, result)``, with the arguments of a bond force."""


@cache
def analytic_energy_density(dtype):
    """Return the block function of the exact energy of any law; it gives NaN where det F <= 0 or the law has no plane-stress state."""

    def energy_density(states, sizes, weights, response, parameters, work, scratch, result):
        widest_vectors()
        states = carray(states, (INVARIANT_ROWS, BLOCK))
        result = carray(result, (ENERGY_ROWS, BLOCK))
        scratch = carray(scratch, (SCRATCH_ROWS, BLOCK))
        condition = block_rows(scratch[0:3])
        found = block_rows(scratch[3:8])
        for k in range(BLOCK):
            condition[0, k] = np.float64(states[0, k])
            condition[1, k] = np.float64(states[1, k])
            condition[2, k] = 1.0
        unsolved = solve_volume_ratios(BLOCK, condition, found, scratch[8], response, parameters, 1e-7)
        # The iteration ends with a step: evaluate once more at the state it led to, whose error is below 1e-13.
        call_block(response, condition, parameters, found)
        for k in range(BLOCK):
            result[0, k] = found[4, k]
            result[1, k] = 0.5 * found[0, k]
            result[2, k] = found[1, k] / condition[1, k]
        if unsolved > 0:
            for k in range(BLOCK):
                solved = condition[1, k] > 0.0 and abs(found[2, k]) <= 1e-5 * found[3, k]
                if not solved:
                    result[0, k] = np.nan
                    result[1, k] = np.nan
                    result[2, k] = np.nan

    return compile_block_function(energy_density, energy_density_signature(np.dtype(dtype)))


GROUP = 4
"""Units of a network that are evaluated together."""

N_UNITS = 0
"""Index of the number of units, a multiple of `GROUP`, in a network's sizes."""

N_CONSTANTS = 3
"""Number of constants after the weights: the constant and the slope of psi = sum - constant - slope log J, and the slope as subtracted from
dpsi/dlog J.
"""


def pack_network(hidden_weights, hidden_biases, output_weights, constant, slope, dtype):
    """Pack an energy network of one hidden layer for `network_energy_density`: return its sizes and its weights in `dtype`.

    `hidden_weights` has a row for log J and one for log(tr C/(2 J)); constant + slope log J is subtracted from the energy.
    """
    units = pack_units(hidden_weights, hidden_biases, output_weights)
    return np.array([units.size // 4]), np.concatenate([units, [constant, slope, slope]]).astype(dtype)


def pack_units(hidden_weights, hidden_biases, output_weights):
    """Return the weights of the hidden units as a vector, in groups of four: biases, weights of both features, output weights."""
    n = output_weights.size
    rows = np.zeros((4, -(-n // GROUP) * GROUP))
    rows[0, :n], rows[1, :n], rows[2, :n], rows[3, :n] = hidden_biases, hidden_weights[0], hidden_weights[1], output_weights
    return np.concatenate([rows[:, group : group + GROUP].ravel() for group in range(0, rows.shape[1], GROUP)])


def unit_sums(activation):
    """Return a function that adds a hidden layer of two features to the first row of sums, and its derivatives by them to the next two.

    ``sums[0] += sum of v a(b + p x + q u)`` over the units; `weights` begin with those of `pack_units`.
    """
    activate = inlined(activation)

    @expanded
    def add_units(features, weights, units, sums):
        one = like(sums[0, 0], 1.0)
        for group in range(0, units, GROUP):
            w = weights[4 * group : 4 * (group + GROUP)]
            b0, b1, b2, b3 = like(one, w[0]), like(one, w[1]), like(one, w[2]), like(one, w[3])
            p0, p1, p2, p3 = like(one, w[4]), like(one, w[5]), like(one, w[6]), like(one, w[7])
            q0, q1, q2, q3 = like(one, w[8]), like(one, w[9]), like(one, w[10]), like(one, w[11])
            v0, v1, v2, v3 = like(one, w[12]), like(one, w[13]), like(one, w[14]), like(one, w[15])
            for k in range(BLOCK):
                x = features[0, k]
                u = features[1, k]
                a0, d0, _ = activate(b0 + p0 * x + q0 * u)
                a1, d1, _ = activate(b1 + p1 * x + q1 * u)
                a2, d2, _ = activate(b2 + p2 * x + q2 * u)
                a3, d3, _ = activate(b3 + p3 * x + q3 * u)
                d0 = v0 * d0
                d1 = v1 * d1
                d2 = v2 * d2
                d3 = v3 * d3
                sums[0, k] += v0 * a0 + v1 * a1 + v2 * a2 + v3 * a3
                sums[1, k] += p0 * d0 + p1 * d1 + p2 * d2 + p3 * d3
                sums[2, k] += q0 * d0 + q1 * d1 + q2 * d2 + q3 * d3

    return add_units


@cache
def network_energy_density(activation, dtype):
    """Return the block function of energy networks with an activation; number of units and weights are arguments of it.

    ``psi = sum of v a(w1 log J + w2 log(tr C/(2 J)) + b) - constant - slope log J``. Both features vanish at rest, where the constants make
    psi and dpsi/dlog J vanish, and with them the stress: 2 dpsi/dtr C + dpsi/dJ = dpsi/dlog J there.
    """
    add_units = unit_sums(activation)

    def energy_density(states, sizes, weights, response, parameters, work, scratch, result):
        widest_vectors()
        states = carray(states, (INVARIANT_ROWS, BLOCK))
        result = carray(result, (ENERGY_ROWS, BLOCK))
        sizes = carray(sizes, (1,))
        units = sizes[N_UNITS]
        weights = carray(weights, (4 * units + N_CONSTANTS,))
        features = carray(work, (2, BLOCK))
        for k in range(BLOCK):
            J = states[1, k]
            features[0, k] = logarithm(J)
            features[1, k] = logarithm(states[0, k] / (J + J))
            result[0, k] = 0
            result[1, k] = 0
            result[2, k] = 0
        add_units(features, weights, units, result)
        constant = weights[4 * units]
        slope = weights[4 * units + 1]
        slope_taken_off = weights[4 * units + 2]
        for k in range(BLOCK):
            result[0, k] = result[0, k] - constant - slope * features[0, k]
            by_log_J = result[1, k] - slope_taken_off
            by_log_ratio = result[2, k]
            result[1, k] = by_log_ratio / states[0, k]
            result[2, k] = (by_log_J - by_log_ratio) / states[1, k]

    return compile_block_function(energy_density, energy_density_signature(np.dtype(dtype)))


NETWORK_WORK_ROWS = 2
