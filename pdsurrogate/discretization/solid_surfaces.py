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

from ..body import ReflectionPlane
from ..scenes import Box, Circle, Ellipse, Rectangle, Scene, Sphere
from ..scenes.shapes import Outline
from ..scenes.solids import Prism, Solid, Straight
from .cells import lattice_of
from .chains import ROUNDING, boundary_of, same_places
from .triangulation import quarters, tiles_of, triangulated


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
    _, _, _, triangles = triangulated(flat, sides, np.zeros(len(sides), dtype=int), cell[across])
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
        cap = tiles_of(nodes)
    else:
        chains = [
            shape.boundary(beside * (1 + isinstance(shape, Circle | Ellipse))) for shape in shapes
        ]
        mirrors = {plane.axis: plane.position for plane in planes}
        nodes, sides, chain, cap = triangulated(
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
