"""Analytic non-ordinary state-based force (2): the exact constitutive law, with zero-energy modes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..body import Body
from ..kernels import nosb
from ..kernels.block_arrays import aligned_rows
from ..materials import Law
from .kinematics import Kinematics, locate
from .model import BindableForce
from .protocol import InvalidState
from .settings import ForceSettings


class NOSBForce(BindableForce):
    """NOSB PD: t_i = w P_i K_i^-1 x.  Exact in homogeneous deformation; blind to modes that leave F alone."""

    name = "nosb"
    # K^-1 needs no correction of incomplete horizons, and P no rotation.
    honours: ClassVar = {"precision": ("float64",), "correction": ("none",), "breakable": (True,)}

    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> NOSBEvaluation:
        """The evaluation on a body."""
        return NOSBEvaluation(body, law, settings)


class NOSBEvaluation:
    """NOSB bound to a body."""

    precision = "float64"
    correction = "none"
    fraction_outside = 0.0

    def __init__(self, body: Body, law: Law, settings: ForceSettings) -> None:
        self.body, self.law = body, law
        self.evaluations = 0
        self.kinematics = Kinematics(body, law, "float64", breakable=settings.breakable)
        kinematics, bonds = self.kinematics, body.bonds
        self._stresses = aligned_rows((len(body.all_points), 4))
        self._weigh_stresses = nosb.weighted_stresses[2].bind(
            kinematics.gradients,
            kinematics.volume_ratios,
            kinematics.inverse_shape,
            law.shear_modulus,
            kinematics.response.address,
            kinematics.parameters,
            kinematics.scratch,
            self._stresses,
            chunks=kinematics.chunks,
        )
        sums = self._stresses, bonds.pointers, bonds.neighbours, kinematics.weighted_bonds, body.volumes
        self._sum_forces = nosb.nosb_forces[2].bind(*sums, np.empty_like(body.points), chunks=kinematics.chunks)
        self._broken = np.zeros(len(body.bonds.first), dtype=bool) if settings.breakable else None

    def __call__(self, positions: np.ndarray, out: np.ndarray) -> None:
        self.evaluations += 1
        self.kinematics.update(positions)
        if self.pass_bonds(out):
            raise InvalidState(locate(self.body, out, "the force on it is not finite"))

    def pass_bonds(self, out: np.ndarray) -> int:
        """Stresses and bond pass in the kinematic state last updated; the number of points without a force."""
        self._weigh_stresses()
        self._sum_forces.give("out", out)
        return self._sum_forces()

    def break_bonds(self, pairs: np.ndarray) -> None:
        """Take pairs out of the horizons, and with them out of the forces."""
        self.kinematics.break_bonds(pairs)
        self._broken[pairs] = True

    def state_arrays(self) -> dict[str, np.ndarray]:
        """See `InternalForce`."""
        return self.kinematics.state_arrays()

    def move_plane(self, plane: int, displacement) -> None:
        """Displace a reflection plane of the body."""
        self.kinematics.move_plane(plane, displacement)

    def pair_forces(self) -> np.ndarray:
        """Force on the first point of every pair in the state last evaluated, shape (n_pairs, 2)."""
        bonds, body = self.body.bonds, self.body
        bond = body.all_points[bonds.second] - body.all_points[bonds.first]
        factor = body.weigh(np.linalg.norm(bond, axis=1)) * body.all_volumes[bonds.first] * body.all_volumes[bonds.second]
        matrices = (self._stresses[bonds.first] + self._stresses[bonds.second]).reshape(-1, 2, 2)
        if self._broken is not None:
            factor[self._broken] = 0
        return factor[:, None] * np.einsum("bji,bj->bi", matrices, bond)
