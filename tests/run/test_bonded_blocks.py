"""Blocks and sheets with bonded ends that relax, against finite elements of FElupe."""

import numpy as np
import pytest
from memory_references import ELEMENTS

import pdsurrogate as pds

STEPS = 16
"""Steps a relaxation time."""

BRANCHES = [{"modulus": 1.0, "time": 1.0}]


def program():
    """Stretches and times: to 1.5 in a relaxation time, held nine, to 1.2 in half of one, held
    five.
    """
    ends, stretches = [0.0, 1.0, 2.0, 4.0, 10.0, 10.5, 11.5, 15.5], [1.0, *[1.5] * 4, *[1.2] * 3]
    parts = [STEPS, STEPS // 2, STEPS // 2, STEPS // 2, STEPS // 2, STEPS // 2, STEPS // 2]
    times = [
        np.linspace(begin, end, count + 1)[1:]
        for begin, end, count in zip(ends, ends[1:], parts, strict=False)
    ]
    times = np.concatenate(times)
    return times, np.interp(times, ends, stretches), np.cumsum(parts) - 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plane", "reference", "bound"),
    [("strain", ELEMENTS["relaxing"][1], 1.5e-3), ("stress", ELEMENTS["sheet"], 3e-3)],
)
def test_forces_of_a_relaxing_block(plane, reference, bound):
    times, stretches, rows = program()
    assert times[rows] == pytest.approx(reference["times"])
    result = pds.simulate(
        pds.Scene(
            name="block",
            spacing=1 / 24,
            plane=plane,
            body={"shape": "rectangle", "size": [1.0, 1.0]},
            material={"law": "neo-hookean", "branches": BRANCHES},
            grips=[{"edge": "left"}, {"edge": "right", "travel": 1.0}],
            stretches=stretches.tolist(),
            times=times.tolist(),
        ),
        "bond-energy",
    )
    found = np.array([level["forces"]["right"][0] for level in result.levels])[rows]
    expected = np.array(reference["forces"])
    assert np.abs(found - expected).max() < bound * expected.max()
