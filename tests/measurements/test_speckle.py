"""Fields that sun-dic and al-dic correlated from the same drawn images of a sheet, as they wrote
them (`tests/data/speckle/README.md`).
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import griddata

from pdsurrogate.measurements import read_fields

BASE = Path(__file__).parents[1] / "data" / "speckle" / "base"


@pytest.fixture(scope="module")
def fields():
    return {
        program: read_fields(*(BASE / program).glob("*.csv")) for program in ("sun-dic", "al-dic")
    }


@pytest.mark.parametrize("program", ["sun-dic", "al-dic"])
def test_a_sheet_that_is_pulled_grows_upward_and_shrinks_sideways(fields, program):
    """The grips are 480 pixels apart and move apart by 40 pixels a step; between them the sheet is
    narrower in the middle. The slopes are least squares over all places, beside the hole.
    """
    field = fields[program]
    assert field.unit == "px"
    for step in range(1, 7):
        here = field.step == step
        x, y = (field.places[here] - field.places[here].mean(axis=0)).T
        u, v = field.displacements[here].T
        assert x @ u / (x @ x) < -0.02 * step
        assert 0.8 * step / 12 < y @ v / (y @ y) < 1.2 * step / 12


def test_both_programs_see_the_same_motion(fields):
    """Median of the differences; each program is within 0.1 pixels of the motion that was drawn."""
    first, second = fields["sun-dic"], fields["al-dic"]
    for step in range(1, 7):
        one, other = first.step == step, second.step == step
        there = griddata(second.places[other], second.displacements[other], first.places[one])
        off = np.abs(there - first.displacements[one])
        assert np.nanmedian(off) < 0.1
        assert np.isfinite(off).mean() > 0.8
