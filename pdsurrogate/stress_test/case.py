"""Definitions for hard cases (tests that every force model takes): the case, the model under test (`Subject`), and the outcome."""

from __future__ import annotations

import operator
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from ..artifacts.store import law_of, load_card, load_surrogate
from ..body import Body
from ..body.ghosts import WITH_ROUNDING
from ..forces import FORCES, ForceModel, ForceSettings, InternalForce, InvalidState
from ..materials import PLANES, Law, NeoHookean, dimension_of, homogeneous, plane_stress
from ..results import Result
from ..run.simulate import SimulationFailed, SimulationInterrupted, simulate
from ..scenes import Scene
from ..solvers.equilibrium import Diverging, NotConverged, Unstable
from .bodies import regular

PASS, WEAK, STOPS, INAPPLICABLE = "pass", "weak", "stops", "-"
"""Verdicts on a force model in a hard case: passed; shows a named weakness; stops with a clear error where no solution exists; does not
apply to the model."""

WEAKNESSES = {
    "zero-energy modes": "points move almost freely against their neighbors: the force uses only deformation gradients (paper, Eq. (10))",
    "not conservative": "the force has no energy, so undamped motion can gain energy; add damping, or use an energy model",
    "moments": "pair forces across the bonds conserve linear momentum exactly, but angular momentum to second order in the spacing",
    "force at rest": "the fitted force does not vanish without deformation, so a body that is only rotated has forces",
    "weights do not add up": "the weights (paper, Eq. (13)) do not add up to the volume of the horizon: mean stresses have an error of 6 %",
    "no transverse stress": "the paper's features do not give T_mm; the scalar correction leaves errors of several percent at edges",
    "cut horizons": "corrections of incomplete horizons make thin bars too stiff in bending; use more points, or an energy model",
    "loses stability": "the body does not resist some displacement from a homogeneous state in which the material is stable",
    "stiff contrasts": "soft points near much stiffer ones become too stiff; use an energy model, or material = 'rigid'",
    "does not converge": "the solver found no equilibrium within the allowed number of force evaluations",
    "no mirror symmetry": "the features distinguish left from right: mirrored bodies have mirrored forces within the error of the fit",
    "last step of J3": "forces use the response before the last step of the iteration for J3: they depend on its start by up to 1e-8 K/mu",
    "settings ignored": "a setting that the model does not support is ignored without a message",
    "accuracy": "the error is larger than the limit",
}
"""Explanations of the weaknesses that a hard case can report, by their names."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a hard case for one force model.

    Attributes
    ----------
    verdict : str
        `PASS`, `WEAK`, `STOPS` (the model stops with a clear error where no solution exists) or `INAPPLICABLE`.
    figure : str
        Text of the result for a table, with its numbers.
    value, limit : float, optional
        Measured value, and the limit with which it was compared.
    weakness : str, optional
        One of `WEAKNESSES`.
    """

    verdict: str
    figure: str
    value: float | None = None
    limit: float | None = None
    weakness: str | None = None

    @classmethod
    def above(cls, value: float | Mapping, limit: float, weakness: str, figure="{:.2g}") -> Outcome:
        """Return the outcome "pass" if `value` is at least `limit`, otherwise a weakness; the least of a mapping of named values decides.

        `weakness` is its name in `WEAKNESSES`, and `figure` the format of the value in the table.
        """
        return cls.below(value, limit, weakness, figure, min, operator.ge)

    @classmethod
    def below(cls, value: float | Mapping, limit: float, weakness: str, figure="{:.1e}", worst=max, holds=operator.le) -> Outcome:
        """Return the outcome "pass" if `value` is at most `limit`, otherwise a weakness; the greatest of a mapping of named values decides.

        `weakness` is its name in `WEAKNESSES`, and `figure` the format of the value in the table. `above` uses this method with other
        functions: `worst`, which chooses the deciding name of a mapping, and `holds`, which compares the value with the limit.
        """
        if isinstance(value, Mapping):
            name = worst(value, key=value.get)
            value, figure = value[name], f"{figure} ({name})"
        passed = bool(holds(value, limit))
        return cls(PASS if passed else WEAK, figure.format(value), float(value), limit, None if passed else weakness)

    @staticmethod
    def of_all(*outcomes: Outcome) -> Outcome:
        """Return the first of the given outcomes whose verdict is a weakness, or the last outcome if none has that verdict."""
        return next((outcome for outcome in outcomes if outcome.verdict == WEAK), outcomes[-1])


