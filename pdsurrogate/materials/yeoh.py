"""Yeoh's law: a cubic in the first invariant."""

from dataclasses import dataclass
from typing import ClassVar

from .law import InvariantLaw


@dataclass(frozen=True)
class Yeoh(InvariantLaw):
    """Yeoh's law, Psi = C10 [(I1bar - 3) + a (I1bar - 3)^2 + b (I1bar - 3)^3] + U(J3), with mu = 2 C10, a = C20/C10 and b = C30/C10.

    Parameters
    ----------
    shear_modulus : float
        mu = 2 C10, any unit of stress.
    bulk_modulus : float
        K, same unit.
    second, third : float
        C20/C10 and C30/C10.  The stress rises with the stretch at all strains only if third >= 0 and second > -sqrt(3 third).

    References
    ----------
    Yeoh, Rubber Chem. Technol. 66 (1993) 754.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials import homogeneous
    >>> law = pds.materials.Yeoh(shear_modulus=0.4)
    >>> print(round(homogeneous.uniaxial(law, 1.5).nominal_stress, 4))
    0.4165
    """

    name: ClassVar[str] = "yeoh"
    reference: ClassVar[str] = "Yeoh 1993"
    bounds: ClassVar[dict] = {"second": (-1.0, 10.0), "third": (0.0, 10.0)}

    second: float = -0.01
    third: float = 2.5e-4

    def check(self) -> None:
        if not (self.third >= 0 and (self.second >= 0 or self.second**2 < 3 * self.third)):
            raise ValueError(
                f"{self.name}: second = {self.second:g} and third = {self.third:g} make the stress fall with growing strain; "
                "third must be at least 0 and second above -sqrt(3 third)"
            )

    @staticmethod
    def isochoric(I1, I2, parameters):
        a, b = parameters[1], parameters[2]
        x = I1 - 3
        zero = 0 * I1
        return x * (1 + x * (a + x * b)) / 2, (1 + x * (2 * a + 3 * b * x)) / 2, zero, a + 3 * b * x, zero, zero
