"""Tangents of small sheets by central differences, and the cases that read them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body import Body
from ..forces import InternalForce
from ..materials import homogeneous
from .case import Case, Outcome, Subject, middle_point, spring_stiffness, square_sheet

CELLS = 12


@dataclass(frozen=True)
class InteriorTangent:
    """The tangent -df/du of a sheet in a homogeneous state, its outermost points held.

    Attributes
    ----------
    matrix : ndarray, shape (2 m, 2 m)
        For the free points, component by component.
    interior : ndarray, shape (m,)
        Their numbers.
    """

    matrix: np.ndarray
    interior: np.ndarray

    @property
    def symmetric(self) -> np.ndarray:
        """What decides whether a displacement is resisted."""
        return (self.matrix + self.matrix.T) / 2

    @property
    def least(self) -> float:
        """Least resistance to any displacement of the free points."""
        return float(np.linalg.eigvalsh(self.symmetric)[0])

    @property
    def asymmetry(self) -> float:
        """|A - A^T|/|A| in the spectral norm."""
        return float(np.linalg.norm(self.matrix - self.matrix.T, 2) / np.linalg.norm(self.matrix, 2))


def tangent(force: InternalForce, positions: np.ndarray) -> InteriorTangent:
    """Central differences over a hundred-thousandth of the spacing: errors of 1e-10 from both curvature and rounding."""
    body = force.body
    margin = np.minimum(body.points - body.points.min(axis=0), body.points.max(axis=0) - body.points).min(axis=1)
    interior = np.flatnonzero(margin > 0.5 * body.spacing)
    probe = 1e-5 * body.spacing
    forward, backward = np.empty_like(positions), np.empty_like(positions)
    matrix = np.empty((2 * len(interior), 2 * len(interior)))
    for number, point in enumerate(interior):
        for component in range(2):
            for sign, out in ((1, forward), (-1, backward)):
                moved = positions.copy()
                moved[point, component] += sign * probe
                force(moved, out)
            matrix[:, 2 * number + component] = ((backward - forward)[interior] / (2 * probe)).ravel()
    return InteriorTangent(matrix, interior)


def states(law) -> dict[str, np.ndarray]:
    """Deformation gradients at which the tangent is formed: theory, section 10, and a compression."""

    def uniaxial(stretch):
        return np.diag([stretch, homogeneous.uniaxial(law, stretch).lateral_stretch])

    return {
        "rest": np.eye(2),
        "uniaxial 2": uniaxial(2.0),
        "uniaxial 3": uniaxial(3.0),
        "uniaxial 0.7": uniaxial(0.7),
        "shear 0.8": np.array([[1.0, 0.8], [0.0, 1.0]]),
        "equibiaxial 2": np.diag([2.0, 2.0]),
    }


def tangents(subject: Subject) -> tuple[Body, dict[str, InteriorTangent]]:
    """Tangents in all states, formed once for a subject."""
    if "tangents" not in subject.measured:
        body = square_sheet(CELLS)
        found = {name: tangent(subject.bind(body), body.points @ F.T) for name, F in states(subject.law).items()}
        subject.measured["tangents"] = body, found
    return subject.measured["tangents"]


def least_of_a_continuum(body: Body, shear_modulus: float) -> float:
    """Least stiffness of a membrane between the held points: 2 pi^2 mu V/L^2, its lowest mode one half wave in each direction."""
    length = np.ptp(body.points[:, 0])
    return 2 * np.pi**2 * shear_modulus * body.volumes[0] / length**2


def worst(values: dict[str, float]) -> tuple[str, float]:
    """The least of several values, and where it was found."""
    place = min(values, key=values.get)
    return place, values[place]


def single_point(subject: Subject) -> Outcome:
    """Resistance to the displacement of one point in the middle, the least over all directions and states.

    In units of what springs along its bonds would hold it with.  A tenth is asked: the true share differs from 1 by the
    stretch of the state, a factor of two or three.
    """
    body, found = tangents(subject)
    middle = middle_point(body)
    stiffness = {}
    for name, formed in found.items():
        at = 2 * int(np.flatnonzero(formed.interior == middle)[0])
        stiffness[name] = np.linalg.eigvalsh(formed.symmetric[at : at + 2, at : at + 2])[0] / spring_stiffness(
            body, subject.law.shear_modulus
        )
    place, least = worst(stiffness)
    return Outcome.above(least, 0.1, "zero-energy modes", f"{{:.2g}} ({place})")


def checkerboard(subject: Subject) -> Outcome:
    """Resistance to displacements that change sign from point to point, along rows, columns and both, the least over all states.

    Held against the springs as for a single point, with the same tolerance: such modes stretch the bonds even more.
    """
    body, found = tangents(subject)
    cell = np.rint((body.points - body.points.min(axis=0)) / body.spacing).astype(int)
    stiffness = {}
    for name, formed in found.items():
        parity = cell[formed.interior]
        for pattern in (parity[:, 0], parity[:, 1], parity.sum(axis=1)):
            for direction in ((1, 0), (0, 1)):
                mode = np.outer((-1.0) ** pattern, direction).ravel()
                value = mode @ formed.matrix @ mode / (mode @ mode) / spring_stiffness(body, subject.law.shear_modulus)
                stiffness[name] = min(value, stiffness.get(name, np.inf))
    place, least = worst(stiffness)
    return Outcome.above(least, 0.1, "zero-energy modes", f"{{:.2g}} ({place})")


def least_eigenvalue(subject: Subject) -> Outcome:
    """Least eigenvalue of the symmetric part of the tangent, over that of a continuous membrane, the least over all states.

    Neo-Hookean rubber resists every wave with at least mu |a|^2 |k|^2 in every state (its energy is mu/2 |F|^2 and a convex
    function of J), so the membrane's lowest mode is a bound from below.  A horizon of three spacings takes up to half off a mode
    of eleven spacings; a quarter is asked.
    """
    body, found = tangents(subject)
    bound = least_of_a_continuum(body, subject.law.shear_modulus)
    place, least = worst({name: formed.least / bound for name, formed in found.items()})
    return Outcome.above(least, 0.25, "zero-energy modes" if least >= -0.25 else "loses stability", f"{{:.2g}} ({place})")


def symmetry(subject: Subject) -> Outcome:
    """Whether the force is the gradient of an energy: |A - A^T|/|A|, the greatest over all states.

    Rounding and differences leave 1e-9; 1e-6 is asked.
    """
    _, found = tangents(subject)
    place = max(found, key=lambda name: found[name].asymmetry)
    return Outcome.below(found[place].asymmetry, 1e-6, "not conservative", f"{{:.1e}} ({place})")


def resistance(subject: Subject, body: Body, F: np.ndarray) -> float:
    """Least eigenvalue of the tangent of any sheet in a homogeneous state, over that of a membrane."""
    return tangent(subject.bind(body), body.points @ F.T).least / least_of_a_continuum(body, subject.law.shear_modulus)


CASES = (
    Case("single point displaced (Fig. 2)", "held with at least 0.1 of its bonds' springs, in six states", single_point),
    Case("checkerboard and hourglass modes", "resisted with at least 0.1 of the bonds' springs, in six states", checkerboard),
    Case("least eigenvalue of the tangent", "at least 0.25 of a membrane's, in six states", least_eigenvalue),
    Case("symmetry of the tangent", "1e-6 at the most, in six states", symmetry),
)
