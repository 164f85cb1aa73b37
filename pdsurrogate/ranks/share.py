"""Division of a body among ranks: the share of each rank, with points of its own and a halo of
points that other ranks own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from .communicator import ALONE, Communicator

SLAB = 500_000
"""Number of bonds that `connected` looks at together. Chosen as for the parts of `Bonds.slabs`."""


class Halo:
    """Halo of an array: its rows that other ranks own, and the messages that copy their values from
    these ranks or back.

    Parameters
    ----------
    ranks : Communicator
    names : ndarray of int, shape (k,)
        Number that identifies every local row on all ranks.
    owners : ndarray of int, shape (k,)
        The rank that owns each row.

    Attributes
    ----------
    rows : ndarray of int
        Local numbers of the rows of the halo.
    """

    def __init__(self, ranks: Communicator, names: np.ndarray, owners: np.ndarray) -> None:
        self.ranks = ranks
        self.rows = np.flatnonzero(owners != ranks.rank)
        self._receive = {
            rank: np.flatnonzero(owners == rank) for rank in np.unique(owners[self.rows]).tolist()
        }
        wanted = ranks.to_each(
            [names[self._receive.get(rank, self.rows[:0])] for rank in range(ranks.size)]
        )
        order = np.argsort(names, kind="stable")
        self._send = {
            rank: order[np.searchsorted(names, asked, sorter=order)]
            for rank, asked in enumerate(wanted)
            if len(asked)
        }

    def fill(self, *fields: np.ndarray) -> None:
        """Copy the rows of the halo in each field, in place, from the ranks that own them;
        further rows, as of images, stay as they are.
        """
        for field in fields:
            for rows, values in self._exchanged(field, self._send, self._receive):
                field[rows] = values

    def fill_sparse(self, rows):
        """Return a sparse matrix with a row for each row here, with the rows of the halo
        replaced by those of the ranks that own them.
        """
        if self.ranks.size == 1:
            return rows
        ranks = range(self.ranks.size)
        none = self.rows[:0]
        received = self.ranks.to_each([rows[self._send.get(rank, none)] for rank in ranks])
        own = np.setdiff1d(np.arange(rows.shape[0]), self.rows)
        order = np.concatenate([own, *(self._receive.get(rank, none) for rank in ranks)])
        return scipy.sparse.vstack([rows[own], *received]).tocsr()[np.argsort(order)]

    def fold(self, field: np.ndarray) -> None:
        """Add the rows of a field's halo to the rows on their owners, in place, and set the halo
        to zero: the transpose of `fill`.
        """
        for rows, values in self._exchanged(field, self._receive, self._send):
            field[rows] += values
        self.clear(field)

    def clear(self, field: np.ndarray) -> None:
        """Set the rows of a field's halo to zero, in place."""
        if len(self.rows):
            field[self.rows] = 0

    def _exchanged(
        self, field: np.ndarray, send: dict[int, np.ndarray], receive: dict[int, np.ndarray]
    ) -> list[tuple]:
        """Send the rows `send` of a field, by receiving rank, and receive values for the rows
        `receive`, by sending rank.

        The result is a list of pairs of row numbers and received values, in the order of the
        sending ranks.
        """
        if not (send or receive):
            return []
        incoming = {
            rank: np.empty((len(rows), *field.shape[1:]), dtype=field.dtype)
            for rank, rows in sorted(receive.items())
        }
        self.ranks.exchange({rank: field[rows] for rank, rows in send.items()}, incoming)
        return [(receive[rank], values) for rank, values in incoming.items()]


@dataclass(eq=False)
class Rows:
    """Correspondence between the rows of an array on this rank, which it owns or has copied, and
    the rows of that array for the whole body.

    Parameters
    ----------
    ranks : Communicator
    numbers : ndarray of int, shape (k,)
        Number in the whole body of every row on this rank.
    own : ndarray of bool, shape (k,)
        True for rows that this rank owns.
    size : int
        Number of rows of the whole body.
    """

    ranks: Communicator
    numbers: np.ndarray
    own: np.ndarray
    size: int

    def gather(self, values: np.ndarray) -> np.ndarray | None:
        """Return, on the first rank, the array of the whole body from the own rows of all ranks;
        None on the other ranks.
        """
        if self.ranks.size == 1:
            return values
        numbers = self.ranks.gather(self.numbers[self.own])
        rows = self.ranks.gather(values[self.own])
        if rows is None:
            return None
        whole = np.empty((self.size, *values.shape[1:]), dtype=values.dtype)
        for places, found in zip(numbers, rows, strict=True):
            whole[places] = found
        return whole

    def hand_out(self, whole: np.ndarray | None) -> np.ndarray:
        """Return this rank's rows of an array of the whole body, given on the first rank;
        `whole` is None on the other ranks.
        """
        if self.ranks.size == 1:
            return whole
        numbers = self.ranks.gather(self.numbers)
        return self.ranks.hand_out(numbers and [whole[places] for places in numbers])


