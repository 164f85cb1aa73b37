"""The Levenberg-Marquardt algorithm for any network, and a scikit-learn regressor of multilayer
perceptrons trained by the algorithm.

`scipy.optimize.least_squares` holds the whole Jacobian of all samples and outputs; here the normal
equations are summed over outputs.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import StrOptions
from threadpoolctl import threadpool_limits

from ..kernels.network import network_outputs
from ..progress import event
from .base import ACTIVATIONS, COUNT, NOT_NEGATIVE, POSITIVE, SHARE, BasePerceptron

CONSTRAINTS = {
    **dict.fromkeys(("max_iter", "n_iter_no_change", "n_init"), COUNT),
    "tol": NOT_NEGATIVE,
    "initial_damping": POSITIVE,
    "random_state": ["random_state"],
}
"""Constraints on the parameters that all regressors trained by this algorithm have."""


def accepted_steps(
    regressor,
    number: int,
    weights: np.ndarray,
    loss_of: Callable[[np.ndarray], float],
    normal_equations: Callable,
) -> Iterator[tuple[np.ndarray, float]]:
    """Minimize a loss by Levenberg-Marquardt steps: yield weights and loss after each of at most
    ``max_iter`` accepted steps.

    The training starts from `weights`; `number` counts the ``n_init`` trainings of a fit, from 0.
    ``normal_equations(weights)`` returns J^T J and J^T r for the residuals r and their derivatives
    J by the weights. The damping, relative to the diagonal of J^T J, is raised until the loss
    falls, and lowered after the step. The training ends early where no damping makes a step an
    improvement: the loss is then at its least to rounding.
    """
    loss = loss_of(weights)
    damping = regressor.initial_damping
    most = regressor.max_iter
    for iteration in range(number * most + 1, (number + 1) * most + 1):
        normal, gradient = normal_equations(weights)
        diagonal = np.diag(normal) + 1e-12 * max(np.trace(normal), 1e-300)
        # At a damping of 1e12 times the diagonal a step is below rounding.
        while damping < 1e12:
            try:
                factor = cho_factor(normal + damping * np.diag(diagonal), check_finite=False)
            except LinAlgError:  # not positive definite
                damping *= 10
                continue
            trial = weights - cho_solve(factor, gradient, check_finite=False)
            if (trial_loss := loss_of(trial)) < loss:
                break
            damping *= 4
        else:
            return
        weights = trial
        loss = trial_loss
        damping = max(damping / 5, 1e-14)
        event("training", iteration, regressor.n_init * most, loss=loss, iterations=iteration)
        yield weights, loss


@dataclass(eq=False, repr=False)
class LevenbergMarquardtRegressor(BasePerceptron):
    """Multilayer perceptron for regression, trained by Levenberg-Marquardt on the squared error.

    As in MATLAB's Neural Net Fitting tool, which the paper used, the samples are split into
    training, validation and test parts: training stops when the validation error has not improved
    for a number of iterations, and the network of the least validation error is kept. The whole
    Jacobian is formed, so the regressor is for small networks and up to some 10^5 samples. Inputs
    and targets should be scaled to unit variance.

    Parameters
    ----------
    hidden_layer_sizes : tuple of int, default=(20,)
        Units of each hidden layer.
    activation : {"logistic", "tanh", "algebraic", "relu"}, default="logistic"
    max_iter : int, default=500
        Most iterations, each an accepted step.
    validation_fraction, test_fraction : float, default=0.15
        Shares of the samples kept for early stopping, and for `test_score_`.
    n_iter_no_change : int, default=50
        Iterations without a better validation error before training stops.
    tol : float, default=1e-4
        Least relative decrease of the validation error that counts as an improvement.
    n_init : int, default=1
        Trainings from different first weights, of which the one with the least validation error is
        kept.
    initial_damping : float, default=1e-2
        Marquardt's parameter at the start, relative to the diagonal of the normal matrix.
    random_state : int, RandomState instance or None, default=None
        Generator of the split and of the first weights.

    Attributes
    ----------
    coefs_ : list of ndarray, shape (n_in, n_out)
    intercepts_ : list of ndarray, shape (n_out,)
    n_iter_ : int
    loss_ : float
        Mean squared error of the training part.
    validation_loss_ : float
        Mean squared error of the validation part; NaN without one.
    test_score_ : float
        R^2 of the test part; NaN without one.
    n_features_in_ : int

    References
    ----------
    Marquardt, J. Soc. Ind. Appl. Math. 11 (1963) 431-441; Hagan and Menhaj, IEEE Trans. Neural
    Netw. 5 (1994) 989-993.

    See Also
    --------
    pdsurrogate.TorchMLPRegressor : for networks too large for this one.
    pdsurrogate.learning.ChebyshevRegressor : a polynomial, without iterations.
    pdsurrogate.surrogate_pipeline : makes a surrogate of a regressor.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> import numpy as np
    >>> x = np.linspace(-1, 1, 60)[:, None]
    >>> model = pds.LevenbergMarquardtRegressor((5,), "tanh", max_iter=100, random_state=0).fit(
    ...     x, np.sin(2 * x)
    ... )
    >>> model.score(x, np.sin(2 * x)) > 0.999
    True
    """

    hidden_layer_sizes: int | Sequence[int] = (20,)
    activation: str = "logistic"
    _: KW_ONLY
    max_iter: int = 500
    validation_fraction: float = 0.15
    test_fraction: float = 0.15
    n_iter_no_change: int = 50
    tol: float = 1e-4
    n_init: int = 1
    initial_damping: float = 1e-2
    random_state: int | np.random.RandomState | None = None

    _parameter_constraints: ClassVar = {
        **CONSTRAINTS,
        "hidden_layer_sizes": ["array-like", *COUNT],
        "activation": [StrOptions(set(ACTIVATIONS))],
        "validation_fraction": SHARE,
        "test_fraction": SHARE,
    }

    def fit(self, X, y):
        """Train the network.

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
            For parameters out of range, or data that scikit-learn would not accept.

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> x = np.linspace(-1, 1, 60)[:, None]
        >>> model = pds.LevenbergMarquardtRegressor((5,), "tanh", max_iter=20, random_state=0).fit(
        ...     x, np.sin(2 * x[:, 0])
        ... )
        >>> model.n_iter_
        20
        """
        X, Y = self._checked(X, y)
        if self.validation_fraction + self.test_fraction >= 1:
            raise ValueError(
                "validation_fraction and test_fraction must add up to less than 1, so that samples"
                " are left for training"
            )
        sizes = np.atleast_1d(self.hidden_layer_sizes).astype(int)
        if not sizes.size or (sizes < 1).any():
            raise ValueError(
                "hidden_layer_sizes must name at least one layer, and every hidden layer needs at"
                f" least one unit, not {self.hidden_layer_sizes}"
            )
        random = check_random_state(self.random_state)

        order = random.permutation(len(X))
        n_validation, n_test = (
            int(fraction * len(X)) for fraction in (self.validation_fraction, self.test_fraction)
        )
        validation, test, train = np.split(order, [n_validation, n_validation + n_test])
        # One thread: matrices this small gain nothing from more, and the result does not depend on
        # how many there are.
        with threadpool_limits(1, user_api="blas"):
            fitted, watched = (
                _Part(sizes, ACTIVATIONS[self.activation], X[rows], Y[rows])
                for rows in (train, validation)
            )
            trainings = [
                self._train(fitted.first_weights(random), fitted, watched, number)
                for number in range(self.n_init)
            ]
        best, weights, self.n_iter_ = min(trainings, key=lambda training: training[0])
        self.coefs_, self.intercepts_ = map(list, fitted.layers(weights))
        self.loss_ = float(fitted.loss(weights))
        self.validation_loss_ = float(best) if n_validation else np.nan
        right = Y[test, 0] if self._single_output else Y[test]
        self.test_score_ = float(self.score(X[test], right)) if n_test >= 2 else np.nan
        return self

    def _train(self, first, fitted, watched, number):
        """Train from the weights `first`; return the least validation loss, the weights at this
        loss, and the number of iterations.

        `fitted` and `watched` are the training and validation samples (`_Part`); `number` counts
        the trainings of a fit, from 0.
        """
        best = np.inf
        kept = first
        improved = 0
        iteration = 0
        for iteration, (weights, loss) in enumerate(
            accepted_steps(self, number, first, fitted.loss, fitted.normal_equations), 1
        ):
            current = watched.loss(weights) if len(watched.X) else loss
            if current < best * (1 - self.tol):
                best = current
                kept = weights
                improved = iteration
            if iteration - improved == self.n_iter_no_change:
                return best, kept, iteration
        # the step that could not be made counts
        return (
            best,
            kept,
            min(iteration + 1, self.max_iter),
        )


class _Part:
    """Training or validation samples, and the error of a fully connected network on them as a
    function of the vector of all weights.
    """

    def __init__(self, sizes, activation, X, Y):
        self.activation = activation
        self.X = X
        self.Y = Y
        self.shapes = list(pairwise([X.shape[1], *sizes, Y.shape[1]]))
        self.starts = np.cumsum([0, *(n_in * n_out + n_out for n_in, n_out in self.shapes)])

    def first_weights(self, random):
        """Return the vector of random initial weights; the biases of the output layer are the
        mean targets.
        """
        parts = []
        for layer, (n_in, n_out) in enumerate(self.shapes):
            output = layer == len(self.shapes) - 1
            parts.append(
                random.normal(size=n_in * n_out) * (0.1 if output else 1.4 / np.sqrt(n_in))
            )
            parts.append(self.Y.mean(axis=0) if output else random.uniform(-1.5, 1.5, n_out))
        return np.concatenate(parts)

    def layers(self, weights):
        """Split the vector of all weights: return the weight matrices of the layers, and the
        bias vectors of the layers.
        """
        layers = zip(np.split(weights, self.starts[1:-1]), self.shapes, strict=True)
        return zip(
            *(
                (layer[:-n_out].reshape(n_in, n_out).copy(), layer[-n_out:].copy())
                for layer, (n_in, n_out) in layers
            ),
            strict=True,
        )

    def loss(self, weights):
        """Return the mean squared error of the network with given weights on these samples."""
        outputs = network_outputs(self.X, zip(*self.layers(weights), strict=True), self.activation)
        return ((outputs - self.Y) ** 2).mean()

    def normal_equations(self, weights):
        """Return J^T J and J^T r for residuals r = outputs - Y and their derivatives J by the
        network's weights.
        """
        coefs, intercepts = self.layers(weights)
        inputs = []
        slopes = []
        values = self.X
        for W, b in zip(coefs[:-1], intercepts[:-1], strict=True):
            inputs.append(values)
            values, slope = self.activation(values @ W + b)
            slopes.append(slope)
        residuals = values @ coefs[-1] + intercepts[-1] - self.Y

        # An output depends on its own weights of the output layer alone: only the columns of these
        # are formed. With one hidden layer the columns of all outputs differ by a factor only, an
        # output weight, and their products are formed once.
        hidden = self.starts[-2]
        n_last, n_outputs = self.shapes[-1]
        normal = np.zeros((self.starts[-1], self.starts[-1]))
        gradient = np.zeros(self.starts[-1])
        jacobian = np.empty((len(values), hidden + n_last + 1))
        factor = np.ones(hidden + n_last + 1)
        jacobian[:, hidden:-1] = values
        jacobian[:, -1] = 1.0
        one_layer = len(slopes) == 1
        for output in range(n_outputs):
            if one_layer:
                factor[:hidden] = np.tile(coefs[-1][:, output], hidden // n_last)
            if output == 0 or not one_layer:
                self._fill(
                    jacobian,
                    coefs,
                    inputs,
                    slopes,
                    slopes[-1] * (1.0 if one_layer else coefs[-1][:, output]),
                )
                products = jacobian.T @ jacobian
            columns = np.concatenate(
                [np.arange(hidden), hidden + np.arange(n_last + 1) * n_outputs + output]
            )
            normal[np.ix_(columns, columns)] += factor[:, None] * products * factor
            gradient[columns] += factor * (jacobian.T @ residuals[:, output])
        return normal, gradient

    def _fill(self, jacobian, coefs, inputs, slopes, delta):
        """Write the derivatives of an output by weights and biases of the hidden layers to the
        first columns of `jacobian`.

        `inputs` and `slopes` are the inputs of each hidden layer and the slopes of its activation;
        `delta`, shape (n, units), holds the derivatives of the output by the inputs of the
        activation of the last hidden layer.
        """
        for layer in range(len(slopes) - 1, -1, -1):
            start = self.starts[layer]
            n_in, n_out = self.shapes[layer]
            block = jacobian[:, start : start + n_in * n_out].reshape(len(jacobian), n_in, n_out)
            np.multiply(inputs[layer][:, :, None], delta[:, None, :], out=block)
            jacobian[:, start + n_in * n_out : start + n_in * n_out + n_out] = delta
            if layer:
                delta = (delta @ coefs[layer].T) * slopes[layer - 1]
