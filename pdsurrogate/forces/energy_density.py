"""What a model of the plane-stress energy gives, and how a learnt one goes over into the exact one at the edge of its domain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .protocol import Domain

BLEND = 0.1
"""Relative width, in squared stretch, of the band inside the edge of a surrogate's domain over which the exact energy takes over."""


@dataclass(frozen=True)
class EnergyDerivatives:
    """A plane-stress energy and its derivatives by tr C and J = det F in the plane, dimensionless, arrays of one shape."""

    psi: np.ndarray
    by_trace: np.ndarray
    by_area: np.ndarray
    by_trace_trace: np.ndarray
    by_trace_area: np.ndarray
    by_area_area: np.ndarray


def domain_constants(domain: Domain, dtype) -> np.ndarray:
    """Constants of `pdsurrogate.kernels.domain.edge_distances` and `exact_share`."""
    low, high = domain.least_stretch**2, domain.greatest_stretch**2
    return np.array([low, high, 1 / low, 1 / high, 1.0, 0.0, BLEND], dtype=dtype)


def blended(surrogate: EnergyDerivatives, exact: EnergyDerivatives, domain: Domain, trace, J) -> EnergyDerivatives:
    """The surrogate's energy with the exact one taking over towards the edge of its domain, with second derivatives.

    The NumPy twin of what `pdsurrogate.kernels.bond_energy.pair_energies` does: psi + s (psi_exact - psi), s the product rule's share.
    """
    low, high = domain.least_stretch**2, domain.greatest_stretch**2
    zero = np.zeros_like(J)
    above, below = high + J * J / high, low + J * J / low
    # Distance from each edge, its derivatives by (I, J) and its second ones by (II, IJ, JJ).
    edges = [
        (
            trace / above - 1,
            (1 / above, -trace * (2 * J / high) / above**2),
            (zero, -(2 * J / high) / above**2, trace * (2 * (2 * J / high) ** 2 / above**3 - (2 / high) / above**2)),
        ),
        (
            1 - below / trace,
            (below / trace**2, -(2 * J / low) / trace),
            (-2 * below / trace**3, (2 * J / low) / trace**2, -(2 / low) / trace),
        ),
        (J / high - 1, (zero, zero + 1 / high), (zero, zero, zero)),
        (1 - J / low, (zero, zero - 1 / low), (zero, zero, zero)),
    ]
    rest = (np.ones_like(J), zero, zero, zero, zero, zero)
    for distance, (d_I, d_J), (d_II, d_IJ, d_JJ) in edges:
        t = np.clip(distance / BLEND + 1, 0, 1)
        s = t**3 * (10 + t * (6 * t - 15))
        ds = 30 * t**2 * (1 - t) ** 2 / BLEND
        dds = 60 * t * (1 - t) * (1 - 2 * t) / BLEND**2
        factor = (1 - s, -ds * d_I, -ds * d_J, -dds * d_I**2 - ds * d_II, -dds * d_I * d_J - ds * d_IJ, -dds * d_J**2 - ds * d_JJ)
        rest = _product(rest, factor)
    share = (1 - rest[0], *(-value for value in rest[1:]))
    first, second = _values(surrogate), _values(exact)
    mixed = _product(share, tuple(b - a for a, b in zip(first, second, strict=True)))
    return EnergyDerivatives(*(a + change for a, change in zip(first, mixed, strict=True)))


def _values(energy: EnergyDerivatives):
    return (energy.psi, energy.by_trace, energy.by_area, energy.by_trace_trace, energy.by_trace_area, energy.by_area_area)


def _product(f, g):
    """Value, gradient and Hessian (I, J, II, IJ, JJ) of a product."""
    return (
        f[0] * g[0],
        f[1] * g[0] + f[0] * g[1],
        f[2] * g[0] + f[0] * g[2],
        f[3] * g[0] + 2 * f[1] * g[1] + f[0] * g[3],
        f[4] * g[0] + f[1] * g[2] + f[2] * g[1] + f[0] * g[4],
        f[5] * g[0] + 2 * f[2] * g[2] + f[0] * g[5],
    )
