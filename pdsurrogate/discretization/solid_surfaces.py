"""Boundary of a solid composed of shapes, as triangles.

The boundary of a prism, such as a box, a cylinder or an extrusion, is the boundary of its section
(found as in `surfaces` for the plane) extruded along its axis, and a cap on either end.  Holes that
go all the way through along its axis are part of the section.  Other holes have a closed boundary
of their own, and lie inside the body.  The boundary of a half, quarter or eighth of a sphere
consists of curved faces, each an eighth of the whole sphere's surface, and flat faces within their
rims; a spherical hole with its center on a flat face is cut by that face.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import scipy

from ..body import ReflectionPlane, Surface
from ..body.cell_mesh import among
from ..body.surface import IN_PLANE
from ..kernels.polygons import encloses
from ..scenes import Box, Circle, Ellipse, Rectangle, Scene, Sphere
from ..scenes.shapes import Outline
from ..scenes.solids import Prism, Solid, Straight
from .cells import lattice_of
from .chains import ROUNDING, boundary_of, same_places

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


def boundary_of_solids(
    scene: Scene,
    cell: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    planes: Sequence[ReflectionPlane],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the boundary of a solid: nodes (k, 3), triangles (f, 3) of node numbers, and part
    names (f,): outline, holes.0, ...

    Facets are about a cell long, on spheres half as long. A flat rectangle is divided into cells,
    and each cell into four triangles that meet at its middle.

    Raises
    ------
    ValueError
        If the boundary of a hole meets the boundary of the body or of another hole, and the hole
        does not go all the way through along the axis of the body.
    """
    tolerance = ROUNDING * float((upper - lower).max())
    problem = None
    for axis in _axes_of(scene.body):
        body = _along(scene.body, axis)
        through = [
            number
            for number, hole in enumerate(scene.holes)
            if _goes_through(_along(hole, axis), body, tolerance)
        ]
        parts = {
            number: _closed(hole, _halved_with(scene.body, hole, tolerance), cell, tolerance)[
                :, ::-1
            ]
            for number, hole in enumerate(scene.holes)
            if number not in through
        }
        problem = _meeting(scene, parts, tolerance)
        if problem is None:
            break
    if problem is not None:
        raise ValueError(
            f"holes.{problem}: its boundary intersects another one; with loads or probes, a hole"
            " must lie inside the body, go all the way through a box, cylinder, tube or extrusion"
            " along its axis, or be a sphere with its center on a flat face of a part of a sphere"
        )
    if body is None:
        triangles = [_sphere(scene.body, scene.body.halved, cell)]
        names = ["outline"]
    else:
        holes = {f"holes.{number}": _along(scene.holes[number], axis).section for number in through}
        holes |= {
            f"holes.{number}": bore for number, bore in enumerate(body.bores, len(scene.holes))
        }
        found = _prism(body, axis, cell, tolerance, tuple(holes.values()), planes)
        triangles = found
        names = ["outline", *holes]
    for number, of_hole in parts.items():
        triangles.append(of_hole)
        names.append(f"holes.{number}")
    if body is None:
        for axis in scene.body.halved:
            triangles.append(
                _flat_face(
                    scene.body, axis, np.concatenate(triangles[: 1 + len(parts)]), cell, tolerance
                )
            )
            names.append("outline")
    nodes = np.concatenate(triangles).reshape(-1, 3)
    facets = same_places(nodes, 4 * tolerance).reshape(-1, 3)
    return nodes, facets, np.repeat(names, [len(of_part) for of_part in triangles])


def _axes_of(body: Solid) -> tuple[int, ...]:
    """Return the axes along which to look for holes through a body: all for a box, the axis of a
    prism, x3 alone for a sphere.
    """
    return (
        (2, 0, 1)
        if isinstance(body, Box)
        else (body.straight.along,)
        if isinstance(body, Prism)
        else (2,)
    )


def _along(shape: Solid, axis: int) -> Straight | None:
    """Return the description of a shape as a prism along an axis; None if it is not such a
    prism.
    """
    if isinstance(shape, Box):
        return shape.straight_along(axis)
    return shape.straight if isinstance(shape, Prism) and shape.straight.along == axis else None


def _goes_through(hole: Straight | None, body: Straight | None, tolerance: float) -> bool:
    if hole is None or body is None or hole.bores:
        return False
    return hole.span[0] <= body.span[0] + tolerance and hole.span[1] >= body.span[1] - tolerance


def _halved_with(body: Solid, hole: Solid, tolerance: float) -> tuple[int, ...]:
    """Return the axes normal to the planes that cut off a part of a spherical hole; none for holes
    of other shapes.

    For a part of a sphere they are those of its own flat faces; for a whole sphere, those of the
    flat faces of the body, itself a part of a sphere, on which the center of the hole lies.
    """
    if not isinstance(hole, Sphere):
        return ()
    cut = tuple(
        axis
        for axis in _faces_of_part(body)
        if abs(hole.center[axis] - body.center[axis]) <= tolerance
    )
    return hole.halved or cut


