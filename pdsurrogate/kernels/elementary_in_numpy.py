"""Elementary functions, as NumPy evaluates them on arrays; material laws and feature sets are
written with them.

Compiled code has implementations of its own (`elementary`), which state the errors given here. The
inverse Langevin function, the force that stretches a chain of freely jointed links, and the free
energy of a chain are written with these functions. This file loads no numba, so that a scene with a
mistake in it is refused without.
"""

import numpy as np


def select(condition, value, otherwise):
    """Return `value` where the condition holds, else `otherwise`; both are computed, since a
    branch would prevent vectorization.
    """
    return np.where(condition, value, otherwise)


def like(x, value):
    """Return `value`; in compiled code, convert it to single precision if `x` is in single
    precision.
    """
    return value


def quotient(x, y):
    """Return x/y for finite x and finite, non-zero y. Relative error below 3e-7 (float32) and
    2.3e-16 (float64).
    """
    return x / y


def inverse_cube_root(x):
    """Return x**(-1/3) for x > 0. Relative error below 3e-7 (float32) and 4e-16 (float64) over
    all normal numbers.
    """
    return np.cbrt(x) ** -1.0


def inverse_square_root(x):
    """Return x**(-1/2) for x > 0. Relative error below 3e-7 (float32) and 5e-16 (float64) over all
    normal numbers.

    Double precision uses multiplications only: on some processors a square root and a division take
    longer than the rest of a network.
    """
    return 1 / np.sqrt(x)


def logarithm(x):
    """Return the natural logarithm for x > 0.

    Absolute error below 3e-7 (float32) and 6e-16 (float64) for x in [0.05, 20]; relative error
    below 3e-7 and 4e-16 near 1; exactly 0 at 1.
    """
    return np.log(x)


def exponential(x):
    """Return e**x, with x clipped to [-87, 88] (float32) or [-708, 709] (float64).

    Relative error below 3e-7 (float32) and 2e-15 (float64) for abs(x) <= 30.
    """
    return np.exp(np.clip(x, -708.0, 709.0))


def langevin(beta):
    """Return the Langevin function coth(beta) - 1/beta for beta >= 0. Relative error below
    1e-15.
    """
    # coth - 1/beta cancels for small arguments; there the eight terms of Lambert's continued
    # fraction are exact to rounding.
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


def inverse_langevin(y):
    """Return beta with langevin(beta) = y, and the derivative of beta by y, for 0 < y < 1; NaN for
    y >= 1, where a chain is straight.

    Two steps of Halley's iteration improve Kroeger's approximation, which is within 0.2 %: relative
    error below 1e-14 up to y = 0.99 (Kroeger, J. Non-Newton. Fluid Mech. 223 (2015) 77).
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


def chain_energy(y, beta):
    """Return the free energy of a chain of freely jointed links, y beta + log(beta/sinh(beta)),
    divided by kT and the number of links.

    y is the extension of the chain divided by its full length, and beta = inverse_langevin(y).
    Absolute error below 1e-14.
    """
    decay = exponential(-2 * beta)
    # 0 * beta passes NaN on, which the kernels' logarithm does not.
    return y * beta - beta - logarithm((1 - decay) / (2 * beta)) + 0 * beta


_ERFC = (
    1.2375126308378264,
    -0.1402405985855061,
    0.003585415485781718,
    0.08227673848712364,
    -0.10880393015455231,
    0.09230432122630407,
    -0.058693398387769276,
    0.028362276757789878,
    -0.009746581194305737,
    0.0017556295098350434,
    0.0002937214295671746,
    -0.00029016629854870584,
    5.162601622259853e-05,
    2.2410019228612918e-05,
    -1.1399726074447365e-05,
    -1.0083452170479683e-06,
    1.6959958079430478e-06,
    -2.7749611122883763e-08,
    -2.143069227582364e-07,
    8.526359817483033e-09,
    1.7552176307433927e-08,
)
"""Coefficients, from the constant one on, of the Chebyshev series of (1 + 2 x) exp(x^2) erfc(x) in
t = (x - 3.75)/(x + 3.75) up to degree 20, as powers of t.
"""


def polynomial(coefficients, real=float):
    """Return the function that evaluates a polynomial in precision `real` by Horner's rule;
    `coefficients` begin with the constant term.
    """
    names = {f"c{n}": real(coefficient) for n, coefficient in enumerate(coefficients)}
    *others, nested = names
    for name in reversed(others):
        nested = f"{name} + x * ({nested})"
    return eval(f"lambda x: {nested}", names)


scaled_complement = polynomial(_ERFC)


def error_function(x, decay):
    """Return erf x for 0 <= x <= 1e100, where ``decay`` is exp(-x^2). Absolute error below 2e-15.

    Shepherd, Laframboise, Math. Comp. 36 (1981) 249: one polynomial for all x.
    """
    t = (x - 3.75) / (x + 3.75)
    return 1.0 - decay * scaled_complement(t) / (1.0 + 2.0 * x)
