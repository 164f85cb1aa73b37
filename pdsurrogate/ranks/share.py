"""The share of a body that one rank works on: points of its own, and a halo of points that other ranks own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..body import Body
from ..body.share import Share
from .communicator import Communicator
from .partition import bisected, bond_counts

HALO = 1.0
"""Width of the halo in horizons.

One horizon holds the bonds of a rank's own points. Quantities of halo points that need all of their bonds (deformation gradients, moments)
come from their owners. The alternative is a halo of two horizons for force maps, three for bond energies and five with smoothed
dilatations: a share of 60 points a side of a solid would then hold 2.1 times its own points.
"""


class RankShare(Share):
    """The points of one rank and its halo.

    Points are numbered in the order of the whole body, points of the halo between its own, so that sums over bonds are taken in the same
    order on any number of ranks, to the same bits.

    Parameters
    ----------
    ranks : Communicator
    numbers : ndarray of int, shape (n,)
        Of the points in the whole body, rising.
    owners : ndarray of int, shape (n,)
        The rank that owns each.
    total : int
        Points of the whole body.

    Attributes
    ----------
    own : ndarray of bool, shape (n,)
    rank : int
    ranks, numbers, owners
    """

    divided = True

    def __init__(self, ranks: Communicator, numbers: np.ndarray, owners: np.ndarray, total: int) -> None:
        self.ranks, self.numbers, self._total = ranks, numbers, total
        self.own, self.owners, self.rank, self.leads = owners == ranks.rank, owners, ranks.rank, ranks.rank == 0
        self._weights, self._own = self.own.astype(float), np.flatnonzero(self.own)
        self._halo = np.flatnonzero(~self.own)
        self._receive = {rank: np.flatnonzero(owners == rank) for rank in np.unique(owners[self._halo]).tolist()}
        wanted = ranks.to_each([numbers[self._receive[rank]] if rank in self._receive else numbers[:0] for rank in range(ranks.size)])
        self._send = {rank: np.searchsorted(numbers, asked) for rank, asked in enumerate(wanted) if len(asked)}
        self._bonds: tuple[dict[int, np.ndarray], dict[int, np.ndarray]] | None = None

    def __deepcopy__(self, memo):
        return self

    def fill(self, values: np.ndarray) -> None:
        self._exchange(values, self._send, self._receive)

    def _exchange(self, values: np.ndarray, send: dict[int, np.ndarray], receive: dict[int, np.ndarray]) -> None:
        """Send rows of values to other ranks and receive the rows of the halo."""
        incoming = {rank: np.empty((len(rows), *values.shape[1:]), dtype=values.dtype) for rank, rows in receive.items()}
        self.ranks.exchange({rank: values[rows] for rank, rows in send.items()}, incoming)
        for rank, rows in receive.items():
            values[rows] = incoming[rank]

    def fold(self, values: np.ndarray) -> None:
        incoming = {rank: np.empty((len(rows), *values.shape[1:])) for rank, rows in self._send.items()}
        self.ranks.exchange({rank: values[rows] for rank, rows in self._receive.items()}, incoming)
        for rank, rows in sorted(self._send.items()):
            values[rows] += incoming[rank]
        self.clear(values)

    def fill_bonds(self, values: np.ndarray, body: Body) -> None:
        if self._bonds is None:
            self._bonds = self._find_bonds(body)
        self._exchange(values, *self._bonds)

    def _find_bonds(self, body: Body) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
        """Return, by rank, the directed bonds of own points in the halos of others, and those of the halo here, in matching order."""
        bonds, ghosts = body.bonds, body.ghosts
        starts = bonds.pointers.astype(np.int64)
        # A neighbour has one name on all ranks: its number in the whole body, and the reflections that it is an image under.
        names = np.concatenate([self.numbers, self.numbers[ghosts.source] + ghosts.image * self._total])[bonds.neighbours]
        receive, asked = {}, []
        for rank in range(self.ranks.size):
            points = self._receive.get(rank)
            if points is None:
                asked.append(None)
                continue
            counts = starts[points + 1] - starts[points]
            receive[rank] = np.repeat(starts[points] - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
            asked.append((np.repeat(self.numbers[points], counts), names[receive[rank]]))
        owners = np.repeat(self.numbers, np.diff(starts))
        # A point's neighbours differ in their names, so that a pair of both tells a bond.
        span = self._total * 2 ** len(body.planes)
        keys = owners * span + names
        order = np.argsort(keys)
        send = {}
        for rank, wanted in enumerate(self.ranks.to_each(asked)):
            if wanted is not None:
                points, neighbours = wanted
                send[rank] = order[np.searchsorted(keys, points * span + neighbours, sorter=order)]
        return send, receive

    def clear(self, values: np.ndarray) -> None:
        values[self._halo] = 0

    def agree(self, error: Exception | None) -> None:
        self.ranks.agree(error)

    def any(self, flag: bool) -> bool:
        return self.ranks.total(int(bool(flag))) > 0

    def any_of(self, flags: np.ndarray) -> np.ndarray:
        return self.ranks.total(flags.astype(np.int64)) > 0

    def total(self, here):
        return self.ranks.total(here)

    def counted(self, volumes: np.ndarray) -> np.ndarray:
        return volumes * self._weights

    def counted_pairs(self, first: np.ndarray) -> np.ndarray:
        return self.own[first]

    def own_points(self, points: np.ndarray) -> np.ndarray:
        return points[self.own[points]]

    def own_columns(self, rows):
        found = (rows.tocsc()[:, self.numbers] @ sparse.diags_array(self._weights)).tocsr()
        found.eliminate_zeros()
        return found

    def with_rows_of_others(self, rows):
        entries = rows.tocoo()
        own = self.own[entries.row]
        found = self.numbers[entries.row[own]], self.numbers[entries.col[own]], entries.data[own]
        row, column, value = (np.concatenate(parts) for parts in zip(*self.ranks.everywhere(found), strict=True))
        places = np.full(self._total, -1)
        places[self.numbers] = np.arange(len(self.numbers))
        row, column = places[row], places[column]
        here = (row >= 0) & (column >= 0)
        return sparse.csr_array((value[here], (row[here], column[here])), shape=rows.shape)

    def beside_halo(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        elsewhere = ~self.own
        within = second < len(self.own)
        found = elsewhere[first]
        found[within] |= elsewhere[second[within]]
        return np.flatnonzero(found | ~within)

    def number(self, point: int) -> int:
        return int(self.numbers[point])

    def local(self, numbers: np.ndarray) -> np.ndarray:
        places = np.searchsorted(self.numbers, numbers)
        places[places == len(self.numbers)] = 0
        return np.unique(places[self.numbers[places] == numbers])

    def gather(self, values: np.ndarray) -> np.ndarray | None:
        rows = self.ranks.gather(np.ascontiguousarray(values[self.own]))
        numbers = self.ranks.gather(self.numbers[self.own])
        if rows is None:
            return None
        whole = np.empty((self._total, *values.shape[1:]), dtype=values.dtype)
        for places, found in zip(numbers, rows, strict=True):
            whole[places] = found
        return whole

    def to_whole(self, values: np.ndarray, body: Body, rows: str) -> np.ndarray | None:
        if rows == "points":
            return self.gather(values)
        if rows != "images":
            return self._gather_each(values, self._counts(body, rows))
        n = len(self.own)
        points, names, images = self.gather(values[:n]), self._gather_images(body), self.ranks.gather(values[n:][self._own_images(body)])
        return None if points is None else np.concatenate([points, np.concatenate(images)[np.argsort(names)]])

    def from_whole(self, values: np.ndarray | None, body: Body, rows: str) -> np.ndarray:
        if rows == "points":
            return self._hand_out(values)
        if rows == "images":
            first = self.ranks.rank == 0
            points = self._hand_out(values[: self._total] if first else None)
            names, wanted = self._gather_images(body), self.ranks.gather(self._image_names(body))
            images = [values[self._total :][np.searchsorted(np.sort(names), asked)] for asked in wanted] if first else None
            return np.concatenate([points, self.ranks.hand_out(images)])
        found = self._hand_out_each(values, self._counts(body, rows))
        if rows == "bonds":
            self.fill_bonds(found, body)
            return found
        # Pairs whose first point is in the halo, from that point's owner, as values of the bond from there.
        bonds = body.bonds
        directed = found[bonds.pair_of]
        self.fill_bonds(directed, body)
        owners = np.repeat(np.arange(len(self.own)), self._counts(body, "bonds"))
        forward = owners == bonds.first[bonds.pair_of]
        found[bonds.pair_of[forward]] = directed[forward]
        return found

    def rows_of_whole(self, count: int, body: Body, rows: str) -> int:
        if rows == "points":
            return self._total
        if rows == "images":
            return self._total + self.ranks.total(int(self._own_images(body).sum()))
        return self.ranks.total(int(self._counts(body, rows)[self.own].sum()))

    @staticmethod
    def _counts(body: Body, rows: str) -> np.ndarray:
        """Return the number of directed bonds, or of pairs as their first point, of every point."""
        pointers = body.bonds.pointers if rows == "bonds" else body.bonds.pair_pointers
        return np.diff(pointers).astype(np.int64)

    def pair_numbers(self, body: Body) -> np.ndarray:
        counts = self._counts(body, "pairs")
        numbers = np.repeat(self._starts(counts) - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
        numbers[~self.own[body.bonds.first]] = -1
        return numbers

    def _image_names(self, body: Body) -> np.ndarray:
        """Return the names of images on all ranks; the whole body holds them in the order of these names."""
        return body.ghosts.image * self._total + self.numbers[body.ghosts.source]

    def _own_images(self, body: Body) -> np.ndarray:
        return self.own[body.ghosts.source]

    def _gather_images(self, body: Body) -> np.ndarray | None:
        names = self.ranks.gather(self._image_names(body)[self._own_images(body)])
        return None if names is None else np.concatenate(names)

    def _hand_out(self, values: np.ndarray | None) -> np.ndarray:
        """Return the values of the points here, from values of all points on the first rank."""
        numbers = self.ranks.gather(self.numbers)
        return self.ranks.hand_out(None if numbers is None else [values[places] for places in numbers])

    def _gather_each(self, values: np.ndarray, counts: np.ndarray) -> np.ndarray | None:
        """Return `gather` of values of which every point has several, counts of shape (n,), point by point."""
        rows, places = self.ranks.gather(values[np.repeat(self.own, counts)]), self._places_of_each(counts)
        if rows is None:
            return None
        whole = np.empty((sum(map(len, rows)), *values.shape[1:]), dtype=values.dtype)
        for entries, found in zip(places, rows, strict=True):
            whole[entries] = found
        return whole

    def _hand_out_each(self, values: np.ndarray | None, counts: np.ndarray) -> np.ndarray:
        """Return the values of this rank, the inverse of `_gather_each`; those of the halo are zero."""
        places = self._places_of_each(counts)
        own = self.ranks.hand_out(None if places is None else [values[entries] for entries in places])
        found = np.zeros((int(counts.sum()), *own.shape[1:]), dtype=own.dtype)
        found[np.repeat(self.own, counts)] = own
        return found

    def _starts(self, counts: np.ndarray) -> np.ndarray:
        """Return the places at which the values of every point here begin in those of the whole body."""
        all_counts = self.gather(counts)
        return self._hand_out(None if all_counts is None else np.cumsum(all_counts) - all_counts)

    def _places_of_each(self, counts: np.ndarray) -> list[np.ndarray] | None:
        """Return, on the first rank, the places in the whole body of the values of every rank's own points; None on others."""
        begins, own = self.ranks.gather(self._starts(counts)[self.own]), self.ranks.gather(counts[self.own])
        if begins is None:
            return None
        # Of every point a run of numbers from its beginning.
        return [
            np.repeat(begin - np.cumsum(count) + count, count) + np.arange(count.sum()) for begin, count in zip(begins, own, strict=True)
        ]

    def dot(self, first, second, weights=None):
        weights = self._weights if weights is None else self._weights * weights
        return self.ranks.total(super().dot(first, second, weights))

    def sum(self, values):
        return self.ranks.total(float(values[self._own].sum()))

    def sum_in_order(self, values):
        whole = self.gather(values)
        return self.ranks.to_all(None if whole is None else super().sum(whole))

    def maximum(self, values):
        return self.ranks.greatest(float(values[self._own].max()))

    def extent(self, points):
        own = points[self._own]
        ends = [self.ranks.greatest(float(end)) for end in (*own.max(axis=0), *-own.min(axis=0))]
        dimension = points.shape[1]
        return max(above + below for above, below in zip(ends[:dimension], ends[dimension:], strict=True))

    def greatest(self, here):
        return self.ranks.greatest(float(here))

    def union(self, values):
        return np.unique(np.concatenate(self.ranks.everywhere(np.unique(values))))

    def spread(self, values):
        size = self._total
        mean = self.sum(values) / size
        return float(np.sqrt(self.sum(np.square(values - mean)) / size))

    def of_all(self, rows, points):
        return np.concatenate(self.ranks.everywhere(rows[self.own[points]]))

    def pieces(self, n, first, second):
        """Pieces of every part are joined where a point of a halo is in one of them, and in another of its owner."""
        count, label = super().pieces(n, first, second)
        counts = self.ranks.everywhere(count)
        label = label.astype(np.int64) + sum(counts[: self.ranks.rank])
        theirs = label.copy()
        self.fill(theirs)
        joined = np.unique(np.stack([label, theirs], axis=1), axis=0)
        one, other = np.concatenate(self.ranks.everywhere(joined)).T
        graph = sparse.coo_matrix((np.ones(len(one), np.int8), (one, other)), shape=(sum(counts), sum(counts)))
        _, piece = connected_components(graph, directed=False)
        # A piece of a part may be of the halo alone: those count that have points of somebody's own, in the order of the first of these.
        least = np.full(sum(counts), np.iinfo(np.int64).max)
        np.minimum.at(least, piece[label[self._own]], self.numbers[self._own])
        least = np.min(self.ranks.everywhere(least), axis=0)
        order = np.argsort(least, kind="stable")
        rank_of = np.empty(len(order), dtype=np.int64)
        rank_of[order] = np.arange(len(order))
        found = int(np.count_nonzero(least < np.iinfo(np.int64).max))
        return found, rank_of[piece[label]]

    def take(self, values: np.ndarray) -> np.ndarray:
        return values[self.numbers]

    def everywhere(self, rows):
        return self.ranks.everywhere(rows)

    def size(self, n: int) -> int:
        return self._total


