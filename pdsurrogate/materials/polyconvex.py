"""Law whose energy is a sum of terms of the dictionary with coefficients of which none is
negative.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .dictionary import GREATEST_POWER, Term, energy_of_row
from .stretch_laws import Ogden


@dataclass(frozen=True)
class Polyconvex(Ogden):
    """Polyconvex law: a sum of powers of stretches, powers and roots of the invariants, and the
    logarithm of the second, none with a negative coefficient.

    Psi = sum_k mu_k/alpha_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3) + sum_k a_k x^k + sum_k b_k
    y^k + d_1 (sqrt I1bar - sqrt 3) + d_2 (sqrt I2bar - sqrt 3) + e log(I2bar/3) + U(J3), with the
    isochoric principal stretches l, x = I1bar - 3 and y = I2bar^1.5 - 3 sqrt 3. Each term but the
    last is polyconvex: powers of the invariants for all deformations, powers of stretches and roots
    if only deformations of constant volume are considered. The term in log I2bar, of the law of
    Gent and Thomas, is not: with it, waves are stable in a bounded range of states only, which
    depends on the other terms.

    Parameters
    ----------
    shear_modulus : float, optional
        Initial shear modulus mu. It follows from the terms, as sum_k mu_k alpha_k / 2 + 2 a_1 + 3
        sqrt 3 b_1 + (d_1 + d_2) / sqrt 3 + 2 e / 3, and if given must equal this sum.
        Unit: stress.
    bulk_modulus : float, optional
        Initial bulk modulus K; 100 mu by default. Unit: stress.
    memory : Memory, optional
        Branches and softening beside the elastic energy; by default none.
    moduli : tuple of float
        Moduli mu_k, up to eight; each has the sign of its exponent. Unit: stress.
    exponents : tuple of float
        Exponents alpha_k, one for each modulus, of magnitude 1 or more. Unit: none.
    first : tuple of float
        Constants a_1 to a_4, not negative; fewer are followed by zeros. Unit: stress.
    second : tuple of float
        Constants b_1 to b_4, not negative; fewer are followed by zeros. Unit: stress.
    roots : tuple of float
        Constants d_1 and d_2, not negative; fewer are followed by zeros. Unit: stress.
    second_logarithm : tuple of float
        Constant e, not negative. Unit: stress.

    References
    ----------
    Hartmann, Neff, Int. J. Solids Struct. 40 (2003) 2767, for the powers of the invariants; Ogden,
    Proc. R. Soc. A 326 (1972) 565; Carroll, J. Elast. 103 (2011) 173, for the root of the second
    invariant; Gent, Thomas, J. Polym. Sci. 28 (1958) 625, for its logarithm.

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
    lists: ClassVar[tuple[str, ...]] = (
        "moduli",
        "exponents",
        "first",
        "second",
        "roots",
        "second_logarithm",
    )
    lengths: ClassVar[dict[str, int]] = {
        "first": GREATEST_POWER,
        "second": GREATEST_POWER,
        "roots": 2,
        "second_logarithm": 1,
    }
    """Numbers of constants in the lists that are filled up with zeros."""

    moduli: tuple[float, ...] = ()
    exponents: tuple[float, ...] = ()
    first: tuple[float, ...] = (0.5, 0.0, 0.0, 0.0)
    second: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    roots: tuple[float, ...] = (0.0, 0.0)
    second_logarithm: tuple[float, ...] = (0.0,)

    def _check_terms(self) -> None:
        for key, most in self.lengths.items():
            values = getattr(self, key)
            if len(values) > most or not (
                np.isfinite(values).all() and min(values, default=0) >= 0
            ):
                raise ValueError(
                    f"{self.name}: {key} must be at most {most} finite numbers, none negative, not"
                    f" {list(values)}"
                )
            object.__setattr__(self, key, (*values, *[0.0] * (most - len(values))))
        if self.moduli or self.exponents:
            super()._check_terms()
        if min(map(abs, self.exponents), default=1) < 1:
            raise ValueError(
                f"{self.name}: exponents must be at least 1 in size for a polyconvex law, not"
                f" {list(self.exponents)}"
            )
        if not self._stiffness() > 0:
            raise ValueError(
                f"{self.name}: the stiffness at rest is zero: give moduli, roots, or a"
                " first number above 0 in first or second"
            )

    @property
    def combination(self) -> dict[Term, float]:
        """Terms of the energy, and their coefficients in the unit of the moduli.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> {
        ...     str(term): float(size)
        ...     for term, size in pds.materials.Polyconvex(first=(0.4, 0.01)).combination.items()
        ... }
        {'I1bar - 3 to the power 1': 0.4, 'I1bar - 3 to the power 2': 0.01}
        """
        pairs = [
            (Term("stretches", exponent), modulus * exponent)
            for modulus, exponent in zip(self.moduli, self.exponents, strict=True)
        ]
        pairs += [
            (Term(kind, float(k)), size)
            for kind in self.lengths
            for k, size in enumerate(getattr(self, kind), start=1)
            if size
        ]
        found: dict[Term, float] = {}
        for term, size in pairs:
            found[term] = found.get(term, 0.0) + size
        return found

    def _stiffness(self) -> float:
        return sum(size * term.shear_modulus for term, size in self.combination.items())

    @property
    def terms(self) -> np.ndarray:
        # Terms that are functions of the same z, with the same a and r, are one row.
        rows: dict[tuple, np.ndarray] = {}
        for term, size in self.combination.items():
            rows[term.row[:2]] = rows.get(term.row[:2], 0) + size / self.shear_modulus * np.array(
                term.row[2:]
            )
        return np.array([[*constants, *sizes] for constants, sizes in rows.items()])

    @property
    def shape(self) -> dict[str, float]:
        found = super().shape
        for key in self.lists[2:]:
            found |= {
                f"{key}_{number}": value / self.shear_modulus
                for number, value in enumerate(getattr(self, key), start=1)
            }
        return found

    @staticmethod
    def coefficients(parameters, k):
        at = 2 + 6 * k
        return (
            parameters[at],
            parameters[at + 1],
            parameters[at + 2],
            parameters[at + 3],
            parameters[at + 4],
            parameters[at + 5],
        )

    term = staticmethod(energy_of_row)


