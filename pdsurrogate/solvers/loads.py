"""Loads: forces on the boundary, in the volume and on points, and pressures that follow the boundary (theory (42)-(46))."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..body import Body
from ..body.surface import Following, Surface
from ..forces import InternalForce, InvalidState
from ..ranks import Share
from .supports import Supports

if TYPE_CHECKING:
    from .rigid import RigidRegion

AT_REST = 1e-14
"""Displacement over the extent of the body, or amplitude of a load, that counts as zero: a sine has rounding errors of this size."""

Amplitude = Callable[[float], float]


@dataclass(frozen=True)
class DeadLoad:
    """Load whose forces keep their size and direction.

    Attributes
    ----------
    name : str
        Name under which results report it.
    amplitude : callable
        Factor of the forces, a function of the loading parameter; ValueError where it has no value.
    points : ndarray of int, shape (k,)
    forces : ndarray, shape (k, d)
        Forces where the amplitude is 1.
    """

    name: str
    amplitude: Amplitude
    points: np.ndarray
    forces: np.ndarray


@dataclass(frozen=True)
class Pressure:
    """Pressure on some facets of the boundary.

    Attributes
    ----------
    name, amplitude
        As for `DeadLoad`.
    facets : ndarray of int, shape (f,)
    value : float
        Pressure where the amplitude is 1.
    deformed : bool
        Whether the pressure acts on the thickness of the deformed sheet.
    """

    name: str
    amplitude: Amplitude
    facets: np.ndarray
    value: float
    deformed: bool

    def no_potential_because(self, surface: Surface) -> str | None:
        """Return why the pressure has no potential; None if it has one."""
        if self.deformed:
            why = "acts on the deformed thickness; on the undeformed one (thickness=undeformed) a closed boundary would give it a potential"
        elif not _closed(surface.facets[self.facets]):
            why = "acts on a part of the boundary that is not closed"
        else:
            return None
        return f"the pressure on {self.name} {why}"


class _Facets:
    """Facets on which pressures act; a facet with two pressures occurs twice.

    A facet may depend on points of several shares, so that all shares evaluate all facets together.

    Parameters
    ----------
    share : Share
    surface : Surface
    pressures : dict of Pressure
        Pressures by the number of the load.

    Attributes
    ----------
    loads : ndarray of int, shape (f,)
        Number of the load that presses on each facet.
    """

    def __init__(self, share: Share, surface: Surface, pressures: dict[int, Pressure]) -> None:
        self._share = share
        facets = np.concatenate([pressure.facets for pressure in pressures.values()])
        counts = [len(pressure.facets) for pressure in pressures.values()]
        self.loads = np.repeat(list(pressures), counts)
        self._values = np.repeat([pressure.value for pressure in pressures.values()], counts)
        self._undeformed = np.repeat([not pressure.deformed for pressure in pressures.values()], counts)
        self.needs_thickness = not self._undeformed.all()
        corners = [surface.interpolation[nodes] for nodes in surface.facets[facets].T]
        # Only points that the facets depend on are used, so that the work of an evaluation is proportional to the boundary.
        self._points = np.unique(np.concatenate([rows.points() for rows in corners]))
        first, *others = (rows.of_points(self._points) for rows in corners)
        self._middle = Following.mean([first, *others])
        self._sides = [other - first for other in others]
        self._spread = self._middle.T
        self._pressures = np.zeros(len(facets))
        # Enclosed volumes are measured about a place within the body, which minimises rounding errors.
        self._origin = surface.nodes.mean(axis=0)
        start = surface.nodes[surface.facets[facets]] - self._origin
        self._enclosed_at_rest = _enclosed(start.mean(axis=1), [start[:, end] - start[:, 0] for end in range(1, start.shape[1])])

    def set(self, factors: np.ndarray) -> None:
        """Set the pressures to those at the amplitudes of all loads."""
        np.multiply(self._values, factors[self.loads], out=self._pressures)

    def on_facets(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Return the force on every facet, shape (f, d) (theory (44), (45)).

        Raises
        ------
        InvalidState
            Where a force is not finite, or the thickness not positive.
        """
        sides = self._sides_at(positions)
        pull = self._pressures
        if self.needs_thickness:
            there = self._share.total(self._middle @ thickness[self._points])
            there[self._undeformed] = 1.0
            if not (there > 0).all():
                raise InvalidState("the thickness of the sheet that a pressure acts on, continued to the boundary, is not positive there")
            pull = pull * there
        if len(sides) == 1:
            forces = np.stack([-(pull * sides[0][:, 1]), pull * sides[0][:, 0]], axis=1)
        else:
            forces = -0.5 * pull[:, None] * np.cross(*sides)
        if not np.isfinite(forces).all():
            raise InvalidState("the force of a pressure on the boundary is not finite")
        return forces

    def add(self, positions: np.ndarray, thickness: np.ndarray | None, out: np.ndarray) -> None:
        """Add the forces on the points to `out`, shape (n, d)."""
        out[self._points] += self._spread @ self.on_facets(positions, thickness)

    def middles(self, vectors: np.ndarray) -> np.ndarray:
        """Return positions or velocities of the middles of the facets from those of the points, shape (f, d)."""
        return self._share.total(self._middle @ vectors.take(self._points, axis=0))

    def _sides_at(self, positions: np.ndarray) -> list[np.ndarray]:
        """Return the vectors along the sides of the facets."""
        places = positions.take(self._points, axis=0)
        return [self._share.total(rows @ places) for rows in self._sides]

    def potential(self, positions: np.ndarray) -> float:
        """Return pressure times the area or volume that the facets have swept since rest (theory (46))."""
        enclosed = _enclosed(self.middles(positions) - self._origin, self._sides_at(positions))
        return float((self._pressures * (enclosed - self._enclosed_at_rest)).sum())


