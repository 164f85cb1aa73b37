"""A polyconvex sum: powers of the principal stretches as in Ogden's law, and powers of the two isochoric invariants."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.elementary import exponential, select
from .ogden import Ogden

SECOND_AT_REST = 3 * 3**0.5
"""I2bar^1.5 of the undeformed state."""

GREATEST_POWER = 3
"""Greatest power of I1bar - 3 and of I2bar^1.5 - 3 sqrt 3."""


@dataclass(frozen=True)
class Polyconvex(Ogden):
    """Psi = sum_k mu_k/alpha_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3) + sum_k a_k x^k + sum_k b_k y^k + U(J3).

    Here l are the isochoric principal stretches, x = I1bar - 3 and y = I2bar^1.5 - 3 sqrt 3.  With a_k and b_k that are not negative,
    moduli that have the signs of their exponents, and exponents of size 1 or more, every term is polyconvex: the invariants among all
    deformations, the powers among those that keep the volume.

    Parameters
    ----------
    shear_modulus : float, optional
        mu = sum_k mu_k alpha_k / 2 + 2 a_1 + 3 sqrt 3 b_1; it follows from the terms, and if given must be the same.
    bulk_modulus : float, optional
        K, same unit; 100 mu by default.
    moduli, exponents : tuple of float
        mu_k, any unit of stress, and alpha_k, as many; none by default.
    first, second : tuple of float
        a_k and b_k of k = 1, 2, 3, same unit; fewer are followed by zeros.

    References
    ----------
    Hartmann, Neff, Int. J. Solids Struct. 40 (2003) 2767, for the powers of the invariants; Ogden, Proc. R. Soc. A 326 (1972) 565.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials import homogeneous
    >>> law = pds.materials.Polyconvex(first=(0.4, 0.01))
    >>> law.shear_modulus, round(homogeneous.uniaxial(law, 1.5).nominal_stress, 4)
    (0.8, 0.8637)
    """

    name: ClassVar[str] = "polyconvex"
    reference: ClassVar[str] = "Hartmann, Neff 2003"
    lists: ClassVar[tuple[str, ...]] = ("moduli", "exponents", "first", "second")

    moduli: tuple[float, ...] = ()
    exponents: tuple[float, ...] = ()
    first: tuple[float, ...] = (0.5, 0.0, 0.0)
    second: tuple[float, ...] = (0.0, 0.0, 0.0)

    def _check_terms(self) -> None:
        for key in ("first", "second"):
            values = getattr(self, key)
            if len(values) > GREATEST_POWER or not (np.isfinite(values).all() and min(values, default=0) >= 0):
                raise ValueError(f"{self.name}: {key} must be at most {GREATEST_POWER} finite numbers, none negative, not {list(values)}")
            object.__setattr__(self, key, (*values, *[0.0] * (GREATEST_POWER - len(values))))
        if self.moduli or self.exponents:
            super()._check_terms()
        if min(map(abs, self.exponents), default=1) < 1:
            raise ValueError(f"{self.name}: exponents must be of size 1 or more, for the sum to be polyconvex, not {list(self.exponents)}")
        if not self._stiffness() > 0:
            raise ValueError(f"{self.name}: nothing is stiff at rest: give moduli, or first or second a first number above 0")

    def _stiffness(self) -> float:
        return super()._stiffness() + 2 * self.first[0] + SECOND_AT_REST * self.second[0]

    @property
    def n_terms(self) -> int:
        return len(self.moduli) + 2

    @property
    def parameters(self) -> np.ndarray:
        # A term is c1 z + c2 z^2 + c3 z^3 of z = S^root - 3^root with S = l1^exponent + l2^exponent + l3^exponent.
        powers = [(exponent, 1.0, modulus / exponent, 0.0, 0.0) for modulus, exponent in zip(self.moduli, self.exponents, strict=True)]
        terms = np.array([*powers, (2.0, 1.0, *self.first), (-2.0, 1.5, *self.second)])
        terms[:, 2:] /= self.shear_modulus
        return np.array([self.bulk_modulus / self.shear_modulus, self.n_terms, *terms.ravel()])

    @property
    def shape(self) -> dict[str, float]:
        found = super().shape
        for key in ("first", "second"):
            found |= {f"{key}_{power}": value / self.shear_modulus for power, value in enumerate(getattr(self, key), start=1)}
        return found

    @staticmethod
    def coefficients(parameters, k):
        at = 2 + 5 * k
        return parameters[at], parameters[at + 1], parameters[at + 2], parameters[at + 3], parameters[at + 4]

    @staticmethod
    def term(x1, x2, x3, s1, s2, s3, coefficients):
        exponent, power, c1, c2, c3 = coefficients
        e1, e2, e3 = exponential(exponent * x1), exponential(exponent * x2), exponential(exponent * x3)
        S = e1 + e2 + e3
        root = np.sqrt(S)
        plain = power == 1.0
        z = select(plain, S - 3, S * root - 3 * np.sqrt(3.0))
        # Derivatives of z by S, and of the energy by z.
        z1, z2 = select(plain, 1.0, 1.5 * root), select(plain, 0.0, 0.75 / root)
        W1, W2 = c1 + z * (2 * c2 + 3 * c3 * z), 2 * c2 + 6 * c3 * z
        slope = exponent * W1 * z1
        along = exponent * (2 * e3 - e1 - e2) / 3
        h = exponent * slope * (e1 + e2 + 4 * e3) / 9 + (W2 * z1 * z1 + W1 * z2) * along * along
        return z * (c1 + z * (c2 + z * c3)), slope * e1, slope * e2, slope * e3, h
