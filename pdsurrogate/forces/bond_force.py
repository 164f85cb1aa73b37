"""Evaluation of the force models that map bond quantities to a bond force."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from ..body import Body
from ..engine.block_arrays import BLOCK, aligned_rows
from ..engine.passes import Chain
from ..engine.threads import Chunks
from ..kernels import bond_force, reference_state
from ..kernels.analytic import analytic_bond_force
from ..kernels.bond_state import LEAST_NORMAL_STRETCH, lateral_stretch
from ..kernels.sums import sum_pair_forces
from ..materials import SHEETS, Law
from .evaluation import DomainWatch, Evaluation, usual_precision
from .kinematics import Kinematics, at_point, locate
from .plane_strain import in_plane_strain
from .portions import EvaluationOfPortions, PointStates, common_precision, refuse_in_plane_strain
from .protocol import EVERYWHERE, CompiledBondForce, Domain, ForceModel, InvalidState, Portion
from .settings import OUTSIDE, OUTSIDE_POLICIES, PRECISIONS, ROTATIONS, ForceSettings
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

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.load_surrogate("neo-hookean@1")
    >>> isinstance(model, pds.ForceSurrogate)
    True
    """

    family = "bond force"
    features: tuple[str, ...]
    domain: Domain | None
    gives_transverse: bool
    default_precision: str

    @property
    def honours(self) -> Mapping[str, tuple]:
        corrections = tuple(name for name in reference_state.CORRECTIONS if self.gives_transverse or name != "tensor")
        # The pressure of plane strain is the trace of the stress, of which T_mm is a part.
        planes = SHEETS if self.gives_transverse else ("stress",)
        honours = {"precision": PRECISIONS, "correction": corrections, "rotation": tuple(ROTATIONS), "breakable": (True,), "plane": planes}
        return honours | ({} if self.domain is None else {"outside": tuple(OUTSIDE_POLICIES)})

    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> BondForceEvaluation:
        return BondForceEvaluation(self, body, law, settings)

    def evaluation_of_portions(self, body: Body, portions: Sequence[Portion], settings: ForceSettings) -> BondForceOfPortions:
        refuse_in_plane_strain(self.name, settings)
        return BondForceOfPortions(body, portions, settings)

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


@dataclass(frozen=True)
class BondStates:
    """States of bonds, vectors of one length: U_nn and U_nm of theory (10), l/horizon, C33 and J."""

    a: np.ndarray
    b: np.ndarray
    length: np.ndarray
    C33: np.ndarray
    J: np.ndarray

    @property
    def has_stretch_tensor(self) -> np.ndarray:
        """Which of them are not turned by a right angle or more, bool."""
        return self.a > LEAST_NORMAL_STRETCH

    @cached_property
    def stretches(self) -> np.ndarray:
        """Principal stretches in the plane, shape (n, 2)."""
        trace = self.a**2 + 2 * self.b**2 + lateral_stretch(self.a, self.b, self.J) ** 2
        total, difference = np.sqrt(trace + 2 * self.J), np.sqrt(np.maximum(trace - 2 * self.J, 0))
        return np.stack([total + difference, total - difference], axis=1) / 2

    def chosen(self, which) -> BondStates:
        """Some of them."""
        return BondStates(*(getattr(self, part.name)[which] for part in fields(self)))

    def quantities(self) -> tuple[np.ndarray, ...]:
        """What `ForceSurrogate.bond_force` takes."""
        return np.hypot(self.a, self.b), np.arctan2(self.b, self.a), self.length, self.C33, self.J


