"""Solvers of linear systems: a multigrid cycle for Laplacians of scattered points, and conjugate
gradients for operators.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy

from ..engine.block_arrays import power_of_two
from ..engine.passes import Chain
from ..engine.threads import chunks_of
from ..kernels.multigrid import passes_of
from ..ranks import Share

Operator = Callable[[np.ndarray], np.ndarray]
InnerProduct = Callable[[np.ndarray, np.ndarray], float]

COARSENING = 3
"""Mean distance of points on a multigrid level, divided by that on the next finer level, along each
axis. Three is usual for smoothed aggregation (Vanek, Mandel, Brezina 1996): smoothed boxes then
overlap their neighbors only, and the matrices of all levels together have few more entries than the
first.
"""

FEW = 1_500
"""Greatest number of unknowns of a multigrid level that is factorized instead of coarsened further.
Chosen: such a factor takes 18 MB at most, even if it fills in completely.
"""

JACOBI = 4 / 3
"""Factor of the two relaxation steps on a multigrid level, in units of the greatest eigenvalue of
D^-1 A: a positive definite cycle, since the steps reduce every error. Chosen by the number of force
evaluations: a twisted cube (24 points a side) needs a fifth more with the two factors of
Chebyshev's method, although the cycle is then nearer to the inverse.
"""


def factor_of(matrix: scipy.sparse.sparray):
    """Return the sparse factorization, without pivoting, of a symmetric positive definite
    matrix: an object with a method `solve`.
    """
    return scipy.sparse.linalg.splu(
        matrix.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


class Multigrid:
    """Multigrid preconditioner for a Laplacian of points: smoothed aggregation over boxes of
    points, with a W cycle.

    One cycle is a fixed, symmetric positive definite operator near the inverse of the matrix, as a
    preconditioner must be. It uses single precision. All boxes have equal sizes: a last layer of
    boxes only one point thick would leave errors there that are small in energy but large in
    strain.

    In a body that is divided among ranks each rank smooths the errors of its own points, and the
    ranks exchange the halo after every step. The next coarser level has a 27th of the points in
    three dimensions and a ninth in the plane, so that every rank solves on it, and on all coarser
    ones, for itself: the same operator as in one process but for rounding.

    Parameters
    ----------
    matrix : sparse.csr_array, shape (n, n)
        Symmetric and positive definite; only bonds to images may have positive off-diagonal
        entries. Rows of the halo are not used.
    points : ndarray, shape (n, d)
    spacing : float
        Mean distance of neighboring points.
    free : ndarray of bool, shape (n,)
        False for held points, whose rows of the matrix have no off-diagonal entries.
    width : int
        Number of right-hand sides that are solved for at once.
    share : Share, optional
        Part of the body that this rank works on; by default the whole body.

    References
    ----------
    Vanek, Mandel and Brezina, Computing 56 (1996) 179-196.
    """

    def __init__(
        self,
        matrix: scipy.sparse.csr_array,
        points: np.ndarray,
        spacing: float,
        free: np.ndarray,
        width: int = 1,
        share: Share | None = None,
    ) -> None:
        self._share = share = share or Share.whole(len(points))
        diagonal = matrix.diagonal()
        # Powers of two scale the values into the range of single precision, in any units, without
        # rounding.
        self._width = width
        self._unit = power_of_two(share.sum(diagonal) / share.size)
        matrix = matrix / self._unit
        diagonal = diagonal / self._unit
        rows = np.flatnonzero(free)
        self._factor = None
        lower = points[rows].min(axis=0, initial=np.inf)
        upper = points[rows].max(axis=0, initial=-np.inf)
        box = boxes_of(
            points[rows],
            spacing,
            np.min(share.everywhere(lower), axis=0),
            np.max(share.everywhere(upper), axis=0),
        )
        kept = np.unique(np.concatenate(share.everywhere(np.unique(box))))
        if share.size <= FEW or 2 * len(kept) > share.total(int(np.count_nonzero(share.own[rows]))):
            self._factor = factor_of(matrix)
            return
        # Gershgorin's bound of the spectrum of D^-1 A.
        relaxation = (
            JACOBI / share.greatest((abs(matrix).sum(axis=1) / diagonal)[share.own]) / diagonal
        )
        box = np.searchsorted(kept, box)
        constant = scipy.sparse.csr_array(
            (np.ones(len(rows)), (rows, box)), shape=(len(points), len(kept))
        )
        prolongation = share.fill_sparse(
            (constant - scipy.sparse.diags_array(relaxation) @ (matrix @ constant)).tocsr()
        )
        restriction = (prolongation.T @ scipy.sparse.diags_array(share.own.astype(float))).tocsr()
        coarse = sum(share.everywhere((restriction @ (matrix @ prolongation)).tocsr())).tocsr()
        owned = share.own[rows]
        counts = share.total(np.bincount(box[owned], minlength=len(kept)).astype(float))
        sums = (
            share.total(np.bincount(box[owned], column[owned], len(kept)))
            for column in points[rows].T
        )
        centers = np.stack([total / counts for total in sums], axis=1)
        self._coarse = Multigrid(
            coarse, centers, spacing * COARSENING, np.ones(len(kept), dtype=bool), width
        )
        self._coarse_matrix = None if self._coarse.factorized else coarse
        self._bind(matrix, relaxation, prolongation, restriction)

    def _bind(self, matrix, relaxation, prolongation, restriction) -> None:
        """Bind the passes of this level to its arrays, in single precision; rows of three
        right-hand sides are read as four.

        There are two steps with the factors `relaxation` (n,) on the residual before the coarser
        level, and two after it. The matrix `prolongation` maps a solution of the coarser level to
        this one.
        """
        count, few = prolongation.shape
        held = {3: 4}.get(self._width, self._width)
        self._right, self._found, self._rest = np.zeros((3, count, held), dtype=np.float32)
        self._coarse_right, self._coarse_found, working = np.zeros((3, few, held), dtype=np.float32)
        rows = rows_of_matrix(matrix)
        passes = passes_of(held)
        chunks = chunks_of(matrix.nnz)
        factors = relaxation.astype(np.float32)
        right = self._right
        found = self._found
        rest = self._rest
        self._scale = Chain(passes.scale.bind(factors, right, rest, chunks=chunks))
        self._relax = Chain(passes.relax.bind(*rows, factors, right, rest, found, chunks=chunks))
        self._restrict = Chain(
            passes.residual.bind(*rows, right, found, rest, chunks=chunks),
            passes.add_product.bind(
                *rows_of_matrix(restriction), rest, 0.0, working, self._coarse_right, chunks=chunks
            ),
        )
        self._prolong = Chain(
            passes.add_product.bind(
                *rows_of_matrix(prolongation), self._coarse_found, 1.0, rest, found, chunks=chunks
            ),
            passes.relax.bind(*rows, factors, right, found, rest, chunks=chunks),
        )

    @property
    def factorized(self) -> bool:
        """Whether the matrix is factorized instead of coarsened."""
        return self._factor is not None

    def cycle(self, right: np.ndarray) -> np.ndarray:
        """Return the approximate solution on own points by one W cycle, for a right-hand side
        (n,), or several in columns (n, width).
        """
        if self._factor is not None:
            return self._factor.solve(right) / self._unit
        share = self._share
        width = self._width
        unit = power_of_two(share.greatest(np.abs(right[share.own] if share.divided else right)))
        self._right[:, :width] = right.reshape(-1, width) / unit
        share.clear(self._right)
        self._scale()
        share.fill(self._rest)
        self._relax()
        share.fill(self._found)
        self._restrict()
        coarse = share.total(self._coarse_right[:, :width].astype(float))
        found = self._coarse.cycle(coarse)
        if self._coarse_matrix is not None:
            found += self._coarse.cycle(coarse - self._coarse_matrix @ found)
        self._coarse_found[:, :width] = found
        self._prolong()
        share.fill(self._rest)
        self._relax()
        return self._found[:, :width].reshape(right.shape) * (unit / self._unit)


def boxes_of(
    points: np.ndarray, spacing: float, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """Return the number of the box in which each point lies, shape (n,); boxes are equal, and about
    `COARSENING` spacings wide.

    `lower` and `upper` (d,) are the least and greatest coordinates of all points of the body, those
    of other ranks included.
    """
    least = lower - spacing / 2
    extent = upper + spacing / 2 - least
    counts = np.maximum(1, np.rint(extent / (COARSENING * spacing))).astype(np.int64)
    # Points between two boxes are assigned to the same side, independent of rounding.
    cells = np.floor((points - least) / extent * counts + 1e-9).astype(np.int64)
    return np.ravel_multi_index(tuple(cells.T), tuple(counts))


def rows_of_matrix(matrix: scipy.sparse.csr_array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return row pointers, column numbers and values of a sparse matrix, converted to the types
    that the compiled passes take.
    """
    return (
        matrix.indptr.astype(np.uint64),
        matrix.indices.astype(np.uint32),
        matrix.data.astype(np.float32),
    )


