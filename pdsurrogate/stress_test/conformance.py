"""Properties that every force model must have, the table of force models they are put to, and where a model states that it departs.

One table and one suite: the tests run every pair of a row and a property, ``pdsurrogate stress-test`` reports them.  A new force model,
known by its name in `pdsurrogate.forces.FORCES` or as an artefact, joins by one line of `TABLE`::

    Row("yeoh", MOMENTS),

The second argument is what the model does not do, with the bound that it keeps instead; a model that has every property is
``Row("yeoh")``.  A new property is a function of a `Subject`, and one line of `PROPERTIES`.
"""

from __future__ import annotations

import re
import tempfile
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..artifacts import load_card
from ..body import Body, ReflectionPlane
from ..engine.threads import most_threads, thread_count
from ..forces import (
    FORCES,
    AnalyticBondForce,
    EnergySurrogate,
    ForceSettings,
    ForceSurrogate,
    InvalidState,
    OutsideDomain,
    OutsideDomainWarning,
)
from ..forces.kernel_values import kernel_bond_force, kernel_energy
from ..forces.settings import OUTSIDE_POLICIES, PRECISIONS, ROTATIONS, WHERE
from ..kernels.reference_state import CORRECTIONS
from ..learning import wide_design
from ..materials import PLANES, Law, dimension_of
from ..run.run import Silent
from ..run.simulate import SimulationFailed, simulate
from ..scenes import MaterialSpec, load_scene
from .bodies import disc_with_hole, gripped, jittered, notched, of_points, plain, sheet
from .case import INAPPLICABLE, PASS, WEAK, Case, Outcome, Subject
from .deformations import force_densities, turn, wavy, why_inaccurate

MIRROR = np.array([-1.0, 1.0, 1.0])
"""Of the first components, as many as a body has."""


@dataclass(frozen=True)
class Departure:
    """That a model does not have a property, and what it keeps instead.

    Attributes
    ----------
    weakness : str
        One of `pdsurrogate.stress_test.case.WEAKNESSES`.
    bound : float or callable
        Of the measured value; a function of the artefact's reference where its card states the error.
    """

    weakness: str
    bound: float | Callable[[str], float]

    def limit(self, reference: str) -> float:
        """The bound of a row."""
        return self.bound(reference) if callable(self.bound) else self.bound


@dataclass(frozen=True)
class Row:
    """A force model of the table, put to every property in its own material (`Subject.law`).

    Attributes
    ----------
    reference : str
        As on the command line.
    departures : mapping
        By the name of the property; every other property is held.
    plane : {"stress", "strain", "space"}
        What the thickness does, or that bodies are solid.
    """

    reference: str
    departures: Mapping[str, Departure] = field(default_factory=dict)
    plane: str = "stress"

    @property
    def name(self) -> str:
        """The reference, and the plane where that is not the usual one."""
        return self.reference + WHERE[self.plane]


