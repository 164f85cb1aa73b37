"""Dictionary of energies: terms, and the law that is their sum with coefficients of which none is negative.

A sum of polyconvex functions with positive coefficients is polyconvex. Each term is so for this reason:

- powers of I1bar - 3 and of I2bar^1.5 - 3 sqrt 3: I1bar and I2bar^1.5 are polyconvex (Hartmann, Neff, Int. J. Solids Struct. 40 (2003)
  2767; I2bar itself is not), and the powers are convex and do not decrease from the least values of the differences, 0, on;
- the logarithm -log(1 - (I1bar - 3)/L), and its continuation: convex functions of I1bar that do not decrease, too;
- powers of the stretches, among deformations of constant volume: l1^a + l2^a + l3^a is a convex function of F for a >= 1, and of cof F,
  whose singular values are the inverses of the stretches, for a <= -1 (Ball, Arch. Rat. Mech. Anal. 63 (1977) 337);
- sqrt I1bar and sqrt I2bar, among deformations of constant volume: the norms of F and of cof F.

log(I2bar/3), as in the law of Gent and Thomas, is not polyconvex: along F + t a x n that keeps the volume it is concave at large t. A sum
with this term may still be convex along all such lines in the states of a body; `line_curvatures` serves to check it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..kernels.elementary_in_numpy import exponential, logarithm, select
from .stretch_laws import MOST_TERMS, Ogden

GREATEST_POWER = 4
"""Greatest power of I1bar - 3 and of I2bar^1.5 - 3 sqrt 3. Chosen: the third, as in Yeoh's law, and the fourth, as in Carroll's, describe
the rise of the stress at great stretches; higher ones would act at the greatest stretches of the data alone."""

LEAST_GAP = 0.1
"""Value of 1 - x/L down to which a term in log(1 - x/L) is a logarithm; from there on the logarithm continues as its Taylor polynomial of
second degree. Chosen: the stress is then ten times that of a Neo-Hookean term, which test data hardly exceed, and an energy from test
data must not end within a body."""


STATES, DIRECTIONS, LINE_STEP = 13, 6, 1e-3
"""Number of stretches of each axis and of angles in a quarter turn of `line_curvatures`, and the step of its differences: the rounding is
then some 1e-9, and the error of the difference a millionth."""


class Term(NamedTuple):
    """One energy of the dictionary, with the coefficient 1.

    Attributes
    ----------
    kind : str
        One of `KINDS`, which are also the names of the parameters of `Polyconvex`.
    number : float
        Exponent a of ``stretches``, (l1^a + l2^a + l3^a - 3)/a^2; power k of ``first``, (I1bar - 3)^k, and of ``second``,
        (I2bar^1.5 - 3 sqrt 3)^k; 1 or 2 of ``roots``, sqrt I1bar - sqrt 3 or sqrt I2bar - sqrt 3; limit L of ``logarithms``,
        -L/2 log(1 - (I1bar - 3)/L); 1 of ``second_logarithm``, log(I2bar/3).
    """

    kind: str
    number: float

    def __str__(self) -> str:
        return KINDS[self.kind].format(self.number)

    @property
    def row(self) -> tuple[float, ...]:
        """Constants (a, r, L, m, c1, ..., c4) of c1 z + ... + c4 z^4 - m/2 L log(1 - z/L), z = S^r - 3^r and S = l1^a + l2^a + l3^a.

        With r = 0, z = log(S/3).
        """
        kind, number = self
        if kind == "stretches":
            return (number, 1.0, 1.0, 0.0, number**-2.0, 0.0, 0.0, 0.0)
        if kind == "roots":
            return (2.0 if number == 1 else -2.0, 0.5, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        if kind == "logarithms":
            return (2.0, 1.0, number, 1.0, 0.0, 0.0, 0.0, 0.0)
        if kind == "second_logarithm":
            return (-2.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        return (*((2.0, 1.0) if kind == "first" else (-2.0, 1.5)), 1.0, 0.0, *(float(number == k) for k in range(1, GREATEST_POWER + 1)))

    @property
    def shear_modulus(self) -> float:
        """Shear modulus of the undeformed material."""
        a, r, _, m, c1, *_ = self.row
        return a**2 / 2 * (c1 + m / 2) * (r or 1.0) * 3 ** (r - 1)


KINDS = {
    "stretches": "exponent {:g}",
    "first": "I1bar - 3 to the power {:g}",
    "second": "I2bar^1.5 - 3 sqrt 3 to the power {:g}",
    "roots": "root of I{:g}bar",
    "logarithms": "logarithm of I1bar - 3 with limit {:.4g}",
    "second_logarithm": "logarithm of I2bar",
}
"""Kinds of terms, with their names in reports."""


@dataclass(frozen=True)
class Polyconvex(Ogden):
    """Polyconvex law: a sum of powers of stretches, powers and roots of the invariants, and logarithms, none with a negative coefficient.

    Psi = sum_k mu_k/alpha_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3) + sum_k a_k x^k + sum_k b_k y^k + d_1 (sqrt I1bar - sqrt 3)
    + d_2 (sqrt I2bar - sqrt 3) - sum_k m_k/2 L_k log(1 - x/L_k) + e log(I2bar/3) + U(J3), with the isochoric principal stretches l,
    x = I1bar - 3 and y = I2bar^1.5 - 3 sqrt 3. From x = 0.9 L_k on, a logarithm of x continues as its Taylor polynomial of second degree,
    so that the law has no limit. Each term but the last is polyconvex: powers of the invariants and logarithms of x for all deformations,
    powers of stretches and roots if only deformations of constant volume are considered. The term in log I2bar, of the law of Gent and
    Thomas, is not: with it, waves are stable in a bounded range of states only, which depends on the other terms.

    Parameters
    ----------
    shear_modulus : float, optional
        Initial shear modulus mu. It follows from the terms, as sum_k mu_k alpha_k / 2 + 2 a_1 + 3 sqrt 3 b_1 + (d_1 + d_2) / sqrt 3
        + sum_k m_k + 2 e / 3, and if given must equal this sum. Unit: stress.
    bulk_modulus : float, optional
        Initial bulk modulus K; 100 mu by default. Unit: stress.
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
    logarithms : tuple of float
        Moduli m_k, up to eight, not negative. Unit: stress.
    limits : tuple of float
        Positive constants L_k, one for each of `logarithms`. Unit: none.
    second_logarithm : tuple of float
        Constant e, not negative. Unit: stress.

    References
    ----------
    Hartmann, Neff, Int. J. Solids Struct. 40 (2003) 2767, for the powers of the invariants; Ogden, Proc. R. Soc. A 326 (1972) 565; Carroll,
    J. Elast. 103 (2011) 173, for the root of the second invariant; Gent, Rubber Chem. Technol. 69 (1996) 59, for the logarithm of x; Gent,
    Thomas, J. Polym. Sci. 28 (1958) 625, for that of the second invariant.

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
    lists: ClassVar[tuple[str, ...]] = ("moduli", "exponents", "first", "second", "roots", "logarithms", "limits", "second_logarithm")
    lengths: ClassVar[dict[str, int]] = {"first": GREATEST_POWER, "second": GREATEST_POWER, "roots": 2, "second_logarithm": 1}
    """Numbers of constants in the lists that are filled up with zeros."""

    moduli: tuple[float, ...] = ()
    exponents: tuple[float, ...] = ()
    first: tuple[float, ...] = (0.5, 0.0, 0.0, 0.0)
    second: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    roots: tuple[float, ...] = (0.0, 0.0)
    logarithms: tuple[float, ...] = ()
    limits: tuple[float, ...] = ()
    second_logarithm: tuple[float, ...] = (0.0,)

    def _check_terms(self) -> None:
        for key, most in {**self.lengths, "logarithms": MOST_TERMS}.items():
            values = getattr(self, key)
            if len(values) > most or not (np.isfinite(values).all() and min(values, default=0) >= 0):
                raise ValueError(f"{self.name}: {key} must be at most {most} finite numbers, none negative, not {list(values)}")
            object.__setattr__(self, key, (*values, *[0.0] * (self.lengths.get(key, 0) - len(values))))
        if len(self.limits) != len(self.logarithms) or not all(0 < limit < np.inf for limit in self.limits):
            raise ValueError(f"{self.name}: limits must be positive numbers, one for each of logarithms, not {list(self.limits)}")
        if self.moduli or self.exponents:
            super()._check_terms()
        if min(map(abs, self.exponents), default=1) < 1:
            raise ValueError(f"{self.name}: exponents must be at least 1 in size for a polyconvex law, not {list(self.exponents)}")
        if not self._stiffness() > 0:
            raise ValueError(
                f"{self.name}: the stiffness at rest is zero: give moduli, roots, logarithms, or a first number above 0 in first or second"
            )

    @property
    def combination(self) -> dict[Term, float]:
        """Terms of the energy, and their coefficients in the unit of the moduli.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> {str(term): float(size) for term, size in pds.materials.Polyconvex(first=(0.4, 0.01)).combination.items()}
        {'I1bar - 3 to the power 1': 0.4, 'I1bar - 3 to the power 2': 0.01}
        """
        pairs = [(Term("stretches", exponent), modulus * exponent) for modulus, exponent in zip(self.moduli, self.exponents, strict=True)]
        pairs += [(Term(kind, float(k)), size) for kind in self.lengths for k, size in enumerate(getattr(self, kind), start=1) if size]
        pairs += [(Term("logarithms", limit), modulus) for modulus, limit in zip(self.logarithms, self.limits, strict=True) if modulus]
        found: dict[Term, float] = {}
        for term, size in pairs:
            found[term] = found.get(term, 0.0) + size
        return found

    def _stiffness(self) -> float:
        return sum(size * term.shear_modulus for term, size in self.combination.items())

    @property
    def terms(self) -> np.ndarray:
        # Terms that are functions of the same z are one row; all with the same r and a, and a logarithm's L, are.
        rows: dict[tuple, np.ndarray] = {}
        for term, size in self.combination.items():
            rows[term.row[:3]] = rows.get(term.row[:3], 0) + size / self.shear_modulus * np.array(term.row[3:])
        return np.array([[*constants, *sizes] for constants, sizes in rows.items()])

    @property
    def shape(self) -> dict[str, float]:
        found = super().shape
        for key in self.lists[2:]:
            size = 1.0 if key == "limits" else self.shear_modulus
            found |= {f"{key}_{number}": value / size for number, value in enumerate(getattr(self, key), start=1)}
        return found

    @staticmethod
    def coefficients(parameters, k):
        at = 2 + 8 * k
        exponent, root, limit, modulus = parameters[at], parameters[at + 1], parameters[at + 2], parameters[at + 3]
        return exponent, root, limit, modulus, parameters[at + 4], parameters[at + 5], parameters[at + 6], parameters[at + 7]

    @staticmethod
    def term(x1, x2, x3, s1, s2, s3, coefficients):
        exponent, power, limit, modulus, c1, c2, c3, c4 = coefficients
        e1, e2, e3 = exponential(exponent * x1), exponential(exponent * x2), exponential(exponent * x3)
        S = e1 + e2 + e3
        root = np.sqrt(S)
        # z, its derivatives by S, and those of the energy by z.
        linear, rising, flat = power == 1.0, power == 1.5, power == 0.0
        z = select(linear, S - 3, select(rising, S * root - 3 * np.sqrt(3.0), root - np.sqrt(3.0)))
        z1 = select(linear, 1.0, select(rising, 1.5 * root, select(flat, 1 / S, 0.5 / root)))
        z2 = select(linear, 0.0, select(rising, 0.75 / root, select(flat, -1 / (S * S), -0.25 / (S * root))))
        gap = 1 - z / limit
        least = select(gap > LEAST_GAP, gap, LEAST_GAP)
        # One logarithm serves both kinds of terms: where z is log(S/3), there is no logarithm of the gap.
        log = logarithm(select(flat, S / 3, least))
        z = select(flat, log, z)
        # How far the state is beyond the end of the logarithm, from which a Taylor polynomial continues it.
        beyond = (least - gap) / least
        W = z * (c1 + z * (c2 + z * (c3 + z * c4))) + modulus / 2 * limit * (beyond + beyond * beyond / 2 - log)
        W1 = c1 + z * (2 * c2 + z * (3 * c3 + z * 4 * c4)) + modulus / 2 * (1 + beyond) / least
        W2 = 2 * c2 + z * (6 * c3 + z * 12 * c4) + modulus / (2 * limit * least * least)
        slope = exponent * W1 * z1
        along = exponent * (2 * e3 - e1 - e2) / 3
        h = exponent * slope * (e1 + e2 + 4 * e3) / 9 + (W2 * z1 * z1 + W1 * z2) * along * along
        return W, slope * e1, slope * e2, slope * e3, h


