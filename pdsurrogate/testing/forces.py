"""Properties required of the forces of every force model, whatever the solver."""

import re
import warnings
from collections.abc import Callable, Iterable
from functools import cache, wraps
from typing import Any

import numpy as np
import scipy
from scipy.linalg import block_diag

from ..body import Body, ReflectionPlane
from ..engine.threads import most_threads, thread_count
from ..forces import (
    FORCES,
    EnergySurrogate,
    ForceSurrogate,
    InternalForce,
    InvalidState,
    OutsideDomain,
    OutsideDomainWarning,
)
from ..forces.kernel_values import kernel_bond_force, kernel_energy
from ..forces.settings import PRECISIONS, SETTINGS
from ..learning import training_samples
from ..materials import dimension_of
from ..problem import compile_scene
from ..problem.materials import checked_models
from .bodies import (
    DEFORMATIONS,
    SPACING,
    crack,
    disc_with_hole,
    gripped,
    jittered,
    notched,
    of_points,
    plain,
    sheet,
    turn,
    wavy,
)
from .properties import Property, required
from .subject import FAILURES, Subject, force_densities, forces_at, mean_stress_at, off

MIRROR = np.array([-1.0, 1.0, 1.0])
"""Signs of x1, x2 and x3 in a reflection in the plane x1 = 0; a body of dimension d uses the
first d entries.
"""


def tested(tolerance: float) -> Callable[[Callable], Property]:
    """Return a decorator that makes a `Property` of a function that measures a `Subject`."""
    return lambda function: Property(function.__name__, tolerance, function, FAILURES)


def _energy(force: InternalForce) -> float:
    """Return the stored energy of the last state, divided by the shear modulus and the volume;
    zero for a force without an energy.
    """
    return (
        force.energy() / (force.law.shear_modulus * force.body.volumes.sum())
        if force.has_energy
        else 0.0
    )


def _scale(force: InternalForce, forces: np.ndarray) -> float:
    """Return the divisor of the errors of `forces`: their greatest component, but at least the
    number mu dx (in solids, too).
    """
    return max(float(np.abs(forces).max()), force.law.shear_modulus * force.body.spacing)


def _error(force: InternalForce, found: np.ndarray, expected: np.ndarray) -> float:
    """Return the greatest difference of two arrays of forces, relative to their `_scale`."""
    return float(np.abs(found - expected).max()) / _scale(force, expected)


def _settled(force: InternalForce, positions: np.ndarray) -> np.ndarray:
    """Return the forces of a second evaluation, whose iteration for the volume ratio J3 starts from
    the converged values of the first.

    `another_start` tests the effect of other start values.
    """
    forces_at(force, positions)
    return forces_at(force, positions)


@cache
def _on_notched(subject: Subject) -> InternalForce:
    """Return the force of a subject on the `notched` body."""
    return subject.bind(notched(subject.dimension))


@cache
def _mirrored(subject: Subject) -> InternalForce:
    """Return the force of a subject on the mirrored `notched` body."""
    return subject.bind(of_points(notched(subject.dimension).points * MIRROR[: subject.dimension]))


@cache
def _renumbered(subject: Subject) -> tuple[InternalForce, np.ndarray]:
    """Return the force of a subject on the `notched` body with its points renumbered, and their
    former numbers in the new order.
    """
    points = notched(subject.dimension).points
    order = np.random.default_rng(20240109).permutation(len(points))
    return subject.bind(of_points(points[order])), order


@cache
def _in_other_units(subject: Subject, length: float, stress: float) -> InternalForce:
    """Return the force of a subject on the `notched` body with lengths and stresses multiplied
    by factors.
    """
    body = notched(subject.dimension)
    scaled = Body(
        length * body.points,
        length**subject.dimension * body.volumes,
        length * body.horizon,
        length * body.spacing,
    )
    return subject.bind(scaled, subject.law.scaled(stress))


def drawn(tolerance: float) -> Callable[[Callable], Property]:
    """Return a decorator that makes a `Property` of a function that measures a force on a `notched`
    body at deformed positions.

    The greatest value over several deformations counts, by default `DEFORMATIONS`.
    """

    def declare(function: Callable[[Subject, InternalForce, np.ndarray], Any]) -> Property:
        @wraps(function)
        def measure(subject: Subject, deformations: Iterable = DEFORMATIONS) -> float:
            force = _on_notched(subject)
            return np.max(
                [
                    np.max(function(subject, force, deformation(force.body.points)))
                    for deformation in deformations
                ]
            )

        return Property(function.__name__, tolerance, measure, FAILURES, drawn=True)

    return declare


