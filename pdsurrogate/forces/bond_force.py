"""Force models that map quantities of a bond to its force, and the term that they make."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from ..body import Body
from ..engine.block_arrays import BLOCK, aligned_rows
from ..kernels import bond_force, reference_state
from ..kernels.analytic import analytic_bond_force
from ..kernels.bond_state import LEAST_NORMAL_STRETCH, lateral_stretch
from ..kernels.sums import sum_pair_forces
from ..materials import SHEETS, Law
from ..materials.stretches import principal_stretches
from .errors import InvalidState, at_point, locate
from .kinematics import matrices
from .material_points import MaterialPoints, have_states
from .plane_strain import in_plane_strain
from .protocol import EVERYWHERE, CompiledBondForce, Domain, ForceModel
from .settings import OUTSIDE_POLICIES, PRECISIONS, ROTATIONS
from .steps import Steps
from .surrogate_thickness import SurrogateThickness
from .term import Binding, DomainWatch, Learnt, Term


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
    """The bond pass of one material over its pairs, bound to its arrays.

    Parameters
    ----------
    binding : Binding
    number : int
        Number of the material.
    points : MaterialPoints

    Attributes
    ----------
    geometry : ndarray, shape (n_blocks, 4 to 6, BLOCK)
        Reference vectors of the pairs, see `pdsurrogate.kernels.reference_state.pair_rows`.
    forces : ndarray, shape (n_blocks * BLOCK, 2)
        Dimensionless force on the first point of every pair.
    find : BoundPass
        Pass that finds `forces` and counts the pairs outside the model's domain.
    unit : float
        Shear modulus of the material.
    """

    def __init__(self, binding: Binding, number: int, points: MaterialPoints) -> None:
        model, law = binding.portions[number].model, points.law
        precision, outside, chunks = binding.precision, binding.outside, binding.kinematics.chunks
        body, plane = binding.body, binding.settings.plane
        self.model, self.points, self.unit, blocks = model, points, law.shear_modulus, len(points.first) // BLOCK
        self._compiled = compiled = model.compiled(precision)
        if plane == "strain" and not compiled.asks_law:
            self._compiled = compiled = in_plane_strain(compiled, law, precision)
        if not body.share.divided:
            self.geometry = aligned_rows((blocks, 5 if compiled.needs_length else 4, BLOCK), precision)
        else:
            counted = body.share.own[body.bonds.first[points.pairs]]
            self.geometry = aligned_rows((blocks, bond_force.COUNTED_ROW + 1, BLOCK), precision)
            numbers = np.arange(len(counted))
            self.geometry[numbers // BLOCK, bond_force.COUNTED_ROW, numbers % BLOCK] = counted
        self.learns_thickness = law.costly and model.domain is not None and model.gives_transverse and plane == "stress"
        if self.learns_thickness:
            points.surrogate_thickness = SurrogateThickness(compiled, model.domain, law, precision, chunks)
        guard = OUTSIDE_POLICIES[outside] if model.domain is not None else bond_force.UNGUARDED
        domain = EVERYWHERE if model.domain is None or outside == "extrapolate" else model.domain
        within = domain.interior if outside == "fallback" else domain
        self.forces = aligned_rows((len(points.first), 2), precision)
        self._exact = analytic_bond_force(precision)
        self.find = bond_force.pair_forces.bind(
            points.positions,
            points.records,
            points.first,
            points.second,
            self.geometry,
            compiled.address,
            compiled.sizes,
            compiled.weights,
            self._exact.address,
            points.response.address,
            points.parameters,
            guard,
            np.stack([domain.limits(precision), within.limits(precision)]),
            aligned_rows((chunks.threads, bond_force.BUFFER_ROWS, BLOCK), precision),
            aligned_rows((chunks.threads, max(compiled.work_rows, 1), BLOCK), precision),
            binding.kinematics.scratch,
            self.forces,
            chunks=chunks,
        )

    def find_geometry(self, binding: Binding, correction: str, pairs: np.ndarray, strength: np.ndarray) -> None:
        """Compute the geometry of some of these pairs from the strengths of all, see `pair_strength`."""
        kinematics, points, body = binding.kinematics, self.points, binding.body
        reference_state.pair_rows(
            pairs,
            points.first,
            points.second,
            body.all_points[points.numbers],
            strength,
            kinematics.inverse_shape[points.numbers],
            kinematics.supported[points.numbers],
            reference_state.CORRECTIONS[correction],
            body.kappa,
            body.horizon,
            self.geometry,
        )


class BondForces(Term):
    """Forces of the bonds, each a function of the states of its ends, theory (55): passes over points and pairs, and the sum to points.

    A pair within a material has its bond force. Of a pair across an interface each of the two materials gives half: what its model and its
    law make of the bond and of both ends. So the forces on the two ends are opposite.
    """

    def __init__(self, binding: Binding) -> None:
        super().__init__(binding)
        body, bonds, kinematics, models = self.body, self.body.bonds, self.kinematics, [portion.model for portion in binding.portions]
        self.correction = binding.settings.correction or ("tensor" if all(model.gives_transverse for model in models) else "scalar")
        if models[0].members and binding.settings.plane == "strain":
            name = models[0].name
            raise ValueError(f"{name} tells the deviation of its members under plane stress; fit it with --energy for other planes")
        strength, self._parts = pair_strength(body), []
        if not binding.whole:
            strength *= np.where(binding.portion_of[bonds.first] == binding.portion_of[bonds.second], 1.0, 0.5)
        for number, model in enumerate(models):
            points = binding.points_of(number, binding.pairs_of(number))
            part, own = PairForces(binding, number, points), strength[points.pairs]
            part.find_geometry(binding, self.correction, np.arange(len(own), dtype=np.uint32), own)
            self.materials.append(points)
            self._parts.append(part)
            n_pairs = binding.count(points.pairs)
            self.watches.append(DomainWatch(model, n_pairs, binding.outside, "force", "bond force", body.share))
        self.learnt_thickness = any(part.learns_thickness for part in self._parts)
        self._strength = strength if binding.settings.breakable else None
        if binding.whole:
            self._forces, self._unit, collect = self._parts[0].forces, self._parts[0].unit, []
            self.learnt = LearntBonds(self, models[0], self._parts[0])
        else:
            self._forces, self._unit, collect = aligned_rows((len(bonds.first), 2), binding.precision), 1.0, [self._collect]
        sums = self._forces, bonds.pair_pointers, bonds.incidence_pointers, bonds.incidence
        self._sum = sum_pair_forces[2].bind(*sums, self._unit, np.empty_like(body.points), chunks=kinematics.chunks)
        steps = [*(part.find for part in self._parts), *collect, self._sum]
        self._find_forces = Steps(body.share, *steps)
        self._find_all = Steps(body.share, *(step for points in self.materials for step in points.steps), *steps)

    def _collect(self) -> None:
        """Add up the forces of all materials on the pairs."""
        self._forces[:] = 0.0
        for part in self._parts:
            pairs = part.points.pairs
            self._forces[pairs] += part.unit * part.forces[: len(pairs)]

    def find(self, out: np.ndarray) -> None:
        self._sum.give("out", out)
        *counts, without_force = self._find_all()
        self.report(have_states(self.materials, counts))
        if without_force:
            raise InvalidState(self._diagnose(out))

    def pass_bonds(self, out: np.ndarray) -> None:
        self._sum.give("out", out)
        self._find_forces()

    def _diagnose(self, out: np.ndarray) -> str:
        """Return a message that says which pair has no finite force, or else which point."""
        body = self.body
        broken = np.flatnonzero(~np.isfinite(self._forces[: len(body.bonds.first)]).all(axis=1))
        if len(broken) == 0:
            return locate(body, out, "the force on it is not finite")
        i, j = int(body.bonds.first[broken[0]]), int(body.bonds.second[broken[0]])
        positions, points = self.kinematics.positions, body.all_points
        stretch = np.linalg.norm(positions[j] - positions[i]) / np.linalg.norm(points[j] - points[i])
        J = np.linalg.det(matrices(self.kinematics.gradients[[i, j]])).mean()
        x1, x2 = points[j]
        law = max((portion.law for portion in self.binding.portions), key=lambda law: law.shear_modulus)
        what = f"its bond to ({x1:.4g}, {x2:.4g}), stretched {stretch:.3g} times in a horizon of det F = {J:.3g}, has no finite force"
        return at_point(body, i, f"{what}: that is beyond the limit of {law.name}")

    def break_bonds(self, pairs: np.ndarray, changed: np.ndarray) -> None:
        self._strength[pairs] = 0.0
        self._parts[0].find_geometry(self.binding, self.correction, changed, self._strength)

    def pair_forces(self, pairs: np.ndarray | slice) -> np.ndarray:
        return self._unit * self._forces[pairs].astype(float)


class LearntBonds(Learnt):
    """How far the bonds of a body of one material are from what its model has learnt."""

    def __init__(self, term: BondForces, model: ForceSurrogate, part: PairForces) -> None:
        self._term, self._model, self._part = term, model, part

    def domain_deviation(self) -> np.ndarray | None:
        term = self._term
        if self._model.domain is None:
            return None
        return self._model.domain.deviation(principal_stretches(term.kinematics.deformation_gradients()), term.volume_ratios() ** 2)

    def beyond_data(self) -> np.ndarray | None:
        if self._model.domain is None or self._model.domain.hull is None:
            return None
        pairs, states = self.bonds()
        counted = self._term.body.share.own[self._term.body.bonds.first]
        # A bond turned past a right angle has no stretch tensor, and is left out.
        chosen = states.has_stretch_tensor & counted[pairs]
        return self._model.domain.beyond_data(states.stretches[chosen])

    def member_deviation(self) -> np.ndarray | None:
        if not self._model.members:
            return None
        law, body, (pairs, states) = self._part.points.law, self._term.body, self.bonds()
        found, of_points = self._model.member_deviations(law, states), np.zeros(len(body))
        for ends in (body.bonds.first[pairs], body.bonds.second[pairs]):
            own = ends < len(body)
            np.maximum.at(of_points, ends[own], found[own])
        return law.shear_modulus * of_points

    def bonds(self) -> tuple[np.ndarray, BondStates]:
        """Return the numbers of the pairs that carry a force, and their states as the bond pass finds them."""
        kinematics, body, part = self._term.kinematics, self._term.body, self._part
        bonds, points = body.bonds, body.all_points
        part.points.find()
        pairs = np.flatnonzero(part.geometry[:, 2].ravel()[: len(bonds.first)] > 0)
        first, second = bonds.first[pairs], bonds.second[pairs]
        vectors, between = points[second] - points[first], kinematics.positions[second] - kinematics.positions[first]
        length = np.linalg.norm(vectors, axis=1)
        cos, sin, J, C33 = (part.points.records[first].astype(float) + part.points.records[second]).T
        turn = np.hypot(cos, sin)
        n1 = (cos * vectors[:, 0] - sin * vectors[:, 1]) / turn
        n2 = (sin * vectors[:, 0] + cos * vectors[:, 1]) / turn
        a = (n1 * between[:, 0] + n2 * between[:, 1]) / length**2
        b = (n1 * between[:, 1] - n2 * between[:, 0]) / length**2
        return pairs, BondStates(a, b, length / body.horizon, C33 / 2, J / 2)


def pair_strength(body: Body) -> np.ndarray:
    """Return 2 w l V_i V_j of every pair, see `pdsurrogate.kernels.reference_state.pair_rows`."""
    bonds, volumes = body.bonds, body.all_volumes
    length = np.linalg.norm(body.all_points[bonds.second] - body.all_points[bonds.first], axis=1)
    return 2 * body.weigh(length) * length * volumes[bonds.first] * volumes[bonds.second]


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
    >>> isinstance(model, pds.forces.ForceSurrogate)
    True
    """

    family = "bond force"
    several_materials = ("stress",)
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

    def terms(self, plane: str) -> tuple[type[Term], ...]:
        return (BondForces,)

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
        """Return the block function of the same map for the bond pass, in the given precision."""

    def member_deviations(self, law: Law, states: BondStates) -> np.ndarray:
        """Return the greatest deviation of the members' bond force from this model's, in units of the shear modulus, shape (n,)."""
        raise NotImplementedError
