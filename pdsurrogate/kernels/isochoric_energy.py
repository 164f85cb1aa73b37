"""The learnt isochoric energy W(I1bar, I2bar) as a response of the selective energy, the exact one taking over at the edge of its domain.

The block function has the rows of an exact isochoric response, and all that it needs stands in its parameters: so the pass over the pairs
is the same for both.  Outside are states in which a principal stretch is beyond its bounds L and H.  Of three stretches with product 1,
where L >= 1/H^2 and H <= 1/L^2, that is where one of

    (1 - s1/H^2) (1 - s2/H^2) (1 - s3/H^2),    (1 - L^2/s1) (1 - L^2/s2) (1 - L^2/s3),    s the squares of the stretches,

is negative, and both are linear in I1bar and I2bar.  They are called distances here: near an edge they are the relative ones in s.
"""

import numpy as np
from numba import carray

from ..engine.block_arrays import BLOCK, block_rows, put_column, rows_from, stack_rows
from ..engine.compile import call_block, widest_vectors
from ..engine.intrinsics import add_to, bits_of
from .elementary import logarithm, select
from .energy_density import GROUP
from .feature_sets import like

ROWS = 4
"""Rows of the result: p, q, r (in the plane the stress across it) and the energy, of W alone."""

UNITS, GUARD, EXACT, COUNTER, LOW, HIGH, BAND, AT_REST, WEIGHTS = 0, 1, 2, 3, 4, 7, 10, 11, 12
"""Places in the parameters: number of units, what is done outside, addresses of the exact response and of the count of states outside (as
bit patterns), the coefficients (1, I1bar, I2bar) of the two distances, the width of the band in which the exact energy takes over, what is
taken off the sum of the units, their weights, and after these the parameters of the exact response."""

MOST_PARAMETERS = 8192
"""More than there are; no state is read beyond the parameters of the law."""

EXTRAPOLATE, COUNT, TAKE_OVER = 0, 1, 2
"""Guards: nothing is done about states outside, they are counted, or counted and handed over to the exact energy."""


def distance_coefficients(low, high):
    """Coefficients of the two distances from the edges by (1, I1bar, I2bar), shape (2, 3); bounds of the stretches as they are."""
    low, high = max(low, high**-2), min(high, low**-2)
    a, b = low**2, high**2
    return np.array([[1 - a**3, a * a, -a], [1 - b**-3, -1 / b, b**-2]])


def take_over(distance, band):
    """Share that the exact energy has at a distance from an edge, and its derivative: 0 inside the band, 1 at the edge and beyond."""
    t = 1 - distance / band
    t = select(t > 0.0, t, 0.0)
    t = select(t < 1.0, t, 1.0)
    return t * t * t * (10 + t * (6 * t - 15)), -30 * t * t * (1 - t) * (1 - t) / band


def network_block(activation, take_over, invariants, of_invariants):
    """Builder of the block functions of networks: ``W = sum of v a(w1 log(I1bar/3) + w2 log(I2bar/3) + b) - constant``.

    They take rows of either precision.

    Both features vanish at rest, and the constant makes W vanish there; its stress does, as that of every function of isochoric invariants.

    Parameters
    ----------
    activation : callable
        One of `pdsurrogate.kernels.activations.SMOOTH`.
    take_over : callable
        `take_over`.
    invariants, of_invariants : callable
        Of an isochoric `pdsurrogate.materials.response.Response`.
    """

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
        for group in range(0, units, GROUP):
            w = parameters[WEIGHTS + 4 * group : WEIGHTS + 4 * (group + GROUP)]
            b0, b1, b2, b3 = like(one, w[0]), like(one, w[1]), like(one, w[2]), like(one, w[3])
            p0, p1, p2, p3 = like(one, w[4]), like(one, w[5]), like(one, w[6]), like(one, w[7])
            q0, q1, q2, q3 = like(one, w[8]), like(one, w[9]), like(one, w[10]), like(one, w[11])
            v0, v1, v2, v3 = like(one, w[12]), like(one, w[13]), like(one, w[14]), like(one, w[15])
            for k in range(BLOCK):
                u = rows[0, k]
                v = rows[1, k]
                a0, d0, _ = activation(b0 + p0 * u + q0 * v)
                a1, d1, _ = activation(b1 + p1 * u + q1 * v)
                a2, d2, _ = activation(b2 + p2 * u + q2 * v)
                a3, d3, _ = activation(b3 + p3 * u + q3 * v)
                d0 = v0 * d0
                d1 = v1 * d1
                d2 = v2 * d2
                d3 = v3 * d3
                sums[0, k] += v0 * a0 + v1 * a1 + v2 * a2 + v3 * a3
                sums[1, k] += p0 * d0 + p1 * d1 + p2 * d2 + p3 * d3
                sums[2, k] += q0 * d0 + q1 * d1 + q2 * d2 + q3 * d3
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
        # The exact energy, and what mixes the two, in double precision.
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
            a, da = take_over(low, parameters[BAND])
            b, db = take_over(high, parameters[BAND])
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
