"""The bond-level energy and the forces that are its gradient (THEORY [6]-[8], volumes shared out by `reference.bond_shares`)."""

from __future__ import annotations

import numpy as np

from ..body import Body
from ..kernels import bond_energy, gradient, reference
from ..kernels.blocks import BLOCK, aligned_rows
from ..kernels.bond_pass import FALL_BACK, UNGUARDED
from ..kernels.energy_density import exact_energy_density
from ..materials import Law
from .domain_watch import DomainWatch
from .energy_density import EnergyDerivatives, EnergySurrogate, ExactEnergyDensity, blended, domain_constants
from .kinematics import Kinematics, at_point, locate
from .model import BindableForce
from .protocol import InvalidState, Release
from .settings import OUTSIDE_POLICIES, PRECISIONS, ForceSettings

HONOURED = {"precision": PRECISIONS, "correction": ("none",), "breakable": (True,)}
"""Settings that an energy honours: it is exact on incomplete horizons, and its invariants know no rotation."""

HONOURED_WITH_DOMAIN = {**HONOURED, "outside": tuple(OUTSIDE_POLICIES)}
"""The same for a learnt energy, whose domain bonds can leave."""


class BondEnergyForce(ExactEnergyDensity, BindableForce):
    """Forces that are the gradient of a sum of bond energies, with the exact plane-stress energy of any law."""

    name = "bond-energy"
    honours = HONOURED

    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> BondEnergyEvaluation:
        """The evaluation on a body."""
        return BondEnergyEvaluation(self, body, law, settings)


