"""Grids of equal cells that fill a box."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

MOST_POINTS = 20_000_000
"""Greatest number of points: at some 2 kB a point more would exceed the memory of a workstation."""

MOST_MISFIT = 0.1
"""Greatest relative deviation of the side of a cell from the spacing.

Any side of a box that is five spacings or longer can be divided within it. In pure shear at 20
cells, cells whose sides differ by a fifth have the same errors as squares of the same area (-0.04
to -0.05 % in stress).
"""


@dataclass(frozen=True)
class Cells:
    """Equal cells that fill a box.

    Attributes
    ----------
    lower : tuple of float
        Corner of the box where all coordinates are least.
    counts : tuple of int
        Cells along each axis, two numbers in the plane and three in three dimensions.
    sides : tuple of float
        Sides of a cell along the axes.
    """

    lower: tuple[float, ...]
    counts: tuple[int, ...]
    sides: tuple[float, ...]

    @classmethod
    def filling(cls, lower: Sequence[float], upper: Sequence[float], spacing: float) -> Cells:
        """Return equal cells that fill a box; they are squares or cubes of the given spacing where
        it divides the box (to 1e-9).

        Otherwise their sides are as near to the spacing as possible. Raise ValueError if the box is
        smaller than a cell or holds too many cells, or if the sides deviate from the spacing by
        more than `MOST_MISFIT`.
        """
        if not (np.isfinite(spacing) and spacing > 0):
            raise ValueError(f"the spacing must be positive and finite, not {spacing}")
        number = math.prod(
            float(high - low) / spacing for low, high in zip(lower, upper, strict=True)
        )
        if not number <= MOST_POINTS:
            raise ValueError(
                f"spacing {spacing:g} makes {number:.3g} points, more than the limit"
                f" {MOST_POINTS:.3g}; use a larger spacing"
            )
        counts = []
        sides = []
        for low, high, axis in zip(
            lower, upper, (f"x{number + 1}" for number in range(len(lower))), strict=True
        ):
            length = float(high - low)
            cells = length / spacing
            count = _count(length, spacing)
            if abs(cells / count - 1) > MOST_MISFIT:
                if cells < 1:
                    raise ValueError(
                        f"spacing {spacing:g} is larger than the body, {length:g} along {axis}"
                    )
                fewer = length / math.ceil(cells)
                more = length / math.floor(cells)
                raise ValueError(
                    f"spacing {spacing:g} does not divide the length {length:g} along {axis}; use"
                    f" {fewer:.6g} or {more:.6g}"
                )
            counts.append(count)
            sides.append(spacing if abs(cells - count) <= 1e-9 * count else length / count)
        return cls(tuple(lower), tuple(counts), tuple(sides))

    @classmethod
    def near(cls, lower: Sequence[float], upper: Sequence[float], spacing: float) -> Cells:
        """Return equal cells that fill a box, however much their sides deviate from the spacing;
        see `filling`.
        """
        lengths = [float(high - low) for low, high in zip(lower, upper, strict=True)]
        counts = [_count(length, spacing) for length in lengths]
        return cls(
            tuple(lower),
            tuple(counts),
            tuple(length / count for length, count in zip(lengths, counts, strict=True)),
        )

    @property
    def volume(self) -> float:
        """Volume of a cell; in the plane its area."""
        return math.prod(self.sides)

    @property
    def spacing(self) -> float:
        """Side of a square or cube with the cell's volume; exact to the last bit for squares and
        cubes.
        """
        if min(self.sides) == max(self.sides):
            return self.sides[0]
        return math.sqrt(self.volume) if len(self.sides) == 2 else math.cbrt(self.volume)

    def centers(self) -> np.ndarray:
        """Return the centers of the cells, shape (n, d); x1 varies fastest, the last coordinate
        slowest.
        """
        centers = np.empty((*self.counts[::-1], len(self.counts)))
        for axis, (low, count, side) in enumerate(
            zip(self.lower, self.counts, self.sides, strict=True)
        ):
            shape = np.ones(len(self.counts), dtype=int)
            shape[-1 - axis] = count
            centers[..., axis] = (low + (np.arange(count) + 0.5) * side).reshape(shape)
        return centers.reshape(-1, len(self.counts))


def _count(length: float, spacing: float) -> int:
    """Return the number of cells nearest to a spacing that fill a length; rounding does not
    decide between two that are equally near.
    """
    return max(1, round(round(length / spacing, 6)))


def grid(lower: Sequence[float], upper: Sequence[float], spacing: float) -> np.ndarray:
    """Return the centers of the cells that fill a box, shape (n, d), in the order of
    `Cells.centers`; see `Cells.filling`.
    """
    return Cells.filling(lower, upper, spacing).centers()
