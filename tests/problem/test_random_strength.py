"""Random strengths: their least value follows the theory of the weakest link, and neither the
spacing nor the correlation length changes the strength of specimens.
"""

import math

import numpy as np
import pytest
from scipy import stats

from pdsurrogate.materials import Gent, NeoHookean, homogeneous
from pdsurrogate.problem.random_strength import strength_factors, works_at_break

MODULUS = 8.0
SPECIMEN = (6.0, 2.0)


def lattice(spacing, *sides):
    """Points at the middles of cells of a box from the origin."""
    axes = [np.arange(spacing / 2, side, spacing) for side in sides]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(sides))


def least(sides, length, seeds=400, spacing=0.25):
    """Least factors of a box by seed."""
    places = lattice(spacing, *sides)
    return np.array(
        [
            strength_factors(places, np.zeros(2), length, MODULUS, SPECIMEN, seed).min()
            for seed in range(seeds)
        ]
    )


@pytest.mark.parametrize(
    ("sides", "length"),
    [((6.0, 2.0), 0.5), ((6.0, 2.0), 1.0), ((12.0, 4.0), 1.0), ((8.0, 0.5), 0.5)],
)
def test_the_weakest_link_has_the_distribution_of_weibull(sides, length):
    """Exactly, for any number of cells: modulus m and scale (V0 / V1)^(1/m) / Gamma(1 + 1/m)."""
    found = least(sides, length)
    share = math.prod(SPECIMEN) / math.prod(sides)
    exact = stats.weibull_min(MODULUS, scale=share ** (1 / MODULUS) / math.gamma(1 + 1 / MODULUS))
    assert stats.kstest(found, exact.cdf).pvalue > 0.01
    assert exact.mean() == pytest.approx(share ** (1 / MODULUS))
    assert found.mean() == pytest.approx(exact.mean(), abs=3 * exact.std() / np.sqrt(len(found)))
    assert found.std() == pytest.approx(exact.std(), rel=0.1)


def test_factors_are_those_of_places_not_of_points():
    """At any spacing, for any choice of points; another seed draws others, independent of them."""
    coarse, fine = lattice(0.5, 6.0, 2.0), lattice(0.125, 6.0, 2.0)

    def factors(places, seed=3):
        return strength_factors(places, np.zeros(2), 1.0, MODULUS, SPECIMEN, seed)

    cells = np.floor(fine)
    for place, factor in zip(coarse, factors(coarse), strict=True):
        same = (cells == np.floor(place)).all(axis=1)
        assert (factors(fine)[same] == factor).all()
    some = np.random.default_rng(0).permutation(len(fine))[:50]
    np.testing.assert_array_equal(factors(fine[some]), factors(fine)[some])
    others = np.unique(factors(fine, seed=4))
    assert len(others) == 12
    assert not np.isin(others, factors(fine)).any()


def test_cells_are_independent_of_their_neighbors_in_all_directions():
    cubes = lattice(1.0, 12.0, 12.0, 12.0)
    drawn = strength_factors(cubes, np.zeros(3), 1.0, 5.0, (1.0, 1.0, 1.0), 1).reshape(12, 12, 12)
    ranks = stats.rankdata(drawn).reshape(drawn.shape)
    for axis in range(3):
        one, other = (np.take(ranks, range(*ends), axis) for ends in ((0, 11), (1, 12)))
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 4 / np.sqrt(one.size)
    assert (
        stats.kstest(drawn.ravel(), stats.weibull_min(5.0, scale=1 / math.gamma(1.2)).cdf).pvalue
        > 0.01
    )


@pytest.mark.parametrize("law", [NeoHookean(0.5, 50.0), Gent(0.5, 50.0, 20.0)])
def test_works_at_break_are_those_of_the_stresses(law):
    stretches = np.array([1.3, 1.9, 2.6])
    states = [homogeneous.uniaxial(law, one) for one in stretches]
    stress = np.array([one.nominal_stress for one in states])
    factors = stress / stress[1]
    found = works_at_break(law, stress[1], factors, factors[2])
    np.testing.assert_allclose(found, [one.energy_density for one in states], rtol=1e-4)


@pytest.mark.parametrize("spread", [0.0, 1e-14, 1e-6])
def test_works_at_break_of_stresses_that_hardly_differ(spread):
    law = NeoHookean(0.5, 50.0)
    state = homogeneous.uniaxial(law, 1.9)
    factors = np.array([1 - spread, 1.0])
    found = works_at_break(law, state.nominal_stress, factors, factors[1])
    np.testing.assert_allclose(found, state.energy_density, rtol=1e-5)
