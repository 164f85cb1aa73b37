"""Energies and forces of the pairs (undirected bonds) of one material, with the compiled passes
that compute them.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..engine.block_arrays import BLOCK, aligned_rows
from ..engine.passes import BoundPass
from ..kernels import bond_energy, selective_energy
from ..kernels.bond_force import FALL_BACK, UNGUARDED
from ..kernels.energy_density import analytic_energy_density
from ..kernels.steps import count_infinite, count_positive
from ..kernels.sums import sum_at_points
from .binding import Binding
from .bond_shares import BondShares
from .domain import EVERYWHERE
from .material_points import MaterialPoints
from .walks import each_pair, walk_over


class EnergyDerivatives(NamedTuple):
    """Plane-stress energy and its derivatives by tr C and J = det F in the plane, dimensionless,
    arrays of one shape.
    """

    psi: np.ndarray
    by_trace: np.ndarray
    by_area: np.ndarray
    by_trace_trace: np.ndarray
    by_trace_area: np.ndarray
    by_area_area: np.ndarray


def bond_gradients(means: np.ndarray, along: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Return the deformation gradients of pairs (k, d, d), theory (27), from the means of those of
    both ends, the deformed bond vectors over the undeformed lengths, and the directions (k, d).
    """
    return means + (along - np.einsum("bij,bj->bi", means, n))[:, :, None] * n[:, None]


class Pairs:
    """Base class for the pairs (undirected bonds) of one material.

    Parameters
    ----------
    model : ForceModel
    points : MaterialPoints
    """

    def __init__(self, model, points: MaterialPoints) -> None:
        self.model = model
        self.points = points

    @property
    def unit(self) -> float:
        """Shear modulus of the material."""
        return self.points.law.shear_modulus

    def set_parameters(self, model) -> None:
        """Replace the model by one of the same kind with other numbers, after `points` have
        taken those of the law.
        """
        self.model = model


class PairsWithEnergy(Pairs):
    """Base class for the pairs of one material with their energies, and the sums of their forces
    and moments.

    Parameters
    ----------
    binding : Binding
    model : ForceModel
    points : MaterialPoints
    geometry : ndarray
        See `BondShares.geometry`.

    Attributes
    ----------
    walk : Walk
        Receives sums of forces and moments, derivatives of the pairs' energies by the deformation
        gradient of either end, in units of `unit`; see
        `pdsurrogate.kernels.bond_energy.pair_energies`.
    energies : ndarray, shape (v,)
        Sums of the energies of the pairs of each visit, divided by the shear modulus.
    steps : list of BoundPass
        Compiled passes that compute energies, forces and moments; the last one does.
    memory : PairMemory or None
        Branches and softening of the material; None if it is elastic.
    """

    steps: list[BoundPass]
    memory: Any = None

    def __init__(
        self, binding: Binding, model, points: MaterialPoints, geometry: np.ndarray
    ) -> None:
        super().__init__(model, points)
        self.geometry = geometry
        self._kinematics = binding.kinematics
        self.walk, self._rows = walk_over(binding.kinematics, points)
        self.places = (points.positions, points.gradients)
        self.pairs = (points.first, points.second), geometry, points.rows
        self.energies = np.zeros(len(self.walk.blocks))

    def sum_to(self, moments: np.ndarray, forces: np.ndarray) -> BoundPass:
        """Return the pass that writes the sums of moments and forces of the pairs, times `unit`, to
        the rows of the points.
        """
        arrays = self.walk.sums, *self._rows, float(self.unit), moments, forces
        return self._kinematics.bind(sum_at_points[forces.shape[1]], *arrays)

    def each(self, places: np.ndarray) -> np.ndarray:
        """Return the moments and forces of the pairs at some places, shape (k, d d + d), in the
        state last evaluated.
        """
        found = each_pair(self.steps[-1], places)
        self.counts()  # of the evaluation alone
        found *= self.unit
        return found

    def counts(self) -> tuple[int, int, int]:
        """Return the numbers of pairs outside the model's domain, of pairs with det F_ij below
        `COLLAPSED`, and of pairs inside out.
        """
        raise NotImplementedError

    def set_parameters(self, model) -> None:
        super().set_parameters(model)
        if self.memory is not None:
            self.memory.set_parameters()

    def energy(self) -> float:
        """Return the total energy of the material's pairs in the state last evaluated, divided
        by the shear modulus.
        """
        return float(self.energies.sum())

    def checks(self, bind: Callable) -> list[BoundPass]:
        """Return passes that return a count where the energy in the state last evaluated is not
        finite, or a pair has collapsed.
        """
        return [bind(count_infinite, self.energies)]

    def stored(self) -> float:
        """Return the stored energy in the state last evaluated, divided by the shear modulus;
        `energy` is that of which the forces are the derivative.
        """
        return self.energy() if self.memory is None else self.memory.stored()


