"""Loads of a body, made from the entries of a scene, and the names of the parts of its boundary
that reflection holds.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from ..body import Body, HeldBoundary, Mirror
from ..materials import Law, plane_stress
from ..scenes import Load, Scene
from ..scenes.amplitudes import amplitude_of
from ..scenes.model import EDGES
from ..scenes.regions import label_of_region
from ..solvers.loads import AnyLoad, DeadLoad, Loads, Pressure, Traction
from .obstacles import obstacles_of
from .regions import BodyRegions


def loads_of(scene: Scene, body: Body, regions: BodyRegions, laws: Sequence[Law] = ()) -> Loads:
    """Return the loads and obstacles of a scene with the laws of its deformable materials.

    Raises
    ------
    ValueError
        For a region that is empty, a load on an edge that is held by reflection, or an unsuitable
        obstacle; the message names the key.
    """
    found: list[AnyLoad] = [*obstacles_of(scene, body, regions, laws)]
    for number, load in enumerate(scene.loads):
        # Several loads may share a name, as traction and pressure on one edge do; results sum them.
        named = (
            load.name or label_of_region(load.region, f"loads.{number}"),
            amplitude_of(load.amplitude),
            body.share,
        )
        key = f"loads.{number}.region"
        if load.kind == "pressure":
            deformed = scene.plane == "stress" and load.thickness != "undeformed"
            facets = _facets_of(key, load, body, regions)
            at_edge = _thickness_at_edge(scene, number, facets, regions, laws) if deformed else None
            found.append(
                Pressure(*named, regions.surface(), facets, load.pressure, deformed, at_edge)
            )
        elif load.kind == "traction":
            facets = _facets_of(key, load, body, regions)
            found.append(Traction(*named, regions.surface(), facets, load.traction))
        else:
            found.append(DeadLoad(*named, *_dead_forces(key, load, body, regions)))
    return Loads(body, found)


def _thickness_at_edge(
    scene: Scene, number: int, facets: np.ndarray, regions: BodyRegions, laws: Sequence[Law]
) -> Callable[[np.ndarray, float], np.ndarray] | None:
    """Return the function that gives the thickness at the facets of a pressure, load `number`, from
    their own stretch, theory (44a).

    None if the body has several materials or memory, or if other loads or an obstacle may act on
    the facets, whose stress is then another one.
    """
    others = [
        load
        for other, load in enumerate(scene.loads)
        if other != number and load.kind in ("pressure", "traction")
    ]
    shared = any(np.isin(facets, regions.facets(load.region, "")).any() for load in others)
    if shared or scene.obstacles or len(laws) != 1 or laws[0].memory:
        return None
    return partial(plane_stress.thickness_at_edge, laws[0])


def _facets_of(key: str, load: Load, body: Body, regions: BodyRegions) -> np.ndarray:
    """Return the facets that a traction or pressure acts on; raise ValueError, naming the `key`,
    if one lies in a reflection plane.
    """
    facets = regions.facets(load.region, key)
    surface = regions.surface()
    for plane in body.planes:
        if (surface.parts[facets] == edge_of(plane)).any():
            edge = words_for(edge_of(plane), body)
            raise ValueError(
                f"{key}: the region contains the {edge}, which is held by reflection, so that a"
                f" {load.kind} there acts on the support only; leave the {edge} out, or hold"
                " points (support=points)"
            )
    return facets


def _dead_forces(
    key: str, load: Load, body: Body, regions: BodyRegions
) -> tuple[np.ndarray, np.ndarray]:
    """Return this rank's own points on which a force or body force acts, and its forces on them.

    Raise ValueError, with the `key` of the load's region, for a load on an edge or face that is
    held by reflection.
    """
    held = [edge for edge in map(edge_of, body.planes) if edge in regions.mirrors(load.region)]
    if load.kind == "force" and held:
        # It would pull at points half a cell inside the edge, which are free.
        edge = words_for(held[0], body)
        raise ValueError(
            f"{key}: the {edge} is held by reflection, so that a force there acts on the support"
            " only; give another region, or hold points instead (support=points)"
        )
    points = regions.points(load.region, key)
    points = points[body.share.own[points]]
    if load.kind == "body_force":
        return points, body.volumes[points, None] * np.array(load.body_force)
    part = np.array(load.force) / body.share.total(len(points))
    return points, np.tile(part, (len(points), 1))


def edge_of(plane: Mirror) -> str:
    """Return the name of the part of the boundary that lies in a reflection plane, or that
    mirrored points hold.
    """
    if isinstance(plane, HeldBoundary):
        return plane.name
    return next(edge for edge, place in EDGES.items() if place == (plane.axis, plane.side))


def words_for(edge: str, body: Body) -> str:
    """Return the words that messages use for an edge of a sheet, a face of a solid, as "left
    edge", or another part of the boundary.
    """
    if edge not in EDGES:
        return f"boundary {edge}"
    return f"{edge} {'edge' if body.dimension == 2 else 'face'}"
