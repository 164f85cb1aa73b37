"""Two opposite grips that move apart, the short way of saying a loading: its parameter is the stretch."""

from __future__ import annotations

from functools import partial

import numpy as np

from ..body import Body
from ..forces import InternalForce
from ..scenes.model import EDGES, Grip, Hold, Scene
from .conditions import HeldPlane, HeldPoints, Loading, Reactions, place_of
from .motion import Motion
from .regions import along_edge


class GripLoading(Loading):
    """The grips and holds of a scene: everything held moves in proportion to the elongation of the body.

    Parameters
    ----------
    scene : Scene
    body : Body
    lower, upper : ndarray, shape (d,)
        Bounding box of the body.

    Attributes
    ----------
    axis : int
        Loaded direction.
    length : float
        Of the undeformed body between the grips.

    Raises
    ------
    ValueError
        If a condition holds no point, two move a point differently, or a piece of the body is not held; names it.
    """

    parameter, rest = "stretch", 1.0

    def __init__(self, scene: Scene, body: Body, lower, upper) -> None:
        self.scene, self.axis = scene, scene.loaded_axis
        self.lower, self.length = lower[self.axis], upper[self.axis] - lower[self.axis]
        held = [self._region(number, hold, body) for number, hold in enumerate(scene.holds)]
        planes = []
        for number, grip in enumerate(scene.grips):
            axis = EDGES[grip.edge][0]
            components = (axis,) if grip.holds == "normal" else tuple(range(body.dimension))
            displacement = partial(self._moved, self._travel(grip))
            if scene.support == "reflected":
                planes.append(HeldPlane(f"{grip.edge} grip", (number,) * body.dimension, components, displacement))
                continue
            points = np.flatnonzero(along_edge(body, grip.edge, lower, upper).inside)
            if not body.share.any(len(points)):
                raise ValueError(f"grips: no point lies within one cell of the {grip.edge} edge")
            held.append(HeldPoints(f"the {grip.edge} grip", number, points, components, displacement))
        names = tuple(grip.edge for grip in scene.grips)
        super().__init__(body, names, tuple(planes), tuple(held), None)
        self._check_agreement(self._held, (2.0,))
        self._check_planes(tuple(f"grips.{number}" for number in range(len(planes))))
        self._check_pieces()

    def _check_pieces(self) -> None:
        """Refuse pieces of the body that nothing holds along the loaded axis."""
        bonds, (count, piece) = self.body.bonds, self.pieces()
        held = np.zeros(count, dtype=bool)
        held[piece[self.free[:, self.axis] == 0]] = True
        held[piece[bonds.first[bonds.second >= len(self.body)]]] = True  # by a grip's plane
        held = self._share.total(held.astype(np.int64)) > 0
        if not held.all():
            loose = self._share.own_points(np.flatnonzero(piece == np.flatnonzero(~held)[0]))
            size = self._share.total(len(loose))
            where = f", at {place_of(self.body, loose[0])}," if len(loose) else ""
            raise ValueError(
                f"body: it is in {count} pieces, and one of {size} points{where} is held by no grip; "
                "a hole or precut separates it, or a hold is missing"
            )
        self._remark_on_pieces(count)

    def _region(self, number: int, hold: Hold, body: Body) -> HeldPoints:
        try:
            points = points_of_hold(hold, body)
        except ValueError as error:
            raise ValueError(f"holds.{number}: {error}") from None
        components = tuple(range(body.dimension)) if hold.components is None else tuple(int(name[1:]) - 1 for name in hold.components)
        travel = np.zeros(body.dimension) if hold.travel is None else np.array(hold.travel)
        return HeldPoints(f"holds.{number}", None, points, components, partial(self._moved, travel))

    def _travel(self, grip: Grip) -> np.ndarray:
        axis, side = EDGES[grip.edge]
        travel = np.zeros(self.scene.dimension)
        travel[axis] = side * grip.travel
        return travel

    def _moved(self, travel: np.ndarray, stretch: float) -> np.ndarray:
        """Displacement at a stretch of what moves by `travel` for a unit of elongation."""
        return travel * ((stretch - 1) * self.length)

    def pull(self, reactions: Reactions) -> float:
        """Force of the grips along the load, in the plane per unit thickness; negative where they push."""
        return float((reactions.forces * self._travels()).sum())

    def _travels(self) -> np.ndarray:
        """Displacement of every grip for a unit of elongation, shape (2, d): grips, components."""
        return np.array([self._travel(grip) for grip in self.scene.grips])

    def largest_increment(self, positions, start, end, asked):
        return asked

    def guesses(self, positions, before, after, earlier):
        """Positions stretched along the loaded axis between the grips."""
        return [self.stretched(positions, before, after)]

    def stretched(self, positions: np.ndarray, before: float, after: float) -> np.ndarray:
        """Positions at one stretch stretched along the loaded axis to another."""
        lower_grip = next(grip for grip in self.scene.grips if EDGES[grip.edge][1] < 0)
        travel = self._travel(lower_grip)[self.axis]
        old, new = (self.lower + travel * (stretch - 1) * self.length for stretch in (before, after))
        guess = positions.copy()
        guess[:, self.axis] = new + (positions[:, self.axis] - old) * after / before
        return guess

    def velocities(self, positions, motion: Motion):
        """Of a homogeneous extension, so that the grips send no shock."""
        ahead = self.stretched(positions, motion.begin, motion.begin + 1e-6)
        return (ahead - positions) / 1e-6 * motion.rate

    def power(self, reactions, motion: Motion, time, step):
        return self.pull(reactions) * (motion.rate * self.length)

    def greatest_speed(self, motion: Motion):
        """Of the two grips from each other."""
        return motion.rate * self.length

    def growth(self, before, after):
        return abs(after - before) * self._share.extent(self.body.points)

    def pushes(self, force: InternalForce):
        return self.pull(self.reactions(force)) < 0


def points_of_hold(hold: Hold, body: Body) -> np.ndarray:
    """Numbers of the points here that a hold is of.

    Raises
    ------
    ValueError
        If there are none in the body, or one of them is not there.
    """
    if hold.points is not None:
        points, size = np.array(hold.points), body.share.size(len(body))
        if points.size and points.max() >= size:
            raise ValueError(f"there is no point {points.max()}; the body has {size}")
        points = body.share.local(points)
    else:
        low, high = np.array(hold.box)
        points = np.flatnonzero(((body.points >= low) & (body.points <= high)).all(axis=1))
    if not body.share.any(len(points)):
        raise ValueError("no point of the body lies in its region")
    return points