def _enclosed(middles: np.ndarray, sides: list[np.ndarray]) -> np.ndarray:
    """Return the area or volume between each facet and the origin; a closed chain or surface of facets encloses their sum."""
    if len(sides) == 1:
        return 0.5 * _cross(middles, sides[0])
    return (middles * np.cross(*sides)).sum(axis=1) / 6


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] if a.shape[1] == 2 else np.cross(a, b)


def _closed(facets: np.ndarray) -> bool:
    """Return whether facets of the given nodes, shape (f, d), have no rim: each side belongs to two of them, in opposite directions."""
    if facets.shape[1] == 2:
        count = facets.max() + 1
        return bool((np.bincount(facets[:, 0], minlength=count) == np.bincount(facets[:, 1], minlength=count)).all())
    sides = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    one, other = (np.unique(ends, axis=0, return_counts=True) for ends in (sides, sides[:, ::-1]))
    return all(np.array_equal(mine, theirs) for mine, theirs in zip(one, other, strict=True))


class Loads:
    """Loads on a body, at one value of the loading parameter at a time.

    Dead loads are summed once for a value of the parameter; pressures are evaluated in every state.

    Parameters
    ----------
    body : Body
    loads : sequence of DeadLoad or Pressure
    surface : callable
        Function that returns the boundary of the body; called only if there is a pressure.

    Attributes
    ----------
    needs_thickness : bool
        Whether a pressure acts on the deformed thickness.  Methods with a `thickness` argument then need the stretch of the thickness at
        the points, J3 / det F, shape (n,).
    no_potential_because : str or None
        Why the loads are not minus the derivative of a potential; None if they are.
    """

    def __init__(self, body: Body, loads: Sequence[DeadLoad | Pressure], surface: Callable[[], Surface]) -> None:
        self.body, self._names = body, [load.name for load in loads]
        # Dead loads of one amplitude act as one.
        self._amplitudes = list(dict.fromkeys(load.amplitude for load in loads))
        self._followed = np.array([self._amplitudes.index(load.amplitude) for load in loads])
        self._dead = {number: load for number, load in enumerate(loads) if isinstance(load, DeadLoad)}
        pressures = {number: load for number, load in enumerate(loads) if isinstance(load, Pressure)}
        self._facets = _Facets(body.share, surface(), pressures) if pressures else None
        reasons = (pressure.no_potential_because(surface()) for pressure in pressures.values())
        self.no_potential_because = next(filter(None, reasons), None)
        self._patterns: dict[int, np.ndarray] = {}
        for number, dead in self._dead.items():
            pattern = self._patterns.setdefault(self._followed[number], np.zeros_like(body.points))
            pattern[dead.points] += dead.forces
        self._present = np.zeros_like(body.points) if self._patterns else None
        self.needs_thickness = self._facets is not None and self._facets.needs_thickness
        self.set(0.0)

    @property
    def conservative(self) -> bool:
        """Return whether the loads are minus the derivative of their `potential`."""
        return self.no_potential_because is None

    def set(self, t: float) -> None:
        """Set all loads to their size at a value of the loading parameter.

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
        if self._facets is not None:
            self._facets.set(self._factors)
        if self._present is not None:
            self._present[:] = 0.0
            with np.errstate(over="ignore"):
                for number, pattern in self._patterns.items():
                    self._present += factors[number] * pattern
            if not np.isfinite(self._present).all():
                raise InvalidState(f"loads: a force is not finite at t = {t:g}")

    def vanish(self, t: float) -> bool:
        """Return whether all loads are zero at a value of the loading parameter."""
        return all(abs(amplitude(t)) <= AT_REST for amplitude in self._amplitudes)

    def forces(self, positions: np.ndarray, thickness: np.ndarray | None, out: np.ndarray) -> None:
        """Add the forces of the loads on the points, in the plane per unit thickness of the undeformed body, to `out` (n, d).

        Parameters
        ----------
        positions : ndarray, shape (n, d)
        thickness : ndarray, shape (n,), or None
            Needed where `needs_thickness`.
        out : ndarray, shape (n, d)

        Raises
        ------
        InvalidState
            Where a pressure has no force.
        """
        if self._present is not None:
            out += self._present
        if self._facets is not None:
            self._facets.add(positions, thickness, out)

    def potential(self, positions: np.ndarray) -> float:
        """Return the potential energy of `conservative` loads at their present size, zero at rest (theory (46)).

        Raises
        ------
        TypeError
            If the loads have no potential.
        """
        if not self.conservative:
            raise TypeError(f"these loads have no potential: {self.no_potential_because}")
        potential = 0.0
        if self._present is not None:
            potential -= float(np.einsum("nc,nc->", self._present, positions - self.body.points))
        if self._facets is not None:
            potential += self._facets.potential(positions) * self.body.share.leads
        return potential

    def power(self, positions: np.ndarray, velocities: np.ndarray, thickness: np.ndarray | None = None) -> float:
        """Return the power of the loads in a state in which the points have the given velocities (n, d)."""
        power = 0.0
        if self._present is not None:
            power += float(np.einsum("nc,nc->", self._present, velocities))
        if self._facets is not None:
            of_facets = self._facets.on_facets(positions, thickness) * self._facets.middles(velocities)
            power += float(of_facets.sum()) * self.body.share.leads
        return power

    def by_name(self, positions: np.ndarray, thickness: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Return the total force of the loads in a state, shape (d,), by name; loads of one name are summed."""
        return self._summed(positions, thickness, lambda places, forces: forces)

    def displacements(self, positions: np.ndarray) -> dict[str, np.ndarray]:
        """Return the mean displacement of the parts that loads act on, shape (d,), by name; loads of one name are averaged together.

        Points count in proportion to their part of a force, so that its work is force times displacement.  A pressure moves with the
        middles of its facets.
        """
        sums: dict[str, tuple[np.ndarray, float]] = {name: (np.zeros(self.body.dimension), 0.0) for name in self._names}

        def take(name: str, moved: np.ndarray, weights: np.ndarray) -> None:
            total, weight = sums[name]
            sums[name] = total + weights @ moved, weight + float(weights.sum())

        displacement = positions - self.body.points
        for number, dead in self._dead.items():
            total = self.body.share.total(dead.forces.sum(axis=0))
            take(self._names[number], displacement[dead.points], dead.forces @ total / max(np.linalg.norm(total), 1e-300))
        if self._facets is not None:
            moved = self._facets.middles(displacement)
            for number in np.unique(self._facets.loads):
                own = self._facets.loads == number
                take(self._names[number], moved[own], np.full(int(own.sum()), float(self.body.share.leads)))
        sums = {name: (self.body.share.total(total), self.body.share.total(weight)) for name, (total, weight) in sums.items()}
        return {name: total / weight if weight else total for name, (total, weight) in sums.items()}

    def moments(self, positions: np.ndarray, about: np.ndarray, thickness: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Return the moment of the loads in a state about a place (d,), by name; loads of one name are summed.

        The moment is a counter-clockwise number in the plane and a vector of shape (3,) in three dimensions.
        """
        return self._summed(positions, thickness, lambda places, forces: _cross(places - about, forces))

    def _summed(self, positions: np.ndarray, thickness: np.ndarray | None, of: Callable[..., np.ndarray]) -> dict[str, np.ndarray]:
        """Return the sums of a function of places and forces, by name."""
        totals = dict.fromkeys(self._names, 0.0)
        for name, places, forces in self._actions(positions, thickness):
            totals[name] = totals[name] + of(places, forces).sum(axis=0)
        return {name: self.body.share.total(total) for name, total in totals.items()}

    def _actions(self, positions: np.ndarray, thickness: np.ndarray | None) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """Yield name, places (k, d) and forces (k, d) of every load."""
        for number, dead in self._dead.items():
            yield self._names[number], positions[dead.points], self._factors[number] * dead.forces
        if self._facets is not None:
            places, forces = self._facets.middles(positions), self._facets.on_facets(positions, thickness)
            for number in np.unique(self._facets.loads):
                own = (self._facets.loads == number) & self.body.share.leads
                yield self._names[number], places[own], forces[own]


class LoadedForce:
    """Internal force with loads, supports at places and rigid regions, which solvers use for a body that has any of them.

    All other attributes are those of the internal force. A call moves its positions, in place, to the nearest ones in which regions are
    rigid. Forces on the points of a region are replaced by forces of the same resultant that move it as one body, so that any solver that
    divides them by volumes, or by `RigidStiffness`, steps in the rigid motions of the region.

    Parameters
    ----------
    internal : InternalForce
    loads : Loads or None
    supports : Supports, optional
    rigid : sequence of RigidRegion

    Attributes
    ----------
    has_energy : bool
        Whether the sum of forces and loads is minus the derivative of an energy.
    no_energy_because : str or None
        Why the loads have no potential; None if they have one.
    internal, loads, supports, rigid
    """

    def __init__(
        self, internal: InternalForce, loads: Loads | None, supports: Supports | None = None, rigid: Sequence[RigidRegion] = ()
    ) -> None:
        self.internal, self.loads, self.supports, self.rigid = internal, loads, supports, rigid
        self.no_energy_because = None if loads is None else loads.no_potential_because
        self.has_energy = internal.has_energy and self.no_energy_because is None

    def __getattr__(self, name: str):
        if name == "internal":  # the attribute is missing while an object is being copied
            raise AttributeError(name)
        return getattr(self.internal, name)

    def __call__(self, positions: np.ndarray, out: np.ndarray) -> None:
        """Write internal force and loads on every point at positions (n, d), in the plane per unit thickness, to `out` (n, d).

        Raises
        ------
        InvalidState
            If the state has no force, or a region cannot follow the prescribed displacements.
        OutsideDomain
            See `InternalForce`.
        """
        for region in self.rigid:
            region.snap(positions)
        if self.supports is not None:
            self.supports.place(positions)
        self.internal(positions, out)
        if self.loads is not None:
            self.loads.forces(positions, self.thickness(), out)
        if self.supports is not None:
            self.supports.fold(out)
        for region in self.rigid:
            region.carry(positions, out)

    def applied(self) -> np.ndarray | None:
        """Return the forces of the loads on the points in the state last evaluated, shape (n, d); None without loads."""
        if self.loads is None:
            return self.internal.applied()
        found = np.zeros_like(self.body.points)
        self.loads.forces(self.positions[: len(self.body)], self.thickness(), found)
        return found

    def thickness(self) -> np.ndarray | None:
        """Return the stretch of the thickness at the points in the state last evaluated, shape (n,); None if no load needs it.

        Raises
        ------
        InvalidState
            Where it has no value.
        """
        if self.loads is None or not self.loads.needs_thickness:
            return None
        F = self.internal.deformation_gradients()
        return self.internal.volume_ratios() / (F[:, 0, 0] * F[:, 1, 1] - F[:, 0, 1] * F[:, 1, 0])

    def energy(self) -> float:
        """Return stored energy and potential of the loads, per unit thickness, in the state last evaluated."""
        energy = self.internal.energy()
        return energy if self.loads is None else energy + self.loads.potential(self.internal.positions[: len(self.body)])
