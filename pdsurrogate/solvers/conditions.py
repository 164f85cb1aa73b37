"""Boundary conditions of a body: held points and reflection planes, their positions along the
loading, and the reaction forces.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import NamedTuple

import numpy as np

from ..body import Body, Mirror
from ..body.body import sums_at_points
from ..forces import InternalForce, InvalidState
from ..forces.errors import at_point
from .held import Held, Support
from .loads import AT_REST, LoadedForce, Loads
from .obstacles import PASSED, TOUCHING, Obstructed
from .rigid import displaced, moment_of, nearest_turn, rigid_placement

MOST_MOTIONS = 8
"""Number of values of the loading parameter at which `Loading` keeps the motions of all held parts.
A step of dynamics asks some twenty times for the motions at four values.
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


@dataclass(frozen=True)
class Reactions:
    """Reaction forces that supports exert on the body in the state last evaluated, in two
    dimensions per unit thickness.

    Attributes
    ----------
    forces : ndarray, shape (holders, d)
        Total force of each holder; a holder is a named support in the results, which may consist of
        several held parts.
    on_planes : ndarray, shape (planes, d)
        Force of each reflection plane.
    at_points : ndarray, shape (n, d), or None
        Forces on held points, 0 in free components; None where no points are held.
    levers : ndarray, shape (planes, d, d), or None
        First moments of the forces: the sum of the outer products f (x) y over the forces f that
        each plane exerts at the places y; None if no plane turns.
    """

    forces: np.ndarray
    on_planes: np.ndarray
    at_points: np.ndarray | None
    levers: np.ndarray | None = None


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
        self._of_points = [part for part in held if part.plane is None]
        self._of_planes = [part for part in held if part.plane is not None]
        self.turning = {part.plane for part in self._of_planes if part.angle is not None}
        self.plane_components = np.zeros((len(planes), body.dimension), dtype=bool)
        for part in self._of_planes:
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
        of_points = (
            self.part[self.at_points],
            self.component[self.at_points],
            self.place[self.at_points],
        )
        self._motions = lru_cache(maxsize=MOST_MOTIONS)(
            partial(_motions_at, held, len(planes), of_points)
        )

    def pieces(self, intact: np.ndarray | None = None) -> tuple[int, np.ndarray]:
        """Return the number of connected pieces of the body, and the number of the piece of every
        point; bonds to images do not connect.

        Parameters
        ----------
        intact : ndarray of bool, shape (bonds,), optional
            True for the bonds that connect points; all by default.
        """
        bonds = self.body.bonds
        n = len(self.body)
        within = bonds.second < n if intact is None else (bonds.second < n) & intact
        return self._share.pieces(bonds.first[within], bonds.second[within])

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
            self._motions(parameter).of_parts,
            self.part,
            self.component,
            self.place if places is None else places,
        )

    def moves_of_points(self, parameter: float) -> np.ndarray:
        """Return the part of `moves` that belongs to held points (True in `at_points`), not to
        be changed.
        """
        return self._motions(parameter).of_points

    def plane_motions(self, parameter: float) -> np.ndarray:
        """Return the motions of all reflection planes at a value of the loading parameter, shape
        (planes, d, d + 1).

        A motion is the matrix [Q - I, c] of a rotation Q and a translation c (see `Held`), with 0
        in free components. The array is not to be changed.
        """
        return self._motions(parameter).of_planes

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
        positions[self.there] = self.body.points[self.there] + self.moves_of_points(parameter)
        for support in self.supports:
            support.set(parameter)
            support.place(positions)
        for number, motion in enumerate(self.plane_motions(parameter)):
            force.move_plane(
                number, motion[:, -1], motion[:, :-1] if number in self.turning else None
            )
        self.loads.planes[:] = self.planes_at(parameter)

    def unevenness(self, last: float, now: float, ahead: float) -> float:
        """Return how much the rate of the prescribed motions changes between two increments, `last`
        to `now` and `now` to `ahead`.

        The change is the greatest difference between the prescribed displacements from `now` to
        `ahead` and those extrapolated linearly from the increment before, divided by the greatest
        of all these displacements; it is 0 at a constant rate.
        """
        if now == last:
            return 0.0
        before, present, after = (
            np.append(self.moves_of_points(t), self.plane_motions(t)) for t in (last, now, ahead)
        )
        way = after - present
        evenly = (present - before) * ((ahead - now) / (now - last))
        off, *ways = (
            self._share.greatest(np.abs(change)) for change in (way - evenly, way, evenly)
        )
        return off / max(ways) if off > 0 else 0.0

    def check_inside(self, parameter: float, force: InternalForce, positions: np.ndarray) -> None:
        """Check that no point has crossed a reflection plane to the side of its own image, and that
        none lies deep in an obstacle.

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
        motions = self.plane_motions(parameter)
        ghosts = self.body.ghosts
        for number, (name, plane, motion) in enumerate(
            zip(self.planes, self.body.planes, motions, strict=True)
        ):
            # In the frame in which the plane has not moved.
            back = np.linalg.solve(
                np.eye(self.body.dimension) + motion[:, :-1], (positions - motion[:, -1]).T
            ).T
            reflects = plane.axis is not None or np.isin(
                np.arange(len(back)), ghosts.source[ghosts.plane == number]
            )
            beyond = np.where(supported & reflects, -plane.mirrored(back)[1], 0.0)
            for obstacle in (
                self.loads.obstacles
            ):  # it pushes back a point that has entered it as far as it has crossed the plane
                beyond[beyond <= ON_A_PLANE * self.body.spacing - obstacle.gaps(positions)[0]] = 0.0
            self._check_held(name, plane, motion)
            worst = int(beyond.argmax())
            error = None
            if beyond[worst] > ON_A_PLANE * self.body.spacing:
                what = (
                    f"it lies {beyond[worst]:.3g} beyond the {name}, on the side of its own image"
                )
                kind = InvalidState
                if plane.axis is not None and self.plane_components[number].sum() > 1:
                    kind = FoldedOver
                    what += "; the body bulges over what it is bonded to, and would lie against it"
                error = kind(at_point(self.body, worst, what))
            self.body.share.agree(error)

    def _check_held(self, name: str, plane: Mirror, motion: np.ndarray) -> None:
        """Raise Obstructed if an obstacle has entered the part of the boundary that a bonded
        plane or held boundary prescribes.
        """
        feet, depths = plane.mirrored(self.body.points)
        feet = feet[depths < self.body.cell.max()]
        for obstacle in self.loads.obstacles if max(plane.parity) < 0 else ():
            gaps, _ = obstacle.gaps(feet + displaced(motion, feet))
            deepest = self.body.share.greatest(np.maximum(-gaps, 0.0))
            if deepest > TOUCHING * self.body.spacing:
                raise Obstructed(
                    f"the obstacle {obstacle.name} lies {deepest:.3g} inside the {name}, whose"
                    " motion is prescribed"
                )

    def reactions(
        self, force: LoadedForce, on_points: np.ndarray | None = None, of_planes: bool = True
    ) -> Reactions:
        """Return the reaction forces of all supports on the body in the state last evaluated.

        The reaction at a held point balances the internal force and the loads there.  The reaction
        of a reflection plane is the force that does work on the displacement of the plane: the sum
        over bonds to images (mirrored points) of half the bond force, times the displacement of the
        image per displacement of the plane.  The factor is a half since half the energy of such a
        bond belongs to the mirrored body.  For a single plane the reaction is the sum of the forces
        of all bonds that cross it. It balances the parts of loads that images carry, too.

        Parameters
        ----------
        force : LoadedForce
        on_points : ndarray, shape (n, d), optional
            Internal force and loads on every point in that state; by default summed from the forces
            of all pairs.
        of_planes : bool
            Whether the reactions of planes are computed; otherwise they are 0.
        """
        on_planes = np.zeros(self.plane_components.shape)
        levers = None
        if of_planes:
            bonds, planes, shares = self.crossing
            crossing = force.pair_forces(bonds)
            np.add.at(on_planes, planes, crossing * shares)
            on_planes = self._share.total(on_planes) - self._loads_on_planes(force)[:, :, 0]
            levers = self._levers_on_planes(force, crossing) if self.turning else None
            levers = None if levers is None else self._share.total(levers)
        if on_points is None and self._of_points:
            on_points = self._on_points(force)
        return self.reactions_of(on_planes, levers, on_points)

    def reactions_of(
        self, on_planes: np.ndarray, levers: np.ndarray | None, on_points: np.ndarray | None
    ) -> Reactions:
        """Return the reactions from the forces and levers of planes (see `Reactions`), and
        internal force plus loads on points (n, d).
        """
        forces = np.zeros((len(self.names), self.body.dimension))
        at_points = None
        if self._of_points:
            at_points = -on_points * (1 - self.free)
            for support in self.supports:
                support.spread(at_points)
            holder, *there = self.counted
            np.add.at(forces, (holder, there[1]), at_points[tuple(there)])
            forces = self._share.total(forces)
        self._add_planes(forces, on_planes)
        return Reactions(forces, on_planes, at_points, levers)

    def moments(self, force: LoadedForce, reactions: Reactions) -> np.ndarray:
        """Return the moments of the holders' forces about the origin of the coordinates.

        Moments on planes follow from virtual work if the force has an energy; otherwise a bond that
        crosses a plane acts on it at the middle of the bond.

        Returns
        -------
        ndarray
            Counter-clockwise moments per unit thickness in two dimensions, shape (holders,);
            vectors in three, shape (holders, 3).
        """
        levers = np.zeros((len(self.names), self.body.dimension, self.body.dimension))
        if len(self.crossing[0]):
            self._add_planes(levers, self._levers_on_planes(force))
        self._add_planes(levers, -self._share.is_first * self._loads_on_planes(force)[:, :, 1:])
        if reactions.at_points is not None:
            holder, point, component = self.counted
            np.add.at(
                levers,
                (holder, component),
                reactions.at_points[point, component, None] * force.positions[point],
            )
        return moment_of(self._share.total(levers))

    def _add_planes(self, of_holders: np.ndarray, of_planes: np.ndarray) -> None:
        """Add the values of planes, `of_planes` (planes, d, ...), in place to `of_holders`
        (holders, d, ...).

        Components that nothing holds, which have couples alone, count for who holds a plane across.
        """
        for part in self._of_planes:
            rows = np.isin(np.arange(self.body.dimension), part.components)
            if self.body.planes[part.plane].axis in part.components:
                rows |= ~self.plane_components[part.plane]
            of_holders[part.holder, rows] += of_planes[part.plane, rows]

    def _levers_on_planes(
        self, force: InternalForce, crossing: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the first moments of the forces of planes (`Reactions.levers`), sums of outer
        products f (x) y, shape (planes, d, d).

        If `force` has an energy, it provides these sums. Otherwise f are the forces of the k bonds
        that cross planes, `crossing` (k, d), by default computed here, and y the middles of these
        bonds.
        """
        levers = force.levers_on_planes()
        if levers is not None:
            return levers
        bonds, planes, shares = self.crossing
        pulls = (force.pair_forces(bonds) if crossing is None else crossing) * shares
        ends = self.body.bonds
        middles = (force.positions[ends.first[bonds]] + force.positions[ends.second[bonds]]) / 2
        levers = np.zeros((len(self.planes), self.body.dimension, self.body.dimension))
        np.add.at(levers, planes, pulls[:, :, None] * middles[:, None])
        return levers

    def _loads_on_planes(self, force: LoadedForce) -> np.ndarray:
        """Return what reaches the planes from the loads, see `Loads.on_planes`."""
        if not self.loads:
            return np.zeros((*self.plane_components.shape, 1 + self.body.dimension))
        return self.loads.on_planes(force.positions[: len(self.body)], force.thickness())

    def _on_points(self, force: LoadedForce) -> np.ndarray:
        """Return internal force plus loads on every point in the state last evaluated, shape (n,
        d).

        In each rigid region forces of equal resultant replace them, see `RigidRegion.carry`.
        """
        total = self.internal_forces(force)
        if self.loads:
            self.loads.forces(force.positions[: len(self.body)], force.thickness(), total)
        for region in force.rigid:
            region.carry(force.positions, total)
        return total

    def internal_forces(self, force: InternalForce) -> np.ndarray:
        """Return the internal force on every point in the state last evaluated, shape (n, d)."""
        bonds = self.body.bonds
        total = sums_at_points(len(self.body), bonds.first, bonds.second, force.pair_forces(), -1)
        beside = force.forces_beside_pairs()
        return total if beside is None else total + beside

    @cached_property
    def counted(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Components of held points whose reactions this rank adds to their holders' forces:
        arrays of holders, points and components.
        """
        holder = np.full(self.free.shape, -1)
        for part in self._of_points:
            holder[part.every[:, None], part.components] = (
                -1 if part.holder is None else part.holder
            )
        holder[~self._share.own] = -1
        there = np.nonzero(holder >= 0)
        return holder[there], *there

    @cached_property
    def crossing(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bonds to images (mirrored points) of each plane, for the reactions of planes, as three
        arrays with a row for each such bond.

        The arrays are the number of the bond, the number of the plane, and half the displacement of
        the image per displacement of the plane, component by component.
        """
        n = len(self.body)
        ghosts = self.body.ghosts
        outer = np.flatnonzero(self.body.bonds.second >= n)
        outer = outer[self._share.own[self.body.bonds.first[outer]]]
        levers = ghosts.lever[self.body.bonds.second[outer] - n]
        rows, planes = np.nonzero(levers.any(axis=2))
        return outer[rows], planes, np.sign(levers[rows, planes])

    def ends(self) -> list[np.ndarray]:
        """Return, for each holder, the points on this rank, halo included, that it holds; for a
        plane the points with images in it.
        """
        return self._by_holder([part.points for part in self.held])

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
        for part in self._of_planes:
            plane = self.body.planes[part.plane]
            middle = places[part.holder].copy()
            if plane.axis is not None:
                middle[plane.axis] = plane.position
            found[part.holder, part.components] = displaced(part.motion(parameter), middle)[
                list(part.components)
            ]
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


class _Motions(NamedTuple):
    """Motions of all held parts (parts, d, d + 1) and of all planes (planes, d, d + 1), and
    `Loading.moves_of_points`, at one time.
    """

    of_parts: np.ndarray
    of_planes: np.ndarray
    of_points: np.ndarray


def _motions_at(
    held: list[Held], planes: int, components: tuple[np.ndarray, ...], parameter: float
) -> _Motions:
    """Return the motions of held parts and planes, and the moves of a table of held
    `components`, at a value of the parameter.
    """
    dimension = components[-1].shape[1]
    motions = np.array([part.motion(parameter) for part in held]).reshape(
        -1, dimension, dimension + 1
    )
    of_planes = np.zeros((planes, dimension, dimension + 1))
    for part, motion in zip(held, motions, strict=True):
        if part.plane is not None:
            of_planes[part.plane, part.components] = motion[list(part.components)]
    found = _Motions(
        motions, of_planes, _moves(motions, *components) if len(components[0]) else np.empty(0)
    )
    for array in found:
        array.flags.writeable = False
    return found


def _moves(
    motions: np.ndarray, parts: np.ndarray, components: np.ndarray, places: np.ndarray
) -> np.ndarray:
    """Return the displacements (k,) of `components` (k,) of `places` (k, d) of the undeformed
    body, each in the motion of a part.
    """
    rows = motions[parts, components]
    return (rows[:, :-1] * places).sum(axis=1) + rows[:, -1]