class PairForces:
    """The bond pass of one model over some pairs, bound to its arrays.

    Parameters
    ----------
    model : ForceSurrogate
    law : Law
    precision, outside, plane : str
        See `ForceSettings`.
    positions : ndarray, shape (k, 2)
        Of the points and images that pairs are made of.
    states : Kinematics or PointStates
        Of the same points, by the law.
    first, second : ndarray of uint32
        Ends of the pairs, filled up to whole blocks.
    chunks : Chunks
    counted : ndarray of bool, optional
        Which pairs are counted, of a body in parts.

    Attributes
    ----------
    compiled : CompiledBondForce
    geometry : ndarray, shape (n_blocks, 4 to 6, BLOCK)
        Reference vectors of the pairs, for `pdsurrogate.kernels.reference_state.pair_rows` to fill.
    forces : ndarray, shape (n_blocks * BLOCK, 2)
        Dimensionless force on the first point of every pair.
    find : BoundPass
        Which brings `forces` up to date and counts the pairs outside the model's domain.
    learns_thickness : bool
        Whether the points' J3 is found with the model, and not by the law.
    """

    def __init__(
        self,
        model: ForceSurrogate,
        law: Law,
        precision: str,
        outside: str,
        plane: str,
        positions: np.ndarray,
        states: Kinematics | PointStates,
        first: np.ndarray,
        second: np.ndarray,
        chunks: Chunks,
        counted: np.ndarray | None = None,
    ) -> None:
        blocks = len(first) // BLOCK
        compiled = model.compiled(precision)
        if plane == "strain" and not compiled.asks_law:
            compiled = in_plane_strain(compiled, law, precision)
        self.compiled = compiled
        if counted is None:
            self.geometry = aligned_rows((blocks, 5 if compiled.needs_length else 4, BLOCK), precision)
        else:
            self.geometry = aligned_rows((blocks, bond_force.COUNTED_ROW + 1, BLOCK), precision)
            numbers = np.arange(len(counted))
            self.geometry[numbers // BLOCK, bond_force.COUNTED_ROW, numbers % BLOCK] = counted
        self.learns_thickness = law.costly and model.domain is not None and model.gives_transverse and plane == "stress"
        if self.learns_thickness:
            states.surrogate_thickness = SurrogateThickness(compiled, model.domain, law, precision, chunks)
        guard = OUTSIDE_POLICIES[outside] if model.domain is not None else bond_force.UNGUARDED
        domain = EVERYWHERE if model.domain is None or outside == "extrapolate" else model.domain
        within = domain.interior if outside == "fallback" else domain
        self.forces = aligned_rows((len(first), 2), precision)
        self._exact = analytic_bond_force(precision)
        self.find = bond_force.pair_forces.bind(
            positions,
            states.records,
            first,
            second,
            self.geometry,
            compiled.address,
            compiled.sizes,
            compiled.weights,
            self._exact.address,
            states.response.address,
            states.parameters,
            guard,
            np.stack([domain.limits(precision), within.limits(precision)]),
            aligned_rows((chunks.threads, bond_force.BUFFER_ROWS, BLOCK), precision),
            aligned_rows((chunks.threads, max(compiled.work_rows, 1), BLOCK), precision),
            states.scratch,
            self.forces,
            chunks=chunks,
        )


class BondForceEvaluation(Evaluation):
    """A bond-force model bound to a body: node pass, bond pass over each pair once, and the sum to points.

    Attributes
    ----------
    model : ForceSurrogate
    outside : str
        What is done about pairs outside its domain, see `ForceSettings`.
    geometry : ndarray
        See `PairForces`.
    """

    def __init__(self, model: ForceSurrogate, body: Body, law: Law, settings: ForceSettings) -> None:
        correction = settings.correction or ("tensor" if model.gives_transverse else "scalar")
        if model.members and settings.plane == "strain":
            raise ValueError(f"{model.name} tells the deviation of its members under plane stress; fit it with --energy for other planes")
        super().__init__(body, law, usual_precision(model, settings), correction, settings)
        self.model, self.outside = model, settings.outside or OUTSIDE
        bonds, kinematics = body.bonds, self._kinematics
        first, second = bonds.ends_in_blocks(BLOCK)
        how, arrays = (self.precision, self.outside, self.plane), (kinematics.positions, kinematics, first, second)
        counted = body.share.counted_pairs(bonds.first)
        self._pairs = PairForces(model, law, *how, *arrays, kinematics.chunks, counted)
        self.learnt_thickness = self._pairs.learns_thickness
        self._watches = [DomainWatch(model, self.pairs_evaluated, self.outside, "force", "bond force", body.share)]
        self.geometry, self._forces = self._pairs.geometry, self._pairs.forces
        self._strength = pair_strength(body)
        self._find_geometry(np.arange(self._n_pairs, dtype=np.uint32))
        if not settings.breakable:
            self._strength = None
        sums = self._forces, bonds.pair_pointers, bonds.incidence_pointers, bonds.incidence
        self._sum_forces = sum_pair_forces[2].bind(*sums, law.shear_modulus, np.empty_like(body.points), chunks=kinematics.chunks)
        self._find_forces = Chain(self._pairs.find, self._sum_forces)
        self._find_all = Chain(*kinematics.state_passes, self._pairs.find, self._sum_forces)

    def evaluate(self, positions: np.ndarray, out: np.ndarray) -> None:
        kinematics = self._kinematics
        kinematics.place_and_form(positions)
        self._sum_forces.give("out", out)
        unsolved, *_, outside, without_force = self._find_all()
        kinematics.have_states(unsolved)
        self.pairs_outside += outside
        self._watches[0].report(outside)
        if without_force:
            raise InvalidState(pair_without_force(self, self._forces, out, self.law))

    def pass_bonds(self, out: np.ndarray) -> tuple[int, int]:
        """Bond pass and sum in the kinematic state last updated; the pairs outside the domain and the points without a force."""
        self._sum_forces.give("out", out)
        outside, without_force = self._find_forces()
        return outside, without_force

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

    def domain_deviation(self) -> np.ndarray | None:
        return None if self.model.domain is None else self.model.domain.deviation(self.principal_stretches(), self.volume_ratios() ** 2)

    def bonds(self) -> tuple[np.ndarray, BondStates]:
        """Numbers of the pairs that carry a force, and their states at the positions last given, as the pass over them finds them."""
        kinematics, bonds, points = self._kinematics, self.body.bonds, self.body.all_points
        kinematics.find_states()
        pairs = np.flatnonzero(self.geometry[:, 2].ravel()[: self._n_pairs] > 0)
        first, second = bonds.first[pairs], bonds.second[pairs]
        vectors, between = points[second] - points[first], kinematics.positions[second] - kinematics.positions[first]
        length = np.linalg.norm(vectors, axis=1)
        cos, sin, J, C33 = (kinematics.records[first].astype(float) + kinematics.records[second]).T
        turn = np.hypot(cos, sin)
        n1 = (cos * vectors[:, 0] - sin * vectors[:, 1]) / turn
        n2 = (sin * vectors[:, 0] + cos * vectors[:, 1]) / turn
        a = (n1 * between[:, 0] + n2 * between[:, 1]) / length**2
        b = (n1 * between[:, 1] - n2 * between[:, 0]) / length**2
        return pairs, BondStates(a, b, length / self.body.horizon, C33 / 2, J / 2)

    def beyond_data(self) -> np.ndarray | None:
        if self.model.domain is None or self.model.domain.hull is None:
            return None
        pairs, states = self.bonds()
        counted = self.body.share.counted_pairs(self.body.bonds.first)
        # One turned past a right angle has no stretch tensor, and is not told.
        chosen = states.has_stretch_tensor if counted is None else states.has_stretch_tensor & counted[pairs]
        return self.model.domain.beyond_data(states.stretches[chosen])

    def member_deviation(self) -> np.ndarray | None:
        if not self.model.members:
            return None
        from .members import bond_deviations  # of which a run without a committee has no need

        pairs, states = self.bonds()
        found, of_points = bond_deviations(self.model, self.law, states), np.zeros(len(self.body))
        for ends in (self.body.bonds.first[pairs], self.body.bonds.second[pairs]):
            own = ends < len(self.body)
            np.maximum.at(of_points, ends[own], found[own])
        return self.law.shear_modulus * of_points

    def pair_forces(self, pairs: np.ndarray | None = None) -> np.ndarray:
        return self.law.shear_modulus * self._forces[slice(self._n_pairs) if pairs is None else pairs].astype(float)


def pair_strength(body: Body) -> np.ndarray:
    """2 w l V_i V_j of every pair, see `pdsurrogate.kernels.reference_state.pair_rows`."""
    bonds, volumes = body.bonds, body.all_volumes
    length = np.linalg.norm(body.all_points[bonds.second] - body.all_points[bonds.first], axis=1)
    return 2 * body.weigh(length) * length * volumes[bonds.first] * volumes[bonds.second]


def pair_without_force(force: Evaluation, forces: np.ndarray, out: np.ndarray, law: Law) -> str:
    """Say which pair of a body has no finite force, or else which point; `law` is the one that may have ended there."""
    body = force.body
    broken = np.flatnonzero(~np.isfinite(forces[: len(body.bonds.first)]).all(axis=1))
    if len(broken) == 0:
        return locate(body, out, "the force on it is not finite")
    i, j = int(body.bonds.first[broken[0]]), int(body.bonds.second[broken[0]])
    positions, points = force.positions, body.all_points
    stretch = np.linalg.norm(positions[j] - positions[i]) / np.linalg.norm(points[j] - points[i])
    J = np.linalg.det(force.gradients_at([i, j])).mean()
    x1, x2 = points[j]
    what = f"its bond to ({x1:.4g}, {x2:.4g}), stretched {stretch:.3g} times in a horizon of det F = {J:.3g}, has no finite force"
    return at_point(body, i, f"{what}: that is beyond the limit of {law.name}")


class BondForceOfPortions(EvaluationOfPortions):
    """Bond-force models of several materials on one body, theory (55).

    A pair within a material has its bond force.  Of a pair across an interface each of the two materials gives half: what its model and its
    law make of the bond and of both ends.  So the forces on the two ends are opposite.
    """

    def __init__(self, body: Body, portions: Sequence[Portion], settings: ForceSettings) -> None:
        correction = settings.correction or ("tensor" if all(portion.model.gives_transverse for portion in portions) else "scalar")
        super().__init__(body, portions, common_precision(portions, settings), correction, settings)
        bonds, kinematics = body.bonds, self._kinematics
        outside = settings.outside or OUTSIDE
        ends = np.stack([bonds.first, bonds.second])
        owners = self.portion_of[ends]
        strength = pair_strength(body) * np.where(owners[0] == owners[1], 1.0, 0.5)
        self._parts, self._watches = [], []
        for number, portion in enumerate(portions):
            pairs = np.flatnonzero((owners == number).any(axis=0))
            states = self._add_states(pairs)
            view = states.view
            how = self.precision, outside, self.plane
            arrays, counted = (view.positions, states, view.first, view.second), self._counted[pairs] if body.share.divided else None
            part = PairForces(portion.model, portion.law, *how, *arrays, kinematics.chunks, counted)
            self.learnt_thickness |= part.learns_thickness
            reference_state.pair_rows(
                np.arange(len(pairs), dtype=np.uint32),
                view.first,
                view.second,
                body.all_points[view.numbers],
                strength[pairs],
                kinematics.inverse_shape[view.numbers],
                kinematics.supported[view.numbers],
                reference_state.CORRECTIONS[self.correction],
                body.kappa,
                body.horizon,
                part.geometry,
            )
            self._watches.append(DomainWatch(portion.model, int(self._counted[pairs].sum()), outside, "force", "bond force", body.share))
            self._parts.append((part, pairs, portion.law.shear_modulus))
        self._forces = aligned_rows((self._n_pairs, 2), self.precision)
        sums = self._forces, bonds.pair_pointers, bonds.incidence_pointers, bonds.incidence
        self._sum_forces = sum_pair_forces[2].bind(*sums, 1.0, np.empty_like(body.points), chunks=kinematics.chunks)

    def evaluate(self, positions: np.ndarray, out: np.ndarray) -> None:
        self._kinematics.place(positions)
        self.find_states()
        outside, without_force = self.pass_bonds(out)
        self.pairs_outside += sum(outside)
        for watch, found in zip(self._watches, outside, strict=True):
            watch.report(found)
        if without_force:
            raise InvalidState(pair_without_force(self, self._forces, out, self.law))

    def pass_bonds(self, out: np.ndarray) -> tuple[list[int], int]:
        """Bond passes and sum in the states last found; the pairs outside each model's domain, and the points without a force."""
        self._forces[:] = 0.0
        outside = []
        for part, pairs, unit in self._parts:
            outside.append(part.find())
            self._forces[pairs] += unit * part.forces[: len(pairs)]
        self._sum_forces.give("out", out)
        return outside, self._sum_forces()

    @property
    def pairs_evaluated(self) -> int:
        return sum(int(self._counted[pairs].sum()) for _, pairs, *_ in self._parts)

    def pair_forces(self, pairs: np.ndarray | None = None) -> np.ndarray:
        return (self._forces if pairs is None else self._forces[pairs]).astype(float)
