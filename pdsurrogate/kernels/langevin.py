"""The inverse Langevin function, accurate to rounding: the force that stretches a chain of freely jointed links.

NumPy evaluates the expressions on arrays, and numba compiles them into the kernels.
"""

from numba.extending import register_jitable

from ..engine.compile import INLINE_OPTIONS
from .elementary import exponential, logarithm, select

_compiled = register_jitable(**INLINE_OPTIONS)


@_compiled
def langevin(beta):
    """Return coth(beta) - 1/beta for beta >= 0. Relative error below 1e-15."""
    # coth - 1/beta cancels for small arguments; there the eight terms of Lambert's continued fraction are exact to rounding.
    square = beta * beta
    fraction = 15 + square / 17
    fraction = 13 + square / fraction
    fraction = 11 + square / fraction
    fraction = 9 + square / fraction
    fraction = 7 + square / fraction
    fraction = 5 + square / fraction
    fraction = 3 + square / fraction
    large = select(beta > 1.0, beta, 1.0)
    decay = exponential(-2 * large)
    return select(beta > 1.0, (1 + decay) / (1 - decay) - 1 / large, beta / fraction)


@_compiled
def inverse_langevin(y):
    """Return beta with langevin(beta) = y, and its derivative by y, for 0 < y < 1; NaN for y >= 1, where the chain is straight.

    Two steps of Halley's iteration improve Kroeger's approximation, which is within 0.2 %: relative error below 1e-14 up to y = 0.99
    (Kroeger, J. Non-Newton. Fluid Mech. 223 (2015) 77).
    """
    square = y * y
    room = select(y < 1.0, 1 - square, y * float("nan"))
    beta = y * (3 - square / 5 * (6 + square - 2 * square * square)) / room
    for _ in range(2):
        value = langevin(beta)
        # The Langevin function satisfies L' = 1 - L^2 - 2 L/beta.
        slope = 1 - value * value - 2 * value / beta
        curvature = 2 * value / (beta * beta) - 2 * slope * (value + 1 / beta)
        error = value - y
        beta = beta - error * slope / (slope * slope - error * curvature / 2)
    return beta, 1 / (1 - square - 2 * y / beta)


@_compiled
def chain_energy(y, beta):
    """Return the free energy of a chain over kT and its number of links, y beta + log(beta/sinh(beta)), for beta = inverse_langevin(y).

    Absolute error below 1e-14.
    """
    decay = exponential(-2 * beta)
    # 0 * beta passes NaN on, which the kernels' logarithm does not.
    return y * beta - beta - logarithm((1 - decay) / (2 * beta)) + 0 * beta
