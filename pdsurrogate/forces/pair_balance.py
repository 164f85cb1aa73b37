"""Changes of the reference vectors of pairs with which a uniform stress exerts the load of the
boundary on every point (theory (80b)).
"""

from __future__ import annotations

import numpy as np
import scipy

from ..body import Body, rows_of
from ..body.body import lengths_of
from ..kernels.lists import add_to_ends
from ..ranks import Rows
from .balanced import beside, ends_of_unknown, sees_clamps
from .fourth_order import conjugate_gradients

ABOVE_ROUNDING = 64
"""Multiple of the rounding error of the longest reference vector, and of that by rounded
coordinates, beyond which the vectors of a point count as out of balance. Their sum is that of some
30 rounded vectors.
"""

SAME_PLACE = 1e-6
"""Distance, in spacings, that counts as none between a point and its image along an axis."""

OPEN = 1e-6
"""Work in an extension, relative to that of pairs that follow it, above which the balance leaves
the extension open. It is of the order of 1 between planes on both sides, and that of the remainder
where free boundaries or no pairs lie between.
"""


def balanced_changes(body: Body, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers (k,) of the pairs whose reference vectors change, and the changes (k, d).

    With the changes the vectors (n_pairs, d) of a point sum to minus the load of a unit tension of
    the boundary on it, `Body.outward`. The sum of their squares, each divided by the length of the
    vector, is the least possible. Pairs without force have the vector zero and no change, and
    points beside curved held boundaries, beside cuts that `Body.outward` does not contain, and in
    corners of clamps and free sides, no equation. Between two planes they leave the mean stress as
    it is.
    """
    bonds = body.bonds
    share = body.share
    n = len(body)
    d = body.dimension
    sources = np.concatenate([np.arange(n), body.ghosts.source.astype(np.int64)])
    left = np.zeros((n, d))
    longest = 0.0
    for part in bonds.slabs():
        of_part = vectors[part].astype(float)
        add_to_ends(bonds.first[part], bonds.second[part], of_part, -1, left)
        longest = max(longest, float(lengths_of(of_part).max()))
    left = -body.outward - left
    rounding = (
        float(np.finfo(vectors.dtype).eps)
        + share.greatest(float(np.spacing(np.abs(body.points).max(initial=0.0)))) / body.spacing
    )
    rounding *= ABOVE_ROUNDING * share.greatest(longest)
    uneven = np.abs(left).max(axis=1) > rounding
    # In corners of clamps and free sides no state is homogeneous. A pair depends on the gradients
    # of both ends, so that the force on a point depends on images beyond a clamp if one of its
    # neighbors sees them.
    unknown = beside(body, np.abs(body.outward).max(axis=1) > 0) & beside(
        body, sees_clamps(body)
    ) | ends_of_unknown(body)
    uneven |= unknown
    curved = np.array([*(plane.axis is None for plane in body.planes), False])
    curved = np.concatenate([np.zeros(n, dtype=bool), curved[body.ghosts.plane]])
    free = uneven & ~unknown
    free[bonds.first[curved[bonds.second]]] = False
    share.fill(left, uneven, free)

    pairs = np.flatnonzero(uneven[bonds.first])
    second = bonds.second[pairs]
    size = np.linalg.norm(vectors[pairs], axis=1)
    kept = uneven[sources[second]] & (size > 0) & ~curved[second]
    pairs, second, size = pairs[kept], second[kept], size[kept]
    first = bonds.first[pairs].astype(np.int64)
    signs = np.vstack([np.ones((n, d)), body.ghosts.reflection])[second]
    vectors = body.all_points[bonds.second[pairs]] - body.all_points[first]
    mirrored = (
        np.abs(body.all_points[second] - body.all_points[sources[second]])
        > SAME_PLACE * body.spacing
    )
    numbers, own = pairs, np.ones(len(pairs), dtype=bool)
    if share.divided:
        rows = rows_of(body, "pairs")
        numbers, own = rows.numbers[pairs], rows.own[pairs]
    of_all = np.sort(np.concatenate(share.everywhere(numbers[own])))
    rows = Rows(share.ranks, np.searchsorted(of_all, numbers), own, len(of_all))
    ends = share.numbers[first], share.numbers[sources[second]]
    whole = [rows.gather(values) for values in (*ends, second >= n, signs, size, vectors, mirrored)]
    loads = share.gather(left)
    free = share.gather(free)
    changes = np.empty((0, d))
    if share.is_first:
        *ends, imaged, signs, weights, vectors, mirrored = whole
        changes = np.zeros((len(weights), d))
        between = [
            e
            for e in range(d)
            if {plane.side for plane in body.planes if plane.axis == e} == {-1, 1}
        ]
        for c in range(d if len(weights) else 0):
            # Images follow an extension along an axis if their components change sign where their
            # places are mirrored along it.
            along = [e for e in between if ((signs[imaged, c] < 0) == mirrored[imaged, e]).all()]
            changes[:, c] = _least_changes(
                *ends, imaged, signs[:, c], weights, loads[:, c], free, vectors[:, along]
            )
    return pairs, rows.hand_out(changes if share.is_first else None)


def _least_changes(first, second, imaged, signs, weights, loads, free, along) -> np.ndarray:
    """Return the least changes (k,) of pairs whose sums on the `free` points are their loads, and
    that do no work in extensions.

    A pair with an image of its second point (`imaged`) counts at its first point only. The
    potential of an image is that of its point times the sign in `signs`, and of points that are not
    free zero. `along` (k, m) are the components of the pairs along the axes of extensions.
    """
    n = len(loads)
    inner = ~imaged
    diagonal = np.bincount(first, weights, n) + np.bincount(second[inner], weights[inner], n)
    rows = np.concatenate([first, second[inner]])
    columns = np.concatenate([second, first[inner]])
    entries = np.concatenate([weights * signs, weights[inner]])
    places = np.flatnonzero(free & (diagonal > 0))
    matrix = (
        scipy.sparse.diags_array(diagonal)
        - scipy.sparse.csr_array((entries, (rows, columns)), shape=(n, n))
    ).tocsr()
    matrix = matrix[places][:, places]
    diagonal = diagonal[places]

    def solution(pulls: np.ndarray) -> np.ndarray:
        potential = np.zeros(n)
        potential[places] = _potential(matrix, diagonal, pulls[places])
        return weights * (signs * potential[second] - potential[first])

    changes = solution(-loads)
    # Between planes the balance leaves the sum across any section open. Each pair with an image
    # stands for half of one inside.
    halves = np.where(imaged, 0.5, 1.0)
    free_ways = np.empty_like(along)
    for number, pulled in enumerate((weights[:, None] * along).T):
        free_ways[:, number] = pulled + solution(
            np.bincount(first, pulled, n) - np.bincount(second[inner], pulled[inner], n)
        )
    work, ways = np.linalg.eigh(np.einsum("ka,k,kb->ab", along, halves, free_ways))
    kept = work > OPEN * np.einsum("ka,k,ka->", along, halves * weights, along)
    amounts = np.einsum("ka,k,k->a", along @ ways, halves, changes)[kept] / work[kept]
    return changes - free_ways @ (ways[:, kept] @ amounts)


def _potential(matrix, diagonal: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return a solution (n,) of equations with a matrix (n, n), its `diagonal` and the
    right-hand side `wanted`.
    """
    # Where no plane and no other point holds the potential of a piece, the loads of the piece must
    # sum to zero.
    count, piece = scipy.sparse.csgraph.connected_components(matrix, directed=False)
    ones = np.ones(len(wanted))
    sums = [np.bincount(piece, values, count) for values in (wanted, matrix @ ones, diagonal, ones)]
    wanted = wanted - np.where(np.abs(sums[1]) < 1e-9 * sums[2], sums[0] / sums[3], 0.0)[piece]
    return conjugate_gradients(
        matrix, wanted[:, None], lambda residual: residual / diagonal[:, None]
    )[:, 0]
