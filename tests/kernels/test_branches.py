"""Steps of viscoelastic branches against formulas on matrices, differences and quadrature."""

import itertools

import numpy as np
import pytest
from memory_references import integrated
from scipy.integrate import quad

from pdsurrogate.kernels.branches import (
    tensors_of,
    weight_of_bow,
    weights_of_ends,
    weights_of_overstress,
)
from pdsurrogate.materials.histories import LOGS

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
@pytest.mark.parametrize("ratio", [None, 0.0, 1.5])
def test_step_is_the_minimum_of_an_energy(d, h, ratio):
    of = tensors_of(d)
    C, begin, end = tensors(d, 3)
    given = components(C, d), components(begin, d), h
    earlier = components(unimodular(begin + 0.1 * (begin - end)), d)
    B, b = of.begin_step(*given) if ratio is None else of.begin_curved_step(*given, earlier, ratio)

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


def along(mode, knots, stretches, n):
    """Times and Cb of n steps between knots."""
    time = np.concatenate([np.linspace(*ends, n + 1)[1:] for ends in itertools.pairwise(knots)])

    def at(t):
        logs = LOGS[mode](np.log(np.interp(t, knots, stretches)), 0.0)
        return np.diag(np.exp(2 * np.array(logs)))

    return [knots[0], *time], at


@pytest.mark.parametrize("mode", LOGS)
def test_steps_follow_a_parabola(mode):
    """A ramp, a hold and a return within a relaxation time, against SciPy at 1e-10."""
    of, knots, errors = tensors_of(3), [0.0, 1.0, 3.0, 4.0], []
    for n in (20, 40, 160):
        time, at = along(mode, knots, [1.0, 2.0, 2.0, 1.2], n)
        C, before, earlier, off = np.eye(3), np.eye(3), np.eye(3), []
        exact = iter(integrated(at, 1.0, knots[1:]))
        for row in range(1, len(time)):
            h, Cb, turns = time[row] - time[row - 1], at(time[row]), (row - 1) % n == 0
            ratio = 0.0 if turns else h / (time[row - 1] - time[row - 2])
            given = (components(one, 3) for one in (C, before))
            step = of.begin_curved_step(*given, h, components(earlier, 3), ratio)
            C = matrix_of(of.end_step(*step, components(Cb, 3)), 3)
            before, earlier = Cb, before
            if row % n == 0:
                off.append(Cb @ (np.linalg.inv(C) - np.linalg.inv(next(exact))))
        errors.append(np.abs(off).max())
    assert errors[0] / errors[1] > 5.0
    assert errors[2] < 1e-6


def test_a_jump_far_beyond_the_last_strain_takes_a_straight_step():
    of = tensors_of(3)
    far, near = np.diag([16.0, 0.25, 0.25]), np.eye(3)
    path = components(near, 3), components(near, 3), 30.0
    bent = of.begin_curved_step(*path, components(far, 3), 1.0)
    held = of.begin_curved_step(*path, components(near, 3), 0.0)
    np.testing.assert_allclose(bent[0], held[0])


@pytest.mark.parametrize("h", [0.1, 1.0, 3.0, 100.0])
def test_a_hold_is_exact_in_a_step_of_any_duration(h):
    of = tensors_of(3)
    for mode in LOGS:
        Cb = np.diag(np.exp(2 * np.array(LOGS[mode](np.log(2.0), 0.0))))
        expected = integrated(lambda _, Cb=Cb: Cb, 1.0, [h])[0]
        given = components(np.eye(3), 3), components(Cb, 3), h, components(np.eye(3), 3), 0.0
        C = matrix_of(of.end_step(*of.begin_curved_step(*given), components(Cb, 3)), 3)
        np.testing.assert_allclose(Cb @ np.linalg.inv(C), Cb @ np.linalg.inv(expected), atol=2e-4)


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
        bow = quad(lambda u, k: (1 - u) * at_end(u, k), 0, 1, args=(k,))[0]
        found = weight_of_bow(np.float64(k), np.exp(-k), both - end)
        np.testing.assert_allclose(found, bow, rtol=1e-8)
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