@dataclass(frozen=True)
class Deformation:
    """A stretch along turned axes, turned again, with waves of a drawn direction on top; in space the volume is kept."""

    first: float
    second: float
    rotation: float
    axes: float
    amplitude: float
    seed: int

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Positions of reference points; angles are in degrees, the amplitude in the unit of the points."""
        random, d = np.random.default_rng(self.seed), points.shape[1]
        stretches = [self.first, self.second, 1 / (self.first * self.second)][:d]
        F = turn(self.rotation, d) @ turn(self.axes, d) @ np.diag(stretches) @ turn(-self.axes, d)
        waves = self.amplitude * np.sin(points @ random.uniform(-6, 6, (d, d)) + random.uniform(0, 6, d))
        return (points + waves) @ F.T


DEFORMATIONS = (
    Deformation(1.3, 0.95, 0.0, 15.0, 0.01, 1),
    Deformation(1.9, 0.75, 100.0, 70.0, 0.005, 2),
    Deformation(0.8, 0.9, -170.0, 0.0, 0.01, 3),
)
"""Stretched, strongly stretched and turned, compressed."""


@dataclass(frozen=True)
class Property(Case):
    """A case that every force model must pass but for its stated departures.

    Attributes
    ----------
    drawn : bool
        Whether its function takes any number of deformations of `notched` bodies too, so that a test can draw them.
    """

    planes: tuple[str, ...] = tuple(PLANES)
    drawn: bool = False


def _evaluate(subject: Subject, body: Body, positions: np.ndarray, **settings):
    """A fresh evaluation on a body, in double precision if nothing else is asked, and the forces."""
    force = subject.model.bind(body, subject.law, ForceSettings(**{"precision": "float64", "plane": subject.plane, **settings}))
    return force, _forces(force, positions)


def _bound(subject: Subject, name: str, make: Callable[[], Body], law: Law | None = None):
    """An evaluation on a body that several properties and deformations share, bound once for a subject."""
    if name not in subject.measured:
        subject.measured[name] = subject.model.bind(make(), law or subject.law, ForceSettings(precision="float64", plane=subject.plane))
    return subject.measured[name]


def _notched(subject: Subject):
    return _bound(subject, "notched", lambda: notched(subject.dimension))


def _forces(force, positions: np.ndarray) -> np.ndarray:
    out = np.empty_like(positions)
    force(positions, out)
    return out


def _settled(force, positions: np.ndarray) -> np.ndarray:
    """Forces whose J3 was found before, so that they do not depend on where its iteration started; what that costs is `another_start`'s."""
    _forces(force, positions)
    return _forces(force, positions)


def _energy(force) -> float:
    """Stored energy over mu times the volume; zero of a force that has none."""
    return force.energy() / (force.law.shear_modulus * force.body.volumes.sum()) if force.has_energy else 0.0


def _scale(force, forces: np.ndarray) -> float:
    """What errors of forces are relative to: the greatest force, and near rest what a stress of mu gives on a side of a cell."""
    return max(float(np.abs(forces).max()), force.law.shear_modulus * force.body.spacing)


def rigid_rotation(subject: Subject) -> Outcome:
    """Greatest force density on a sheet turned by 0 to 360 degrees, in mu/dx, and energy, in mu times the volume.

    Rounding of positions leaves K/mu times 1e-15 times the number of spacings; 1e-9 is asked.
    """
    body = subject.body(10) if subject.dimension == 2 else plain(3)
    force, found = subject.bind(body), []
    for degrees in range(0, 361, 15):
        found += [np.abs(force_densities(force, body.points @ turn(degrees, subject.dimension).T)).max(), abs(_energy(force))]
    return Outcome.below(np.max(found), 1e-9, "force at rest")


def objectivity(subject: Subject, deformations: Iterable = DEFORMATIONS) -> Outcome:
    """Change of the forces on a deformed body that is turned by 15 to 360 degrees and moved, seen in its own frame; and of its energy.

    Rounding of the positions, 1e-15, is a strain of 1e-14 over a spacing, multiplied by K/mu and some thirty bonds: 1e-10, and a tenth of
    what is asked.
    """
    force, errors = _notched(subject), []
    for deformation in deformations:
        positions = deformation(force.body.points)
        still, energy = _settled(force, positions), _energy(force)
        for degrees in (15, 110, 170, 200, 275, 360):
            rotation = turn(degrees, subject.dimension)
            turned = _settled(force, positions @ rotation.T + [3.0, -2.0, 1.0][: subject.dimension])
            errors += [np.abs(turned @ rotation - still).max() / _scale(force, still), abs(_energy(force) - energy)]
    return Outcome.below(np.max(errors), 1e-9, "accuracy")


def another_start(subject: Subject, deformations: Iterable = DEFORMATIONS) -> Outcome:
    """Change of the forces when the iteration for J3 starts from rest, and not from the same state.

    It ends with a step below 1e-8, after which J3 is off by the square of that: K/mu times 1e-16, 1e-9 is asked.
    """
    force, errors = _notched(subject), []
    for deformation in deformations:
        positions = deformation(force.body.points)
        _forces(force, force.body.points)
        found, expected = _forces(force, positions), _forces(force, positions)
        errors.append(np.abs(found - expected).max() / _scale(force, expected))
    return Outcome.below(np.max(errors), 1e-9, "last step of J3")


