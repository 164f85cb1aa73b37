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
"""Least resistance required, as a share of that of springs along all bonds, where rubber is as stiff as at rest (`share_of_rest`).
Rubber in tension of 3 differs from its springs at rest by a factor of two or three in the plane and by up to eight in three dimensions,
where both sides are narrow; zero-energy modes have less than a fiftieth.
"""

CELLS = 12, 7
"""Points a side in the plane and in three dimensions. Chosen: some points in the middle have full horizons, and so have their neighbours;
the dense tangent of more points takes longer."""


class Tangent(NamedTuple):
    """Tangent -df/du of a body in a homogeneous state.

    Attributes
    ----------
    matrix : ndarray, shape (d m, d m)
        Derivatives for the free points; component i of free point k has row and column d k + i.
    free : ndarray, shape (m,)
        Numbers of the free points.
    force : InternalForce
        Force of the body.
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
        """Least resistance to any displacement of the free points, over that of a continuum at rest between the held points.

        The former is the least eigenvalue of the symmetric part. A continuum has d pi^2 mu V/L^2, of a mode with half a wave in each
        direction.
        """
        body = self.force.body
        continuum = body.dimension * np.pi**2 * self.force.law.shear_modulus * body.volumes[0] / np.ptp(body.points[:, 0]) ** 2
        return float(np.linalg.eigvalsh(self.symmetric)[0] / continuum)

    @property
    def asymmetry(self) -> float:
        """Relative asymmetry |A - A^T|/|A| of the matrix A of the tangent, in the spectral norm."""
        return float(np.linalg.norm(self.matrix - self.matrix.T, 2) / np.linalg.norm(self.matrix, 2))


def tangent(force: InternalForce, positions: np.ndarray, held: bool = True) -> Tangent:
    """Return the tangent of a force at given positions (`InternalForce.tangent`).

    If `held`, the outermost points are fixed; otherwise all points are free.
    """
    body, d = force.body, positions.shape[1]
    free = np.flatnonzero(inner_points(body)) if held else np.arange(len(body))
    columns = (d * free[:, None] + np.arange(d)).ravel()
    products = force.tangent(positions) @ np.eye(positions.size)[:, columns]
    return Tangent(products[columns], free, force)


def tangent_at(subject: Subject, body: Body, F: np.ndarray) -> Tangent:
    """Return the tangent of a body, of the model under test, in a homogeneous state with deformation gradient F."""
    return tangent(subject.bind(body), body.points @ F.T)


def states(subject: Subject) -> dict[str, np.ndarray]:
    """Return, by name, the deformation gradients of the homogeneous states in which tangents are computed: rest, tension, shear etc."""
    uniaxial = {f"uniaxial {stretch:g}": subject.uniaxial(stretch) for stretch in (2.0, 3.0, 0.7)}
    sheared, equibiaxial = np.array([[1.0, 0.8], [0.0, 1.0]]), np.diag([2.0, 2.0])
    others = {"rest": np.eye(2), "shear 0.8": sheared, "equibiaxial 2": equibiaxial}
    return uniaxial | {name: subject.gradient(F) for name, F in others.items()}


@cache
def tangents(subject: Subject) -> dict[str, Tangent]:
    """Return the tangents of a regular body in all `states`, by name, computed only once for a force model."""
    return {name: tangent_at(subject, subject.body(*CELLS), F) for name, F in states(subject).items()}


def share_of_rest(subject: Subject, F: np.ndarray) -> float:
    """Return the least resistance of the material to any wave in a homogeneous state, over mu, at most 1.

    The resistance is the least eigenvalue of the acoustic tensor (Q a) = dP(F + h a n^T)/dh n at h = 0 over the directions n to the
    neighbours in a lattice. No discretisation resists more than its material: Neo-Hookean rubber has at least mu everywhere, softening
    rubber has less.
    """
    d, probe, least = len(F), 1e-5, 1.0
    for direction in list(product((-1.0, 0.0, 1.0), repeat=d))[: (3**d - 1) // 2]:
        n = np.array(direction) / np.linalg.norm(direction)
        change = [probe * np.outer(a, n) for a in np.eye(d)]
        Q = np.stack([(subject.exact_stress(F + h) - subject.exact_stress(F - h)) @ n for h in change], axis=1) / (2 * probe)
        least = min(least, np.linalg.eigvalsh((Q + Q.T) / 2)[0] / subject.law.shear_modulus)
    return float(least)


def _over_springs(subject: Subject, stiffness: Callable[[Tangent], float]) -> dict[str, float]:
    """Return, for every state by name, the ratio of a tangent's stiffness to the stiffness if all bonds were springs.

    The springs are as stiff as the rubber in that state (`share_of_rest`).
    """
    springs, applied = spring_stiffness(subject.body(*CELLS), subject.law.shear_modulus), states(subject)
    return {name: stiffness(formed) / (springs * share_of_rest(subject, applied[name])) for name, formed in tangents(subject).items()}


@case("single point displaced (Fig. 2)", "held with 0.1 of its bonds' springs, in six states")
def single_point(subject: Subject) -> Outcome:
    """Test the resistance to the displacement of one point in the middle, the least over all directions and states.

    The unit is the resistance if the bonds of the point were springs, as stiff as the rubber in that state; `HELD` is required.
    """

    def resisted(formed: Tangent) -> float:
        at = subject.dimension * int(np.flatnonzero(formed.free == middle_point(formed.force.body))[0])
        own = slice(at, at + subject.dimension)
        return np.linalg.eigvalsh(formed.symmetric[own, own])[0]

    return Outcome.above(_over_springs(subject, resisted), HELD, "zero-energy modes")


@case("checkerboard and hourglass modes", "resisted with 0.1 of the bonds' springs, in six states")
def checkerboard(subject: Subject) -> Outcome:
    """Test the resistance to displacements that alternate in sign from point to point along any of the axes, the least over all states.

    The unit and the limit are those of `single_point`, although such modes stretch the bonds even more.
    """

    def resisted(formed: Tangent) -> float:
        body, d = formed.force.body, subject.dimension
        cell = np.rint((body.points - body.points.min(axis=0)) / body.spacing).astype(int)[formed.free]
        signs = [(-1.0) ** (cell @ axes) for axes in list(product((0, 1), repeat=d))[1:]]
        modes = [np.outer(sign, direction).ravel() for sign in signs for direction in np.eye(d)]
        return min(mode @ formed.matrix @ mode / (mode @ mode) for mode in modes)

    return Outcome.above(_over_springs(subject, resisted), HELD, "zero-energy modes")


@case("least eigenvalue of the tangent", "at least 0.25 of a continuum's, in six states")
def least_eigenvalue(subject: Subject) -> Outcome:
    """Test that in all states the least eigenvalue of the tangent's symmetric part is at least a quarter of a continuum's.

    Neo-Hookean rubber resists every wave with at least mu |a|^2 |k|^2 in every state (its energy is mu/2 |F|^2 plus a convex function of
    J), so the continuum's lowest mode is a lower bound. A horizon of three spacings reduces a mode of eleven spacings by up to half, and a
    horizon of 1.75 spacings a mode of six; hence a quarter.
    """
    least = {name: formed.resistance for name, formed in tangents(subject).items()}
    return Outcome.above(least, 0.25, why_not_resisted(min(least.values()), 0.25))


def why_not_resisted(resisted: float, least: float) -> str:
    """Return the weakness of a model that resists less than `least`: "zero-energy modes", or "loses stability" if clearly negative."""
    return "zero-energy modes" if resisted > -least else "loses stability"


@case("displacements of a free body that no force answers", "the rigid ones alone: 3 in the plane, 6 in three dimensions")
def rigid_motions(subject: Subject) -> Outcome:
    """Test that a free body at rest resists every displacement except the three or six rigid motions.

    A motion without resistance has a singular value of the tangent below a millionth of the springs' stiffness, the size of rounding and
    difference errors. The next value of a body of seven or four points a side is a bending or twisting mode of hundredths, or of
    thousandths with zero-energy modes.
    """
    body = subject.body(7, 4)
    formed = tangent(subject.bind(body), body.points.copy(), held=False)
    values = np.linalg.svd(formed.matrix, compute_uv=False)[::-1] / spring_stiffness(body, subject.law.shear_modulus)
    without, rigid = int((values < 1e-6).sum()), body.dimension * (body.dimension + 1) // 2
    figure = f"{without}, the next {values[min(without, len(values) - 1)]:.2g}"
    few = Outcome.above(without, rigid, "force at rest", figure)
    return Outcome.of_all(few, Outcome.below(without, rigid, "zero-energy modes", figure))


@case("symmetry of the tangent", "1e-6 at the most, in six states")
def symmetry(subject: Subject) -> Outcome:
    """Test that the force is the gradient of an energy: the asymmetry |A - A^T|/|A| of the tangent A must vanish in all states.

    Rounding and differences leave 1e-9; the limit is 1e-6.
    """
    return Outcome.below({name: formed.asymmetry for name, formed in tangents(subject).items()}, 1e-6, "not conservative")


CASES = cases_of(globals())
