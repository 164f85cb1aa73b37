"""Polynomial regression in a Chebyshev basis, as a scikit-learn regressor."""

from itertools import islice
from math import comb
from numbers import Integral
from typing import ClassVar

import numpy as np
from sklearn.utils._param_validation import Interval

from ..kernels.polynomial import MOST_DEGREE
from .base import BaseRegressor

MOST_TERMS = 10_000
"""Most terms of a polynomial: with as many samples the matrix of the least squares has 0.8 GB."""


class ChebyshevRegressor(BaseRegressor):
    """Least-squares fit of products of Chebyshev polynomials of the features, up to a total degree.

    Features are mapped to [-1, 1] by their range in the training data. The fit has no iterations
    and no random choices.

    Parameters
    ----------
    degree : int or tuple of int, default=6
        Greatest total degree of a product; or a greatest degree for each feature: the degrees of
        the features in a product, each divided by the greatest degree of the feature, then add up
        to at most 1.

    Attributes
    ----------
    powers_ : ndarray, shape (n_terms, n_features)
        Degree of each feature in each term.
    coef_ : ndarray, shape (n_terms, n_outputs)
    center_, half_width_ : ndarray, shape (n_features,)
        Map of the features to [-1, 1].
    n_features_in_ : int

    See Also
    --------
    pdsurrogate.LevenbergMarquardtRegressor : a network.
    pdsurrogate.surrogate_pipeline : makes a surrogate of a regressor.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> import numpy as np
    >>> x = np.linspace(-1, 1, 50)[:, None]
    >>> model = pds.learning.ChebyshevRegressor(6).fit(x, np.exp(x))
    >>> bool(np.abs(model.predict(x) - np.exp(x)).max() < 1e-5)
    True
    """

    _parameter_constraints: ClassVar = {
        "degree": [Interval(Integral, 0, MOST_DEGREE, closed="both"), tuple]
    }

    def __init__(self, degree=6):
        self.degree = degree

    def fit(self, X, y):
        """Fit the coefficients of the polynomial by least squares.

        Parameters
        ----------
        X : array-like, shape (n_samples, n_features)
        y : array-like, shape (n_samples,) or (n_samples, n_outputs)

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If the degrees make more than `MOST_TERMS` terms; the message names the greatest degree
            that makes no more.

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> x = np.linspace(-1, 1, 50)[:, None]
        >>> pds.learning.ChebyshevRegressor(3).fit(x, x[:, 0] ** 2).powers_.ravel().tolist()
        [0, 1, 2, 3]
        """
        X, Y = self._checked(X, y)
        low = X.min(axis=0)
        high = X.max(axis=0)
        self.center_ = (low + high) / 2
        self.half_width_ = np.where(high > low, (high - low) / 2, 1.0)
        self.powers_ = self._checked_powers(X.shape[1])
        # Terms that the samples do not determine within rounding are left out.
        self.coef_ = np.linalg.lstsq(self._terms(X), Y, rcond=1e-13)[0]
        return self

    def __setstate__(self, state):
        """Restore a pickled regressor; regressors pickled before release 0.2 call `center_` by
        its British spelling.
        """
        super().__setstate__(
            {"center_" if key == "centre_" else key: value for key, value in state.items()}
        )

    def _outputs(self, X):
        return self._terms(X) @ self.coef_

    def _checked_powers(self, n_features):
        """Return the degree of each feature in each term, shape (n_terms, n_features); raise
        ValueError for invalid or too high degrees.
        """
        degrees = (
            [self.degree] * n_features if isinstance(self.degree, Integral) else list(self.degree)
        )
        if len(degrees) != n_features or not all(
            isinstance(value, Integral) and 0 <= value <= MOST_DEGREE for value in degrees
        ):
            raise ValueError(
                f"degree must be one number from 0 to {MOST_DEGREE} for each of the {n_features}"
                f" features, not {self.degree}"
            )
        powers = list(islice(_powers([int(value) for value in degrees], 1.0), MOST_TERMS + 1))
        if len(powers) > MOST_TERMS:
            most = max(
                degree
                for degree in range(MOST_DEGREE + 1)
                if comb(n_features + degree, degree) <= MOST_TERMS
            )
            raise ValueError(
                f"degree {self.degree} makes more than {MOST_TERMS} terms: use at most {most}, or"
                " lower single degrees"
            )
        return np.array(powers)

    def _terms(self, X):
        """Return the values of all terms of the polynomial at X, shape (n_samples, n_terms)."""
        basis = np.polynomial.chebyshev.chebvander(
            (X - self.center_) / self.half_width_, self.powers_.max()
        )
        terms = np.ones((len(X), len(self.powers_)))
        for feature in range(X.shape[1]):
            terms *= basis[:, feature, self.powers_[:, feature]]
        return terms


def _powers(degrees, share):
    """Yield all tuples (d_1, ..., d_n) of powers for which the sum of d_i/D_i is at most
    `share`, with `degrees` (D_1, ..., D_n).
    """
    if not degrees:
        yield ()
        return
    greatest, *others = degrees
    for first in range(int(greatest * share + 1e-9) + 1):
        for rest in _powers(others, share - (first / greatest if greatest else 0.0)):
            yield (first, *rest)
