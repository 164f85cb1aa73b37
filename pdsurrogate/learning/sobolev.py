"""Networks fitted to a function and its gradient together (Sobolev training), as a scikit-learn
regressor.
"""

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils import check_random_state, column_or_1d
from sklearn.utils._param_validation import StrOptions
from sklearn.utils.validation import check_is_fitted, validate_data
from threadpoolctl import threadpool_limits

from ..kernels.network import ACTIVATIONS, SMOOTH
from .base import COUNT, NOT_NEGATIVE, POSITIVE
from .levenberg_marquardt import CONSTRAINTS, accepted_steps


@dataclass(eq=False, repr=False)
class SobolevRegressor(RegressorMixin, BaseEstimator):
    """A small network of one hidden layer, trained by the Levenberg-Marquardt algorithm on a scalar
    function and its gradient together.

    Targets of shape (n,) are values; targets of shape (n, 1 + n_features) are the value in the
    first column and its derivatives by the features in the others. Predictions have the shape of
    the targets, and the derivatives predicted are those of the value predicted.

    Parameters
    ----------
    n_units : int, default=12
    activation : {"algebraic", "logistic", "tanh"}, default="algebraic"
    gradient_weight : float, default=1.0
        Weight of the residuals of the derivatives relative to those of the values, each divided by
        their spread.
    anchor : array-like, shape (n_features,), default=None
        Features at which the function is exactly zero.
    flat : tuple of int, default=()
        Column indices of the features by which the derivative is exactly zero at the anchor.
    size : callable, default=None
        ``size(X)``, shape (n_samples,): known size of the function and its derivatives, by which
        residuals are divided.
    max_iter : int, default=400
        Most iterations, each an accepted step.
    alpha : float, default=1e-12
        Factor of the sum of squared output weights that is added to the mean squared residual (of
        order one), against large weights of opposite sign, whose sum would lose digits to rounding.
    tol : float, default=1e-3
        Training ends when the loss falls by less than this, relatively, over `n_iter_no_change`
        iterations.
    n_iter_no_change : int, default=50
    n_init : int, default=1
        Trainings from different first weights, of which the one with the least loss is kept.
    initial_damping : float, default=1e-2
        Marquardt's parameter at the start, relative to the diagonal of the normal matrix.
    random_state : int, RandomState instance or None, default=None
        Generator of the first weights.

    Attributes
    ----------
    hidden_weights_ : ndarray, shape (n_features, n_units)
    hidden_biases_, output_weights_ : ndarray, shape (n_units,)
    intercept_ : float
    slopes_ : ndarray, shape (n_features,)
        Coefficients of a linear function of ``X - anchor`` that is added to the network, so that
        the derivatives by the features `flat` vanish at the anchor.
    loss_ : float
        Mean squared residual of the values, divided by their variance.
    n_iter_ : int
    n_features_in_ : int

    References
    ----------
    Czarnecki et al., Sobolev training for neural networks, NeurIPS (2017); Marquardt, J. Soc. Ind.
    Appl. Math. 11 (1963) 431-441.

    See Also
    --------
    pdsurrogate.surrogate_pipeline : makes a surrogate of an energy with this regressor.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> regressor = pds.learning.SobolevRegressor(6, "algebraic", max_iter=100, random_state=0)
    >>> regressor.get_params()["max_iter"]
    100
    """

    n_units: int = 12
    activation: str = "algebraic"
    _: KW_ONLY
    gradient_weight: float = 1.0
    anchor: Sequence[float] | np.ndarray | None = None
    flat: Sequence[int] = ()
    size: Callable[[np.ndarray], np.ndarray] | None = None
    max_iter: int = 400
    alpha: float = 1e-12
    tol: float = 1e-3
    n_iter_no_change: int = 50
    n_init: int = 1
    initial_damping: float = 1e-2
    random_state: int | np.random.RandomState | None = None

    _parameter_constraints: ClassVar = {
        **CONSTRAINTS,
        "n_units": COUNT,
        "activation": [StrOptions(set(SMOOTH))],
        "gradient_weight": POSITIVE,
        "anchor": ["array-like", None],
        "flat": ["array-like"],
        "size": [callable, None],
        "alpha": NOT_NEGATIVE,
    }

    def fit(self, X, y):
        """Fit the network to values, or to values and their derivatives by the features.

        Parameters
        ----------
        X : array-like, shape (n_samples, n_features)
        y : array-like, shape (n_samples,) or (n_samples, 1 + n_features)

        Returns
        -------
        self

        Raises
        ------
        ValueError
            For parameters out of range, or data that scikit-learn would not accept.

        Examples
        --------
        The parabola and its slope:

        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> x = np.linspace(-1, 1, 40)[:, None]
        >>> model = pds.learning.SobolevRegressor(6, random_state=0).fit(
        ...     x, np.column_stack([x**2, 2 * x])
        ... )
        >>> model.loss_ < 1e-4
        True
        """
        self._validate_params()
        X, y = validate_data(self, X, y, dtype=np.float64, multi_output=True, y_numeric=True)
        d = X.shape[1]
        self._with_gradient = y.ndim == 2 and y.shape[1] == 1 + d
        if not self._with_gradient:
            y = column_or_1d(y, warn=True)[:, None]
        anchor = None if self.anchor is None else np.asarray(self.anchor, dtype=float).reshape(d)
        flat = list(self.flat)
        if flat and anchor is None:
            raise ValueError("flat needs an anchor: it names derivatives that vanish there")

        mean = X.mean(axis=0)
        spread = X.std(axis=0)
        spread[spread == 0] = 1.0
        if anchor is not None:
            mean = anchor  # the origin of the scaled features
        target = y * np.array([1.0, *spread])[: y.shape[1]]
        weight = (
            np.ones((len(X), 1))
            if self.size is None
            else 1 / np.asarray(self.size(X), dtype=float).reshape(len(X), 1)
        )
        # Residuals are divided by the spread of their targets: one scale for the value, one for all
        # derivatives.
        spreads = (weight * target).std(axis=0)
        unit = spreads[0] if spreads[0] > 0 else 1.0
        weights = np.repeat(weight / unit, target.shape[1], axis=1)
        if self._with_gradient:
            size = np.sqrt((spreads[1:] ** 2).mean())
            weights[:, 1:] = self.gradient_weight * weight / (size if size > 0 else 1.0)
        random = check_random_state(self.random_state)
        # all of order one
        function = _Function(self, (X - mean) / spread, target / unit, weights * unit)
        with threadpool_limits(1, user_api="blas"):
            trainings = [
                self._train(function, function.first(random), number)
                for number in range(self.n_init)
            ]
        _, theta, self.n_iter_ = min(trainings, key=lambda training: training[0])
        W, b, v, constant = function.parts(theta)
        self.hidden_weights_ = W / spread[:, None]
        self.hidden_biases_ = b - mean @ self.hidden_weights_
        self.output_weights_ = v * unit
        self.intercept_ = 0.0
        self.slopes_ = np.zeros(d)
        self.anchor_ = mean if anchor is not None else np.zeros(d)
        if anchor is None:
            self.intercept_ = constant * unit
        else:
            at = self._outputs(anchor[None])[0]
            self.intercept_ = -at[0]
            self.slopes_[flat] = -at[1:][flat]
        residual = (self._outputs(X)[:, 0] - y[:, 0]) * weight[:, 0]
        self.loss_ = float((residual**2).mean() / unit**2)
        return self

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "hidden_weights_")

    def predict(self, X):
        """Predict values, or values and their derivatives by the features, as in training.

        Parameters
        ----------
        X : array-like, shape (n_samples, n_features)

        Returns
        -------
        ndarray, shape (n_samples,) or (n_samples, 1 + n_features)

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> x = np.linspace(-1, 1, 40)[:, None]
        >>> model = pds.learning.SobolevRegressor(6, random_state=0).fit(
        ...     x, np.column_stack([x**2, 2 * x])
        ... )
        >>> model.predict([[0.6]]).round(1).tolist()
        [[0.4, 1.2]]
        """
        check_is_fitted(self)
        outputs = self._outputs(validate_data(self, X, dtype=np.float64, reset=False))
        return outputs if self._with_gradient else outputs[:, 0]

    def _outputs(self, X):
        parameters = self.hidden_weights_, self.hidden_biases_, self.output_weights_
        outputs = values_and_slopes(X, *parameters, self.activation, 1 + X.shape[1])
        outputs[:, 0] = outputs[:, 0] + self.intercept_ + (X - self.anchor_) @ self.slopes_
        outputs[:, 1:] += self.slopes_
        return outputs

    def _train(self, function, first, number):
        """Train the network from the parameters `first`; return the last loss, the last parameters,
        and the number of iterations.

        `function` is the network with its loss (`_Function`); `number` counts the trainings of a
        fit, from 0.
        """
        steps = [(first, function.loss(first))]
        waiting = self.n_iter_no_change
        for step in accepted_steps(self, number, first, function.loss, function.normal_equations):
            steps.append(step)
            if len(steps) > waiting + 1 and step[1] > (1 - self.tol) * steps[-1 - waiting][1]:
                break
        return steps[-1][1], steps[-1][0], len(steps) - 1


