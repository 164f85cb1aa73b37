"""Hard cases, the force models that they test, and their outcomes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..artifacts import law_of, load_card, load_surrogate
from ..body import Body
from ..forces import FORCES, ForceModel, ForceSettings, InternalForce
from ..materials import PLANES, Law, NeoHookean, dimension_of, plane_stress
from .bodies import regular

PASS, WEAK, STOPS, INAPPLICABLE = "pass", "weak", "stops", "-"
"""Verdicts: passed; a named weakness; a clear stop where no solution exists; not applicable to the model."""

WEAKNESSES = {
    "zero-energy modes": "the force does not feel modes that leave the deformation gradients alone (paper, Eq. (10)): "
    "points move against their neighbours for next to nothing",
    "not conservative": "averaged features make a force that is not the gradient of an energy (theory, section 10): the tangent is "
    "unsymmetric where horizons are incomplete, and undamped motion gains energy at edges; damp, or use an energy model",
    "moments": "pair forces that are not along their bonds cancel in their moments only over whole horizons in homogeneous deformation: "
    "linear momentum is conserved exactly, angular momentum to second order in the spacing",
    "force at rest": "a fit on features without a rest state built in leaves a force on a body that is merely turned",
    "weights do not add up": "the weights (13) of BA-NOSB do not add up to the volume of the horizon: exact bond stresses give a mean "
    "stress that is off, by about 6 per cent on a sheet of ten points",
    "no transverse stress": "the paper's features do not give T_mm, which the tensor correction of incomplete horizons needs; the "
    "scalar one (24) leaves errors of per cents at edges",
    "cut horizons": "corrections make a horizon that a surface cuts count as a whole one in homogeneous states: where all are cut, in bars "
    "of few points across, bending is resisted by more than it should be; take more points, or an energy model",
    "loses stability": "the tangent of a homogeneous state has a direction without resistance, where that of the material has none",
    "stiff contrasts": "points of a soft part within the horizon of one many times as stiff take part of its stiffness: a layer of four "
    'points is too stiff, or too soft by per cents; take an energy model, or `material = "rigid"` beside what is as good as rigid',
    "does not converge": "no equilibrium was found within the evaluations allowed",
    "no mirror symmetry": "features that know left from right: mirrored bodies have mirrored forces to the error of the fit",
    "last step of J3": "forces are formed with the response before the last step of the iteration for J3: they depend on its start by "
    "up to 1e-8 K/mu",
    "settings ignored": "a setting that the model cannot honour is taken without a word",
    "accuracy": "the error is larger than asked for",
}
"""Names of weaknesses, with explanations."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a case.

    Attributes
    ----------
    verdict : str
    figure : str
        Result in words, for a table.
    value, limit : float, optional
        Measured value, and the limit it was compared with.
    weakness : str, optional
        One of `WEAKNESSES`.
    """

    verdict: str
    figure: str
    value: float | None = None
    limit: float | None = None
    weakness: str | None = None

    @classmethod
    def below(cls, value: float, limit: float, weakness: str, figure: str = "{:.1e}") -> Outcome:
        """Return an outcome that is passed if the value is at most the limit."""
        passed = bool(value <= limit)
        return cls(PASS if passed else WEAK, figure.format(value), float(value), limit, None if passed else weakness)

    @classmethod
    def above(cls, value: float, limit: float, weakness: str, figure: str = "{:.2g}") -> Outcome:
        """Return an outcome that is passed if the value is at least the limit."""
        passed = bool(value >= limit)
        return cls(PASS if passed else WEAK, figure.format(value), float(value), limit, None if passed else weakness)


@dataclass(frozen=True)
class Case:
    """A hard case: its title, its requirement, and the function that tests it."""

    title: str
    asked: str
    function: Callable[[Subject], Outcome]
    planes: tuple[str, ...] = ("stress", "space")
    """States in which it is tested: plane stress ("stress"), plane strain ("strain"), three-dimensional bodies ("space")."""

    @property
    def key(self) -> str:
        """Name in JSON."""
        return self.function.__name__


@dataclass(frozen=True)
class Subject:
    """A force model under test.

    Parameters
    ----------
    reference : str
        Name as on the command line.
    quick : bool
        Whether to take fewer steps, for tests and a first look.
    plane : {"stress", "strain", "space"}
        Plane stress, plane strain, or three dimensions.
    """

    reference: str
    quick: bool = False
    plane: str = "stress"
    measured: dict = field(default_factory=dict)
    """Results that several cases share, measured once."""

    @property
    def dimension(self) -> int:
        """Dimension of the bodies on which it is tested."""
        return dimension_of(self.plane)

    @cached_property
    def model(self) -> ForceModel:
        """Force model under test."""
        return load_surrogate(self.reference)

    @cached_property
    def law(self) -> Law:
        """Material that the model describes: its own, or Neo-Hookean rubber with K = 100 mu."""
        if self.reference in FORCES:
            return NeoHookean()
        return law_of(load_card(self.reference))

    def body(self, cells: int | tuple[int, ...], ratio: float | None = None, **options) -> Body:
        """Return a square or cube with `cells` points a side; see `pdsurrogate.stress_test.bodies.regular`."""
        return regular(self.dimension, cells, ratio, **options)

    def gradient(self, F: np.ndarray) -> np.ndarray:
        """Return the gradient for an in-plane deformation F: F itself, or, in three dimensions, with the free stretch across the plane."""
        if self.dimension == 2:
            return F
        full = np.zeros((3, 3))
        trace, J = plane_stress.invariants(F)
        full[:2, :2], full[2, 2] = F, plane_stress.volume_ratio(self.law, trace, J) / J
        return full

    def exact_stress(self, F: np.ndarray) -> np.ndarray:
        """Return the law's first Piola-Kirchhoff stress, shape (d, d)."""
        return PLANES[self.plane].first_piola_stress(self.law, F)

    def bind(self, body: Body, law: Law | None = None, precision: str = "float64") -> InternalForce:
        """Return the model bound to a body."""
        return self.model.bind(body, law or self.law, ForceSettings(precision=precision, plane=self.plane))

    def describes(self, law: Law) -> bool:
        """Return whether the model can be used for a material."""
        try:
            self.model.check_material(law)
        except ValueError:
            return False
        return True


def spring_stiffness(body: Body, shear_modulus: float) -> float:
    """Return the stiffness against moving a point with a full horizon if its bonds were springs: 4 mu V^2 sum(w)/kappa.

    Springs of 4 mu w V^2/kappa along and across every bond have the shear modulus mu, in two and three dimensions.
    """
    d = body.dimension
    cells = np.arange(-8, 9) * body.spacing
    distance = np.linalg.norm(np.stack(np.meshgrid(*[cells] * d)), axis=0)
    reach = (distance > 0) & (distance <= body.horizon * (1 + 1e-9))
    return float(4 * shear_modulus * body.spacing ** (2 * d) * body.weigh(distance[reach]).sum() / body.kappa)


def middle_point(body: Body) -> int:
    """Return the point nearest to the middle of a body."""
    return int(np.linalg.norm(body.points - body.points.mean(axis=0), axis=1).argmin())
