"""Loads: forces on the boundary, in the volume and on points, and pressures that follow the boundary (theory (42)-(46))."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..body import Body, ReflectionPlane
from ..body.share import Share
from ..body.surface import Following, Surface
from ..forces import InternalForce, InvalidState
from ..scenes.amplitudes import amplitude_of
from ..scenes.loading import Load
from ..scenes.model import EDGES, Scene
from .conditions import AT_REST

if TYPE_CHECKING:
    from .regions import BodyRegions
    from .supports import Supports

ON_A_PLANE = 1e-6
"""Spacings within which a facet counts as lying in a plane of reflection."""


@dataclass(frozen=True)
class _DeadForces:
    """A load whose forces keep their size and direction: where it acts, and with what where its amplitude is 1, shape (k, d)."""

    points: np.ndarray
    forces: np.ndarray


class _Pressures:
    """All pressures of a scene, facet by facet; a facet that two of them act on is here twice.

    Parameters
    ----------
    share : Share
        What is here of the body: of all facets something may hang on points elsewhere, so that all parts find all of them together.
    surface : Surface
    facets : ndarray of int, shape (f,)
    loads : ndarray of int, shape (f,)
        Number of the load that presses on each facet.
    values : ndarray, shape (f,)
        Pressures where the amplitude is 1.
    deformed : ndarray of bool, shape (f,)
        Whether they act on the thickness that the sheet has in its deformed state.

    Attributes
    ----------
    loads : ndarray of int, shape (f,)
    needs_thickness : bool
    """

    def __init__(
        self, share: Share, surface: Surface, facets: np.ndarray, loads: np.ndarray, values: np.ndarray, deformed: np.ndarray
    ) -> None:
        self._share = share
        corners = [surface.interpolation[nodes] for nodes in surface.facets[facets].T]
        # Of the body's points only those that the facets hang on: what is done at every evaluation is as small as the boundary.
        self._points = np.unique(np.concatenate([rows.points() for rows in corners]))
        first, *others = (rows.of_points(self._points) for rows in corners)
        self._middle = Following.mean([first, *others])
        self._sides = [other - first for other in others]
        self._spread = self._middle.T
        self.loads, self._values, self._undeformed = loads, values, ~deformed
        self.needs_thickness = bool(deformed.any())
        self._pressures = np.zeros(len(values))
        # What facets enclose is measured about a place within the body, where least is lost to rounding.
        self._origin = surface.nodes.mean(axis=0)
        start = surface.nodes[surface.facets[facets]] - self._origin
        self._enclosed_at_rest = _enclosed(start.mean(axis=1), [start[:, end] - start[:, 0] for end in range(1, start.shape[1])])

    def set(self, factors: np.ndarray) -> None:
        """Take the present amplitudes of all loads."""
        np.multiply(self._values, factors[self.loads], out=self._pressures)

    def on_facets(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Force on every facet, shape (f, d) (theory (44), (45)).

        Raises
        ------
        InvalidState
            Where there is none.
        """
        sides = self._sides_at(positions)
        pull = self._pressures
        if self.needs_thickness:
            there = self._share.total(self._middle @ thickness[self._points])
            there[self._undeformed] = 1.0
            if not (there > 0).all():
                raise InvalidState("the thickness of the sheet that a pressure acts on, continued to the boundary, is not positive there")
            pull = pull * there
        forces = np.empty_like(sides[0])
        if len(sides) == 1:
            np.multiply(pull, sides[0][:, 1], out=forces[:, 0])
            np.multiply(pull, sides[0][:, 0], out=forces[:, 1])
            np.negative(forces[:, 0], out=forces[:, 0])
        else:
            np.multiply(-0.5 * pull[:, None], np.cross(*sides), out=forces)
        if not np.isfinite(forces).all():
            raise InvalidState("the force of a pressure on the boundary is not finite")
        return forces

    def add(self, positions: np.ndarray, thickness: np.ndarray | None, out: np.ndarray) -> None:
        """Add the forces on the points to `out`, shape (n, d)."""
        out[self._points] += self._spread @ self.on_facets(positions, thickness)

    def middles(self, vectors: np.ndarray) -> np.ndarray:
        """What the middles of the facets do where the points have the given positions or velocities, shape (f, d)."""
        return self._share.total(self._middle @ vectors.take(self._points, axis=0))

    def _sides_at(self, positions: np.ndarray) -> list[np.ndarray]:
        """Vectors along the sides of the facets."""
        places = positions.take(self._points, axis=0)
        return [self._share.total(rows @ places) for rows in self._sides]

    def potential(self, positions: np.ndarray) -> float:
        """Pressure times the area or volume that the facets have swept since rest (theory (46)); of pressures that have a potential."""
        enclosed = _enclosed(self.middles(positions) - self._origin, self._sides_at(positions))
        return float((self._pressures * (enclosed - self._enclosed_at_rest)).sum())