class Share(Halo, Rows):
    """Points of a body that one rank works on: its own points, and a halo of points owned by other
    ranks, with the methods of `Halo` and `Rows` for arrays with a row for each point.

    In a single process all points are its own. Points are numbered in the order of the whole body,
    with those of the halo in between, so that sums over bonds are taken in the same order on any
    number of ranks, with bitwise identical results. Values summed over all bonds of a point are
    correct on owned points, and are copied from their owners to the halo.

    Reductions over ranks are of two kinds. `dot` and `sum` take an array with a row for every local
    point, and leave out halo points, so that each point of the body counts once. `total`,
    `greatest` and `any` combine values that each rank has computed, with none left out.

    Parameters
    ----------
    numbers : ndarray of int, shape (n,)
        Numbers of the points in the whole body, rising.
    owners : ndarray of int, shape (n,)
        The rank that owns each point.
    size : int
        Number of points of the whole body.
    ranks : Communicator, optional

    Attributes
    ----------
    own : ndarray of bool, shape (n,)
        True for the points that this rank owns. A pair belongs to the owner of its first point, so
        ``own[first]`` is True for the pairs that this rank counts.
    divided : bool
        True if several ranks share the body.
    is_first : bool
        True on the first rank. A value that every rank has whole, such as the work of a load,
        enters a sum over ranks on this rank only.
    agree, everywhere, total, greatest : callable
        Methods of `Communicator`: raise an error of any rank on all, list the values of all ranks,
        and take sum and maximum over them.
    numbers, owners, size, ranks
    """

    def __init__(
        self, numbers: np.ndarray, owners: np.ndarray, size: int, ranks: Communicator = ALONE
    ) -> None:
        Rows.__init__(self, ranks, numbers, owners == ranks.rank, size)
        Halo.__init__(self, ranks, numbers, owners)
        self.owners = owners
        self.divided = ranks.size > 1
        self.is_first = ranks.rank == 0
        self.agree = ranks.agree
        self.everywhere = ranks.everywhere
        self.total = ranks.total
        self.greatest = ranks.greatest
        self._own = np.flatnonzero(self.own) if self.divided else slice(None)
        self._weights = self.own.astype(float) if self.divided else None

    @classmethod
    def whole(cls, n: int) -> Share:
        """Return the share of one process, which has all n points."""
        return cls(np.arange(n), np.zeros(n, dtype=np.int32), n)

    def any(self, flags):
        """Return whether a flag is true on any rank; for an array of flags, return the array of
        these answers.
        """
        if not np.ndim(flags):
            return self.total(int(flags)) > 0
        return self.total(np.asarray(flags, dtype=np.int64)) > 0

    def count(self, flags: np.ndarray) -> int:
        """Return the number of points of the body whose flag, one for each local point, is true."""
        return self.total(int(np.count_nonzero(flags[self._own])))

    def dot(
        self, first: np.ndarray, second: np.ndarray, weights: np.ndarray | None = None
    ) -> float:
        """Return the inner product of two arrays (n, d) over all points of the body, with optional
        weights (n,) of the points.

        NumPy computes the sum rather than BLAS, whose threads would wait for the threads of the
        kernels, and whose result depends on the number of threads.
        """
        if self.divided:
            weights = self._weights if weights is None else self._weights * weights
        if weights is None:
            return float(np.einsum("nc,nc->", first, second))
        return self.total(float(np.einsum("n,nc,nc->", weights, first, second)))

    def sum(self, values: np.ndarray, in_order: bool = False) -> float:
        """Return the sum over the whole body of an array with a row for each local point.

        With `in_order` the sum has the same bits on any number of ranks, since all entries are
        gathered on one rank.
        """
        if not in_order:
            return self.total(float(values[self._own].sum()))
        whole = self.gather(values)
        return self.ranks.to_all(None if whole is None else float(whole.sum()))

    def joined(self, rows: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return, on every rank, the rows of all ranks joined in the order of the ranks, without
        rows of halo points.

        `points` are the local points to which the rows of this rank belong.
        """
        return np.concatenate(self.everywhere(rows[self.own[points]]))

    def pieces(self, first: np.ndarray, second: np.ndarray) -> tuple[int, np.ndarray]:
        """Return the number of pieces into which bonds connect the points of the whole body, and
        the piece of each local point, shape (n,).

        Local bonds are given by their ends, see `connected`. Pieces on two ranks are joined
        where a halo point of one rank is in both.
        """
        count, label = connected(len(self.own), first, second)
        if not self.divided:
            return count, label
        counts = self.everywhere(count)
        label = label.astype(np.int64) + sum(counts[: self.ranks.rank])
        theirs = label.copy()
        self.fill(theirs)
        edges = np.unique(np.stack([label, theirs], axis=1), axis=0)
        _, piece = connected(sum(counts), *np.concatenate(self.everywhere(edges)).T)
        # A piece of a share may consist of halo points only. Pieces with owned points count, in the
        # order of the first such point.
        least = np.full(sum(counts), self.size)
        np.minimum.at(least, piece[label[self._own]], self.numbers[self._own])
        least = np.min(self.everywhere(least), axis=0)
        rank_of = np.argsort(np.argsort(least, kind="stable"))
        return int(np.count_nonzero(least < self.size)), rank_of[piece[label]]

    def own_columns(self, rows):
        """Return the columns, for local points, of a sparse matrix (k, points of the whole body),
        with 0 in columns of halo points.

        The sum over ranks of the products with local vectors is then the product for the whole
        body.
        """
        if not self.divided:
            return rows
        found = (rows.tocsc()[:, self.numbers] @ scipy.sparse.diags_array(self._weights)).tocsr()
        found.eliminate_zeros()
        return found

    def with_rows_of_others(self, rows):
        """Return a sparse matrix (n, n) of the local points with the rows of its halo points
        replaced by those of their owners.
        """
        if not self.divided:
            return rows
        entries = rows.tocoo()
        own = self.own[entries.row]
        found = self.numbers[entries.row[own]], self.numbers[entries.col[own]], entries.data[own]
        row, column, value = (
            np.concatenate(parts) for parts in zip(*self.everywhere(found), strict=True)
        )
        places = np.full(self.size, -1)
        places[self.numbers] = np.arange(len(self.numbers))
        row = places[row]
        column = places[column]
        here = (row >= 0) & (column >= 0)
        return scipy.sparse.csr_array((value[here], (row[here], column[here])), shape=rows.shape)

    def beside_halo(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Return the numbers of the bonds, given by their ends, with an end that is a halo point or
        an image (mirrored point).

        In a single process the result is empty.
        """
        n = len(self.own)
        return (
            np.flatnonzero(~self.own[first] | (second >= n) | ~self.own[np.minimum(second, n - 1)])
            if self.divided
            else first[:0]
        )

    def local(self, numbers: np.ndarray) -> np.ndarray:
        """Return the local numbers, rising, of points given by their numbers in the whole body;
        points not on this rank are left out.
        """
        places = np.searchsorted(self.numbers, numbers)
        places[places == len(self.numbers)] = 0
        return np.unique(places[self.numbers[places] == numbers])


def connected(n: int, first: np.ndarray, second: np.ndarray) -> tuple[int, np.ndarray]:
    """Return the number of connected components of n points, and the number of the component of
    each point, shape (n,).

    Bonds join the points `first` to the points `second`; numbers from n on are no points. Only the
    bonds given here count: ranks do not communicate, unlike in `Share.pieces`.
    """
    root = np.arange(n, dtype=np.uint32)
    # Where bonds are sorted, those that begin another list join nearly all points, and the others
    # next to none.
    begin = np.flatnonzero(first[1:] != first[:-1]) + 1
    _join(root, first[begin], second[begin])
    for start in range(0, len(first), SLAB):
        _join(root, first[start : start + SLAB], second[start : start + SLAB])
    roots = root == np.arange(n)
    return int(np.count_nonzero(roots)), (np.cumsum(roots) - 1)[root]


def _join(root: np.ndarray, first: np.ndarray, second: np.ndarray) -> None:
    """Join the components of the points that bonds connect; `root` is the least number in the
    component of each point.
    """
    within = second < len(root)
    if not within.all():
        first, second = first[within], second[within]
    while True:
        one = root[first]
        other = root[second]
        apart = one != other
        if not apart.any():
            break
        first = first[apart]
        second = second[apart]
        one = one[apart]
        other = other[apart]
        # Every root becomes a child of the least root that its bonds reach; then all points become
        # children of roots again.
        np.minimum.at(root, np.maximum(one, other), np.minimum(one, other))
        while (root[root] != root).any():
            root[:] = root[root]


def bond_counts(points: np.ndarray, radius: float, chosen: slice = slice(None)) -> np.ndarray:
    """Return, for each chosen point, the number of points within a radius, itself included,
    which measures the cost of computing it.
    """
    counted = scipy.spatial.cKDTree(points).query_ball_point(
        points[chosen], radius, return_length=True
    )
    return np.asarray(counted, dtype=float)


def bisected(points: np.ndarray, weights: np.ndarray, parts: int) -> np.ndarray:
    """Divide points into parts of nearly equal cost by recursive bisection: return the part of
    every point, shape (n,).

    Parameters
    ----------
    points : ndarray, shape (n, d)
    weights : ndarray, shape (n,)
        Cost of each point.
    parts : int
        Number of parts.

    References
    ----------
    Berger and Bokhari, IEEE Trans. Comput. 36 (1987) 570-580.
    """
    part = np.zeros(len(points), dtype=np.int32)

    def split(numbers: np.ndarray, first: int, count: int) -> None:
        if count == 1:
            part[numbers] = first
            return
        before = count // 2
        axis = int(np.ptp(points[numbers], axis=0).argmax())
        order = numbers[np.argsort(points[numbers, axis], kind="stable")]
        sums = np.cumsum(weights[order])
        cut = int(
            np.clip(
                np.searchsorted(sums, sums[-1] * before / count),
                before,
                len(order) - (count - before),
            )
        )
        split(order[:cut], first, before)
        split(order[cut:], first + before, count - before)

    split(np.arange(len(points)), 0, parts)
    return part
