"""Boundary of the body of a scene.

In the plane the outline and the holes become closed chains of facets, see `chains`; in three
dimensions closed surfaces, see `solid_surfaces`.
"""

from collections.abc import Sequence

import numpy as np
import scipy

from ..body import Body, Faces, Following, ReflectionPlane, Surface
from ..body.local_fit import boundary_rows, empty_rows
from ..body.surface import IN_PLANE
from ..scenes import Mesh, Scene
from .chains import ROUNDING, boundary_of
from .cuts import Cuts
from .meshes import boundary_of_mesh, mesh_of, named_edges, triangles_of
from .separation import cuts_of
from .solid_surfaces import boundary_of_solids

EDGE = 0.8
"""Cosine of the angle between normals of facets in three dimensions above which the facets belong
to one side, without an edge between. Chosen: 37 degrees are more than between neighboring facets of
a round surface, and less than at the edges of a box.
"""


PARTED = 16.0
"""Distance along a cut of the nodes of its faces from the ends of its straight parts, in their
distance from the cut: parts that meet at an angle of 4 degrees and more have their nodes between
them.
"""


def surface_of(scene: Scene, body: Body, lower: np.ndarray, upper: np.ndarray) -> Surface:
    """Return the boundary of the body of a scene as facets, with their names and the map from
    points to nodes.

    Straight sides have facets about a cell long and nodes at their ends; on a rectangle nodes lie
    on the boundaries between cells.  Circles and ellipses have facets of about half a cell or
    shorter, see `pdsurrogate.scenes.Circle.boundary`.  In 3D facets are triangles of about a cell,
    on spheres of half a cell, see `boundary_of_solids`.  A mesh has the sides of its cells,
    quadrilaterals as four triangles about their middle.

    Parameters
    ----------
    scene : Scene
    body : Body
        Its points, as discretized.
    lower, upper : ndarray, shape (d,)
        Corners of its bounding box.

    Raises
    ------
    ValueError
        If holes in three dimensions meet each other or the outline in a way that
        `boundary_of_solids` does not support.
    """
    extent = float((upper - lower).max())
    groups = {}
    symmetric = [plane for plane in body.planes if plane.symmetric]
    if isinstance(scene.body, Mesh):
        nodes = mesh_of(scene.body).cells.nodes
        facets, parts, groups = boundary_of_mesh(scene, lower, upper)
        if scene.dimension == 3:
            nodes, facets, face = triangles_of(nodes, facets)
            parts = parts[face]
            groups = {name: np.flatnonzero(np.isin(face, own)) for name, own in groups.items()}
    elif scene.dimension == 3:
        nodes, facets, parts = boundary_of_solids(scene, body.cell, lower, upper, symmetric)
    else:
        nodes, facets, chain = boundary_of(
            [shape.boundary(body.cell) for shape in (scene.body, *scene.holes)], ROUNDING * extent
        )
        parts = np.where(chain == 0, "outline", np.char.add("holes.", (chain - 1).astype(str)))
    used, facets = np.unique(facets, return_inverse=True)
    nodes = nodes[used]
    facets = facets.reshape(-1, scene.dimension)
    parts = named_edges(parts, nodes[facets], lower, upper, ROUNDING)
    normals = _normals_at(*_continued(symmetric, nodes, facets))[: len(nodes)]
    if not scene.precuts:
        return Surface(nodes, facets, parts, boundary_rows(body, nodes, normals), groups)
    cuts = cuts_of(scene, lower, upper, between=True, planes=body.planes)
    follow = _with_mouths(body, cuts, nodes, facets, normals)
    faces = _faces_of(body, cuts, nodes, facets, symmetric)
    return Surface(nodes, facets, parts, follow, groups, faces=faces)


def _with_mouths(
    body: Body, cuts: Cuts, nodes: np.ndarray, facets: np.ndarray, normals: np.ndarray
) -> Following:
    """Return the map to the nodes of a boundary; a node at the mouth of a cut follows the mean
    of the parts that its facets belong to.
    """
    facet, corner = np.nonzero(cuts.on(nodes)[facets])
    node = facets[facet, corner]
    count = len(nodes)
    ways = nodes[facets[facet]].mean(axis=1) - nodes[node]
    places = nodes[node] + cuts.beside * ways / np.linalg.norm(ways, axis=1)[:, None]
    follow = boundary_rows(
        body, np.concatenate([nodes, places]), np.concatenate([normals, normals[node]])
    )
    told = ~empty_rows(follow.rows)
    at_mouths = ~np.isin(np.arange(count), node) & told[:count]
    told = told[count:]
    whole = np.flatnonzero(at_mouths)
    shares = np.concatenate(
        [np.ones(len(whole)), told / np.maximum(np.bincount(node, told, count), 1)[node]]
    )
    where = np.concatenate([whole, node]), np.concatenate([whole, count + np.arange(len(node))])
    means = scipy.sparse.csr_array((shares, where), shape=(count, count + len(node)))
    means.eliminate_zeros()
    return follow.changed(lambda rows: (means @ rows).tocsr())


