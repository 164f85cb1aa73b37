"""The plane-stress energy density psi(tr C, det F) of a sheet, with C33 eliminated: exact for any
law, and learned by a network.

Both are functions compiled for blocks of states, with the arguments of a bond force; they compute
psi and its two derivatives, dimensionless, from the two invariants. By the envelope theorem the
derivatives at the C33 that solves P33 = 0 are those at fixed C33: 2 dpsi/dtr C = p and J dpsi/dJ =
q, the coefficients of R^T P = p U + q U^-1 (`pdsurrogate.materials.expressions`).
"""

from functools import cache

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows, put_column
from ..engine.compile import call_block, compile_bond_force
from .elementary import logarithm
from .network import GROUP, pack_units, unit_sums
from .node_state import solve_volume_ratios

INVARIANT_ROWS = 2
"""Number of rows of a block of states: tr C and J = det F, both in the plane."""

ENERGY_ROWS = 3
"""Number of rows of the result for a block: the energy density psi, dpsi/dtr C and dpsi/dJ."""


@cache
def analytic_energy_density(dtype):
    """Return the function, compiled for blocks of states, that computes the exact plane-stress
    energy density from the response of a law.

    The result is psi, dpsi/dtr C and dpsi/dJ; it is NaN where det F <= 0 or the law has no
    plane-stress state.
    """

    def energy_density(states, sizes, weights, response, parameters, work, scratch, result):
        condition = block_rows(scratch[0:3])
        found = block_rows(scratch[3:8])
        for k in range(BLOCK):
            put_column(condition, k, (np.float64(states[0, k]), np.float64(states[1, k]), 1.0))
        unsolved = solve_volume_ratios(
            BLOCK, condition, found, scratch[8], response, parameters, 1e-7
        )
        # The iteration ends with a step: evaluate once more at the state it led to, whose error is
        # below 1e-13.
        call_block(response, condition, parameters, found)
        for k in range(BLOCK):
            put_column(result, k, (found[4, k], 0.5 * found[0, k], found[1, k] / condition[1, k]))
        if unsolved > 0:
            for k in range(BLOCK):
                solved = condition[1, k] > 0.0 and abs(found[2, k]) <= 1e-5 * found[3, k]
                if not solved:
                    put_column(result, k, (np.nan, np.nan, np.nan))

    return compile_bond_force(energy_density, dtype, INVARIANT_ROWS, ENERGY_ROWS)


N_CONSTANTS = 2
"""Number of constants after the weights of the units: `constant` and `slope` of psi = (sum of
the units) - constant - slope log J.
"""

NETWORK_WORK_ROWS = 2
"""Number of rows of working memory that an energy network needs, one for each of its two
features.
"""


def pack_network(hidden_weights, hidden_biases, output_weights, dtype):
    """Pack an energy network of one hidden layer for `network_energy_density`: return its sizes and
    its weights in `dtype`.

    `hidden_weights` has a row for log J and a row for log(tr C/(2 J)); the constant and the slope
    are appended as zeros.
    """
    units = pack_units(hidden_weights, hidden_biases, output_weights)
    return np.array([units.size // GROUP]), np.append(units, np.zeros(N_CONSTANTS)).astype(dtype)


@cache
def network_energy_density(activation, dtype):
    """Return the function, compiled for blocks of states, that evaluates energy networks of one
    hidden layer with an activation.

    ``psi = sum of v a(w1 log J + w2 log(tr C/(2 J)) + b) - constant - slope log J``: the sum runs
    over the hidden units, with the activation a, input weights w1 and w2, bias b and output weight
    v of each. The function takes the number of hidden units and the weights as arguments. Both
    features vanish in the undeformed state, where the constant and the slope make psi and dpsi/dlog
    J vanish. The stress vanishes there, too, since its value 2 dpsi/dtr C + dpsi/dJ equals
    dpsi/dlog J.
    """
    add_units = unit_sums(activation)

    def energy_density(states, sizes, weights, response, parameters, work, scratch, result):
        units = sizes[0]
        last = GROUP * units
        features = block_rows(work[:NETWORK_WORK_ROWS])
        for k in range(BLOCK):
            J = states[1, k]
            features[0, k] = logarithm(J)
            features[1, k] = logarithm(states[0, k] / (J + J))
            result[0, k] = 0
            result[1, k] = 0
            result[2, k] = 0
        add_units(features, weights, units, result)
        constant = weights[last]
        slope = weights[last + 1]
        for k in range(BLOCK):
            by_log_J = result[1, k] - slope
            by_log_ratio = result[2, k]
            result[0, k] = result[0, k] - constant - slope * features[0, k]
            result[1, k] = by_log_ratio / states[0, k]
            result[2, k] = (by_log_J - by_log_ratio) / states[1, k]

    return compile_bond_force(energy_density, dtype, INVARIANT_ROWS, ENERGY_ROWS)
