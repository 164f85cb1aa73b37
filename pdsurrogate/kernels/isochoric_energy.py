"""Learned isochoric energy W(I1bar, I2bar), blended into the exact energy of the law at the edge of
its domain.

The compiled function has the arguments and result rows of an exact isochoric response. A state is
outside if a principal stretch is beyond the bounds L and H. Of three stretches with product 1,
where L >= 1/H^2 and H <= 1/L^2, that is the case if one of

    (1 - s1/H^2) (1 - s2/H^2) (1 - s3/H^2),    (1 - L^2/s1) (1 - L^2/s2) (1 - L^2/s3),    s the
    squared stretches,

is negative. Both are linear in I1bar and I2bar; the code calls them distances, since near an edge
they are the relative distances in s.
"""

import numpy as np
from numba import carray

from ..engine.block_arrays import (
    BLOCK,
    add_to,
    block_rows,
    put_column,
    rows_from,
    stack_rows,
    tuple_of,
)
from ..engine.compile import call_block, widest_vectors
from .algebra import entries
from .domain import BLEND, exact_share_at
from .elementary import like, logarithm, select
from .network import GROUP, unit_sums

ROWS = 4
"""Number of rows of the result: the coefficients p, q, r of the stress (for a sheet r is the
stress across its plane) and the energy W.
"""

UNITS = 0
GUARD = 1
OUTSIDE = 2
"""Indices in the array ``sizes`` of a learned energy: its number of hidden units, its guard
(`EXTRAPOLATE`, `COUNT` or `TAKE_OVER`), and the counter of the states found outside the domain.
"""

N_SIZES = 3

AT_REST = 6
FIRST_UNIT = 7
"""Indices in the array ``weights`` of a learned energy, after the three coefficients (of 1, I1bar,
I2bar) of each of the two distances: the value of the network in the undeformed state, and the first
of the weights of the hidden units.
"""

EXTRAPOLATE = 0
COUNT = 1
TAKE_OVER = 2
"""Guards for states outside the domain: nothing is done, they are counted, or they are counted and
the exact energy replaces the learned one.
"""


in_precision = entries("x, bounds", [f"like(x, bounds[{n}])" for n in range(AT_REST)])
distances = entries("b, I1, I2", ["b[0] + b[1] * I1 + b[2] * I2", "b[3] + b[4] * I1 + b[5] * I2"])


def network_block(activation, invariants, of_invariants):
    """Build the function for blocks of states of a network: ``W = sum of v a(w1 log(I1bar/3) + w2
    log(I2bar/3) + b) - constant``.

    The sum runs over the hidden units, with the `activation` a, input weights w1 and w2, bias b and
    output weight v of each. `invariants` computes (I1bar, I2bar) from a state, and `of_invariants`
    the rows of the result from W and its derivatives by these invariants. The function accepts
    states and results of either precision. Both features vanish in the undeformed state, and the
    constant makes W vanish there. The stress vanishes there for any W, since the undeformed state
    is a stationary point of both invariants.
    """
    add_units = unit_sums(activation)

    def energy(states, sizes, weights, response, parameters, result):
        widest_vectors()
        states = carray(states, (3, BLOCK))
        result = carray(result, (ROWS, BLOCK))
        sizes = carray(sizes, (N_SIZES,))
        units = sizes[UNITS]
        guard = sizes[GUARD]
        weights = carray(weights, (FIRST_UNIT + GROUP * units,))
        one = like(states[0, 0], 1.0)
        zero = like(one, 0.0)
        third = like(one, 1.0 / 3.0)
        at_rest = like(one, weights[AT_REST])
        rows = block_rows(stack_rows(5, one))
        sums = rows_from(rows, 2)
        for k in range(BLOCK):
            I1, I2 = invariants((states[0, k], states[1, k], states[2, k]))
            rows[0, k] = logarithm(I1 * third)
            rows[1, k] = logarithm(I2 * third)
            sums[0, k] = -at_rest
            sums[1, k] = zero
            sums[2, k] = zero
        add_units(rows, weights[FIRST_UNIT:], units, sums)
        bounds = tuple_of(weights, AT_REST)
        single = in_precision(one, bounds)
        band = like(one, BLEND)
        near = 0
        outside = 0
        for k in range(BLOCK):
            state = states[0, k], states[1, k], states[2, k]
            I1, I2 = invariants(state)
            least = min(*distances(single, I1, I2))
            near += 1 if least < band else 0
            outside += 1 if least < zero else 0
            learned = sums[0, k], sums[1, k] / I1, sums[2, k] / I2, zero, zero, zero
            p, q, r, W = of_invariants(state, learned, (zero, zero, zero))
            put_column(result, k, (like(one, p), like(one, q), like(one, r), like(one, W)))
        if guard == EXTRAPOLATE or near == 0:
            return
        if outside > 0:
            add_to(sizes, OUTSIDE, outside)
        if guard != TAKE_OVER:
            return
        # The exact energy and the blend are computed in double precision.
        doubles = block_rows(stack_rows(7, 1.0))
        exact = rows_from(doubles, 3)
        for k in range(BLOCK):
            put_column(
                doubles,
                k,
                (np.float64(states[0, k]), np.float64(states[1, k]), np.float64(states[2, k])),
            )
        call_block(response, doubles, parameters, exact)
        for k in range(BLOCK):
            state = doubles[0, k], doubles[1, k], doubles[2, k]
            I1, I2 = invariants(state)
            low, high = distances(bounds, I1, I2)
            a, da = exact_share_at(low)
            b, db = exact_share_at(high)
            # W + s (exact - W), s = 1 - (1 - a) (1 - b): the blended energy is a function of the
            # invariants like W.
            rest = (1.0 - a) * (1.0 - b)
            da = da * (1.0 - b)
            db = db * (1.0 - a)
            more = exact[3, k] - result[3, k]
            by_1 = more * (bounds[1] * da + bounds[4] * db)
            by_2 = more * (bounds[2] * da + bounds[5] * db)
            p, q, r, _ = of_invariants(state, (0.0, by_1, by_2, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
            added = p, q, r, 0.0
            for row in range(ROWS):
                learned = select(rest > 0.0, rest * result[row, k] + added[row], 0.0)
                result[row, k] = learned + select(rest < 1.0, (1.0 - rest) * exact[row, k], 0.0)

    return energy
