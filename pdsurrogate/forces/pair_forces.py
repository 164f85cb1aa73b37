"""Forces of the pairs of one material, with the compiled pass that computes them."""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..body.alike import vectors_between
from ..body.bonds import SLAB
from ..engine.block_arrays import BLOCK, aligned_rows
from ..engine.passes import BoundPass
from ..engine.threads import Chunks
from ..kernels import bond_force, reference_state, surrogate_thickness
from ..kernels.bond_force import LEAST_NORMAL_STRETCH, lateral_stretch
from ..materials import Law
from ..materials.response import volume_residual_block
from .binding import Binding
from .compiled_force import CompiledBondForce
from .domain import EVERYWHERE, Domain
from .material_points import MaterialPoints
from .pair_passes import Pairs
from .settings import OUTSIDE_POLICIES
from .steps import Step

THICKNESS_TOLERANCE = {"float32": 1e-6, "float64": 1e-9}
"""Relative step of the volume ratio J3 at which the iteration for the thickness ends, by precision
of the bond forces: a few times the error of J3 that rounding in the forces causes at K = 10 mu.
"""


class BondStates(NamedTuple):
    """States of n bonds, in vectors of length n.

    The components of the stretch tensor U along the undeformed bond (n) and across it (m) are ``a``
    = U_nn and ``b`` = U_nm (theory (10)); ``length`` is the undeformed length divided by the
    horizon, ``C33`` the squared thickness stretch, and ``J`` is det F in the plane.
    """

    a: np.ndarray
    b: np.ndarray
    length: np.ndarray
    C33: np.ndarray
    J: np.ndarray

    @property
    def has_stretch_tensor(self) -> np.ndarray:
        """Flags of the bonds that have a stretch tensor (U_nn > `LEAST_NORMAL_STRETCH`): those
        turned by less than a right angle.
        """
        return self.a > LEAST_NORMAL_STRETCH

    @property
    def stretches(self) -> np.ndarray:
        """Principal stretches of the bonds in the plane, the greater first, shape (n, 2)."""
        trace = self.a**2 + 2 * self.b**2 + lateral_stretch(self.a, self.b, self.J) ** 2
        total = np.sqrt(trace + 2 * self.J)
        difference = np.sqrt(np.maximum(trace - 2 * self.J, 0))
        return np.stack([total + difference, total - difference], axis=1) / 2


