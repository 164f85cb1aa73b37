"""Base of the regressors of nominal stresses by stretches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

from ..arguments import in_order
from ..materials import Law, homogeneous, plane_stress

WELL_POSED = 1e14
"""Greatest condition of the normal equations of the parameters that has standard errors come of them."""


BULK_RATIO = 1000.0
"""K over mu of a law whose bulk modulus nobody gives.

Rubber has some thousand to ten thousand.  At 100 the volume of Treloar's rubber would grow by 42 % at its greatest stretch of 7.6, which
no rubber's does, and the best fit of Ogden's law has an R^2 of 0.992 in tension; at 1000 by 4 %, with 0.996, and 0.997 without bound.
"""

FREE_SIDES = 1e-4
"""How far, in log-stretch, a lateral stretch may be off stretch**-0.5 for the sides to be taken as free."""


def nominal_stress(law: Law, stretches: np.ndarray) -> np.ndarray:
    """Nominal stress along the first of two stretches in the plane, of the law with its bulk modulus; NaN past the law's limit.

    Parameters
    ----------
    law : Law
    stretches : ndarray, shape (n, 2)
        Along the stress and across it.  A second one that is the first to the power -1/2 says that it is uniaxial tension of rubber
        whose sides are free: there the lateral stretch is the one at which their stress is zero.  The thickness is free always.

    Returns
    -------
    ndarray, shape (n,)
        In the unit of the law's shear modulus.
    """
    return states(law, stretches)[0]


def states(law: Law, stretches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nominal stress and volume ratio J3 of the same states, each of shape (n,)."""
    first, second = np.asarray(stretches, dtype=float).T
    return homogeneous.sheet_states(law, first, np.where(free_sides(first, second), np.nan, second))


def free_sides(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return which states are uniaxial tension or compression along the first stretch, bool, shape (n,)."""
    return np.abs(np.log(second) + np.log(first) / 2) < FREE_SIDES


def incompressible_stress(law: Law, stretches: np.ndarray) -> np.ndarray:
    """Nominal stress in the limit of an infinite bulk modulus, shape (n,): at J3 = 1, P33 = 0 having eliminated the pressure."""
    first, second = stretches.T
    with np.errstate(all="ignore"):
        p, q, *_ = plane_stress.response(law, first**2 + second**2, first * second, np.ones_like(first))
    return law.shear_modulus * (p * first + q / first)


class StressRegressor(RegressorMixin, BaseEstimator):
    """Base of regressors that find an energy, as a law, from nominal stresses.

    A subclass writes `fit`: it takes its data from `_checked` and ends with `_store`, which keeps the law, its parameters and their errors.
    """

    columns = ("stretch", "lateral_stretch")

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.positive_only = True
        tags.regressor_tags.poor_score = True
        return tags

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "law_")

    def predict(self, X: ArrayLike) -> np.ndarray:
        """Nominal stress, shape (n_samples,); NaN past the law's limit.  Tables are read by the names of their columns, as in `fit`."""
        check_is_fitted(self)
        X = validate_data(self, in_order(X, self.columns, "X"), dtype=np.float64, reset=False)
        return nominal_stress(self.law_, self._stretches(X))

    def redrawn(self, random: np.random.Generator) -> StressRegressor:
        """Return an unfitted copy for a committee, with random values of settings that neither the data nor the user determine."""
        return clone(self)

    def forget(self) -> None:
        """Drop everything that a training found, so that the regressor is not fitted."""
        for key in [key for key in vars(self) if key.endswith("_")]:
            delattr(self, key)

    def _stretches(self, X: np.ndarray) -> np.ndarray:
        """Two columns of positive stretches; a ValueError if they are not."""
        if X.shape[1] != 2:
            raise ValueError(f"X must have two columns, the stretch along the stress and the one across it, but n_features = {X.shape[1]}")
        if not (X > 0).all():
            raise ValueError(f"Negative values in data passed to {type(self).__name__}: a stretch must be positive, not {X.min():g}")
        return X

    def _checked(self, X, y, sample_weight) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Checked data: stretches, stresses and roots of weights of rows with a weight above zero, and which they are."""
        self.forget()  # a training that fails leaves nothing of an earlier one
        self._validate_params()
        X, y = validate_data(self, in_order(X, self.columns, "X"), y, dtype=np.float64, y_numeric=True)
        root = np.sqrt(_check_sample_weight(sample_weight, X, dtype=np.float64, ensure_non_negative=True))
        used = root > 0
        if not used.any():
            raise ValueError("all sample weights are zero")
        X = self._stretches(X)
        return X[used], y[used], root[used], used

    def _store(
        self, law: Law, names: Sequence[str], values: np.ndarray, jacobian: np.ndarray, squares: float, at_bound: Sequence[str] = ()
    ) -> None:
        """Keep what was found.

        Parameters
        ----------
        law : Law
        names : sequence of str
            Of the parameters.
        values : ndarray, shape (n_parameters,)
        jacobian : ndarray, shape (n_samples, n_parameters)
            Of the weighted residuals by the parameters.
        squares : float
            Sum of the squares of the weighted residuals.
        at_bound : sequence of str
        """
        self.law_, self.parameter_names_, self.parameters_, self.at_bound_ = law, list(names), values, list(at_bound)
        n_samples, count = jacobian.shape
        size = np.linalg.norm(jacobian, axis=0)
        size[size == 0] = 1.0
        information = (jacobian / size).T @ (jacobian / size)
        if n_samples > count and np.linalg.cond(information) < WELL_POSED:
            self.covariance_ = squares / (n_samples - count) * np.linalg.inv(information) / np.outer(size, size)
        else:
            self.covariance_ = np.full((count, count), np.inf)
        self.standard_errors_ = np.sqrt(np.diag(self.covariance_))
