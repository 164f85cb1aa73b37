"""Weight functions of the bond length."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class WeightFunction:
    """Weight function w(l) of the bond length, non-zero up to the horizon.

    Attributes
    ----------
    name : str
    function : callable
        ``function(length, horizon)`` returns w.
    moments : tuple of float
        Scalar kappa in the shape tensor kappa I of a full horizon, divided by the horizon to the
        power 4 in the plane and 5 in three dimensions: pi times the integral of w r^3 dr over the
        horizon, or 4 pi/3 times that of w r^4 dr.
    """

    name: str
    function: Callable
    moments: tuple[float, float]


WEIGHT_FUNCTIONS = {
    weight.name: weight
    for weight in (
        # The paper's choice: with it w l is the same for every bond, and so is the force that the
        # network learns.
        WeightFunction("inverse", lambda length, horizon: horizon / length, (np.pi / 3, np.pi / 3)),
        WeightFunction(
            "constant", lambda length, horizon: np.ones_like(length), (np.pi / 4, 4 * np.pi / 15)
        ),
        WeightFunction(
            "linear", lambda length, horizon: 1 - length / horizon, (np.pi / 20, 2 * np.pi / 45)
        ),
    )
}