@tested(1e-9)
def rigid_rotation(subject: Subject) -> float:
    """Return the greatest force and energy of an undeformed body that is rotated by 0 to 360
    degrees.

    Forces per volume are measured in mu/dx (shear modulus/spacing), the energy in mu times the
    volume. Rounding of positions leaves 1e-15 K/mu, times the number of spacings along the body.
    """
    body = plain(subject.dimension)
    force, found = subject.bind(body), []
    for degrees in range(0, 361, 15):
        found += [
            np.abs(force_densities(force, body.points @ turn(degrees, subject.dimension).T)).max(),
            abs(_energy(force)),
        ]
    return np.max(found)


@drawn(1e-9)
def objectivity(subject, force, positions):
    """Return relative changes of the forces (rotated back) and of the energy if a deformed body is
    rotated by 15 to 360 degrees and moved.

    Rounding of the positions, 1e-15, is a strain of 1e-14 over a spacing, multiplied by K/mu and
    some thirty bonds: 1e-10, a tenth of the limit.
    """
    still, energy, errors = _settled(force, positions), _energy(force), []
    for degrees in (15, 110, 170, 200, 275, 360):
        rotation = turn(degrees, subject.dimension)
        turned = _settled(force, positions @ rotation.T + [3.0, -2.0, 1.0][: subject.dimension])
        errors += [_error(force, turned @ rotation, still), abs(_energy(force) - energy)]
    return errors


@drawn(1e-9)
def another_start(subject, force, positions):
    """Return the relative change of the forces if the iteration for J3 starts from the undeformed
    instead of the converged state.

    The iteration converges quadratically: if its last step is below 1e-8, the error of the volume
    ratio J3 is the square, 1e-16, and the forces change by K/mu times 1e-16.
    """
    forces_at(force, force.body.points)
    return _error(force, forces_at(force, positions), forces_at(force, positions))


@drawn(1e-9)
def mirror(subject, force, positions):
    """Return the relative difference of the forces on a mirrored body and the mirrored forces on
    the original.
    """
    across = MIRROR[: subject.dimension]
    mirrored = _settled(_mirrored(subject), positions * across)
    return _error(force, mirrored, _settled(force, positions) * across)


@drawn(1e-12)
def linear_momentum(subject, force, positions):
    """Return the sum of all forces on a body divided by the sum of their magnitudes.

    Rounding of some 2,000 bond forces, by 1e-16 each, leaves less than the limit, 1e-12.
    """
    forces = _settled(force, positions)
    return np.abs(forces.sum(axis=0)).max() / max(
        float(np.abs(forces).sum()), _scale(force, forces)
    )


@drawn(1e-9)
def angular_momentum(subject, force, positions):
    """Return the moment of all forces about the middle of the body, divided by the sum of (lever
    arm times force) over the points.

    Rounding leaves 1e-15.
    """
    forces, arms = _settled(force, positions), positions - positions.mean(axis=0)
    lengths = np.linalg.norm(arms, axis=1)
    # These are the components of the moment, in two or three dimensions.
    moment = np.abs(arms.T @ forces - forces.T @ arms).max()
    return moment / max(
        float((lengths * np.linalg.norm(forces, axis=1)).sum()),
        lengths.max() * _scale(force, forces),
    )


@drawn(1e-11)
def order_of_points(subject, force, positions):
    """Return the relative change of the forces if the points are renumbered, which sums bonds in
    another order.

    Rounding is 1e-16 for each of some thirty bonds, multiplied by K/mu where the large volumetric
    parts of the bond forces cancel.
    """
    renumbered, order = _renumbered(subject)
    found = _settled(renumbered, positions[order])
    return _error(force, found, _settled(force, positions)[order])


@drawn(1e-9)
def units(subject, force, positions):
    """Return the relative changes of the forces if lengths are divided and stresses multiplied by
    1e9, and the reverse.

    The forces are compared in the changed units: stress times length (per unit thickness) in the
    plane, stress times length^2 in solids.
    """
    d, expected, errors = subject.dimension, _settled(force, positions), []
    for length, stress in ((1e-9, 1e9), (1e9, 1e-9)):
        other = _in_other_units(subject, length, stress)
        found = _settled(other, length * positions) / (length ** (d - 1) * stress)
        errors.append(_error(force, found, expected))
    return errors


