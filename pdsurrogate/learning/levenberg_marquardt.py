"""Multilayer perceptrons trained by the Levenberg-Marquardt algorithm, as a scikit-learn regressor."""

from __future__ import annotations

from itertools import pairwise
from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data
from threadpoolctl import threadpool_limits

from ..kernels.network import network_outputs
from .activations import ACTIVATIONS
from .listening import tell
from .marquardt import improved
from .repeated import distinct_samples


class LevenbergMarquardtRegressor(RegressorMixin, BaseEstimator):
    """Multilayer perceptron for regression, trained by Levenberg-Marquardt on the squared error.

    The data are split into training, validation and test parts as in MATLAB's Neural Net Fitting tool, which the
    paper used: training stops when the validation error has not improved for a number of iterations, and the network
    of the best validation error is kept.  The Jacobian is formed whole, so this is for small networks and up to some
    10^5 samples.  Inputs and targets should be scaled to unit variance.  A sample that is given more than once is one sample of as much
    weight, so that it never stands on both sides of the split.

    Parameters
    ----------
    hidden_layer_sizes : tuple of int, default=(20,)
        Units of each hidden layer.
    activation : {"logistic", "tanh", "algebraic", "relu"}, default="logistic"
    max_iter : int, default=500
        Most iterations, each an accepted step.
    validation_fraction, test_fraction : float, default=0.15
        Parts of the samples kept for early stopping, and for `test_score_`.
    n_iter_no_change : int, default=50
        Iterations without a better validation error before training stops.
    tol : float, default=1e-4
        Relative improvement of the validation error that counts as one.
    n_init : int, default=1
        Trainings from different first weights, of which the one with the least validation error is kept.
    initial_damping : float, default=1e-2
        Marquardt's parameter at the start, relative to the diagonal of the normal matrix.
    random_state : int, RandomState instance or None, default=None
        Of the split and the first weights.

    Attributes
    ----------
    coefs_ : list of ndarray, shape (n_in, n_out)
    intercepts_ : list of ndarray, shape (n_out,)
    n_iter_ : int
    loss_ : float
        Mean squared error of the training part.
    validation_loss_ : float
        Of the validation part; NaN if there is none.
    test_score_ : float
        R^2 of the test part; NaN if there is none.
    n_features_in_ : int

    References
    ----------
    Marquardt, J. Soc. Ind. Appl. Math. 11 (1963) 431-441; Hagan and Menhaj, IEEE Trans. Neural Netw. 5 (1994) 989-993.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> import numpy as np
    >>> x = np.linspace(-1, 1, 60)[:, None]
    >>> model = pds.LevenbergMarquardtRegressor((5,), "tanh", max_iter=100, random_state=0).fit(x, np.sin(2 * x))
    >>> model.score(x, np.sin(2 * x)) > 0.999
    True
    """

    _parameter_constraints: ClassVar = {
        "hidden_layer_sizes": ["array-like", Interval(Integral, 1, None, closed="left")],
        "activation": [StrOptions(set(ACTIVATIONS))],
        "max_iter": [Interval(Integral, 1, None, closed="left")],
        "validation_fraction": [Interval(Real, 0, 1, closed="left")],
        "test_fraction": [Interval(Real, 0, 1, closed="left")],
        "n_iter_no_change": [Interval(Integral, 1, None, closed="left")],
        "tol": [Interval(Real, 0, None, closed="left")],
        "n_init": [Interval(Integral, 1, None, closed="left")],
        "initial_damping": [Interval(Real, 0, None, closed="neither")],
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        hidden_layer_sizes=(20,),
        activation="logistic",
        max_iter=500,
        validation_fraction=0.15,
        test_fraction=0.15,
        n_iter_no_change=50,
        tol=1e-4,
        n_init=1,
        initial_damping=1e-2,
        random_state=None,
    ):
        self.hidden_layer_sizes = hidden_layer_sizes
        self.activation = activation
        self.max_iter = max_iter
        self.validation_fraction = validation_fraction
        self.test_fraction = test_fraction
        self.n_iter_no_change = n_iter_no_change
        self.tol = tol
        self.n_init = n_init
        self.initial_damping = initial_damping
        self.random_state = random_state

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        return tags

    def fit(self, X, y, sample_weight=None):
        """Train the network.

        Parameters
        ----------
        X : array-like, shape (n_samples, n_features)
        y : array-like, shape (n_samples,) or (n_samples, n_outputs)
        sample_weight : array-like, shape (n_samples,), optional
            Of the squared errors, in training, validation and test.  A whole number stands for as many samples, 0 for none.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            For parameters out of range, or data that scikit-learn would not accept.
        """
        self._validate_params()
        if self.validation_fraction + self.test_fraction >= 1:
            raise ValueError("validation_fraction and test_fraction leave nothing to train on")
        sizes = np.atleast_1d(self.hidden_layer_sizes).astype(int)
        if not sizes.size or (sizes < 1).any():
            raise ValueError(
                "there is at least one hidden layer, and every hidden layer needs at least one unit, "
                f"hidden_layer_sizes is {self.hidden_layer_sizes}"
            )
        X, y = validate_data(self, X, y, dtype=np.float64, multi_output=True, y_numeric=True)
        y = np.asarray(y, dtype=np.float64)
        self._single_output = y.ndim == 1
        Y = y.reshape(len(X), -1)
        if sample_weight is not None:
            sample_weight = _check_sample_weight(sample_weight, X, dtype=np.float64, ensure_non_negative=True)
        kept, share = distinct_samples(X, Y, sample_weight)
        if kept is not None:
            X, Y = X[kept], Y[kept]
        random = check_random_state(self.random_state)

        order = random.permutation(len(X))
        n_validation, n_test = (int(fraction * len(X)) for fraction in (self.validation_fraction, self.test_fraction))
        validation, test, train = np.split(order, [n_validation, n_validation + n_test])
        network = _Network([X.shape[1], *sizes, Y.shape[1]], ACTIVATIONS[self.activation])
        # One thread: matrices this small gain nothing from more, and the result does not depend on how many there are.
        with threadpool_limits(1, user_api="blas"):
            fitted, watched = _Part(X, Y, share, train), _Part(X, Y, share, validation)
            trainings = [
                self._train(network, network.first_weights(random, fitted.mean), fitted, watched, number) for number in range(self.n_init)
            ]
        best, weights, self.n_iter_ = min(trainings, key=lambda training: training[0])
        self.coefs_, self.intercepts_ = network.layers(weights)
        self.loss_ = float(fitted.loss(network, weights))
        self.validation_loss_ = float(best) if n_validation else np.nan
        self.test_score_ = np.nan
        if n_test >= 2:
            share = None if share is None else share[test]
            self.test_score_ = float(self.score(X[test], Y[test, 0] if self._single_output else Y[test], share))
        return self

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "coefs_")

    def predict(self, X):
        """Predict targets, shape (n_samples,) or (n_samples, n_outputs) as in training."""
        check_is_fitted(self)
        X = validate_data(self, X, dtype=np.float64, reset=False)
        Y = network_outputs(X, zip(self.coefs_, self.intercepts_, strict=True), ACTIVATIONS[self.activation])
        return Y[:, 0] if self._single_output else Y

    def _train(self, network, weights, fitted, watched, number):
        """The training of a number; returns the least validation loss, the weights that had it, and the number of iterations."""
        damping = self.initial_damping

        def loss_of(weights):
            return fitted.loss(network, weights)

        loss = loss_of(weights)
        best, best_weights, waited = np.inf, weights, 0
        iterations = 0
        while iterations < self.max_iter:
            iterations += 1
            normal, gradient = network.normal_equations(weights, fitted.X, fitted.Y, fitted.root)
            weights, new_loss, damping = improved(weights, loss, loss_of, normal, gradient, damping)
            if new_loss is None:
                break  # no damping makes the step an improvement: the training error is at its least to rounding
            loss = new_loss
            tell(number * self.max_iter + iterations, self.n_init * self.max_iter, loss)
            current = watched.loss(network, weights) if len(watched.X) else loss
            if current < best * (1 - self.tol):
                best, best_weights, waited = current, weights, 0
            else:
                waited += 1
                if waited >= self.n_iter_no_change:
                    break
        return best, best_weights, iterations