def law_of(terms: Sequence[Term], coefficients: ArrayLike, bulk_modulus: float) -> Ogden:
    """Return the law whose isochoric energy is a sum of terms with coefficients: `Ogden` if all are powers of stretches, else `Polyconvex`.

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
    >>> from pdsurrogate.materials.polyconvex import Term, law_of
    >>> law_of([Term("first", 1), Term("first", 2)], [0.4, 0.01], 400.0) == pds.materials.Polyconvex(first=(0.4, 0.01), bulk_modulus=400.0)
    True
    """
    sizes = np.asarray(coefficients, dtype=float)
    if not (sizes >= 0).all():
        raise ValueError(f"coefficients of energy terms must not be negative, but the least is {sizes.min():g}")
    lists: dict[str, list[float]] = {key: [0.0] * Polyconvex.lengths.get(key, 0) for key in Polyconvex.lists}
    for (kind, number), size in zip(terms, sizes.tolist(), strict=True):
        if not size:
            continue
        if kind in Polyconvex.lengths:
            lists[kind][int(number) - 1] += size
        else:
            moduli, numbers = ("moduli", "exponents") if kind == "stretches" else ("logarithms", "limits")
            lists[moduli].append(size / number if kind == "stretches" else size)
            lists[numbers].append(float(number))
    if all(not any(values) for key, values in lists.items() if key not in Ogden.lists):
        return Ogden(bulk_modulus=bulk_modulus, moduli=tuple(lists["moduli"]), exponents=tuple(lists["exponents"]))
    given: dict[str, Any] = {key: tuple(values) for key, values in lists.items()}
    return Polyconvex(bulk_modulus=bulk_modulus, **given)


