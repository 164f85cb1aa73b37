"""Base classes of the terms of the internal force, and the classes for the state that terms keep
between evaluations.
"""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..body import Body
from ..engine.passes import BoundPass
from ..errors import InvalidState, OutsideDomain, OutsideDomainWarning
from ..materials import PLANES
from .binding import Binding, MaterialPart
from .errors import locate
from .kinematics import Kinematics
from .material_points import MaterialPoints, have_states
from .steps import Step, Steps
from .volume_energy import VolumeEnergy


@dataclass(frozen=True)
class StateArray:
    """Array that a force keeps from one evaluation to the next, such as volume ratios.

    Checkpoints save such arrays, ranks divide them, and results may show them.

    Attributes
    ----------
    name : str
    rows : {"points", "images", "bonds", "pairs"}
        Kind of its rows: one for every point, every point and image, every directed bond, or every
        pair.
    values : ndarray
        Changed in place.
    shown : bool
        Whether results show the array as a field on the points; values of bonds and pairs are
        averaged over the bonds of a point.
    """

    name: str
    rows: str
    values: np.ndarray
    shown: bool = False

    def at_points(self, body: Body) -> np.ndarray:
        """Return one value for every point, shape (n, ...); values of bonds and pairs are
        averaged over a point's bonds (0 if none).
        """
        if self.rows in ("points", "images"):
            return self.values[: len(body)]
        counts = np.diff(body.bonds.pointers).astype(np.int64)
        values = (
            self.values[: counts.sum()] if self.rows == "bonds" else self.values[body.bonds.pair_of]
        )
        found = np.zeros((len(body), *values.shape[1:]))
        np.add.at(found, np.repeat(np.arange(len(body)), counts), values)
        return (found.T / np.maximum(counts, 1)).T


@dataclass(frozen=True)
class Kept:
    """Declaration of a `StateArray` with history by a term: kind, shape, type and initial value
    of a row, and whether results show it.
    """

    name: str
    rows: str
    shape: tuple[int, ...] = ()
    dtype: str = "float64"
    at_rest: float = 0.0
    shown: bool = False

    def allocate(self, body: Body) -> StateArray:
        """Return a new `StateArray` with a row for each point, bond or pair of a body, as
        declared, and the initial value everywhere.
        """
        bonds = body.bonds
        sizes = {
            "points": len(body),
            "images": len(body.all_points),
            "bonds": int(bonds.pointers[-1]),
            "pairs": len(bonds.first),
        }
        return StateArray(
            self.name,
            self.rows,
            np.full((sizes[self.rows], *self.shape), self.at_rest, self.dtype),
            self.shown,
        )


class Passes(NamedTuple):
    """Passes of a term in a body on one rank."""

    find: tuple[BoundPass, ...]
    """Those of an evaluation."""

    of_planes: tuple[BoundPass, np.ndarray] | None = None
    """Pass that computes `Term.forces_of_planes`, and the array (planes, d) that receives them."""


