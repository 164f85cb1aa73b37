"""Loads: dead forces on the boundary, in the volume and on points, and pressures that follow the
boundary (theory (42)-(46)).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence

import numpy as np
import scipy

from ..body import Body
from ..body.surface import Following, Surface
from ..forces import InvalidState
from ..ranks import Share
from .obstacles import Obstacle, Obstructed
from .rigid import moment_of

AT_REST = 1e-14
"""Greatest displacement divided by the extent of the body, and greatest amplitude of a load, that
count as zero: a sine has such rounding errors.
"""

Amplitude = Callable[[float], float]


class DeadLoad:
    """Load on points whose forces do not depend on the deformation.

    Parameters
    ----------
    name : str
        Name under which results report the load.
    amplitude : callable
        Factor on the forces as a function of the loading parameter; raises ValueError where it has
        no value.
    share : Share
    points : ndarray of int, shape (k,)
        Points that this rank owns.
    forces : ndarray, shape (k, d)
        Forces where the amplitude is 1.
    factor : float
        Present value of the amplitude.
    """

    def __init__(
        self, name: str, amplitude: Amplitude, share: Share, points: np.ndarray, forces: np.ndarray
    ) -> None:
        self.name = name
        self.amplitude = amplitude
        self.points = points
        self.forces = forces
        self.factor = 0.0
        self.weights = _along_total(forces, share.total(forces.sum(axis=0)))

    def at_sites(self, vectors: np.ndarray, planes: np.ndarray | None) -> np.ndarray:
        """Return the vectors at the k points that the load acts on, shape (k, d), from an array
        of all points (n, d).
        """
        return vectors[self.points]

    def on_sites(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Return the present force on each of the k points that the load acts on, shape (k, d);
        the arguments are ignored.
        """
        return self.factor * self.forces


