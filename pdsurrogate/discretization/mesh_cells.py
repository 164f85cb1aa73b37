"""Geometry of the cells of meshes: volumes, centroids and sizes, and cells that have none."""

from __future__ import annotations

import math

import numpy as np

from ..body.cell_mesh import FACES

CELL_TYPES = {2: ("triangle", "quad"), 3: ("tetra", "hexahedron")}
"""Accepted types of cells by dimension, by their names in meshio; names of quadratic cells end
with their number of nodes.
"""

EDGES = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": (
        (0, 1),
        (1, 2),
        (2, 3),
        (3, 0),
        (4, 5),
        (5, 6),
        (6, 7),
        (7, 4),
        (0, 4),
        (1, 5),
        (2, 6),
        (3, 7),
    ),
}
"""Edges of a cell by the numbers of their corners, in the order in which the middles of edges
follow the corners in a quadratic cell.
"""

QUADRATIC = ("triangle6", "triangle7", "quad8", "quad9", "tetra10", "hexahedron20", "hexahedron27")
"""Quadratic cells by their names in meshio, which become cells with the same corners and
straight edges.
"""

SHAPES = {(2, 3): "triangle", (2, 4): "quad", (3, 4): "tetra", (3, 8): "hexahedron"}
"""Cells by dimension and number of corners."""

PARTS = {(2, 3): 2, (3, 4): 6}
"""Number of cells that make up a square or cube, by dimension and number of corners of a cell."""

BESIDE_CORNERS = {
    4: [[1, 2, 3]],
    8: [[1, 3, 4], [2, 0, 5], [3, 1, 6], [0, 2, 7], [7, 5, 0], [4, 6, 1], [5, 7, 2], [6, 4, 3]],
}
"""Corners to which the three edges at each corner of a solid cell lead, in right-handed order, by
the cell's number of corners.

For tetrahedra only corner 0 is listed: the edges at every corner span the same volume, whose sign
tells whether the cell is inverted.
"""


def kind_of(name: str) -> str:
    """Return the type of linear cell that has the corners of cells of the type `name`; a type
    that is not read remains as it is.
    """
    return name.rstrip("0123456789") if name in QUADRATIC else name


def corners_of(kind: str) -> int:
    """Return the number of corners of a linear cell."""
    return max(map(max, EDGES[kind])) + 1


def upright(file: str, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return flags of the inverted among solid cells (n, corners, 3), and the numbers of the
    corners of such a cell in an order that makes its volume positive.

    Raise ValueError if a cell is flat, or if it is a hexahedron not convex at a corner.
    """
    beside = BESIDE_CORNERS[cells.shape[1]]
    edges = cells[:, beside] - cells[:, : len(beside), None]
    turns = np.linalg.det(edges)  # volume that the three edges at each corner span
    least = 1e-12 * np.linalg.norm(edges, axis=-1).max(axis=-1) ** 3
    inverted = (turns < -least).all(axis=1)
    wrong = np.flatnonzero(~inverted & ~(turns > least).all(axis=1))
    if len(wrong):
        kind = SHAPES[3, cells.shape[1]]
        raise ValueError(
            f"body.file: {file} has {len(wrong)} invalid cells; {kind} {wrong[0]} (counted from 0)"
            " is flat, or folded at a corner"
        )
    return inverted, np.array([1, 0, 2, 3] if len(beside) == 1 else [4, 5, 6, 7, 0, 1, 2, 3])


def simplices_of(cells: np.ndarray) -> np.ndarray:
    """Divide cells (n, corners, d) into triangles or tetrahedra; return their corners, shape (n,
    parts, d + 1, d).

    A face of a hexahedron need not be flat: it is divided into four triangles about the mean of its
    corners, alike for both its cells.
    """
    if cells.shape[1] == cells.shape[2] + 1:
        return cells[:, None]
    if cells.shape[2] == 2:
        return cells[:, [[0, 1, 2], [0, 2, 3]]]
    faces = cells[:, np.array(FACES[3, 8])]
    middles = np.broadcast_to(faces.mean(axis=2, keepdims=True), faces.shape)
    tops = np.broadcast_to(cells.mean(axis=1)[:, None, None], faces.shape)
    # Faces run counter-clockwise as seen from outside: with the middle of the cell first, volumes
    # are positive.
    return np.stack([tops, faces, np.roll(faces, -1, axis=2), middles], axis=3).reshape(
        len(cells), -1, 4, 3
    )


def volumes_of(cells: np.ndarray) -> np.ndarray:
    """Return the signed volumes (n, parts) of the simplices (`simplices_of`) of cells; in the
    plane areas, negative where clockwise.
    """
    parts = simplices_of(cells)
    return np.linalg.det(parts[:, :, 1:] - parts[:, :, :1]) / math.factorial(cells.shape[2])


def centroids(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centroids (n, d) and volumes (n,) of cells of one type, given by positions of their
    corners, shape (n, corners, d).

    Raise ValueError for a cell without volume, or a quadrilateral whose sides cross.
    """
    volumes = volumes_of(cells)
    volume = volumes.sum(axis=1)
    if (volume == 0).any():
        raise ValueError("body.file: the area of a cell is zero")
    # The sides of a quadrilateral cross if either diagonal cuts it into triangles of opposite
    # senses.
    if (
        cells.shape[1:] == (4, 2)
        and (
            (volumes.prod(axis=1) < 0) & (volumes_of(np.roll(cells, 1, axis=1)).prod(axis=1) < 0)
        ).any()
    ):
        raise ValueError(
            "body.file: the sides of a quadrilateral cross each other; its corners must be in order"
            " around it"
        )
    return (volumes[..., None] * simplices_of(cells).mean(axis=2)).sum(axis=1) / volume[
        :, None
    ], np.abs(volume)


def sizes_of(cells: list[np.ndarray], kept: np.ndarray, volumes: np.ndarray) -> tuple[float, float]:
    """Return the spacing of a mesh, the mean size (area^(1/2) or volume^(1/3)) of a cell, and the
    side of the squares or cubes of cells.

    `cells` are the corners of the cells block by block, shape (n, corners, d), `kept` flags of the
    cells that are not in holes, and `volumes` those of all cells. Two triangles count as one
    square, six tetrahedra as one cube. Both are volume means: many small cells in a corner do not
    make the horizon small everywhere.
    """
    dimension = cells[0].shape[2]
    parts = np.repeat(
        [PARTS.get((dimension, block.shape[1]), 1) for block in cells],
        [len(block) for block in cells],
    )
    return tuple(
        float(np.average(size[kept] ** (1 / dimension), weights=volumes[kept]))
        for size in (volumes, parts * volumes)
    )