def _faces_of(
    body: Body,
    cuts: Cuts,
    nodes: np.ndarray,
    facets: np.ndarray,
    symmetric: Sequence[ReflectionPlane],
) -> Faces | None:
    """Return the two faces of each cut of a body with a boundary of `facets` between `nodes`.

    Places lie a little beside the cut, so that they follow the points on their side. In the plane
    they are the nodes of a chain on each straight part, which ends a little before the places where
    parts meet; in space the centroids of facets about as large as a cell.
    """
    places = [np.zeros((0, body.dimension))]
    areas = [np.zeros((0, body.dimension))]
    d = body.dimension
    for side in (1, -1):
        if d == 3:
            for centers, vectors in cuts.flat_parts(side, body.cell, nodes, facets, symmetric):
                places.append(centers)
                areas.append(vectors)
            continue
        for part in cuts.straight_parts(nodes[facets]):
            start, last, end = _through_plane(symmetric, *part, ROUNDING * body.extent)
            length = np.linalg.norm(end - start)
            along = (end - start) / length
            normal = np.array([-along[1], along[0]])
            count = max(1, round(float(np.linalg.norm((end - start) / body.cell))))
            inset = PARTED * cuts.beside * along
            chain = np.linspace(start, end, count + 1)
            chain[[0, -1]] += np.stack([inset, -inset])
            shares = np.ones((count + 1, 1))
            shares[[0, -1]] = 0.5
            # A place in a plane of symmetry stands for its half on this side.
            beyond = (chain - last) @ along
            shares[np.abs(beyond) <= cuts.beside] = 0.5
            own = beyond <= cuts.beside
            places.append(chain[own] + side * cuts.beside * normal)
            areas.append(-side * length / count * shares[own] * normal)
    places = np.concatenate(places)
    areas = np.concatenate(areas)
    # The other face of a cut in a plane of symmetry is the image of the one on this side.
    here = np.ones(len(places), dtype=bool)
    for plane in symmetric:
        here &= plane.mirrored(places)[1] > -cuts.beside / 2
    places = places[here]
    areas = areas[here]
    if not len(places):
        return None
    normals = areas / np.linalg.norm(areas, axis=1, keepdims=True)
    return Faces(places, areas, boundary_rows(body, places, normals[:, None]))


def _through_plane(
    symmetric: Sequence[ReflectionPlane], start: np.ndarray, end: np.ndarray, rounding: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the two ends of a straight cut, and the second one again or, if the cut meets a plane
    of symmetry there at a right angle, the mirror image of the first.
    """
    for plane in symmetric:
        for one, other in ((start, end), (end, start)):
            foot = plane.mirrored(one[None])[0][0]
            if np.linalg.norm(foot - other) <= rounding:
                return one, other, 2 * other - one
    return start, end, end


def _continued(
    symmetric: Sequence[ReflectionPlane], nodes: np.ndarray, facets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes and facets of a boundary continued by its mirror images in planes of
    symmetry, without the facets in these planes; images of nodes come last.
    """
    for plane in symmetric:
        within = np.abs(plane.mirrored(nodes)[1]) <= IN_PLANE * np.ptp(nodes, axis=0).max()
        facets = facets[~within[facets].all(axis=1)]
        beside = facets[within[facets].any(axis=1)]
        images = np.where(within, np.arange(len(nodes)), len(nodes) + np.arange(len(nodes)))
        nodes = np.concatenate([nodes, 2 * plane.mirrored(nodes)[0] - nodes])
        facets = np.concatenate([facets, images[beside][:, ::-1]])
    return nodes, facets


def _normals_at(nodes: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Return, for each node, unit normals of the flat or smooth parts of the boundary that meet at
    the node, shape (k, d, d).

    In the plane they are the normals of the facets before and after the node. In three dimensions
    the surrounding facets form at most three groups of similar normals (see `EDGE`); the normals
    are the means over the groups, and rows without a group are NaN.
    """
    if nodes.shape[1] == 3:
        return _normals_of_sides(nodes, facets)
    along = nodes[facets[:, 1]] - nodes[facets[:, 0]]
    along /= np.linalg.norm(along, axis=1)[:, None]
    normals = np.full((len(nodes), 2, 2), np.nan)
    normals[facets[:, 1], 0] = normals[facets[:, 0], 1] = np.stack(
        [along[:, 1], -along[:, 0]], axis=1
    )
    return normals


def _normals_of_sides(nodes: np.ndarray, facets: np.ndarray) -> np.ndarray:
    corners = nodes[facets]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    node = facets.ravel()
    areas = np.repeat(areas, 3, axis=0)
    size = np.linalg.norm(areas, axis=1)
    normals = areas / size[:, None]
    chosen = np.full((len(nodes), 3, 3), np.nan)

    def alike() -> np.ndarray:
        """Return the cosines of angles to the normals chosen at the same node."""
        return np.nan_to_num(np.einsum("fi,fki->fk", normals, chosen[node]), nan=-1.0)

    for number in range(3):
        left = np.flatnonzero(alike().max(axis=1) <= EDGE)
        left = left[np.lexsort((-size[left], node[left]))]
        # the largest of the facets of another side
        first = left[np.unique(node[left], return_index=True)[1]]
        chosen[node[first], number] = normals[first]
    side = alike().argmax(axis=1)
    means = np.zeros_like(chosen)
    np.add.at(means, (node, side), areas)
    with np.errstate(invalid="ignore"):
        return means / np.linalg.norm(means, axis=2, keepdims=True)
