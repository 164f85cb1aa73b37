"""How a body is held and loaded: what every way of saying it has in common."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..body import Body
from ..forces import InternalForce, InvalidState
from ..forces.errors import at_point
from .motion import Motion
from .supports import SupportAtPlace, Supports

if TYPE_CHECKING:
    from .loads import Loads


AT_REST = 1e-14
"""Displacement over the extent of the body, or amplitude of a load, that counts as none: rounding leaves as much of a sine."""

ONE_SIDED = 0.1
"""Horizons from a point to the middle of its neighbours, along a plane, from which it lies beside a free side: full horizons have it at the
point, halves 0.4 away."""


class FoldedOver(InvalidState):
    """A free side has bulged over the plane that it is bonded to, where it would lie against it."""


@dataclass(frozen=True)
class HeldPoints:
    """Points of which some components follow the loading parameter.

    Attributes
    ----------
    name : str
        What messages call the condition.
    holder : int or None
        Number of the holder whose force theirs is; None where nobody asks for it.
    points : ndarray of int, shape (k,)
    components : tuple of int
    displacement : callable
        Displacement at a value of the parameter, shape (d,) or (k, d); only held components are read.
    support : SupportAtPlace, optional
        Of a support at a place: the point is one of several that move so in the mean alone.
    """

    name: str
    holder: int | None
    points: np.ndarray
    components: tuple[int, ...]
    displacement: Callable[[float], np.ndarray]
    support: SupportAtPlace | None = None

    @property
    def every(self) -> np.ndarray:
        """The points, and of a support at a place those that are as near."""
        return self.points if self.support is None else np.concatenate([self.points, self.support.others])


@dataclass(frozen=True)
class HeldPlane:
    """A plane of reflection that follows the loading parameter.

    Attributes
    ----------
    name : str
        What messages call it.
    holders : tuple of int or None
        By component: number of the holder whose force that of the plane is.
    components : tuple of int
        Held ones.
    displacement : callable
        Displacement at a value of the parameter, shape (d,); 0 in free components.
    turn : callable, optional
        Of a plane that turns, all components of which are held: Q - I at a value of the parameter, shape (d, d).  Then the place X of the
        plane at rest is displaced by u(X) = displacement + turn X.
    """

    name: str
    holders: tuple[int | None, ...]
    components: tuple[int, ...]
    displacement: Callable[[float], np.ndarray]
    turn: Callable[[float], np.ndarray] | None = None

    def motion(self, parameter: float) -> np.ndarray:
        """Turn and displacement as columns of one array, shape (d, d + 1); see `displaced`."""
        displacement = self.displacement(parameter)
        motion = np.zeros((len(displacement), len(displacement) + 1))
        motion[:, -1] = displacement
        if self.turn is not None:
            motion[:, :-1] = self.turn(parameter)
        return motion


def displaced(motion: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Displacement u(X), shape (k, d), of places (k, d) by the motion (d, d + 1) of a plane."""
    return places @ motion[:, :-1].T + motion[:, -1]


@dataclass(frozen=True)
class Reactions:
    """Forces on the body of all that holds it, in the plane per unit thickness, in the state last evaluated.

    Attributes
    ----------
    forces : ndarray, shape (holders, d)
        Of every holder.
    on_planes : ndarray, shape (planes, d)
    at_points : ndarray, shape (n, d), or None
        On held points, 0 in free components; None where no holder holds points.
    levers : ndarray, shape (planes, d, d), or None
        Of planes, sum of f (x) y with the place y that a force f acts at; None where no plane turns.
    """

    forces: np.ndarray
    on_planes: np.ndarray
    at_points: np.ndarray | None
    levers: np.ndarray | None = None


def place_of(body: Body, point: int) -> str:
    """Where a point is, for messages."""
    return f"({', '.join(f'{coordinate:.4g}' for coordinate in body.points[point])})"


def moment_of(levers: np.ndarray) -> np.ndarray:
    """Moments, shape (k,) counter-clockwise in the plane and (k, 3) in space, of sums of f (x) y, shape (k, d, d)."""
    if levers.shape[-1] == 2:
        return levers[:, 1, 0] - levers[:, 0, 1]
    return np.stack([levers[:, 2, 1] - levers[:, 1, 2], levers[:, 0, 2] - levers[:, 2, 0], levers[:, 1, 0] - levers[:, 0, 1]], axis=1)


