"""Multigrid on lattices of cells by stencils: relaxation, residuals, and transfer between a lattice
and one of cells twice as long.

Cells have three counts, 1 along the third axis in the plane; x1 varies fastest. Arrays over cells
have a margin of zeros at both ends, as long as the greatest distance of two neighbors in them. A
matrix has couplings (axes, cells) of each cell with the next one along each axis, and the inverse
of its diagonal, 0 in cells that are held or empty. All arrays are in single precision.
"""

from functools import cache
from types import SimpleNamespace

import numpy as np

from ..engine.compile import inlined
from ..engine.passes import Pass, share_of

QUARTER = np.float32(0.25)
"""Weight of a neighbor in the linear interpolation between the centers of cells and those of cells
twice as long, which are half a cell away along every axis.
"""


@inlined
def first_of(counts, margin, row):
    """Return the index of the first cell of a row."""
    return np.uint64(margin + row * counts[0])


@cache
def passes_of(dimension: int) -> SimpleNamespace:
    """Return the passes over lattices with so many axes: `relax`, `residual`, `restrict`, `inject`
    and `correct`.
    """

    @inlined
    def neighbors(couplings, counts, found, i):
        """Return the sum of the couplings of a cell times the values of its neighbors."""
        one = np.uint64(1)
        row = np.uint64(counts[0])
        total = couplings[0, i] * found[i + one] + couplings[0, i - one] * found[i - one]
        total += couplings[1, i] * found[i + row] + couplings[1, i - row] * found[i - row]
        if dimension == 3:
            layer = np.uint64(counts[0] * counts[1])
            total += couplings[2, i] * found[i + layer] + couplings[2, i - layer] * found[i - layer]
        return total

    @inlined
    def toward(coupling, value, own):
        """Return what a neighbor adds to a mean: nothing where no coupling joins it."""
        return QUARTER * (value - own) if coupling > 0 else np.float32(0)

    @inlined
    def mean(couplings, counts, values, i):
        """Return the value of a cell, interpolated with those of its neighbors."""
        one = np.uint64(1)
        row = np.uint64(counts[0])
        own = values[i]
        total = own + toward(couplings[0, i], values[i + one], own)
        total += toward(couplings[0, i - one], values[i - one], own)
        total += toward(couplings[1, i], values[i + row], own)
        total += toward(couplings[1, i - row], values[i - row], own)
        if dimension == 3:
            layer = np.uint64(counts[0] * counts[1])
            total += toward(couplings[2, i], values[i + layer], own)
            total += toward(couplings[2, i - layer], values[i - layer], own)
        return total

    @Pass
    def relax(chunk, counts, margin, couplings, inverse, right, found, color):
        """Solve for the cells of one color of a checkerboard, in place, with the others fixed."""
        for row in share_of(counts[1] * counts[2], chunk):
            start = first_of(counts, margin, row)
            odd = (row % counts[1] + row // counts[1] + color) % 2
            for half in range((counts[0] + 1 - odd) // 2):
                i = start + np.uint64(2 * half + odd)
                found[i] = inverse[i] * (right[i] + neighbors(couplings, counts, found, i))

    @Pass
    def residual(chunk, counts, margin, couplings, inverse, right, found, rest):
        """Compute the residual, 0 in held and empty cells."""
        for row in share_of(counts[1] * counts[2], chunk):
            start = first_of(counts, margin, row)
            for x in range(counts[0]):
                i = start + np.uint64(x)
                left = right[i] + neighbors(couplings, counts, found, i)
                rest[i] = left - found[i] / inverse[i] if inverse[i] > 0 else np.float32(0)

    @Pass
    def restrict(chunk, counts, margin, couplings, inverse, rest, coarse, coarse_margin, out):
        """Sum the means of the residual over the cells of each coarse one."""
        for row in share_of(coarse[1] * coarse[2], chunk):
            start = first_of(coarse, coarse_margin, row)
            for x in range(coarse[0]):
                out[start + np.uint64(x)] = 0
            second = 2 * (row % coarse[1])
            third = 2 * (row // coarse[1])
            for z in range(third, min(third + 2, counts[2])):
                for y in range(second, min(second + 2, counts[1])):
                    begin = first_of(counts, margin, z * counts[1] + y)
                    for x in range(counts[0]):
                        i = begin + np.uint64(x)
                        if inverse[i] > 0:
                            out[start + np.uint64(x // 2)] += mean(couplings, counts, rest, i)

    @Pass
    def inject(chunk, counts, margin, couplings, inverse, rest, coarse, coarse_margin, values):
        """Give `rest` the values of the coarse cells, 0 in cells without unknown."""
        for row in share_of(counts[1] * counts[2], chunk):
            start = first_of(counts, margin, row)
            begin = first_of(
                coarse, coarse_margin, row // counts[1] // 2 * coarse[1] + row % counts[1] // 2
            )
            for x in range(counts[0]):
                i = start + np.uint64(x)
                value = values[begin + np.uint64(x // 2)]
                rest[i] = value if inverse[i] > 0 else np.float32(0)

    @Pass
    def correct(chunk, counts, margin, couplings, inverse, rest, found):
        """Add the means of `rest` to the cells with an unknown, in place."""
        for row in share_of(counts[1] * counts[2], chunk):
            start = first_of(counts, margin, row)
            for x in range(counts[0]):
                i = start + np.uint64(x)
                if inverse[i] > 0:
                    found[i] += mean(couplings, counts, rest, i)

    return SimpleNamespace(
        relax=relax, residual=residual, restrict=restrict, inject=inject, correct=correct
    )
