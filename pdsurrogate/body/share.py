"""The share of a body that one process works on; in this module, of one process that has the whole body."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components


class Share:
    """The share of one process that has the whole body: it owns every point, and exchanges nothing.

    `pdsurrogate.ranks.RankShare` has the same methods for a body that several ranks divide among themselves. Points of a share that other
    ranks own are its *halo*: values summed over all bonds of a point are right on owned points, and are copied from there to the halo.

    Reductions take one of two kinds of argument. `dot`, `sum`, `sum_in_order`, `maximum`, `extent` and `spread` take an array with a row
    for every point that is here, and count each point of the body once. `total`, `greatest`, `any` and `any_of` take what has been formed
    of the points and bonds that are here: a number, a few of them, or a small array.
    """

    divided = False
    leads = True
    """Whether values known to all shares are counted on this one."""

    def fill(self, values: np.ndarray) -> None:
        """Copy the rows of the halo from their owners; `values` has a row for every point."""

    def fill_bonds(self, values: np.ndarray, body) -> None:
        """Copy the values of directed bonds of halo points from their owners, shape (n_bonds,)."""

    def fold(self, values: np.ndarray) -> None:
        """Add the rows of the halo to those of their owners and set them to zero, the transpose of `fill`."""

    def clear(self, values: np.ndarray) -> None:
        """Set the rows of the halo to zero."""

    def agree(self, error: Exception | None) -> None:
        """Raise, on every rank, an error that any rank has found; `error` is the one found on this rank."""
        if error is not None:
            raise error

    def everywhere(self, rows):
        """Return the rows of all shares in a list."""
        return [rows]

    def any(self, flag: bool) -> bool:
        """Return whether a flag is set on any share."""
        return bool(flag)

    def any_of(self, flags: np.ndarray) -> np.ndarray:
        """Return which of several flags are set on any share."""
        return flags

    def total(self, here):
        """Return the sum over all shares of a number, of each of a few numbers, or of an array."""
        return here

    def greatest(self, here: float) -> float:
        """Return the greatest of a number over all shares; NaN if one of them is."""
        return float(here)

    def dot(self, first: np.ndarray, second: np.ndarray, weights: np.ndarray | None = None) -> float:
        """Return the inner product of two arrays (n, d), every point with its weight (n,).

        NumPy sums it rather than BLAS, whose threads would wait for those of the kernels, and whose sum depends on their number.
        """
        if weights is None:
            return float(np.einsum("nc,nc->", first, second))
        return float(np.einsum("n,nc,nc->", weights, first, second))

    def sum(self, values: np.ndarray) -> float:
        """Return the sum of all entries of an array by points."""
        return float(values.sum())

    def sum_in_order(self, values: np.ndarray) -> float:
        """Return `sum` to the same bits on any number of ranks; this brings all entries to one rank."""
        return float(values.sum())

    def maximum(self, values: np.ndarray) -> float:
        """Return the greatest entry of an array by points; NaN if there is one."""
        return float(values.max())

    def extent(self, points: np.ndarray) -> float:
        """Return the longest side of the box around points (n, d)."""
        return float(np.ptp(points, axis=0).max())

    def spread(self, values: np.ndarray) -> float:
        """Return the standard deviation of values at the points, shape (n,)."""
        return float(values.std())

    def union(self, values: np.ndarray) -> np.ndarray:
        """Return the values that any share has, each once and rising."""
        return np.unique(values)

    def of_all(self, rows: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return rows that belong to points here, together with the rows of all other shares."""
        return rows

    def pieces(self, n: int, first: np.ndarray, second: np.ndarray) -> tuple[int, np.ndarray]:
        """Return the number of pieces into which bonds connect n points, and the piece of every point, shape (n,)."""
        graph = sparse.coo_matrix((np.ones(len(first), np.int8), (first, second)), shape=(n, n))
        return connected_components(graph, directed=False)

    def counted(self, volumes: np.ndarray) -> np.ndarray:
        """Return the values (n,) of the points with zeros on the halo, so that sums over shares count each point once."""
        return volumes

    def counted_pairs(self, first: np.ndarray) -> np.ndarray | None:
        """Return which pairs with these first points are counted on this share, each on one share; None where all are."""
        return None

    def own_points(self, points: np.ndarray) -> np.ndarray:
        """Return those of the given points that are counted on this share."""
        return points

    def own_columns(self, rows):
        """Return linear maps (k, n) from the points of the whole body, restricted to those counted here; the shares sum to the maps."""
        return rows

    def with_rows_of_others(self, rows):
        """Return a sparse matrix (n, n), of which the rows of own points are given, with the rows of the halo copied from their owners."""
        return rows

    def beside_halo(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Return the numbers of the pairs with an end in the halo, or an image of a halo point."""
        return np.empty(0, dtype=np.int64)

    def number(self, point: int) -> int:
        """Return the number of a point in the whole body, for messages."""
        return point

    def local(self, numbers: np.ndarray) -> np.ndarray:
        """Return the points of this share that have the given numbers in the whole body, in rising order."""
        return numbers

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Return the values of all points of the whole body, in its order, on the first rank; None on the others."""
        return values

    def to_whole(self, values: np.ndarray, body, rows: str) -> np.ndarray | None:
        """Return an array of a body in the order of the whole body, on the first rank; None on the others.

        `rows` names what the array has a row for: "points", "images" (points and images), "bonds" (directed bonds), or "pairs".
        """
        return values

    def from_whole(self, values: np.ndarray | None, body, rows: str) -> np.ndarray:
        """Return the rows of this share, the inverse of `to_whole`; `values` is None on ranks other than the first."""
        return values

    def rows_of_whole(self, count: int, body, rows: str) -> int:
        """Return the number of rows of the whole body, where this share has `count`."""
        return count

    def pair_numbers(self, body) -> np.ndarray:
        """Return the numbers of this share's pairs in the whole body; -1 for those that are not counted here."""
        return np.arange(len(body.bonds.first))

    def take(self, values: np.ndarray) -> np.ndarray:
        """Return the rows of this share's points from values of all points of the whole body."""
        return values

    def size(self, n: int) -> int:
        """Return the number of points of the whole body, of which n are here."""
        return n


SERIAL = Share()
"""Share of a body that one process has whole."""
