"""Energy without a law for calibrations: a sum of polyconvex terms, whose non-negative coefficients are the unknowns."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from scipy.optimize import nnls

from ..materials import Law, Polyconvex
from ..materials.stretch_laws import GREATEST_POWER, SECOND_AT_REST

EXPONENTS = (-4.0, -2.0, -1.0, 1.0, 2.0, 3.0, 5.0, 8.0)
"""Exponents of the stretches among the terms, as many as a law takes: about evenly spaced in the logarithm of their size."""

FLOOR = 3e-5
"""Least coefficient in the search, relative to the greatest: differences over a millionth of the greatest modulus keep its sign."""

MOST_STEPS = 12
"""Most Gauss-Newton steps, each with a simulation of all derivatives."""

HALVINGS = 6
"""Most halvings of a step that does not reduce the residuals."""


@dataclass(frozen=True)
class EnergyUnknowns:
    """Terms of an energy, whose coefficients are the unknowns of a calibration.

    Attributes
    ----------
    terms : tuple of (str, float)
        ``("exponent", a)`` for (l1^a + l2^a + l3^a - 3)/a^2, ``("first", k)`` for (I1bar - 3)^k, ``("second", k)`` for
        (I2bar^1.5 - 3 sqrt 3)^k.
    bulk_ratio, bulk_modulus : float or None
        Of these, one is given.
    """

    terms: tuple[tuple[str, float], ...]
    bulk_ratio: float | None = None
    bulk_modulus: float | None = None

    @classmethod
    def all_terms(cls, **bulk: float) -> "EnergyUnknowns":
        """Return all candidate terms."""
        powers = tuple((kind, float(k)) for kind in ("first", "second") for k in range(1, GREATEST_POWER + 1) if (kind, k) != ("first", 1))
        return cls((*(("exponent", a) for a in EXPONENTS), *powers), **bulk)

    def of(self, kept: np.ndarray) -> "EnergyUnknowns":
        """Return the unknowns of some of the terms, given by a mask."""
        return EnergyUnknowns(tuple(t for t, one in zip(self.terms, kept, strict=True) if one), self.bulk_ratio, self.bulk_modulus)

    def unknowns(self) -> list[str]:
        """Return the names of the coefficients."""
        return [f"{kind} {number:g}" for kind, number in self.terms]

    def law_of(self, values: np.ndarray) -> Law:
        """Return the law with given coefficients, all positive."""
        lists: dict = {"moduli": [], "exponents": [], "first": [0.0] * GREATEST_POWER, "second": [0.0] * GREATEST_POWER}
        modulus = 0.0
        for (kind, number), size in zip(self.terms, map(float, values), strict=True):
            if kind == "exponent":
                lists["moduli"].append(size / number)
                lists["exponents"].append(number)
                modulus += size / 2
            else:
                lists[kind][int(number) - 1] = size
                modulus += size * {("first", 1.0): 2.0, ("second", 1.0): SECOND_AT_REST}.get((kind, number), 0.0)
        bulk = self.bulk_modulus or (self.bulk_ratio or 1.0) * modulus
        return Polyconvex(bulk_modulus=bulk, **{key: tuple(each) for key, each in lists.items()})

    @property
    def stiff(self) -> np.ndarray:
        """Mask of the terms with stiffness in the undeformed state."""
        return np.array([kind == "exponent" or number == 1 for kind, number in self.terms])

    def start(self) -> np.ndarray:
        """Return the coefficients of a Neo-Hookean law with the shear modulus 1."""
        return np.array([2.0 * (term == ("exponent", 2.0)) for term in self.terms])


def solved(jacobian: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the non-negative least-squares solution of J x = right, after an orthogonal reduction to as many rows as columns."""
    q, r = np.linalg.qr(jacobian)
    size = np.linalg.norm(r, axis=0)
    size[size == 0] = 1.0
    return nnls(r / size, q.T @ right)[0] / size


def non_negative(search, x: np.ndarray, close: float) -> SimpleNamespace:
    """Minimize the residuals of a search over non-negative coefficients by Gauss-Newton steps.

    The search ends when a step reduces the sum of squares by less than its part `close`. Return the coefficients ``x``, of which none is
    less than `FLOOR` of the greatest, and the Jacobian ``jac``, as `scipy.optimize.least_squares` does.
    """
    x = np.maximum(x, FLOOR * x.max())
    cost = (search.residuals(x) ** 2).sum()
    for _ in range(MOST_STEPS):
        jacobian = search.jacobian(x)
        step = solved(jacobian, jacobian @ x - search.residuals(x)) - x
        for halving in range(HALVINGS):
            new = x + step / 2**halving
            new = np.maximum(new, FLOOR * new.max())
            reached = (search.residuals(new) ** 2).sum()
            if reached < cost:
                break
        else:
            break
        before, cost, x = cost, reached, new
        if cost > (1 - close) * before:
            break
    return SimpleNamespace(x=x, jac=search.jacobian(x), active_mask=np.zeros(len(x)))


def members(jacobian: np.ndarray, right: np.ndarray, stiff: np.ndarray, count: int, random: np.random.Generator) -> list[np.ndarray]:
    """Return coefficients of members of a committee, each solved from a random half of the rows with a random two thirds of the terms.

    `stiff` is a mask of the terms with stiffness at rest, of which every member has one.
    """
    found, (n, terms) = [], jacobian.shape
    while len(found) < count:
        rows, kept = random.permutation(n)[: n // 2], np.sort(random.permutation(terms)[: -(-2 * terms // 3)])
        values = np.zeros(terms)
        values[kept] = solved(jacobian[np.ix_(rows, kept)], right[rows])
        if stiff[values > 0].any():
            found.append(values)
    return found
