"""Reflection planes, beyond which mirrored points continue a body and so hold its edges, and
these edges, found before the points exist.
"""

from collections.abc import Mapping

import numpy as np

from ..body import HeldBoundary, ReflectionPlane
from ..scenes import Mesh, Polygon, Rectangle, Scene, Sphere
from ..scenes.grips import prescribed_in
from ..scenes.loading import Prescribed
from ..scenes.model import EDGES
from ..scenes.regions import RegionReference, edge_names
from ..scenes.shapes import Outline, Shape
from .mesh_groups import MeshFile
from .meshes import mesh_of

LEAST_RADIUS = 2.0
"""Least radius of curvature, in spacings, of a boundary that mirrored points hold. The torque on a
hole that turns in a disc is 20 % too small with mirrored points at 2 spacings and 7 % at 3, and 70
and 54 % too large with points held (measured once).
"""

FLAT = 1e-6
"""Extent of a group of a mesh's sides across its plane or line, divided by its extent along it,
up to which it counts as flat.
"""


def whole_edge(scene: Scene, region: RegionReference, faces: Mapping[str, str]) -> str | None:
    """Return the name of the edge (or face) that a region of a scene covers whole; None if it
    covers none or only a part.

    `faces` gives the names of whole edges by the names of the mesh groups that cover them, see
    `faces_of_groups`.
    """
    region = _member(scene, region)
    if isinstance(region, str):
        return region if region in edge_names(scene.dimension) else None
    return faces.get(region.group) if region.group is not None else region.edge


def _member(scene: Scene, region: RegionReference) -> RegionReference:
    """Return the region or name that stands for a region of one member, or given by its name."""
    if isinstance(region, str):
        return _member(scene, scene.regions[region]) if region in scene.regions else region
    members = [member for _, member in region.members()]
    return _member(scene, members[0]) if len(members) == 1 and region.other is None else region


def whole_boundaries(scene: Scene, region: RegionReference) -> tuple[str, ...]:
    """Return the names of the outline and holes, or of the curved group of a mesh's sides, that
    a region consists of; empty for others.
    """
    region = _member(scene, region)
    meshed = isinstance(scene.body, Mesh)
    if not isinstance(region, str):
        curved = meshed and _is_curved(mesh_of(scene.body), region.group)
        return (f"group {region.group}",) if curved else ()
    if region == "holes" and not meshed:
        return tuple(f"holes.{number}" for number in range(len(scene.holes)))
    return (region,) if region in ("outline", "holes") or region.startswith("holes.") else ()


def _is_curved(mesh: MeshFile, group: str | None) -> bool:
    """Return whether a group of a mesh is one of sides of cells that do not lie in a plane, or
    on a line in two dimensions.
    """
    if group not in mesh.side_groups or not len(mesh.side_groups[group]):
        return False
    places = mesh.cells.nodes[np.unique(mesh.side_groups[group])]
    extents = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return bool(extents[-1] > FLAT * extents[0])


def held_boundaries(scene: Scene, curves: bool = True) -> tuple[HeldBoundary, ...]:
    """Return the boundaries of a scene that mirrored points hold; `curves` as for
    `held_at_points`.
    """
    able = (name for name, why in _boundaries_held(scene, curves).items() if not why)
    return tuple(
        HeldBoundary(name, _shape_of(scene, name), name != "outline", (-1,) * scene.dimension)
        for name in able
    )


def held_at_points(scene: Scene, curves: bool) -> dict[str, str]:
    """Return the outlines, holes and curved groups that a scene holds at their points, by name,
    with the reason and what would help.

    Images beyond reentrant corners and tight bends (`LEAST_RADIUS`) would meet, and are left out.
    `curves` says whether the force model supports mirrored points beyond curves.
    """
    return {name: why for name, why in _boundaries_held(scene, curves).items() if why}


def _boundaries_held(scene: Scene, curves: bool) -> dict[str, str]:
    """Return the boundaries of which a scene prescribes at least one component: by name why
    points hold them, or "" for mirrored points.
    """
    if scene.support != "reflected":
        return {}
    held = {}
    for entry in prescribed_in(scene).values():
        for name in whole_boundaries(scene, entry.region):
            held.setdefault(name, set()).update(prescribed_components(entry, scene.dimension))
    return {
        name: _why_at_points(scene, name, components, curves)
        for name, components in sorted(held.items())
    }


