"""Smoothing of the dilatations of the points, theory (50)."""

import numpy as np
from scipy import sparse

from ..body import Body
from ..engine.passes import BoundPass
from ..engine.threads import Chunks
from ..kernels import dilatation, selective_energy
from .kinematics import entries_of, pointers_to

SLAB = 4_000_000
"""Pairs that are prepared together, so that temporary arrays stay small in comparison with the body's own."""


class Smoothing:
    """Weights of neighbours in the smoothed dilatation of the points (theory (50)).

    On a grid they are (1 2 1)/4 along each axis. Rows add up to one, so that a uniform dilatation is unchanged; V_i W_ij is symmetric, so
    that its mean is unchanged as well, and a uniform pressure too. If points lie closer than on a grid, a point keeps its weight of a grid,
    a quarter in the plane and an eighth in three dimensions. The weight of a neighbour beyond a surface or a crack stays with the point. A
    mirror image is a neighbour; images beyond a clamped plane deform differently from the body and have no weight.

    Parameters
    ----------
    body : Body
    carries : ndarray of bool, shape (n_pairs,)
        Flags of the pairs that carry anything: pairs across a cut carry nothing.
    breakable : bool
        Whether bonds may break, see `renew`.
    """

    def __init__(self, body: Body, carries: np.ndarray, breakable: bool = False) -> None:
        bonds, ghosts, n = body.bonds, body.ghosts, len(body)
        mirrors = np.concatenate([np.ones(n, dtype=bool), (ghosts.parity == ghosts.reflection).all(axis=1)])
        found = []
        for start in range(0, len(bonds.first), SLAB):
            part = slice(start, start + SLAB)
            first, second = bonds.first[part], bonds.second[part]
            offsets = np.abs(body.all_points[second] - body.all_points[first]) / body.cell
            near = carries[part] & mirrors[second] & (offsets < 2).all(axis=1)
            found.append((start + np.flatnonzero(near), (0.5 - offsets[near] / 4).prod(axis=1)))
        pairs, weights = (np.concatenate(parts) for parts in zip(*found, strict=True))
        first, second = bonds.first[pairs], bonds.second[pairs]
        weights *= body.volumes[first] * body.all_volumes[second] / body.cell.prod()
        within = second < n
        second = np.concatenate([np.arange(n, dtype=np.uint32), ghosts.source])[second]
        rows = np.concatenate([first, second[within]])
        order = np.argsort(rows, kind="stable")
        rows, self._columns = rows[order], np.concatenate([second, first[within]])[order]
        self._pointers = pointers_to(rows, n)
        self._volumes, self._most = body.volumes, 1 - 0.5**body.dimension
        raw = np.concatenate([weights, weights[within]])[order]
        self._share, self._single = body.share, None
        self._caps = self._cap(np.bincount(rows, raw, n) / body.volumes)
        self._share.fill(self._caps)
        self._weights = raw * np.minimum(self._caps[rows], self._caps[self._columns]) / body.volumes[rows]
        self._own = 1 - np.bincount(rows, self._weights, n)
        if breakable:
            self._ends = bonds.first, bonds.second
            self._raw, self._pairs = raw, np.concatenate([pairs, pairs[within]])[order].astype(np.uint32)

    def bind(self, values: np.ndarray, out: np.ndarray, chunks: Chunks) -> BoundPass:
        """Bind the pass that smooths values at the points (n,) into the first n of another array, in the precision of the values."""
        return selective_energy.smooth.bind(self._matrix(values.dtype), values, out, chunks=chunks)

    def bind_sum(self, values: np.ndarray, factor: float, others, out: np.ndarray, chunks: Chunks) -> BoundPass:
        """Bind the pass that writes a multiple of the smoothed values, plus three others (factor, values), of which `out` may be one."""
        others = tuple((float(of_other), other) for of_other, other in others)
        return dilatation.smooth_and_add.bind(self._matrix(values.dtype), values, factor, others, out, chunks=chunks)

    def _matrix(self, dtype) -> tuple[np.ndarray, ...]:
        """Return the weights as CSR arrays and diagonal, in single precision if asked for."""
        if dtype == np.float64:
            return self._pointers, self._columns, self._weights, self._own
        if self._single is None:
            self._single = self._weights.astype(np.float32), self._own.astype(np.float32)
        return self._pointers, self._columns, *self._single

    def take(self) -> None:
        """Bring the weights in single precision up to date."""
        for single, exact in zip(self._single, (self._weights, self._own), strict=True):
            single[:] = exact

    def matrix(self) -> sparse.csr_array:
        """Return the weights, shape (n, n)."""
        n = len(self._own)
        neighbours = sparse.csr_array((self._weights, self._columns.astype(np.int64), self._pointers.astype(np.int64)), shape=(n, n))
        return neighbours + sparse.diags_array(self._own, format="csr")

    def renew(self, carries: np.ndarray, pairs: np.ndarray) -> None:
        """Bring the weights up to date after some of the given pairs have ceased to carry anything."""
        n = len(self._own)
        ends = np.concatenate([end[pairs] for end in self._ends])
        rows = np.unique(ends[ends < n]).astype(np.int64)
        owners, entries = self._entries(rows)
        self._raw[entries[~carries[self._pairs[entries]]]] = 0.0
        self._caps[rows] = self._cap(np.bincount(owners, self._raw[entries], n)[rows] / self._volumes[rows])
        self._share.fill(self._caps)
        rows = np.arange(n) if self._share.divided else np.unique(np.concatenate([rows, self._columns[entries]]))
        owners, entries = self._entries(rows)
        caps = np.minimum(self._caps[owners], self._caps[self._columns[entries]])
        self._weights[entries] = self._raw[entries] * caps / self._volumes[owners]
        self._own[rows] = 1 - np.bincount(owners, self._weights[entries], n)[rows]

    def _cap(self, shares: np.ndarray) -> np.ndarray:
        """Return the factors that limit the total share of the neighbours of each point to its value on a grid."""
        return self._most / np.maximum(shares, self._most)

    def _entries(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the row of every entry of given rows, and the numbers of these entries."""
        counts = np.diff(self._pointers).astype(np.int64)[rows]
        return np.repeat(rows, counts), entries_of(self._pointers, rows)
