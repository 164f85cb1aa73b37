"""The learnt isochoric energy W(I1bar, I2bar) as a response of the selective energy, blended into the exact one at the edge of its domain.

The block function has the rows of an exact isochoric response and reads all its data from `parameters`, so the pass over the pairs is the
same for both. A state is outside if a principal stretch is beyond its bounds L and H. Of three stretches with product 1, where L >= 1/H^2
and H <= 1/L^2, that is the case if one of

    (1 - s1/H^2) (1 - s2/H^2) (1 - s3/H^2),    (1 - L^2/s1) (1 - L^2/s2) (1 - L^2/s3),    s the squared stretches,

is negative. Both are linear in I1bar and I2bar; the code calls them distances, since near an edge they are the relative distances in s.
"""

import numpy as np
from numba import carray

from ..engine.block_arrays import BLOCK, block_rows, put_column, rows_from, stack_rows
from ..engine.compile import call_block, widest_vectors
from ..engine.intrinsics import add_to, bits_of
from .domain import exact_share_at
from .elementary import logarithm, select
from .energy_density import unit_sums
from .feature_sets import like

ROWS = 4
"""Rows of the result: p, q, r (r is the stress across the plane of a sheet) and the energy W."""

UNITS, GUARD, EXACT, COUNTER, LOW, HIGH, BAND, AT_REST, WEIGHTS = 0, 1, 2, 3, 4, 7, 10, 11, 12
"""Places in the parameters: number of units, guard, addresses of the exact response and of the counter of states outside (as bit patterns),
the coefficients (1, I1bar, I2bar) of the two distances, the width of the blending band, the value at rest, the weights of the units, and
after these the parameters of the exact response.
"""

MOST_PARAMETERS = 8192
"""Length of the array view of the parameters, an upper bound for all models; nothing beyond the law's parameters is read."""

EXTRAPOLATE, COUNT, TAKE_OVER = 0, 1, 2
"""Guards for states outside the domain: nothing is done, they are counted, or they are counted and the exact energy replaces the learnt
one.
"""


def network_block(activation, invariants, of_invariants):
    """Build the block function of a network: ``W = sum of v a(w1 log(I1bar/3) + w2 log(I2bar/3) + b) - constant``.

    It serves rows of either precision. Both features vanish at rest, and the constant makes W vanish there; the stress vanishes as for
    every function of isochoric invariants.
    """
    add_units = unit_sums(activation)

    def response(states, parameters, result):
        widest_vectors()
        states = carray(states, (3, BLOCK))
        result = carray(result, (ROWS, BLOCK))
        parameters = carray(parameters, (MOST_PARAMETERS,))
        units = np.int64(parameters[UNITS])
        guard = parameters[GUARD]
        one = like(states[0, 0], 1.0)
        zero = like(one, 0.0)
        third = like(one, 1.0 / 3.0)
        at_rest = like(one, parameters[AT_REST])
        rows = block_rows(stack_rows(5, one))
        sums = rows_from(rows, 2)
        for k in range(BLOCK):
            I1, I2 = invariants((states[0, k], states[1, k], states[2, k]))
            rows[0, k] = logarithm(I1 * third)
            rows[1, k] = logarithm(I2 * third)
            sums[0, k] = -at_rest
            sums[1, k] = zero
            sums[2, k] = zero
        add_units(rows, parameters[WEIGHTS:], units, sums)
        l0, l1, l2 = like(one, parameters[LOW]), like(one, parameters[LOW + 1]), like(one, parameters[LOW + 2])
        h0, h1, h2 = like(one, parameters[HIGH]), like(one, parameters[HIGH + 1]), like(one, parameters[HIGH + 2])
        band = like(one, parameters[BAND])
        near = 0
        outside = 0
        for k in range(BLOCK):
            state = states[0, k], states[1, k], states[2, k]
            I1, I2 = invariants(state)
            low = l0 + l1 * I1 + l2 * I2
            high = h0 + h1 * I1 + h2 * I2
            least = min(low, high)
            near += 1 if least < band else 0
            outside += 1 if least < zero else 0
            learnt = sums[0, k], sums[1, k] / I1, sums[2, k] / I2, zero, zero, zero
            p, q, r, W = of_invariants(state, learnt, (zero, zero, zero))
            put_column(result, k, (like(one, p), like(one, q), like(one, r), like(one, W)))
        if guard == EXTRAPOLATE or near == 0:
            return
        if outside > 0:
            add_to(bits_of(parameters[COUNTER]), outside)
        if guard != TAKE_OVER:
            return
        # The exact energy and the blend are computed in double precision.
        doubles = block_rows(stack_rows(7, 1.0))
        exact = rows_from(doubles, 3)
        for k in range(BLOCK):
            put_column(doubles, k, (np.float64(states[0, k]), np.float64(states[1, k]), np.float64(states[2, k])))
        call_block(bits_of(parameters[EXACT]), doubles, parameters[WEIGHTS + 4 * units :], exact)
        for k in range(BLOCK):
            state = doubles[0, k], doubles[1, k], doubles[2, k]
            I1, I2 = invariants(state)
            low = parameters[LOW] + parameters[LOW + 1] * I1 + parameters[LOW + 2] * I2
            high = parameters[HIGH] + parameters[HIGH + 1] * I1 + parameters[HIGH + 2] * I2
            a, da = exact_share_at(low, parameters[BAND])
            b, db = exact_share_at(high, parameters[BAND])
            # W + s (exact - W), s = 1 - (1 - a) (1 - b): what s changes is a function of the invariants like W.
            rest = (1.0 - a) * (1.0 - b)
            da = da * (1.0 - b)
            db = db * (1.0 - a)
            more = exact[3, k] - result[3, k]
            by_1 = more * (parameters[LOW + 1] * da + parameters[HIGH + 1] * db)
            by_2 = more * (parameters[LOW + 2] * da + parameters[HIGH + 2] * db)
            p, q, r, _ = of_invariants(state, (0.0, by_1, by_2, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
            inside = rest > 0.0
            p = select(inside, rest * result[0, k] + p, 0.0) + select(rest < 1.0, (1.0 - rest) * exact[0, k], 0.0)
            q = select(inside, rest * result[1, k] + q, 0.0) + select(rest < 1.0, (1.0 - rest) * exact[1, k], 0.0)
            r = select(inside, rest * result[2, k] + r, 0.0) + select(rest < 1.0, (1.0 - rest) * exact[2, k], 0.0)
            W = select(inside, rest * result[3, k], 0.0) + select(rest < 1.0, (1.0 - rest) * exact[3, k], 0.0)
            put_column(result, k, (like(one, p), like(one, q), like(one, r), like(one, W)))

    return response
