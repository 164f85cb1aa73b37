"""Multigrid cycle for the Laplacian of a body that is divided among ranks: the finest level is shared, and every rank has the others."""

from __future__ import annotations

import numpy as np
import scipy

from ..engine.block_arrays import power_of_two
from ..engine.passes import Chain
from ..engine.threads import chunks_of
from ..kernels.multigrid import passes_of
from ..ranks import Share
from .multigrid import COARSENING, JACOBI, Multigrid, boxes_of, rows_of_matrix


class SharedMultigrid:
    """The cycle of `Multigrid` on several ranks, the same operator as in one process but for rounding.

    Each rank smooths the errors of its own points, and the ranks exchange the halo after every step. The next coarser level has a 27th of
    the points in three dimensions and a ninth in the plane, so that every rank solves on it, and on all coarser ones, for itself.

    Parameters
    ----------
    matrix : sparse.csr_array, shape (n, n)
        As for `Multigrid`, for the local points; rows of points of the halo are not used.
    points, spacing, free, width
        As for `Multigrid`, for the local points.
    share : Share
    """

    def __init__(
        self,
        matrix: scipy.sparse.csr_array,
        points: np.ndarray,
        spacing: float,
        free: np.ndarray,
        width: int,
        share: Share,
    ) -> None:
        diagonal = matrix.diagonal()
        self._share, self._width, self._unit = share, width, power_of_two(share.sum(diagonal) / share.size)
        matrix, diagonal = matrix / self._unit, diagonal / self._unit
        greatest = share.greatest((abs(matrix).sum(axis=1) / diagonal)[share.own])
        relaxation = JACOBI / greatest / diagonal
        rows = np.flatnonzero(free)
        lower, upper = points[rows].min(axis=0, initial=np.inf), points[rows].max(axis=0, initial=-np.inf)
        box = boxes_of(points[rows], spacing, np.min(share.everywhere(lower), axis=0), np.max(share.everywhere(upper), axis=0))
        kept = np.unique(np.concatenate(share.everywhere(np.unique(box))))
        box = np.searchsorted(kept, box)
        constant = scipy.sparse.csr_array((np.ones(len(rows)), (rows, box)), shape=(len(points), len(kept)))
        prolongation = share.fill_sparse((constant - scipy.sparse.diags_array(relaxation) @ (matrix @ constant)).tocsr())
        own = scipy.sparse.diags_array(share.own.astype(float))
        restriction = (prolongation.T @ own).tocsr()
        coarse = sum(share.everywhere((restriction @ (matrix @ prolongation)).tocsr())).tocsr()
        owned = share.own[rows]
        counts = share.total(np.bincount(box[owned], minlength=len(kept)).astype(float))
        sums = (share.total(np.bincount(box[owned], column[owned], len(kept))) for column in points[rows].T)
        centers = np.stack([total / counts for total in sums], axis=1)
        self._coarse_matrix = coarse
        self._coarse = Multigrid(coarse, centers, spacing * COARSENING, np.ones(len(kept), dtype=bool), width)
        self._bind(matrix, relaxation, prolongation, restriction)

    def _bind(self, matrix, relaxation, prolongation, restriction) -> None:
        """Bind the passes of the finest level to its arrays, in single precision; rows of three right-hand sides are read as four."""
        (count, few), held = prolongation.shape, {3: 4}.get(self._width, self._width)
        self._right, self._found, self._rest = np.zeros((3, count, held), dtype=np.float32)
        self._coarse_right, self._coarse_found, working = np.zeros((3, few, held), dtype=np.float32)
        rows, passes, chunks = rows_of_matrix(matrix), passes_of(held), chunks_of(matrix.nnz)
        factors = relaxation.astype(np.float32)
        right, found, rest = self._right, self._found, self._rest
        self._scale = Chain(passes.scale.bind(factors, right, rest, chunks=chunks))
        self._relax = Chain(passes.relax.bind(*rows, factors, right, rest, found, chunks=chunks))
        self._restrict = Chain(
            passes.residual.bind(*rows, right, found, rest, chunks=chunks),
            passes.add_product.bind(*rows_of_matrix(restriction), rest, 0.0, working, self._coarse_right, chunks=chunks),
        )
        self._prolong = Chain(
            passes.add_product.bind(*rows_of_matrix(prolongation), self._coarse_found, 1.0, rest, found, chunks=chunks),
            passes.relax.bind(*rows, factors, right, found, rest, chunks=chunks),
        )

    def cycle(self, right: np.ndarray) -> np.ndarray:
        """Return the approximate solution on own points by one W cycle, for a right-hand side (n,), or several in columns (n, width)."""
        share, width = self._share, self._width
        unit = power_of_two(share.greatest(np.abs(right[share.own])))
        self._right[:, :width] = right.reshape(-1, width) / unit
        share.clear(self._right)
        self._scale()
        share.fill(self._rest)
        self._relax()
        share.fill(self._found)
        self._restrict()
        coarse = share.total(self._coarse_right[:, :width].astype(float))
        found = self._coarse.cycle(coarse)
        found += self._coarse.cycle(coarse - self._coarse_matrix @ found)
        self._coarse_found[:, :width] = found
        self._prolong()
        share.fill(self._rest)
        self._relax()
        return self._found[:, :width].reshape(right.shape) * (unit / self._unit)
