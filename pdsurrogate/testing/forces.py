"""Properties required of the forces of every force model, whatever the solver."""

from collections.abc import Callable, Iterable
from functools import cache, wraps
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from ..body import Body
from ..engine.threads import most_threads, thread_count
from ..forces import (
    FORCES,
    EnergySurrogate,
    ForceSurrogate,
    InternalForce,
)
from ..forces.kernel_values import kernel_bond_force, kernel_energy
from ..forces.settings import PRECISIONS
from ..learning import training_samples
from .bodies import (
    DEFORMATIONS,
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


def error_of(force: InternalForce, found: np.ndarray, expected: np.ndarray) -> float:
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
    force = subject.bind(body)
    found = []
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
    still = _settled(force, positions)
    energy = _energy(force)
    errors = []
    for degrees in (15, 110, 170, 200, 275, 360):
        rotation = turn(degrees, subject.dimension)
        turned = _settled(force, positions @ rotation.T + [3.0, -2.0, 1.0][: subject.dimension])
        errors += [error_of(force, turned @ rotation, still), abs(_energy(force) - energy)]
    return errors


@drawn(1e-9)
def another_start(subject, force, positions):
    """Return the relative change of the forces if the iteration for J3 starts from the undeformed
    instead of the converged state.

    The iteration converges quadratically: if its last step is below 1e-8, the error of the volume
    ratio J3 is the square, 1e-16, and the forces change by K/mu times 1e-16.
    """
    forces_at(force, force.body.points)
    return error_of(force, forces_at(force, positions), forces_at(force, positions))


@drawn(1e-9)
def mirror(subject, force, positions):
    """Return the relative difference of the forces on a mirrored body and the mirrored forces on
    the original.
    """
    across = MIRROR[: subject.dimension]
    mirrored = _settled(_mirrored(subject), positions * across)
    return error_of(force, mirrored, _settled(force, positions) * across)


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
    forces = _settled(force, positions)
    arms = positions - positions.mean(axis=0)
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
    return error_of(force, found, _settled(force, positions)[order])


@drawn(1e-9)
def units(subject, force, positions):
    """Return the relative changes of the forces if lengths are divided and stresses multiplied by
    1e9, and the reverse.

    The forces are compared in the changed units: stress times length (per unit thickness) in the
    plane, stress times length^2 in solids.
    """
    d = subject.dimension
    expected = _settled(force, positions)
    errors = []
    for length, stress in ((1e-9, 1e9), (1e9, 1e-9)):
        other = _in_other_units(subject, length, stress)
        found = _settled(other, length * positions) / (length ** (d - 1) * stress)
        errors.append(error_of(force, found, expected))
    return errors


AWAY = 2.0**20
GRID = 2.0**-32
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
    near, far = _near_and_far(subject)
    placed = GRID * np.rint(positions / GRID)
    expected = _settled(near, placed)
    found = _settled(far, placed + AWAY)
    return [error_of(near, found, expected), abs(_energy(far) - _energy(near))]


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
    errors = []
    limits = []
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
    model = subject.model
    law = subject.law
    required(subject.plane == "stress", "its NumPy implementation is for sheets")
    required(isinstance(model, ForceSurrogate | EnergySurrogate), "no NumPy implementation")
    required(model.compiled("float64").address, "no compiled kernel")
    if isinstance(model, ForceSurrogate):
        X = training_samples(law, 1000, (0.8, 3.5), random_state=11).X.T
        found = kernel_bond_force(model, law, np.float64)(*X)
        expected = model.bond_force(*X)
    else:
        stretches = np.random.default_rng(11).uniform(0.6, 4.5, (1000, 2))
        states = (stretches**2).sum(axis=1), stretches.prod(axis=1)
        own = model.energy_derivatives(law, *states)
        found = kernel_energy(model, law, "float64", *states)
        expected = np.stack([own.psi, own.by_trace, own.by_area])
    return off(found, expected)


@tested(0.0)
def threads(subject: Subject) -> float:
    """Return the number of forces and energies that have other bits on two threads than on one,
    in every precision of the model.
    """
    required(most_threads() >= 2, "one thread was asked for, or numba started with one")
    body = sheet(0.05) if subject.dimension == 2 else plain(3)
    found = {1: [], 2: []}
    for count, values in found.items():
        with thread_count(count):
            for precision in subject.takes("precision"):
                force = subject.bind(body, precision=precision)
                values += [forces_at(force, wavy(body.points)), _energy(force)]
    return sum(not np.array_equal(one, two) for one, two in zip(*found.values(), strict=True))


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
        total = np.zeros_like(body.all_points)
        pairs = force.pair_forces()
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
    body = plain(subject.dimension)
    cut = plain(subject.dimension, separates=crosses)
    positions = wavy(body.points)
    force = subject.bind(body, breakable=True)
    built = subject.bind(cut, breakable=True)
    forces_at(force, positions)
    pairs = np.flatnonzero(crosses(body.points[body.bonds.first], body.points[body.bonds.second]))
    for part in np.array_split(pairs, 2):
        force.break_bonds(part)
    found = forces_at(force, positions)
    expected = forces_at(built, positions)
    lost = np.abs(force.pair_forces()[pairs]).max() / np.abs(expected).max()
    return np.max([off(found, expected), lost, abs(_energy(force) - _energy(built))])
