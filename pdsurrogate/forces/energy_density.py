"""Derivatives of a plane-stress energy, and the blend of a learnt one into the exact one at the edge of its domain."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..kernels.domain import exact_share, product_rule
from .protocol import Domain


class EnergyDerivatives(NamedTuple):
    """A plane-stress energy and its derivatives by tr C and J = det F in the plane, dimensionless, arrays of one shape."""

    psi: np.ndarray
    by_trace: np.ndarray
    by_area: np.ndarray
    by_trace_trace: np.ndarray
    by_trace_area: np.ndarray
    by_area_area: np.ndarray


def blended(surrogate: EnergyDerivatives, exact: EnergyDerivatives, domain: Domain, trace, J) -> EnergyDerivatives:
    """Return the energy that the pass over the pairs uses near the edge of the domain, psi + s (psi_exact - psi), with its derivatives."""
    excess = tuple(b - a for a, b in zip(surrogate, exact, strict=True))
    mixed = product_rule(exact_share(trace, J, domain.limits("float64")), excess)
    return EnergyDerivatives(*(a + change for a, change in zip(surrogate, mixed, strict=True)))
