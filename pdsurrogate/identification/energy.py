"""An energy from test data without a law: a sum of powers of the stretches, each with a weight that is not negative."""

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

from ..materials import Ogden
from .data import BIAXIAL, MODES
from .stress_regressor import StressRegressor

LEAST_EXPONENT = 1.0
"""Powers of at least 1 of the principal stretches, and of their products two by two, are convex functions of F and of its cofactor."""

STEP = 0.25
"""Between the exponents of the dictionary."""

POSITIVE, NEGATIVE = (3.0, 5.0, 8.0, 12.0), (1.0, 2.0, 4.0, 6.0)
"""Greatest exponents, of powers of the stretches and of those of their inverses, among which cross-validation chooses."""

AS_GOOD = 0.05
"""Of two dictionaries whose errors differ by no more, the smaller is taken."""

FOLDS = 5
"""Of a biaxial grid, by its greatest stretch."""

SAME_MODE = 0.01
"""How far a lateral stretch may be off that of a mode of loading to be taken for it."""


class EnergyRegressor(StressRegressor):
    """An isochoric energy fitted to nominal stresses, without a law.

    W is the sum of c_a/a^2 (l1^a + l2^a + l3^a - 3) over a dictionary of exponents a of size 1 or more, of either sign, with c_a >= 0
    (a separable energy, after Valanis and Landel).  What physics asks for holds whatever the data are: energy and stress vanish at rest;
    l^a summed is a convex function of F for a >= 1, and for a <= -1 of its cofactor, so W is polyconvex among deformations that keep the
    volume, and shear waves are stable in all states; it grows without bound.  Beyond the data it goes on as these powers do.

    Stresses are linear in c, so the fit is one of non-negative least squares, with no start and no random choice; few terms are left.
    How far the exponents reach is chosen by cross-validation over modes of loading, or over parts of a biaxial grid.  Rubber is taken as
    incompressible.

    Parameters
    ----------
    max_terms : int, default=8
        Those with the least part in the stress are left out beyond so many.
    margin : float, default=0.05
        By which the hull of the data is taken to hold beyond them, in log-stretch.
    bulk_ratio : float, default=100
        K/mu of the law that comes out: such tests do not tell it.
    offset : float, default=0.0
        By which the sizes of the exponents begin beyond 1; less than their step of 0.25.  Nothing tells where the grid of exponents
        stands: members of a committee draw it.

    Attributes
    ----------
    law_ : Ogden
        The energy, as a law that every force model takes.
    exponents_, weights_ : ndarray, shape (n_terms,)
        a and c_a, in the unit of the stresses; half of the sum of the weights is the shear modulus.
    parameter_names_, parameters_, covariance_, standard_errors_, at_bound_
        Weights with their covariance and standard errors, the exponents taken as given.
    cross_validation_ : list of dict
        ``greatest``, ``least`` exponent, and the relative RMS error of what was left out.
    hull_ : ndarray, shape (n, 3)
        Half-planes (n1, n2, -d) of the convex hull of the data and of rest, n . x <= d, with x the logarithms of the two greater of the
        three stretches of a state, the greatest first: an isotropic energy does not know which way they point.
    stretch_range_ : tuple of float
        Least and greatest stretch of the data.
    n_features_in_ : int

    References
    ----------
    Valanis, Landel, J. Appl. Phys. 38 (1967) 2997; Ball, Arch. Rat. Mech. Anal. 63 (1977) 337; Ogden 1972.

    Examples
    --------
    >>> import pdsurrogate as pd
    >>> data = pd.load_test_data("treloar").up_to(3.0)
    >>> found = pd.EnergyRegressor().fit(data.stretches, data.nominal_stress)
    >>> found.law_.name
    'ogden'
    """

    _parameter_constraints: ClassVar = {
        "max_terms": [Interval(Integral, 1, 8, closed="both")],
        "margin": [Interval(Real, 0, 1, closed="both")],
        "bulk_ratio": [Interval(Real, 0, None, closed="neither")],
        "offset": [Interval(Real, 0, STEP, closed="left")],
    }

    law = "energy"
    """Its name in reports, where a `LawRegressor` names its law."""

    def __init__(self, max_terms=8, margin=0.05, bulk_ratio=100.0, offset=0.0):
        self.max_terms = max_terms
        self.margin = margin
        self.bulk_ratio = bulk_ratio
        self.offset = offset

    def redrawn(self, random):
        """A copy with another offset of the exponents."""
        return super().redrawn(random).set_params(offset=random.uniform(0, STEP))

    def fit(self, X, y, sample_weight=None, groups=None):
        """Fit the weights.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2)
            Stretch in the direction of the stress, and across it.
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
        most = (1 + AS_GOOD) * min(row["relative_rms"] for row in self.cross_validation_) + 1e-9
        chosen = next(row for row in self.cross_validation_ if row["relative_rms"] <= most)
        exponents, weights = self._fitted(X, y, root, dictionary(chosen["greatest"], -chosen["least"], self.offset))
        if not weights.sum() > 0:
            warnings.warn("no rubber has such stresses: they do not rise with the stretch, and next to nothing is fitted", stacklevel=2)
            exponents, weights = np.array([2.0]), np.array([1e-6 * max(np.abs(y).max(), 1e-300)])
        modulus = float(weights.sum() / 2)
        # A term of Ogden's law is mu_k/alpha_k (…): mu_k alpha_k is the weight.
        law = Ogden(modulus, self.bulk_ratio * modulus, tuple(weights / exponents), tuple(exponents))
        columns = root[:, None] * stresses(X, exponents)
        squares = ((columns @ weights - root * y) ** 2).sum()
        self._store(law, [f"weight of exponent {exponent:g}" for exponent in exponents], weights, columns, squares)
        self.exponents_, self.weights_ = exponents, weights
        self.stretch_range_ = float(X.min()), float(X.max())
        self.hull_ = half_planes(X)
        return self

    def beyond(self, X) -> np.ndarray:
        """How far states are beyond the hull of the data, in log-stretch, shape (n_samples,); 0 and less within it and its margin."""
        check_is_fitted(self)
        logs = ordered_logs(self._stretches(np.asarray(X, dtype=float)))
        return (logs @ self.hull_[:, :2].T + self.hull_[:, 2]).max(axis=1) - self.margin

    def domain_hull(self) -> list[list[float]]:
        """Half-planes (n1, n2, d) of the hull with its margin, as `pdsurrogate.forces.Domain` has them."""
        check_is_fitted(self)
        return [[n1, n2, self.margin - offset] for n1, n2, offset in self.hull_.tolist()]

    def _cross_validated(self, X, y, root, groups) -> list[dict]:
        rows, kinds = [], np.unique(groups)
        for greatest, least in product(POSITIVE, NEGATIVE):
            exponents, error, size = dictionary(greatest, least, self.offset), 0.0, 0.0
            for kind in kinds if len(kinds) > 1 else ():
                left = groups == kind
                found = self._fitted(X[~left], y[~left], root[~left], exponents)
                error += ((root[left] * (stresses(X[left], found[0]) @ found[1] - y[left])) ** 2).sum()
                size += ((root[left] * y[left]) ** 2).sum()
            rows.append({"greatest": greatest, "least": -least, "relative_rms": float(np.sqrt(error / size)) if size > 0 else 0.0})
        return rows

    def _fitted(self, X, y, root, exponents) -> tuple[np.ndarray, np.ndarray]:
        """Exponents with a weight, and the weights."""
        while True:
            columns = root[:, None] * stresses(X, exponents)
            size = np.linalg.norm(columns, axis=0)
            size[size == 0] = 1.0  # data at rest tell nothing
            weights = nnls(columns / size, root * y)[0]
            kept = weights > 1e-9 * max(weights.max(), 1e-300)
            if kept.sum() <= self.max_terms:
                return exponents[kept], (weights / size)[kept]
            # The least part in the stress.
            exponents = np.delete(exponents[kept], weights[kept].argmin())


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


def stresses(X, exponents) -> np.ndarray:
    """Nominal stress along the first stretch of every term of unit weight, shape (n_samples, n_terms)."""
    thickness = 1 / X.prod(axis=1)
    return (X[:, :1] ** exponents - thickness[:, None] ** exponents) / X[:, :1] / exponents


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
