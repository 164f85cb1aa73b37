"""Large deformations of small sheets, against exact homogeneous solutions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from ..forces import ForceSurrogate, InvalidState
from ..materials import Gent, Law, plane_stress
from ..run.simulate import SimulationFailed, simulate
from ..scenes import load_scene
from ..solvers import Unstable
from .case import INAPPLICABLE, PASS, SPACING, STOPS, WEAK, Case, Outcome, Subject, square_sheet
from .tangents import resistance

MOST_ERROR = 1e-3
"""Of stresses: a tenth of a per cent, a third of what the best experiments on rubber reproduce."""


TURNED_ABOUT = np.array([2.0, -1.0, 2.0]) / 3
"""Axis of rotations in space: that of no face of a block."""


def turn(degrees: float, dimension: int = 2) -> np.ndarray:
    """Rotation matrix; in space about `TURNED_ABOUT` (Rodrigues)."""
    angle = np.deg2rad(degrees)
    if dimension == 2:
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    cross = np.cross(np.eye(3), -TURNED_ABOUT)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def wavy(points: np.ndarray) -> np.ndarray:
    """An inhomogeneous deformation."""
    x1, x2, *rest = points.T
    across = [0.82 * x3 + 0.05 * x2 + 0.02 * np.sin(4 * x1) for x3 in rest]
    return np.stack([1.3 * x1 + 0.02 * np.sin(4 * x2), 0.95 * x2 + 0.1 * x1 + 0.02 * np.cos(5 * x1), *across], axis=1)


def force_densities(force, positions: np.ndarray) -> np.ndarray:
    """Forces per volume in units of shear modulus / spacing."""
    out = np.empty_like(positions)
    force(positions, out)
    return out / force.body.volumes[:, None] * force.body.spacing / force.law.shear_modulus


def _stretched(subject: Subject, stretches, law: Law, *changes) -> Outcome | float:
    """Greatest error of the nominal stress of a sheet in uniaxial tension or compression, solved for; or how it failed."""
    # In double: where a law stiffens, stresses of a hundred mu leave more than 1e-6 mu/dx of rounding in single precision.
    changes = [f"spacing={SPACING}", "precision=float64", "solver.most_evaluations=20000", *changes]
    scene = load_scene("uniaxial", changes, stretches=stretches, material=law.describe())
    try:
        result = simulate(scene, subject.model)
    except SimulationFailed as error:
        if isinstance(error.__cause__, Unstable):
            return Outcome(STOPS, str(error))
        return Outcome(WEAK, str(error), None, None, "does not converge")
    return max(abs(level["nominal_stress_error"]) for level in result.levels)


def why_inaccurate(subject: Subject) -> str:
    """Why a model is inaccurate where the analytic bond force is not."""
    known = {"ba-nosb": "weights do not add up", "nosb": "zero-energy modes"}
    if subject.reference in known:
        return known[subject.reference]
    blind = isinstance(subject.model, ForceSurrogate) and not subject.model.gives_transverse
    return "no transverse stress" if blind else "accuracy"


def _judged(subject: Subject, found: Outcome | float) -> Outcome:
    return found if isinstance(found, Outcome) else Outcome.below(found, MOST_ERROR, why_inaccurate(subject))


def stretch(subject: Subject) -> Outcome:
    """Uniaxial tension to 4, 5 and 8: error of the nominal stress.

    Beyond their domain surrogates hand over to the exact bond force, so theirs is no larger than within it.
    """
    return _judged(subject, _stretched(subject, [4.0, 5.0, 8.0], subject.law))


def compression(subject: Subject) -> Outcome:
    """Uniaxial compression of a square to 0.5: error of the nominal stress.

    The exact state is not stable below 0.53: a model with an energy finds that out, and stops there.
    """
    return _judged(subject, _stretched(subject, [0.7, 0.5], subject.law, "body.size=1.0,1.0"))


def _homogeneous(subject: Subject, F: np.ndarray) -> Outcome:
    """Mean stress of a homogeneous state against the exact one, and the resistance of that state to any disturbance.

    The resistance is held against a quarter of a membrane's, as in `tangents.least_eigenvalue`.
    """
    body = square_sheet(10)
    force = subject.bind(body)
    force(body.points @ F.T, np.empty_like(body.points))
    exact = plane_stress.first_piola_stress(subject.law, F)
    error = float(np.abs(force.mean_stress() - exact).max() / np.abs(exact).max())
    least = resistance(subject, body, F)
    figure = f"{error:.1e}, resistance {least:.2g}"
    if error > MOST_ERROR:
        return Outcome(WEAK, figure, error, MOST_ERROR, why_inaccurate(subject))
    if least < 0.25:
        return Outcome(WEAK, figure, least, 0.25, "zero-energy modes" if least > -0.25 else "loses stability")
    return Outcome(PASS, figure, error, MOST_ERROR)


def equibiaxial(subject: Subject) -> Outcome:
    """Equibiaxial stretch 3: mean stress, and stability."""
    return _homogeneous(subject, np.diag([3.0, 3.0]))


def simple_shear(subject: Subject) -> Outcome:
    """Simple shear 2: mean stress, and stability."""
    return _homogeneous(subject, np.array([[1.0, 2.0], [0.0, 1.0]]))


def compressibility(subject: Subject) -> Outcome:
    """Uniaxial stretch 2 at K/mu = 10, 100, 10^3, 10^4: the greatest error of the nominal stress, each against its own exact solution."""
    errors = {}
    for ratio in (1e1, 1e2, 1e3, 1e4):
        law = replace(subject.law, bulk_modulus=ratio * subject.law.shear_modulus)
        if not subject.describes(law):
            return Outcome(INAPPLICABLE, "fitted to one bulk modulus")
        found = _stretched(subject, [2.0], law)
        if isinstance(found, Outcome):
            return replace(found, figure=f"K/mu = {ratio:g}: {found.figure}")
        errors[ratio] = found
    ratio = max(errors, key=errors.get)
    return Outcome.below(errors[ratio], MOST_ERROR, why_inaccurate(subject), f"{{:.1e}} (K/mu = {ratio:g})")


def chain_limit(subject: Subject) -> Outcome:
    """Gent's law in uniaxial tension to 99 % and 102 % of its limit, and then at twice the stretch: stresses, and a stop.

    The limit is that of I1bar - 3, about the square of the stretch; a slightly compressible law goes a few per cent past it by
    growing in volume.  At twice the stretch there is no answer, and the stop must say where and why.
    """
    law = subject.law if isinstance(subject.law, Gent) else Gent(subject.law.shear_modulus, 100 * subject.law.shear_modulus, 30.0)
    if not subject.describes(law):
        return Outcome(INAPPLICABLE, "fitted to another law")

    def strain(stretch):
        return stretch**2 + 2 / stretch - 3

    def at(share):
        return float(brentq(lambda stretch: strain(stretch) - share * law.chain_limit, 1.0, 2 * np.sqrt(law.chain_limit + 3)))

    found = _stretched(subject, [at(0.99), at(1.02)], law)
    if isinstance(found, Outcome):
        return found
    body = square_sheet(6)
    stretch = 2 * at(0.99)
    try:
        subject.bind(body, law)(body.points * [stretch, stretch**-0.5], np.empty_like(body.points))
    except InvalidState as error:
        if "limit" in str(error) and "point" in str(error):
            return Outcome.below(found, MOST_ERROR, why_inaccurate(subject), f"{{:.1e}}, stops beyond ({error})")
        return Outcome(WEAK, f"beyond the limit: {error}", None, None, "accuracy")
    return Outcome(WEAK, "went on beyond the limit", None, None, "accuracy")


CASES = (
    Case("stretch to 4, 5 and 8", "stress within 0.1 % of the exact one", stretch),
    Case("compression to 0.5", "stress within 0.1 % of the exact one", compression),
    Case("equibiaxial stretch 3", "stress within 0.1 %, and stable", equibiaxial),
    Case("simple shear 2", "stress within 0.1 %, and stable", simple_shear),
    Case("Gent to 99 % of its limit, and beyond", "stress within 0.1 %; beyond, a stop that names the place", chain_limit),
    Case("K/mu = 10 to 10^4, stretch 2", "stress within 0.1 % of the exact one", compressibility),
)
