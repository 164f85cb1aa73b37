"""Energy of the pairs of a body, and the forces that are its gradient, theory (27)-(31),
(48)-(52), (56), (57).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..engine.block_arrays import aligned_rows
from ..engine.passes import BoundPass
from ..errors import InvalidState
from ..kernels import bond_energy
from ..kernels.domain import BLEND
from ..kernels.steps import copy_rows
from ..materials import PLANES, Law, plane_stress
from ..materials.states import principal_stretches
from .balanced import balanced_changes
from .binding import Binding, MaterialPart
from .bond_shares import BondShares
from .errors import at_point, why_invalid
from .kinematics import matrices
from .material_points import rows_of_each
from .pair_passes import PairEnergies, SelectivePairs, bond_gradients
from .steps import Steps
from .term import OutsideCounter, Passes, whole_volume
from .volume_energy import VolumeEnergy
from .work_on_planes import WorkOnPlanes

if TYPE_CHECKING:
    from .pair_memory import PairMemory


class PairEnergy(WorkOnPlanes):
    """Internal force from the energy of all pairs (undirected bonds), each a function of the pair's
    deformation gradient F_ij.

    Under plane stress the pairs have the whole energy. In plane strain and three dimensions the
    energy is selective: isochoric at the pairs and volumetric at the points (`VolumeEnergy`), which
    avoids locking. With several materials, each material evaluates a bond and its ends as if the
    other material moved with it (`Interfaces`), so that a pair across an interface has one gradient
    for each material; the derivative of the energy by the jump between the two gradients is a force
    on the points that determine the jump.

    Attributes
    ----------
    selective : bool
        Whether the energy is selective.
    shares : BondShares
    volume : VolumeEnergy or None
        Volumetric part of a selective energy.
    """

    has_energy = True
    selective: bool | None = None

    def __init__(self, binding: Binding) -> None:
        super().__init__(binding)
        body = self.body
        d = body.dimension
        whole = binding.whole
        if self.selective is None:
            self.selective = binding.settings.plane != "stress"
        self.shares = BondShares(self.kinematics, binding.precision)
        # They do not depend on the energy, and two terms have them in common.
        if self.kinematics.balance is None:
            changes = balanced_changes(binding, self.shares)
            if changes is not None:
                self.kinematics.change_weights(*changes)
        self._model = binding.portions[0].model
        models = [portion.model for portion in binding.portions]
        self._domain = self._model.domain if whole else None
        owners = None if whole else binding.portion_of[body.bond_owners]
        each = []
        self._own_bonds = []
        for number, model in enumerate(models):
            own = None if whole else owners == number
            # A material has energy in its own bonds.
            pairs = None if whole else np.flatnonzero(self.shares.weights_of(own=own))
            points = self.points_of(number, pairs)
            self.watches.append(OutsideCounter(binding, model, points, "energy", "energy"))
            each.append((binding, self.shares, model, points, own))
            self._own_bonds.append(own)
        if self.selective:
            sizes = [len(points.first) for points in self.materials]
            all_volumes = np.ones(sum(sizes))
            volumes = np.split(all_volumes, np.cumsum(sizes)[:-1])
            self.parts = [
                SelectivePairs(*one, of_pairs) for one, of_pairs in zip(each, volumes, strict=True)
            ]
            self.volume = VolumeEnergy(binding, self.shares, self.parts, all_volumes)
        else:
            self.parts = [PairEnergies(*one) for one in each]
        # of the last evaluation; None where passes have made it
        self._energy: float | None = 0.0
        self.memories = [
            self._memory_of(number)
            for number, points in enumerate(self.materials)
            if points.law.memory
        ]
        self._begun = not self.memories
        self.settles = any(memory.follows_positions for memory in self.memories)
        self._stresses = aligned_rows((len(body.all_points), d * d))
        self._on_points = np.zeros((len(body.all_points), d))
        self._moments_of_ghosts = np.zeros((len(body.ghosts), d * d))
        self._on_jumps = None if whole else np.zeros((len(body), d))
        seen = [None, None]
        if not whole:
            seen = [np.zeros_like(array) for array in (self._on_points, self._stresses)]
        (forces, of_forces), (moments, of_moments) = (
            rows_of_each(self.kinematics, self.materials, *arrays)
            for arrays in zip((self._on_points, self._stresses), seen, strict=True)
        )
        sums = [part.sum_to(*rows) for part, *rows in zip(self.parts, moments, forces, strict=True)]
        self.in_units = list(enumerate(sums))
        further = []
        if not whole:
            own = self._stresses[: len(body)]
            further = self.kinematics.interfaces.steps_back(*seen, own, self._on_jumps)
        to_points = [
            *sums,
            *of_forces,
            *of_moments,
            *self.shares.steps_to_points(
                self._stresses, self._on_points, self._moments_of_ghosts, *further
            ),
        ]
        seen = [step for points in self.materials for step in points.seen]
        before, after = (
            (seen, []) if self.volume is None else (self.volume.dilatation_steps, self.volume.steps)
        )
        leading = [] if binding.number else self.kinematics.steps()
        after = [
            *after,
            *(step for part in self.parts for step in part.steps),
            *to_points,
        ]
        self._find_forces, self._find_all = (
            Steps(body.share, *first, *before, *after) for first in ([], leading)
        )
        self._after, self._sums = (
            sum(isinstance(step, BoundPass) for step in steps) for steps in (after, to_points)
        )
        self.places = bool(leading)

    def _memory_of(self, number: int) -> PairMemory:
        """Return the memory of a material, which becomes part of the history."""
        from .pair_memory import PairMemory  # here, for few materials have one
        from .sheet_memory import SheetMemory

        kind = PairMemory if self.selective else SheetMemory
        memory = kind(self.binding, self.parts[number], number)
        memory.see = self._see
        self.state += memory.state
        self.kept |= {array.name: array.values for array in memory.state}
        return memory

    def set_parameters(self, portions: Sequence[MaterialPart]) -> None:
        super().set_parameters(portions)
        self._model = portions[0].model
        for part, portion in zip(self.parts, portions, strict=True):
            part.set_parameters(portion.model)

    def find(self, out: np.ndarray) -> None:
        outside, invalid, without_force = self._run(self._find_all, out)
        self.kinematics.formed |= self.places
        for watch, found in zip(self.watches, outside, strict=True):
            watch.found = found
        if invalid or not np.isfinite(self._energy):
            raise InvalidState(self._without_energy())
        if without_force:
            raise InvalidState(self.diagnose(out))

    def passes(self, out: np.ndarray) -> Passes | None:
        steps = self._find_all.passes
        counted = any(part.model.domain for part in self.parts)
        if steps is None or self.memories or self._on_jumps is not None or counted:
            return None
        bind = self.kinematics.bind
        checks = [one for part in self.parts for one in part.checks(bind)]
        copy = bind(copy_rows, self._on_points, out)
        self._energy = None
        return Passes((*steps, *checks, copy), self._sum_on_planes)

    def pass_bonds(self, out: np.ndarray) -> None:
        self._run(self._find_forces, out)

    def _run(self, steps: Steps, out: np.ndarray) -> tuple[list[int], int, int]:
        """Run the steps of an evaluation: compute the energy, and write the forces on points to
        `out`.

        Return the numbers of pairs outside the domain of each model, of pairs turned inside out,
        and of points without a finite force.
        """
        self._energy = np.nan
        if not self._begun:
            self._begin()
        found = steps()
        outside, _, inside_out = zip(*(part.counts() for part in self.parts), strict=True)
        invalid = sum(found[: -self._after])
        if self.volume is not None and self.body.share.any(invalid):
            return [0] * len(self.parts), invalid, 0
        if not any(inside_out):
            self._energy = self._sum()
        out[:] = self._on_points[: len(out)]
        if self._on_jumps is not None:
            out += self._on_jumps
        return list(outside), sum(inside_out), sum(found[-self._sums :])

    def elapse(self) -> None:
        self._begun = not self.memories

    def _begin(self) -> None:
        """Compute what evaluations need of the history, once for a state and a time."""
        if self.settles:
            self.kinematics.place_and_form()
            self._see()
        for memory in self.memories:
            memory.begin(self.kinematics.elapsed)
        self._begun = True

    def settle(self) -> bool:
        self._see()
        elapsed = self.kinematics.elapsed
        changed = [memory.settle(elapsed) for memory in self.memories]
        return any(changed)

    def accept(self, elapsed: float) -> None:
        self._see()
        if not self._begun:
            self._begin()
        for memory in self.memories:
            memory.accept(elapsed)

    def _see(self) -> None:
        """Bring the gradients up to date, as every material sees them."""
        self.kinematics.form_gradients()
        for points in self.materials:
            for step in points.seen:
                step()

    def energy(self) -> float:
        return self._sum() if self._energy is None else self._energy

    def _sum(self) -> float:
        return sum(part.unit * part.energy() for part in self.parts)

    def stored(self) -> float:
        if not self.memories or np.isnan(self._energy):
            return self.energy()
        return sum(part.unit * part.stored() for part in self.parts)

    def dissipated(self) -> dict[str, float]:
        if not self.memories:
            return {}
        found = sum(memory.dissipated() for memory in self.memories).tolist()
        return dict(zip(("branches", "softening"), found, strict=True))

    def pair_forces(self, pairs: np.ndarray) -> np.ndarray:
        """Return the forces of pairs on their first points: from the energies of the pairs, and
        from the moments of their two ends.

        A moment is the derivative of the energy by a point's deformation gradient. The force of a
        pair with a ghost includes the force that the mirrored pair exerts on the ghost of this
        first point.
        """
        bonds = self.body.bonds
        body = self.body
        n = len(body)
        first = bonds.first[pairs]
        second = bonds.second[pairs]
        stresses = matrices(self._stresses[:n])

        def of_firsts(chosen: np.ndarray) -> np.ndarray:
            """Return the part of the forces that does not come from the moments of the second
            ends.
            """
            vectors = body.all_points[bonds.second[chosen]] - body.all_points[bonds.first[chosen]]
            return self._of_pairs(chosen)[1] + self.shares.strength[chosen, None] * np.einsum(
                "bij,bj->bi", stresses[bonds.first[chosen]], vectors
            )

        forces = of_firsts(pairs)
        within = np.flatnonzero(second < n)
        outer = np.flatnonzero(second >= n)
        partners = self.kinematics.mirrored_pairs[
            np.searchsorted(self.kinematics.outer_pairs, pairs[outer])
        ]
        forces[outer] -= body.ghosts.parity[bonds.second[partners] - n] * of_firsts(partners)
        vectors = body.points[second[within]] - body.points[first[within]]
        forces[within] += self.shares.strength[pairs[within], None] * np.einsum(
            "bij,bj->bi", stresses[second[within]], vectors
        )
        changed = self._from_one_side()
        return forces if changed is None else forces + changed[pairs]

    def _of_pairs(self, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the moments (k, d d) and forces (k, d) of given pairs, summed over the materials,
        in the state last evaluated.
        """
        self._see()
        d = self.body.dimension
        found = np.zeros((len(pairs), d * d + d))
        for part in self.parts:
            places, chosen = part.points.places_of_pairs(pairs)
            found[chosen] += part.each(places)
        return found[:, : d * d], found[:, d * d :]

    def _from_one_side(self) -> np.ndarray | None:
        """Return corrections of the forces of all pairs where bonds are omitted from gradients
        or have changed weights; None if none do.
        """
        found = [(each.numbers, each.owners, each.changes) for each in self.kinematics.changed]
        if not found:
            return None
        numbers, owners, changes = (np.concatenate(each) for each in zip(*found, strict=True))
        return self.kinematics.of_pairs(
            numbers, owners, self.shares.pulls(self._stresses, owners, changes)
        )

    def mean_stress(self) -> np.ndarray:
        """Return the volume mean of the bonds' first Piola-Kirchhoff stresses, (d, d): the
        derivative of the energy by a homogeneous F.
        """
        bonds = self.body.bonds
        points = self.body.all_points
        d = self.body.dimension
        found = np.zeros((d, d))
        for part in bonds.slabs():
            pairs = part.start + np.flatnonzero(self.body.share.own[bonds.first[part]])
            vectors = points[bonds.second[pairs]] - points[bonds.first[pairs]]
            moments, forces = self._of_pairs(pairs)
            # P (I - n (x) n) is twice the moment.
            found += forces.T @ vectors + 2 * moments.sum(axis=0).reshape(d, d).T
        return found / whole_volume(self.body)

    def released_by(self, motion: np.ndarray) -> float | None:
        if not self.binding.whole:
            return None
        kinematics = self.kinematics
        bonds = self.body.bonds
        points = self.body.all_points
        d = self.body.dimension
        own = self.body.share.own
        positions = kinematics.positions[: len(motion)].copy()
        density = self.stress_and_energy()[1]
        kinematics.form_gradients()
        before = kinematics.gradients.copy()
        # Gradients are affine in the positions, so that their changes are the gradients of the
        # motion.
        kinematics.place(positions + motion, form=True)
        moved = (kinematics.gradients != before).any(axis=1)
        growth = np.trace(
            matrices(kinematics.gradients[: len(motion)] - before[: len(motion)]), axis1=1, axis2=2
        )
        pairs = np.flatnonzero(own[bonds.first] & (moved[bonds.first] | moved[bonds.second]))
        ahead = self._gradients(pairs)
        kinematics.place(positions, form=True)
        F = self._gradients(pairs)
        vectors = points[bonds.second[pairs]] - points[bonds.first[pairs]]
        turned = F @ (ahead - F)
        moments, forces = self._of_pairs(pairs)
        along = np.einsum("bi,bij,bj->", forces, turned, vectors)
        # P (I - n (x) n) is twice the moment
        across = 2 * np.einsum("bji,bij->", moments.reshape(-1, d, d), turned)
        return float(along + across - (self.body.volumes * density * growth)[own].sum())

    def break_bonds(self, pairs: np.ndarray, changed: np.ndarray) -> None:
        self.shares.strength[pairs] = 0.0
        around = self.shares.renew(changed)
        for part, own in zip(self.parts, self._own_bonds, strict=True):
            places, chosen = part.points.places_of_pairs(around)
            of_part = around[chosen]
            self.shares.put_weights(
                part.geometry, places, of_part, self.shares.weights_of(of_part, own)
            )
            if self.volume is not None:
                self.shares.fill_end_shares(part.end_shares, places, of_part, own)
        if self.volume is not None:
            self.volume.renew()

    def collapsed_pairs(self) -> np.ndarray:
        """Return the numbers of pairs that were turned inside out, or pressed below `COLLAPSED`
        of their area or volume.
        """
        found = super().collapsed_pairs()
        for part, own in zip(self.parts, self._own_bonds, strict=True):
            if self.selective:
                every = None if part.points.whole else part.points.pairs
                count = len(self.shares.strength if every is None else every)
                pairs = np.flatnonzero(~(part.volumes[:count] > bond_energy.COLLAPSED))
                pairs = pairs if every is None else every[pairs]
            elif part.counts()[1]:
                pairs = np.arange(len(self.body.bonds.first))[part.points.pairs]
                pairs = pairs[~(np.linalg.det(self._gradients(pairs)) > bond_energy.COLLAPSED)]
            else:
                continue
            if len(pairs):
                found = np.union1d(found, pairs[self.shares.weights_of(pairs, own) > 0])
        return found

    def volume_ratios(self) -> np.ndarray:
        if self.volume is None:
            found = super().volume_ratios()
            for part in self._remembering():
                found[part.points.own[1]] = part.memory.volume_ratios()
            return found
        self.kinematics.form_gradients()
        self.body.share.agree(
            InvalidState(self._without_energy()) if self.volume.find_dilatations() else None
        )
        found = self.volume.dilatations.copy()
        if not self.binding.whole:
            found[self.binding.portion_of[: len(found)] == len(self.materials)] = 1.0
        return found

    def _bulk_stresses(self) -> np.ndarray:
        found = super()._bulk_stresses()
        return found if self.volume is None else self.volume.smoothing.matrix() @ found

    def stress_and_energy(self) -> tuple[np.ndarray, np.ndarray]:
        stress, energy = self._elastic_stress_and_energy()
        for part in self._remembering():
            self._add_memory(part, stress, energy)
        return stress, energy

    def _remembering(self) -> list:
        """Return the parts with memory, ready to be asked about points in the present state."""
        if self.memories and not self._begun:
            self._begin()
        return [part for part in self.parts if part.memory is not None]

    def _add_memory(self, part: Any, stress: np.ndarray, energy: np.ndarray) -> None:
        """Add branches and softening of a material to the elastic stress and energy density of its
        points, from means over their bonds.
        """
        plane = PLANES[self.kinematics.plane]
        M, eta, stored = part.memory.at_points()
        _, at = part.points.own
        F = self.kinematics.deformation_gradients()[at]
        J3 = self.volume_ratios()[at]
        law = part.points.law
        if law.memory.softening is not None:
            elastic = (
                plane.stress_and_energy(
                    law, F, J3, 0 * J3, part.isochoric.evaluate(*plane.isochoric_state(F))
                )
                if self.selective
                else plane.stress_and_energy(law, F, J3)
            )
            stress[at] += (eta - 1)[:, None, None] * elastic[0]
        full = np.zeros((len(F), 3, 3))
        full[:, 2, 2] = 1.0 if self.selective else J3 / np.linalg.det(F)
        full[:, : F.shape[1], : F.shape[1]] = F
        J = np.linalg.det(full)[:, None, None]
        FM = full @ M
        mean = np.einsum("nij,nij->n", FM, full)[:, None, None] / 3
        inverse = np.linalg.inv(full).swapaxes(1, 2)
        found = np.cbrt(J) ** -2 * (FM - mean * inverse)
        if not self.selective:  # no stress across the sheet
            found -= (found[:, 2, 2] * full[:, 2, 2])[:, None, None] * inverse
        stress[at] += part.unit * found
        energy[at] += part.unit * stored

    def _elastic_stress_and_energy(self) -> tuple[np.ndarray, np.ndarray]:
        part = self.parts[0]
        plane = PLANES[self.kinematics.plane]
        if not self.binding.whole or part.model.domain is None:
            return super().stress_and_energy()
        F = self.kinematics.deformation_gradients()
        law = part.points.law
        if self.selective:
            found = part.isochoric.evaluate(*plane.isochoric_state(F))
            return plane.stress_and_energy(
                law, F, self.volume_ratios(), self._bulk_stresses(), found
            )
        stress, energy = super().stress_and_energy()
        trace, J = plane_stress.invariants(F)
        found = part.model.energy_derivatives(law, trace, J)
        learned = np.ones(len(F), dtype=bool)
        if (
            self.binding.outside == "fallback"
        ):  # the exact energy counts in the whole band where it is blended in
            learned = self.domain_deviation() < 0.5 * np.log(1 - BLEND)
        stress[learned] = energy[learned] = 0.0
        stress[learned, :2, :2] += (
            part.unit
            * plane_stress.in_plane_stress(F, 2 * found.by_trace, J * found.by_area)[learned]
        )
        energy[learned] += part.unit * found.psi[learned]
        return stress, energy

    def domain_deviation(self) -> np.ndarray | None:
        return None if self._domain is None else self._domain.deviation(self._stretches())

    def beyond_data(self) -> np.ndarray | None:
        if not self.selective or self._domain is None or self._domain.hull is None:
            return None
        return self._domain.beyond_data(self._stretches()[self.body.share.own])

    def _stretches(self) -> np.ndarray:
        """Return the principal stretches of the points, shape (n, k); for a selective energy the
        three isochoric ones.
        """
        stretches = principal_stretches(self.kinematics.deformation_gradients())
        if not self.selective:
            return stretches
        J = stretches.prod(axis=1, keepdims=True)
        # In plane strain the third stretch is 1.
        return np.hstack([stretches, np.ones((len(J), 3 - stretches.shape[1]))]) / np.cbrt(J)

    def _gradients(self, pairs: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return the deformation gradients F_ij (k, d, d) of given pairs, by default of all
        (theory (27)).
        """
        self.kinematics.form_gradients()
        first = self.body.bonds.first[pairs]
        second = self.body.bonds.second[pairs]
        gradients = self.kinematics.gradients
        vectors, between = (
            at[second] - at[first] for at in (self.body.all_points, self.kinematics.positions)
        )
        length = np.linalg.norm(vectors, axis=1)[:, None]
        n = vectors / length
        means = matrices(gradients[first] + gradients[second]) / 2
        return bond_gradients(means, between / length, n)

    def _without_energy(self) -> str:
        """Return an error message that names a point with a bond that has no energy, and the
        reason.
        """
        pairs = np.flatnonzero(self.shares.weights_of() > 0)
        F = self._gradients()[pairs]

        def laws(place: int) -> list[Law]:
            return [
                points.law
                for points in self.materials
                if points.whole or pairs[place] in points.pairs
            ]

        place, reason = why_invalid(F, " of a bond", self.kinematics.plane, laws)
        return at_point(self.body, int(self.body.bonds.first[pairs[place]]), reason)
