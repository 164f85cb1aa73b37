"""Boundary of a body, where tractions and pressures act."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy

from ..kernels.polygons import distances_to_segments, encloses
from ..ranks import Share
from .cell_mesh import outward
from .ghosts import HeldBoundary, Mirror

IN_PLANE = 1e-6
"""Distance from a reflection plane, as a fraction of the body's extent, up to which a node lies in
it. Chosen above the rounding of coordinates in single precision that meshes may have.
"""


@dataclass(frozen=True)
class Following:
    """Linear map from vectors at points of a body, such as displacements, to vectors at other
    places, component by component.

    Attributes
    ----------
    rows : tuple of csr_array, shape (k, n)
        One map for all components, or one for each: near a plane of symmetry the maps of the
        components along the plane use mirror images of the points, and the map of the component
        across it does not.
    """

    rows: tuple[scipy.sparse.csr_array, ...]

    def __matmul__(self, vectors: np.ndarray) -> np.ndarray:
        """Return vectors at the places (k, d) from vectors at the points (n, d); with a single
        map, values of any shape (n, ...).
        """
        if len(self.rows) == 1:
            return self.rows[0] @ vectors
        return np.stack(
            [rows @ vectors[:, component] for component, rows in enumerate(self.rows)], axis=1
        )

    def __getitem__(self, places) -> Following:
        """Return the map from all points to the chosen places alone: its rows of these places,
        given by an index, mask or slice.
        """
        return self._each(lambda rows: rows[places])

    def __sub__(self, other: Following) -> Following:
        return Following(
            tuple(own - theirs for own, theirs in zip(self.rows, other.rows, strict=True))
        )

    def of_points(self, points: np.ndarray) -> Following:
        """Return the part of the map that depends on the chosen points alone: its columns of
        these points.
        """
        return self._each(lambda rows: rows[:, points].tocsr())

    def points(self) -> np.ndarray:
        """Return the numbers of the points on which the motion of at least one place depends."""
        return np.unique(np.concatenate([rows.indices for rows in self.rows]))

    @property
    def T(self) -> Following:  # noqa: N802 (the name that arrays use)
        """Transposed map, a `Following` that distributes forces on the places to the points."""
        return self._each(lambda rows: rows.T.tocsr())

    def of_share(self, share: Share) -> Following:
        """Return the map restricted to the points of this rank's `share` of a body that it owns."""
        return self._each(share.own_columns)

    def _each(self, change: Callable[[Any], Any]) -> Following:
        return Following(tuple(map(change, self.rows)))

    @classmethod
    def mean(cls, several: Sequence[Following]) -> Following:
        """Return the equally weighted mean of several maps: row i maps to the mean motion of
        place i of all the maps.
        """
        return cls(
            tuple(
                (sum(others, first) / (1 + len(others))).tocsr()
                for first, *others in zip(*(one.rows for one in several), strict=True)
            )
        )


@dataclass(frozen=True)
class Faces:
    """The two faces of each cut of a body, which are free: no region contains them, and no load or
    obstacle acts on them.

    Attributes
    ----------
    places : ndarray, shape (k, d)
        Places beside the cuts, in the reference state.
    areas : ndarray, shape (k, d)
        Outward normals times the areas, in the plane lengths, for which the places stand.
    interpolation : Following
        Map from the points to the places, see `Surface`.
    """

    places: np.ndarray
    areas: np.ndarray
    interpolation: Following

    def of_share(self, share: Share) -> Faces:
        """Return the faces with their interpolation restricted to the points of this rank's
        `share` of the body that it owns.
        """
        return replace(self, interpolation=self.interpolation.of_share(share))

    def on_points(self) -> np.ndarray:
        """Return the forces on the points, shape (n, d), of a unit tension on the undeformed
        faces.
        """
        return self.interpolation.T @ self.areas


