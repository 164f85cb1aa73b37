"""Training with torch and skorch; imported only where a network is fitted with them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import torch
from skorch import NeuralNetRegressor
from skorch.callbacks import EarlyStopping, LRScheduler
from skorch.dataset import Dataset
from skorch.helper import predefined_split


class Algebraic(torch.nn.Module):
    """x / sqrt(1 + x^2)."""

    def forward(self, x):
        """Evaluate."""
        return x * torch.rsqrt(1 + x * x)


ACTIVATIONS = {
    "algebraic": Algebraic,
    "logistic": torch.nn.Sigmoid,
    "tanh": torch.nn.Tanh,
    "relu": torch.nn.ReLU,
}


class Perceptron(torch.nn.Module):
    """A fully connected network in double precision."""

    def __init__(self, widths, activation):
        super().__init__()
        layers = []
        for n_in, n_out in pairwise(widths[:-1]):
            layers += [torch.nn.Linear(n_in, n_out, dtype=torch.float64), ACTIVATIONS[activation]()]
        self.layers = torch.nn.Sequential(*layers, torch.nn.Linear(widths[-2], widths[-1], dtype=torch.float64))

    def forward(self, X):
        """Outputs of the network."""
        return self.layers(X)


class WeightedSquares(torch.nn.Module):
    """Mean squared error with weights, which are the last column of the targets."""

    def forward(self, outputs, targets):
        """Evaluate."""
        return (targets[:, -1:] * (outputs - targets[:, :-1]) ** 2).mean()


def train(X, Y, weights, widths, activation, learning_rate, max_epochs, batch_size, validation_fraction, patience, seed):
    """Train a network; returns its weights, its biases, the epochs it took, and its validation loss (NaN if there was no such part)."""
    if weights is not None:
        Y = np.column_stack([Y, weights / weights.mean()])
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        split, callbacks = None, []
        order = np.random.default_rng(seed).permutation(len(X))
        kept = int(validation_fraction * len(X))
        if kept:
            validation, order = order[:kept], order[kept:]
            split = predefined_split(Dataset(X[validation], Y[validation]))
            callbacks.append(("stop", EarlyStopping(patience=patience, load_best=True)))
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR
        callbacks.append(("rate", LRScheduler(schedule, T_max=max_epochs, eta_min=learning_rate / 100)))
        net = NeuralNetRegressor(
            Perceptron(widths, activation),
            criterion=torch.nn.MSELoss if weights is None else WeightedSquares,
            optimizer=torch.optim.Adam,
            lr=learning_rate,
            max_epochs=max_epochs,
            batch_size=min(batch_size, len(order)),
            train_split=split,
            callbacks=callbacks,
            iterator_train__shuffle=True,
            verbose=0,
        )
        net.fit(X[order], Y[order])
    linear = [layer for layer in net.module_.layers if isinstance(layer, torch.nn.Linear)]
    coefs = [layer.weight.detach().numpy().T.copy() for layer in linear]
    intercepts = [layer.bias.detach().numpy().copy() for layer in linear]
    losses = [row["valid_loss"] for row in net.history if "valid_loss" in row] if split is not None else []
    return coefs, intercepts, len(net.history), float(np.min(losses)) if losses else float("nan")
