"""Prescribed displacements and loads on regions, the general way of saying a loading: its parameter is t."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..body import Body
from ..discretisation.planes import prescribed_components, reflected_edges
from ..forces import InternalForce, InvalidState
from ..scenes.amplitudes import amplitude_of
from ..scenes.loading import Prescribed
from ..scenes.model import Scene
from .conditions import HeldPlane, HeldPoints, Loading, Reactions, displaced, place_of
from .equilibrium import TooFar
from .extension import Samples, affine_extension, greatest_bond_strain
from .motion import Motion
from .preconditioner import Extension, extension_of
from .regions import along_edge
from .supports import SupportAtPlace

if TYPE_CHECKING:
    from .loads import Loads
    from .regions import BodyRegions

COMPRESSED = 0.05
"""Compression anywhere, over the greatest tension in the body, from which the body is taken to be able to buckle: less is what free edges
show, whose horizons are incomplete."""

RIGID = 1e3
"""Stiffness of rigid regions over that of the rest in a first guess, which is then brought to where they can be."""

NO_STRESS = {"float32": 1e-5, "float64": 1e-10}
"""Compression over the shear modulus that rounding of the forces may show, by precision."""

LARGEST_TURN = 10.0
"""Degrees by which held parts turn at once in a first guess.  Points between them go along chords, which shrinks the body half way by 0.4 %
for 10 degrees and by 13 % for 60; of 2, 5, 10 and 60 degrees the first three take as many evaluations (twisted boxes and cylinders)."""

HALVINGS = 10
"""Of a step, to find an increment that is not too long; a first guess that strains bonds by more than a thousand is a slip."""


class PrescribedLoading(Loading):
    """The prescribed displacements and the loads of a scene.

    Parameters
    ----------
    scene : Scene
    body : Body
    lower, upper : ndarray, shape (d,)
        Bounding box of the body.
    regions : BodyRegions
    loads : Loads or None
    shear_modulus : float
        For the first guess.
    *rigid : ndarray of int
        Points of every region that moves as one body; those of them beside a plane are held as the plane is.

    Raises
    ------
    ValueError
        If a region is empty, two entries move a point or plane differently or share a name, an amplitude is not zero at rest, or nothing
        keeps a piece of the body where it is; names the key.
    """

    parameter, rest, adaptive = "t", 0.0, True

    def __init__(
        self,
        scene: Scene,
        body: Body,
        lower,
        upper,
        regions: BodyRegions,
        loads: Loads | None,
        shear_modulus: float,
        *rigid: np.ndarray,
    ) -> None:
        self.body, self._amplitudes = body, [amplitude_of(entry.amplitude) for entry in scene.prescribed]
        self._entries, self._loads, self._shear_modulus = scene.prescribed, scene.loads, shear_modulus
        self._springs: float | np.ndarray = shear_modulus
        if rigid:
            self._springs = np.full(len(body), shear_modulus)
            self._springs[np.concatenate(rigid)] *= RIGID
        # A hair more, so that increments of just that strain are taken.
        self._largest_strain = scene.solver.largest_increment * (1 + 1e-6)
        turning_points = [0.0, *(step.to for step in scene.steps)]
        self._range = min(turning_points), max(turning_points)
        labels = _labels(scene, regions)
        names = tuple(dict.fromkeys(labels[: len(scene.prescribed)]))
        holders = [names.index(label) for label in labels[: len(scene.prescribed)]]
        edges, of_rigid = reflected_edges(scene, body.faces), np.concatenate([np.empty(0, dtype=np.int64), *rigid])
        planes, held, along_planes = [], [], []
        for edge, numbers in edges.items():
            points = np.flatnonzero(along_edge(body, edge, lower, upper).inside)
            by_component: list[int | None] = [None] * body.dimension
            turned = None
            for number in numbers:
                entry = scene.prescribed[number]
                components = prescribed_components(entry, body.dimension)
                # What the plane does is what the points beside it would do: two entries may not disagree on either.
                displacement = self._displacement(number, body.points[points])
                along_planes.append(HeldPoints(f"prescribed.{number}", None, points, components, displacement))
                beside = np.intersect1d(points, of_rigid)
                if len(beside):  # its images hold no region that nothing deforms
                    moves = self._displacement(number, body.points[beside])
                    held.append(HeldPoints(f"prescribed.{number}", holders[number], beside, components, moves))
                for component in components:
                    by_component[component] = number
                turned = turned if entry.rotation is None else number
            planes.append(
                HeldPlane(
                    f"{edge} edge",
                    tuple(None if number is None else holders[number] for number in by_component),
                    tuple(component for component in range(body.dimension) if by_component[component] is not None),
                    partial(self._of_plane, tuple(by_component) if turned is None else (turned,) * body.dimension),
                    None if turned is None else partial(self._turn, turned),
                )
            )
        reflected = {number for numbers in edges.values() for number in numbers}
        for number, entry in enumerate(scene.prescribed):
            if number in reflected:
                continue
            points = regions.points(entry.region)
            displacement = self._displacement(number, body.points[points])
            components = prescribed_components(entry, body.dimension)
            support = self._support(entry, points, regions)
            if support is not None and any(step.dynamics is not None for step in scene.steps):
                raise ValueError(
                    f"prescribed.{number}.region: {support.count} points are equally near to this place, and a support between points is "
                    "not followed in dynamics; give points by their numbers, or a box around them"
                )
            if support is not None:
                points, displacement = np.setdiff1d(points, support.others), self._displacement(number, support.place[None])
            held.append(HeldPoints(f"prescribed.{number}", holders[number], points, components, displacement, support))
        super().__init__(body, names, tuple(planes), tuple(held), loads)
        if self.supports is not None:
            still = np.zeros((len(planes), body.dimension))
            self.supports.response = lambda held: self._stiffness.response(body, shear_modulus, held, still)
        # Every t at which a programme turns, and places between: amplitudes that agree at all of these are the same.
        samples = np.unique(np.concatenate([np.linspace(a, b, 5) for a, b in pairwise(turning_points)]))
        every = (*along_planes, *held)
        try:
            self._check_rest(every)
            self._check_agreement(every, tuple(samples.tolist()))
        except InvalidState as error:
            raise ValueError(str(error)) from None
        self._check_planes(tuple(f"prescribed.{numbers[0]}.region" for numbers in edges.values()))
        if any(step.dynamics is None for step in scene.steps):
            self._check_rigid_motions()

    def _support(self, entry: Prescribed, points: np.ndarray, regions: BodyRegions) -> SupportAtPlace | None:
        """The support that some points make, if they are equally near to a place."""
        share = self.body.share
        if not regions.is_place(entry.region):
            return None
        rows = [(share.number(int(point)), tuple(self.body.points[point])) for point in points]
        found = dict(sorted(row for of_part in share.everywhere(rows) for row in of_part))
        if len(found) == 1:
            return None
        return SupportAtPlace(np.mean(list(found.values()), axis=0), len(found), share.local(np.array(list(found)[1:])))

    def _displacement(self, number: int, places: np.ndarray) -> Callable[[float], np.ndarray]:
        """Displacement by an entry of points at reference places (k, d), as a function of t; (d,) where it is the same of all."""
        entry: Prescribed = self._entries[number]
        arms = None if entry.rotation is None else places - np.array(entry.about)

        def displacement(t: float) -> np.ndarray:
            moved = self._shift(number, t)
            return moved if arms is None else arms @ self._turn(number, t).T + moved

        return displacement

    def _factor(self, number: int, t: float) -> float:
        """Amplitude of an entry.

        Raises
        ------
        InvalidState
            Where it has no value.
        """
        try:
            amplitude, within = self._amplitudes[number], min(max(t, self._range[0]), self._range[1])
            if t == within:
                return amplitude(t)
            # Beyond its programme an amplitude need have no value, and a force with viscosity looks a little ahead: it goes on as it came,
            # so that what moves at the end of the programme has its velocity there.
            return 2 * amplitude(within) - amplitude(2 * within - t)
        except ValueError as error:
            raise InvalidState(f"prescribed.{number}.amplitude: {error}") from None

    def _shift(self, number: int, t: float) -> np.ndarray:
        """Displacement by an entry of what it does not turn, shape (d,)."""
        values = [value or 0.0 for value in self._entries[number].displacement]
        return np.array(values[: self.body.dimension]) * self._factor(number, t)

    def _turn(self, number: int, t: float) -> np.ndarray:
        """Q - I of an entry with a rotation, shape (d, d)."""
        entry = self._entries[number]
        angle = math.radians(entry.rotation * self._factor(number, t))
        cosine, sine = math.cos(angle), math.sin(angle)
        if self.body.dimension == 2:
            return np.array([[cosine - 1, -sine], [sine, cosine - 1]])
        a, b, c = np.array(entry.axis) / math.hypot(*entry.axis)
        cross = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
        return sine * cross + (1 - cosine) * (cross @ cross)

    def _of_plane(self, numbers: tuple[int | None, ...], t: float) -> np.ndarray:
        """Displacement of a plane whose components follow some entries; of one that turns, where its turn leaves the origin."""
        moved = np.zeros(self.body.dimension)
        for component, number in enumerate(numbers):
            if number is not None:
                moved[component] = self._shift(number, t)[component]
        turned = next((number for number in numbers if number is not None and self._entries[number].rotation is not None), None)
        return moved if turned is None else moved - self._turn(turned, t) @ np.array(self._entries[turned].about)

    def _check_rest(self, every: tuple[HeldPoints, ...]) -> None:
        for part in every:
            if np.abs(part.displacement(0.0)[..., list(part.components)]).max(initial=0.0) > 1e-9 * self.body.spacing:
                raise ValueError(f"{part.name}.amplitude: it must be 0 at t = 0, where the body is at rest, as ramp and sine are")

    def _check_rigid_motions(self) -> None:
        """Refuse pieces of the body that can move or turn as a whole: they have no equilibrium, or many."""
        count, piece = self.pieces()
        extent = self._share.extent(self.body.points)
        sums = [self._share.sum(column) for column in self.body.points.T]
        middle = np.array(sums) / self._share.size(len(self.body))
        places, components, owners = self._constraints()
        rows = self._share.of_all(_rigid_motions((places - middle) / extent, components), owners)
        pieces = self._share.of_all(piece[owners], owners)
        for number in range(count):
            own = rows[pieces == number]
            motions = _free_motions(own, self.body.dimension)
            if not motions:
                continue
            loose = self._share.own_points(np.flatnonzero(piece == number))
            size = self._share.total(len(loose))
            where = f", at {place_of(self.body, loose[0])}," if len(loose) else ""
            ways = "x1 or x2" if self.body.dimension == 2 else "x1, x2 or x3"
            what = "the body" if count == 1 else f"a piece of {size} points of the body{where}"
            advice = f"hold {ways} of a region by 0 against it, or let the steps be in dynamics"
            if count > 1:
                thin = f"as where a wall is thinner than the spacing, {self.body.spacing:.3g}, or a cut goes all the way"
                advice = f"there are {count} pieces with no bonds between them, {thin}: take {self.body.finer}, or {advice}"
            raise ValueError(f"prescribed: nothing keeps {what} from {' or '.join(motions)}; {advice}")
        self._remark_on_pieces(count)

    def _constraints(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places (k, d) and components (k,) that are held at rest, and the point of the body that each belongs to."""
        places, components, owners = [], [], []
        for part in self._held:
            there = self.body.points[part.points] if part.support is None else np.tile(part.support.place, (len(part.points), 1))
            for component in part.components:
                places.append(there)
                components.append(np.full(len(part.points), component))
                owners.append(part.points)
        for plane, held, sources in zip(self.body.planes, self._planes, self._beside_planes, strict=True):
            beside = self.body.points[sources].copy()
            beside[:, plane.axis] = plane.position
            for component in held.components:
                places.append(beside)
                components.append(np.full(len(sources), component))
                owners.append(sources)
        if not places:
            return np.zeros((0, self.body.dimension)), np.zeros(0, dtype=int), np.zeros(0, dtype=int)
        return np.concatenate(places), np.concatenate(components), np.concatenate(owners)

    def at(self, parameter: float) -> str:
        return f"t = {parameter:g}"

    def largest_increment(self, positions, start, end, asked):
        """The whole way, or what was asked for; halved until its first guess strains no bond by more than the solver may."""
        largest = min(abs(end - start), asked or math.inf) or 1.0
        for _ in range(HALVINGS):
            share = min(1.0, largest / abs(end - start)) if end != start else 1.0
            guess = self._followed(positions, start, start + share * (end - start))
            if self._greatest_strain(positions, guess) <= self._largest_strain:
                break
            largest /= 2
        return largest

    def guesses(self, positions, before, after, earlier):
        """What the held parts say of the body, starting from the last equilibrium and, where there are two, from their continuation."""
        guess = self._followed(positions, before, after)
        strain = self._greatest_strain(positions, guess)
        if strain > self._largest_strain:
            raise TooFar(f"the first guess strains a bond by {strain:.2g}, more than solver.largest_increment = {self._largest_strain:.4g}")
        if earlier is None or earlier[0] == before or after == before:
            return [guess]
        ratio = (after - before) / (before - earlier[0])
        planes = self._plane_motions(before)
        planes = planes + ratio * (planes - self._plane_motions(earlier[0]))
        return [guess, self._extended(positions + ratio * (positions - earlier[1]), planes, after)]

    def _followed(self, positions: np.ndarray, before: float, after: float) -> np.ndarray:
        """First guess from what held parts do on the way, in so many parts that none turns far: points go round, and not across."""
        turns = [
            abs(entry.rotation * (self._factor(number, after) - self._factor(number, before)))
            for number, entry in enumerate(self._entries)
            if entry.rotation
        ]
        parts = max(1, math.ceil(max(turns, default=0.0) / LARGEST_TURN))
        for start, end in pairwise(np.linspace(before, after, parts + 1)):
            positions = self._extended(positions, self._plane_motions(start), end)
        return positions

    def _greatest_strain(self, before: np.ndarray, after: np.ndarray) -> float:
        """Of any bond, on the way from one state to another."""
        self.body.share.fill(before)
        return self._share.greatest(greatest_bond_strain(self.body, before, after))

    def _plane_motions(self, t: float) -> np.ndarray:
        """See `HeldPlane.motion`, shape (p, d, d + 1)."""
        return np.array([plane.motion(t) for plane in self._planes]).reshape(-1, self.body.dimension, self.body.dimension + 1)

    def _extended(self, start: np.ndarray, planes: np.ndarray, t: float) -> np.ndarray:
        """Positions from a start, with planes moved by (p, d, d + 1), in which all that is held is where it is at t.

        First by the affine map nearest to what held parts do, which homogeneous deformations and turns of the whole body are found by; what
        is left of held displacements then spreads as through a network of springs.
        """
        goal_planes = self._plane_motions(t)
        self.body.share.fill(start)
        samples = self._samples(start, planes, goal_planes, t)
        changes = samples.goals - samples.places[np.arange(len(samples.goals)), samples.components]
        farthest = self._share.greatest(np.abs(changes).max(initial=0.0))
        if farthest == 0:
            return start.copy()
        everywhere = Samples(*(self._share.of_all(rows, samples.points) for rows in (samples.places, samples.components, samples.goals)))
        gradient, shift = affine_extension(everywhere, lambda direction: self._share.spread(start @ direction))
        guess = start @ gradient.T + shift
        mapped = (samples.places @ gradient.T + shift)[np.arange(len(samples.goals)), samples.components]
        left = samples.goals - mapped
        if self._share.greatest(np.abs(left).max(initial=0.0)) > 1e-6 * min(farthest, self.body.spacing):
            moved, at, of_planes = np.zeros_like(start), 0, np.zeros(goal_planes.shape[:2])
            turns = self._turns_left(planes, goal_planes, gradient)
            for part in self._held:
                for component in part.components:
                    moved[part.points, component] = left[at : at + len(part.points)]
                    at += len(part.points)
            for number, (sources, held) in enumerate(zip(self._beside_planes, self._planes, strict=True)):
                for component in held.components:
                    # Along its plane the affine map need not follow every place alike.
                    of_planes[number, component] = self._share.of_all(left[at : at + len(sources)], sources).mean()
                    at += len(sources)
                if turns is not None and len(held.components) == self.body.dimension:
                    of_planes[number] = goal_planes[number, :, -1] - gradient @ planes[number, :, -1] - shift
            guess += self._stiffness.response(self.body, self._springs, moved, of_planes, turns)
        for part in self._held:
            goal = self._goal(part, t, start)
            for component in part.components:
                guess[part.points, component] = goal[:, component]
        return guess

    def _turns_left(self, planes: np.ndarray, goal_planes: np.ndarray, gradient: np.ndarray) -> np.ndarray | None:
        """What an affine map of a given gradient leaves of the turns of planes, as `Ghosts.shifts` has them; None where none turns.

        Where one turns, the map turns the others by a part of that, which is left of these.
        """
        if all(plane.turn is None for plane in self._planes):
            return None
        identity = np.eye(self.body.dimension)
        left = identity + goal_planes[:, :, :-1] - gradient @ (identity + planes[:, :, :-1])
        left[[len(plane.components) < self.body.dimension for plane in self._planes]] = 0.0
        return left

    def _samples(self, start: np.ndarray, planes: np.ndarray, goal_planes: np.ndarray, t: float) -> Samples:
        """What is held, where it is and where it goes: points, then planes, at the places beside which the body's points are."""
        places, components, goals = [np.zeros((0, self.body.dimension))], [np.zeros(0, dtype=int)], [np.zeros(0)]
        points = [np.zeros(0, dtype=int)]

        def add(numbers: np.ndarray, there: np.ndarray, component: int, goal: np.ndarray) -> None:
            points.append(numbers)
            places.append(there)
            components.append(np.full(len(there), component))
            goals.append(goal)

        for part in self._held:
            goal = self._goal(part, t, start)
            for component in part.components:
                add(part.points, start[part.points], component, goal[:, component])
        for number, (plane, held, sources) in enumerate(zip(self.body.planes, self._planes, self._beside_planes, strict=True)):
            there, at_rest = start[sources].copy(), self.body.points[sources].copy()
            at_rest[:, plane.axis] = plane.position
            now, then = displaced(planes[number], at_rest), displaced(goal_planes[number], at_rest)
            for component in held.components:
                there[:, component] = at_rest[:, component] + now[:, component]
            for component in held.components:
                add(sources, there, component, there[:, component] + (then - now)[:, component])
        return Samples(*map(np.concatenate, (places, components, goals, points)))

    def _goal(self, part: HeldPoints, t: float, start: np.ndarray) -> np.ndarray:
        """Where held points go at t, shape (k, d); the one of a support as far as the mean of all goes, from where they start."""
        displacement = part.displacement(t)
        if part.support is None:
            return self.body.points[part.points] + displacement
        return start[part.points] + displacement - (start[part.every] - self.body.points[part.every]).sum(axis=0) / part.support.count

    @cached_property
    def _beside_planes(self) -> list[np.ndarray]:
        """Points that have images in each plane."""
        ghosts = self.body.ghosts
        return [np.unique(ghosts.source[ghosts.plane == number]) for number in range(len(self._planes))]

    @cached_property
    def _stiffness(self) -> Extension:
        return extension_of(self.body, self._springs, self.free)

    def velocities(self, positions, motion: Motion):
        """Of the first guess: what is held moves at once, and all of the body with it, so that it sends no shock."""
        share = 1e-6
        ahead = motion.begin + share * (motion.end - motion.begin)
        guess = self._extended(positions, self._plane_motions(motion.begin), ahead)
        return (guess - positions) / (share * motion.duration)

    def power(self, reactions: Reactions, motion: Motion, time, step):
        """By the displacements over the last step; over the next one where there is none."""
        before, after = (motion.at(time - step), motion.at(time)) if time >= step else (motion.at(time), motion.at(time + step))
        old, new = self._plane_motions(before), self._plane_motions(after)
        changes = new - old
        if reactions.levers is None:
            power = float((reactions.on_planes * (changes[:, :, -1] / step)).sum())
        else:
            # The place X of a plane is at y = X + u(X): the change of u is a linear function of y.
            by_place = np.linalg.solve((np.eye(self.body.dimension) + old[:, :, :-1]).mT, changes[:, :, :-1].mT).mT
            shifts = changes[:, :, -1] - np.einsum("prc,pc->pr", by_place, old[:, :, -1])
            power = float((reactions.on_planes * shifts).sum() + (reactions.levers * by_place).sum()) / step
        if reactions.at_points is not None:
            moved = np.zeros_like(reactions.at_points)
            for part in self._held:
                change = np.broadcast_to(part.displacement(after) - part.displacement(before), (len(part.points), self.body.dimension))
                for component in part.components:
                    moved[part.points, component] = change[:, component]
            power += self._share.sum(reactions.at_points * moved) / step
        return power

    def greatest_speed(self, motion: Motion):
        times = np.linspace(0, motion.duration, 17)
        fastest = 0.0
        for begin, end in pairwise(times):
            low, high = np.full(self.body.dimension, np.inf), np.full(self.body.dimension, -np.inf)
            changes = [(part, part.displacement(motion.at(end)) - part.displacement(motion.at(begin))) for part in self._held]
            for plane, sources in zip(self._planes, self._beside_planes, strict=True):
                change = plane.motion(motion.at(end)) - plane.motion(motion.at(begin))
                changes.append((plane, displaced(change, self.body.points[sources])))
            for part, change in changes:
                change = np.atleast_2d(change)
                for component in part.components:
                    low[component] = min(low[component], change[:, component].min(initial=np.inf))
                    high[component] = max(high[component], change[:, component].max(initial=-np.inf))
            low = -np.array([self._share.greatest(-value) for value in low])
            high = np.array([self._share.greatest(value) for value in high])
            spread = (high - low)[np.isfinite(low)]
            fastest = max(fastest, float(spread.max(initial=0.0)) / (end - begin))
        return fastest

    def growth(self, before, after):
        return None

    def pushes(self, force: InternalForce):
        """Whether some point is compressed, by the virial stress of its bonds."""
        n, bonds, positions = len(self.body), self.body.bonds, force.positions
        arms, pulls = positions[bonds.second] - positions[bonds.first], force.pair_forces()
        within = bonds.second < n
        stress = np.empty((n, self.body.dimension, self.body.dimension))
        for i in range(self.body.dimension):
            for j in range(self.body.dimension):
                product = (pulls[:, i] * arms[:, j] + pulls[:, j] * arms[:, i]) / 4
                summed = np.bincount(bonds.first, product, n) + np.bincount(bonds.second[within], product[within], n)
                stress[:, i, j] = summed / self.body.volumes
        least, *_, greatest = np.linalg.eigvalsh(stress).T
        least, greatest = -self._share.maximum(-least), self._share.maximum(greatest)
        return bool(least < -max(COMPRESSED * greatest, NO_STRESS[force.precision] * self._shear_modulus))

    def reached(self, parameter: float) -> str:
        told = []
        for number, entry in enumerate(self._entries):
            factor = amplitude_of(entry.amplitude)(parameter)
            parts = [f"x{component} = {value * factor:.4g}" for component, value in enumerate(entry.displacement, 1) if value]
            if entry.rotation:
                parts.append(f"rotation = {entry.rotation * factor:.4g}")
            if parts:
                told.append(f"prescribed.{number} to {', '.join(parts)}")
        for number, load in enumerate(self._loads):
            factor = amplitude_of(load.amplitude)(parameter)
            size = np.array(getattr(load, load.kind)) * factor
            told.append(f"loads.{number} to {load.kind} = {np.array2string(size, precision=4, separator=', ')}")
        return "; ".join(told)


