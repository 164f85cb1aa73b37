"""Bond-associated correspondence model, paper (11)-(15): the stable reference method of the
paper.
"""

from typing import ClassVar

import numpy as np
import scipy

from ..body.body import lengths_of
from ..body.bonds import pointers_to
from ..body.ghosts import WITH_ROUNDING, symmetric
from ..engine.block_arrays import BLOCK, SCRATCH_ROWS, aligned_rows
from ..engine.passes import Chain
from ..errors import InvalidState
from ..kernels import ba_nosb
from ..kernels.sums import sum_pair_forces
from ..materials import SHEETS
from .binding import Binding
from .errors import at_point, why_invalid
from .pair_balance import balanced_changes
from .protocol import ForceModel
from .term import MaterialTerm, StateArray, Term


class BondAssociatedStress(MaterialTerm):
    """Internal force of BA-NOSB: forces from the stresses of the bonds, each of which has a
    deformation gradient of its own.

    Attributes
    ----------
    bond_vectors : ndarray, shape (n_bonds, 2)
        Vector by which the stress of every directed bond is multiplied to give its force: first the
        bonds that start at points, then those that start at ghosts.
    bond_forces : ndarray, shape (n_bonds, 2)
        Force of every directed bond in the state last evaluated, divided by the shear modulus.
    """

    needs_gradients = False

    def __init__(self, binding: Binding) -> None:
        super().__init__(binding)
        material = self.points_of(0)
        body = self.body
        kinematics = self.kinematics
        bonds = body.bonds
        points = body.all_points
        volumes = body.all_volumes
        chunks = kinematics.chunks
        n = len(body)
        total = len(points)

        # Directed bonds by owner: a point's own, then those of images toward points of the body.
        order = np.argsort(bonds.second[kinematics.outer_pairs], kind="stable")
        from_image = kinematics.outer_pairs[order]
        self._owners = owners = np.concatenate([body.bond_owners, bonds.second[from_image]]).astype(
            np.uint32
        )
        self._targets = targets = np.concatenate([bonds.neighbors, bonds.first[from_image]])
        # Iterations at the bonds of images begin where those at the mirrored bonds ended, so that
        # bonds of points are all the state.
        self._mirrored = kinematics.bonds_of_pairs[0][kinematics.mirrored_pairs[order]]
        pair_of = np.concatenate([bonds.pair_of, from_image])
        self._forward, backward = np.argsort(pair_of, kind="stable").reshape(-1, 2).T
        self._reverse = np.empty(len(owners), dtype=np.uint32)
        self._reverse[self._forward], self._reverse[backward] = backward, self._forward
        bond_pointers = pointers_to(owners, total)

        # Tables: all points within the horizon; of an image, those that exist.
        near = scipy.spatial.cKDTree(points).query_ball_point(
            points[n:], body.horizon * WITH_ROUNDING
        )
        around_images = np.array(
            [[i, j] for i, others in enumerate(near, n) for j in others if j != i], dtype=np.int64
        ).reshape(-1, 2)
        if body.separates is not None:
            # The neighborhood of an image is that of its source, reflected.
            image, other = around_images.T
            flips = body.ghosts.reflection[image - n]
            source = points[body.ghosts.source[image - n]]
            ends = source + flips * (points[other] - points[image])
            around_images = around_images[~body.separates(source, ends)]
        self._table = np.concatenate([bonds.neighbors, around_images[:, 1].astype(np.uint32)])
        table_owners = np.concatenate([owners[: len(bonds.neighbors)], around_images[:, 0]])
        self._table_pointers = pointers_to(table_owners, total)
        bond = points[self._table] - points[table_owners]
        weights = body.weigh(lengths_of(bond))
        self._table_weights = np.ascontiguousarray(bond * (weights * volumes[self._table])[:, None])
        horizon_volumes = np.bincount(table_owners, volumes[self._table], total)
        # The horizon of an image extends beyond the existing images, so it has the volume of the
        # mirrored point's horizon.
        body.ghosts.fill(horizon_volumes)

        table = self._table_pointers, self._table
        self._common_pointers = np.zeros(len(owners) + 1, dtype=np.uint64)
        self._common = np.empty(0, dtype=np.uint16)
        for count in (True, False):
            common = count, self._common_pointers, self._common
            ba_nosb.list_common_points(
                points, *table, bond_pointers, targets, body.horizon, *common
            )
            if count:
                self._common = np.empty(int(self._common_pointers[-1]), dtype=np.uint16)
        direction = points[targets] - points[owners]
        self.bond_vectors = np.ascontiguousarray(
            direction * body.weigh(np.linalg.norm(direction, axis=1))[:, None]
        )
        self._inverse_shapes = np.empty((len(owners), 3))
        weighted = (*table, self._table_weights)
        shared = (self._common_pointers, self._common)
        shapes = self._inverse_shapes, self.bond_vectors
        ba_nosb.bond_references(
            points, volumes, weighted, (owners, targets), shared, horizon_volumes, *shapes
        )
        # Without loads on the boundary the model stays as it was published.
        if body.loaded and body.outward is not None:
            self._balance()
        self._volume_ratios = np.ones(len(owners))
        self.bond_forces = np.empty((len(owners), 2))
        self.state.append(
            StateArray("bond_volume_ratios", "bonds", self._volume_ratios[: len(bonds.neighbors)])
        )
        of_table = aligned_rows((chunks.threads, int(np.diff(self._table_pointers).max()), 4))
        of_bonds, scratch = (
            aligned_rows((chunks.threads, *shape), value=1)
            for shape in ((BLOCK, 4), (SCRATCH_ROWS + 4, BLOCK))
        )
        state = self._volume_ratios, material.response.address, material.parameters
        arrays = (
            kinematics.positions,
            weighted,
            (bond_pointers, *shared, *shapes),
            *state,
            (of_table, of_bonds, scratch),
            self.bond_forces,
        )
        # The force on a point is the sum of its bonds' forces minus those of the reverse bonds.
        sums = (
            self.bond_forces,
            bond_pointers,
            bond_pointers,
            self._reverse,
            material.law.shear_modulus,
            np.empty_like(body.points),
        )
        self._sum_forces = kinematics.bind(sum_pair_forces[2], *sums)
        self.in_units = [(0, self._sum_forces)]
        self._find_forces = Chain(
            kinematics.bind(ba_nosb.ba_nosb_forces, *arrays), self._sum_forces
        )

    def _balance(self) -> None:
        """Add to the vectors of both bonds of a pair, where they have stresses, equal parts of the
        change that balances the pair, theory (80b).
        """
        both = np.stack([self._forward, self._reverse[self._forward]])
        pairs, changes = balanced_changes(
            self.body, self.bond_vectors[both[0]] - self.bond_vectors[both[1]]
        )
        both = both[:, pairs]
        stressed = self._inverse_shapes[both, 0] != 0
        changes = changes[None] * (stressed / np.maximum(stressed.sum(axis=0), 1))[:, :, None]
        self.bond_vectors[both[0]] += changes[0]
        self.bond_vectors[both[1]] -= changes[1]

    def find(self, out: np.ndarray) -> None:
        unsolved, without_force = self.pass_bonds(out)
        if unsolved:
            self._volume_ratios[:] = 1.0
            raise InvalidState(self._without_state())
        if without_force:
            raise InvalidState(self.diagnose(out))

    def passes(self, out: np.ndarray) -> None:
        return None

    def pass_bonds(self, out: np.ndarray) -> list[int]:
        """Write the forces on the points to `out`; return the numbers of bonds without a stress
        and of points without a finite force.
        """
        self._sum_forces.give("out", out)
        self._volume_ratios[len(self.body.bonds.neighbors) :] = self._volume_ratios[self._mirrored]
        return self._find_forces()

    def _without_state(self) -> str:
        """Return an error message about a bond without a stress; the gradients of all bonds are
        recomputed for it.
        """
        body = self.body
        positions = self.kinematics.positions
        owners = self._owners
        bonds = np.repeat(np.arange(len(owners)), np.diff(self._common_pointers).astype(np.int64))
        entries = self._table_pointers[owners[bonds]].astype(np.int64) + self._common
        vectors = positions[self._table[entries]] - positions[owners[bonds]]
        F = np.zeros((len(owners), 2, 2))
        np.add.at(F, bonds, np.einsum("ci,cj->cij", vectors, self._table_weights[entries]))
        F = F @ symmetric(self._inverse_shapes)
        F[self._inverse_shapes[:, 0] == 0] = np.eye(2)
        bond, reason = why_invalid(
            F, " of the bond", "stress", lambda _: [self.binding.portions[0].law]
        )
        x1, x2 = body.all_points[self._targets[bond]]
        return at_point(
            body,
            int(self.kinematics.sources[owners[bond]]),
            f"its bond to ({x1:.4g}, {x2:.4g}) has no stress: {reason}",
        )

    def pair_forces(self, pairs: np.ndarray) -> np.ndarray:
        forward = self._forward[pairs]
        return self.binding.portions[0].law.shear_modulus * (
            self.bond_forces[forward] - self.bond_forces[self._reverse[forward]]
        )


class BANOSBForce(ForceModel):
    """Force model BA-NOSB (bond-associated correspondence peridynamics), without zero-energy modes.

    Every bond has a deformation gradient of its own, from the points in the horizons of both its
    ends.

    See Also
    --------
    pdsurrogate.forces.NOSBForce : one deformation gradient for each point.
    pdsurrogate.AnalyticBondForce : exact bond force of the same laws.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.forces.BANOSBForce().honored("stress")["precision"]
    ('float64',)
    """

    name = family = "ba-nosb"
    differentiable = False
    # Fracture is not supported: the shared horizons around every broken bond would have to be
    # recomputed.
    honors: ClassVar = {"precision": ("float64",), "correction": ("none",), "plane": SHEETS}

    def terms(self, plane: str) -> tuple[type[Term], ...]:
        return (BondAssociatedStress,)
