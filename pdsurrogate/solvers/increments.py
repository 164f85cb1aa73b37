"""Course of a loading parameter: in increments that fail or succeed, or as a function of time for bodies with inertia."""

from dataclasses import dataclass

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


@dataclass(frozen=True)
class Motion:
    """The loading parameter as a function of the time since a phase of dynamics began.

    Attributes
    ----------
    begin, end : float
        Values of the parameter.
    rate : float
        Change of the parameter per unit time.
    duration : float
        Duration of the phase.
    """

    begin: float
    end: float
    rate: float
    duration: float

    @classmethod
    def lasting(cls, begin: float, end: float, duration: float) -> "Motion":
        """Return the even motion from one value to another in a given time; the values may be equal."""
        return cls(begin, end, (end - begin) / duration, duration)

    @classmethod
    def at_rate(cls, begin: float, end: float, rate: float) -> "Motion":
        """Return the motion from one value to a greater one at a given rate."""
        return cls(begin, end, rate, (end - begin) / rate)

    def at(self, time: float) -> float:
        """Return the parameter at a time; from the end of the phase on it stays constant."""
        value = self.begin + self.rate * time
        return min(value, self.end) if self.rate > 0 else max(value, self.end)
