"""Small bodies for tests and hard cases in two and three dimensions: regular, jittered, with holes, notches and reflection planes."""

from collections.abc import Callable
from itertools import permutations

import numpy as np

from ..body import Body, ReflectionPlane, grid

SPACING = 0.1
"""Spacing of the small bodies; every figure is dimensionless."""

HORIZONS = {2: 3.15, 3: 1.75}
"""Horizons in spacings, by dimension: the paper's in the plane, and 26 bonds to a point in three dimensions."""


def lattice(*sides: float) -> np.ndarray:
    """Return cell-centred points 0.1 apart in a box at the origin, x1 fastest."""
    return grid((0,) * len(sides), sides, SPACING)


def of_points(points: np.ndarray, ratio: float | None = None, **options) -> Body:
    """Return a body of points 0.1 apart; the horizon is 3.15 spacings in the plane and 1.75 in three dimensions unless given."""
    dimension = points.shape[1]
    return Body(points, np.full(len(points), SPACING**dimension), (ratio or HORIZONS[dimension]) * SPACING, SPACING, **options)


def regular(dimension: int, cells: int | tuple[int, ...], ratio: float | None = None, **options) -> Body:
    """Return a square or cube with `cells` points a side, or a box with a number of points along each axis."""
    cells = (cells,) * dimension if isinstance(cells, int) else cells
    return of_points(lattice(*(count * SPACING for count in cells)), ratio, **options)


def sheet(spacing=SPACING, width=1.2, height=1.0, **options) -> Body:
    """Return a rectangle with a horizon of 3.15 spacings."""
    return Body.rectangle(width, height, spacing, HORIZONS[2] * spacing, **options)


def plain(dimension: int, width=1.2, **options) -> Body:
    """Return a `sheet`, or a block that is 0.4 thick, by dimension."""
    return of_points(lattice(*(width, 1.0, 0.4)[:dimension]), **options)


def gripped(dimension=2, parity=(-1, 1, 1)) -> Body:
    """Return a `plain` body that images continue beyond its left and right edges or faces."""
    ends = ((0.0, -1), (1.2, 1))
    return plain(dimension, planes=tuple(ReflectionPlane(0, place, side, parity[:dimension]) for place, side in ends))


def of_simplices(random: np.random.Generator, dimension: int, cells: int, amount=0.2) -> Body:
    """Return a square or cube of triangles or tetrahedra with a point in the middle of each, as from a mesh file.

    Every square is cut in two, every cube in six, along the paths over its edges from one corner to the opposite one. The interior corners
    are moved by up to `amount` of the side of a square, so that no two cells are alike.
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
    """Return a rectangle or block whose points are moved by up to `amount` spacings."""
    points = lattice(*(1.2, 1.0, 0.4)[:dimension])
    return of_points(points + amount * 0.1 * random.uniform(-1, 1, points.shape), **options)


def disc_with_hole(dimension=2, **options) -> Body:
    """Return a disc with a hole, or a tube: no straight edge, incomplete horizons of every kind."""
    points = lattice(*(2.0, 2.0, 0.4)[:dimension])
    radius = np.linalg.norm(points[:, :2] - 1, axis=1)
    return of_points((points - 1)[(radius < 0.95) & (radius > 0.3)], **options)


def notched(dimension=2, **options) -> Body:
    """Return a body of some 80 points, or 250 in three dimensions, without symmetry, with edges and a notch."""
    points = lattice(*(1.0, 0.9, 0.3)[:dimension])
    return of_points(points[(np.abs(points[:, :2] - [0.35, 0.9]) > [0.1, 0.3]).any(axis=1)], **options)


def crack(height: float, length: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the function ``separates`` of a `Body` that is cut from its left edge or face at a height."""

    def separates(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        crosses = (start[:, 1] - height) * (end[:, 1] - height) < 0
        share = (height - start[:, 1]) / np.where(crosses, end[:, 1] - start[:, 1], 1.0)
        return crosses & (start[:, 0] + share * (end[:, 0] - start[:, 0]) < length)

    return separates


def inner_points(body: Body) -> np.ndarray:
    """Return which points are not the outermost ones along any axis."""
    margin = np.minimum(body.points - body.points.min(axis=0), body.points.max(axis=0) - body.points).min(axis=1)
    return margin > 0.5 * body.spacing


def middle_point(body: Body) -> int:
    """Return the point nearest to the middle of a body."""
    return int(np.linalg.norm(body.points - body.points.mean(axis=0), axis=1).argmin())
