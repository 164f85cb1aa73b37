"""Bonds of a body: which points and images interact, and the lists in which they are found."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from ..kernels.lists import list_ends, pairs_on_lattice, sort_numbers
from .ghosts import WITH_ROUNDING, Ghosts

MOST_BONDS = 500_000_000
"""Greatest number of bonds: at 80 bytes a bond more would exceed the memory of a workstation."""

PADDED = 1024
"""The ends of pairs are stored filled up with zeros to a multiple of this number, which is a
multiple of the blocks of all kernels.
"""

SLAB = 500_000
"""Number of pairs of which `Bonds.slabs` makes a part. Chosen: a temporary array of doubles then
takes 4 MB, and calls of NumPy cost nothing beside the work on so many numbers.
"""

EMPTY = 16
"""Greatest number of places of a lattice for each point on it; in emptier boxes pairs are found by
a search. Chosen: the table of the places then takes no more than the lists of a point's pairs.
"""

ON_LATTICE = 1e-9
"""Greatest distance of points from the places of a lattice, in cells. Chosen above the rounding of
positions; it decides about the horizon no more than `WITH_ROUNDING` does.
"""

COINCIDING = 1e-9
"""Distance of two points, divided by the horizon, below which the points are refused as coinciding:
a bond between them has no direction. Chosen far above the rounding of positions and far below any
spacing.
"""


@dataclass(frozen=True)
class Bonds:
    """Bonds of a body: neighbor lists of all points (directed bonds), and a list of pairs.

    A *pair* is an undirected bond. A pair of two points of the body appears in the neighbor lists
    of both; a pair of a point and an image appears in the list of the point only.

    Attributes
    ----------
    ends : ndarray of uint32, shape (2, k)
        Ends of the pairs, filled up with zeros to a multiple k of `PADDED`.
    n_pairs : int
    pairs_of_points : tuple of ndarray
        Pairs of all points and ghosts, see `pairs_of_points`.
    pointers : ndarray of uint64, shape (n + 1,)
        Index at which the neighbors of each point begin.
    cut : ndarray, shape (k, 2)
        Ends of the pairs that cuts or holes of the undeformed body separate; these pairs are in
        none of the lists.
    neighbors : ndarray of uint32
        Neighbors of all points; numbers from n on are ghosts.
    pair_of : ndarray of uint32
        Pair of each entry of `neighbors`.
    n_directed : int
        Number of directed bonds within the body, without ghosts.
    first, second : ndarray of uint32, shape (n_pairs,)
        Ends of the pairs, ordered by `first`, which is a point of the body; `second` is a later
        point or an image.
    """

    ends: np.ndarray
    n_pairs: int
    pairs_of_points: tuple[np.ndarray, np.ndarray, np.ndarray]
    pointers: np.ndarray
    cut: np.ndarray

    @cached_property
    def first(self) -> np.ndarray:
        return self.ends[0, : self.n_pairs]

    @cached_property
    def second(self) -> np.ndarray:
        return self.ends[1, : self.n_pairs]

    @cached_property
    def neighbors(self) -> np.ndarray:
        return self.neighbors_of(np.arange(len(self.pointers) - 1))

    @cached_property
    def pair_of(self) -> np.ndarray:
        pairs = np.arange(self.n_pairs, dtype=np.uint32)
        return self._at_points(np.arange(len(self.pointers) - 1), pairs, pairs)

    def neighbors_of(self, points: np.ndarray) -> np.ndarray:
        """Return the neighbors of some points, those of one after the other."""
        return self._at_points(points, *self.ends)

    @property
    def n_directed(self) -> int:
        return 2 * int(self.pairs_of_points[1][len(self.pointers) - 1])

    def _at_points(
        self, points: np.ndarray, backward: np.ndarray, forward: np.ndarray
    ) -> np.ndarray:
        """Return a value for each directed bond of some points: that of its pair in `forward`, or
        in `backward` where it begins at the second end.
        """
        count = (self.pointers[points + 1] - self.pointers[points]).sum()
        found = np.empty(int(count), dtype=np.uint32)
        list_ends(points, *self.pairs_of_points, backward, forward, found)
        return found

    def ends_in_blocks(self, block: int) -> tuple[np.ndarray, np.ndarray]:
        """Return `first` and `second` filled up with zeros to a multiple of `block`, which divides
        `PADDED`.

        Kernels ignore the results of the zeros.
        """
        first, second = self.ends[:, : -(-self.n_pairs // block) * block]
        return first, second

    def slabs(self) -> Iterator[slice]:
        """Yield the pairs in parts, whose temporary arrays are small beside those that the pairs
        of a large body hold.
        """
        for start in range(0, self.n_pairs, SLAB):
            yield slice(start, min(start + SLAB, self.n_pairs))

    @classmethod
    def of(
        cls,
        points: np.ndarray,
        ghosts: Ghosts,
        horizon: float,
        spacing: float,
        cell: np.ndarray,
        separates: Callable | None,
    ) -> Bonds:
        """Return the bonds of a body with the given points and ghosts; for the others see `Body`.

        Raise ValueError if they are too many, or if there are none.
        """
        n, d, reach = *points.shape, horizon / spacing
        every = np.concatenate([points, ghosts.points])
        estimate = n / 2 * min(len(every), (np.pi if d == 2 else 4 / 3 * np.pi) * reach**d)
        if estimate > MOST_BONDS:
            raise ValueError(
                f"a horizon of {reach:.3g} spacings makes {estimate:.1g} bonds, more than"
                f" {MOST_BONDS:.1g}; reduce it"
            )
        # The tolerance includes points at exactly the horizon, whose computed distance may exceed
        # it by rounding.
        reach = horizon * WITH_ROUNDING
        found = _pairs_on_lattice(every, cell, reach, n)
        first, second = _pairs_within(every, reach, n) if found is None else found
        first, second = _with_partners(points, ghosts, horizon, first, second)
        cut = np.empty((0, 2), dtype=np.uint32)
        if separates is not None and len(first):
            # Empty space beyond a held boundary does not separate images there: the bond to the
            # source decides.
            separated = separates(points[first], np.concatenate([points, ghosts.unfolded])[second])
            cut = np.stack([first[separated], second[separated]], axis=1)
            first = first[~separated]
            second = second[~separated]
        if len(first) == 0:
            raise ValueError(
                f"the horizon {horizon:g} is too small: it contains no neighbor at the spacing"
                f" {spacing:g}"
            )
        ends = np.zeros((2, -(-len(first) // PADDED) * PADDED), dtype=np.uint32)
        ends[0, : len(first)] = first
        ends[1, : len(first)] = second
        own, others, incidence = pairs_of_points(first, second, len(every))
        pointers = (own + others)[: n + 1]
        return cls(ends, len(first), (own, others, incidence), pointers, cut)


def pairs_of_points(
    first: np.ndarray, second: np.ndarray, total: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pairs of each of `total` points, given by their ends, where `first` is sorted, in
    three arrays.

    They are: index at which the pairs with each point as first end begin; index into the third
    array at which the pairs with each as second end begin; numbers of the pairs ordered by second
    end.
    """
    others, incidence = np.zeros(total + 1, np.uint64), np.empty(len(second), np.uint32)
    sort_numbers(second, others, incidence)
    return pointers_to(first, total), others, incidence


