"""Polynomial regression in a Chebyshev basis, as a scikit-learn regressor."""

from __future__ import annotations

from numbers import Integral
from typing import ClassVar

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_is_fitted, validate_data


class ChebyshevRegressor(RegressorMixin, BaseEstimator):
    """Least squares on products of Chebyshev polynomials of the features, up to a total degree.

    Features are mapped to [-1, 1] by their range in the training data.  No iteration and no random choice.

    Parameters
    ----------
    degree : int, default=6
        Total degree of the products.

    Attributes
    ----------
    powers_ : ndarray, shape (n_terms, n_features)
        Degree of each feature in each term.
    coef_ : ndarray, shape (n_terms, n_outputs)
    centre_, half_width_ : ndarray, shape (n_features,)
    n_features_in_ : int
    """

    _parameter_constraints: ClassVar = {"degree": [Interval(Integral, 0, 24, closed="both")]}

    def __init__(self, degree=6):
        self.degree = degree

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        return tags

    def fit(self, X, y):
        """Fit the coefficients.

        Parameters
        ----------
        X : array-like, shape (n_samples, n_features)
        y : array-like, shape (n_samples,) or (n_samples, n_outputs)

        Returns
        -------
        self
        """
        self._validate_params()
        X, y = validate_data(self, X, y, dtype=np.float64, multi_output=True, y_numeric=True)
        y = np.asarray(y, dtype=np.float64)
        self._single_output = y.ndim == 1
        low, high = X.min(axis=0), X.max(axis=0)
        self.centre_ = (low + high) / 2
        self.half_width_ = np.where(high > low, (high - low) / 2, 1.0)
        self.powers_ = np.array(list(_powers(X.shape[1], self.degree)))
        self.coef_ = np.linalg.lstsq(self._terms(X), y.reshape(len(X), -1), rcond=1e-13)[0]
        return self

    def predict(self, X):
        """Predict targets, shape (n_samples,) or (n_samples, n_outputs) as in training."""
        check_is_fitted(self)
        Y = self._terms(validate_data(self, X, dtype=np.float64, reset=False)) @ self.coef_
        return Y[:, 0] if self._single_output else Y

    def _terms(self, X):
        basis = np.polynomial.chebyshev.chebvander((X - self.centre_) / self.half_width_, self.degree)
        terms = np.ones((len(X), len(self.powers_)))
        for feature in range(X.shape[1]):
            terms *= basis[:, feature, self.powers_[:, feature]]
        return terms


def _powers(n_features, degree):
    """All degrees of `n_features` features that add up to at most `degree`."""
    if n_features == 0:
        yield ()
        return
    for first in range(degree + 1):
        for rest in _powers(n_features - 1, degree - first):
            yield (first, *rest)
