"""An energy from test data without a law: a sum of powers of stretches and invariants, each with a weight that is not negative."""

from __future__ import annotations

import warnings
from itertools import product
from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import ConvexHull
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_is_fitted

from ..arguments import in_order
from ..materials import Ogden, Polyconvex
from ..materials.polyconvex import SECOND_AT_REST
from .data import BIAXIAL, MODES
from .stress_regressor import BULK_RATIO, StressRegressor, free_sides, states

LEAST_EXPONENT = 1.0
"""Powers of at least 1 of the principal stretches, and of their products two by two, are convex functions of F and of its cofactor."""

STEP = 0.25
"""Between the exponents of the dictionary."""

POSITIVE, NEGATIVE = (3.0, 5.0, 8.0, 12.0), (1.0, 2.0, 4.0, 6.0)
"""Greatest exponents, of powers of the stretches and of those of their inverses, among which cross-validation chooses."""

INVARIANTS = ((), ((1, 2), (1, 3)), ((1, 2), (1, 3), (2, 1), (2, 2), (2, 3)))
"""Powers of invariants beside those of the stretches among which cross-validation chooses, as (1 or 2, power): those of I1bar - 3, and of
I2bar^1.5 - 3 sqrt 3 as well, which modes that are not among the data may ask too much of.  I1bar - 3 itself is the exponent 2."""

AS_GOOD = 0.05
"""Of two dictionaries whose errors differ by no more, the smaller is taken."""

FOLDS = 5
"""Of a biaxial grid, by its greatest stretch; and of states that are left out one in five."""

ROUNDS = 60
"""Most fits by turns of the weights and of the volume ratios that they make."""

SAME_MODE = 0.01
"""How far a lateral stretch may be off that of a mode of loading to be taken for it."""


