"""Internal force on the points of a body, the object that solvers evaluate: the sum of the terms
of a force model.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import reduce
from operator import add
from typing import Any

import numpy as np
import scipy

from ..body import Body
from ..body.body import lengths_of
from ..materials import Law
from .binding import Binding, MaterialPart
from .interface_search import YIELDING
from .interfaces import Interfaces
from .kinematics import Kinematics
from .settings import ForceSettings
from .term import MaterialTerm, StateArray, Term
from .volume_energy import LinearizedDilatation

PROBE = 1e-5
"""Greatest displacement of a point, in spacings, in the central differences of `tangent_of`.
Chosen: curvature and rounding leave errors of 1e-8 or less.
"""


class InternalForce:
    """Internal force on the points of a body with one or several materials: the sum of the terms of
    their force model.

    `ForceModel.bind` makes it for a body of one material, and `bind_portions` for a body of
    several.

    Parameters
    ----------
    body : Body
    portions : sequence of MaterialPart
        Materials with models of one family; the points of a single material are ``slice(None)``.
    settings : ForceSettings

    Attributes
    ----------
    body : Body
    portions : sequence of MaterialPart
    portion_of : ndarray of int, shape (n + m,), or None
        Number of the material (index into `portions`) of every point and ghost, ``len(portions)``
        for rigid ones; None with one material.
    positions : ndarray, shape (n + m, d)
        Positions of points and ghosts as last set by `place` or a call.
    move_planes : callable
        Method of `Kinematics`: moves all reflection planes.
    interfaces : Interfaces or None
        Interfaces between materials; None if the body has one material.
    law : Law
        Law with the greatest shear modulus, by which forces and their rounding are measured.
    laws : list of tuple
        Laws of the body's materials, each with the numbers of the points that it describes.
    precision : {"float32", "float64"}
        Precision of the compiled pass over the bonds.
    correction : str
        Correction of incomplete horizons, see `ForceSettings`.
    breakable : bool
        Whether `break_bonds` is allowed.
    broken : ndarray of bool, shape (n_pairs,)
        Flags of the pairs that `break_bonds` has broken; empty if none can break.
    plane : {"stress", "strain", "space"}
        Plane stress, plane strain, or three dimensions.
    has_energy : bool
        Whether the forces are minus the derivative of an energy, which `energy` returns.
    nearly_incompressible : bool
        Whether the force has a `linearized_dilatation`: the derivative by the positions of the
        points' volumes, whose change the bulk modulus resists.
    zero_energy_modes : bool
        Whether the force does not resist some displacements that alternate from point to point.
    learned_thickness : bool
        Whether the volume ratios J3 of the points are computed with a learned force, and not by the
        law.
    learned : Term
        Term that reports the distance of the state from the training data: `domain_deviation`,
        `beyond_data`. At most one term may have a model with training data.
    stiffness_moduli : float or ndarray, shape (n,)
        Shear modulus, with that of all branches, that measures the stiffness around a point. With
        several materials it is the mean over the bonds of the point, where each bond has the mean
        modulus of its two ends, since bonds across an interface stiffen all points that they reach.
    force_scale : float or ndarray, shape (n,)
        Shear modulus that scales the force on a point. With several materials it is the greatest
        among the point and its neighbors, since forces and their rounding errors are that large.
    states : list of StateArray
        All arrays that the next evaluation starts from, apart from positions and broken bonds.
    state_arrays : dict of ndarray
        Their values by name. A solution that is saved with copies of these, and restored by copying
        them back, continues with identical bits.
    history : dict of ndarray
        Those of them that `accept` alone changes: the history of the terms, see `Term.keeps`.
    elapsed : float
        Time since the state last accepted, see `elapse`.
    before : float or None
        Duration of the step before.
    evaluations : int
        Evaluations begun so far.
    pairs_outside : int
        Pairs outside the domains of the models, summed over all evaluations.
    most_outside : int
        Greatest number of such pairs in one evaluation.
    seconds : float
        Time spent in the last `timed` finished evaluations; callers may set both to zero.
    timed : int
        Number of evaluations that `seconds` covers.
    """

    # Solvers ask every force for these parts, which `pdsurrogate.solvers.loads.LoadedForce` may
    # have.
    supports = rigid = obstacles = ()

    def __init__(
        self, body: Body, portions: Sequence[MaterialPart], settings: ForceSettings
    ) -> None:
        settings.check_body(body)
        self.body = body
        self.portions = portions
        self.breakable = settings.breakable
        self.broken = np.zeros(len(body.bonds.first) if settings.breakable else 0, dtype=bool)
        self.plane = settings.plane
        self.law = max((portion.law for portion in portions), key=lambda law: law.shear_modulus)
        self.laws = [(portion.law, portion.points) for portion in portions]
        self.precision = max(portion.model.usual_precision(settings) for portion in portions)
        several = not isinstance(portions[0].points, slice)
        changing = settings.breakable or any(portion.law.memory for portion in portions)
        self._kinematics = kinematics = Kinematics(
            body, self.precision, settings.plane, changing or several
        )
        self.positions = kinematics.positions
        self.move_planes = kinematics.move_planes
        kinds: Sequence[type[Term]] = portions[0].model.terms(settings.plane)
        self.has_energy = all(kind.has_energy for kind in kinds)
        self.portion_of = _numbers_of(body, portions) if several else None
        elastic = [portion.law.shear_modulus for portion in portions]
        glassy = [portion.law.shear_modulus + portion.law.memory.modulus for portion in portions]
        self.force_scale = max(elastic)
        self.stiffness_moduli = max(glassy)
        if self.portion_of is not None:
            moduli = np.array([*elastic, np.inf])[self.portion_of]
            held = settings.plane != "stress"
            kinematics.interfaces = Interfaces(
                kinematics, self.portion_of, moduli, self.has_energy, held, settings.breakable
            )
            self.stiffness_moduli, self.force_scale = self._moduli(moduli, max(elastic))
            if glassy != elastic:
                moduli = np.array([*glassy, np.inf])[self.portion_of]
                self.stiffness_moduli, _ = self._moduli(moduli, max(glassy))
        self.interfaces = kinematics.interfaces
        binding = Binding(kinematics, portions, settings, self.precision, self.portion_of)
        self.terms = [kind(replace(binding, number=number)) for number, kind in enumerate(kinds)]
        self._volumes = _term_with_volumes(self.terms, settings.plane)
        self._further = np.empty_like(body.points) if len(kinds) > 1 else None
        self._forms = any(term.needs_gradients for term in self.terms)
        self._watches = [watch for term in self.terms for watch in term.watches]
        self.learned = _term_with_domain(self.terms)
        self.correction = next(
            (term.correction for term in self.terms if term.correction != "none"), "none"
        )
        self.zero_energy_modes = all(term.zero_energy_modes for term in self.terms)
        self.nearly_incompressible = any(term.volume is not None for term in self.terms)
        self.learned_thickness = any(term.learned_thickness for term in self.terms)
        self.states: list[StateArray] = [array for term in self.terms for array in term.state]
        self.state_arrays = {array.name: array.values for array in self.states}
        if len(self.state_arrays) < len(self.states):
            raise ValueError(
                "two terms of a force keep arrays of one name, of"
                f" {[array.name for array in self.states]}"
            )
        self._remembering = [term for term in self.terms if term.kept]
        self.history = {
            name: values for term in self._remembering for name, values in term.kept.items()
        }
        self.evaluations = self.pairs_outside = self.most_outside = self.timed = 0
        self.seconds = self.elapsed = 0.0
        self.before: float | None = None

    def _moduli(self, moduli: np.ndarray, most: float) -> tuple[np.ndarray, np.ndarray]:
        """Return `stiffness_moduli` and `force_scale` from the shear moduli of points and
        ghosts, which are infinite for rigid ones, and the greatest one of a material.
        """
        body = self.body
        bonds = body.bonds
        n = len(body)
        owners = body.bond_owners
        around = moduli[bonds.neighbors]
        length = lengths_of(body.all_points[bonds.neighbors] - body.points[owners])
        # A bond between very different moduli carries the force of the softer material: each point
        # counts its own modulus only.
        apart = self.has_energy & (
            np.maximum(around, moduli[owners]) > YIELDING * np.minimum(around, moduli[owners])
        )
        around[apart] = moduli[owners[apart]]
        moduli = np.minimum(moduli, most)  # rigid points have none of their own
        around = np.minimum(around, most)
        weights = body.weigh(length) * body.all_volumes[bonds.neighbors]
        stiffness = (
            moduli[:n] + np.bincount(owners, weights * around, n) / np.bincount(owners, weights, n)
        ) / 2
        greatest = moduli[:n].copy()
        np.maximum.at(greatest, owners, around)
        body.share.fill(stiffness, greatest)
        return stiffness, greatest

    def __call__(self, positions: np.ndarray, out: np.ndarray) -> None:
        """Write the internal force on every point per unit thickness at positions (n, d) to `out`
        (n, d).

        Raises
        ------
        InvalidState
            If the deformation has no force; the message names a point.
        OutsideDomain
            If bonds are outside the domain of a model, and the settings have ``outside="raise"``.
        """
        self.evaluations += 1
        began = time.perf_counter()
        error = None
        for watch in self._watches:
            watch.found = 0
        try:
            if self.terms[0].places:
                self._kinematics.set_positions(positions)
            else:
                self._kinematics.place(positions, self._forms)
            self._add_up([term.find for term in self.terms], out)
        except RuntimeError as found:  # it concerns the state, or comes from a user's own force
            error = found
        outside = sum(watch.found for watch in self._watches)
        self.pairs_outside += outside
        self.most_outside = max(self.most_outside, outside)
        for watch in self._watches:
            watch.settle()
        self.body.share.agree(error)
        self.body.share.clear(out)
        self.seconds += time.perf_counter() - began
        self.timed += 1

    def _add_up(self, writers: Sequence[Callable[[np.ndarray], object]], out: np.ndarray) -> None:
        """Write the sum of the forces that several functions ``write(array)`` compute into
        `out`.
        """
        first, *others = writers
        first(out)
        for write in others:
            write(self._further)
            out += self._further

    def elapse(self, time: float, before: float | None = None) -> None:
        """Set the time since the state that was last accepted, at which the next evaluations try
        states of a body with history; to be called, too, after `history` was restored.

        Parameters
        ----------
        time : float
        before : float, optional
            Duration of the step that led to the last state, if the motion goes on smoothly, else 0.
            A force with `ForceSettings.paths` then follows how strains bend, and how fast branches
            relax; the short steps of dynamics do not need it.
        """
        self.elapsed = self._kinematics.elapsed = time
        self.before = self._kinematics.before = before
        for term in self._remembering:
            term.elapse()

    def accept(self, positions: np.ndarray) -> None:
        """Accept a state of the body: add it to the `history`, which evaluations never change, and
        begin a new time at it (`elapse`).

        Parameters
        ----------
        positions : ndarray, shape (n, d)
            Positions of the points in equilibrium, or after a time step.
        """
        if self._remembering:
            self._kinematics.place(positions)
            for term in self._remembering:
                term.accept(self._kinematics.elapsed)
        self.elapse(0.0)

    def pass_bonds(self, out: np.ndarray) -> None:
        """Write the forces to `out` from the states of the points as last computed, without checks;
        for timings, and for broken bonds.

        A force with an energy computes these states at the positions last set. Where they have no
        energy, `energy` then returns NaN.
        """
        self._kinematics.form_gradients()
        self._add_up([term.pass_bonds for term in self.terms], out)

    def place(self, positions: np.ndarray) -> None:
        """Set the positions of points (n, d) and ghosts without computing forces, before queries
        for gradients, stresses and the like.
        """
        self._kinematics.place(positions)

    def move_plane(self, plane: int, displacement, turn: np.ndarray | None = None) -> None:
        """Displace a reflection plane of the body by u(X) = displacement + turn X; its ghosts
        follow when positions are next set.

        `displacement` has the shape (d,) and `turn` (d, d). Only clamped planes (odd parity of all
        components) may be turned; if `turn` is None, the plane keeps the turn of the last call.
        """
        motions = self._kinematics.plane_motions.copy()
        motions[plane, :, -1] = displacement
        if turn is not None:
            motions[plane, :, :-1] = turn
        self.move_planes(motions)

    def deformation_gradients(self, images: bool = False) -> np.ndarray:
        """Return the deformation gradients F of the points, or of their `images` (ghosts), at the
        positions last set, shape (n, d, d).
        """
        return self._kinematics.deformation_gradients(images)

    @property
    def supported(self) -> np.ndarray:
        """Flags of the points that have bonds enough for a deformation gradient, bool, shape
        (n,); for others F is the identity.
        """
        return self._kinematics.supported[: len(self.body)] != 0

    def volume_ratios(self) -> np.ndarray:
        """Return the volume ratios J3 at which the volumetric energy of the points is evaluated, at
        the positions last set, shape (n,).

        Raises
        ------
        InvalidState
            If a point has no volume ratio.
        """
        return self._volumes.volume_ratios()

    def stress_and_energy(self) -> tuple[np.ndarray, np.ndarray]:
        """Return stress and energy density of the points from their own deformation gradients, at
        the positions last set.

        A learned energy of a sheet provides the energy and its derivative. For all other models,
        which are exact or provide only bond forces, both follow from the laws of the points, at the
        volume ratios and bulk stresses that the force evaluation computed.

        Returns
        -------
        stress : ndarray, shape (n, 3, 3)
            First Piola-Kirchhoff stress.
        energy : ndarray, shape (n,)
            Stored energy per undeformed volume.
        """
        stresses, energies = zip(*(term.stress_and_energy() for term in self.terms), strict=True)
        return reduce(add, stresses), reduce(add, energies)

    def pair_forces(self, pairs: np.ndarray | None = None) -> np.ndarray:
        """Return the force on the first point of given pairs, by default of all, in the state
        last evaluated, shape (k, d).
        """
        chosen = np.arange(len(self.body.bonds.first)) if pairs is None else pairs
        return reduce(add, (term.pair_forces(chosen) for term in self.terms))

    def forces_of_planes(self) -> np.ndarray:
        """Return the forces (planes, d) that do work on the displacements of the reflection planes,
        in the state last evaluated: this rank's part.

        The force of a single plane is the sum of the forces of all bonds that cross it.
        """
        return reduce(add, (term.forces_of_planes() for term in self.terms))

    def levers_on_planes(self) -> np.ndarray:
        """Return the first moments of the forces that reflection planes exert on the body, sums of
        f (x) y, shape (planes, d, d), in the state last evaluated: this rank's part.

        f is a force of a plane and y the place where it acts. The sums follow from virtual work for
        terms with an energy; bonds of other terms act on a plane at their middles.
        """
        return reduce(add, (term.levers_on_planes() for term in self.terms))

    def applied(self) -> np.ndarray:
        """Return zeros, shape (n, d): no loads are part of an internal force; a `LoadedForce`
        returns the forces of its loads instead.
        """
        return np.zeros_like(self.body.points)

    def mean_stress(self) -> np.ndarray:
        """Return the volume mean of the first Piola-Kirchhoff stress in the state last evaluated,
        shape (d, d).

        In a body divided among ranks, it is the contribution of this rank to the mean.
        """
        return reduce(add, (term.mean_stress() for term in self.terms))

    def energy(self) -> float:
        """Return the energy per unit thickness in the state last evaluated of which the forces are
        the derivative, for a force that `has_energy`.
        """
        return reduce(add, (term.energy() for term in self.terms))

    def tangent(self, positions: np.ndarray) -> scipy.sparse.linalg.LinearOperator:
        """Return minus the derivative of the forces at positions (n, d), see `tangent_of`."""
        return tangent_of(self, positions)

    def linearized_dilatation(self) -> LinearizedDilatation:
        """Return the derivative of the points' volume ratios by the positions, for a force that
        is `nearly_incompressible`.
        """
        return LinearizedDilatation([term.volume for term in self.terms if term.volume is not None])

    def break_bonds(self, pairs: np.ndarray) -> None:
        """Break pairs (bonds): remove them for good from the horizons of their ends, from
        corrections, and from forces.

        Raises
        ------
        ValueError
            If the force was bound without `ForceSettings.breakable`.
        """
        if not self.breakable:
            raise ValueError(
                "the bonds of this force cannot break; bind it with ForceSettings(breakable=True)"
            )
        self.broken[pairs] = True
        changed = self._kinematics.break_bonds(pairs)
        for term in self.terms:
            term.break_bonds(pairs, changed)

    def collapsed_pairs(self) -> np.ndarray:
        """Return the numbers of pairs nearly or fully turned inside out in the last evaluation;
        empty for models that do not check.
        """
        return reduce(np.union1d, (term.collapsed_pairs() for term in self.terms))

    @property
    def fraction_outside(self) -> float:
        """Fraction of all pair evaluations so far that were outside the model's domain; pairs
        across an interface count twice.
        """
        total = self.body.share.total
        outside = total(self.pairs_outside)
        pairs = total(sum(watch.n_pairs for watch in self._watches))
        return outside / max(1, self.evaluations * pairs)


def tangent_of(force: InternalForce, positions: np.ndarray) -> scipy.sparse.linalg.LinearOperator:
    """Return minus the derivative of an internal or loaded force at positions (n, d), in a body
    that is not divided among ranks.

    The operator is of shape (n d, n d), in the order of ``positions.ravel()``; with an energy it is
    symmetric. A product is a central difference over `PROBE` spacings, which costs two evaluations
    of the force in its present state of bonds and planes, and leaves the force in the state last
    evaluated, beside these positions.

    Raises
    ------
    ValueError
        If the force is not bound with ``precision="float64"``, or if the body is divided among
        ranks.
    """
    if force.precision != "float64" or force.body.share.divided:
        needs = "bind the force with precision='float64', to a body on one rank"
        raise ValueError(f"the tangent is computed from differences of forces in float64: {needs}")
    ahead, behind = np.empty((2, *positions.shape))

    def multiply(displacements: np.ndarray) -> np.ndarray:
        greatest = np.abs(displacements).max()
        if greatest == 0:
            return np.zeros(positions.size)
        step = PROBE * force.body.spacing / greatest
        moved = step * displacements.reshape(positions.shape)
        force(positions + moved, ahead)
        force(positions - moved, behind)
        return ((behind - ahead) / (2 * step)).ravel()

    adjoint = multiply if force.has_energy else None
    return scipy.sparse.linalg.LinearOperator(
        (positions.size, positions.size), multiply, adjoint, dtype=float
    )


@contextmanager
def numbers_in_place(force: InternalForce, materials: Sequence[tuple[Law, Any]]) -> Iterator[None]:
    """Replace the laws and models of a force by others that differ in numbers alone, until the end
    of a ``with`` block.

    The forces are then those of a force that is bound to these laws and models. `stiffness_moduli`,
    `force_scale`, and the interfaces across which one material is much stiffer than the other
    remain those of the laws with which the force was bound.

    Parameters
    ----------
    force : InternalForce
    materials : sequence of tuple
        Law and model of each of its `portions`, of the same classes and with arrays of the same
        shapes.

    Raises
    ------
    ValueError
        If the number of materials or a class differs, or laws have lists of other lengths.
    """
    own = [(portion.law, portion.model) for portion in force.portions]
    kinds = [
        [(type(law), type(model), law.parameters.shape) for law, model in each]
        for each in (own, materials)
    ]
    if kinds[0] != kinds[1]:
        raise ValueError(
            "a force takes other numbers of its laws and models, but no other laws or models: bind"
            " a force to these"
        )

    def give(materials: Sequence[tuple[Law, Any]]) -> None:
        """Give the numbers to all terms of the force, which have copies of them."""
        new = zip(force.portions, materials, strict=True)
        force.portions = [replace(portion, law=law, model=model) for portion, (law, model) in new]
        force.law = max(
            (portion.law for portion in force.portions), key=lambda law: law.shear_modulus
        )
        force.laws = [(portion.law, portion.points) for portion in force.portions]
        for term in force.terms:
            term.set_parameters(force.portions)

    try:
        give(materials)
        yield
    finally:
        give(own)


def released_by(force: InternalForce, motion: np.ndarray) -> float | None:
    """Return minus the derivative of the energy by a motion Q of the undeformed points, at fixed
    positions in the state last evaluated.

    Bonds, and the shares of volumes that they represent, move with the points, theory (74).

    Parameters
    ----------
    force : InternalForce
    motion : ndarray, shape (n, d)
        Q of every point, zero at the boundary of the body or tangential to it.

    Returns
    -------
    float or None
        The contribution of this rank; None for a force without energy, and for several materials.
    """
    parts = [term.released_by(motion) for term in force.terms]
    return None if None in parts else sum(parts)


def settle(force: InternalForce, positions: np.ndarray) -> bool:
    """Determine anew, at an equilibrium at `positions` (n, d), what the first evaluation of a step
    has determined for all of them: how fast branches relax whose times depend on the overstress.

    Return whether forces have changed, so that the equilibrium has to be found again.
    """
    settling = [term for term in force.terms if term.settles]
    if not settling:
        return False
    force.place(positions)
    changed = [term.settle() for term in settling]
    return force.body.share.any(any(changed))


def path_error(
    force: InternalForce, positions: np.ndarray, begins: bool, total: float
) -> list[float]:
    """Return an estimate of the error of the overstress of branches in a step that leads to an
    equilibrium at `positions` (n, d), the sum of the errors of such steps in a relaxation time, or
    in the `total` time if this is less, and the overstress: the greatest of all bonds.

    `begins` says that the step before was the first one of a motion, whose error counts, too.
    """
    force.place(positions)
    memories = [one for term in force.terms for one in term.memories if one.bends]
    found = [[0.0, 0.0, 0.0], *(one.path_error(begins, total) for one in memories)]
    return [force.body.share.greatest(max(values)) for values in zip(*found, strict=True)]


def stored_by(force: InternalForce) -> float:
    """Return the energy stored at the positions last evaluated in the history last accepted;
    `InternalForce.energy`, of which the forces are the derivative, may contain what a step
    dissipates.
    """
    return reduce(add, (term.stored() for term in force.terms))


def dissipated_by(force: InternalForce) -> dict[str, float]:
    """Return what accepted states have dissipated since the body was at rest, by its cause,
    "branches" or "softening", on this rank; empty without memory.
    """
    found: dict[str, float] = {}
    for term in force.terms:
        for cause, energy in term.dissipated().items():
            found[cause] = found.get(cause, 0.0) + energy
    return found


def _term_with_volumes(terms: Sequence[Term], plane: str) -> MaterialTerm:
    """Return the term by which the volume ratios of the points are defined: one with a volumetric
    energy, or else with laws of materials.

    Raises
    ------
    ValueError
        If no term has materials; or if, under plane stress, the laws of two terms do not determine
        the same thickness: each would be evaluated as a sheet of its own, and the two do not add up
        to one.
    """
    found = [term for term in terms if isinstance(term, MaterialTerm)]
    if not found:
        raise ValueError(
            "a force needs a term with materials, whose laws determine the volumes of its points"
        )
    for one, other in (
        (one.law, other.law)
        for term in found[1:]
        for one, other in zip(found[0].materials, term.materials, strict=True)
    ):
        if plane == "stress" and (
            type(one) is not type(other) or not np.array_equal(one.parameters, other.parameters)
        ):
            thickness = "under plane stress the thickness follows from the sum of all stresses"
            raise ValueError(
                f"two terms of a force have the laws {one.name} and {other.name}: {thickness};"
                " write one term for both"
            )
    return next((term for term in found if term.volume is not None), found[0])


def _term_with_domain(terms: Sequence[Term]) -> Term:
    """Return the term whose model has training data, or else the first; raise ValueError if two
    have.
    """
    found = [term for term in terms if any(watch.bounded for watch in term.watches)]
    if len(found) > 1:
        raise ValueError("two terms of a force have models with training data; only one may")
    return (found or terms)[0]


def _numbers_of(body: Body, portions: Sequence[MaterialPart]) -> np.ndarray:
    """Return the material (index into `portions`) of every point and ghost; ``len(portions)``
    for rigid points, which have none.
    """
    found = np.full(len(body.all_points), len(portions))
    for number, portion in enumerate(portions):
        found[portion.points] = number
    body.ghosts.fill(found)
    return found
