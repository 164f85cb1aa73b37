"""Passes that copy values between the points of a body of several materials and the copies of
these points that each material sees.
"""

from functools import cache

import numpy as np

from ..engine.passes import Pass, share_of


@cache
def see_points(dimension: int) -> Pass:
    """Return the pass that copies positions and gradients as a material sees them, in the plane
    or in three dimensions.
    """
    entries = dimension * dimension

    @Pass
    def see_points(
        chunk,
        numbers,
        others,
        depths,
        positions,
        gradients,
        jumps,
        changes,
        to_positions,
        to_gradients,
    ):
        """Copy the rows `numbers` of positions and gradients (by columns); move the `others`,
        points of other materials.

        They are moved by minus their depth times the jump of the slope at their interface, and
        their gradients by `changes`.
        """
        for k in share_of(numbers.shape[0], chunk):
            i = numbers[k]
            if others[k]:
                for r in range(dimension):
                    to_positions[k, r] = positions[i, r] - depths[i] * jumps[i, r]
                for r in range(entries):
                    to_gradients[k, r] = gradients[i, r] + changes[i, r]
            else:
                for r in range(dimension):
                    to_positions[k, r] = positions[i, r]
                for r in range(entries):
                    to_gradients[k, r] = gradients[i, r]

    return see_points


@Pass
def copy_values(chunk, numbers, places, values, out):
    """Write ``out[places[k]] = values[numbers[k]]`` for every k."""
    for k in share_of(numbers.shape[0], chunk):
        out[places[k]] = values[numbers[k]]


@cache
def gather_rows(width: int) -> Pass:
    """Return the pass that sums the rows of `width` reals that all materials have for a point."""

    @Pass
    def gather_rows(chunk, pointers, places, others, values, out, theirs):
        """Write the sum of the rows ``values[places]`` of every point to `out`, and of those of
        other materials to `theirs`.

        `pointers` bound the `places` of each point, and `others` flags those whose material is not
        the point's own. Without rows of `theirs` these sums are left out. Return how many sums in
        `out` are not finite.
        """
        not_finite = 0
        for i in share_of(out.shape[0], chunk):
            finite = True
            for c in range(width):
                total = 0.0
                foreign = 0.0
                for e in range(pointers[i], pointers[i + 1]):
                    value = values[places[e], c]
                    total += value
                    foreign += value if others[e] else 0.0
                out[i, c] = total
                finite &= abs(total) < np.inf
                if theirs.shape[0] > 0:
                    theirs[i, c] = foreign
            not_finite += 0 if finite else 1
        return not_finite

    return gather_rows
