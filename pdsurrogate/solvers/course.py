"""Course of a body along its loading: first guesses and velocities from the held parts, and the power of the holders."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from itertools import pairwise

import numpy as np

from ..body.body import sums_at_points
from ..forces import InternalForce
from .conditions import HeldPoints, Loading, Reactions, displaced
from .equilibrium import TooFar
from .extension import Samples, affine_extension, greatest_bond_strain
from .motion import Motion
from .preconditioner import Extension

COMPRESSED = 0.05
"""Compression anywhere, over the greatest tension in the body, beyond which the body may buckle: free edges, whose horizons are incomplete,
show less."""

NO_STRESS = {"float32": 1e-5, "float64": 1e-10}
"""Compression over the shear modulus that rounding of the forces may show, by precision."""

LARGEST_TURN = 10.0
"""Greatest turn of held parts in one portion of a first guess, in degrees. Points between them move along chords, which shrinks the body
half way by 0.4 % for 10 degrees and by 13 % for 60; 2, 5 and 10 degrees need equally many evaluations (twisted boxes and cylinders)."""

HALVINGS = 10
"""Greatest number of halvings of a step in the search for a first increment; a guess a thousand times too long is a slip in the scene."""

AHEAD = 1e-6
"""Change of the stretch, or share of a stage, over which velocities are formed as difference quotients; the rounding of the result, the
root of that of the positions, is as small as its error."""


class Pull:
    """Course of a body between two grips that move apart: homogeneous extension along the loaded axis, the parameter being the stretch.

    Parameters
    ----------
    loading : Loading
    axis : int
        Loaded direction.
    lower, length : float
        Least coordinate of the body along it, and length of the undeformed body.
    travels : ndarray, shape (2, d)
        Displacement of each grip per unit of elongation.
    """

    adaptive = False
    """Whether increments are lengthened only after easy ones, and begin from the best of several guesses."""

    def __init__(self, loading: Loading, axis: int, lower: float, length: float, travels: np.ndarray) -> None:
        self._loading, self.axis, self._lower, self._length, self._travels = loading, axis, lower, length, travels
        self._lower_travel = travels[:, axis].min()  # the grip at the lower end moves down

    def largest_increment(self, positions: np.ndarray, start: float, end: float, asked: float | None) -> float | None:
        """Return the greatest increment to plan, which is the bound that the scene sets."""
        return asked

    def guesses(self, positions: np.ndarray, before: float, after: float, earlier: tuple[float, np.ndarray] | None) -> list[np.ndarray]:
        """Return the positions extended to another stretch; see `Paths.guesses`."""
        old, new = (self._lower + self._lower_travel * (stretch - 1) * self._length for stretch in (before, after))
        guess = positions.copy()
        guess[:, self.axis] = new + (positions[:, self.axis] - old) * after / before
        return [guess]

    def velocities(self, positions: np.ndarray, motion: Motion) -> np.ndarray:
        """Return the velocities of a homogeneous extension, with which the grips send no shock."""
        (ahead,) = self.guesses(positions, motion.begin, motion.begin + AHEAD, None)
        return (ahead - positions) / AHEAD * motion.rate

    def pull(self, reactions: Reactions) -> float:
        """Return the force of the grips along the load, in the plane per unit thickness; negative where they push."""
        return float((reactions.forces * self._travels).sum())

    def power(self, reactions: Reactions, motion: Motion, time: float, step: float) -> float:
        """Return the power of the grips; see `Paths.power`."""
        return self.pull(reactions) * (motion.rate * self._length)

    def growth(self, before: float, after: float) -> float:
        """Return the change of the body's extent between two stretches."""
        return abs(after - before) * self._loading.body.extent

    def pushes(self, force: InternalForce, least: float = 0.0) -> bool:
        """Return whether the grips push in the state last evaluated, by more than the `least` force."""
        return self.pull(self._loading.reactions(force)) < -least


