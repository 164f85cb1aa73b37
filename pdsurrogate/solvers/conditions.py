"""How a body is held and pulled: reflected grips, and points held component by component."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..body import Body, ReflectionPlane
from ..forces import InternalForce, InvalidState
from ..forces.kinematics import at_point
from ..scenes.model import EDGES, Hold, Scene
from .reductions import LocalReductions


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


def _place(body: Body, point: int) -> str:
    x1, x2 = body.points[point]
    return f"({x1:.4g}, {x2:.4g})"


class Loading:
    """The conditions of a scene on a body: what is held, and where it is at a given stretch.

    Parameters
    ----------
    scene : Scene
    body : Body
    lower, upper : ndarray, shape (2,)
        Bounding box of the body.
    reductions : LocalReductions

    Attributes
    ----------
    axis : int
        Loaded direction.
    free : ndarray, shape (n, 2)
        1 where a component may move, 0 where it is held.

    Raises
    ------
    ValueError
        If a condition holds no point, two move a point differently, or a piece of the body is not held; names it.
    """

    def __init__(self, scene: Scene, body: Body, lower, upper, reductions: LocalReductions) -> None:
        self.scene, self.body, self._reductions = scene, body, reductions
        self.axis = scene.loaded_axis
        self.lower, self.length = lower[self.axis], upper[self.axis] - lower[self.axis]
        self._held = [self._region(number, hold) for number, hold in enumerate(scene.holds)]
        if scene.support == "points":
            self._held += [self._edge(grip, lower, upper) for grip in scene.grips]
        self.free = np.ones((len(body), 2))
        for held in self._held:
            for component in held.components:
                self.free[held.points, component] = 0
        self._check_agreement()
        self._check_pieces()

    def _check_agreement(self) -> None:
        """Refuse two conditions that move a point differently: it would go with the later one."""
        names = [f"holds.{number}" for number in range(len(self.scene.holds))] + [f"the {grip.edge} grip" for grip in self.scene.grips]
        for component in range(2):
            travel, holder = np.zeros(len(self.body)), np.full(len(self.body), -1)
            for number, held in enumerate(self._held):
                if component not in held.components:
                    continue
                twice = (holder[held.points] >= 0) & (travel[held.points] != held.travel[component])
                if twice.any():
                    point = held.points[twice][0]
                    raise ValueError(
                        f"{names[holder[point]]} and {names[number]} move point {point} at {_place(self.body, point)} differently along "
                        f"x{component + 1}"
                    )
                travel[held.points], holder[held.points] = held.travel[component], number

    def _check_pieces(self) -> None:
        """Refuse grips that reach no point, and pieces of the body that nothing holds along the loaded axis."""
        bonds, n = self.body.bonds, len(self.body)
        if self.scene.support == "reflected":
            for number, grip in enumerate(self.scene.grips):
                if not (self._outer_planes == number).any():
                    raise ValueError(f"grips.{number}: no bond of the body crosses its {grip.edge} edge; do holes take all that is there?")
        within = bonds.second < n
        count, piece = self._reductions.pieces(n, bonds.first[within], bonds.second[within])
        held = np.zeros(count, dtype=bool)
        held[piece[self.free[:, self.axis] == 0]] = True
        held[piece[bonds.first[~within]]] = True  # by a grip's plane
        if not held.all():
            loose = np.flatnonzero(piece == np.flatnonzero(~held)[0])
            raise ValueError(
                f"body: it is in {count} pieces, and one of {len(loose)} points, at {_place(self.body, loose[0])}, is held by no grip; "
                "a hole or precut separates it, or a hold is missing"
            )

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
        points = np.flatnonzero(distance < 0.99 * self.body.cell[axis])
        if len(points) == 0:
            raise ValueError(f"grips: no point lies within one cell of the {grip.edge} edge")
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
        supported = force.supported
        for plane, grip in zip(self.body.planes, self.scene.grips, strict=True):
            place = plane.position + self._travel(grip)[plane.axis] * (stretch - 1) * self.length
            beyond = np.where(supported, plane.side * (positions[:, plane.axis] - place), 0.0)
            worst = int(beyond.argmax())
            if beyond[worst] > 1e-6 * self.body.spacing:
                what = f"it lies {beyond[worst]:.3g} beyond the {grip.edge} grip, on the side of its own image"
                raise InvalidState(at_point(self.body, worst, what))

    def reactions(self, force: InternalForce) -> np.ndarray:
        """Force of every grip on the body in the state last evaluated, per unit thickness, shape (2, 2): grips, components."""
        pair_forces, bonds, grips = force.pair_forces(), self.body.bonds, range(len(self.scene.grips))
        if self.scene.support == "reflected":
            # What the far side of the plane exerts: all bonds that cross it.
            crossing, planes = pair_forces[self._outer_pairs], self._outer_planes
            forces = np.stack([np.bincount(planes, crossing[:, component], len(grips)) for component in (0, 1)], axis=1)
            return self._reductions.total_of_parts(forces)
        # Points held by a grip take from it what their bonds pull with, in the components that it holds.
        n, within = len(self.body), bonds.second < len(self.body)
        internal = np.stack(
            [
                np.bincount(bonds.first, pair_forces[:, component], n)
                - np.bincount(bonds.second[within], pair_forces[within, component], n)
                for component in (0, 1)
            ],
            axis=1,
        )
        reactions = np.zeros((len(grips), 2))
        for grip, held in zip(grips, self._held[len(self.scene.holds) :], strict=True):
            for component in held.components:
                reactions[grip, component] = -internal[held.points, component].sum()
        return self._reductions.total_of_parts(reactions)

    def pull(self, reactions: np.ndarray) -> float:
        """Force of the grips along the load per unit thickness, from their `reactions`; negative where they push."""
        return float((reactions * self.travels()).sum())

    def travels(self) -> np.ndarray:
        """Displacement of every grip for a unit of elongation, shape (2, 2): grips, components."""
        return np.array([self._travel(grip) for grip in self.scene.grips])

    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Points that each grip holds directly."""
        if self.scene.support == "points":
            low, high = self._held[len(self.scene.holds) :]
            return low.points, high.points
        ghosts = self.body.ghosts
        low, high = (ghosts.source[ghosts.plane == plane] for plane in range(2))
        return low, high

    @cached_property
    def _outer_pairs(self) -> np.ndarray:
        return np.flatnonzero(self.body.bonds.second >= len(self.body))

    @cached_property
    def _outer_planes(self) -> np.ndarray:
        return self.body.ghosts.plane[self.body.bonds.second[self._outer_pairs] - len(self.body)]

    def stretched(self, positions: np.ndarray, before: float, after: float) -> np.ndarray:
        """First guess: positions stretched along the loaded axis between the grips."""
        lower_grip = next(grip for grip in self.scene.grips if EDGES[grip.edge][1] < 0)
        travel = self._travel(lower_grip)[self.axis]
        old, new = (self.lower + travel * (stretch - 1) * self.length for stretch in (before, after))
        guess = positions.copy()
        guess[:, self.axis] = new + (positions[:, self.axis] - old) * after / before
        return guess
