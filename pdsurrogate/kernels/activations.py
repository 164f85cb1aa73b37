"""Activation functions of networks with their first two derivatives, elementwise.

A network of an energy gives stresses through its slope and stiffness through its curvature, so the two are part of the function.  The same
expressions serve NumPy (checking, the tangent, the training of energies) and, compiled, the kernels, where what is not used costs nothing.
The algebraic sigmoid is exact to rounding without a root or a division; the exponential ones use `exponential`, whose error is below
2e-7 in single and 1e-15 in double precision.
"""

import numpy as np

from .elementary import exponential, inverse_square_root, select
from .feature_sets import like


def algebraic(x):
    """X / sqrt(1 + x^2): one inverse root gives value, slope and curvature; the cheapest smooth sigmoid."""
    r = inverse_square_root(like(x, 1.0) + x * x)
    slope = r * r * r
    return x * r, slope, like(x, -3.0) * x * slope * r * r


def logistic(x):
    """1 / (1 + exp(-x))."""
    value = like(x, 1.0) / (like(x, 1.0) + exponential(-x))
    slope = value * (like(x, 1.0) - value)
    return value, slope, slope * (like(x, 1.0) - value - value)


def tanh(x):
    """Tanh x = 1 - 2/(1 + exp(2x)); the absolute error near 0 is that of rounding at 1."""
    value = like(x, 1.0) - like(x, 2.0) / (like(x, 1.0) + exponential(x + x))
    slope = like(x, 1.0) - value * value
    return value, slope, like(x, -2.0) * value * slope


def relu(x):
    """max(x, 0)."""
    zero = like(x, 0.0)
    return np.maximum(x, zero), select(x > zero, like(x, 1.0), zero), zero


def identity(x):
    """X itself."""
    return x, like(x, 1.0), like(x, 0.0)


ACTIVATIONS = {function.__name__: function for function in (algebraic, logistic, tanh, relu, identity)}
"""``f(x) -> (value, slope, curvature)`` by name: those of scikit-learn's ``MLPRegressor``, and the algebraic sigmoid."""

SMOOTH = ("algebraic", "logistic", "tanh")
"""Those with which a network may stand for an energy."""