class BondEnergyEvaluation(DomainWatch):
    """An energy bound to a body: gradient pass, a pass over each pair once, and the sums to points.

    The energy is that of the body's own points: of a pair with an image, the point's share counts and the image's, which lies beyond the
    grip, does not.  Images are functions of the points they mirror, so what the energy says about an image is handed on to that point.
    """

    correction = "none"

    def __init__(self, model: EnergySurrogate, body: Body, law: Law, settings: ForceSettings) -> None:
        model.check_material(law)
        self.body, self.law = body, law
        self.precision = settings.precision or model.default_precision
        super().__init__(model, settings.outside, len(body.bonds.first), "energy", "energy")
        self.kinematics = Kinematics(body, law, self.precision, breakable=settings.breakable)
        bonds, n, total = body.bonds, len(body), len(body.all_points)
        self._first, self._second = bonds.ends_in_blocks(BLOCK)
        size = len(self._first)
        blocks = size // BLOCK
        vectors = body.all_points[bonds.second] - body.all_points[bonds.first]
        length = np.linalg.norm(vectors, axis=1)
        self._strength = body.weigh(length) * body.all_volumes[bonds.first] * body.all_volumes[bonds.second]
        self._intact = np.ones(self._n_pairs, dtype=bool)
        self._weights = np.zeros(self._n_pairs)
        self.geometry = aligned_rows((blocks, 4, BLOCK), self.precision)
        rows = np.zeros((4, size))
        rows[:3, : self._n_pairs] = vectors[:, 0] / length, vectors[:, 1] / length, 1 / length
        self.geometry[:] = rows.reshape(4, blocks, BLOCK).transpose(1, 0, 2)

        # Pairs in which a point or an image comes second; images are first in none.
        incidence = np.argsort(bonds.second, kind="stable").astype(np.uint32)
        self._incidence = incidence
        self._incidence_pointers = np.zeros(total + 1, dtype=np.uint64)
        self._incidence_pointers[1:] = np.cumsum(np.bincount(bonds.second, minlength=total))
        self._pair_pointers = np.full(total + 1, bonds.pair_pointers[-1])
        self._pair_pointers[: n + 1] = bonds.pair_pointers
        # Bonds of the images, seen from them: the directed bonds that end in one, by image.
        towards = np.flatnonzero(bonds.neighbours >= n)
        self._image_bonds = towards[np.argsort(bonds.neighbours[towards], kind="stable")]
        owners = np.repeat(np.arange(n, dtype=np.uint32), np.diff(bonds.pointers).astype(np.int64))
        self._image_neighbours = owners[self._image_bonds]
        self._image_pointers = np.zeros(total - n + 1, dtype=np.uint64)
        self._image_pointers[1:] = np.cumsum(np.bincount(bonds.neighbours[towards] - n, minlength=total - n))
        self._counted, self._shares = np.zeros(self._n_pairs), np.zeros(len(bonds.neighbours))
        self._weigh_pairs(np.arange(self._n_pairs))

        compiled = model.compiled(self.precision)
        self._compiled = compiled
        self._exact = exact_energy_density(self.precision)
        domain = model.domain
        self._guard = {"fallback": FALL_BACK, "extrapolate": UNGUARDED}.get(self.outside, bond_energy.COUNTED) if domain else UNGUARDED
        self._domain = domain_constants(domain, self.precision) if domain else np.zeros(bond_energy.DOMAIN_SIZE, self.precision)
        chunks = self.kinematics.chunks
        self._buffers = aligned_rows((chunks, bond_energy.BUFFER_ROWS, BLOCK), self.precision)
        self._sums = aligned_rows((chunks, 4, BLOCK))
        self._work = aligned_rows((chunks, max(compiled.work_rows, 1), BLOCK), self.precision)
        self._counts = np.zeros((3, chunks), dtype=np.int64)
        self._energy, self._collapsed = 0.0, 0
        self._energies = np.zeros(blocks)
        self._forces = aligned_rows((size, 2), self.precision)
        self._moments = aligned_rows((size, 4), self.precision)
        self._stresses = aligned_rows((total, 4))
        self._node_parts, self._all_forces = np.zeros((total, 2)), np.zeros((total, 2))

    def __call__(self, positions: np.ndarray, out: np.ndarray) -> None:
        self.evaluations += 1
        self.kinematics.update_gradients(positions)
        outside, invalid, strange = self.pass_bonds(out)
        self._report_outside(outside)
        if invalid or not np.isfinite(self._energy):
            raise InvalidState(self._diagnose())
        if strange:
            raise InvalidState(locate(self.body, out, "the force on it is not finite"))

    def pass_bonds(self, out: np.ndarray) -> tuple[int, int, int]:
        """Pass over the pairs and sums, with the deformation gradients last formed.

        Returns the number of pairs outside the domain, of those turned inside out, and of points without a force.
        """
        kinematics = self.kinematics
        self._energy, outside, self._collapsed, invalid = bond_energy.pair_energies(
            kinematics.positions,
            kinematics.gradients,
            self._first,
            self._second,
            self.geometry,
            self._compiled.address,
            self._compiled.sizes,
            self._compiled.weights,
            self._exact.address,
            kinematics.response.address,
            kinematics.parameters,
            self._guard,
            self._domain,
            self._buffers,
            self._sums,
            self._work,
            kinematics.scratch,
            *self._counts,
            self._energies,
            self._forces,
            self._moments,
        )
        return outside, invalid, self._sum_to_points(self._forces, self._moments, out)

    def _sum_to_points(self, forces, moments, out) -> int:
        """Force on the body's points from the parts of the pairs; what falls to an image goes to the point behind it.

        Returns the number of points and images without a force.
        """
        body, bonds, images, kinematics = self.body, self.body.bonds, self.body.images, self.kinematics
        n = len(body)
        bond_energy.sum_moments(moments, self._pair_pointers, self._incidence_pointers, self._incidence, self._stresses)
        bond_energy.return_moments(self._stresses, n, images.mirror, images.parity, images.axis)
        bond_energy.weigh_moments(self._stresses, kinematics.inverse_shape, body.volumes)
        common = (forces, self._stresses, self._pair_pointers, self._incidence_pointers, self._incidence)
        unit = self.law.shear_modulus
        total = self._all_forces if len(images) else out
        strange = bond_energy.point_forces(
            *common, bonds.pointers, bonds.neighbours, kinematics.weighted_bonds, body.volumes, unit, 0, self._node_parts, total
        )
        if len(images):
            strange += bond_energy.point_forces(
                *common,
                self._image_pointers,
                self._image_neighbours,
                self._image_weighted_bonds,
                body.all_volumes,
                unit,
                n,
                self._node_parts,
                total,
            )
            bond_energy.return_forces(total, n, images.mirror, images.parity)
            out[:] = total[:n]
        return strange

    def energy(self) -> float:
        """Stored energy per unit thickness in the state last evaluated."""
        return self.law.shear_modulus * self._energy

    def state_arrays(self) -> dict[str, np.ndarray]:
        """See `InternalForce`."""
        return self.kinematics.state_arrays()

    def move_plane(self, plane: int, displacement) -> None:
        """Displace a reflection plane of the body."""
        self.kinematics.move_plane(plane, displacement)

    def mean_stress(self) -> np.ndarray:
        """Volume mean of the bonds' first Piola-Kirchhoff stress, the derivative of the energy by a homogeneous F; shape (2, 2)."""
        bonds, points = self.body.bonds, self.body.all_points
        vectors = points[bonds.second] - points[bonds.first]
        along = self._forces[: self._n_pairs].astype(float).T @ vectors
        # P m (x) m is twice the moment.
        across = 2 * self._moments[: self._n_pairs].sum(axis=0, dtype=float).reshape(2, 2).T
        return self.law.shear_modulus * (along + across) / self.body.volumes.sum()

    def pair_forces(self) -> np.ndarray:
        """Force on the first point of every pair in the state last evaluated, shape (n_pairs, 2).

        The pair's own part, and what the two ends' S exert along it.  Of a pair with an image, that includes what the energy of the
        mirrored pair says about the image of this point.
        """
        bonds, body, n = self.body.bonds, self.body, len(self.body)
        images = body.images
        vectors = body.all_points[bonds.second] - body.all_points[bonds.first]
        stresses = self._stresses.reshape(-1, 2, 2).transpose(0, 2, 1).copy()
        flip = np.where(images.axis[:, None] == np.arange(2), -1.0, 1.0)
        stresses[n:] = images.parity[:, :, None] * stresses[images.mirror] * flip[:, None, :]
        strength = self._strength * self._intact
        forces = self._forces[: self._n_pairs].astype(float)
        outer = np.flatnonzero(bonds.second >= n)
        if len(outer):
            image = bonds.second[outer] - n
            forces[self._mirrored_pairs(outer)] -= images.parity[image] * self._forces[outer]
        forces += strength[:, None] * np.einsum("bij,bj->bi", stresses[bonds.first] + stresses[bonds.second], vectors)
        return self.law.shear_modulus * forces

    def _mirrored_pairs(self, outer: np.ndarray) -> np.ndarray:
        """For pairs of a point i and the image of a point k: the pairs of k and the image of i in the same plane."""
        bonds, images, n = self.body.bonds, self.body.images, len(self.body)
        image = bonds.second[outer].astype(np.int64) - n
        number = np.full((int(images.plane.max()) + 1, n), -1)
        number[images.plane, images.mirror] = np.arange(len(images))
        partner = images.mirror[image].astype(np.int64), n + number[images.plane[image], bonds.first[outer]]
        total = n + len(images)
        keys = bonds.first[outer].astype(np.int64) * total + bonds.second[outer]
        order = np.argsort(keys)
        return outer[order[np.searchsorted(keys[order], partner[0] * total + partner[1])]]

    def bond_columns(self) -> tuple[np.ndarray, np.ndarray]:
        """C = F_ij n and e = F_ij m of every pair with the deformation gradients last formed, shape (n_pairs, 2) each."""
        kinematics, bonds, body = self.kinematics, self.body.bonds, self.body
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
        exact = ExactEnergyDensity().energy_derivatives(self.law, trace, area_ratio)
        return blended(found, exact, domain, trace, area_ratio)

    def tangent(self, positions: np.ndarray):
        """The second derivative of the energy at positions of the points; see `pdsurrogate.forces.tangent.Tangent`."""
        from .tangent import Tangent

        return Tangent(self, positions)

    def break_bonds(self, pairs: np.ndarray) -> Release:
        """Take pairs out of the horizons, the deformation gradients and the sum of energies.

        Returns
        -------
        Release
            What they had held, at the positions last placed; nothing where the body has no finite energy before or after.
        """
        self.kinematics.check_breakable()
        forces, remaining = np.zeros_like(self.body.points), np.zeros_like(self.body.points)
        before = self._energy_at_present(forces)
        self._intact[pairs] = False
        self._weigh_pairs(self.kinematics.break_bonds(pairs))
        energy, forces = before - self._energy_at_present(remaining), forces - remaining
        if not (np.isfinite(energy) and np.isfinite(forces).all()):
            return Release(0.0, np.zeros_like(forces))
        return Release(energy, forces)

    def collapsed_pairs(self) -> np.ndarray:
        """Numbers of the pairs that were turned inside out in the last evaluation, or pressed below a third of their area."""
        if not self._collapsed:
            return np.empty(0, dtype=np.int64)
        c, e = self.bond_columns()
        return np.flatnonzero((self._weights > 0) & ~(c[:, 0] * e[:, 1] - c[:, 1] * e[:, 0] > bond_energy.COLLAPSED))

    def _energy_at_present(self, out: np.ndarray) -> float:
        """Energy at the positions last placed, NaN where there is none; forces to `out`."""
        self.kinematics.update_gradients(self.kinematics.positions[: len(self.body)].copy())
        _, invalid, _ = self.pass_bonds(out)
        return np.nan if invalid else self.energy()

    def _weigh_pairs(self, pairs: np.ndarray) -> None:
        """Bring beta up to date after a change at the given pairs, from what is intact and which points have a gradient.

        Of a pair with an image only the point's share counts.
        """
        bonds, body, n = self.body.bonds, self.body, len(self.body)
        supported = self.kinematics.supported.astype(bool)
        # A point without support has no gradient; its bonds carry nothing, and so take no share of the other end's volume either.
        carries = self._intact[pairs] & supported[bonds.first[pairs]] & supported[bonds.second[pairs]]
        self._counted[pairs] = np.where(carries, self._strength[pairs], 0.0)
        ends = np.concatenate([bonds.first[pairs], bonds.second[pairs]])
        touched = np.unique(ends[ends < n])
        starts, counts = bonds.pointers[touched].astype(np.int64), np.diff(bonds.pointers).astype(np.int64)[touched]
        entries = np.repeat(starts - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
        around = np.unique(bonds.pair_of[entries])
        directed = bonds.pointers, bonds.neighbours, bonds.pair_of
        reference.bond_shares(touched, *directed, body.all_points, body.volumes, self._counted, body.horizon, self._shares)
        entries, starts = self.kinematics.pair_entries
        one, other = entries[starts[around]], entries[starts[around + 1] - 1]
        self._weights[around] = self._shares[one] + np.where(other != one, self._shares[other], 0.0)
        self.geometry[around // BLOCK, 3, around % BLOCK] = self._weights[around]
        bond, volumes = self.kinematics.weighted_bonds[self._image_bonds], body.all_volumes
        ratio = volumes[self._image_neighbours] / volumes[bonds.neighbours[self._image_bonds]]
        # In the precision of the points' own: another would have `point_forces` compiled a second time.
        self._image_weighted_bonds = (-bond * ratio[:, None]).astype(bond.dtype)

    def _diagnose(self) -> str:
        """Say which bond has no energy, and why."""
        c, e = self.bond_columns()
        bonds, alive = self.body.bonds, self._weights > 0
        J = c[:, 0] * e[:, 1] - c[:, 1] * e[:, 0]
        broken = alive & ~np.isfinite(J)
        if broken.any():
            return at_point(self.body, int(bonds.first[broken.argmax()]), "the deformation gradient of a bond is not finite")
        worst = int(np.where(alive, J, np.inf).argmin())
        if J[worst] <= 0:
            what = f"det F = {J[worst]:.3g} of a bond: the material is turned inside out there"
            return at_point(self.body, int(bonds.first[worst]), what)
        trace = (c * c).sum(axis=1) + (e * e).sum(axis=1)
        for pair in np.argsort(np.where(alive, -trace, np.inf))[:100]:
            try:
                ExactEnergyDensity().energy_derivatives(self.law, trace[[pair]], J[[pair]])
            except ValueError as error:
                return at_point(self.body, int(bonds.first[pair]), str(error))
        worst = int(np.where(alive, trace, -np.inf).argmax())
        what = f"one of the bonds has no energy; of the most strained one, tr C = {trace[worst]:.4g} and det F = {J[worst]:.4g}"
        return at_point(self.body, int(bonds.first[worst]), what)

    def gradient_change(self, displacements: np.ndarray, positions: np.ndarray, gradients: np.ndarray) -> None:
        """Displacements of points and images, and the change of every F under them; the linear part of `Kinematics.update_gradients`."""
        body, kinematics, images, n = self.body, self.kinematics, self.body.images, len(self.body)
        positions[:n] = displacements
        positions[n:] = images.parity * displacements[images.mirror]
        bonds = body.bonds
        gradient.deformation_gradients(
            positions, bonds.pointers, bonds.neighbours, kinematics.weighted_bonds, kinematics.inverse_shape, 0.0, gradients
        )
        bond_energy.reflect_changes(gradients, n, images.mirror, images.parity, images.axis)
