"""Tangents of small bodies (negative derivatives of forces by displacements) by central differences, and the hard cases that use them."""

from collections.abc import Callable
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

from ..body import Body
from ..forces import InternalForce
from .bodies import inner_points, middle_point
from .case import Outcome, Subject, case, cases_of, spring_stiffness

HELD = 0.1
"""Least stiffness required, divided by the stiffness if all bonds were springs that are as stiff as the rubber in the state.

At stretch 3 the stiffness of rubber differs from that of springs of the undeformed rubber by a factor of two or three in the plane, and of
up to eight in three dimensions, where the body is narrow on both sides; zero-energy modes have less than a fiftieth.
"""

CELLS = 12, 7
"""Points a side of the bodies whose tangents are computed, in the plane and in three dimensions. Chosen: some points in the middle have
full horizons, and so have their neighbors; the dense tangent of more points takes longer."""


class Tangent(NamedTuple):
    """Tangent -df/du (negative derivatives of the forces by the displacements) of a body in a given state.

    Attributes
    ----------
    matrix : ndarray, shape (d m, d m)
        Derivatives for the free points; component i of free point k has row and column d k + i.
    free : ndarray, shape (m,)
        Numbers (indices) of the free points in the body.
    force : InternalForce
        Force on the body, whose derivatives these are.
    """

    matrix: np.ndarray
    free: np.ndarray
    force: InternalForce

    @property
    def symmetric(self) -> np.ndarray:
        """Symmetric part of the matrix, which decides whether a displacement is resisted, shape (d m, d m)."""
        return (self.matrix + self.matrix.T) / 2

    @property
    def resistance(self) -> float:
        """Least stiffness against any displacement of the free points, divided by that of an undeformed continuum of the body's length L.

        The stiffness is the least eigenvalue of the symmetric part. A continuum held at its boundary has d pi^2 mu V/L^2, for a mode with
        half a wave along each of d axes, with the shear modulus mu and the volume V of a point.
        """
        body = self.force.body
        continuum = body.dimension * np.pi**2 * self.force.law.shear_modulus * body.volumes[0] / np.ptp(body.points[:, 0]) ** 2
        return float(np.linalg.eigvalsh(self.symmetric)[0] / continuum)

    @property
    def asymmetry(self) -> float:
        """Relative asymmetry |A - A^T|/|A| of the matrix A of the tangent, in the spectral norm."""
        return float(np.linalg.norm(self.matrix - self.matrix.T, 2) / np.linalg.norm(self.matrix, 2))


def tangent(force: InternalForce, positions: np.ndarray, held: bool = True) -> Tangent:
    """Return the tangent (negative derivatives by displacements) of a force at given positions, from `InternalForce.tangent`.

    If `held`, the outermost points of the body are fixed; otherwise all points are free.
    """
    body, d = force.body, positions.shape[1]
    free = np.flatnonzero(inner_points(body)) if held else np.arange(len(body))
    columns = (d * free[:, None] + np.arange(d)).ravel()
    products = force.tangent(positions) @ np.eye(positions.size)[:, columns]
    return Tangent(products[columns], free, force)


def tangent_at(subject: Subject, body: Body, F: np.ndarray) -> Tangent:
    """Return the tangent of a body under the force of the model under test, in a homogeneous state with deformation gradient F."""
    return tangent(subject.bind(body), body.points @ F.T)


def states(subject: Subject) -> dict[str, np.ndarray]:
    """Return by name the deformation gradients of the six homogeneous states in which tangents are computed, from rest to shear."""
    uniaxial = {f"uniaxial {stretch:g}": subject.uniaxial(stretch) for stretch in (2.0, 3.0, 0.7)}
    sheared, equibiaxial = np.array([[1.0, 0.8], [0.0, 1.0]]), np.diag([2.0, 2.0])
    others = {"rest": np.eye(2), "shear 0.8": sheared, "equibiaxial 2": equibiaxial}
    return uniaxial | {name: subject.gradient(F) for name, F in others.items()}


@cache
def tangents(subject: Subject) -> dict[str, Tangent]:
    """Return by name the tangents of a regular body in all `states`, computed only once for each force model."""
    return {name: tangent_at(subject, subject.body(*CELLS), F) for name, F in states(subject).items()}


