"""Springs with history: a term of a force that keeps a number for every bond, for tests."""

from typing import ClassVar

import numpy as np

import pdsurrogate as pds
from pdsurrogate.forces.pair_energy import PairEnergy
from pdsurrogate.forces.term import Kept, Term

STIFFNESS = 0.05
"""Stiffness of the springs over the shear modulus: a part of the force, so that its history
decides the equilibrium.
"""


class SofteningSprings(Term):
    """Springs along the bonds, whose stiffness falls with the greatest stretch that a bond has
    had in an accepted state or has now.
    """

    keeps = (Kept("greatest_stretch", "bonds", at_rest=1.0, shown=True),)
    needs_gradients = False
    latest: ClassVar = None
    """Term of the force that was bound last."""

    def __init__(self, binding):
        super().__init__(binding)
        body, self.owners, self.neighbors = (
            self.body,
            self.kinematics.body.bond_owners,
            self.body.bonds.neighbors.astype(np.int64),
        )
        self._vectors = body.all_points[self.neighbors] - body.all_points[self.owners]
        self.length = np.linalg.norm(self._vectors, axis=1)
        modulus = STIFFNESS * binding.portions[0].law.shear_modulus
        self._weights = (
            modulus
            * body.weigh(self.length)
            * body.all_volumes[self.owners]
            * body.all_volumes[self.neighbors]
        )
        self.accepted, self.tried, self.most = [], 0.0, np.zeros(len(self.length))
        type(self).latest = self

    def _stretched(self):
        between = self.kinematics.positions[self.neighbors] - self.kinematics.positions[self.owners]
        deformed = np.linalg.norm(between, axis=1)
        return between, deformed, np.maximum(self.kept["greatest_stretch"], deformed / self.length)

    def accept(self, elapsed):
        self.accepted.append(
            (elapsed, self.kinematics.positions.copy(), self.kept["greatest_stretch"].copy())
        )
        self.kept["greatest_stretch"][:] = self._stretched()[2]

    def find(self, out):
        self.pass_bonds(out)

    def pass_bonds(self, out):
        between, deformed, greatest = self._stretched()
        self.tried = (deformed / self.length).max()
        np.maximum(self.most, deformed / self.length, out=self.most)
        self._forces = (self._weights * (deformed - self.length) / greatest / deformed)[
            :, None
        ] * between
        out[:] = np.stack(
            [
                np.bincount(self.owners, self._forces[:, axis], len(out))
                for axis in range(out.shape[1])
            ],
            axis=1,
        )

    def pair_forces(self, pairs):
        bonds = self.body.bonds
        forward = np.flatnonzero(self.owners == bonds.first[bonds.pair_of])
        found = np.empty((len(bonds.first), self.body.dimension))
        found[bonds.pair_of[forward]] = self._forces[forward]
        return found[pairs]

    def stress_and_energy(self):
        body, products = self.body, self._forces[:, :, None] * self._vectors[:, None] / 2
        stress, energy = np.zeros((len(body), 3, 3)), np.zeros(len(body))
        np.add.at(stress[:, :2, :2], self.owners, products)
        np.add.at(
            energy,
            self.owners,
            self._weights * (np.linalg.norm(self._forces, axis=1) / self._weights) ** 2 / 4,
        )
        return stress / body.volumes[:, None, None], energy / body.volumes

    def break_bonds(self, pairs, changed):
        self._weights[np.isin(self.body.bonds.pair_of, pairs)] = 1e-300


class SofteningForce(pds.BondEnergyForce):
    """Bond energy with softening springs."""

    name = family = "softening"

    def terms(self, plane):
        return (PairEnergy, SofteningSprings)


def softened(**changes):
    """Displacements and greatest stretches of a sheet that is pulled and let back."""
    scene = pds.load_scene(
        "uniaxial",
        {"spacing": 0.25, "stretches": [1.2, 1.1], "solver.method": "relaxation", **changes},
    )
    result = pds.simulate(scene, SofteningForce())
    return result and {
        "displacement": result.displacement(),
        "greatest_stretch": result.field("greatest_stretch"),
    }
