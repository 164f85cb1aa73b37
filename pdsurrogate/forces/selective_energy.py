"""The selective energy of plane strain and of space: isochoric at the bonds, volumetric at the points (theory (48)-(52)).

At K = 1000 mu one bond after another would have to keep its volume, more conditions than a body has displacements: all of the energy at the
bonds locks.  A point's mean over its bonds is one condition a point.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from ..body import Body
from ..engine.block_arrays import BLOCK, aligned_rows
from ..engine.passes import BoundPass, Chain
from ..engine.threads import Chunks
from ..kernels import dilatation, selective_energy
from ..kernels.bond_energy import COLLAPSED
from ..kernels.elementary import sum_in_order
from ..materials import PLANES, Law
from ..materials.response import volume_energy_block
from .bond_energy import BondEnergyEvaluation
from .dilatation import LinearisedDilatation
from .kinematics import Kinematics
from .protocol import InvalidState

SLAB = 4_000_000
"""Pairs that are looked at together while a body is prepared, so that passing arrays stay small beside the body's own."""


@dataclass(frozen=True)
class IsochoricEnergy:
    """W and its stress for the pass over the pairs, as (p, q, r, energy) of `pdsurrogate.materials.response`, exact or learnt.

    Attributes
    ----------
    address : int
        Of the block function (`pdsurrogate.engine.compile.STRESS_RESPONSE`).
    parameters : ndarray
        What it reads.
    precision : {"float32", "float64"}
        Of states and results.
    outside : ndarray of int64, shape (1,)
        To which a learnt one adds the states that it finds outside its domain.
    """

    address: int
    parameters: np.ndarray
    precision: str = "float64"
    outside: np.ndarray = field(default_factory=lambda: np.zeros(1, dtype=np.int64))

    @classmethod
    def exact(cls, law: Law, plane: str) -> IsochoricEnergy:
        """Of a law itself."""
        return cls(PLANES[plane].isochoric_response.block(law).address, law.parameters)

    def evaluate(self, *state) -> np.ndarray:
        """The result at states given as three vectors of n numbers, shape (4, n); of points, whose states are not counted."""
        states, n = np.stack(state).astype(self.precision), len(state[0])
        found, counted = np.empty((selective_energy.RESULT_ROWS, n)), self.outside.copy()
        for at in range(0, n, BLOCK):
            size = min(BLOCK, n - at)
            # Filled up with the first, which is a state.
            rows = np.repeat(states[:, at : at + 1], BLOCK, axis=1)
            result = np.empty((selective_energy.RESULT_ROWS, BLOCK), self.precision)
            rows[:, :size] = states[:, at : at + size]
            selective_energy.evaluate_response(self.address, rows, self.parameters, result)
            found[:, at : at + size] = result[:, :size]
        self.outside[:] = counted
        return found