class _Part:
    """A part of the samples, with the roots of their weights, whose squares are 1 in the mean."""

    def __init__(self, X, Y, weights, chosen):
        self.X, self.Y, self.root, self.mean = X[chosen], Y[chosen], 1.0, None
        if weights is not None:
            weights = weights[chosen]
            self.root = np.sqrt(weights / weights.mean())[:, None] if len(weights) else 1.0
        if len(self.X):
            self.mean = (self.root**2 * self.Y).mean(axis=0)

    def loss(self, network, weights):
        """Mean squared error."""
        return ((self.root * (network.outputs(weights, self.X) - self.Y)) ** 2).mean()


class _Network:
    """A fully connected network as a function of one vector of weights."""

    def __init__(self, widths, activation):
        self.widths, self.activation = widths, activation
        self.shapes = list(pairwise(widths))
        sizes = [n_in * n_out + n_out for n_in, n_out in self.shapes]
        self.starts = np.concatenate([[0], np.cumsum(sizes)])

    def first_weights(self, random, mean):
        parts = []
        for layer, (n_in, n_out) in enumerate(self.shapes):
            output = layer == len(self.shapes) - 1
            parts.append(random.normal(size=n_in * n_out) * (0.1 if output else 1.4 / np.sqrt(n_in)))
            parts.append(mean if output else random.uniform(-1.5, 1.5, n_out))
        return np.concatenate(parts)

    def layers(self, weights):
        coefs, intercepts = [], []
        for start, (n_in, n_out) in zip(self.starts[:-1], self.shapes, strict=True):
            coefs.append(weights[start : start + n_in * n_out].reshape(n_in, n_out).copy())
            intercepts.append(weights[start + n_in * n_out : start + n_in * n_out + n_out].copy())
        return coefs, intercepts

    def outputs(self, weights, X):
        return network_outputs(X, zip(*self.layers(weights), strict=True), self.activation)

    def normal_equations(self, weights, X, Y, root):
        """J^T J and J^T r of the residuals r = root (outputs - Y), summed over samples and outputs."""
        coefs, intercepts = self.layers(weights)
        inputs, slopes, values = [], [], X
        for W, b in zip(coefs[:-1], intercepts[:-1], strict=True):
            inputs.append(values)
            values, slope = self.activation(values @ W + b)
            slopes.append(slope)
        residuals = root * (values @ coefs[-1] + intercepts[-1] - Y)

        # The output layer's weights of one output do not touch another's: only the columns of this one are formed.  With one hidden layer
        # these are the same for every output but for a factor, an output weight, so that their products are formed once.
        hidden = self.starts[-2]
        n_last, n_outputs = self.shapes[-1]
        normal, gradient = np.zeros((self.starts[-1], self.starts[-1])), np.zeros(self.starts[-1])
        jacobian, factor = np.empty((len(X), hidden + n_last + 1)), np.ones(hidden + n_last + 1)
        jacobian[:, hidden:-1] = root * values
        jacobian[:, -1:] = root
        one_layer = len(slopes) == 1
        if one_layer:
            self._fill(jacobian, coefs, inputs, slopes, root * slopes[0])
            products = jacobian.T @ jacobian
        for output in range(n_outputs):
            if one_layer:
                factor[:hidden] = np.tile(coefs[-1][:, output], hidden // n_last)
            else:
                self._fill(jacobian, coefs, inputs, slopes, root * slopes[-1] * coefs[-1][:, output])
                products = jacobian.T @ jacobian
            columns = np.concatenate(
                [np.arange(hidden), hidden + np.arange(n_last) * n_outputs + output, [hidden + n_last * n_outputs + output]]
            )
            normal[np.ix_(columns, columns)] += factor[:, None] * products * factor
            gradient[columns] += factor * (jacobian.T @ residuals[:, output])
        return normal, gradient

    def _fill(self, jacobian, coefs, inputs, slopes, delta):
        """Derivatives by the weights of the hidden layers, of which `delta` is that by the last one's arguments."""
        for layer in range(len(slopes) - 1, -1, -1):
            start, (n_in, n_out) = self.starts[layer], self.shapes[layer]
            block = jacobian[:, start : start + n_in * n_out].reshape(len(jacobian), n_in, n_out)
            np.multiply(inputs[layer][:, :, None], delta[:, None, :], out=block)
            jacobian[:, start + n_in * n_out : start + n_in * n_out + n_out] = delta
            if layer:
                delta = (delta @ coefs[layer].T) * slopes[layer - 1]