AWAY, GRID = 2.0**20, 2.0**-32
"""Distance along every axis in `far_from_the_origin`, some 1e6, and the grid on which coordinates
of its bodies lie: sums and differences of them are then exact.
"""


@cache
def _near_and_far(subject: Subject) -> tuple[InternalForce, InternalForce]:
    """Return the forces of a subject on the `notched` body, its points on the `GRID`, at the
    origin and `AWAY` from it.
    """
    points = GRID * np.rint(notched(subject.dimension).points / GRID)
    return subject.bind(of_points(points)), subject.bind(of_points(points + AWAY))


@drawn(1e-12)
def far_from_the_origin(subject, force, positions):
    """Return the relative changes of the forces and of the energy if the body lies a million
    lengths from the origin.

    Positions enter by their differences alone, which are exact here: what is left is rounding in
    sums.
    """
    (near, far), placed = _near_and_far(subject), GRID * np.rint(positions / GRID)
    expected, found = _settled(near, placed), _settled(far, placed + AWAY)
    return [_error(near, found, expected), abs(_energy(far) - _energy(near))]


GRADIENTS = (
    np.array([[1.5, 0.0], [0.0, 0.82]]),
    np.array([[1.0, 0.8], [0.0, 1.0]]),
    turn(143) @ np.array([[1.8, 0.3], [0.1, 0.9]]),
    np.array([[0.85, 0.1], [0.0, 0.9]]),
)
"""In-plane deformation gradients of `homogeneous_stress`: tension, shear, a rotated state and
compression, all within the domain of every shipped artifact.
"""


@tested(0.0)
def homogeneous_stress(subject: Subject) -> tuple[float, str]:
    """Return the relative error of the mean stress in homogeneous states beyond rounding and beyond
    the errors on the card of an artifact.

    Four states of three bodies with different weight functions are compared with the law's stress;
    the greatest excess counts.

    An exact force gives the stress of the law, at the boundary too, except for rounding: 1e-13
    multiplied by K/mu. For an artifact its card bounds the error: the stress P is twice the mean of
    (bond force t) (x) (bond direction n) over all directions, so its error is at most twice the
    greatest error of a bond force, which the card states for the strain of the state. A model
    without T_mm, the stress across a bond, also has errors at edges, where forces are corrected by
    a scalar: it is compared with the exact force under this correction.
    """
    random = np.random.default_rng(20240109)
    rounding = 1e-13 * subject.law.bulk_modulus / subject.law.shear_modulus
    errors, limits = [], []
    d = subject.dimension
    for body in (
        plain(d, weight="inverse"),
        disc_with_hole(d, weight="constant"),
        jittered(random, dimension=d, weight="linear"),
    ):
        force = subject.bind(body)
        scalar = force.correction == "scalar"
        exact = (
            subject.bind(body, model=FORCES["analytic"](), correction="scalar") if scalar else None
        )
        for F in map(_extended, GRADIENTS) if d == 3 else GRADIENTS:
            errors.append(
                off(
                    mean_stress_at(force, F),
                    mean_stress_at(exact, F) if scalar else subject.exact_stress(F),
                )
            )
            limits.append(rounding + _stated_error(subject, F))
    worst = int(np.argmax(np.subtract(errors, limits)))  # NaN is treated as the greatest value
    return (
        np.maximum(errors[worst] - limits[worst], 0.0),
        f"error {errors[worst]:.1e} of {limits[worst]:.1e} allowed",
    )


def _extended(F: np.ndarray) -> np.ndarray:
    """Return an in-plane deformation gradient extended by a stretch along x3 to determinant
    0.97, between two rotations, shape (3, 3).
    """
    return turn(50, 3) @ block_diag(F, 0.97 / np.linalg.det(F)) @ turn(20, 3)


def _stated_error(subject: Subject, F: np.ndarray) -> float:
    """Return the bound of the relative stress error at a deformation gradient F from the card of an
    artifact; 0 without a card.

    The bound is twice the greatest error of a bond force that the card states for the strain of F.
    """
    strain = float(np.abs(np.linalg.svd(F, compute_uv=False) - 1).max())
    return 2 * max(
        (
            entry["max"]
            for entry in subject.stated
            if entry["strain"][0] <= strain <= entry["strain"][1]
        ),
        default=0.0,
    )


