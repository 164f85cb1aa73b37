"""Small bodies of every kind that tests and hard cases are put to."""

from __future__ import annotations

import numpy as np

from ..body import Body, ReflectionPlane, grid


def sheet(spacing=0.1, width=1.2, height=1.0, **options) -> Body:
    """A plain rectangle, 3.15 spacings of horizon."""
    return Body.rectangle(width, height, spacing, 3.15 * spacing, **options)


def of_points(points: np.ndarray, **options) -> Body:
    """A body of points 0.1 apart, 3.15 spacings of horizon."""
    return Body(points, np.full(len(points), 0.01), 0.315, 0.1, **options)


def jittered(random: np.random.Generator, amount=0.3, **options) -> Body:
    """A rectangle whose points are moved by up to `amount` spacings."""
    points = grid((0, 0), (1.2, 1.0), 0.1)
    return of_points(points + amount * 0.1 * random.uniform(-1, 1, points.shape), **options)


def disc_with_hole(**options) -> Body:
    """A disc with a hole: no straight edge, incomplete horizons of every kind."""
    points = grid((-1, -1), (1, 1), 0.1)
    radius = np.linalg.norm(points, axis=1)
    return of_points(points[(radius < 0.95) & (radius > 0.3)], **options)


def notched_sheet(**options) -> Body:
    """Some 80 points without a symmetry of their own, edges and a notch included."""
    points = grid((0, 0), (1.0, 0.9), 0.1)
    return of_points(points[(np.abs(points - [0.35, 0.9]) > [0.1, 0.3]).any(axis=1)], **options)


def gripped_sheet(parity=(-1, 1)) -> Body:
    """A rectangle continued by images beyond its left and right edges."""
    return sheet(planes=(ReflectionPlane(0, 0.0, -1, parity), ReflectionPlane(0, 1.2, 1, parity)))
