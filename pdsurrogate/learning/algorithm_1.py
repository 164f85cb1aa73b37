"""Samples of bond forces by the paper's Algorithm 1."""

from __future__ import annotations

import numpy as np

from ..arguments import check_seed, check_whole_number
from ..body import WEIGHT_FUNCTIONS
from ..materials import Law
from ..materials.law import check_number, checked_law
from .bond_force import BOND_FORCE
from .sampling import checked_range, force_factor, force_on_bonds, log_stretches, on_surface
from .targets import Samples

LENGTHS, ORIENTATIONS = 2, 5
"""Bond lengths for each deformation gradient of Algorithm 1, and orientations for each length: enough for both to be spread, and few
enough for a thousand gradients among 10,000 samples."""


def algorithm_1(
    law: Law,
    n_samples: int = 10_000,
    stretch_range: tuple[float, float] = (0.8, 4.0),
    horizon: float = 1.0,
    weight: str = "inverse",
    nondimensional: bool = True,
    random_state: int = 0,
) -> Samples:
    """Draw samples of bond forces by the paper's Algorithm 1: loops over principal stretches, bond lengths and bond orientations.

    The paper loops over "various" values. Here lengths and orientations are drawn uniformly from their ranges, and stretches uniformly in
    the logarithm. On a full grid of values a network can be exact at the few stretches of the grid and wrong by percents between them. If
    stretches themselves were uniform, only two in a thousand pairs would be near the corner of least stretches, where C33 is greatest, and
    a network would be wrong there by ten times its error elsewhere.

    Parameters
    ----------
    law : Law
    n_samples : int
        Number of samples, rounded to whole pairs of stretches: ten samples have the same pair.
    stretch_range : tuple of float
        Least and greatest principal stretch.
    horizon : float
        Horizon delta; lengths are in (0, delta].
    weight : str
        Weight function.
    nondimensional : bool
        Whether lengths are in units of the horizon, and forces are t kappa/(w l mu). Otherwise lengths have the unit of the horizon, and
        forces, by Eq. (2) on a full circular horizon, that of the shear modulus over the cube of the horizon's.
    random_state : int
        Seed.

    Returns
    -------
    Samples

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.learning.algorithm_1(pds.materials.NeoHookean(), n_samples=200, random_state=0)
    >>> samples.X.shape
    (200, 5)
    """
    checked_law(law)
    check_whole_number(n_samples, "n_samples", 1)
    check_seed(random_state)
    check_number(horizon, "horizon")
    if not 0 < horizon < np.inf:
        raise ValueError(f"horizon must be positive and finite, not {horizon}")
    if weight not in WEIGHT_FUNCTIONS:
        raise ValueError(f"unknown weight {weight!r}; there are {', '.join(WEIGHT_FUNCTIONS)}")
    low, high = checked_range(stretch_range)
    random = np.random.default_rng(random_state)
    pairs = max(1, round(n_samples / (LENGTHS * ORIENTATIONS)))
    stretches = np.repeat(np.exp(log_stretches(random, pairs, low, high, near_rest=0.0)), LENGTHS * ORIENTATIONS, axis=0)
    length = np.repeat(horizon * (1 - random.uniform(0, 1, pairs * LENGTHS)), ORIENTATIONS)
    angle = 2 * np.pi * (1 - random.uniform(0, 1, len(length)))
    U_nn, U_nm, J, C33 = on_surface(law, *stretches.T, angle)
    X, y = force_on_bonds(law, U_nn, U_nm, J, C33, length)
    if nondimensional:
        X[:, 2] /= horizon
    else:
        y *= force_factor(length, horizon, weight, law.shear_modulus)[:, None]
    design = {
        "name": "algorithm 1",
        "n_samples": len(X),
        "stretch_range": [low, high],
        "horizon": horizon,
        "weight": weight,
        "nondimensional": nondimensional,
        "random_state": random_state,
    }
    return Samples(X, y, design, BOND_FORCE)
