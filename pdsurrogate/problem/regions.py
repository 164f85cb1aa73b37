"""Regions of a scene, resolved into the numbers of the points of its body, or of the facets of
its boundary, that lie in them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..body import Body, Surface
from ..body.body import lengths_of
from ..body.local_fit import text_of, too_few
from ..discretization.chains import ROUNDING
from ..discretization.planes import whole_boundaries, whole_edge
from ..scenes import Region, Scene
from ..scenes.model import EDGES
from ..scenes.problems import suggestion
from ..scenes.regions import edge_names

LAYER = 0.99
"""Greatest distance of points that belong to an edge or to the boundary, in cells; from an edge of
a mesh in sides of the point's own cell.

The outermost points lie half a cell inside; so do points along a boundary whose cells include a
part of another, cut cell. Points of the second layer lie one and a half cells inside. A triangle or
tetrahedron that touches the edge with one corner lies 2/3 or 3/4 inside.
"""


@dataclass(eq=False)
class _Parts:
    """Base class for the points of a body, or the facets of its boundary, each at a place, among
    which those in a region are searched.

    Every search returns the distances of all points or facets from the region, with which messages
    about empty regions name the nearest: 0 for those in it, infinite where no distance is defined.
    """

    regions: "BodyRegions"
    places: np.ndarray
    groups: Mapping[str, np.ndarray]

    def group(self, name: str) -> np.ndarray:
        """Return the distances from a physical group of the mesh file: 0 for its points or
        facets, infinite for others.
        """
        if not self.groups:
            raise ValueError(
                f"there is no group {name!r}: the body is not a mesh with physical groups of cells"
                " or lines"
            )
        if name not in self.groups:
            raise ValueError(
                f"the mesh has no group {name!r}; {suggestion(name, self.groups, 'it has')}"
            )
        return self.numbered(self.groups[name])

    def numbered(self, numbers: np.ndarray) -> np.ndarray:
        """Return the distances that mean that the points or facets with the given numbers are in
        the region: 0 for them, else infinite.
        """
        distance = np.full(len(self.places), np.inf)
        distance[numbers] = 0.0
        return distance


class _Points(_Parts):
    """Points of the body, among which the points of a region are searched."""

    what = "the region contains no point of the body"

    def describe(self, number: int) -> str:
        return f"point {number} at {text_of(self.places[number])}"

    def edge(self, name: str) -> np.ndarray:
        axis, side = EDGES[name]
        distance = side * (
            (self.regions.upper if side > 0 else self.regions.lower)[axis] - self.places[:, axis]
        )
        cells = self.regions.body.mesh_cells
        return np.where(
            distance
            < LAYER * (self.regions.body.cell[axis] if cells is None else cells.extents(axis)),
            0.0,
            distance,
        )

    def boundary(self, name: str) -> np.ndarray:
        surface = self.regions.surface()
        reach = LAYER * self.regions.body.cell.max()
        cells = self.regions.body.mesh_cells
        facets = _facets_of(surface, name)
        if cells is not None:  # those that touch it, of whatever size
            return np.where(
                cells.touching(
                    np.isfinite(surface.distances(cells.nodes, self.regions.tolerance, facets))
                ),
                0.0,
                np.inf,
            )
        distance = surface.distances(self.places, reach, facets)
        return np.where(distance < reach, 0.0, distance)

    def listed(self, region: Region) -> np.ndarray:
        """Return the distances from the points that a region lists by number, or from those nearest
        to its place `near`.

        They are 0 for these points, infinite for others. Several points may be equally near to a
        thousandth of a cell. Raise ValueError if a number is too great, or if the nearest point is
        more than two cells from the place.
        """
        share = self.regions.body.share
        if region.near is not None:
            distance = np.linalg.norm(self.places - np.array(region.near), axis=1)
            nearest = int(distance.argmin())
            least = min(share.everywhere(float(distance[nearest])))
            # Inside a body the nearest point lies 0.9 cells away at most.
            if least > 2.0 * self.regions.body.cell.max():
                place = text_of(np.array(region.near))
                found = self.describe(nearest)
                raise ValueError(
                    f"no point is close enough to {place}: the nearest one is {found},"
                    f" {distance[nearest]:.3g} away"
                )
            # Equally near, far above rounding and far below what points of a mesh have by chance,
            # are points on either side of an axis of symmetry, where a support at one of them alone
            # would turn the body.
            return self.numbered(
                np.flatnonzero(distance <= least + 1e-3 * self.regions.body.cell.min())
            )
        numbers = np.array(region.points, dtype=np.int64)
        size = share.size
        if numbers.max(initial=-1) >= size:
            raise ValueError(
                f"there is no point {numbers.max()}; the points of the body have the numbers 0 to"
                f" {size - 1}"
            )
        return self.numbered(share.local(numbers))


class _Facets(_Parts):
    """Facets of the boundary of the body, among which the facets of a region are searched."""

    what = "the region contains no part of the boundary"

    def describe(self, number: int) -> str:
        return (
            f"a facet of {self.regions.surface().parts[number]} with its middle at"
            f" {text_of(self.places[number])}"
        )

    def edge(self, name: str) -> np.ndarray:
        return self.numbered(self.regions.surface().parts == name)

    def boundary(self, name: str) -> np.ndarray:
        return self.numbered(_facets_of(self.regions.surface(), name))

    def listed(self, region: Region) -> np.ndarray:
        key = "near" if region.points is None else "points"
        raise ValueError(
            f"this load needs a part of the boundary, not points; instead of {key} give an edge,"
            " outline, holes or a box"
        )


def _facets_of(surface: Surface, name: str) -> np.ndarray:
    """Return the numbers of the facets of a part of the boundary: "outline", "holes" for all
    holes, or "holes.0", ... for one of them.
    """
    holes = np.char.startswith(surface.parts, "holes.")
    found = np.flatnonzero(
        ~holes if name == "outline" else holes if name == "holes" else surface.parts == name
    )
    if not len(found):
        there = sorted(set(surface.parts[holes]), key=lambda part: int(part.removeprefix("holes.")))
        raise ValueError(
            f"there is no boundary {name}; "
            + (f"there are {', '.join(there)}" if there else "the body has no holes")
        )
    return found


@dataclass(eq=False)
class BodyRegions:
    """Regions of a scene, resolved into numbers of points of its body and of facets of its
    boundary.

    A point belongs to a shape if it is inside the shape; to an edge, the outline or the holes if it
    is within a cell of them; to a group of a mesh if its cell is in the group, or has a line of the
    group as a side. A facet belongs to a shape if its middle is inside the shape; to an edge, the
    outline or the holes if it is part of them; to a group if it is of the cells or lines of the
    group.

    Error messages identify a region by its name, or a region without a name by the `key` of the
    scene's entry that defines it.

    Parameters
    ----------
    scene : Scene
    body : Body
    lower, upper : ndarray, shape (d,)
        Corners of the bounding box of the body.
    surface : callable
        Returns the boundary of the body, made where it is first needed.
    """

    scene: Scene
    body: Body
    lower: np.ndarray
    upper: np.ndarray
    surface: Callable[[], Surface]

    @property
    def tolerance(self) -> float:
        """Return the greatest distance that may be due to rounding."""
        return ROUNDING * float((self.upper - self.lower).max())

    def points(self, reference: str | Region, key: str | None = None) -> np.ndarray:
        """Return the indices of the points in a region, given as a `Region` or by name.

        Raises
        ------
        ValueError
            If there are none; the message gives the name of the region (for a region without a name
            `key`) and the nearest point.
        """
        return self._found(reference, key, _Points(self, self.body.points, self.body.groups))

    def facets(self, reference: str | Region, key: str | None = None) -> np.ndarray:
        """Return the numbers of the facets in a region, given as a `Region` or by name.

        Raises
        ------
        ValueError
            If there are none, or a node of a facet has too few points near it to determine its
            motion; the message names the region (one without a name by `key`) and the place.
        """
        surface = self.surface()
        parts = _Facets(self, surface.midpoints(), surface.groups)
        found = self._found(reference, key, parts)
        lost = surface.facets[found][~surface.followed()[surface.facets[found]]]
        if len(lost):
            raise ValueError(
                f"{self._key(reference, key)}: the body is too thin at"
                f" {text_of(surface.nodes[lost[0]])}, where the points near the boundary, with"
                f" which it moves, are {too_few(self.body)}; use {self.body.finer}"
            )
        return found

    def edge(self, reference: str | Region) -> str | None:
        """Return the name of the edge or face of the bounding box that a region consists of;
        None for any other region.
        """
        return whole_edge(self.scene, reference, self.body.faces)

    def mirrors(self, reference: str | Region) -> tuple[str, ...]:
        """Return the name of the edge, or the names of the outline or holes, that a region
        consists of: mirrored points may hold them.
        """
        edge = self.edge(reference)
        return whole_boundaries(self.scene, reference) if edge is None else (edge,)

    def is_place(self, reference: str | Region) -> bool:
        """Return whether a region is defined as the points nearest to a place."""
        region = self._unnamed(reference)
        return isinstance(region, Region) and region.near is not None

    def check_place(self, key: str, place: Sequence[float]) -> None:
        """Check that a place lies in the body, and not in one of its holes.

        Raises
        ------
        ValueError
            If the place lies elsewhere; the message names `key`, the key of the place in the scene,
            and the nearest point.
        """
        at = np.array([place], dtype=float)
        surface = self.surface()
        # Facets of round outlines, half a cell long, lie up to 0.02 cells inside the outline.
        if not surface.encloses(at)[0] and not np.isfinite(
            surface.distances(at, 0.05 * self.body.cell.max())[0]
        ):
            distance, point = scipy.spatial.cKDTree(self.body.points).query(at[0])
            raise ValueError(
                f"{key}: {text_of(at[0])} lies outside the body; its nearest point is {point} at"
                f" {text_of(self.body.points[point])}, {distance:.3g} away"
            )

    def _found(
        self, reference: str | Region, key: str | None, parts: _Points | _Facets
    ) -> np.ndarray:
        try:
            distance = self._resolved(reference, parts)
            numbers = np.flatnonzero(distance == 0)
            if not self.body.share.any(len(numbers)):
                raise ValueError(f"{parts.what}{self._nearby(reference, parts, distance)}")
        except ValueError as error:
            raise ValueError(f"{self._key(reference, key)}: {error}") from None
        return numbers

    def _unnamed(self, reference: str | Region) -> str | Region:
        """Return the region that the scene defines under a name; other names, as of edges, and
        regions are returned unchanged.
        """
        while isinstance(reference, str) and reference in self.scene.regions:
            reference = self.scene.regions[reference]
        return reference

    def _resolved(self, reference: str | Region, parts: _Points | _Facets) -> np.ndarray:
        """Return the distances of points or facets, `parts`, from a region: 0 for those in it."""
        region = self._unnamed(reference)
        if isinstance(region, str):
            if region in edge_names(self.scene.dimension):
                return parts.edge(region)
            return (
                parts.numbered(np.arange(len(parts.places)))
                if region == "body"
                else parts.boundary(region)
            )
        if members := [self._resolved(member, parts) for _, member in region.members()]:
            if region.other is not None:
                return parts.numbered(members[0] > 0)
            return np.min(members, axis=0) if region.both is None else np.max(members, axis=0)
        if region.edge is not None:
            return parts.edge(region.edge)
        if region.group is not None:
            return parts.group(region.group)
        if region.points is not None or region.near is not None:
            return parts.listed(region)
        distance = np.full(len(parts.places), np.inf)
        round_one = region.disc or region.ball
        near = slice(None)
        if round_one is not None:
            # Of thousands of inclusions each has few of the points at its own x1; the others matter
            # where it has none.
            beside = np.flatnonzero(
                np.abs(parts.places[:, 0] - round_one.center[0])
                <= round_one.radius + self.tolerance
            )
            near = (
                beside
                if (_distance(region, parts.places[beside]) <= self.tolerance).any()
                else near
            )
        distance[near] = _distance(region, parts.places[near])
        distance[distance <= self.tolerance] = 0.0
        return distance

    def _nearby(
        self, reference: str | Region, parts: _Points | _Facets, distance: np.ndarray
    ) -> str:
        """Return, for the message about an empty region, which point or facet is nearest by the
        given distances, or why none is near.
        """
        region = self._unnamed(reference)
        if isinstance(region, Region) and region.both is not None:
            counts = [
                f"{(self._resolved(member, parts) == 0).sum()} lie in {key}"
                for key, member in region.members()
            ]
            return (
                f": of {len(parts.places)} candidates, {', '.join(counts)}, but none lies in all of"
                " them"
            )
        edge = self.edge(region)
        if edge is not None and isinstance(parts, _Facets):
            side, there = (
                ("straight side", "edge") if len(self.lower) == 2 else ("flat part", "face")
            )
            return f"; no {side} of the body is on its {edge} {there}"
        if not np.isfinite(distance).any():
            return ""
        number = int(distance.argmin())
        return f"; the nearest is {parts.describe(number)}, {distance[number]:.3g} away"

    def _key(self, reference: str | Region, key: str | None) -> str:
        """Return what error messages call a region: ``regions.NAME`` if the scene defines it,
        else `key`, else the name, or "region".
        """
        if isinstance(reference, str) and reference in self.scene.regions:
            return f"regions.{reference}"
        return key or (reference if isinstance(reference, str) else "region")


def _distance(region: Region, places: np.ndarray) -> np.ndarray:
    """Return the distances of places (n, d) from a region that is a box, disc, ball, half-plane
    or half-space; zero inside it.
    """
    if region.box is not None:
        lower, upper = np.array(region.box)
        return np.linalg.norm(np.maximum(0, np.maximum(lower - places, places - upper)), axis=1)
    round_one = region.disc or region.ball
    side = region.half_plane or region.half_space
    if round_one is not None:
        return np.maximum(0, lengths_of(places - np.array(round_one.center)) - round_one.radius)
    normal = np.array(side.normal)
    return np.maximum(0, (np.array(side.point) - places) @ (normal / np.linalg.norm(normal)))