class SelectiveEnergyEvaluation(BondEnergyEvaluation):
    """The energy in plane strain or in space, E = sum of bond volumes times W(F_ij) + sum of V_i U(J_i), bound to a body.

    J_i is the mean of det F_ij over the bonds of a point, smoothed over its nearest neighbours.  The mean alone is exact in homogeneous
    states, but its pressure is rough; det F_i alone leaves a pressure that changes sign from point to point.

    Attributes
    ----------
    smoothing : Smoothing
    """

    nearly_incompressible = True
    # The volumes of the pairs are found from it.
    geometry_precision = "float64"

    def _bind_energies(self) -> None:
        body, kinematics, chunks = self.body, self._kinematics, self._kinematics.chunks
        bonds, n = body.bonds, len(body)
        first, second = bonds.ends_in_blocks(BLOCK)
        self.smoothing = Smoothing(body, self._carrying(), self.breakable)
        self._pair_volumes, self._dilatations, self._smoothed, self._slopes = np.ones(len(first)), np.ones(n), np.ones(n), np.zeros(n)
        # Ghosts' volumes lie beyond the body: they have no pressure, and no share.
        self._pressures = np.zeros(len(body.all_points))
        places = kinematics.positions, kinematics.gradients, self._pressures
        self._isochoric = self.model.isochoric_energy(self.law, self.plane, self.outside, self.precision)
        self._pairs = SelectivePairs(self._isochoric, kinematics, *places, first, second, self.geometry, self._pair_volumes)
        self._share_ends(np.arange(self._n_pairs))
        self._volume_energies = np.zeros(-(-n // BLOCK))
        self._forces, self._moments = self._pairs.forces, self._pairs.moments
        find_dilatations = selective_energy.means_over_bonds.bind(
            bonds.pointers, bonds.pair_of, self.bond_shares, self._pair_volumes, 1.0, self._dilatations, chunks=chunks
        )
        smooth = self.smoothing.bind(self._dilatations, self._smoothed, chunks)
        self._find_volumes = Chain(self._pairs.find_volumes, find_dilatations, smooth)
        self._smooth = smooth
        self._volumetric = volume_energy_block(self.law)
        find_volume_energies = selective_energy.volume_energies.bind(
            self._smoothed,
            body.share.counted(body.volumes),
            self._volumetric.address,
            kinematics.parameters,
            self._pairs.buffers,
            self._volume_energies,
            self._slopes,
            chunks=chunks,
        )
        # What the bonds of the points feel of U' is the transpose of the smoothing, and V_i W_ij is symmetric.
        spread_slopes = self.smoothing.bind(self._slopes, self._pressures, chunks)
        self._find_energies = Chain(find_volume_energies, spread_slopes, self._pairs.find_energies)
        self._find_pressures = Chain(find_volume_energies, spread_slopes)

    def pass_bonds(self, out: np.ndarray) -> tuple[list[int], int, int]:
        """Passes over pairs and points, and sums, with the deformation gradients last formed; see `BondEnergyEvaluation.pass_bonds`."""
        invalid = self._form_volumes()
        if self.body.share.any(invalid):
            return [0], invalid, 0
        if self.body.share.divided:
            self._find_pressures()
            self.body.share.fill(self._pressures[: len(self.body)])
            self._pairs.find_energies()
        else:
            self._find_energies()
        self._energy = self._pairs.energy + float(sum_in_order(self._volume_energies))
        return [self._pairs.count_outside()], 0, self._own_sums(out)

    def _form_volumes(self) -> int:
        """Bring the smoothed dilatations up to date with the gradients last formed; the number of pairs turned inside out."""
        invalid, *_ = self._find_volumes()
        share = self.body.share
        if share.divided:  # the points in the halo have the means of all their bonds, and then of all their neighbours, from elsewhere
            share.fill(self._dilatations)
            self._smooth()
            share.fill(self._smoothed)
        return invalid

    def linearised_dilatation(self) -> LinearisedDilatation:
        return LinearisedDilatation(self, self._kinematics, self.smoothing, self._smoothed, self._pairs)

    def bulk_stresses(self) -> np.ndarray:
        return self.smoothing.matrix() @ super().bulk_stresses()

    def volume_ratios(self) -> np.ndarray:
        self._kinematics.form_gradients()
        self.body.share.agree(InvalidState(self._diagnose()) if self._form_volumes() else None)
        return self._smoothed.copy()

    def stress_and_energy(self) -> tuple[np.ndarray, np.ndarray]:
        if self.model.domain is None:
            return super().stress_and_energy()
        F, plane = self.deformation_gradients(), PLANES[self.plane]
        found = self._isochoric.evaluate(*plane.isochoric_state(F))
        return plane.stress_and_energy(self.law, F, self.volume_ratios(), self.bulk_stresses(), found)

    def _isochoric_stretches(self) -> np.ndarray:
        """Three principal stretches of the points, over the cube root of their product, shape (n, 3)."""
        stretches = self.principal_stretches()
        J = stretches.prod(axis=1, keepdims=True)
        # In the plane the third one is held at 1.
        full = np.hstack([stretches, np.ones((len(J), 3 - self.body.dimension))])
        return full / np.cbrt(J)

    def domain_deviation(self) -> np.ndarray | None:
        return None if self.model.domain is None else self.model.domain.deviation(self._isochoric_stretches())

    def beyond_data(self) -> np.ndarray | None:
        if self.model.domain is None or self.model.domain.hull is None:
            return None
        counted = self.body.share.counted(np.ones(len(self.body))) > 0
        return self.model.domain.beyond_data(self._isochoric_stretches()[counted])

    def member_deviation(self) -> np.ndarray | None:
        if not self.model.members:
            return None
        from .members import point_deviations  # of which a run without a committee has no need

        return self.law.shear_modulus * point_deviations(self.model, self.law, self._isochoric_stretches())

    def collapsed_pairs(self) -> np.ndarray:
        volumes = self._pair_volumes[: self._n_pairs]
        return np.flatnonzero((self.bond_weights > 0) & ~(volumes > COLLAPSED))

    def renew_weights(self, pairs: np.ndarray) -> None:
        super().renew_weights(pairs)
        self._share_ends(pairs)
        self.smoothing.renew(self._carrying(), pairs)

    def _share_ends(self, pairs: np.ndarray) -> None:
        """Bring the shares that given pairs have of the volumes of their ends up to date."""
        self._pairs.share(pairs, self._kinematics, pairs, self.bond_shares)

    def _carrying(self) -> np.ndarray:
        """Which pairs carry anything; of one with a ghost, whose mirrored pair does as well: else V_i W_ij would not be symmetric."""
        carries = self.bond_weights > 0
        if self.breakable and len(self.body.ghosts):
            outer, mirrored = self._mirrored_pairs
            carries[outer] &= carries[mirrored]
        return carries


class SelectivePairs:
    """The passes of the selective energy over some pairs of a body, bound to their arrays.

    In single precision are, if they are to be, the energies of the pairs and what they exert.  Their volumes are not: a pressure is K/mu
    times the error of one.

    Parameters
    ----------
    isochoric : IsochoricEnergy
    kinematics : Kinematics
        Of the body.
    positions, gradients : ndarray, shapes (k, d) and (k, d d)
        Of the points and images that pairs are made of.
    pressures : ndarray, shape (k,)
        Of the same, in units of mu: what a share of a point's volume weighs the change of det F_ij with.
    first, second : ndarray of uint32
        Ends of the pairs, filled up to whole blocks.
    geometry : ndarray
        See `pair_geometry`.
    volumes : ndarray, shape (n_blocks * BLOCK,)
        For det F_ij.

    Attributes
    ----------
    forces, moments
        As those of `PairEnergies`, in the precision of the isochoric energy.
    buffers : ndarray
        Working memory in doubles.
    end_shares : ndarray, shape (n_blocks, 2, BLOCK)
        Of the volumes of both ends, see `share`.
    find_volumes, find_energies : BoundPass
        Of which the first returns the number of pairs turned inside out.
    """

    def __init__(
        self,
        isochoric: IsochoricEnergy,
        kinematics: Kinematics,
        positions: np.ndarray,
        gradients: np.ndarray,
        pressures: np.ndarray,
        first: np.ndarray,
        second: np.ndarray,
        geometry: np.ndarray,
        volumes: np.ndarray,
    ) -> None:
        dimension, chunks = positions.shape[1], kinematics.chunks
        self._isochoric = isochoric
        self.end_shares, self._energies = aligned_rows((len(geometry), 2, BLOCK)), np.zeros(len(geometry))
        self.buffers = aligned_rows((chunks.threads, selective_energy.buffer_rows(dimension), BLOCK), value=1)
        precision = isochoric.precision
        in_its_precision = self.buffers if precision == "float64" else aligned_rows(self.buffers.shape, precision, 1)
        self.forces = aligned_rows((len(first), dimension), precision)
        self.moments = aligned_rows((len(first), dimension**2), precision)
        places, pairs = (positions, gradients), (first, second, geometry)
        self.find_volumes = selective_energy.pair_volumes[dimension].bind(*places, *pairs, self.buffers, volumes, chunks=chunks)
        self.find_energies = selective_energy.pair_energies[dimension].bind(
            *places,
            pressures,
            *pairs,
            self.end_shares,
            isochoric.address,
            isochoric.parameters,
            in_its_precision,
            self._energies,
            self.forces,
            self.moments,
            chunks=chunks,
        )

    def count_outside(self) -> int:
        """Pairs that the energies last found outside the domain of a learnt energy; to be asked once after every evaluation."""
        outside = int(self._isochoric.outside[0])
        self._isochoric.outside[:] = 0
        return outside

    @property
    def energy(self) -> float:
        """Isochoric energy of the pairs as last found, over the shear modulus."""
        return float(sum_in_order(self._energies))

    def share(self, places: np.ndarray, kinematics: Kinematics, pairs: np.ndarray, bond_shares: np.ndarray) -> None:
        """Bring the shares of the volumes of both ends up to date; a ghost's volume has none.

        Parameters
        ----------
        places : ndarray of int
            Of pairs among these.
        kinematics : Kinematics
        pairs : ndarray of int
            The same pairs by their numbers in the body.
        bond_shares : ndarray, shape (n_bonds,)
            Volume of its point that every directed bond stands for.
        """
        entries, starts = kinematics.pair_entries
        self.end_shares[places // BLOCK, 0, places % BLOCK] = bond_shares[entries[starts[pairs]]]
        within = kinematics.body.bonds.second[pairs] < len(kinematics.body)
        places, pairs = places[within], pairs[within]
        self.end_shares[places // BLOCK, 1, places % BLOCK] = bond_shares[entries[starts[pairs + 1] - 1]]


class Smoothing:
    """Weights of neighbours in the smoothed dilatation of the points (theory (50)).

    On a grid they are (1 2 1)/4 along each axis.  Rows add up to one, so that an even dilatation stays as it is; V_i W_ij is symmetric, so
    that its mean does as well, and an even pressure stays even.  Where points lie closer than on a grid, a point keeps what it keeps there,
    a quarter in the plane and an eighth in space.  What a neighbour beyond a surface or a crack would have stays with the point.  A mirror
    image is a neighbour; beyond a clamped plane the body is continued otherwise than it is, and nothing is taken from there.

    Parameters
    ----------
    body : Body
    carries : ndarray of bool, shape (n_pairs,)
        Which pairs carry anything: across a cut there are none.
    breakable : bool
        Whether pairs may cease to, see `renew`.
    """

    def __init__(self, body: Body, carries: np.ndarray, breakable: bool = False) -> None:
        bonds, ghosts, n = body.bonds, body.ghosts, len(body)
        mirrors = np.concatenate([np.ones(n, dtype=bool), (ghosts.parity == ghosts.reflection).all(axis=1)])
        found = []
        for start in range(0, len(bonds.first), SLAB):
            part = slice(start, start + SLAB)
            first, second = bonds.first[part], bonds.second[part]
            offsets = np.abs(body.all_points[second] - body.all_points[first]) / body.cell
            near = carries[part] & mirrors[second] & (offsets < 2).all(axis=1)
            found.append((start + np.flatnonzero(near), (0.5 - offsets[near] / 4).prod(axis=1)))
        pairs, weights = (np.concatenate(parts) for parts in zip(*found, strict=True))
        first, second = bonds.first[pairs], bonds.second[pairs]
        weights *= body.volumes[first] * body.all_volumes[second] / body.cell.prod()
        within = second < n
        second = np.concatenate([np.arange(n, dtype=np.uint32), ghosts.source])[second]
        rows = np.concatenate([first, second[within]])
        order = np.argsort(rows, kind="stable")
        rows, self._columns = rows[order], np.concatenate([second, first[within]])[order]
        self._pointers = np.zeros(n + 1, dtype=np.uint64)
        self._pointers[1:] = np.cumsum(np.bincount(rows, minlength=n))
        self._volumes, self._most = body.volumes, 1 - 0.5**body.dimension
        raw = np.concatenate([weights, weights[within]])[order]
        self._share = body.share
        self._caps = self._cap(np.bincount(rows, raw, n) / body.volumes)
        self._share.fill(self._caps)
        self._weights = raw * np.minimum(self._caps[rows], self._caps[self._columns]) / body.volumes[rows]
        self._own = 1 - np.bincount(rows, self._weights, n)
        if breakable:
            self._ends = bonds.first, bonds.second
            self._raw, self._pairs = raw, np.concatenate([pairs, pairs[within]])[order].astype(np.uint32)

    def bind(self, values: np.ndarray, out: np.ndarray, chunks: Chunks) -> BoundPass:
        """The pass that smooths values at the points (n,) into the first n of another array."""
        return selective_energy.smooth.bind(self._pointers, self._columns, self._weights, self._own, values, out, chunks=chunks)

    def in_single_precision(self) -> SinglePrecisionSmoothing:
        """The same for what needs no more digits."""
        return SinglePrecisionSmoothing(self._pointers, self._columns, self._weights, self._own)

    def matrix(self) -> sparse.csr_array:
        """The weights, shape (n, n)."""
        n = len(self._own)
        neighbours = sparse.csr_array((self._weights, self._columns.astype(np.int64), self._pointers.astype(np.int64)), shape=(n, n))
        return neighbours + sparse.diags_array(self._own, format="csr")

    def renew(self, carries: np.ndarray, pairs: np.ndarray) -> None:
        """Bring the weights up to date after some of the given pairs have ceased to carry anything."""
        n = len(self._own)
        ends = np.concatenate([end[pairs] for end in self._ends])
        rows = np.unique(ends[ends < n]).astype(np.int64)
        owners, entries = self._entries(rows)
        self._raw[entries[~carries[self._pairs[entries]]]] = 0.0
        self._caps[rows] = self._cap(np.bincount(owners, self._raw[entries], n)[rows] / self._volumes[rows])
        self._share.fill(self._caps)
        rows = np.arange(n) if self._share.divided else np.unique(np.concatenate([rows, self._columns[entries]]))
        owners, entries = self._entries(rows)
        caps = np.minimum(self._caps[owners], self._caps[self._columns[entries]])
        self._weights[entries] = self._raw[entries] * caps / self._volumes[owners]
        self._own[rows] = 1 - np.bincount(owners, self._weights[entries], n)[rows]

    def _cap(self, shares: np.ndarray) -> np.ndarray:
        """By what the neighbours' shares of a point are multiplied, so that they have no more than on a grid."""
        return self._most / np.maximum(shares, self._most)

    def _entries(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Entries of given rows, and which row each is of."""
        starts = self._pointers[rows].astype(np.int64)
        counts = self._pointers[rows + 1].astype(np.int64) - starts
        return np.repeat(rows, counts), np.repeat(starts - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())


class SinglePrecisionSmoothing:
    """`Smoothing` of values in single precision, whose weights are half as long to read.

    Parameters
    ----------
    pointers, columns, weights, own : ndarray
        Of the smoothing, which may renew the last two.
    """

    def __init__(self, pointers: np.ndarray, columns: np.ndarray, weights: np.ndarray, own: np.ndarray) -> None:
        self._exact = weights, own
        self._matrix = pointers, columns, weights.astype(np.float32), own.astype(np.float32)

    def take(self) -> None:
        """Take the weights as they are now."""
        for single, exact in zip(self._matrix[2:], self._exact, strict=True):
            single[:] = exact

    def bind(self, values: np.ndarray, out: np.ndarray, chunks: Chunks) -> BoundPass:
        """See `Smoothing.bind`."""
        return selective_energy.smooth.bind(*self._matrix, values, out, chunks=chunks)

    def bind_sum(self, values: np.ndarray, factor: float, others, out: np.ndarray, chunks: Chunks) -> BoundPass:
        """The pass that writes a multiple of the smoothed values, plus three others (factor, values), of which `out` may be one."""
        (of_first, first), (of_second, second), (of_third, third) = others
        rest = factor, first, float(of_first), second, float(of_second), third, float(of_third)
        return dilatation.smooth_and_add.bind(*self._matrix, values, *rest, out, chunks=chunks)