def pointers_to(numbers: np.ndarray, count: int) -> np.ndarray:
    """Return row pointers, shape (count + 1,): where the entries of each number from 0 to count
    - 1 begin in the sorted `numbers`, which others may follow.
    """
    pointers = np.zeros(count + 1, dtype=np.uint64)
    sort_numbers(numbers.astype(np.uint32, copy=False), pointers, np.empty(0, dtype=np.uint32))
    return pointers


def _with_partners(
    points: np.ndarray, ghosts: Ghosts, horizon: float, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs without those across a held boundary whose ends' sources, or whose mirrored
    pair, are farther apart than a horizon.

    For a pair of i and an image of k, the mirrored pair is that of k and the same boundary's image
    of i. Beyond planes it has the same length; beyond a round boundary it need not, and forces of
    ghosts on their sources are reported as forces of mirrored pairs.
    """
    n = len(points)
    outer = np.flatnonzero(second >= n)
    outer = outer[(ghosts.points != ghosts.unfolded).any(axis=1)[second[outer] - n]]
    if not len(outer):
        return first, second
    one = first[outer].astype(np.int64)
    ghost = second[outer].astype(np.int64) - n
    mirrored = ghosts.mirrored(one, ghost)
    source = ghosts.source[ghost]
    reach = horizon * WITH_ROUNDING
    apart = np.linalg.norm(points[one] - ghosts.unfolded[ghost], axis=1) > reach
    apart |= (mirrored < 0) | (
        np.linalg.norm(points[source] - ghosts.points[mirrored], axis=1) > reach
    )
    kept = np.delete(np.arange(len(first)), outer[apart])
    return first[kept], second[kept]


def check_apart(tree: scipy.spatial.cKDTree, least: float) -> None:
    """Raise ValueError if two points of a search tree are nearer to each other than `least`."""
    near = tree.query_pairs(least, output_type="ndarray")
    if len(near):
        one, other = near[0]
        raise ValueError(f"points {one} and {other} coincide at {tree.data[one]}")


def _pairs_within(points: np.ndarray, reach: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs i < j of points (n, d) within `reach` of each other, with i < `count`, as
    sorted arrays of i and of j.
    """
    tree = scipy.spatial.cKDTree(points)
    total = len(points)
    check_apart(tree, COINCIDING * reach)
    # Sorting one number per pair is five times as fast as sorting two.
    one, other = tree.query_pairs(reach, output_type="ndarray").T
    keys = np.minimum(one, other) * total + np.maximum(one, other)
    del one, other
    keys = keys[keys < count * total]
    keys.sort()
    first, second = np.divmod(keys, total)
    return first.astype(np.uint32), second.astype(np.uint32)


def _pairs_on_lattice(
    points: np.ndarray, cell: np.ndarray, reach: float, count: int
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the pairs as `_pairs_within` does, from the numbers of the points in a table of the
    places of a lattice with the sides `cell`; None if the points are on none or coincide.
    """
    places = (points - points.min(axis=0)) / cell
    steps = np.rint(places)
    margin = (reach / cell).astype(int)
    shape = steps.max(axis=0) + 2 * margin + 1
    if np.abs(places - steps).max() > ON_LATTICE or shape.prod() > EMPTY * len(points) + 1e6:
        return None
    # The first coordinate varies fastest, as in the numbers of `Cells.centers`.
    strides = np.append(1, shape[:-1]).cumprod().astype(int)
    at = (steps.astype(int) + margin) @ strides
    table = np.full(int(shape.prod()), -1, dtype=np.int32)
    table[at] = np.arange(len(points))
    if (table[at] != np.arange(len(points))).any():
        return None
    ways = np.stack(np.meshgrid(*(np.arange(-m, m + 1) for m in margin)), axis=-1)
    ways = ways.reshape(-1, len(margin))
    ways = np.sort(ways[np.linalg.norm(ways * cell, axis=1) <= reach] @ strides)
    lattice = table, at[:count], ways
    nothing = np.empty(0, dtype=np.uint32)
    first, second = np.empty((2, pairs_on_lattice(*lattice, nothing, nothing)), dtype=np.uint32)
    pairs_on_lattice(*lattice, first, second)
    return first, second
