"""Volumetric part of a selective energy: a function of the smoothed dilatations of the points, theory (48)-(52).

At K = 1000 mu an energy evaluated only at the bonds locks: every bond would have to keep its volume, which are more conditions than the
body has degrees of freedom. The mean over the bonds of a point is one condition per point.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..engine.block_arrays import BLOCK
from ..kernels import selective_energy
from ..materials.response import volume_energy_block
from .bond_shares import BondShares
from .dilatation import LinearisedDilatation
from .pair_passes import SelectivePairs
from .smoothing import Smoothing
from .steps import Steps
from .term import Binding


class VolumeEnergy:
    """Sum of V_i U(J_i), whose forces act through the pressures of the pairs (`SelectivePairs`).

    J_i is the mean of det F_ij over the bonds of a point in the motion of its own material, smoothed over its nearest neighbours of that
    material, so that the pressure can jump at an interface. The mean alone is exact in homogeneous states, but its pressure is rough;
    det F_i alone leads to a pressure that alternates in sign from point to point.

    Parameters
    ----------
    binding : Binding
    shares : BondShares
    parts : sequence of SelectivePairs
        Pairs of every material.
    volumes : ndarray
        det F_ij of the pairs of all parts, one part after the other.

    Attributes
    ----------
    smoothing : Smoothing
    dilatations : ndarray, shape (n,)
        J_i in the state last evaluated.
    steps : list
        Steps that find the pressures of the pairs and the energies from the dilatations.
    """

    def __init__(self, binding: Binding, shares: BondShares, parts: Sequence[SelectivePairs], volumes: np.ndarray) -> None:
        self._binding, self._shares, self._parts = binding, shares, parts
        body, chunks, n = binding.kinematics.body, binding.kinematics.chunks, len(binding.kinematics.body)
        bonds, breakable = body.bonds, binding.settings.breakable
        carries = shares.carrying(breakable)
        if not binding.whole:
            carries &= binding.portion_of[bonds.first] == binding.portion_of[bonds.second]
        self.smoothing = Smoothing(body, carries, breakable)
        means, self.dilatations, self._slopes = np.ones(n), np.ones(n), np.zeros(n)
        shares_of_bonds = bonds.pointers, self._places(), shares.bond_shares
        find_means = selective_energy.means_over_bonds.bind(*shares_of_bonds, volumes, 1.0, means, chunks=chunks)
        smooth = self.smoothing.bind(means, self.dilatations, chunks)
        # Points in the halo have bonds, and therefore neighbours, that this rank does not have.
        self._find = Steps(body.share, *(part.find_volumes for part in parts), find_means, means, smooth, self.dilatations)

        counted, passes, self._own = body.volumes * body.share.own, [], []
        for part in parts:
            numbers = part.points.own[1]
            # If all points are of one material, these are views of the arrays of all points.
            ratios, slopes = self.dilatations[numbers], self._slopes[numbers]
            part.volume_energies = np.zeros(-(-len(ratios) // BLOCK))
            law = volume_energy_block(part.points.law).address, part.points.parameters, part.buffers
            arrays = ratios, counted[numbers], *law, part.volume_energies, slopes
            passes.append(selective_energy.volume_energies.bind(*arrays, chunks=chunks))
            self._own.append((part, numbers, ratios, slopes))
        # The transpose of the smoothing of U' acts on the bonds of the points, and V_i W_ij is symmetric. Slopes may be in units of each
        # material's own modulus, for none reach another. Ghosts' volumes lie beyond the body: they have no pressure, and no share.
        self._pressures = parts[0].pressures if binding.whole else np.zeros(n)
        spread = self.smoothing.bind(self._slopes, self._pressures, chunks), self._pressures[:n]
        self.steps = [*passes, *spread] if binding.whole else [self._take, *passes, self._give, *spread, self._show]

    def _places(self) -> np.ndarray:
        """Return, for every directed bond, the index of its det F_ij in its point's own material among the volumes of all parts."""
        binding, bonds, start = self._binding, self._binding.kinematics.body.bonds, 0
        if binding.whole:
            return bonds.pair_of
        owners, places = binding.portion_of[binding.kinematics.owners()], np.zeros(len(bonds.pair_of), dtype=np.uint32)
        for number, part in enumerate(self._parts):
            place = np.zeros(len(bonds.first), dtype=np.uint32)
            place[part.points.pairs] = start + np.arange(len(part.points.pairs))
            places[owners == number] = place[bonds.pair_of[owners == number]]
            start += len(part.points.first)
        return places

    def _take(self) -> None:
        """Copy the dilatations of each material's points."""
        for _, numbers, ratios, _ in self._own:
            ratios[:] = self.dilatations[numbers]

    def _give(self) -> None:
        """Copy the slopes of U of each material's points back."""
        for _, numbers, _, slopes in self._own:
            self._slopes[numbers] = slopes

    def _show(self) -> None:
        """Copy the pressures to the points of each material; other materials and images have none."""
        for part, numbers, *_ in self._own:
            part.pressures[part.points.own[0]] = self._pressures[numbers]

    def find_dilatations(self) -> int:
        """Bring the dilatations up to date with the gradients; return the number of pairs turned inside out."""
        return sum(self._find()[: len(self._parts)])

    def renew(self, pairs: np.ndarray) -> None:
        """Update shares and smoothing of a body of one material after a change of the weights of given pairs."""
        self._shares.fill_end_shares(self._parts[0].end_shares, pairs, pairs)
        self.smoothing.renew(self._shares.carrying(self._binding.settings.breakable), pairs)

    def linearised(self) -> LinearisedDilatation:
        """Return the derivative of the dilatations of a body of one material by the positions."""
        return LinearisedDilatation(self._binding, self._shares, self.smoothing, self.dilatations, self._parts[0])
