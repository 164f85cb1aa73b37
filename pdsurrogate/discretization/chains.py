"""Boundary of a plane body from closed polygons (chains of facets) of its outline and holes,
which may cross or touch each other.
"""

import numpy as np
import scipy

from ..ranks.share import connected

ROUNDING = 1e-9
"""Distance, divided by the extent of a body, within which places coincide."""


def same_places(places: np.ndarray, tolerance: float) -> np.ndarray:
    """Return for each place (k, d) the number of the first place of its cluster.

    Two places are in one cluster if a chain of places joins them in which neighbors lie within
    `tolerance` of each other.
    """
    _, labels = connected(
        len(places), *scipy.spatial.cKDTree(places).query_pairs(tolerance, output_type="ndarray").T
    )
    _, first = np.unique(labels, return_index=True)
    return first[labels]


def boundary_of(
    chains: list[np.ndarray], tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the boundary of a body with an outline and holes: its facets, between nodes of the
    polygons and the places where they cross.

    Parameters
    ----------
    chains : list of ndarray, shape (k, 2)
        Nodes around closed polygons: the outline, then the holes.
    tolerance : float
        Distance within which places coincide.

    Returns
    -------
    nodes : ndarray, shape (k, 2)
    facets : ndarray of int, shape (f, 2)
        First and second node of each facet, with the material on the left; polygon by polygon, in
        order around each.
    chain : ndarray of int, shape (f,)
        Number of the polygon on which each facet lies; the least if it lies on several.
    """
    import shapely  # here, because few bodies need it

    body, *holes = (
        shapely.make_valid(shapely.polygons(nodes), method="structure", keep_collapsed=False)
        for nodes in chains
    )
    for hole in holes:
        # Sides that run along each other receive the same nodes, so that no slivers are left
        # between them.
        body = shapely.snap(body, hole, tolerance)
        body = body.difference(shapely.snap(hole, body, tolerance))
    rings = shapely.get_rings(shapely.orient_polygons(shapely.get_parts(body)))
    places, ring = shapely.get_coordinates(rings, return_index=True)
    goes_on = np.flatnonzero(ring[:-1] == ring[1:])
    middles = shapely.points((places[goes_on] + places[goes_on + 1]) / 2)
    number = same_places(places, 4 * tolerance)
    sides = np.concatenate(
        [np.stack([nodes, np.roll(nodes, -1, axis=0)], axis=1) for nodes in chains]
    )
    sides = shapely.linestrings(sides)
    chain = np.repeat(np.arange(len(chains)), [len(nodes) for nodes in chains])
    facet, side = shapely.STRtree(sides).query(middles, predicate="dwithin", distance=2 * tolerance)
    facet, first = np.unique(facet, return_index=True)
    side = np.minimum.reduceat(side, first)
    order = np.lexsort((shapely.line_locate_point(sides[side], middles[facet]), side))
    facets = np.stack([number[goes_on], number[goes_on + 1]], axis=1)[facet[order]]
    kept = facets[:, 0] != facets[:, 1]
    return places, facets[kept], chain[side[order]][kept]
