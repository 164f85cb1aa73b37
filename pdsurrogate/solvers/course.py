"""First guesses of equilibria, initial velocities of dynamics, and the rate of work of supports,
from the motions of held parts.
"""

import math
import weakref
from collections.abc import Callable
from functools import cached_property
from itertools import pairwise

import numpy as np

from ..body.body import sums_at_points
from .bond_strains import greatest_bond_strain
from .conditions import Loading, Motions
from .equilibrium import TooFar
from .increments import Motion
from .loaded_force import LoadedForce
from .nearest_bonds import inverse_of, network_of
from .obstacles import ContactStiffness
from .preconditioner import extension_of
from .reactions import Reactions, support_reactions
from .rigid import displaced

COMPRESSED = 0.05
"""Compressive stress of a point, divided by the greatest tensile stress in the body, beyond which
the body is checked for buckling. Chosen above the compression that points at free edges show
because their horizons are incomplete.
"""

NO_STRESS = {"float32": 1e-5, "float64": 1e-10}
"""Compressive stress, divided by the shear modulus, that may be a rounding error of the forces, by
precision of the forces. Chosen: a hundred times the rounding of single precision; in double
precision there is room for a much wider margin, since rounding of a pressure is multiplied by K/mu.
"""

LARGEST_TURN = 10.0
"""Greatest rotation of held parts, in degrees, in one step of the first guess of an equilibrium;
greater rotations take several steps. In a step points between held parts move along chords of their
arcs, which shrinks the body half way between these parts by 0.4 % for 10 degrees and 13 % for 60.
Chosen: 2, 5 and 10 degrees need equally many force evaluations (twisted boxes and cylinders).
"""

HALVINGS = 10
"""Greatest number of halvings in the search for a first increment; an increment a thousand times
too long is a mistake in the scene.
"""

CLOSE = 0.02
"""Strain of the first guess between two grips up to which an extrapolation is tried beside it.
Longer increments take fewer evaluations without; those of slow tears take a tenth more.
"""

AHEAD = 1e-6
"""Interval of the difference quotients that give initial velocities, as a fraction of a stage of
the loading. Chosen: relative to the velocities the truncation error is then some 1e-6, and the
rounding error less.
"""


LEAST_SPREAD = 0.5
"""Standard deviation of held places along a direction, divided by that of the body's points, above
which these places determine the gradient of an affine map along this direction. Chosen: places on
two opposite sides spread more than the body, and places on one side only by the width of its layer
of points, which is noise.
"""


