"""Loads of a scene, resolved into forces on points and pressures on facets."""

import numpy as np

from ..body import Body, ReflectionPlane
from ..scenes import Load, Scene
from ..scenes.amplitudes import amplitude_of
from ..scenes.model import EDGES
from ..solvers.loads import DeadLoad, Loads, Pressure
from .regions import BodyRegions

ON_A_PLANE = 1e-6
"""Distance in spacings within which a facet counts as lying in a plane of reflection."""


def loads_of(scene: Scene, body: Body, regions: BodyRegions) -> Loads | None:
    """Return the loads of a scene; None where it has none.

    Raises
    ------
    ValueError
        For a region that is empty, or a load on an edge that is held by reflection; names the key.
    """
    found: list[DeadLoad | Pressure] = []
    for number, load in enumerate(scene.loads):
        # Several loads may share a name, as traction and pressure on one edge do; results sum them.
        name = load.name or regions.label(load.region, f"loads.{number}")
        key, amplitude = f"loads.{number}.region", amplitude_of(load.amplitude)
        if load.kind == "pressure":
            deformed = scene.plane == "stress" and load.thickness != "undeformed"
            found.append(Pressure(name, amplitude, _facets_of(key, load, body, regions), load.pressure, deformed))
        else:
            found.append(DeadLoad(name, amplitude, *_dead_forces(key, load, body, regions)))
    return Loads(body, found, regions.surface) if found else None


def _facets_of(key: str, load: Load, body: Body, regions: BodyRegions) -> np.ndarray:
    """Return the facets that a traction or pressure acts on; raise ValueError where one lies in a plane of reflection."""
    facets, surface = regions.facets(load.region, key), regions.surface()
    for plane in body.planes:
        distance = np.abs(surface.nodes[surface.facets[facets]][..., plane.axis] - plane.position)
        if (distance < ON_A_PLANE * body.spacing).all(axis=1).any():
            edge = _words_for(edge_of(plane), body)
            why = f"which is held by reflection, so that a {load.kind} there goes into what holds it"
            raise ValueError(f"{key}: it takes in facets of the {edge}, {why}; leave the {edge} out, or hold points (support=points)")
    return facets


def _dead_forces(key: str, load: Load, body: Body, regions: BodyRegions) -> tuple[np.ndarray, np.ndarray]:
    """Return the points that a dead load acts on and its forces on them (theory (43))."""
    if load.kind == "traction":
        facets, surface = _facets_of(key, load, body, regions), regions.surface()
        corners = [surface.interpolation[nodes] for nodes in surface.facets[facets].T]
        spread = [sum(others, first).T for first, *others in zip(*(one.rows for one in corners), strict=True)]
        sizes = np.stack([rows @ surface.areas()[facets] / len(corners) for rows in spread], axis=1)
        points = np.flatnonzero(sizes.any(axis=1))
        return points, sizes[points] * np.array(load.traction)
    if load.kind == "force" and regions.edge(load.region) in map(edge_of, body.planes):
        # It would pull at points half a cell inside the edge, which are free.
        edge = _words_for(regions.edge(load.region), body)
        why = f"the {edge} is held by reflection, so that a force there goes into what holds it"
        raise ValueError(f"{key}: {why}; give another region, or hold points (support=points)")
    points = regions.points(load.region, key)
    points = points[body.share.own[points]]
    if load.kind == "body_force":
        return points, body.volumes[points, None] * np.array(load.body_force)
    part = np.array(load.force) / body.share.total(len(points))
    return points, np.tile(part, (len(points), 1))


def edge_of(plane: ReflectionPlane) -> str:
    """Return the name of the edge that a plane holds."""
    return next(edge for edge, place in EDGES.items() if place == (plane.axis, plane.side))


def _words_for(edge: str, body: Body) -> str:
    """Return the name of an edge or face in messages."""
    return f"{edge} {'edge' if body.dimension == 2 else 'face'}"
