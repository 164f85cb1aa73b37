"""Exact homogeneous solutions of slightly compressible laws, in plane stress or plane strain, as references for simulations.

The textbook formulas of the paper's Table 1 hold in the incompressible limit and are off by about 1 % in stress at K = 100 mu.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from ..kernels.node_state import SWELLING
from .law import Law
from .plane_stress import invariants, response, stretch_squares
from .planes import PLANES, SHEETS

STEP = 1e-7
"""Of the difference that gives Newton's iteration for J3 its slope, relative to J3."""


@dataclass(frozen=True)
class HomogeneousState:
    """A homogeneous state in the plane.

    Attributes
    ----------
    stretch, lateral_stretch, thickness_stretch : float
        Principal stretches along x1, along x2, and through the thickness.
    volume_ratio : float
        J3.
    nominal_stress, lateral_stress : float
        P11 and P22, in the unit of the shear modulus.
    energy_density : float
        Per undeformed volume, same unit.
    """

    stretch: float
    lateral_stretch: float
    thickness_stretch: float
    volume_ratio: float
    nominal_stress: float
    lateral_stress: float
    energy_density: float


def biaxial(law: Law, stretch: float, lateral_stretch: float, plane: str = "stress") -> HomogeneousState:
    """Return the state of a sheet at two given in-plane stretches; `plane` is one of `SHEETS`."""
    if plane not in SHEETS:
        raise ValueError(f"plane must be {' or '.join(SHEETS)} for two given stretches of a sheet, not {plane}")
    for value in (stretch, lateral_stretch):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"a stretch must be positive and finite, not {value}")
    F = np.diag([stretch, lateral_stretch])
    trace, J = invariants(F)
    at = PLANES[plane]
    J3 = float(at.volume_ratio(law, trace, J))
    P = at.first_piola_stress(law, F)
    if not np.isfinite(P).all():
        raise ValueError(
            f"{law.name}: no state at stretches of {stretch:g} and {lateral_stretch:g}: {law.limit(stretch_squares(trace, J))}"
        )
    return HomogeneousState(
        float(stretch),
        float(lateral_stretch),
        J3 / (stretch * lateral_stretch),
        J3,
        float(P[0, 0]),
        float(P[1, 1]),
        float(at.energy_density(law, F)),
    )


def uniaxial(law: Law, stretch: float, plane: str = "stress") -> HomogeneousState:
    """Return the state in tension or compression along x1 with free sides: P22 = 0, and P33 = 0 in plane stress and three dimensions.

    `plane` is a name of `PLANES`.
    """
    if plane == "space":
        # The state is that of plane stress, since the thickness is free as well.
        plane = "stress"

    def lateral_stress(lateral_stretch):
        return biaxial(law, stretch, lateral_stretch, plane).lateral_stress

    # The search starts at the incompressible lateral stretch and stops at the law's limit, which may be near.
    middle = stretch**-0.5 if plane == "stress" else 1 / stretch
    low, high = (_enclosing(lateral_stress, middle, sign) for sign in (-1, 1))
    return biaxial(law, stretch, brentq(lateral_stress, low, high, xtol=1e-15, rtol=1e-15), plane)


def _enclosing(function, middle: float, sign: int) -> float:
    """Return a place, beyond `middle` on one side, where an increasing function has the given sign; raise ValueError if there is none."""
    near, far, step = 0.0, np.inf, 1e-3
    for _ in range(60):
        place = middle * np.exp(sign * step)
        try:
            if sign * function(place) > 0:
                return place
            near = step
        except ValueError:
            far = step
        step = 2 * step if np.isinf(far) else (near + far) / 2
    function(place)
    raise ValueError(f"no state with zero lateral stress between {middle:g} and {place:g}")


def equibiaxial(law: Law, stretch: float) -> HomogeneousState:
    """Return the state at equal stretches along x1 and x2."""
    return biaxial(law, stretch, stretch)


def pure_shear(law: Law, stretch: float) -> HomogeneousState:
    """Return the state at a stretch along x1 and a fixed width (lateral stretch 1)."""
    return biaxial(law, stretch, 1.0)


def sheet_states(law: Law, stretch: np.ndarray, lateral_stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nominal stress and volume ratio of many homogeneous states under plane stress at once, as a fit asks for them.

    Parameters
    ----------
    law : Law
    stretch : ndarray, shape (n,)
        Along the stress.
    lateral_stretch : ndarray, shape (n,)
        Across it, in the plane; NaN where nothing holds the sides, which then have no stress, nor has the thickness.

    Returns
    -------
    nominal_stress, volume_ratio : ndarray, shape (n,)
        P11, in the unit of the shear modulus, and J3; NaN where the law has no state, past its limit.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> stress, volume = sheet_states(pds.materials.NeoHookean(), np.array([1.5, 1.5]), np.array([np.nan, 1.0]))
    >>> bool(np.isclose(stress[0], uniaxial(pds.materials.NeoHookean(), 1.5).nominal_stress))
    True
    """
    free = np.isnan(lateral_stretch)

    def at(J3):
        # Sides and thickness that nothing holds have one stretch, by symmetry.
        lateral = np.where(free, np.sqrt(J3 / stretch), lateral_stretch)
        return response(law, stretch**2 + lateral**2, stretch * lateral, J3)

    J3 = np.ones_like(stretch)
    bulk = law.bulk_modulus / law.shear_modulus
    with np.errstate(all="ignore"):
        for _ in range(60):
            residual, ahead = at(J3)[2], at((1 + STEP) * J3)[2]
            step = np.clip(STEP * J3 * residual / (ahead - residual), -J3, 0.5 * J3)
            # Past the law's limit, where the residual is NaN, the state swells: with more volume it may keep the limit.
            J3 = J3 - np.where(np.isnan(step), -SWELLING * J3, step)
            # The iteration squares the error: after this step it is at rounding.
            if np.all(np.abs(step) <= 1e-8 * J3):
                break
        p, q, residual, *_ = at(J3)
    reached = np.abs(residual) <= 1e-9 * bulk
    return np.where(reached, law.shear_modulus * (p * stretch + q / stretch), np.nan), np.where(reached, J3, np.nan)