def mirror(subject: Subject, deformations: Iterable = DEFORMATIONS) -> Outcome:
    """Difference between the forces on a mirrored body and the mirrored forces; rounding, 1e-9 as of a turned body."""
    force, across = _notched(subject), MIRROR[: subject.dimension]
    mirrored = _bound(subject, "mirrored", lambda: of_points(force.body.points * across))
    errors = []
    for deformation in deformations:
        positions = deformation(force.body.points)
        expected = _settled(force, positions) * across
        errors.append(np.abs(_settled(mirrored, positions * across) - expected).max() / _scale(force, expected))
    return Outcome.below(np.max(errors), 1e-9, "no mirror symmetry")


def linear_momentum(subject: Subject, deformations: Iterable = DEFORMATIONS) -> Outcome:
    """Sum of all forces over the sum of their sizes; of some 2,000 bond forces rounding leaves 1e-15 each: 1e-12 is asked."""
    force, errors = _notched(subject), []
    for deformation in deformations:
        forces = _settled(force, deformation(force.body.points))
        errors.append(np.abs(forces.sum(axis=0)).max() / max(float(np.abs(forces).sum()), _scale(force, forces)))
    return Outcome.below(np.max(errors), 1e-12, "accuracy")


def angular_momentum(subject: Subject, deformations: Iterable = DEFORMATIONS) -> Outcome:
    """Moment of all forces on a deformed body about its middle, over the sum of the moments' sizes; rounding leaves 1e-15."""
    force, errors = _notched(subject), []
    for deformation in deformations:
        positions = deformation(force.body.points)
        forces, arms = _settled(force, positions), positions - positions.mean(axis=0)
        lengths = np.linalg.norm(arms, axis=1)
        # The components of the moment, in the plane and in space.
        moment = np.abs(arms.T @ forces - forces.T @ arms).max()
        size = max(float((lengths * np.linalg.norm(forces, axis=1)).sum()), lengths.max() * _scale(force, forces))
        errors.append(moment / size)
    return Outcome.below(np.max(errors), 1e-9, "moments")


def order_of_points(subject: Subject, deformations: Iterable = DEFORMATIONS) -> Outcome:
    """Change of the forces when the points are numbered otherwise: sums in another order, so rounding; 1e-11 is asked.

    That is 1e-16 for each of some thirty bonds, multiplied by K/mu where the volumetric part cancels.
    """
    force = _notched(subject)
    order = np.random.default_rng(20240109).permutation(len(force.body))
    shuffled = _bound(subject, "shuffled", lambda: of_points(force.body.points[order]))
    errors = []
    for deformation in deformations:
        positions = deformation(force.body.points)
        expected = _settled(force, positions)
        errors.append(np.abs(_settled(shuffled, positions[order]) - expected[order]).max() / _scale(force, expected))
    return Outcome.below(np.max(errors), 1e-11, "accuracy")


def _in_units_of(law: Law, stress: float) -> Law:
    """The same material with every modulus multiplied."""
    described = law.describe()
    for key in described:
        if "modul" in key:
            described[key] = (np.asarray(described[key]) * stress).tolist()
    return MaterialSpec.model_validate(described).build()


def units(subject: Subject, deformations: Iterable = DEFORMATIONS) -> Outcome:
    """Change of the forces in other units of length and stress; 1e-9, as of a turned body.

    A force per unit thickness is their product; one in space has the length twice.
    """
    force, errors = _notched(subject), []
    for length, stress in ((1e-6, 3e5), (50.0, 1e-3)):
        body = force.body
        other = _bound(
            subject,
            f"unit of length {length}",
            lambda length=length, body=body: Body(
                length * body.points, length**subject.dimension * body.volumes, length * body.horizon, length * body.spacing
            ),
            _in_units_of(subject.law, stress),
        )
        for deformation in deformations:
            positions = deformation(body.points)
            expected = _settled(force, positions)
            found = _settled(other, length * positions) / (length ** (subject.dimension - 1) * stress)
            errors.append(np.abs(found - expected).max() / _scale(force, expected))
    return Outcome.below(np.max(errors), 1e-9, "accuracy")


