"""Energies of several materials on one body (theory (56), (57)): of a pair across an interface every end has its share, by its own law."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ..body import Body
from ..engine.block_arrays import aligned_rows
from ..kernels import selective_energy
from ..kernels.elementary import sum_in_order
from ..materials import Law
from .bond_energy import EnergyOfPairs, PairEnergies, pair_geometry
from .evaluation import DomainWatch
from .kinematics import matrices
from .portions import EvaluationOfPortions, common_precision
from .protocol import InvalidState, Portion
from .selective_energy import SelectivePairs, Smoothing
from .settings import OUTSIDE, ForceSettings


class EnergyOfSomePairs(Protocol):
    """What a part of the energy is asked for: `PairEnergies` or `SelectivePairs`."""

    energy: float
    forces: np.ndarray
    moments: np.ndarray


class EnergyOfPortions(EnergyOfPairs, EvaluationOfPortions):
    """An energy of several materials.

    Either material sees the bond and its ends as if the other moved as itself (`Interfaces`), so that a pair across an interface has one
    gradient for each; what the energy says about the jump between them is a force on the points that the jump is found from.
    """

    def __init__(self, body: Body, portions: Sequence[Portion], settings: ForceSettings) -> None:
        super().__init__(body, portions, common_precision(portions, settings), "none", settings)
        self.unit, self._outside = 1.0, settings.outside or OUTSIDE
        self._prepare()
        bonds, self._watches = body.bonds, []
        owners = self.portion_of[np.repeat(np.arange(len(body)), np.diff(bonds.pointers).astype(np.int64))]
        self._pairs_of, self._seen, geometries = [], [], []
        for number, portion in enumerate(portions):
            weights = np.bincount(bonds.pair_of, self.bond_shares * (owners == number), self._n_pairs)
            pairs = np.flatnonzero(weights)
            self._pairs_of.append(pairs)
            self._add_states(pairs)
            geometries.append(pair_geometry(body, pairs, weights[pairs], self.geometry_precision))
            self._watches.append(DomainWatch(portion.model, int(self._counted[pairs].sum()), self._outside, "energy", "energy", body.share))
            ends = bonds.first[pairs], bonds.second[pairs]
            across = [np.flatnonzero(self.portion_of[end] != number) for end in ends]
            self._seen.append([(other, end[other]) for other, end in zip(across, ends, strict=True)])
        self._parts = self._bind_parts(owners, geometries)
        total, d = len(body.all_points), body.dimension
        self._forces, self._moments = aligned_rows((self._n_pairs, d), self.precision), aligned_rows((self._n_pairs, d * d), self.precision)
        self._seen_forces, self._seen_moments = np.zeros((total, d)), np.zeros((total, d * d))
        self._own_sums = self.sums_of(self._forces, self._moments, self._on_jumps)

    @abstractmethod
    def _bind_parts(self, owners: np.ndarray, geometries: list[np.ndarray]) -> Sequence[EnergyOfSomePairs]:
        """For every portion the pass over its pairs, bound to the points as it sees them.

        Parameters
        ----------
        owners : ndarray of int, shape (n_bonds,)
            Which of the portions the point of every directed bond is of.
        geometries : list of ndarray
            `pair_geometry` of the pairs of every portion.
        """

    def _share(self, rows: np.ndarray, numbers: np.ndarray, strength: np.ndarray) -> None:
        strength = strength[numbers]
        strength[self._kinematics.interfaces.left_out] = 0.0
        super()._share(rows, np.arange(len(numbers), dtype=numbers.dtype), strength)

    def _form(self) -> None:
        self.form_views()

    def pair_forces(self, pairs: np.ndarray | None = None) -> np.ndarray:
        forces, bonds, left = super().pair_forces(pairs), self.body.bonds, self._kinematics.interfaces.one_sided_bonds
        if left is None:
            return forces
        numbers, owners, changes = left
        d, rows = self.body.dimension, np.triu_indices(self.body.dimension)
        # The moments of the points as they were before their shapes weighed them.
        points, places = np.unique(owners, return_inverse=True)
        shapes = np.zeros((len(points), d, d))
        shapes[:, rows[0], rows[1]] = shapes[:, rows[1], rows[0]] = self._kinematics.inverse_shape[points]
        moments = matrices(self._stresses[points]) @ np.linalg.inv(shapes) * self.body.volumes[points, None, None]
        pulls = np.einsum("bij,bj->bi", moments[places], changes)
        pulls[bonds.first[bonds.pair_of[numbers]] != owners] *= -1
        changed = np.stack([np.bincount(bonds.pair_of[numbers], pull, self._n_pairs) for pull in pulls.T], axis=1)
        if len(self.body.ghosts):
            outer, mirrored = self._mirrored_pairs
            parity = self.body.ghosts.parity[bonds.second[outer] - len(self.body)]
            changed[outer] -= parity * changed[mirrored]
        return forces + (changed if pairs is None else changed[pairs])

    def forces_beside_pairs(self) -> np.ndarray:
        return self._kinematics.interfaces.on_jumps

    def _on_jumps(self, moments: np.ndarray) -> np.ndarray:
        """Forces on the points from what the energy says about the jumps at interfaces."""
        return self._kinematics.interfaces.hand_on(self._seen_forces, self._seen_moments, moments)

    def _add_parts(self, out: np.ndarray) -> int:
        """Energy, and the sums of what the parts have last found to the points; the number of points without a force."""
        self._forces[:] = self._moments[:] = 0.0
        self._seen_forces[:] = self._seen_moments[:] = 0.0
        self._energy = 0.0
        for part, pairs, seen, portion in zip(self._parts, self._pairs_of, self._seen, self.portions, strict=True):
            unit = portion.law.shear_modulus
            self._energy += unit * part.energy
            self._forces[pairs] += unit * part.forces[: len(pairs)]
            self._moments[pairs] += unit * part.moments[: len(pairs)]
            for sign, (some, others) in zip((1.0, -1.0), seen, strict=True):
                np.add.at(self._seen_forces, others, sign * unit * part.forces[some])
                np.add.at(self._seen_moments, others, unit * part.moments[some])
        return self._own_sums(out)

    @property
    def pairs_evaluated(self) -> int:
        return sum(int(self._counted[pairs].sum()) for pairs in self._pairs_of)

    def _laws_of(self, pair: int) -> list[Law]:
        return [portion.law for portion, pairs in zip(self.portions, self._pairs_of, strict=True) if pair in pairs]


class BondEnergyOfPortions(EnergyOfPortions):
    """All of the energy at the bonds, theory (56)."""

    def _bind_parts(self, owners: np.ndarray, geometries: list[np.ndarray]) -> list[PairEnergies]:
        parts = []
        for portion, states, geometry in zip(self.portions, self.states, geometries, strict=True):
            view, how = states.view, (self.precision, self._outside, self._kinematics, states.response)
            arrays = view.positions, view.gradients, view.first, view.second, geometry
            parts.append(PairEnergies(portion.model, portion.law, *how, *arrays))
        return parts

    def pass_bonds(self, out: np.ndarray) -> tuple[list[int], int, int]:
        outside = [part() for part in self._parts]
        return outside, sum(part.invalid for part in self._parts), self._add_parts(out)


class SelectiveEnergyOfPortions(EnergyOfPortions):
    """The selective energy of several materials, theory (57): isochoric at the bonds, volumetric at the points.

    A point's dilatation is the mean over its bonds as its own material sees them, smoothed among the points of that material: the pressure
    jumps at an interface.
    """

    # As in `SelectiveEnergyEvaluation`.
    geometry_precision = "float64"

    def _bind_parts(self, owners: np.ndarray, geometries: list[np.ndarray]) -> list[SelectivePairs]:
        body, bonds, kinematics = self.body, self.body.bonds, self._kinematics
        # The pressure jumps: a point's neighbours are those of its own material.
        within = self.portion_of[bonds.first] == self.portion_of[bonds.second]
        self._smoothing = Smoothing(body, (self.bond_weights > 0) & within)
        self._dilatations, self._smoothed, self._slopes, self._pressures = np.ones((4, len(body)))
        self._shown_pressures = []
        # Det F_ij of all parts, and of every directed bond where among them its point's own material has it.
        starts = np.cumsum([0, *(len(states.view.first) for states in self.states)])
        volumes, places, parts = np.ones(starts[-1]), np.zeros(len(owners), dtype=np.uint32), []
        of_portions = zip(self.portions, self._pairs_of, self.states, geometries, strict=True)
        for number, (portion, pairs, states, geometry) in enumerate(of_portions):
            own, place = owners == number, np.zeros(self._n_pairs, dtype=np.uint32)
            place[pairs] = starts[number] + np.arange(len(pairs))
            places[own] = place[bonds.pair_of[own]]
            view, pressures = states.view, np.zeros(len(states.view.numbers))
            # Of the points alone: other materials and images have no share.
            shown = np.flatnonzero((self.portion_of[view.numbers] == number) & (view.numbers < len(body)))
            self._shown_pressures.append((pressures, shown, view.numbers[shown]))
            arrays = view.positions, view.gradients, pressures, view.first, view.second, geometry
            isochoric = portion.model.isochoric_energy(portion.law, self.plane, self._outside, self.precision)
            part = SelectivePairs(isochoric, kinematics, *arrays, volumes[starts[number] : starts[number + 1]])
            part.share(np.arange(len(pairs)), kinematics, pairs, self.bond_shares * own)
            parts.append(part)
        self._find_dilatations = selective_energy.means_over_bonds.bind(
            bonds.pointers, places, self.bond_shares, volumes, 1.0, self._dilatations, chunks=kinematics.chunks
        )
        self._smooth_dilatations = self._smoothing.bind(self._dilatations, self._smoothed, kinematics.chunks)
        # As in `SelectiveEnergyEvaluation`; slopes may be in units of each material's own modulus, for none reach another.
        self._spread_slopes = self._smoothing.bind(self._slopes, self._pressures, kinematics.chunks)
        return parts

    def pass_bonds(self, out: np.ndarray) -> tuple[list[int], int, int]:
        invalid, part_of_body = self._form_volumes(), self.body.share
        if part_of_body.any(invalid):
            return [0] * len(self._parts), invalid, 0
        energies = np.zeros(len(self.body))
        with np.errstate(all="ignore"):  # what is not finite shows in the energy
            for law, points in self.laws:
                U, self._slopes[points], _ = law.volumetric(self._smoothed[points], law.parameters)
                energies[points] = law.shear_modulus * U
        self._spread_slopes()
        part_of_body.fill(self._pressures)
        for part, (pressures, shown, numbers) in zip(self._parts, self._shown_pressures, strict=True):
            pressures[shown] = self._pressures[numbers]
            part.find_energies()
        without_force = self._add_parts(out)
        self._energy += float(sum_in_order(part_of_body.counted(self.body.volumes) * energies))
        return [part.count_outside() for part in self._parts], 0, without_force

    def _form_volumes(self) -> int:
        """Bring the smoothed dilatations up to date with the gradients last formed; the number of pairs turned inside out."""
        invalid = sum(part.find_volumes() for part in self._parts)
        self._find_dilatations()
        self.body.share.fill(self._dilatations)
        self._smooth_dilatations()
        self.body.share.fill(self._smoothed)
        return invalid

    def bulk_stresses(self) -> np.ndarray:
        return self._smoothing.matrix() @ super().bulk_stresses()

    def volume_ratios(self) -> np.ndarray:
        self.form_views()
        self.body.share.agree(InvalidState(self._diagnose()) if self._form_volumes() else None)
        return np.where(self.portion_of[: len(self.body)] < len(self.portions), self._smoothed, 1.0)
