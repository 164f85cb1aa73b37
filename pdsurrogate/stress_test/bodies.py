"""Small bodies for tests and hard cases in two and three dimensions: regular, jittered, with holes, notches and reflection planes."""

from collections.abc import Callable
from itertools import permutations

import numpy as np

from ..body import Body, ReflectionPlane, grid
from ..scenes.model import USUAL

SPACING = 0.1
"""Spacing of the small bodies; every figure is dimensionless."""

HORIZONS = USUAL["horizon_ratio"]
"""Horizons in spacings, by dimension: the paper's in the plane, and 26 bonds to a point in three dimensions."""


def lattice(*sides: float) -> np.ndarray:
    """Return cell-centred points 0.1 apart, shape (n, d), in a box with one corner at the origin and given sides; x1 varies fastest."""
    return grid((0,) * len(sides), sides, SPACING)


def of_points(points: np.ndarray, ratio: float | None = None, **options) -> Body:
    """Return a body of points 0.1 apart; the horizon is `ratio` spacings, by default 3.15 in the plane and 1.75 in three dimensions."""
    dimension = points.shape[1]
    return Body(points, np.full(len(points), SPACING**dimension), (ratio or HORIZONS[dimension]) * SPACING, SPACING, **options)


def regular(dimension: int, cells: int | tuple[int, ...], ratio: float | None = None, **options) -> Body:
    """Return a square or cube with `cells` points a side, or a box with a number of points along each axis."""
    cells = (cells,) * dimension if isinstance(cells, int) else cells
    return of_points(lattice(*(count * SPACING for count in cells)), ratio, **options)


def sheet(spacing=SPACING, width=1.2, height=1.0, **options) -> Body:
    """Return a rectangular body in the plane with a horizon of 3.15 spacings."""
    return Body.rectangle(width, height, spacing, HORIZONS[2] * spacing, **options)


def plain(dimension: int, width=1.2, **options) -> Body:
    """Return a regular body: a rectangle 1 high in the plane, or a block 1 high and 0.4 thick in three dimensions."""
    return of_points(lattice(*(width, 1.0, 0.4)[:dimension]), **options)


def gripped(dimension=2, parity=(-1, 1, 1)) -> Body:
    """Return a `plain` body with a reflection plane at its left and at its right edge or face, beyond which ghosts continue it."""
    ends = ((0.0, -1), (1.2, 1))
    return plain(dimension, planes=tuple(ReflectionPlane(0, place, side, parity[:dimension]) for place, side in ends))


def of_simplices(random: np.random.Generator, dimension: int, cells: int, amount=0.2) -> Body:
    """Return a square or cube of triangles or tetrahedra with a point in the middle of each, as from a mesh file.

    Every square is cut into two triangles, every cube into six tetrahedra, along the paths over its edges from one corner to the opposite
    corner. Interior corners are moved by up to `amount` of the side of a square, so that no two cells are alike.
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
    """Return a rectangle or block whose points are moved at random by up to `amount` spacings along each axis."""
    points = lattice(*(1.2, 1.0, 0.4)[:dimension])
    return of_points(points + amount * 0.1 * random.uniform(-1, 1, points.shape), **options)


def disc_with_hole(dimension=2, **options) -> Body:
    """Return a disc with a hole, or in three dimensions a tube; neither has a straight outline, so horizons are cut in many ways."""
    points = lattice(*(2.0, 2.0, 0.4)[:dimension])
    radius = np.linalg.norm(points[:, :2] - 1, axis=1)
    return of_points((points - 1)[(radius < 0.95) & (radius > 0.3)], **options)


def notched(dimension=2, **options) -> Body:
    """Return a body of some 80 points, or 250 in three dimensions, without symmetry, with edges and a notch."""
    points = lattice(*(1.0, 0.9, 0.3)[:dimension])
    return of_points(points[(np.abs(points[:, :2] - [0.35, 0.9]) > [0.1, 0.3]).any(axis=1)], **options)


def crack(height: float, length: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the argument ``separates`` of `Body` for a straight cut at a height x2 from the left edge or face to x1 = `length`."""

    def separates(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        crosses = (start[:, 1] - height) * (end[:, 1] - height) < 0
        share = (height - start[:, 1]) / np.where(crosses, end[:, 1] - start[:, 1], 1.0)
        return crosses & (start[:, 0] + share * (end[:, 0] - start[:, 0]) < length)

    return separates


def inner_points(body: Body) -> np.ndarray:
    """Return a mask of the points that are not among the outermost points along any axis, shape (n,)."""
    margin = np.minimum(body.points - body.points.min(axis=0), body.points.max(axis=0) - body.points).min(axis=1)
    return margin > 0.5 * body.spacing


def middle_point(body: Body) -> int:
    """Return the number of the point nearest to the middle of a body."""
    return int(np.linalg.norm(body.points - body.points.mean(axis=0), axis=1).argmin())