GRADIENTS = (
    np.array([[1.5, 0.0], [0.0, 0.82]]),
    np.array([[1.0, 0.8], [0.0, 1.0]]),
    turn(143) @ np.array([[1.8, 0.3], [0.1, 0.9]]),
    np.array([[0.85, 0.1], [0.0, 0.9]]),
)
"""Tension, shear, a turned state and compression, within the domain of every shipped artefact."""


def homogeneous_stress(subject: Subject) -> Outcome:
    """Error of the mean stress in four homogeneous states of three bodies, each with another weight function.

    Of an exact force the stress is the law's, boundary included, but for rounding: 1e-13 multiplied by K/mu.  Of an artefact it is as exact
    as its card says: P is twice the mean of t (x) n over the directions of the bonds, so it is off by at most twice the greatest error of a
    bond, which the card states for the strain of the state.  A model without T_mm has errors of its correction at edges; it is held against
    the exact force with the same correction.  The figure is that of the state nearest to its limit.
    """
    random = np.random.default_rng(20240109)
    rounding = 1e-13 * subject.law.bulk_modulus / subject.law.shear_modulus
    errors, limits = [], []
    d = subject.dimension
    for body in (plain(d, weight="inverse"), disc_with_hole(d, weight="constant"), jittered(random, dimension=d, weight="linear")):
        force, _ = _evaluate(subject, body, body.points)
        exact = _exact_stress(force)
        for F in map(_extended, GRADIENTS) if d == 3 else GRADIENTS:
            _forces(force, body.points @ F.T)
            expected = exact(F)
            errors.append(np.abs(force.mean_stress() - expected).max() / np.abs(expected).max())
            limits.append(rounding + _stated_error(subject, F))
    # NaN counts as the greatest.
    worst = int(np.argmax(np.divide(errors, limits)))
    return Outcome.below(errors[worst], limits[worst], why_inaccurate(subject), f"{{:.1e}} of {limits[worst]:.1e}")


def _extended(F: np.ndarray) -> np.ndarray:
    """A gradient of the plane with the third stretch that leaves the volume within a few per cent, all turned."""
    full = np.zeros((3, 3))
    full[:2, :2], full[2, 2] = F, 0.97 / np.linalg.det(F)
    return turn(50, 3) @ full @ turn(20, 3)


def _exact_stress(force):
    """The stress that a force model would have without errors of a fit: the law's, or the exact force's with the same correction."""
    if force.correction != "scalar":
        return lambda F: PLANES[force.plane].first_piola_stress(force.law, F)
    scalar = ForceSettings(precision="float64", correction="scalar", plane=force.plane)
    exact = AnalyticBondForce(force.law).bind(force.body, force.law, scalar)

    def stress(F):
        _forces(exact, force.body.points @ F.T)
        return exact.mean_stress()

    return stress


def _stated_error(subject: Subject, F: np.ndarray) -> float:
    """Relative error of the stress that a card allows in a homogeneous state; none without a card."""
    if subject.reference in FORCES:
        return 0.0
    strain = float(np.abs(np.linalg.svd(F, compute_uv=False) - 1).max())
    bins = load_card(subject.reference).errors["box"]["by_strain"]
    return 2 * max(entry["max"] for entry in bins if entry["strain"][0] <= strain <= entry["strain"][1])


