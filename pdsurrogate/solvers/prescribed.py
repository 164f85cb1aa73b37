"""Prescribed displacements and loads on regions, the general way of saying a loading: its parameter is t."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..body import Body
from ..forces import InternalForce, InvalidState
from ..scenes.amplitudes import amplitude_of
from ..scenes.loading import Prescribed
from ..scenes.model import Scene
from .conditions import HeldPlane, HeldPoints, Loading, Reactions, place_of
from .equilibrium import TooFar
from .extension import Samples, affine_extension, greatest_bond_strain
from .motion import Motion
from .planes import prescribed_components, reflected_edges
from .preconditioner import NearestBondStiffness
from .reductions import LocalReductions
from .regions import along_edge

if TYPE_CHECKING:
    from .loads import Loads
    from .regions import BodyRegions

COMPRESSED = 0.05
"""Compression anywhere, over the greatest tension in the body, from which the body is taken to be able to buckle: less is what free edges
show, whose horizons are incomplete."""

HALVINGS = 10
"""Of a step, to find an increment that is not too long; a first guess that strains bonds by more than a thousand is a slip."""


class PrescribedLoading(Loading):
    """The prescribed displacements and the loads of a scene.

    Parameters
    ----------
    scene : Scene
    body : Body
    lower, upper : ndarray, shape (2,)
        Bounding box of the body.
    regions : BodyRegions
    loads : Loads or None
    shear_modulus : float
        For the first guess.
    reductions : LocalReductions

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
        reductions: LocalReductions,
    ) -> None:
        self._entries, self._loads, self._shear_modulus = scene.prescribed, scene.loads, shear_modulus
        # A hair more, so that increments of just that strain are taken.
        self._largest_strain = scene.solver.largest_increment * (1 + 1e-6)
        turning_points = [0.0, *(step.to for step in scene.steps)]
        self._range = min(turning_points), max(turning_points)
        labels = _labels(scene, regions)
        names = tuple(dict.fromkeys(labels[: len(scene.prescribed)]))
        holders = [names.index(label) for label in labels[: len(scene.prescribed)]]
        edges = reflected_edges(scene)
        planes, held, along_planes = [], [], []
        for edge, numbers in edges.items():
            points = np.flatnonzero(along_edge(body, edge, lower, upper).inside)
            by_component: list[int | None] = [None, None]
            for number in numbers:
                entry = scene.prescribed[number]
                components = prescribed_components(entry)
                # What the plane does is what the points beside it would do: two entries may not disagree on either.
                along_planes.append(HeldPoints(f"prescribed.{number}", None, points, components, self._displacement(number, None)))
                for component in components:
                    by_component[component] = number
            planes.append(
                HeldPlane(
                    f"{edge} edge",
                    tuple(None if number is None else holders[number] for number in by_component),
                    tuple(component for component in (0, 1) if by_component[component] is not None),
                    partial(self._of_plane, tuple(by_component)),
                )
            )
        reflected = {number for numbers in edges.values() for number in numbers}
        for number, entry in enumerate(scene.prescribed):
            if number in reflected:
                continue
            points = regions.points(entry.region)
            displacement = self._displacement(number, body.points[points])
            held.append(HeldPoints(f"prescribed.{number}", holders[number], points, prescribed_components(entry), displacement))
        super().__init__(body, names, tuple(planes), tuple(held), loads, reductions)
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

    def _displacement(self, number: int, places: np.ndarray | None) -> Callable[[float], np.ndarray]:
        """Displacement by an entry of points at reference places (k, 2), or of what is not turned, as a function of t."""
        entry: Prescribed = self._entries[number]
        amplitude, values = amplitude_of(entry.amplitude), np.array([entry.x1 or 0.0, entry.x2 or 0.0])
        arms = None if entry.rotation is None else places - np.array(entry.about)

        def displacement(t: float) -> np.ndarray:
            try:
                # Beyond its programme an amplitude need have no value; a retarded force looks a little ahead.
                factor = amplitude(min(max(t, self._range[0]), self._range[1]))
            except ValueError as error:
                raise InvalidState(f"prescribed.{number}.amplitude: {error}") from None
            moved = values * factor
            if arms is None:
                return moved
            angle = math.radians(entry.rotation * factor)
            cosine, sine = math.cos(angle), math.sin(angle)
            return arms @ np.array([[cosine - 1, sine], [-sine, cosine - 1]]) + moved

        return displacement

    def _of_plane(self, numbers: tuple[int | None, int | None], t: float) -> np.ndarray:
        """Displacement of a plane whose components follow some entries."""
        moved = np.zeros(2)
        for component, number in enumerate(numbers):
            if number is not None:
                moved[component] = self._unturned[number](t)[component]
        return moved

    @cached_property
    def _unturned(self) -> list[Callable[[float], np.ndarray] | None]:
        """Displacements by the entries that turn nothing."""
        return [self._displacement(n, None) if entry.rotation is None else None for n, entry in enumerate(self._entries)]

    def _check_rest(self, every: tuple[HeldPoints, ...]) -> None:
        for part in every:
            if np.abs(part.displacement(0.0)[..., list(part.components)]).max() > 1e-9 * self.body.spacing:
                raise ValueError(f"{part.name}.amplitude: it must be 0 at t = 0, where the body is at rest, as ramp and sine are")

    def _check_rigid_motions(self) -> None:
        """Refuse pieces of the body that can move or turn as a whole: they have no equilibrium, or many."""
        count, piece = self.pieces()
        middle, extent = self.body.points.mean(axis=0), self._reductions.extent(self.body.points)
        places, components, owners = self._constraints()
        rows = np.zeros((len(places), 3))
        rows[np.arange(len(places)), components] = 1.0
        arms = (places - middle) / extent
        rows[:, 2] = np.where(components == 0, -arms[:, 1], arms[:, 0])
        for number in range(count):
            own = rows[piece[owners] == number]
            motions = _free_motions(own)
            if not motions:
                continue
            loose = np.flatnonzero(piece == number)
            what = "the body" if count == 1 else f"a piece of {len(loose)} points of the body, at {place_of(self.body, loose[0])},"
            raise ValueError(
                f"prescribed: nothing keeps {what} from {' or '.join(motions)}; hold x1 or x2 of a region by 0 against it, or let the "
                "steps be in dynamics"
            )

    def _constraints(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places (k, 2) and components (k,) that are held at rest, and the point of the body that each belongs to."""
        places, components, owners = [], [], []
        for part in self._held:
            for component in part.components:
                places.append(self.body.points[part.points])
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
            return np.zeros((0, 2)), np.zeros(0, dtype=int), np.zeros(0, dtype=int)
        return np.concatenate(places), np.concatenate(components), np.concatenate(owners)

    def at(self, parameter: float) -> str:
        return f"t = {parameter:g}"

    def largest_increment(self, positions, start, end, asked):
        """The whole way, or what was asked for; halved until its first guess strains no bond by more than the solver may."""
        largest = min(abs(end - start), asked or math.inf) or 1.0
        for _ in range(HALVINGS):
            share = min(1.0, largest / abs(end - start)) if end != start else 1.0
            guess = self._extended(positions, self._plane_displacements(start), start + share * (end - start))
            if greatest_bond_strain(self.body, positions, guess) <= self._largest_strain:
                break
            largest /= 2
        return largest

    def guesses(self, positions, before, after, earlier):
        """What the held parts say of the body, starting from the last equilibrium and, where there are two, from their continuation."""
        guess = self._extended(positions, self._plane_displacements(before), after)
        strain = greatest_bond_strain(self.body, positions, guess)
        if strain > self._largest_strain:
            raise TooFar(f"the first guess strains a bond by {strain:.2g}, more than solver.largest_increment = {self._largest_strain:.4g}")
        if earlier is None or earlier[0] == before or after == before:
            return [guess]
        ratio = (after - before) / (before - earlier[0])
        planes = self._plane_displacements(before)
        planes = planes + ratio * (planes - self._plane_displacements(earlier[0]))
        return [guess, self._extended(positions + ratio * (positions - earlier[1]), planes, after)]

    def _plane_displacements(self, t: float) -> np.ndarray:
        return np.array([plane.displacement(t) for plane in self._planes]).reshape(-1, 2)

    def _extended(self, start: np.ndarray, planes: np.ndarray, t: float) -> np.ndarray:
        """Positions from a start, with planes displaced by (p, 2), in which all that is held is where it is at t.

        First by the affine map nearest to what held parts do, which homogeneous deformations and turns of the whole body are found by; what
        is left of held displacements then spreads as through a network of springs.
        """
        goal_planes = self._plane_displacements(t)
        samples = self._samples(start, planes, goal_planes, t)
        if np.array_equal(samples.goals, samples.places[np.arange(len(samples.goals)), samples.components]):
            return start.copy()
        guess = affine_extension(samples, start)
        mapped = affine_extension(samples, samples.places)[np.arange(len(samples.goals)), samples.components]
        left = samples.goals - mapped
        if np.abs(left).max() > 1e-6 * self.body.spacing:
            moved, at, of_planes = np.zeros_like(start), 0, np.zeros_like(goal_planes)
            for part in self._held:
                for component in part.components:
                    moved[part.points, component] = left[at : at + len(part.points)]
                    at += len(part.points)
            for number, (sources, held) in enumerate(zip(self._beside_planes, self._planes, strict=True)):
                for component in held.components:
                    # Along its plane the affine map need not follow every place alike.
                    of_planes[number, component] = left[at : at + len(sources)].mean()
                    at += len(sources)
            guess += self._stiffness.response(self.body, self._shear_modulus, moved, of_planes)
        for part in self._held:
            goal = part.displacement(t)
            for component in part.components:
                guess[part.points, component] = self.body.points[part.points, component] + goal[..., component]
        return guess

    def _samples(self, start: np.ndarray, planes: np.ndarray, goal_planes: np.ndarray, t: float) -> Samples:
        """What is held, where it is and where it goes: points, then planes, at the places beside which the body's points are."""
        places, components, goals = [np.zeros((0, 2))], [np.zeros(0, dtype=int)], [np.zeros(0)]

        def add(there: np.ndarray, component: int, goal: np.ndarray) -> None:
            places.append(there)
            components.append(np.full(len(there), component))
            goals.append(goal)

        for part in self._held:
            displacement = part.displacement(t)
            for component in part.components:
                add(start[part.points], component, self.body.points[part.points, component] + displacement[..., component])
        for number, (plane, held, sources) in enumerate(zip(self.body.planes, self._planes, self._beside_planes, strict=True)):
            there = start[sources].copy()
            for component in held.components:
                at_rest = plane.position if component == plane.axis else self.body.points[sources, component]
                there[:, component] = at_rest + planes[number, component]
            for component in held.components:
                add(there, component, there[:, component] + (goal_planes - planes)[number, component])
        return Samples(np.concatenate(places), np.concatenate(components), np.concatenate(goals))

    @cached_property
    def _beside_planes(self) -> list[np.ndarray]:
        """Points that have images in each plane."""
        ghosts = self.body.ghosts
        return [np.unique(ghosts.source[ghosts.plane == number]) for number in range(len(self._planes))]

    @cached_property
    def _stiffness(self) -> NearestBondStiffness:
        return NearestBondStiffness(self.body, self._shear_modulus, self.free)

    def velocities(self, positions, motion: Motion):
        """Of the first guess: what is held moves at once, and all of the body with it, so that it sends no shock."""
        share = 1e-6
        ahead = motion.begin + share * (motion.end - motion.begin)
        guess = self._extended(positions, self._plane_displacements(motion.begin), ahead)
        return (guess - positions) / (share * motion.duration)

    def power(self, reactions: Reactions, motion: Motion, time, step):
        """By the displacements over the last step; over the next one where there is none."""
        before, after = (motion.at(time - step), motion.at(time)) if time >= step else (motion.at(time), motion.at(time + step))
        velocities = (self._plane_displacements(after) - self._plane_displacements(before)) / step
        power = float((reactions.on_planes * velocities).sum())
        if reactions.at_points is not None:
            moved = np.zeros_like(reactions.at_points)
            for part in self._held:
                change = np.broadcast_to(part.displacement(after) - part.displacement(before), (len(part.points), 2))
                for component in part.components:
                    moved[part.points, component] = change[:, component]
            power += self._reductions.total(reactions.at_points * moved) / step
        return power

    def greatest_speed(self, motion: Motion):
        times = np.linspace(0, motion.duration, 17)
        fastest = 0.0
        for begin, end in pairwise(times):
            low, high = np.full(2, np.inf), np.full(2, -np.inf)
            for part in (*self._held, *self._planes):
                change = np.atleast_2d(part.displacement(motion.at(end)) - part.displacement(motion.at(begin)))
                for component in part.components:
                    low[component] = min(low[component], change[:, component].min())
                    high[component] = max(high[component], change[:, component].max())
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
        stress = np.empty((n, 2, 2))
        for i in (0, 1):
            for j in (0, 1):
                product = (pulls[:, i] * arms[:, j] + pulls[:, j] * arms[:, i]) / 4
                summed = np.bincount(bonds.first, product, n) + np.bincount(bonds.second[within], product[within], n)
                stress[:, i, j] = summed / self.body.volumes
        least, greatest = np.linalg.eigvalsh(stress).T
        return bool(least.min() < -max(COMPRESSED * greatest.max(), 1e-4 * self._shear_modulus))

    def reached(self, parameter: float) -> str:
        told = []
        for number, entry in enumerate(self._entries):
            factor = amplitude_of(entry.amplitude)(parameter)
            parts = [f"x{c + 1} = {value * factor:.4g}" for c, value in enumerate((entry.x1, entry.x2)) if value]
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


def _free_motions(rows: np.ndarray) -> list[str]:
    """Words for the rigid motions (x1, x2, turn) that constraints, shape (k, 3), leave free."""
    if len(rows) == 0:
        return ["moving along x1", "moving along x2", "turning"]
    _, sizes, directions = np.linalg.svd(rows / np.sqrt(len(rows)), full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(3 - len(sizes))])
    # Less than what two points a thousandth of the body apart would give.
    free = directions[sizes < 1e-6]
    if not len(free):
        return []
    words = [f"moving along x{axis + 1}" for axis in (0, 1) if not (np.abs(rows[:, axis]) > 0).any()]
    if len(free) > len(words):
        words.append("turning")
    return words
