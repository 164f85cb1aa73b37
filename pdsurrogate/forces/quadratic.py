"""Correction of deformation gradients at points with incomplete horizons: exact for every quadratic motion (theory (64), (65))."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
import scipy

from ..body import Body

LOPSIDED = 0.02
"""Greatest error of a point's gradient in a quadratic motion, in cells times its second derivatives, for which the point is not corrected.
The error is zero where a horizon is symmetric, and 0.3 to 0.5 at a flat face. Chosen far below these, and above rounding."""

MISFIT = 0.01
"""Greatest part of the error that a correction may leave. Chosen above rounding: where the neighbors lie in too few layers to determine
the correction, most of the error is left."""

MOST_AMPLIFICATION = 6.0
"""Greatest sum of the absolute weights in a correction, since it amplifies errors of single gradients; 3 to 4.5 on solids."""

SPREAD = 1e-6
"""Least singular value of the conditions on a correction, relative to the greatest, that counts as nonzero. Chosen: six of the sixteen
digits of double precision, far below the values of points in three layers."""

TOGETHER = 4_000
"""Number of points whose weights are computed together. Chosen: with 26 neighbors each, their arrays take some 20 MB."""


def quadratic_correction(body: Body, weights: np.ndarray, supported: np.ndarray) -> scipy.sparse.csr_array:
    """Return the matrix C (n d, n d) of corrections to deformation gradients, whose columns are the rows of a vector (n d, d).

    The gradient (theory (1)) of a point at a boundary is that of the material some cells inside. The corrected gradients are the sum of
    this vector and its product with C: a point adds gradients of its neighbors, with weights whose sum is zero and which cancel the error
    in every quadratic motion, the least such weights. Rows of complete horizons, and of points whose neighbors do not determine the
    weights, are empty.

    Parameters
    ----------
    body : Body
    weights : ndarray, shape (n_bonds, d)
        Weights of directed bonds in the gradients, see `Kinematics.gradient_weights`.
    supported : ndarray of uint8, shape (n,)
        1 where a point has a gradient.
    """
    bonds, n, d, owners = body.bonds, len(body), body.dimension, body.bond_owners
    first, second = np.array(list(combinations_with_replacement(range(d), 2))).T
    vectors = (body.all_points[bonds.neighbors] - body.points[owners]) / body.spacing
    products = vectors[:, first] * vectors[:, second]
    errors = np.zeros((n, d, len(first)))  # what points find, relative to themselves, for the gradients of products of two coordinates
    for axis, number in np.ndindex(errors.shape[1:]):
        errors[:, axis, number] = np.bincount(owners, body.spacing * weights[:, axis] * products[:, number], n)
    body.share.fill(errors)
    chosen = body.share.own & (supported > 0) & (np.abs(errors).max(axis=(1, 2)) > LOPSIDED)
    entries = np.flatnonzero(chosen[owners] & (bonds.neighbors < n))
    entries = entries[supported[bonds.neighbors[entries]] > 0]
    counts, found = np.bincount(owners[entries], minlength=n), scipy.sparse.csr_array((n * d, n * d))
    starts = np.cumsum(counts) - counts
    for count in np.unique(counts[chosen & (counts > 0)]):
        alike = np.flatnonzero(chosen & (counts == count))
        for points in np.split(alike, range(TOGETHER, len(alike), TOGETHER)):
            around = np.column_stack([points, bonds.neighbors[entries[starts[points, None] + np.arange(count)]]]).astype(np.int64)
            offsets = (body.points[around] - body.points[points, None]) / body.spacing
            added, good = _least_weights(errors[around], offsets, (first, second))
            axes, places = np.arange(d), (points[good, None, None, None], around[good, :, None, None])
            into, of = np.broadcast_arrays(d * places[0] + axes, d * places[1] + axes[:, None])
            found += scipy.sparse.csr_array((added[good].ravel(), (into.ravel(), of.ravel())), shape=found.shape)
    return found


def _least_weights(errors: np.ndarray, offsets: np.ndarray, factors: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights A (p, k, d, d) with which columns of gradients G_k add G_k A_k to the first of k points, and flags of their use.

    `errors` (p, k, d, q) are those of the points' gradients for q products of coordinates, whose `factors` are two arrays (q,) of axes;
    `offsets` (p, k, d) are the places of the points relative to the first.
    """
    (p, k, d), axes = offsets.shape, np.eye(offsets.shape[2])
    one, other = factors
    # Gradients that the points find for products of coordinates relative to the first point.
    gradients = errors + axes[:, one] * offsets[:, :, None, other] + axes[:, other] * offsets[:, :, None, one]
    sums = np.broadcast_to(np.tile(axes, (k, 1)), (p, k * d, d))
    conditions = np.concatenate([sums, gradients.reshape(p, k * d, -1)], axis=2).swapaxes(1, 2)
    asked = np.concatenate([np.zeros((p, d, d)), -errors[:, 0].swapaxes(1, 2)], axis=1)
    weights = np.linalg.pinv(conditions, rcond=SPREAD) @ asked
    left, most = np.abs(conditions @ weights - asked).max(axis=(1, 2)), np.abs(weights).sum(axis=1).max(axis=1)
    return weights.reshape(p, k, d, d), (left <= MISFIT * np.abs(asked).max(axis=(1, 2))) & (most <= MOST_AMPLIFICATION)
