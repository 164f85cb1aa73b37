"""Rigid obstacles without friction: energy, force and area of their contact with a body, and its
stiffness (theory (69)-(71)).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import scipy

from ..body import Following
from ..forces import InvalidState
from ..ranks import Share
from .multigrid import Operator

MOST_ROUNDS = 20
"""Maximum number of rounds in which nodes in contact are added and removed for a first guess;
some five are usual.
"""

TOUCHING = 0.01
"""Gap in spacings below which the boundary counts as touching in the contact area. Within a contact
the gap at single nodes varies by half of that, since the fit of their motion smooths it; beyond the
edge of a contact the gap soon exceeds it.
"""

CLOSE = 1e-5
"""Gap in spacings below which a place counts as in contact in a preconditioner. With 0 a place at
the edge of a contact that touches and leaves in turn kept the residual of a round seal at 1.2e-6
for 2400 evaluations, where 60 now suffice.
"""

SAMPLES = 64
"""Intervals in which the length of an obstacle's path between two equilibria is measured; its
amplitude may go to and fro.
"""

PASSED = 0.5
"""Depth of a point in an obstacle, in spacings, beyond which the obstacle has passed the boundary.
Chosen: the outermost points lie half a spacing inside the boundary, which enters an obstacle by a
small part of a spacing only.
"""


class Obstructed(InvalidState):
    """Error for an obstacle that has passed the boundary of the body, or lies inside a part of
    it whose motion is prescribed.
    """


class ContactNodes:
    """Places of a body at which obstacles push, on every rank all of them, and the map from the
    motion of the points to theirs.

    Values at the points are gathered from all ranks and multiplied by the map of the whole body, so
    that the sums have the same bits on any number of ranks.

    Parameters
    ----------
    share : Share
    interpolation : Following
        Map from the points of this rank to the places.
    nodes : ndarray, shape (k, d)
        Reference positions of the places: first the nodes of the boundary.
    areas : ndarray, shape (k,)
        Area that a place stands for, in the plane its length; 0 where obstacles do not push, as at
        bonded nodes.
    facets : ndarray of int, shape (f, d)
        Nodes of the facets that obstacles can touch.
    bonded : ndarray of bool, shape (nodes,)
        Nodes of the boundary in bonded planes.
    stops : ndarray of int, shape (f,)
        Place of the point beside a bonded corner that is nearest to each facet; -1 for facets
        elsewhere.
    spacing : float
    """

    def __init__(
        self,
        share: Share,
        interpolation: Following,
        nodes: np.ndarray,
        areas: np.ndarray,
        facets: np.ndarray,
        bonded: np.ndarray,
        stops: np.ndarray,
        spacing: float,
    ) -> None:
        self.share = share
        self.nodes = nodes
        self.areas = areas
        self.facets = facets
        self.bonded = bonded
        self.spacing = spacing
        self.stops = stops
        self._points = np.unique(interpolation.rows.indices)
        numbers = share.everywhere(share.numbers[self._points])
        self._order = np.argsort(np.concatenate(numbers))
        start = sum(map(len, numbers[: share.ranks.rank]))
        self._here = np.argsort(self._order)[start : start + len(self._points)]

        def of_all(rows: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
            parts = share.everywhere(rows[:, self._points])
            return scipy.sparse.hstack(parts, format="csc")[:, self._order].tocsr()

        self._map = interpolation.changed(of_all)

    def _gathered(self, vectors: np.ndarray) -> np.ndarray:
        """Return the vectors at the points of all ranks on which the places depend."""
        return np.concatenate(self.share.everywhere(vectors.take(self._points, axis=0)))[
            self._order
        ]

    def places(self, vectors: np.ndarray, planes: np.ndarray | None = None) -> np.ndarray:
        """Return vectors at the places (k, d) from vectors at the points of this rank (n, d) and,
        across themselves, of planes of symmetry; see `Following`.
        """
        return self._map(self._gathered(vectors), planes)

    def add(self, forces: np.ndarray, out: np.ndarray) -> None:
        """Add the forces on the points of this rank that result from forces on the places (k, d)
        to `out`, shape (n, d).
        """
        out[self._points] += self._map.spread(forces)[self._here]

    def on_planes(
        self, forces: np.ndarray, positions: np.ndarray, planes: np.ndarray
    ) -> np.ndarray:
        """Return what acts on planes of symmetry by forces on the places (k, d), see
        `Following.on_planes`; 0 on ranks other than the first.
        """
        return self._map.on_planes(forces, self._gathered(positions), planes) * self.share.is_first

    def greatest_frequency(self, stiffness: np.ndarray, mass: np.ndarray) -> float:
        """Return an upper bound of the squared frequencies of points with masses (n,) on springs of
        given stiffness (k,) at the places.

        The bound is the greatest sum of a row of absolute values.
        """
        parts = (abs(self._map.component(axis)) for axis in range(self.nodes.shape[1]))
        sums = np.max([rows.T @ (stiffness * rows.sum(axis=1)) for rows in parts], axis=0)
        return self.share.greatest((sums[self._here] / mass[self._points]).max(initial=0.0))


class Obstacle:
    """Rigid obstacle, which pushes at a place of area A with the force max(q - k A g, 0), where g
    is the gap to it and k a stiffness.

    Equilibria find the pushes q with which nothing penetrates; in dynamics a place keeps its
    push until it leaves the obstacle.

    Parameters
    ----------
    name : str
        Name under which results report the obstacle.
    amplitude : callable
        Factor of its displacement as a function of the loading parameter; raises ValueError where
        it has no value.
    surface : ContactNodes
    center : ndarray, shape (d,)
        Undeformed place of the obstacle: center, a place on the axis, or a place on the flat side.
    radius : float or None
        Radius of a round obstacle; None for a flat one.
    direction : ndarray, shape (d,), or None
        Unit vector along the axis of a cylinder, or out of a flat obstacle.
    travel : ndarray, shape (d,)
        Displacement where the amplitude is 1.
    stiffness : float
        Pressure divided by penetration.

    Attributes
    ----------
    factor : float
        Present value of the amplitude.
    stiffness : ndarray, shape (k,)
        Force divided by penetration at each place.
    pushes : ndarray, shape (k,)
        Force at each place where the gap is zero, the column of the obstacle in `Loads.pushes`.
    barred : mapping of str to ndarray of int
        Places that the obstacle must not touch, by the name of the rigid region that they belong
        to.
    planes : ndarray, shape (planes,)
        Positions of the planes of symmetry, set by `Loads`.
    name, amplitude, surface, travel
    """

    planes: np.ndarray
    needs_thickness = False
    no_potential_because = None

    def __init__(
        self,
        name: str,
        amplitude: Callable[[float], float],
        surface: ContactNodes,
        center: np.ndarray,
        radius: float | None,
        direction: np.ndarray | None,
        travel: np.ndarray,
        stiffness: float,
    ) -> None:
        self.name = name
        self.amplitude = amplitude
        self.surface = surface
        self.travel = travel
        self.factor = 0.0
        self.barred: Mapping[str, np.ndarray] = {}
        self.pushes = np.zeros(len(surface.nodes))
        self._center = center
        self._radius = radius
        self._direction = direction
        self.stiffness = stiffness * surface.areas

    def gaps(
        self, places: np.ndarray, factor: float | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the distances of places (k, d) from the obstacle, negative within it, and its unit
        normals toward them (k, d).

        The obstacle is displaced by `factor` times its travel, by default by its present factor.
        """
        arms = places - (self._center + (self.factor if factor is None else factor) * self.travel)
        if self._radius is None:
            return arms @ self._direction, np.tile(self._direction, (len(arms), 1))
        if self._direction is not None:
            arms = arms - (arms @ self._direction)[:, None] * self._direction
        lengths = np.linalg.norm(arms, axis=1)
        return lengths - self._radius, arms / np.maximum(lengths, 1e-300)[:, None]

    def enters(self, parameter: float) -> bool:
        """Return whether the obstacle overlaps the undeformed body at a value of the loading
        parameter.
        """
        gaps, _ = self.gaps(self.surface.nodes, self.amplitude(parameter))
        return bool((gaps[self.stiffness > 0] < 0).any())

    def check_barred(self, positions: np.ndarray) -> None:
        """Raise Obstructed if the obstacle touches a rigid region in a state, at positions (n,
        d) of the points.
        """
        for name, places in self.barred.items():
            if (
                self.gaps(self.at_sites(positions, self.planes)[places])[0].min(initial=0.0)
                < -CLOSE * self.surface.spacing
            ):
                raise Obstructed(
                    f"the obstacle {self.name} touches the rigid region {name}, but pushes on"
                    " deformable materials alone"
                )

    def passes(self, before: float, after: float, start: np.ndarray, end: np.ndarray) -> bool:
        """Return whether the obstacle enters the body between two equilibria, at `start` and `end`
        (n, d), by more than `PASSED`.

        The obstacle follows its amplitude from the parameter `before` to `after`, and points move
        in straight lines meanwhile.
        """
        surface = self.surface
        factors = [self.amplitude(t) for t in np.linspace(before, after, SAMPLES + 1)]
        way = np.linalg.norm(self.travel) * np.abs(np.diff(factors)).sum() + surface.share.greatest(
            np.abs(end - start)
        )
        found = False
        for part in np.linspace(0, 1, int(way / (PASSED * surface.spacing)) + 2)[1:-1]:
            gaps, _ = self.gaps(
                start + part * (end - start), self.amplitude(before + part * (after - before))
            )
            found |= bool((gaps < -PASSED * surface.spacing).any())
        return bool(surface.share.any(found))

    def at_sites(self, vectors: np.ndarray, planes: np.ndarray | None) -> np.ndarray:
        """Return vectors at the places (k, d) from vectors at the points (n, d) and planes."""
        return self.surface.places(vectors, planes)

    def on_sites(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Return the force at every place, shape (k, d); 0 on ranks other than the first."""
        forces, normals = self.pushed(positions)
        return forces[:, None] * normals * self.surface.share.is_first

    def pushed(
        self, positions: np.ndarray, pushes: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the force (k,) at every place, by default with the present `pushes`, and its
        directions (k, d).
        """
        gaps, normals = self.gaps(self.surface.places(positions, self.planes))
        pushes = self.pushes if pushes is None else pushes
        return np.maximum(pushes - self.stiffness * gaps, 0.0), normals

    def add(self, positions: np.ndarray, thickness: np.ndarray | None, out: np.ndarray) -> None:
        """Add the forces of the obstacle on the points to `out`, shape (n, d)."""
        forces, normals = self.pushed(positions)
        self.surface.add(forces[:, None] * normals, out)

    def on_planes(self, positions: np.ndarray, thickness: np.ndarray | None) -> np.ndarray:
        """Return this rank's part of what acts on the planes, see `Following.on_planes`."""
        forces, normals = self.pushed(positions)
        return self.surface.on_planes(forces[:, None] * normals, positions, self.planes)

    def potential(self, positions: np.ndarray) -> float:
        """Return the energy of the contact, 0 without gaps and penetration; 0 on ranks other than
        the first.
        """
        pushing = self.stiffness > 0
        forces = self.pushed(positions)[0]
        squares = forces[pushing] ** 2 - self.pushes[pushing] ** 2
        return float((squares / self.stiffness[pushing]).sum()) / 2 * self.surface.share.is_first

    def contact(self, positions: np.ndarray) -> dict[str, float]:
        """Return the deformed area of the boundary in contact, in the plane its length, and the
        greatest penetration.

        The gap is linear in a facet, so that an edge of the contact may lie within it. A facet
        beside a bonded corner also touches, as a whole, if the point at it does.
        """
        facets = self.surface.facets
        places = self.surface.places(positions, self.planes)
        touching = TOUCHING * self.surface.spacing
        gaps, _ = self.gaps(places)
        # In dynamics a place is pushed until its gap is q / (k A).
        gaps = np.where(self.pushes > self.stiffness * gaps, np.minimum(gaps, 0.0), gaps)
        whole = (self.surface.stops >= 0) & (gaps[self.surface.stops] < touching)
        bonded = self.surface.bonded[facets]
        deepest = float(gaps[self.stiffness > 0].min(initial=0.0))
        at_corners = np.where(bonded, np.inf, gaps[facets])
        # A bonded corner touches if the nodes beside it do.
        at_corners = np.where(bonded, at_corners.min(axis=1, keepdims=True), at_corners)
        return {
            "area": float(
                np.where(whole, 1.0, _share_below(at_corners - touching)) @ _areas(places, facets)
            ),
            "penetration": max(0.0, -deepest),
        }


def _areas(places: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Return the areas of facets (f, d) between nodes at given places (k, d), in the plane their
    lengths, shape (f,).
    """
    first, *others = places[facets].swapaxes(0, 1)
    sides = [other - first for other in others]
    return (
        np.linalg.norm(sides[0], axis=1)
        if len(sides) == 1
        else np.linalg.norm(np.cross(*sides), axis=1) / 2
    )


def _share_below(values: np.ndarray) -> np.ndarray:
    """Return the share of each facet in which a linear function is negative, shape (f,), from
    its values at the corners (f, d).
    """
    below = values < 0
    count = below.sum(axis=1)
    corners = values.shape[1]
    # the corner with a sign of its own
    alone = np.where(count == 1, below.argmax(axis=1), below.argmin(axis=1))
    own = np.abs(np.take_along_axis(values, alone[:, None], axis=1))
    with np.errstate(invalid="ignore"):
        # the factor of the corner itself is 1/2
        part = 2 * (own / (own + np.abs(values))).prod(axis=1)
    return np.select([count == 0, count == corners, count == 1], [0.0, 1.0, part], 1 - part)


class ContactStiffness:
    """Stiffness A of a body plus that of its contact with obstacles, and displacements that bring
    the boundary out of obstacles.

    With rows g of the normal displacements in contact, and their stiffnesses k, the inverse of A +
    g^T k g follows from that of A by Woodbury's identity. The displacements of all places under a
    push on one of them along an axis are computed when they are first needed. Obstacles and places
    are numbered as pairs, those of the first obstacle first.

    Parameters
    ----------
    inverse : callable
        Inverse of A, a linear operator: returns the displacements (n, d) under forces (n, d).
    obstacles : sequence of Obstacle
    """

    def __init__(self, inverse: Operator, obstacles: Sequence[Obstacle]) -> None:
        self._inverse = inverse
        self._obstacles = obstacles
        self._surface = obstacles[0].surface
        self._stiffness = np.concatenate([obstacle.stiffness for obstacle in obstacles])
        self._places = np.tile(np.arange(len(self._surface.nodes)), len(obstacles))
        # Displacements of all places under a unit push on a place along an axis.
        self._known: dict[tuple[int, int], np.ndarray] = {}
        self._active = np.zeros(0, dtype=int)
        self._normals = np.zeros((0, 0))
        self._factor = None

    def _gaps(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the gaps of all pairs, infinite where obstacles do not push, the gaps below which
        they push, and the normals.
        """
        places = self._surface.places(positions, self._obstacles[0].planes)
        gaps, normals = (
            np.concatenate(parts)
            for parts in zip(*(one.gaps(places) for one in self._obstacles), strict=True)
        )
        pushes = np.concatenate([obstacle.pushes for obstacle in self._obstacles])
        pushing = self._stiffness > 0
        reach = np.divide(pushes, self._stiffness, out=np.zeros_like(pushes), where=pushing)
        return np.where(pushing, gaps, np.inf), reach, normals

    def _moved_by(self, at_places: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """Return the displacements of the points, with `shape` (n, d), under forces on the places
        (k, d).
        """
        forces = np.zeros(shape)
        self._surface.add(at_places, forces)
        return self._inverse(forces)

    def _pushed_by(
        self, pairs: np.ndarray, normals: np.ndarray, pushes: np.ndarray, shape: tuple[int, ...]
    ) -> np.ndarray:
        """Return the displacements of the points under pushes (p,) of `pairs` (p,) along their
        normals (p, d).
        """
        at_places = np.zeros_like(self._surface.nodes)
        np.add.at(at_places, self._places[pairs], pushes[:, None] * normals)
        return self._moved_by(at_places, shape)

    def _responses(
        self, rows: np.ndarray, pairs: np.ndarray, normals: np.ndarray, shape: tuple[int, ...]
    ) -> np.ndarray:
        """Return the displacements of the pairs `rows` along their normals under unit pushes on
        `pairs`, shape (rows, pairs); `normals` are those of all pairs.
        """
        places = self._places[rows]
        along = normals[rows]
        found = np.zeros((len(rows), len(pairs)))
        for column, pair in enumerate(pairs.tolist()):
            for axis in np.flatnonzero(normals[pair]).tolist():
                key = int(self._places[pair]), axis
                if key not in self._known:
                    unit = np.zeros_like(self._surface.nodes)
                    unit[key] = 1.0
                    self._known[key] = self._surface.places(self._moved_by(unit, shape))
                found[:, column] += normals[pair, axis] * (self._known[key][places] * along).sum(1)
        return found

    def _compliance(self, pairs: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Return the matrix from pushes on `pairs` in contact to their normal displacements, from
        their responses (p, p) and the stiffness of the contact itself.
        """
        return (own + own.T) / 2 + np.diag(1 / self._stiffness[pairs])

    def adapt(self, positions: np.ndarray) -> bool:
        """Adapt to the contact at positions (n, d); return whether other places are in contact
        than before.
        """
        gaps, reach, normals = self._gaps(positions)
        pairs = np.flatnonzero(gaps - reach < CLOSE * self._surface.spacing)
        changed = not np.array_equal(pairs, self._active)
        if changed or not np.array_equal(normals[pairs], self._normals):
            self._active = pairs
            self._normals = normals[pairs]
            own = self._responses(pairs, pairs, normals, positions.shape)
            self._factor = (
                scipy.linalg.lu_factor(self._compliance(pairs, own)) if len(pairs) else None
            )
        return changed

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements (n, d) under forces (n, d)."""
        moved = self._inverse(forces)
        if self._factor is None:
            return moved
        pairs = self._active
        normals = self._normals
        along = (self._surface.places(moved)[self._places[pairs]] * normals).sum(axis=1)
        pushes = scipy.linalg.lu_solve(self._factor, along)
        return moved - self._pushed_by(pairs, normals, pushes, forces.shape)

    def outside(self, positions: np.ndarray) -> np.ndarray:
        """Return positions (n, d) moved by the least displacements, in the energy of A, that bring
        the boundary out of the obstacles.

        Places in contact are found in rounds, which add those that penetrate and remove those that
        are pulled.
        """
        gaps, reach, normals = self._gaps(positions)
        pairs = np.flatnonzero(gaps < reach)
        pushes = np.zeros(0)
        every = np.arange(len(gaps))
        for _ in range(MOST_ROUNDS if len(pairs) else 0):
            responses = self._responses(every, pairs, normals, positions.shape)
            pushes = np.linalg.solve(self._compliance(pairs, responses[pairs]), -gaps[pairs])
            active = gaps + responses @ pushes < reach
            active[pairs] = pushes > -self._stiffness[pairs] * reach[pairs]
            before = pairs
            pairs = np.flatnonzero(active)
            if np.array_equal(before, pairs):
                break
        else:
            return positions
        return positions + self._pushed_by(pairs, normals[pairs], pushes, positions.shape)