class Paths:
    """First guesses, initial velocities and power for a body whose held parts follow prescribed
    paths.

    Parameters
    ----------
    loading : Loading
    springs : float or ndarray, shape (n,)
        Shear modulus to which the stiffness of the springs is proportional that spread held
        displacements into the body in a first guess.
    shear_modulus : float
        Unit of the stresses that `pushes` compares.
    largest_strain : float
        Greatest strain of a bond that a first guess may make.
    pull : callable, optional
        For a body between two grips the force with which they pull, as a function of the forces of
        the supports.
    """

    def __init__(
        self,
        loading: Loading,
        springs: float | np.ndarray,
        shear_modulus: float,
        largest_strain: float,
        pull: Callable[[np.ndarray], float] | None = None,
    ) -> None:
        # With a circle of references the body would stay in memory until a collection of garbage.
        self._loading, self.body, self._share = (
            weakref.proxy(loading),
            loading.body,
            loading.body.share,
        )
        # A slightly larger bound accepts increments of exactly that strain.
        self._springs = springs
        self._shear_modulus = shear_modulus
        self._largest_strain = largest_strain * (1 + 1e-6)
        self._pull = pull
        self.between_grips = pull is not None

    def largest_increment(
        self,
        positions: np.ndarray,
        start: float,
        end: float,
        asked: float | None,
        largest_strain: float = math.inf,
    ) -> float:
        """Return the greatest increment to plan between two values of the loading parameter.

        The increment begins as the whole difference, or `asked` if that is less, and is halved, at
        most `HALVINGS` times, until its first guess strains no bond by more than `largest_strain`,
        here or of the paths.

        Parameters
        ----------
        positions : ndarray, shape (n, d)
            Equilibrium at the parameter `start`.
        start, end : float
            Values of the loading parameter.
        asked : float or None
            Bound that the scene sets on increments; None for no bound.
        largest_strain : float
        """
        largest_strain = min(largest_strain, self._largest_strain)
        largest = min(abs(end - start), asked or math.inf) or 1.0
        for _ in range(HALVINGS):
            share = min(1.0, largest / abs(end - start)) if end != start else 1.0
            if self._followed(positions, start, start + share * (end - start))[1] <= largest_strain:
                break
            largest /= 2
        return largest

    def guesses(
        self,
        positions: np.ndarray,
        before: float,
        after: float,
        earlier: tuple[float, np.ndarray] | None,
    ) -> list[np.ndarray]:
        """Return one or two first guesses of the equilibrium at the parameter `after`; the caller
        chooses the better.

        The first guess follows the held parts from the last equilibrium; the second, if an earlier
        equilibrium is known, extrapolates linearly from both equilibria, between two grips over
        short ways alone (`CLOSE`), unless the earlier one is at `after` itself.

        Parameters
        ----------
        positions : ndarray, shape (n, d)
            Last equilibrium, at the parameter `before`.
        before, after : float
            Values of the loading parameter.
        earlier : tuple of float and ndarray, or None
            Parameter and positions of the equilibrium before the last.

        Raises
        ------
        TooFar
            If the first guess strains a bond by more than `largest_strain`.
        """
        guess, strain = self._followed(positions, before, after)
        if strain > self._largest_strain:
            raise TooFar(
                f"the first guess strains a bond by {strain:.2g}, more than"
                f" solver.largest_increment = {self._largest_strain:.4g}"
            )
        if earlier is None or earlier[0] == before or after == before:
            return [guess]
        if self.between_grips and strain > CLOSE and earlier[0] != after:
            return [guess]
        ratio = (after - before) / (before - earlier[0])
        planes = self._loading.plane_motions(before)
        planes = planes + ratio * (planes - self._loading.plane_motions(earlier[0]))
        return [
            guess,
            self._outside(
                self._extended(positions + ratio * (positions - earlier[1]), planes, after), after
            ),
        ]

    def velocities(self, positions: np.ndarray, motion: Motion) -> np.ndarray:
        """Return initial velocities of dynamics, shape (n, d), with which a body in equilibrium
        follows its held parts without a shock.
        """
        ahead = motion.begin + AHEAD * (motion.end - motion.begin)
        guess = self._extended(positions, self._loading.plane_motions(motion.begin), ahead)
        return (guess - positions) / (AHEAD * motion.duration)

    def work(self, reactions: Reactions, before: float, after: float) -> float:
        """Return the work of all supports on the body at constant reactions, in two dimensions per
        unit thickness, while the loading parameter changes from one value to another.
        """
        return float(self.works(reactions, *map(self._loading.motions_at, (before, after))))

    def works(self, reactions: Reactions, old: Motions, new: Motions) -> float | np.ndarray:
        """Return the work as of `work`, from motions at one value of the parameter to those at
        another, or, of arrays with further axes, that of each step.
        """
        loading = self._loading
        found = 0.0
        if loading.of_points:
            moves = new.of_points - old.of_points
            if loading.supports:  # each point around a place carries the reaction at the held one
                counts = np.array([part.count for part in loading.held])
                moves = counts[loading.part[loading.at_points]] * moves
            found = self._share.total((reactions.at_held * moves).sum(axis=-1))
        if reactions.on_planes is None:
            return found
        return found + self._work_of_planes(reactions, old.of_planes, new.of_planes)

    def _work_of_planes(
        self, reactions: Reactions, old: np.ndarray, new: np.ndarray
    ) -> float | np.ndarray:
        changes = new - old
        shifts = changes[..., -1]
        work = 0.0
        if reactions.levers is not None:
            # The place X of a plane is at y = X + u(X): the change of u is a linear function of y.
            by_place = np.linalg.solve(
                (np.eye(self.body.dimension) + old[..., :-1]).mT, changes[..., :-1].mT
            ).mT
            shifts = shifts - np.einsum("...rc,...c->...r", by_place, old[..., -1])
            work = _sums(reactions.levers * by_place, 3)
        return work + _sums(reactions.on_planes * shifts, 2)

    def pushes(self, force: LoadedForce, least: float = 0.0) -> bool:
        """Return whether grips push in the state last evaluated, with more than the force `least`,
        or else whether a point is compressed.

        The compression, by the virial stress of bonds, must exceed `COMPRESSED` times the greatest
        tension and `NO_STRESS` times the shear modulus.
        """
        if self._pull is not None:
            return self._pull(support_reactions(self._loading, force).forces) < -least
        n, d = self.body.points.shape
        first = self.body.bonds.first
        second = self.body.bonds.second
        positions = force.positions
        arms = positions[second] - positions[first]
        pulls = force.pair_forces()
        products = (pulls[:, :, None] * arms[:, None] + arms[:, :, None] * pulls[:, None]) / 4
        sums = (
            sums_at_points(n, first, second, products.reshape(-1, d * d), 1)
            / self.body.volumes[:, None]
        )
        least, *_, greatest = np.linalg.eigvalsh(sums[self._share.own].reshape(-1, d, d)).T
        least = -self._share.greatest(-least)
        greatest = self._share.greatest(greatest)
        return bool(
            least < -max(COMPRESSED * greatest, NO_STRESS[force.precision] * self._shear_modulus)
        )

    def response(self, displacements: np.ndarray) -> np.ndarray:
        """Return the displacements (n, d) of the body, modeled as a network of springs, for
        displacements (n, d) of held components.
        """
        return self._extend(
            displacements, np.zeros((len(self._loading.planes), self.body.dimension))
        )

    @cached_property
    def _extend(self) -> Callable[..., np.ndarray]:
        return extension_of(self.body, self._springs, self._loading.free)

    @cached_property
    def _contact(self) -> ContactStiffness:
        network = network_of(self.body, self._springs)
        return ContactStiffness(
            inverse_of(network, self._loading.free), self._loading.loads.obstacles
        )

    def _outside(self, guess: np.ndarray, t: float) -> np.ndarray:
        """Return a first guess (n, d) at the parameter `t`, with its boundary moved out of the
        obstacles as they are then.
        """
        loads = self._loading.loads
        if not loads.obstacles:
            return guess
        loads.set(t)
        return self._contact.outside(guess)

    def _followed(
        self, positions: np.ndarray, before: float, after: float
    ) -> tuple[np.ndarray, float]:
        """Return the first guess at parameter `after`, and the greatest strain of a bond from
        `positions`, the state at `before`, to it.

        The guess follows the held parts in steps that turn no held part by more than
        `LARGEST_TURN`, so that points move nearly along arcs.
        """
        turns = (
            abs(part.angle(after) - part.angle(before))
            for part in self._loading.held
            if part.angle is not None
        )
        portions = max(1, math.ceil(max(turns, default=0.0) / LARGEST_TURN))
        guess = positions
        for start, end in pairwise(np.linspace(before, after, portions + 1)):
            guess = self._extended(guess, self._loading.plane_motions(start), end)
        guess = self._outside(guess, after)
        return guess, self._share.greatest(greatest_bond_strain(self.body, positions, guess))

    def _extended(self, start: np.ndarray, planes: np.ndarray, t: float) -> np.ndarray:
        """Return the positions (n, d) to which `start` changes when all held parts move to their
        places at `t`.

        In the state `start` the reflection planes have the motions `planes`. An affine map fitted
        to the motion of the held parts is applied first: it captures homogeneous deformations and
        rotations of the whole body. The remaining held displacements are then interpolated as by a
        network of springs.
        """
        loading = self._loading
        goal_planes = self._loading.plane_motions(t)
        self._share.fill(start)
        places, goals = self._samples(start, planes, goal_planes, t)
        rows = np.arange(len(goals)), loading.component
        farthest = self._share.greatest(np.abs(goals - places[rows]))
        if farthest == 0:
            return start.copy()

        def spread(direction: np.ndarray) -> float:
            along = start @ direction
            along -= self._share.sum(along) / self._share.size
            return float(np.sqrt(self._share.sum(np.square(along)) / self._share.size))

        everywhere = (
            self._share.joined(values, loading.point)
            for values in (places, loading.component, goals)
        )
        gradient, shift = affine_extension(*everywhere, spread)
        guess = start @ gradient.T + shift
        left = goals - (places @ gradient.T + shift)[rows]
        if self._share.greatest(np.abs(left)) > 1e-6 * min(farthest, self.body.spacing):
            moved = np.zeros_like(start)
            of_planes = np.zeros(goal_planes.shape[:2])
            moved[loading.there] = left[loading.at_points]
            for number, component in zip(*np.nonzero(loading.plane_components), strict=True):
                # Along its plane the affine map need not follow every place alike.
                own = (loading.plane == number) & (loading.component == component)
                of_planes[number, component] = self._share.joined(
                    left[own], loading.point[own]
                ).mean()
            turns = None
            if loading.turning:
                # If one plane turns, the map turns the others by a part of that, which the
                # remainder of their turn cancels.
                held = loading.plane_components.all(axis=1)
                identity = np.eye(self.body.dimension)
                turns = (
                    identity + goal_planes[:, :, :-1] - gradient @ (identity + planes[:, :, :-1])
                )
                turns[~held] = 0.0
                of_planes[held] = (goal_planes[:, :, -1] - planes[:, :, -1] @ gradient.T - shift)[
                    held
                ]
            guess += self._extend(moved, of_planes, turns)
        guess[loading.there] = goals[loading.at_points]
        return guess

    def _samples(
        self, start: np.ndarray, planes: np.ndarray, goal_planes: np.ndarray, t: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the present places (k, d) of the held components in the table of `Loading`, and
        the coordinate (k,) of each at `t`.

        A held component of a plane has one row for each point with an image in the plane: the place
        is the projection of the point onto it, but the point's own coordinate in components in
        which the plane is free. `planes` and `goal_planes` are the motions of the planes at the
        positions `start` and at `t` (see `Loading.plane_motions`).
        """
        loading = self._loading
        displacements = start - self.body.points
        there = loading.point, loading.component
        places = start[loading.point]
        goals = self.body.points[there] + loading.moves(t)
        for number, part in enumerate(loading.held):
            if (
                part.others is not None
            ):  # the point of a place between points goes as far as the mean of all its points does
                own = loading.part == number
                mean = displacements[part.every].sum(axis=0) / part.count
                goals[own] += (
                    displacements[loading.point[own], loading.component[own]]
                    - mean[loading.component[own]]
                )
        beside = ~loading.at_points
        number = loading.plane[beside]
        component = loading.component[beside]
        at_rest = loading.place[beside]
        now, then = (displaced(motions[number], at_rest) for motions in (planes, goal_planes))
        there = np.where(loading.plane_components[number], at_rest + now, places[beside])
        rows = np.arange(len(number)), component
        places[beside] = there
        goals[beside] = there[rows] + (then - now)[rows]
        return places, goals


def affine_extension(
    places: np.ndarray,
    components: np.ndarray,
    goals: np.ndarray,
    spread_along: Callable[[np.ndarray], float],
) -> tuple[np.ndarray, np.ndarray]:
    """Return the affine map y -> A y + b that brings given components of places nearest to their
    goals: the gradient A and the shift b.

    Along directions in which the places do not determine the gradient, A is that of the identity.
    Where all places lie on one line, or in three dimensions on one plane, as on a single clamped
    edge or face, A rotates the normal of that line or plane with it.

    Parameters
    ----------
    places : ndarray, shape (k, d)
    components : ndarray of int, shape (k,)
        Component of each place that has a goal.
    goals : ndarray, shape (k,)
        Value that this component must reach.
    spread_along : callable
        Function that returns the standard deviation of the body's points along a direction (d,).
        Places that spread less than `LEAST_SPREAD` times as much do not determine the gradient
        along it.

    Returns
    -------
    gradient : ndarray, shape (d, d)
    shift : ndarray, shape (d,)
    """
    dimension = places.shape[1]
    gradient = np.eye(dimension)
    told = [[] for _ in range(dimension)]
    shift = np.zeros(dimension)
    middles = np.zeros((dimension, dimension))
    for component in range(dimension):
        own = components == component
        if not own.any():
            continue
        middles[component] = middle = places[own].mean(axis=0)
        changes = goals[own] - places[own, component]
        _, spreads, directions = np.linalg.svd(places[own] - middle, full_matrices=False)
        for spread, direction in zip(spreads / np.sqrt(own.sum()), directions, strict=True):
            if spread > LEAST_SPREAD * spread_along(direction) and spread > 0:
                arms = (places[own] - middle) @ direction
                gradient[component] += (arms @ changes) / (arms @ arms) * direction
                told[component].append(direction)
        shift[component] = middle[component] + changes.mean() - gradient[component] @ middle
    if all(len(directions) == dimension - 1 for directions in told):
        normals = [_normal(np.array(directions)) for directions in told]
        wanted = _normal(np.array(told[0]) @ gradient.T)
        length = np.linalg.norm(wanted)
        # Normals that agree within eight degrees.
        if all(abs(normals[0] @ normal) > 0.99 for normal in normals[1:]) and length > 0:
            change = np.outer(wanted / length - gradient @ normals[0], normals[0])
            shift -= (change * middles).sum(axis=1)
            gradient += change
    return gradient, shift


def _normal(directions: np.ndarray) -> np.ndarray:
    """Return a normal (not a unit vector) to one direction in the plane, shape (1, 2), or two in
    three dimensions, shape (2, 3).
    """
    return (
        np.array([-directions[0, 1], directions[0, 0]])
        if directions.shape[1] == 2
        else np.cross(*directions)
    )


def _sums(products: np.ndarray, axes: int) -> float | np.ndarray:
    """Return the sums over so many last axes, each taken in the same order."""
    return products.reshape(*products.shape[:-axes], -1).sum(axis=-1)