def single_precision(subject: Subject) -> Outcome:
    """Difference of the forces in float32 and in float64 on a deformed sheet, over the greatest.

    A few roundings of 6e-8 on each of some thirty bond forces, which are larger than their sum: 2e-5 is asked.
    """
    body = plain(subject.dimension)
    try:
        _, single = _evaluate(subject, body, wavy(body.points), precision="float32")
    except ValueError:
        return Outcome(INAPPLICABLE, "double only")
    _, double = _evaluate(subject, body, wavy(body.points))
    return Outcome.below(np.abs(single - double).max() / np.abs(double).max(), 2e-5, "accuracy")


def kernel_and_numpy(subject: Subject) -> Outcome:
    """Difference between the compiled model and its plain face in NumPy on 1,000 states, over the greatest value.

    Some 40 roundings of terms that are up to ten thousand times their sum: 1e-10 in float64.  In float32 the forces are held
    against those in float64 as a whole, see `single_precision`.
    """
    model, law = subject.model, subject.law
    if subject.plane != "stress":
        return Outcome(INAPPLICABLE, "its face in NumPy is that of a sheet")
    if isinstance(model, ForceSurrogate):
        X = wide_design(law, 1000, (0.8, 3.5), random_state=11).X.T
        found, expected = kernel_bond_force(model, law, np.float64)(*X), model.bond_force(*X)
    elif isinstance(model, EnergySurrogate):
        stretches = np.random.default_rng(11).uniform(0.6, 4.5, (1000, 2))
        states = (stretches**2).sum(axis=1), stretches.prod(axis=1)
        own = model.energy_derivatives(law, *states)
        found, expected = kernel_energy(model, law, "float64", *states), np.stack([own.psi, own.by_trace, own.by_area])
    else:
        return Outcome(INAPPLICABLE, "no face in NumPy")
    return Outcome.below(np.abs(found - expected).max() / np.abs(expected).max(), 1e-10, "accuracy")


def threads(subject: Subject) -> Outcome:
    """Bits by which forces on one thread and on two differ, in every precision that the model takes: none may."""
    if most_threads() < 2:
        return Outcome(INAPPLICABLE, "one thread was asked for, or numba started with one")
    body, found = sheet(0.05) if subject.dimension == 2 else plain(3), []
    for count in (1, 2):
        with thread_count(count):
            found.append([])
            for precision in PRECISIONS:
                with suppress(ValueError):  # of a model that does not take it, see `settings_refused`
                    force, out = _evaluate(subject, body, wavy(body.points), precision=precision)
                    found[-1] += [out, _energy(force)]
    differing = sum(not np.array_equal(one, two) for one, two in zip(*found, strict=True))
    return _none_may(differing, "bitwise the same", "differ")


def _none_may(count: int, none: str, some: str, weakness: str = "accuracy") -> Outcome:
    """Passed if a count is zero."""
    return Outcome(WEAK if count else PASS, some if count else none, float(count), 0.0, weakness if count else None)


def reflected_half(subject: Subject) -> Outcome:
    """Difference between the forces on half a sheet at a symmetry plane and on that half of the whole sheet, symmetrically deformed.

    The images stand for points that are really there: sums of the same bonds in another order, 1e-11 as for `order_of_points`.
    """
    d = subject.dimension
    half, whole = plain(d, width=0.6, planes=(ReflectionPlane(0, 0.6, 1, (-1, 1, 1)[:d]),)), plain(d, width=1.2)
    x1, x2, *rest = (whole.points - [0.6, 0, 0][:d]).T
    across = [0.8 * x3 + 0.03 * x2 * x1**2 for x3 in rest]
    positions = np.stack([0.6 + 1.4 * x1 + 0.1 * x1 * np.cos(3 * x2), 0.9 * x2 + 0.05 * x1**2, *across], axis=1)
    left = whole.points[:, 0] < 0.6
    force, expected = _evaluate(subject, whole, positions)
    _, found = _evaluate(subject, half, positions[left])
    return Outcome.below(np.abs(found - expected[left]).max() / _scale(force, expected), 1e-11, "no mirror symmetry")


