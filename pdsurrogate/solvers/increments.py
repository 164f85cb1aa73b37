"""Increments of a loading parameter: as planned where that works, halved after a failure, doubled again after easy successes."""

from __future__ import annotations

import numpy as np

LEAST_SHARE = 1 / 64
"""Least share of a planned increment: a solution that increments of this share do not find is assumed not to exist."""


class Increments:
    """The way of a loading parameter from one value to another.

    Planned are equal increments of at most a given size.  Shares of them are powers of one half, and a share is doubled only where the
    sum of those taken is a multiple of the double: after a failure the way comes back to the planned values.

    Parameters
    ----------
    start, end : float
    largest : float
        Bound of the planned increments.
    done, share : float
        Of a way that was begun before: planned increments that are behind, and the present one over the planned.

    Attributes
    ----------
    share : float
        The present increment over the planned one.
    """

    def __init__(self, start: float, end: float, largest: float, done: float = 0.0, share: float = 1.0) -> None:
        self._start, self._largest = start, largest
        self._count = max(1, int(np.ceil(abs(end - start) / largest - 1e-9)))
        self._planned = np.linspace(start, end, self._count + 1)
        # The unit is the planned increment; sums of powers of one half are exact.
        self._done, self.share = done, share

    def describe(self) -> dict[str, float]:
        """Return the arguments from which the way is made again, without its end."""
        return {"start": self._start, "largest": self._largest, "done": self._done, "share": self.share}

    @property
    def finished(self) -> bool:
        """True if the end has been reached."""
        return self._done == self._count

    @property
    def ends(self) -> bool:
        """True if the present increment leads to the end."""
        return self._done + self.share == self._count

    @property
    def target(self) -> float:
        """Value to which the present increment leads."""
        number, part = divmod(self._done + self.share, 1.0)
        first = self._planned[int(number)]
        return float(first + part * (self._planned[int(number) + 1] - first) if part else first)

    @property
    def size(self) -> float:
        """Size of the present increment."""
        return float(abs(self._planned[-1] - self._planned[0]) * self.share / self._count)

    def accept(self, easy: bool = True) -> bool:
        """Count the increment as done; double it if it was easy, had been halved, and the way done is a multiple of the double.

        Return whether it was doubled.
        """
        self._done += self.share
        longer = easy and self.share < 1 and (self._done / (2 * self.share)).is_integer()
        if longer:
            self.share *= 2
        return longer

    def shorten(self) -> bool:
        """Halve the increment; False where it would become too short."""
        if self.share <= LEAST_SHARE:
            return False
        self.share /= 2
        return True
