"""Changes of the reference vectors of pairs with which a uniform stress exerts the load of the boundary on every point (theory (80b))."""

from __future__ import annotations

import numpy as np
import scipy

from ..body import Body, rows_of
from ..ranks import Rows
from .balanced import beside, ends_of_unknown, sees_clamps

ABOVE_ROUNDING = 64
"""Multiple of the rounding error of the longest reference vector beyond which the vectors of a point count as out of balance. Their sum is
that of some 30 rounded vectors."""

REMAINDER = 1e-8
"""Norm of the forces that are left out of balance, divided by the norm before, at which the iteration ends."""


def balanced_changes(body: Body, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers (k,) of the pairs whose reference vectors change, and the changes (k, d).

    With the changes the vectors (n_pairs, d) of a point sum to minus the load of a unit tension of the boundary on it, `Body.outward`. The
    sum of their squares, each divided by the length of the vector, is the least possible. Pairs without force have the vector zero and no
    change, and points beside curved held boundaries, beside cuts that `Body.outward` does not contain, and in corners of clamps and free
    sides, no equation.
    """
    bonds, share, n, d = body.bonds, body.share, len(body), body.dimension
    within, sources = bonds.second < n, np.concatenate([np.arange(n), body.ghosts.source.astype(np.int64)])
    left, size = -body.outward, np.linalg.norm(vectors, axis=1)
    for c in range(d):
        left[:, c] -= np.bincount(bonds.first, vectors[:, c], n) - np.bincount(bonds.second[within], vectors[within, c], n)
    rounding = ABOVE_ROUNDING * float(np.finfo(vectors.dtype).eps) * share.greatest(float(size.max(initial=0.0)))
    uneven = np.abs(left).max(axis=1) > rounding
    # In corners of clamps and free sides no state is homogeneous. A pair depends on the gradients of both ends, so that the force on a
    # point depends on images beyond a clamp if one of its neighbors sees them.
    unknown = beside(body, np.abs(body.outward).max(axis=1) > 0) & beside(body, sees_clamps(body)) | ends_of_unknown(body, None)
    uneven |= unknown
    curved = np.array([*(plane.axis is None for plane in body.planes), False])
    curved = np.concatenate([np.zeros(n, dtype=bool), curved[body.ghosts.plane]])[bonds.second]
    free = uneven & ~unknown
    free[bonds.first[curved]] = False
    share.fill(left, uneven, free)

    pairs = np.flatnonzero(uneven[bonds.first] & uneven[sources[bonds.second]] & (size > 0) & ~curved)
    first, second = bonds.first[pairs].astype(np.int64), bonds.second[pairs]
    signs = np.vstack([np.ones((n, d)), body.ghosts.reflection])[second]
    rows = rows_of(body, "pairs")
    numbers, own = rows.numbers[pairs], rows.own[pairs]
    of_all = np.sort(np.concatenate(share.everywhere(numbers[own])))
    rows = Rows(share.ranks, np.searchsorted(of_all, numbers), own, len(of_all))
    ends = share.numbers[first], share.numbers[sources[second]]
    whole = [rows.gather(values) for values in (*ends, second >= n, signs, size[pairs])]
    loads, free = share.gather(left), share.gather(free)
    found = np.empty((0, d))
    if share.leads:
        found = np.stack([_potential(*whole[:3], whole[3][:, c], whole[4], loads[:, c], free) for c in range(d)], axis=1)
    potential = rows_of(body, "points").hand_out(found if share.leads else None)
    return pairs, size[pairs, None] * (signs * potential[sources[second]] - potential[first])


def _potential(first, second, imaged, signs, weights, loads, free) -> np.ndarray:
    """Return the potential (n,) of `free` points, zero at others, whose weighted differences along the pairs of a point sum to its load.

    A pair with an image of its second point (`imaged`) counts at its first point only. The potential of an image is that of its point times
    the sign in `signs`.
    """
    n, inner = len(loads), ~imaged
    diagonal = np.bincount(first, weights, n) + np.bincount(second[inner], weights[inner], n)
    rows, columns = np.concatenate([first, second[inner]]), np.concatenate([second, first[inner]])
    entries = np.concatenate([weights * signs, weights[inner]])
    places = np.flatnonzero(free & (diagonal > 0))
    matrix = (scipy.sparse.diags_array(diagonal) - scipy.sparse.csr_array((entries, (rows, columns)), shape=(n, n))).tocsr()
    matrix, wanted, diagonal = matrix[places][:, places], -loads[places], diagonal[places]
    # Where no plane and no other point holds the potential of a piece, the loads of the piece must sum to zero.
    count, piece = scipy.sparse.csgraph.connected_components(matrix, directed=False)
    sums = [np.bincount(piece, values, count) for values in (wanted, matrix @ np.ones(len(places)), diagonal, np.ones(len(places)))]
    wanted -= np.where(np.abs(sums[1]) < 1e-9 * sums[2], sums[0] / sums[3], 0.0)[piece]
    found, step, last = np.zeros(len(places)), np.zeros(len(places)), np.inf
    least = REMAINDER**2 * np.einsum("n,n->", wanted, wanted)
    for _ in range(len(places)):
        if np.einsum("n,n->", wanted, wanted) <= least:
            break
        eased = wanted / diagonal
        work = np.einsum("n,n->", wanted, eased)
        step = eased + (work / last) * step
        exerted = matrix @ step
        length = work / np.einsum("n,n->", step, exerted)
        found += length * step
        wanted -= length * exerted
        last = work
    potential = np.zeros(n)
    potential[places] = found
    return potential