def pair_forces(subject: Subject) -> Outcome:
    """Difference between the forces and the sum of the pair forces, on a free sheet and on one with images; 1e-10.

    Sums of the same bonds in another order, from parts that are formed anew where a model does not store them.  Those of some pairs alone
    are the same.
    """
    errors = []
    for body in (plain(subject.dimension), gripped(subject.dimension)):
        force, out = _evaluate(subject, body, body.points + 0.1 * (wavy(body.points) - body.points))
        total, pairs = np.zeros_like(body.all_points), force.pair_forces()
        np.add.at(total, body.bonds.first, pairs)
        np.add.at(total, body.bonds.second, -pairs)
        some = np.arange(len(pairs))[::-3]
        errors += [np.abs(total[: len(body)] - out).max() / np.abs(out).max(), np.abs(force.pair_forces(some) - pairs[some]).max()]
    return Outcome.below(np.max(errors), 1e-10, "accuracy")


def broken_bonds(subject: Subject) -> Outcome:
    """Difference between a body whose bonds break in two steps and one that was built without them: forces, energy, pair forces.

    Horizons, gradients and corrections are found anew from the same numbers in another order: rounding.  J3 starts elsewhere, which leaves
    1e-9 (`another_start`).
    """

    def crosses(start, end):
        share = (0.5 - start[:, 1]) / np.where(end[:, 1] == start[:, 1], np.inf, end[:, 1] - start[:, 1])
        return (share > 0) & (share < 1) & (start[:, 0] + share * (end[:, 0] - start[:, 0]) < 0.6)

    body, cut = plain(subject.dimension), plain(subject.dimension, separates=crosses)
    positions = wavy(body.points)
    try:
        force, _ = _evaluate(subject, body, positions, breakable=True)
    except ValueError as error:
        return Outcome(INAPPLICABLE, str(error))
    pairs = np.flatnonzero(crosses(body.points[body.bonds.first], body.points[body.bonds.second]))
    for part in np.array_split(pairs, 2):
        force.break_bonds(part)
    found = _forces(force, positions)
    built, expected = _evaluate(subject, cut, positions, breakable=True)
    errors = [np.abs(found - expected).max() / np.abs(expected).max(), np.abs(force.pair_forces()[pairs]).max() / np.abs(expected).max()]
    errors.append(abs(_energy(force) - _energy(built)))
    return Outcome.below(np.max(errors), 1e-9, "accuracy")


def unbreakable(subject: Subject) -> Outcome:
    """Whether breaking bonds of an evaluation that was not bound for it is refused with what to do."""
    force = subject.model.bind(plain(subject.dimension), subject.law, ForceSettings(plane=subject.plane))
    try:
        force.break_bonds(np.arange(5))
    except ValueError as error:
        return _none_may(int("breakable" not in str(error)), "refused", f"refused without breakable ({error})")
    return _none_may(1, "refused", "broken all the same")


class _Killed(Exception):
    """A run that ended before its time."""


class _Killing(Silent):
    """Ends a run as its second level begins."""

    def level(self, number: int, stretch: float) -> None:
        if number == 1:
            raise _Killed


def checkpoint(subject: Subject) -> Outcome:
    """Points that end elsewhere when a run in equilibrium is killed between two levels and resumed from its checkpoint: none may."""
    if subject.plane == "space":
        return Outcome(INAPPLICABLE, "its run is that of a sheet")
    # Without the exact solution to compare with, which costs more than the run with some laws.
    changes = {"spacing": 0.1, "body.size": [0.8, 0.8], "stretches": [1.05, 1.15], "solver.tolerance": 1e-4, "reference": None}
    changes["plane"] = subject.plane
    scene = load_scene("uniaxial", changes, material=subject.law.describe())
    try:
        whole = simulate(scene, subject.model)
    except SimulationFailed as error:
        return Outcome(WEAK, str(error), None, None, "does not converge")
    with tempfile.TemporaryDirectory() as name:
        with suppress(_Killed):
            simulate(scene, subject.model, folder=Path(name), progress=_Killing())
        resumed = simulate(scene, subject.model, folder=Path(name), resume=True)
        elsewhere = (resumed.displacement() != whole.displacement()).any(axis=1).sum()
    return _none_may(int(elsewhere), "bitwise the same", "resumed to other positions")


