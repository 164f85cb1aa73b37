"""Preconditioners of a body divided among ranks: inverses of overlapping parts, and the affine motions of each part."""

from functools import cached_property

import numpy as np
from scipy.linalg import eigh_tridiagonal

from ..body import Body
from ..body.body import sums_at_points
from .multigrid import Operator, conjugate_gradient_steps, conjugate_gradients, factor_of
from .nearest_bonds import (
    NearestBondLaplacian,
    NearestBonds,
    Preconditioner,
    by_components,
    drifting_axes,
    held_matrix,
    laplacian_of,
    random_vector,
    remove_drift,
    springs_of,
)

SOLVED, EXACTLY = 0.05, 1e-6
"""Shares of the forces that inner conjugate gradients leave: in general, and where they replace a factor.

Restricted Schwarz alone, which exchanges less, was tried for few parts: a ring under pressure then needs 173 evaluations on two
ranks and 273 on three, while one rank needs 76, and two with conjugate gradients 78."""

MOST_STEPS = 200

LEFT_BY_CHEBYSHEV = 0.2
"""Share of any component of an error that Chebyshev's method may leave. A cycle of multigrid, which replaces a factor in large bodies
on one rank, leaves as much."""

LANCZOS_STEPS = 20
"""Number of Lanczos steps that determine the ends of a spectrum accurately enough for Chebyshev's method."""

MARGIN = 1.1
"""Factor of the greatest Ritz value: Chebyshev's method magnifies components beyond the end of its interval."""


