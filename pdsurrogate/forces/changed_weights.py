"""Changes of the weights of bonds in the deformation gradients of their first points."""

import numpy as np
import scipy

from ..body import Body
from ..engine.threads import Chunks
from .steps import Step, sparse_product

THINNEST = 1e-3
"""Least eigenvalue of the sum of x (x) x over the bonds of a point, relative to its trace, with
which the weights of these bonds may change: less means that they lie on a line or in a plane.
"""


def sums_of_products(
    places: np.ndarray, one: np.ndarray, other: np.ndarray, count: int
) -> np.ndarray:
    """Return the sums of a (x) b over the vectors a (k, d) and b (k, c) in each of `count`
    places, shape (count, d, c).
    """
    shape = one.shape[1], other.shape[1]
    return np.stack(
        [np.bincount(places, one[:, a] * other[:, b], count) for a, b in np.ndindex(shape)], axis=1
    ).reshape(count, *shape)


def moments_of(
    places: np.ndarray, functions: np.ndarray, dimension: int, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the sums of products of functions (k, c) in each of `count` places, as regular
    matrices, and flags of places that are thin.

    The first functions are the vectors of bonds; a further one may be zero. In thin places, where
    bonds do not tell functions apart, the matrices are the identity.
    """
    moments = sums_of_products(places, functions, functions, count)
    sizes = np.trace(moments, axis1=1, axis2=2)
    for further in range(dimension, functions.shape[1]):
        moments[:, further, further] += np.where(
            moments[:, further, further] == 0, sizes / dimension, 0.0
        )
    thin = np.linalg.eigvalsh(moments)[:, 0] <= THINNEST * sizes
    moments[thin] = np.eye(functions.shape[1])
    return moments, thin


class ChangedWeights:
    """Changes of the weights of some directed bonds in the deformation gradients of their first
    points.

    Parameters
    ----------
    body : Body
    chunks : Chunks
    numbers : ndarray of int, shape (k,)
        Numbers of the bonds, rising.
    changes : ndarray, shape (k, d)

    Attributes
    ----------
    owners : ndarray of int, shape (k,)
        First point of each bond.
    numbers, changes
    """

    def __init__(
        self, body: Body, chunks: Chunks, numbers: np.ndarray, changes: np.ndarray
    ) -> None:
        self._body = body
        self._chunks = chunks
        self.numbers = numbers
        self.changes = changes
        d = body.dimension
        self.owners = body.bond_owners[numbers]
        self._points, self._places = np.unique(self.owners, return_inverse=True)
        ends = np.concatenate([body.bonds.neighbors[numbers], self._points]).astype(np.int32)
        rows = d * np.concatenate([self.owners, self._points])[:, None] + np.arange(d)
        # The matrices have the entries of all bonds and of their first points, in places that
        # broken bonds do not change.
        order = np.arange(rows.size, dtype=np.int32)
        entries = order, (rows.ravel().astype(np.int32), np.repeat(ends, d))
        matrix = scipy.sparse.csr_array(entries, shape=(d * len(body), len(body.all_points)))
        matrix.sort_indices()
        self._matrices = matrix, matrix.T.tocsr()
        self._orders = [each.data for each in self._matrices]
        for each in self._matrices:
            each.data = np.zeros(len(each.data))
        self._fill()

    def _fill(self) -> None:
        """Write the changes to the matrices: from positions to columns of gradients, and minus
        its transpose.
        """
        sums = np.stack(
            [np.bincount(self._places, column, len(self._points)) for column in self.changes.T],
            axis=1,
        )
        entries = np.concatenate([self.changes, -sums]).ravel()
        for matrix, order, sign in zip(self._matrices, self._orders, (1, -1), strict=True):
            matrix.data[:] = sign * entries[order]

    def gradient_steps(self, positions: np.ndarray, gradients: np.ndarray) -> list[Step]:
        """Return the steps that add the changes' part to gradients (n + m, d d) of positions, or
        of displacements.
        """
        columns = gradients[: len(self._body)].reshape(-1, self.changes.shape[1])
        return sparse_product(
            self._chunks, self._matrices[0], positions, columns, add=True, variable=True
        )

    def pull_steps(self, moments: np.ndarray, forces: np.ndarray, add: bool = True) -> list[Step]:
        """Return the steps that add the forces that derivatives by gradients, `moments` by
        columns, exert through the changes, or write them to all `forces`.
        """
        columns = moments[: len(self._body)].reshape(-1, self.changes.shape[1])
        return sparse_product(
            self._chunks, self._matrices[1], columns, forces, add, every=not add, variable=True
        )

    def put(self, changes: np.ndarray) -> None:
        """Replace the changes."""
        self.changes[:] = changes
        self._fill()


class BalancedWeights(ChangedWeights):
    """Changes of weights with which a uniform stress exerts the load of the boundary, theory (79).

    Parameters
    ----------
    body, chunks, numbers, changes
    functions : ndarray, shape (k, d) or (k, d + 1)
        See `Kinematics.change_weights`.
    weighted_bonds, supported : ndarray
        Those of `Kinematics`.
    """

    def __init__(
        self,
        body: Body,
        chunks: Chunks,
        numbers: np.ndarray,
        changes: np.ndarray,
        functions: np.ndarray,
        weighted_bonds: np.ndarray,
        supported: np.ndarray,
    ) -> None:
        super().__init__(body, chunks, numbers, changes.copy())
        self._weighted_bonds = weighted_bonds
        self._supported = supported
        # Those of a whole body: what is left of them follows from the bonds that are broken, in
        # whatever order they broke.
        self._whole = changes
        self._functions = functions

    def renew(self, touched: np.ndarray) -> None:
        """Drop the changes of broken bonds of the points `touched`, and project the others there
        onto those that keep affine motions.
        """
        body = self._body
        d = self.changes.shape[1]
        n = len(self._body)
        chosen = np.zeros(n, dtype=bool)
        chosen[touched] = True
        found = np.flatnonzero(chosen[self.owners])
        owners = self.owners[found]
        numbers = self.numbers[found]
        whole = self._weighted_bonds[numbers].any(axis=1)
        functions, changes = (
            each[found] * whole[:, None] for each in (self._functions, self._whole)
        )
        places = np.searchsorted(touched, owners)
        moments, thin = moments_of(places, functions, d, len(touched))
        left = (self._supported[touched] > 0) & ~thin
        of_changes = sums_of_products(places, functions, changes, len(touched))
        changes -= np.einsum("bi,bij->bj", functions, np.linalg.solve(moments, of_changes)[places])
        self.changes[found] = np.where(left[places, None], changes, 0.0)
        if body.share.divided:
            every = np.zeros((len(body.bonds.neighbors), d))
            every[self.numbers] = self.changes
            body.bond_halo.fill(every)
            self.changes[:] = every[self.numbers]
        self._fill()
