"""Boundary of the body of a scene.

In the plane the outline and the holes become closed chains of facets, see `chains`; in three
dimensions closed surfaces, see `solid_surfaces`.
"""

import numpy as np
import scipy

from ..body import Body, Faces, Following, Surface
from ..body.cell_mesh import side_numbers
from ..body.local_fit import boundary_rows, empty_rows
from ..body.surface import IN_PLANE
from ..ranks.share import connected
from ..scenes import Mesh, Scene
from ..scenes.model import EDGES
from ..scenes.regions import edge_names
from .chains import ROUNDING, boundary_of
from .cuts import Cuts
from .meshes import mesh_of
from .points import cuts_of
from .solid_surfaces import boundary_of_solids, quarters

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
    extent, groups = float((upper - lower).max()), {}
    symmetric = [plane for plane in body.planes if plane.symmetric]
    if isinstance(scene.body, Mesh):
        nodes, facets, parts, groups = _of_mesh(scene)
    elif scene.dimension == 3:
        nodes, facets, parts = boundary_of_solids(scene, body.cell, lower, upper, symmetric)
    else:
        nodes, facets, chain = boundary_of(
            [shape.boundary(body.cell) for shape in (scene.body, *scene.holes)], ROUNDING * extent
        )
        parts = np.where(chain == 0, "outline", np.char.add("holes.", (chain - 1).astype(str)))
    used, facets = np.unique(facets, return_inverse=True)
    nodes, facets = nodes[used], facets.reshape(-1, scene.dimension)
    for edge in edge_names(scene.dimension):
        axis, side = EDGES[edge]
        there = (
            np.abs(nodes[facets][..., axis] - (lower, upper)[side > 0][axis]) <= ROUNDING * extent
        )
        parts = np.where(there.all(axis=1) & (parts == "outline"), edge, parts)
    normals = _normals_at(*_continued(body, nodes, facets))[: len(nodes)]
    if not scene.precuts:
        return Surface(nodes, facets, parts, boundary_rows(body, nodes, normals), groups)
    cuts = cuts_of(scene, lower, upper, between=True)
    follow = _with_mouths(body, cuts, nodes, facets, normals)
    return Surface(nodes, facets, parts, follow, groups, faces=_faces_of(body, cuts, nodes, facets))


def _with_mouths(
    body: Body, cuts: Cuts, nodes: np.ndarray, facets: np.ndarray, normals: np.ndarray
) -> Following:
    """Return the map to the nodes of a boundary; a node at the mouth of a cut follows the mean
    of the parts that its facets belong to.
    """
    facet, corner = np.nonzero(cuts.on(nodes)[facets])
    node, count = facets[facet, corner], len(nodes)
    ways = nodes[facets[facet]].mean(axis=1) - nodes[node]
    places = nodes[node] + cuts.beside * ways / np.linalg.norm(ways, axis=1)[:, None]
    follow = boundary_rows(
        body, np.concatenate([nodes, places]), np.concatenate([normals, normals[node]])
    )
    told = ~empty_rows(follow.rows)
    at_mouths, told = ~np.isin(np.arange(count), node) & told[:count], told[count:]
    whole = np.flatnonzero(at_mouths)
    shares = np.concatenate(
        [np.ones(len(whole)), told / np.maximum(np.bincount(node, told, count), 1)[node]]
    )
    where = np.concatenate([whole, node]), np.concatenate([whole, count + np.arange(len(node))])
    means = scipy.sparse.csr_array((shares, where), shape=(count, count + len(node)))
    means.eliminate_zeros()
    return follow.changed(lambda rows: (means @ rows).tocsr())


def _faces_of(body: Body, cuts: Cuts, nodes: np.ndarray, facets: np.ndarray) -> Faces | None:
    """Return the two faces of each cut of a body with a boundary of `facets` between `nodes`.

    Places lie a little beside the cut, so that they follow the points on their side. In the plane
    they are the nodes of a chain on each straight part, which ends a little before the places where
    parts meet; in space the centroids of facets about as large as a cell.
    """
    places, areas, d = (
        [np.zeros((0, body.dimension))],
        [np.zeros((0, body.dimension))],
        body.dimension,
    )
    for side in (1, -1):
        if d == 3:
            symmetric = [plane for plane in body.planes if plane.symmetric]
            for centers, vectors in cuts.flat_parts(side, body.cell, nodes, facets, symmetric):
                places.append(centers)
                areas.append(vectors)
            continue
        for part in cuts.straight_parts(nodes[facets]):
            start, last, end = _through_plane(body, *part)
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
    places, areas = np.concatenate(places), np.concatenate(areas)
    if not len(places):
        return None
    normals = areas / np.linalg.norm(areas, axis=1, keepdims=True)
    return Faces(places, areas, boundary_rows(body, places, normals[:, None]))