def share_of_rest(subject: Subject, F: np.ndarray) -> float:
    """Return the least stiffness of the material against plane waves at a deformation gradient F, divided by mu; at most 1.

    The undeformed material has the stiffness mu. The least stiffness is the least eigenvalue of the symmetric part of the acoustic tensor
    Q, Q a = dP(F + h a n^T)/dh n at h = 0, with the first Piola-Kirchhoff stress P, over the directions n from a point of a square or cubic
    lattice to the adjacent points, along diagonals too. No discretization is stiffer than its material: Neo-Hookean rubber has at least mu
    in every state, softening rubber has less.
    """
    d, probe, least = len(F), 1e-5, 1.0
    for direction in list(product((-1.0, 0.0, 1.0), repeat=d))[: (3**d - 1) // 2]:
        n = np.array(direction) / np.linalg.norm(direction)
        change = [probe * np.outer(a, n) for a in np.eye(d)]
        Q = np.stack([(subject.exact_stress(F + h) - subject.exact_stress(F - h)) @ n for h in change], axis=1) / (2 * probe)
        least = min(least, np.linalg.eigvalsh((Q + Q.T) / 2)[0] / subject.law.shear_modulus)
    return float(least)


def _over_springs(subject: Subject, stiffness: Callable[[Tangent], float]) -> dict[str, float]:
    """Return, by the name of the state, a stiffness of each tangent divided by the stiffness if all bonds were springs.

    The function `stiffness` takes a tangent. The springs are as stiff as the rubber in that state, which may be less than the undeformed
    rubber (`share_of_rest`).
    """
    springs, applied = spring_stiffness(subject.body(*CELLS), subject.law.shear_modulus), states(subject)
    return {name: stiffness(formed) / (springs * share_of_rest(subject, applied[name])) for name, formed in tangents(subject).items()}


@case("displacement of a single point (Fig. 2)", "stiffness at least 0.1 of that of springs, in six states")
def single_point(subject: Subject) -> Outcome:
    """Test the stiffness against displacing one point in the middle of a body, the least over all directions and states.

    It is divided by the stiffness if the bonds of the point were springs as stiff as the rubber in that state; at least `HELD` is required.
    """

    def resisted(formed: Tangent) -> float:
        at = subject.dimension * int(np.flatnonzero(formed.free == middle_point(formed.force.body))[0])
        own = slice(at, at + subject.dimension)
        return np.linalg.eigvalsh(formed.symmetric[own, own])[0]

    return Outcome.above(_over_springs(subject, resisted), HELD, "zero-energy modes")


@case("checkerboard and hourglass modes", "stiffness at least 0.1 of that of springs, in six states")
def checkerboard(subject: Subject) -> Outcome:
    """Test the stiffness against displacements whose sign alternates from point to point along one or more axes, the least over all states.

    As in `single_point`, the stiffness is divided by the stiffness of springs against moving a single point, and compared with `HELD`:
    a mild requirement, since alternating displacements stretch the bonds even more.
    """

    def resisted(formed: Tangent) -> float:
        body, d = formed.force.body, subject.dimension
        cell = np.rint((body.points - body.points.min(axis=0)) / body.spacing).astype(int)[formed.free]
        signs = [(-1.0) ** (cell @ axes) for axes in list(product((0, 1), repeat=d))[1:]]
        modes = [np.outer(sign, direction).ravel() for sign in signs for direction in np.eye(d)]
        return min(mode @ formed.matrix @ mode / (mode @ mode) for mode in modes)

    return Outcome.above(_over_springs(subject, resisted), HELD, "zero-energy modes")


@case("least eigenvalue of the tangent", "at least 0.25 of that of a continuum, in six states")
def least_eigenvalue(subject: Subject) -> Outcome:
    """Test that in all states the least eigenvalue of the tangent's symmetric part is at least a quarter of a continuum's.

    Neo-Hookean rubber resists every wave of amplitude a and wave vector k with at least mu |a|^2 |k|^2 in every state (its energy is mu/2
    |F|^2 plus a convex function of J), so the lowest mode of an undeformed continuum is a lower bound. A horizon of three spacings lowers
    the stiffness of a mode on a body eleven spacings long by up to half, and so does a horizon of 1.75 spacings on one six spacings long;
    hence a quarter.
    """
    least = {name: formed.resistance for name, formed in tangents(subject).items()}
    return Outcome.above(least, 0.25, why_not_resisted(min(least.values()), 0.25))


def why_not_resisted(resisted: float, least: float) -> str:
    """Return the weakness of a model whose resistance is below `least`: "loses stability" if at most -`least`, else "zero-energy modes"."""
    return "zero-energy modes" if resisted > -least else "loses stability"


@case("displacements of a free body without resistance", "rigid motions only: 3 in the plane, 6 in solids")
def rigid_motions(subject: Subject) -> Outcome:
    """Test that an undeformed free body resists every displacement except the three (in a solid six) rigid motions.

    The test counts the singular values of the tangent below a millionth of `spring_stiffness`; rounding and difference errors are of that
    size. The next singular value is that of bending or twisting: hundredths of the stiffness, or thousandths with zero-energy modes.
    """
    body = subject.body(7, 4)
    formed = tangent(subject.bind(body), body.points.copy(), held=False)
    values = np.linalg.svd(formed.matrix, compute_uv=False)[::-1] / spring_stiffness(body, subject.law.shear_modulus)
    without, rigid = int((values < 1e-6).sum()), body.dimension * (body.dimension + 1) // 2
    figure = f"{without}, the next {values[min(without, len(values) - 1)]:.2g}"
    few = Outcome.above(without, rigid, "force at rest", figure)
    return Outcome.of_all(few, Outcome.below(without, rigid, "zero-energy modes", figure))


@case("symmetry of the tangent", "asymmetry at most 1e-6, in six states")
def symmetry(subject: Subject) -> Outcome:
    """Test that the force is the gradient of an energy: the asymmetry |A - A^T|/|A| of its tangent A must vanish in all states.

    Rounding and the errors of finite differences leave 1e-9; the limit is 1e-6.
    """
    return Outcome.below({name: formed.asymmetry for name, formed in tangents(subject).items()}, 1e-6, "not conservative")


CASES = cases_of(globals())
