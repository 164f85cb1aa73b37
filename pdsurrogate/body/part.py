"""Parts of a body that several ranks share; this module has the part that is the whole body."""

from __future__ import annotations

import numpy as np


class Whole:
    """The part that is the whole body: every point is owned, and nothing is exchanged.

    `pdsurrogate.ranks.Part` has the same methods for a body that ranks share. Points of a part that other ranks own are its *halo*: values
    summed over all bonds of a point are right on owned points, and are copied from there to the halo.
    """

    divided = False
    leads = True
    """Whether values known to all parts are counted on this one."""

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
        """Return the rows of all parts in a list."""
        return [rows]

    def any(self, flag: bool) -> bool:
        """Return whether a flag is set on any part."""
        return bool(flag)

    def any_of(self, flags: np.ndarray) -> np.ndarray:
        """Return which of several flags are set on any part."""
        return flags

    def total(self, part):
        """Return the sum of a number or an array over all parts."""
        return part

    def counted(self, volumes: np.ndarray) -> np.ndarray:
        """Return the values (n,) of the points with zeros on the halo, so that sums over parts count each point once."""
        return volumes

    def counted_pairs(self, first: np.ndarray) -> np.ndarray | None:
        """Return which pairs with these first points are counted on this part, each on one part; None where all are."""
        return None

    def own_points(self, points: np.ndarray) -> np.ndarray:
        """Return those of the given points that are counted on this part."""
        return points

    def own_columns(self, rows):
        """Return linear maps (k, n) from the points of the whole body, restricted to those counted here; the parts sum to the maps."""
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
        """Return the points of this part that have the given numbers in the whole body, in rising order."""
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
        """Return the rows of this part, the inverse of `to_whole`; `values` is None on ranks other than the first."""
        return values

    def rows_of_whole(self, count: int, body, rows: str) -> int:
        """Return the number of rows of the whole body, where this part has `count`."""
        return count

    def pair_numbers(self, body) -> np.ndarray:
        """Return the numbers of this part's pairs in the whole body; -1 for those that are not counted here."""
        return np.arange(len(body.bonds.first))

    def take(self, values: np.ndarray) -> np.ndarray:
        """Return the rows of this part's points from values of all points of the whole body."""
        return values

    def size(self, n: int) -> int:
        """Return the number of points of the whole body, of which n are here."""
        return n


WHOLE = Whole()
