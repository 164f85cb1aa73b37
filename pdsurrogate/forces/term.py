"""What a term of the internal force is: what it needs of the points, what it adds, and which state it keeps."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..body import Body
from ..materials import PLANES
from ..ranks import Share
from .errors import InvalidState, OutsideDomain, OutsideDomainWarning, locate
from .kinematics import Kinematics
from .material_points import MaterialPoints
from .settings import OUTSIDE, ForceSettings

if TYPE_CHECKING:
    from scipy.sparse.linalg import LinearOperator

    from .dilatation import LinearisedDilatation
    from .protocol import Portion


@dataclass(frozen=True)
class StateArray:
    """An array that a bound force keeps from one evaluation to the next: in checkpoints, on ranks, and on request in results.

    Attributes
    ----------
    name : str
    rows : {"points", "images", "bonds", "pairs"}
        What it has a row for: every point, every point and image, every directed bond, or every pair.
    values : ndarray
        Changed in place.
    shown : bool
        Whether results have it as a field on the points; values of bonds and pairs as the mean over the bonds of a point.
    """

    name: str
    rows: str
    values: np.ndarray
    shown: bool = False


@dataclass(frozen=True)
class Release:
    """Stored energy that the body loses, and forces on the points, shape (n, d), that vanish, when bonds break."""

    energy: float
    forces: np.ndarray


@dataclass(frozen=True)
class Kept:
    """Declaration of a `StateArray`: what it has a row for, the shape and type of a row, and its value at rest."""

    name: str
    rows: str
    shape: tuple[int, ...] = ()
    dtype: str = "float64"
    at_rest: float = 0.0
    shown: bool = False

    def allocate(self, body: Body) -> StateArray:
        """Return the array for a body at rest."""
        bonds = body.bonds
        sizes = {"points": len(body), "images": len(body.all_points), "bonds": len(bonds.neighbours), "pairs": len(bonds.first)}
        return StateArray(self.name, self.rows, np.full((sizes[self.rows], *self.shape), self.at_rest, self.dtype), self.shown)


@dataclass(frozen=True)
class Binding:
    """A body with its materials, and the settings of the evaluation: all that a term is bound to.

    Attributes
    ----------
    kinematics : Kinematics
    portions : sequence of Portion
    settings : ForceSettings
    precision : str
        Precision of the bond pass.
    portion_of : ndarray of int, shape (n + m,), or None
        Number of the portion of every point and image, and the number of portions for rigid ones; None if all points are of one portion.
    """

    kinematics: Kinematics
    portions: Sequence[Portion]
    settings: ForceSettings
    precision: str
    portion_of: np.ndarray | None

    @property
    def body(self) -> Body:
        """Body of the kinematics."""
        return self.kinematics.body

    @property
    def outside(self) -> str:
        """What happens to pairs outside the domain of a model."""
        return self.settings.outside or OUTSIDE

    @property
    def whole(self) -> bool:
        """Whether all points are of one portion."""
        return self.portion_of is None

    def points_of(self, number: int, pairs: np.ndarray | None = None) -> MaterialPoints:
        """Return the points of a portion, and those that it sees through the given pairs of the body."""
        own = None if self.whole else self.portion_of == number
        settings = self.settings
        return MaterialPoints(self.kinematics, self.portions[number].law, self.precision, settings.rotation, own, pairs)

    def pairs_of(self, number: int) -> np.ndarray | None:
        """Return the numbers of the pairs with an end in a portion; None if these are all."""
        bonds = self.body.bonds
        return None if self.whole else np.flatnonzero((self.portion_of[np.stack([bonds.first, bonds.second])] == number).any(axis=0))

    def count(self, pairs: np.ndarray | slice) -> int:
        """Return how many of some pairs are counted on this rank."""
        first = self.body.bonds.first[pairs]
        return int(np.count_nonzero(self.body.share.own[first]))


class Term(ABC):
    """A term of the internal force, bound to a body and its materials.

    A term derives from this class, declares what it is by class attributes, and writes the forces in `pass_bonds`.

    Attributes
    ----------
    needs_gradients : bool
        Whether it needs the deformation gradients of the points; states of the points by their laws it asks for itself (`materials`).
    keeps : tuple of Kept
        Declared state, of which `kept` has the arrays by name.
    has_energy : bool
        Whether its forces are minus the derivative of an energy.
    has_tangent : bool
        Whether it has the second derivative of that energy.
    nearly_incompressible : bool
        Whether it knows how the volume of the points changes with the positions.
    zero_energy_modes : bool
        Whether there are displacements from point to point that it does not resist.
    learnt_thickness : bool
        Whether J3 of the points is found with a learnt force, and not by the law.
    correction : str
        Correction of incomplete horizons.
    materials : list of MaterialPoints
        Points as each material sees them.
    watches : list of DomainWatch
    pairs_outside : int
        Pairs outside the domains of the models, summed over evaluations; it may be set back.
    learnt : Learnt
    """

    needs_gradients: ClassVar[bool] = True
    keeps: ClassVar[tuple[Kept, ...]] = ()
    has_energy: ClassVar[bool] = False
    zero_energy_modes: ClassVar[bool] = False
    has_tangent = nearly_incompressible = learnt_thickness = False
    correction = "none"

    def __init__(self, binding: Binding) -> None:
        self.binding, self.kinematics, self.body = binding, binding.kinematics, binding.body
        self.declared = [kept.allocate(self.body) for kept in self.keeps]
        self.kept = {array.name: array.values for array in self.declared}
        self.materials: list[MaterialPoints] = []
        self.watches: list[DomainWatch] = []
        self.pairs_outside = 0
        self.learnt = Learnt()

    @property
    def state(self) -> list[StateArray]:
        """Arrays that the next evaluation starts from, apart from positions and broken bonds."""
        names = ["volume_ratios"] if self.binding.whole else [f"volume_ratios_{number}" for number in range(len(self.materials))]
        return [
            *(StateArray(name, "images", points.kept_ratios) for name, points in zip(names, self.materials, strict=True)),
            *self.declared,
        ]

    @abstractmethod
    def find(self, out: np.ndarray) -> None:
        """Write the forces on the points, shape (n, d), in the state of the kinematics.

        Raises
        ------
        InvalidState
            Where the state has no force; names a point.
        """

    @abstractmethod
    def pass_bonds(self, out: np.ndarray) -> object:
        """Write the forces in the states of the points last found, without looking at them; for timings, and for what bonds release."""

    @abstractmethod
    def pair_forces(self, pairs: np.ndarray | slice) -> np.ndarray:
        """Return the force on the first point of given pairs in the state last evaluated, shape (k, d)."""

    def break_bonds(self, pairs: np.ndarray, changed: np.ndarray) -> None:
        """Drop broken pairs; `changed` are all pairs with a changed horizon.  Of a model that honours `ForceSettings.breakable`."""
        raise NotImplementedError

    def forces_beside_pairs(self) -> np.ndarray | None:
        """Return forces on the points that no pair exerts, shape (n, d); None where there are none."""
        return None

    def levers_on_planes(self) -> np.ndarray | None:
        """See `InternalForce.levers_on_planes`."""
        return None

    def mean_stress(self) -> np.ndarray:
        """Return the volume mean of the first Piola-Kirchhoff stress, shape (d, d): (1/V) sum of f (x) x over the bonds.

        It is work-conjugate to the mean deformation gradient; of a bond with a ghost, half lies within the body.
        """
        bonds, points = self.body.bonds, self.body.all_points
        share = np.where(bonds.second < len(self.body), 1.0, 0.5)
        share = share * self.body.share.own[bonds.first]
        vectors = points[bonds.second] - points[bonds.first]
        return np.einsum("b,bi,bj->ij", share, self.pair_forces(slice(len(bonds.first))), vectors) / whole_volume(self.body)

    def energy(self) -> float:
        """Return the stored energy in the state last evaluated; NaN where there is none."""
        raise TypeError(f"{type(self).__name__} has no energy")

    def tangent(self, positions: np.ndarray) -> LinearOperator:
        """See `InternalForce.tangent`."""
        raise TypeError(f"{type(self).__name__} has no tangent")

    def linearised_dilatation(self) -> LinearisedDilatation:
        """See `InternalForce.linearised_dilatation`."""
        raise TypeError(f"{type(self).__name__} has no dilatation of its own")

    def collapsed_pairs(self) -> np.ndarray:
        """See `InternalForce.collapsed_pairs`."""
        return np.empty(0, dtype=np.int64)

    def volume_ratios(self) -> np.ndarray:
        """Return J3 of the points, shape (n,); 1 for rigid ones."""
        found = np.ones(len(self.body))
        for points in self.materials:
            points.find()
            places, numbers = points.own
            found[numbers] = points.volume_ratios[places]
        return found

    def bulk_stresses(self) -> np.ndarray:
        """Return U' of the points, the hydrostatic part of a stress that U gives, in units of mu, shape (n,)."""
        found, J3 = np.zeros(len(self.body)), self.volume_ratios()
        for portion in self.binding.portions:
            found[portion.points] = portion.law.volumetric(J3[portion.points], portion.law.parameters)[1]
        return found

    def stress_and_energy(self) -> tuple[np.ndarray, np.ndarray]:
        """See `InternalForce.stress_and_energy`; here by the laws, at the volume ratios and bulk stresses of the force."""
        n, plane = len(self.body), self.kinematics.plane
        F, J3 = self.kinematics.deformation_gradients(), self.volume_ratios()
        bulk = None if plane == "stress" else self.bulk_stresses()
        stress, energy = np.zeros((n, 3, 3)), np.zeros(n)  # rigid points have no law
        for portion in self.binding.portions:
            at = portion.points
            found = PLANES[plane].stress_and_energy(portion.law, F[at], J3[at], None if bulk is None else bulk[at])
            stress[at], energy[at] = found
        return stress, energy

    def report(self, outside: Sequence[int]) -> None:
        """Count the pairs outside the domain of each model, and apply the policy; on a body in shares that is done later."""
        self.pairs_outside += sum(outside)
        for watch, found in zip(self.watches, outside, strict=True):
            watch.found = found
            if not self.body.share.divided:
                watch.settle()

    def check_finite(self, out: np.ndarray, without_force: int) -> None:
        """Raise InvalidState, naming a point, if any point has no finite force."""
        if without_force:
            raise InvalidState(locate(self.body, out, "the force on it is not finite"))


