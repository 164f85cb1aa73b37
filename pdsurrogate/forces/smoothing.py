"""Smoothing of the dilatations of the points, theory (50)."""

from __future__ import annotations

import numpy as np
import scipy

from ..body import Body
from ..body.bonds import pointers_to
from ..engine.passes import BoundPass
from ..engine.threads import Chunks
from ..kernels import dilatation, selective_energy


class Smoothing:
    """Smoothing W of the dilatations of points: weights of each point and its neighbors in a mean
    (theory (50)).

    On a grid the weights are (1 2 1)/4 along each axis. Rows add up to one, so that a uniform
    dilatation is unchanged; V_i W_ij is symmetric, so that the mean dilatation is unchanged as
    well, and a uniform pressure too. If points lie closer than on a grid, a point keeps the weight
    that it has on a grid, a quarter in the plane and an eighth in three dimensions. The weight of a
    neighbor beyond a surface or a crack stays with the point. A mirror image is a neighbor; images
    beyond a clamped plane deform differently from the body and have no weight.

    Parameters
    ----------
    body : Body
    carries : ndarray of bool, shape (n_pairs,)
        Flags of the pairs that carry force; pairs across a cut carry none.
    breakable : bool
        Whether bonds may break, see `renew`.
    """

    def __init__(self, body: Body, carries: np.ndarray, breakable: bool = False) -> None:
        bonds = body.bonds
        ghosts = body.ghosts
        n = len(body)
        mirrors = np.concatenate(
            [np.ones(n, dtype=bool), (ghosts.parity == ghosts.reflection).all(axis=1)]
        )
        found = []
        for part in bonds.slabs():
            first = bonds.first[part]
            second = bonds.second[part]
            offsets = np.abs(body.all_points[second] - body.all_points[first]) / body.cell
            near = carries[part] & mirrors[second] & (offsets < 2).all(axis=1)
            found.append(
                (part.start + np.flatnonzero(near), (0.5 - offsets[near] / 4).prod(axis=1))
            )
        pairs, weights = (np.concatenate(parts) for parts in zip(*found, strict=True))
        first = bonds.first[pairs]
        second = bonds.second[pairs]
        weights *= body.volumes[first] * body.all_volumes[second] / body.cell.prod()
        within = second < n
        second = np.concatenate([np.arange(n, dtype=np.uint32), ghosts.source])[second]
        rows = np.concatenate([first, second[within]])
        order = np.argsort(rows, kind="stable")
        self._pointers = pointers_to(rows, n)
        self._columns = np.concatenate([second, first[within]])[order]
        self._volumes = body.volumes
        self._most = 1 - 0.5**body.dimension
        self._share = body.share
        self._single = None
        raw = np.concatenate([weights, weights[within]])[order]
        self._weights = np.empty(len(raw))
        self._own = np.empty(n)
        self._limit(raw)
        if breakable:
            self._raw = raw
            self._pairs = np.concatenate([pairs, pairs[within]])[order].astype(np.uint32)

    def _limit(self, raw: np.ndarray) -> None:
        """Set the weights from unlimited weights `raw`, so that the neighbors of a point have
        together at most their weight on a grid.
        """
        n = len(self._own)
        rows = np.repeat(np.arange(n), np.diff(self._pointers).astype(np.int64))
        caps = self._most / np.maximum(np.bincount(rows, raw, n) / self._volumes, self._most)
        self._share.fill(caps)
        self._weights[:] = raw * np.minimum(caps[rows], caps[self._columns]) / self._volumes[rows]
        self._own[:] = 1 - np.bincount(rows, self._weights, n)

    def bind(self, values: np.ndarray, out: np.ndarray, chunks: Chunks) -> BoundPass:
        """Return the compiled pass that writes the smoothed `values` (n,) of points to
        ``out[:n]``, in the precision of the values.
        """
        return selective_energy.smooth.bind(self._matrix(values.dtype), values, out, chunks=chunks)

    def bind_sum(
        self, values: np.ndarray, factor: float, others, out: np.ndarray, chunks: Chunks
    ) -> BoundPass:
        """Return the compiled pass that writes `factor` times the smoothed `values`, plus three
        products, to `out`.

        `others` are the three products, as pairs of a factor and an array; `out` may be one of
        these arrays.
        """
        others = tuple((float(of_other), other) for of_other, other in others)
        return dilatation.smooth_and_add.bind(
            self._matrix(values.dtype), values, factor, others, out, chunks=chunks
        )

    def _matrix(self, dtype) -> tuple[np.ndarray, ...]:
        """Return the weights in a precision: CSR pointers, columns and values of the neighbors,
        and the points' own weights.
        """
        if dtype == np.float64:
            return self._pointers, self._columns, self._weights, self._own
        if self._single is None:
            self._single = self._weights.astype(np.float32), self._own.astype(np.float32)
        return self._pointers, self._columns, *self._single

    def renew_copies(self) -> None:
        """Update the single-precision copies of the weights after a change of the weights."""
        for single, exact in zip(self._single, (self._weights, self._own), strict=True):
            single[:] = exact

    def matrix(self) -> scipy.sparse.csr_array:
        """Return the weights as a sparse matrix W, shape (n, n): ``W @ values`` are smoothed
        values.
        """
        n = len(self._own)
        neighbors = scipy.sparse.csr_array(
            (self._weights, self._columns.astype(np.int64), self._pointers.astype(np.int64)),
            shape=(n, n),
        )
        return neighbors + scipy.sparse.diags_array(self._own, format="csr")

    def renew(self, carries: np.ndarray) -> None:
        """Update the weights after bonds have broken; `carries` flags the pairs that still carry
        force.
        """
        self._raw[~carries[self._pairs]] = 0.0
        self._limit(self._raw)