def law_of(terms: Sequence[Term], coefficients: ArrayLike, bulk_modulus: float) -> Ogden:
    """Return the law whose isochoric energy is a sum of terms with coefficients: `Ogden` if all are
    powers of stretches, else `Polyconvex`.

    Parameters
    ----------
    terms : sequence of Term
    coefficients : array-like, shape (n_terms,)
        Not negative; terms with the coefficient 0 are left out. Unit: stress.
    bulk_modulus : float
        Unit: stress.

    Raises
    ------
    ValueError
        If a coefficient is negative, or the energy has no stiffness in the undeformed state.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials.dictionary import Term
    >>> from pdsurrogate.materials.polyconvex import law_of
    >>> law_of(
    ...     [Term("first", 1), Term("first", 2)], [0.4, 0.01], 400.0
    ... ) == pds.materials.Polyconvex(first=(0.4, 0.01), bulk_modulus=400.0)
    True
    """
    sizes = np.asarray(coefficients, dtype=float)
    if not (sizes >= 0).all():
        raise ValueError(
            f"coefficients of energy terms must not be negative, but the least is {sizes.min():g}"
        )
    lists: dict[str, list[float]] = {
        key: [0.0] * Polyconvex.lengths.get(key, 0) for key in Polyconvex.lists
    }
    for (kind, number), size in zip(terms, sizes.tolist(), strict=True):
        if not size:
            continue
        if kind in Polyconvex.lengths:
            lists[kind][int(number) - 1] += size
        else:
            lists["moduli"].append(size / number)
            lists["exponents"].append(float(number))
    if all(not any(values) for key, values in lists.items() if key not in Ogden.lists):
        return Ogden(
            bulk_modulus=bulk_modulus,
            moduli=tuple(lists["moduli"]),
            exponents=tuple(lists["exponents"]),
        )
    given: dict[str, Any] = {key: tuple(values) for key, values in lists.items()}
    return Polyconvex(bulk_modulus=bulk_modulus, **given)


def stiffness_of(terms: Sequence[Term], coefficients: ArrayLike) -> float:
    """Return the shear modulus of an energy in the undeformed state."""
    return float(np.asarray(coefficients, dtype=float) @ [term.shear_modulus for term in terms])
