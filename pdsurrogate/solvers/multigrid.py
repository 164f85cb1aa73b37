"""Solvers of linear systems: a multigrid cycle for Laplacians of scattered points, and conjugate gradients for operators."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy

from ..engine.block_arrays import power_of_two
from ..engine.passes import Chain
from ..engine.threads import chunks_of
from ..kernels.multigrid import passes_of

Operator = Callable[[np.ndarray], np.ndarray]
InnerProduct = Callable[[np.ndarray, np.ndarray], float]

COARSENING = 3
"""Mean distance of points on a multigrid level, divided by that on the next finer level, along each axis. Three is usual for smoothed
aggregation (Vanek, Mandel, Brezina 1996): smoothed boxes then overlap their neighbors only, and the matrices of all levels together have
few more entries than the first."""

FEW = 1_500
"""Greatest number of unknowns of a multigrid level that is factorized instead of coarsened further. Chosen: such a factor takes
18 MB at most, even if it fills in completely."""

JACOBI = 4 / 3
"""Factor of the two relaxation steps on a multigrid level, in units of the greatest eigenvalue of D^-1 A: a positive definite cycle, since
the steps reduce every error. Chosen by the number of force evaluations: a twisted cube (24 points a side) needs a fifth more with the two
factors of Chebyshev's method, although the cycle is then nearer to the inverse."""


def factor_of(matrix: scipy.sparse.sparray):
    """Return the sparse factorization, without pivoting, of a symmetric positive definite matrix: an object with a method `solve`."""
    return scipy.sparse.linalg.splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


