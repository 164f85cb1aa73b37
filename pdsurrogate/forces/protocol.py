"""What solvers, measures, tests and runs may ask of a force model, and of one bound to a body."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from ..body import Body
from ..html_tables import html_facts
from ..kernels.bond_state import LEAST_NORMAL_STRETCH
from ..materials import PLANES, Law
from ..materials.law import checked_law
from .settings import ForceSettings


class OutsideDomain(RuntimeError):
    """Bonds left the domain of a surrogate, and the policy is to stop."""


class OutsideDomainWarning(RuntimeWarning):
    """Bonds left the domain of a surrogate, and it is extrapolated."""


class InvalidState(RuntimeError):
    """A deformation for which the material law has no answer: det F <= 0, a limit passed, or numbers that are not finite."""


@dataclass(frozen=True)
class Domain:
    """Where a surrogate was trained.

    Attributes
    ----------
    least_stretch, greatest_stretch : float
        Bounds of both principal stretches in the plane, of the stretch tensor that (lambda_b, dtheta, J) define (theory (10)).
    least_bulk, greatest_bulk : float
        Bounds of J3^2 = J^2 C33.
    hull : tuple of tuple of float, optional
        Of an energy from test data, where those are: half-planes (n1, n2, d) in the logarithms of the two greater of three principal
        stretches of product 1, the greatest first, n1 log l1 + n2 log l2 <= d.
    """

    least_stretch: float
    greatest_stretch: float
    least_bulk: float
    greatest_bulk: float
    hull: tuple[tuple[float, float, float], ...] | None = field(default=None, repr=False)

    @property
    def interior(self) -> Domain:
        """The part of the domain in which the surrogate alone counts; between the two its force goes over into the exact one.

        Every bound lies a tenth nearer to rest, on a logarithmic scale.  A domain that rest is no part of has no such band.
        """
        bounds = (self.least_stretch, self.greatest_stretch, self.least_bulk, self.greatest_bulk)
        if not (bounds[0] < 1 < bounds[1] and bounds[2] < 1 < bounds[3]):
            return self
        return Domain(*(bound**0.9 for bound in bounds))

    def deviation(self, stretches: np.ndarray, bulk: np.ndarray | None = None) -> np.ndarray:
        """Greatest logarithm by which states pass a bound, negative by the distance to the nearest one within the domain, shape (n,).

        The edge of the hull of test data is one of the bounds, where there is one.

        Parameters
        ----------
        stretches : ndarray, shape (n, k)
            Principal stretches.
        bulk : ndarray, shape (n,), optional
            J3^2, of a model that sees it.
        """
        passed = self.beyond_bounds(stretches, bulk)
        return passed if self.hull is None else np.maximum(passed, self.beyond_data(stretches))

    def beyond_data(self, stretches: np.ndarray) -> np.ndarray:
        """The same of the hull of test data alone; of stretches in the plane, shape (n, 2), the third follows without change of volume."""
        logs = np.log(stretches)
        logs = np.column_stack([logs, -logs.sum(axis=1)]) if logs.shape[1] == 2 else logs - logs.mean(axis=1, keepdims=True)
        planes = np.array(self.hull)
        return (-np.sort(-logs, axis=1)[:, :2] @ planes[:, :2].T - planes[:, 2]).max(axis=1)

    def beyond_bounds(self, stretches: np.ndarray, bulk: np.ndarray | None = None) -> np.ndarray:
        """The same of the bounds of stretches and J3^2 alone, within which the model itself counts in a run."""
        with np.errstate(divide="ignore"):
            stretch = np.log(stretches)
            least, greatest, low, high = np.log([self.least_stretch, self.greatest_stretch, self.least_bulk, self.greatest_bulk])
            passed = np.maximum(stretch.max(axis=1) - greatest, least - stretch.min(axis=1))
            return passed if bulk is None else np.maximum(passed, np.maximum(np.log(bulk) - high, low - np.log(bulk)))

    def limits(self, dtype) -> np.ndarray:
        """Constants of `pdsurrogate.kernels.domain.is_outside`."""
        low, high = np.float64(self.least_stretch) ** 2, np.float64(self.greatest_stretch) ** 2
        with np.errstate(divide="ignore"):
            return np.array([low, high, 1 / low, 1 / high, self.least_bulk, self.greatest_bulk, LEAST_NORMAL_STRETCH], dtype=dtype)


EVERYWHERE = Domain(0.0, np.inf, 0.0, np.inf)
"""All states in which a bond has a stretch tensor."""


@dataclass(frozen=True)
class CompiledBondForce:
    """A bond force ready for the bond pass.

    Attributes
    ----------
    address : int
        Of the block function (`pdsurrogate.engine.compile.bond_force_signature`).
    sizes : ndarray of int64
    weights : ndarray, in the precision of the bond pass
    work_rows : int
        Rows of working memory that it needs, in that precision.
    needs_length : bool
        Whether it reads the last row of its states, l/horizon, which is filled for nobody else.
    asks_law : bool
        Whether it asks the response that the pass hands over, which says what the thickness does.  The force of every other is that of a
        thickness without stress; plane strain adds the pressure to it (`pdsurrogate.forces.plane_strain`).
    """

    address: int
    sizes: np.ndarray
    weights: np.ndarray
    work_rows: int
    needs_length: bool = False
    asks_law: bool = False


@dataclass(frozen=True)
class Release:
    """What bonds had held when they broke.

    Attributes
    ----------
    energy : float
        Stored energy that the body lost.
    forces : ndarray, shape (n, 2)
        Force that went with it.
    """

    energy: float
    forces: np.ndarray


@dataclass(frozen=True)
class Portion:
    """The points of a body that are of one material, and the force model that describes it.

    Attributes
    ----------
    law : Law
    model : ForceModel
    points : ndarray of int
        Numbers of the points, rising.
    """

    law: Law
    model: ForceModel
    points: np.ndarray


@dataclass(frozen=True)
class Member:
    """A member of the committee of a learnt model.

    Attributes
    ----------
    model : ForceModel
        Of the member, in units of its own shear modulus.
    law : Law
        That it describes.
    ratio : float
        Its shear modulus over that of the model whose committee it is in.
    """

    model: ForceModel
    law: Law
    ratio: float


class InternalForce(ABC):
    """A force model bound to a body: all that may be asked of it, and what is answered where a model says nothing else.

    `pdsurrogate.forces.evaluation.Evaluation` is the base of those that stand on the deformation gradients of the points.

    Attributes
    ----------
    body : Body
    law : Law
        Of several materials that with the greatest shear modulus, by which forces and their rounding are measured.
    precision : {"float32", "float64"}
        Of the bond pass.
    correction : str
        Of incomplete horizons, see `ForceSettings`.
    breakable : bool
        Whether `break_bonds` is allowed.
    plane : {"stress", "strain", "space"}
        What the thickness does, or that the body is a solid.
    has_energy : bool
        Whether the forces are minus the derivative of an energy, which `energy` gives.
    has_tangent : bool
        Whether `tangent` gives the second derivative of that energy.
    nearly_incompressible : bool
        Whether `linearised_dilatation` tells how the volume of the points changes with the positions, which costs the bulk modulus.
    zero_energy_modes : bool
        Whether there are displacements from point to point that it does not resist.
    learnt_thickness : bool
        Whether the points' J3 is found with a learnt force, and not by the law itself.
    evaluations : int
        Begun so far.
    pairs_outside : int
        Pairs outside the model's domain, summed over all evaluations.
    seconds : float
        Spent in `timed` finished evaluations; both may be set back.
    timed : int
    """

    has_energy = False
    has_tangent = False
    nearly_incompressible = False
    zero_energy_modes = False
    learnt_thickness = False
    _watches: Sequence = ()
    """What watches over the domains of the models that are evaluated."""

    def __init__(self, body: Body, law: Law, precision: str, correction: str, breakable: bool, plane: str = "stress") -> None:
        self.body, self.law, self.precision, self.correction, self.breakable = body, law, precision, correction, breakable
        self.plane = plane
        self.evaluations, self.pairs_outside = 0, 0
        self.seconds, self.timed = 0.0, 0

    def __call__(self, positions: np.ndarray, out: np.ndarray) -> None:
        """Internal force on every point per unit thickness at positions (n, d), written to `out` (n, d).

        Raises
        ------
        InvalidState
            Where the state has no force; names a point.
        OutsideDomain
            If bonds are outside the model's domain, and that was to stop it.
        """
        self.evaluations += 1
        began, share, error = time.perf_counter(), self.body.share, None
        try:
            self.evaluate(positions, out)
        except RuntimeError as found:  # of the state, the domain, or a force of the user's own
            if not share.divided:
                raise
            error = found
        share.agree(error)
        for watch in self._watches:
            watch.settle()
        share.clear(out)
        self.seconds += time.perf_counter() - began
        self.timed += 1

    @abstractmethod
    def evaluate(self, positions: np.ndarray, out: np.ndarray) -> None:
        """What a call does, apart from counting and timing it."""

    @abstractmethod
    def pass_bonds(self, out: np.ndarray) -> object:
        """The part of an evaluation that comes after the points' own states, anew in those last found; to time it by itself."""

    @abstractmethod
    def place(self, positions: np.ndarray) -> None:
        """Take positions (n, d) for what is asked about the points, without forces; ghosts follow."""

    @abstractmethod
    def move_plane(self, plane: int, displacement, turn: np.ndarray | None = None) -> None:
        """Displace a reflection plane of the body by u(X) = displacement + turn X; its ghosts follow when positions are next given.

        Only planes that are odd in all components are turned; once turned, a plane is given its turn every time.
        """

    @property
    @abstractmethod
    def positions(self) -> np.ndarray:
        """Of points and ghosts as last given to `place` or a call, shape (n + m, d)."""

    @abstractmethod
    def deformation_gradients(self) -> np.ndarray:
        """F of the points at the positions last given, shape (n, d, d)."""

    @abstractmethod
    def volume_ratios(self) -> np.ndarray:
        """J3 of the points at the positions last given, where their volumetric energy is taken, shape (n,).

        Raises
        ------
        InvalidState
            Where there is none.
        """

    def bulk_stresses(self) -> np.ndarray:
        """U' of the points at the positions last given, the hydrostatic part of a stress that U gives, in units of mu, shape (n,)."""
        return self.law.volumetric(self.volume_ratios(), self.law.parameters)[1]

    def stress_and_energy(self) -> tuple[np.ndarray, np.ndarray]:
        """What the model makes of the points' own deformation gradients at the positions last given.

        Of a model that has learnt the energy of a sheet it is that energy and its derivative; of every other, which is exact or gives
        forces of bonds alone, the points' laws at the volume ratios and bulk stresses that the force has found.

        Returns
        -------
        stress : ndarray, shape (n, 3, 3)
            First Piola-Kirchhoff stress.
        energy : ndarray, shape (n,)
            Stored energy per undeformed volume.
        """
        n, at = len(self.body), PLANES[self.plane].stress_and_energy
        F, J3 = self.deformation_gradients(), self.volume_ratios()
        bulk = None if self.plane == "stress" else self.bulk_stresses()
        stress, energy = np.zeros((n, 3, 3)), np.zeros(n)  # of rigid points, which have no law
        for law, points in self.laws:
            stress[points], energy[points] = at(law, F[points], J3[points], None if bulk is None else bulk[points])
        return stress, energy

    def domain_deviation(self) -> np.ndarray | None:
        """How far the points are beyond the domain of a learnt model (`Domain.deviation`), shape (n,); None of a model that has none."""
        return None

    def beyond_data(self) -> np.ndarray | None:
        """How far bonds, or of an energy points, are beyond the test data (`Domain.beyond_data`), at the positions last given.

        Each of those counted here once; None of a model that does not know where its data are.
        """
        return None

    def member_deviation(self) -> np.ndarray | None:
        """Greatest deviation of a committee's members from the model, of the bonds of every point or of the point, shape (n,).

        In the unit of the shear modulus, at the positions last given (`pdsurrogate.forces.members`); None where no members were asked for.
        """
        return None

    @property
    @abstractmethod
    def supported(self) -> np.ndarray:
        """Which points have bonds enough for a deformation gradient, bool, shape (n,); of others F is the identity."""

    @abstractmethod
    def pair_forces(self, pairs: np.ndarray | None = None) -> np.ndarray:
        """Force on the first point of given pairs in the state last evaluated, shape (k, d); of every pair where none are given."""

    def forces_beside_pairs(self) -> np.ndarray | None:
        """Forces on the points in the state last evaluated that no pair exerts, shape (n, d); None where there are none."""
        return None

    def levers_on_planes(self) -> np.ndarray | None:
        """Sum of f (x) y of every plane of the body, shape (planes, d, d), by virtual work in the state last evaluated.

        With f the forces that a plane exerts, and y the places where it does; None of a force that has no energy.
        """
        return None

    state_rows: Mapping[str, str] = MappingProxyType({"volume_ratios": "images"})
    """What the arrays of `state_arrays` have a row for: "images", every point and image, or "bonds", every directed bond."""

    @abstractmethod
    def state_arrays(self) -> dict[str, np.ndarray]:
        """Arrays of doubles that the next evaluation starts from, beside positions and broken bonds.

        A solution saved with copies of them, and copied back into them, goes on to the same bits.
        """

    @property
    def laws(self) -> list[tuple[Law, slice | np.ndarray]]:
        """Laws of the body's points, each with those that are of it."""
        return [(self.law, slice(None))]

    @property
    def stiffness_moduli(self) -> float | np.ndarray:
        """Shear modulus that the stiffness about a point is of: one number, or of several materials shape (n,).

        There it is the mean over the bonds of a point, each of both its ends: bonds across an interface stiffen all that they reach.
        """
        return self.law.shear_modulus

    def applied(self) -> np.ndarray | None:
        """Forces of loads on the points in the state last evaluated, shape (n, d); None without loads, which `LoadedForce` adds."""
        return None

    @property
    def force_scale(self) -> float | np.ndarray:
        """Shear modulus that the force on a point is measured by: one number, or of several materials shape (n,).

        There it is the greatest among the point and those that it is bonded to: so large are the forces on it, and their rounding.
        """
        return self.law.shear_modulus

    def mean_stress(self) -> np.ndarray:
        """Volume mean of the first Piola-Kirchhoff stress in the state last evaluated, shape (d, d); what this part of a body has.

        (1/V) sum of f (x) x over the bonds, work-conjugate to the mean deformation gradient; of a bond with a ghost, half lies within the
        body.
        """
        bonds, points = self.body.bonds, self.body.all_points
        share = np.where(bonds.second < len(self.body), 1.0, 0.5)
        counted = self.body.share.counted_pairs(bonds.first)
        if counted is not None:
            share = share * counted
        vectors = points[bonds.second] - points[bonds.first]
        return np.einsum("b,bi,bj->ij", share, self.pair_forces(), vectors) / self._whole_volume()

    def _whole_volume(self) -> float:
        """Of the body that this one is a share of, if it is one."""
        share = self.body.share
        return share.total(float(share.counted(self.body.volumes).sum()))

    def energy(self) -> float:
        """Stored energy per unit thickness in the state last evaluated; of a force that `has_energy`."""
        raise TypeError(f"{type(self).__name__} has no energy")

    def tangent(self, positions: np.ndarray):
        """Second derivative of the energy at positions of the points (`forces.tangent.Tangent`); of a force that `has_tangent`."""
        raise TypeError(f"{type(self).__name__} has no tangent")

    def linearised_dilatation(self):
        """How the points' volume changes with the positions (`forces.dilatation.LinearisedDilatation`); if `nearly_incompressible`."""
        raise TypeError(f"{type(self).__name__} has no dilatation of its own")

    def break_bonds(self, pairs: np.ndarray) -> Release | None:
        """Take pairs out of everything: horizons, corrections and forces.

        Says what is released, where the force has an energy.

        Raises
        ------
        ValueError
            If the force was bound without `ForceSettings.breakable`.
        """
        if not self.breakable:
            raise ValueError("this force was bound without bonds that break; bind it with ForceSettings(breakable=True)")
        return self.take_out(pairs)

    def take_out(self, pairs: np.ndarray) -> Release | None:
        """What `break_bonds` does; of a model that honours `ForceSettings.breakable`."""
        raise NotImplementedError

    def collapsed_pairs(self) -> np.ndarray:
        """Numbers of the pairs that were turned inside out in the last evaluation, or nearly; none where pairs have no gradient."""
        return np.empty(0, dtype=np.int64)

    @property
    def fraction_outside(self) -> float:
        """Share of all pair evaluations so far that were outside the model's domain."""
        outside, pairs = self.body.share.total(self.pairs_outside), self.body.share.total(self.pairs_evaluated)
        return outside / max(1, self.evaluations * pairs)

    @property
    def pairs_evaluated(self) -> int:
        """Pairs counted in one evaluation; of several materials those across an interface count twice."""
        counted = self.body.share.counted_pairs(self.body.bonds.first)
        return len(self.body.bonds.first) if counted is None else int(counted.sum())


