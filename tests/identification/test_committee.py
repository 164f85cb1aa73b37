"""The spread of a committee tells how far a result is off, where the form of the energy is
right.
"""

import numpy as np
import pytest
from sklearn.linear_model import Ridge

import pdsurrogate as pds
from pdsurrogate.identification import nominal_stress

# K/mu as a fit takes it, which no test tells
LAW = pds.materials.Ogden(moduli=(0.4, -0.02), exponents=(2.0, -2.0), bulk_modulus=420.0)


@pytest.fixture(scope="module")
def measured():
    """Three modes with 2 % of noise."""
    stretch = np.linspace(1.05, 2.5, 15)
    X = np.concatenate(
        [np.stack([stretch, lateral], axis=1) for lateral in (stretch**-0.5, np.ones(15), stretch)]
    )
    return X, nominal_stress(LAW, X) * (1 + 0.02 * np.random.default_rng(1).standard_normal(len(X)))


@pytest.mark.slow  # a dozen committees
def test_stresses_are_within_twice_the_spread(measured):
    """Of states between the tests, by twelve sets of data with 2 % of noise, each weighted by its
    variance.

    The nominal share is 95 %.  Errors of the states of one set go together, some three of them
    being free, so the share of twelve sets has a standard deviation of about sqrt(0.05 * 0.95 / 36)
    = 4 %; and the spread is to be no larger than it need be, in the root mean square. The law was
    not looked at when the committee's make was chosen.
    """
    law, random = pds.materials.Gent(0.4, 400.0, 60.0), np.random.default_rng(0)
    fresh = np.stack([random.uniform(1.2, 2.4, 50), random.uniform(0.8, 1.2, 50)], axis=1)
    right, X, off, spread = nominal_stress(law, fresh), measured[0], [], []
    for seed in range(12):
        y = nominal_stress(law, X) * (
            1 + 0.02 * np.random.default_rng(seed).standard_normal(len(X))
        )
        model = pds.identification.EnergyRegressor().fit(X, y, y**-2)
        found, members = (
            model.predict(fresh),
            [
                one.predict(fresh)
                for one in pds.identification.committee(
                    model, X, y, random_state=seed, sample_weight=y**-2
                )
            ],
        )
        off.append(found / right - 1)
        spread.append(pds.identification.committee_spread(found, members) / right)
    assert np.mean(np.abs(off) <= 2 * np.array(spread)) >= 0.87
    assert np.mean(np.square(spread)) < 4 * np.mean(np.square(off))


def test_the_spread_of_few_members_is_students(random):
    """Twice the spread of normal deviations holds as many as twice their standard deviation,
    whatever the number of members.
    """
    for count in (3, 8):
        draws = random.standard_normal((200_000, 1 + count))
        within = np.abs(draws[:, 0]) <= 2 * pds.identification.committee_spread(0.0, draws[:, 1:].T)
        assert within.mean() == pytest.approx(0.9545, abs=0.002)


def test_members_repeat_from_their_seed_and_have_half_of_the_tests(measured):
    members, again = (
        pds.identification.committee(pds.identification.EnergyRegressor(), *measured, n_members=2)
        for _ in range(2)
    )
    np.testing.assert_array_equal(again[1].weights_, members[1].weights_)
    assert not np.array_equal(members[0].weights_, members[1].weights_)
    kawabata = pds.load_test_data("kawabata")
    tests = kawabata.tests
    assert len(set(tests)) > len(kawabata) / 2 - 5
    for test in set(tests):  # both stresses of a biaxial state
        assert len({tuple(np.sort(row).round(6)) for row in kawabata.stretches[tests == test]}) == 1


def test_what_makes_no_committee_is_refused(measured):
    with pytest.raises(ValueError, match="n_members must be at least 2, not 1"):
        pds.identification.committee(pds.identification.EnergyRegressor(), *measured, n_members=1)
    with pytest.raises(
        TypeError, match="regressor must be a LawRegressor or an EnergyRegressor, not a Ridge"
    ):
        pds.identification.committee(Ridge(), *measured)
    with pytest.raises(ValueError, match="at least two tests, but there is only one"):
        pds.identification.committee(
            pds.identification.EnergyRegressor(), *measured, tests=np.zeros(45)
        )
