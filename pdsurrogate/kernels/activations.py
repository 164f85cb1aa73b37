"""Activation functions of networks, each with its first and second derivative, elementwise.

A network that represents an energy gives the stress through the slope and the stiffness through the curvature. NumPy evaluates the same
expressions for checks and training; compiled, unused derivatives cost nothing. The algebraic sigmoid is exact to rounding; the others use
`exponential`, whose error is below 2e-7 in single and 1e-15 in double precision.
"""

import numpy as np

from .elementary import exponential, inverse_square_root, select
from .feature_sets import like


def algebraic(x):
    """Evaluate x / sqrt(1 + x^2), the cheapest smooth sigmoid: one inverse square root gives value, slope and curvature."""
    r = inverse_square_root(like(x, 1.0) + x * x)
    slope = r * r * r
    return x * r, slope, like(x, -3.0) * x * slope * r * r


def logistic(x):
    """Evaluate 1 / (1 + exp(-x))."""
    value = like(x, 1.0) / (like(x, 1.0) + exponential(-x))
    slope = value * (like(x, 1.0) - value)
    return value, slope, slope * (like(x, 1.0) - value - value)


def tanh(x):
    """Evaluate tanh x as 1 - 2/(1 + exp(2x)); the absolute error near 0 is the rounding error at 1."""
    value = like(x, 1.0) - like(x, 2.0) / (like(x, 1.0) + exponential(x + x))
    slope = like(x, 1.0) - value * value
    return value, slope, like(x, -2.0) * value * slope


def relu(x):
    """Evaluate max(x, 0)."""
    zero = like(x, 0.0)
    return np.maximum(x, zero), select(x > zero, like(x, 1.0), zero), zero


def identity(x):
    """Return x, with slope 1 and curvature 0."""
    return x, like(x, 1.0), like(x, 0.0)


ACTIVATIONS = {function.__name__: function for function in (algebraic, logistic, tanh, relu, identity)}
"""Activation functions ``f(x) -> (value, slope, curvature)`` by name: those of scikit-learn's ``MLPRegressor`` and the algebraic sigmoid.
"""

SMOOTH = ("algebraic", "logistic", "tanh")
"""Names of the activations smooth enough for a network that represents an energy."""
