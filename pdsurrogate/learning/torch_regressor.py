"""Larger multilayer perceptrons, trained by stochastic gradients with torch and skorch.

torch is imported when a network is fitted, not before; a fitted regressor holds plain arrays and needs it no more.
"""

from __future__ import annotations

from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

from ..kernels.network import network_outputs
from .activations import ACTIVATIONS
from .repeated import distinct_samples


class TorchMLPRegressor(RegressorMixin, BaseEstimator):
    """Multilayer perceptron for regression, trained by Adam on the squared error, with early stopping and a decaying rate.

    For networks too large for `LevenbergMarquardtRegressor`; needs the ``torch`` extra to fit.

    Parameters
    ----------
    hidden_layer_sizes : tuple of int, default=(64, 64)
    activation : {"algebraic", "logistic", "tanh", "relu"}, default="tanh"
    learning_rate : float, default=3e-3
        At the start; it falls to a hundredth along a cosine.
    max_epochs : int, default=300
    batch_size : int, default=256
    validation_fraction : float, default=0.15
        Part of the samples kept for early stopping.
    patience : int, default=100
        Epochs without a better validation error before training stops.
    random_state : int, RandomState instance or None, default=None

    Attributes
    ----------
    coefs_ : list of ndarray, shape (n_in, n_out)
    intercepts_ : list of ndarray, shape (n_out,)
    n_iter_ : int
        Epochs.
    loss_, validation_loss_ : float
        Mean squared errors of all samples, and of the validation part; NaN if there is none.
    n_features_in_ : int

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.TorchMLPRegressor((8, 8)).get_params()["hidden_layer_sizes"]
    (8, 8)
    """

    _parameter_constraints: ClassVar = {
        "hidden_layer_sizes": ["array-like"],
        "activation": [StrOptions(set(ACTIVATIONS))],
        "learning_rate": [Interval(Real, 0, None, closed="neither")],
        "max_epochs": [Interval(Integral, 1, None, closed="left")],
        "batch_size": [Interval(Integral, 1, None, closed="left")],
        "validation_fraction": [Interval(Real, 0, 1, closed="left")],
        "patience": [Interval(Integral, 1, None, closed="left")],
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        hidden_layer_sizes=(64, 64),
        activation="tanh",
        learning_rate=3e-3,
        max_epochs=300,
        batch_size=256,
        validation_fraction=0.15,
        patience=100,
        random_state=None,
    ):
        self.hidden_layer_sizes = hidden_layer_sizes
        self.activation = activation
        self.learning_rate = learning_rate
        self.max_epochs = max_epochs
        self.batch_size = batch_size
        self.validation_fraction = validation_fraction
        self.patience = patience
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
            Of the squared errors, in training and validation.  A whole number stands for as many samples, 0 for none.

        Returns
        -------
        self

        Raises
        ------
        ImportError
            Without torch and skorch, with what to install.
        """
        self._validate_params()
        X, y = validate_data(self, X, y, dtype=np.float64, multi_output=True, y_numeric=True)
        y = np.asarray(y, dtype=np.float64)
        self._single_output = y.ndim == 1
        Y = y.reshape(len(X), -1)
        if sample_weight is not None:
            sample_weight = _check_sample_weight(sample_weight, X, dtype=np.float64, ensure_non_negative=True)
        kept, share = distinct_samples(X, Y, sample_weight)
        if kept is not None:
            X, Y = X[kept], Y[kept]
        try:
            from .torch_training import train
        except ImportError as error:
            raise ImportError(f"fitting a TorchMLPRegressor needs torch and skorch: pip install 'pdsurrogate[torch]' ({error})") from None

        seed = int(check_random_state(self.random_state).randint(2**31 - 1))
        widths = [X.shape[1], *np.atleast_1d(self.hidden_layer_sizes).astype(int).tolist(), Y.shape[1]]
        trained = train(
            X,
            Y,
            share,
            widths,
            self.activation,
            self.learning_rate,
            self.max_epochs,
            self.batch_size,
            self.validation_fraction,
            self.patience,
            seed,
        )
        self.coefs_, self.intercepts_, self.n_iter_, self.validation_loss_ = trained
        self.loss_ = float(np.average(((self._outputs(X) - Y) ** 2).mean(axis=1), weights=share))
        return self

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "coefs_")

    def predict(self, X):
        """Predict targets, shape (n_samples,) or (n_samples, n_outputs) as in training."""
        check_is_fitted(self)
        Y = self._outputs(validate_data(self, X, dtype=np.float64, reset=False))
        return Y[:, 0] if self._single_output else Y

    def _outputs(self, X):
        return network_outputs(X, zip(self.coefs_, self.intercepts_, strict=True), ACTIVATIONS[self.activation])
