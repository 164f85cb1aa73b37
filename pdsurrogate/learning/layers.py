"""Layers of networks in fitted estimators, with the affine steps around them folded in."""

from __future__ import annotations

import numpy as np
from sklearn.compose import TransformedTargetRegressor
from sklearn.pipeline import Pipeline

from ..kernels.activations import ACTIVATIONS
from ..kernels.network import MOST_HIDDEN, network_outputs

Layers = tuple[tuple[np.ndarray, np.ndarray], ...]

TORCH_ACTIVATIONS = {"Sigmoid": "logistic", "Tanh": "tanh", "ReLU": "relu"}
"""Names of activations in the kernels by the names of modules of torch."""

AGREEMENT = 1e-5
"""Greatest difference of the layers from the predictions of the estimator, relative to the RMS: single precision of torch."""


def network_of(estimator, features: np.ndarray) -> tuple[str, Layers] | None:
    """Return activation and layers of a fitted estimator that is a network the kernels evaluate; None for any other estimator.

    Such are scikit-learn's ``MLPRegressor`` and estimators with the same ``coefs_``, ``intercepts_`` and ``activation``, and skorch's
    regressors whose module is a sequence of linear layers with one kind of activation between; also as the last step of a pipeline whose
    other steps are affine, and with an affine transformation of the target. The layers are compared with the predictions of the estimator
    at `features`, shape (m, n), so that a module with another forward pass, or a step that is not affine, is not accepted.
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
    """Return activation and layers as if all steps were affine."""
    if isinstance(estimator, Pipeline) and len(estimator.steps) == 1:
        return _layers_of(estimator[0], n_features)
    if isinstance(estimator, Pipeline):
        matrix, shift = _affine(estimator[:-1].transform, n_features)
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
    """Return M and c of an affine transformation x -> x M + c."""
    values = np.asarray(transform(np.vstack([np.zeros((1, count)), np.eye(count)])), dtype=float)
    return values[1:] - values[0], values[0]


def _layers_of_module(module) -> tuple[str, Layers] | None:
    """Return the activation and the linear layers of a module of torch, in the order in which the module lists them."""
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
