"""What a material law is here: its energy, stated once.

A law is a small frozen dataclass.  It states its energy and the derivatives of its energy as elementwise expressions; NumPy evaluates
them on arrays for checking, and the same expressions are compiled.  What follows from them under plane stress, in plane strain and in
space is the business of `plane_stress`, `plane_strain` and `solid`.

All of it is dimensionless: energies and stresses in units of the law's shear modulus.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from numbers import Real
from typing import ClassVar, Self

import numpy as np

from ..html_tables import html_facts


@dataclass(frozen=True)
class Law(ABC):
    """A slightly compressible isotropic hyperelastic law.

    Parameters
    ----------
    shear_modulus : float
        Shear modulus in the undeformed state, in any unit of stress; everything else is computed in units of it.
    bulk_modulus : float
        Bulk modulus in the undeformed state, same unit.
    """

    name: ClassVar[str]
    reference: ClassVar[str]
    bounds: ClassVar[dict[str, tuple[float, float]]] = {}
    """Bounds of the parameters beside the two moduli, within which they are identified from test data."""

    costly: ClassVar[bool] = False
    """Whether the response costs more than a learnt bond force, so that such a force does better to solve the thickness by itself."""

    shear_modulus: float = 1.0
    bulk_modulus: float = 100.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(field.default, Real) or field.name in ("shear_modulus", "bulk_modulus"):
                check_number(value, f"{self.name}: {field.name}")
            if not np.all(np.isfinite(value)):
                raise ValueError(f"{self.name}: {field.name} must be finite, not {value}")
        for key in ("shear_modulus", "bulk_modulus"):
            if getattr(self, key) <= 0:
                raise ValueError(f"{self.name}: {key} must be positive, not {getattr(self, key):g}")
        self.check()

    def check(self) -> None:  # noqa: B027  (most laws have nothing to add)
        """Raise ValueError where a parameter of the law's own makes no sense."""

    @property
    @abstractmethod
    def parameters(self) -> np.ndarray:
        """Dimensionless parameters, float64, in the order the law's expressions read them; the first is K/mu."""

    @staticmethod
    def volumetric(J3, parameters):
        """U and its derivatives (U, U', U'') at the volume ratio; K/8 (J3 - 1/J3)^2, the paper's Eq. (6), unless a law has another."""
        K = parameters[0]
        inverse = 1 / J3
        square = inverse * inverse
        return (
            K / 8 * (J3 - inverse) * (J3 - inverse),
            K / 4 * (J3 - inverse * square),
            K / 4 * (1 + 3 * square * square),
        )

    def limit(self, squares: np.ndarray) -> str:
        """Why there is no state at isochoric principal stretches with these three squares, for the error that says so."""
        return "beyond the law's limit"

    @property
    def shape(self) -> dict[str, float]:
        """Those dimensionless parameters that the bond force at given (a, b, J, C33) depends on; the bulk modulus is none."""
        return {}

    def scaled(self, factor: float) -> Self:
        """The same material with all its moduli times a factor, as in another unit of stress."""
        return replace(self, shear_modulus=self.shear_modulus * factor, bulk_modulus=self.bulk_modulus * factor)

    def describe(self) -> dict:
        """Name and parameters, as a scene or a card states them."""
        return {"law": self.name, **{field.name: getattr(self, field.name) for field in fields(self)}}

    def _repr_html_(self) -> str:
        return html_facts(f"Law {self.name}", {**self.describe(), "source": self.reference})


def check_number(value, what: str) -> None:
    """Raise TypeError if a value is no number."""
    if not isinstance(value, Real) or isinstance(value, bool | np.bool_):
        raise TypeError(f"{what} must be a number, not {value!r}")


def checked_law(law) -> Law:
    """A law as it is given.

    Raises
    ------
    TypeError
        If it is none, such as the name of one.
    """
    if not isinstance(law, Law):
        raise TypeError(f"law must be a material law, such as NeoHookean(), not {law!r}")
    return law


class InvariantLaw(Law):
    """A law W(I1bar, I2bar) + U(J3) of the isochoric invariants.

    A subclass gives `isochoric`, and `volumetric` where it has its own: static methods that are plain elementwise expressions.
    Everything else follows.
    """

    n_parameters: ClassVar[int] = 1
    """Length of `parameters`."""

    @staticmethod
    @abstractmethod
    def isochoric(I1, I2, parameters):
        """W and its derivatives (W, W1, W2, W11, W12, W22) at the isochoric invariants."""


class PrincipalStretchLaw(Law):
    """A law W + U(J3) whose isochoric part W is a sum of like terms in the isochoric principal stretches.

    The terms of Ogden's sum are such terms, and so are the directions of a quadrature on the sphere.  A subclass gives `coefficients`
    and `term`, static methods that are plain elementwise expressions, and `n_terms`.  Its `parameters` are K/mu, the number of terms,
    and whatever `coefficients` reads.
    """

    @property
    @abstractmethod
    def n_terms(self) -> int:
        """Number of terms."""

    @staticmethod
    @abstractmethod
    def coefficients(parameters, k):
        """Constants of term k, a tuple of numbers."""

    @staticmethod
    @abstractmethod
    def term(x1, x2, x3, s1, s2, s3, coefficients):
        """One term of W: its energy, g1, g2, g3, h.

        ``x`` are the logarithms of the isochoric principal stretches and ``s`` their squares; ``g`` are the derivatives by x1, x2 and
        x3, and ``h`` is the second derivative along (-1, -1, 2)/3, the way J3 changes them while the plane is held.
        """
