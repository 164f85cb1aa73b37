"""The spread of a committee tells how far a result is off, where the form of the energy is right."""

import numpy as np
import pytest

import pdsurrogate as pd
from pdsurrogate.identification import nominal_stress

LAW = pd.Ogden(moduli=(0.4, -0.02), exponents=(2.0, -2.0))


@pytest.fixture(scope="module")
def measured():
    """Three modes with 2 % of noise."""
    stretch = np.linspace(1.05, 2.5, 15)
    X = np.concatenate([np.stack([stretch, lateral], axis=1) for lateral in (stretch**-0.5, np.ones(15), stretch)])
    return X, nominal_stress(LAW, X) * (1 + 0.02 * np.random.default_rng(1).standard_normal(len(X)))


def test_stresses_are_within_twice_the_spread(measured):
    """Of 200 states within the data at least nine in ten, as of two standard deviations; members repeat from their seed."""
    members = pd.committee(pd.EnergyRegressor(), *measured, n_members=12)
    random = np.random.default_rng(0)
    fresh = np.stack([random.uniform(1.3, 2.4, 200), random.uniform(0.8, 1.2, 200)], axis=1)
    stresses = np.array([member.predict(fresh) for member in members])
    off = np.abs(stresses.mean(axis=0) - nominal_stress(LAW, fresh))
    assert (off <= 2 * stresses.std(axis=0, ddof=1)).mean() >= 0.9
    again = pd.committee(pd.EnergyRegressor(), *measured, n_members=2)
    np.testing.assert_array_equal(again[1].weights_, members[1].weights_)


@pytest.mark.slow  # six runs
def test_a_sheet_with_a_hole_is_within_twice_the_spread(measured):
    """The pull on a sheet with a hole, by the law that made the data and by what was learnt from them."""

    def stress(law):
        scene = pd.load_scene("hole", spacing=0.1, stretches=1.5, material=law.describe())
        return pd.simulate(scene, "analytic").levels[0]["nominal_stress"]

    found = np.array([stress(member.law_) for member in pd.committee(pd.EnergyRegressor(), *measured, n_members=5)])
    assert abs(found.mean() - stress(LAW)) <= 2 * found.std(ddof=1)
    assert found.std(ddof=1) < 0.03 * found.mean()


def test_what_makes_no_committee_is_refused(measured):
    with pytest.raises(ValueError, match="at least two members, not 1"):
        pd.committee(pd.EnergyRegressor(), *measured, n_members=1)
    with pytest.raises(ValueError, match="at least two tests; there is one"):
        pd.committee(pd.EnergyRegressor(), *measured, tests=np.zeros(45))