class EnergyRegressor(StressRegressor):
    """An isochoric energy fitted to nominal stresses, without a law.

    W is the sum of c_a/a^2 (l1^a + l2^a + l3^a - 3) over a dictionary of exponents a of size 1 or more, of either sign, with c_a >= 0
    (a separable energy, after Valanis and Landel), and, where cross-validation finds them to foretell more, of powers up to the third of
    I1bar - 3 and of I2bar^1.5 - 3 sqrt 3, with weights that are not negative either.  What physics asks for holds whatever the data are:
    energy and stress vanish at rest; l^a summed is a convex function of F for a >= 1, and for a <= -1 of its cofactor, and the powers of
    invariants are polyconvex, so W is among deformations that keep the volume, and shear waves are stable in all states; it grows without
    bound.  Beyond the data it goes on as these powers do.

    In states of constant volume the stresses are linear in the weights, so the fit is one of non-negative least squares, with no start and
    no random choice; few terms are left.  The volume ratios that the bulk modulus lets the law have are found by turns with the weights.
    How far the exponents reach, and which powers of invariants there are, is chosen by cross-validation over modes of loading, or over
    parts of a biaxial grid; for the powers of invariants, where there are three such parts, the error of every fifth state left out counts
    as much.

    Parameters
    ----------
    max_terms : int, default=8
        Those with the least part in the stress are left out beyond so many.
    margin : float, default=0.05
        By which the hull of the data is taken to hold beyond them, in log-stretch.
    bulk_ratio : float, default=1000
        K/mu of the law that is fitted and comes out: such tests do not tell it, see `LawRegressor`.
    bulk_modulus : float, optional
        K itself instead, in the unit of the stresses.
    offset : float, default=0.0
        By which the sizes of the exponents begin beyond 1; less than their step of 0.25.  Nothing tells where the grid of exponents
        stands: members of a committee draw it.

    Attributes
    ----------
    law_ : Ogden or Polyconvex
        The energy, as a law that every force model takes; the latter where it has powers of invariants.
    exponents_, weights_ : ndarray, shape (n_terms,)
        a and c_a, in the unit of the stresses; half of their sum is the shear modulus, with that of the invariants' own.
    invariant_weights_ : dict
        Weights of the powers of the invariants by (1 or 2, power), same unit; empty if there are none.
    parameter_names_, parameters_, covariance_, standard_errors_, at_bound_
        Weights with their covariance and standard errors, the exponents and the volume ratios taken as given.
    cross_validation_ : list of dict
        ``greatest``, ``least`` exponent, ``invariants``, and the relative RMS error of what was left out.
    hull_ : ndarray, shape (n, 3)
        Half-planes (n1, n2, -d) of the convex hull of the data and of rest, n . x <= d, with x the logarithms of the two greater of the
        three stretches of a state, the greatest first: an isotropic energy does not know which way they point.
    stretch_range_ : tuple of float
        Least and greatest stretch of the data.
    n_features_in_ : int

    References
    ----------
    Valanis, Landel, J. Appl. Phys. 38 (1967) 2997; Ball, Arch. Rat. Mech. Anal. 63 (1977) 337; Ogden 1972; Hartmann, Neff, Int. J. Solids
    Struct. 40 (2003) 2767.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> data = pds.load_test_data("treloar").up_to(3.0)
    >>> found = pds.EnergyRegressor().fit(data.stretches, data.nominal_stress)
    >>> bool(found.score(data.stretches, data.nominal_stress) > 0.99)
    True
    """

    _parameter_constraints: ClassVar = {
        "max_terms": [Interval(Integral, 1, 8, closed="both")],
        "margin": [Interval(Real, 0, 1, closed="both")],
        "bulk_ratio": [Interval(Real, 0, None, closed="neither")],
        "bulk_modulus": [None, Interval(Real, 0, None, closed="neither")],
        "offset": [Interval(Real, 0, STEP, closed="left")],
    }

    law = "energy"
    """Its name in reports, where a `LawRegressor` names its law."""

    def __init__(self, max_terms=8, margin=0.05, bulk_ratio=BULK_RATIO, bulk_modulus=None, offset=0.0):
        self.max_terms = max_terms
        self.margin = margin
        self.bulk_ratio = bulk_ratio
        self.bulk_modulus = bulk_modulus
        self.offset = offset

    def redrawn(self, random):
        """A copy with another offset of the exponents."""
        return super().redrawn(random).set_params(offset=random.uniform(0, STEP))

    def fit(self, X, y, sample_weight=None, groups=None):
        """Fit the weights.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2)
            Stretch in the direction of the stress, and across it; of a table (pandas) the columns ``stretch`` and ``lateral_stretch``, in
            any order.
        y : array-like, shape (n_samples,)
            Nominal stress.
        sample_weight : array-like, shape (n_samples,), optional
        groups : array-like, shape (n_samples,), optional
            What is left out together in cross-validation; by default modes of loading (`groups_of`).

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If X has other columns or a stretch is not positive.

        Warns
        -----
        UserWarning
            If the stresses are those of no rubber, or the data of one state or one mode of loading, which do not tell an energy.
        """
        X, y, root, used = self._checked(X, y, sample_weight)
        _tell_what_is_open(X)
        groups = groups_of(X) if groups is None else np.asarray(groups)[used]
        self.cross_validation_ = self._cross_validated(X, y, root, groups)
        chosen = self._chosen(X, y, root, groups)
        volume = np.ones_like(y)
        for _ in range(ROUNDS):
            stretches = isochoric(X, volume)
            terms, weights = self._fitted(columns_of(stretches, X[:, 0], chosen), y, root, chosen)
            if not sum(stiffness_of(terms, weights)) > 0:
                warnings.warn("no rubber has such stresses: they do not rise with the stretch, and next to nothing is fitted", stacklevel=2)
                terms, weights = [2.0], np.array([1e-6 * max(np.abs(y).max(), 1e-300)])
            before, (law, volume) = volume, self._law_and_volume(terms, weights, X, volume)
            if np.abs(volume - before).max() < 1e-9:
                break
        columns = root[:, None] * columns_of(stretches, X[:, 0], terms)
        squares = ((columns @ weights - root * y) ** 2).sum()
        self._store(law, [_name_of(term) for term in terms], weights, columns, squares)
        powers = np.array([not isinstance(term, tuple) for term in terms])
        self.exponents_ = np.array([term for term in terms if not isinstance(term, tuple)])
        self.weights_ = weights[powers]
        self.invariant_weights_ = {term: float(weight) for term, weight in zip(terms, weights, strict=True) if isinstance(term, tuple)}
        self.stretch_range_ = float(X.min()), float(X.max())
        self.hull_ = half_planes(X)
        return self

    def beyond(self, X) -> np.ndarray:
        """Return the distance of states beyond the hull of the data, in log-stretch, shape (n_samples,); at most 0 inside its margin."""
        check_is_fitted(self)
        logs = ordered_logs(self._stretches(np.asarray(in_order(X, self.columns, "X"), dtype=float)))
        return (logs @ self.hull_[:, :2].T + self.hull_[:, 2]).max(axis=1) - self.margin

    def domain_hull(self) -> list[list[float]]:
        """Half-planes (n1, n2, d) of the hull with its margin, as `pdsurrogate.forces.Domain` has them."""
        check_is_fitted(self)
        return [[n1, n2, self.margin - offset] for n1, n2, offset in self.hull_.tolist()]

    def _cross_validated(self, X, y, root, groups) -> list[dict]:
        """Relative error of what is left out, group by group, of every dictionary; the first of those that are as good is to be taken."""
        rows = []
        for invariants, greatest, least in product(INVARIANTS, POSITIVE, NEGATIVE):
            terms = [*dictionary(greatest, least, self.offset), *invariants]
            error = self._left_out(X, y, root, groups, terms)
            rows.append({"greatest": greatest, "least": -least, "invariants": len(invariants), "relative_rms": error})
        return rows

    def _chosen(self, X, y, root, groups) -> list:
        """Terms of the best dictionary: the best reach of the exponents for each set of invariants, and then the best set."""
        candidates = []
        for invariants in INVARIANTS:
            rows = [row for row in self.cross_validation_ if row["invariants"] == len(invariants)]
            row = _first_as_good(rows, [row["relative_rms"] for row in rows])
            terms, error = [*dictionary(row["greatest"], -row["least"], self.offset), *invariants], row["relative_rms"]
            if len(np.unique(groups)) > 2:
                # Enough modes for what lies between them to be asked for as well as what lies beyond.
                error = np.sqrt(error * self._left_out(X, y, root, fifths_of(X), terms))
            candidates.append((terms, error))
        return _first_as_good(*zip(*candidates, strict=True))

    def _left_out(self, X, y, root, groups, terms) -> float:
        """Relative RMS error of the rows of each group, by a fit to those of the others at constant volume."""
        columns, error, size, kinds = columns_of(isochoric(X, np.ones_like(y)), X[:, 0], terms), 0.0, 0.0, np.unique(groups)
        numbers = np.arange(len(terms))
        for kind in kinds if len(kinds) > 1 else ():
            left = groups == kind
            kept, weights = self._fitted(columns[~left], y[~left], root[~left], numbers)
            error += ((root[left] * (columns[left][:, kept] @ weights - y[left])) ** 2).sum()
            size += ((root[left] * y[left]) ** 2).sum()
        return float(np.sqrt(error / size)) if size > 0 else 0.0

    def _fitted(self, columns, y, root, terms) -> tuple[list, np.ndarray]:
        """Terms with a weight, and the weights."""
        columns, kept = root[:, None] * columns, np.arange(len(terms))
        size = np.linalg.norm(columns, axis=0)
        size[size == 0] = 1.0  # data at rest tell nothing
        while True:
            weights = nnls(columns[:, kept] / size[kept], root * y)[0]
            some = weights > 1e-9 * max(weights.max(), 1e-300)
            if some.sum() <= self.max_terms:
                kept, weights = kept[some], weights[some]
                return [terms[number] for number in kept], weights / size[kept]
            # The least part in the stress.
            kept = np.delete(kept[some], weights[some].argmin())

    def _law_and_volume(self, terms, weights, X, volume) -> tuple[Ogden, np.ndarray]:
        """The law of weights, and the volume ratios that it has, or that were known where it has none."""
        powers = [(term, weight) for term, weight in zip(terms, weights, strict=True) if not isinstance(term, tuple)]
        exponents = tuple(float(term) for term, _ in powers)
        # A term of Ogden's law is mu_k/alpha_k (...): mu_k alpha_k is the weight.
        moduli = tuple(float(weight / term) for term, weight in powers)
        bulk = self.bulk_modulus or self.bulk_ratio * sum(stiffness_of(terms, weights))
        if len(powers) == len(terms):
            law = Ogden(None, bulk, moduli, exponents)
        else:
            of = {term: float(weight) for term, weight in zip(terms, weights, strict=True) if isinstance(term, tuple)}
            first, second = (tuple(of.get((which, power), 0.0) for power in (1, 2, 3)) for which in (1, 2))
            law = Polyconvex(None, bulk, moduli, exponents, first, second)
        found = states(law, X)[1]
        return law, np.where(np.isfinite(found), found, volume)


