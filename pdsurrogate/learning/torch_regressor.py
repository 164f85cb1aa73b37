"""Larger multilayer perceptrons, trained by stochastic gradients with torch and skorch.

torch is imported when a network is fitted; a fitted regressor holds plain arrays and predicts
without it.
"""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

import numpy as np
from sklearn.utils._param_validation import StrOptions

from .base import ACTIVATIONS, COUNT, POSITIVE, SHARE, BasePerceptron


@dataclass(eq=False, repr=False)
class TorchMLPRegressor(BasePerceptron):
    """Multilayer perceptron for regression, trained by Adam on the squared error, with early
    stopping and a decaying rate.

    The class is for networks too large for `LevenbergMarquardtRegressor`; a fit needs the ``torch``
    extra of the package.

    Parameters
    ----------
    hidden_layer_sizes : tuple of int, default=(64, 64)
    activation : {"algebraic", "logistic", "tanh", "relu"}, default="tanh"
    learning_rate : float, default=3e-3
        Rate at the start; it falls to a hundredth along a cosine.
    max_epochs : int, default=300
    batch_size : int, default=256
    validation_fraction : float, default=0.15
        Share of the samples kept for early stopping.
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
        Mean squared errors of all samples, and of the validation part; the latter is NaN without
        one.
    n_features_in_ : int

    See Also
    --------
    pdsurrogate.LevenbergMarquardtRegressor : more accurate for small networks.
    pdsurrogate.surrogate_pipeline : makes a surrogate of a regressor.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.TorchMLPRegressor((8, 8)).get_params()["hidden_layer_sizes"]
    (8, 8)
    """

    hidden_layer_sizes: int | Sequence[int] = (64, 64)
    activation: str = "tanh"
    _: KW_ONLY
    learning_rate: float = 3e-3
    max_epochs: int = 300
    batch_size: int = 256
    validation_fraction: float = 0.15
    patience: int = 100
    random_state: int | np.random.RandomState | None = None

    _parameter_constraints: ClassVar = {
        **dict.fromkeys(("max_epochs", "batch_size", "patience"), COUNT),
        "hidden_layer_sizes": ["array-like"],
        "activation": [StrOptions(set(ACTIVATIONS))],
        "learning_rate": POSITIVE,
        "validation_fraction": SHARE,
        "random_state": ["random_state"],
    }

    def fit(self, X, y):
        """Train the network with torch and skorch.

        Parameters
        ----------
        X : array-like, shape (n_samples, n_features)
        y : array-like, shape (n_samples,) or (n_samples, n_outputs)

        Returns
        -------
        self

        Raises
        ------
        ImportError
            Without torch and skorch, with what to install.

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> x = np.linspace(-1, 1, 60)[:, None]
        >>> pds.TorchMLPRegressor((8,), max_epochs=3, random_state=0).fit(x, x[:, 0] ** 2).n_iter_
        3
        """
        X, Y = self._checked(X, y)
        try:
            from .torch_training import train
        except ImportError as error:
            raise ImportError(
                "fitting a TorchMLPRegressor needs torch and skorch: pip install"
                f" 'pdsurrogate[torch]' ({error})"
            ) from None

        self.coefs_, self.intercepts_, self.n_iter_, self.validation_loss_ = train(self, X, Y)
        self.loss_ = float(((self._outputs(X) - Y) ** 2).mean())
        return self
