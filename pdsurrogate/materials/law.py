"""Interface of a material law.

A law is a small frozen dataclass. It states its energy and the derivatives of its energy as
elementwise expressions, which NumPy evaluates for checks and numba compiles for runs. `expressions`
and `states` derive stresses and stiffness from them.

Energies and stresses are dimensionless, in units of the law's shear modulus.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from numbers import Real
from typing import Any, ClassVar, Self

import numpy as np

from ..html_tables import html_facts
from .memory import Memory


@dataclass(frozen=True)
class Law(ABC):
    """Base class of slightly compressible isotropic hyperelastic laws.

    Parameters
    ----------
    shear_modulus : float
        Shear modulus in the undeformed state, in any unit of stress; energies and stresses are
        computed in units of the shear modulus.
    bulk_modulus : float
        Bulk modulus in the undeformed state, in the same unit. The default, 100 shear moduli, is
        the paper's; rubber has about 1,000.
    memory : Memory
        Branches and softening beside the elastic energy; by default none. Moduli and energies are
        in the unit of `shear_modulus`.
    """

    name: ClassVar[str]
    reference: ClassVar[str]
    bounds: ClassVar[dict[str, tuple[float, float]]] = {}
    """Bounds within which an identification from test data searches the parameters other than
    the two moduli.
    """

    above: ClassVar[dict[str, float]] = {}
    """Values that parameters other than the two moduli must exceed."""

    costly: ClassVar[bool] = False
    """True if the law's response costs more than a learned bond force; the learned force then
    computes the thickness as well.
    """

    shear_modulus: float = 1.0
    bulk_modulus: float = 100.0
    memory: Memory = field(default=Memory(), kw_only=True, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.memory, Memory):
            raise TypeError(f"{self.name}: memory must be a Memory, not {self.memory!r}")
        for key, default in self.defaults().items():
            value = getattr(self, key)
            if isinstance(default, Real) or key in ("shear_modulus", "bulk_modulus"):
                check_number(value, f"{self.name}: {key}")
            if not np.all(np.isfinite(value)):
                raise ValueError(f"{self.name}: {key} must be finite, not {value}")
        for key, least in {"shear_modulus": 0, "bulk_modulus": 0, **self.above}.items():
            if getattr(self, key) <= least:
                bound = f"above {least:g}" if least else "positive"
                raise ValueError(f"{self.name}: {key} must be {bound}, not {getattr(self, key):g}")
        self.check()

    @classmethod
    def defaults(cls) -> dict[str, Any]:
        """Return the names of the parameters of the elastic energy, with their defaults.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> list(pds.materials.Gent.defaults())
        ['shear_modulus', 'bulk_modulus', 'chain_limit']
        """
        return {each.name: each.default for each in fields(cls) if each.name != "memory"}

    def check(self) -> None:  # noqa: B027  (most laws have no such parameter)
        """Check the parameters of this law other than the moduli; by default check nothing.

        Raises
        ------
        ValueError
            If a parameter is invalid; the message names it.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> try:
        ...     pds.materials.MooneyRivlin(second_share=1.5)  # the constructor calls the check
        ... except ValueError as error:
        ...     print(error)
        mooney-rivlin: second_share must be between 0 and 1, not 1.5
        """

    @property
    def parameters(self) -> np.ndarray:
        """Dimensionless parameters, float64, in the order in which the law's expressions read them;
        by default K/mu and the `shape`.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.materials.Gent(
        ...     shear_modulus=2.0, bulk_modulus=100.0, chain_limit=60.0
        ... ).parameters.tolist()
        [50.0, 60.0]
        """
        return np.array([self.bulk_modulus / self.shear_modulus, *self.shape.values()])

    @property
    def poisson_ratio(self) -> float:
        """Poisson's ratio for small strains.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.materials.NeoHookean(shear_modulus=3.0, bulk_modulus=5.0).poisson_ratio
        0.25
        """
        K, mu = self.bulk_modulus, self.shear_modulus
        return (3 * K - 2 * mu) / (6 * K + 2 * mu)

    @staticmethod
    def volumetric(J3, parameters):
        """Return the volumetric energy U and its derivatives; by default U = K/8 (J3 - 1/J3)^2, Eq.
        (6) of the paper.

        Parameters
        ----------
        J3 : float or ndarray
            Volume ratio det F in three dimensions.
        parameters : ndarray
            Values of `parameters`.

        Returns
        -------
        tuple
            U, U' and U'' in units of mu.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> law = pds.materials.NeoHookean()
        >>> law.volumetric(1.0, law.parameters)[0].item()
        0.0
        """
        K = parameters[0]
        inverse = 1 / J3
        square = inverse * inverse
        return (
            K / 8 * (J3 - inverse) * (J3 - inverse),
            K / 4 * (J3 - inverse * square),
            K / 4 * (1 + 3 * square * square),
        )

    def limit(self, squares: np.ndarray) -> str:
        """Explain, for an error message, why no state exists at some isochoric principal stretches.

        Parameters
        ----------
        squares : ndarray, shape (3,)
            Squares of the isochoric principal stretches.

        Returns
        -------
        str

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> pds.materials.NeoHookean().limit(np.array([100.0, 0.1, 0.1]))
        'it is beyond the limit of the law'
        """
        return "it is beyond the limit of the law"

    @property
    def shape(self) -> dict[str, float]:
        """Dimensionless parameters, by name, on which the bond force / mu in a given state depends;
        by default all but mu and K.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.materials.Gent(chain_limit=60.0).shape
        {'chain_limit': 60.0}
        """
        return {key: getattr(self, key) for key in list(self.defaults())[2:]}

    def scaled(self, factor: float) -> Self:
        """Return a copy of the law with all moduli multiplied by a factor, for example for another
        unit of stress.

        Parameters
        ----------
        factor : float

        Returns
        -------
        Law
            Law of the same class.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.materials.NeoHookean(shear_modulus=0.4, bulk_modulus=40.0).scaled(
        ...     1000.0
        ... )  # from MPa to kPa
        NeoHookean(shear_modulus=400.0, bulk_modulus=40000.0)
        """
        return replace(
            self,
            shear_modulus=self.shear_modulus * factor,
            bulk_modulus=self.bulk_modulus * factor,
            memory=self.memory.scaled(factor),
        )

    def describe(self) -> dict:
        """Return name and parameters of the law, in the form used by scenes and artifact cards.

        Returns
        -------
        dict

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.materials.NeoHookean(shear_modulus=0.4, bulk_modulus=40.0).describe()
        {'law': 'neo-hookean', 'shear_modulus': 0.4, 'bulk_modulus': 40.0}
        """
        return {
            "law": self.name,
            **{key: getattr(self, key) for key in self.defaults()},
            **self.memory.describe(),
        }

    def _repr_html_(self) -> str:
        return html_facts(f"Law {self.name}", {**self.describe(), "source": self.reference})


def check_number(value, what: str) -> None:
    """Raise TypeError if a value is not a real number (a bool is none)."""
    if not isinstance(value, Real) or isinstance(value, bool | np.bool_):
        raise TypeError(f"{what} must be a number, not {value!r}")


def checked_law(law) -> Law:
    """Return the law, or raise TypeError if the value is not a law."""
    if not isinstance(law, Law):
        raise TypeError(f"law must be a material law, such as NeoHookean(), not {law!r}")
    return law


class InvariantLaw(Law):
    """Base class of laws W(I1bar, I2bar) + U(J3) of the isochoric invariants.

    A subclass defines `isochoric`, and `volumetric` if U is not the default: static methods that
    are plain elementwise expressions.
    """

    @staticmethod
    @abstractmethod
    def isochoric(I1, I2, parameters):
        """Return W and its derivatives by the isochoric invariants.

        Parameters
        ----------
        I1, I2 : float or ndarray
            I1bar and I2bar.
        parameters : ndarray
            Values of `parameters`.

        Returns
        -------
        tuple
            W, W1, W2, W11, W12, W22 in units of mu; the digits stand for derivatives by I1bar and
            I2bar.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> law = pds.materials.NeoHookean()
        >>> law.isochoric(4.0, 3.5, law.parameters)
        (0.5, 0.5, 0.0, 0.0, 0.0, 0.0)
        """


class PrincipalStretchLaw(Law):
    """Base class of laws W + U(J3) whose isochoric part W is a sum of terms of one form in the
    isochoric principal stretches.

    Ogden's law is such a sum, and so is a quadrature over directions on the sphere. A subclass
    defines `terms`, and `coefficients` and `term` as static methods that are plain elementwise
    expressions.
    """

    @property
    def terms(self) -> np.ndarray:
        """Dimensionless constants of the terms, one row for each, which `coefficients` reads from
        `parameters`.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.materials.Ogden(moduli=(0.5, 0.1), exponents=(2.0, 4.0)).terms.round(3).tolist()
        [[0.714, 2.0], [0.143, 4.0]]
        """
        raise NotImplementedError(f"{type(self).__name__} defines no terms")

    @cached_property
    def parameters(self) -> np.ndarray:
        """Dimensionless parameters: K/mu, the number of terms, and the rows of `terms`.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.materials.Ogden(moduli=(1.0,), exponents=(2.0,)).parameters.tolist()
        [100.0, 1.0, 1.0, 2.0]
        """
        return np.concatenate(
            [[self.bulk_modulus / self.shear_modulus, len(self.terms)], *self.terms]
        )

    @staticmethod
    @abstractmethod
    def coefficients(parameters, k):
        """Return the constants of a term of W.

        Parameters
        ----------
        parameters : ndarray
            Values of `parameters`.
        k : int
            Number of the term, from 0.

        Returns
        -------
        tuple of float

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> law = pds.materials.Ogden(moduli=(1.0,), exponents=(2.0,))
        >>> [float(number) for number in law.coefficients(law.parameters, 0)]
        [1.0, 2.0]
        """

    def sums(self, stretches: tuple, parameters: np.ndarray) -> list:
        """Return W and its derivatives, summed over all terms.

        Parameters
        ----------
        stretches : tuple
            Values (x1, x2, x3, s1, s2, s3), see `term`.
        parameters : ndarray
            Values of `parameters`.

        Returns
        -------
        list
            W, g1, g2, g3 and h in units of mu, see `term`.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> law = pds.materials.Ogden(moduli=(1.0,), exponents=(2.0,))
        >>> [
        ...     round(float(part), 6)
        ...     for part in law.sums((0.0, 0.0, 0.0, 1.0, 1.0, 1.0), law.parameters)
        ... ]
        [0.0, 1.0, 1.0, 1.0, 1.333333]
        """
        terms = (
            self.term(*stretches, self.coefficients(parameters, k))
            for k in range(int(parameters[1]))
        )
        return [sum(parts) for parts in zip(*terms, strict=True)]

    @staticmethod
    @abstractmethod
    def term(x1, x2, x3, s1, s2, s3, coefficients):
        """Return one term of W and its derivatives.

        Parameters
        ----------
        x1, x2, x3 : float or ndarray
            Logarithms of the isochoric principal stretches.
        s1, s2, s3 : float or ndarray
            Squares of these stretches.
        coefficients : tuple of float
            Constants of the term, see `coefficients`.

        Returns
        -------
        tuple
            Energy; its derivatives g1, g2 and g3 by x1, x2 and x3; and the second derivative h
            along (-1, -1, 2)/3, the direction in which J3 changes the stretches at fixed F in the
            plane.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> law = pds.materials.Ogden(moduli=(1.0,), exponents=(2.0,))
        >>> energy, *_ = law.term(0.0, 0.0, 0.0, 1.0, 1.0, 1.0, law.coefficients(law.parameters, 0))
        >>> float(energy)
        0.0
        """