class Term(ABC):
    """Base class of the terms of an internal force, bound to a body and its materials: each
    computes forces on the points.

    A term derives from this class, or from `MaterialTerm` if laws of materials determine the states
    of its points, and declares its properties in class attributes.

    Attributes
    ----------
    needs_gradients : bool
        Whether the term needs the deformation gradients of the points.
    keeps : tuple of Kept
        Declarations of the arrays with the history of the term, which `accept` alone changes;
        `kept` holds the arrays by name.
    has_energy : bool
        Whether the forces are minus the derivative of an energy.
    zero_energy_modes : bool
        Whether the force does not resist some displacements that alternate from point to point.
    volume : VolumeEnergy or None
        Volumetric energy of the points; None if they have none of their own.
    learned_thickness : bool
        Whether the volume ratios J3 of the points are computed with a learned force, and not by the
        law.
    places : bool
        Whether `find` begins with the steps of `Kinematics.steps`, which place the points and form
        their gradients.
    settles : bool
        Whether the first evaluation of a step determines something for the whole step (`settle`).
    correction : str
        Correction of incomplete horizons.
    state : list of StateArray
        Arrays that the next evaluation starts from, apart from positions and broken bonds.
    materials : list of MaterialPoints
        Points of each material, with the points of other materials that are bonded to them.
    memories : list of PairMemory
        Histories of the materials with branches or softening.
    watches : list of OutsideCounter
        Counters of the pairs outside the domain of each model.
    """

    needs_gradients: ClassVar[bool] = True
    keeps: ClassVar[tuple[Kept, ...]] = ()
    has_energy: ClassVar[bool] = False
    zero_energy_modes: ClassVar[bool] = False
    volume: VolumeEnergy | None = None
    learned_thickness = places = settles = False
    correction = "none"

    def __init__(self, binding: Binding) -> None:
        self.binding, self.kinematics, self.body = (
            binding,
            binding.kinematics,
            binding.kinematics.body,
        )
        self.state = [kept.allocate(self.body) for kept in self.keeps]
        self.kept = {array.name: array.values for array in self.state}
        self.memories: list = []
        self.materials: list[MaterialPoints] = []
        self.watches: list[OutsideCounter] = []

    def set_parameters(self, portions: Sequence[MaterialPart]) -> None:
        """Replace laws and models in place by others of the same kinds, on the same points, that
        differ in numbers alone.

        A term that copies numbers of laws or models overrides it.
        """
        self.binding = replace(self.binding, portions=portions)

    @abstractmethod
    def find(self, out: np.ndarray) -> None:
        """Evaluate the term at the positions in `kinematics`: write the forces on the points, shape
        (n, d), to `out`.

        Any evaluation is a trial: the forces follow from the positions, from the history of the
        state last accepted, and from `Kinematics.elapsed`, the time since then. Each of `watches`
        receives the number of pairs found outside its model's domain.

        Raises
        ------
        InvalidState
            If the deformation has no force; the message names a point.
        """

    def passes(self, out: np.ndarray) -> Passes | None:
        """Return the passes that `find` runs for forces in `out`, if it does nothing else where no
        pass returns a count.
        """
        return None

    @abstractmethod
    def pass_bonds(self, out: np.ndarray) -> object:
        """Write the forces to `out` from the states of the points as last computed, without checks.

        Timings use it, and the computation of the energy that breaking bonds release.
        """

    @abstractmethod
    def pair_forces(self, pairs: np.ndarray) -> np.ndarray:
        """Return the force on the first point of given pairs in the state last evaluated, shape
        (k, d).
        """

    @abstractmethod
    def stress_and_energy(self) -> tuple[np.ndarray, np.ndarray]:
        """Return what the term adds to stress and energy density of the points, see
        `InternalForce.stress_and_energy`.
        """

    def elapse(self) -> None:  # noqa: B027 - most terms have no history
        """Take notice that `Kinematics.elapsed` has been set, or the history has been restored."""

    def settle(self) -> bool:
        """Determine anew, at the positions, what the first evaluation since `elapse` has determined
        for the whole step; return whether forces have changed.

        Terms that `settle` must override it.
        """
        raise NotImplementedError

    def accept(self, elapsed: float) -> None:  # noqa: B027 - most terms have no history
        """Add to the history the state at the positions in `kinematics`, reached in a time
        `elapsed` since the state accepted before.
        """

    def break_bonds(self, pairs: np.ndarray, changed: np.ndarray) -> None:
        """Remove broken `pairs` from the term; `changed` are all pairs that this affects, as
        `Kinematics.break_bonds` returns them.

        Terms of models that honor `ForceSettings.breakable` must override it.
        """
        raise NotImplementedError

    def forces_of_planes(self) -> np.ndarray:
        """Return the forces of reflection planes, see `InternalForce.forces_of_planes`: by default
        the sums of the forces of the bonds that cross them.
        """
        return sums_by_plane(self.kinematics, self._pulls_across())

    def levers_on_planes(self) -> np.ndarray:
        """Return first moments of the forces of reflection planes, see
        `InternalForce.levers_on_planes`: by default bonds act on planes at their middles.
        """
        kinematics = self.kinematics
        bonds, _, _ = kinematics.crossing
        middles = (
            kinematics.positions[self.body.bonds.first[bonds]]
            + kinematics.positions[self.body.bonds.second[bonds]]
        ) / 2
        return sums_by_plane(kinematics, self._pulls_across()[:, :, None] * middles[:, None])

    def _pulls_across(self) -> np.ndarray:
        """Return the parts of the forces of bonds across planes that act on these, (k, d)."""
        bonds, shares, _ = self.kinematics.crossing
        return self.pair_forces(bonds) * shares

    def mean_stress(self) -> np.ndarray:
        """Return the volume mean of the first Piola-Kirchhoff stress, shape (d, d): (1/V) sum of f
        (x) x over the bonds.

        f is the force and x the reference vector of a bond; half of a bond with a ghost lies within
        the body. The stress is work-conjugate to the mean deformation gradient.
        """
        bonds = self.body.bonds
        points = self.body.all_points
        found = 0.0
        for part in bonds.slabs():
            first, second = bonds.first[part], bonds.second[part]
            share = np.where(second < len(self.body), 1.0, 0.5) * self.body.share.own[first]
            forces = self.pair_forces(np.arange(part.start, part.stop))
            vectors = points[second] - points[first]
            found += np.einsum("b,bi,bj->ij", share, forces, vectors)
        return found / whole_volume(self.body)

    def energy(self) -> float:
        """Return the stored energy in the state last evaluated, NaN if it is undefined there;
        TypeError for a term without energy.
        """
        raise TypeError(f"{type(self).__name__} has no energy")

    def stored(self) -> float:
        """Return the energy stored at the positions last evaluated, for a term with memory in the
        history last accepted: without what a step dissipates, which `energy` may contain.
        """
        return self.energy()

    def dissipated(self) -> dict[str, float]:
        """Return what accepted states have dissipated since the body was at rest, by its cause,
        "branches" or "softening", on this rank; it follows from the history alone.
        """
        return {}

    def released_by(self, motion: np.ndarray) -> float | None:
        """Return the energy released by a motion of the undeformed points, see `released_by` of
        `internal_force`; None without energy.
        """
        return None

    def collapsed_pairs(self) -> np.ndarray:
        """Return the indices of the pairs that were nearly or fully turned inside out in the last
        evaluation.

        The array is empty unless a subclass looks for such pairs.
        """
        return np.empty(0, dtype=np.int64)

    def domain_deviation(self) -> np.ndarray | None:
        """Return how far the points are beyond the domain of the model (`Domain.deviation`),
        shape (n,); None if it has no domain.
        """
        return None

    def beyond_data(self) -> np.ndarray | None:
        """Return how far states are beyond the test data (`Domain.beyond_data`): those of bonds for
        a bond force, of points for an energy.

        Each bond or point is counted on one rank only. None if the model has no hull of test data.
        """
        return None


