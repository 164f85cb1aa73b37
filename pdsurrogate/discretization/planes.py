"""Reflection planes, beyond which mirrored points continue a body and so hold its edges, and these edges, found before the points exist."""

from collections.abc import Mapping

import numpy as np
import shapely

from ..body import HeldBoundary, ReflectionPlane
from ..scenes import Mesh, Polygon, Rectangle, Sphere
from ..scenes.loading import Prescribed
from ..scenes.model import EDGES, Scene
from ..scenes.regions import RegionReference, edge_names
from ..scenes.shapes import Outline, Shape

LEAST_RADIUS = 2.0
"""Least radius of curvature, in spacings, of a boundary that mirrored points hold. The torque on a hole that turns in a disc is 20 % too
small with mirrored points at 2 spacings and 7 % at 3, and 70 and 54 % too large with points held (measured once)."""


def whole_edge(scene: Scene, region: RegionReference, faces: Mapping[str, str]) -> str | None:
    """Return the name of the edge (or face) that a region of a scene covers whole; None if it covers none or only a part.

    `faces` gives the names of whole edges by the names of the mesh groups that cover them, see `faces_of_groups`.
    """
    if isinstance(region, str):
        if region in edge_names(scene.dimension):
            return region
        return whole_edge(scene, scene.regions[region], faces) if region in scene.regions else None
    members = list(region.members())
    if len(members) == 1 and region.other is None:
        return whole_edge(scene, members[0][1], faces)
    return faces.get(region.group) if region.group is not None else region.edge


def whole_boundaries(scene: Scene, region: RegionReference) -> tuple[str, ...]:
    """Return the names of the outline and holes of a scene that a region consists of; empty for other regions and meshes."""
    if isinstance(region, str) and region in scene.regions:
        return whole_boundaries(scene, scene.regions[region])
    if not isinstance(region, str):
        members = [member for _, member in region.members()]
        return whole_boundaries(scene, members[0]) if len(members) == 1 and region.other is None else ()
    if isinstance(scene.body, Mesh):
        return ()
    if region == "holes":
        return tuple(f"holes.{number}" for number in range(len(scene.holes)))
    return (region,) if region == "outline" or region.startswith("holes.") else ()


def held_boundaries(scene: Scene) -> tuple[HeldBoundary, ...]:
    """Return the boundaries of a scene that mirrored points hold: outlines and holes, whole, all components of which are prescribed.

    A boundary with reentrant corners or tight bends (`LEAST_RADIUS`) is held at its points, since images there would meet and are left
    out; so is an outline some edges of which are held by reflection planes.
    """
    if scene.support != "reflected" or scene.stretched:
        return ()
    every, held = set(range(scene.dimension)), {}
    for entry in scene.prescribed:
        for name in whole_boundaries(scene, entry.region):
            held.setdefault(name, set()).update(prescribed_components(entry, scene.dimension))
    if reflected_edges(scene, {}):
        held.pop("outline", None)
    shapes = {"outline": scene.body} | {f"holes.{number}": hole for number, hole in enumerate(scene.holes)}
    able = (name for name, components in sorted(held.items()) if components == every and _bends_slowly(scene, name, shapes[name]))
    return tuple(HeldBoundary(name, shapes[name], name != "outline", (-1,) * scene.dimension) for name in able)


def _bends_slowly(scene: Scene, name: str, shape: Shape) -> bool:
    """Return whether a boundary has neither corners that are reentrant for the body nor radii of curvature below `LEAST_RADIUS`.

    In three dimensions only whole spheres have mirrored points.
    """
    if not isinstance(shape, Outline):
        return isinstance(shape, Sphere) and shape.part == "whole" and shape.radius >= LEAST_RADIUS * scene.spacing
    nodes = shape.boundary(np.full(2, scene.spacing))
    polygon = shapely.polygons(nodes)
    reentrant = polygon.convex_hull.area > (1 + 1e-9) * polygon.area if name == "outline" else isinstance(shape, Rectangle | Polygon)
    return not reentrant and shape.nearest(nodes)[1].max() * LEAST_RADIUS * scene.spacing <= 1


def prescribed_components(entry: Prescribed, dimension: int) -> tuple[int, ...]:
    """Return the numbers, from 0 for x1, of the displacement components that an entry of `prescribed` fixes; all for a rotation."""
    return tuple(component for component in range(dimension) if entry.rotation is not None or entry.displacement[component] is not None)


def reflected_edges(scene: Scene, faces: Mapping[str, str]) -> dict[str, set[int]]:
    """Return the edges of a scene that reflection planes hold, each with the displacement components that are held there, 0 for x1.

    Reflection planes hold the edges of grips. They also hold an edge if entries of `prescribed` apply to the whole of it, by its name or by
    a mesh group that covers it (see `whole_edge`, also for `faces`), and prescribe its normal component, alone or as part of a rotation.
    On other edges that a scene holds, the outermost points are held instead.
    """
    if scene.support != "reflected":
        return {}
    every = range(scene.dimension)
    held = {grip.edge: {EDGES[grip.edge][0]} if grip.holds == "normal" else set(every) for grip in scene.grips}
    for entry in scene.prescribed:
        edge = whole_edge(scene, entry.region, faces)
        if edge is not None:
            held.setdefault(edge, set()).update(prescribed_components(entry, scene.dimension))
    return {edge: components for edge, components in held.items() if EDGES[edge][0] in components}


def reflection_planes(scene: Scene, lower, upper, faces: Mapping[str, str]) -> tuple[ReflectionPlane, ...]:
    """Return the reflection planes that hold edges of a scene, one for each of `reflected_edges`.

    `lower` and `upper` are the corners of the body's bounding box, shape (d,); `faces` gives the names of whole edges by the names of the
    mesh groups that cover them, see `faces_of_groups`.
    """
    planes = []
    for edge, components in reflected_edges(scene, faces).items():
        axis, side = EDGES[edge]
        parity = tuple(-1 if component in components else 1 for component in range(scene.dimension))
        planes.append(ReflectionPlane(axis, (lower, upper)[side > 0][axis], side, parity))
    return tuple(planes)
