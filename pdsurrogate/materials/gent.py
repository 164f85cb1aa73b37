"""Gent's law of rubber whose chains have a limited extension; the paper's Eq. (32)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.elementary import logarithm, select
from .law import InvariantLaw


@dataclass(frozen=True)
class Gent(InvariantLaw):
    """Gent's law, Psi = -mu Jm/2 log(1 - (I1bar - 3)/Jm) + K/2 ((J3^2 - 1)/2 - log J3).

    The law ends at I1bar - 3 = Jm: there and past it every response is NaN, which the plane-stress solution reports as an error.

    Parameters
    ----------
    shear_modulus : float
        mu, any unit of stress.
    bulk_modulus : float
        K, same unit; 2/D of the paper, whose D = 0.01 makes 200 mu.
    chain_limit : float
        Jm; 120 in the paper's section 6.7.

    References
    ----------
    Gent, Rubber Chem. Technol. 69 (1996) 59.  Chen, Yang, Liu, Int. J. Mech. Sci. 273 (2024) 109234, Eq. (32).

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials import homogeneous
    >>> law = pds.materials.Gent(chain_limit=80.0)
    >>> state = homogeneous.uniaxial(law, 1.5)
    >>> print(round(state.nominal_stress, 4))
    1.0602
    """

    name: ClassVar[str] = "gent"
    reference: ClassVar[str] = "Gent 1996; Chen et al. 2024, Eq. (32)"
    bounds: ClassVar[dict] = {"chain_limit": (0.01, 1e4)}
    above: ClassVar[dict] = {"chain_limit": 0}

    bulk_modulus: float = 200.0
    chain_limit: float = 120.0

    def limit(self, squares: np.ndarray) -> str:
        return f"I1bar - 3 is {squares.sum() - 3:.4g} there, and the law ends at chain_limit = {self.chain_limit:g}"

    @staticmethod
    def isochoric(I1, I2, parameters):
        limit = parameters[1]
        gap = 1 - (I1 - 3) / limit
        gap = select(gap > 0, gap, np.nan)
        zero = 0 * I1
        # 0 * gap passes NaN on, which the kernels' logarithm does not.
        return 0 * gap - limit / 2 * logarithm(gap), 1 / (2 * gap), zero, 1 / (2 * limit * gap * gap), zero, zero

    @staticmethod
    def volumetric(J3, parameters):
        K = parameters[0]
        inverse = 1 / J3
        return K / 2 * ((J3 * J3 - 1) / 2 - logarithm(J3)), K / 2 * (J3 - inverse), K / 2 * (1 + inverse * inverse)
