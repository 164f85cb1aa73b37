"""Boundary of a body, where tractions and pressures act."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from ..kernels.polygons import distances_to_segments, encloses
from ..ranks import Share
from .cell_mesh import outward
from .ghosts import HeldBoundary, Mirror

IN_PLANE = 1e-6
"""Distance from a reflection plane, as a fraction of the body's extent, up to which a node or an
end of a precut lies in it, and from a side of the bounding box, up to which a side of a mesh's cell
does. Chosen above the rounding of coordinates in single precision that meshes may have.
"""


@dataclass(frozen=True)
class Following:
    """Linear map from vectors at points of a body, such as displacements, to vectors at other
    places.

    The mirror images of points in planes of symmetry contribute as points do: they have the vectors
    of the points, but for the component across the plane, which is reflected in that of the plane.

    Attributes
    ----------
    rows : csr_array, shape (k, n)
        Weights of the points together with their images; they sum to 1.
    across : tuple of (int, int, csr_array)
        For each plane of symmetry its number in `Body.planes`, its axis, and twice the weights of
        the images in it, shape (k, n).
    """

    rows: scipy.sparse.csr_array
    across: tuple[tuple[int, int, scipy.sparse.csr_array], ...] = ()

    def __call__(self, vectors: np.ndarray, planes: np.ndarray | None = None) -> np.ndarray:
        """Return vectors at the places (k, d) from vectors at the points (n, d).

        `planes` are the components of the planes across themselves: their positions for positions,
        their displacements for displacements; 0 by default.
        """
        found = self.rows @ vectors
        for number, axis, rows in self.across:
            own = 0.0 if planes is None else planes[number]
            found[:, axis] += rows @ (own - vectors[:, axis])
        return found

    def spread(self, forces: np.ndarray) -> np.ndarray:
        """Return the forces on the points (n, d) that do the work of forces on the places (k, d)
        while planes rest.
        """
        found = self.rows.T @ forces
        for _, axis, rows in self.across:
            found[:, axis] -= rows.T @ forces[:, axis]
        return found

    def on_planes(
        self, forces: np.ndarray, positions: np.ndarray, planes: np.ndarray
    ) -> np.ndarray:
        """Return the forces that reach the planes from forces on the places (k, d), as outer
        products with the places where they act, (1, y), shape (planes, d, 1 + d).

        The force on an image along a plane of symmetry moves its point in the same way: it leaves
        the plane the couple of both. `positions` (n, d) are those of the points, and `planes` those
        of the planes.
        """
        found = np.zeros((len(planes), positions.shape[1], 1 + positions.shape[1]))
        for number, axis, rows in self.across:
            feet = np.insert(positions, 0, 1.0, axis=1)
            feet[:, 1 + axis] = planes[number]
            of_images = rows.T @ forces
            found[number, :, 1 + axis] = of_images.T @ (planes[number] - positions[:, axis])
            found[number, axis] = of_images[:, axis] @ feet
        return found

    def component(self, axis: int) -> scipy.sparse.csr_array:
        """Return the weights (k, n) of the points in one component of the vectors."""
        return sum((-rows for _, across, rows in self.across if across == axis), self.rows)

    def changed(self, change: Callable) -> Following:
        """Return the map whose matrices are those that ``change(matrix)`` returns, with other
        places or points.
        """
        return Following(
            change(self.rows),
            tuple((number, axis, change(rows)) for number, axis, rows in self.across),
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
        return replace(self, interpolation=self.interpolation.changed(share.own_columns))

    def on_points(self) -> np.ndarray:
        """Return the forces on the points, shape (n, d), of a unit tension on the undeformed
        faces.
        """
        return self.interpolation.spread(self.areas)


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
        own = self.interpolation.changed(share.own_columns)
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
        forces = np.zeros(self.nodes.shape)
        normals = self.normals() / self.nodes.shape[1]
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
        return self.interpolation.spread(forces) + on_faces

    def followed(self) -> np.ndarray:
        """Return flags of the nodes that have enough points near them to define their motion,
        shape (k,).
        """
        return np.diff(self.interpolation.rows.indptr) > 0 if self.follow is None else self.follow

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
        place = near["i"]
        facet = near["j"]
        distances = distances_to_segments if corners.shape[1] == 2 else _distances_to_triangles
        np.minimum.at(nearest, place, distances(places[place], *corners[facet].transpose(1, 0, 2)))
        return np.where(nearest <= reach, nearest, np.inf)


def _distances_to_triangles(
    places: np.ndarray, first: np.ndarray, second: np.ndarray, third: np.ndarray
) -> np.ndarray:
    """Return the distance of place i to triangle i, for every i: to its plane where the place
    projects into it, else to an edge.
    """
    one = second - first
    other = third - first
    offset = places - first
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