class Loading(ABC):
    """The conditions of a scene on a body: what is held, and where it is at a value of the loading parameter.

    Parameters
    ----------
    body : Body
    names : sequence of str
        Of the holders: those whose forces are told.
    planes : sequence of HeldPlane
        In the order of the body's.
    held : sequence of HeldPoints
        The force on a point that two hold alike counts with the later of them.
    loads : Loads or None

    Attributes
    ----------
    parameter : str
        Name of the loading parameter.
    rest : float
        Its value at rest.
    adaptive : bool
        Whether increments of the parameter are made longer only where they are easy, and begin from the best of several guesses.
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    supports : Supports or None
        Those at places between points; None where there are none.
    names, loads
    """

    parameter: ClassVar[str]
    rest: ClassVar[float]
    adaptive: ClassVar[bool] = False

    def __init__(
        self,
        body: Body,
        names: tuple[str, ...],
        planes: tuple[HeldPlane, ...],
        held: tuple[HeldPoints, ...],
        loads: Loads | None,
    ) -> None:
        self.body, self.names, self.loads, self._share = body, names, loads, body.share
        self._planes, self._held = planes, held
        at_places = tuple(part for part in held if part.support is not None)
        self.supports = Supports(body, at_places) if at_places else None
        self.free = np.ones((len(body), body.dimension))
        for part in held:
            for component in part.components:
                self.free[part.points, component] = 0

    def _check_agreement(self, held: tuple[HeldPoints, ...], samples: tuple[float, ...]) -> None:
        """Refuse two conditions that move a point differently at one of some values of the parameter: it would go with the later one."""
        for component in range(self.body.dimension):
            for sample in samples:
                travel, holder = np.zeros(len(self.body)), np.full(len(self.body), -1)
                for number, part in enumerate(held):
                    if component not in part.components:
                        continue
                    goes = np.broadcast_to(part.displacement(sample)[..., component], len(part.points))
                    apart = np.abs(travel[part.points] - goes) > 1e-9 * self.body.spacing
                    twice = part.points[(holder[part.points] >= 0) & apart]
                    if len(twice):
                        raise ValueError(
                            f"{held[holder[twice[0]]].name} and {part.name} move point {twice[0]} at {place_of(self.body, twice[0])} "
                            f"differently along x{component + 1}"
                        )
                    travel[part.points], holder[part.points] = goes, number

    def _check_planes(self, keys: tuple[str, ...]) -> None:
        """Refuse planes that no bond crosses; `keys` name them."""
        for number, (key, plane) in enumerate(zip(keys, self._planes, strict=True)):
            if not self._share.any((self._levers[1] == number).any()):
                name, edge = plane.name.split()[0], "edge" if self.body.dimension == 2 else "face"
                raise ValueError(f"{key}: no bond of the body crosses its {name} {edge}; do holes take all that is there?")

    def pieces(self, intact: np.ndarray | None = None) -> tuple[int, np.ndarray]:
        """Into how many pieces bonds within the body join its points, and the piece of every point.

        Parameters
        ----------
        intact : ndarray of bool, shape (bonds,), optional
            Bonds that count; all by default.
        """
        bonds, n = self.body.bonds, len(self.body)
        within = bonds.second < n if intact is None else (bonds.second < n) & intact
        return self._share.pieces(n, bonds.first[within], bonds.second[within])

    def _remark_on_pieces(self, count: int) -> None:
        """Say that the body is in several pieces, each of which is held."""
        if count > 1 and self.body.share.leads:
            why = f"as where a cut goes all the way, or a wall is thinner than the spacing, {self.body.spacing:.3g}"
            warnings.warn(f"the body is in {count} pieces with no bonds between them, {why}; each is held by itself", stacklevel=2)

    def at(self, parameter: float) -> str:
        """Words for a value of the parameter."""
        return f"{self.parameter} {parameter:g}"

    def at_rest(self, parameter: float) -> bool:
        """Whether all that is held is where it is at rest at a value of the parameter, and there are no loads."""
        shares = [np.abs(part.displacement(parameter)[..., list(part.components)]).max(initial=0.0) for part in self._held]
        motions = [plane.motion(parameter) for plane in self._planes]
        shares += [max(np.abs(motion[:, -1]).max(), np.abs(motion[:, :-1]).max() * self.body.spacing) for motion in motions]
        moved = self._share.greatest(float(max(shares, default=0.0))) > AT_REST * self._share.extent(self.body.points)
        return not moved and (self.loads is None or self.loads.vanish(parameter))

    def apply(self, parameter: float, force: InternalForce, positions: np.ndarray) -> None:
        """Move everything that is held to where it is at a value of the parameter, and bring the loads to their size there."""
        self.hold(parameter, force, positions)
        if self.loads is not None:
            self.loads.set(parameter)

    def hold(self, parameter: float, force: InternalForce, positions: np.ndarray) -> None:
        """Move everything that is held to where it is at a value of the parameter."""
        for part in self._held:
            if part.support is None:
                displacement = part.displacement(parameter)
                for component in part.components:
                    positions[part.points, component] = self.body.points[part.points, component] + displacement[..., component]
        if self.supports is not None:
            self.supports.set(parameter)
            self.supports.place(positions)
        for number, plane in enumerate(self._planes):
            force.move_plane(number, plane.displacement(parameter), None if plane.turn is None else plane.turn(parameter))

    def unevenness(self, last: float, now: float, ahead: float) -> float:
        """Return by what share of its way to a value `ahead` what is held departs from its velocity since the `last` value."""
        if now == last:
            return 0.0

        def places(parameter: float) -> np.ndarray:
            motions = [*(part.displacement(parameter) for part in self._held), *(plane.motion(parameter) for plane in self._planes)]
            return np.concatenate([np.ravel(motion) for motion in motions]) if motions else np.zeros(1)

        before, present, after = map(places, (last, now, ahead))
        way, evenly = after - present, (present - before) * ((ahead - now) / (now - last))
        off, *ways = (self._share.greatest(np.abs(change).max(initial=0.0)) for change in (way - evenly, way, evenly))
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
        for plane, held in zip(self.body.planes, self._planes, strict=True):
            motion = held.motion(parameter)
            if held.turn is None:
                beyond = positions[:, plane.axis] - (plane.position + motion[plane.axis, -1])
            else:
                normal, place = np.zeros((2, self.body.dimension))
                normal[plane.axis], place[plane.axis] = 1.0, plane.position
                place += displaced(motion, place[None])[0]
                beyond = (positions - place) @ (normal + motion[:, :-1] @ normal)
            beyond = np.where(supported, plane.side * beyond, 0.0)
            worst, error = int(beyond.argmax()), None
            if beyond[worst] > 1e-6 * self.body.spacing:
                what = f"it lies {beyond[worst]:.3g} beyond the {held.name}, on the side of its own image"
                error = InvalidState(at_point(self.body, worst, what))
                if len(held.components) > 1 and self._beside_free_side(worst, plane.axis):
                    what += "; the free side beside it bulges over what it is bonded to, and would lie against it"
                    error = FoldedOver(at_point(self.body, worst, what))
            self.body.share.agree(error)

    def _beside_free_side(self, point: int, axis: int) -> bool:
        """Whether the neighbours of a point are on one side of it, along a plane that an axis is normal to."""
        bonds = self.body.bonds
        neighbours = bonds.neighbours[bonds.pointers[point] : bonds.pointers[point + 1]]
        arms = self.body.all_points[neighbours] - self.body.points[point]
        middle = np.average(arms, axis=0, weights=self.body.all_volumes[neighbours])
        return bool(np.linalg.norm(np.delete(middle, axis)) > ONE_SIDED * self.body.horizon)

    def reactions(self, force: InternalForce, on_points: np.ndarray | None = None) -> Reactions:
        """Forces of all holders on the body in the state last evaluated.

        On held points, what keeps the internal force and the loads there in balance.  On a plane, what works with its displacement: half
        of what every bond with an image pulls with, times the displacement of the image by that of the plane, since an image on the
        other side has a bond alike.  In a single plane that is the sum over all bonds that cross it.

        Parameters
        ----------
        force : InternalForce
        on_points : ndarray, shape (n, d), optional
            Internal force and loads on every point in that state; found from all pairs where they are not given.
        """
        bonds, planes, shares = self._levers
        crossing, dimension = force.pair_forces(bonds), self.body.dimension
        on_planes = np.zeros((len(self._planes), dimension))
        for component in range(dimension) if self._planes else ():
            on_planes[:, component] = np.bincount(planes, crossing[:, component] * shares[:, component], len(self._planes))
        levers = None
        if any(plane.turn is not None for plane in self._planes):
            levers = self._share.total(self._levers_on_planes(force, crossing))
        if on_points is None and self._holds_points:
            on_points = self._on_points(force)
        return self.reactions_of(self._share.total(on_planes), levers, on_points)

    @property
    def _holds_points(self) -> bool:
        return bool(self._held)

    def reactions_of(self, on_planes: np.ndarray, levers: np.ndarray | None, on_points: np.ndarray | None) -> Reactions:
        """Forces of all holders by those on planes, with their levers, and by internal force and loads on every point."""
        forces, at_points = np.zeros((len(self.names), self.body.dimension)), None
        if self._holds_points:
            at_points = -on_points * (1 - self.free)
            for part in self._held:
                if part.support is not None:
                    self.body.share.fill(at_points)
                    for component in part.components if len(part.points) else ():
                        at_points[part.support.others, component] = at_points[part.points, component]
            for part, owned in zip(self._held, self._owned, strict=True):
                for component, points in owned.items():
                    forces[part.holder, component] += at_points[points, component].sum()
            forces = self._share.total(forces)
        for number, plane in enumerate(self._planes):
            for component in plane.components:
                forces[plane.holders[component], component] += on_planes[number, component]
        return Reactions(forces, on_planes, at_points, levers)

    def moments(self, force: InternalForce, reactions: Reactions) -> np.ndarray:
        """Moments of the holders' forces about the origin of the coordinates.

        On planes by virtual work where the force has an energy; of others a bond that crosses a plane pulls at the middle between its ends.

        Returns
        -------
        ndarray
            In the plane counter-clockwise and per unit thickness, shape (holders,); in space vectors, shape (holders, 3).
        """
        positions, dimension = force.positions, self.body.dimension
        levers = np.zeros((len(self.names), dimension, dimension))
        if len(self._levers[0]):
            on_planes = self._levers_on_planes(force, force.pair_forces(self._levers[0]))
            for of_plane, plane in zip(on_planes, self._planes, strict=True):
                for component in plane.components:
                    levers[plane.holders[component], component] += of_plane[component]
        if reactions.at_points is not None:
            for part, owned in zip(self._held, self._owned, strict=True):
                for component, points in owned.items():
                    levers[part.holder, component] += reactions.at_points[points, component] @ positions[points]
        return moment_of(self._share.total(levers))

    def _levers_on_planes(self, force: InternalForce, crossing: np.ndarray) -> np.ndarray:
        """Of every plane the sum of f (x) y, shape (planes, d, d), from the forces of the bonds that cross them, shape (k, d)."""
        levers = force.levers_on_planes()
        if levers is not None:
            return levers
        bonds, planes, shares = self._levers
        pulls, ends = crossing * shares, self.body.bonds
        middles = (force.positions[ends.first[bonds]] + force.positions[ends.second[bonds]]) / 2
        levers = np.zeros((len(self._planes), self.body.dimension, self.body.dimension))
        for number in range(len(self._planes)):
            own = planes == number
            levers[number] = np.einsum("kr,kc->rc", pulls[own], middles[own])
        return levers

    def _on_points(self, force: InternalForce) -> np.ndarray:
        """Internal force and loads on every point in the state last evaluated, shape (n, d), carried as rigid regions do."""
        total = self.internal_forces(force)
        if self.loads is not None:
            self.loads.forces(force.positions[: len(self.body)], force.thickness(), total)
        if getattr(force, "rigid", None):
            force.carry(force.positions[: len(self.body)], total)
        return total

    def internal_forces(self, force: InternalForce) -> np.ndarray:
        """Internal force on every point in the state last evaluated, shape (n, d)."""
        n, bonds, pair_forces = len(self.body), self.body.bonds, force.pair_forces()
        within = bonds.second < n
        total = np.stack(
            [
                np.bincount(bonds.first, pair_forces[:, component], n)
                - np.bincount(bonds.second[within], pair_forces[within, component], n)
                for component in range(self.body.dimension)
            ],
            axis=1,
        )
        beside = force.forces_beside_pairs()
        return total if beside is None else total + beside

    @cached_property
    def _owned(self) -> list[dict[int, np.ndarray]]:
        """By condition and component, the points whose force counts with its holder; none where nobody asks."""
        owner = np.full((len(self.body), self.body.dimension), -1)
        for number, part in enumerate(self._held):
            for component in part.components:
                owner[part.every, component] = number
        return [
            {} if part.holder is None else {c: self._share.own_points(part.every[owner[part.every, c] == number]) for c in part.components}
            for number, part in enumerate(self._held)
        ]

    @cached_property
    def _levers(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bonds with images that planes move: number of the bond, of the plane, and half the image's displacement by that of the plane."""
        n, ghosts = len(self.body), self.body.ghosts
        outer = np.flatnonzero(self.body.bonds.second >= n)
        counted = self.body.share.counted_pairs(self.body.bonds.first[outer])
        outer = outer if counted is None else outer[counted]
        levers = ghosts.lever[self.body.bonds.second[outer] - n]
        rows, planes = np.nonzero(levers.any(axis=2))
        return outer[rows], planes, levers[rows, planes] / 2

    def ends(self) -> list[np.ndarray]:
        """Points that each holder holds directly, of those that are here."""
        found: list[list[np.ndarray]] = [[] for _ in self.names]
        ghosts = self.body.ghosts
        for number, plane in enumerate(self._planes):
            for holder in {plane.holders[component] for component in plane.components}:
                found[holder].append(ghosts.source[ghosts.plane == number])
        for part in self._held:
            if part.holder is not None:
                found[part.holder].append(part.points)
        return [np.concatenate(parts) for parts in found]

    def displacements(self, parameter: float, positions: np.ndarray) -> np.ndarray:
        """Mean displacement of what each holder holds, shape (holders, d): of its points, or of its plane in the middle.

        Components of a plane that are free to move are those of the points beside it, within a cell.
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
        for plane, held in zip(self.body.planes, self._planes, strict=True):
            motion = held.motion(parameter)
            for component in held.components:
                holder = held.holders[component]
                middle = places[holder].copy()
                middle[plane.axis] = plane.position
                found[holder, component] = displaced(motion, middle[None])[0, component]
        return found

    @cached_property
    def _beside(self) -> list[np.ndarray]:
        """Points that each holder holds directly, of planes those within a cell of it."""
        found: list[list[np.ndarray]] = [[] for _ in self.names]
        for number, (plane, held) in enumerate(zip(self.body.planes, self._planes, strict=True)):
            ghosts = self.body.ghosts
            sources = np.unique(ghosts.source[ghosts.plane == number])
            near = sources[np.abs(self.body.points[sources, plane.axis] - plane.position) < self.body.cell[plane.axis]]
            for holder in {held.holders[component] for component in held.components}:
                found[holder].append(near)
        for part in self._held:
            if part.holder is not None:
                found[part.holder].append(part.every)
        return [self._share.own_points(np.unique(np.concatenate(parts))) for parts in found]

    @abstractmethod
    def largest_increment(self, positions: np.ndarray, start: float, end: float, asked: float | None) -> float:
        """Greatest increment of the parameter to plan on the way from one value to another.

        Parameters
        ----------
        positions : ndarray, shape (n, d)
            In equilibrium at the start.
        start, end : float
        asked : float or None
            What the scene bounds it by.
        """

    @abstractmethod
    def guesses(self, positions: np.ndarray, before: float, after: float, earlier: tuple[float, np.ndarray] | None) -> list[np.ndarray]:
        """First guesses of an equilibrium, any of which may be the best.

        Parameters
        ----------
        positions : ndarray, shape (n, d)
            In equilibrium at the value `before` of the parameter.
        before, after : float
        earlier : tuple of float and ndarray, or None
            The equilibrium before that one.

        Raises
        ------
        TooFar
            If the step is longer than the first guess is good for.
        """

    @abstractmethod
    def velocities(self, positions: np.ndarray, motion: Motion) -> np.ndarray:
        """Velocities with which a body that has followed its conditions slowly goes on with them, shape (n, d)."""

    @abstractmethod
    def power(self, reactions: Reactions, motion: Motion, time: float, step: float) -> float:
        """Power of all that holds the body, in the plane per unit thickness, at the end of a time step."""

    @abstractmethod
    def greatest_speed(self, motion: Motion) -> float:
        """Greatest difference of the velocities of any two held parts, in a component, during a phase of dynamics."""

    @abstractmethod
    def growth(self, before: float, after: float) -> float | None:
        """Change of the body's extent between two values of the parameter; None where conditions do not tell it."""

    @abstractmethod
    def pushes(self, force: InternalForce) -> bool:
        """Whether the body may buckle in the state last evaluated, since it is under compression."""

    def reached(self, parameter: float) -> str:
        """How far conditions have come at a value of the parameter, for messages; empty where the value says it."""
        return ""
