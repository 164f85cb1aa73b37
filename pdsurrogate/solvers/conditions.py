"""How a body is held and pulled: reflected grips, and points held component by component."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..body import Body, ReflectionPlane
from ..forces import InternalForce, InvalidState
from ..forces.kinematics import at_point
from ..scenes.model import EDGES, Hold, Scene


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


@dataclass(frozen=True)
class _HeldPoints:
    """Points of which some components move with the loading: ``displacement = travel * elongation``."""

    points: np.ndarray
    components: tuple[int, ...]
    travel: np.ndarray


class Loading:
    """The conditions of a scene on a body: what is held, and where it is at a given stretch.

    Parameters
    ----------
    scene : Scene
    body : Body
    lower, upper : ndarray, shape (2,)
        Bounding box of the body.

    Attributes
    ----------
    axis : int
        Loaded direction.
    free : ndarray, shape (n, 2)
        1 where a component may move, 0 where it is held.

    Raises
    ------
    ValueError
        If a condition holds no point; names it.
    """

    def __init__(self, scene: Scene, body: Body, lower, upper) -> None:
        self.scene, self.body = scene, body
        self.axis = scene.loaded_axis
        self.lower, self.length = lower[self.axis], upper[self.axis] - lower[self.axis]
        self._held = [self._region(number, hold) for number, hold in enumerate(scene.holds)]
        if scene.support == "points":
            self._held += [self._edge(grip, lower, upper) for grip in scene.grips]
        self.free = np.ones((len(body), 2))
        for held in self._held:
            for component in held.components:
                self.free[held.points, component] = 0

    def _region(self, number: int, hold: Hold) -> _HeldPoints:
        if hold.points is not None:
            points = np.array(hold.points)
            if points.size and points.max() >= len(self.body):
                raise ValueError(f"holds.{number}: there is no point {points.max()}; the body has {len(self.body)}")
        else:
            low, high = np.array(hold.box)
            points = np.flatnonzero(((self.body.points >= low) & (self.body.points <= high)).all(axis=1))
        if len(points) == 0:
            raise ValueError(f"holds.{number}: no point of the body lies in its region")
        return _HeldPoints(points, tuple(int(name == "x2") for name in hold.components), np.array(hold.travel))

    def _edge(self, grip, lower, upper) -> _HeldPoints:
        axis, side = EDGES[grip.edge]
        distance = -side * (self.body.points[:, axis] - (lower, upper)[side > 0][axis])
        points = np.flatnonzero(distance < 0.99 * self.body.spacing)
        if len(points) == 0:
            raise ValueError(f"grips: no point lies within one spacing of the {grip.edge} edge")
        return _HeldPoints(points, (axis,) if grip.holds == "normal" else (0, 1), self._travel(grip))

    @staticmethod
    def _travel(grip) -> np.ndarray:
        axis, side = EDGES[grip.edge]
        travel = np.zeros(2)
        travel[axis] = side * grip.travel
        return travel

    def apply(self, stretch: float, force: InternalForce, positions: np.ndarray) -> None:
        """Move everything that is held to where it is at a stretch."""
        elongation = (stretch - 1) * self.length
        for held in self._held:
            for component in held.components:
                positions[held.points, component] = self.body.points[held.points, component] + held.travel[component] * elongation
        if self.scene.support == "reflected":
            for number, grip in enumerate(self.scene.grips):
                force.move_plane(number, self._travel(grip) * elongation)

    def check_inside(self, stretch: float, force: InternalForce, positions: np.ndarray) -> None:
        """Check that no point is on the far side of a plane in which the body is reflected, where its own image belongs.

        Points without support are left out: nothing moves them.

        Raises
        ------
        InvalidState
            Names the point that is farthest beyond, and the grip.
        """
        if self.scene.support != "reflected":
            return
        supported = force.kinematics.supported[: len(self.body)] != 0
        for plane, grip in zip(self.body.planes, self.scene.grips, strict=True):
            place = plane.position + self._travel(grip)[plane.axis] * (stretch - 1) * self.length
            beyond = np.where(supported, plane.side * (positions[:, plane.axis] - place), 0.0)
            worst = int(beyond.argmax())
            if beyond[worst] > 1e-6 * self.body.spacing:
                what = f"it lies {beyond[worst]:.3g} beyond the {grip.edge} grip, on the side of its own image"
                raise InvalidState(at_point(self.body, worst, what))

    def reactions(self, force: InternalForce, forces: np.ndarray) -> np.ndarray:
        """Pull of every grip on the body along the loaded axis, outwards, per unit thickness, shape (2,).

        Parameters
        ----------
        force : InternalForce
            In the state last evaluated.
        forces : ndarray, shape (n, 2)
            Internal forces there.
        """
        sides = np.array([EDGES[grip.edge][1] for grip in self.scene.grips])
        if self.scene.support == "points":
            # Points held by a grip take from it what the bonds pull them inwards with.
            held = self._held[len(self.scene.holds) :]
            return sides * np.array([-forces[grip.points, self.axis].sum() for grip in held])
        pair_forces = force.pair_forces()[self._outer_pairs, self.axis]
        return sides * np.bincount(self._outer_planes, pair_forces, len(sides))

    def travels(self) -> np.ndarray:
        """Share of the elongation that each grip takes, shape (2,)."""
        return np.array([grip.travel for grip in self.scene.grips])

    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Points that each grip holds directly."""
        if self.scene.support == "points":
            low, high = self._held[len(self.scene.holds) :]
            return low.points, high.points
        images = self.body.images
        low, high = (images.mirror[images.plane == plane] for plane in range(2))
        return low, high

    @cached_property
    def _outer_pairs(self) -> np.ndarray:
        return np.flatnonzero(self.body.bonds.second >= len(self.body))

    @cached_property
    def _outer_planes(self) -> np.ndarray:
        return self.body.images.plane[self.body.bonds.second[self._outer_pairs] - len(self.body)]

    def stretched(self, positions: np.ndarray, before: float, after: float) -> np.ndarray:
        """First guess: positions stretched along the loaded axis between the grips."""
        lower_grip = next(grip for grip in self.scene.grips if EDGES[grip.edge][1] < 0)
        travel = self._travel(lower_grip)[self.axis]
        old, new = (self.lower + travel * (stretch - 1) * self.length for stretch in (before, after))
        guess = positions.copy()
        guess[:, self.axis] = new + (positions[:, self.axis] - old) * after / before
        return guess
