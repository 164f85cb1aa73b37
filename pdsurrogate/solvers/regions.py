"""Which points of a body lie in a region of a scene."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..body import Body
from ..scenes.model import EDGES, Scene
from ..scenes.regions import Region


class BodyRegions:
    """The regions of a scene on its body.

    Parameters
    ----------
    scene : Scene
    body : Body
    lower, upper : ndarray, shape (2,)
        Corners of the bounding box of the body.
    surface : callable
        Gives the boundary of the body, for those who ask for facets.
    """

    def __init__(self, scene: Scene, body: Body, lower, upper, surface: Callable) -> None:
        self.scene, self.body, self._corners, self._surface = scene, body, (np.asarray(lower), np.asarray(upper)), surface

    def points(self, reference: str | Region) -> np.ndarray:
        """Numbers of the points in a region; ValueError where there is none."""
        found = np.flatnonzero(self._inside(reference))
        if not len(found):
            low, high = self._corners
            raise ValueError(f"no point of the body lies in it; the body reaches from {low.tolist()} to {high.tolist()}")
        return found

    def _inside(self, reference: str | Region) -> np.ndarray:
        points = self.body.points
        if isinstance(reference, str):
            if reference in EDGES:
                axis, side = EDGES[reference]
                return -side * (points[:, axis] - self._corners[side > 0][axis]) < 0.99 * self.body.cell[axis]
            return np.ones(len(points), dtype=bool) if reference == "body" else self._inside(self.scene.regions[reference])
        if reference.edge is not None:
            return self._inside(reference.edge)
        if reference.box is not None:
            return ((points >= np.array(reference.box[0])) & (points <= np.array(reference.box[1]))).all(axis=1)
        if reference.disc is not None:
            return np.linalg.norm(points - np.array(reference.disc.centre), axis=1) <= reference.disc.radius
        if reference.half_plane is not None:
            return (points - np.array(reference.half_plane.point)) @ np.array(reference.half_plane.normal) >= 0
        if reference.points is not None:
            return np.isin(np.arange(len(points)), reference.points)
        if reference.near is not None:
            return np.arange(len(points)) == np.linalg.norm(points - np.array(reference.near), axis=1).argmin()
        if reference.both is not None:
            return np.logical_and.reduce([self._inside(part) for part in reference.both])
        if reference.either is not None:
            return np.logical_or.reduce([self._inside(part) for part in reference.either])
        return ~self._inside(reference.other)
