"""Analytic non-ordinary state-based force (2): the exact constitutive law, with zero-energy modes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from ..body import Body
from ..engine.block_arrays import aligned_rows
from ..kernels import nosb
from ..materials import PLANES, Law
from .evaluation import Evaluation
from .kinematics import at_point, locate, matrices
from .portions import EvaluationOfPortions, refuse_in_plane_strain
from .protocol import ForceModel, InvalidState, Portion
from .settings import ForceSettings


class NOSBForce(ForceModel):
    """NOSB PD: t_i = w P_i K_i^-1 x.  Exact in homogeneous deformation; blind to modes that leave F alone.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.NOSBForce()
    >>> model, model.family
    (<NOSBForce nosb>, 'nosb')
    """

    name = family = "nosb"
    # K^-1 needs no correction of incomplete horizons, and P no rotation.
    honours: ClassVar = {"precision": ("float64",), "correction": ("none",), "breakable": (True,), "plane": tuple(PLANES)}

    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> NOSBEvaluation:
        return NOSBEvaluation(body, law, settings)

    def evaluation_of_portions(self, body: Body, portions: Sequence[Portion], settings: ForceSettings) -> NOSBOfPortions:
        refuse_in_plane_strain(self.name, settings)
        return NOSBOfPortions(body, portions, settings)


class StressesAtPoints(Evaluation):
    """Forces from stresses of the points, whatever they come from."""

    zero_energy_modes = True

    def _prepare(self) -> None:
        kinematics, body, bonds = self._kinematics, self.body, self.body.bonds
        self._stresses = aligned_rows((len(body.all_points), body.dimension**2))
        sums = self._stresses, bonds.pointers, bonds.neighbours, kinematics.weighted_bonds, body.volumes
        self._sum_forces = nosb.nosb_forces[body.dimension].bind(*sums, np.empty_like(body.points), chunks=kinematics.chunks)
        self._broken: np.ndarray | None = None

    def evaluate(self, positions: np.ndarray, out: np.ndarray) -> None:
        self._kinematics.place(positions)
        self.find_states()
        if self.pass_bonds(out):
            raise InvalidState(self._diagnose(out))

    def pass_bonds(self, out: np.ndarray) -> int:
        """Stresses and bond pass in the states last found; the number of points without a force."""
        self._find_stresses()
        self._sum_forces.give("out", out)
        return self._sum_forces()

    def _diagnose(self, out: np.ndarray) -> str:
        """Say which point has no stress and why, or else where there is no force."""
        if self.plane != "stress":  # there the thickness is where a law ends, and is found before
            from ..materials import solid  # of which a sheet under plane stress has no need

            F = self.deformation_gradients()
            for law, points in self.laws:
                numbers = np.arange(len(F))[points]
                for i in numbers[np.argsort(-np.linalg.norm(F[points], axis=(1, 2)))][:100]:
                    reason = solid.why_no_energy(law, F[i])
                    if reason:
                        return at_point(self.body, int(i), f"{law.name}: it has no stress: {reason}")
        return locate(self.body, out, "the force on it is not finite")

    def find_states(self) -> None:
        """Bring gradients and the points' states up to date."""
        self._kinematics.find_states()

    def _find_stresses(self) -> None:
        """Bring P K^-1 of all points and images up to date."""
        raise NotImplementedError

    def pair_forces(self, pairs: np.ndarray | None = None) -> np.ndarray:
        bonds, body, chosen = self.body.bonds, self.body, slice(None) if pairs is None else pairs
        first, second = bonds.first[chosen], bonds.second[chosen]
        bond = body.all_points[second] - body.all_points[first]
        factor = body.weigh(np.linalg.norm(bond, axis=1)) * body.all_volumes[first] * body.all_volumes[second]
        stresses = matrices(self._stresses[first] + self._stresses[second])
        if self._broken is not None:
            factor[self._broken[chosen]] = 0
        return factor[:, None] * np.einsum("bij,bj->bi", stresses, bond)


class NOSBEvaluation(StressesAtPoints):
    """NOSB bound to a body."""

    def __init__(self, body: Body, law: Law, settings: ForceSettings) -> None:
        super().__init__(body, law, "float64", "none", settings)
        self._prepare()
        kinematics = self._kinematics
        self._find_stresses = nosb.weighted_stresses[body.dimension].bind(
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
        if settings.breakable:
            self._broken = np.zeros(len(body.bonds.first), dtype=bool)

    def take_out(self, pairs: np.ndarray) -> None:
        self._kinematics.break_bonds(pairs)
        self._broken[pairs] = True


class NOSBOfPortions(EvaluationOfPortions, StressesAtPoints):
    """NOSB on a body of several materials: the stress of every point, and of its images, is that of its own law."""

    def __init__(self, body: Body, portions: Sequence[Portion], settings: ForceSettings) -> None:
        super().__init__(body, portions, "float64", "none", settings)
        self._prepare()
        kinematics, self._parts = self._kinematics, []
        for portion in portions:
            states = self._add_states(np.empty(0, dtype=np.int64))
            numbers = states.view.numbers
            stresses = aligned_rows((len(numbers), 4))
            weigh = nosb.weighted_stresses[2].bind(
                states.view.gradients,
                states.volume_ratios,
                kinematics.inverse_shape[numbers],
                portion.law.shear_modulus,
                states.response.address,
                states.parameters,
                states.scratch,
                stresses,
                chunks=kinematics.chunks,
            )
            self._parts.append((weigh, numbers, stresses))

    def _find_stresses(self) -> None:
        for weigh, numbers, stresses in self._parts:
            weigh()
            self._stresses[numbers] = stresses
