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


def apply(function, x):
    function = inlined(function)

    @kernel
    def loop(x, y):
        for k in range(x.shape[0]):
            y[k] = function(x[k])

    y = np.empty_like(x)
    loop(x, y)
    return y.astype(float)


def apply_to_both(function, x, y):
    function = inlined(function)

    @kernel
    def loop(x, y, out):
        for k in range(x.shape[0]):
            out[k] = function(x[k], y[k])

    out = np.empty_like(x)
    loop(x, y, out)
    return out.astype(float)


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 3e-7), (np.float64, 2.3e-16)])
def test_quotient(random, dtype, tolerance):
    x, y = (np.exp(random.uniform(-40, 40, (2, 5000))) * random.choice([-1, 1], (2, 5000))).astype(
        dtype
    )
    assert (
        np.abs(
            apply_to_both(elementary.quotient, x, y) * y.astype(float) / x.astype(float) - 1
        ).max()
        < tolerance
    )


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 3e-7), (np.float64, 4e-16)])
def test_inverse_cube_root(random, dtype, tolerance):
    x = np.exp(random.uniform(-80, 80, 5000)).astype(dtype)
    # In extended precision: a cube root in double precision would add its own rounding of 2.2e-16.
    exact = np.cbrt(x.astype(np.longdouble))
    assert (
        np.abs(apply(elementary.inverse_cube_root, x).astype(np.longdouble) * exact - 1).max()
        < tolerance
    )


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 3e-7), (np.float64, 5e-16)])
def test_inverse_square_root(random, dtype, tolerance):
    x = np.exp(random.uniform(-80, 80, 5000)).astype(dtype)
    assert (
        np.abs(apply(elementary.inverse_square_root, x) * np.sqrt(x.astype(float)) - 1).max()
        < tolerance
    )


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 3e-7), (np.float64, 6e-16)])
def test_logarithm(random, dtype, tolerance):
    x = np.exp(random.uniform(-3, 3, 5000)).astype(dtype)
    assert np.abs(apply(elementary.logarithm, x) - np.log(x.astype(float))).max() < tolerance
    assert apply(elementary.logarithm, np.ones(4, dtype))[0] == 0.0


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 3e-7), (np.float64, 4e-16)])
def test_logarithm_is_relatively_accurate_near_one(random, dtype, tolerance):
    x = (1 + np.exp(random.uniform(-9, -3, 2000)) * random.choice([-1, 1], 2000)).astype(dtype)
    assert np.abs(apply(elementary.logarithm, x) / np.log(x.astype(float)) - 1).max() < tolerance


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 3e-7), (np.float64, 2e-15)])
def test_exponential(random, dtype, tolerance):
    x = random.uniform(-30, 30, 5000).astype(dtype)
    assert np.abs(apply(elementary.exponential, x) / np.exp(x.astype(float)) - 1).max() < tolerance


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 4e-7), (np.float64, 1e-15)])
def test_arctangent(random, dtype, tolerance):
    angle = random.uniform(-1.57, 1.57, 5000)
    y, x = (1.7 * np.sin(angle)).astype(dtype), (1.7 * np.cos(angle)).astype(dtype)
    assert (
        np.abs(apply_to_both(arctangent, y, x) - np.arctan2(y.astype(float), x.astype(float))).max()
        < tolerance
    )


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
        apply_to_both(elementary.error_function, x, decay),
    ):
        assert np.abs(found - erf(x)).max() < 2e-15
