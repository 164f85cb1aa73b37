"""What solvers know of a body in parts: sums, greatest values, decisions and pieces over all ranks."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ..solvers.reductions import LocalReductions
from .part import Part


class ReductionsOfParts(LocalReductions):
    """Reductions over all ranks; of an array by points every rank counts the points that it owns.

    Parameters
    ----------
    part : Part
    """

    def __init__(self, part: Part) -> None:
        self._part, self._ranks = part, part.ranks
        self._own = np.flatnonzero(part.own)
        self._weights = part.own.astype(float)

    def dot(self, first, second, weights=None):
        weights = self._weights if weights is None else self._weights * weights
        return self._ranks.total(super().dot(first, second, weights))

    def total(self, values):
        return self._ranks.total(float(values[self._own].sum()))

    def total_in_order(self, values):
        whole = self._part.gather(values)
        return self._ranks.to_all(None if whole is None else super().total(whole))

    def greatest(self, values):
        return self._ranks.greatest(float(values[self._own].max()))

    def extent(self, points):
        own = points[self._own]
        ends = [self._ranks.greatest(float(end)) for end in (*own.max(axis=0), *-own.min(axis=0))]
        dimension = points.shape[1]
        return max(above + below for above, below in zip(ends[:dimension], ends[dimension:], strict=True))

    def total_of_parts(self, part):
        return self._ranks.total(part)

    def greatest_of_parts(self, part):
        return self._ranks.greatest(float(part))

    def any(self, flag):
        return self._part.any(flag)

    def total_size(self, n):
        return self._part.size(n)

    def take(self, values):
        return self._part.take(values)

    def union(self, values):
        return np.unique(np.concatenate(self._ranks.everywhere(np.unique(values))))

    def spread(self, values):
        size = self.total_size(len(values))
        mean = self.total(values) / size
        return float(np.sqrt(self.total(np.square(values - mean)) / size))

    def of_all(self, rows, points):
        return np.concatenate(self._ranks.everywhere(rows[self._part.own[points]]))

    def counts(self, points):
        return points[self._part.own[points]]

    def pieces(self, n, first, second):
        """Pieces of every part are joined where a point of a halo is in one of them, and in another of its owner."""
        count, label = super().pieces(n, first, second)
        counts = self._ranks.everywhere(count)
        label = label.astype(np.int64) + sum(counts[: self._ranks.rank])
        theirs = label.copy()
        self._part.fill(theirs)
        joined = np.unique(np.stack([label, theirs], axis=1), axis=0)
        one, other = np.concatenate(self._ranks.everywhere(joined)).T
        graph = sparse.coo_matrix((np.ones(len(one), np.int8), (one, other)), shape=(sum(counts), sum(counts)))
        _, piece = connected_components(graph, directed=False)
        # A piece of a part may be of the halo alone: those count that have points of somebody's own, in the order of the first of these.
        least = np.full(sum(counts), np.iinfo(np.int64).max)
        np.minimum.at(least, piece[label[self._own]], self._part.numbers[self._own])
        least = np.min(self._ranks.everywhere(least), axis=0)
        order = np.argsort(least, kind="stable")
        rank_of = np.empty(len(order), dtype=np.int64)
        rank_of[order] = np.arange(len(order))
        found = int(np.count_nonzero(least < np.iinfo(np.int64).max))
        return found, rank_of[piece[label]]
