"""Solution of positive semidefinite equations on the points of a body: of fourth order for
balanced gradients (theory (80a)) or less.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from ..ranks.share import connected

BOX = 6
"""Side, in spacings, of the boxes of points on which the preconditioner has linear functions.
Chosen: a solution takes some 10 steps in the plane and 20 in space; with 4 half as many, but the
factor of the functions' equations takes three times as long.
"""

RESIDUAL = 1e-8
"""Residual of the equations, relative to their right-hand side, at which their solution ends;
with 1e-6 edges move by 0.001 % too much.
"""

MOST_STEPS = 300
"""Number of conjugate-gradient steps that small systems may take, for which the number of unknowns
is not enough with rounding; larger ones may take as many as they have unknowns. Some ten or twenty
are usual on two levels.
"""

FREE = 1e-12
"""Stiffness, relative to that of motions that alternate from point to point, that counts as none.
Chosen far above rounding, and far below the stiffness of the longest waves.
"""

REGULAR = 1e-10
"""Part of the mean diagonal entry that is added to the diagonal of the equations of the functions
on boxes, which motions without stiffness make singular.
"""


def solution_of(
    matrix: scipy.sparse.csr_array, right: np.ndarray, points: np.ndarray, pieces: np.ndarray
) -> np.ndarray:
    """Return a solution (n, c) of equations for the part of their right-hand sides `right` (n, c)
    for which there is one.

    Points at which a right-hand side is NaN have no equation and the solution zero. Affine motions
    of the `pieces` (n,) of the `points` (n, d), in spacings, may have no stiffness. Conjugate
    gradients are preconditioned on two levels: by damped steps of Jacobi's method, and by linear
    functions on boxes of points, smoothed by such a step.
    """
    diagonal = matrix.diagonal()
    found = np.zeros(right.shape)
    touched = np.flatnonzero((diagonal > FREE * diagonal.max()) & np.isfinite(right).all(axis=1))
    matrix = matrix[touched][:, touched].tocsr()
    diagonal = diagonal[touched]
    points = points[touched]
    pieces = np.unique(pieces[touched], return_inverse=True)[1]
    free = np.empty((len(touched), 0))
    # Those of whole bodies first, which others with little stiffness would blur.
    for each in (scipy.sparse.csgraph.connected_components(matrix, directed=False)[1], pieces):
        free = _with_free_motions(free, matrix, points, each)
    precondition = _two_levels(matrix, diagonal, points, pieces)

    def without_free(values: np.ndarray) -> np.ndarray:
        return values - np.einsum("nm,mc->nc", free, np.einsum("nm,nc->mc", free, values))

    found[touched] = conjugate_gradients(
        matrix, without_free(right[touched]), lambda residual: without_free(precondition(residual))
    )
    return found


def conjugate_gradients(
    matrix, right: np.ndarray, precondition: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Return the solution (n, c) of equations with a positive semidefinite matrix (n, n) for
    right-hand sides (n, c) that have one.

    It ends at `RESIDUAL`. The sums do not depend on the number of threads.
    """
    residual = right.copy()
    solution = np.zeros_like(right)
    step = np.zeros_like(right)
    before = np.ones(right.shape[1])
    least = RESIDUAL * np.abs(right).max(initial=0.0)
    for _ in range(max(MOST_STEPS, len(right))):
        if np.abs(residual).max(initial=0.0) <= least:
            break
        towards = precondition(residual)
        size = np.einsum("nc,nc->c", residual, towards)
        step = towards + size / before * step
        pulls = matrix @ step
        stiffness = np.einsum("nc,nc->c", step, pulls)
        # A component that is solved to rounding takes no more steps.
        length = np.where(stiffness > 0, size, 0.0) / np.where(stiffness > 0, stiffness, 1.0)
        solution += length * step
        residual -= length * pulls
        before = np.where(size > 0, size, 1.0)
    return solution


