"""Preconditioners of quasi-Newton methods for each kind of force, and extension of the
displacements of held parts into the body.
"""

from collections.abc import Callable, Sequence

import numpy as np

from ..body import Body
from ..forces import InternalForce
from ..ranks import Share
from .held import Support
from .multigrid import conjugate_gradient_steps
from .nearest_bonds import (
    NearestBonds,
    Preconditioner,
    inverse_of,
    laplacian_of,
    network_of,
    spring_solver_of,
    springs_of,
    struts_of,
)
from .obstacles import ContactStiffness, Obstacle
from .rigid import inverse_with_regions

SHORT = 2.0
"""Displacement that is added to those of the preconditioner of a sheet for displacements that
alternate from point to point, in units of that which the nearest bonds permit. Bodies of points
with mean gradients resist such displacements some ten times less than their nearest bonds. Chosen:
with 0, 1, 2 and 4, ten derivatives in a sheet with a hole need 290, 227, 222 and 247 evaluations.

Quasi-Newton methods adapt to the tangent themselves and do without it.
"""

EXTENDED = 3e-4
SOLVED = 0.05
"""Permitted residuals, divided by the given forces in the energy norm, of conjugate gradients for
the displacements of springs: in first guesses (`EXTENDED`) and in preconditioners (`SOLVED`).

Preconditioners with an approximate inverse alone, without conjugate gradients, were tried: rings
and sheets with holes then need half as many to twice as many force evaluations more on two ranks.
"""

NEARLY_SOLVED = 0.1
"""Permitted relative residual of the system of the pressures, whose unknowns suppress changes of
volume, divided by mu/K: the energy of the remaining change of volume is then small compared with
that of the shear. With 1/3 each solution takes fewer steps of conjugate gradients, but there are
more solutions, and more steps in all (theory, section 17).
"""

MOST_STEPS = 100
"""Maximum number of conjugate-gradient steps in a solution for the pressures of
`incompressible_inverse`; some tens are usual.
"""

POLYNOMIAL_ERROR = 0.5
"""Greatest relative error of the polynomial that preconditions the system of the pressures in
`incompressible_inverse`. Chosen: the least degrees are then 4 at K = 100 mu and 8 at K = 1000 mu;
an error of 0.3 needs 4 and 9, one of 0.7 needs 3 and 6.
"""


SLENDER = 4.0
"""Extent of a body to the power of its dimension, divided by its volume, from which it counts as
slender.
"""

MOST_STRUTS = {2: 1e7, 3: 1e6}
WIDEST_CHECKED = {2: 160, 3: 40}
"""By dimension, greatest number of points times the mean number of points in a section across the
extent, at which the springs of `struts_of` a slender body are factorized, and the greatest such
mean at which this is done for the checks of stability in a run.

Chosen: a bar of 80 x 8 x 8 points has 6.6e5, for which the factorization takes 20 s and 200 MB. In
a sheet of 640 x 160 points it takes as long as 20 force evaluations, and in a bar of 48 x 6 x 6 no
longer; a check with the usual preconditioner takes some 20 more. Stocky bodies need as many steps
for their lowest modes with the usual preconditioner, which take a quarter of the time.
"""


LEFT = 0.05
"""Stiffness of the spring of a broken bond, divided by that of an intact one, so that no fragment
is without springs. Chosen: a tear of 2,300 points needs 6,726 evaluations with 0.05, 6,812 with 0.2
and 8,391 with 1.
"""


def is_slender(body: Body) -> bool:
    """Return whether a body is so slender that bending it takes small forces, compared with
    those of its bonds (`SLENDER`).
    """
    return bool(body.extent**body.dimension >= SLENDER * body.share.sum(body.volumes))


def has_struts(body: Body, widest: float = np.inf) -> bool:
    """Return whether a body on a single rank is slender, and small enough for a factorization of
    `struts_of` it.

    `widest` is the greatest mean number of points in a section.
    """
    section = len(body) * body.spacing / body.extent
    return (
        not body.share.divided
        and section <= widest
        and len(body) * section <= MOST_STRUTS[body.dimension]
        and is_slender(body)
    )