class Paths:
    """Course of a body whose held parts each follow a path of their own, the parameter being t.

    Parameters
    ----------
    loading : Loading
    springs : float or ndarray, shape (n,)
        Stiffness of the springs through which held displacements spread into the body in a first guess.
    shear_modulus : float
    largest_strain : float
        Greatest strain of a bond that a first guess may make.
    turned : callable
        Greatest angle in degrees by which a held part turns between two values of the parameter.
    """

    adaptive = True

    def __init__(
        self,
        loading: Loading,
        springs: float | np.ndarray,
        shear_modulus: float,
        largest_strain: float,
        turned: Callable[[float, float], float],
    ) -> None:
        self._loading, self.body, self._share = loading, loading.body, loading.body.share
        # A slightly larger bound accepts increments of exactly that strain.
        self._springs, self._shear_modulus, self._largest_strain = springs, shear_modulus, largest_strain * (1 + 1e-6)
        self._turned = turned

    def largest_increment(self, positions: np.ndarray, start: float, end: float, asked: float | None) -> float:
        """Return the greatest increment to plan between two values of the parameter.

        It is the whole way, or the increment that the scene asks for, halved until its first guess strains no bond too much.

        Parameters
        ----------
        positions : ndarray, shape (n, d)
            In equilibrium at the start.
        start, end : float
        asked : float or None
            Bound by the scene.
        """
        largest = min(abs(end - start), asked or math.inf) or 1.0
        for _ in range(HALVINGS):
            share = min(1.0, largest / abs(end - start)) if end != start else 1.0
            guess = self._followed(positions, start, start + share * (end - start))
            if self._greatest_strain(positions, guess) <= self._largest_strain:
                break
            largest /= 2
        return largest

    def guesses(self, positions: np.ndarray, before: float, after: float, earlier: tuple[float, np.ndarray] | None) -> list[np.ndarray]:
        """Return first guesses of an equilibrium, any of which may be the best.

        One follows the held parts from the last equilibrium; where there are two, another continues the way between them.

        Parameters
        ----------
        positions : ndarray, shape (n, d)
            In equilibrium at the value `before` of the parameter.
        before, after : float
        earlier : tuple of float and ndarray, or None
            Parameter and positions of the equilibrium before that one.

        Raises
        ------
        TooFar
            If the first guess strains a bond too much.
        """
        guess = self._followed(positions, before, after)
        strain = self._greatest_strain(positions, guess)
        if strain > self._largest_strain:
            raise TooFar(f"the first guess strains a bond by {strain:.2g}, more than solver.largest_increment = {self._largest_strain:.4g}")
        if earlier is None or earlier[0] == before or after == before:
            return [guess]
        ratio = (after - before) / (before - earlier[0])
        planes = self._loading.plane_motions(before)
        planes = planes + ratio * (planes - self._loading.plane_motions(earlier[0]))
        return [guess, self._extended(positions + ratio * (positions - earlier[1]), planes, after)]

    def velocities(self, positions: np.ndarray, motion: Motion) -> np.ndarray:
        """Return the velocities with which a body that has followed its conditions slowly goes on with them, shape (n, d)."""
        ahead = motion.begin + AHEAD * (motion.end - motion.begin)
        guess = self._extended(positions, self._loading.plane_motions(motion.begin), ahead)
        return (guess - positions) / (AHEAD * motion.duration)

    def power(self, reactions: Reactions, motion: Motion, time: float, step: float) -> float:
        """Return the power of all holders of the body at the end of a time step, per unit thickness in the plane.

        Displacements are those over the last step, or over the next one where there is none.
        """
        before, after = (motion.at(time - step), motion.at(time)) if time >= step else (motion.at(time), motion.at(time + step))
        old, new = self._loading.plane_motions(before), self._loading.plane_motions(after)
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
            for part in self._loading.held:
                change = np.broadcast_to(part.displacement(after) - part.displacement(before), (len(part.points), self.body.dimension))
                for component in part.components:
                    moved[part.points, component] = change[:, component]
            power += self._share.sum(reactions.at_points * moved) / step
        return power

    def growth(self, before: float, after: float) -> None:
        """Return None: conditions of this kind do not determine how far the body's extent changes."""

    def pushes(self, force: InternalForce, least: float = 0.0) -> bool:
        """Return whether some point is compressed in the state last evaluated, by the virial stress of its bonds.

        The bound of that stress is its own: no `least` force enters.
        """
        n, bonds, positions = len(self.body), self.body.bonds, force.positions
        arms, pulls = positions[bonds.second] - positions[bonds.first], force.pair_forces()
        stress = np.empty((n, self.body.dimension, self.body.dimension))
        for i in range(self.body.dimension):
            for j in range(self.body.dimension):
                product = (pulls[:, i] * arms[:, j] + pulls[:, j] * arms[:, i]) / 4
                stress[:, i, j] = sums_at_points(n, bonds.first, bonds.second, product, 1) / self.body.volumes
        least, *_, greatest = np.linalg.eigvalsh(stress).T
        least, greatest = -self._share.greatest(-least), self._share.greatest(greatest)
        return bool(least < -max(COMPRESSED * greatest, NO_STRESS[force.precision] * self._shear_modulus))

    def response(self, displacements: np.ndarray) -> np.ndarray:
        """Return the displacements of the body, shape (n, d), near held components that are displaced by (n, d)."""
        still = np.zeros((len(self._loading.planes), self.body.dimension))
        return self._stiffness.response(displacements, still)

    @cached_property
    def _stiffness(self) -> Extension:
        return Extension(self.body, self._springs, self._loading.free)

    def _followed(self, positions: np.ndarray, before: float, after: float) -> np.ndarray:
        """Return the guess that follows held parts, in enough portions of the way that none turns far and points move along arcs."""
        portions = max(1, math.ceil(self._turned(before, after) / LARGEST_TURN))
        for start, end in pairwise(np.linspace(before, after, portions + 1)):
            positions = self._extended(positions, self._loading.plane_motions(start), end)
        return positions

    def _greatest_strain(self, before: np.ndarray, after: np.ndarray) -> float:
        """Return the greatest strain of a bond on the way from one state to another."""
        self._share.fill(before)
        return self._share.greatest(greatest_bond_strain(self.body, before, after))

    def _extended(self, start: np.ndarray, planes: np.ndarray, t: float) -> np.ndarray:
        """Return the positions in which all held parts are in their place at t, from a start with planes moved by (p, d, d + 1).

        An affine map fitted to the motion of the held parts is applied first: it captures homogeneous deformations and rotations of the
        whole body. The remaining held displacements are then interpolated as by a network of springs.
        """
        goal_planes = self._loading.plane_motions(t)
        self._share.fill(start)
        samples = self._samples(start, planes, goal_planes, t)
        changes = samples.goals - samples.places[np.arange(len(samples.goals)), samples.components]
        farthest = self._share.greatest(np.abs(changes))
        if farthest == 0:
            return start.copy()
        everywhere = Samples(*(self._share.joined(rows, samples.points) for rows in (samples.places, samples.components, samples.goals)))
        gradient, shift = affine_extension(everywhere, lambda direction: self._spread(start @ direction))
        guess = start @ gradient.T + shift
        mapped = (samples.places @ gradient.T + shift)[np.arange(len(samples.goals)), samples.components]
        left = samples.goals - mapped
        if self._share.greatest(np.abs(left)) > 1e-6 * min(farthest, self.body.spacing):
            moved, at, of_planes = np.zeros_like(start), 0, np.zeros(goal_planes.shape[:2])
            turns = self._turns_left(planes, goal_planes, gradient)
            for part in self._loading.held:
                for component in part.components:
                    moved[part.points, component] = left[at : at + len(part.points)]
                    at += len(part.points)
            for number, (sources, held) in enumerate(zip(self._loading.beside_planes, self._loading.planes, strict=True)):
                for component in held.components:
                    # Along its plane the affine map need not follow every place alike.
                    of_planes[number, component] = self._share.joined(left[at : at + len(sources)], sources).mean()
                    at += len(sources)
                if turns is not None and len(held.components) == self.body.dimension:
                    of_planes[number] = goal_planes[number, :, -1] - gradient @ planes[number, :, -1] - shift
            guess += self._stiffness.response(moved, of_planes, turns)
        for part in self._loading.held:
            goal = self._goal(part, t, start)
            for component in part.components:
                guess[part.points, component] = goal[:, component]
        return guess

    def _spread(self, values: np.ndarray) -> float:
        """Return the standard deviation of values at the points, shape (n,)."""
        mean = self._share.sum(values) / self._share.size
        return float(np.sqrt(self._share.sum(np.square(values - mean)) / self._share.size))

    def _turns_left(self, planes: np.ndarray, goal_planes: np.ndarray, gradient: np.ndarray) -> np.ndarray | None:
        """Return the remainder of the planes' turns after an affine map of a given gradient, as in `Ghosts.shifts`; None if none turns.

        If one plane turns, the map turns the others by a part of that, which their remainder cancels.
        """
        if all(plane.turn is None for plane in self._loading.planes):
            return None
        identity = np.eye(self.body.dimension)
        left = identity + goal_planes[:, :, :-1] - gradient @ (identity + planes[:, :, :-1])
        left[[len(plane.components) < self.body.dimension for plane in self._loading.planes]] = 0.0
        return left

    def _samples(self, start: np.ndarray, planes: np.ndarray, goal_planes: np.ndarray, t: float) -> Samples:
        """Return the places that are held and where they go: points, then planes, at the places next to points of the body."""
        places, components, goals = [np.zeros((0, self.body.dimension))], [np.zeros(0, dtype=int)], [np.zeros(0)]
        points = [np.zeros(0, dtype=int)]

        def add(numbers: np.ndarray, there: np.ndarray, component: int, goal: np.ndarray) -> None:
            points.append(numbers)
            places.append(there)
            components.append(np.full(len(there), component))
            goals.append(goal)

        for part in self._loading.held:
            goal = self._goal(part, t, start)
            for component in part.components:
                add(part.points, start[part.points], component, goal[:, component])
        planes_held = zip(self.body.planes, self._loading.planes, self._loading.beside_planes, strict=True)
        for number, (plane, held, sources) in enumerate(planes_held):
            there, at_rest = start[sources].copy(), self.body.points[sources].copy()
            at_rest[:, plane.axis] = plane.position
            now, then = displaced(planes[number], at_rest), displaced(goal_planes[number], at_rest)
            for component in held.components:
                there[:, component] = at_rest[:, component] + now[:, component]
            for component in held.components:
                add(sources, there, component, there[:, component] + (then - now)[:, component])
        return Samples(*map(np.concatenate, (places, components, goals, points)))

    def _goal(self, part: HeldPoints, t: float, start: np.ndarray) -> np.ndarray:
        """Return the places of held points at t, shape (k, d); that of a support goes as far as the mean of its points does."""
        displacement = part.displacement(t)
        if part.support is None:
            return self.body.points[part.points] + displacement
        return start[part.points] + displacement - (start[part.every] - self.body.points[part.every]).sum(axis=0) / part.support.count
