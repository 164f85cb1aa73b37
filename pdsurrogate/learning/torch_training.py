"""Training with torch and skorch; imported only where a network is fitted with them."""

from itertools import pairwise

import numpy as np
import torch
from sklearn.utils import check_random_state
from skorch import NeuralNetRegressor
from skorch.callbacks import EarlyStopping, LRScheduler
from skorch.dataset import ValidSplit

from .export import layers_of_module


class Algebraic(torch.nn.Module):
    """Activation x / sqrt(1 + x^2) as a torch module."""

    def forward(self, x):
        """Return the activation of each element of x."""
        return x * torch.rsqrt(1 + x * x)


ACTIVATIONS = {
    "algebraic": Algebraic,
    "logistic": torch.nn.Sigmoid,
    "tanh": torch.nn.Tanh,
    "relu": torch.nn.ReLU,
}


def train(regressor, X, Y):
    """Train a network; return its weights, biases, number of epochs, and least validation loss (NaN
    without a validation part).

    The network and its training have the parameters of `regressor`, a `TorchMLPRegressor`.
    """
    seed = int(check_random_state(regressor.random_state).randint(2**31 - 1))
    widths = [
        X.shape[1],
        *np.atleast_1d(regressor.hidden_layer_sizes).astype(int).tolist(),
        Y.shape[1],
    ]
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        split = None
        callbacks = []
        if regressor.validation_fraction:
            split = ValidSplit(regressor.validation_fraction, random_state=seed)
            callbacks.append(("stop", EarlyStopping(patience=regressor.patience, load_best=True)))
        rate = regressor.learning_rate
        most = regressor.max_epochs
        callbacks.append(
            (
                "rate",
                LRScheduler(
                    torch.optim.lr_scheduler.CosineAnnealingLR, T_max=most, eta_min=rate / 100
                ),
            )
        )
        linear = [
            torch.nn.Linear(n_in, n_out, dtype=torch.float64) for n_in, n_out in pairwise(widths)
        ]
        layers = [
            layer
            for hidden in linear[:-1]
            for layer in (hidden, ACTIVATIONS[regressor.activation]())
        ]
        net = NeuralNetRegressor(
            torch.nn.Sequential(*layers, linear[-1]),
            optimizer=torch.optim.Adam,
            lr=rate,
            max_epochs=most,
            batch_size=regressor.batch_size,
            train_split=split,
            callbacks=callbacks,
            iterator_train__shuffle=True,
            verbose=0,
        )
        net.fit(X, Y)
    coefs, intercepts = map(list, zip(*layers_of_module(net.module_)[1], strict=True))
    losses = [row["valid_loss"] for row in net.history if "valid_loss" in row]
    return coefs, intercepts, len(net.history), float(np.min(losses)) if losses else float("nan")