def _edge_of(plane: ReflectionPlane) -> str:
    """Name of the edge that a plane holds."""
    return next(edge for edge, place in EDGES.items() if place == (plane.axis, plane.side))


def _enclosed(middles: np.ndarray, sides: list[np.ndarray]) -> np.ndarray:
    """Area or volume between each facet and the origin: in sum, what a closed chain or surface of facets encloses."""
    if len(sides) == 1:
        return 0.5 * _cross(middles, sides[0])
    return (middles * np.cross(*sides)).sum(axis=1) / 6


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] if a.shape[1] == 2 else np.cross(a, b)


def _closed(facets: np.ndarray) -> bool:
    """Whether facets of the given nodes, shape (f, d), have no rim: all that bounds one of them bounds another the other way round."""
    if facets.shape[1] == 2:
        count = facets.max() + 1
        return bool((np.bincount(facets[:, 0], minlength=count) == np.bincount(facets[:, 1], minlength=count)).all())
    sides = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    one, other = (np.unique(ends, axis=0, return_counts=True) for ends in (sides, sides[:, ::-1]))
    return all(np.array_equal(mine, theirs) for mine, theirs in zip(one, other, strict=True))


class Loads:
    """The loads of a scene on a body, at one value of the loading parameter at a time.

    Forces that keep their size and direction are summed once for a value of the parameter; only pressures are found anew in every state.

    Parameters
    ----------
    scene : Scene
    body : Body
    regions : BodyRegions

    Attributes
    ----------
    needs_thickness : bool
        Whether a pressure acts on the deformed thickness: then all that asks for a state asks for the thickness too, as the stretch of it
        at the points, J3 / det F, shape (n,).
    no_potential_because : str or None
        Why the loads are not minus the derivative of a potential; None if they are.

    Raises
    ------
    ValueError
        For a region that is empty, or a load on an edge that is held by reflection; names the key.
    """

    def __init__(self, scene: Scene, body: Body, regions: BodyRegions) -> None:
        self.body = body
        # A name that several loads have, as traction and pressure on one edge may, stands for all of them.
        self._names = [load.name or regions.label(load.region, f"loads.{number}") for number, load in enumerate(scene.loads)]
        distinct = list(dict.fromkeys(load.amplitude for load in scene.loads))
        self._amplitudes = [amplitude_of(amplitude) for amplitude in distinct]
        self._followed = np.array([distinct.index(load.amplitude) for load in scene.loads])
        self._dead: dict[int, _DeadForces] = {}
        self.no_potential_because: str | None = None
        pressed = []
        for number, load in enumerate(scene.loads):
            if load.kind == "pressure":
                facets = self._facets(number, load, regions)
                deformed = scene.plane == "stress" and load.thickness != "undeformed"
                self._note_potential(self._names[number], deformed, regions.surface().facets[facets])
                pressed.append((facets, *(np.full(len(facets), value) for value in (number, load.pressure, deformed))))
            else:
                self._dead[number] = self._dead_forces(number, load, regions)
        self._pressures = _Pressures(body.share, regions.surface(), *map(np.concatenate, zip(*pressed, strict=True))) if pressed else None
        # Dead loads of one amplitude act as one.
        self._patterns: dict[int, np.ndarray] = {}
        for number, dead in self._dead.items():
            pattern = self._patterns.setdefault(self._followed[number], np.zeros_like(body.points))
            pattern[dead.points] += dead.forces
        self._present = np.zeros_like(body.points) if self._patterns else None
        self.needs_thickness = self._pressures is not None and self._pressures.needs_thickness
        self.set(0.0)

    def _facets(self, number: int, load: Load, regions: BodyRegions) -> np.ndarray:
        """Facets that a traction or pressure acts on; none may lie in a plane in which the body is reflected."""
        facets, surface = regions.facets(load.region), regions.surface()
        for plane in self.body.planes:
            distance = np.abs(surface.nodes[surface.facets[facets]][..., plane.axis] - plane.position)
            if (distance < ON_A_PLANE * self.body.spacing).all(axis=1).any():
                edge = self._told(_edge_of(plane))
                raise ValueError(
                    f"loads.{number}.region: it takes in facets of the {edge}, which is held by reflection, so that a {load.kind} "
                    f"there goes into what holds it; leave the {edge} out, or hold points (support=points)"
                )
        return facets

    def _told(self, edge: str) -> str:
        """What messages call an edge or face."""
        return f"{edge} {'edge' if self.body.dimension == 2 else 'face'}"

    def _dead_forces(self, number: int, load: Load, regions: BodyRegions) -> _DeadForces:
        """A dead load as forces on points (theory (43))."""
        if load.kind == "traction":
            facets, surface = self._facets(number, load, regions), regions.surface()
            corners = [surface.interpolation[nodes] for nodes in surface.facets[facets].T]
            spread = [sum(others, first).T for first, *others in zip(*(one.rows for one in corners), strict=True)]
            sizes = np.stack([rows @ surface.areas()[facets] / len(corners) for rows in spread], axis=1)
            points = np.flatnonzero(sizes.any(axis=1))
            return _DeadForces(points, sizes[points] * np.array(load.traction))
        if load.kind == "force" and regions.edge(load.region) in map(_edge_of, self.body.planes):
            # It would pull at points half a cell inside the edge, which are free.
            edge = self._told(regions.edge(load.region))
            raise ValueError(
                f"loads.{number}.region: the {edge} is held by reflection, so that a force there goes into what holds it; give another "
                "region, or hold points (support=points)"
            )
        points = self.body.share.own_points(regions.points(load.region))
        if load.kind == "body_force":
            return _DeadForces(points, self.body.volumes[points, None] * np.array(load.body_force))
        share = np.array(load.force) / self.body.share.total(len(points))
        return _DeadForces(points, np.tile(share, (len(points), 1)))

    def _note_potential(self, name: str, deformed: bool, facets: np.ndarray) -> None:
        """Note why a pressure on facets of the given nodes has no potential, if it has none."""
        closed = _closed(facets)
        if deformed:
            why = "acts on the deformed thickness; on the undeformed one (thickness=undeformed) a closed boundary would give it a potential"
        elif not closed:
            why = "acts on a part of the boundary that is not closed"
        else:
            return
        self.no_potential_because = self.no_potential_because or f"the pressure on {name} {why}"

    @property
    def conservative(self) -> bool:
        """Whether the loads are minus the derivative of their `potential`."""
        return self.no_potential_because is None

    def set(self, t: float) -> None:
        """Bring all loads to their size at a value of the loading parameter.

        Raises
        ------
        InvalidState
            Where an amplitude or a force has no finite value there.
        """
        try:
            factors = np.array([amplitude(t) for amplitude in self._amplitudes])
        except ValueError as error:
            raise InvalidState(f"loads: {error}") from None
        self._factors = factors[self._followed]
        if self._pressures is not None:
            self._pressures.set(self._factors)
        if self._present is not None:
            self._present[:] = 0.0
            with np.errstate(over="ignore"):
                for number, pattern in self._patterns.items():
                    self._present += factors[number] * pattern
            if not np.isfinite(self._present).all():
                raise InvalidState(f"loads: a force is not finite at t = {t:g}")

    def vanish(self, t: float) -> bool:
        """Whether there are none at a value of the loading parameter."""
        return all(abs(amplitude(t)) <= AT_REST for amplitude in self._amplitudes)

    def forces(self, positions: np.ndarray, thickness: np.ndarray | None, out: np.ndarray) -> None:
        """Add the forces of the loads on the points, in the plane per unit thickness of the undeformed body, to `out` (n, d).

        Parameters
        ----------
        positions : ndarray, shape (n, d)
        thickness : ndarray, shape (n,), or None
            See `needs_thickness`.
        out : ndarray, shape (n, d)

        Raises
        ------
        InvalidState
            Where a pressure has no force.
        """
        if self._present is not None:
            out += self._present
        if self._pressures is not None:
            self._pressures.add(positions, thickness, out)

    def potential(self, positions: np.ndarray) -> float:
        """Potential energy of the loads of their present size, zero at rest (theory (46)); of loads that are `conservative`.

        Raises
        ------
        TypeError
            If there is none.
        """
        if not self.conservative:
            raise TypeError(f"these loads have no potential: {self.no_potential_because}")
        potential = 0.0
        if self._present is not None:
            potential -= float(np.einsum("nc,nc->", self._present, positions - self.body.points))
        if self._pressures is not None:
            potential += self._pressures.potential(positions) * self.body.share.leads
        return potential

    def power(self, positions: np.ndarray, velocities: np.ndarray, thickness: np.ndarray | None = None) -> float:
        """Power of the loads in a state in which the points have the given velocities (n, d)."""
        power = 0.0
        if self._present is not None:
            power += float(np.einsum("nc,nc->", self._present, velocities))
        if self._pressures is not None:
            of_facets = self._pressures.on_facets(positions, thickness) * self._pressures.middles(velocities)
            power += float(of_facets.sum()) * self.body.share.leads
        return power

    def by_name(self, positions: np.ndarray, thickness: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Total force of the loads in a state, shape (d,), by name; loads of one name are summed."""
        totals = {name: np.zeros(self.body.dimension) for name in self._names}
        for name, _, forces in self._actions(positions, thickness):
            totals[name] += forces.sum(axis=0)
        return {name: self.body.share.total(total) for name, total in totals.items()}

    def displacements(self, positions: np.ndarray) -> dict[str, np.ndarray]:
        """Mean displacement of what the loads act on, shape (d,), by name; loads of one name are taken together.

        Of a force that with which it works: points count by what they take of it, which on the boundary is the motion of the boundary
        itself.  Of a pressure that of the middles of its facets.
        """
        sums: dict[str, tuple[np.ndarray, float]] = {name: (np.zeros(self.body.dimension), 0.0) for name in self._names}

        def take(name: str, moved: np.ndarray, weights: np.ndarray) -> None:
            total, weight = sums[name]
            sums[name] = total + weights @ moved, weight + float(weights.sum())

        displacement = positions - self.body.points
        for number, dead in self._dead.items():
            total = self.body.share.total(dead.forces.sum(axis=0))
            take(self._names[number], displacement[dead.points], dead.forces @ total / max(np.linalg.norm(total), 1e-300))
        if self._pressures is not None:
            moved = self._pressures.middles(displacement)
            for number in np.unique(self._pressures.loads):
                own = self._pressures.loads == number
                take(self._names[number], moved[own], np.full(int(own.sum()), float(self.body.share.leads)))
        sums = {name: (self.body.share.total(total), self.body.share.total(weight)) for name, (total, weight) in sums.items()}
        return {name: total / weight if weight else total for name, (total, weight) in sums.items()}

    def moments(self, positions: np.ndarray, about: np.ndarray, thickness: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Moment of the loads in a state about a place (d,), by name; loads of one name are summed.

        In the plane counter-clockwise, shape (); in space vectors, shape (3,).
        """
        totals = dict.fromkeys(self._names, 0.0)
        for name, places, forces in self._actions(positions, thickness):
            totals[name] = totals[name] + _cross(places - about, forces).sum(axis=0)
        return {name: self.body.share.total(total) for name, total in totals.items()}

    def _actions(self, positions: np.ndarray, thickness: np.ndarray | None) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """Name, places (k, d) and forces (k, d) of every load."""
        for number, dead in self._dead.items():
            yield self._names[number], positions[dead.points], self._factors[number] * dead.forces
        if self._pressures is not None:
            places, forces = self._pressures.middles(positions), self._pressures.on_facets(positions, thickness)
            for number in np.unique(self._pressures.loads):
                own = (self._pressures.loads == number) & self.body.share.leads
                yield self._names[number], places[own], forces[own]


class LoadedForce:
    """An internal force, loads and supports at places: all that solvers ask of a force, given in the place of it where there are any.

    What a bond or a point holds by itself is asked of the internal force; of that only what solvers need is passed on.

    Parameters
    ----------
    internal : InternalForce
    loads : Loads or None
    supports : Supports, optional

    Attributes
    ----------
    internal, loads, supports
    body, law, precision, nearly_incompressible, zero_energy_modes
        Of the internal force.
    has_energy : bool
        Whether the sum of both is minus the derivative of an energy.
    """

    def __init__(self, internal: InternalForce, loads: Loads | None, supports: Supports | None = None) -> None:
        self.internal, self.loads, self.supports = internal, loads, supports
        self.body, self.law, self.precision = internal.body, internal.law, internal.precision
        self.has_energy = internal.has_energy and (loads is None or loads.conservative)
        self.nearly_incompressible, self.zero_energy_modes = internal.nearly_incompressible, internal.zero_energy_modes
        self._thickness, self._product = np.ones(len(internal.body)), np.empty(len(internal.body))

    @property
    def no_energy_because(self) -> str | None:
        """What the loads have against an energy; None where that is not what is missing."""
        return None if self.loads is None else self.loads.no_potential_because

    @property
    def evaluations(self) -> int:
        """Begun so far."""
        return self.internal.evaluations

    @property
    def positions(self) -> np.ndarray:
        """See `InternalForce`."""
        return self.internal.positions

    @property
    def supported(self) -> np.ndarray:
        """See `InternalForce`."""
        return self.internal.supported

    @property
    def force_scale(self) -> float | np.ndarray:
        """See `InternalForce`."""
        return self.internal.force_scale

    @property
    def stiffness_moduli(self) -> float | np.ndarray:
        """See `InternalForce`."""
        return self.internal.stiffness_moduli

    def __call__(self, positions: np.ndarray, out: np.ndarray) -> None:
        """Internal force and loads on every point at positions (n, d), in the plane per unit thickness, written to `out` (n, d).

        Raises
        ------
        InvalidState
            Where the state has no force.
        OutsideDomain
            See `InternalForce`.
        """
        if self.supports is not None:
            self.supports.place(positions)
        self.internal(positions, out)
        if self.loads is not None:
            self.loads.forces(positions, self.thickness(), out)
        if self.supports is not None:
            self.supports.fold(out)

    def applied(self) -> np.ndarray | None:
        """See `InternalForce`."""
        if self.loads is None:
            return self.internal.applied()
        found = np.zeros_like(self.body.points)
        self.loads.forces(self.positions[: len(self.body)], self.thickness(), found)
        return found

    def thickness(self) -> np.ndarray | None:
        """Stretch of the thickness at the points in the state last evaluated, shape (n,), valid until the next; None if no load needs it.

        Raises
        ------
        InvalidState
            Where there is none.
        """
        if self.loads is None or not self.loads.needs_thickness:
            return None
        J3, F = self.internal.volume_ratios(), self.internal.deformation_gradients()
        thickness, product = self._thickness, self._product
        np.multiply(F[:, 0, 0], F[:, 1, 1], out=thickness)
        np.multiply(F[:, 0, 1], F[:, 1, 0], out=product)
        thickness -= product
        return np.divide(J3, thickness, out=thickness)

    def energy(self) -> float:
        """Stored energy and potential of the loads, per unit thickness, in the state last evaluated; where there are both."""
        energy = self.internal.energy()
        return energy if self.loads is None else energy + self.loads.potential(self.internal.positions[: len(self.body)])

    def pair_forces(self, pairs: np.ndarray | None = None) -> np.ndarray:
        """See `InternalForce`."""
        return self.internal.pair_forces(pairs)

    def forces_beside_pairs(self) -> np.ndarray | None:
        """See `InternalForce`."""
        return self.internal.forces_beside_pairs()

    def linearised_dilatation(self):
        """See `InternalForce`."""
        return self.internal.linearised_dilatation()

    def levers_on_planes(self) -> np.ndarray | None:
        """See `InternalForce`."""
        return self.internal.levers_on_planes()

    def state_arrays(self) -> dict[str, np.ndarray]:
        """See `InternalForce`; loads have none of their own."""
        return self.internal.state_arrays()

    def move_plane(self, plane: int, displacement, turn: np.ndarray | None = None) -> None:
        """See `InternalForce`."""
        self.internal.move_plane(plane, displacement, turn)
