"""How a body is held and pulled: reflected grips, or held points."""

from __future__ import annotations

import numpy as np

from ..body import Body, ReflectionPlane
from ..forces import InternalForce
from ..scenes.model import EDGES, Scene


def reflection_planes(scene: Scene, lower, upper) -> tuple[ReflectionPlane, ...]:
    """Planes in which the body is continued beyond its grips; none where points are held instead."""
    if scene.support != "reflected":
        return ()
    planes = []
    for grip in scene.grips:
        axis, side = EDGES[grip.edge]
        parity = [-1, -1]
        if grip.holds == "normal":
            parity[1 - axis] = 1
        planes.append(ReflectionPlane(axis, (lower, upper)[side > 0][axis], side, tuple(parity)))
    return tuple(planes)


class Loading:
    """The grips of a scene on a body: what they hold, and where they are at a given stretch.

    Parameters
    ----------
    scene : Scene
    body : Body
    lower, upper : pair of float
        Bounding box of the body.

    Attributes
    ----------
    free : ndarray, shape (n, 2)
        1 where a component may move.
    """

    def __init__(self, scene: Scene, body: Body, lower, upper) -> None:
        self.scene, self.body = scene, body
        self.axis = scene.loaded_axis
        self.lower, self.length = lower[self.axis], upper[self.axis] - lower[self.axis]
        self.free = np.ones((len(body), 2))
        self._held: list[np.ndarray] = []
        if scene.support == "points":
            for grip in scene.grips:
                axis, side = EDGES[grip.edge]
                distance = -side * (body.points[:, axis] - (lower, upper)[side > 0][axis])
                held = np.flatnonzero(distance < body.spacing * 0.99)
                if len(held) == 0:
                    raise ValueError(f"no point lies within one spacing of the {grip.edge} edge, so its grip would hold nothing")
                self.free[held, axis] = 0
                if grip.holds == "all":
                    self.free[held, 1 - axis] = 0
                self._held.append(held)

    def grip_displacements(self, stretch: float) -> list[np.ndarray]:
        """Displacement of each grip."""
        displacements = []
        for grip in self.scene.grips:
            axis, side = EDGES[grip.edge]
            displacement = np.zeros(2)
            displacement[axis] = side * grip.travel * (stretch - 1) * self.length
            displacements.append(displacement)
        return displacements

    def apply(self, stretch: float, force: InternalForce, positions: np.ndarray) -> None:
        """Move the grips to a stretch."""
        for number, displacement in enumerate(self.grip_displacements(stretch)):
            if self._held:
                held, axis = self._held[number], EDGES[self.scene.grips[number].edge][0]
                positions[held, axis] = self.body.points[held, axis] + displacement[axis]
                if self.scene.grips[number].holds == "all":
                    positions[held, 1 - axis] = self.body.points[held, 1 - axis] + displacement[1 - axis]
            else:
                force.move_plane(number, displacement)

    def stretched(self, positions: np.ndarray, before: float, after: float) -> np.ndarray:
        """A first guess: positions stretched along the loaded axis between the grips."""
        lower_grip = next(number for number, grip in enumerate(self.scene.grips) if EDGES[grip.edge][1] < 0)
        old, new = (self.lower + self.grip_displacements(stretch)[lower_grip][self.axis] for stretch in (before, after))
        guess = positions.copy()
        guess[:, self.axis] = new + (positions[:, self.axis] - old) * after / before
        return guess
