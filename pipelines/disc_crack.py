"""A disc crack in a cylinder by linear finite elements: an independent figure for the volume of its opening."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.optimize import brentq
from scipy.sparse.linalg import spsolve


def opened_volume(radius: float, outer: float, length: float, poisson: float, intervals: int = 16, finest: float = 1e-3) -> float:
    """Volume of the opening of a disc crack across the middle of a cylinder, over Sneddon's for an endless body at the same mean stress.

    The cylinder's ends slide on the plates that pull them.  Axisymmetric elements of nine nodes on half of it, graded toward the edge of
    the crack in geometric sequences; the volume is what the crack takes off the force of the plates.  It comes from below: for a radius of
    0.4 in a cylinder of radius 1 and length 3, nu = 0.475, it is 1.0315, 1.0344 and 1.0350 with (10, 4e-3), (16, 1e-3) and (20, 4e-4).

    Parameters
    ----------
    radius, outer, length : float
        Of the crack and of the cylinder.
    poisson : float
    intervals : int
        Elements between the edge of the crack and the axis or the side.
    finest : float
        Size of those at the edge, in units of the cylinder's radius.

    Returns
    -------
    float
        Without dimension.
    """
    half, finest = length / 2, finest * outer
    r = np.concatenate([radius - _graded(radius, intervals, finest)[:0:-1], radius + _graded(outer - radius, intervals, finest)])
    z = _graded(half, intervals + 6, finest)
    # Lame's constants with E = 1.
    lame, shear = poisson / ((1 + poisson) * (1 - 2 * poisson)), 1 / (2 * (1 + poisson))
    D = np.diag([2 * shear, 2 * shear, 2 * shear, shear])
    D[:3, :3] += lame
    rows, columns, values = [], [], []
    nodes_along = 2 * len(z) - 1
    for i in range(len(r) - 1):
        for j in range(len(z) - 1):
            nodes = ((2 * i + np.arange(3))[:, None] * nodes_along + 2 * j + np.arange(3)).ravel()
            unknowns = np.stack([2 * nodes, 2 * nodes + 1], axis=1).ravel()
            rows.append(np.repeat(unknowns, 18))
            columns.append(np.tile(unknowns, 18))
            values.append(_stiffness(r[i], r[i + 1] - r[i], z[j + 1] - z[j], D).ravel())
    K = sparse.csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))))
    number = np.arange(K.shape[0] // 2).reshape(-1, nodes_along)
    places = np.sort(np.concatenate([r, (r[1:] + r[:-1]) / 2]))
    ahead = places >= radius - 1e-12 * outer
    pulled = 2 * number[:, -1] + 1
    held = np.concatenate([2 * number[0], 2 * number[ahead, 0] + 1, pulled])
    u = np.zeros(K.shape[0])
    u[pulled] = 1.0
    free = np.setdiff1d(np.arange(len(u)), held)
    u[free] = spsolve(K[free][:, free], -K[free][:, held] @ u[held])
    stress = (K @ u)[pulled].sum() / (np.pi * outer**2)
    volume = (1 - stress * half) * 2 * np.pi * outer**2
    return float(volume / (16 * (1 - poisson**2) * stress * radius**3 / 3))


def _graded(length: float, count: int, finest: float) -> np.ndarray:
    """Places from 0 on in a geometric sequence of intervals."""
    growth = brentq(lambda q: finest * (q**count - 1) / (q - 1) - length, 1 + 1e-6, 10.0)
    return np.concatenate([[0.0], np.cumsum(finest * growth ** np.arange(count))])


def _stiffness(start: float, width: float, height: float, D: np.ndarray) -> np.ndarray:
    """Of an element from radius `start` on, shape (18, 18)."""
    points, weights = np.polynomial.legendre.leggauss(3)

    def shape(s):
        return np.array([s * (s - 1) / 2, 1 - s * s, s * (s + 1) / 2])

    def slope(s):
        return np.array([s - 0.5, -2 * s, s + 0.5])

    K = np.zeros((18, 18))
    for p, across in zip(points, weights, strict=True):
        for q, along in zip(points, weights, strict=True):
            radius = start + width * (p + 1) / 2
            by_r, by_z = np.outer(slope(p), shape(q)).ravel() * 2 / width, np.outer(shape(p), slope(q)).ravel() * 2 / height
            B = np.zeros((4, 18))
            B[0, ::2], B[1, 1::2], B[2, ::2] = by_r, by_z, np.outer(shape(p), shape(q)).ravel() / radius
            B[3, ::2], B[3, 1::2] = by_z, by_r
            K += B.T @ D @ B * across * along * width * height / 4 * 2 * np.pi * radius
    return K
