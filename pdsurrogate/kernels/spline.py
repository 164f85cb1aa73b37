"""Bond forces as tensor-product cubic splines of two or three features, compiled for blocks of
bonds.

Knots are equidistant, so that one multiplication finds the cell of a state; the function and its
first two derivatives are continuous. Beyond the box of the knots the spline has the value of the
nearest place in the box, and the box's lower end replaces a feature that is NaN.
"""

from functools import cache

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows, put_column
from ..engine.compile import compile_bond_force, inlined
from ..engine.vector_loads import sums_of_rows
from .algebra import state_at
from .elementary import like
from .feature_sets import MOST_SHARED, N_OUTPUTS, FeatureSet, write_tractions

FEATURES = (2, 3)
"""Numbers of features that a spline may have."""

SUPPORT = 4
"""Number of B-splines that are non-zero in a cell; along a feature there are three more
coefficients than cells.
"""

MOST_FEATURES = FEATURES[-1]

SCALING = 2 * MOST_FEATURES
"""Number of constants before the coefficients in the packed weights: lower end and cells per unit
of each feature, zero for a missing third feature.
"""

N_WEIGHTS = 0
CELLS = 1
"""Indices in a spline's array of sizes: the length of its weights, and the first of its numbers
of cells along each feature.
"""

N_SIZES = CELLS + MOST_FEATURES

OFFSET = 0
SHARES = 1
KEPT = 1 + MOST_FEATURES * SUPPORT
"""First rows of the parts of working memory: the index at which a state's coefficients begin, the
values of the four B-splines of each feature, and the values that `FeatureSet.shared` returns.
"""

WORK_ROWS = KEPT + MOST_SHARED


def pack(low, step, coefficients, at_rest, dtype):
    """Pack a spline for `spline_block`: return its sizes and its weights in `dtype`.

    `low` and `step` are the lower end of the box and the width of a cell for each feature,
    `coefficients` have shape (2, cells_1 + 3, …, cells_n + 3), and `at_rest`, the two outputs in
    the undeformed state, is appended for subtraction.
    """
    missing = MOST_FEATURES - len(low)
    scaling = [np.pad(values, (missing, 0)) for values in (low, 1 / np.asarray(step))]
    # Both outputs of a place are stored side by side.
    packed = np.concatenate([*scaling, np.moveaxis(coefficients, 0, -1).ravel(), at_rest]).astype(
        dtype
    )
    sizes = np.zeros(N_SIZES, dtype=np.int64)
    sizes[N_WEIGHTS] = packed.size
    sizes[CELLS:] = [1] * missing + [count - (SUPPORT - 1) for count in coefficients.shape[1:]]
    return sizes, packed


def cubic_weights(u):
    """Return the values of the four cubic B-splines that are non-zero in a cell of the knots, at
    the place u in [0, 1] within the cell.
    """
    one = like(u, 1.0)
    v = one - u
    sixth = like(u, 1 / 6)
    first = sixth * v * v * v
    last = sixth * u * u * u
    second = like(u, 2 / 3) - u * u * (one - like(u, 0.5) * u)
    return first, second, one - first - second - last, last


@cache
def spline_block(features: FeatureSet, dtype):
    """Return the function, compiled for blocks of bonds, that evaluates splines of two or three
    features as a bond force.

    The function takes the sizes and weights from `pack` as arguments.
    """
    shared_of = inlined(features.shared)
    inputs = inlined(features.inputs)
    put_tractions = write_tractions(features)
    weights_at = inlined(cubic_weights)
    # With two features the first of three has one cell and one weight.
    layers = SUPPORT ** (len(features.names) - 2)

    def spline(states, sizes, weights, response, parameters, work, scratch, traction):
        places = block_rows(work[:SHARES])
        ahead = block_rows(work[SHARES : SHARES + SUPPORT])
        down = block_rows(work[SHARES + SUPPORT : SHARES + 2 * SUPPORT])
        along = block_rows(work[SHARES + 2 * SUPPORT : KEPT])
        kept = block_rows(work[KEPT:WORK_ROWS])
        real = weights.dtype.type
        zero = real(0.0)
        one = real(1.0)
        low0 = weights[0]
        low1 = weights[1]
        low2 = weights[2]
        scale0 = weights[3]
        scale1 = weights[4]
        scale2 = weights[5]
        cells0 = real(sizes[CELLS])
        cells1 = real(sizes[CELLS + 1])
        cells2 = real(sizes[CELLS + 2])
        row = N_OUTPUTS * (sizes[CELLS + 2] + SUPPORT - 1)
        layer = row * (sizes[CELLS + 1] + SUPPORT - 1)
        size1 = real(row)
        size0 = real(layer)
        for k in range(BLOCK):
            a, b, U_mm, J, C33 = state_at(states, k)
            shared = shared_of(a, b, J, C33)
            put_column(kept, k, shared)
            values = inputs(shared, a, b, U_mm, J, C33, states[5, k])
            t0 = (values[0] - low0) * scale0
            t1 = (values[-2] - low1) * scale1
            t2 = (values[-1] - low2) * scale2
            # These comparisons map NaN to the lower end.
            t0 = t0 if t0 > zero else zero
            t1 = t1 if t1 > zero else zero
            t2 = t2 if t2 > zero else zero
            t0 = min(t0, cells0)
            t1 = min(t1, cells1)
            t2 = min(t2, cells2)
            i0 = min(np.floor(t0), cells0 - one)
            i1 = min(np.floor(t1), cells1 - one)
            i2 = min(np.floor(t2), cells2 - one)
            # Single precision holds this whole number exactly: tables are far smaller than 2^24.
            places[OFFSET, k] = real(SCALING) + i0 * size0 + i1 * size1 + real(N_OUTPUTS) * i2
            put_column(ahead, k, weights_at(t0 - i0))
            put_column(down, k, weights_at(t1 - i1))
            put_column(along, k, weights_at(t2 - i2))
        for k in range(BLOCK):
            begin = np.int64(places[OFFSET, k])
            rows = down[0, k], down[1, k], down[2, k], down[3, k]
            columns = along[0, k], along[1, k], along[2, k], along[3, k]
            first, second = sums_of_rows(weights, begin, row, rows, columns)
            if layers > 1:
                first = first * ahead[0, k]
                second = second * ahead[0, k]
                for n in range(1, layers):
                    more, other = sums_of_rows(weights, begin + n * layer, row, rows, columns)
                    first = first + more * ahead[n, k]
                    second = second + other * ahead[n, k]
            traction[0, k] = first
            traction[1, k] = second
        put_tractions(states, kept, weights[sizes[N_WEIGHTS] - N_OUTPUTS :], traction)

    return compile_bond_force(spline, dtype)
