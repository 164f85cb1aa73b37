"""Division of points among ranks: recursive bisection along the longest side, by the number of bonds."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree


def bond_counts(points: np.ndarray, horizon: float, chosen: slice = slice(None)) -> np.ndarray:
    """Return the number of points within the horizon of each chosen point, itself included, to which its cost is proportional."""
    counted = cKDTree(points).query_ball_point(points[chosen], horizon * (1 + 1e-9), return_length=True)
    return np.asarray(counted, dtype=float)


def bisected(points: np.ndarray, weights: np.ndarray, parts: int) -> np.ndarray:
    """Return the number of the part of every point, shape (n,).

    Parameters
    ----------
    points : ndarray, shape (n, d)
    weights : ndarray, shape (n,)
        Costs, whose sums are nearly equal in all parts.
    parts : int

    References
    ----------
    Berger and Bokhari, IEEE Trans. Comput. 36 (1987) 570-580.
    """
    part = np.zeros(len(points), dtype=np.int32)

    def split(numbers: np.ndarray, first: int, count: int) -> None:
        if count == 1:
            part[numbers] = first
            return
        before = count // 2
        axis = int(np.ptp(points[numbers], axis=0).argmax())
        order = numbers[np.argsort(points[numbers, axis], kind="stable")]
        sums = np.cumsum(weights[order])
        cut = int(np.clip(np.searchsorted(sums, sums[-1] * before / count), before, len(order) - (count - before)))
        split(order[:cut], first, before)
        split(order[cut:], first + before, count - before)

    split(np.arange(len(points)), 0, parts)
    return part
