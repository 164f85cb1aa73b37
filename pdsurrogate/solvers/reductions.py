"""What solvers know of the whole body: sums, greatest values, decisions and pieces, of all points or of parts that were formed apart."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components


class LocalReductions:
    """Reductions of a body whose points are all here.

    Two kinds of argument are told apart.  An array by points, shape (n, ...), has a row for every point that is here; a body in several
    parts would count a point in one of them.  A part is what has been formed of the points and bonds that are here: a number, a few
    of them, or a small array, taken one by one.
    """

    def dot(self, first: np.ndarray, second: np.ndarray, weights: np.ndarray | None = None) -> float:
        """Inner product of two arrays by points, shape (n, d), every point with its weight, shape (n,).

        Not by BLAS, whose threads would wait for those of the kernels, and whose sum depends on their number.
        """
        if weights is None:
            return float(np.einsum("nc,nc->", first, second))
        return float(np.einsum("n,nc,nc->", weights, first, second))

    def total(self, values: np.ndarray) -> float:
        """Sum of all entries of an array by points."""
        return float(values.sum())

    def total_in_order(self, values: np.ndarray) -> float:
        """The same sum to the same bits whatever parts a body is in, at the cost of bringing all entries to one place."""
        return float(values.sum())

    def greatest(self, values: np.ndarray) -> float:
        """Greatest entry of an array by points; NaN if there is one."""
        return float(values.max())

    def extent(self, points: np.ndarray) -> float:
        """Greatest side of the box around points, shape (n, d)."""
        return float(np.ptp(points, axis=0).max())

    def total_of_parts(self, part):
        """Sum of what has been formed of every part."""
        return part

    def greatest_of_parts(self, part: float) -> float:
        """Greatest of what has been formed of every part; NaN if there is one."""
        return float(part)

    def any(self, flag: bool) -> bool:
        """Whether something holds in one part or another."""
        return bool(flag)

    def total_size(self, n: int) -> int:
        """Points of the whole body, of which n are here."""
        return n

    def take(self, values: np.ndarray) -> np.ndarray:
        """Of values of all points of the whole body those of the points here."""
        return values

    def union(self, values: np.ndarray) -> np.ndarray:
        """Values that some part has, each once and rising."""
        return np.unique(values)

    def spread(self, values: np.ndarray) -> float:
        """Standard deviation of values at the points, shape (n,)."""
        return float(values.std())

    def of_all(self, rows: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Rows that belong to points here, with those of all other parts."""
        return rows

    def counts(self, points: np.ndarray) -> np.ndarray:
        """Of the given points those that are counted here."""
        return points

    def pieces(self, n: int, first: np.ndarray, second: np.ndarray) -> tuple[int, np.ndarray]:
        """Pieces into which bonds connect n points: how many there are, and the number of every point's, shape (n,)."""
        graph = sparse.coo_matrix((np.ones(len(first), np.int8), (first, second)), shape=(n, n))
        return connected_components(graph, directed=False)


LOCAL = LocalReductions()
"""What solvers take where nothing else is given to them."""
