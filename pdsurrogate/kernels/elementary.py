"""Elementary functions that LLVM vectorizes: they contain no library call and no branch.

NumPy evaluates them on arrays (`elementary_in_numpy`), and numba compiles the implementations of
this file for scalars of either precision. The llvmlite wheels bring no vector mathematics library,
so ``math.log`` or ``math.exp`` would prevent vectorization of a loop. Errors are relative unless
stated otherwise, and measured over the stated range (``tests/kernels/test_elementary.py``).
"""

import math

import numpy as np
from numba import types
from numba.cpython.unsafe.numbers import viewer
from numba.extending import overload

from ..engine.compile import INLINE_OPTIONS, inlined
from ..engine.intrinsics import finite_quotient
from .elementary_in_numpy import (
    chain_energy,
    error_function,
    exponential,
    inverse_cube_root,
    inverse_langevin,
    inverse_square_root,
    langevin,
    like,
    logarithm,
    polynomial,
    quotient,
    scaled_complement,
    select,
)

# Expressions of the functions above are compiled as they are.
for _function in (langevin, inverse_langevin, chain_energy, scaled_complement, error_function):
    inlined(_function)


@overload(select, jit_options=INLINE_OPTIONS)
def _select(condition, value, otherwise):
    return lambda condition, value, otherwise: value if condition else otherwise


@overload(like, jit_options=INLINE_OPTIONS)
def _like(x, value):
    if x == types.float32:
        return lambda x, value: np.float32(value)
    return lambda x, value: value


@overload(quotient, jit_options=INLINE_OPTIONS)
def _quotient(x, y):
    if x == types.float32:
        return lambda x, y: finite_quotient(x, y)
    return lambda x, y: x / y


def _format(x):
    """Return the NumPy type for the numba real type x, the integer type of equal width, and the
    number of its mantissa bits.
    """
    return (np.float32, np.int32, 23) if x == types.float32 else (np.float64, np.int64, 52)


@overload(inverse_cube_root, jit_options=INLINE_OPTIONS)
def _inverse_cube_root(x):
    real, whole, digits = _format(x)
    first = real(1419915264.0 if digits == 23 else 6142611528258043000.0)
    one, third, second, last = real(1.0), real(1 / 3), real(2 / 9), real(14 / 81)

    def implementation(x):
        # A first guess within 3.5 % from the exponent bits, then twice the series of (1 - d)^(-1/3)
        # for d = 1 - x r^3, up to its cube.
        r = viewer(whole(first - real(viewer(x, whole)) * third), real)
        for _ in range(2):
            d = one - x * r * r * r
            r = r + r * d * (third + d * (second + d * last))
        return r

    return implementation


@overload(inverse_square_root, jit_options=INLINE_OPTIONS)
def _inverse_square_root(x):
    if x == types.float32:
        # In single precision the compiler uses the processor's estimate and refines it.
        return lambda x: np.float32(1.0) / np.sqrt(x)

    def implementation(x):
        # A first guess within 4 % from the exponent bits, then Newton's iteration for r**-2 = x.
        r = viewer(
            np.int64(np.int64(0x5FE6EB50C7B537A9) - (viewer(x, np.int64) >> np.int64(1))),
            np.float64,
        )
        half = 0.5 * x
        for _ in range(4):
            r = r + r * (0.5 - half * r * r)
        return r

    return implementation


def _polynomial(coefficients, real):
    """Return the compiled function of a polynomial, see `polynomial`."""
    return inlined(polynomial(coefficients, real))


@overload(logarithm, jit_options=INLINE_OPTIONS)
def _logarithm(x):
    real, whole, digits = _format(x)
    root, terms = (whole(0x3F3504F3), 4) if digits == 23 else (whole(0x3FE6A09E667F3BCD), 10)
    digits = whole(digits)
    one = real(1.0)
    two = real(2.0)
    log_2 = real(math.log(2.0))
    artanh = _polynomial([1.0 / n for n in range(3, 3 + 2 * terms, 2)], real)

    def implementation(x):
        # x = m 2**e with m in [sqrt(1/2), sqrt(2)), and log m = 2 artanh(s), s = (m - 1)/(m + 1),
        # as a series in s^2 <= 0.0295. Each step is cut to the width of x: numba's integer
        # arithmetic has 64 bits, which would halve the vector width in single precision.
        bits = viewer(x, whole)
        exponent = whole(whole(bits - root) >> digits)
        m = viewer(whole(bits - whole(exponent << digits)), real)
        s = (m - one) / (m + one)
        return real(exponent) * log_2 + two * (s + s * s * s * artanh(s * s))

    return implementation


@overload(exponential, jit_options=INLINE_OPTIONS)
def _exponential(x):
    real, whole, digits = _format(x)
    if digits == 23:
        terms = 8
        bias = 127
        constants = (-87.0, 88.0, 0.693359375, -2.12194440e-4)
    else:
        terms = 14
        bias = 1023
        constants = (-708.0, 709.0, 6.93145751953125e-1, 1.42860682030941723212e-6)
    low, high, first, second, half, inverse = map(real, (*constants, 0.5, 1 / math.log(2.0)))
    digits = whole(digits)
    bias = whole(bias)
    taylor = _polynomial([1 / math.factorial(n) for n in range(terms)], real)

    def implementation(x):
        # x = k log 2 + r with |r| <= log(2)/2; e**r by its Taylor polynomial; 2**k through the
        # exponent bits. The multiples k of the first part of log 2 are exact.
        x = min(max(x, low), high)
        k = np.floor(x * inverse + half)
        r = x - k * first - k * second
        return taylor(r) * viewer(whole((whole(k) + bias) << digits), real)

    return implementation