def _through_plane(
    body: Body, start: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the two ends of a straight cut, and the second one again or, if the cut meets a plane
    of symmetry there at a right angle, the mirror image of the first.
    """
    for plane in (plane for plane in body.planes if plane.symmetric):
        for one, other in ((start, end), (end, start)):
            foot = plane.mirrored(one[None])[0][0]
            if np.linalg.norm(foot - other) <= ROUNDING * body.extent:
                return one, other, 2 * other - one
    return start, end, end


def _continued(body: Body, nodes: np.ndarray, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes and facets of a boundary continued by its mirror images in planes of
    symmetry, without the facets in these planes; images of nodes come last.
    """
    for plane in body.planes:
        if not plane.symmetric:
            continue
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
    node, areas = facets.ravel(), np.repeat(areas, 3, axis=0)
    size = np.linalg.norm(areas, axis=1)
    normals = areas / size[:, None]
    chosen = np.full((len(nodes), 3, 3), np.nan)
    alike = np.full(len(node), -1.0)  # cosine of the angle to the nearest normal that was chosen
    side = np.zeros(len(node), dtype=int)
    for number in range(3):
        order = np.lexsort((-size, alike > EDGE, node))
        # the largest of the facets of another side
        first = order[np.searchsorted(node[order], np.unique(node))]
        first = first[alike[first] <= EDGE]
        chosen[node[first], number] = normals[first]
        cosine = (normals * chosen[node, number]).sum(axis=1)
        nearer = cosine > alike
        side[nearer], alike[nearer] = number, cosine[nearer]
    means = np.zeros_like(chosen)
    np.add.at(means, (node, side), areas)
    with np.errstate(invalid="ignore"):
        return means / np.linalg.norm(means, axis=2, keepdims=True)


def _of_mesh(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Return the boundary of a mesh body: nodes, facets, names of their parts, and facets of each
    group, see `Surface`.

    Cells whose centroids lie in holes of the scene are left out. A boundary around empty space of
    the mesh itself is a hole too; such holes are numbered after the holes of the scene, from left
    to right.
    """
    mesh = mesh_of(scene.body)
    middles, _ = mesh.centroids()
    hole = np.full(len(middles), -1)
    for number, shape in reversed(list(enumerate(scene.holes))):
        hole[shape.contains(middles)] = number
    sides = mesh.sides()
    outer, beyond = sides.boundary(hole < 0)
    facets, owners = sides.corners[outer], sides.owners[outer]
    parts = np.where(beyond < 0, "outline", np.char.add("holes.", hole[beyond].astype(str)))
    loop = connected(
        len(mesh.nodes), np.repeat(facets[:, 0], facets.shape[1] - 1), facets[:, 1:].ravel()
    )[1][facets[:, 0]]
    first = mesh.nodes[facets[:, 0]]
    if scene.dimension == 2:
        second = mesh.nodes[facets[:, 1]]
        within = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    else:
        within = np.linalg.det(quarters(mesh.nodes[facets])).reshape(len(facets), -1).sum(axis=1)
    within = np.bincount(loop, within)
    inner = [
        number for number in np.flatnonzero(within < 0) if ((loop == number) & (beyond < 0)).any()
    ]
    inner.sort(key=lambda number: tuple(first[loop == number].min(axis=0)))
    for number, chain in enumerate(inner, len(scene.holes)):
        parts = np.where((loop == chain) & (beyond < 0), f"holes.{number}", parts)
    groups = {
        name: np.flatnonzero(np.isin(owners, cells)) for name, cells in mesh.cell_groups.items()
    }
    groups |= {
        name: np.flatnonzero(sides.among(lines)[outer]) for name, lines in mesh.side_groups.items()
    }
    if scene.dimension == 2:
        return mesh.nodes, facets, parts, groups
    triangles = facets[:, 2] == facets[:, 3]
    three = facets[~triangles][:, [[0, 1, 2, 2], [0, 1, 3, 3], [0, 2, 3, 3], [1, 2, 3, 3]]].reshape(
        -1, 4
    )
    keys = side_numbers(np.concatenate([facets[triangles], three]))
    if np.isin(keys[: triangles.sum()], keys[triangles.sum() :]).any():
        raise ValueError(
            "body.file: faces of tetrahedra cover half faces of hexahedra; loads and probes need"
            " shared whole faces"
        )
    middles = len(mesh.nodes) + np.arange(np.count_nonzero(~triangles))
    nodes = np.concatenate([mesh.nodes, mesh.nodes[facets[~triangles]].mean(axis=1)])
    around = facets[~triangles]
    four = np.stack(
        [around, np.roll(around, -1, axis=1), np.broadcast_to(middles[:, None], around.shape)],
        axis=2,
    ).reshape(-1, 3)
    face = np.concatenate([np.flatnonzero(triangles), np.repeat(np.flatnonzero(~triangles), 4)])
    groups = {name: np.flatnonzero(np.isin(face, members)) for name, members in groups.items()}
    return nodes, np.concatenate([facets[triangles, :3], four]), parts[face], groups
