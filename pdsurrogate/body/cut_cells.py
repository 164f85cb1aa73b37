"""Cells of a lattice that follow the outline and the holes of a body and have the volumes of its
points.
"""

from collections.abc import Callable

import numpy as np
import scipy

from .cell_mesh import CellMesh, outward

REACH = 1.6
STEP = 0.1
"""Greatest distance of a node from the boundary, and distance of the places that are tested on the
way there, in cells along each axis. A cell with half its volume or more has its nodes within 0.71
cells of the boundary in the plane, and 0.87 in three dimensions; one with the rest of its neighbor
in addition, within twice as much.
"""

BISECTIONS = 40
"""Halvings of the interval in which a boundary lies: to rounding."""

INSIDE = 1e-5
"""Distance in cells from a flat side at which its material is tested: shapes do not contain
their own boundary.
"""

ON_A_SIDE = np.array([[0.31, -0.43, 0.17, -0.22, 0.47], [-0.13, 0.29, 0.41, -0.37, -0.05]])
"""Places on a side of a cell, in its two directions, at which it is tested whether the side lies on
the boundary. They have no symmetry: a curved boundary that touches the side does so at one of them
at most.
"""

ACROSS = 0.14
LAYERS = {2: 3, 3: 1}
"""Steps of nodes on the boundary across it for the sake of volumes, where those along it and of
other nodes count 1; and by dimension how many layers of cells have nodes that move. Chosen: circles
look round, and no cell at a hole of two cells' radius or more turns over.
"""

MOST_ITERATIONS = 30
MISFIT = 1e-12
"""Greatest number of Newton iterations, and the greatest error of a volume in cells at which
they end.
"""

TETRAHEDRA = np.array([[0, 1, 3, 4], [1, 2, 3, 6], [1, 3, 4, 6], [3, 4, 6, 7], [1, 4, 5, 6]])
"""Corners of the tetrahedra into which VTK divides a hexahedron, whose volumes ParaView adds."""