def _along_total(forces: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Return the components of forces (k, d) along their total (d,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        # `Loads.set` refuses forces that are not finite
        return forces @ total / max(np.linalg.norm(total), 1e-300)


class _OnFacets:
    """Base class for loads on facets of the boundary, shape (f,), given by their numbers in a
    `surface`.

    A facet may depend on points of several ranks, so that all ranks evaluate all facets together,
    and only the first rank counts them. Beside a plane of symmetry it depends on images of points
    as well; the part of its force that these carry acts on the plane.

    Attributes
    ----------
    points : ndarray of int, shape (k,)
        Points that this rank owns on which the facets depend, so that the work of an evaluation is
        proportional to the boundary.
    planes : ndarray, shape (planes,)
        Positions of the planes of symmetry, set by `Loads`.
    factor : float
        Present value of the amplitude.
    """

    planes: np.ndarray

    def __init__(
        self,
        name: str,
        amplitude: Amplitude,
        share: Share,
        surface: Surface,
        facets: np.ndarray,
    ) -> None:
        self.name = name
        self.amplitude = amplitude
        self.factor = 0.0
        self._share = share
        self._areas = surface.areas()[facets]
        corners = surface.facets[facets]
        f, d = (len(facets), surface.facets.shape[1])

        def combined(weights: np.ndarray) -> Following:
            """Return the map to combinations of the corners of each facet."""
            entries = np.tile(weights, f), corners.ravel(), d * np.arange(f + 1)
            matrix = scipy.sparse.csr_array(entries, shape=(f, len(surface.nodes)))
            return surface.interpolation.changed(lambda rows: (matrix @ rows).tocsr())

        middle = combined(np.full(d, 1 / d))
        sides = np.eye(d)[1:] - np.eye(d)[0]
        self.points = np.unique(middle.rows.indices)
        self._middle, *self._sides = (
            each.changed(lambda rows: rows[:, self.points].tocsr())
            for each in (middle, *map(combined, sides))
        )

    @abstractmethod
    def _on_facets(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Return the force on every facet, shape (f, d)."""

    def at_sites(self, vectors: np.ndarray, planes: np.ndarray | None) -> np.ndarray:
        """Return vectors at the middles of the facets, shape (f, d), interpolated from positions
        or velocities of all points (n, d) and, across themselves, of the planes.
        """
        return self._share.total(self._middle(vectors.take(self.points, axis=0), planes))

    def on_sites(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Return the force on every facet, shape (f, d); 0 on ranks other than the first."""
        return self._on_facets(positions, thickness) * self._share.is_first

    def on_planes(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Return this rank's part of what acts on the planes, see `Following.on_planes`."""
        return self._middle.on_planes(
            self._on_facets(positions, thickness), positions[self.points], self.planes
        )


class Traction(_OnFacets):
    """Dead force on facets of the boundary, for which `points` and `forces` are as in `DeadLoad`.

    Parameters
    ----------
    name, amplitude, share
        As for `DeadLoad`.
    surface, facets
        As for `Pressure`.
    value : sequence of float
        Force divided by undeformed area where the amplitude is 1.
    """

    def __init__(
        self,
        name: str,
        amplitude: Amplitude,
        share: Share,
        surface: Surface,
        facets: np.ndarray,
        value: Sequence[float],
    ) -> None:
        super().__init__(name, amplitude, share, surface, facets)
        self._forces = self._areas[:, None] * np.array(value)
        self.forces = self._middle.spread(self._forces)
        self.weights = _along_total(self._forces, self._forces.sum(axis=0)) * share.is_first

    def _on_facets(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        return self.factor * self._forces


class Pressure(_OnFacets):
    """Pressure on facets of the boundary, which follows their deformation.

    Parameters
    ----------
    name, amplitude, share
        As for `DeadLoad`.
    surface : Surface
    facets : ndarray of int, shape (f,)
        Numbers of the facets in the surface.
    value : float
        Pressure where the amplitude is 1.
    deformed : bool
        Whether the pressure acts on the edge of a sheet with its deformed thickness; otherwise with
        its undeformed thickness.
    thickness_at_edge : callable, optional
        ``thickness_at_edge(along, pressure)`` returns the stretch of the thickness at the facets,
        which have the stretches `along` (f,), if nothing but the pressure acts there. Without it
        the thickness is continued from the points.

    Attributes
    ----------
    needs_thickness : bool
        Whether the thickness is continued from the points.
    no_potential_because : str or None
        Why the pressure has no potential; None if it has one.
    weights : ndarray, shape (f,)
        Weight of each facet in the mean displacement: 1 on the first rank, 0 on the others.
    name, amplitude, factor, deformed
    """

    def __init__(
        self,
        name: str,
        amplitude: Amplitude,
        share: Share,
        surface: Surface,
        facets: np.ndarray,
        value: float,
        deformed: bool,
        thickness_at_edge: Callable[[np.ndarray, float], np.ndarray] | None = None,
    ) -> None:
        super().__init__(name, amplitude, share, surface, facets)
        self._value = value
        self.deformed = deformed
        self._at_edge = thickness_at_edge
        self.needs_thickness = deformed and thickness_at_edge is None
        self.weights = np.full(len(facets), float(share.is_first))
        why = None
        if deformed:
            why = (
                "acts on the deformed thickness; on the undeformed one (thickness=undeformed) a"
                " closed boundary would give it a potential"
            )
        elif not _closed(surface.facets[facets]):
            why = "acts on a part of the boundary that is not closed"
        self.no_potential_because = why and f"the pressure on {name} {why}"
        # Enclosed volumes are measured about a place within the body, which minimizes rounding
        # errors.
        self._origin = surface.nodes.mean(axis=0)
        start = surface.nodes[surface.facets[facets]] - self._origin
        self._enclosed_at_rest = _enclosed(
            start.mean(axis=1), [start[:, end] - start[:, 0] for end in range(1, start.shape[1])]
        )

    def _on_facets(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Return the force on every facet, shape (f, d) (theory (44), (45)).

        `thickness` is the stretch of the thickness at the points, used only if `needs_thickness`.

        Raises
        ------
        InvalidState
            Where a force is not finite, or the thickness not positive.
        """
        pressure = self._value * self.factor
        sides = self._sides_at(positions)
        forces = -pressure * _normals(sides)
        if self.deformed and pressure:
            if self._at_edge is None:
                there = self._share.total(self._middle.rows @ thickness[self.points])
            else:
                there = self._at_edge(np.linalg.norm(sides[0], axis=1) / self._areas, pressure)
            if not (there > 0).all():
                raise InvalidState(
                    "the thickness of the sheet that a pressure acts on is not positive at the"
                    " boundary"
                )
            forces *= there[:, None]
        if not np.isfinite(forces).all():
            raise InvalidState("the force of a pressure on the boundary is not finite")
        return forces

    def add(self, positions: np.ndarray, thickness: np.ndarray | None, out: np.ndarray) -> None:
        """Add the forces of the pressure on the points to `out`, shape (n, d)."""
        out[self.points] += self._middle.spread(self._on_facets(positions, thickness))

    def _sides_at(self, positions: np.ndarray) -> list[np.ndarray]:
        """Return the vectors from the first node of each facet to its other nodes, an array (f,
        d) for each of these.
        """
        places = positions.take(self.points, axis=0)
        return [self._share.total(side(places, self.planes)) for side in self._sides]

    def potential(self, positions: np.ndarray) -> float:
        """Return the potential (theory (46)): the pressure times the growth of the area or volume
        of the body within the facets.

        On ranks other than the first the value is 0.
        """
        middles = self.at_sites(positions, self.planes) - self._origin
        enclosed = _enclosed(middles, self._sides_at(positions))
        return (
            self._value
            * self.factor
            * float((enclosed - self._enclosed_at_rest).sum())
            * self._share.is_first
        )


def _normals(sides: list[np.ndarray]) -> np.ndarray:
    """Return the normals of facets, shape (f, d), with the length of an edge or the area of a
    triangle as magnitude.

    `sides` are the vectors from the first node of each facet to its other nodes, an array (f, d)
    for each of these.
    """
    if len(sides) == 1:
        return np.stack([sides[0][:, 1], -sides[0][:, 0]], axis=1)
    return 0.5 * np.cross(*sides)


def _enclosed(middles: np.ndarray, sides: list[np.ndarray]) -> np.ndarray:
    """Return the signed area or volume between each facet and the origin, shape (f,), from its
    middle and `sides` as in `_normals`.

    The sum over the facets of a closed boundary is the area or volume that it encloses.
    """
    return (middles * _normals(sides)).sum(axis=1) / middles.shape[1]


def _closed(facets: np.ndarray) -> bool:
    """Return whether facets, given by their nodes (f, d), form closed boundaries.

    In the plane every node then ends one facet and starts another; in three dimensions two facets
    share every edge, in opposite directions.
    """
    if facets.shape[1] == 2:
        return np.array_equal(*np.sort(facets, axis=0).T)
    sides = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    one, other = (np.unique(ends, axis=0, return_counts=True) for ends in (sides, sides[:, ::-1]))
    return all(np.array_equal(mine, theirs) for mine, theirs in zip(one, other, strict=True))


AnyLoad = DeadLoad | Traction | Pressure | Obstacle


class Loads:
    """Loads on a body, at one value of the loading parameter at a time.

    Dead loads are summed once for a value of the parameter; pressures and obstacles are evaluated
    in every state.

    Parameters
    ----------
    body : Body
    loads : sequence of DeadLoad, Traction, Pressure or Obstacle

    Attributes
    ----------
    normals : ndarray, shape (planes, d)
        Unit vectors across the planes of symmetry; 0 for other planes and boundaries.
    at_rest, planes : ndarray, shape (planes,)
        Positions of the planes along their normals, in the undeformed body and now.
    needs_thickness : bool
        Whether a pressure continues the thickness from the points.  Methods with a `thickness`
        argument then need the stretch of the thickness at the points, J3 / det F, shape (n,): the
        volume ratio J3 divided by the area ratio det F in the plane.
    no_potential_because : str or None
        Why the loads are not minus the derivative of a potential; None if they are.
    obstacles : list of Obstacle
    pushes : ndarray, shape (k, obstacles)
        Forces of the obstacles at places where the gap is zero, found by equilibria and,
        in dynamics, lost where contact ends.
    """

    def __init__(self, body: Body, loads: Sequence[AnyLoad]) -> None:
        self.body = body
        self._loads = loads
        planes = [
            (plane.axis, plane.position) if plane.symmetric else (-1, 0.0) for plane in body.planes
        ]
        axes, self.at_rest = np.reshape(planes, (-1, 2)).T
        self.normals = axes[:, None] == np.arange(body.dimension)
        self.planes = self.at_rest.copy()
        self._dead = [load for load in loads if isinstance(load, DeadLoad | Traction)]
        self._following: list[Pressure | Obstacle] = [
            load for load in loads if not isinstance(load, DeadLoad | Traction)
        ]
        self._beside_planes = [load for load in loads if not isinstance(load, DeadLoad)]
        for load in self._beside_planes:
            load.planes = self.planes
        self.obstacles = [load for load in loads if isinstance(load, Obstacle)]
        places = len(self.obstacles[0].surface.nodes) if self.obstacles else 0
        self.pushes = np.zeros((places, len(self.obstacles)))
        for one, column in zip(self.obstacles, self.pushes.T, strict=True):
            one.pushes = column
        self._present = np.zeros_like(body.points) if self._dead else None
        self.needs_thickness = any(load.needs_thickness for load in self._following)
        self.no_potential_because = next(
            filter(None, (load.no_potential_because for load in self._following)), None
        )
        self.set(0.0)

    def __len__(self) -> int:
        return len(self._loads)

    @property
    def planes_moved(self) -> np.ndarray:
        """Displacements (planes,) of planes of symmetry across themselves."""
        return self.planes - self.at_rest

    def set(self, t: float) -> None:
        """Set all loads to their size at a value of the loading parameter.

        Raises
        ------
        InvalidState
            If an amplitude has no value, or a force no finite value, at this parameter.
        """
        try:
            for load in self._loads:
                load.factor = load.amplitude(t)
        except ValueError as error:
            raise InvalidState(f"loads: {error}") from None
        if self._present is not None:
            self._present[:] = 0.0
            with np.errstate(over="ignore"):
                for load in self._dead:
                    self._present[load.points] += load.factor * load.forces
            if not np.isfinite(self._present).all():
                raise InvalidState(f"loads: a force is not finite at t = {t:g}")

    def vanish(self, t: float) -> bool:
        """Return True if all loads are zero, and no obstacle touches the undeformed body, at a
        value of the loading parameter.
        """
        loads = (load for load in self._loads if load not in self.obstacles)
        return all(abs(load.amplitude(t)) <= AT_REST for load in loads) and not any(
            one.enters(t) for one in self.obstacles
        )

    def check_path(self, before: float, after: float, start: np.ndarray, end: np.ndarray) -> None:
        """Raise Obstructed if an obstacle passes through the body between two equilibria, see
        `Obstacle.passes`.
        """
        for obstacle in self.obstacles:
            if obstacle.passes(before, after, start, end):
                raise Obstructed(
                    f"the obstacle {obstacle.name} passes through the body between t = {before:.4g}"
                    f" and {after:.4g}"
                )

    def greatest_frequency(self, mass: np.ndarray) -> float:
        """Return an upper bound of the squared frequencies of points with masses (n,) in contact
        with the obstacles; 0 without any.
        """
        return sum(one.surface.greatest_frequency(one.stiffness, mass) for one in self.obstacles)

    def forces(self, positions: np.ndarray, thickness: np.ndarray | None, out: np.ndarray) -> None:
        """Add the forces of the loads on the points, in two dimensions per unit undeformed
        thickness, to `out` (n, d).

        Parameters
        ----------
        positions : ndarray, shape (n, d)
        thickness : ndarray, shape (n,), or None
            Stretch of the thickness at the points, if `needs_thickness`.
        out : ndarray, shape (n, d)

        Raises
        ------
        InvalidState
            If the force of a pressure is not finite, or the thickness on which the pressure acts is
            not positive.
        """
        if self._present is not None:
            out += self._present
        for load in self._following:
            load.add(positions, thickness, out)

    def pushed(self, positions: np.ndarray, pushes: np.ndarray) -> np.ndarray:
        """Return the forces of all obstacles at places (k, obstacles) with given `pushes`."""
        forces = np.empty_like(pushes)
        for number, obstacle in enumerate(self.obstacles):
            forces[:, number] = obstacle.pushed(positions, pushes[:, number])[0]
        return forces

    def let_go(self, positions: np.ndarray) -> None:
        """Set to zero the pushes at places that the obstacles no longer push at positions (n, d):
        contact that begins there again is that of a penalty.
        """
        if self.pushes.any():
            self.pushes[self.pushed(positions, self.pushes) == 0] = 0.0

    def potential(self, positions: np.ndarray) -> float:
        """Return the potential energy of the loads at their present size, 0 in the undeformed body
        (theory (46)).

        It is valid only if `no_potential_because` is None.
        """
        potential = sum(load.potential(positions) for load in self._following)
        if self._present is not None:
            potential -= float(np.einsum("nc,nc->", self._present, positions - self.body.points))
        return potential

    def power(
        self,
        positions: np.ndarray,
        velocities: np.ndarray,
        planes: np.ndarray | None = None,
        thickness: np.ndarray | None = None,
    ) -> float:
        """Return the power of the loads in a state in which the points have the given velocities
        (n, d), and the planes of symmetry velocities (planes,) across themselves.
        """
        return float(
            sum(
                (load.on_sites(positions, thickness) * load.at_sites(velocities, planes)).sum()
                for load in self._loads
            )
        )

    def on_planes(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Return the forces of the loads on planes of symmetry, and their first moments, see
        `Following.on_planes`.
        """
        found = (load.on_planes(positions, thickness) for load in self._beside_planes)
        shape = *self.normals.shape, 1 + self.body.dimension
        return self.body.share.total(sum(found, np.zeros(shape)))

    def by_name(
        self, positions: np.ndarray, thickness: np.ndarray | None = None
    ) -> dict[str, np.ndarray]:
        """Return the total force of the loads at given positions, shape (d,), by name; loads
        that share a name are summed.
        """
        return self._summed(lambda load: load.on_sites(positions, thickness))

    def displacements(self, positions: np.ndarray) -> dict[str, np.ndarray]:
        """Return the mean displacement of the points or facets that loads act on, shape (d,), by
        name; a name shared counts as one load.

        Points have the weights `DeadLoad.weights`, so that the work of a load is force times mean
        displacement. For a pressure the mean is over the middles of its facets. For an obstacle it
        is the displacement of the obstacle.
        """
        displacement = positions - self.body.points
        planes = self.planes_moved
        loads = [load for load in self._loads if load not in self.obstacles]
        totals = self._summed(
            lambda load: load.weights[:, None] * load.at_sites(displacement, planes), loads
        )
        weights = self._summed(lambda load: load.weights, loads)
        found = {name: total / (weights[name] or 1.0) for name, total in totals.items()}
        return found | {one.name: one.factor * one.travel for one in self.obstacles}

    def moments(
        self, positions: np.ndarray, about: np.ndarray, thickness: np.ndarray | None = None
    ) -> dict[str, np.ndarray]:
        """Return the moment of the loads at given positions about a place (d,), by name; loads that
        share a name are summed.

        The moment is a counter-clockwise number in the plane and a vector of shape (3,) in three
        dimensions.
        """
        levers = self._summed(
            lambda load: (
                load.on_sites(positions, thickness)[:, :, None]
                * (load.at_sites(positions, self.planes) - about)[:, None]
            )
        )
        return {name: moment_of(lever) for name, lever in levers.items()}

    def _summed(
        self, of: Callable[..., np.ndarray], loads: Sequence | None = None
    ) -> dict[str, np.ndarray]:
        """Return, by load name, sums of `of(load)`, an array with a row for each point, facet or
        node that the load acts on.

        A sum is taken over all rows, all `loads` of that name (by default of all loads) and all
        ranks.
        """
        loads = self._loads if loads is None else loads
        totals = dict.fromkeys((load.name for load in loads), 0.0)
        for load in loads:
            totals[load.name] = totals[load.name] + of(load).sum(axis=0)
        return {name: self.body.share.total(total) for name, total in totals.items()}
