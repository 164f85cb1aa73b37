"""Steps of viscoelastic branches against formulas on matrices, differences and quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad

from pdsurrogate.kernels.branches import tensors_of, weights_of_ends, weights_of_overstress

PLACES = {2: [(0, 0), (0, 1), (1, 1), (2, 2)], 3: [(r, c) for r in range(3) for c in range(r, 3)]}


def components(matrix, d):
    return tuple(matrix[place] for place in PLACES[d])


def matrix_of(values, d):
    found = np.zeros((3, 3))
    for (r, c), value in zip(PLACES[d], values, strict=True):
        found[r, c] = found[c, r] = value
    return found


def unimodular(matrix):
    return matrix / np.cbrt(np.linalg.det(matrix))


def tensors(d, count, seed=0):
    rng = np.random.default_rng(seed)
    F = np.tile(np.eye(3), (count, 1, 1))
    F[:, :d, :d] += 0.25 * rng.normal(size=(count, d, d))
    return [unimodular(one.T @ one) for one in F]


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("h", [0.0, 1e-6, 0.3, 20.0, 1e6, np.inf])
def test_step_is_the_minimum_of_an_energy(d, h):
    of = tensors_of(d)
    C, begin, end = tensors(d, 3)
    B, b = of.begin_step(components(C, d), components(begin, d), h)

    def step(Cb):
        return of.take_step(B, b, components(Cb, d))

    M, energy = step(end)
    found = matrix_of(of.end_step(B, b, components(end, d)), d)
    np.testing.assert_allclose(matrix_of(M, d) @ found, np.eye(3), atol=1e-10)
    np.testing.assert_allclose(found, unimodular(matrix_of(B, d) + b * end), rtol=1e-10, atol=1e-12)
    if h == 0:
        np.testing.assert_allclose(found, C, atol=1e-13)
        np.testing.assert_allclose(energy, np.trace(end @ np.linalg.inv(C)) / 2 - 1.5, atol=1e-12)
    if h == np.inf:
        np.testing.assert_allclose(found, end, atol=1e-13)
        np.testing.assert_allclose(energy, 0.0, atol=1e-13)
    # The derivative of the energy along isochoric changes of Cb is M/2.
    rate = tensors(d, 4)[3]
    rate = rate - np.trace(rate @ np.linalg.inv(end)) / 3 * end
    moved = [step(unimodular(end + sign * 1e-5 * rate))[1] for sign in (1, -1)]
    np.testing.assert_allclose(
        (moved[0] - moved[1]) / 2e-5, np.sum(matrix_of(M, d) * rate) / 2, atol=1e-9
    )


def test_weights_are_integrals():
    def at_end(u, k):
        return u * np.exp(-k * (1 - u))

    def at_both(u, k):
        return np.exp(-k * (1 - u))

    def last(u, h, n):
        share = np.expm1(-u) / np.expm1(-h)
        return (1 - share) ** (2 - n) * share**n

    for k in (1e-7, 0.0099, 0.0101, 1.0, 30.0):
        both, end = (quad(function, 0, 1, args=(k,))[0] for function in (at_both, at_end))
        np.testing.assert_allclose(
            weights_of_ends(np.float64(k)), [np.exp(-k), both - end, end], rtol=1e-10
        )
    np.testing.assert_array_equal(weights_of_overstress(np.float64(0.0)), 0.0)
    for h in (1e-7, 0.049, 0.051, 1.0, 30.0):
        expected = [quad(last, 0, h, args=(h, n))[0] for n in range(3)]
        np.testing.assert_allclose(weights_of_overstress(np.float64(h)), expected, rtol=1e-9)


@pytest.mark.parametrize("h", [0.0, 0.01, 1.0, 50.0])
@pytest.mark.parametrize("d", [2, 3])
def test_dissipation_of_a_held_step_is_the_fall_of_its_energy(d, h):
    of = tensors_of(d)
    C, held = tensors(d, 2, seed=3)
    energies, dissipated = [], 0.0
    for _ in range(20):
        B, b = of.begin_step(components(C, d), components(held, d), np.float64(h))
        after = matrix_of(of.end_step(B, b, components(held, d)), d)
        states = (components(one, d) for one in (held, C, after, held, after))
        dissipated += of.dissipation(*states, np.float64(h))
        energies.append(np.trace(held @ np.linalg.inv(C)) / 2)
        C = after
    fall = energies[0] - np.trace(held @ np.linalg.inv(C)) / 2
    np.testing.assert_allclose(dissipated, fall, rtol=1e-9, atol=1e-9)
