"""Base of regressors that find a law from nominal stresses, and the stresses of a law."""

from collections.abc import Sequence
from numbers import Real
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

from ..arguments import check_kind, check_numbers, in_order
from ..materials import Law, homogeneous
from ..materials.covariance import LawCovariance, covariance_of_numbers
from .data import TestData

BULK_RATIO = 1000.0
"""Default of K/mu of a law.

Rubber has one thousand to ten thousand. At 100 the volume of Treloar's rubber would grow by 42 % at
its greatest stretch of 7.6, unlike that of any rubber, and the best fit of Ogden's law has an R^2
of 0.992 in tension; at 1000 the volume grows by 4 %, with 0.996, and an incompressible law has
0.997.
"""

BULK_CONSTRAINTS = {
    "bulk_ratio": [Interval(Real, 0, None, closed="neither")],
    "bulk_modulus": [None, Interval(Real, 0, None, closed="neither")],
}
"""Permitted values of the regressors' parameters ``bulk_ratio`` and ``bulk_modulus``, in the
form that scikit-learn validates.
"""

FREE_SIDES = 1e-4
"""Greatest difference, in log-stretch, of a lateral stretch from stretch**-0.5 at which the
sides count as free: data have four digits.
"""


def bulk_arguments(**given: float | None) -> dict[str, float]:
    """Return `bulk_modulus` or `bulk_ratio`, whichever is not None, as arguments of a regressor:
    none if both are None.

    Raise ValueError if neither is None.
    """
    found = {key: value for key, value in given.items() if value is not None}
    if len(found) > 1:
        raise ValueError(
            "bulk_modulus and bulk_ratio exclude each other: choose one (--bulk-modulus or"
            " --bulk-ratio)"
        )
    return found


def nominal_stress(law: Law, stretches: np.ndarray) -> np.ndarray:
    """Return the nominal stress of a law along the first of two stretches in the plane; NaN past
    the limit of the law.

    Parameters
    ----------
    law : Law
    stretches : ndarray, shape (n, 2)
        Stretches along the stress and across it. A second stretch equal to the first to the power
        -1/2 means uniaxial tension with free sides: the lateral stretch is then the one at which
        the lateral stress is zero. The thickness is always free.

    Returns
    -------
    ndarray, shape (n,)
        Stress in the same unit as the shear modulus of the law.
    """
    return states(law, stretches)[0]


