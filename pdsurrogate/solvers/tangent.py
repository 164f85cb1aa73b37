"""Linear equations of the tangent of a force: the displacements that small changes of the forces
cause.
"""

from collections.abc import Callable, Iterable

import numpy as np

from ..forces import InternalForce
from .equilibrium import NotConverged
from .nearest_bonds import Preconditioner
from .preconditioner import stiffness_of_nearest_bonds

MOST_PRODUCTS = 600
"""Greatest number of products of the tangent in one solution; some tens are usual."""

STEP = 2e-7
"""Greatest displacement of a point, in spacings, in the one-sided differences of forces that
approximate products of the tangent. Chosen: their relative errors, by rounding and curvature
together, are then some 1e-7 in sheets and 3e-6 in solids at K = 1000 mu.
"""

COARSE = 1e-5
FINE = 1e-3
"""Greatest displacements of a point, in spacings, in central differences of forces of second order,
and in those of fourth order, which also take half of it. Chosen: at K = 100 mu the former have
relative errors of 1e-8, by curvature and rounding alike; both grow with K. The errors of the latter
are 1e-12 K/mu.
"""

FREELY = 1e-6
"""Forces on a body that moves freely, divided by those that its bonds cause at displacements that
alternate from point to point. Chosen: rounding of differences leaves some 1e-9.
"""

LOST = 0.1
"""Share of a vector that is left after the components along others are subtracted, below which
rounding requires to do so again.
"""

MEMORY = 4e7
LEAST_KEPT = 100
MOST_KEPT = 200
"""Bytes of the directions kept from one solution for the next, and least and greatest number of
these directions. Chosen: they then add a quarter or less to the memory of a simulation, 22 kB for a
point; with 100 and 130 instead of 200, eight derivatives in a block need 314 and 285 instead of 228
evaluations, and the derivatives of a sheet as many.
"""


def central_difference(
    values: Callable[[float], np.ndarray], step: float, fine: bool
) -> np.ndarray:
    """Return the derivative of an array at 0 by a central difference over `step`, of fourth
    order with half of it as well if `fine`.
    """
    found = [
        (values(width) - values(-width)) / (2 * width) for width in (step, step / 2)[: 1 + fine]
    ]
    return (4 * found[1] - found[0]) / 3 if fine else found[0]


def tangent_product(
    force: InternalForce,
    positions: np.ndarray,
    displacements: np.ndarray,
    step: float,
    fine: bool = False,
) -> np.ndarray:
    """Return the product of the tangent at positions (n, d) with displacements (n, d), by a
    `central_difference` over `step` of them.
    """

    def forces_at(width: float) -> np.ndarray:
        found = np.empty_like(positions)
        force(positions + width * displacements, found)
        return found

    return -central_difference(forces_at, step, fine)


