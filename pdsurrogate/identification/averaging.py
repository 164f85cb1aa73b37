"""Averages of energies without a law: all sums of few terms that fit measurements, weighted by
how well each of them describes these.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import nnls

from ..materials.dictionary import Term, derivatives
from .data import MODES
from .stress_regressor import free_sides

MOST_OF_STRETCHES = 4
MOST_OF_INVERSES = 1
"""Most terms in an energy that are functions of the stretches, as those of I1bar, and of their
inverses, as those of I2bar. Chosen: measurements hardly distinguish five of the former from each
other, nor two of the latter.
"""

PER_TERM = 1.0
PER_RATIO = 4.0
"""Decreases of the logarithm of the prior weight of an energy: for each term, and for a ratio of
the stress in equibiaxial tension to that in uniaxial tension, at `PRIOR_STRETCH`, that is greater
by 1. Chosen by simulated tests of 35 laws (theory, section 28): they decide where the measurements
do not.
"""

PRIOR_STRETCH = 2.0
"""Stretch at which the prior weight compares equibiaxial with uniaxial tension."""


@dataclass(frozen=True)
class Average:
    """Average of energies of different terms, each weighted by the probability that the
    measurements give it.

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
    variance: Callable[[float], float],
    margin: Callable[[np.ndarray], np.ndarray],
    count: int = 0,
    random_state: int = 0,
) -> Average:
    """Return the average (87) of all sets of few `terms` that solve the linear equations J x =
    right, with `count` members.

    It is a continuous function of the equations: no set is chosen, and the weight of a set is zero
    where it ceases to be permitted.

    Parameters
    ----------
    terms : sequence of Term
    jacobian : ndarray, shape (n, n_terms)
        Derivatives of the measurements by the coefficients of all terms, times the roots of the
        weights of the measurements.
    right : ndarray, shape (n,)
    variance : callable
        Gives, for the least sum of squares of all sets, the variance of a measurement times the
        number of measurements that tell as much as one independent measurement.
    margin : callable
        Gives the margins of stability of coefficients, shape (..., n_terms), as
        `pdsurrogate.materials.dictionary.wave_margin`.
    count : int
    random_state : int
        Seed of the members.

    Raises
    ------
    ValueError
        If no sum of the terms with a stiffness at rest fits.
    """
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0] = 1.0  # data of the undeformed state have no stress
    square = np.asarray(np.linalg.qr(np.column_stack([jacobian / size, right]), mode="r"))
    sets = list(sets_of(terms))
    x = np.zeros((len(sets), len(terms)))
    for row, chosen in zip(x, sets, strict=True):
        row[chosen] = nnls(square[:, chosen], square[:, -1])[0]
    squares = ((x @ square[:, :-1].T - square[:, -1]) ** 2).sum(axis=1)
    x /= size
    scale = variance(float(squares.min()))
    states = np.array(
        [[PRIOR_STRETCH, MODES[mode](PRIOR_STRETCH)] for mode in ("equibiaxial", "uniaxial")]
    )
    equibiaxial, uniaxial = columns_of(isochoric(states, np.ones(2)), states[:, 0], terms) @ x.T
    stable = np.where(uniaxial > 0, np.maximum(margin(x), 0.0), 0.0)
    logarithms = -squares / (2 * scale) - PER_TERM * np.array([len(chosen) for chosen in sets])
    logarithms -= PER_RATIO * equibiaxial / np.where(uniaxial > 0, uniaxial, 1.0)
    weights = stable * np.exp(
        np.minimum(logarithms - logarithms[stable > 0].max(initial=-np.inf), 0.0)
    )
    moduli = np.array([term.shear_modulus for term in terms])
    stiff = x @ moduli > 0
    if not weights[stiff].sum() > 0:
        raise ValueError(
            "no sum of the terms with positive coefficients and stable waves describes the"
            " measurements: check that stresses and forces are positive in tension and rise"
        )
    weights /= weights.sum()
    mean = weights @ x
    covariance = (x - mean).T @ (weights[:, None] * (x - mean))
    factors = {}
    for number in np.flatnonzero(weights > np.finfo(float).eps):
        kept = np.flatnonzero(x[number])
        factors[number] = (
            kept,
            np.sqrt(scale) * np.linalg.pinv(square[:, kept], rcond=1e-12) / size[kept, None],
        )
        covariance[np.ix_(kept, kept)] += (
            weights[number] * factors[number][1] @ factors[number][1].T
        )
    random = np.random.default_rng(random_state)
    members = []
    drawn = [number for number in factors if stiff[number]]
    for number in random.choice(drawn, size=count, p=weights[drawn] / weights[drawn].sum()):
        member = x[number].copy()
        kept, factor = factors[number]
        member[kept] += factor @ random.standard_normal(factor.shape[1])
        # A coefficient is not negative, and the energy of the set itself takes the place of an
        # unstable one.
        member = np.maximum(member, 0.0)
        members.append(member if member @ moduli > 0 and margin(member) > 0 else x[number])
    return Average(mean, covariance, np.array(members))


def sets_of(terms: Sequence[Term]) -> Iterator[list[int]]:
    """Yield the numbers of the terms in each set with 1 to `MOST_OF_STRETCHES` and 0 to
    `MOST_OF_INVERSES` of them.
    """
    inverse = np.array([term.row[0] < 0 for term in terms])
    for size in range(1, MOST_OF_STRETCHES + 1):
        for of_stretches in combinations(np.flatnonzero(~inverse).tolist(), size):
            for more in range(MOST_OF_INVERSES + 1):
                for of_inverses in combinations(np.flatnonzero(inverse).tolist(), more):
                    yield [*of_stretches, *of_inverses]


def nonnegative(columns: np.ndarray, y: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Return the coefficients, none negative, with which a sum of columns fits y best; `root`
    holds the square roots of row weights.
    """
    columns = root[:, None] * columns
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0  # data of the undeformed state have no stress
    return nnls(columns / size, root * y)[0] / size


def isochoric(X: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Return the three isochoric principal stretches, shape (n, 3), of states X (two stretches)
    with given volume ratios.

    In states with free sides the lateral stretch is that of the thickness, whatever X states.
    """
    first, second = X.T
    lateral = np.where(free_sides(first, second), np.sqrt(volume / first), second)
    l1 = first * volume ** (-1 / 3)
    l2 = lateral * volume ** (-1 / 3)
    return np.column_stack([l1, l2, 1 / (l1 * l2)])


def columns_of(stretches: np.ndarray, first: np.ndarray, terms: Sequence[Term]) -> np.ndarray:
    """Return the nominal stress along the first stretch of each energy term with unit weight, shape
    (n_samples, n_terms).

    `stretches` are the isochoric principal stretches, shape (n_samples, 3), with the stress-free
    thickness last; `first` are the full stretches along the stress, which include the change of
    volume.
    """
    slopes = derivatives(terms, np.log(stretches))[1]
    return (slopes[..., 0] - slopes[..., 2]) / first[:, None]
