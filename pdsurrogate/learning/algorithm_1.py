"""Samples as the paper draws them, Algorithm 1."""

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
"""Bond lengths for every deformation gradient of Algorithm 1, and orientations for every length."""


def algorithm_1(
    law: Law,
    n_samples: int = 10_000,
    stretch_range: tuple[float, float] = (0.8, 4.0),
    horizon: float = 1.0,
    weight: str = "inverse",
    nondimensional: bool = True,
    random_state: int = 0,
) -> Samples:
    """Loops over principal stretches, within them over bond lengths, within these over bond orientations.

    The paper says "for various"; here lengths and orientations are drawn evenly from their ranges, stretches evenly in the logarithm.
    (On a full grid of values a network can be exact at the grid's few stretches and wrong by percents between them.  Drawn evenly
    themselves, two stretches out of a thousand pairs come near the corner of least stretches, where C33 is largest, and a network is
    wrong there by ten times its error elsewhere.)

    Parameters
    ----------
    law : Law
    n_samples : int
        About how many: one pair of stretches for every `LENGTHS` x `ORIENTATIONS` of them.
    stretch_range : tuple of float
        Of both principal stretches.
    horizon : float
        delta; lengths run over (0, delta].
    weight : str
        Weight function.
    nondimensional : bool
        Lengths in units of the horizon, forces as t kappa/(w l mu) [1]; else lengths as they are, forces by Eq. (2) on a full circular
        horizon, in the unit of the shear modulus over the horizon's cubed.
    random_state : int
        Seed.

    Returns
    -------
    Samples

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> samples = pds.algorithm_1(pds.NeoHookean(), n_samples=200, random_state=0)
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
