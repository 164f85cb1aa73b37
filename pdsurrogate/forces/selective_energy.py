"""The selective energy of plane strain and of space: isochoric at the bonds, volumetric at the points (theory (48)-(52)).

At K = 1000 mu one bond after another would have to keep its volume, more conditions than a body has displacements: all of the energy at the
bonds locks.  A point's mean over its bonds is one condition a point.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ..body import Body
from ..kernels import selective_energy
from ..kernels.block_arrays import BLOCK, aligned_rows
from ..kernels.elementary import sum_in_order
from ..materials import PLANES
from .bond_energy import BondEnergyEvaluation
from .protocol import InvalidState


class SelectiveEnergyEvaluation(BondEnergyEvaluation):
    """The exact energy in plane strain or in space, E = sum of bond volumes times W(F_ij) + sum of V_i U(J_i), bound to a body.

    J_i is the mean of det F_ij over the bonds of a point, smoothed over its nearest neighbours.  The mean alone is exact in homogeneous
    states, but its pressure is rough; det F_i alone leaves a pressure that changes sign from point to point.
    """

    def _bind_energies(self) -> None:
        body, kinematics, chunks = self.body, self._kinematics, self._kinematics.chunks
        bonds, total, dimension = body.bonds, len(body.all_points), body.dimension
        first, second = bonds.ends_in_blocks(BLOCK)
        size = len(first)
        self._smoothing = smoothing(body, self.bond_weights > 0)
        self._pair_volumes, self._dilatations = np.ones(size), np.ones(len(body))
        # Ghosts' volumes lie beyond the body: they have no pressure, and no share.
        self._pressures = np.zeros(total)
        entries, starts = kinematics.pair_entries
        rows = np.zeros((2, size))
        rows[0, : self._n_pairs] = self.bond_shares[entries[starts[:-1]]]
        within = bonds.second < len(body)
        rows[1, : self._n_pairs][within] = self.bond_shares[entries[starts[1:] - 1]][within]
        self._end_shares = aligned_rows((size // BLOCK, 2, BLOCK))
        self._end_shares[:] = rows.reshape(2, -1, BLOCK).transpose(1, 0, 2)
        self._buffers = aligned_rows((chunks, selective_energy.buffer_rows(dimension), BLOCK), value=1)
        pairs = first, second, self.geometry
        self._energies = np.zeros(len(self.geometry))
        self._forces, self._moments = aligned_rows((size, dimension)), aligned_rows((size, dimension**2))
        places = kinematics.positions, kinematics.gradients
        self._find_volumes = selective_energy.pair_volumes[dimension].bind(
            *places, *pairs, self._buffers, self._pair_volumes, chunks=chunks
        )
        self._find_dilatations = selective_energy.mean_dilatations.bind(
            bonds.pointers, bonds.pair_of, self.bond_shares, self._pair_volumes, self._dilatations, chunks=chunks
        )
        self._response = PLANES[self.plane].isochoric_response.block(self.law)
        self._find_energies = selective_energy.pair_energies[dimension].bind(
            *places,
            self._pressures,
            *pairs,
            self._end_shares,
            self._response.address,
            kinematics.parameters,
            self._buffers,
            self._energies,
            self._forces,
            self._moments,
            chunks=chunks,
        )

    def pass_bonds(self, out: np.ndarray) -> tuple[list[int], int, int]:
        """Passes over pairs and points, and sums, with the deformation gradients last formed; see `BondEnergyEvaluation.pass_bonds`."""
        invalid, J = self._smoothed_dilatations()
        if invalid:
            return [0], invalid, 0
        with np.errstate(all="ignore"):  # what is not finite shows in the energy
            U, slope, _ = self.law.volumetric(J, self._kinematics.parameters)
        self._pressures[: len(self.body)] = self._spread(slope)
        self._find_energies()
        self._energy = float(sum_in_order(self._energies) + sum_in_order(self.body.volumes * U))
        return [0], 0, self._own_sums(out)

    def _smoothed_dilatations(self) -> tuple[int, np.ndarray]:
        """The number of pairs turned inside out, and the volume ratios of the points, with the gradients last formed."""
        invalid = self._find_volumes()
        self._find_dilatations()
        return invalid, self._smoothing @ self._dilatations

    def _spread(self, slopes: np.ndarray) -> np.ndarray:
        """What the bonds of the points feel of U' at their smoothed dilatations: the transpose of the smoothing."""
        return self._smoothing.T @ (self.body.volumes * slopes) / self.body.volumes

    def bulk_stresses(self) -> np.ndarray:
        return self._spread(super().bulk_stresses())

    def volume_ratios(self) -> np.ndarray:
        self._kinematics.form_gradients()
        invalid, J = self._smoothed_dilatations()
        if invalid:
            raise InvalidState(self._diagnose())
        return J


def smoothing(body: Body, carries: np.ndarray) -> sparse.csr_array:
    """Weights of neighbours in the smoothed dilatation of the points (theory (50)), shape (n, n).

    On a grid they are (1 2 1)/4 along each axis.  Rows add up to one, so that an even dilatation stays as it is; V_i W_ij is symmetric, so
    that its mean does as well, and an even pressure stays even.  Where points lie closer than on a grid, a point keeps what it keeps there,
    a quarter in the plane and an eighth in space.  What a neighbour beyond a surface would have stays with the point.  A
    mirror image is a neighbour; beyond a clamped plane the body is continued otherwise than it is, and nothing is taken from there.

    Parameters
    ----------
    body : Body
    carries : ndarray of bool, shape (n_pairs,)
        Which pairs carry anything: across a cut there are none.
    """
    bonds, ghosts, n = body.bonds, body.ghosts, len(body)
    first, second = bonds.first.astype(np.int64), bonds.second.astype(np.int64)
    offsets = np.abs(body.all_points[second] - body.all_points[first]) / body.cell
    mirrors = np.concatenate([np.ones(n, dtype=bool), (ghosts.parity == ghosts.reflection).all(axis=1)])
    near = carries & mirrors[second] & (offsets < 2).all(axis=1)
    first, second, within = first[near], second[near], second[near] < n
    weights = (0.5 - offsets[near] / 4).prod(axis=1) * body.volumes[first] * body.all_volumes[second] / body.cell.prod()
    second = np.concatenate([np.arange(n), ghosts.source.astype(np.int64)])[second]
    rows, columns = np.concatenate([first, second[within]]), np.concatenate([second, first[within]])
    weights = np.concatenate([weights, weights[within]])
    share = np.bincount(rows, weights, n) / body.volumes
    of_neighbours = 1 - 0.5**body.dimension
    most = of_neighbours / np.maximum(share, of_neighbours)
    weights *= np.minimum(most[rows], most[columns])
    own = body.volumes - np.bincount(rows, weights, n)
    each = np.arange(n)
    rows, columns = np.concatenate([rows, each]), np.concatenate([columns, each])
    return sparse.csr_array((np.concatenate([weights, own]) / body.volumes[rows], (rows, columns)), shape=(n, n))
