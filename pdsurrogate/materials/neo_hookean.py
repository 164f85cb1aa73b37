"""Slightly compressible Neo-Hookean rubber, the paper's Eqs. (6)-(9)."""

from dataclasses import dataclass
from typing import ClassVar

from .law import InvariantLaw


@dataclass(frozen=True)
class NeoHookean(InvariantLaw):
    """Neo-Hookean law, Psi = mu/2 (I1bar - 3) + K/8 (J3 - 1/J3)^2.

    Parameters
    ----------
    shear_modulus : float
        mu, any unit of stress.
    bulk_modulus : float
        K, same unit; the paper uses 100 mu throughout.

    References
    ----------
    Chen, Yang, Liu, Int. J. Mech. Sci. 273 (2024) 109234, Eq. (6).  Treloar, Trans. Faraday Soc. 39 (1943) 241.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials import homogeneous
    >>> law = pds.materials.NeoHookean(shear_modulus=2.0)
    >>> state = homogeneous.uniaxial(law, 1.5)
    >>> print(round(state.nominal_stress, 4))
    2.0872
    """

    name: ClassVar[str] = "neo-hookean"
    reference: ClassVar[str] = "Treloar 1943; Chen et al. 2024, Eq. (6)"

    @staticmethod
    def isochoric(I1, I2, parameters):
        zero = 0 * I1
        return (I1 - 3) / 2, zero + 1 / 2, zero, zero, zero, zero
