"""Linear equations of the tangent of a force: the displacements that small changes of the forces cause."""

import numpy as np
import scipy

from ..forces import InternalForce
from .equilibrium import NotConverged
from .nearest_bonds import Preconditioner

INNER, OUTER = 30, 20
"""Products of the tangent between two restarts of the linear solver, and greatest number of restarts.

Vectors kept from one right-hand side for the next (GCROT's recycling) were tried: the errors of differences of forces then grow without
bound."""


class TangentEquations:
    """Linear equations of the tangent of a force in one state, for displacements of the free components.

    The solver is the flexible GCROT method, which permits preconditioners that are themselves iterations, and tangents that are not
    symmetric.

    Parameters
    ----------
    force : InternalForce or LoadedForce
        Force in double precision, in a body that is not divided among ranks.
    positions : ndarray, shape (n, d)
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    preconditioner : Preconditioner
    """

    def __init__(self, force: InternalForce, positions: np.ndarray, free: np.ndarray, preconditioner: Preconditioner) -> None:
        tangent, size, shape = force.tangent(positions), positions.size, positions.shape
        force(positions, np.empty_like(positions))
        preconditioner.update()

        def forces_of(displacements: np.ndarray) -> np.ndarray:
            return (free * (tangent @ (free.ravel() * displacements.ravel())).reshape(shape)).ravel()

        def approximate(forces: np.ndarray) -> np.ndarray:
            return (free * preconditioner.solve(free * forces.reshape(shape))).ravel()

        self._free = free
        self._tangent = scipy.sparse.linalg.LinearOperator((size, size), forces_of, dtype=float)
        self._approximate = scipy.sparse.linalg.LinearOperator((size, size), approximate, dtype=float)

    def displacements(self, forces: np.ndarray, share_left: float, negligible: float = 0.0) -> np.ndarray:
        """Return the displacements under small forces (n, d).

        Parameters
        ----------
        forces : ndarray, shape (n, d)
        share_left : float
            Norm of the residual at the end, divided by that of the forces on free components.
        negligible : float
            Norm of forces that rounding alone may cause; a smaller residual is no aim.

        Raises
        ------
        NotConverged
            If the equations are not solved, as near limit loads and buckling, where the tangent is nearly singular.
        """
        right = (self._free * forces).ravel()
        settings = {"rtol": share_left, "atol": negligible, "maxiter": OUTER, "m": INNER}
        found, unsolved = scipy.sparse.linalg.gcrotmk(self._tangent, right, M=self._approximate, **settings)
        if unsolved or not np.isfinite(found).all():
            raise NotConverged(f"the linear equations of the tangent are not solved after {INNER * OUTER} products: it is nearly singular")
        return found.reshape(forces.shape)