@tested(2e-5)
def single_precision(subject: Subject) -> float:
    """Return the difference of the forces in float32 and float64 on a deformed body, divided by the
    greatest force.

    A few roundings of 6e-8 on each of some thirty bond forces, which are larger than their sum,
    stay below this limit.
    """
    required("float32" in subject.takes("precision"), "double precision only")
    body = plain(subject.dimension)
    single, double = (
        forces_at(subject.bind(body, precision=precision), wavy(body.points))
        for precision in PRECISIONS
    )
    return off(single, double)


@tested(1e-10)
def kernel_and_numpy(subject: Subject) -> float:
    """Return the difference of a surrogate's compiled kernel and its NumPy implementation, divided
    by the greatest value.

    The inputs are 1,000 random ones: features of a bond for a bond force, invariants of the
    deformation gradient for an energy. Some 40 roundings of terms that are up to ten thousand times
    their sum leave 1e-10 in float64. `single_precision` tests float32.
    """
    model, law = subject.model, subject.law
    required(subject.plane == "stress", "its NumPy implementation is for sheets")
    required(isinstance(model, ForceSurrogate | EnergySurrogate), "no NumPy implementation")
    required(model.compiled("float64").address, "no compiled kernel")
    if isinstance(model, ForceSurrogate):
        X = training_samples(law, 1000, (0.8, 3.5), random_state=11).X.T
        found, expected = kernel_bond_force(model, law, np.float64)(*X), model.bond_force(*X)
    else:
        stretches = np.random.default_rng(11).uniform(0.6, 4.5, (1000, 2))
        states = (stretches**2).sum(axis=1), stretches.prod(axis=1)
        own = model.energy_derivatives(law, *states)
        found, expected = (
            kernel_energy(model, law, "float64", *states),
            np.stack([own.psi, own.by_trace, own.by_area]),
        )
    return off(found, expected)


@tested(0.0)
def threads(subject: Subject) -> float:
    """Return the number of forces and energies that have other bits on two threads than on one,
    in every precision of the model.
    """
    required(most_threads() >= 2, "one thread was asked for, or numba started with one")
    body, found = sheet(0.05) if subject.dimension == 2 else plain(3), {1: [], 2: []}
    for count, values in found.items():
        with thread_count(count):
            for precision in subject.takes("precision"):
                force = subject.bind(body, precision=precision)
                values += [forces_at(force, wavy(body.points)), _energy(force)]
    return sum(not np.array_equal(one, two) for one, two in zip(*found.values(), strict=True))


@tested(1e-11)
def reflected_half(subject: Subject) -> float:
    """Return the difference of the forces on half a body at a reflection plane and on that half of
    the whole, symmetrically deformed.

    Ghosts (mirror images) take the place of the other half, so the same bonds are summed in another
    order.
    """
    d = subject.dimension
    half, whole = (
        plain(d, width=0.6, planes=(ReflectionPlane(0, 0.6, 1, (-1, 1, 1)[:d]),)),
        plain(d, width=1.2),
    )
    x1, x2, *rest = (whole.points - [0.6, 0, 0][:d]).T
    across = [0.8 * x3 + 0.03 * x2 * x1**2 for x3 in rest]
    positions = np.stack(
        [0.6 + 1.4 * x1 + 0.1 * x1 * np.cos(3 * x2), 0.9 * x2 + 0.05 * x1**2, *across], axis=1
    )
    left = whole.points[:, 0] < 0.6
    force = subject.bind(whole)
    expected = forces_at(force, positions)
    found = forces_at(subject.bind(half), positions[left])
    return _error(force, found, expected[left])


CUTS = {
    2: (
        {"start": (0.0, -0.3), "end": (0.42, -0.3)},
        {"start": (-0.42, -0.3), "end": (0.42, -0.3)},
        {"start": (0.1, 0.1), "end": (0.1, 0.5)},
        {"start": (-0.1, 0.5), "end": (-0.1, 0.1)},
    ),
    3: (
        *({"center": (0.0, -0.3, 0.0), "radius": 0.35, "normal": (0.0, 1.0, 0.0)},) * 2,
        {"center": (0.1, 0.2, 0.0), "radius": 0.3, "normal": (1.0, 0.0, 0.0)},
        {"center": (-0.1, 0.2, 0.0), "radius": 0.3, "normal": (-1.0, 0.0, 0.0)},
    ),
}
"""Cuts of `reflected_parts`, by dimension: one that meets the plane x1 = 0, of the half and of the
whole, and one a cell beside the plane, with its image.
"""