def impossible_states(subject: Subject) -> Outcome:
    """Impossible states, turned inside out and with a NaN, that are not refused with the number and place of a point."""
    body = plain(subject.dimension)
    inverted, lost = body.points * MIRROR[: subject.dimension], body.points.copy()
    lost[7] = np.nan
    taken = []
    for positions, reason in ((inverted, "inside out"), (lost, "not finite")):
        try:
            _evaluate(subject, body, positions)
            taken.append(reason)
        except InvalidState as error:
            if not re.search(rf"point \d+ at \(.*\): .*{reason}", str(error)):
                taken.append(f"{reason}: {error}")
    return _none_may(len(taken), "refused with the place", "; ".join(taken))


SETTINGS = {
    "precision": PRECISIONS,
    "correction": tuple(CORRECTIONS),
    "rotation": tuple(ROTATIONS),
    "outside": tuple(OUTSIDE_POLICIES),
    "breakable": (True,),
    "plane": tuple(PLANES),
}
"""Settings of a force evaluation, and the values that can be asked for."""

IN_WORDS = {"breakable": "bonds that break"}
"""Settings that messages call by another name, that of a scene."""


def settings_refused(subject: Subject) -> Outcome:
    """Settings that change nothing, are refused without their name, or are taken or refused against what the model declares."""
    wrong, declared = [], subject.model.honoured(subject.plane)
    for key, values in SETTINGS.items():
        usual, stated, taken = _settings_outcome(subject, key, None), _own_choice(subject, key), {}
        for value in values:
            try:
                taken[value] = _settings_outcome(subject, key, value)
            except ValueError as error:
                if IN_WORDS.get(key, key) not in str(error):
                    wrong.append(f"{key}={value} is refused without its name ({error})")
        # One value may be what the model does anyway: where others differ, or where it says that it does that.
        alive = any(outcome != usual for outcome in taken.values())
        same = [value for value, outcome in taken.items() if outcome == usual]
        wrong += [f"{key}={value} changes nothing" for value in same if len(same) > 1 or not (alive or stated == value)]
        if set(taken) != set(declared.get(key, ())):
            wrong.append(f"{key} is declared as {declared.get(key, ())} and taken as {tuple(taken)}")
    return _none_may(len(wrong), "refused by name", "; ".join(wrong), "settings ignored")


def _bind_with(subject: Subject, key: str, value):
    """An evaluation with one setting; None leaves it to the model."""
    settings = ForceSettings(**{"plane": subject.plane} | ({} if value is None else {key: value}))
    return subject.model.bind(plain(dimension_of(settings.plane)), subject.law, settings)


def _own_choice(subject: Subject, key: str):
    """What an evaluation says that it does where nothing is asked; None of what it does not say."""
    force = _bind_with(subject, key, None)
    return {"precision": force.precision, "correction": force.correction, "plane": force.plane}.get(key)


def _settings_outcome(subject: Subject, key: str, value):
    """What an evaluation does with a setting: its forces to the bit, and whether it warns or stops."""
    force = _bind_with(subject, key, value)
    # Stretched along axes off the grid, where the paper's rotation differs; far beyond the domain of any surrogate.
    d = force.body.dimension
    F = np.diag([6.0, 0.6, 0.6][:d]) if key == "outside" else turn(22.5, d) @ np.diag([1.5, 1.0, 0.8][:d]) @ turn(-22.5, d)
    if value is True:
        force.break_bonds(np.arange(5))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", OutsideDomainWarning)
        try:
            return _forces(force, wavy(force.body.points) @ F.T).tobytes(), len(caught)
        except OutsideDomain:
            return "stops"


