"""Small bodies of sheets and solids for tests, with holes, notches and planes of reflection, and
deformations of them.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ..body import Body, ReflectionPlane, grid
from ..scenes.model import USUAL

SPACING = 0.1
"""Distance of neighboring points in the small bodies; lengths here have no unit."""

HORIZONS = USUAL["horizon_ratio"]
"""Horizon of the small bodies in spacings, by dimension: 3.15 (the paper's) in the plane, 1.75 (26
bonds at a point) in three dimensions.
"""


def lattice(*sides: float) -> np.ndarray:
    """Return cell-centered points 0.1 apart, shape (n, d), in a box with one corner at the
    origin and given sides; x1 varies fastest.
    """
    return grid((0,) * len(sides), sides, SPACING)


def of_points(points: np.ndarray, ratio: float | None = None, **options) -> Body:
    """Return a body of given points 0.1 apart, shape (n, d); the horizon is `ratio` spacings, by
    default `HORIZONS[d]`.

    `options` are further arguments of `Body`.
    """
    dimension = points.shape[1]
    return Body(
        points,
        np.full(len(points), SPACING**dimension),
        (ratio or HORIZONS[dimension]) * SPACING,
        SPACING,
        **options,
    )


def sheet(spacing=SPACING, width=1.2, height=1.0, **options) -> Body:
    """Return a rectangular body in the plane with a horizon of 3.15 spacings; `options` are
    further arguments of `Body`.
    """
    return Body.rectangle(width, height, spacing, HORIZONS[2] * spacing, **options)


def plain(dimension: int, width=1.2, **options) -> Body:
    """Return a rectangle of sides `width` and 1, or in three dimensions a block of sides `width`, 1
    and 0.4, with regular points.

    `options` are further arguments of `Body`.
    """
    return of_points(lattice(*(width, 1.0, 0.4)[:dimension]), **options)


def gripped(dimension=2, parity=(-1, 1, 1)) -> Body:
    """Return a `plain` body with reflection planes at its left and right edges or faces, beyond
    which mirror images of points continue it.

    `parity` is the sign of each displacement component in the images; by default the normal
    component changes its sign, which makes both planes symmetry planes (frictionless rollers).
    """
    ends = ((0.0, -1), (1.2, 1))
    return plain(
        dimension,
        planes=tuple(ReflectionPlane(0, place, side, parity[:dimension]) for place, side in ends),
    )


def jittered(random: np.random.Generator, amount=0.3, dimension=2, **options) -> Body:
    """Return a rectangle or block whose points are moved at random by up to `amount` spacings along
    each axis.

    `options` are further arguments of `Body`.
    """
    points = lattice(*(1.2, 1.0, 0.4)[:dimension])
    return of_points(points + amount * 0.1 * random.uniform(-1, 1, points.shape), **options)


def disc_with_hole(dimension=2, **options) -> Body:
    """Return a disc with a hole, or in three dimensions a tube; curved edges cut the horizons of
    points in many ways.

    `options` are further arguments of `Body`.
    """
    points = lattice(*(2.0, 2.0, 0.4)[:dimension])
    radius = np.linalg.norm(points[:, :2] - 1, axis=1)
    return of_points((points - 1)[(radius < 0.95) & (radius > 0.3)], **options)


def notched(dimension=2, **options) -> Body:
    """Return a rectangle or block with a notch and no symmetry, of some 80 points in the plane and
    250 in three dimensions.

    `options` are further arguments of `Body`.
    """
    points = lattice(*(1.0, 0.9, 0.3)[:dimension])
    return of_points(
        points[(np.abs(points[:, :2] - [0.35, 0.9]) > [0.1, 0.3]).any(axis=1)], **options
    )


def crack(height: float, length: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the argument ``separates`` of `Body` for a straight cut at x2 = `height`, from the
    left edge or face to x1 = `length`.

    The argument is a function that takes the two ends of bonds, each of shape (k, d), and returns a
    mask of the bonds that the cut crosses.
    """

    def separates(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        crosses = (start[:, 1] - height) * (end[:, 1] - height) < 0
        share = (height - start[:, 1]) / np.where(crosses, end[:, 1] - start[:, 1], 1.0)
        return crosses & (start[:, 0] + share * (end[:, 0] - start[:, 0]) < length)

    return separates


def turn(degrees: float, dimension: int = 2) -> np.ndarray:
    """Return the matrix of a rotation by an angle in degrees, shape (d, d), in three dimensions
    about an axis parallel to no face of a block.
    """
    axis = np.array([-2.0, 1.0, -2.0]) / 3 if dimension == 3 else np.array([0.0, 0.0, 1.0])
    return Rotation.from_rotvec(degrees * axis, degrees=True).as_matrix()[:dimension, :dimension]


def wavy(points: np.ndarray) -> np.ndarray:
    """Return the positions of points, shape (n, d), under a smooth inhomogeneous deformation
    with waves.
    """
    x1, x2, *rest = points.T
    across = [0.82 * x3 + 0.05 * x2 + 0.02 * np.sin(4 * x1) for x3 in rest]
    return np.column_stack(
        [1.3 * x1 + 0.02 * np.sin(4 * x2), 0.95 * x2 + 0.1 * x1 + 0.02 * np.cos(5 * x1), *across]
    )


class Deformation(NamedTuple):
    """Deformation for tests: first waves of random direction, then stretches along rotated axes,
    then a rotation of the body.

    `first` and `second` are the stretches (in three dimensions the third keeps the volume); `axes`
    is the angle of their axes and `rotation` that of the body, in degrees; `amplitude` is that of
    the waves, a length in the unit of the coordinates, and `seed` that of the random generator for
    the waves.
    """

    first: float
    second: float
    rotation: float
    axes: float
    amplitude: float
    seed: int

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Return the deformed positions of points; both have shape (n, d)."""
        random = np.random.default_rng(self.seed)
        d = points.shape[1]
        stretches = [self.first, self.second, 1 / (self.first * self.second)][:d]
        F = turn(self.rotation, d) @ turn(self.axes, d) @ np.diag(stretches) @ turn(-self.axes, d)
        waves = self.amplitude * np.sin(
            points @ random.uniform(-6, 6, (d, d)) + random.uniform(0, 6, d)
        )
        return (points + waves) @ F.T


DEFORMATIONS = (
    Deformation(1.3, 0.95, 0.0, 15.0, 0.01, 1),
    Deformation(1.9, 0.75, 100.0, 70.0, 0.005, 2),
    Deformation(0.8, 0.9, -170.0, 0.0, 0.01, 3),
)
"""Default deformations of the cases that accept others: stretched; strongly stretched and
rotated; compressed and rotated.
"""