@tested(1e-6)
def reflected_parts(subject: Subject) -> float:
    """Return the difference of the forces and loads on a half with cuts and a quarter with a hole,
    at or beside planes of symmetry, and on these parts of the wholes.

    Weights that balance the boundary are solutions to 1e-8, and the ends of faces of cuts follow
    places some 1e-6 cells inside.
    """
    d, errors = subject.dimension, []
    hole = {"radius": 0.33} if d == 2 else {"radius": 0.33, "base": (0, 0, -0.2), "length": 0.4}
    holed = {
        "holes": [{"shape": subject.sized("circle", "cylinder"), **hole}],
        "loads": [{"region": "holes", "pressure": 0.2}],
    }
    met, all_met, near, image = CUTS[d]
    for axes, of_part, of_whole in (
        ((0, 1), holed, holed),
        ((0,), {"precuts": [met, near]}, {"precuts": [all_met, near, image]}),
    ):
        (part, own), (whole, expected) = (
            _deformed_at(subject, axes, of_part),
            _deformed_at(subject, (), of_whole),
        )
        errors.append(off(own, expected[scipy.spatial.cKDTree(whole).query(part)[1]]))
    return np.max(errors)


def _deformed_at(
    subject: Subject, axes: tuple[int, ...], described: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (n, d) of a body 1.6 wide, or of its part between planes of symmetry
    normal to `axes`, and the forces and loads on it in a state symmetric about these.
    """
    d = subject.dimension
    lower = np.array([-0.8 * (axis not in axes) for axis in (0, 1)] + [-0.2])[:d]
    upper = np.array([0.8, 0.8, 0.2])[:d]
    corner = {"box": ((upper - 0.2).tolist(), upper.tolist())}
    scene = subject.scene(
        (),
        spacing=SPACING,
        steps=1.0,
        body={"shape": subject.sized("rectangle", "box"), "size": upper - lower, "lower": lower},
        prescribed=[
            *({"region": ("left", "bottom")[axis], f"x{axis + 1}": 0.0} for axis in axes),
            subject.held_at(corner),
        ],
        **described,
    )
    with warnings.catch_warnings(action="ignore"):
        problem = compile_scene(scene, checked_models(scene, subject.model))
        _, force = problem.bind("float64")
    x1, x2, *rest = points = problem.body.points.T
    stretched = [
        1.1 * x1 + 0.05 * x1 * np.cos(2 * x2),
        0.95 * x2 + 0.05 * x2 * x1**2,
        *(0.9 * x3 + 0.05 * x2**2 for x3 in rest),
    ]
    force.loads.set(1.0)
    return points.T, forces_at(force, np.stack(stretched, axis=1))


@tested(1e-10)
def pair_forces(subject: Subject) -> float:
    """Return the difference of the forces on points and the sums of their pair forces, on a free
    body and between planes of reflection.

    The sums have another order, and a model recomputes the terms that it does not store. Pair
    forces computed for selected pairs alone must agree with those of all pairs, too.
    """
    errors = []
    for body in (plain(subject.dimension), gripped(subject.dimension)):
        force = subject.bind(body)
        out = forces_at(force, body.points + 0.1 * (wavy(body.points) - body.points))
        total, pairs = np.zeros_like(body.all_points), force.pair_forces()
        np.add.at(total, body.bonds.first, pairs)
        np.add.at(total, body.bonds.second, -pairs)
        some = np.arange(len(pairs))[::-3]
        errors += [
            off(total[: len(body)], out),
            np.abs(force.pair_forces(some) - pairs[some]).max(),
        ]
    return np.max(errors)


@tested(1e-9)
def broken_bonds(subject: Subject) -> float:
    """Return the difference of the forces on a body whose bonds break in two steps and on a body
    built without these bonds.

    Sums over the bonds of a point are formed in another order, and the iteration for the volume
    ratio J3 starts from other values (`another_start`); the limit is 1e-9. The pair forces of the
    broken bonds must vanish, too.
    """
    required(True in subject.takes("breakable"), "its bonds do not break")
    crosses = crack(0.5, 0.6)
    body, cut = plain(subject.dimension), plain(subject.dimension, separates=crosses)
    positions = wavy(body.points)
    force, built = subject.bind(body, breakable=True), subject.bind(cut, breakable=True)
    forces_at(force, positions)
    pairs = np.flatnonzero(crosses(body.points[body.bonds.first], body.points[body.bonds.second]))
    for part in np.array_split(pairs, 2):
        force.break_bonds(part)
    found, expected = forces_at(force, positions), forces_at(built, positions)
    lost = np.abs(force.pair_forces()[pairs]).max() / np.abs(expected).max()
    return np.max([off(found, expected), lost, abs(_energy(force) - _energy(built))])


@tested(0.0)
def unbreakable(subject: Subject) -> tuple[float, str]:
    """Return 0 if a force bound without the setting ``breakable`` refuses to break bonds with an
    error that names it, otherwise 1.
    """
    force = subject.bind(plain(subject.dimension), precision=None)
    try:
        force.break_bonds(np.arange(5))
    except ValueError as error:
        return float("breakable" not in str(error)), str(error)
    return 1.0, "broken all the same"


@tested(0.0)
def impossible_states(subject: Subject) -> tuple[float, str]:
    """Return how many of a mirrored body (det F < 0) and of positions with NaN are not refused
    with the number and place of a point.
    """
    body = plain(subject.dimension)
    inverted, lost = body.points * MIRROR[: subject.dimension], body.points.copy()
    lost[7] = np.nan
    taken = []
    for positions, reason in ((inverted, "inside out"), (lost, "not finite")):
        try:
            forces_at(subject.bind(body), positions)
            taken.append(reason)
        except InvalidState as error:
            if not re.search(rf"point \d+ at \(.*\): .*{reason}", str(error)):
                taken.append(f"{reason}: {error}")
    return len(taken), "; ".join(taken)


IN_WORDS = {"breakable": "bonds that break"}
"""Text by which error messages name a force setting, where it is not the name of the setting
itself.
"""


@tested(0.0)
def settings_refused(subject: Subject) -> tuple[float, str]:
    """Return the number of values of force settings that are ignored, or declared but refused, or
    refused without their name.

    A value that is accepted, differs from the default and changes neither the forces nor the number
    of warnings counts as ignored.
    """
    wrong, declared = [], subject.model.honored(subject.plane)
    for key, values in SETTINGS.items():
        usual, stated, taken = (
            _settings_outcome(subject, key, None),
            getattr(_bind_with(subject, key, None), key, None),
            {},
        )
        for value in values:
            try:
                taken[value] = _settings_outcome(subject, key, value)
            except ValueError as error:
                if IN_WORDS.get(key, key) not in str(error):
                    wrong.append(f"{key}={value} is refused without its name ({error})")
        # One value may equal the model's default: then others differ, or the model declares this
        # value.
        alive = any(outcome != usual for outcome in taken.values())
        same = [value for value, outcome in taken.items() if outcome == usual]
        wrong += [
            f"{key}={value} changes nothing"
            for value in same
            if len(same) > 1 or not (alive or stated == value)
        ]
        if set(taken) != set(declared.get(key, ())):
            wrong.append(
                f"{key} is declared as {declared.get(key, ())} and taken as {tuple(taken)}"
            )
    return len(wrong), "; ".join(wrong)


def _bind_with(subject: Subject, key: str, value: Any) -> InternalForce:
    """Return the force of the model under test on a body, with the setting `key` set to a value;
    None leaves the model's default.
    """
    settings = {} if value is None else {key: value}
    dimension = dimension_of(settings.get("plane", subject.plane))
    return subject.bind(plain(dimension), **{"precision": None} | settings)


def _settings_outcome(subject: Subject, key: str, value: Any) -> Any:
    """Return the forces as bytes and the number of warnings under a setting, or "stops" if the
    evaluation raises OutsideDomain.

    The setting `key` has the given value, None for the default; if the value is True (of
    ``breakable``), five bonds are broken first.
    """
    force = _bind_with(subject, key, value)
    # The stretch is along axes off the grid, where the paper's rotation differs, and far beyond the
    # domain of any surrogate.
    d = force.body.dimension
    F = (
        np.diag([6.0, 0.6, 0.6][:d])
        if key == "outside"
        else turn(22.5, d) @ np.diag([1.5, 1.0, 0.8][:d]) @ turn(-22.5, d)
    )
    if value is True:
        force.break_bonds(np.arange(5))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", OutsideDomainWarning)
        try:
            return forces_at(force, wavy(force.body.points) @ F.T).tobytes(), len(caught)
        except OutsideDomain:
            return "stops"
