"""Activation functions with their derivatives, for training by the squared error.

Not the expressions of `pdsurrogate.kernels.activations`, which agree to 1e-15: a training magnifies the last bit of a function into other
weights, and the shipped artefacts come back to the last bit with these.
"""

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


ACTIVATIONS = {function.__name__: function for function in (algebraic, logistic, tanh, relu)}
"""``f(x) -> (value, derivative)`` by name; all of them are among the kernels' activations."""