class Ended(Exception):
    """Exception that ends a hard case early; its argument is the outcome of the case."""


def required(holds: bool, otherwise: str) -> None:
    """End a hard case as inapplicable (raise `Ended`) for the reason `otherwise`, unless the condition `holds`."""
    if not holds:
        raise Ended(Outcome(INAPPLICABLE, otherwise))


@dataclass(frozen=True)
class Case:
    """Hard case: a test that every force model takes; it is called with the model under test (`Subject`) and returns an `Outcome`.

    Attributes
    ----------
    title, asked : str
        Title of the case and text of its requirement, for a table.
    function : callable
        Function that takes a `Subject` and returns the outcome, or raises `Ended`.
    planes : tuple of str
        States that the case applies to: plane stress ("stress"), plane strain ("strain"), three-dimensional bodies ("space").
    failing : str, optional
        Weakness reported if the function raises InvalidState, NotConverged or Diverging; by default these errors go to the caller.
    drawn : bool
        Whether the function takes an optional second argument, an iterable of `Deformation` of a `notched` body, so that tests can pass
        random ones.
    """

    title: str
    asked: str
    function: Callable[..., Outcome]
    planes: tuple[str, ...] = tuple(PLANES)
    failing: str | None = None
    drawn: bool = False

    @property
    def key(self) -> str:
        """Name of the case in reports as JSON: the name of its function."""
        return self.function.__name__

    def __call__(self, subject: Subject, *given) -> Outcome:
        """Return the outcome of the case for a force model under test; `given` are further arguments of the function.

        The exception `Ended` becomes its outcome; InvalidState, NotConverged and Diverging become the weakness `failing`, if there is one.
        """
        try:
            return self.function(subject, *given)
        except Ended as ended:
            return ended.args[0]
        except (InvalidState, NotConverged, Diverging) as error:
            if self.failing is None:
                raise
            return Outcome(WEAK, str(error), weakness=self.failing)


def case(title: str, asked: str, **options) -> Callable[[Callable[..., Outcome]], Case]:
    """Return a decorator that turns a function of a `Subject` into a `Case` with a title and a requirement (`asked`).

    `options` are further attributes of the case.
    """
    return lambda function: Case(title, asked, function, **options)


def cases_of(module: Mapping[str, Any]) -> tuple[Case, ...]:
    """Return the hard cases that a module (given by its ``globals()``) defines, without imported ones, in the order of definition."""
    return tuple(found for found in module.values() if isinstance(found, Case) and found.function.__module__ == module["__name__"])