class Multigrid:
    """Multigrid preconditioner for a Laplacian of points: smoothed aggregation over boxes of points, with a W cycle.

    One cycle is a fixed, symmetric positive definite operator near the inverse of the matrix, as a preconditioner must be. It uses single
    precision. All boxes have equal sizes: a last layer of boxes only one point thick would leave errors there that are small in energy
    but large in strain.

    Parameters
    ----------
    matrix : sparse.csr_array, shape (n, n)
        Symmetric and positive definite; only bonds to images may have positive off-diagonal entries.
    points : ndarray, shape (n, d)
    spacing : float
        Mean distance of neighboring points.
    free : ndarray of bool, shape (n,)
        False for held points, whose rows of the matrix have no off-diagonal entries.
    width : int
        Number of right-hand sides that are solved for at once.

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
    ) -> None:
        # Powers of two scale the values into the range of single precision, in any units, without rounding.
        self._unit = power_of_two(matrix.diagonal().mean())
        matrix = matrix / self._unit
        # Rows of three are read as four.
        self._width, held = width, {3: 4}.get(width, width)
        self._levels = [_Level(matrix.shape[0], held)]
        while matrix.shape[0] > FEW:
            diagonal = matrix.diagonal()
            # Gershgorin's bound of the spectrum of D^-1 A.
            greatest = float((abs(matrix).sum(axis=1) / diagonal).max())
            relaxation = JACOBI / greatest / diagonal
            rows = np.flatnonzero(free)
            boxes = boxes_of(points[rows], spacing, points[rows].min(axis=0), points[rows].max(axis=0))
            kept, box = np.unique(boxes, return_inverse=True)
            if 2 * len(kept) > len(rows):
                break
            constant = scipy.sparse.csr_array((np.ones(len(rows)), (rows, box)), shape=(len(points), len(kept)))
            prolongation = (constant - scipy.sparse.diags_array(relaxation) @ (matrix @ constant)).tocsr()
            self._levels.append(_Level(prolongation.shape[1], held))
            self._levels[-2].bind(matrix, relaxation, prolongation, self._levels[-1])
            matrix = (prolongation.T @ (matrix @ prolongation)).tocsr()
            counts = np.bincount(box)
            points = np.stack([np.bincount(box, column) / counts for column in points[rows].T], axis=1)
            spacing, free = spacing * COARSENING, np.ones(len(kept), dtype=bool)
        self._factor = factor_of(matrix)

    def cycle(self, right: np.ndarray) -> np.ndarray:
        """Return the approximate solution, by one W cycle, for a right-hand side (n,), or for several in the columns of (n, width)."""
        if len(self._levels) == 1:
            return self._factor.solve(right) / self._unit
        finest, unit = self._levels[0], power_of_two(np.abs(right).max())
        finest.right[:, : self._width] = right.reshape(-1, self._width) / unit
        self._visit(0)
        return finest.found[:, : self._width].reshape(right.shape) * (unit / self._unit)

    def _visit(self, number: int) -> None:
        """Compute the approximate solution `found` of a level from its right-hand side `right`, by visits to the coarser levels."""
        level = self._levels[number]
        if level.down is None:
            level.found[:, : self._width] = self._factor.solve(level.right[:, : self._width].astype(float))
            return
        level.down()
        coarser = self._levels[number + 1]
        self._visit(number + 1)
        if coarser.down is not None:
            coarser.first[:] = coarser.found
            coarser.take_rest()
            coarser.right[:] = coarser.rest
            self._visit(number + 1)
            coarser.found += coarser.first
        level.up()


class _Level:
    """Arrays of one multigrid level, and the compiled passes over them.

    Parameters
    ----------
    count : int
        Number n of unknowns for each right-hand side.
    held : int
        Number of columns of the arrays, one for each right-hand side; three right-hand sides are stored in 4 columns.

    Attributes
    ----------
    right, found, rest, first : ndarray of float32, shape (n, held)
        Right-hand side; solution; residual or intermediate solution; and the solution after the first of the two visits of a W cycle.
    down, up : Chain or None
        Passes from `right` to the right-hand side of the next coarser level, and from the solution there to `found`; None on the coarsest.
    take_rest : Chain or None
        Pass that computes the residual `rest` of the solution `found`.
    """

    def __init__(self, count: int, held: int) -> None:
        self.right, self.found, self.rest, self.first = np.zeros((4, count, held), dtype=np.float32)
        self.down = self.up = self.take_rest = None

    def bind(self, matrix: scipy.sparse.csr_array, relaxation: np.ndarray, prolongation: scipy.sparse.csr_array, coarser: _Level) -> None:
        """Create the passes `down`, `up` and `take_rest` between this level and the next coarser one.

        There are two steps with the factors `relaxation` (n,) on the residual before the coarser level, and two after it. The matrix
        `prolongation` maps a solution of the coarser level to this one.
        """
        rows, restriction = rows_of_matrix(matrix), rows_of_matrix(prolongation.T.tocsr())
        factors = relaxation.astype(np.float32)
        right, found, rest = self.right, self.found, self.rest
        passes, chunks = passes_of(right.shape[1]), chunks_of(matrix.nnz)
        self.down = Chain(
            passes.scale.bind(factors, right, rest, chunks=chunks),
            passes.relax.bind(*rows, factors, right, rest, found, chunks=chunks),
            passes.residual.bind(*rows, right, found, rest, chunks=chunks),
            passes.add_product.bind(*restriction, rest, 0.0, coarser.found, coarser.right, chunks=chunks),
        )
        self.up = Chain(
            passes.add_product.bind(*rows_of_matrix(prolongation), coarser.found, 1.0, rest, found, chunks=chunks),
            passes.relax.bind(*rows, factors, right, found, rest, chunks=chunks),
            passes.relax.bind(*rows, factors, right, rest, found, chunks=chunks),
        )
        self.take_rest = Chain(passes.residual.bind(*rows, right, found, rest, chunks=chunks))


def boxes_of(points: np.ndarray, spacing: float, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Return the number of the box in which each point lies, shape (n,); boxes are equal, and about `COARSENING` spacings wide.

    `lower` and `upper` (d,) are the least and greatest coordinates of all points of the body, those of other ranks included.
    """
    least = lower - spacing / 2
    extent = upper + spacing / 2 - least
    counts = np.maximum(1, np.rint(extent / (COARSENING * spacing))).astype(np.int64)
    # Points between two boxes are assigned to the same side, independent of rounding.
    cells = np.floor((points - least) / extent * counts + 1e-9).astype(np.int64)
    return np.ravel_multi_index(tuple(cells.T), tuple(counts))


def rows_of_matrix(matrix: scipy.sparse.csr_array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return row pointers, column numbers and values of a sparse matrix, converted to the types that the compiled passes take."""
    return matrix.indptr.astype(np.uint64), matrix.indices.astype(np.uint32), matrix.data.astype(np.float32)


def conjugate_gradient_steps(
    left: np.ndarray, precondition: Operator, image_of: Operator, dot: InnerProduct, share_left: float, most: int
) -> Iterator[tuple[float, np.ndarray, float]]:
    """Yield, for every step of conjugate gradients, its length, its direction, and the squared norm of the residual before it.

    The solution is the sum of the lengths times the directions. The steps end when the residual is small enough, or after `most`.

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
        Norm of the residual at the end divided by that of the right-hand side, both in the norm of `precondition`.
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
        yield length, direction, size
        left -= length * image
        better = precondition(left)
        size, before = dot(left, better), size
        direction = better + size / before * direction


def conjugate_gradients(left: np.ndarray, *settings) -> np.ndarray:
    """Return the solution of a linear system by conjugate gradients; the arguments are those of `conjugate_gradient_steps`."""
    found = np.zeros_like(left)
    for length, direction, _ in conjugate_gradient_steps(left, *settings):
        found += length * direction
    return found
