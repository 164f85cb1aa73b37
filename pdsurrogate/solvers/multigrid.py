"""A cycle of multigrid for Laplacians of scattered points, which costs a few products with the matrix whatever their number."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

COARSENING = 3
"""Mean distances of points, along each axis, that are one on the next level."""

FEW = 1_500
"""Points of a level that is factorised."""


class Multigrid:
    """Smoothed aggregation over boxes of points.

    One cycle is a symmetric positive definite operator near the inverse of the matrix, a fixed one: what a preconditioner asks for.

    Parameters
    ----------
    matrix : sparse.csr_array, shape (n, n)
        Symmetric and positive definite, with no positive entries beside the diagonal but those of images.
    points : ndarray, shape (n, d)
    spacing : float
        Mean distance of neighbouring points.
    free : ndarray of bool, shape (n,)
        The others are joined to nothing.

    References
    ----------
    Vanek, Mandel and Brezina, Computing 56 (1996) 179-196.
    """

    def __init__(self, matrix: sparse.csr_array, points: np.ndarray, spacing: float, free: np.ndarray) -> None:
        self._levels, self._factor = [], None
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
            self._levels.append((matrix, relaxation, prolongation, prolongation.T.tocsr()))
            matrix = (prolongation.T @ (matrix @ prolongation)).tocsr()
            counts = np.bincount(box)
            points = np.stack([np.bincount(box, column) / counts for column in points[rows].T], axis=1)
            spacing, free = spacing * COARSENING, np.ones(len(kept), dtype=bool)
        self._factor = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def cycle(self, right: np.ndarray, level: int = 0) -> np.ndarray:
        """Nearly the solution for a right hand side, shape (n,) or (n, k)."""
        if level == len(self._levels):
            return self._factor.solve(right)
        matrix, relaxation, prolongation, restriction = self._levels[level]
        relaxation = relaxation if right.ndim == 1 else relaxation[:, None]
        found = relaxation * right
        found += relaxation * (right - matrix @ found)
        found += prolongation @ self.cycle(restriction @ (right - matrix @ found), level + 1)
        for _ in range(2):
            found += relaxation * (right - matrix @ found)
        return found
