"""Shares of the points' volumes that bonds represent, and the sum of forces and moments of pairs
at the points.
"""

import numpy as np

from ..body.alike import pair_strength, stored_lists, vectors_between
from ..body.body import lengths_of
from ..body.bonds import pointers_to
from ..body.ghosts import symmetric
from ..engine.block_arrays import BLOCK, aligned_rows
from ..kernels.ghosts import fold_matrices, fold_vectors
from ..kernels.reference_state import bond_shares
from ..kernels.sums import add_node_forces, weigh_moments
from .kinematics import Kinematics, bonds_of_rows, entries_of, matrices
from .material_points import MaterialPoints
from .steps import Step


class BondShares:
    """Division of the points' volumes among their bonds, and sums of forces and moments of pairs at
    points and ghosts.

    The energy of a pair of points counts for the volume shares of both ends. In a pair with a ghost
    only the share of the point counts, since the ghost lies beyond the reflection plane. Forces and
    moments (derivatives of the energy by a deformation gradient) of a ghost are added to those of
    the point that it mirrors.

    Parameters
    ----------
    kinematics : Kinematics
    precision : str
        Precision of `Kinematics.weighted_bonds`.

    Attributes
    ----------
    bond_shares : ndarray, shape (k,)
        Shares of their point's volume that directed bonds represent, in the places of
        `Kinematics.starts`.
    strength : ndarray, shape (n_pairs,)
        `pdsurrogate.body.alike.pair_strength` of every pair; zero for broken pairs.
    """

    def __init__(self, kinematics: Kinematics, precision: str) -> None:
        self._kinematics = kinematics
        self._body = kinematics.body
        body = self._body
        bonds = self._body.bonds
        n = len(body)
        total = len(body.all_points)
        self.strength = np.concatenate([pair_strength(body, part) for part in bonds.slabs()])
        # Bonds of the ghosts, seen from them: the directed bonds that end in one, by image.
        toward = np.flatnonzero(bonds.neighbors >= n)
        self._ghost_bonds = toward[np.argsort(bonds.neighbors[toward], kind="stable")]
        neighbors = body.bond_owners[self._ghost_bonds].astype(np.uint32)
        # The precision is that of the points' own arrays: another one would make `add_node_forces`
        # compile a second time.
        weighted_bonds = aligned_rows((len(toward), body.dimension), precision)
        weights = kinematics.starts, kinematics.weighted_bonds
        self._of_points = bonds.pointers, bonds.neighbors, *weights, body.volumes
        pointers = pointers_to(bonds.neighbors[toward] - n, total - n)
        self._of_ghosts = (
            pointers,
            neighbors,
            pointers[:-1],
            weighted_bonds,
            body.all_volumes,
        )
        self._node_parts = np.zeros((total, body.dimension))
        self.bond_shares = np.zeros(len(kinematics.weighted_bonds))
        self._divide_volumes(stored_lists(bonds.pointers, kinematics.alike)[0])

    def renew(self, pairs: np.ndarray) -> np.ndarray:
        """Update `bond_shares` after a change of `pairs`; return all pairs whose weights
        (`weights_of`) may have changed.

        `pairs` must contain all pairs whose `strength`, or whose ends' flags
        `Kinematics.supported`, have changed.
        """
        body = self._body
        bonds = self._body.bonds
        n = len(self._body)
        touched = np.zeros(len(body.all_points), dtype=bool)
        affected = np.zeros(len(bonds.first), dtype=bool)
        touched[bonds.first[pairs]] = touched[bonds.second[pairs]] = True
        touched = np.flatnonzero(touched[:n]).astype(np.uint32)
        affected[bonds.pair_of[entries_of(bonds.pointers, touched)]] = True
        self._divide_volumes(touched)
        beside = body.share.beside_halo(bonds.first, bonds.second)
        return np.union1d(np.flatnonzero(affected), beside)

    def weights_of(
        self, pairs: np.ndarray | slice = slice(None), own: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the volumes for which the energies of pairs count, by default of all; zero for
        pairs that carry no force.

        They are the sums of the shares of both directed bonds of a pair, or of those flagged in
        `own`.
        """
        one, other = self._of_ends(pairs, own)
        return one + other

    def _of_ends(
        self, pairs: np.ndarray | slice, own: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the shares that pairs have of the volumes of their two ends, those of the directed
        bonds in `own` alone; zero at ghosts.
        """
        bonds = self._body.bonds
        first, second = bonds.first[pairs], bonds.second[pairs]
        within = second < len(self._body)
        owners = first, np.where(within, second, first)
        found = []
        for bonds_of_ends, of_ends in zip(self._kinematics.bonds_of_pairs, owners, strict=True):
            numbers = bonds_of_ends[pairs]
            shares = self.bond_shares[self._kinematics.places_of(numbers, of_ends)]
            found.append(shares * (1.0 if own is None else own[numbers]))
        one, other = found
        return one, np.where(within, other, 0.0)

    def _divide_volumes(self, rows: np.ndarray) -> None:
        """Divide the volumes of the points `rows` among their directed bonds, and weigh the bonds
        of ghosts.

        Bonds that an interface omits get no share, nor do those of a point that is not supported:
        it has no gradient, so that its bonds carry nothing.
        """
        kinematics = self._kinematics
        body = self._body
        bonds = self._body.bonds
        pointers, vectors = bonds_of_rows(body, rows)
        numbers = entries_of(bonds.pointers, rows)
        strength = self.strength[bonds.pair_of[numbers]]
        strength *= kinematics.supported[bonds.neighbors[numbers]]
        strength *= np.repeat(kinematics.supported[rows], np.diff(pointers).astype(np.int64))
        if kinematics.interfaces is not None:
            strength[np.isin(numbers, kinematics.interfaces.left_out)] = 0.0
        of_bonds = pointers, vectors, body.volumes, strength, body.horizon
        bond_shares[body.dimension](rows, *of_bonds, kinematics.starts[rows], self.bond_shares)
        if body.share.divided:
            body.bond_halo.fill(self.bond_shares)
        _, neighbors, _, weighted_bonds, volumes = self._of_ghosts
        ratio = volumes[neighbors] / volumes[bonds.neighbors[self._ghost_bonds]]
        places = kinematics.places_of(self._ghost_bonds, neighbors)
        weighted_bonds[:] = -kinematics.weighted_bonds[places] * ratio[:, None]

    def carrying(self, breakable: bool) -> np.ndarray:
        """Return flags of the pairs that carry forces.

        If bonds may break (`breakable`), a pair with a ghost is flagged only if its mirrored pair
        carries force too: the smoothing of volume ratios is then symmetric.
        """
        carries = self.weights_of() > 0
        if breakable and len(self._body.ghosts):
            carries[self._kinematics.outer_pairs] &= carries[self._kinematics.mirrored_pairs]
        return carries

    def geometry(
        self, points: MaterialPoints, own: np.ndarray | None, precision: str
    ) -> np.ndarray:
        """Return reference data of the pairs of a material in blocks, shape (k, d + 2 or d + 3,
        BLOCK), in the rows `MaterialPoints.rows`.

        They are the direction n of the undeformed pair, its inverse length 1/l, the volume for
        which its energy counts, that of the directed bonds in `own`, and in a body divided among
        ranks the part of that volume that this rank counts.
        """
        body = self._body
        d = self._body.dimension
        pairs, places = points.stored
        vectors = vectors_between(body, body.bonds.first[pairs], body.bonds.second[pairs])
        length = lengths_of(vectors)
        rows = d + (3 if body.share.divided else 2)
        blocks = len(np.unique(points.rows))
        geometry = aligned_rows((blocks, rows, BLOCK), precision)
        geometry[places // BLOCK, : d + 1, places % BLOCK] = np.column_stack(
            [vectors / length[:, None], 1 / length]
        )
        self.put_weights(geometry, places, pairs, self.weights_of(pairs, own))
        return geometry

    def put_weights(
        self, geometry: np.ndarray, places: np.ndarray, pairs: np.ndarray, weights: np.ndarray
    ) -> None:
        """Write the volumes `weights` for which the energies of given pairs of the body count into
        an array made by `geometry`.

        `places` are the positions of these pairs in the array.
        """
        body = self._body
        d = self._body.dimension
        geometry[places // BLOCK, d + 1, places % BLOCK] = weights
        if body.share.divided:
            geometry[places // BLOCK, d + 2, places % BLOCK] = (
                weights * body.share.own[body.bonds.first[pairs]]
            )

    def fill_end_shares(
        self,
        end_shares: np.ndarray,
        places: np.ndarray,
        pairs: np.ndarray,
        own: np.ndarray | None = None,
    ) -> None:
        """Write the shares that pairs have of the volumes of their two ends into `end_shares`
        (k, 2, BLOCK); zero at ghosts.

        Parameters
        ----------
        end_shares : ndarray
            Array that is changed in place.
        places, pairs : ndarray of int
            Numbers of the pairs in the array, see `geometry`, and in the body.
        own : ndarray of bool, shape (n_bonds,), optional
            Flags of the directed bonds whose shares count; by default all.
        """
        one, other = self._of_ends(pairs, own)
        end_shares[places // BLOCK, 0, places % BLOCK] = one
        end_shares[places // BLOCK, 1, places % BLOCK] = other

    def steps_to_points(
        self, moments: np.ndarray, forces: np.ndarray, folded: np.ndarray, *before: Step
    ) -> list[Step]:
        """Return the steps of an evaluation that turn moments of points into forces, and add forces
        on ghosts to the points they mirror.

        Parameters
        ----------
        moments : ndarray, shape (n + m, d d)
            Derivatives of the energy by the deformation gradients, by columns; overwritten by the
            steps.
        forces : ndarray, shape (n + m, d), or (n, d) without ghosts
            Forces to which the steps add.
        folded : ndarray, shape (m, d d)
            Receives the moments of the ghosts, before they are added to others.
        *before : Step
            Steps that compute the other forces, run after the moments of ghosts have been added to
            those of the points they mirror.
        """
        body = self._body
        ghosts = self._body.ghosts
        kinematics = self._kinematics
        d = body.dimension
        weigh = kinematics.bind(weigh_moments[d], moments, kinematics.inverse_shape, body.volumes)
        of_both = (self._of_points, 0), (self._of_ghosts, len(body))
        own, others = (
            kinematics.bind(add_node_forces[d], moments, *bonds, first, self._node_parts, forces)
            for bonds, first in of_both
        )
        for changed in kinematics.changed:
            before = *before, *changed.pull_steps(moments, forces)
        if not len(ghosts):
            return [moments, *before, weigh, own]
        of_ghosts = kinematics.gradient_ghosts.of_gradients
        fold = kinematics.bind(fold_matrices, moments, *of_ghosts, folded)
        fold_forces = kinematics.bind(fold_vectors, forces, ghosts.source, ghosts.parity)
        return [fold, moments, *before, weigh, own, others, fold_forces]

    def pulls(self, stresses: np.ndarray, owners: np.ndarray, changes: np.ndarray) -> np.ndarray:
        """Return the derivatives of the energy by the ends of bonds whose weights in gradients of
        their `owners` are changed, (k, d).

        `stresses` are those after `steps_to_points`: moments of the points, weighed by their
        shapes.
        """
        points, places = np.unique(owners, return_inverse=True)
        # A point without a gradient has no moments: any shape will do.
        lost = self._kinematics.supported[points, None, None] == 0
        shapes = np.where(
            lost, np.eye(self._body.dimension), symmetric(self._kinematics.inverse_shape[points])
        )
        moments = (
            matrices(stresses[points])
            @ np.linalg.inv(shapes)
            * self._body.volumes[points, None, None]
        )
        return np.einsum("bij,bj->bi", moments[places], changes)
