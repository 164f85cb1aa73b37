"""Vectorized elementary functions against NumPy in double precision, over the ranges their
docstrings state.
"""

import numpy as np
import pytest
from scipy.special import erf

from pdsurrogate.engine.compile import inlined, kernel
from pdsurrogate.kernels import elementary
from pdsurrogate.kernels import network as activations
from pdsurrogate.paper.features import arctangent


def apply(function, *given):
    function = inlined(function)

    @kernel
    def of_one(x, out):
        for k in range(x.shape[0]):
            out[k] = function(x[k])

    @kernel
    def of_two(x, y, out):
        for k in range(x.shape[0]):
            out[k] = function(x[k], y[k])

    out = np.empty_like(given[0])
    (of_one if len(given) == 1 else of_two)(*given, out)
    return out.astype(float)


def spread(random, most, size=5000):
    """Positive numbers of all sizes."""
    return np.exp(random.uniform(-most, most, size))


def near_one(random):
    return 1 + np.exp(random.uniform(-9, -3, 2000)) * random.choice([-1, 1], 2000)


def around(random):
    angle = random.uniform(-1.57, 1.57, 5000)
    return 1.7 * np.sin(angle), 1.7 * np.cos(angle)


FUNCTIONS = {
    "quotient": (
        elementary.quotient,
        np.divide,
        lambda random: spread(random, 40, (2, 5000)) * random.choice([-1, 1], (2, 5000)),
    ),
    "inverse cube root": (
        elementary.inverse_cube_root,
        lambda x: 1 / np.cbrt(x),
        lambda random: [spread(random, 80)],
    ),
    "inverse square root": (
        elementary.inverse_square_root,
        lambda x: 1 / np.sqrt(x),
        lambda random: [spread(random, 80)],
    ),
    "logarithm": (elementary.logarithm, np.log, lambda random: [spread(random, 3)]),
    "logarithm near one": (elementary.logarithm, np.log, lambda random: [near_one(random)]),
    "exponential": (
        elementary.exponential,
        np.exp,
        lambda random: [random.uniform(-30, 30, 5000)],
    ),
    "arctangent": (arctangent, np.arctan2, around),
}
"""Functions, with those of NumPy and the arguments."""

BOUNDS = {
    "quotient": (3e-7, 2.3e-16),
    "inverse cube root": (3e-7, 4e-16),
    "inverse square root": (3e-7, 5e-16),
    "logarithm": (3e-7, 6e-16),
    "logarithm near one": (3e-7, 4e-16),
    "exponential": (3e-7, 2e-15),
    "arctangent": (4e-7, 1e-15),
}
"""Errors in single and in double precision: of the logarithm and of the arctangent absolute ones
where they pass through zero, else relative ones.
"""


@pytest.mark.parametrize("precision", [np.float32, np.float64])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_elementary_functions(random, name, precision):
    """In extended precision: NumPy's own rounding would add 2.2e-16."""
    function, exact, arguments = FUNCTIONS[name]
    given = [one.astype(precision) for one in arguments(random)]
    expected = exact(*(one.astype(np.longdouble) for one in given))
    scale = 1 if name in ("logarithm", "arctangent") else np.abs(expected)
    error = (np.abs(apply(function, *given) - expected) / scale).max()
    assert error < BOUNDS[name][precision is np.float64]


def test_the_logarithm_of_one_is_zero():
    for precision in (np.float32, np.float64):
        assert apply(elementary.logarithm, np.ones(4, precision))[0] == 0.0


EXACT = {
    "algebraic": lambda x: x / np.sqrt(1 + x * x),
    "logistic": lambda x: 1 / (1 + np.exp(-x)),
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0),
    "identity": lambda x: x,
}


@pytest.mark.parametrize("name", sorted(activations.ACTIVATIONS))
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 5e-7), (np.float64, 2e-15)])
def test_activations(random, name, dtype, tolerance):
    function = inlined(activations.ACTIVATIONS[name])

    def value(x):
        return function(x)[0]

    x = np.concatenate(
        [random.uniform(-20, 20, 3000), random.uniform(-0.1, 0.1, 1000), [0.0, -60.0, 60.0]]
    ).astype(dtype)
    exact = EXACT[name](x.astype(float))
    # Relative to the larger of 1 and the value: relu and the identity grow without bound.
    assert (np.abs(apply(value, x) - exact) / np.maximum(1, np.abs(exact))).max() < tolerance


@pytest.mark.parametrize("name", sorted(activations.ACTIVATIONS))
def test_slope_and_curvature_of_activations(random, name):
    function, x = activations.ACTIVATIONS[name], random.uniform(-8, 8, 200)
    _, slope, curvature = np.broadcast_arrays(*function(x))
    above, below = (np.broadcast_arrays(*function(x + step)) for step in (1e-6, -1e-6))
    np.testing.assert_allclose(slope, (above[0] - below[0]) / 2e-6, atol=1e-8)
    np.testing.assert_allclose(curvature, (above[1] - below[1]) / 2e-6, atol=1e-8)


def test_error_function():
    x = np.concatenate([np.linspace(0, 8, 20001), np.geomspace(1e-300, 1e-2, 1000), [30.0, 1e100]])
    decay = np.exp(-(np.minimum(x, 30.0) ** 2))
    for found in (
        elementary.error_function(x, decay),
        apply(elementary.error_function, x, decay),
    ):
        assert np.abs(found - erf(x)).max() < 2e-15