def _faces_of_part(body: Solid) -> tuple[int, ...]:
    """Return the normal axes of the flat faces of a body that is a part of a sphere; none for
    other bodies.
    """
    return body.halved if isinstance(body, Sphere) else ()


def _meeting(scene: Scene, closed: dict[int, np.ndarray], tolerance: float) -> int | None:
    """Return the number of the first hole, among the holes in `closed`, whose boundary leaves the
    body or meets another hole; else None.

    `closed` gives the boundaries as triangles, shape (f, 3, 3), by the numbers of the holes.

    The rims of spherical holes that flat faces cut lie on these faces and do not count as leaving
    the body.
    """
    inward = np.zeros(3)
    inward[list(_faces_of_part(scene.body))] = 4 * tolerance
    for number, triangles in closed.items():
        nodes = triangles.reshape(-1, 3)
        inside = scene.body.contains(nodes + inward)
        for other, hole in enumerate(scene.holes):
            if other != number:
                inside &= ~hole.contains(nodes)
                if other in closed:
                    inside &= ~scene.holes[number].contains(closed[other].reshape(-1, 3)).any()
        if not inside.all():
            return number
    return None


def _closed(
    shape: Solid, halved: tuple[int, ...], cell: np.ndarray, tolerance: float
) -> np.ndarray:
    """Return the boundary of one shape as triangles (f, 3, 3), counter-clockwise as seen from
    outside.

    The boundary is closed, except for a sphere cut by planes normal to the axes `halved`: it is
    then the curved surface without flat faces.
    """
    if isinstance(shape, Sphere):
        return _sphere(shape, halved, cell)
    straight = shape.straight
    return np.concatenate(_prism(straight, straight.along, cell, tolerance, straight.bores))


def _sphere(sphere: Sphere, halved: tuple[int, ...], cell: np.ndarray) -> np.ndarray:
    """Return the curved surface of a sphere, or of its part with greater coordinates than the
    center along each of the axes `halved`.

    The result is triangles, shape (f, 3, 3).

    The triangles of the whole sphere enclose exactly its volume.

    It is made of divided eighths. Nodes lie outside the sphere about as far as the middles of
    facets lie inside, so that the work of a pressure in an affine motion is exact. Facets are about
    half a cell long: the work of a pressure that widens a hole of six cells' radius is then 0.25 %
    too small; with facets of a whole cell it is 1 %.
    """
    signs = lattice_of(*((1.0,) if axis in halved else (1.0, -1.0) for axis in range(3)))
    faces = signs[:, :, None] * np.eye(3)
    # The sides of an eighth are divided evenly; in its middle the facets are larger by 1.4.
    count = max(3, math.ceil(2.5 * math.pi / 2 * sphere.radius / cell.min()))
    inward = np.linalg.det(faces) < 0
    faces[inward] = faces[inward][:, ::-1]
    row, column = lattice_of(*[np.arange(count)] * 2).T
    low = np.stack([row, column], axis=-1)[:, None] + [[0, 0], [1, 0], [0, 1]]
    high = np.stack([row, column], axis=-1)[:, None] + [[1, 0], [1, 1], [0, 1]]
    shares = np.concatenate([low[row + column < count], high[row + column < count - 1]]) / count
    # of the corners of a face
    weights = np.concatenate([1 - shares.sum(axis=2, keepdims=True), shares], axis=2)
    found = np.einsum("tnc,fcd->ftnd", np.sin(np.pi / 2 * weights), faces).reshape(-1, 3, 3)
    found /= np.linalg.norm(found, axis=2, keepdims=True)
    volume = np.linalg.det(found).sum() / 6 * 8 / len(faces)
    return np.array(sphere.center) + sphere.radius * np.cbrt(4 * np.pi / 3 / volume) * found


