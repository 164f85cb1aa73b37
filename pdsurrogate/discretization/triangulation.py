"""Triangles of quadrilaterals and of flat faces with holes."""

from collections.abc import Sequence

import numpy as np
import scipy

from ..body import Surface
from ..body.cell_mesh import among
from ..body.surface import IN_PLANE
from ..kernels.polygons import encloses
from .cells import lattice_of
from .chains import ROUNDING, same_places

AWAY = 0.6
"""Distance, in cells, from the boundary of a section within which a cap has no nodes other than
those on the boundary. Chosen: the nodes within are a cell apart; a smaller distance makes flat
triangles at the boundary, a greater one long ones.
"""

ON_CIRCLE = 1e-6
"""Distance, in cells, of the middles of two circles that count as one; far above rounding."""

MOST_ROUNDS = 20
"""Maximum number of times that sides of a section are halved until they are sides of its
triangles; three do except at acute corners.
"""


def quarters(quadrilaterals: np.ndarray) -> np.ndarray:
    """Divide each quadrilateral (q, 4, d) into four triangles about the mean of its corners;
    return the triangles, shape (4 q, 3, d).
    """
    middles = np.broadcast_to(quadrilaterals.mean(axis=1, keepdims=True), quadrilaterals.shape)
    triangles = np.stack([quadrilaterals, np.roll(quadrilaterals, -1, axis=1), middles], axis=2)
    return triangles.reshape(-1, *triangles.shape[2:])


def tiles_of(nodes: np.ndarray) -> np.ndarray:
    """Divide a rectangle into the tiles between nodes on its edges, and each tile into four
    triangles; return them, shape (t, 3, 2).
    """
    low = nodes.min(axis=0)
    on_edges = nodes - low <= ROUNDING * np.ptp(nodes, axis=0).max()
    x1, x2 = (np.unique(nodes[on_edges[:, 1 - axis], axis]) for axis in (0, 1))
    corners = np.stack(np.meshgrid(x1, x2, indexing="ij"), axis=-1)
    tiles = np.stack(
        [corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]], axis=2
    )
    return quarters(tiles.reshape(-1, 4, 2))


