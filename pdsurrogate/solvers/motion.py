"""Loading parameter as a function of time, for bodies with inertia."""

from __future__ import annotations

from dataclasses import dataclass


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
    def lasting(cls, begin: float, end: float, duration: float) -> Motion:
        """Return the even motion from one value to another in a given time; the values may be equal."""
        return cls(begin, end, (end - begin) / duration, duration)

    @classmethod
    def at_rate(cls, begin: float, end: float, rate: float) -> Motion:
        """Return the motion from one value to a greater one at a given rate."""
        return cls(begin, end, rate, (end - begin) / rate)

    def at(self, time: float) -> float:
        """Return the parameter at a time; from the end of the phase on it stays constant."""
        value = self.begin + self.rate * time
        return min(value, self.end) if self.rate > 0 else max(value, self.end)