class MaterialTerm(Term):
    """Base class of terms whose forces follow from the states of the points by the laws of their
    materials.

    A term derives from this class and binds its steps in `bind_steps`. A term whose forces need
    more than these steps overrides `find` and `pass_bonds`.

    Attributes
    ----------
    parts : sequence
        Pairs of each material, for terms that have forces of pairs.
    in_units : list of tuple
        Passes with an argument ``unit``, each after the number of the material whose shear modulus
        it is.
    """

    def __init__(self, binding: Binding) -> None:
        super().__init__(binding)
        self.in_units: list[tuple[int, BoundPass]] = []
        self.parts: Sequence = ()

    def set_parameters(self, portions: Sequence[MaterialPart]) -> None:
        super().set_parameters(portions)
        for points, portion in zip(self.materials, portions, strict=True):
            points.set_parameters(portion.law)
        for number, bound in self.in_units:
            bound.give_number("unit", portions[number].law.shear_modulus)

    def points_of(self, number: int, pairs: np.ndarray | None = None) -> MaterialPoints:
        """Return the points of material `number` and the points bonded to them by given pairs;
        their J3 become part of `state`.
        """
        binding = self.binding
        own, end = (None, "") if binding.whole else (binding.portion_of == number, f"_{number}")
        points = MaterialPoints(
            self.kinematics,
            binding.portions[number].law,
            binding.precision,
            binding.settings.rotation,
            own,
            pairs,
        )
        self.materials.append(points)
        of_term = f"_of_term_{binding.number}" if binding.number else ""
        self.state.append(StateArray(f"volume_ratios{end}{of_term}", "images", points.kept_ratios))
        return points

    _find_forces: Callable[[], list[int]]

    def bind_steps(self, *steps: Step) -> None:
        """Set the steps that compute the forces from the states of the points.

        The first must be passes that return the number of pairs outside a model's domain, one for
        each of `watches` in their order. The last must be the pass that writes the forces on the
        points to its argument `out`, and returns how many of them are not finite.
        """
        share = self.body.share
        states = [step for points in self.materials for step in points.steps]
        leading = [] if self.binding.number else self.kinematics.steps()
        self.places = bool(leading)
        self._leading = sum(isinstance(step, BoundPass) for step in leading)
        self._sum = steps[-1]
        self._find_forces = Steps(share, *steps)
        self._find_all = Steps(share, *leading, *states, *steps)

    def find(self, out: np.ndarray) -> None:
        """Write the forces on the points to `out`, as for `Term`.

        A term that `places` begins by setting points and ghosts to the positions that `kinematics`
        has taken and by forming gradients.
        """
        self._sum.give("out", out)
        found = self._find_all()
        self.kinematics.formed |= self.places
        counts = have_states(self.materials, found[self._leading :])
        for watch in self.watches:
            watch.found = counts.pop(0)
        if counts[-1]:
            raise InvalidState(self.diagnose(out))

    def passes(self, out: np.ndarray) -> Passes | None:
        self._sum.give("out", out)
        found = self._find_all.passes
        return None if found is None else Passes(found)

    def pass_bonds(self, out: np.ndarray) -> object:
        self._sum.give("out", out)
        self._find_forces()

    def diagnose(self, out: np.ndarray) -> str:
        """Return an error message that names a point whose force in `out` is not finite."""
        return locate(self.body, out, "the force on it is not finite")

    def volume_ratios(self) -> np.ndarray:
        """Return the volume ratios J3 of the points, shape (n,); 1 for rigid points."""
        found = np.ones(len(self.body))
        for points in self.materials:
            points.find()
            places, numbers = points.own
            found[numbers] = points.volume_ratios[places]
        return found

    def _bulk_stresses(self) -> np.ndarray:
        """Return the derivative U' of the volumetric energy at the points, in units of mu, shape
        (n,).
        """
        found = np.zeros(len(self.body))
        J3 = self.volume_ratios()
        for portion in self.binding.portions:
            found[portion.points] = portion.law.volumetric(
                J3[portion.points], portion.law.parameters
            )[1]
        return found

    def stress_and_energy(self) -> tuple[np.ndarray, np.ndarray]:
        """Return stress and energy density of the points by their laws, at the volume ratios and
        bulk stresses that the force uses.

        See `InternalForce.stress_and_energy`.
        """
        n = len(self.body)
        plane = self.kinematics.plane
        F = self.kinematics.deformation_gradients()
        J3 = self.volume_ratios()
        bulk = None if plane == "stress" else self._bulk_stresses()
        stress = np.zeros((n, 3, 3))
        energy = np.zeros(n)  # rigid points have no law
        for portion in self.binding.portions:
            at = portion.points
            states = F[at], J3[at], None if bulk is None else bulk[at]
            stress[at], energy[at] = PLANES[plane].stress_and_energy(portion.law, *states)
        return stress, energy