def preconditioner_of(
    force: InternalForce, free: np.ndarray, bending: bool = False
) -> Preconditioner:
    """Return the preconditioner that suits a force; `free` (n, d) is 1 where a component may move,
    0 where it is held.

    With `bending`, bodies with `has_struts` are approximated by `struts_of` them: the ratio of this
    stiffness to that of the tangent does not grow with their slenderness, but a solution takes
    longer.
    """
    body = force.body
    moduli = force.stiffness_moduli
    if bending and has_struts(body):
        network = struts_of(body, moduli)
    else:
        network = (
            laplacian_of(body, moduli) if force.nearly_incompressible else springs_of(body, moduli)
        )
    regions = force.rigid
    supports = force.supports
    obstacles = force.obstacles
    if regions or obstacles or force.nearly_incompressible:
        inner = (
            inverse_with_regions(network, free, regions)
            if regions
            else _by_springs(network, force, free)
        )
        found = _touching(force, obstacles, inner)
    elif body.share.divided:
        found = Preconditioner(spring_solver_of(network, free, SOLVED))
    else:
        found = _by_springs(network, force, free)
    if force.nearly_incompressible:
        found = incompressible_inverse(force, found)
    return supported(found, supports, body.share) if supports and not obstacles else found


def _by_springs(network: NearestBonds, force: InternalForce, free: np.ndarray) -> Preconditioner:
    """Return the preconditioner that inverts a network of springs; of a body on one rank, without
    obstacles, springs of broken bonds give way in `update` (`LEFT`).
    """
    inverse = inverse_of(network, free)
    if not len(force.broken) or force.body.share.divided or force.obstacles:
        return Preconditioner(inverse)
    known = np.zeros(len(network.first), dtype=bool)

    def solve(forces: np.ndarray) -> np.ndarray:
        return inverse(forces)

    def update() -> bool:
        nonlocal inverse, known
        if not force.broken.any():
            return False
        broken = force.broken[network.pairs]
        changed = not np.array_equal(broken, known)
        if changed:
            known = broken
            inverse = inverse_of(network.weakened(broken, LEFT), free)
        return changed

    return Preconditioner(solve, update)


def _touching(
    force: InternalForce, obstacles: Sequence[Obstacle], inner: Preconditioner
) -> Preconditioner:
    """Return a preconditioner that includes the stiffness of contact with obstacles; `inner`, a
    linear operator, if there are none.
    """
    if not obstacles:
        return inner
    if force.supports:  # obstacles press on a body that its supports hold
        inner = supported(inner, force.supports, force.body.share)
    contact = ContactStiffness(inner.solve, obstacles)

    def update() -> bool:
        inner.update()
        return contact.adapt(force.positions[: len(force.body)])

    return Preconditioner(contact.solve, update)


def extension_of(
    body: Body, shear_moduli: float | np.ndarray, free: np.ndarray
) -> Callable[..., np.ndarray]:
    """Return a function that extends displacements of held components to the whole body, as through
    a network of springs.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.

    Returns
    -------
    callable
        ``response(held, planes, turns)`` returns the displacements, shape (n, d), where held
        components are displaced by `held` (n, d), 0 in free components, and each reflection plane
        by u(X) = displacement + turn X, with rows of `planes` (planes, d) as displacements and of
        `turns` (planes, d, d), Q - I for a rotation Q, as turns; None for no turns.
    """
    network = network_of(body, shear_moduli)
    solve = spring_solver_of(network, free, EXTENDED)

    def response(
        held: np.ndarray, planes: np.ndarray, turns: np.ndarray | None = None
    ) -> np.ndarray:
        held = held.copy()
        found = solve(network.forces(held, body.ghosts.moved_by_planes(planes, turns))) + held
        body.share.fill(found)
        return found

    return response


