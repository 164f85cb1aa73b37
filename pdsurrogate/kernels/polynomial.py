"""Polynomials in two features as bond-force block functions: sums of products of Chebyshev polynomials up to a total degree."""

from functools import cache

import numpy as np
from numba import carray

from .blocks import BLOCK, STATE_ROWS, TRACTION_ROWS, block_rows
from .compile import bond_force_signature, compile_block_function, inlined, source_digest
from .feature_sets import FEATURE_SETS

N_OUTPUTS = 2

DEGREE, N_WEIGHTS, N_WORK_ROWS = 0, 1, 2
"""Places in a polynomial's sizes."""


def pack(centre, half_width, coefficients, at_rest, dtype):
    """Pack a polynomial for `polynomial_block`.

    Parameters
    ----------
    centre, half_width : array_like, shape (2,)
        Features are mapped to (x - centre)/half_width.
    coefficients : ndarray, shape (2, degree + 1, degree + 1)
        Of T_i(x1) T_j(x2), by output; those with i + j > degree are not used.
    at_rest : array_like, shape (2,)
        Taken off the outputs.
    dtype : float32 or float64

    Returns
    -------
    sizes : ndarray of int64
    weights : ndarray of `dtype`
    """
    degree = coefficients.shape[1] - 1
    # For each i the coefficients of both outputs side by side, in the order in which the loops want them.
    terms = [coefficients[:, i, : degree - i + 1].T.ravel() for i in range(degree + 1)]
    weights = np.concatenate([centre, 1 / np.asarray(half_width), *terms, at_rest]).astype(dtype)
    return np.array([degree, weights.size, degree + 4]), weights


@cache
def polynomial_block(features, dtype):
    """Block function of polynomials in a feature set of two; degree and coefficients are arguments of it.

    ``sizes`` and ``weights`` are what `pack` returns.
    """
    inputs = inlined(FEATURE_SETS[features].inputs)[0]
    traction_of = inlined(FEATURE_SETS[features].traction)[0]
    digest = source_digest()

    def polynomial(states, sizes, weights, response, parameters, work, scratch, traction):
        digest  # noqa: B018  (part of the cache key)
        states = carray(states, (STATE_ROWS, BLOCK))
        traction = carray(traction, (TRACTION_ROWS, BLOCK))
        sizes = carray(sizes, (3,))
        weights = carray(weights, (sizes[N_WEIGHTS],))
        work = carray(work, (sizes[N_WORK_ROWS], BLOCK))
        degree = sizes[DEGREE]
        # T_j(x2) for all j, and T_i(x1), T_i-1(x1) and x1 itself.
        second = block_rows(work[0 : degree + 1])
        first = block_rows(work[degree + 1 : degree + 4])
        centre1, centre2, scale1, scale2 = weights[0], weights[1], weights[2], weights[3]
        for k in range(BLOCK):
            x1, x2 = inputs(states[0, k], states[1, k], states[2, k], states[3, k], states[4, k], states[5, k])
            first[2, k] = (x1 - centre1) * scale1
            first[0, k] = 1
            first[1, k] = 0
            second[0, k] = (x2 - centre2) * scale2
            traction[0, k] = 0
            traction[1, k] = 0
        if degree >= 1:
            for k in range(BLOCK):
                second[1, k] = second[0, k]
                second[0, k] = 1
        else:
            for k in range(BLOCK):
                second[0, k] = 1
        for j in range(2, degree + 1):
            for k in range(BLOCK):
                second[j, k] = (second[1, k] + second[1, k]) * second[j - 1, k] - second[j - 2, k]
        at = 4
        for i in range(degree + 1):
            if i == 1:
                for k in range(BLOCK):
                    first[1, k] = 1
                    first[0, k] = first[2, k]
            elif i > 1:
                for k in range(BLOCK):
                    following = (first[2, k] + first[2, k]) * first[0, k] - first[1, k]
                    first[1, k] = first[0, k]
                    first[0, k] = following
            count = degree - i + 1
            j = 0
            while j + 1 < count:
                a0, b0, a1, b1 = weights[at], weights[at + 1], weights[at + 2], weights[at + 3]
                for k in range(BLOCK):
                    y0 = second[j, k]
                    y1 = second[j + 1, k]
                    traction[0, k] += first[0, k] * (a0 * y0 + a1 * y1)
                    traction[1, k] += first[0, k] * (b0 * y0 + b1 * y1)
                at += 4
                j += 2
            if j < count:
                a0, b0 = weights[at], weights[at + 1]
                for k in range(BLOCK):
                    y0 = second[j, k]
                    traction[0, k] += first[0, k] * (a0 * y0)
                    traction[1, k] += first[0, k] * (b0 * y0)
                at += 2
        rest0 = weights[at]
        rest1 = weights[at + 1]
        for k in range(BLOCK):
            T_nn, T_nm, T_mm = traction_of(
                traction[0, k] - rest0, traction[1, k] - rest1, states[0, k], states[1, k], states[2, k], states[3, k], states[4, k]
            )
            traction[0, k] = T_nn
            traction[1, k] = T_nm
            traction[2, k] = T_mm

    return compile_block_function(polynomial, bond_force_signature(np.dtype(dtype)))