class OutsideCounter:
    """Counter of the pairs outside the training domain of a model; according to the policy it
    raises an error or warns.

    Parameters
    ----------
    binding : Binding
    model : ForceModel
    points : MaterialPoints
        Points whose pairs the model evaluates.
    quantity, stand_in : str
        Names, for messages, of the quantity that the model computes and of its replacement outside
        the domain.

    Attributes
    ----------
    bounded : bool
        Whether the model has a domain.
    n_pairs : int
        Number of pairs in one evaluation of the model.
    found : int
        Number of pairs outside the domain in the last evaluation.
    """

    def __init__(
        self, binding: Binding, model: Any, points: MaterialPoints, quantity: str, stand_in: str
    ) -> None:
        body = binding.kinematics.body
        self._policy = binding.outside
        self._model = model
        self._names = (quantity, stand_in)
        self.bounded = model.domain is not None
        self._share = body.share
        self.n_pairs = int(np.count_nonzero(body.share.own[body.bonds.first[points.pairs]]))
        self.found = 0
        self._warned = False

    def settle(self) -> None:
        """Apply the policy (error, warning or nothing) to the number of pairs found, once all ranks
        have evaluated.

        Raises
        ------
        OutsideDomain
            If a pair is outside, and the policy is "raise".
        """
        found = self._share.total(self.found) if self._policy in ("raise", "warn") else 0
        if not found:
            return
        quantity, stand_in = self._names
        what = (
            f"{found} of {self._share.total(self.n_pairs)} bonds are outside the domain of"
            f" {self._model.name}, {self._model.domain}"
        )
        if self._policy == "raise":
            raise OutsideDomain(
                f"{what}; with outside=fallback the exact {stand_in} is used for them"
            )
        if not self._warned:
            self._warned = True
            warnings.warn(
                f"{what}: the {quantity} of these bonds is extrapolated",
                OutsideDomainWarning,
                stacklevel=3,
            )


def sums_by_plane(kinematics: Kinematics, values: np.ndarray) -> np.ndarray:
    """Return for each reflection plane the sum of values (k, ...) of the bonds across it."""
    ends = kinematics.crossing[2]
    return np.array([values[start:end].sum(axis=0) for start, end in pairwise(ends)]).reshape(
        -1, *values.shape[1:]
    )


def whole_volume(body: Body) -> float:
    """Return the volume of the whole body, also if `body` is the part of one rank."""
    return body.share.total(float((body.volumes * body.share.own).sum()))
