"""The volumetric part of a selective energy: a function of the smoothed dilatations of the points, theory (48)-(52).

At K = 1000 mu one bond after another would have to keep its volume, more conditions than a body has displacements: all of the energy at the
bonds locks. A point's mean over its bonds is one condition a point.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..engine.block_arrays import BLOCK
from ..kernels import selective_energy
from ..kernels.elementary import sum_in_order
from ..materials.response import volume_energy_block
from .bond_shares import BondShares
from .dilatation import LinearisedDilatation
from .pair_passes import SelectivePairs
from .smoothing import Smoothing
from .steps import Steps
from .term import Binding


class VolumeEnergy:
    """The sum of V_i U(J_i), whose forces act through the pressures of the pairs (`SelectivePairs`).

    J_i is the mean of det F_ij over the bonds of a point as its own material sees them, smoothed over its nearest neighbours of that
    material: the pressure jumps at an interface. The mean alone is exact in homogeneous states, but its pressure is rough; det F_i alone
    leaves a pressure that changes sign from point to point.

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
        J_i as last found.
    steps : list
        Steps that find the pressures of the pairs and the energies from the dilatations.
    """

    def __init__(self, binding: Binding, shares: BondShares, parts: Sequence[SelectivePairs], volumes: np.ndarray) -> None:
        self._binding, self._shares, self._parts = binding, shares, parts
        body, chunks, n = binding.body, binding.kinematics.chunks, len(binding.body)
        bonds, breakable, carries = body.bonds, binding.settings.breakable, shares.carrying(binding.settings.breakable)
        if not binding.whole:
            carries &= binding.portion_of[bonds.first] == binding.portion_of[bonds.second]
        self.smoothing = Smoothing(body, carries, breakable)
        means, self.dilatations, self._slopes = np.ones(n), np.ones(n), np.zeros(n)
        shares_of_bonds = bonds.pointers, self._places(), shares.bond_shares
        find_means = selective_energy.means_over_bonds.bind(*shares_of_bonds, volumes, 1.0, means, chunks=chunks)
        smooth = self.smoothing.bind(means, self.dilatations, chunks)
        # Points in the halo have bonds, and then neighbours, that are not here.
        self._find = Steps(body.share, *(part.find_volumes for part in parts), find_means, means, smooth, self.dilatations)

        counted, passes = body.volumes * body.share.own, []
        self._own, self._blocks = [], [volume_energy_block(part.points.law) for part in parts]
        for part, block in zip(parts, self._blocks, strict=True):
            numbers = part.points.own[1]
            # Views of all points' values where they are of one material.
            ratios, slopes = self.dilatations[numbers], self._slopes[numbers]
            energies = np.zeros(-(-len(ratios) // BLOCK))
            law = block.address, part.points.parameters, part.buffers
            passes.append(selective_energy.volume_energies.bind(ratios, counted[numbers], *law, energies, slopes, chunks=chunks))
            self._own.append((numbers, ratios, slopes, energies))
        # The bonds of the points feel the transpose of the smoothing of U', and V_i W_ij is symmetric. Slopes may be in units of each
        # material's own modulus, for none reach another. Ghosts' volumes lie beyond the body: they have no pressure, and no share.
        self._pressures = parts[0].pressures if binding.whole else np.zeros(n)
        spread = self.smoothing.bind(self._slopes, self._pressures, chunks), self._pressures[:n]
        self.steps = [*passes, *spread] if binding.whole else [self._take, *passes, self._give, *spread, self._show]

    def _places(self) -> np.ndarray:
        """Return where every directed bond finds, among the volumes of all parts, that which its point's own material sees."""
        binding, pair_of = self._binding, self._binding.body.bonds.pair_of
        if binding.whole:
            return pair_of
        owners, places, start = binding.portion_of[binding.kinematics.owners()], np.zeros(len(pair_of), dtype=np.uint32), 0
        for number, part in enumerate(self._parts):
            own, place, pairs = owners == number, np.zeros(len(binding.body.bonds.first), dtype=np.uint32), part.points.pairs
            place[pairs] = start + np.arange(len(pairs))
            places[own] = place[pair_of[own]]
            start += len(part.points.first)
        return places

    def _take(self) -> None:
        """Copy the dilatations of each material's points."""
        for numbers, ratios, *_ in self._own:
            ratios[:] = self.dilatations[numbers]

    def _give(self) -> None:
        """Copy the slopes of U of each material's points back."""
        for numbers, _, slopes, _ in self._own:
            self._slopes[numbers] = slopes

    def _show(self) -> None:
        """Copy the pressures to the points of each material; other materials and images have none."""
        for part in self._parts:
            places, numbers = part.points.own
            part.pressures[places] = self._pressures[numbers]

    def find_dilatations(self) -> int:
        """Bring the dilatations up to date with the gradients; return the number of pairs turned inside out."""
        return sum(self._find()[: len(self._parts)])

    def energy(self, number: int) -> float:
        """Return the volumetric energy of the points of a material, over its shear modulus."""
        return float(sum_in_order(self._own[number][-1]))

    def renew(self, pairs: np.ndarray) -> None:
        """Update shares and smoothing of a body of one material after a change of the weights of given pairs."""
        self._shares.fill_end_shares(self._parts[0].end_shares, pairs, pairs)
        self.smoothing.renew(self._shares.carrying(self._binding.settings.breakable), pairs)

    def linearised(self) -> LinearisedDilatation:
        """Return the derivative of the dilatations of a body of one material by the positions."""
        return LinearisedDilatation(self._binding, self._shares, self.smoothing, self.dilatations, self._parts[0])