class TangentEquations:
    """Linear equations of the tangent of a force in one state, for displacements of the free
    components; `move` takes a state near it.

    The solver is the flexible generalized conjugate residual method, which permits preconditioners
    that are themselves iterations, and tangents that are not symmetric. Its directions, and their
    products with the tangent, are kept from one solution to the next: right-hand sides that
    resemble earlier ones need few further products. Directions are extended with one-sided
    differences of forces, one evaluation each. Their errors remain in a solution: a better one
    takes its residual, from the products that `forces` gives, and a correction.

    Parameters
    ----------
    force : InternalForce or LoadedForce
        Force in double precision, in a body that is not divided among ranks.
    positions : ndarray, shape (n, d)
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    preconditioner : Preconditioner

    Attributes
    ----------
    products : int
        Number of products of the tangent so far.

    References
    ----------
    Eisenstat, Elman and Schultz, SIAM J. Numer. Anal. 20 (1983) 345-357; de Sturler, J. Comput.
    Appl. Math. 67 (1996) 15-41.
    """

    def __init__(
        self,
        force: InternalForce,
        positions: np.ndarray,
        free: np.ndarray,
        preconditioner: Preconditioner,
    ) -> None:
        self._force = force
        self._free = free
        self._preconditioner = preconditioner
        self.products = 0
        self._here = np.empty_like(positions)
        self.move(positions)
        preconditioner.update()
        size = int(np.clip(MEMORY / (16 * positions.size), LEAST_KEPT, MOST_KEPT))
        # Rows are touched, and take memory, when they are first written.
        self._moved = np.empty((size, positions.size))
        self._pulled = np.empty((size, positions.size))
        self._kept = 0

    def move(self, positions: np.ndarray) -> None:
        """Take another state near the present one: positions (n, d).

        Directions are kept with their products with the earlier tangent. The errors that this
        causes in solutions are corrected as those of one-sided differences are.
        """
        self._positions = positions.copy()
        self._force(self._positions, self._here)

    def _projected(self, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the displacements that the directions so far give for forces (n d,), and the
        forces that they leave.
        """
        kept = min(self._kept, len(self._moved))
        shares = self._pulled[:kept] @ forces
        return shares @ self._moved[:kept], forces - shares @ self._pulled[:kept]

    def displacements(
        self, forces: np.ndarray, share_left: float, negligible: float = 0.0
    ) -> np.ndarray:
        """Return the approximate displacements (n, d) under small forces (n, d).

        Parameters
        ----------
        forces : ndarray, shape (n, d)
        share_left : float
            Norm of the residual at the end, divided by that of the forces on free components, as
            one-sided differences give it.
        negligible : float
            Norm of forces that rounding alone may cause; a smaller residual is no aim.

        Raises
        ------
        NotConverged
            If the equations are not solved, as near limit loads and buckling, where the tangent is
            nearly singular.
        """
        left = (self._free * forces).ravel()
        found = np.zeros_like(left)
        self._reduce(
            found,
            left,
            max(share_left * float(np.linalg.norm(left)), negligible),
            self.products + MOST_PRODUCTS,
        )
        return found.reshape(forces.shape)

    def estimate(self, forces: np.ndarray) -> tuple[np.ndarray, float]:
        """Return a first estimate of the displacements (n, d) under small forces (n, d), without
        products, and the root of their work.

        The estimate consists of the shares of the kept directions, and of the displacements of the
        preconditioner under the other forces.
        """
        moved, left = self._projected((self._free * forces).ravel())
        moved = moved.reshape(forces.shape) + self._free * self._preconditioner.solve(
            left.reshape(forces.shape)
        )
        return moved, float(np.sqrt(abs(np.vdot(moved, forces))))

    def forces(self, displacements: np.ndarray, width: float = COARSE) -> np.ndarray:
        """Return the product of the tangent with displacements (n, d), the forces that cause them,
        by central differences.

        Points move by at most `width` spacings. Differences over more than `COARSE` are of fourth
        order.
        """
        self.products += 1
        unit = self._force.body.spacing / max(np.abs(displacements).max(), 1e-300)
        return tangent_product(
            self._force, self._positions, displacements, width * unit, width > COARSE
        )

    def _reduce(self, found: np.ndarray, left: np.ndarray, goal: float, most: int) -> None:
        """Reduce the residual `left` to the norm `goal`, and add the displacements to `found`,
        both in place.
        """
        moved, left[:] = self._projected(left)
        found += moved
        while not float(np.linalg.norm(left)) <= goal:
            if self.products >= most or not np.isfinite(left).all():
                raise NotConverged(
                    f"the linear equations of the tangent are not solved after {MOST_PRODUCTS}"
                    " products: it is nearly singular"
                )
            moved = (
                self._free * self._preconditioner.solve(left.reshape(self._free.shape))
            ).ravel()
            place = self._keep(moved, self._quick(moved))
            share = float(self._pulled[place] @ left)
            found += share * self._moved[place]
            left -= share * self._pulled[place]

    def learn(self, displacements: Iterable[np.ndarray]) -> None:
        """Keep displacements of the free components, each (n, d), as directions: solutions that
        contain them are then found sooner.

        Displacements that cause no forces, as those of a body that may move freely, are left out.
        """
        stiffness = stiffness_of_nearest_bonds(self._force)
        for each in displacements:
            moved = self._free * each
            pulled = self._quick(moved.ravel())
            if np.linalg.norm(pulled) > FREELY * np.linalg.norm(stiffness * moved):
                self._keep(moved.ravel(), pulled)

    def _keep(self, moved: np.ndarray, pulled: np.ndarray) -> int:
        """Keep displacements and the forces that cause them, made orthonormal to those before,
        and return their place.
        """
        kept = min(self._kept, len(self._moved))
        before = np.inf
        size = float(np.linalg.norm(pulled))
        while before == np.inf or size < LOST * before:
            shares = self._pulled[:kept] @ pulled
            pulled -= shares @ self._pulled[:kept]
            moved -= shares @ self._moved[:kept]
            before = size
            size = float(np.linalg.norm(pulled))
        place = self._kept % len(self._moved)
        self._moved[place], self._pulled[place], self._kept = (
            moved / size,
            pulled / size,
            self._kept + 1,
        )
        return place

    def _quick(self, moved: np.ndarray) -> np.ndarray:
        """Return the approximate product of the tangent with free displacements, by a one-sided
        difference.
        """
        self.products += 1
        step = STEP * self._force.body.spacing / max(np.abs(moved).max(), 1e-300)
        forces = np.empty_like(self._here)
        self._force(self._positions + step * moved.reshape(self._free.shape), forces)
        return (self._free * (self._here - forces) / step).ravel()
