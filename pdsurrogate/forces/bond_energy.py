"""The bond-level energy and the forces that are its gradient (theory (27)-(31), volumes shared out by `reference_state.bond_shares`)."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..body import Body
from ..kernels import bond_energy
from ..kernels.block_arrays import BLOCK, aligned_rows
from ..kernels.bond_force import FALL_BACK, UNGUARDED
from ..kernels.elementary import sum_in_order
from ..kernels.energy_density import analytic_energy_density
from ..kernels.reference_state import bond_shares
from ..kernels.sums import point_forces, sum_moments, weigh_moments
from ..materials import PLANES, Law, plane_stress
from .energy_density import EnergyDerivatives, blended, domain_constants
from .evaluation import ModelEvaluation
from .kinematics import at_point, locate
from .protocol import CompiledBondForce, Domain, ForceModel, InvalidState, Release
from .settings import OUTSIDE_POLICIES, PRECISIONS, ForceSettings

if TYPE_CHECKING:
    from .tangent import Tangent


class EnergySurrogate(ForceModel):
    """A force model that maps the invariants of a bond's deformation gradient to its energy: a surrogate, or the exact energy.

    Attributes
    ----------
    domain : Domain or None
        Where it was trained, as bounds of the principal stretches; None if it holds everywhere.
    default_precision : str
    """

    domain: Domain | None
    default_precision: str

    @property
    def honours(self) -> Mapping[str, tuple]:
        # It is exact on incomplete horizons, and its invariants know no rotation.  What is learnt is the energy of a sheet.
        honours = {"precision": PRECISIONS, "correction": ("none",), "breakable": (True,), "plane": ("stress",)}
        return honours | ({} if self.domain is None else {"outside": tuple(OUTSIDE_POLICIES)})

    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> BondEnergyEvaluation:
        return BondEnergyEvaluation(self, body, law, settings)

    @abstractmethod
    def energy_derivatives(self, law: Law, trace, area_ratio) -> EnergyDerivatives:
        """Energy and derivatives in NumPy, for checking and for the tangent."""

    @abstractmethod
    def compiled(self, dtype) -> CompiledBondForce:
        """Energy and first derivatives for the pass over the pairs (`pdsurrogate.kernels.energy_density`)."""


class BondEnergyForce(EnergySurrogate):
    """The exact energy of any law.

    Under plane stress it is that of the bonds, C33 solved in every evaluation.  In plane strain the isochoric part is taken at the bonds
    and the volumetric one at the points, which does not lock (`pdsurrogate.forces.selective_energy`).
    """

    name = "bond-energy"
    domain = None
    default_precision = "float64"

    @property
    def honours(self) -> Mapping[str, tuple]:
        return {**super().honours, "plane": tuple(PLANES)}

    def honoured(self, plane: str) -> Mapping[str, tuple]:
        if plane == "stress":
            return self.honours
        return {key: values for key, values in self.honours.items() if key != "breakable"} | {"precision": ("float64",)}

    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> BondEnergyEvaluation:
        if settings.plane == "stress":
            return BondEnergyEvaluation(self, body, law, settings)
        from .selective_energy import SelectiveEnergyEvaluation  # which stands on this module

        return SelectiveEnergyEvaluation(self, body, law, settings)

    def energy_derivatives(self, law: Law, trace, area_ratio) -> EnergyDerivatives:
        return EnergyDerivatives(*plane_stress.energy_derivatives(law, trace, area_ratio))

    def compiled(self, dtype) -> CompiledBondForce:
        """Block function of the exact energy, whose law the pass supplies."""
        return CompiledBondForce(analytic_energy_density(dtype).address, np.zeros(1, dtype=np.int64), np.zeros(1, dtype=dtype), 0)


class PlainBondEnergyForce(BondEnergyForce):
    """All of the energy at the bonds in plane strain too, where it locks: to be compared with `BondEnergyForce`."""

    name = "bond-energy-plain"

    def honoured(self, plane: str) -> Mapping[str, tuple]:
        return self.honours

    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> BondEnergyEvaluation:
        return BondEnergyEvaluation(self, body, law, settings)


class BondEnergyEvaluation(ModelEvaluation):
    """An energy bound to a body: gradient pass, a pass over each pair once, and the sums to points.

    The energy is that of the body's own points: of a pair with a ghost, the point's share counts and the ghost's, which lies beyond the
    grip, does not.  Ghosts are functions of the points they mirror, so what the energy says about a ghost is handed on to that point.

    Attributes
    ----------
    bond_shares : ndarray, shape (n_bonds,)
        Volume of its point that every directed bond stands for.
    bond_weights : ndarray, shape (n_pairs,)
        Volume bond_volume that the energy of every pair counts for; zero of those that carry nothing.
    """

    has_energy = True

    def __init__(self, model: EnergySurrogate, body: Body, law: Law, settings: ForceSettings) -> None:
        super().__init__(model, body, law, "none", settings, "energy", "energy")
        bonds, n, total = body.bonds, len(body), len(body.all_points)
        self._first, self._second = bonds.ends_in_blocks(BLOCK)
        size = len(self._first)
        blocks = size // BLOCK
        vectors = body.all_points[bonds.second] - body.all_points[bonds.first]
        length = np.linalg.norm(vectors, axis=1)
        self._strength = body.weigh(length) * body.all_volumes[bonds.first] * body.all_volumes[bonds.second]
        self._intact = np.ones(self._n_pairs, dtype=bool)
        self.bond_weights = np.zeros(self._n_pairs)
        self.geometry = aligned_rows((blocks, 4, BLOCK), self.precision)
        rows = np.zeros((4, size))
        rows[:3, : self._n_pairs] = vectors[:, 0] / length, vectors[:, 1] / length, 1 / length
        self.geometry[:] = rows.reshape(4, blocks, BLOCK).transpose(1, 0, 2)

        # Pairs in which a point or a ghost comes second; ghosts are first in none.
        incidence = np.argsort(bonds.second, kind="stable").astype(np.uint32)
        self._incidence = incidence
        self._incidence_pointers = np.zeros(total + 1, dtype=np.uint64)
        self._incidence_pointers[1:] = np.cumsum(np.bincount(bonds.second, minlength=total))
        self._pair_pointers = np.full(total + 1, bonds.pair_pointers[-1])
        self._pair_pointers[: n + 1] = bonds.pair_pointers
        # Bonds of the ghosts, seen from them: the directed bonds that end in one, by image.
        towards = np.flatnonzero(bonds.neighbours >= n)
        self._ghost_bonds = towards[np.argsort(bonds.neighbours[towards], kind="stable")]
        owners = np.repeat(np.arange(n, dtype=np.uint32), np.diff(bonds.pointers).astype(np.int64))
        self._ghost_neighbours = owners[self._ghost_bonds]
        self._ghost_pointers = np.zeros(total - n + 1, dtype=np.uint64)
        self._ghost_pointers[1:] = np.cumsum(np.bincount(bonds.neighbours[towards] - n, minlength=total - n))
        # In the precision of the points' own: another would have `point_forces` compiled a second time.
        self._ghost_weighted_bonds = aligned_rows((len(towards), 2), self.precision)
        self._counted, self.bond_shares = np.zeros(self._n_pairs), np.zeros(len(bonds.neighbours))
        self._weigh_pairs(np.arange(self._n_pairs))

        self._energy, self._collapsed = 0.0, 0
        self._energies = np.zeros(blocks)
        self._forces = aligned_rows((size, 2), self.precision)
        self._moments = aligned_rows((size, 4), self.precision)
        self._stresses = aligned_rows((total, 4))
        self._node_parts, self._all_forces = np.zeros((total, 2)), np.zeros((total, 2))
        self._bind_energies()
        self._own_sums = self.sums_of(self._forces, self._moments)

    def _bind_energies(self) -> None:
        """Bind the pass over the pairs to its arrays."""
        compiled = self.model.compiled(self.precision)
        self._compiled = compiled
        self._exact = analytic_energy_density(self.precision)
        domain = self.model.domain
        self._guard = {"fallback": FALL_BACK, "extrapolate": UNGUARDED}.get(self.outside, bond_energy.COUNTED) if domain else UNGUARDED
        self._domain = domain_constants(domain, self.precision) if domain else np.zeros(bond_energy.DOMAIN_SIZE, self.precision)
        chunks = self._kinematics.chunks
        self._buffers = aligned_rows((chunks, bond_energy.BUFFER_ROWS, BLOCK), self.precision)
        self._sums = aligned_rows((chunks, 4, BLOCK))
        self._work = aligned_rows((chunks, max(compiled.work_rows, 1), BLOCK), self.precision)
        self._counts = np.zeros((chunks, 3), dtype=np.int64)
        self._find_energies = bond_energy.pair_energies.bind(
            self._kinematics.positions,
            self._kinematics.gradients,
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
            self._sums,
            self._work,
            self._kinematics.scratch,
            self._counts,
            self._energies,
            self._forces,
            self._moments,
            chunks=chunks,
        )

    def evaluate(self, positions: np.ndarray, out: np.ndarray) -> None:
        self._kinematics.place(positions)
        self._kinematics.form_gradients()
        outside, invalid, without_force = self.pass_bonds(out)
        self._report_outside(outside)
        if invalid or not np.isfinite(self._energy):
            raise InvalidState(self._diagnose())
        if without_force:
            raise InvalidState(locate(self.body, out, "the force on it is not finite"))

    def pass_bonds(self, out: np.ndarray) -> tuple[int, int, int]:
        """Pass over the pairs and sums, with the deformation gradients last formed.

        Returns the number of pairs outside the domain, of those turned inside out, and of points without a force.
        """
        self._find_energies()
        self._energy = float(sum_in_order(self._energies))
        outside, self._collapsed, invalid = self._counts.sum(axis=0).tolist()
        return outside, invalid, self._own_sums(out)

    def sums_of(self, forces: np.ndarray, moments: np.ndarray) -> Callable[[np.ndarray], int]:
        """What sums forces and moments of the pairs to the body's points, bound to these arrays.

        What falls to a ghost goes to the point behind it.  Called with the array to write to, it returns the number of points and ghosts
        without a force.
        """
        body, bonds, ghosts, kinematics = self.body, self.body.bonds, self.body.ghosts, self._kinematics
        n, chunks = len(body), kinematics.chunks
        pairs = self._pair_pointers, self._incidence_pointers, self._incidence
        gather = sum_moments[2].bind(moments, *pairs, self._stresses, chunks=chunks)
        weigh = weigh_moments[2].bind(self._stresses, kinematics.inverse_shape, body.volumes, chunks=chunks)
        common = forces, self._stresses, *pairs
        unit, total = self.law.shear_modulus, self._all_forces if len(ghosts) else np.empty_like(body.points)
        directed = bonds.pointers, bonds.neighbours, kinematics.weighted_bonds, body.volumes
        own = point_forces[2].bind(*common, *directed, unit, 0, self._node_parts, total, chunks=chunks)
        directed = self._ghost_pointers, self._ghost_neighbours, self._ghost_weighted_bonds, body.all_volumes
        others = point_forces[2].bind(*common, *directed, unit, n, self._node_parts, total, chunks=chunks)

        def to_points(out: np.ndarray) -> int:
            gather()
            kinematics.gradient_ghosts.fold_moments(self._stresses)
            weigh()
            if not len(ghosts):
                own.give("out", out)
                return own()
            without_force = own() + others()
            ghosts.fold_forces(total)
            out[:] = total[:n]
            return without_force

        return to_points

    def energy(self) -> float:
        return self.law.shear_modulus * self._energy

    def mean_stress(self) -> np.ndarray:
        # Of the bonds' own stresses: the derivative of the energy by a homogeneous F.
        bonds, points = self.body.bonds, self.body.all_points
        vectors = points[bonds.second] - points[bonds.first]
        along = self._forces[: self._n_pairs].astype(float).T @ vectors
        # P m (x) m is twice the moment.
        across = 2 * self._moments[: self._n_pairs].sum(axis=0, dtype=float).reshape(2, 2).T
        return self.law.shear_modulus * (along + across) / self.body.volumes.sum()

    def pair_forces(self) -> np.ndarray:
        """The pair's own part, and what the two ends' S exert along it.

        Of a pair with a ghost, that includes what the energy of the mirrored pair says about the ghost of this point.
        """
        bonds, body, n = self.body.bonds, self.body, len(self.body)
        ghosts = body.ghosts
        vectors = body.all_points[bonds.second] - body.all_points[bonds.first]
        stresses = self._stresses.copy()
        ghosts.fill_changes(stresses)
        stresses = stresses.reshape(-1, 2, 2).transpose(0, 2, 1)
        strength = self._strength * self._intact
        forces = self._forces[: self._n_pairs].astype(float)
        outer = np.flatnonzero(bonds.second >= n)
        if len(outer):
            ghost = bonds.second[outer] - n
            forces[self._mirrored_pairs(outer)] -= ghosts.parity[ghost] * self._forces[outer]
        forces += strength[:, None] * np.einsum("bij,bj->bi", stresses[bonds.first] + stresses[bonds.second], vectors)
        return self.law.shear_modulus * forces

    def _mirrored_pairs(self, outer: np.ndarray) -> np.ndarray:
        """For pairs of a point i and the ghost of a point k: the pairs of k and the ghost of i under the same reflections."""
        bonds, ghosts, n = self.body.bonds, self.body.ghosts, len(self.body)
        ghost = bonds.second[outer].astype(np.int64) - n
        number = np.full((int(ghosts.image.max()) + 1, n), -1)
        number[ghosts.image, ghosts.source] = np.arange(len(ghosts))
        partner = ghosts.source[ghost].astype(np.int64), n + number[ghosts.image[ghost], bonds.first[outer]]
        total = n + len(ghosts)
        keys = bonds.first[outer].astype(np.int64) * total + bonds.second[outer]
        order = np.argsort(keys)
        return outer[order[np.searchsorted(keys[order], partner[0] * total + partner[1])]]

    def bond_columns(self) -> tuple[np.ndarray, np.ndarray]:
        """C = F_ij n and e = F_ij m of every pair at the positions last given, shape (n_pairs, 2) each."""
        kinematics, bonds, body = self._kinematics, self.body.bonds, self.body
        kinematics.form_gradients()
        vectors = body.all_points[bonds.second] - body.all_points[bonds.first]
        length = np.linalg.norm(vectors, axis=1)[:, None]
        m = np.stack([-vectors[:, 1], vectors[:, 0]], axis=1) / length
        mean = (kinematics.gradients[bonds.first] + kinematics.gradients[bonds.second]).reshape(-1, 2, 2) / 2
        return (kinematics.positions[bonds.second] - kinematics.positions[bonds.first]) / length, np.einsum("bji,bj->bi", mean, m)

    def energy_derivatives(self, trace, area_ratio) -> EnergyDerivatives:
        """The energy used here, the exact one taking over where this evaluation falls back on it, with second derivatives."""
        model, domain = self.model, self.model.domain
        found = model.energy_derivatives(self.law, trace, area_ratio)
        if domain is None or self.outside != "fallback":
            return found
        exact = BondEnergyForce().energy_derivatives(self.law, trace, area_ratio)
        return blended(found, exact, domain, trace, area_ratio)

    @property
    def has_tangent(self) -> bool:
        # Rounding in single precision would be most of what differences of the energy leave; second derivatives are of a sheet's energy.
        return self.precision == "float64" and self.plane == "stress"

    def tangent(self, positions: np.ndarray) -> Tangent:
        from .tangent import Tangent

        return Tangent(self, positions)

    def tangent_pass(self, linearised: np.ndarray) -> Callable[[np.ndarray, np.ndarray], None]:
        """What multiplies the tangent by displacements of the points.

        Parameters
        ----------
        linearised : ndarray, shape (n_blocks, 9, BLOCK)
            See `pdsurrogate.kernels.bond_energy.pair_tangents`.

        Returns
        -------
        callable
            Called with displacements (n, 2), it writes minus the tangent times them to its second argument.
        """
        ghosts, n, chunks = self.body.ghosts, len(self.body), self._kinematics.chunks
        changes, gradients = np.zeros_like(self.positions), np.zeros_like(self._kinematics.gradients)
        forces, moments = np.zeros(self._forces.shape), np.zeros(self._moments.shape)
        form, to_points = self._kinematics.gradient_pass(changes, gradients, 0.0), self.sums_of(forces, moments)
        bonds, memory = (self._first, self._second, self.geometry), (self._buffers, self._sums)
        find = bond_energy.pair_tangents.bind(changes, gradients, *bonds, linearised, *memory, forces, moments, chunks=chunks)

        def multiply(displacements: np.ndarray, out: np.ndarray) -> None:
            changes[:n] = displacements
            ghosts.fill_displacements(changes)
            form()
            ghosts.fill_changes(gradients)
            find()
            to_points(out)

        return multiply

    def gradient_weights(self) -> np.ndarray:
        """Weights of the neighbours' positions in the points' F, K^-1 w x V_j of every directed bond, shape (n_bonds, 2)."""
        return self._kinematics.gradient_weights()

    def take_out(self, pairs: np.ndarray) -> Release:
        """Of the horizons, the deformation gradients and the sum of energies.

        Returns
        -------
        Release
            What they had held, at the positions last placed; nothing where the body has no finite energy before or after.
        """
        forces, remaining = np.zeros_like(self.body.points), np.zeros_like(self.body.points)
        before = self._energy_at_present(forces)
        self._intact[pairs] = False
        self._weigh_pairs(self._kinematics.break_bonds(pairs))
        energy, forces = before - self._energy_at_present(remaining), forces - remaining
        if not (np.isfinite(energy) and np.isfinite(forces).all()):
            return Release(0.0, np.zeros_like(forces))
        return Release(energy, forces)

    def collapsed_pairs(self) -> np.ndarray:
        """Of the pairs that were turned inside out, or pressed below a third of their area."""
        if not self._collapsed:
            return np.empty(0, dtype=np.int64)
        c, e = self.bond_columns()
        return np.flatnonzero((self.bond_weights > 0) & ~(c[:, 0] * e[:, 1] - c[:, 1] * e[:, 0] > bond_energy.COLLAPSED))

    def _energy_at_present(self, out: np.ndarray) -> float:
        """Energy at the positions last placed, NaN where there is none; forces to `out`."""
        self._kinematics.form_gradients()
        _, invalid, _ = self.pass_bonds(out)
        return np.nan if invalid else self.energy()

    def _weigh_pairs(self, pairs: np.ndarray) -> None:
        """Bring bond_volume up to date after a change at the given pairs, from what is intact and which points have a gradient.

        Of a pair with a ghost only the point's share counts.
        """
        bonds, body, n = self.body.bonds, self.body, len(self.body)
        supported = self._kinematics.supported.astype(bool)
        # A point without support has no gradient; its bonds carry nothing, and so take no share of the other end's volume either.
        carries = self._intact[pairs] & supported[bonds.first[pairs]] & supported[bonds.second[pairs]]
        self._counted[pairs] = np.where(carries, self._strength[pairs], 0.0)
        ends = np.concatenate([bonds.first[pairs], bonds.second[pairs]])
        touched = np.unique(ends[ends < n])
        starts, counts = bonds.pointers[touched].astype(np.int64), np.diff(bonds.pointers).astype(np.int64)[touched]
        entries = np.repeat(starts - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
        around = np.unique(bonds.pair_of[entries])
        directed = bonds.pointers, bonds.neighbours, bonds.pair_of
        bond_shares[2](touched, *directed, body.all_points, body.volumes, self._counted, body.horizon, self.bond_shares)
        entries, starts = self._kinematics.pair_entries
        one, other = entries[starts[around]], entries[starts[around + 1] - 1]
        self.bond_weights[around] = self.bond_shares[one] + np.where(other != one, self.bond_shares[other], 0.0)
        self.geometry[around // BLOCK, 3, around % BLOCK] = self.bond_weights[around]
        bond, volumes = self._kinematics.weighted_bonds[self._ghost_bonds], body.all_volumes
        ratio = volumes[self._ghost_neighbours] / volumes[bonds.neighbours[self._ghost_bonds]]
        self._ghost_weighted_bonds[:] = -bond * ratio[:, None]

    def _diagnose(self) -> str:
        """Say which bond has no energy, and why."""
        c, e = self.bond_columns()
        bonds, alive = self.body.bonds, self.bond_weights > 0
        J = c[:, 0] * e[:, 1] - c[:, 1] * e[:, 0]
        broken = alive & ~np.isfinite(J)
        if broken.any():
            return at_point(self.body, int(bonds.first[broken.argmax()]), "the deformation gradient of a bond is not finite")
        worst = int(np.where(alive, J, np.inf).argmin())
        if J[worst] <= 0:
            what = f"det F = {J[worst]:.3g} of a bond: the material is turned inside out there"
            return at_point(self.body, int(bonds.first[worst]), what)
        trace = (c * c).sum(axis=1) + (e * e).sum(axis=1)
        for pair in np.argsort(np.where(alive, -trace, np.inf))[: 100 if self.plane == "stress" else 0]:
            try:
                BondEnergyForce().energy_derivatives(self.law, trace[[pair]], J[[pair]])
            except ValueError as error:
                return at_point(self.body, int(bonds.first[pair]), str(error))
        worst = int(np.where(alive, trace, -np.inf).argmax())
        what = f"one of the bonds has no energy; of the most strained one, tr C = {trace[worst]:.4g} and det F = {J[worst]:.4g}"
        return at_point(self.body, int(bonds.first[worst]), what)
