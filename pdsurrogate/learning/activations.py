"""Activation functions with their derivatives, for training by the squared error.

The expressions differ from those of `pdsurrogate.kernels.activations` by 1e-15. A training magnifies the last bit into other weights, and
only with these do the weights of the shipped artefacts come out again (``pipelines/fit_shipped.py --check``).
"""

import numpy as np
from scipy.special import expit


def algebraic(x):
    """Return x / sqrt(1 + x^2) and its derivative."""
    inverse = 1 / np.sqrt(1 + x * x)
    return x * inverse, inverse**3


def logistic(x):
    """Return 1 / (1 + exp(-x)) and its derivative."""
    value = expit(x)
    return value, value * (1 - value)


def tanh(x):
    """Return the hyperbolic tangent and its derivative."""
    value = np.tanh(x)
    return value, 1 - value * value


def relu(x):
    """Return max(x, 0) and its derivative."""
    return np.maximum(x, 0), (x > 0).astype(float)


ACTIVATIONS = {function.__name__: function for function in (algebraic, logistic, tanh, relu)}
"""Functions ``f(x) -> (value, derivative)`` by name; the kernels have all of them."""
