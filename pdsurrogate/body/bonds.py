"""Bonds of a body: which points and images interact, and the lists in which they are found."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

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
    pointers : ndarray of uint64, shape (n + 1,)
        Index at which the neighbors of each point begin.
    neighbors : ndarray of uint32
        Neighbors of all points; numbers from n on are ghosts.
    ends : ndarray of uint32, shape (2, k)
        Ends of the pairs, filled up with zeros to a multiple k of `PADDED`.
    n_pairs : int
    pair_pointers : ndarray of uint64, shape (n + 1,)
        Index at which the pairs with each point as `first` begin.
    incidence_pointers : ndarray of uint64, shape (n + 1,)
        Index at which the entries of each point in `incidence` begin.
    incidence : ndarray of uint32
        Pairs in which each point is `second`.
    pair_of : ndarray of uint32
        Pair of each entry of `neighbors`.
    cut : ndarray, shape (k, 2)
        Ends of the pairs that cuts or holes of the undeformed body separate; these pairs are in
        none of the lists.
    n_directed : int
        Number of directed bonds within the body, without ghosts.
    first, second : ndarray of uint32, shape (n_pairs,)
        Ends of the pairs, ordered by `first`, which is a point of the body; `second` is a later
        point or an image.
    """

    pointers: np.ndarray
    neighbors: np.ndarray
    ends: np.ndarray
    n_pairs: int
    pair_pointers: np.ndarray
    incidence_pointers: np.ndarray
    incidence: np.ndarray
    pair_of: np.ndarray
    cut: np.ndarray
    n_directed: int

    @cached_property
    def first(self) -> np.ndarray:
        return self.ends[0, : self.n_pairs]

    @cached_property
    def second(self) -> np.ndarray:
        return self.ends[1, : self.n_pairs]

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
        separates: Callable | None,
    ) -> Bonds:
        """Return the bonds of a body with the given points and ghosts; for `separates` see `Body`.

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
        first, second = _pairs_within(every, horizon * WITH_ROUNDING, n)
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
        numbers = np.arange(len(first), dtype=np.uint32)
        ends = np.stack([np.pad(end, (0, -len(end) % PADDED)) for end in (first, second)])

        within = np.flatnonzero(second < n).astype(np.uint32)
        incidence = within[np.argsort(second[within], kind="stable")]
        # The neighbors of a point are in rising order: first those of pairs in which it is second,
        # then those in which it is first.
        owner = np.concatenate([second[incidence], first])
        order = np.argsort(owner, kind="stable")
        neighbors = np.concatenate([first[incidence], second])[order]
        pair_of = np.concatenate([incidence, numbers])[order]
        return cls(
            pointers_to(owner, n),
            np.ascontiguousarray(neighbors),
            ends,
            len(first),
            pointers_to(first, n),
            pointers_to(second[within], n),
            incidence,
            pair_of,
            cut,
            2 * len(within),
        )


def pointers_to(numbers: np.ndarray, count: int) -> np.ndarray:
    """Return row pointers, shape (count + 1,): where the entries of each number from 0 to count
    - 1 begin in the sorted `numbers`.
    """
    return np.concatenate([[0], np.cumsum(np.bincount(numbers, minlength=count))]).astype(np.uint64)


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
