"""Preconditioners of quasi-Newton methods, chosen by the force, and extensions of held displacements into the body."""

from collections.abc import Callable, Sequence

import numpy as np

from ..body import Body
from ..forces import InternalForce
from ..ranks import Share
from .held import Support
from .multigrid import conjugate_gradient_steps, conjugate_gradients
from .nearest_bonds import EXACTLY, Preconditioner, inverse_of_laplacian, inverse_of_springs, laplacian_of, springs_of
from .rigid import inverse_with_regions

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
    if regions := getattr(force, "rigid", ()):
        found = inverse_with_regions(body, moduli, free, regions)
    elif force.nearly_incompressible:
        found = incompressible_inverse(force, inverse_of_laplacian(body, moduli, free))
    else:
        found = inverse_of_springs(body, moduli, free)
    supports = getattr(force, "supports", ())
    return supported(found, supports, body.share) if supports else found


def extension_of(body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> Callable[..., np.ndarray]:
    """Return the map from displacements of held components to displacements of the whole body, through a network of springs.

    In 3D the network is the Laplacian, and conjugate gradients solve it: a factor of all components would fill too much memory.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.

    Returns
    -------
    callable
        ``response(held, planes, turns)`` returns the displacements, shape (n, d), where held components and planes of reflection are
        displaced: by `held` (n, d), 0 in free components, by `planes` (planes, d), and by `turns` (planes, d, d), rotations as in
        `pdsurrogate.body.Ghosts.shifts`, or None.
    """
    if body.dimension == 2:
        network, solve = springs_of(body, shear_moduli), inverse_of_springs(body, shear_moduli, free, EXACTLY).solve
    else:
        network, precondition = laplacian_of(body, shear_moduli), inverse_of_laplacian(body, shear_moduli, free).solve

        def solve(forces: np.ndarray) -> np.ndarray:
            settings = precondition, lambda moved: -network.forces(moved) * free, body.share.dot, EXTENDED, MOST_STEPS
            return conjugate_gradients(forces * free, *settings)

    def response(held: np.ndarray, planes: np.ndarray, turns: np.ndarray | None = None) -> np.ndarray:
        held = held.copy()
        found = solve(network.forces(held, body.ghosts.moved_by_planes(body.points, planes, turns))) + held
        body.share.fill(found)
        return found

    return response


def incompressible_inverse(force: InternalForce, laplacian: Preconditioner) -> Preconditioner:
    """Return the inverse of A + D^T C D, an approximation of the tangent of a nearly incompressible body (theory (58), (59)).

    A is the Laplacian of the nearest bonds, D the derivative of the points' dilatation in the present state and C the stiffness against
    it. D is exact, since an error in the change of volume is multiplied by K. In the pressures p as unknowns the system has the magnitude
    of the bulk compliance and not of K, (C^-1 + D A^-1 D^T) p = D A^-1 f, and a few steps of conjugate gradients solve it; each costs about
    two thirds of a force evaluation and a solution with A.

    Parameters
    ----------
    force : InternalForce
        Force with a linearised dilatation.
    laplacian : Preconditioner
        Exact or approximate inverse of A: a fixed operator, symmetric and positive definite.
    """
    share, dilatation = force.body.share, force.linearised_dilatation()
    compliance, unit = force.law.shear_modulus / force.law.bulk_modulus, force.law.shear_modulus * force.body.volumes
    inverse = dilatation.polynomial(_inverse_polynomial(compliance))

    def precondition(left: np.ndarray) -> np.ndarray:
        """Return about V mu (mu/K + W^4)^-1 of a rest: D has the smoothing W, and the bonds' means smooth about as much again."""
        return unit * inverse(left)

    def dot(one: np.ndarray, other: np.ndarray) -> float:
        return share.dot(one[:, None], other[:, None])

    def solve(forces: np.ndarray) -> np.ndarray:
        displacements = moved = laplacian.solve(forces)

        def image_of(pressures: np.ndarray) -> np.ndarray:
            nonlocal moved
            moved = laplacian.solve(dilatation.forces(pressures))
            return pressures / dilatation.stiffness + dilatation.changes(moved)

        settings = precondition, image_of, dot, NEARLY_SOLVED * compliance, MOST_STEPS
        for length, _, _ in conjugate_gradient_steps(dilatation.changes(displacements), *settings):
            displacements -= length * moved
        return displacements

    return Preconditioner(solve, dilatation.take)


def _inverse_polynomial(compliance: float) -> np.ndarray:
    """Return Chebyshev coefficients on [0, 1] of a polynomial near 1/(compliance + s^2), of the least degree within `EXPONENT_ERROR`."""
    s = (1 - np.cos(np.pi * (np.arange(400) + 0.5) / 400)) / 2
    for degree in range(2, 64):
        table = np.polynomial.chebyshev.chebvander(2 * s - 1, degree) * (compliance + s * s)[:, None]
        coefficients = np.linalg.lstsq(table, np.ones_like(s), rcond=None)[0]
        if np.abs(table @ coefficients - 1).max() <= EXPONENT_ERROR:
            break
    return coefficients


def supported(inner: Preconditioner, supports: Sequence[Support], share: Share) -> Preconditioner:
    """Return the preconditioner R M R^T of a body held at places between points, from M of the same body held at points.

    R u moves no such place.
    """
    fields, dot = [field for support in supports for field in support.fields()], share.dot

    def solve(forces: np.ndarray) -> np.ndarray:
        balanced = forces.copy()
        for weights, follows in fields:
            balanced -= weights * dot(follows, balanced)
        moved = inner.solve(balanced)
        for weights, follows in reversed(fields):
            moved -= follows * dot(weights, moved)
        return moved

    return Preconditioner(solve, inner.update)
