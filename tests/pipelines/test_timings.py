"""Costs of runs: what processes of a checkout are asked is what their scripts read."""

import pytest
import timings

import pdsurrogate as pds


def test_a_run_tells_its_figures_and_its_cost():
    changes = {"spacing": 0.1, "stretches": 1.1}
    found = timings.run("uniaxial", changes)(timings.ROOT)
    (level,) = pds.simulate(pds.load_scene("uniaxial", changes)).levels
    assert found["nominal_stress at 1.1"] == pytest.approx(level["nominal_stress"], rel=1e-5)
    assert {"evaluations", "run (s)", "processor time (s)", "memory (MB)"} <= found.keys()