@dataclass(frozen=True, eq=False)
class Subject:
    """Force model under test, with methods that make the bodies, forces and runs that hard cases need.

    No two subjects are equal, so that a function with `functools.cache` computes a result that several cases share once for each subject.

    Parameters
    ----------
    reference : str
        Name of the force model, as on the command line.
    full : bool
        Whether to take all explicit time steps of the long cases, not a part of them.
    plane : {"stress", "strain", "space"}
        Plane stress, plane strain, or three dimensions.
    """

    reference: str
    full: bool = False
    plane: str = "stress"

    @property
    def dimension(self) -> int:
        """Dimension, 2 or 3, of the bodies on which the model is tested."""
        return dimension_of(self.plane)

    @cached_property
    def model(self) -> ForceModel:
        """Force model under test."""
        return load_surrogate(self.reference)

    @cached_property
    def law(self) -> Law:
        """Material in which the model is tested: the law on an artifact's card, or Neo-Hookean with K = 100 mu for built-in models."""
        return NeoHookean() if self.reference in FORCES else law_of(load_card(self.reference))

    def sized(self, plane: Any, space: Any) -> Any:
        """Return the first argument if the model is tested on bodies in the plane (stress or strain), the second if on solids."""
        return plane if self.dimension == 2 else space

    def body(self, plane: int | tuple[int, ...], space: int | tuple[int, ...], ratio: float | None = None, **options) -> Body:
        """Return a `regular` body with `plane` points a side if the model is tested in the plane, with `space` points a side if in solids.

        The horizon is `ratio` spacings, by default that of `bodies.HORIZONS`; `options` are further arguments of `Body`.
        """
        return regular(self.dimension, self.sized(plane, space), ratio, **options)

    def gradient(self, F: np.ndarray) -> np.ndarray:
        """Return an in-plane deformation gradient F, shape (2, 2), completed for solids by the stretch along x3 without stress there."""
        if self.dimension == 2:
            return F
        trace, J = plane_stress.invariants(F)
        return block_diag(F, plane_stress.volume_ratio(self.law, trace, J) / J)

    def uniaxial(self, stretch: float) -> np.ndarray:
        """Return the deformation gradient, shape (d, d), of the material in uniaxial tension or compression to `stretch` along x1."""
        return self.gradient(np.diag([stretch, homogeneous.uniaxial(self.law, stretch).lateral_stretch]))

    def exact_stress(self, F: np.ndarray) -> np.ndarray:
        """Return the first Piola-Kirchhoff stress of the material law at a deformation gradient F, both of shape (d, d)."""
        return PLANES[self.plane].first_piola_stress(self.law, F)

    def bind(self, body: Body, law: Law | None = None, model: ForceModel | None = None, **settings) -> InternalForce:
        """Return the force of the model under test, or of another `model`, on a body.

        `law` is the material, by default the subject's; `settings` are those of `ForceSettings`, with double precision as the default.
        """
        settings = ForceSettings(**{"precision": "float64", "plane": self.plane} | settings)
        return (model or self.model).bind(body, law or self.law, settings)

    def takes(self, setting: str) -> tuple:
        """Return the values of a force setting (such as "precision") that the model declares to honor; empty for an unused setting."""
        return self.model.honored(self.plane).get(setting, ())

    def describes(self, law: Law) -> bool:
        """Return whether the model can be used for a material law."""
        try:
            self.model.check_material(law)
        except ValueError:
            return False
        return True

    def scene(self, sides: tuple[float, ...], **described) -> Scene:
        """Return a scene with a rectangle or box of given sides, of the subject's material; `described` adds or replaces keys of it."""
        body = {"shape": self.sized("rectangle", "box"), "size": sides[: self.dimension]}
        return Scene(**{"name": "hard-case", "plane": self.plane, "material": self.law.describe(), "body": body} | described)

    def held_at(self, region: str) -> dict[str, Any]:
        """Return the entry of ``prescribed`` in a scene that holds a region in place: all displacements are zero."""
        return {"region": region, **{f"x{axis + 1}": 0.0 for axis in range(self.dimension)}}

    def run(self, scene: Scene, force: str | None = None, where="", weakness="does not converge", unstable=WEAK, **options) -> Result:
        """Simulate a scene with the model under test, or with the force model named `force`, and return the result.

        If the simulation fails, raise `Ended` with an outcome whose text begins with `where`. The verdict is WEAK, with the weakness
        `weakness`; the argument `unstable` gives another verdict for an unstable equilibrium. `options` are further arguments of
        `simulate`. Raise KeyboardInterrupt after Ctrl-C.
        """
        try:
            with warnings.catch_warnings(action="ignore"):  # warnings of a run are ignored, since the measured values show their cause
                return simulate(scene, force or self.model, **options)
        except SimulationInterrupted:
            raise KeyboardInterrupt from None
        except SimulationFailed as error:
            verdict = unstable if isinstance(error.__cause__, Unstable) else WEAK
            raise Ended(Outcome(verdict, f"{where}{error}", weakness=weakness if verdict == WEAK else None)) from error


def forces_at(force: InternalForce, positions: np.ndarray) -> np.ndarray:
    """Return the forces on the points of the force's body at given positions, both of shape (n, d)."""
    out = np.empty_like(positions)
    force(positions, out)
    return out


def off(found: np.ndarray, expected: np.ndarray) -> float:
    """Return the greatest difference between two arrays, divided by the greatest magnitude in `expected`."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def spring_stiffness(body: Body, shear_modulus: float) -> float:
    """Return the stiffness against moving one point with a full horizon if all its bonds were springs: 4 mu V^2 sum(w)/kappa.

    V is the volume of a point, w the weight function and kappa the factor of the shape tensor kappa I. In two and three dimensions, springs
    of stiffness 4 mu w V^2/kappa along and across every bond give the body the shear modulus mu.
    """
    d = body.dimension
    cells = np.arange(-8, 9) * body.spacing
    distance = np.linalg.norm(np.stack(np.meshgrid(*[cells] * d)), axis=0)
    reach = (distance > 0) & (distance <= body.horizon * WITH_ROUNDING)
    return float(4 * shear_modulus * body.spacing ** (2 * d) * body.weigh(distance[reach]).sum() / body.kappa)