def cut_cells(
    lattice: CellMesh,
    volumes: np.ndarray,
    cell: np.ndarray,
    inside: Callable[[np.ndarray], np.ndarray],
) -> CellMesh:
    """Return the cells of a lattice with their outer nodes on the boundary of the body, and with
    the volumes of its points.

    Outer nodes first move to the boundary. Then nodes near the boundary move as little as possible,
    mainly along it, until every cell has its volume, which includes the material of cells that were
    merged into it.

    Parameters
    ----------
    lattice : CellMesh
        Whole cells.
    volumes : ndarray, shape (n,)
        Volumes of the points.
    cell : ndarray, shape (d,)
        Sides of a cell.
    inside : callable
        Flags of places, shape (m, d), that lie in material.
    """
    (block,) = lattice.blocks
    nodes, held, sides = _on_boundary(lattice, cell, inside)
    if not len(sides):
        return lattice
    near = np.isin(np.arange(len(nodes)), sides)
    for _ in range(LAYERS[len(cell)]):
        near[block[near[block].any(axis=1)]] = True
    chosen = near[block].any(axis=1)
    free = near[:, None] & ~held
    block = block[chosen]
    asked = volumes[chosen]
    columns = (block[:, :, None] * len(cell) + np.arange(len(cell))).ravel()
    rows = np.arange(0, len(columns) + 1, len(columns) // len(block))
    for _ in range(MOST_ITERATIONS):
        found, slopes = _volumes(nodes[block])
        if np.abs(asked - found).max() <= MISFIT * cell.prod():
            break
        normals = _normals(nodes, sides)
        slopes = _along(slopes * free[block], normals[block])
        matrix = scipy.sparse.csr_array(
            (slopes.ravel(), columns, rows), shape=(len(block), nodes.size)
        )
        # The least change of the nodes that makes up for what is missing, in a measure in which
        # steps across the boundary are long.
        change = scipy.sparse.linalg.lsmr(matrix, asked - found, atol=1e-4, btol=1e-4)[0]
        nodes = nodes + free * _along(change.reshape(nodes.shape), normals)
    return CellMesh(nodes, (_begun_convex(nodes, lattice.blocks[0]),))


def _along(vectors: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return vectors with their components along unit normals multiplied by `ACROSS`."""
    return vectors - (1 - ACROSS) * (vectors * normals).sum(axis=-1, keepdims=True) * normals


def _on_boundary(
    lattice: CellMesh, cell: np.ndarray, inside: Callable
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the nodes of a lattice with its outer ones moved to the boundary, the components
    that flat sides hold, and the moved sides.
    """
    corners, owners = lattice.outer_sides
    nodes = lattice.nodes.copy()
    middles = nodes[corners].mean(axis=1)
    normals = np.rint(2 * (middles - nodes[lattice.blocks[0][owners]].mean(axis=1)) / cell)
    along = nodes[corners[:, 1:]] - nodes[corners[:, :-1]]
    places = middles + np.einsum("as,fad->sfd", ON_A_SIDE[: along.shape[1]], along[:, :2])
    just = INSIDE * cell * normals
    flat = sum(inside(place - just) & ~inside(place + just) for place in places) > 1
    ways = np.zeros_like(nodes)
    inward = np.zeros_like(nodes)
    held = np.zeros(nodes.shape, dtype=bool)
    for corner in corners.T:
        np.add.at(ways, corner[~flat], normals[~flat])
    for axis in range(len(cell)):
        for side in (-1, 1):
            on_it = np.isin(nodes[:, axis], nodes[corners[flat & (normals[:, axis] == side)], axis])
            held[on_it, axis], inward[on_it, axis] = True, -side * INSIDE * cell[axis]
    ways[held] = 0
    moving = np.flatnonzero(ways.any(axis=1))
    starts = nodes[moving] + inward[moving]
    ways = cell * ways[moving] / np.linalg.norm(ways[moving], axis=1)[:, None]
    shares = np.arange(-REACH, REACH, STEP) + INSIDE
    there = np.array([inside(starts + share * ways) for share in shares])
    distance = np.where(there[:-1] & ~there[1:], np.abs(shares[:-1, None] + STEP / 2), np.inf)
    found = np.isfinite(distance.min(axis=0, initial=np.inf))
    low = shares[distance.argmin(axis=0)]
    for number in range(1, BISECTIONS + 1):
        further = low + STEP / 2**number
        low = np.where(inside(starts + further[:, None] * ways), further, low)
    nodes[moving[found]] += (low[:, None] * ways)[found]
    return nodes, held, corners[~flat & np.isin(corners, moving[found]).any(axis=1)]


def _normals(nodes: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Return the mean unit normals of the sides at each node, shape (k, d); zero at nodes of no
    side.
    """
    normals = outward(nodes[sides])
    total = np.zeros_like(nodes)
    for corner in sides.T:
        np.add.at(total, corner, normals)
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]


def _volumes(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the volumes of cells (in the plane areas), given by corners (n, 4 or 8, d), and
    their derivatives by the corners.
    """
    slopes = np.zeros_like(corners)
    if corners.shape[2] == 2:
        slopes = (np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1))[:, :, ::-1] * [
            0.5,
            -0.5,
        ]
        return (corners * slopes).sum(axis=(1, 2)) / 2, slopes
    volumes = np.zeros(len(corners))
    for tetrahedron in TETRAHEDRA:
        first, second, third = (
            corners[:, tetrahedron[1:]] - corners[:, tetrahedron[:1]]
        ).transpose(1, 0, 2)
        normals = (
            np.stack(
                [np.cross(second, third), np.cross(third, first), np.cross(first, second)], axis=1
            )
            / 6
        )
        volumes += (first * normals[:, 0]).sum(axis=1)
        slopes[:, tetrahedron[1:]] += normals
        slopes[:, tetrahedron[0]] -= normals.sum(axis=1)
    return volumes, slopes


def _begun_convex(nodes: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Return cells, quadrilaterals with a concave corner as their first or third: VTK divides
    them by the diagonal between these two.
    """
    if block.shape[1] == 8:
        return block
    before, after = (nodes[np.roll(block, shift, axis=1)] - nodes[block] for shift in (1, -1))
    turns = after[:, :, 0] * before[:, :, 1] - after[:, :, 1] * before[:, :, 0]
    concave = turns[:, 1::2].min(axis=1) < turns[:, ::2].min(axis=1)
    return np.where(concave[:, None], np.roll(block, 1, axis=1), block)
