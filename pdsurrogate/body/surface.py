"""The boundary of a body, where tractions and pressures act."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree


@dataclass(frozen=True)
class Surface:
    """The boundary of a body in the plane: straight facets between nodes that lie on the boundary itself.

    The outermost points of a body lie half a cell inside its boundary.  A node moves as they and their deformation gradient say:
    y_s = sum_j N_sj y_j, with rows of N that are 1 in sum and have X_s as their first moment, so that every affine motion is followed
    exactly, and a load on a node does its work at the boundary itself and keeps linear and angular momentum.
    The node at the mouth of a cut follows both of its sides.

    Attributes
    ----------
    nodes : ndarray, shape (k, 2)
        Reference positions.
    facets : ndarray of int, shape (f, 2)
        First and second node of each facet, with the body on the left: the outward normal times the length is (t2, -t1) for t from the
        first to the second.  Facets that meet share their node, so that the boundary is made of closed chains.
    parts : ndarray of str, shape (f,)
        Where each facet lies: left, right, bottom or top on that edge of the bounding box, outline elsewhere on the outer boundary,
        and holes.0, holes.1, ... around holes.
    interpolation : scipy.sparse.csr_array, shape (k, n)
        N.  The row of a node that its surroundings cannot tell the motion of is empty, see `followed`.
    groups : mapping of str to ndarray of int
        Numbers of the facets in each physical group of a mesh file.
    """

    nodes: np.ndarray
    facets: np.ndarray
    parts: np.ndarray
    interpolation: sparse.csr_array
    groups: Mapping[str, np.ndarray] = field(default_factory=dict)

    def midpoints(self) -> np.ndarray:
        """Reference positions of the middles of the facets, shape (f, 2)."""
        return self.nodes[self.facets].mean(axis=1)

    def normals(self) -> np.ndarray:
        """Outward normals times lengths in the reference state, shape (f, 2)."""
        first, second = self.nodes[self.facets].transpose(1, 0, 2)
        return np.stack([second[:, 1] - first[:, 1], first[:, 0] - second[:, 0]], axis=1)

    def lengths(self) -> np.ndarray:
        """Lengths of the facets in the reference state, shape (f,)."""
        return np.linalg.norm(self.normals(), axis=1)

    def followed(self) -> np.ndarray:
        """Which nodes have enough points beside them to move with, shape (k,)."""
        return np.diff(self.interpolation.indptr) > 0

    def encloses(self, places: np.ndarray) -> np.ndarray:
        """Which of the places (m, 2) lie in the body."""
        first, second = self.nodes[self.facets].transpose(1, 0, 2)
        return encloses(places, first, second)

    def distances(self, places: np.ndarray, reach: float, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Distance of each place (m, 2) to the nearest of the chosen facets, shape (m,); infinite beyond the reach."""
        first, second = self.nodes[self.facets[chosen]].transpose(1, 0, 2)
        nearest = np.full(len(places), np.inf)
        if not len(first):
            return nearest
        # A facet reaches half its length from its middle.
        longest = np.linalg.norm(second - first, axis=1).max()
        near = cKDTree(places).sparse_distance_matrix(cKDTree((first + second) / 2), reach + longest / 2, output_type="ndarray")
        place, facet = near["i"], near["j"]
        np.minimum.at(nearest, place, _distances_to_segments(places[place], first[facet], second[facet]))
        return np.where(nearest <= reach, nearest, np.inf)


def encloses(places: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Which of the places (m, 2) lie within closed chains of segments, whose starts and ends have shape (s, 2).

    A place is inside if a ray from it towards larger x1 crosses the segments an odd number of times.
    """
    inside = np.zeros(len(places), dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        for start, end in zip(starts, ends, strict=True):
            spans = (start[1] > places[:, 1]) != (end[1] > places[:, 1])
            crossing = start[0] + (places[:, 1] - start[1]) * (end[0] - start[0]) / (end[1] - start[1])
            inside ^= spans & (places[:, 0] < crossing)
    return inside


def _distances_to_segments(places: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Distance of each place to the segment of the same number."""
    along = ends - starts
    share = np.clip(((places - starts) * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
    return np.linalg.norm(places - starts - share[:, None] * along, axis=1)
