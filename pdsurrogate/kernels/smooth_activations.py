"""Activation functions of energy networks with their first two derivatives, elementwise.

A network of an energy gives stresses through its slope and stiffness through its curvature, so the two are part of the function.  The same
expressions serve NumPy (training, checking, the tangent) and, compiled, the kernels, where what is not used costs nothing.
"""

from .elementary import exponential, inverse_square_root
from .feature_sets import like


def algebraic(x):
    """X / sqrt(1 + x^2): one inverse root gives value, slope and curvature."""
    r = inverse_square_root(like(x, 1.0) + x * x)
    slope = r * r * r
    return x * r, slope, like(x, -3.0) * x * slope * r * r


def logistic(x):
    """1 / (1 + exp(-x))."""
    value = like(x, 1.0) / (like(x, 1.0) + exponential(-x))
    slope = value * (like(x, 1.0) - value)
    return value, slope, slope * (like(x, 1.0) - value - value)


def tanh(x):
    """Hyperbolic tangent."""
    value = like(x, 1.0) - like(x, 2.0) / (like(x, 1.0) + exponential(x + x))
    slope = like(x, 1.0) - value * value
    return value, slope, like(x, -2.0) * value * slope


SMOOTH_ACTIVATIONS = {function.__name__: function for function in (algebraic, logistic, tanh)}
"""``f(x) -> (value, slope, curvature)`` by name."""