def _flat_face(
    sphere: Sphere, axis: int, curved: np.ndarray, cell: np.ndarray, tolerance: float
) -> np.ndarray:
    """Return the triangles (f, 3, 3) of the flat face of a part of a sphere, normal to `axis`,
    between the rims of its curved faces.

    `curved` are the triangles of these, shape (f, 3, 3). Two flat faces have common nodes along the
    line where they meet.
    """
    center = np.array(sphere.center)
    across = [(axis + 1) % 3, (axis + 2) % 3]
    nodes = curved.reshape(-1, 3)
    rim = np.abs(nodes[:, axis] - center[axis]) <= tolerance
    number = same_places(nodes, 4 * tolerance).reshape(-1, 3)
    sides = np.concatenate([number[:, [0, 1]], number[:, [1, 2]], number[:, [2, 0]]])
    sides = sides[rim[sides].all(axis=1)]
    starts = np.setdiff1d(sides[:, 0], sides[:, 1])
    ends = np.setdiff1d(sides[:, 1], sides[:, 0])
    added = []
    places = list(nodes)
    for other in sphere.halved:
        if other == axis:
            continue
        along = 3 - axis - other
        line = [
            end for end in (*starts, *ends) if abs(nodes[end, other] - center[other]) <= tolerance
        ]
        line.sort(key=lambda end: nodes[end, along])
        if len(line) % 2:  # the corner where three flat faces meet
            line.insert(0, len(nodes))
            if len(places) == len(nodes):
                places.append(center)
        for low, high in zip(line[::2], line[1::2], strict=True):
            pieces_of_line = max(1, round((places[high][along] - places[low][along]) / cell[along]))
            between = [low, *range(len(places), len(places) + pieces_of_line - 1), high]
            places.extend(
                places[low] + (places[high] - places[low]) * part / pieces_of_line
                for part in range(1, pieces_of_line)
            )
            # A rim that ends at a place goes on along the line.
            added += pairwise(between if low in ends or high in starts else between[::-1])
    sides = np.concatenate([sides, np.array(added, dtype=int).reshape(-1, 2)])
    flat = np.array(places)[:, across]
    _, _, _, triangles = _triangulated(flat, sides, np.zeros(len(sides), dtype=int), cell[across])
    found = np.empty((*triangles.shape[:-1], 3))
    found[..., across] = triangles
    found[..., axis] = center[axis]
    return found[:, ::-1]


def _prism(
    straight: Straight,
    axis: int,
    cell: np.ndarray,
    tolerance: float,
    holes: tuple[Outline, ...],
    planes: Sequence[ReflectionPlane] = (),
) -> list[np.ndarray]:
    """Return the boundary of a prism as triangle arrays (f, 3, 3): its outline with both caps, then
    each hole through it.

    The argument `straight` describes the prism, which extends along `axis`, and `holes` are the
    plane sections of the holes. `cell` are the sizes of a cell along the three axes, and `planes`
    those of symmetry.
    """
    across = [(axis + 1) % 3, (axis + 2) % 3]
    beside = cell[across]
    low, high = straight.span
    layers = max(1, round((high - low) / cell[axis]))
    levels = low + (high - low) * np.arange(layers + 1) / layers
    shapes = (straight.section, *holes)

    if isinstance(straight.section, Rectangle) and not holes:
        nodes = straight.section.boundary(beside)
        sides = np.stack([np.arange(len(nodes)), np.roll(np.arange(len(nodes)), -1)], axis=1)
        chain = np.zeros(len(nodes), dtype=int)
        cap = _tiles(nodes)
    else:
        chains = [
            shape.boundary(beside * (1 + isinstance(shape, Circle | Ellipse))) for shape in shapes
        ]
        mirrors = {plane.axis: plane.position for plane in planes}
        nodes, sides, chain, cap = _triangulated(
            *boundary_of(chains, tolerance), beside, [mirrors.get(each) for each in across]
        )

    def placed(places: np.ndarray, level: np.ndarray | float) -> np.ndarray:
        found = np.empty((*places.shape[:-1], 3))
        found[..., across] = places
        found[..., axis] = level
        return found

    found = []
    for number in range(len(shapes)):
        first, second = nodes[sides[chain == number]].transpose(1, 0, 2)[:, None]
        below = levels[:-1, None]
        above = levels[1:, None]
        quadrilaterals = np.stack(
            [
                placed(np.broadcast_to(end, (layers, *end.shape[1:])), level)
                for end, level in ((first, below), (second, below), (second, above), (first, above))
            ],
            axis=2,
        )
        found.append(quarters(quadrilaterals.reshape(-1, 4, 3)))
    found[0] = np.concatenate([found[0], placed(cap, high), placed(cap, low)[:, ::-1]])
    return found


def quarters(quadrilaterals: np.ndarray) -> np.ndarray:
    """Divide each quadrilateral (q, 4, d) into four triangles about the mean of its corners;
    return the triangles, shape (4 q, 3, d).
    """
    middles = np.broadcast_to(quadrilaterals.mean(axis=1, keepdims=True), quadrilaterals.shape)
    triangles = np.stack([quadrilaterals, np.roll(quadrilaterals, -1, axis=1), middles], axis=2)
    return triangles.reshape(-1, *triangles.shape[2:])


def _tiles(nodes: np.ndarray) -> np.ndarray:
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


def _triangulated(
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
    """Return polygons as for `_triangulated`, with the nodes `between` in the place of those
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
