"""Copies of points that each material of a body sees, and sums over the materials, against NumPy."""

import numpy as np
import pytest

from pdsurrogate.kernels.material_copies import copy_values, gather_rows, see_points

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("d", [2, 3])
def test_points_of_other_materials_are_moved(d):
    total, depths = 50, RNG.random(50)
    numbers = np.sort(RNG.choice(total, 31, replace=False))
    others = RNG.random(31) < 0.4
    positions, jumps, gradients, changes = (RNG.random((total, width)) for width in (d, d, d * d, d * d))
    moved, changed = np.empty((31, d)), np.empty((31, d * d))
    see_points(d)(numbers.astype(np.uint32), others, depths, positions, gradients, jumps, changes, moved, changed)
    # A product and a difference may be rounded once or twice.
    expected = positions[numbers] - others[:, None] * depths[numbers, None] * jumps[numbers]
    np.testing.assert_allclose(moved, expected, rtol=0, atol=4 * np.finfo(float).eps)
    np.testing.assert_array_equal(changed, gradients[numbers] + others[:, None] * changes[numbers])


def test_values_are_copied_to_places():
    values, out, before = RNG.random(9), np.zeros(5), np.zeros(5)
    copy_values(np.array([7, 0, 3], np.uint32), np.array([4, 1, 0], np.uint32), values, out)
    before[[4, 1, 0]] = values[[7, 0, 3]]
    np.testing.assert_array_equal(out, before)


def test_rows_of_all_materials_are_summed_and_those_not_finite_counted():
    counts = np.array([1, 2, 0, 3, 1])
    pointers, places = np.append(0, np.cumsum(counts)).astype(np.uint32), RNG.permutation(7).astype(np.uint32)
    others, values = np.array([False, True, False, False, True, True, True]), RNG.random((7, 4))
    out, theirs = np.ones((5, 4)), np.ones((5, 4))
    assert gather_rows(4)(pointers, places, others, values, out, theirs) == 0
    owners, sums = np.repeat(np.arange(5), counts), np.zeros((2, 5, 4))
    np.add.at(sums[0], owners, values[places])
    np.add.at(sums[1], owners[others], values[places[others]])
    # Sums of three positive numbers below 1 may be ordered differently.
    np.testing.assert_allclose([out, theirs], sums, rtol=0, atol=4 * np.finfo(float).eps)
    values[places[1], 2], values[places[4], 0] = np.nan, np.inf
    assert gather_rows(4)(pointers, places, others, values, out, theirs[:0]) == 2
    np.testing.assert_array_equal(np.isfinite(out).all(axis=1), [True, False, True, False, True])
