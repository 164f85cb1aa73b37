"""Small bodies for tests."""

import numpy as np

from pdsurrogate.body import Body, ReflectionPlane, grid


def sheet(spacing=0.1, width=1.2, height=1.0, **options):
    """A plain rectangle, 3.15 spacings of horizon."""
    return Body.rectangle(width, height, spacing, 3.15 * spacing, **options)


def jittered(random, amount=0.3, **options):
    """A rectangle whose points are moved by up to `amount` spacings."""
    points = grid((0, 0), (1.2, 1.0), 0.1)
    return Body(points + amount * 0.1 * random.uniform(-1, 1, points.shape), np.full(len(points), 0.01), 0.315, 0.1, **options)


def disc_with_hole(**options):
    """A disc with a hole: no straight edge, incomplete horizons of every kind."""
    points = grid((-1, -1), (1, 1), 0.1)
    radius = np.linalg.norm(points, axis=1)
    points = points[(radius < 0.95) & (radius > 0.3)]
    return Body(points, np.full(len(points), 0.01), 0.315, 0.1, **options)


def gripped_sheet(parity=(-1, 1)):
    """A rectangle continued by images beyond its left and right edges."""
    return sheet(planes=(ReflectionPlane(0, 0.0, -1, parity), ReflectionPlane(0, 1.2, 1, parity)))


def rotation(angle):
    """2 x 2 rotation matrix."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
