"""Laws of the isochoric invariants: polynomials in them, and laws of rubber whose chains have a
limited extension.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.elementary_in_numpy import chain_energy, inverse_langevin, logarithm, select
from .law import InvariantLaw


@dataclass(frozen=True)
class NeoHookean(InvariantLaw):
    """Neo-Hookean law, Psi = mu/2 (I1bar - 3) + K/8 (J3 - 1/J3)^2.

    Parameters
    ----------
    shear_modulus : float
        Initial shear modulus mu. Unit: stress.
    bulk_modulus : float
        Initial bulk modulus K; the paper uses 100 mu throughout. Unit: stress.
    memory : Memory, optional
        Branches and softening beside the elastic energy; by default none.

    References
    ----------
    Chen, Yang, Liu, Int. J. Mech. Sci. 273 (2024) 109234, Eq. (6).  Treloar, Trans. Faraday Soc. 39
    (1943) 241.

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


@dataclass(frozen=True)
class MooneyRivlin(InvariantLaw):
    """Mooney-Rivlin law, Psi = C10 (I1bar - 3) + C01 (I2bar - 3) + U(J3), with mu = 2 (C10 + C01).

    Parameters
    ----------
    shear_modulus : float
        Initial shear modulus mu, 2 (C10 + C01). Unit: stress.
    bulk_modulus : float
        Initial bulk modulus K. Unit: stress.
    memory : Memory, optional
        Branches and softening beside the elastic energy; by default none.
    second_share : float
        C01/(C10 + C01), from 0 to 1. Outside this interval one of the two constants is negative,
        and large strains are unstable. The default is an example, not a fit. Unit: none.

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
            raise ValueError(
                f"{self.name}: second_share must be between 0 and 1, not {self.second_share:g}"
            )

    @staticmethod
    def isochoric(I1, I2, parameters):
        second = parameters[1] / 2
        first = 0.5 - second
        zero = 0 * I1
        return first * (I1 - 3) + second * (I2 - 3), zero + first, zero + second, zero, zero, zero


@dataclass(frozen=True)
class Yeoh(InvariantLaw):
    """Yeoh's law, Psi = C10 [(I1bar - 3) + a (I1bar - 3)^2 + b (I1bar - 3)^3] + U(J3), with mu = 2
    C10, a = C20/C10 and b = C30/C10.

    Parameters
    ----------
    shear_modulus : float
        Initial shear modulus mu, 2 C10. Unit: stress.
    bulk_modulus : float
        Initial bulk modulus K. Unit: stress.
    memory : Memory, optional
        Branches and softening beside the elastic energy; by default none.
    second : float
        a = C20/C10, above -sqrt(3 third). Below this bound the stress decreases at some strain. The
        default is an example, not a fit. Unit: none.
    third : float
        b = C30/C10, at least 0. The default is an example, not a fit. Unit: none.

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
                f"{self.name}: second = {self.second:g} and third = {self.third:g} make the stress"
                " fall with growing strain; third must be at least 0 and second above -sqrt(3"
                " third)"
            )

    @staticmethod
    def isochoric(I1, I2, parameters):
        a = parameters[1]
        b = parameters[2]
        x = I1 - 3
        zero = 0 * I1
        return (
            x * (1 + x * (a + x * b)) / 2,
            (1 + x * (2 * a + 3 * b * x)) / 2,
            zero,
            a + 3 * b * x,
            zero,
            zero,
        )