class PairEnergies(PairsWithEnergy):
    """Pairs of one material in a sheet under plane stress, whose whole energy a compiled pass
    computes.

    Parameters
    ----------
    binding : Binding
    shares : BondShares
    model : EnergySurrogate
    points : MaterialPoints
    own : ndarray of bool, shape (n_bonds,), or None
        Directed bonds of the material's points; None if these are all.

    Attributes
    ----------
    count_rows : ndarray of int, shape (n_chunks, 3)
        Counts of the chunks, see `counts`.
    """

    def __init__(
        self,
        binding: Binding,
        shares: BondShares,
        model,
        points: MaterialPoints,
        own: np.ndarray | None,
    ) -> None:
        kinematics = binding.kinematics
        precision = binding.precision
        domain = model.domain
        super().__init__(binding, model, points, shares.geometry(points, own, precision))
        compiled = model.compiled(precision)
        threads = kinematics.chunks.threads
        self._weights = compiled.weights
        self._precision = precision
        guard = (
            {"fallback": FALL_BACK, "extrapolate": UNGUARDED}.get(
                binding.outside, bond_energy.COUNTED
            )
            if domain
            else UNGUARDED
        )
        self.count_rows = np.zeros((kinematics.chunks.number, 3), dtype=np.int64)
        if points.law.memory:
            return  # a `SheetMemory` has the passes
        limits = (domain or EVERYWHERE).limits(precision)
        energy = (
            compiled.address,
            analytic_energy_density(precision).address,
            compiled.constants(points),
            guard,
            limits,
        )
        buffers = (
            aligned_rows((threads, bond_energy.BUFFER_ROWS, BLOCK), precision),
            aligned_rows((threads, 4, BLOCK)),
        )
        memory = *buffers, compiled.memory(threads, precision), kinematics.scratch
        results = self.count_rows, self.energies, self.walk
        bound = kinematics.bind(
            bond_energy.pair_energies, *self.places, self.pairs, *energy, memory, results
        )
        self.steps = [bound]

    def set_parameters(self, model) -> None:
        super().set_parameters(model)
        self._weights[:] = model.compiled(self._precision).weights

    def checks(self, bind: Callable) -> list[BoundPass]:
        return [*super().checks(bind), bind(count_positive, self.count_rows)]

    def counts(self) -> tuple[int, int, int]:
        return tuple(self.count_rows.sum(axis=0).tolist())


class SelectivePairs(PairsWithEnergy):
    """Pairs of one material with a selective energy: isochoric energy at the pairs, volumetric
    energy at the points.

    Compiled passes find the volume ratios of the pairs, and the forces of the isochoric energy and
    of the points' pressures. Energies and forces of the pairs may be in single precision. Volume
    ratios are in double, since a pressure has K/mu times their error.

    Parameters
    ----------
    binding, shares, model, points, own
        See `PairEnergies`; the model has an `isochoric_energy`.
    volumes : ndarray, shape (n_blocks * BLOCK,)
        Array that receives det F_ij of the pairs.

    Attributes
    ----------
    pressures : ndarray, shape (k,)
        Pressures of the material's points, in units of the shear modulus; their work is pressure
        times a share of the point's volume times the change of det F_ij of a pair.
    buffers : ndarray
        Working memory in doubles.
    volume_energies : ndarray
        Volumetric energies of blocks of the material's points, divided by the shear modulus
        (`VolumeEnergy`).
    end_shares : ndarray, shape (k, 2, BLOCK)
        Shares of the volumes of both ends, in the rows of `geometry`, see
        `BondShares.fill_end_shares`.
    find_volumes : BoundPass
        Pass that returns the number of pairs turned inside out.
    """

    def __init__(
        self,
        binding: Binding,
        shares: BondShares,
        model,
        points: MaterialPoints,
        own: np.ndarray | None,
        volumes: np.ndarray,
    ) -> None:
        dimension = points.positions.shape[1]
        chunks = binding.kinematics.chunks
        self.isochoric = isochoric = model.isochoric_energy(
            points.law, binding.settings.plane, binding.outside, binding.precision
        )
        # the volumes are computed from this array
        geometry = shares.geometry(points, own, "float64")
        super().__init__(binding, model, points, geometry)
        self.pressures = np.zeros(len(points.positions))
        self.volume_energies = np.zeros(0)
        self.volumes = volumes
        self.end_shares = aligned_rows((len(geometry), 2, BLOCK))
        pairs, places = points.stored
        shares.fill_end_shares(self.end_shares, places, pairs, own)
        self.buffers = aligned_rows(
            (chunks.threads, selective_energy.buffer_rows(dimension), BLOCK), value=1
        )
        self.find_volumes = binding.kinematics.bind(
            selective_energy.pair_volumes[dimension],
            *self.places,
            self.pairs,
            self.buffers,
            volumes,
        )
        if points.law.memory:
            return  # a `PairMemory` has the pass
        memory = (
            self.buffers
            if isochoric.precision == "float64"
            else aligned_rows(self.buffers.shape, isochoric.precision, 1)
        )
        shares_and_energy = (self.end_shares, *isochoric.arguments)
        results = self.energies, self.walk
        bound = binding.kinematics.bind(
            selective_energy.pair_energies[dimension],
            *self.places,
            self.pressures,
            self.pairs,
            *shares_and_energy,
            memory,
            results,
        )
        self.steps = [bound]

    def set_parameters(self, model) -> None:
        self.isochoric.parameters[:] = self.points.law.parameters
        self.isochoric.weights[:] = model.isochoric_weights
        super().set_parameters(model)

    def energy(self) -> float:
        return super().energy() + float(self.volume_energies.sum())

    def stored(self) -> float:
        volumetric = 0.0 if self.memory is None else float(self.volume_energies.sum())
        return super().stored() + volumetric

    def checks(self, bind: Callable) -> list[BoundPass]:
        return [*super().checks(bind), bind(count_infinite, self.volume_energies)]

    def counts(self) -> tuple[int, int, int]:
        """Return the number of pairs outside the domain since the last call, and two zeros:
        `find_volumes` counts pairs inside out.
        """
        return self.isochoric.count_outside(), 0, 0