def states(law: Law, stretches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return nominal stress and volume ratio J3 of a law, each of shape (n,), at pairs of
    stretches as in `nominal_stress`.
    """
    return homogeneous.sheet_states(law, *sheet_of(stretches))


def sheet_of(stretches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return stretches along the stress and across it, each of shape (n,), the latter NaN for
    free sides, from pairs (n, 2).
    """
    first, second = np.asarray(stretches, dtype=float).T
    return first, np.where(free_sides(first, second), np.nan, second)


def free_sides(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return a mask, shape (n,), of the states that are uniaxial tension or compression along
    the first stretch with free sides.
    """
    return np.abs(np.log(second) + np.log(first) / 2) < FREE_SIDES


def incompressible_stress(law: Law, stretches: np.ndarray) -> np.ndarray:
    """Return the nominal stress of a law, shape (n,), for an infinite bulk modulus: volume ratio
    1, and no stress across the thickness.
    """
    first, second = stretches.T
    return homogeneous.sheet_response(law, first, second)(np.ones_like(first))[0]


class LawEstimator(RegressorMixin, BaseEstimator):
    """Base of regressors that find a law.

    A subclass sets ``law_`` and the parameters with their covariance in ``fit``, which begins with
    `_begin_fit`; its method ``_law_of`` returns the law with given values of the parameters.
    """

    law_: Law
    parameter_names_: list[str]
    parameters_: np.ndarray
    covariance_: np.ndarray
    standard_errors_: np.ndarray
    at_bound_: list[str]

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.regressor_tags.poor_score = True
        return tags

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "law_")

    def law_covariance(self) -> LawCovariance:
        """Return the covariance of the numbers of the fitted law, with which
        `pdsurrogate.Result.standard_errors` propagates it to results.

        Returns
        -------
        LawCovariance
            From `covariance_`, with the numbers that follow from the parameters, such as the bulk
            modulus from K/mu.

        Raises
        ------
        ValueError
            If the measurements do not determine a parameter, or a parameter is at a bound of the
            search.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> data = pds.load_test_data("treloar")
        >>> found = pds.identification.LawRegressor("gent").fit(data.stretches, data.nominal_stress)
        >>> found.law_covariance().names
        ('shear_modulus', 'bulk_modulus', 'chain_limit')
        """
        check_is_fitted(self)
        return covariance_of_numbers(
            self._law_of, self.parameter_names_, self.parameters_, self.covariance_, self.at_bound_
        )

    def forget(self) -> None:
        """Delete the results of a fit from the regressor, which is unfitted afterwards.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> data = pds.load_test_data("treloar").up_to(3.0)
        >>> found = pds.identification.LawRegressor().fit(data.stretches, data.nominal_stress)
        >>> found.forget()
        >>> hasattr(found, "law_")
        False
        """
        for key in [key for key in vars(self) if key.endswith("_")]:
            delattr(self, key)

    def _begin_fit(self) -> None:
        """Delete the results of an earlier fit, which must not outlive a failed one; raise an
        error for a parameter of a wrong kind.
        """
        self.forget()
        self._validate_params()
        for name, kinds in self._parameter_constraints.items():
            if any(isinstance(kind, Interval) for kind in kinds):
                # scikit-learn takes True for 1
                check_kind(getattr(self, name), object, name, "a number")

    def _checked(self, X, y, sample_weight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Check the data; return the table, the measurements and their weights."""
        columns = ", ".join(self.columns or ("of numbers",))
        for values, what, wanted in (
            (X, "X", f"it must have the columns {columns}, and a row for each measurement"),
            (y, "y", "give a measured value for each row of X"),
            (sample_weight, "sample_weight", "give a number for each row of X"),
        ):
            check_numbers(values, what, wanted)
        X, y = validate_data(
            self, in_order(X, self.columns, "X"), y, dtype=np.float64, y_numeric=True
        )
        weight = _check_sample_weight(sample_weight, X, dtype=np.float64, ensure_non_negative=True)
        if not weight.any():
            raise ValueError("all sample weights are zero")
        return X, y, weight


class StressRegressor(LawEstimator):
    """Base of regressors that find a law from nominal stresses.

    A subclass implements ``fit``, which takes its data from `_used` and ends with `_store`, and
    ``law_of``, which returns the law with given values of the fitted parameters. It has the
    parameters `bulk_ratio` and `bulk_modulus`.
    """

    columns = ("stretch", "lateral_stretch")

    over_time: ClassVar[bool] = False
    """Whether the stresses depend on the order of the rows: on earlier stretches."""

    @property
    def form(self) -> str:
        """Fitted form in words: the name of the law.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.identification.LawRegressor("gent").form
        'gent'
        """
        return self.law

    def rows_of(self, data: TestData) -> np.ndarray:
        """Return the rows of test data as `fit` and `predict` take them.

        Parameters
        ----------
        data : TestData

        Returns
        -------
        ndarray, shape (n_samples, n_columns)

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.identification.LawRegressor().rows_of(pds.load_test_data("treloar")).shape[1]
        2
        """
        return data.stretches

    def fit_tests(self, data: TestData) -> Self:
        """Fit to test data, with modes of loading weighted by their scatter, or, over time, with
        their own weights.

        Parameters
        ----------
        data : TestData

        Returns
        -------
        self

        See Also
        --------
        pdsurrogate.fit_to_tests : also examines data and fit.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> data = pds.load_test_data("treloar").up_to(3.0)
        >>> pds.identification.LawRegressor("gent").fit_tests(data).law_.name
        'gent'
        """
        weights = data.weight if self.over_time else data.balanced_weights()
        return self.fit(self.rows_of(data), data.nominal_stress, weights)

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.positive_only = True
        return tags

    def predict(self, X: ArrayLike) -> np.ndarray:
        """Return nominal stresses of the fitted law.

        Parameters
        ----------
        X : array-like, shape (n_samples, 2)
            Stretches along the stress and across it; a table (pandas) has the columns ``stretch``
            and ``lateral_stretch`` in any order.

        Returns
        -------
        ndarray, shape (n_samples,)
            Nominal stresses in the unit of the data; NaN past the limit of the law.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> data = pds.load_test_data("treloar").up_to(3.0)
        >>> found = pds.identification.LawRegressor().fit(data.stretches, data.nominal_stress)
        >>> found.predict([[1.0, 1.0]]).round(6).tolist()
        [0.0]
        """
        check_is_fitted(self)
        X = validate_data(self, in_order(X, self.columns, "X"), dtype=np.float64, reset=False)
        return nominal_stress(self.law_, self._stretches(X))

    def _law_of(self, values: ArrayLike) -> Law:
        return self.law_of(values)

    def _stretches(self, X) -> np.ndarray:
        """Return X; raise ValueError unless it has two columns of positive stretches."""
        if X.shape[1] != 2:
            raise ValueError(
                "X must have two columns, the stretch along the stress and the one across it, but"
                f" n_features = {X.shape[1]}"
            )
        if not (X > 0).all():
            raise ValueError(
                f"Negative values in data passed to {type(self).__name__}: a stretch must be"
                f" positive, not {X.min():g}"
            )
        return X

    def _used(self, X, y, sample_weight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Begin a fit: check the data; return stretches, stresses and roots of weights for the
        rows of positive weight.
        """
        self._begin_fit()
        X, y, weight = self._checked(X, y, sample_weight)
        used = weight > 0
        return self._stretches(X)[used], y[used], np.sqrt(weight[used])

    def _bulk(self, shear_modulus: float) -> float:
        """Return the bulk modulus of a law with a shear modulus: the parameter `bulk_modulus`,
        or `bulk_ratio` times the shear modulus.
        """
        return self.bulk_modulus or self.bulk_ratio * shear_modulus

    def _store(
        self,
        law: Law,
        names: Sequence[str],
        values,
        covariance: np.ndarray,
        at_bound: Sequence[str] = (),
    ) -> None:
        """Set the results of a fit: the law, its parameters, and their covariance."""
        self.law_ = law
        self.parameter_names_ = list(names)
        self.parameters_ = values
        self.at_bound_ = list(at_bound)
        self.covariance_ = covariance
        self.standard_errors_ = np.sqrt(np.diag(covariance))
