"""Preconditioners of quasi-Newton methods: the stiffness of the nearest bonds, and what a great bulk modulus adds to it."""

from __future__ import annotations

import numpy as np

from ..body import Body
from ..forces import InternalForce
from . import conjugate_gradients
from .nearest_bonds import Extension, NearestBondLaplacian, NearestBondStiffness, Preconditioner
from .rigid import RigidStiffness
from .schwarz import SchwarzLaplacian, SchwarzStiffness

NEARLY_SOLVED = 0.1
"""Share of a change of volume that may be left, over mu/K: the energy of what is left is then small against that of the shear."""

MOST_STEPS = 100
"""Most steps for the pressures in one solution; some tens are taken at K = 1000 mu."""

EXPONENT_ERROR = 0.5
"""Greatest relative error of the polynomial that preconditions the system of the pressures."""


def preconditioner_of(force: InternalForce, free: np.ndarray) -> Preconditioner:
    """Return the preconditioner that suits the tangent of a force in which components (n, d) are free."""
    body, moduli = force.body, force.stiffness_moduli
    if getattr(force, "rigid", None):
        return RigidStiffness(force, free)
    if force.nearly_incompressible:
        return IncompressibleStiffness(force, (SchwarzLaplacian if body.share.divided else NearestBondLaplacian)(body, moduli, free))
    return (SchwarzStiffness if body.share.divided else NearestBondStiffness)(body, moduli, free)


def extension_of(body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> Extension:
    """Return the map from displacements of held components to the body; in 3D a factor of all components would fill too much memory."""
    whole, divided = (NearestBondLaplacian, SchwarzLaplacian) if body.dimension == 3 else (NearestBondStiffness, SchwarzStiffness)
    return (divided if body.share.divided else whole)(body, shear_moduli, free)


class IncompressibleStiffness:
    """An approximation of the tangent of a nearly incompressible body, A + D^T C D, that is solved for displacements (theory (58), (59)).

    A is the Laplacian of the nearest bonds, D the derivative of the points' dilatation in the present state and C their stiffness against
    it.  D is not approximated: what is over of a change of volume costs K.  With pressures p for the unknowns the system has the size
    of the bulk compliance and not of K, (C^-1 + D A^-1 D^T) p = D A^-1 f, and a few steps of conjugate gradients solve it.

    Parameters
    ----------
    force : InternalForce
        Nearly incompressible.
    laplacian : Preconditioner
        What solves with A, or nearly: a fixed operator, symmetric and positive definite.

    Attributes
    ----------
    steps : int
        Taken for the pressures so far; each costs about as much as two thirds of a force evaluation and a solution with A.
    """

    def __init__(self, force: InternalForce, laplacian: Preconditioner) -> None:
        self._laplacian, self._share = laplacian, force.body.share
        self._dilatation = force.linearised_dilatation()
        self._volumes, self._modulus = force.body.volumes, force.law.shear_modulus
        self._compliance = force.law.shear_modulus / force.law.bulk_modulus
        self._inverse = self._dilatation.polynomial(_inverse_polynomial(self._compliance))
        self.steps = 0

    def update(self) -> None:
        """Take the state that the force was last evaluated in."""
        self._dilatation.take()

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Displacements under forces, shape (n, d)."""
        laplacian, dilatation = self._laplacian, self._dilatation
        compliance = 1 / dilatation.stiffness
        displacements = laplacian.solve(forces)
        moved = displacements

        def image_of(pressures: np.ndarray) -> np.ndarray:
            nonlocal moved
            moved = laplacian.solve(dilatation.forces(pressures))
            return compliance * pressures + dilatation.changes(moved)

        asked = self._precondition, image_of, self._dot, NEARLY_SOLVED * self._compliance, MOST_STEPS
        for share, _, _ in conjugate_gradients.steps(dilatation.changes(displacements), *asked):
            displacements -= share * moved
            self.steps += 1
        return displacements

    def _precondition(self, left: np.ndarray) -> np.ndarray:
        """V mu (mu/K + W^4)^-1 nearly: D has the smoothing W, and the bonds' means smooth about as much again."""
        return self._modulus * self._volumes * self._inverse(left)

    def _dot(self, first: np.ndarray, second: np.ndarray) -> float:
        """Inner product of values at the points, shape (n,)."""
        return self._share.dot(first[:, None], second[:, None])


def _inverse_polynomial(compliance: float) -> np.ndarray:
    """Chebyshev coefficients on [0, 1] of a polynomial near 1/(compliance + s^2), of the least degree that keeps to `EXPONENT_ERROR`."""
    s = (1 - np.cos(np.pi * (np.arange(400) + 0.5) / 400)) / 2
    for degree in range(2, 64):
        table = np.polynomial.chebyshev.chebvander(2 * s - 1, degree) * (compliance + s * s)[:, None]
        coefficients = np.linalg.lstsq(table, np.ones_like(s), rcond=None)[0]
        if np.abs(table @ coefficients - 1).max() <= EXPONENT_ERROR:
            break
    return coefficients
