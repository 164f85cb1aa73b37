"""Ogden's law: a sum of powers of the principal stretches."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from ..kernels.elementary import exponential
from .law import PrincipalStretchLaw, check_number

MOST_TERMS = 8

NOT_GIVEN: Any = None
"""Default of a modulus that follows from others; after the construction it is a number."""


@dataclass(frozen=True)
class Ogden(PrincipalStretchLaw):
    """Ogden's law, Psi = sum_k mu_k/alpha_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3) + U(J3), with the isochoric principal stretches l.

    Parameters
    ----------
    shear_modulus : float, optional
        mu = sum_k mu_k alpha_k / 2; it follows from the terms, and if given must be the same.
    bulk_modulus : float, optional
        K, same unit; 100 mu by default.
    moduli : tuple of float
        mu_k, any unit of stress; each has the sign of its exponent, without which large strains are unstable.
    exponents : tuple of float
        alpha_k, as many; none is 0.

    References
    ----------
    Ogden, Proc. R. Soc. A 326 (1972) 565: moduli 0.63, 0.0012, -0.01 MPa and exponents 1.3, 5, -2 for Treloar's rubber, which are the
    default in units of their shear modulus, 0.4225 MPa.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials import homogeneous
    >>> law = pds.materials.Ogden(moduli=(0.63, 0.0012), exponents=(1.3, 5.0))
    >>> print(round(homogeneous.uniaxial(law, 1.5).nominal_stress, 4))
    0.3927
    """

    name: ClassVar[str] = "ogden"
    reference: ClassVar[str] = "Ogden 1972"
    costly: ClassVar[bool] = True
    lists: ClassVar[tuple[str, ...]] = ("moduli", "exponents")
    """Parameters that are several numbers."""

    shear_modulus: float = NOT_GIVEN
    bulk_modulus: float = NOT_GIVEN
    moduli: tuple[float, ...] = (0.63 / 0.4225, 0.0012 / 0.4225, -0.01 / 0.4225)
    exponents: tuple[float, ...] = (1.3, 5.0, -2.0)

    def __post_init__(self) -> None:
        for key in self.lists:
            values = np.atleast_1d(getattr(self, key))
            if values.ndim != 1 or values.dtype.kind not in "iuf":
                raise TypeError(f"{self.name}: {key} must be numbers, not {getattr(self, key)!r}")
            object.__setattr__(self, key, tuple(float(value) for value in values))
        self._check_terms()
        modulus = self._stiffness()
        given = self.shear_modulus
        if given is not None:
            check_number(given, f"{self.name}: shear_modulus")
        if given is not None and not (np.isfinite(given) and abs(given - modulus) <= 1e-6 * modulus):
            raise ValueError(
                f"{self.name}: {' and '.join(self.lists)} make the shear_modulus {modulus:g}, not {given:g}; leave it out, or scale them"
            )
        object.__setattr__(self, "shear_modulus", modulus if given is None else float(given))
        if self.bulk_modulus is None:
            object.__setattr__(self, "bulk_modulus", 100 * self.shear_modulus)
        super().__post_init__()

    def _check_terms(self) -> None:
        if len(self.moduli) != len(self.exponents) or not 1 <= len(self.moduli) <= MOST_TERMS:
            raise ValueError(f"{self.name}: moduli and exponents must be lists of equal length, from 1 to {MOST_TERMS}")
        if not np.isfinite([*self.moduli, *self.exponents]).all():
            raise ValueError(f"{self.name}: moduli and exponents must be finite")
        for number, product in enumerate(self._products()):
            if product <= 0:
                raise ValueError(
                    f"{self.name}: modulus times exponent of term {number + 1} must be positive, not {product:g}: "
                    "moduli have the signs of their exponents"
                )

    def _stiffness(self) -> float:
        """Shear modulus at rest."""
        return sum(self._products()) / 2

    def _products(self) -> list[float]:
        return [modulus * exponent for modulus, exponent in zip(self.moduli, self.exponents, strict=True)]

    def scaled(self, factor: float) -> Self:
        scaled = {key: tuple(value * factor for value in getattr(self, key)) for key in self.lists if key != "exponents"}
        return replace(self, shear_modulus=NOT_GIVEN, bulk_modulus=self.bulk_modulus * factor, **scaled)

    @property
    def n_terms(self) -> int:
        return len(self.moduli)

    @property
    def parameters(self) -> np.ndarray:
        return np.array([self.bulk_modulus / self.shear_modulus, self.n_terms, *self.shape.values()])

    @property
    def shape(self) -> dict[str, float]:
        found: dict[str, float] = {}
        for number, (modulus, exponent) in enumerate(zip(self.moduli, self.exponents, strict=True), start=1):
            found |= {f"modulus_{number}": modulus / self.shear_modulus, f"exponent_{number}": exponent}
        return found

    @staticmethod
    def coefficients(parameters, k):
        return parameters[2 + 2 * k], parameters[3 + 2 * k]

    @staticmethod
    def term(x1, x2, x3, s1, s2, s3, coefficients):
        modulus, exponent = coefficients
        g1 = modulus * exponential(exponent * x1)
        g2 = modulus * exponential(exponent * x2)
        g3 = modulus * exponential(exponent * x3)
        return (g1 + g2 + g3 - 3 * modulus) / exponent, g1, g2, g3, exponent * (g1 + g2 + 4 * g3) / 9
