"""Errors of a bond force against the exact one, on and off the plane-stress surface and by strain, and its least stiffness."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from ..forces import AnalyticBondForce
from ..materials import Law
from .sampling import states_of_strain, wide_bonds

STRAIN_BINS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 3.0)
"""Bounds of the bins of greatest principal strain in error reports: two or three in a decade, up to the strain at a stretch of 4."""

SLOPE_STEP = 1e-4
"""Relative change of lambda_b in central differences of the force: in double precision their error is 1e-8 of the slope."""


def relative_errors(predicted: np.ndarray, exact: np.ndarray) -> dict[str, float]:
    """Return the RMS (``rms``) and the greatest (``max``) error of vectors, shape (n, d), divided by the RMS of the exact ones."""
    error = np.linalg.norm(predicted - exact, axis=1)
    size = np.sqrt((exact**2).sum(axis=1).mean())
    return {"rms": float(np.sqrt((error**2).mean()) / size), "max": float(error.max() / size)}


def force_report(force: Callable, law: Law, stretch_range: tuple[float, float], n_samples: int, random_state: int) -> dict:
    """Compare a bond force with the exact one.

    Parameters
    ----------
    force : callable
        ``force(stretch, rotation, length, C33, J)``.
    law : Law
    stretch_range : tuple of float
        Least and greatest principal stretch.
    n_samples : int
        States in each set.
    random_state : int
        Seed; choose one that no training used.

    Returns
    -------
    dict
        ``on_surface`` and ``off_surface``: ``rms`` and ``max`` of the error over the RMS of the exact force; ``by_strain``: list of bins
        with their ``strain`` bounds, ``rms`` and ``max``; ``at_rest``: size of the force on an undeformed bond; ``least_slope``: least
        d t_n / d lambda_b at fixed dtheta, J and C33 over both sets, with ``least_slope_exact`` of the exact force in these states. Short
        waves are unstable unless the least slope is positive.
    """
    on, on_force, _ = wide_bonds(law, n_samples, stretch_range, 0.25, 0, random_state)
    off, off_force, _ = wide_bonds(law, n_samples, stretch_range, 0, 1, random_state + 1)
    bins = []
    for number, strains in enumerate(strain_bins(*stretch_range)):
        X, exact = states_of_strain(law, strains, stretch_range, max(n_samples // 10, 100), random_state + 2 + number)
        bins.append({"strain": list(strains), **relative_errors(force(*X.T), exact)})
    states = np.vstack([on, off])
    exact = AnalyticBondForce(law).bond_force
    return {
        "stretch_range": list(stretch_range),
        "n_samples": n_samples,
        "random_state": random_state,
        "on_surface": relative_errors(force(*on.T), on_force),
        "off_surface": relative_errors(force(*off.T), off_force),
        "by_strain": bins,
        "at_rest": float(np.linalg.norm(force([1.0], [0.0], [1.0], [1.0], [1.0]))),
        "least_slope": float(stiffness_slopes(force, states).min()),
        "least_slope_exact": float(stiffness_slopes(exact, states).min()),
    }


def strain_bins(low: float, high: float) -> list[tuple[float, float]]:
    """Return the bins of greatest principal strain up to that of a range of stretches, at which the last bin ends."""
    reach = max(high - 1, 1 - low)
    return [(least, min(greatest, reach)) for least, greatest in pairwise(STRAIN_BINS) if least < reach * (1 - 1e-9)]


def stiffness_slopes(force: Callable, states: np.ndarray) -> np.ndarray:
    """Return d t_n / d lambda_b at fixed dtheta, length, C33 and J, by central differences, shape (n,)."""
    stretch = states[:, 0]
    low, high = (force(stretch * (1 + sign * SLOPE_STEP), *states[:, 1:].T)[:, 0] for sign in (-1, 1))
    return (high - low) / (2 * SLOPE_STEP * stretch)
