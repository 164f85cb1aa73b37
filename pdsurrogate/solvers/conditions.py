"""Conditions of a body: held points and planes, their positions at a value of the loading parameter, and the reaction forces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..body import Body
from ..body.body import sums_at_points
from ..forces import InternalForce, InvalidState
from ..forces.errors import at_point
from .loads import AT_REST, Loads
from .supports import SupportAtPlace, Supports

if TYPE_CHECKING:
    from .course import Paths, Pull

ONE_SIDED = 0.1
"""Horizons from a point to the middle of its neighbours, along a plane, from which it lies beside a free side: full horizons have it at the
point, halves 0.4 away."""


class FoldedOver(InvalidState):
    """A free side has bulged over the plane that it is bonded to, where it would lie against it."""


@dataclass(frozen=True)
class HeldPoints:
    """Points some components of which follow the loading parameter.

    Attributes
    ----------
    name : str
        Name of the condition in messages.
    holder : int or None
        Number of the holder that their force counts for; None where results do not report it.
    points : ndarray of int, shape (k,)
    components : tuple of int
    displacement : callable
        Displacement at a value of the parameter, shape (d,) or (k, d); only held components are read.
    support : SupportAtPlace, optional
        Support at a place: the point is one of several that move so only in the mean.
    """

    name: str
    holder: int | None
    points: np.ndarray
    components: tuple[int, ...]
    displacement: Callable[[float], np.ndarray]
    support: SupportAtPlace | None = None

    @property
    def every(self) -> np.ndarray:
        """Return the points, and for a support at a place also the others that are equally near."""
        return self.points if self.support is None else np.concatenate([self.points, self.support.others])


@dataclass(frozen=True)
class HeldPlane:
    """A plane of reflection that follows the loading parameter.

    Attributes
    ----------
    name : str
        Name in messages.
    holders : tuple of int or None
        By component: number of the holder that the force on the plane counts for.
    components : tuple of int
        Components that are held.
    displacement : callable
        Displacement at a value of the parameter, shape (d,); 0 in free components.
    turn : callable, optional
        Q - I at a value of the parameter, shape (d, d), of a plane that turns; all its components are held.  The place X of the plane at
        rest is then displaced by u(X) = displacement + turn X.
    """

    name: str
    holders: tuple[int | None, ...]
    components: tuple[int, ...]
    displacement: Callable[[float], np.ndarray]
    turn: Callable[[float], np.ndarray] | None = None

    def motion(self, parameter: float) -> np.ndarray:
        """Return [Q - I, displacement] at a value of the parameter, Q the rotation, shape (d, d + 1); see `displaced`."""
        displacement = self.displacement(parameter)
        motion = np.zeros((len(displacement), len(displacement) + 1))
        motion[:, -1] = displacement
        if self.turn is not None:
            motion[:, :-1] = self.turn(parameter)
        return motion


def displaced(motion: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the displacements u(X), shape (k, d), of places (k, d) by the motion (d, d + 1) of a plane."""
    return places @ motion[:, :-1].T + motion[:, -1]


@dataclass(frozen=True)
class Reactions:
    """Forces that holders exert on the body in the state last evaluated, in the plane per unit thickness.

    Attributes
    ----------
    forces : ndarray, shape (holders, d)
        Forces of the holders.
    on_planes : ndarray, shape (planes, d)
    at_points : ndarray, shape (n, d), or None
        Forces on held points, 0 in free components; None where no holder holds points.
    levers : ndarray, shape (planes, d, d), or None
        Sum over each plane of f (x) y, with the place y that a force f acts at; None where no plane turns.
    """

    forces: np.ndarray
    on_planes: np.ndarray
    at_points: np.ndarray | None
    levers: np.ndarray | None = None


def place_of(body: Body, point: int) -> str:
    """Return the place of a point, for messages."""
    return f"({', '.join(f'{coordinate:.4g}' for coordinate in body.points[point])})"


def moment_of(levers: np.ndarray) -> np.ndarray:
    """Return the moments of sums of f (x) y, shape (k, d, d): (k,) counter-clockwise in the plane, (k, 3) in three dimensions."""
    if levers.shape[-1] == 2:
        return levers[:, 1, 0] - levers[:, 0, 1]
    return np.stack([levers[:, 2, 1] - levers[:, 1, 2], levers[:, 0, 2] - levers[:, 2, 0], levers[:, 1, 0] - levers[:, 0, 1]], axis=1)


