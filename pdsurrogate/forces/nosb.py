"""Analytic non-ordinary state-based force (2): the exact constitutive law, with zero-energy modes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ..body import Body
from ..kernels import nosb
from ..kernels.block_arrays import aligned_rows
from ..materials import PLANES, Law
from .evaluation import Evaluation
from .kinematics import locate
from .protocol import ForceModel, InvalidState
from .settings import ForceSettings


class NOSBForce(ForceModel):
    """NOSB PD: t_i = w P_i K_i^-1 x.  Exact in homogeneous deformation; blind to modes that leave F alone."""

    name = "nosb"
    # K^-1 needs no correction of incomplete horizons, and P no rotation.
    honours: ClassVar = {"precision": ("float64",), "correction": ("none",), "breakable": (True,), "plane": tuple(PLANES)}

    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> NOSBEvaluation:
        return NOSBEvaluation(body, law, settings)


class NOSBEvaluation(Evaluation):
    """NOSB bound to a body."""

    def __init__(self, body: Body, law: Law, settings: ForceSettings) -> None:
        super().__init__(body, law, "float64", "none", settings)
        kinematics, bonds = self._kinematics, body.bonds
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

    def evaluate(self, positions: np.ndarray, out: np.ndarray) -> None:
        self._kinematics.place(positions)
        self._kinematics.find_states()
        if self.pass_bonds(out):
            raise InvalidState(locate(self.body, out, "the force on it is not finite"))

    def pass_bonds(self, out: np.ndarray) -> int:
        """Stresses and bond pass in the kinematic state last updated; the number of points without a force."""
        self._weigh_stresses()
        self._sum_forces.give("out", out)
        return self._sum_forces()

    def take_out(self, pairs: np.ndarray) -> None:
        self._kinematics.break_bonds(pairs)
        self._broken[pairs] = True

    def pair_forces(self) -> np.ndarray:
        bonds, body = self.body.bonds, self.body
        bond = body.all_points[bonds.second] - body.all_points[bonds.first]
        factor = body.weigh(np.linalg.norm(bond, axis=1)) * body.all_volumes[bonds.first] * body.all_volumes[bonds.second]
        matrices = (self._stresses[bonds.first] + self._stresses[bonds.second]).reshape(-1, 2, 2)
        if self._broken is not None:
            factor[self._broken] = 0
        return factor[:, None] * np.einsum("bji,bj->bi", matrices, bond)
