"""Change of the loading parameter: in increments that are shortened after failures, or as a
function of time in dynamics.
"""

from dataclasses import dataclass

import numpy as np

LEAST_SHARE = 1 / 64
"""Least fraction of a planned increment to try: if even this one leads to no equilibrium, none is
assumed to exist. Chosen: six halvings; a limit load is then known to 1/64 of an increment, and each
further halving costs a failed search.
"""


class Increments:
    """Increments in which the loading parameter goes from one value to another, halved after
    failures and doubled after successes.

    The planned increments are equal and at most of a given size. The present increment is a power
    of one half of the planned one, and is doubled only where the number of increments done is a
    multiple of the doubled one, so that planned values are reached again.

    Parameters
    ----------
    start, end : float
        Values of the loading parameter.
    largest : float
        Bound of the planned increments.
    time : float
        Time in which the loading parameter goes from one value to the other.

    Attributes
    ----------
    share : float
        The present increment divided by the planned one.
    grows : bool
        Whether an increment that was shortened may be doubled.
    """

    def __init__(self, start: float, end: float, largest: float, time: float = 0.0) -> None:
        self._count = max(1, int(np.ceil(abs(end - start) / largest - 1e-9)))
        self._planned = np.linspace(start, end, self._count + 1)
        # The unit is the planned increment; sums of powers of one half are exact.
        self._done = 0.0
        self.share = 1.0
        self.grows = True
        self._time = time

    @property
    def duration(self) -> float:
        """Time that the present increment takes."""
        return self._time * self.share / self._count

    @property
    def finished(self) -> bool:
        """True if the loading parameter has reached its end value."""
        return self._done == self._count

    @property
    def completes(self) -> bool:
        """True if the present increment completes a planned one."""
        return (self._done + self.share).is_integer()

    @property
    def ends(self) -> bool:
        """True if the present increment leads to the end value."""
        return self._done + self.share == self._count

    @property
    def target(self) -> float:
        """Value of the loading parameter to which the present increment leads."""
        number, part = divmod(self._done + self.share, 1.0)
        first = self._planned[int(number)]
        return float(first + part * (self._planned[int(number) + 1] - first) if part else first)

    @property
    def size(self) -> float:
        """Size of the present increment of the loading parameter."""
        return float(abs(self._planned[-1] - self._planned[0]) * self.share / self._count)

    def accept(self) -> bool:
        """Count the present increment as done, double the next one if possible, and return whether
        it was doubled.

        The next increment is doubled if the present one was shorter than planned, if the
        increments done are a whole multiple of the doubled one, and if it `grows`.
        """
        self._done += self.share
        longer = self.share < 1 and (self._done / (2 * self.share)).is_integer() and self.grows
        if longer:
            self.share *= 2
        return longer

    def restart(self) -> None:
        """Begin again, with increments as short as the present one."""
        self._done = 0.0

    def shorten(self, least: float = LEAST_SHARE) -> bool:
        """Halve the present increment and return True, or return False where it would be shorter
        than the share `least`.
        """
        if self.share <= least:
            return False
        self.share /= 2
        return True


@dataclass(frozen=True)
class Motion:
    """The loading parameter as a linear function of the time since a stage in dynamics began.

    Attributes
    ----------
    begin, end : float
        Values of the parameter.
    rate : float
        Change of the parameter per unit time.
    duration : float
        Duration of the stage.
    """

    begin: float
    end: float
    rate: float
    duration: float

    def at(self, time: float) -> float:
        """Return the parameter at a time; it stays constant after its end value is reached."""
        value = self.begin + self.rate * time
        return min(value, self.end) if self.rate > 0 else max(value, self.end)