def derivatives(terms: Sequence[Term], logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the energies of terms with the coefficient 1, and their derivatives by the logarithms of the isochoric principal stretches.

    Parameters
    ----------
    terms : sequence of Term
    logs : ndarray, shape (n, 3)
        Logarithms of the isochoric principal stretches; their sum is 0.

    Returns
    -------
    energies : ndarray, shape (n, n_terms)
    slopes : ndarray, shape (n, n_terms, 3)
        The deviators of these are the principal Kirchhoff stresses.

    Examples
    --------
    >>> import numpy as np
    >>> from pdsurrogate.materials.polyconvex import Term, derivatives
    >>> energies, slopes = derivatives([Term("first", 1.0)], np.log([[2.0, 1.0, 0.5]]))
    >>> energies.tolist(), slopes.round(6).tolist()
    ([[2.25]], [[[8.0, 2.0, 0.5]]])
    """
    x = np.asarray(logs, dtype=float).T[:, :, None]
    (x1, x2, x3), (s1, s2, s3) = x, np.exp(2 * x)
    energy, *slopes, _ = Polyconvex.term(x1, x2, x3, s1, s2, s3, np.array([term.row for term in terms]).T)
    return energy, np.stack(slopes, axis=-1)


def line_curvatures(terms: Sequence[Term], greatest: float = 3.0) -> np.ndarray:
    """Return second derivatives of terms with the coefficient 1 along lines F + t a x n that keep the volume, shape (n_lines, n_terms).

    An energy is strongly elliptic in a state, that is, shear waves of all directions and polarizations are stable, if these are positive.
    The states F have principal stretches from 1/`greatest` to `greatest`, and the lines the directions n of an octant.

    Examples
    --------
    >>> from pdsurrogate.materials.polyconvex import Term, line_curvatures
    >>> curvatures = line_curvatures([Term("first", 1.0), Term("second_logarithm", 1.0)])
    >>> curvatures[:, 0].min().round(3).item(), bool(curvatures[:, 1].min() < 0), bool((2 * curvatures[:, 0] + curvatures[:, 1]).min() > 0)
    (2.0, True, True)
    """
    logs = np.linspace(-1.0, 1.0, STATES) * np.log(greatest)
    first, second = (grid.ravel() for grid in np.meshgrid(logs, logs))
    kept = (first >= second) & (second >= -first - second) & (-first - second >= logs[0] - 1e-9)
    stretches = np.exp(np.stack([first, second, -first - second], axis=1)[kept])
    angles = (np.arange(DIRECTIONS) + 0.5) * np.pi / 2 / DIRECTIONS
    polar, around, turn = (grid.ravel() for grid in np.meshgrid(angles, angles, np.arange(2 * DIRECTIONS) * np.pi / 2 / DIRECTIONS))
    n = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=1)
    # a is perpendicular to the normal of the deformed surface, F^-T n.
    normal = n / stretches[:, None]
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    across = np.cross(normal, np.roll(normal, 1, axis=2) * [1.0, -1.0, 1.0])
    across /= np.linalg.norm(across, axis=2, keepdims=True)
    a = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * np.cross(normal, across)
    F, energies = stretches[:, None, :, None] * np.eye(3), []
    for step in (-LINE_STEP, 0.0, LINE_STEP):
        moved = (F + step * a[..., :, None] * n[:, None, :]).reshape(-1, 3, 3)
        energies.append(derivatives(terms, np.log(np.linalg.eigvalsh(np.swapaxes(moved, 1, 2) @ moved)) / 2)[0])
    return (energies[0] - 2 * energies[1] + energies[2]) / LINE_STEP**2
