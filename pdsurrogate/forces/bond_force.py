"""Evaluation of the force models that map bond quantities to a bond force."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping

import numpy as np

from ..body import Body
from ..kernels import bond_force, reference_state
from ..kernels.analytic import analytic_bond_force
from ..kernels.block_arrays import BLOCK, aligned_rows
from ..kernels.sums import sum_pair_forces
from ..materials import PLANES, Law
from .evaluation import ModelEvaluation
from .kinematics import at_point, locate
from .plane_strain import in_plane_strain
from .protocol import EVERYWHERE, CompiledBondForce, Domain, ForceModel, InvalidState
from .settings import OUTSIDE_POLICIES, PRECISIONS, ROTATIONS, ForceSettings
from .surrogate_thickness import SurrogateThickness


class ForceSurrogate(ForceModel):
    """A force model that maps bond quantities to the force of the bond: a surrogate, or the exact map.

    Attributes
    ----------
    features : tuple of str
        What the model sees of a bond.
    domain : Domain or None
        Where it was trained; None if it holds everywhere.
    gives_transverse : bool
        Whether it knows T_mm, which the tensor correction needs.
    default_precision : str
    """

    features: tuple[str, ...]
    domain: Domain | None
    gives_transverse: bool
    default_precision: str

    @property
    def honours(self) -> Mapping[str, tuple]:
        corrections = tuple(name for name in reference_state.CORRECTIONS if self.gives_transverse or name != "tensor")
        # The pressure of plane strain is the trace of the stress, of which T_mm is a part.
        planes = tuple(PLANES) if self.gives_transverse else ("stress",)
        honours = {"precision": PRECISIONS, "correction": corrections, "rotation": tuple(ROTATIONS), "breakable": (True,), "plane": planes}
        return honours | ({} if self.domain is None else {"outside": tuple(OUTSIDE_POLICIES)})

    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> BondForceEvaluation:
        return BondForceEvaluation(self, body, law, settings)

    @abstractmethod
    def bond_force(self, stretch, rotation, length, C33, J) -> np.ndarray:
        """Dimensionless bond force, theory (9), in NumPy, for checking.

        Parameters
        ----------
        stretch : array_like, shape (n,)
            lambda_b.
        rotation : array_like, shape (n,)
            dtheta in radians: turn of the bond relative to its horizon, counter-clockwise.
        length : array_like, shape (n,)
            l_b/delta.
        C33 : array_like, shape (n,)
        J : array_like, shape (n,)
            det F in the plane.

        Returns
        -------
        ndarray, shape (n, 2)
            t_n and t_tau, along and across the deformed bond, times kappa/(w l mu).
        """

    @abstractmethod
    def compiled(self, dtype) -> CompiledBondForce:
        """The same for the bond pass, in the given precision."""


class BondForceEvaluation(ModelEvaluation):
    """A bond-force model bound to a body: node pass, bond pass over each pair once, and the sum to points."""

    def __init__(self, model: ForceSurrogate, body: Body, law: Law, settings: ForceSettings) -> None:
        correction = settings.correction or ("tensor" if model.gives_transverse else "scalar")
        super().__init__(model, body, law, correction, settings, "force", "bond force")
        bonds = body.bonds
        self._first, self._second = bonds.ends_in_blocks(BLOCK)
        blocks = len(self._first) // BLOCK
        compiled = model.compiled(self.precision)
        if self.plane == "strain" and not compiled.asks_law:
            compiled = in_plane_strain(compiled, law, self.precision)
        self._compiled = compiled
        self.geometry = aligned_rows((blocks, 5 if compiled.needs_length else 4, BLOCK), self.precision)
        length = np.linalg.norm(body.all_points[bonds.second] - body.all_points[bonds.first], axis=1)
        self._strength = 2 * body.weigh(length) * length * body.all_volumes[bonds.first] * body.all_volumes[bonds.second]
        self._find_geometry(np.arange(self._n_pairs, dtype=np.uint32))
        if not settings.breakable:
            self._strength = None
        if law.costly and model.domain is not None and model.gives_transverse and self.plane == "stress":
            self.learnt_thickness = True
            self._kinematics.surrogate_thickness = SurrogateThickness(compiled, model.domain, law, self.precision, self._kinematics.chunks)
        self._exact = analytic_bond_force(self.precision)
        self._guard = OUTSIDE_POLICIES[self.outside] if model.domain is not None else bond_force.UNGUARDED
        domain = EVERYWHERE if model.domain is None or self.outside == "extrapolate" else model.domain
        within = domain.interior if self.outside == "fallback" else domain
        self._domain = np.stack([domain.limits(self.precision), within.limits(self.precision)])
        chunks = self._kinematics.chunks
        self._buffers = aligned_rows((chunks, bond_force.BUFFER_ROWS, BLOCK), self.precision)
        self._work = aligned_rows((chunks, max(compiled.work_rows, 1), BLOCK), self.precision)
        self._forces = aligned_rows((len(self._first), 2), self.precision)
        self._find_forces = bond_force.pair_forces.bind(
            self._kinematics.positions,
            self._kinematics.records,
            self._first,
            self._second,
            self.geometry,
            compiled.address,
            compiled.sizes,
            compiled.weights,
            self._exact.address,
            self._kinematics.response.address,
            self._kinematics.parameters,
            self._guard,
            self._domain,
            self._buffers,
            self._work,
            self._kinematics.scratch,
            self._forces,
            chunks=chunks,
        )
        sums = self._forces, bonds.pair_pointers, bonds.incidence_pointers, bonds.incidence
        self._sum_forces = sum_pair_forces[2].bind(*sums, law.shear_modulus, np.empty_like(body.points), chunks=chunks)

    def evaluate(self, positions: np.ndarray, out: np.ndarray) -> None:
        self._kinematics.place(positions)
        self._kinematics.find_states()
        outside, without_force = self.pass_bonds(out)
        self._report_outside(outside)
        if without_force:
            raise InvalidState(self._diagnose(out))

    def _diagnose(self, out: np.ndarray) -> str:
        """Say which bond has no force."""
        broken = np.flatnonzero(~np.isfinite(self._forces[: self._n_pairs]).all(axis=1))
        if len(broken) == 0:
            return locate(self.body, out, "the force on it is not finite")
        i, j = int(self.body.bonds.first[broken[0]]), int(self.body.bonds.second[broken[0]])
        kinematics, points = self._kinematics, self.body.all_points
        stretch = np.linalg.norm(kinematics.positions[j] - kinematics.positions[i]) / np.linalg.norm(points[j] - points[i])
        J = kinematics.records[[i, j], 2].mean()
        x1, x2 = points[j]
        what = f"its bond to ({x1:.4g}, {x2:.4g}), stretched {stretch:.3g} times in a horizon of det F = {J:.3g}, has no finite force"
        return at_point(self.body, i, f"{what}: that is beyond the limit of {self.law.name}")

    def pass_bonds(self, out: np.ndarray) -> tuple[int, int]:
        """Bond pass and sum in the kinematic state last updated; the pairs outside the domain and the points without a force."""
        outside = self._find_forces()
        self._sum_forces.give("out", out)
        return outside, self._sum_forces()

    def _find_geometry(self, pairs: np.ndarray) -> None:
        body, bonds = self.body, self.body.bonds
        reference_state.pair_rows(
            pairs,
            bonds.first,
            bonds.second,
            body.all_points,
            self._strength,
            self._kinematics.inverse_shape,
            self._kinematics.supported,
            reference_state.CORRECTIONS[self.correction],
            body.kappa,
            body.horizon,
            self.geometry,
        )

    def take_out(self, pairs: np.ndarray) -> None:
        changed = self._kinematics.break_bonds(pairs)
        self._strength[pairs] = 0.0
        self._find_geometry(changed)

    def pair_forces(self) -> np.ndarray:
        return self.law.shear_modulus * self._forces[: self._n_pairs].astype(float)
