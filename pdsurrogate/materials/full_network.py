"""The full-network law of rubber: chains in all directions, summed by quadrature on the sphere."""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import ClassVar

import numpy as np
from scipy.integrate import lebedev_rule

from ..kernels.langevin import chain_energy, inverse_langevin
from .law import PrincipalStretchLaw

DEGREE = 29
"""Degree of the polynomials that the quadrature integrates exactly."""


@cache
def directions() -> np.ndarray:
    """Return Lebedev's quadrature in the frame of the principal stretches: rows (weight, r1^2, r2^2, r3^2), weights summing to 1.

    The stretch of a chain depends on squares only, so directions that differ by signs are merged; the rest is symmetric in the three axes,
    which makes the law isotropic.
    """
    points, weights = lebedev_rule(DEGREE)
    squares, place = np.unique(np.round(points.T**2, 14), axis=0, return_inverse=True)
    total = np.bincount(place.ravel(), weights)
    return np.column_stack([total / total.sum(), squares / squares.sum(axis=1, keepdims=True)])


@dataclass(frozen=True)
class FullNetwork(PrincipalStretchLaw):
    """Full-network law, Psi = n kT N <y beta + log(beta/sinh(beta))> + U(J3), averaged over all directions r of a chain.

    Here y = l(r)/sqrt(N) and beta = L^-1(y), with l(r)^2 = r . Cbar r the squared stretch in the direction of the chain. The law ends where
    the most stretched chain is straight, at a greatest isochoric stretch of sqrt(N): there and beyond every response is NaN.

    Parameters
    ----------
    shear_modulus : float
        mu in the undeformed state, any unit of stress; n kT follows from it.
    bulk_modulus : float
        K, same unit.
    chain_links : float
        N, links of a chain; above 1.

    References
    ----------
    Treloar, Riding, Proc. R. Soc. A 369 (1979) 261.  Wu, van der Giessen, J. Mech. Phys. Solids 41 (1993) 427.  Quadrature: Lebedev,
    Laikov, Dokl. Math. 59 (1999) 477, as in scipy.integrate.lebedev_rule.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.materials import homogeneous
    >>> law = pds.materials.FullNetwork(chain_links=20.0)
    >>> state = homogeneous.uniaxial(law, 1.5)
    >>> print(round(state.nominal_stress, 4))
    1.0667
    """

    name: ClassVar[str] = "full-network"
    reference: ClassVar[str] = "Treloar, Riding 1979; Wu, van der Giessen 1993"
    costly: ClassVar[bool] = True
    bounds: ClassVar[dict] = {"chain_links": (1.01, 1e4)}
    above: ClassVar[dict] = {"chain_links": 1}

    chain_links: float = 60.0

    @property
    def n_terms(self) -> int:
        return len(directions())

    @cached_property
    def parameters(self) -> np.ndarray:
        N, table = self.chain_links, directions()
        start = np.array([self.bulk_modulus / self.shear_modulus, self.n_terms, N, 0.0])
        at_rest = N**-0.5
        energy = float(chain_energy(at_rest, inverse_langevin(at_rest)[0]))
        raw = np.concatenate([start, [energy], table.ravel()])
        raw[3] = 1.0
        # The second derivative of W along (-1, -1, 2)/3 is 4/3 mu in the undeformed state.
        one, zero = np.ones(1), np.zeros(1)
        second = sum(self.term(zero, zero, zero, one, one, one, self.coefficients(raw, k))[4][0] for k in range(self.n_terms))
        raw[3] = 4 / 3 / second
        return raw

    def limit(self, squares: np.ndarray) -> str:
        greatest = squares.max()
        return f"the square of the greatest stretch is {greatest:.4g} there, and chains are straight at chain_links = {self.chain_links:g}"

    @staticmethod
    def coefficients(parameters, k):
        at = 5 + 4 * k
        N = parameters[2]
        density = parameters[3] * N * parameters[at]
        return density, N, parameters[4], parameters[at + 1], parameters[at + 2], parameters[at + 3]

    @staticmethod
    def term(x1, x2, x3, s1, s2, s3, coefficients):
        density, N, at_rest, r1, r2, r3 = coefficients
        e1 = s1 * r1
        e2 = s2 * r2
        e3 = s3 * r3
        square = (e1 + e2 + e3) / N
        y = np.sqrt(square)
        beta, stiffness = inverse_langevin(y)
        # f(y) as a function of y^2: f' = beta/(2 y), f'' = (stiffness y - beta)/(4 y^3).
        first = density * beta / (2 * y)
        second = density * (stiffness * y - beta) / (4 * square * y)
        d = (2 / 3) * (2 * e3 - e1 - e2) / N
        dd = (4 / 9) * (4 * e3 + e1 + e2) / N
        energy = density * (chain_energy(y, beta) - at_rest)
        return energy, 2 / N * first * e1, 2 / N * first * e2, 2 / N * first * e3, second * d * d + first * dd
