"""Base classes of the regressors that learn forces and energies: checked data, activations,
predictions in the shape of the targets.

The module also holds `NamedFunction`: a function in a pipeline with the names of the table columns
that it reads, by which pipelines check and order the columns of tables.
"""

from collections.abc import Callable
from functools import update_wrapper
from numbers import Integral, Real

import numpy as np
from scipy.special import expit
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_is_fitted, validate_data

from ..kernels.network import network_outputs

COUNT = [Interval(Integral, 1, None, closed="left")]
NOT_NEGATIVE = [Interval(Real, 0, None, closed="left")]
POSITIVE = [Interval(Real, 0, None, closed="neither")]
SHARE = [Interval(Real, 0, 1, closed="left")]
"""Constraints on parameters of estimators, for scikit-learn's validation: whole numbers from 1;
numbers from 0, above 0, and in [0, 1).
"""


def algebraic(x):
    """Return x / sqrt(1 + x^2) and its derivative."""
    inverse = 1 / np.sqrt(1 + x * x)
    return x * inverse, inverse**3


def logistic(x):
    """Return 1 / (1 + exp(-x)) and its derivative."""
    value = expit(x)
    return value, value * (1 - value)


def tanh(x):
    """Return the hyperbolic tangent and its derivative."""
    value = np.tanh(x)
    return value, 1 - value * value


def relu(x):
    """Return max(x, 0) and its derivative."""
    return np.maximum(x, 0), (x > 0).astype(float)


ACTIVATIONS = {function.__name__: function for function in (algebraic, logistic, tanh, relu)}
"""Functions ``f(x) -> (value, derivative)`` by name; the kernels have all of them.

The values differ from those of `pdsurrogate.kernels.network` by rounding, some 1e-15. A training
magnifies such differences into other weights: only these expressions reproduce the weights of the
shipped artifacts (``pipelines/fit_shipped.py --check``).
"""


class BaseRegressor(RegressorMixin, BaseEstimator):
    """Base class of regressors of one or several outputs; predictions have one dimension where the
    training targets had one.

    A subclass implements ``fit``, which takes its data from `_checked`, and ``_outputs``, which
    returns the outputs of X, shape (n_samples, n_outputs). A regressor is fitted once it has the
    attribute ``coef_`` or ``coefs_``.
    """

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        return tags

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "coef_") or hasattr(self, "coefs_")

    def predict(self, X):
        """Predict targets.

        Parameters
        ----------
        X : array-like, shape (n_samples, n_features)

        Returns
        -------
        ndarray, shape (n_samples,) or (n_samples, n_outputs)
            As the targets in training.

        Raises
        ------
        NotFittedError
            Before `fit`.

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> x = np.linspace(-1, 1, 50)[:, None]
        >>> pds.learning.ChebyshevRegressor(2).fit(x, x[:, 0] ** 2).predict([[0.5]]).round(
        ...     6
        ... ).tolist()
        [0.25]
        """
        check_is_fitted(self)
        outputs = self._outputs(validate_data(self, X, dtype=np.float64, reset=False))
        return outputs[:, 0] if self._single_output else outputs

    def _checked(self, X, y) -> tuple[np.ndarray, np.ndarray]:
        """Check parameters and data; return X, and y in two dimensions (n_samples, n_outputs)."""
        self._validate_params()
        X, y = validate_data(self, X, y, dtype=np.float64, multi_output=True, y_numeric=True)
        self._single_output = y.ndim == 1
        return X, np.asarray(y, dtype=np.float64).reshape(len(X), -1)


class BasePerceptron(BaseRegressor):
    """Base class of multilayer perceptrons, which predict from ``coefs_``, ``intercepts_`` and
    the parameter ``activation``.
    """

    def _outputs(self, X):
        return network_outputs(
            X, zip(self.coefs_, self.intercepts_, strict=True), ACTIVATIONS[self.activation]
        )


class NamedFunction:
    """Function of a module with the names of the table columns of X and y that it reads; None
    stands for columns of any names.

    The ``repr`` is the name of the function. A pickle holds only module and name, as the pickle of
    a plain function does.
    """

    __name__: str
    __qualname__: str

    def __init__(
        self,
        function: Callable,
        columns: tuple[str, ...] | None = None,
        targets: tuple[str, ...] | None = None,
    ) -> None:
        update_wrapper(self, function)
        self.columns = columns
        self.targets = targets

    def __call__(self, *args, **kwargs):
        return self.__wrapped__(*args, **kwargs)

    def __repr__(self) -> str:
        return self.__name__

    def __reduce__(self) -> str:
        return self.__qualname__


def named(
    columns: tuple[str, ...] | None = None, targets: tuple[str, ...] | None = None
) -> Callable[[Callable], NamedFunction]:
    """Return a decorator that makes a function a `NamedFunction` with the names `columns` of
    columns of X and `targets` of columns of y.
    """
    return lambda function: NamedFunction(function, columns, targets)


def columns_read(function) -> tuple[tuple[str, ...] | None, tuple[str, ...] | None]:
    """Return the names of the columns of X and of y that a function (or its
    ``functools.partial``) reads; None where it states none.
    """
    function = getattr(function, "func", function)
    return getattr(function, "columns", None), getattr(function, "targets", None)


def check_targets(y, names) -> None:
    """Raise ValueError unless the targets y have two dimensions and one column for each of
    `names`.
    """
    if np.shape(y)[1:] != (len(names),):
        raise ValueError(
            f"y must have the {len(names)} columns {', '.join(names)}, not shape {np.shape(y)}"
        )


def checked_columns(X, columns: tuple[str, ...], positive: tuple[str, ...]) -> np.ndarray:
    """Return X transposed, shape (n_columns, n); raise ValueError for missing columns, or values
    of `positive` columns not above 0.
    """
    X = np.asarray(X, dtype=float)
    if X.ndim != 2 or X.shape[1] != len(columns):
        raise ValueError(
            f"X must have the {len(columns)} columns {', '.join(columns)}, not shape {X.shape}"
        )
    for name in positive:
        values = X[:, columns.index(name)]
        if not (values > 0).all():
            raise ValueError(f"{name} must be positive; the least given is {values.min():g}")
    return X.T
