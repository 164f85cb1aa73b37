"""The eight-chain law of Arruda and Boyce, with the true inverse Langevin function."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.langevin import chain_energy, inverse_langevin
from .law import InvariantLaw


@dataclass(frozen=True)
class ArrudaBoyce(InvariantLaw):
    """Eight-chain law, Psi = n kT N [y beta + log(beta/sinh(beta))] + U(J3), y = sqrt(I1bar/(3 N)), beta = L^-1(y).

    The law ends where the chains are straight, at I1bar = 3 N: there and beyond every response is NaN.

    Parameters
    ----------
    shear_modulus : float
        mu in the undeformed state, any unit of stress; n kT follows from it, mu = n kT beta0/(3 y0) with y0 = 1/sqrt(N).
    bulk_modulus : float
        K, same unit.
    chain_links : float
        N, links of a chain; above 1.

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
        return np.array([self.bulk_modulus / self.shear_modulus, N, density, float(chain_energy(at_rest, beta))])

    def limit(self, squares: np.ndarray) -> str:
        return f"I1bar/3 is {squares.sum() / 3:.4g} there, and the chains are straight at chain_links = {self.chain_links:g}"

    @staticmethod
    def isochoric(I1, I2, parameters):
        N, density, at_rest = parameters[1], parameters[2], parameters[3]
        y = np.sqrt(I1 / (3 * N))
        beta, stiffness = inverse_langevin(y)
        zero = 0 * I1
        W11 = density * (stiffness * y - beta) / (36 * N * y * y * y)
        return density * N * (chain_energy(y, beta) - at_rest), density * beta / (6 * y), zero, W11, zero, zero
