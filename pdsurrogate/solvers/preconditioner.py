"""A stiffness matrix of the nearest bonds, factorised: what a quasi-Newton method starts from."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ..body import Body

REACH = 1.3
"""Bonds up to this many spacings make the matrix: four to a point on a grid, and those of points that lie off it.

With the diagonals the factor has four times the entries and takes four times as long, for a tenth fewer steps.
"""

SHEAR_SHARE = 1 / 3
"""Stiffness across a bond over that along it; the true tangent has both."""

SHIFT = 1e-6
"""Share of the mean diagonal added to it, so that bodies free to drift have a factor too."""


class NearestBondStiffness:
    """The stiffness of a network of springs along and across the nearest bonds, scaled to the body's small-strain stiffness.

    Its low modes are those of the true tangent within a factor that does not grow with the number of points, and its
    factor takes seconds for 10^5 points.

    Parameters
    ----------
    body : Body
    shear_moduli : float or ndarray, shape (n,)
        Of all points, or about each.
    free : ndarray, shape (n, 2)
        1 where a component may move; held ones get the identity.
    """

    def __init__(self, body: Body, shear_moduli: float | np.ndarray, free: np.ndarray) -> None:
        n, ghosts = len(body), body.ghosts
        first, second, blocks = _springs(body, shear_moduli)
        within = second < n
        # A ghost moves with the point behind it, each component with its parity.
        mirrored, parity = second.copy(), np.ones((len(second), 2))
        mirrored[~within] = ghosts.source[second[~within] - n]
        parity[~within] = ghosts.parity[second[~within] - n]
        self._degrees = 2 * n
        rows, columns, values = [], [], []
        for i in range(2):
            for j in range(2):
                block = blocks[:, i, j]
                rows += [2 * first + i, 2 * first + i]
                columns += [2 * first + j, 2 * mirrored + j]
                values += [block, -block * parity[:, j]]
                # The second end of a bond within the body; a ghost's force is not one of the unknowns.
                rows += [2 * second[within] + i, 2 * second[within] + i]
                columns += [2 * second[within] + j, 2 * first[within] + j]
                values += [block[within], -block[within]]
        shape = (self._degrees, self._degrees)
        matrix = sparse.coo_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape).tocsc()
        matrix = (matrix + matrix.T) / 2
        self._free = free.ravel()
        keep = sparse.diags_array(self._free)
        mean = matrix.diagonal().mean()
        diagonal = SHIFT * mean * self._free + mean * (1 - self._free)
        matrix = (keep @ matrix @ keep + sparse.diags_array(diagonal)).tocsc()
        self._factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        # Rigid translations that nothing holds: a uniform force has no place in equilibrium, and is left out rather
        # than divided by the shift.
        held = (ghosts.parity < 0).any(axis=0)
        self._drifting = [axis for axis in range(2) if not held[axis] and free[:, axis].all()]

    def solve(self, forces: np.ndarray) -> np.ndarray:
        """Displacements under forces, shape (n, 2)."""
        displacements = self._factor.solve(forces.ravel() * self._free).reshape(forces.shape)
        for axis in self._drifting:
            displacements[:, axis] -= displacements[:, axis].mean()
        return displacements

    def response(
        self, body: Body, shear_moduli: float | np.ndarray, held: np.ndarray, planes: np.ndarray, turns: np.ndarray | None = None
    ) -> np.ndarray:
        """Displacements of the body, shape (n, 2), where held components and planes of reflection are displaced.

        Parameters
        ----------
        body : Body
        shear_moduli : float or ndarray, shape (n,)
            Both as given when the stiffness was made.
        held : ndarray, shape (n, 2)
            Displacements in held components, 0 in free ones.
        planes : ndarray, shape (planes, 2)
            Displacements of the planes.
        turns : ndarray, shape (planes, 2, 2), optional
            Of planes that turn too, see `pdsurrogate.body.Ghosts.shifts`.
        """
        n, ghosts = len(body), body.ghosts
        first, second, blocks = _springs(body, shear_moduli)
        moved = np.vstack([held, held[ghosts.source] * ghosts.parity + ghosts.moved_by_planes(body.points, planes, turns)])
        pulls, within = np.einsum("bij,bj->bi", blocks, moved[second] - moved[first]), second < n
        forces = np.stack(
            [np.bincount(first, pulls[:, axis], n) - np.bincount(second[within], pulls[within, axis], n) for axis in (0, 1)], axis=1
        )
        return self.solve(forces) + held


def _springs(body: Body, shear_moduli: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends of the nearest bonds and the stiffness of each, shape (k, 2, 2); `second` may be a ghost."""
    bonds, points = body.bonds, body.all_points
    vector = points[bonds.second] - points[bonds.first]
    length = np.linalg.norm(vector, axis=1)
    volumes = body.all_volumes[bonds.first] * body.all_volumes[bonds.second]
    if isinstance(shear_moduli, np.ndarray):
        ends = np.concatenate([shear_moduli, shear_moduli[body.ghosts.source]])
        shear_moduli = (ends[bonds.first] + ends[bonds.second]) / 2
    stiffness = 6 * shear_moduli * body.weigh(length) * volumes / body.kappa
    near = length <= REACH * body.spacing
    if not near.any():
        near[:] = True
    moment = stiffness * length**2
    stiffness, along = stiffness[near] * moment.sum() / moment[near].sum(), vector[near] / length[near, None]
    first, second = bonds.first[near].astype(np.int64), bonds.second[near].astype(np.int64)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    blocks = np.einsum("b,bi,bj->bij", stiffness, along, along) + SHEAR_SHARE * np.einsum("b,bi,bj->bij", stiffness, across, across)
    return first, second, blocks
