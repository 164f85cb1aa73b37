"""Cells around the points of a cloud, which lie on no lattice: Voronoi polygons in the plane,
cubes in three dimensions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from .cell_mesh import CORNERS, CellMesh

if TYPE_CHECKING:
    import shapely

FAR = 10.0
"""Distance, in sizes of the body, of four points around it that bound the outermost cells before
the outline cuts them.
"""

ONE_PLACE = 1e-6
"""Distance, in mean distances of points, within which corners of neighboring cells are one node:
above the rounding with which two cells meet the outline, and far below the side of a cell that one
could see.
"""


def voronoi_cells(
    outline: shapely.Geometry, points: np.ndarray, _volumes: np.ndarray | None = None
) -> CellMesh:
    """Return the cells of points in the plane, of the places nearest to each, cut at the outline of
    the body.

    All cells have as many corners as the cell with the most; others repeat their last one. Of a
    cell that the outline cuts into pieces, the piece with or nearest to the point remains.
    """
    import shapely  # here, because few bodies need it

    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    size = np.ptp(points, axis=0).max() + 1e-300
    # About the middle, since Qhull has squares of coordinates.
    around = scipy.spatial.Voronoi(
        np.concatenate([points - middle, FAR * size * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])])
    )
    regions = [around.regions[number] for number in around.point_region[: len(points)]]
    cells = shapely.polygons(
        [shapely.linearrings(middle + around.vertices[region]) for region in regions]
    )
    shapely.prepare(outline)
    cut = np.flatnonzero(~shapely.contains_properly(outline, cells))
    pieces, owner = shapely.get_parts(shapely.intersection(cells[cut], outline), return_index=True)
    away = shapely.distance(pieces, shapely.points(points[cut[owner]]))
    away[shapely.get_dimensions(pieces) < 2] = np.inf
    for piece in np.lexsort((-away, owner)):  # the nearest comes last
        cells[cut[owner[piece]]] = pieces[piece]
    rings = (
        shapely.orient_polygons(cells)
        if hasattr(shapely, "orient_polygons")
        else shapely.normalize(cells)
    )
    rings = shapely.get_exterior_ring(rings)
    counts = shapely.get_num_coordinates(rings) - 1
    places, ring = shapely.get_coordinates(rings, return_index=True)
    last = np.append(ring[1:] != ring[:-1], True)
    places = places[~last]
    ring = ring[~last]
    scale = ONE_PLACE * np.sqrt(shapely.area(outline) / len(points))
    _, first, number = np.unique(
        np.rint(places / scale).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    begins = np.cumsum(counts) - counts
    corner = begins[:, None] + np.minimum(np.arange(counts.max()), counts[:, None] - 1)
    return CellMesh(places[first], (number.ravel()[corner].astype(np.int32),))


def cubes(points: np.ndarray, volumes: np.ndarray) -> CellMesh:
    """Return a cube around each point of a cloud in three dimensions, of the point's volume;
    cubes share no nodes, and may overlap.
    """
    nodes = points[:, None] + (CORNERS[3] - 0.5) * np.cbrt(volumes)[:, None, None]
    return CellMesh(
        nodes.reshape(-1, 3), (np.arange(8 * len(points), dtype=np.int32).reshape(-1, 8),)
    )
