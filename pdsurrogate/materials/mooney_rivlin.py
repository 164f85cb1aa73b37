"""The law of Mooney and Rivlin, linear in both invariants."""

from dataclasses import dataclass
from typing import ClassVar

from .law import InvariantLaw


@dataclass(frozen=True)
class MooneyRivlin(InvariantLaw):
    """Mooney-Rivlin law, Psi = C10 (I1bar - 3) + C01 (I2bar - 3) + U(J3), with mu = 2 (C10 + C01).

    Parameters
    ----------
    shear_modulus : float
        mu = 2 (C10 + C01), any unit of stress.
    bulk_modulus : float
        K, same unit.
    second_share : float
        C01/(C10 + C01), in [0, 1]: outside it one of the two constants is negative, and large strains are unstable.

    References
    ----------
    Mooney, J. Appl. Phys. 11 (1940) 582.  Rivlin, Phil. Trans. R. Soc. A 241 (1948) 379.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials import homogeneous
    >>> law = pds.materials.MooneyRivlin(second_share=0.2)
    >>> state = homogeneous.uniaxial(law, 1.5)
    >>> print(round(state.nominal_stress, 4))
    0.9802
    """

    name: ClassVar[str] = "mooney-rivlin"
    reference: ClassVar[str] = "Mooney 1940; Rivlin 1948"
    bounds: ClassVar[dict] = {"second_share": (0.0, 1.0)}

    second_share: float = 0.1

    def check(self) -> None:
        if not 0 <= self.second_share <= 1:
            raise ValueError(f"{self.name}: second_share must be between 0 and 1, not {self.second_share:g}")

    @staticmethod
    def isochoric(I1, I2, parameters):
        second = parameters[1] / 2
        first = 0.5 - second
        zero = 0 * I1
        return first * (I1 - 3) + second * (I2 - 3), zero + first, zero + second, zero, zero, zero
