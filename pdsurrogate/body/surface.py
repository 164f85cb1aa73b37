"""The boundary of a body, where tractions and pressures act."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse


@dataclass(frozen=True)
class Surface:
    """The boundary of a body in the plane: straight facets between nodes that lie on the boundary itself.

    The outermost points of a body lie half a cell inside its boundary.  A node moves as they and their deformation gradient say:
    y_s = sum_j N_sj y_j, with rows of N that are 1 in sum and have X_s as their first moment, so that every affine motion is followed
    exactly, and a load on a node does its work at the boundary itself and keeps linear and angular momentum.

    Attributes
    ----------
    nodes : ndarray, shape (k, 2)
        Reference positions.
    facets : ndarray of int, shape (f, 2)
        First and second node of each facet, with the body on the left: the outward normal times the length is (t2, -t1) for t from the
        first to the second.
    parts : ndarray of str, shape (f,)
        Where each facet comes from: left, right, bottom, top, outline, holes.0, holes.1, ..., or the name of a mesh's physical group.
    interpolation : scipy.sparse.csr_array, shape (k, n)
        N.
    """

    nodes: np.ndarray
    facets: np.ndarray
    parts: np.ndarray
    interpolation: sparse.csr_array

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