def incompressible_inverse(force: InternalForce, laplacian: Preconditioner) -> Preconditioner:
    """Return the preconditioner of a nearly incompressible body: the inverse of A + D^T C D (theory
    (58), (59)).

    A is the Laplacian of the nearest bonds, D the derivative of the points' dilatation in the
    present state and C the stiffness against dilatation. D is exact, since an error in the change
    of volume is multiplied by the bulk modulus K. Under forces f, with the pressures p as unknowns,
    the system (C^-1 + D A^-1 D^T) p = D A^-1 f has the magnitude of the bulk compliance and not of
    K. A few steps of conjugate gradients solve it; each costs about two thirds of a force
    evaluation and a solution with A.

    Parameters
    ----------
    force : InternalForce
        Force with a linearized dilatation.
    laplacian : Preconditioner
        Exact or approximate inverse of A, symmetric and positive definite; A includes the stiffness
        of obstacles in contact.
    """
    share = force.body.share
    dilatation = force.linearized_dilatation()
    unit = force.law.shear_modulus * force.body.volumes
    for law, points in force.laws:
        unit[points] = law.shear_modulus * force.body.volumes[points]
    compliance = min(law.shear_modulus / law.bulk_modulus for law, _ in force.laws)
    inverse = dilatation.polynomial(_inverse_polynomial(compliance))

    def precondition(left: np.ndarray) -> np.ndarray:
        """Return about V mu (mu/K + W^4)^-1 times a residual, with the points' volumes V and the
        smoothing W of the dilatation.

        D A^-1 D^T acts about as W^4/(V mu): D contains W, and the means over bonds in D smooth
        about as much again.
        """
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
        for length, _ in conjugate_gradient_steps(dilatation.changes(displacements), *settings):
            displacements -= length * moved
        return displacements

    def update() -> None:
        dilatation.linearize()
        return laplacian.update()

    return Preconditioner(solve, update)


def _inverse_polynomial(compliance: float) -> np.ndarray:
    """Return Chebyshev coefficients of a polynomial in s on [0, 1] near 1/(`compliance` + s^2),
    with relative error `POLYNOMIAL_ERROR`.

    The degree is the least that achieves this error, at most 63; with 63 the error may be greater.
    """
    s = (1 - np.cos(np.pi * (np.arange(400) + 0.5) / 400)) / 2
    for degree in range(2, 64):
        table = (
            np.polynomial.chebyshev.chebvander(2 * s - 1, degree) * (compliance + s * s)[:, None]
        )
        coefficients = np.linalg.lstsq(table, np.ones_like(s), rcond=None)[0]
        if np.abs(table @ coefficients - 1).max() <= POLYNOMIAL_ERROR:
            break
    return coefficients


def stiffness_of_nearest_bonds(force: InternalForce) -> np.ndarray:
    """Return the stiffness (n, 1) of the nearest bonds of the points against displacements that
    alternate from point to point.
    """
    body = force.body
    return (4 * body.dimension * force.stiffness_moduli * body.volumes / body.spacing**2)[:, None]


def with_short_displacements(
    inner: Preconditioner, force: InternalForce, free: np.ndarray
) -> Preconditioner:
    """Return a preconditioner that adds short displacements to those of another one, `inner`, for
    sheets without constraints.

    They would change volumes in nearly incompressible bodies, deform rigid regions, and move the
    places of supports between points.
    """
    if force.nearly_incompressible or force.rigid or force.supports:
        return inner
    short = SHORT * free / stiffness_of_nearest_bonds(force)
    return Preconditioner(lambda forces: inner.solve(forces) + short * forces, inner.update)


def supported(inner: Preconditioner, supports: Sequence[Support], share: Share) -> Preconditioner:
    """Return the preconditioner R M R^T of a body that has supports at places between points; M is
    the one without these supports.

    The projection R removes from displacements the mean motion of these places.
    """
    fields = [field for support in supports for field in support.fields()]
    dot = share.dot

    def solve(forces: np.ndarray) -> np.ndarray:
        balanced = forces.copy()
        for weights, follows in fields:
            balanced -= weights * dot(follows, balanced)
        moved = inner.solve(balanced)
        for weights, follows in reversed(fields):
            moved -= follows * dot(weights, moved)
        return moved

    return Preconditioner(solve, inner.update)
