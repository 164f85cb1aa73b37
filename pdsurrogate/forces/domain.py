"""Bounds of the states on which a surrogate was trained."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from ..kernels.bond_force import LEAST_NORMAL_STRETCH


@dataclass(frozen=True)
class Domain:
    """Bounds of the states on which a surrogate was trained.

    Attributes
    ----------
    least_stretch, greatest_stretch : float
        Bounds of both principal stretches in the plane; those of a bond follow from its stretch,
        its rotation and J (theory (10)).
    least_bulk, greatest_bulk : float
        Bounds of the squared volume ratio, J3^2 = J^2 C33.
    hull : tuple of tuple of float, optional
        Hull of the test data of an energy: half-planes (n1, n2, d) in the logarithms of the two
        greater of three principal stretches of product 1, the greatest first, n1 log l1 + n2 log l2
        <= d.
    rates : tuple of float, optional
        Least and greatest rate of stretch of the tests behind branches, per second
        (`pdsurrogate.materials.memory.untested_rates`).
    """

    least_stretch: float
    greatest_stretch: float
    least_bulk: float
    greatest_bulk: float
    hull: tuple[tuple[float, float, float], ...] | None = field(default=None, repr=False)
    rates: tuple[float, float] | None = field(default=None, repr=False)

    @property
    def interior(self) -> Self:
        """Inner part of the domain, where the surrogate alone is used; from there to the domain's
        edge the exact force is blended in.

        Every bound lies a tenth nearer to 1, the undeformed state, on a logarithmic scale. A domain
        that does not contain the undeformed state is returned unchanged.
        """
        bounds = (self.least_stretch, self.greatest_stretch, self.least_bulk, self.greatest_bulk)
        if not (bounds[0] < 1 < bounds[1] and bounds[2] < 1 < bounds[3]):
            return self
        return type(self)(*(bound**0.9 for bound in bounds))

    def deviation(self, stretches: np.ndarray, bulk: np.ndarray | None = None) -> np.ndarray:
        """Return the greatest logarithmic excess of each state over a bound, shape (n,); inside,
        minus the distance to the nearest bound.

        The edge of the hull of test data, if there is one, is one of the bounds.

        Parameters
        ----------
        stretches : ndarray, shape (n, k)
            Principal stretches.
        bulk : ndarray, shape (n,), optional
            Squared volume ratio J3^2, for a model that depends on it.
        """
        with np.errstate(divide="ignore"):
            stretch = np.log(stretches)
            least, greatest, low, high = np.log(
                [self.least_stretch, self.greatest_stretch, self.least_bulk, self.greatest_bulk]
            )
            passed = np.maximum(stretch.max(axis=1) - greatest, least - stretch.min(axis=1))
            if bulk is not None:
                passed = np.maximum(passed, np.maximum(np.log(bulk) - high, low - np.log(bulk)))
        return passed if self.hull is None else np.maximum(passed, self.beyond_data(stretches))

    def beyond_data(self, stretches: np.ndarray) -> np.ndarray:
        """Return the `deviation` of states from the hull of test data alone, shape (n,).

        Two stretches in the plane are completed by a third at constant volume.
        """
        logs = np.log(stretches)
        logs = (
            np.column_stack([logs, -logs.sum(axis=1)])
            if logs.shape[1] == 2
            else logs - logs.mean(axis=1, keepdims=True)
        )
        planes = np.array(self.hull)
        return (-np.sort(-logs, axis=1)[:, :2] @ planes[:, :2].T - planes[:, 2]).max(axis=1)

    def limits(self, dtype) -> np.ndarray:
        """Return the bounds as an array of constants for the compiled test
        `pdsurrogate.kernels.domain.is_outside`.
        """
        low = np.float64(self.least_stretch) ** 2
        high = np.float64(self.greatest_stretch) ** 2
        with np.errstate(divide="ignore"):
            return np.array(
                [
                    low,
                    high,
                    1 / low,
                    1 / high,
                    self.least_bulk,
                    self.greatest_bulk,
                    LEAST_NORMAL_STRETCH,
                ],
                dtype=dtype,
            )


EVERYWHERE = Domain(0.0, np.inf, 0.0, np.inf)
"""Domain without bounds: all states in which a bond has a stretch tensor."""
