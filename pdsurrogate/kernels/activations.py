"""Activation functions of networks, elementwise, in the form the kernels evaluate.

The algebraic sigmoid is exact to rounding without a root or a division; the exponential ones use `exponential`, whose error is below
2e-7 in single and 1e-15 in double precision.
"""

import numpy as np

from .elementary import exponential, inverse_square_root, logarithm
from .feature_sets import like


def algebraic(x):
    """X / sqrt(1 + x^2), the cheapest smooth sigmoid."""
    return x * inverse_square_root(like(x, 1.0) + x * x)


def logistic(x):
    """1 / (1 + exp(-x))."""
    return like(x, 1.0) / (like(x, 1.0) + exponential(-x))


def tanh(x):
    """Tanh x = 1 - 2/(1 + exp(2x)); the absolute error near 0 is that of rounding at 1."""
    return like(x, 1.0) - like(x, 2.0) / (like(x, 1.0) + exponential(x + x))


def relu(x):
    """max(x, 0)."""
    return np.maximum(x, like(x, 0.0))


def softplus(x):
    """log(1 + exp(x)) = max(x, 0) + log(1 + exp(-abs(x)))."""
    return np.maximum(x, like(x, 0.0)) + logarithm(like(x, 1.0) + exponential(-np.abs(x)))


ACTIVATIONS = {function.__name__: function for function in (algebraic, logistic, tanh, relu, softplus)}