class TwoLevels:
    """Schwarz' method on two levels: the parts, and the affine motions of each.

    A part inverts the stiffness of its own points and of those halo points that have all their nearest bonds on this rank; other points
    are held. Its solution is added to those of its neighbours, and to the best combination of motions that are affine in every part.

    Parameters
    ----------
    bonds : NearestBonds
        Bonds of a part.
    multiply : callable
        Product of the stiffness and displacements (n, d); with valid displacements on all local points it is valid on the owned points.
    free : ndarray, shape (n, d)
        Zero on the halo.

    Attributes
    ----------
    inside : ndarray, shape (n, d)
        1 for the rows whose stiffness this part inverts with `invert`, which the caller sets.
    invert : callable

    References
    ----------
    Toselli and Widlund, Domain Decomposition Methods (2005), ch. 3.
    """

    invert: Operator

    def __init__(self, bonds: NearestBonds, multiply: Operator, free: np.ndarray) -> None:
        body, share = bonds.body, bonds.body.share
        self._share, self._multiply, self._free, self._body = share, multiply, free, body
        self._around = free.copy()
        share.fill(self._around)
        degrees = sums_at_points(len(body), bonds.first, bonds.second, np.ones(len(bonds.first)), 1)
        of_owners = degrees.copy()
        share.fill(of_owners)
        self.inside = self._around * (degrees == of_owners)[:, None]
        self._drifting = drifting_axes(body, self._around)
        self._coarse: tuple[np.ndarray, np.ndarray] | None = None

    def balanced(self, values: np.ndarray) -> np.ndarray:
        """Subtract, in place, the mean of values along the axes in which the body is not held, set the halo to zero, and return the values.

        For a body that can drift only balanced forces have a solution; with others conjugate gradients would not end.
        """
        remove_drift(values, self._drifting, self._share)
        self._share.clear(values)
        return values

    def applied(self, displacements: np.ndarray) -> np.ndarray:
        """Fill the halo of displacements, and return their product with the stiffness."""
        self._share.fill(displacements)
        return self._multiply(displacements) * self._free

    def both(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements of both levels under forces that are zero on the halo."""
        around = forces.copy()
        self._share.fill(around)
        found = self.invert(around * self.inside) * self.inside
        self._share.fold(found)
        modes, inverse = self._affine()
        pulls = np.concatenate(self._share.everywhere(modes.T @ forces.ravel()))
        k = modes.shape[1]
        found += (modes @ (inverse @ pulls)[k * self._share.ranks.rank : k * (self._share.ranks.rank + 1)]).reshape(forces.shape)
        return found * self._free

    def _affine(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the affine motions of own free components, shape (d n, k), and the inverse stiffness of those of all parts."""
        if self._coarse is None:
            points, share, (n, d) = self._body.points, self._share, self._free.shape
            middle = np.stack(share.everywhere(points[share.own].mean(axis=0)))[share.owners]
            # All ranks use the same unit, since each forms the motions of its neighbours as well.
            arms = (points - middle) / self._body.extent
            functions = np.column_stack([np.ones(n), arms])
            motions = np.zeros((d, d + 1, n, d))
            for axis in range(d):
                motions[axis, :, :, axis] = functions.T * self._around[:, axis]
            motions = motions.reshape(-1, n, d)
            k, count = len(motions), share.ranks.size
            own = (motions * share.own[:, None]).reshape(k, -1).T.copy()
            rows = np.zeros((k, k * count))
            for rank in np.unique(share.owners):
                theirs = (share.owners == rank)[:, None]
                for number, motion in enumerate(motions):
                    rows[:, k * rank + number] = own.T @ self._multiply(motion * theirs).ravel()
            stiffness = np.concatenate(share.everywhere(rows))
            self._coarse = own, np.linalg.pinv((stiffness + stiffness.T) / 2, rcond=1e-10, hermitian=True)
        return self._coarse

    def iterated(self, forces: np.ndarray, left: float) -> np.ndarray:
        """Return the solution of conjugate gradients that leaves a share of the forces."""
        rest = self.balanced(forces * self._free)
        return self.balanced(conjugate_gradients(rest, self.both, self.applied, self._share.dot, left, MOST_STEPS))

    def spectrum(self) -> tuple[float, float]:
        """Return the least and greatest Ritz value of the preconditioned stiffness, by conjugate gradients on random forces."""
        rest = self.balanced(random_vector(self._share, self._free))
        steps = conjugate_gradient_steps(rest, self.both, self.applied, self._share.dot, EXACTLY, LANCZOS_STEPS)
        shares, sizes = np.array([(1 / length, size) for length, _, size in steps]).T
        growths, diagonal = sizes[1:] / sizes[:-1], shares.copy()
        diagonal[1:] += growths * shares[:-1]
        values = eigh_tridiagonal(diagonal, np.sqrt(growths) * shares[:-1], eigvals_only=True)
        return float(values[0]), float(values[-1])


class SchwarzStiffness(Preconditioner):
    """Inverse of `springs_of` a body for a body in parts, by conjugate gradients with a factor for every part.

    Parameters
    ----------
    body : Body
        A part.
    shear_moduli : float or ndarray, shape (n,)
    free : ndarray, shape (n, d)
        Zero on the halo.
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> None:
        springs = springs_of(body, shear_moduli)
        matrix = springs.matrix()
        self._levels = TwoLevels(springs, lambda moved: (matrix @ moved.ravel()).reshape(moved.shape), free)
        factor = factor_of(held_matrix(matrix, self._levels.inside.ravel()))
        self._levels.invert = lambda forces: factor.solve(forces.ravel()).reshape(forces.shape)

    def solve(self, forces: np.ndarray, left: float = SOLVED) -> np.ndarray:
        """Return the displacements under forces, shape (n, d), right on the points that are owned; a share of the forces may be left."""
        return self._levels.iterated(forces, left)


class SchwarzLaplacian(Preconditioner):
    """Approximate inverse of `laplacian_of` a body for a body in parts, by some steps of Chebyshev's method.

    Unlike conjugate gradients they form one symmetric positive definite operator for all forces, and need no sums over all ranks.

    Parameters
    ----------
    body, shear_moduli, free
        See `SchwarzStiffness`.

    References
    ----------
    Saad, Iterative Methods for Sparse Linear Systems (2003), algorithm 12.1.
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> None:
        self._free, laplacian = free, laplacian_of(body, shear_moduli)
        products = [(components, matrix.__matmul__) for components, matrix in laplacian.matrices()]
        self._levels = TwoLevels(laplacian, lambda moved: by_components(products, moved), free)
        self._levels.invert = NearestBondLaplacian(body, shear_moduli, self._levels.inside).solve

    @cached_property
    def _ends(self) -> tuple[float, float, int]:
        """Ends of the spectrum, and the number of steps that reduce errors between them to `LEFT_BY_CHEBYSHEV`."""
        least, greatest = self._levels.spectrum()
        greatest *= MARGIN
        middle = (greatest + least) / (greatest - least)
        return least, greatest, int(np.ceil(np.arccosh(1 / LEFT_BY_CHEBYSHEV) / np.arccosh(middle)))

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements under forces, shape (n, d), right on the points that are owned."""
        levels = self._levels
        least, greatest, steps = self._ends
        middle, half = (greatest + least) / 2, (greatest - least) / 2
        rest = levels.balanced(forces * self._free)
        step = levels.both(rest) / middle
        found, ratio = step.copy(), half / middle
        for _ in range(steps - 1):
            rest -= levels.applied(step)
            following = 1 / (2 * middle / half - ratio)
            step = following * ratio * step + 2 * following / half * levels.both(rest)
            found += step
            ratio = following
        return levels.balanced(found)
