"""Small bodies for tests and hard cases in two and three dimensions: regular, jittered, with holes, notches and reflection planes."""

from collections.abc import Callable
from itertools import permutations

import numpy as np

from ..body import Body, ReflectionPlane, grid
from ..scenes.model import USUAL

SPACING = 0.1
"""Distance of neighboring points in the small bodies; lengths here have no unit."""

HORIZONS = USUAL["horizon_ratio"]
"""Horizon of the small bodies in spacings, by dimension: 3.15 (the paper's) in the plane, 1.75 (26 bonds at a point) in three
dimensions."""


def lattice(*sides: float) -> np.ndarray:
    """Return cell-centered points 0.1 apart, shape (n, d), in a box with one corner at the origin and given sides; x1 varies fastest."""
    return grid((0,) * len(sides), sides, SPACING)


def of_points(points: np.ndarray, ratio: float | None = None, **options) -> Body:
    """Return a body of given points 0.1 apart, shape (n, d); the horizon is `ratio` spacings, by default `HORIZONS[d]`.

    `options` are further arguments of `Body`.
    """
    dimension = points.shape[1]
    return Body(points, np.full(len(points), SPACING**dimension), (ratio or HORIZONS[dimension]) * SPACING, SPACING, **options)


def regular(dimension: int, cells: int | tuple[int, ...], ratio: float | None = None, **options) -> Body:
    """Return a square (`dimension` 2) or cube (3) with `cells` points a side; a tuple `cells` gives the number of points along each axis.

    The horizon is `ratio` spacings, and `options` are further arguments of `Body`, as in `of_points`.
    """
    cells = (cells,) * dimension if isinstance(cells, int) else cells
    return of_points(lattice(*(count * SPACING for count in cells)), ratio, **options)


def sheet(spacing=SPACING, width=1.2, height=1.0, **options) -> Body:
    """Return a rectangular body in the plane with a horizon of 3.15 spacings; `options` are further arguments of `Body`."""
    return Body.rectangle(width, height, spacing, HORIZONS[2] * spacing, **options)


def plain(dimension: int, width=1.2, **options) -> Body:
    """Return a rectangle of sides `width` and 1, or in three dimensions a block of sides `width`, 1 and 0.4, with regular points.

    `options` are further arguments of `Body`.
    """
    return of_points(lattice(*(width, 1.0, 0.4)[:dimension]), **options)


def gripped(dimension=2, parity=(-1, 1, 1)) -> Body:
    """Return a `plain` body with reflection planes at its left and right edges or faces, beyond which mirror images of points continue it.

    `parity` is the sign of each displacement component in the images; by default the normal component changes its sign, which makes both
    planes symmetry planes (frictionless rollers).
    """
    ends = ((0.0, -1), (1.2, 1))
    return plain(dimension, planes=tuple(ReflectionPlane(0, place, side, parity[:dimension]) for place, side in ends))


def of_simplices(random: np.random.Generator, dimension: int, cells: int, amount=0.2) -> Body:
    """Return a square or cube meshed with triangles or tetrahedra, with a point at the centroid of each, as from a mesh file.

    The body is a regular grid with `cells` squares or cubes along each side. Every square is cut into two triangles, every cube into six
    tetrahedra around its diagonal. Interior corners of the grid are moved at random by up to `amount` sides of a square along each axis, so
    that no two triangles or tetrahedra are alike.
    """
    axes = np.meshgrid(*[np.arange(cells + 1)] * dimension, indexing="ij")
    corners = np.stack(axes, axis=-1).reshape(-1, dimension)
    within = ((corners > 0) & (corners < cells)).all(axis=1)
    nodes = SPACING * (corners + amount * within[:, None] * random.uniform(-1, 1, corners.shape))
    nodes = nodes.reshape(*axes[0].shape, dimension)
    origins = corners[(corners < cells).all(axis=1)]
    middles, volumes = [], []
    for path in permutations(np.eye(dimension, dtype=int)):
        steps = np.cumsum([np.zeros(dimension, dtype=int), *path], axis=0)
        cell = np.stack([nodes[tuple((origins + step).T)] for step in steps], axis=1)
        middles.append(cell.mean(axis=1))
        volumes.append(np.abs(np.linalg.det(cell[:, 1:] - cell[:, :1])) / (2 if dimension == 2 else 6))
    volumes = np.concatenate(volumes)
    spacing = float(volumes.mean() ** (1 / dimension))
    return Body(np.concatenate(middles), volumes, HORIZONS[dimension] * spacing, spacing)


def jittered(random: np.random.Generator, amount=0.3, dimension=2, **options) -> Body:
    """Return a rectangle or block whose points are moved at random by up to `amount` spacings along each axis.

    `options` are further arguments of `Body`.
    """
    points = lattice(*(1.2, 1.0, 0.4)[:dimension])
    return of_points(points + amount * 0.1 * random.uniform(-1, 1, points.shape), **options)


def disc_with_hole(dimension=2, **options) -> Body:
    """Return a disc with a hole, or in three dimensions a tube; curved edges cut the horizons of points in many ways.

    `options` are further arguments of `Body`.
    """
    points = lattice(*(2.0, 2.0, 0.4)[:dimension])
    radius = np.linalg.norm(points[:, :2] - 1, axis=1)
    return of_points((points - 1)[(radius < 0.95) & (radius > 0.3)], **options)


def notched(dimension=2, **options) -> Body:
    """Return a rectangle or block with a notch and no symmetry, of some 80 points in the plane and 250 in three dimensions.

    `options` are further arguments of `Body`.
    """
    points = lattice(*(1.0, 0.9, 0.3)[:dimension])
    return of_points(points[(np.abs(points[:, :2] - [0.35, 0.9]) > [0.1, 0.3]).any(axis=1)], **options)


def crack(height: float, length: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the argument ``separates`` of `Body` for a straight cut at x2 = `height`, from the left edge or face to x1 = `length`.

    The argument is a function that takes the two ends of bonds, each of shape (k, d), and returns a mask of the bonds that the cut crosses.
    """

    def separates(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        crosses = (start[:, 1] - height) * (end[:, 1] - height) < 0
        share = (height - start[:, 1]) / np.where(crosses, end[:, 1] - start[:, 1], 1.0)
        return crosses & (start[:, 0] + share * (end[:, 0] - start[:, 0]) < length)

    return separates


def inner_points(body: Body) -> np.ndarray:
    """Return a mask, shape (n,), of the points that lie more than half a spacing inside the bounding box of all points."""
    margin = np.minimum(body.points - body.points.min(axis=0), body.points.max(axis=0) - body.points).min(axis=1)
    return margin > 0.5 * body.spacing


def middle_point(body: Body) -> int:
    """Return the number of the point nearest to the middle of a body."""
    return int(np.linalg.norm(body.points - body.points.mean(axis=0), axis=1).argmin())
