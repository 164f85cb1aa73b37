"""Parts of the calibration of energies without a law."""

import numpy as np
import pytest

from pdsurrogate.calibration.free import grouping


def test_smooth_residuals_tell_less_than_independent_ones(random):
    """1,225 places, 3 steps, 2 components: the mean square of some 190 groups without common places
    has a scatter of 10 %.

    Constant residuals give the number of residuals in a group.
    """
    side = np.linspace(0.0, 1.0, 35)
    places = np.tile(np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2), (6, 1))
    component = np.repeat([1, 2], len(places) // 2)
    noise = random.standard_normal(len(places))
    total, count = grouping(noise, places, component)
    assert total / count / (noise**2).mean() == pytest.approx(1.0, abs=0.3)
    total, count = grouping(np.ones(len(places)), places, component)
    assert total / count == pytest.approx(3 * 13)
