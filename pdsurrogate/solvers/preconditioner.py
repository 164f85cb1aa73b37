"""Preconditioners of quasi-Newton methods, chosen by the force, and extensions of held displacements into the body."""

import numpy as np

from ..body import Body
from ..forces import InternalForce
from .held import Supports
from .multigrid import conjugate_gradient_steps, conjugate_gradients
from .nearest_bonds import EXACTLY, Preconditioner, inverse_of_laplacian, inverse_of_springs, laplacian_of, springs_of
from .rigid import RigidStiffness

EXTENDED = 3e-4
"""Permitted residual of a first guess, relative to the forces of held components, in the energy norm."""

NEARLY_SOLVED = 0.1
"""Permitted residual share of a change of volume, over mu/K: its energy is then small compared with that of the shear."""

MOST_STEPS = 100
"""Maximum number of conjugate-gradient steps for the pressures or a first guess; some tens are usual."""

EXPONENT_ERROR = 0.5
"""Greatest relative error of the polynomial that preconditions the system of the pressures."""


def preconditioner_of(force: InternalForce, free: np.ndarray) -> Preconditioner:
    """Return the preconditioner for the tangent of a force, with the given free components (n, d)."""
    body, moduli = force.body, force.stiffness_moduli
    found: Preconditioner
    if regions := getattr(force, "rigid", ()):
        found = RigidStiffness(body, moduli, free, regions)
    elif force.nearly_incompressible:
        found = IncompressibleStiffness(force, inverse_of_laplacian(body, moduli, free))
    else:
        found = inverse_of_springs(body, moduli, free)
    supports = getattr(force, "supports", None)
    return found if supports is None else SupportedPreconditioner(found, supports)


class Extension:
    """Map from displacements of held components to displacements of the whole body, through a network of springs.

    In 3D the network is the Laplacian, and conjugate gradients solve it: a factor of all components would fill too much memory.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> None:
        self._body, self._free = body, free
        self._network = (springs_of if body.dimension == 2 else laplacian_of)(body, shear_moduli)
        if body.dimension == 2:
            self._inverse = inverse_of_springs(body, shear_moduli, free, EXACTLY)
        else:
            self._inverse = inverse_of_laplacian(body, shear_moduli, free)

    def response(self, held: np.ndarray, planes: np.ndarray, turns: np.ndarray | None = None) -> np.ndarray:
        """Return the displacements of the body, shape (n, d), where held components and planes of reflection are displaced.

        Parameters
        ----------
        held : ndarray, shape (n, d)
            Displacements in held components, 0 in free ones.
        planes : ndarray, shape (planes, d)
            Displacements of the planes.
        turns : ndarray, shape (planes, d, d), optional
            Rotations of planes, see `pdsurrogate.body.Ghosts.shifts`.
        """
        held, of_images = held.copy(), self._body.ghosts.moved_by_planes(self._body.points, planes, turns)
        forces = self._network.forces(held, of_images)
        if self._body.dimension == 2:
            found = self._inverse.solve(forces) + held
        else:
            image_of, dot = (lambda moved: -self._network.forces(moved) * self._free), self._body.share.dot
            found = conjugate_gradients(forces * self._free, self._inverse.solve, image_of, dot, EXTENDED, MOST_STEPS) + held
        self._body.share.fill(found)
        return found


class IncompressibleStiffness(Preconditioner):
    """Approximation A + D^T C D of the tangent of a nearly incompressible body, whose systems are solved (theory (58), (59)).

    A is the Laplacian of the nearest bonds, D the derivative of the points' dilatation in the present state and C the stiffness against
    it. D is exact, since an error in the change of volume is multiplied by K. In the pressures p as unknowns the system has the magnitude
    of the bulk compliance and not of K, (C^-1 + D A^-1 D^T) p = D A^-1 f, and a few steps of conjugate gradients solve it.

    Parameters
    ----------
    force : InternalForce
        Force with a linearised dilatation.
    laplacian : Preconditioner
        Exact or approximate inverse of A: a fixed operator, symmetric and positive definite.

    Attributes
    ----------
    steps : int
        Conjugate-gradient steps for the pressures so far; each costs about two thirds of a force evaluation and a solution with A.
    """

    def __init__(self, force: InternalForce, laplacian: Preconditioner) -> None:
        self._laplacian, self._share = laplacian, force.body.share
        self._dilatation = force.linearised_dilatation()
        self._volumes, self._modulus = force.body.volumes, force.law.shear_modulus
        self._compliance = force.law.shear_modulus / force.law.bulk_modulus
        self._inverse = self._dilatation.polynomial(_inverse_polynomial(self._compliance))
        self.steps = 0

    def update(self) -> None:
        """Update the operator to the state in which the force was last evaluated."""
        self._dilatation.take()

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements under forces, shape (n, d)."""
        laplacian, dilatation = self._laplacian, self._dilatation
        compliance = 1 / dilatation.stiffness
        displacements = laplacian.solve(forces)
        moved = displacements

        def image_of(pressures: np.ndarray) -> np.ndarray:
            nonlocal moved
            moved = laplacian.solve(dilatation.forces(pressures))
            return compliance * pressures + dilatation.changes(moved)

        def dot(one: np.ndarray, other: np.ndarray) -> float:
            return self._share.dot(one[:, None], other[:, None])

        asked = self._precondition, image_of, dot, NEARLY_SOLVED * self._compliance, MOST_STEPS
        for share, _, _ in conjugate_gradient_steps(dilatation.changes(displacements), *asked):
            displacements -= share * moved
            self.steps += 1
        return displacements

    def _precondition(self, left: np.ndarray) -> np.ndarray:
        """Return about V mu (mu/K + W^4)^-1 of a rest: D has the smoothing W, and the bonds' means smooth about as much again."""
        return self._modulus * self._volumes * self._inverse(left)


def _inverse_polynomial(compliance: float) -> np.ndarray:
    """Return Chebyshev coefficients on [0, 1] of a polynomial near 1/(compliance + s^2), of the least degree within `EXPONENT_ERROR`."""
    s = (1 - np.cos(np.pi * (np.arange(400) + 0.5) / 400)) / 2
    for degree in range(2, 64):
        table = np.polynomial.chebyshev.chebvander(2 * s - 1, degree) * (compliance + s * s)[:, None]
        coefficients = np.linalg.lstsq(table, np.ones_like(s), rcond=None)[0]
        if np.abs(table @ coefficients - 1).max() <= EXPONENT_ERROR:
            break
    return coefficients


class SupportedPreconditioner(Preconditioner):
    """Preconditioner R M R^T of a body held at places between points, from M of the same body held at points; R u moves no such place.

    Parameters
    ----------
    inner : Preconditioner
    supports : Supports
    """

    def __init__(self, inner: Preconditioner, supports: Supports) -> None:
        self._inner, self._fields, self._share, self.update = inner, supports.fields, supports.share, inner.update

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements under forces, shape (n, d), which move no supported place."""
        balanced = forces.copy()
        for weights, follows in self._fields:
            balanced -= weights * self._share.dot(follows, balanced)
        moved = self._inner.solve(balanced)
        for weights, follows in reversed(self._fields):
            moved -= follows * self._share.dot(weights, moved)
        return moved
