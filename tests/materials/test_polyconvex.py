"""The dictionary of polyconvex energies: its derivatives, its convexity, and the laws that are
sums of its terms.
"""

from unittest.mock import patch

import numpy as np
import pytest
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.materials import plane_stress
from pdsurrogate.materials.dictionary import (
    KINDS,
    Term,
    derivatives,
    line_curvatures,
    wave_margin,
)
from pdsurrogate.materials.polyconvex import law_of

TERMS = [Term("stretches", exponent) for exponent in (-6.0, -1.0, 1.0, 2.0, 3.25, 12.0)]
TERMS += [Term(kind, power) for kind in ("first", "second") for power in (1.0, 2.0, 3.0, 4.0)]
TERMS += [Term("roots", 1.0), Term("roots", 2.0)]
TERMS += [Term("second_logarithm", 1.0)]
POLYCONVEX = tuple(term for term in TERMS if term.polyconvex)


def energy_of(term, F):
    """Energy of a term for a deformation gradient of determinant 1, from the invariants of C."""
    C = F.T @ F
    first, second = np.trace(C), np.trace(np.linalg.inv(C))
    x, y, number = first - 3, second**1.5 - 3**1.5, term.number
    if term.kind == "stretches":
        return (np.linalg.eigvalsh(C) ** (number / 2)).sum() / number**2 - 3 / number**2
    if term.kind == "second_logarithm":
        return np.log(second / 3)
    return {
        "first": x**number,
        "second": y**number,
        "roots": np.sqrt((first, second)[int(number) % 2 - 1]) - np.sqrt(3),
    }[term.kind]


def test_every_kind_is_tried():
    assert {term.kind for term in TERMS} == set(KINDS)
    assert len({str(term) for term in TERMS}) == len(TERMS)


def test_energies_and_slopes_of_terms(random):
    """Against the formulas of the energies, and the slopes against differences of energies."""
    logs = random.uniform(-0.8, 0.8, (20, 3))
    logs -= logs.mean(axis=1, keepdims=True)
    energies, slopes = derivatives(TERMS, logs)
    expected = [[energy_of(term, np.diag(np.exp(row))) for term in TERMS] for row in logs]
    np.testing.assert_allclose(energies, expected, rtol=1e-9, atol=1e-11)
    step = 1e-5
    for along in np.array([[1, -1, 0], [1, 1, -2], [0, 1, -1]]):
        differences = (
            derivatives(TERMS, logs + step * along)[0] - derivatives(TERMS, logs - step * along)[0]
        ) / (2 * step)
        np.testing.assert_allclose(slopes @ along, differences, rtol=1e-6, atol=1e-8)


def curvature(energy, F, a, n):
    """Second difference of an energy along a change of rank one that keeps the volume, by the
    size of the energy.
    """
    step = 1e-3 * F @ np.outer(a, n)
    middle = energy(F)
    return (energy(F + step) - 2 * middle + energy(F - step)) / max(1.0, abs(middle))


@pytest.mark.parametrize("term", POLYCONVEX, ids=str)
def test_terms_are_convex_along_every_change_of_rank_one_that_keeps_the_volume(term, random):
    for _ in range(200):
        F = np.linalg.qr(random.standard_normal((3, 3)))[0] @ np.diag(
            np.exp(random.uniform(-1, 1, 3))
        )
        F /= np.cbrt(np.linalg.det(F))
        a, n, _ = np.linalg.qr(random.standard_normal((3, 3)))[0].T
        assert curvature(lambda F: energy_of(term, F), F, a, n) > -1e-12


def test_a_logarithm_of_the_second_invariant_is_not_convex():
    """In simple shear log(I2bar/3) is log(1 + shear^2/3), which is concave beyond a shear of
    sqrt 3.
    """
    a, n, _ = np.eye(3)
    for shear, sign in ((1.0, 1), (3.0, -1)):
        F = np.eye(3) + shear * np.outer(a, n)
        assert (
            sign * curvature(lambda F: energy_of(Term("second_logarithm", 1.0), F), F, a, n) > 1e-9
        )


