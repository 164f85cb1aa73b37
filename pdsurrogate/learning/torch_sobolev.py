"""Sobolev training with torch and skorch; imported only where a network is fitted with them."""

from __future__ import annotations

import numpy as np
import torch
from skorch import NeuralNetRegressor

ACTIVATIONS = {
    "algebraic": lambda z: (z * torch.rsqrt(1 + z * z), torch.rsqrt(1 + z * z) ** 3),
    "logistic": lambda z: (torch.sigmoid(z), torch.sigmoid(z) * (1 - torch.sigmoid(z))),
    "tanh": lambda z: (torch.tanh(z), 1 - torch.tanh(z) ** 2),
}
"""Activation and slope."""


class ValueAndGradient(torch.nn.Module):
    """The network's value and derivatives, times the weights of their residuals, which follow the features in its input."""

    def __init__(self, network, first, columns):
        super().__init__()
        self.network, self.columns = network, columns
        self.theta = torch.nn.Parameter(torch.from_numpy(first.copy()))

    def forward(self, data):
        """Weighted outputs, shape (n, columns)."""
        network, d = self.network, self.network.d
        X, weights = data[:, :d], data[:, d:]
        outputs = self._outputs(X)
        if network.anchored:
            origin = self._outputs(torch.zeros((1, d), dtype=X.dtype))[0]
            value, gradient = outputs[:, 0] - origin[0], [outputs[:, 1 + feature] for feature in range(d)]
            for feature in network.flat:
                value = value - X[:, feature] * origin[1 + feature]
                gradient[feature] = gradient[feature] - origin[1 + feature]
            outputs = torch.stack([value, *gradient], dim=1)
        return outputs[:, : self.columns] * weights

    def _outputs(self, X):
        W, b, v, constant = self.network.parts(self.theta)
        value, slope = ACTIVATIONS[self.network.activation](X @ W + b)
        return torch.cat([(value @ v + constant)[:, None], (slope * v) @ W.T], dim=1)


def train(network, first, X, Y, weights, max_epochs):
    """Train from the parameters `first`; returns the trained ones and the number of epochs."""
    threads = torch.get_num_threads()
    # Matrices this small gain nothing from more, and the result does not depend on how many there are.
    torch.set_num_threads(1)
    try:
        net = NeuralNetRegressor(
            ValueAndGradient,
            module__network=network,
            module__first=first,
            module__columns=Y.shape[1],
            criterion=torch.nn.MSELoss,
            optimizer=torch.optim.LBFGS,
            optimizer__max_iter=20,
            optimizer__history_size=50,
            optimizer__line_search_fn="strong_wolfe",
            optimizer__tolerance_change=0.0,
            lr=1.0,
            max_epochs=max_epochs,
            batch_size=-1,
            train_split=None,
            verbose=0,
        )
        net.fit(np.hstack([X, weights]), Y * weights)
    finally:
        torch.set_num_threads(threads)
    return net.module_.theta.detach().numpy().copy(), len(net.history)
