"""Reflection planes, beyond which mirrored points continue a body and so hold its edges, and these edges, found before the points exist."""

from collections.abc import Mapping

from ..body import ReflectionPlane
from ..scenes.loading import Prescribed
from ..scenes.model import EDGES, Scene
from ..scenes.regions import RegionReference, edge_names


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