def _shape_of(scene: Scene, name: str) -> Shape:
    """Return the shape of the outline or a hole of a scene."""
    return scene.body if name == "outline" else scene.holes[int(name.removeprefix("holes."))]


def _why_at_points(scene: Scene, name: str, components: set[int], curves: bool) -> str:
    """Return why mirrored points do not hold a boundary whose given components are prescribed,
    and what would help; empty if they do.
    """
    finer = "use a smaller spacing"
    if isinstance(scene.body, Mesh):
        return (
            "in bodies from meshes only whole edges of the bounding box have mirrored points;"
            f" define the body by shapes, or {finer}"
        )
    if not curves:
        return (
            "this force has no mirrored points at curved boundaries; use force=bond-energy or"
            f" analytic, or {finer}"
        )
    if missing := set(range(scene.dimension)) - components:
        free = " and ".join(f"x{component + 1}" for component in sorted(missing))
        return f"{free} is free; prescribe all components if the boundary is bonded, or {finer}"
    if name == "outline" and reflected_edges(scene, {}):
        return f"other entries hold edges of it; prescribe each edge by its name, or {finer}"
    shape = _shape_of(scene, name)
    if isinstance(shape, Outline):
        nodes = shape.boundary(np.full(2, scene.spacing))
        import shapely  # here, because few bodies need it

        polygon = shapely.polygons(nodes)
        if (
            polygon.convex_hull.area > (1 + 1e-9) * polygon.area
            if name == "outline"
            else isinstance(shape, Rectangle | Polygon)
        ):
            return f"it has reentrant corners; {finer}"
        curvature = float(shape.nearest(nodes)[1].max())
    elif not isinstance(shape, Sphere) or shape.part != "whole":
        return (
            "in three dimensions only whole spheres have mirrored points; prescribe flat faces by"
            f" their names, or {finer}"
        )
    else:
        curvature = 1 / shape.radius
    if curvature * LEAST_RADIUS * scene.spacing <= 1:
        return ""
    least = (
        f"its least radius of curvature, {1 / curvature:.3g}, is below {LEAST_RADIUS:g} spacings"
    )
    return f"{least}; use a spacing of at most {1 / curvature / LEAST_RADIUS:.3g}"


def prescribed_components(entry: Prescribed, dimension: int) -> tuple[int, ...]:
    """Return the numbers, from 0 for x1, of the displacement components that an entry of
    `prescribed` fixes; all for a rotation.
    """
    return tuple(
        component
        for component in range(dimension)
        if entry.rotation is not None or entry.displacement[component] is not None
    )


def reflected_edges(scene: Scene, faces: Mapping[str, str]) -> dict[str, set[int]]:
    """Return the edges of a scene that reflection planes hold, each with the displacement
    components that are held there, 0 for x1.

    Reflection planes hold an edge if grips or entries of `prescribed` apply to the whole of it, by
    its name or by a mesh group that covers it (see `whole_edge`, also for `faces`), and prescribe
    its normal component, alone or as part of a rotation. On other edges that a scene holds, the
    outermost points are held instead.
    """
    if scene.support != "reflected":
        return {}
    held: dict[str, set[int]] = {}
    for entry in prescribed_in(scene).values():
        edge = whole_edge(scene, entry.region, faces)
        if edge is not None:
            held.setdefault(edge, set()).update(prescribed_components(entry, scene.dimension))
    return {edge: components for edge, components in held.items() if EDGES[edge][0] in components}


def reflection_planes(
    scene: Scene, lower, upper, faces: Mapping[str, str]
) -> tuple[ReflectionPlane, ...]:
    """Return the reflection planes that hold edges of a scene, one for each of `reflected_edges`.

    `lower` and `upper` are the corners of the body's bounding box, shape (d,); `faces` gives the
    names of whole edges by the names of the mesh groups that cover them, see `faces_of_groups`.
    """
    planes = []
    for edge, components in reflected_edges(scene, faces).items():
        axis, side = EDGES[edge]
        parity = tuple(-1 if component in components else 1 for component in range(scene.dimension))
        planes.append(ReflectionPlane(axis, (lower, upper)[side > 0][axis], side, parity))
    return tuple(planes)
