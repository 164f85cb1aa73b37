"""Search for the relaxation times that pass in a step, far from steady loading."""

import numpy as np
import pytest
from scipy.integrate import quad

from pdsurrogate.kernels.rates import log_mean_time, log_overstress, times_passed
from pdsurrogate.materials.histories import advanced

SPAN = np.log(100.0)


def squares(random, size, count=2000):
    """Principal values of isochoric tensors."""
    logs = size * random.normal(size=(count, 3))
    return np.exp(2 * (logs - logs.mean(axis=1, keepdims=True)))


@pytest.mark.parametrize("power", [1.0, 10.0])
def test_every_step_passes_its_time(power):
    """Steps of 1e-6 to 1e6 relaxation times, between states that have nothing in common."""
    random = np.random.default_rng(0)
    before, after = squares(random, 0.7), squares(random, 0.7)
    states = before**0.7 * squares(random, 0.7) ** 0.3
    steps = 10.0 ** random.uniform(-6, 6, len(before))

    def log_rate(squares, states):
        logs = log_overstress((squares / states).sum(axis=-1), (states / squares).sum(axis=-1))
        return power * np.clip(logs - np.log(0.05), 0, SPAN)

    def ended(times):
        each = advanced(states[:, None], before[:, None], times[:, None])(after[:, None])
        return log_rate(after, each[:, 0])

    begun = log_rate(before, states)
    passed = times_passed(steps, begun, ended, power * SPAN)
    assert passed * np.exp(log_mean_time(begun, ended(passed))) == pytest.approx(steps, rel=1e-9)
    assert (passed >= steps * (1 - 1e-12)).all()


@pytest.mark.parametrize(("begin", "end"), [(0.0, 0.0), (2.0, 2.001), (0.3, 5.0), (5.0, 0.3)])
def test_the_mean_time_is_that_of_a_rate_whose_logarithm_is_linear(begin, end):
    mean = quad(lambda u: np.exp(-(begin + u * (end - begin))), 0, 1)[0]
    assert log_mean_time(begin, end) == pytest.approx(np.log(mean), abs=1e-12)


def test_sudden_and_endless_steps_pass_no_time_and_all():
    steps = np.array([0.0, np.inf])
    assert times_passed(steps, np.zeros(2), lambda times: 0 * times, 1.0).tolist() == [0, np.inf]
