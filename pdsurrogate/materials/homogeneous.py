"""Exact homogeneous solutions of slightly compressible laws, in plane stress or plane strain, as
references for simulations.

The textbook formulas of the paper's Table 1 hold in the incompressible limit and are off by about 1
% in stress at K = 100 mu.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .law import Law
from .states import PLANES, SHEETS, invariants, newton, plane_stress, stretch_squares

STEP = 1e-7
"""Relative difference from which Newton's iteration computes its slope. Chosen near the square root
of rounding: the slope has an error of some 1e-7, which costs the iteration no step and the result
nothing.
"""


@dataclass(frozen=True)
class HomogeneousState:
    """Stretches, stresses and energy density of a body under homogeneous loading along the axes x1
    and x2.

    Attributes
    ----------
    stretch, lateral_stretch, thickness_stretch : float
        Principal stretches along x1, along x2, and through the thickness.
    volume_ratio : float
        J3, deformed volume divided by undeformed volume.
    nominal_stress, lateral_stress : float
        P11 and P22, in the same unit as the shear modulus.
    energy_density : float
        Strain energy per undeformed volume, in the same unit as the shear modulus.
    """

    stretch: float
    lateral_stretch: float
    thickness_stretch: float
    volume_ratio: float
    nominal_stress: float
    lateral_stress: float
    energy_density: float


def biaxial(
    law: Law, stretch: float, lateral_stretch: float, plane: str = "stress"
) -> HomogeneousState:
    """Return the homogeneous state of a sheet at two given in-plane stretches, in plane "stress"
    or "strain".
    """
    if plane not in SHEETS:
        raise ValueError(
            f"plane must be {' or '.join(SHEETS)} for two given stretches of a sheet, not {plane}"
        )
    for value in (stretch, lateral_stretch):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"a stretch must be positive and finite, not {value}")
    F = np.diag([stretch, lateral_stretch])
    J3, P, energy = PLANES[plane].exact(law, F)
    if not np.isfinite(P).all():
        limit = law.limit(stretch_squares(*invariants(F)))
        raise ValueError(
            f"{law.name}: no state exists at the stretches {stretch:g} and {lateral_stretch:g}:"
            f" {limit}"
        )
    thickness = J3 / (stretch * lateral_stretch)
    return HomogeneousState(
        *map(float, (stretch, lateral_stretch, thickness, J3, P[0, 0], P[1, 1], energy))
    )


def uniaxial(law: Law, stretch: float, plane: str = "stress") -> HomogeneousState:
    """Return the homogeneous state in tension or compression along x1 with free sides: P22 = 0, and
    P33 = 0 except in plane strain.

    `plane` is a name of `PLANES`.
    """
    first = np.array([stretch], dtype=float)
    if plane == "strain":
        # Free sides and a held thickness are the free thickness and the held sides of pure shear.
        lateral = sheet_states(law, first, np.ones(1))[1] / first
    else:
        lateral = np.sqrt(sheet_states(law, first, np.array([np.nan]))[1] / first)
    if not np.isfinite(lateral).all():
        side = stretch ** (-1.0 if plane == "strain" else -0.5)
        squares = stretch_squares(stretch**2 + side**2, stretch * side)
        raise ValueError(
            f"{law.name}: no state with free sides exists at the stretch {stretch:g}:"
            f" {law.limit(squares)}"
        )
    return biaxial(law, stretch, float(lateral[0]), "strain" if plane == "strain" else "stress")


def _root(function: Callable[[np.ndarray], np.ndarray], start: np.ndarray) -> np.ndarray:
    """Return the zeros of increasing functions of positive numbers, by Newton's method from `start`
    with slopes from differences.

    ``function(x)`` evaluates all functions, one for each element of x. A zero is NaN if its
    function is not finite there.
    """
    found = newton(
        lambda x: (function(x), (function((1 + STEP) * x) - function(x)) / (STEP * x)), start, 1e-8
    )
    with np.errstate(all="ignore"):
        return np.where(np.isfinite(function(found)), found, np.nan)


def equibiaxial(law: Law, stretch: float) -> HomogeneousState:
    """Return the homogeneous state of a sheet under plane stress at equal stretches along x1 and
    x2.
    """
    return biaxial(law, stretch, stretch)


def pure_shear(law: Law, stretch: float) -> HomogeneousState:
    """Return the homogeneous state of a sheet under plane stress at a stretch along x1 and a
    fixed width (lateral stretch 1).
    """
    return biaxial(law, stretch, 1.0)


def sheet_states(
    law: Law, stretch: np.ndarray, lateral_stretch: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return nominal stress and volume ratio of many homogeneous states under plane stress at once.

    Parameters
    ----------
    law : Law
    stretch : ndarray, shape (n,)
        Stretches along the stress.
    lateral_stretch : ndarray, shape (n,)
        Stretches across the stress, in the plane; NaN for free sides, which have no stress. The
        thickness is always free of stress.

    Returns
    -------
    nominal_stress, volume_ratio : ndarray, shape (n,)
        P11, in the same unit as the shear modulus, and J3; NaN where the law has no state, past its
        limit.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> stress, volume = sheet_states(
    ...     pds.materials.NeoHookean(), np.array([1.5, 1.5]), np.array([np.nan, 1.0])
    ... )
    >>> bool(np.isclose(stress[0], uniaxial(pds.materials.NeoHookean(), 1.5).nominal_stress))
    True
    """
    at = sheet_response(law, stretch, lateral_stretch)
    J3 = _root(lambda J3: at(J3)[1], np.ones_like(stretch))
    stress, residual = at(J3)
    reached = np.abs(residual) <= 1e-9 * law.bulk_modulus / law.shear_modulus
    return np.where(reached, stress, np.nan), np.where(reached, J3, np.nan)


def sheet_response(
    law: Law, stretch: np.ndarray, lateral_stretch: np.ndarray
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return a function of J3 that gives the nominal stress of states as in `sheet_states`, and
    what vanishes where the thickness is free.

    The latter is divided by the shear modulus. All arrays have the shape (n,).
    """
    free = np.isnan(lateral_stretch)

    def at(J3):
        # Free sides and thickness have the same stretch, by symmetry.
        lateral = np.where(free, np.sqrt(J3 / stretch), lateral_stretch)
        with np.errstate(all="ignore"):
            p, q, residual, *_ = plane_stress.response(
                law, stretch**2 + lateral**2, stretch * lateral, J3
            )
            return law.shear_modulus * (p * stretch + q / stretch), residual

    return at
