"""Activation functions with their derivatives, for training."""

import numpy as np
from scipy.special import expit


def algebraic(x):
    """X / sqrt(1 + x^2)."""
    inverse = 1 / np.sqrt(1 + x * x)
    return x * inverse, inverse**3


def logistic(x):
    """1 / (1 + exp(-x))."""
    value = expit(x)
    return value, value * (1 - value)


def tanh(x):
    """Hyperbolic tangent."""
    value = np.tanh(x)
    return value, 1 - value * value


def relu(x):
    """max(x, 0)."""
    return np.maximum(x, 0), (x > 0).astype(float)


def softplus(x):
    """log(1 + exp(x))."""
    return np.logaddexp(0, x), expit(x)


ACTIVATIONS = {function.__name__: function for function in (algebraic, logistic, tanh, relu, softplus)}
"""``f(x) -> (value, derivative)`` by name; the names are those of the kernels' activations."""
