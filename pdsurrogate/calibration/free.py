"""Energy without a law for calibrations: a sum of polyconvex terms, whose coefficients, of which none is negative, are the unknowns."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from ..identification.energy import best_sets, nonnegative, stiffness_of
from ..materials import Law
from ..materials.polyconvex import Term, law_of

EXPONENTS = (-4.0, -2.0, -1.0, 1.0, 2.0, 3.0, 5.0, 8.0)
"""Exponents of the stretches among the terms, as many as a law takes: about evenly spaced in the logarithm of their size."""

TERMS = (
    *(Term("stretches", exponent) for exponent in EXPONENTS),
    *(Term("first", power) for power in (2.0, 3.0, 4.0)),
    Term("second", 1.0),
    *(Term("roots", number) for number in (1.0, 2.0)),
)
"""Candidate terms: I1bar - 3 itself is the exponent 2. Left out are logarithms, whose limits belong to the greatest stretch of homogeneous
tests, and higher powers of I2bar^1.5 - 3 sqrt 3, with which stresses in equibiaxial tension, which few tests of bodies contain, can be
off by a factor."""

FLOOR = 3e-5
"""Least coefficient in the search, relative to the greatest: differences over a millionth of the greatest modulus keep its sign."""

MOST_STEPS = 12
"""Most Gauss-Newton steps, each with a simulation of all derivatives."""

HALVINGS = 6
"""Most halvings of a step that does not reduce the residuals."""

MOST_TERMS = 6
"""Most terms of an energy. Chosen: the tests of a body rarely determine as many."""


@dataclass(frozen=True)
class EnergyUnknowns:
    """Terms of an energy, whose coefficients are the unknowns of a calibration.

    Attributes
    ----------
    bulk_ratio, bulk_modulus : float or None
        Of these, one is given.
    terms : tuple of Term
    """

    bulk_ratio: float | None = None
    bulk_modulus: float | None = None
    terms: tuple[Term, ...] = TERMS

    def of(self, kept: np.ndarray) -> "EnergyUnknowns":
        """Return the unknowns of some of the terms, given by a mask."""
        return replace(self, terms=tuple(term for term, one in zip(self.terms, kept, strict=True) if one))

    def unknowns(self) -> list[str]:
        """Return the names of the coefficients."""
        return [f"weight of {term}" for term in self.terms]

    def law_of(self, values: np.ndarray) -> Law:
        """Return the law with given coefficients."""
        return law_of(self.terms, values, self.bulk_modulus or (self.bulk_ratio or 1.0) * stiffness_of(self.terms, values))

    @property
    def stiff(self) -> np.ndarray:
        """Mask of the terms with stiffness in the undeformed state."""
        return np.array([term.shear_modulus > 0 for term in self.terms])

    def start(self) -> np.ndarray:
        """Return the coefficients of a law near the Neo-Hookean one with the shear modulus 1, none below its least value."""
        return floored(np.array([2.0 * (term == ("stretches", 2.0)) for term in self.terms]))


def floored(values: np.ndarray) -> np.ndarray:
    """Return coefficients that are at least `FLOOR` of the greatest."""
    return np.maximum(values, FLOOR * values.max())


def solved(jacobian: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the least-squares solution of J x = right without negative numbers, after an orthogonal reduction to a square matrix."""
    q, r = np.linalg.qr(jacobian)
    return nonnegative(r, q.T @ right, np.ones(len(r)))[0]


def minimized(search, x: np.ndarray, close: float, most: int = MOST_STEPS) -> SimpleNamespace:
    """Minimize the residuals of a search over coefficients, none negative, by at most `most` Gauss-Newton steps.

    The search ends when a step reduces the sum of squares by less than its part `close`. Return the coefficients ``x``, of which none is
    less than `FLOOR` of the greatest, and the Jacobian ``jac``, as `scipy.optimize.least_squares` does.
    """
    x = floored(x)
    cost = (search.residuals(x) ** 2).sum()
    for _ in range(most):
        jacobian = search.jacobian(x)
        target = solved(jacobian, jacobian @ x - search.residuals(x))
        for halving in range(HALVINGS):
            new = floored(x + (target - x) / 2**halving)
            reached = (search.residuals(new) ** 2).sum()
            if reached < cost:
                break
        else:
            break
        before, cost, x = cost, reached, new
        if cost > (1 - close) * before:
            break
    return SimpleNamespace(x=x, jac=jacobian if most == 1 else search.jacobian(x), active_mask=np.zeros(len(x)))


def chosen_terms(jacobian: np.ndarray, right: np.ndarray, stiff: np.ndarray) -> np.ndarray:
    """Return a mask of the fewest terms that fit the linear equations J x = right as well as up to `MOST_TERMS` terms do.

    As well means that the sum of squares exceeds the least one by at most the standard error of the difference, from its scatter over the
    rows.
    """
    squares, sets = [], best_sets(jacobian, right, np.ones(len(right)), stiff, MOST_TERMS)
    if not sets:
        raise ValueError("no energy describes the measurements: check that forces are positive in tension, and the steps in the table")
    for chosen in sets:
        squares.append((jacobian[:, chosen] @ solved(jacobian[:, chosen], right) - right) ** 2)
    excess = np.array(squares) - squares[np.argmin([each.sum() for each in squares])]
    as_good = excess.sum(axis=1) <= np.sqrt(len(right)) * excess.std(axis=1)
    return np.isin(np.arange(len(stiff)), sets[int(np.argmax(as_good))])


def members(jacobian: np.ndarray, right: np.ndarray, stiff: np.ndarray, field: np.ndarray, count: int) -> list[np.ndarray]:
    """Return coefficients of the members of a committee, each solved with a random two thirds of the terms.

    Each takes all outputs and a random half of the displacements, the rows in the mask `field`: the few outputs determine the scale of the
    stresses. `stiff` is a mask of the terms with stiffness at rest, of which every member has one.
    """
    found, terms, random, at = [], jacobian.shape[1], np.random.default_rng(0), np.flatnonzero(field)
    while len(found) < count:
        rows = np.concatenate([np.flatnonzero(~field), random.permutation(at)[: len(at) // 2]])
        kept, values = np.sort(random.permutation(terms)[: -(-2 * terms // 3)]), np.zeros(terms)
        values[kept] = solved(jacobian[np.ix_(rows, kept)], right[rows])
        if stiff[values > 0].any():
            found.append(values)
    return found
