"""Boundary conditions of a body: held points and reflection planes, and their positions along the
loading.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache, partial
from typing import NamedTuple

import numpy as np

from ..body import Body, Mirror
from ..forces import InternalForce, InvalidState
from ..forces.errors import at_point
from .held import Held, Support
from .loads import AT_REST, Loads
from .obstacles import PASSED, TOUCHING, Obstructed
from .rigid import displaced, nearest_turn, rigid_placement

MOST_MOTIONS = 8
"""Number of values of the loading parameter at which `Loading` keeps the motions of all held parts.
A step of dynamics asks some twenty times for the motions at five values.
"""

ON_A_PLANE = 1e-6
"""Distance from a reflection plane, in spacings, within which a point counts as lying in the plane.
Chosen above the rounding of coordinates in single precision, and far below a spacing.
"""


class FoldedOver(InvalidState):
    """Error for a body that has bulged beyond the plane of a grip: contact there is not computed.

    A grip is a reflection plane of which more than one component is held, unlike a plane of
    symmetry.
    """


class Loading:
    """Boundary conditions of a body: held points and reflection planes, their positions along the
    loading, and the loads.

    Parameters
    ----------
    body : Body
    parameter : str
        Name of the loading parameter.
    rest : float
        Value of the loading parameter for the undeformed body.
    names : sequence of str
        Names of the holders: the supports under whose names results report forces. A holder may
        consist of several held parts.
    planes : sequence of str
        Names of the reflection planes in messages, in the order of `Body.planes`.
    held : sequence of Held
        Parts of the body with prescribed motion. The force on a point that two parts hold counts
        for the later part; no two parts hold the same component of a plane.
    loads : Loads

    Attributes
    ----------
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    part, component, point, plane, place : ndarray, shape (k,), the last (k, d)
        Table of the k held components: number of the part in `held`, component, point, plane (-1
        where a point itself is held), and the place in the undeformed body whose motion is
        prescribed.
    at_points : ndarray of bool, shape (k,)
        True where a point itself is held, False where a plane is.
    there : tuple of ndarray of int
        Points and components where points themselves are held, to index arrays (n, d).
    plane_components : ndarray of bool, shape (planes, d)
        True for the held components of each plane.
    turning : set of int
        Numbers of the planes that turn.
    supports : list of Support
        Supports at places between points.
    motions, motions_at : callable
        ``motions(parameters)`` returns the `Motions` at values (k,) of the parameter,
        ``motions_at(parameter)`` those at one value.
    course : Paths
        Object that computes first guesses, initial velocities and the power of supports; set by the
        caller after construction.
    parameter, rest, names, planes, held, loads
    """

    def __init__(
        self,
        body: Body,
        parameter: str,
        rest: float,
        names: tuple[str, ...],
        planes: list[str],
        held: list[Held],
        loads: Loads,
    ) -> None:
        self.body = body
        self.parameter = parameter
        self.rest = rest
        self.names = names
        self.loads = loads
        self._share = body.share
        self.planes = planes
        self.held = held
        self.supports = [Support(body, part) for part in held if part.others is not None]
        self.of_points = [part for part in held if part.plane is None]
        self.of_planes = [part for part in held if part.plane is not None]
        self.turning = {part.plane for part in self.of_planes if part.angle is not None}
        self.plane_components = np.zeros((len(planes), body.dimension), dtype=bool)
        for part in self.of_planes:
            self.plane_components[part.plane, part.components] = True
        rows = [(np.zeros(0, dtype=int),) * 4 + (np.zeros((0, body.dimension)),)]
        for number, part in enumerate(held):
            places = np.broadcast_to(part.places, (len(part.points), body.dimension))
            for component in part.components:
                numbers = number, component, -1 if part.plane is None else part.plane
                rows.append(
                    (*(np.full(len(places), value) for value in numbers), part.points, places)
                )
        self.part, self.component, self.plane, self.point, self.place = map(
            np.concatenate, zip(*rows, strict=True)
        )
        self.at_points = self.plane < 0
        self.there = self.point[self.at_points], self.component[self.at_points]
        self.free = np.ones((len(body), body.dimension))
        self.free[self.there] = 0
        self.places_there = body.points[self.there]
        of_points = self.part[self.at_points], self.component[self.at_points]
        turn = any(part.angle is not None for part in self.of_points)
        of_planes = np.zeros((len(planes), body.dimension), dtype=int)
        for number, part in enumerate(held):
            if part.plane is not None:
                of_planes[part.plane, part.components] = number
        of_planes = of_planes[self.plane_components], *np.nonzero(self.plane_components)
        places = self.place[self.at_points] if turn else None
        self.motions = partial(
            _motions_at, held, len(planes), body.dimension, of_planes, of_points, places
        )
        self.motions_at = lru_cache(maxsize=MOST_MOTIONS)(partial(_first, self.motions))

    def pieces(self, intact: np.ndarray | None = None) -> tuple[int, np.ndarray]:
        """Return the number of connected pieces of the body, and the number of the piece of every
        point; bonds to images do not connect.

        Parameters
        ----------
        intact : ndarray of bool, shape (bonds,), optional
            True for the bonds that connect points; all by default.
        """
        bonds = self.body.bonds
        ends = (bonds.first, bonds.second)
        return self._share.pieces(*(ends if intact is None else (end[intact] for end in ends)))

    def at(self, parameter: float) -> str:
        """Return a value of the loading parameter with its name, as text for messages."""
        return f"t = {parameter:g}" if self.parameter == "t" else f"{self.parameter} {parameter:g}"

    def moves(self, parameter: float, places: np.ndarray | None = None) -> np.ndarray:
        """Return the prescribed displacements of all k held components at a value of the loading
        parameter, shape (k,).

        They are the displacements of the held places or, if given, of other `places` (k, d) of the
        undeformed body in the same motions.
        """
        return _moves(
            self.motions_at(parameter).of_parts,
            self.part,
            self.component,
            self.place if places is None else places,
        )

    def plane_motions(self, parameter: float) -> np.ndarray:
        """Return the motions of all reflection planes at a value of the loading parameter, shape
        (planes, d, d + 1).

        A motion is the matrix [Q - I, c] of a rotation Q and a translation c (see `Held`), with 0
        in free components. The array is not to be changed.
        """
        return self.motions_at(parameter).of_planes

    def planes_at(self, parameter: float) -> np.ndarray:
        """Return the positions of planes of symmetry at a value of the loading parameter, see
        `Loads.planes`.
        """
        moved = self.plane_motions(parameter)[:, :, -1] * self.loads.normals
        return self.loads.at_rest + moved.sum(axis=1)

    def at_rest(self, parameter: float) -> bool:
        """Return whether all held parts are in their undeformed places and all loads are zero,
        at a value of the loading parameter.
        """
        moved = self._share.greatest(np.abs(self.moves(parameter))) > AT_REST * self.body.extent
        return not moved and self.loads.vanish(parameter)

    def deforms(self, parameter: float, positions: np.ndarray) -> bool:
        """Return whether the prescribed motions of a connected piece agree, to rounding, with no
        rigid motion, at a value of the parameter.

        It tells rigid motions from strains so small that they are lost in the rounding of the
        `positions` (n, d).
        """
        share = self._share
        at_rest = self.body.points
        moves = self.moves(parameter)
        count, piece = self.pieces()
        table = [
            share.joined(rows, self.point)
            for rows in (piece[self.point], self.component, self.place, moves)
        ]
        error = AT_REST * (share.greatest(np.abs(at_rest)) + share.greatest(np.abs(moves)))
        for number in range(count):
            own = share.own & (piece == number)
            size = share.total(int(own.sum()))
            before, after = (
                share.total(places[own].sum(axis=0)) / size for places in (at_rest, positions)
            )
            turn = nearest_turn(share.total((positions[own] - after).T @ (at_rest[own] - before)))
            component, places, moved = (rows[table[0] == number] for rows in table[1:])
            arms = places - before
            held = (np.arange(len(places)), component)
            if (
                rigid_placement(
                    arms, held, arms[held] + moved, after - before, turn, self.body.extent
                )[1]
                > error
            ):
                return True
        return False

    def apply(self, parameter: float, force: InternalForce, positions: np.ndarray) -> None:
        """Move held points (in `positions`) and planes (in `force`) to their places at a value
        of the parameter, and set the loads.
        """
        self.hold(parameter, force, positions)
        self.loads.set(parameter)

    def hold(self, parameter: float, force: InternalForce, positions: np.ndarray) -> None:
        """Move held points, in `positions`, and reflection planes, in `force`, to their places
        at a value of the loading parameter.
        """
        motions = self.motions_at(parameter)
        positions[self.there] = self.places_there + motions.of_points
        for support in self.supports:
            support.set(parameter)
            support.place(positions)
        if len(self.planes):
            force.move_planes(motions.of_planes)
            self.loads.planes[:] = self.planes_at(parameter)

    def changes_of_rate(
        self, before: Motions, present: Motions, after: Motions, ratio: np.ndarray
    ) -> list[np.ndarray]:
        """Return the greatest differences (k,) between prescribed displacements from `present` to
        `after` and those extrapolated from the time before, `ratio` (k, 1) times as long; and the
        greatest of each. In a divided body there is one time.
        """
        way = after.of_all - present.of_all
        evenly = (present.of_all - before.of_all) * ratio
        found = [np.abs(one).max(axis=1, initial=0.0) for one in (way - evenly, way, evenly)]
        if self._share.divided:
            found = [np.array([self._share.greatest(one)]) for one in found]
        return found

    def check_inside(
        self,
        parameter: float,
        force: InternalForce,
        positions: np.ndarray,
        broken: np.ndarray | None = None,
    ) -> list[str]:
        """Check that no point has crossed a reflection plane to the side of its own image, and that
        none lies deep in an obstacle; return the names of planes that pieces torn off them have
        crossed, where bonds have `broken` (flags, shape (bonds,)); contact there is not computed.

        Points whose bonds do not determine a deformation gradient (False in `force.supported`) are
        not checked.

        Raises
        ------
        InvalidState
            If a point has crossed, or an obstacle has passed the boundary; the message names the
            farthest point, and the plane or obstacle.
        FoldedOver
            If the plane is held along itself too, so that a free side can bulge over it.
        """
        for obstacle in self.loads.obstacles:
            depths = -obstacle.gaps(positions)[0] - PASSED * self.body.spacing
            error = None
            if (deepest := int(depths.argmax())) >= 0 and depths[deepest] > 0:
                what = (
                    f"it lies in the obstacle {obstacle.name}, which has passed the boundary of the"
                    " body"
                )
                error = Obstructed(at_point(self.body, deepest, what))
            self.body.share.agree(error)
            obstacle.check_barred(positions)
        supported = force.supported
        passed = []
        planes = zip(self.planes, self.body.planes, self.plane_motions(parameter), strict=True)
        for number, (name, plane, motion) in enumerate(planes):
            beyond = supported * self._beyond(number, motion, positions, np.arange(len(positions)))
            self._check_held(name, plane, motion)
            if broken is not None and self._share.any(bool((beyond > 0).any())):
                off = self._torn_off(number, broken)
                if self._share.any(bool((beyond[off] > 0).any())):
                    passed.append(name)
                beyond[off] = 0.0
            worst = int(beyond.argmax())
            error = None
            if beyond[worst] > 0:
                what = (
                    f"it lies {beyond[worst]:.3g} beyond the {name}, on the side of its own image"
                )
                kind = InvalidState
                if plane.axis is not None and self.plane_components[number].sum() > 1:
                    kind = FoldedOver
                    what += "; the body bulges over what it is bonded to, and would lie against it"
                error = kind(at_point(self.body, worst, what))
            self.body.share.agree(error)
        return passed

    def _beyond(
        self, number: int, motion: np.ndarray, positions: np.ndarray, points: np.ndarray
    ) -> np.ndarray:
        """Return how far `points` (k,) lie beyond a plane that has moved, 0 for others, shape
        (k,).
        """
        plane, ghosts = self.body.planes[number], self.body.ghosts
        places = positions[points]
        # In the frame in which the plane has not moved.
        back = places - motion[:, -1]
        if number in self.turning:
            back = np.linalg.solve(np.eye(self.body.dimension) + motion[:, :-1], back.T).T
        beyond = -plane.mirrored(back)[1]
        beyond[beyond <= ON_A_PLANE * self.body.spacing] = 0.0
        if plane.axis is None:
            beyond[~np.isin(points, ghosts.source[ghosts.plane == number])] = 0.0
        # An obstacle pushes back a point that has entered it as far as it has crossed the plane.
        for obstacle in self.loads.obstacles:
            beyond[beyond <= ON_A_PLANE * self.body.spacing - obstacle.gaps(places)[0]] = 0.0
        return beyond

    def _joined_to(self, plane: int, intact: np.ndarray) -> np.ndarray:
        """Return the points that intact bonds join to images beyond a plane."""
        bonds, ghosts = self.body.bonds, self.body.ghosts
        outer = np.flatnonzero(intact & (bonds.second >= len(self.body)))
        return bonds.first[outer[ghosts.plane[bonds.second[outer] - len(self.body)] == plane]]

    def _torn_off(self, plane: int, broken: np.ndarray) -> np.ndarray:
        """Return flags of the points that nothing joins to a plane: those of pieces that no intact
        bond joins to images beyond it, and torn ones that have no such bond themselves.
        """
        bonds = self.body.bonds
        joined = self._joined_to(plane, ~broken)
        _, piece = self.pieces(~broken)
        held = np.concatenate(self._share.everywhere(np.unique(piece[joined])))
        torn = np.zeros(len(self.body.all_points), dtype=bool)
        torn[bonds.first[broken]] = torn[bonds.second[broken]] = True
        torn[joined] = False
        return ~np.isin(piece, held) | torn[: len(self.body)]

    def swung_through(
        self, parameter: float, positions: np.ndarray, torn: np.ndarray, broken: np.ndarray
    ) -> np.ndarray:
        """Return the numbers of those `torn` points, which have lost bonds, that lie beyond a plane
        to which others of their bonds join them.
        """
        found = [np.empty(0, dtype=np.int64)]
        for number, motion in enumerate(self.plane_motions(parameter)):
            crossed = torn[self._beyond(number, motion, positions, torn) > 0]
            if len(crossed):
                found.append(np.intersect1d(crossed, self._joined_to(number, ~broken)))
        return np.unique(np.concatenate(found))

    def _check_held(self, name: str, plane: Mirror, motion: np.ndarray) -> None:
        """Raise Obstructed if an obstacle has entered the part of the boundary that a bonded
        plane or held boundary prescribes.
        """
        if not self.loads.obstacles or max(plane.parity) > 0:
            return
        feet, depths = plane.mirrored(self.body.points)
        feet = feet[depths < self.body.cell.max()]
        for obstacle in self.loads.obstacles:
            gaps, _ = obstacle.gaps(feet + displaced(motion, feet))
            deepest = self.body.share.greatest(np.maximum(-gaps, 0.0))
            if deepest > TOUCHING * self.body.spacing:
                raise Obstructed(
                    f"the obstacle {obstacle.name} lies {deepest:.3g} inside the {name}, whose"
                    " motion is prescribed"
                )

    @cached_property
    def rows_of_planes(self) -> list[tuple[int, int, np.ndarray]]:
        """Holder, plane and mask (d,) of the components that count for the holder, for each part
        of a plane.

        Components that nothing holds, which have couples alone, count for who holds the plane
        across.
        """
        found = []
        for part in self.of_planes:
            rows = np.isin(np.arange(self.body.dimension), part.components)
            if self.body.planes[part.plane].axis in part.components:
                rows |= ~self.plane_components[part.plane]
            found.append((part.holder, part.plane, rows))
        return found

    @cached_property
    def counted(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Components of held points whose reactions this rank adds to their holders' forces:
        arrays of holders, points and components.
        """
        holder = np.full(self.free.shape, -1)
        for part in self.of_points:
            holder[part.every[:, None], part.components] = (
                -1 if part.holder is None else part.holder
            )
        holder[~self._share.own] = -1
        there = np.nonzero(holder >= 0)
        return holder[there], *there

    def ends(self, intact: np.ndarray | None = None) -> list[np.ndarray]:
        """Return, for each holder, the points on this rank, halo included, that it holds; for a
        plane the points with images in it, or those that bonds (True in `intact`) join to one.
        """
        return self._by_holder(
            [
                part.points if intact is None or part.plane is None else self._joined(part, intact)
                for part in self.held
            ]
        )

    def _joined(self, part: Held, intact: np.ndarray) -> np.ndarray:
        """Return the points that intact bonds join to images in the plane of a part."""
        body = self.body
        bonds = body.bonds
        outer = np.flatnonzero(intact & (bonds.second >= len(body)))
        sources = body.points[body.ghosts.source[bonds.second[outer] - len(body)]]
        feet = body.planes[part.plane].mirrored(sources)[0]
        off = 2 * feet - sources - body.all_points[bonds.second[outer]]
        return bonds.first[outer[np.abs(off).max(axis=1, initial=0.0) < body.spacing / 4]]

    def _by_holder(self, points: list[np.ndarray]) -> list[np.ndarray]:
        """Return one array with the points of each holder, from `points`, which has one array
        for each entry of `held`.
        """
        holders = np.repeat(
            [-1 if part.holder is None else part.holder for part in self.held],
            [len(numbers) for numbers in points],
        )
        every = np.concatenate([np.zeros(0, dtype=int), *points])
        return [np.unique(every[holders == number]) for number in range(len(self.names))]

    def displacements(self, parameter: float, positions: np.ndarray) -> np.ndarray:
        """Return the mean displacement of each holder, shape (holders, d), over the points that it
        holds.

        For a reflection plane the points are those less than a grid cell away from it. In
        components in which the plane is held, the displacement is that of the plane, at the mean
        undeformed position of these points projected onto it.
        """
        # Displacement, place and number of the points of each holder.
        sums = np.zeros((len(self.names), 2 * self.body.dimension + 1))
        for number, points in enumerate(self._beside):
            places = self.body.points[points]
            sums[number] = np.concatenate(
                [(positions[points] - places).sum(axis=0), places.sum(axis=0), [len(points)]]
            )
        sums = self._share.total(sums)
        found, places = np.split(sums[:, :-1] / np.maximum(sums[:, -1:], 1), 2, axis=1)
        motions = self.motions_at(parameter).of_parts
        for part, motion in zip(self.held, motions, strict=True):
            if part.plane is None:
                continue
            plane = self.body.planes[part.plane]
            middle = places[part.holder].copy()
            if plane.axis is not None:
                middle[plane.axis] = plane.position
            found[part.holder, part.components] = displaced(motion, middle)[list(part.components)]
        return found

    @cached_property
    def _beside(self) -> list[np.ndarray]:
        """Points owned by this rank that each holder holds; for a reflection plane, those less
        than a grid cell away from it.
        """
        near = []
        for part in self.held:
            points = part.every
            if part.plane is not None:
                plane = self.body.planes[part.plane]
                depths = plane.mirrored(self.body.points[points])[1]
                points = points[
                    np.abs(depths)
                    < (self.body.cell.max() if plane.axis is None else self.body.cell[plane.axis])
                ]
            near.append(points[self._share.own[points]])
        return self._by_holder(near)