class Learnt:
    """How far the state of a body is from what its models have learnt; here for models that have learnt nothing."""

    def domain_deviation(self) -> np.ndarray | None:
        """Return how far the points are beyond the domain of the model (`Domain.deviation`), shape (n,); None if it has no domain."""
        return None

    def beyond_data(self) -> np.ndarray | None:
        """Return how far bonds, or for an energy points, are beyond the test data (`Domain.beyond_data`), each counted on one rank.

        None if the model does not know its data.
        """
        return None

    def member_deviation(self) -> np.ndarray | None:
        """Return the greatest deviation of a committee's members from the model at every point, shape (n,); None without members.

        It has the unit of the shear modulus; for a bond force it is the greatest of the bonds of a point (`pdsurrogate.forces.members`).
        """
        return None


class DomainWatch:
    """Counter of the pairs outside the domain of a model, which stops or warns according to the policy.

    Parameters
    ----------
    model : ForceSurrogate or EnergySurrogate
    n_pairs : int
        Pairs in one evaluation of the model.
    outside : str
        See `ForceSettings`.
    quantity, stand_in : str
        Names, for messages, of what the model gives, and of what would replace it.
    share : Share

    Attributes
    ----------
    found : int
        Pairs outside in the last evaluation.
    """

    def __init__(self, model, n_pairs: int, outside: str, quantity: str, stand_in: str, share: Share) -> None:
        self._model, self.n_pairs, self._share, self._policy = model, n_pairs, share, outside
        self._quantity, self._stand_in, self._warned = quantity, stand_in, False
        self.found = 0

    def settle(self) -> None:
        """Apply the policy to the pairs found; on a body in shares once all ranks have evaluated.

        Raises
        ------
        OutsideDomain
            If there are any, and the policy is to stop.
        """
        found = self._share.total(self.found) if self._policy in ("raise", "warn") else 0
        if not found:
            return
        what = f"{found} of {self._share.total(self.n_pairs)} bonds are outside the domain of {self._model.name}, {self._model.domain}"
        if self._policy == "raise":
            raise OutsideDomain(f"{what}; outside=fallback would use the exact {self._stand_in} for them")
        if not self._warned:
            self._warned = True
            warnings.warn(f"{what}: its {self._quantity} there is extrapolated", OutsideDomainWarning, stacklevel=5)


def whole_volume(body: Body) -> float:
    """Return the volume of a body, or of the whole body that it is a share of."""
    return body.share.total(float((body.volumes * body.share.own).sum()))