def test_curvatures_tell_where_a_sum_with_the_logarithm_is_stable():
    """I1bar has the curvature 2 along lines of unit vectors.

    In simple shear s, log(1 + s^2/3) has the least curvature, -1/12, at s = 3, so that with less
    than 1/24 of I1bar - 3 the sum is unstable there, at a greatest stretch of 3.3; other states
    need more. The terms of the dictionary that are polyconvex are stable in all.
    """
    curvatures = line_curvatures(
        [*POLYCONVEX, Term("second_logarithm", 1.0), Term("first", 1.0)], 3.4
    )
    assert curvatures[:, : len(POLYCONVEX)].min() > -1e-6
    assert curvatures[:, -1] == pytest.approx(2.0, rel=1e-6)
    logarithm = curvatures[:, -2]
    assert (
        (logarithm + curvatures[:, -1] / 26).min() < 0 < (logarithm + curvatures[:, -1] / 2).min()
    )


def test_sums_of_polyconvex_terms_are_stable_by_form_and_others_are_checked():
    """In simple shear log(I2bar/3) needs 1/24 of I1bar - 3 at least."""
    assert not Term("second_logarithm", 1.0).polyconvex
    assert len(POLYCONVEX) == len(TERMS) - 1
    coefficients = np.array([[1.0, 1.0], [1.0, 0.0], [1 / 26, 1.0]])
    margins = wave_margin([Term("first", 1.0), Term("second_logarithm", 1.0)], 3.4)(coefficients)
    assert (margins > 0).tolist() == [True, True, False]
    assert margins[1] == 1
    assert np.abs(margins).max() <= 1
    with patch("pdsurrogate.materials.dictionary.line_curvatures", side_effect=AssertionError):
        assert (wave_margin([Term("first", 1.0), Term("roots", 2.0)])(coefficients) == 1).all()


@pytest.mark.parametrize("term", TERMS, ids=str)
def test_the_shear_modulus_is_that_of_small_shear(term):
    F = np.eye(3)
    F[0, 1] = 1e-3
    assert 2 * energy_of(term, F) / 1e-6 == pytest.approx(
        term.shear_modulus, abs=1e-4 * max(1.0, term.shear_modulus)
    )


def test_the_law_of_a_combination_has_its_energy(random):
    coefficients = random.uniform(0.1, 1.0, len(TERMS)) * 10.0 ** -np.arange(len(TERMS)).clip(max=3)
    law = law_of(TERMS, coefficients, 500.0)
    assert law.combination == pytest.approx(dict(zip(TERMS, coefficients, strict=True)))
    assert law.shear_modulus == pytest.approx(
        sum(size * term.shear_modulus for term, size in law.combination.items())
    )
    first, second = np.exp(random.uniform(-0.4, 0.6, (2, 10)))
    *_, W = plane_stress.response(law, first**2 + second**2, first * second, np.ones(10))
    energies, _ = derivatives(TERMS, np.log(np.column_stack([first, second, 1 / (first * second)])))
    np.testing.assert_allclose(law.shear_modulus * W, energies @ coefficients, rtol=1e-10)
    assert law.scaled(2.0).combination == pytest.approx(
        {term: 2 * size for term, size in law.combination.items()}
    )
    assert type(law_of(TERMS[:3], [0.0, 1.0, 2.0], 100.0)) is pds.materials.Ogden


def test_coefficients_that_are_no_polyconvex_energy_are_refused():
    with raising(r"must not be negative, but the least is -0\.1"):
        law_of([Term("first", 1.0), Term("first", 2.0)], [1.0, -0.1], 100.0)
    with raising("the stiffness at rest is zero"):
        law_of([Term("first", 2.0)], [1.0], 100.0)
    with raising("roots must be at most 2 finite numbers, none negative"):
        pds.materials.Polyconvex(roots=(1.0, -1.0))
