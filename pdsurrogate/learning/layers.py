"""Networks taken out of fitted estimators: their layers, with the affine steps around them folded in."""

from __future__ import annotations

import numpy as np
from sklearn.compose import TransformedTargetRegressor
from sklearn.pipeline import Pipeline

from ..kernels.activations import ACTIVATIONS
from ..kernels.network import MOST_HIDDEN, network_outputs

Layers = tuple[tuple[np.ndarray, np.ndarray], ...]

TORCH_ACTIVATIONS = {"Sigmoid": "logistic", "Tanh": "tanh", "ReLU": "relu"}
"""Those of torch that the kernels have, by the names of their modules."""

AGREEMENT = 1e-5
"""Greatest difference of what was taken over from what the estimator predicts, in parts of the RMS: single precision of torch."""


def network_of(estimator, features: np.ndarray) -> tuple[str, Layers] | None:
    """Activation and layers of an estimator that is a network the kernels evaluate; None of every other.

    Taken are scikit-learn's ``MLPRegressor`` and what has ``coefs_``, ``intercepts_`` and ``activation`` like it, and skorch's regressors
    whose module is a sequence of linear layers and one activation; also as the last step of a pipeline whose other steps are affine, and
    with an affine transformation of the target.  What is found is compared with what the estimator predicts, so that a module with another
    forward pass, or a step that is not affine, is no network.

    Parameters
    ----------
    estimator : estimator
        Fitted.
    features : ndarray, shape (m, n)
        At which the two are compared.
    """
    found = _layers_of(estimator, features.shape[1])
    if found is None:
        return None
    activation, layers = found
    if activation not in ACTIVATIONS or not 1 <= len(layers) - 1 <= MOST_HIDDEN:
        return None
    values = network_outputs(features, layers, ACTIVATIONS[activation])
    expected = np.asarray(estimator.predict(features), dtype=float)
    if expected.shape != values.shape:
        return None
    agree = np.abs(values - expected).max() <= AGREEMENT * np.sqrt((expected**2).mean())
    return (activation, layers) if agree else None


def _layers_of(estimator, n_features: int) -> tuple[str, Layers] | None:
    if isinstance(estimator, Pipeline):
        before = estimator[:-1]
        if len(before.steps) == 0:
            return _layers_of(estimator[-1], n_features)
        matrix, shift = _affine(before.transform, n_features)
        found = _layers_of(estimator[-1], len(shift))
        if found is None:
            return None
        activation, (first, *rest) = found
        return activation, ((matrix @ first[0], shift @ first[0] + first[1]), *rest)
    if isinstance(estimator, TransformedTargetRegressor):
        found = _layers_of(estimator.regressor_, n_features)
        if found is None:
            return None
        activation, (*rest, last) = found
        matrix, shift = _affine(estimator.transformer_.inverse_transform, last[1].size)
        return activation, (*rest, (last[0] @ matrix, last[1] @ matrix + shift))
    if all(hasattr(estimator, key) for key in ("coefs_", "intercepts_", "activation")):
        pairs = zip(estimator.coefs_, estimator.intercepts_, strict=True)
        return estimator.activation, tuple((np.array(W, dtype=float), np.array(b, dtype=float)) for W, b in pairs)
    if hasattr(estimator, "module_"):
        return _layers_of_module(estimator.module_)
    return None


def _affine(transform, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrix and shift of x -> x M + c, of a transformation that is one."""
    values = np.asarray(transform(np.vstack([np.zeros((1, count)), np.eye(count)])), dtype=float)
    return values[1:] - values[0], values[0]


def _layers_of_module(module) -> tuple[str, Layers] | None:
    """Linear layers with one activation between them, in the order in which a module of torch lists them."""
    leaves = [leaf for leaf in module.modules() if not list(leaf.children())]
    names = [type(leaf).__name__ for leaf in leaves]
    kinds = set(names[1::2])
    if len(leaves) % 2 == 0 or set(names[::2]) != {"Linear"} or len(kinds) != 1 or not kinds <= set(TORCH_ACTIVATIONS):
        return None
    layers = []
    for leaf in leaves[::2]:
        weights, biases = (None if array is None else array.detach().cpu().numpy().astype(float) for array in (leaf.weight, leaf.bias))
        layers.append((np.ascontiguousarray(weights.T), np.zeros(len(weights)) if biases is None else biases))
    return TORCH_ACTIVATIONS[kinds.pop()], tuple(layers)