def _first_as_good(choices, errors):
    """The first, which is the smallest, of those whose errors are about the least."""
    most = (1 + AS_GOOD) * min(errors) + 1e-9
    return next(choice for choice, error in zip(choices, errors, strict=True) if error <= most)


def _name_of(term) -> str:
    if not isinstance(term, tuple):
        return f"weight of exponent {term:g}"
    return f"weight of {('I1bar - 3', 'I2bar^1.5 - 3 sqrt 3')[term[0] - 1]} to the power {term[1]}"


def stiffness_of(terms, weights) -> list[float]:
    """Part of the shear modulus at rest of every term with its weight."""
    own = [0.5 if not isinstance(term, tuple) else {(1, 1): 2.0, (2, 1): SECOND_AT_REST}.get(term, 0.0) for term in terms]
    return [float(part * weight) for part, weight in zip(own, weights, strict=True)]


def isochoric(X: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Three isochoric principal stretches, shape (n, 3), of states of given volume ratio; free sides share it with the thickness."""
    first, second = X.T
    lateral = np.where(free_sides(first, second), np.sqrt(volume / first), second)
    l1, l2 = first * volume ** (-1 / 3), lateral * volume ** (-1 / 3)
    return np.stack([l1, l2, 1 / (l1 * l2)], axis=1)


def ordered_logs(X: np.ndarray) -> np.ndarray:
    """Logarithms of the two greater of the three stretches of incompressible states, the greatest first, shape (n, 2)."""
    logs = np.log(X)
    return -np.sort(-np.column_stack([logs, -logs.sum(axis=1)]), axis=1)[:, :2]


def _tell_what_is_open(X: np.ndarray) -> None:
    """Warn of data that leave most of an energy open."""
    logs = ordered_logs(X)
    states = np.unique(logs[np.abs(logs).max(axis=1) > SAME_MODE].round(3), axis=0)
    if len(states) <= 1:
        warnings.warn(
            "the data are of one state: they tell one number, some shear modulus; how the stress rises with the stretch, and what it is "
            "in other modes of loading, is the guess of the sum of powers",
            stacklevel=3,
        )
    elif np.abs(logs @ line_through_rest(logs)[0]).max() < SAME_MODE:
        first, second = states[-1]
        mode = next((name for name, lateral in MODES.items() if abs(second - _second_of(first, lateral)) < SAME_MODE), "one mode")
        warnings.warn(
            f"the data are of one mode of loading ({mode}): what the stress is in others is not determined by them, as the share of the "
            "second invariant is not; add another mode, such as pure shear or equibiaxial tension",
            stacklevel=3,
        )


def _second_of(first: float, lateral) -> float:
    """Logarithm of the second of the ordered stretches where the first is pulled in a mode."""
    return float(ordered_logs(np.array([[np.exp(first), lateral(np.exp(first))]]))[0, 1])


def half_planes(X: np.ndarray) -> np.ndarray:
    """`EnergyRegressor.hull_` of stretches; of one mode of loading the line of it from rest."""
    logs = ordered_logs(X)
    off, along = line_through_rest(logs)
    if np.abs(logs @ off).max() < SAME_MODE:
        reach = np.append(logs @ along, 0.0)
        thick = np.abs(logs @ off).max()
        return np.array([[*off, -thick], [*-off, -thick], [*along, -reach.max()], [*-along, reach.min()]])
    return ConvexHull(np.vstack([logs, np.zeros(2)])).equations


def line_through_rest(logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors across and along the line through rest that states are nearest to."""
    along, off = np.linalg.svd(np.vstack([logs, np.zeros((2, 2))]), full_matrices=False)[2]
    return off, along


def dictionary(greatest: float, least: float, offset: float = 0.0) -> np.ndarray:
    """Exponents about from -least to -1 and from 1 to the greatest, all larger in size by an offset."""
    sizes = np.arange(LEAST_EXPONENT, max(greatest, least) + STEP / 2, STEP)
    return np.concatenate([-sizes[sizes <= least][::-1] - offset, sizes[sizes <= greatest] + offset])


def columns_of(stretches: np.ndarray, first: np.ndarray, terms) -> np.ndarray:
    """Nominal stress along the first stretch of every term of unit weight, shape (n_samples, n_terms).

    Parameters
    ----------
    stretches : ndarray, shape (n_samples, 3)
        Isochoric, that of the thickness last, whose stress is zero.
    first : ndarray, shape (n_samples,)
        Stretch along the stress, with its part of the volume.
    terms : sequence of float or tuple
        Exponents, or invariants with their power as in `INVARIANTS`.
    """
    powers = np.array([term for term in terms if not isinstance(term, tuple)])
    along, across = stretches[:, :1], stretches[:, 2:]
    columns = [(along**powers - across**powers) / powers]
    squares = stretches**2
    for which, power in (term for term in terms if isinstance(term, tuple)):
        if which == 1:
            slope = power * (squares.sum(axis=1) - 3) ** (power - 1)
            columns.append((slope * 2 * (squares[:, 0] - squares[:, 2]))[:, None])
        else:
            I2 = (1 / squares).sum(axis=1)
            slope = power * (I2**1.5 - SECOND_AT_REST) ** (power - 1) * 1.5 * np.sqrt(I2)
            columns.append((slope * 2 * (1 / squares[:, 2] - 1 / squares[:, 0]))[:, None])
    return np.hstack(columns) / first[:, None]


def fifths_of(X) -> np.ndarray:
    """Numbers from 0 to 4 that go round over the states, in the order of their greatest stretch; rows of one state have the same."""
    return np.unique(ordered_logs(X).round(9), axis=0, return_inverse=True)[1].ravel() % FOLDS


def groups_of(X) -> np.ndarray:
    """Modes of loading by the two stretches; what is of none is biaxial, in parts by its greater stretch."""
    first, second = X.T
    groups = np.full(len(X), BIAXIAL, dtype=object)
    biaxial = np.ones(len(X), dtype=bool)
    for mode, lateral in MODES.items():
        same = np.abs(np.log(second / lateral(first))) < SAME_MODE
        groups[same & biaxial] = mode
        biaxial &= ~same
    if biaxial.sum() > len(X) / 2:
        greater = X.max(axis=1)
        bounds = np.quantile(greater, np.arange(1, FOLDS) / FOLDS)
        return np.searchsorted(bounds, greater).astype(str)
    return groups.astype(str)
