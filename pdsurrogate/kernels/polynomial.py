"""Polynomials in two features as bond-force block functions: sums of products of Chebyshev polynomials."""

from functools import cache

import numpy as np
from numba import carray

from .blocks import BLOCK, STATE_ROWS, TRACTION_ROWS, block_rows
from .compile import bond_force_signature, compile_block_function, inlined, source_digest, widest_vectors
from .feature_sets import FEATURE_SETS

N_OUTPUTS = 2

MOST_DEGREE = 24

INNER, OUTER, N_WEIGHTS, N_WORK_ROWS, COUNTS = 0, 1, 2, 3, 4
"""Places in a polynomial's sizes: its two degrees, and from `COUNTS` on how many terms go with each power of the second feature."""


def pack(centre, half_width, coefficients, at_rest, dtype):
    """Pack a polynomial for `polynomial_block`.

    Parameters
    ----------
    centre, half_width : array_like, shape (2,)
        Features are mapped to (x - centre)/half_width.
    coefficients : ndarray, shape (2, inner + 1, outer + 1)
        Of T_j(x1) T_i(x2), by output.  For each i, those past the last that is not zero cost nothing.
    at_rest : array_like, shape (2,)
        Taken off the outputs.
    dtype : float32 or float64

    Returns
    -------
    sizes : ndarray of int64
    weights : ndarray of `dtype`
    """
    inner, outer = coefficients.shape[1] - 1, coefficients.shape[2] - 1
    used = (coefficients != 0).any(axis=0)
    counts = [int(np.flatnonzero(used[:, i])[-1]) + 1 if used[:, i].any() else 0 for i in range(outer + 1)]
    # For each i the coefficients of both outputs side by side, in the order in which the loops want them.
    terms = [coefficients[:, :count, i].T.ravel() for i, count in enumerate(counts)]
    weights = np.concatenate([centre, 1 / np.asarray(half_width), *terms, at_rest]).astype(dtype)
    return np.array([inner, outer, weights.size, inner + 4, *counts]), weights


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
        widest_vectors()
        states = carray(states, (STATE_ROWS, BLOCK))
        traction = carray(traction, (TRACTION_ROWS, BLOCK))
        sizes = carray(sizes, (COUNTS + MOST_DEGREE + 1,))
        weights = carray(weights, (sizes[N_WEIGHTS],))
        work = carray(work, (sizes[N_WORK_ROWS], BLOCK))
        inner = sizes[INNER]
        # T_j(x1) for all j, and T_i(x2), T_i-1(x2) and x2 itself.
        powers = block_rows(work[0 : inner + 1])
        other = block_rows(work[inner + 1 : inner + 4])
        centre1, centre2, scale1, scale2 = weights[0], weights[1], weights[2], weights[3]
        for k in range(BLOCK):
            x1, x2 = inputs(states[0, k], states[1, k], states[2, k], states[3, k], states[4, k], states[5, k])
            other[2, k] = (x2 - centre2) * scale2
            other[0, k] = 1
            other[1, k] = 0
            powers[0, k] = (x1 - centre1) * scale1
            traction[0, k] = 0
            traction[1, k] = 0
        if inner >= 1:
            for k in range(BLOCK):
                powers[1, k] = powers[0, k]
                powers[0, k] = 1
        else:
            for k in range(BLOCK):
                powers[0, k] = 1
        j = 2
        while j + 1 <= inner:
            for k in range(BLOCK):
                twice = powers[1, k] + powers[1, k]
                following = twice * powers[j - 1, k] - powers[j - 2, k]
                powers[j + 1, k] = twice * following - powers[j - 1, k]
                powers[j, k] = following
            j += 2
        if j <= inner:
            for k in range(BLOCK):
                powers[j, k] = (powers[1, k] + powers[1, k]) * powers[j - 1, k] - powers[j - 2, k]
        at = 4
        for i in range(sizes[OUTER] + 1):
            if i == 1:
                for k in range(BLOCK):
                    other[1, k] = 1
                    other[0, k] = other[2, k]
            elif i > 1:
                for k in range(BLOCK):
                    following = (other[2, k] + other[2, k]) * other[0, k] - other[1, k]
                    other[1, k] = other[0, k]
                    other[0, k] = following
            count = sizes[COUNTS + i]
            j = 0
            # Eight or four terms at a time: the sums are loaded and stored once for all of them.
            while j + 7 < count:
                a0, b0, a1, b1 = weights[at], weights[at + 1], weights[at + 2], weights[at + 3]
                a2, b2, a3, b3 = weights[at + 4], weights[at + 5], weights[at + 6], weights[at + 7]
                a4, b4, a5, b5 = weights[at + 8], weights[at + 9], weights[at + 10], weights[at + 11]
                a6, b6, a7, b7 = weights[at + 12], weights[at + 13], weights[at + 14], weights[at + 15]
                eight = block_rows(powers[j : j + 8])
                for k in range(BLOCK):
                    y0, y1, y2, y3 = eight[0, k], eight[1, k], eight[2, k], eight[3, k]
                    y4, y5, y6, y7 = eight[4, k], eight[5, k], eight[6, k], eight[7, k]
                    one = ((a0 * y0 + a1 * y1) + (a2 * y2 + a3 * y3)) + ((a4 * y4 + a5 * y5) + (a6 * y6 + a7 * y7))
                    two = ((b0 * y0 + b1 * y1) + (b2 * y2 + b3 * y3)) + ((b4 * y4 + b5 * y5) + (b6 * y6 + b7 * y7))
                    traction[0, k] += other[0, k] * one
                    traction[1, k] += other[0, k] * two
                at += 16
                j += 8
            while j + 3 < count:
                a0, b0, a1, b1 = weights[at], weights[at + 1], weights[at + 2], weights[at + 3]
                a2, b2, a3, b3 = weights[at + 4], weights[at + 5], weights[at + 6], weights[at + 7]
                four = block_rows(powers[j : j + 4])
                for k in range(BLOCK):
                    y0 = four[0, k]
                    y1 = four[1, k]
                    y2 = four[2, k]
                    y3 = four[3, k]
                    traction[0, k] += other[0, k] * ((a0 * y0 + a1 * y1) + (a2 * y2 + a3 * y3))
                    traction[1, k] += other[0, k] * ((b0 * y0 + b1 * y1) + (b2 * y2 + b3 * y3))
                at += 8
                j += 4
            while j + 1 < count:
                a0, b0, a1, b1 = weights[at], weights[at + 1], weights[at + 2], weights[at + 3]
                for k in range(BLOCK):
                    y0 = powers[j, k]
                    y1 = powers[j + 1, k]
                    traction[0, k] += other[0, k] * (a0 * y0 + a1 * y1)
                    traction[1, k] += other[0, k] * (b0 * y0 + b1 * y1)
                at += 4
                j += 2
            if j < count:
                a0, b0 = weights[at], weights[at + 1]
                for k in range(BLOCK):
                    y0 = powers[j, k]
                    traction[0, k] += other[0, k] * (a0 * y0)
                    traction[1, k] += other[0, k] * (b0 * y0)
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
