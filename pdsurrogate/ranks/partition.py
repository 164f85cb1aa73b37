"""Which rank owns which points: recursive bisection along the longest side, with as many bonds on either side as ranks ask for."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree


def bond_counts(points: np.ndarray, horizon: float, chosen: slice = slice(None)) -> np.ndarray:
    """Neighbours within the horizon of some of the points, and the points themselves: what an evaluation costs them."""
    counted = cKDTree(points).query_ball_point(points[chosen], horizon * (1 + 1e-9), return_length=True)
    return np.asarray(counted, dtype=float)


def bisected(points: np.ndarray, weights: np.ndarray, parts: int) -> np.ndarray:
    """Number of the part of every point, shape (n,).

    Parameters
    ----------
    points : ndarray, shape (n, d)
    weights : ndarray, shape (n,)
        What each part gets nearly the same sum of.
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
