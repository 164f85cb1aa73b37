"""The dilatation of the points of a selective energy, linearised: what a solver needs to know of a great bulk modulus."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..kernels import selective_energy
from ..kernels.block_arrays import BLOCK, aligned_rows

if TYPE_CHECKING:
    from .kinematics import Kinematics
    from .selective_energy import SelectiveEnergyEvaluation, SelectivePairs, Smoothing


class LinearisedDilatation:
    """How the smoothed dilatations of the points change with the positions, D, and the transpose of that (theory (58)).

    Parameters
    ----------
    force : SelectiveEnergyEvaluation
        Whose bonds, shares and sums it takes; what is broken there is broken here.
    kinematics : Kinematics
    smoothing : Smoothing
    dilatations : ndarray, shape (n,)
        Smoothed, as last evaluated.
    pairs : SelectivePairs

    Attributes
    ----------
    stiffness : ndarray, shape (n,)
        C, of the points against a change of their dilatation, V_i mu U''.
    """

    def __init__(
        self,
        force: SelectiveEnergyEvaluation,
        kinematics: Kinematics,
        smoothing: Smoothing,
        dilatations: np.ndarray,
        pairs: SelectivePairs,
    ) -> None:
        body, bonds = force.body, force.body.bonds
        self._body, self._law, self._unit, self._dilatations = body, force.law, force.unit, dilatations
        self._gradient_ghosts, chunks, d, n, total = (
            kinematics.gradient_ghosts,
            kinematics.chunks,
            body.dimension,
            len(body),
            len(body.all_points),
        )
        first, second = bonds.ends_in_blocks(BLOCK)
        # Single precision would do, but for kernels that would be compiled once more.
        self._derivatives = aligned_rows((len(force.geometry), selective_energy.change_rows(d), BLOCK))
        self._displacements, self._gradients = np.zeros((total, d)), aligned_rows((total, d * d))
        self._changes, self._means, self._smoothed, self._pressures = np.zeros(len(first)), np.zeros(n), np.zeros(n), np.zeros(total)
        forces, moments = aligned_rows((len(first), d)), aligned_rows((len(first), d * d))
        self._form_gradients = kinematics.gradient_pass(self._displacements, self._gradients, 0.0)
        self._linearise = selective_energy.volume_derivatives[d].bind(
            kinematics.positions, kinematics.gradients, first, second, force.geometry, pairs.buffers, self._derivatives, chunks=chunks
        )
        self._find_changes = selective_energy.volume_changes[d].bind(
            self._displacements, self._gradients, first, second, self._derivatives, pairs.buffers, self._changes, chunks=chunks
        )
        self._find_means = selective_energy.means_over_bonds.bind(
            bonds.pointers, bonds.pair_of, force.bond_shares, self._changes, 0.0, self._means, chunks=chunks
        )
        self._smooth_means = smoothing.bind(self._means, self._smoothed, chunks)
        self._smooth_pressures = smoothing.bind(self._means, self._pressures, chunks)
        self._find_parts = selective_energy.pressure_parts[d].bind(
            self._pressures, first, second, pairs.end_shares, self._derivatives, forces, moments, chunks=chunks
        )
        self._to_points = force.sums_of(forces, moments)
        self.stiffness = np.zeros(n)

    def take(self) -> None:
        """Linearise in the state last evaluated."""
        self._linearise()
        self.stiffness[:] = self._unit * self._body.volumes * self._law.volumetric(self._dilatations, self._law.parameters)[2]

    def changes(self, displacements: np.ndarray) -> np.ndarray:
        """D u, shape (n,), of displacements (n, d); costs about a quarter of a force evaluation."""
        self._displacements[: len(displacements)] = displacements
        self._body.ghosts.fill_displacements(self._displacements)
        self._form_gradients()
        self._gradient_ghosts.fill_changes(self._gradients)
        self._find_changes()
        self._find_means()
        self._smooth_means()
        return self._smoothed.copy()

    def forces(self, values: np.ndarray) -> np.ndarray:
        """D^T s, shape (n, d), of values (n,) at the points; costs less than half of a force evaluation."""
        # The smoothing is its own transpose by volumes.
        np.divide(values, self._body.volumes, out=self._means)
        self._smooth_pressures()
        self._find_parts()
        out = np.empty_like(self._body.points)
        self._to_points(out)
        out *= -1 / self._unit
        return out

    def smooth(self, values: np.ndarray) -> np.ndarray:
        """W s, shape (n,), of values (n,) at the points."""
        self._means[:] = values
        self._smooth_means()
        return self._smoothed.copy()