class Motions(NamedTuple):
    """Motions of all held parts (..., parts, d, d + 1) and of all planes (..., planes, d, d + 1),
    and the part (..., k) of `Loading.moves` that belongs to held points, at one or several values
    of the parameter.
    """

    of_parts: np.ndarray
    of_planes: np.ndarray
    of_points: np.ndarray

    @property
    def of_all(self) -> np.ndarray:
        """Motions of points and planes in one vector (..., k)."""
        planes = self.of_planes.reshape(*self.of_points.shape[:-1], -1)
        return np.concatenate([self.of_points, planes], axis=-1)

    def at(self, rows) -> Motions:
        """Return the motions at some of the values."""
        return Motions(*(array[rows] for array in self))


def _motions_at(
    held: list[Held],
    planes: int,
    dimension: int,
    components_of_planes: tuple[np.ndarray, ...],
    components_of_points: tuple[np.ndarray, ...],
    places: np.ndarray | None,
    parameters: np.ndarray,
) -> Motions:
    """Return the motions of held parts and planes, and the moves of held points, at values (k,) of
    the parameter.

    The held components of planes are given by parts, planes and components, those of points by
    parts, components and, unless all points move without turning, undeformed `places`.
    """
    count = len(parameters)
    motions = np.zeros((count, len(held), dimension, dimension + 1))
    for number, part in enumerate(held):
        motions[:, number] = part.motion(parameters)
    of_planes = np.zeros((count, planes, dimension, dimension + 1))
    part, *there = components_of_planes
    of_planes[:, *there] = motions[:, part, there[1]]
    parts, components = components_of_points
    of_points = (
        motions[:, parts, components, -1]
        if places is None
        else _moves(motions, parts, components, places)
    )
    found = Motions(motions, of_planes, of_points)
    for array in found:
        array.flags.writeable = False
    return found


def _first(motions: Callable[[np.ndarray], Motions], parameter: float) -> Motions:
    return motions(np.array([parameter])).at(0)


def _moves(
    motions: np.ndarray, parts: np.ndarray, components: np.ndarray, places: np.ndarray
) -> np.ndarray:
    """Return the displacements (k,) of `components` (k,) of `places` (k, d) of the undeformed
    body, each in the motion of a part.
    """
    rows = motions[..., parts, components, :]
    return (rows[..., :-1] * places).sum(axis=-1) + rows[..., -1]