@dataclass(frozen=True)
class Gent(InvariantLaw):
    """Gent's law, Psi = -mu Jm/2 log(1 - (I1bar - 3)/Jm) + K/2 ((J3^2 - 1)/2 - log J3).

    The law ends at I1bar - 3 = Jm: there and past it every response is NaN, which the plane-stress
    solution reports as an error.

    Parameters
    ----------
    shear_modulus : float
        Initial shear modulus mu. Unit: stress.
    bulk_modulus : float
        Initial bulk modulus K; equal to 2/D in the paper, where D = 0.01 gives K = 200 mu. Unit:
        stress.
    memory : Memory, optional
        Branches and softening beside the elastic energy; by default none.
    chain_limit : float
        Limit Jm of I1bar - 3; 120 in the paper's section 6.7. Unit: none.

    References
    ----------
    Gent, Rubber Chem. Technol. 69 (1996) 59.  Chen, Yang, Liu, Int. J. Mech. Sci. 273 (2024)
    109234, Eq. (32).

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
        return (
            f"I1bar - 3 = {squares.sum() - 3:.4g} exceeds the limit of the law, chain_limit ="
            f" {self.chain_limit:g}"
        )

    @staticmethod
    def isochoric(I1, I2, parameters):
        limit = parameters[1]
        gap = 1 - (I1 - 3) / limit
        gap = select(gap > 0, gap, np.nan)
        zero = 0 * I1
        # 0 * gap passes NaN on, which the kernels' logarithm does not.
        return (
            0 * gap - limit / 2 * logarithm(gap),
            1 / (2 * gap),
            zero,
            1 / (2 * limit * gap * gap),
            zero,
            zero,
        )

    @staticmethod
    def volumetric(J3, parameters):
        K = parameters[0]
        inverse = 1 / J3
        return (
            K / 2 * ((J3 * J3 - 1) / 2 - logarithm(J3)),
            K / 2 * (J3 - inverse),
            K / 2 * (1 + inverse * inverse),
        )


@dataclass(frozen=True)
class ArrudaBoyce(InvariantLaw):
    """Eight-chain law, Psi = n kT N [y beta + log(beta/sinh(beta))] + U(J3), y = sqrt(I1bar/(3 N)),
    beta = L^-1(y).

    The law ends where the chains are straight, at I1bar = 3 N: there and beyond every response is
    NaN.

    Parameters
    ----------
    shear_modulus : float
        Initial shear modulus mu; n kT follows from it, mu = n kT beta0/(3 y0) with y0 = 1/sqrt(N).
        Unit: stress.
    bulk_modulus : float
        Initial bulk modulus K. Unit: stress.
    memory : Memory, optional
        Branches and softening beside the elastic energy; by default none.
    chain_links : float
        Number N of links of a chain. Unit: none.

    References
    ----------
    Arruda, Boyce, J. Mech. Phys. Solids 41 (1993) 389, whose N for Treloar's rubber is 26.5.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials import homogeneous
    >>> law = pds.materials.ArrudaBoyce(chain_links=20.0)
    >>> state = homogeneous.uniaxial(law, 1.5)
    >>> print(round(state.nominal_stress, 4))
    1.056
    """

    name: ClassVar[str] = "arruda-boyce"
    reference: ClassVar[str] = "Arruda, Boyce 1993"
    costly: ClassVar[bool] = True
    bounds: ClassVar[dict] = {"chain_links": (1.01, 1e4)}
    above: ClassVar[dict] = {"chain_links": 1}

    chain_links: float = 26.5

    @property
    def parameters(self) -> np.ndarray:
        N = self.chain_links
        at_rest = N**-0.5
        beta = float(inverse_langevin(at_rest)[0])
        density = 3 * at_rest / beta
        return np.array(
            [self.bulk_modulus / self.shear_modulus, N, density, float(chain_energy(at_rest, beta))]
        )

    def limit(self, squares: np.ndarray) -> str:
        return (
            f"I1bar/3 = {squares.sum() / 3:.4g} exceeds the limit of the law, chain_links ="
            f" {self.chain_links:g}"
        )

    @staticmethod
    def isochoric(I1, I2, parameters):
        N = parameters[1]
        density = parameters[2]
        at_rest = parameters[3]
        y = np.sqrt(I1 / (3 * N))
        beta, stiffness = inverse_langevin(y)
        zero = 0 * I1
        W11 = density * (stiffness * y - beta) / (36 * N * y * y * y)
        return (
            density * N * (chain_energy(y, beta) - at_rest),
            density * beta / (6 * y),
            zero,
            W11,
            zero,
            zero,
        )