def values_and_slopes(X, W, b, v, activation: str, columns: int) -> np.ndarray:
    """Return the outputs of a network at X and, in further columns, their derivatives by the
    features, shape (n, columns).

    The output at features x is the sum of a(x W + b) times the output weights v, with weights W and
    biases b of the hidden layer and the activation a.
    """
    value, slope, _ = ACTIVATIONS[activation](X @ W + b)
    return np.column_stack([value @ v, (slope * v) @ W.T])[:, :columns]


class _Function:
    """Network of one hidden layer with its gradient and its loss at weighted samples, as functions
    of the vector theta of its parameters.

    With an anchor the features are measured from the anchor, which is the origin, and the network
    has no constant term: its value at the origin is subtracted from its outputs, and so is a linear
    function of the features ``flat``, so that the derivatives by these features vanish at the
    origin.
    """

    def __init__(self, regressor, X, Y, weights):
        self.X = X
        self.Y = Y
        self.weights = weights
        self.d = X.shape[1]
        self.columns = Y.shape[1]
        self.units = regressor.n_units
        self.activation = regressor.activation
        self.flat = regressor.flat
        self.anchored = regressor.anchor is not None
        self.penalty = np.zeros(self.units * (self.d + 2) + (not self.anchored))
        # of the output weights
        self.penalty[(self.d + 1) * self.units : (self.d + 2) * self.units] = (
            regressor.alpha * Y.size
        )

    def first(self, random):
        W = random.normal(size=(self.d, self.units)) * np.sqrt(2 / self.d)
        parts = [
            W.ravel(),
            random.uniform(-1.5, 1.5, self.units),
            0.1 * random.normal(size=self.units),
        ]
        return np.concatenate(parts if self.anchored else [*parts, [0.0]])

    def parts(self, theta):
        W = theta[: self.d * self.units].reshape(self.d, self.units)
        rest = theta[self.d * self.units :]
        return (
            W,
            rest[: self.units],
            rest[self.units : 2 * self.units],
            0.0 if self.anchored else rest[-1],
        )

    def loss(self, theta):
        residuals = (self._at_samples(self._outputs, theta) - self.Y) * self.weights
        return (residuals**2).mean() + (self.penalty * theta**2).sum() / self.Y.size

    def normal_equations(self, theta):
        residuals = (self._at_samples(self._outputs, theta) - self.Y) * self.weights
        A = (self._at_samples(self._jacobian, theta) * self.weights[:, :, None]).reshape(
            -1, theta.size
        )
        return A.T @ A + np.diag(self.penalty), A.T @ residuals.ravel() + self.penalty * theta

    def _at_samples(self, function, theta):
        """Return `function` (outputs or Jacobian) at the samples, shape (n, columns, ...).

        With an anchor, the value of `function` at the origin is subtracted, and so is a linear
        function of the features ``flat`` with the derivatives by them at the origin.
        """
        values = function(theta, self.X, self.columns)
        if self.anchored:
            origin = function(theta, np.zeros((1, self.d)), 1 + self.d)[0]
            shape = (-1, *[1] * (values.ndim - 2))
            values[:, 0] -= origin[0]
            for feature in self.flat:
                values[:, 0] -= self.X[:, feature].reshape(shape) * origin[1 + feature]
                if self.columns > 1:
                    values[:, 1 + feature] -= origin[1 + feature]
        return values

    def _outputs(self, theta, X, columns):
        *parameters, constant = self.parts(theta)
        outputs = values_and_slopes(X, *parameters, self.activation, columns)
        outputs[:, 0] += constant
        return outputs

    def _jacobian(self, theta, X, columns):
        """Return the derivatives of value and gradient of the network by its parameters, shape
        (n, columns, n_parameters).
        """
        W, b, v, _ = self.parts(theta)
        value, slope, curvature = ACTIVATIONS[self.activation](X @ W + b)
        slope_v = slope * v
        curvature_v = curvature * v
        by_b = np.stack([slope_v, *(curvature_v * row for row in W)][:columns], axis=1)
        by_v = np.stack([value, *(slope * row for row in W)][:columns], axis=1)
        by_W = X[:, None, :, None] * by_b[:, :, None]
        for feature in range(columns - 1):
            by_W[:, 1 + feature, feature] += slope_v
        by_constant = np.zeros((len(X), columns, 0 if self.anchored else 1))
        by_constant[:, 0] = 1
        return np.concatenate(
            [by_W.reshape(len(X), columns, W.size), by_b, by_v, by_constant], axis=2
        )
