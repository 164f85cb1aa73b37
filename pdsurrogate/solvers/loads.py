"""Loads: forces on the boundary, in the volume and on points, and pressures that follow the boundary (theory (42)-(46))."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..body import Body
from ..body.surface import Following, Surface
from ..forces import InternalForce, InvalidState
from ..ranks import Share
from .held import Supports
from .rigid import RigidRegion, moment_of

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


class _DeadLoads:
    """Dead loads of a body, which act at points.

    Parameters
    ----------
    body : Body
    loads : sequence of DeadLoad
    followed : ndarray of int, shape (k,)
        Number of the amplitude that the force at each of their points follows.

    Attributes
    ----------
    weights : ndarray, shape (k,)
        Part of each point in the mean displacement of its load: in proportion to its force along that of the load.
    """

    def __init__(self, body: Body, loads: Sequence[DeadLoad], followed: np.ndarray) -> None:
        self._body, self._followed = body, followed
        self._points = np.concatenate([load.points for load in loads])
        self._forces = np.concatenate([load.forces for load in loads])
        totals = [body.share.total(load.forces.sum(axis=0)) for load in loads]
        along = [load.forces @ total / max(np.linalg.norm(total), 1e-300) for load, total in zip(loads, totals, strict=True)]
        self.weights = np.concatenate(along)
        # Loads of one amplitude act as one.
        self._patterns = np.zeros((followed.max(initial=0) + 1, *body.points.shape))
        np.add.at(self._patterns, (followed, self._points), self._forces)

    def set(self, factors: np.ndarray, t: float) -> None:
        """Set the forces to those at the values of all amplitudes, those at t; raise InvalidState where a force is not finite."""
        self._factors = factors[self._followed]
        with np.errstate(over="ignore"):
            self._present = np.einsum("a,anc->nc", factors[: len(self._patterns)], self._patterns)
        if not np.isfinite(self._present).all():
            raise InvalidState(f"loads: a force is not finite at t = {t:g}")

    def add(self, positions: np.ndarray, thickness: np.ndarray | None, out: np.ndarray) -> None:
        """Add the forces on the points to `out`, shape (n, d)."""
        out += self._present

    def at_sites(self, vectors: np.ndarray) -> np.ndarray:
        """Return the rows of the points that the loads act on, shape (k, d), of an array (n, d)."""
        return vectors[self._points]

    def on_sites(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Return the force at each of these points that counts here, shape (k, d)."""
        return self._factors[:, None] * self._forces

    def potential(self, positions: np.ndarray) -> float:
        """Return minus the work of the present forces since rest."""
        return -float(np.einsum("nc,nc->", self._present, positions - self._body.points))