class Loading:
    """Conditions of a body: held points and planes, their positions at a value of the loading parameter, and the loads.

    Parameters
    ----------
    body : Body
    parameter : str
        Name of the loading parameter.
    rest : float
        Its value at rest.
    names : sequence of str
        Names of the holders, whose forces results report.
    planes : sequence of HeldPlane
        In the order of the body's.
    held : sequence of HeldPoints
        The force on a point that two entries hold counts for the later of them.
    loads : Loads or None

    Attributes
    ----------
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    supports : Supports or None
        Supports at places between points; None where there are none.
    course : Pull or Paths
        Paths on which the body follows the held parts; set once the conditions are known.
    parameter, rest, names, planes, held, loads
    """

    course: Pull | Paths

    def __init__(
        self,
        body: Body,
        parameter: str,
        rest: float,
        names: tuple[str, ...],
        planes: tuple[HeldPlane, ...],
        held: tuple[HeldPoints, ...],
        loads: Loads | None,
    ) -> None:
        self.body, self.parameter, self.rest, self.names, self.loads, self._share = body, parameter, rest, names, loads, body.share
        self.planes, self.held = planes, held
        at_places = tuple(part for part in held if part.support is not None)
        self.supports = Supports(body, at_places) if at_places else None
        self.free = np.ones((len(body), body.dimension))
        for part in held:
            for component in part.components:
                self.free[part.points, component] = 0

    def pieces(self, intact: np.ndarray | None = None) -> tuple[int, np.ndarray]:
        """Return the number of pieces into which bonds within the body join its points, and the piece of every point.

        Parameters
        ----------
        intact : ndarray of bool, shape (bonds,), optional
            Bonds that count; all by default.
        """
        bonds, n = self.body.bonds, len(self.body)
        within = bonds.second < n if intact is None else (bonds.second < n) & intact
        return self._share.pieces(bonds.first[within], bonds.second[within])

    def at(self, parameter: float) -> str:
        """Return words for a value of the parameter."""
        return f"t = {parameter:g}" if self.parameter == "t" else f"{self.parameter} {parameter:g}"

    def at_rest(self, parameter: float) -> bool:
        """Return whether, at a value of the parameter, everything held is in its place at rest and there are no loads."""
        shares = [np.abs(part.displacement(parameter)[..., list(part.components)]).max(initial=0.0) for part in self.held]
        motions = np.abs(self.plane_motions(parameter))
        shares += [motions[..., -1].max(initial=0.0), motions[..., :-1].max(initial=0.0) * self.body.spacing]
        moved = self._share.greatest(max(shares)) > AT_REST * self.body.extent
        return not moved and (self.loads is None or self.loads.vanish(parameter))

    @cached_property
    def beside_planes(self) -> list[np.ndarray]:
        """Points that have images in each plane."""
        ghosts = self.body.ghosts
        return [np.unique(ghosts.source[ghosts.plane == number]) for number in range(len(self.planes))]

    def plane_motions(self, parameter: float) -> np.ndarray:
        """Return the motions of all planes, see `HeldPlane.motion`, shape (p, d, d + 1)."""
        dimension = self.body.dimension
        return np.array([plane.motion(parameter) for plane in self.planes]).reshape(-1, dimension, dimension + 1)

    def apply(self, parameter: float, force: InternalForce, positions: np.ndarray) -> None:
        """Move everything that is held to where it is at a value of the parameter, and bring the loads to their size there."""
        self.hold(parameter, force, positions)
        if self.loads is not None:
            self.loads.set(parameter)

    def hold(self, parameter: float, force: InternalForce, positions: np.ndarray) -> None:
        """Move everything that is held to where it is at a value of the parameter."""
        for part in self.held:
            if part.support is None:
                displacement = part.displacement(parameter)
                for component in part.components:
                    positions[part.points, component] = self.body.points[part.points, component] + displacement[..., component]
        if self.supports is not None:
            self.supports.set(parameter)
            self.supports.place(positions)
        for number, plane in enumerate(self.planes):
            force.move_plane(number, plane.displacement(parameter), None if plane.turn is None else plane.turn(parameter))

    def unevenness(self, last: float, now: float, ahead: float) -> float:
        """Return the deviation of held parts from their velocity since the `last` value, relative to their way to a value `ahead`."""
        if now == last:
            return 0.0

        def places(parameter: float) -> np.ndarray:
            motions = [*(part.displacement(parameter) for part in self.held), self.plane_motions(parameter)]
            return np.concatenate([np.ravel(motion) for motion in motions])

        before, present, after = map(places, (last, now, ahead))
        way, evenly = after - present, (present - before) * ((ahead - now) / (now - last))
        off, *ways = (self._share.greatest(np.abs(change)) for change in (way - evenly, way, evenly))
        return off / max(ways) if off > 0 else 0.0

    def check_inside(self, parameter: float, force: InternalForce, positions: np.ndarray) -> None:
        """Check that no point is on the far side of a plane in which the body is reflected, where its own image belongs.

        Points without support are left out: nothing moves them.

        Raises
        ------
        InvalidState
            Names the point that is farthest beyond, and the plane.
        """
        supported = force.supported
        for plane, held in zip(self.body.planes, self.planes, strict=True):
            motion, (normal, place) = held.motion(parameter), np.zeros((2, self.body.dimension))
            normal[plane.axis], place[plane.axis] = 1.0, plane.position
            place += displaced(motion, place[None])[0]
            beyond = np.where(supported, plane.side * ((positions - place) @ (normal + motion[:, :-1] @ normal)), 0.0)
            worst, error = int(beyond.argmax()), None
            if beyond[worst] > 1e-6 * self.body.spacing:
                what = f"it lies {beyond[worst]:.3g} beyond the {held.name}, on the side of its own image"
                error = InvalidState(at_point(self.body, worst, what))
                if len(held.components) > 1 and self._beside_free_side(worst, plane.axis):
                    what += "; the free side beside it bulges over what it is bonded to, and would lie against it"
                    error = FoldedOver(at_point(self.body, worst, what))
            self.body.share.agree(error)

    def _beside_free_side(self, point: int, axis: int) -> bool:
        """Return whether the neighbours of a point lie to one side of it, along a plane that an axis is normal to."""
        bonds = self.body.bonds
        neighbours = bonds.neighbours[bonds.pointers[point] : bonds.pointers[point + 1]]
        arms = self.body.all_points[neighbours] - self.body.points[point]
        middle = np.average(arms, axis=0, weights=self.body.all_volumes[neighbours])
        return bool(np.linalg.norm(np.delete(middle, axis)) > ONE_SIDED * self.body.horizon)

    def reactions(self, force: InternalForce, on_points: np.ndarray | None = None) -> Reactions:
        """Return the forces of all holders on the body in the state last evaluated.

        The reaction at a held point balances the internal force and the loads there.  The reaction of a plane is the force that does work
        on its displacement: half the force of each bond to an image, times the displacement of the image per displacement of the plane,
        since an image on the other side has an equal bond.  For a single plane that is the sum over all bonds that cross it.

        Parameters
        ----------
        force : InternalForce
        on_points : ndarray, shape (n, d), optional
            Internal force and loads on every point in that state; summed from all pairs where they are not given.
        """
        bonds, planes, shares = self.crossing
        crossing, on_planes = force.pair_forces(bonds), np.zeros((len(self.planes), self.body.dimension))
        np.add.at(on_planes, planes, crossing * shares)
        levers = None
        if any(plane.turn is not None for plane in self.planes):
            levers = self._share.total(self._levers_on_planes(force, crossing))
        if on_points is None and self.held:
            on_points = self._on_points(force)
        return self.reactions_of(self._share.total(on_planes), levers, on_points)

    def reactions_of(self, on_planes: np.ndarray, levers: np.ndarray | None, on_points: np.ndarray | None) -> Reactions:
        """Return the forces of all holders from those on planes, with their levers, and from internal force and loads on every point."""
        forces, at_points = np.zeros((len(self.names), self.body.dimension)), None
        if self.held:
            at_points = -on_points * (1 - self.free)
            for part in self.held:
                if part.support is not None:
                    self.body.share.fill(at_points)
                    for component in part.components if len(part.points) else ():
                        at_points[part.support.others, component] = at_points[part.points, component]
            for part, owned in zip(self.held, self._owned, strict=True):
                for component, points in owned.items():
                    forces[part.holder, component] += at_points[points, component].sum()
            forces = self._share.total(forces)
        for number, plane in enumerate(self.planes):
            for component in plane.components:
                forces[plane.holders[component], component] += on_planes[number, component]
        return Reactions(forces, on_planes, at_points, levers)

    def moments(self, force: InternalForce, reactions: Reactions) -> np.ndarray:
        """Return the moments of the holders' forces about the origin of the coordinates.

        Moments on planes follow from virtual work if the force has an energy; otherwise a bond that crosses a plane acts at its middle.

        Returns
        -------
        ndarray
            Counter-clockwise moments per unit thickness in the plane, shape (holders,); vectors in three dimensions, shape (holders, 3).
        """
        positions, dimension = force.positions, self.body.dimension
        levers = np.zeros((len(self.names), dimension, dimension))
        if len(self.crossing[0]):
            on_planes = self._levers_on_planes(force, force.pair_forces(self.crossing[0]))
            for of_plane, plane in zip(on_planes, self.planes, strict=True):
                for component in plane.components:
                    levers[plane.holders[component], component] += of_plane[component]
        if reactions.at_points is not None:
            for part, owned in zip(self.held, self._owned, strict=True):
                for component, points in owned.items():
                    levers[part.holder, component] += reactions.at_points[points, component] @ positions[points]
        return moment_of(self._share.total(levers))

    def _levers_on_planes(self, force: InternalForce, crossing: np.ndarray) -> np.ndarray:
        """Return the sum of f (x) y over every plane, shape (planes, d, d), from the forces of the bonds that cross them, shape (k, d)."""
        levers = force.levers_on_planes()
        if levers is not None:
            return levers
        bonds, planes, shares = self.crossing
        pulls, ends = crossing * shares, self.body.bonds
        middles = (force.positions[ends.first[bonds]] + force.positions[ends.second[bonds]]) / 2
        levers = np.zeros((len(self.planes), self.body.dimension, self.body.dimension))
        np.add.at(levers, planes, pulls[:, :, None] * middles[:, None])
        return levers

    def _on_points(self, force: InternalForce) -> np.ndarray:
        """Return internal force and loads on every point in the state last evaluated, shape (n, d), carried as rigid regions do."""
        total = self.internal_forces(force)
        if self.loads is not None:
            self.loads.forces(force.positions[: len(self.body)], force.thickness(), total)
        for region in getattr(force, "rigid", ()):
            region.carry(force.positions, total)
        return total

    def internal_forces(self, force: InternalForce) -> np.ndarray:
        """Return the internal force on every point in the state last evaluated, shape (n, d)."""
        bonds = self.body.bonds
        total = sums_at_points(len(self.body), bonds.first, bonds.second, force.pair_forces(), -1)
        beside = force.forces_beside_pairs()
        return total if beside is None else total + beside

    @cached_property
    def _owned(self) -> list[dict[int, np.ndarray]]:
        """Points whose force counts for the holder, by condition and component; none where results do not report it."""
        owner = np.full((len(self.body), self.body.dimension), -1)
        for number, part in enumerate(self.held):
            for component in part.components:
                owner[part.every, component] = number
        owner[~self._share.own] = -1
        return [
            {} if part.holder is None else {c: part.every[owner[part.every, c] == number] for c in part.components}
            for number, part in enumerate(self.held)
        ]

    @cached_property
    def crossing(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bonds to images that planes move: their numbers, the planes, and half the image's displacement per displacement of the plane."""
        n, ghosts = len(self.body), self.body.ghosts
        outer = np.flatnonzero(self.body.bonds.second >= n)
        outer = outer[self._share.own[self.body.bonds.first[outer]]]
        levers = ghosts.lever[self.body.bonds.second[outer] - n]
        rows, planes = np.nonzero(levers.any(axis=2))
        return outer[rows], planes, levers[rows, planes] / 2

    def ends(self) -> list[np.ndarray]:
        """Return the points of this share that each holder holds directly."""
        return self._by_holder(self.beside_planes, [part.points for part in self.held])

    def _by_holder(self, at_planes: list[np.ndarray], at_points: list[np.ndarray]) -> list[np.ndarray]:
        """Return the points that each holder holds, from those of every plane and of every entry of `held`."""
        found: list[list[np.ndarray]] = [[] for _ in self.names]
        for points, plane in zip(at_planes, self.planes, strict=True):
            for holder in {plane.holders[component] for component in plane.components}:
                found[holder].append(points)
        for points, part in zip(at_points, self.held, strict=True):
            if part.holder is not None:
                found[part.holder].append(points)
        return [np.unique(np.concatenate(parts)) for parts in found]

    def displacements(self, parameter: float, positions: np.ndarray) -> np.ndarray:
        """Return the mean displacement of each holder, shape (holders, d): that of its points, or of the middle of its plane.

        Components in which a plane is free to move are the means over the points within a cell of it.
        """
        n = len(self.names)
        # Displacement, place and number of the points of each holder.
        sums = np.zeros((n, 2 * self.body.dimension + 1))
        for number, points in enumerate(self._beside):
            places = self.body.points[points]
            sums[number] = np.concatenate([(positions[points] - places).sum(axis=0), places.sum(axis=0), [len(points)]])
        sums = self._share.total(sums)
        means = sums[:, :-1] / np.maximum(sums[:, -1:], 1)
        found, places = np.split(means, 2, axis=1)
        for plane, held in zip(self.body.planes, self.planes, strict=True):
            motion = held.motion(parameter)
            for component in held.components:
                holder = held.holders[component]
                middle = places[holder].copy()
                middle[plane.axis] = plane.position
                found[holder, component] = displaced(motion, middle[None])[0, component]
        return found

    @cached_property
    def _beside(self) -> list[np.ndarray]:
        """Points that each holder holds directly; of a plane, those within a cell of it."""
        near = []
        for plane, sources in zip(self.body.planes, self.beside_planes, strict=True):
            near.append(sources[np.abs(self.body.points[sources, plane.axis] - plane.position) < self.body.cell[plane.axis]])
        return [points[self._share.own[points]] for points in self._by_holder(near, [part.every for part in self.held])]
