"""A term that keeps a number for every bond: its state goes through checkpoints and into results, with no change outside the term."""

import numpy as np
from stopping import killed_with_levels

import pdsurrogate as pds
from pdsurrogate.forces.nosb import PointStress
from pdsurrogate.forces.term import Kept, Term
from pdsurrogate.run.simulate import simulate

STIFFNESS = 0.05
"""Stiffness of the springs over the shear modulus: a part of the force, so that its history decides the equilibrium."""


class SofteningSprings(Term):
    """Springs along the bonds, whose stiffness falls with the greatest stretch that a bond has had."""

    keeps = (Kept("greatest_stretch", "bonds", at_rest=1.0, shown=True),)
    needs_gradients = False

    def __init__(self, binding):
        super().__init__(binding)
        body, self._owners, self._neighbors = self.body, self.kinematics.body.bond_owners, self.body.bonds.neighbors.astype(np.int64)
        vectors = body.all_points[self._neighbors] - body.all_points[self._owners]
        self._length = np.linalg.norm(vectors, axis=1)
        self._weights = STIFFNESS * body.weigh(self._length) * body.all_volumes[self._owners] * body.all_volumes[self._neighbors]

    def find(self, out):
        self.pass_bonds(out)

    def pass_bonds(self, out):
        positions, greatest = self.kinematics.positions, self.kept["greatest_stretch"]
        between = positions[self._neighbors] - positions[self._owners]
        deformed = np.linalg.norm(between, axis=1)
        np.maximum(greatest, deformed / self._length, out=greatest)
        self._forces = (self._weights * (deformed - self._length) / greatest / deformed)[:, None] * between
        out[:] = np.stack([np.bincount(self._owners, self._forces[:, axis], len(out)) for axis in range(out.shape[1])], axis=1)

    def pair_forces(self, pairs):
        bonds = self.body.bonds
        forward = np.flatnonzero(self._owners == bonds.first[bonds.pair_of])
        found = np.empty((len(bonds.first), self.body.dimension))
        found[bonds.pair_of[forward]] = self._forces[forward]
        return found[pairs]


class SofteningForce(pds.forces.NOSBForce):
    """Correspondence with softening springs."""

    name = family = "softening"

    def terms(self, plane):
        return (PointStress, SofteningSprings)


def test_state_of_bonds_is_resumed_and_shown(tmp_path):
    scene = pds.load_scene("uniaxial", {"spacing": 0.25, "stretches": [1.2, 1.1], "solver.method": "relaxation"})
    whole = simulate(scene, SofteningForce())
    stretched, released = (fields["greatest_stretch"] for _, fields in whole.states)
    # The greatest stretch stays when the sheet is let back; an output of 1.2 has bonds along the pull that are stretched by as much.
    assert (released >= stretched).all()
    assert stretched.max() > 1.1
    with killed_with_levels(1):
        simulate(scene, SofteningForce(), folder=tmp_path)
    resumed = simulate(scene, SofteningForce(), folder=tmp_path, resume=True)
    np.testing.assert_array_equal(resumed.displacement(), whole.displacement())
    np.testing.assert_array_equal(resumed.field("greatest_stretch"), np.float32(whole.field("greatest_stretch")))