def _labels(scene: Scene, regions: BodyRegions) -> list[str]:
    """Names under which forces are told: of the prescribed entries, then of the loads; one name stands for one region.

    Raises
    ------
    ValueError
        If two entries on different regions have one name.
    """
    labels, owners = [], {}
    for kind in ("prescribed", "loads"):
        for number, entry in enumerate(getattr(scene, kind)):
            key = f"{kind}.{number}"
            label = entry.name or regions.label(entry.region, key)
            other, region = owners.setdefault(label, (key, entry.region))
            if region != entry.region:
                raise ValueError(f"{other} and {key} are on different regions and both called {label!r}; give one of them another name")
            labels.append(label)
    return labels


def _rigid_motions(arms: np.ndarray, components: np.ndarray) -> np.ndarray:
    """What rigid motions do in given components (k,) of places at given arms (k, d): d along the axes, then a turn or three of them."""
    count, dimension = arms.shape
    turns = [(0, 1)] if dimension == 2 else [(1, 2), (2, 0), (0, 1)]
    rows = np.zeros((count, dimension + len(turns)))
    rows[np.arange(count), components] = 1.0
    for number, (a, b) in enumerate(turns, dimension):
        rows[:, number] = np.where(components == a, -arms[:, b], np.where(components == b, arms[:, a], 0.0))
    return rows


def _free_motions(rows: np.ndarray, dimension: int) -> list[str]:
    """Words for the rigid motions of `_rigid_motions` that constraints, shape (k, motions), leave free."""
    if len(rows) == 0:
        return [*(f"moving along x{axis + 1}" for axis in range(dimension)), "turning"]
    # Of R with R^T R = A^T A, which is small however many places there are.
    _, sizes, directions = np.linalg.svd(np.linalg.qr(rows / np.sqrt(len(rows)), mode="r"), full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(rows.shape[1] - len(sizes))])
    # Less than what two points a thousandth of the body apart would give.
    free = directions[sizes < 1e-6]
    if not len(free):
        return []
    words = [f"moving along x{axis + 1}" for axis in range(dimension) if not (np.abs(rows[:, axis]) > 0).any()]
    if len(free) > len(words):
        words.append("turning")
    return words
