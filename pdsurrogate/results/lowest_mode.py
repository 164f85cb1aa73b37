"""Lowest mode of an equilibrium: the displacement that the body resists least, and whether the
equilibrium is stable.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class LowestMode:
    """Displacement of the free points that a body in equilibrium resists least.

    The forces that cause the mode are its displacements times the volumes of the points times the
    eigenvalue.

    Attributes
    ----------
    eigenvalue : float
        Stiffness of the mode, in the unit of stress over that of length squared. Divided by the
        density, it is the square of the lowest natural angular frequency of small motions about the
        equilibrium. Negative if the equilibrium is not stable.
    error : float
        Estimated error of the eigenvalue, without that of the discretization.
    displacements : ndarray, shape (n, d)
        Displacements of the points in the mode, the greatest of which has the length 1.

    See Also
    --------
    pdsurrogate.Result.lowest_mode : returns the lowest mode.
    """

    eigenvalue: float
    error: float
    displacements: np.ndarray

    @property
    def stable(self) -> bool:
        """Whether the body resists every small displacement: False also for an eigenvalue of zero,
        as at a limit load.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.simulate(
        ...     pds.load_scene("uniaxial", spacing=0.25, stretches=1.5), "bond-energy"
        ... ).lowest_mode().stable
        True
        """
        return self.eigenvalue > self.error
