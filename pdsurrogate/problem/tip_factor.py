"""Mean energy densities around the tips of long cuts, by the law, theory (107)-(108a)."""

import math

import numpy as np
import scipy

from ..materials import Law
from ..materials.tearing import TABLE, tension_states
from .strength_surface import Surface, rising

STRETCHES = (1.0, 1.05, 1.2, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, math.inf)
SHARES = (0.0, 0.031, 0.142, 0.338, 0.552, 0.761, 0.854, 0.93, 0.96, 1.0)
"""Share of the way from the factor of small strains to that of large ones, 1, by stretch at break,
in an incompressible neo-Hookean sheet: from finite elements (`pipelines/strength.py`).
"""

SHIFTS = np.linspace(0, 0.6, 13)[:, None]
"""Distances of the centers of discs from the tip over their radii. Chosen: means change by less
than 0.001 between two of them, and are smaller beyond the last.
"""


def factor_of(law: Law, stretch: float, plane: str, surface: Surface | None = None) -> float:
    """Return the factor c of a law that breaks at a stretch in uniaxial tension: the greatest mean
    energy density, or that of a strength surface, over discs of radius R ahead of the tip of a long
    crack is c G / (pi R), if it is the work at break.

    For small strains it is that of the field of Williams, from there to large ones it changes as in
    neo-Hookean sheets, and the law enters by the field of Rice. A solid has the factor of plane
    strain.

    Raises
    ------
    ValueError
        If the stress in uniaxial tension does not rise up to the break.
    """
    nu = law.poisson_ratio
    kappa = (3 - nu) / (1 + nu) if plane == "stress" else 3 - 4 * nu
    angle = (np.arange(TABLE) + 0.5) * math.pi / TABLE
    cos = np.cos(angle)
    density = (1 + cos) * (kappa - cos) / (kappa + 1)
    if surface:
        density = surface.density_around_tip(angle, nu, plane)
    ways = SHIFTS * cos + np.sqrt(1 - (SHIFTS * np.sin(angle)) ** 2)
    small = (density * ways).mean(axis=1).max()
    share = np.interp(-1 / stretch, -1 / np.array(STRETCHES), SHARES)
    return float(small + (1 - small) * share) * factor_of_rice(law, stretch)


def factor_of_rice(law: Law, stretch: float) -> float:
    """Return the factor by the field of Rice for a law, which is 1 in incompressible neo-Hookean
    material: the energy density exceeds a value in a circle, and its mean over a disc is the
    integral over all values of the areas that their circles share with the disc.
    """
    stretches, stresses, roots = (rows[1:] for rows in tension_states(law, stretch))
    shears = (stretches - 1) * np.sqrt(1 + 2 / stretches)
    loads = stresses * shears / (stretches - stretches**-2)
    count = rising(law, stretches, loads, TABLE - 1)
    shears, loads, works = shears[:count], loads[:count], np.square(roots[:count])
    work = works[TABLE - 2]
    radii = 1 / (math.pi * loads * shears)
    last = 1 + math.log(loads[-1] / loads[-2]) / math.log(shears[-1] / shears[-2])
    outward = scipy.integrate.cumulative_trapezoid(radii[::-1], -np.log(shears[::-1]), initial=0)
    centers = 2 * (radii[-1] / last + outward[::-1]) - radii

    def excess(radius: float) -> float:
        areas = common_areas(radius, radii, centers - SHIFTS * radius)
        wholes = works[0] * math.pi * radius**2 + areas[:, -1] * loads[-1] * shears[-1] / last
        wholes += (areas[:, 1:] + areas[:, :-1]) / 2 @ np.diff(works)
        return float(wholes.max() / (math.pi * radius**2) - work)

    return math.pi * work * scipy.optimize.brentq(excess, 1e-6 / work, 10 / work)


def common_areas(radius: float, radii: np.ndarray, away: np.ndarray) -> np.ndarray:
    """Return the areas that a circle shares with others of given radii (n,) and distances of their
    centers (..., n), shape (..., n).
    """
    away = np.maximum(np.abs(away), np.finfo(float).tiny)
    areas = np.zeros(away.shape)
    for one, other in ((radius, radii), (radii, radius)):
        cos = np.clip((away**2 + one**2 - other**2) / (2 * away * one), -1, 1)
        areas += one**2 * (np.arccos(cos) - cos * np.sqrt(1 - cos**2))
    return areas