class ForceModel(ABC):
    """A force model: it says which settings it honours, and is bound to a body with none that it does not.

    Attributes
    ----------
    name : str
    family : str
        Kind of force model: those of one kind can describe the materials of one body.
    honours : mapping
        The values that it can honour of every field of `ForceSettings` that it has a use for.
    stated : mapping, optional
        Errors that the card of a learnt model states, see `pdsurrogate.forces.agreement`.
    members : tuple of Member
        Of its committee, where their deviation is asked for.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> model = pds.load_surrogate("neo-hookean@1")
    >>> isinstance(model, pds.ForceModel), model.facts["family"]
    (True, 'bond force')
    """

    name: str
    family: str
    honours: Mapping[str, tuple]
    stated: Mapping[str, float] | None = None
    members: tuple[Member, ...] = ()

    def bind(self, body: Body, law: Law, settings: ForceSettings) -> InternalForce:
        """Prepare the evaluation of this model on a body of a material.

        Raises
        ------
        TypeError
            If one of them is none.
        ValueError
            If the model does not fit the material, or cannot honour a setting.
        """
        if not isinstance(body, Body):
            raise TypeError(f"body must be a Body, such as Body.rectangle(1.0, 1.0, 0.1, 0.315), not {body!r}")
        if not isinstance(settings, ForceSettings):
            raise TypeError(f"settings must be ForceSettings(), not {settings!r}")
        settings.check(self.name, self.honoured(settings.plane))
        self.check_material(checked_law(law))
        return self.evaluation(body, law, settings)

    def honoured(self, plane: str) -> Mapping[str, tuple]:
        """What it can honour under plane stress, in plane strain or in space; the same, but of a model with an evaluation for each."""
        return self.honours

    @abstractmethod
    def evaluation(self, body: Body, law: Law, settings: ForceSettings) -> InternalForce:
        """The evaluation on a body, with settings that it can honour."""

    def evaluation_of_portions(self, body: Body, portions: Sequence[Portion], settings: ForceSettings) -> InternalForce:
        """The evaluation on a body of several materials, all of them described by models of this family, see `forces.portions`.

        Raises
        ------
        ValueError
            If the family takes bodies of one material only.
        """
        raise ValueError(f"{self.name} takes a body of one material; without materials it serves every law")

    def check_material(self, law: Law) -> None:  # noqa: B027 - most models have nothing to check
        """Raise ValueError if the model does not describe this material; one that has learnt nothing serves every law."""

    def payload(self) -> dict:
        """Plain containers and arrays that tell this model from others of its name: what it has learnt."""
        return {}

    @property
    def size(self) -> str:
        """What it has learnt in words, for tables."""
        return ""

    @property
    def facts(self) -> dict[str, str]:
        """What a person wants to know of it first, in words."""
        return {"family": self.family, "learnt": self.size or "nothing: it is exact and serves every law"}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"

    def _repr_html_(self) -> str:
        return html_facts(f"Force model {self.name}", self.facts)
