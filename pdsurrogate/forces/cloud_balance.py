"""Factors on the bonds of a relaxed cloud with which a uniform stress exerts no force inside it (theory (77), (77a))."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..body import Body

SWEEPS = 3
"""Number of sweeps of Jacobi's method for the factors. The forces that a uniform stress exerts vary from point to point without order, so
that each sweep reduces them several times."""

MOST_CHANGE = 0.5
"""Greatest change of a factor from one, which keeps every bond. Changes of some hundredths are usual."""

ONE_SIDED = 0.2
"""Length of the mean bond of a point, divided by the mean length of its bonds, beyond which its horizon counts as incomplete. Chosen: the
mean bond is half as long as the bonds at a free edge, and some hundredths inside a cloud."""

LEAST_INSIDE = {2: 0.7, 3: 0.0}
"""Least share of points with complete horizons, by dimension, for which a body has factors. Chosen: in a square 8 points across, with a
share of 0.61, the errors of the boundary prevail, and its force under a plate was 0.2 % farther from the exact one with factors. Solids
gain more."""

TOGETHER = 200_000
"""Number of directed bonds that are treated together: their arrays then take some 20 MB."""


class Around(NamedTuple):
    """Directed bonds of some successive points of a body.

    Attributes
    ----------
    points, bonds : slice
        Numbers of the points and of their directed bonds.
    owners : ndarray of int, shape (k,)
        First point of each bond.
    vectors : ndarray, shape (k, d)
        Undeformed bonds.
    """

    points: slice
    bonds: slice
    owners: np.ndarray
    vectors: np.ndarray

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Return the sums of values (k, ...) of the bonds at each of the points."""
        count, owners = self.points.stop - self.points.start, self.owners - self.points.start
        columns = [np.bincount(owners, column, count) for column in values.reshape(len(values), -1).T]
        return np.stack(columns, axis=1).reshape(count, *values.shape[1:])


Pulls = Callable[[np.ndarray], Callable[[Around], tuple[np.ndarray, np.ndarray]]]
"""Function that takes factors (n_pairs,) and returns a function of some directed bonds, which returns two arrays of vectors (k, d). Times a
uniform stress these are the forces that a bond exerts on its first point in proportion to its factor, and by other means."""


def around(body: Body) -> Iterator[Around]:
    """Yield all directed bonds of a body, some points at a time."""
    bonds, starts = body.bonds, body.bonds.pointers.astype(np.int64)
    ends = np.unique(np.append(np.searchsorted(starts, np.arange(0, starts[-1], TOGETHER)), len(body)))
    for first, last in pairwise(ends):
        some = slice(starts[first], starts[last])
        owners = np.repeat(np.arange(first, last), np.diff(starts[first : last + 1]))
        yield Around(slice(first, last), some, owners, body.all_points[bonds.neighbors[some]] - body.points[owners])


def balancing_factors(body: Body, pulls: Pulls) -> np.ndarray:
    """Return factors near one on the pairs of a cloud, shape (n_pairs,), with which the vectors `pulls` nearly cancel at points inside.

    The factor of a pair of points with complete horizons is 1 + (c_j - c_i) . x, where x is the undeformed bond; other factors are one.
    """
    bonds, ghosts, d, n = body.bonds, body.ghosts, body.dimension, len(body)
    changes, inverse, inside = np.zeros((len(body.all_points), d)), np.zeros((n, d, d)), complete_horizons(body)
    share = body.share
    if share.total(int((inside & share.own).sum())) < LEAST_INSIDE[d] * share.size:
        return np.ones(len(bonds.first))
    share.fill(inside)
    # The forces of a uniform stress on points beside the boundary stay as they are: obstacles and loads displace these points by them.
    whole = np.concatenate([inside, inside[ghosts.source]])
    changed = whole[bonds.first] & whole[bonds.second]
    vectors, factors = body.all_points[bonds.second] - body.all_points[bonds.first], np.ones(len(bonds.first))
    for sweep in range(SWEEPS):
        of_bonds = pulls(factors)
        for some in around(body):
            within = inside[some.points, None]
            direct, others = of_bonds(some)
            if sweep == 0:
                stiffness = some.sums(direct[:, :, None] * some.vectors[:, None])
                inverse[some.points] = np.linalg.inv(np.where(within[:, None], stiffness, np.eye(d))) * within[:, None]
            changes[some.points] += np.einsum("nij,nj->ni", inverse[some.points], some.sums(direct + others))
        share.fill(changes)
        changes[n:] = ghosts.reflection * changes[ghosts.source]
        apart = np.einsum("bi,bi->b", changes[bonds.second] - changes[bonds.first], vectors)
        factors = 1 + np.where(changed, np.clip(apart, -MOST_CHANGE, MOST_CHANGE), 0.0)
    return factors


def complete_horizons(body: Body) -> np.ndarray:
    """Return flags of the points (n,) with complete horizons that no curved held boundary continues."""
    inside = np.zeros(len(body), dtype=bool)
    curved = np.array([*(plane.axis is None for plane in body.planes), False])
    curved = np.concatenate([np.zeros(len(body), dtype=bool), curved[body.ghosts.plane]])
    for some in around(body):
        neighbors, length = body.bonds.neighbors[some.bonds], np.linalg.norm(some.vectors, axis=1)
        weights = body.weigh(length) * body.all_volumes[neighbors]
        means = np.linalg.norm(some.sums(weights[:, None] * some.vectors), axis=1)
        beside = some.sums(curved[neighbors].astype(float)) > 0
        inside[some.points] = (means <= ONE_SIDED * some.sums(weights * length)) & ~beside
    return inside