@dataclass(frozen=True)
class Surface:
    """Boundary of a body: facets between nodes on the boundary, segments in the plane and triangles
    in three dimensions.

    The outermost points of a body lie half a cell inside its boundary. The position of a node is
    linear in those of the points near it, y_s = sum_j N_sj y_j, with sum_j N_sj = 1 and sum_j N_sj
    X_j = X_s. So every affine motion is followed exactly, and a load on a node acts at the boundary
    itself: its force and moment on the points equal those of the load. A node at the mouth of a cut
    follows the mean of the parts beside it.

    Attributes
    ----------
    nodes : ndarray, shape (k, d)
        Reference positions.
    facets : ndarray of int, shape (f, d)
        In the plane, first and second node of each facet, with the body on the left: the outward
        normal times the length is (t2, -t1) for t from the first to the second. In 3D the three
        nodes of each, counter-clockwise as seen from outside. Facets that meet share their nodes,
        so that the boundary consists of closed chains or surfaces.
    parts : ndarray of str, shape (f,)
        Name of the part of the boundary: left, right, bottom, top, back or front on that side of
        the bounding box, outline elsewhere on the outer boundary, and holes.0, holes.1, ... around
        holes.
    interpolation : Following
        Map N from the points to the nodes. The row of a node is empty if the points near it do not
        define its motion, see `followed`.
    groups : mapping of str to ndarray of int
        Numbers of the facets in each physical group of a mesh file.
    follow : ndarray of bool, shape (k,), optional
        Nodes that have a non-empty row in the map N of the whole body, if `interpolation` covers
        only the points of one rank.
    faces : Faces, optional
        The faces of cuts.
    """

    nodes: np.ndarray
    facets: np.ndarray
    parts: np.ndarray
    interpolation: Following
    groups: Mapping[str, np.ndarray] = field(default_factory=dict)
    follow: np.ndarray | None = None
    faces: Faces | None = None

    def of_share(self, share: Share) -> Surface:
        """Return the surface with its interpolation restricted to the points of this rank's
        `share` of the body that it owns.
        """
        own = self.interpolation.of_share(share)
        faces = None if self.faces is None else self.faces.of_share(share)
        return replace(self, interpolation=own, follow=self.followed(), faces=faces)

    def midpoints(self) -> np.ndarray:
        """Return the reference positions of the middles of the facets, shape (f, d)."""
        return self.nodes[self.facets].mean(axis=1)

    def normals(self) -> np.ndarray:
        """Return the outward normals times areas, in the plane times lengths, in the reference
        state, shape (f, d).
        """
        return outward(self.nodes[self.facets])

    def areas(self) -> np.ndarray:
        """Return the areas of the facets in the reference state, in the plane their lengths,
        shape (f,).
        """
        return np.linalg.norm(self.normals(), axis=1)

    def on_points(self, planes: Sequence[Mirror]) -> np.ndarray:
        """Return the forces on the points, shape (n, d), of a unit tension on the undeformed
        boundary, except where `planes` reflect.
        """
        forces, normals = np.zeros(self.nodes.shape), self.normals() / self.nodes.shape[1]
        corners = self.nodes[self.facets]
        for plane in planes:
            if isinstance(plane, HeldBoundary):
                normals[self.parts == plane.name] = 0.0
            else:
                normals[
                    (
                        np.abs(corners[..., plane.axis] - plane.position)
                        < IN_PLANE * np.ptp(self.nodes, axis=0).max()
                    ).all(axis=1)
                ] = 0.0
        for ends in self.facets.T:
            np.add.at(forces, ends, normals)
        # free where they lie in a plane, too
        on_faces = 0.0 if self.faces is None else self.faces.on_points()
        return self.interpolation.T @ forces + on_faces

    def followed(self) -> np.ndarray:
        """Return flags of the nodes that have enough points near them to define their motion,
        shape (k,).
        """
        return (
            np.diff(self.interpolation.rows[0].indptr) > 0 if self.follow is None else self.follow
        )

    def encloses(self, places: np.ndarray) -> np.ndarray:
        """Return flags of the places (m, d) that lie in the body, shape (m,)."""
        if self.nodes.shape[1] == 3:
            return _encloses_in_space(places, self.nodes[self.facets])
        first, second = self.nodes[self.facets].transpose(1, 0, 2)
        return encloses(places, first, second)

    def distances(
        self, places: np.ndarray, reach: float, chosen: np.ndarray | slice = slice(None)
    ) -> np.ndarray:
        """Return the distance of each place (m, d) to the nearest of the chosen facets, shape
        (m,); infinity if above `reach`.
        """
        corners = self.nodes[self.facets[chosen]]
        nearest = np.full(len(places), np.inf)
        if not len(corners):
            return nearest
        middles = corners.mean(axis=1)
        extent = np.linalg.norm(corners - middles[:, None], axis=2).max()
        near = scipy.spatial.cKDTree(places).sparse_distance_matrix(
            scipy.spatial.cKDTree(middles), reach + extent, output_type="ndarray"
        )
        place, facet = near["i"], near["j"]
        distances = distances_to_segments if corners.shape[1] == 2 else _distances_to_triangles
        np.minimum.at(nearest, place, distances(places[place], *corners[facet].transpose(1, 0, 2)))
        return np.where(nearest <= reach, nearest, np.inf)


def _distances_to_triangles(
    places: np.ndarray, first: np.ndarray, second: np.ndarray, third: np.ndarray
) -> np.ndarray:
    """Return the distance of place i to triangle i, for every i: to its plane where the place
    projects into it, else to an edge.
    """
    one, other, offset = second - first, third - first, places - first
    normal = np.cross(one, other)
    square = (normal**2).sum(axis=1)
    shares = [
        (np.cross(a, b) * normal).sum(axis=1) / square for a, b in ((offset, other), (one, offset))
    ]
    above = (shares[0] >= 0) & (shares[1] >= 0) & (shares[0] + shares[1] <= 1)
    sides = [
        distances_to_segments(places, *side)
        for side in ((first, second), (second, third), (third, first))
    ]
    return np.where(
        above, np.abs((offset * normal).sum(axis=1)) / np.sqrt(square), np.min(sides, axis=0)
    )


def _encloses_in_space(places: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return flags of the places (m, 3) that lie within closed surfaces of triangles (f, 3, 3).

    The triangles subtend the full solid angle at such places; the angles are computed after Van
    Oosterom and Strackee (1983).
    """
    inside = np.zeros(len(places), dtype=bool)
    for number, place in enumerate(places):
        a, b, c = (triangles - place).transpose(1, 0, 2)
        lengths = [np.linalg.norm(corner, axis=1) for corner in (a, b, c)]
        volume = (a * np.cross(b, c)).sum(axis=1)
        pairs = zip((a, b, c), (b, c, a), (lengths[2], lengths[0], lengths[1]), strict=True)
        base = lengths[0] * lengths[1] * lengths[2] + sum(
            (one * other).sum(axis=1) * length for one, other, length in pairs
        )
        # each solid angle is twice this; their sum is 4 pi inside, 0 outside
        inside[number] = np.arctan2(volume, base).sum() > np.pi
    return inside