class PairForces(Pairs):
    """Forces of the pairs (undirected bonds) of one material, with their arrays and the compiled
    pass that computes them.

    Parameters
    ----------
    binding : Binding
    model : ForceSurrogate
    points : MaterialPoints
    strength : callable
        Returns `pdsurrogate.body.alike.pair_strength` of pairs of the body.
    correction : str
        Correction of incomplete horizons, see `ForceSettings`.

    Attributes
    ----------
    forces : ndarray, shape (n_blocks * BLOCK, 2)
        Forces of the pairs on their first points, in units of `unit`.
    geometry : ndarray, shape (k, 4 to 6, BLOCK)
        Reference vectors of the pairs in blocks, see
        `pdsurrogate.kernels.reference_state.pair_rows`.
    rows : ndarray of uint32, shape (n_blocks,)
        Row of each block in `geometry`.
    find : Step
        Compiled pass that finds the forces and counts the pairs outside the model's domain; or
        `evaluate` for a model without compiled code.
    learns_thickness : bool
        Whether the volume ratios J3 of the points are computed with the model, since the law is
        costly to evaluate.
    """

    def __init__(
        self, binding: Binding, model, points: MaterialPoints, strength: Callable, correction: str
    ) -> None:
        law = points.law
        kinematics = binding.kinematics
        precision = binding.precision
        plane = binding.settings.plane
        body = kinematics.body
        super().__init__(model, points)
        self.forces = aligned_rows((len(points.first), 2), precision)
        self._kinematics = kinematics
        self._precision = precision
        self._binding = binding
        compiled = model.compiled(precision)
        self._weights = compiled.weights
        if plane == "strain" and not compiled.asks_law:
            compiled = in_plane_strain(compiled, law, precision)
        divided = body.share.divided
        rows = bond_force.COUNTED_ROW + 1 if divided else 5 if compiled.needs_length else 4
        self.rows = points.rows
        pairs, places = points.stored
        self.geometry = aligned_rows((int(self.rows.max()) + 1, rows, BLOCK), precision)
        if divided:
            counted = body.share.own[body.bonds.first[pairs]]
            self.geometry[places // BLOCK, bond_force.COUNTED_ROW, places % BLOCK] = counted
        self.find_geometry(pairs, places, strength, correction)
        self.learns_thickness = (
            law.costly and model.domain is not None and model.gives_transverse and plane == "stress"
        )
        if self.learns_thickness:
            points.state_pass = surrogate_states(
                points, compiled, model.domain, precision, kinematics.chunks
            )
        self._compiled = compiled

    @cached_property
    def find(self) -> Step:
        points = self.points
        model = self.model
        kinematics = self._kinematics
        binding = self._binding
        compiled = self._compiled
        precision = self._precision
        threads = kinematics.chunks.threads
        guard = bond_force.UNGUARDED if model.domain is None else OUTSIDE_POLICIES[binding.outside]
        domain = (
            EVERYWHERE if model.domain is None or binding.outside == "extrapolate" else model.domain
        )
        within = domain.interior if binding.outside == "fallback" else domain
        limits = np.stack([domain.limits(precision), within.limits(precision)])
        pairs = (points.first, points.second), self.geometry, self.rows
        arrays = points.positions, points.records, pairs
        force = (
            compiled.address,
            bond_force.analytic_bond_force(precision).address,
            compiled.constants(points),
            guard,
            limits,
        )
        buffers = aligned_rows((threads, bond_force.BUFFER_ROWS, BLOCK), precision)
        memory = buffers, compiled.memory(threads, precision), kinematics.scratch
        return (
            kinematics.bind(bond_force.pair_forces, *arrays, *force, memory, self.forces)
            if compiled.address
            else self.evaluate
        )

    def set_parameters(self, model) -> None:
        super().set_parameters(model)
        self._weights[:] = model.compiled(self._precision).weights

    def find_geometry(
        self, pairs: np.ndarray, places: np.ndarray, strength: Callable, correction: str
    ) -> None:
        """Compute the rows of `geometry` for some `pairs` of the body, in their `places`;
        ``strength(pairs)`` returns `pair_strength`.
        """
        kinematics = self._kinematics
        body = self._kinematics.body
        shapes = kinematics.inverse_shape, kinematics.supported
        rule = reference_state.CORRECTIONS[correction], body.kappa, body.horizon
        for start in range(0, len(pairs), SLAB):
            part = slice(start, start + SLAB)
            some = pairs[part]
            ends = body.bonds.first[some], body.bonds.second[some]
            given = places[part], *ends, vectors_between(body, *ends), strength(some)
            reference_state.pair_rows(*given, *shapes, *rule, self.geometry)

    def separate(self, pairs: np.ndarray) -> None:
        """Give the blocks of some `pairs` rows of their own, before `find` is used."""
        if len(self.geometry) < len(self.rows):
            blocks = np.unique(pairs // BLOCK)
            rows = np.append(np.arange(len(self.geometry)), self.rows[blocks])
            geometry = aligned_rows((len(rows), *self.geometry.shape[1:]), self._precision)
            geometry[:] = self.geometry[rows]
            self.geometry = geometry
            self.rows = self.rows.copy()
            self.rows[blocks] = np.arange(len(rows) - len(blocks), len(rows))

    def states(self) -> tuple[np.ndarray, BondStates, np.ndarray]:
        """Return, in a body of one material, the numbers of the pairs that carry a force, their
        `BondStates`, and their undeformed directions, turned with the material and divided by the
        length, shape (2, k).
        """
        body = self._kinematics.body
        records = self.points.records
        self.points.find()
        pairs = np.flatnonzero(self.geometry[self.rows, 2].ravel()[: len(body.bonds.first)])
        first = body.bonds.first[pairs]
        second = body.bonds.second[pairs]
        x, between = (
            (at[second] - at[first]).T for at in (body.all_points, self._kinematics.positions)
        )
        length = np.hypot(*x)
        cos, sin, J, C33 = (records[first].astype(float) + records[second]).T
        turned = np.stack([cos * x[0] - sin * x[1], sin * x[0] + cos * x[1]])
        n1, n2 = turned = turned / (np.hypot(cos, sin) * length**2)
        a = n1 * between[0] + n2 * between[1]
        b = n1 * between[1] - n2 * between[0]
        return pairs, BondStates(a, b, length / body.horizon, C33 / 2, J / 2), turned

    def evaluate(self) -> None:
        """Find `forces` in NumPy, for all pairs at once."""
        pairs, states, (n1, n2) = self.states()
        T_nn, T_nm, T_mm = self.model.tractions(states)
        _, _, normal, tilt, *_ = self.geometry[self.rows[pairs // BLOCK], :, pairs % BLOCK].T
        along = normal * T_nn + tilt * T_nm
        across = normal * T_nm + tilt * T_mm
        self.forces[:] = 0.0
        self.forces[pairs] = np.stack([n1 * along - n2 * across, n2 * along + n1 * across], axis=1)

    def reference_vectors(self) -> np.ndarray:
        """Return the reference vectors (theory (21)) of the pairs, shape (n_pairs, 2), in `forces`,
        which an evaluation overwrites.
        """
        n1, n2, along, across = self.geometry[:, :4].transpose(1, 0, 2)
        found = np.stack([n1 * along - n2 * across, n2 * along + n1 * across], axis=-1)
        np.take(
            found, self.rows, axis=0, out=self.forces.reshape(-1, *found.shape[1:]), mode="clip"
        )
        return self.forces

    def add(self, pairs: np.ndarray, changes: np.ndarray) -> None:
        """Add `changes` (k, 2) to the reference vectors of some `pairs` that carry force."""
        block = self.rows[pairs // BLOCK]
        lane = pairs % BLOCK
        n1, n2, along = self.geometry[block, :3, lane].T.astype(float)
        one, other = changes.T
        factors = np.where(
            along == 0, 0.0, [n1 * one + n2 * other, n1 * other - n2 * one] / (n1**2 + n2**2)
        )
        self.geometry[block, 2:4, lane] += factors.T


def surrogate_states(
    points: MaterialPoints,
    compiled: CompiledBondForce,
    domain: Domain,
    precision: str,
    chunks: Chunks,
) -> BoundPass:
    """Return the compiled pass that finds J3 and `MaterialPoints.records` with a learned force, and
    counts the points without a state.

    The learned force `compiled` must provide the stress component T_mm across a bond. The law of
    the points determines the states of points outside `domain`.
    """
    limits = np.stack([domain.limits("float64"), domain.interior.limits("float64")])
    tolerance = THICKNESS_TOLERANCE[precision]
    volumetric = volume_residual_block(points.law)
    force = volumetric.address, compiled.address, compiled.constants(points), limits, tolerance
    buffers = aligned_rows((chunks.threads, surrogate_thickness.BUFFER_ROWS, BLOCK), precision, 1)
    scratch = aligned_rows((chunks.threads, surrogate_thickness.SCRATCH_ROWS, BLOCK), value=1)
    memory = (buffers, compiled.memory(chunks.threads, precision), scratch)
    states = (
        points.gradients,
        points.volume_ratios,
    )
    return surrogate_thickness.surrogate_node_states.bind(
        *states, *force, memory, points.records, chunks=chunks
    )


def in_plane_strain(compiled: CompiledBondForce, law: Law, dtype) -> CompiledBondForce:
    """Return the compiled bond force for plane strain: a force learned under plane stress plus a
    pressure (theory (47)).

    The learned force must provide the stress component T_mm across a bond. The only function of the
    law that is evaluated is the derivative of its volumetric energy U, so that an expensive law
    adds no cost.
    """
    addresses = [compiled.address, volume_residual_block(law).address]
    return replace(
        compiled,
        address=bond_force.plane_strain_bond_force(dtype).address,
        sizes=np.concatenate([addresses, compiled.sizes]),
    )