class _Pressures:
    """Pressures on a body, which act on facets; a facet with two pressures occurs twice.

    A facet may depend on points of several shares, so that all shares evaluate all facets together, and one of them counts them.

    Parameters
    ----------
    share : Share
    surface : Surface
    loads : sequence of Pressure
    followed : ndarray of int, shape (f,)
        Number of the amplitude that the pressure on each of their facets follows.

    Attributes
    ----------
    weights : ndarray, shape (f,)
        Part of each facet in the mean displacement of its load: all are alike.
    """

    def __init__(self, share: Share, surface: Surface, loads: Sequence[Pressure], followed: np.ndarray) -> None:
        self._share, self._followed = share, followed
        facets = np.concatenate([load.facets for load in loads])
        self.weights = np.full(len(facets), float(share.leads))
        counts = [len(load.facets) for load in loads]
        self._values = np.repeat([load.value for load in loads], counts)
        self._undeformed = np.repeat([not load.deformed for load in loads], counts)
        corners = [surface.interpolation[nodes] for nodes in surface.facets[facets].T]
        # Only points that the facets depend on are used, so that the work of an evaluation is proportional to the boundary.
        self._points = np.unique(np.concatenate([rows.points() for rows in corners]))
        first, *others = (rows.of_points(self._points) for rows in corners)
        self._middle = Following.mean([first, *others])
        self._sides = [other - first for other in others]
        self._spread = self._middle.T
        # Enclosed volumes are measured about a place within the body, which minimises rounding errors.
        self._origin = surface.nodes.mean(axis=0)
        start = surface.nodes[surface.facets[facets]] - self._origin
        self._enclosed_at_rest = _enclosed(start.mean(axis=1), [start[:, end] - start[:, 0] for end in range(1, start.shape[1])])

    def set(self, factors: np.ndarray, t: float) -> None:
        """Set the pressures to those at the values of all amplitudes."""
        self._pressures = self._values * factors[self._followed]

    def _on_facets(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Return the force on every facet, shape (f, d) (theory (44), (45)).

        Raises
        ------
        InvalidState
            Where a force is not finite, or the thickness not positive.
        """
        pull = self._pressures
        if not self._undeformed.all():
            there = self._share.total(self._middle @ thickness[self._points])
            there[self._undeformed] = 1.0
            if not (there > 0).all():
                raise InvalidState("the thickness of the sheet that a pressure acts on, continued to the boundary, is not positive there")
            pull = pull * there
        forces = -pull[:, None] * _normals(self._sides_at(positions))
        if not np.isfinite(forces).all():
            raise InvalidState("the force of a pressure on the boundary is not finite")
        return forces

    def add(self, positions: np.ndarray, thickness: np.ndarray | None, out: np.ndarray) -> None:
        """Add the forces on the points to `out`, shape (n, d)."""
        out[self._points] += self._spread @ self._on_facets(positions, thickness)

    def at_sites(self, vectors: np.ndarray) -> np.ndarray:
        """Return positions or velocities of the middles of the facets from those of the points, shape (f, d)."""
        return self._share.total(self._middle @ vectors.take(self._points, axis=0))

    def on_sites(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Return the force on every facet that counts here, shape (f, d)."""
        return self._on_facets(positions, thickness) * self._share.leads

    def _sides_at(self, positions: np.ndarray) -> list[np.ndarray]:
        """Return the vectors along the sides of the facets."""
        places = positions.take(self._points, axis=0)
        return [self._share.total(rows @ places) for rows in self._sides]

    def potential(self, positions: np.ndarray) -> float:
        """Return pressure times the area or volume that the facets have swept since rest, where it counts (theory (46))."""
        enclosed = _enclosed(self.at_sites(positions) - self._origin, self._sides_at(positions))
        return float((self._pressures * (enclosed - self._enclosed_at_rest)).sum()) * self._share.leads


def _normals(sides: list[np.ndarray]) -> np.ndarray:
    """Return the normals of facets, of the length of an edge or the area of a triangle, from the vectors along their sides."""
    if len(sides) == 1:
        return np.stack([sides[0][:, 1], -sides[0][:, 0]], axis=1)
    return 0.5 * np.cross(*sides)


def _enclosed(middles: np.ndarray, sides: list[np.ndarray]) -> np.ndarray:
    """Return the area or volume between each facet and the origin; a closed chain or surface of facets encloses their sum."""
    return (middles * _normals(sides)).sum(axis=1) / middles.shape[1]


def _closed(facets: np.ndarray) -> bool:
    """Return whether facets of the given nodes, shape (f, d), have no rim: each side belongs to two of them, in opposite directions."""
    if facets.shape[1] == 2:
        return np.array_equal(*np.sort(facets, axis=0).T)
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
        dead = [load for load in loads if isinstance(load, DeadLoad)]
        pressures = [load for load in loads if isinstance(load, Pressure)]
        self.body, self._names = body, list(dict.fromkeys(load.name for load in loads))
        self._amplitudes = list(dict.fromkeys(load.amplitude for load in [*dead, *pressures]))
        # Kinds of loads, each with the number of the name of every place that its loads act at.
        self._kinds: list[tuple[_DeadLoads | _Pressures, np.ndarray]] = []
        for some in filter(None, (dead, pressures)):
            counts = [len(load.points if isinstance(load, DeadLoad) else load.facets) for load in some]
            followed = np.repeat([self._amplitudes.index(load.amplitude) for load in some], counts)
            kind = _DeadLoads(body, dead, followed) if some is dead else _Pressures(body.share, surface(), pressures, followed)
            self._kinds.append((kind, np.repeat([self._names.index(load.name) for load in some], counts)))
        self.needs_thickness = any(load.deformed for load in pressures)
        reasons = (pressure.no_potential_because(surface()) for pressure in pressures)
        self.no_potential_because = next(filter(None, reasons), None)
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
        for kind, _ in self._kinds:
            kind.set(factors, t)

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
        for kind, _ in self._kinds:
            kind.add(positions, thickness, out)

    def potential(self, positions: np.ndarray) -> float:
        """Return the potential energy of `conservative` loads at their present size, zero at rest (theory (46)).

        Raises
        ------
        TypeError
            If the loads have no potential.
        """
        if not self.conservative:
            raise TypeError(f"these loads have no potential: {self.no_potential_because}")
        return sum(kind.potential(positions) for kind, _ in self._kinds)

    def power(self, positions: np.ndarray, velocities: np.ndarray, thickness: np.ndarray | None = None) -> float:
        """Return the power of the loads in a state in which the points have the given velocities (n, d)."""
        return float(sum((kind.on_sites(positions, thickness) * kind.at_sites(velocities)).sum() for kind, _ in self._kinds))

    def by_name(self, positions: np.ndarray, thickness: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Return the total force of the loads in a state, shape (d,), by name; loads of one name are summed."""
        return self._named(self._summed(lambda kind: kind.on_sites(positions, thickness)))

    def displacements(self, positions: np.ndarray) -> dict[str, np.ndarray]:
        """Return the mean displacement of the parts that loads act on, shape (d,), by name; loads of one name are averaged together.

        Points count in proportion to their part of a force, so that its work is force times displacement.  A pressure moves with the
        middles of its facets.
        """
        displacement = positions - self.body.points
        totals = self._summed(lambda kind: kind.weights[:, None] * kind.at_sites(displacement))
        weights = self._summed(lambda kind: kind.weights)
        return self._named(totals / np.where(weights == 0, 1.0, weights)[:, None])

    def moments(self, positions: np.ndarray, about: np.ndarray, thickness: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Return the moment of the loads in a state about a place (d,), by name; loads of one name are summed.

        The moment is a counter-clockwise number in the plane and a vector of shape (3,) in three dimensions.
        """
        levers = self._summed(lambda kind: kind.on_sites(positions, thickness)[:, :, None] * (kind.at_sites(positions) - about)[:, None])
        return self._named(moment_of(levers))

    def _summed(self, of: Callable[[_DeadLoads | _Pressures], np.ndarray]) -> np.ndarray:
        """Return the sums of values at the places that loads act at, over all shares, shape (names, ...)."""
        found = [(of(kind), names) for kind, names in self._kinds]
        totals = np.zeros((len(self._names), *found[0][0].shape[1:]))
        for values, names in found:
            np.add.at(totals, names, values)
        return self.body.share.total(totals)

    def _named(self, values: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(self._names, values, strict=True))


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
