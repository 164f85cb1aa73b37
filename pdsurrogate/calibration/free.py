"""Energy without a law for calibrations: a sum of few terms, whose coefficients, of which none is negative, are the unknowns."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
from scipy.spatial import cKDTree

from ..identification import MODES
from ..identification.energy import columns_of, isochoric, no_sum_fits, nonnegative, stiffness_of
from ..materials import Law
from ..materials.dictionary import OF_INVARIANTS, STABLE_TO, Term, wave_check
from ..materials.polyconvex import law_of

MOST_OF_STRETCHES, MOST_OF_INVERSES = 4, 1
"""Most terms in an energy that are functions of the stretches, as those of I1bar, and of their inverses, as those of I2bar. Chosen:
measurements hardly distinguish five of the former from each other, nor two of the latter."""

PER_TERM, PER_RATIO = 1.0, 4.0
"""Decreases of the logarithm of the prior weight of an energy: for each term, and for a ratio of the stress in equibiaxial tension to that
in uniaxial tension, at `PRIOR_STRETCH`, that is greater by 1. Chosen by simulated tests of 35 laws (theory, section 28): they decide where
the measurements do not."""

PRIOR_STRETCH = 2.0
"""Stretch at which the prior weight compares equibiaxial with uniaxial tension."""

GROUP = 13
"""Number of neighboring places whose residuals of all steps are summed to see whether they are independent."""

FLOOR = 3e-6
"""Least coefficient in the search, relative to the greatest: differences over a millionth of the greatest do not make it negative."""

MOST_TRIED = 8
"""Most terms whose coefficients a search varies, each of which takes the solution of linear equations in each step. Of a greater dictionary
the weak form chooses these."""

MET = 100.0
"""Norm of the equation for the sum of the forces, divided by that of all other equations: the sum is then fitted to 1e-4."""

HALVINGS = 6
"""Most halvings of a step that does not reduce the residuals."""


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
    terms: tuple[Term, ...] = OF_INVARIANTS

    def of(self, kept: np.ndarray) -> "EnergyUnknowns":
        """Return the unknowns of some of the terms, given by a mask."""
        return replace(self, terms=tuple(term for term, one in zip(self.terms, kept, strict=True) if one))

    def unknowns(self) -> list[str]:
        """Return the names of the coefficients."""
        return [f"weight of {term}" for term in self.terms]

    def law_of(self, values: np.ndarray) -> Law:
        """Return the law with given coefficients."""
        return law_of(self.terms, values, self.bulk_modulus or (self.bulk_ratio or 1.0) * stiffness_of(self.terms, values))

    def start(self) -> np.ndarray:
        """Return the coefficients of a law with the shear modulus 1 near the Neo-Hookean one, none below its least value."""
        rows = np.array([term.row for term in self.terms])
        moduli = np.array([term.shear_modulus for term in self.terms])
        nearest = np.abs(rows[:, 0] * rows[:, 1] - 2) + np.where(moduli > 0, 0, np.inf)  # l^2, of which I1bar is the sum
        start = np.zeros(len(moduli))
        start[nearest.argmin()] = 1 / moduli[nearest.argmin()]
        return floored(start)


def floored(values: np.ndarray) -> np.ndarray:
    """Return coefficients that are at least `FLOOR` of the greatest."""
    return np.maximum(values, FLOOR * values.max())


def solved(jacobian: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the least-squares solution of J x = right without negative numbers, after an orthogonal reduction to a square matrix."""
    q, r = np.linalg.qr(jacobian)
    return nonnegative(r, q.T @ right, np.ones(len(r)))[0]