def _with_free_motions(
    free: np.ndarray, matrix, points: np.ndarray, pieces: np.ndarray
) -> np.ndarray:
    """Return orthonormal motions (n, m): `free`, and further ones without stiffness that are
    affine on each of the `pieces` (n,).
    """
    n, d = points.shape
    counts = np.bincount(pieces)
    middles = (
        np.stack([np.bincount(pieces, column) for column in points.T], axis=1) / counts[:, None]
    )
    values = np.column_stack([np.ones(n), points - middles[pieces]])
    sizes = np.sqrt(np.stack([np.bincount(pieces, column**2) for column in values.T], axis=1))
    values /= np.where(sizes > 0, sizes, 1.0)[pieces]
    columns = (d + 1) * pieces[:, None] + np.arange(d + 1)
    motions = scipy.sparse.csr_array(
        (values.ravel(), columns.ravel(), (d + 1) * np.arange(n + 1)),
        shape=(n, (d + 1) * len(counts)),
    )
    stiffness, combined = np.linalg.eigh((motions.T @ (matrix @ motions)).toarray())
    found = motions @ combined[:, stiffness <= FREE * matrix.diagonal().max(initial=0.0)]
    found = found - np.einsum("nm,mk->nk", free, np.einsum("nm,nk->mk", free, found))
    squares, combined = np.linalg.eigh(np.einsum("nm,nk->mk", found, found))
    kept = squares > FREE
    return np.hstack(
        [free, np.einsum("nm,mk->nk", found, combined[:, kept] / np.sqrt(squares[kept]))]
    )


def _two_levels(
    matrix, diagonal: np.ndarray, points: np.ndarray, pieces: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function near the inverse of a matrix (n, n), symmetric and positive definite,
    that multiplies arrays (n, c).
    """
    n, d = points.shape
    wave = np.random.default_rng(0).normal(size=n)
    for _ in range(20):
        wave = matrix @ (wave / np.sqrt(np.einsum("n,n->", wave, wave))) / diagonal
    damping = 4 / 3 / np.sqrt(np.einsum("n,n->", wave, wave)) / diagonal[:, None]

    # Points in one box that only others connect, as on both sides of a cut, have functions of their
    # own, and so have the pieces.
    boxes = np.unique(
        np.floor((points - points.min(axis=0)) / BOX + FREE), axis=0, return_inverse=True
    )[1].ravel()
    entries = matrix.tocoo()
    within = (boxes[entries.row] == boxes[entries.col]) & (
        pieces[entries.row] == pieces[entries.col]
    )
    count, boxes = connected(n, entries.row[within], entries.col[within])
    middles = (
        np.stack([np.bincount(boxes, column, count) for column in points.T], axis=1)
        / np.bincount(boxes, minlength=count)[:, None]
    )
    values = np.column_stack([np.ones(n), (points - middles[boxes]) / BOX])
    columns = (d + 1) * boxes[:, None] + np.arange(d + 1)
    linear = scipy.sparse.csr_array(
        (values.ravel(), columns.ravel(), (d + 1) * np.arange(n + 1)), shape=(n, (d + 1) * count)
    )
    smooth = (linear - scipy.sparse.diags_array(damping[:, 0]) @ (matrix @ linear)).tocsr()
    back = smooth.T.tocsr()
    coarse = (back @ (matrix @ smooth)).tocsc()
    regular = (
        REGULAR * coarse.diagonal().mean() * scipy.sparse.eye_array(coarse.shape[0], format="csc")
    )
    options = {"SymmetricMode": True}
    factor = scipy.sparse.linalg.splu(
        coarse + regular, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
    )

    def precondition(right: np.ndarray) -> np.ndarray:
        found = damping * right
        found += damping * (right - matrix @ found)
        found += smooth @ factor.solve(back @ (right - matrix @ found))
        for _ in range(2):
            found += damping * (right - matrix @ found)
        return found

    return precondition
