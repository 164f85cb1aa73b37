"""A cycle of multigrid for Laplacians of scattered points, which costs a few products with the matrix whatever their number."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ..kernels.multigrid import passes_of
from ..kernels.passes import BoundPass, Chain
from ..kernels.threads import chunks_of

COARSENING = 3
"""Mean distances of points, along each axis, that are one on the next level."""

FEW = 1_500
"""Points of a level that is factorised."""


class Multigrid:
    """Smoothed aggregation over boxes of points.

    One cycle is a symmetric positive definite operator near the inverse of the matrix, a fixed one: what a preconditioner asks for.  It is
    done in single precision.

    Parameters
    ----------
    matrix : sparse.csr_array, shape (n, n)
        Symmetric and positive definite, with no positive entries beside the diagonal but those of images.
    points : ndarray, shape (n, d)
    spacing : float
        Mean distance of neighbouring points.
    free : ndarray of bool, shape (n,)
        The others are joined to nothing.
    width : int
        Right hand sides that are solved for at once.

    References
    ----------
    Vanek, Mandel and Brezina, Computing 56 (1996) 179-196.
    """

    def __init__(self, matrix: sparse.csr_array, points: np.ndarray, spacing: float, free: np.ndarray, width: int = 1) -> None:
        # Rows of three are read as four.
        self._width, held = width, {3: 4}.get(width, width)
        self._right = [np.zeros((matrix.shape[0], held), dtype=np.float32)]
        self._found = [np.zeros_like(self._right[0])]
        down, up = [], []
        while matrix.shape[0] > FEW:
            diagonal = matrix.diagonal()
            # Gershgorin's bound of the spectrum of D^-1 A.
            greatest = float((abs(matrix).sum(axis=1) / diagonal).max())
            relaxation = 4 / (3 * greatest) / diagonal
            numbers = np.floor((points - points.min(axis=0)) / (COARSENING * spacing)).astype(np.int64)
            rows = np.flatnonzero(free)
            boxes = np.ravel_multi_index(tuple(numbers[rows].T), tuple(numbers.max(axis=0) + 1))
            kept, box = np.unique(boxes, return_inverse=True)
            if 2 * len(kept) > len(rows):
                break
            constant = sparse.csr_array((np.ones(len(rows)), (rows, box)), shape=(len(points), len(kept)))
            prolongation = (constant - sparse.diags_array(relaxation) @ (matrix @ constant)).tocsr()
            before, after = self._bind(matrix, relaxation, prolongation)
            down, up = [*down, *before], [*after, *up]
            matrix = (prolongation.T @ (matrix @ prolongation)).tocsr()
            counts = np.bincount(box)
            points = np.stack([np.bincount(box, column) / counts for column in points[rows].T], axis=1)
            spacing, free = spacing * COARSENING, np.ones(len(kept), dtype=bool)
        self._down, self._up = (Chain(*passes) if passes else None for passes in (down, up))
        self._factor = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def _bind(self, matrix, relaxation, prolongation) -> tuple[list[BoundPass], list[BoundPass]]:
        """What is done on a level before and after the next coarser one, whose vectors it adds to those that there are."""
        rows, restriction = _rows(matrix), _rows(prolongation.T.tocsr())
        relaxation, right, found = relaxation.astype(np.float32), self._right[-1], self._found[-1]
        passes, rest, width = passes_of(right.shape[1]), np.zeros_like(right), right.shape[1]
        coarse_right, coarse_found = np.zeros((2, prolongation.shape[1], width), dtype=np.float32)
        self._right.append(coarse_right)
        self._found.append(coarse_found)
        chunks = chunks_of(matrix.nnz)
        before = [
            passes.scale.bind(relaxation, right, rest, chunks=chunks),
            passes.relax.bind(*rows, relaxation, right, rest, found, chunks=chunks),
            passes.residual.bind(*rows, right, found, rest, chunks=chunks),
            passes.add_product.bind(*restriction, rest, 0.0, coarse_found, coarse_right, chunks=chunks),
        ]
        after = [
            passes.add_product.bind(*_rows(prolongation), coarse_found, 1.0, rest, found, chunks=chunks),
            passes.relax.bind(*rows, relaxation, right, found, rest, chunks=chunks),
            passes.relax.bind(*rows, relaxation, right, rest, found, chunks=chunks),
        ]
        return before, after

    def cycle(self, right: np.ndarray) -> np.ndarray:
        """Nearly the solution for a right hand side, shape (n,), or as many as there are columns in (n, width)."""
        if self._down is None:
            return self._factor.solve(right)
        self._right[0][:, : self._width] = right.reshape(-1, self._width)
        self._down()
        self._found[-1][:, : self._width] = self._factor.solve(self._right[-1][:, : self._width].astype(float))
        self._up()
        return self._found[0][:, : self._width].astype(float).reshape(right.shape)


def _rows(matrix: sparse.csr_array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pointers, columns and values of the rows, as passes take them."""
    return matrix.indptr.astype(np.uint64), matrix.indices.astype(np.uint32), matrix.data.astype(np.float32)