PROPERTIES = (
    Property("rigid rotation, 0 to 360 degrees", "forces below 1e-9 mu/dx", rigid_rotation),
    Property("deformed and turned", "forces turn with the body, 1e-9", objectivity, drawn=True),
    Property("evaluated from rest", "the forces of the second evaluation, 1e-9", another_start, drawn=True),
    Property("deformed and mirrored", "mirrored forces, 1e-9", mirror, drawn=True),
    Property("linear momentum", "sum of all forces below 1e-12 of their sizes", linear_momentum, drawn=True),
    Property("angular momentum", "moment of all forces below 1e-9 of its parts", angular_momentum, drawn=True),
    Property("points numbered otherwise", "the same forces, 1e-11", order_of_points, drawn=True),
    Property("units of length and stress", "the same forces, 1e-9", units, drawn=True),
    Property("homogeneous deformation", "mean stress as exact as the model states", homogeneous_stress),
    Property("float32 against float64", "forces within 2e-5", single_precision),
    Property("kernel against NumPy", "the same values, 1e-10", kernel_and_numpy),
    Property("1 thread against 2", "bitwise the same", threads),
    Property("half a sheet at a symmetry plane", "forces of the whole sheet, 1e-11", reflected_half),
    Property("pair forces", "add up to the forces, 1e-10", pair_forces),
    Property("broken bonds", "a body that never had them, 1e-9", broken_bonds),
    Property("bonds broken that were not to break", "refused", unbreakable),
    Property("killed between levels and resumed", "bitwise the same", checkpoint),
    Property("turned inside out, not a number", "refused with the place", impossible_states),
    Property("settings that a model cannot honour", "refused by name", settings_refused),
)
"""The suite, in the order of its report."""


def _force_at_rest(reference: str) -> float:
    """Force density that a force on every bond at rest adds up to, in mu/dx on a square sheet.

    The card states t kappa/(w l mu) of a bond at rest.  Corrections make every horizon count as a whole one, so a point's bonds add up to
    2 mu/kappa times the sum of w l V, at the most, where they do not cancel: 6 mu over the horizon of 3.15 dx.
    """
    return 6 / 3.15 * load_card(reference).errors["box"]["at_rest"]


def _fit_off_surface(reference: str) -> float:
    """Twice the error of the fit, of a body and of its mirror image; averaged over bonds that are off the plane-stress surface."""
    return 2 * load_card(reference).errors["box"]["off_surface"]["rms"]


# Pair forces across their bonds leave moments of second order in the horizon over the size of the body: (0.315/1)^2.
MOMENTS = {"angular_momentum": Departure("moments", 0.1)}
"""Of every force made of averaged features of a bond's ends."""

TABLE = (
    Row("analytic", MOMENTS),
    Row("bond-energy"),
    Row("nosb"),
    Row(
        "ba-nosb",
        MOMENTS
        | {
            # Of the weights alone, not of the state: 6 per cent where sheets are ten points wide.
            "homogeneous_stress": Departure("weights do not add up", 0.07),
            # Forces are formed with the response before the last step of J3, which is below 1e-8, and multiplied by K/mu.
            "another_start": Departure("last step of J3", 1e-6),
        },
    ),
    Row("neo-hookean", MOMENTS),
    Row("neo-hookean@1", MOMENTS),
    Row("neo-hookean-energy"),
    Row(
        "neo-hookean-paper",
        MOMENTS
        | {
            "rigid_rotation": Departure("force at rest", _force_at_rest),
            "mirror": Departure("no mirror symmetry", _fit_off_surface),
        },
    ),
    Row("gent", MOMENTS),
    Row("ogden", MOMENTS),
    Row("full-network", MOMENTS),
    Row("bond-energy", plane="strain"),
    Row("neo-hookean", MOMENTS, plane="strain"),
    Row("neo-hookean-isochoric", plane="strain"),
    Row("bond-energy", plane="space"),
    Row("neo-hookean-isochoric", plane="space"),
    Row("arruda-boyce-isochoric", plane="space"),
    Row("ogden-isochoric", plane="space"),
    Row("full-network-isochoric", plane="space"),
    Row("nosb", plane="space"),
)
"""Every force model that is shipped, and what it states that it does not do."""
