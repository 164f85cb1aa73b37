"""Laws of the isochoric principal stretches: Ogden's sum of powers, and a network of molecular
chains in all directions.
"""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, ClassVar, Self

import numpy as np
import scipy

from ..kernels.elementary_in_numpy import chain_energy, exponential, inverse_langevin
from .law import PrincipalStretchLaw, check_number

MOST_TERMS = 8
"""Greatest number of terms with an exponent in a law of sums of powers. Chosen: fits to tests use
three to eight terms, and a response costs as much as its terms.
"""

NOT_GIVEN: Any = None
"""Default of a modulus that the constructor of a law computes from other parameters."""


@dataclass(frozen=True)
class Ogden(PrincipalStretchLaw):
    """Ogden's law, Psi = sum_k mu_k/alpha_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3) + U(J3),
    with the isochoric principal stretches l.

    Parameters
    ----------
    shear_modulus : float, optional
        Initial shear modulus mu. It follows from the terms, as sum_k mu_k alpha_k / 2, and if given
        must equal this sum. Unit: stress.
    bulk_modulus : float, optional
        Initial bulk modulus K; 100 mu by default. Unit: stress.
    memory : Memory, optional
        Branches and softening beside the elastic energy; by default none.
    moduli : tuple of float
        Moduli mu_k, one to eight; each has the sign of its exponent, because large strains are
        unstable otherwise. Unit: stress.
    exponents : tuple of float
        Exponents alpha_k, one for each modulus; none is 0. Unit: none.

    References
    ----------
    Ogden, Proc. R. Soc. A 326 (1972) 565: moduli 0.63, 0.0012, -0.01 MPa and exponents 1.3, 5, -2
    for Treloar's rubber, which are the default in units of their shear modulus, 0.4225 MPa.

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
    """Names of the parameters that are tuples of numbers."""

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
        given = modulus if self.shear_modulus is None else self.shear_modulus
        check_number(given, f"{self.name}: shear_modulus")
        if not (np.isfinite(given) and abs(given - modulus) <= 1e-6 * modulus):
            raise ValueError(
                f"{self.name}: {' and '.join(self.lists)} imply shear_modulus = {modulus:g}, not"
                f" {given:g}; leave it out"
            )
        object.__setattr__(self, "shear_modulus", float(given))
        if self.bulk_modulus is None:
            object.__setattr__(self, "bulk_modulus", 100 * self.shear_modulus)
        super().__post_init__()

    def _check_terms(self) -> None:
        if len(self.moduli) != len(self.exponents) or not 1 <= len(self.moduli) <= MOST_TERMS:
            raise ValueError(
                f"{self.name}: moduli and exponents must be lists of equal length, from 1 to"
                f" {MOST_TERMS}"
            )
        if not np.isfinite([*self.moduli, *self.exponents]).all():
            raise ValueError(f"{self.name}: moduli and exponents must be finite")
        for number, (modulus, exponent) in enumerate(
            zip(self.moduli, self.exponents, strict=True), start=1
        ):
            if modulus * exponent <= 0:
                raise ValueError(
                    f"{self.name}: term {number} needs modulus * exponent > 0, not {modulus:g} *"
                    f" {exponent:g}"
                )

    def _stiffness(self) -> float:
        """Return the shear modulus of the undeformed material that follows from the moduli and
        exponents.
        """
        return (
            sum(
                modulus * exponent
                for modulus, exponent in zip(self.moduli, self.exponents, strict=True)
            )
            / 2
        )

    def scaled(self, factor: float) -> Self:
        scaled: dict[str, Any] = {
            key: tuple(value * factor for value in getattr(self, key))
            for key in self.lists
            if key != "exponents"
        }
        return replace(
            self,
            shear_modulus=NOT_GIVEN,
            bulk_modulus=self.bulk_modulus * factor,
            memory=self.memory.scaled(factor),
            **scaled,
        )

    @property
    def terms(self) -> np.ndarray:
        return np.column_stack([np.array(self.moduli) / self.shear_modulus, self.exponents])

    @property
    def shape(self) -> dict[str, float]:
        found: dict[str, float] = {}
        for number, (modulus, exponent) in enumerate(
            zip(self.moduli, self.exponents, strict=True), start=1
        ):
            found |= {
                f"modulus_{number}": modulus / self.shear_modulus,
                f"exponent_{number}": exponent,
            }
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
        return (
            (g1 + g2 + g3 - 3 * modulus) / exponent,
            g1,
            g2,
            g3,
            exponent * (g1 + g2 + 4 * g3) / 9,
        )


@cache
def directions() -> np.ndarray:
    """Return Lebedev's quadrature over directions r of chains in the principal frame: rows (weight,
    r1^2, r2^2, r3^2), weights sum to 1.

    The stretch of a chain depends on squares only, so directions that differ by signs are merged.
    The remaining directions are unchanged by permutations of the three axes, which the symmetry of
    an isotropic law requires.
    """
    # Lebedev's rule of this degree has 302 directions, 46 of which differ in the squares of their
    # components; a lower degree makes the law less exact toward its limit, where the longest chains
    # carry all, a higher one costs in proportion.
    points, weights = scipy.integrate.lebedev_rule(29)
    squares, place = np.unique(np.round(points.T**2, 14), axis=0, return_inverse=True)
    total = np.bincount(place.ravel(), weights)
    return np.column_stack([total / total.sum(), squares / squares.sum(axis=1, keepdims=True)])


@dataclass(frozen=True)
class FullNetwork(PrincipalStretchLaw):
    """Full-network law, Psi = n kT N <y beta + log(beta/sinh(beta))> + U(J3), averaged over all
    directions r of a chain.

    Here y = l(r)/sqrt(N) and beta = L^-1(y), with l(r)^2 = r . Cbar r the squared stretch in the
    direction of the chain. The law ends where the most stretched chain is straight, at a greatest
    isochoric stretch of sqrt(N): there and beyond every response is NaN.

    Parameters
    ----------
    shear_modulus : float
        Initial shear modulus mu; n kT follows from it. Unit: stress.
    bulk_modulus : float
        Initial bulk modulus K. Unit: stress.
    memory : Memory, optional
        Branches and softening beside the elastic energy; by default none.
    chain_links : float
        Number N of links of a chain. With the default the law ends at a stretch of sqrt(60) = 7.7,
        just beyond Treloar's greatest stretch, 7.6. Unit: none.

    References
    ----------
    Treloar, Riding, Proc. R. Soc. A 369 (1979) 261.  Wu, van der Giessen, J. Mech. Phys. Solids 41
    (1993) 427.  Quadrature: Lebedev, Laikov, Dokl. Math. 59 (1999) 477, as in
    scipy.integrate.lebedev_rule.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials import homogeneous
    >>> law = pds.materials.FullNetwork(chain_links=20.0)
    >>> state = homogeneous.uniaxial(law, 1.5)
    >>> print(round(state.nominal_stress, 4))
    1.0667
    """

    name: ClassVar[str] = "full-network"
    reference: ClassVar[str] = "Treloar, Riding 1979; Wu, van der Giessen 1993"
    costly: ClassVar[bool] = True
    bounds: ClassVar[dict] = {"chain_links": (1.01, 1e4)}
    above: ClassVar[dict] = {"chain_links": 1}

    chain_links: float = 60.0

    @property
    def terms(self) -> np.ndarray:
        return directions()

    @cached_property
    def parameters(self) -> np.ndarray:
        at_rest = self.chain_links**-0.5
        beta, stiffness = (float(value) for value in inverse_langevin(at_rest))
        # The modulus at rest is that of chains whose 3 r3^2 - 1 has the mean square 4/5, as it has
        # over all directions.
        density = 15 / (stiffness + 4 * beta / at_rest)
        # What all terms share stands before them.
        start = [
            self.bulk_modulus / self.shear_modulus,
            len(self.terms),
            self.chain_links,
            density,
            chain_energy(at_rest, beta),
        ]
        return np.concatenate([start, *self.terms])

    def limit(self, squares: np.ndarray) -> str:
        greatest = squares.max()
        return (
            f"the square of the greatest stretch, {greatest:.4g}, exceeds the limit of the law,"
            f" chain_links = {self.chain_links:g}"
        )

    @staticmethod
    def coefficients(parameters, k):
        at = 5 + 4 * k
        N = parameters[2]
        density = parameters[3] * N * parameters[at]
        return density, N, parameters[4], parameters[at + 1], parameters[at + 2], parameters[at + 3]

    @staticmethod
    def term(x1, x2, x3, s1, s2, s3, coefficients):
        density, N, at_rest, r1, r2, r3 = coefficients
        e1 = s1 * r1
        e2 = s2 * r2
        e3 = s3 * r3
        square = (e1 + e2 + e3) / N
        y = np.sqrt(square)
        beta, stiffness = inverse_langevin(y)
        # f(y) as a function of y^2: f' = beta/(2 y), f'' = (stiffness y - beta)/(4 y^3).
        first = density * beta / (2 * y)
        second = density * (stiffness * y - beta) / (4 * square * y)
        d = (2 / 3) * (2 * e3 - e1 - e2) / N
        dd = (4 / 9) * (4 * e3 + e1 + e2) / N
        energy = density * (chain_energy(y, beta) - at_rest)
        return (
            energy,
            2 / N * first * e1,
            2 / N * first * e2,
            2 / N * first * e3,
            second * d * d + first * dd,
        )