def conjugate_gradient_steps(
    left: np.ndarray,
    precondition: Operator,
    image_of: Operator,
    dot: InnerProduct,
    share_left: float,
    most: int,
) -> Iterator[tuple[float, np.ndarray]]:
    """Yield, for every step of conjugate gradients, its length and its direction.

    The solution is the sum of the lengths times the directions. The steps end when the residual is
    small enough, or after `most`.

    Parameters
    ----------
    left : ndarray
        Right-hand side, changed in place to the residual.
    precondition : callable
        Approximate inverse of the matrix: fixed, symmetric and positive definite.
    image_of : callable
        Product of the matrix and a direction.
    dot : callable
        Inner product.
    share_left : float
        Norm of the residual at the end divided by that of the right-hand side, both in the norm of
        `precondition`.
    most : int
        Greatest number of steps.
    """
    direction = better = precondition(left)
    size = dot(left, better)
    least = share_left**2 * size
    for _ in range(most):
        if not size > least:
            return
        image = image_of(direction)
        length = size / dot(direction, image)
        yield length, direction
        left -= length * image
        better = precondition(left)
        size, before = dot(left, better), size
        direction = better + size / before * direction


def conjugate_gradients(left: np.ndarray, *settings) -> np.ndarray:
    """Return the solution of a linear system by conjugate gradients; the arguments are those of
    `conjugate_gradient_steps`.
    """
    found = np.zeros_like(left)
    for length, direction in conjugate_gradient_steps(left, *settings):
        found += length * direction
    return found