def divided(body: Body, ranks: Communicator, halo: float = HALO) -> Body:
    """Return the share of a body that falls to this rank; bonds of the body must not have been used yet.

    Parameters
    ----------
    body : Body
    ranks : Communicator
    halo : float
        Horizons around a rank's own points within which it has those of others.

    Raises
    ------
    ValueError
        If there are fewer points than ranks, or a horizon reaches beyond the ranks beside one.
    """
    n = len(body)
    if n < 4 * ranks.size:
        raise ValueError(f"{n} points are too few for {ranks.size} ranks; take fewer")
    share = slice(n * ranks.rank // ranks.size, n * (ranks.rank + 1) // ranks.size)
    weights = np.concatenate(ranks.everywhere(bond_counts(body.points, body.horizon, share)))
    owners = bisected(body.points, weights, ranks.size)
    own = np.flatnonzero(owners == ranks.rank)
    reach = halo * body.horizon * (1 + 1e-9)
    lower, upper = body.points[own].min(axis=0) - 2 * reach, body.points[own].max(axis=0) + 2 * reach
    near = np.flatnonzero(((body.points >= lower) & (body.points <= upper)).all(axis=1))
    distance, _ = cKDTree(body.points[own]).query(body.points[near], distance_upper_bound=2 * reach)
    numbers = near[distance <= reach]
    share = RankShare(ranks, numbers, owners[numbers], n)
    groups = {name: share.local(np.sort(members)) for name, members in body.groups.items()}
    return replace(body, points=body.points[numbers], volumes=body.volumes[numbers], groups=groups, mesh_cells=None, share=share)