def triangulated(
    nodes: np.ndarray,
    sides: np.ndarray,
    chain: np.ndarray,
    cell: np.ndarray,
    levels: Sequence[float | None] = (None, None),
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Divide the area within closed polygons (chains of sides) into triangles about a cell long.

    They are the Delaunay triangles of the nodes of the polygons and of a lattice within, polygons
    on one circle divided about their middles; sides of polygons that are sides of no triangle are
    halved. `levels` are the coordinates of planes of symmetry normal to the two axes: a part at
    such planes has the triangles of the whole, and sides in the planes have the nodes for it.

    Returns
    -------
    nodes, sides, chain
        Nodes of the polygons, sides and the number of the polygon of each side, with halved sides
        and new numbers of nodes.
    triangles : ndarray, shape (t, 3, 2)
        Positions of the corners, counter-clockwise.
    """
    used, sides = np.unique(sides, return_inverse=True)
    lower = nodes[used].min(axis=0)
    upper = nodes[used].max(axis=0)
    # Areas and Delaunay's criterion have products of coordinates, which far from the origin are
    # rounded.
    middle = np.array(
        [
            own if level is None else level
            for own, level in zip((lower + upper) / 2, levels, strict=True)
        ]
    )
    nodes = (nodes[used] - middle) / cell
    sides = sides.reshape(-1, 2)
    low = np.floor((lower - middle) / cell)
    high = np.ceil((upper - middle) / cell)
    lattice = lattice_of(*map(np.arange, low, high + 1))
    free = np.ones(len(sides), dtype=bool)
    for axis, level in enumerate(levels):
        if level is not None:
            free &= (np.abs(nodes[sides][..., axis]) > IN_PLANE).any(axis=1)
    lattice = lattice[
        ~np.isfinite(Surface(nodes, sides[free], np.array([]), None).distances(lattice, AWAY))
    ]
    within = encloses(lattice, *nodes[sides].transpose(1, 0, 2))
    for axis, level in enumerate(levels):
        if level is not None:
            nodes, sides, chain = _with_nodes(
                nodes, sides, chain, lattice[lattice[:, axis] == 0], axis
            )
            within &= lattice[:, axis] != 0
    lattice = lattice[within]
    for _ in range(MOST_ROUNDS):
        places = np.concatenate([nodes, lattice])
        found = scipy.spatial.Delaunay(places).simplices
        edges = np.concatenate([found[:, [0, 1]], found[:, [1, 2]], found[:, [2, 0]]])
        missing = np.flatnonzero(~among(sides, edges))
        if not len(missing):
            break
        middles = len(nodes) + np.arange(len(missing))
        nodes = np.concatenate([nodes, nodes[sides[missing]].mean(axis=1)])
        sides = np.concatenate([sides, np.stack([middles, sides[missing, 1]], axis=1)])
        sides[missing, 1] = middles
        chain = np.concatenate([chain, chain[missing]])
    first, second = nodes[sides].transpose(1, 0, 2)
    found = found[encloses(places[found].mean(axis=1), first, second)]
    corners = places[found]
    areas = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 2
    found[areas < 0] = found[areas < 0][:, ::-1]
    area = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum() / 2
    if len(missing) or abs(np.abs(areas).sum() - area) > 1e-9 * area:
        raise ValueError(
            "body: its cross-section has corners that are too sharp for a triangulation, so loads"
            " and probes are not possible"
        )
    triangles = _about_middles(places, found[np.abs(areas) > 1e-12])
    return middle + nodes * cell, sides, chain, middle + triangles * cell


def _about_middles(places: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return Delaunay triangles (t, 3) of places, those on a common circle replaced by triangles
    about its middle, shape (s, 3, 2): which of them there are would depend on rounding.
    """
    sides = places[triangles[:, 1:]] - places[triangles[:, :1]]
    centers = np.linalg.solve(2 * sides, (sides**2).sum(axis=2)[:, :, None])[:, :, 0]
    circle = same_places(centers + places[triangles[:, 0]], ON_CIRCLE)
    several = np.bincount(circle, minlength=len(triangles))[circle] > 1
    starts, ends = np.concatenate(
        [triangles[several][:, pair] for pair in ((0, 1), (1, 2), (2, 0))]
    ).T
    circle = np.tile(circle[several], 3)
    count = len(places)
    outer = ~np.isin(
        (circle * count + starts) * count + ends, (circle * count + ends) * count + starts
    )
    starts = starts[outer]
    ends = ends[outer]
    circle = circle[outer]
    sums = np.stack([np.bincount(circle, column) for column in places[starts].T], axis=1)
    middles = sums[circle] / np.bincount(circle)[circle, None]
    fans = np.stack([places[starts], places[ends], middles], axis=1)
    return np.concatenate([places[triangles[~several]], fans])


def _with_nodes(
    nodes: np.ndarray, sides: np.ndarray, chain: np.ndarray, between: np.ndarray, axis: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return polygons as for `triangulated`, with the nodes `between` in the place of those
    between the ends of straight lines of sides on which the coordinate `axis` is 0.
    """
    there = (np.abs(nodes[sides][..., axis]) <= IN_PLANE).all(axis=1)
    starts, ends = (
        np.setdiff1d(one, other) for one, other in (sides[there].T, sides[there].T[::-1])
    )
    lines = zip(*(each[nodes[each, 1 - axis].argsort()] for each in (starts, ends)), strict=True)
    parts = [sides[~there]]
    chains = [chain[~there]]
    for start, end in lines:
        low, high = sorted(nodes[[start, end], 1 - axis])
        own = between[(between[:, 1 - axis] > low) & (between[:, 1 - axis] < high)]
        own = own[np.argsort(own[:, 1 - axis])][:: 1 if nodes[start, 1 - axis] == low else -1]
        line = np.concatenate([[start], len(nodes) + np.arange(len(own)), [end]])
        nodes = np.concatenate([nodes, own])
        parts.append(np.stack([line[:-1], line[1:]], axis=1))
        chains.append(np.full(len(line) - 1, chain[there & (sides[:, 0] == start)][0]))
    used, sides = np.unique(np.concatenate(parts), return_inverse=True)
    return nodes[used], sides.reshape(-1, 2), np.concatenate(chains)