def scaled(jacobian: np.ndarray, right: np.ndarray, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the equations of the weak form with one more, which fits the sum of the measured forces, chosen by a mask.

    Without it an energy of almost zero would fit best where the simulation has errors, since its forces are in balance in every field.
    """
    if not forces.any():
        return jacobian, right
    row = np.append(right[forces] @ jacobian[forces], right[forces] @ right[forces])
    row *= MET * np.linalg.norm(jacobian) / np.linalg.norm(row[:-1])
    return np.vstack([jacobian, row[:-1]]), np.append(right, row[-1])


def proposed(jacobian: np.ndarray, right: np.ndarray, forces: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Return, for each term, the share of fits of the weak form in which it has weight: to all equations, and with one group left out."""
    masks = [np.ones(len(groups), dtype=bool), *(groups != one for one in np.unique(groups))]
    fits = np.array([solved(*scaled(jacobian[used], right[used], forces[used])) for used in masks])
    return np.mean(fits > FLOOR * fits.max(axis=1, keepdims=True), axis=0)


def minimized(search, x: np.ndarray, close: float, most: int) -> SimpleNamespace:
    """Minimize the residuals of a search over coefficients, none negative, by at most `most` Gauss-Newton steps.

    The search ends when a step reduces the sum of squares by a smaller share than `close`. Return the coefficients ``x``, of which none is
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
    return SimpleNamespace(x=x, jac=jacobian if most == 1 else search.jacobian(x))


@dataclass(frozen=True)
class Average:
    """Average of energies of different terms, each weighted by the probability that the measurements give it.

    Attributes
    ----------
    mean : ndarray, shape (n_terms,)
        Coefficients of the average.
    covariance : ndarray, shape (n_terms, n_terms)
        Covariance of the coefficients: that within the energies, and that of the energies.
    members : ndarray, shape (n_members, n_terms)
        Coefficients of energies drawn by their weights, with random errors.
    """

    mean: np.ndarray
    covariance: np.ndarray
    members: np.ndarray


def average(
    terms: Sequence[Term],
    jacobian: np.ndarray,
    right: np.ndarray,
    correlated: float,
    count: int,
    random_state: int = 0,
    greatest: float = STABLE_TO,
) -> Average:
    """Return the average of all sets of few `terms` that solve the linear equations J x = right, with `count` members.

    Parameters
    ----------
    terms : sequence of Term
    jacobian : ndarray, shape (n, n_terms)
        Derivatives of the measurements by the coefficients of all terms, in standard deviations.
    right : ndarray, shape (n,)
    correlated : float
        Number of measurements that tell as much as one independent measurement (`grouping`).
    count : int
    random_state : int
        Seed of the members.
    greatest : float
        Greatest stretch of the states in which waves must be stable.

    Raises
    ------
    ValueError
        If no sum of the terms with a stiffness at rest fits.
    """
    n, every = jacobian.shape
    square = np.linalg.qr(np.column_stack([jacobian, right]), mode="r")
    waves, stiff, found = wave_check(terms, greatest), np.array([term.shear_modulus > 0 for term in terms]), {}

    def stable(x: np.ndarray) -> bool:
        """Return whether an energy has a stiffness at rest and stable waves."""
        return bool(stiff[x > 0].any() and waves(x))

    for chosen in sets_of(terms):
        x = np.zeros(every)
        x[chosen] = nonnegative(square[:, chosen], square[:, -1], np.ones(len(square)))[0]
        if stable(x):
            found[tuple(np.flatnonzero(x))] = x
    if not found:
        raise no_sum_fits("measurements", "that forces are positive in tension, the steps in the table")
    x = np.array(list(found.values()))
    squares = ((x @ square[:, :-1].T - square[:, -1]) ** 2).sum(axis=1)
    scale = correlated * max(1.0, squares.min() / n)
    states = np.array([[PRIOR_STRETCH, MODES[mode](PRIOR_STRETCH)] for mode in ("equibiaxial", "uniaxial")])
    equibiaxial, uniaxial = columns_of(isochoric(states, np.ones(2)), states[:, 0], terms) @ x.T
    logarithms = -(squares - squares.min()) / (2 * scale) - PER_TERM * (x > 0).sum(axis=1) - PER_RATIO * equibiaxial / uniaxial
    weights = np.exp(logarithms - logarithms.max())
    weights /= weights.sum()
    mean = weights @ x
    covariance, factors = (x - mean).T @ (weights[:, None] * (x - mean)), []
    for kept, weight in zip(found, weights, strict=True):
        factors.append(np.sqrt(scale) * np.linalg.pinv(square[:, list(kept)], rcond=1e-12))
        covariance[np.ix_(kept, kept)] += weight * factors[-1] @ factors[-1].T
    random, members = np.random.default_rng(random_state), []
    for number in random.choice(len(x), size=count, p=weights):
        member, kept = x[number].copy(), list(found)[number]
        member[list(kept)] += factors[number] @ random.standard_normal(factors[number].shape[1])
        # A coefficient is not negative, and the energy of the set itself takes the place of an unstable one.
        member = np.maximum(member, 0.0)
        members.append(member if stable(member) else x[number])
    return Average(mean, covariance, np.array(members))


def sets_of(terms: Sequence[Term]) -> Iterator[list[int]]:
    """Yield the numbers of the terms in each set with 1 to `MOST_OF_STRETCHES` and 0 to `MOST_OF_INVERSES` of them.

    Where all terms are functions of the inverses, each set has one of them.
    """
    inverse = np.array([term.row[0] < 0 for term in terms])
    sets = [
        [[*one] for size in range(most + 1) for one in combinations(np.flatnonzero(kind), size)]
        for kind, most in ((~inverse, MOST_OF_STRETCHES), (inverse, MOST_OF_INVERSES))
    ]
    for of_stretches in sets[0][0 if inverse.all() else 1 :]:
        yield from (of_stretches + of_inverses for of_inverses in sets[1] if of_stretches or of_inverses)


def grouping(residuals: np.ndarray, places: np.ndarray, component: np.ndarray) -> tuple[float, int]:
    """Return the sum over groups of the squared sums of residuals of displacements, and the sum of the numbers of residuals in the groups.

    A group consists of the residuals of all steps, of one component, at a place and its `GROUP` - 1 nearest. The quotient of both sums,
    divided by the mean square, is 1 for independent residuals. For residuals with smooth sources, such as the discretization error, it is
    about the number of residuals that contain as much information as one independent residual.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
    places : ndarray, shape (n, d)
    component : ndarray of int, shape (n,)
    """
    total, count = 0.0, 0
    for axis in np.unique(component):
        here = component == axis
        where, at = np.unique(places[here], axis=0, return_inverse=True)
        near = cKDTree(where).query(where, min(GROUP, len(where)))[1].reshape(len(where), -1)
        sums = np.bincount(at.ravel(), residuals[here], len(where))[near].sum(axis=1)
        total += float((sums**2).sum())
        count += int(np.bincount(at.ravel(), minlength=len(where))[near].sum())
    return total, count
