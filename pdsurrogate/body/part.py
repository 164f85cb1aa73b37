"""What a body is of a larger one: all of it, or the points that one of several ranks owns with those around them."""

from __future__ import annotations

import numpy as np


class Whole:
    """A body that is all there: every point counts, and nothing has to be brought from elsewhere.

    Bodies in parts have another (`pdsurrogate.ranks.Part`) that answers the same questions.  Points of a part that others own are its
    *halo*: what is summed or found by looking at all bonds of a point is right on the points that are owned, and is brought to the halo
    from there.
    """

    divided = False
    leads = True
    """Whether what all parts know is counted here."""

    def fill(self, values: np.ndarray) -> None:
        """Bring the rows of the halo up to date, from those who own them; values has a row for every point."""

    def fill_bonds(self, values: np.ndarray, body) -> None:
        """The same of values of the directed bonds of a body, shape (n_bonds,)."""

    def fold(self, values: np.ndarray) -> None:
        """Add the rows of the halo to those of their owners, and set them to zero: the transpose of `fill`."""

    def clear(self, values: np.ndarray) -> None:
        """Set the rows of the halo to zero."""

    def agree(self, error: Exception | None) -> None:
        """Raise an error everywhere that is found anywhere; `error` is the one that has been found here."""
        if error is not None:
            raise error

    def everywhere(self, rows):
        """What all parts have, in a list."""
        return [rows]

    def any(self, flag: bool) -> bool:
        """Whether something holds in one part or another."""
        return bool(flag)

    def any_of(self, flags: np.ndarray) -> np.ndarray:
        """The same of several things."""
        return flags

    def total(self, part):
        """Sum of a number or an array of every part."""
        return part

    def counted(self, volumes: np.ndarray) -> np.ndarray:
        """Values (n,) of the points, zero on the halo: what this part has to count."""
        return volumes

    def counted_pairs(self, first: np.ndarray) -> np.ndarray | None:
        """Which pairs of given first points are counted here, each by one part; None where all are."""
        return None

    def own_points(self, points: np.ndarray) -> np.ndarray:
        """Of some points those that are counted here."""
        return points

    def own_columns(self, rows):
        """Of linear maps (k, n) from the points of the whole body that from those counted here: the sum over all parts is the map."""
        return rows

    def with_rows_of_others(self, rows):
        """A sparse matrix (n, n) of which the rows of own points are there, with those of the halo from their owners."""
        return rows

    def beside_halo(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Numbers of the pairs of which an end is in the halo, or an image of a point there."""
        return np.empty(0, dtype=np.int64)

    def number(self, point: int) -> int:
        """Of a point in the whole body, for messages."""
        return point

    def local(self, numbers: np.ndarray) -> np.ndarray:
        """Points here that have given numbers in the whole body, rising."""
        return numbers

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Values of all points of the whole body, in its order; None on ranks other than the first."""
        return values

    def to_whole(self, values: np.ndarray, body, rows: str) -> np.ndarray | None:
        """An array of a body as the whole body has it, on the first rank; None on the others.

        Parameters
        ----------
        values : ndarray
        body : Body
            That this is the part of.
        rows : {"points", "images", "bonds", "pairs"}
            What it has a row for: every point, every point and image, every directed bond, or every pair.
        """
        return values

    def from_whole(self, values: np.ndarray | None, body, rows: str) -> np.ndarray:
        """The way back of `to_whole`; `values` is None on ranks other than the first."""
        return values

    def rows_of_whole(self, count: int, body, rows: str) -> int:
        """How many rows the whole body has where there are `count` here."""
        return count

    def pair_numbers(self, body) -> np.ndarray:
        """Numbers in the whole body of the pairs here; those that are not counted here have none, and -1."""
        return np.arange(len(body.bonds.first))

    def take(self, values: np.ndarray) -> np.ndarray:
        """Of values of all points of the whole body those of the points here."""
        return values

    def size(self, n: int) -> int:
        """Points of the whole body, of which n are here."""
        return n


WHOLE = Whole()
