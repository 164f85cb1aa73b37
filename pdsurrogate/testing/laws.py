"""Properties required of every law: derivatives, objectivity, stresses of sheets against those
of solids, and compiled expressions.
"""

from collections.abc import Callable

import numba
import numpy as np
from scipy.spatial.transform import Rotation

from ..engine.block_arrays import BLOCK
from ..engine.compile import call_block
from ..materials import (
    LAWS,
    PLANES,
    Law,
    dimension_of,
    homogeneous,
    plane_strain,
    plane_stress,
    solid,
)
from ..materials.consistency import check_consistency
from ..scenes.model import MaterialSpec
from .properties import Property, required
from .subject import off

STATES = 40
"""Number of random states in which a law is tested; those beyond the limit of the law are left
out.
"""

RANGES = {"stress": (0.5, 4.0), "strain": (0.6, 2.0), "space": (0.6, 2.0)}
"""Ranges of the principal stretches of these states, by plane."""

FAINT = 1e-5
"""Strain at which `small_strain_moduli` compares the moduli: the next term of the expansion is
of its relative order.
"""


def of_law(tolerance: float) -> Callable[[Callable], Property]:
    """Return a decorator that makes a `Property` of a function that measures a law."""
    return lambda function: Property(function.__name__, tolerance, function, (ValueError,))


@numba.njit
def _call(address, states, parameters, result):
    call_block(address, states, parameters, result)


def compiled_response(law: Law, *state, response=plane_stress.response) -> np.ndarray:
    """Return the rows of a compiled response of a law at states of any number, each argument of
    shape (n,).
    """
    columns = []
    for at in range(0, len(state[0]), BLOCK):
        size = min(BLOCK, len(state[0]) - at)
        states = np.stack(
            [np.pad(values[at : at + size], (0, BLOCK - size), "edge") for values in state]
        )
        result = np.zeros((response.rows, BLOCK))
        _call(response.block(law).address, states, law.parameters, result)
        columns.append(result[:, :size])
    return np.concatenate(columns, axis=1)


def _gradients(law: Law, plane: str) -> np.ndarray:
    """Return deformation gradients in which a law has a state: turned stretches within `RANGES`,
    with volumes near that of rubber.
    """
    random = np.random.default_rng(20240109)
    d = dimension_of(plane)
    low, high = RANGES[plane]
    stretches = np.exp(random.uniform(np.log(low), np.log(high), (STATES, d)))
    if plane != "stress":
        stretches *= (random.uniform(0.9, 1.1, STATES) / stretches.prod(axis=1))[:, None] ** (1 / d)
    left, right = (_turns(random, d) for _ in range(2))
    F = left @ (stretches[:, :, None] * right)
    F = F[PLANES[plane].has_state(law, F)]
    if not len(F):
        raise ValueError(
            f"{law.name} has none of the {STATES} states, of stretches from {low} to {high}"
        )
    return F


def _turns(random: np.random.Generator, d: int) -> np.ndarray:
    if d == 3:
        return Rotation.random(STATES, rng=random).as_matrix()
    about = random.uniform(0, 2 * np.pi, STATES)[:, None] * [0.0, 0.0, 1.0]
    return Rotation.from_rotvec(about).as_matrix()[:, :2, :2]


def _in_space(F: np.ndarray, thickness_stretch) -> np.ndarray:
    """Return deformation gradients of sheets, shape (n, 2, 2), with a stretch across the sheet,
    shape (n, 3, 3).
    """
    full = np.zeros((len(F), 3, 3))
    full[:, :2, :2] = F
    full[:, 2, 2] = thickness_stretch
    return full


def _stiffest(law: Law) -> float:
    """Return the greater one of bulk and shear modulus, by which rounding of stresses is
    measured.
    """
    return max(law.bulk_modulus, law.shear_modulus)


@of_law(0.0)
def derivatives(law: Law) -> float:
    """Return 1 if a coded derivative is not that of the energy, or if the undeformed material
    has a stress or other moduli; otherwise 0.
    """
    check_consistency(law)
    return 0.0


@of_law(1e-6)
def stress_of_the_energy(law: Law) -> float:
    """Return the error of stresses against differences of the energy in plane stress, in plane
    strain and in space, in units of K.
    """
    h = 1e-5
    errors = []
    for plane, states in PLANES.items():
        F = _gradients(law, plane)
        P = states.first_piola_stress(law, F)
        for i, j in np.ndindex(F.shape[1:]):
            step = np.zeros(F.shape[1:])
            step[i, j] = h
            slope = (
                states.energy_density(law, F + step) - states.energy_density(law, F - step)
            ) / (2 * h)
            # Next to the limit of a law the step may lead beyond it.
            there = np.isfinite(slope)
            errors.append(
                np.abs(P[there, i, j] - slope[there]) / (_stiffest(law) + np.abs(slope[there]))
            )
    return np.concatenate(errors).max()


@of_law(1e-9)
def stress_at_rest(law: Law) -> float:
    """Return the greatest stress and energy of the undeformed material, in units of its shear
    modulus.
    """
    found = [
        np.abs(quantity(law, np.eye(3 if name == "space" else 2))).max()
        for name, plane in PLANES.items()
        for quantity in _both(plane)
    ]
    return np.max(found) / law.shear_modulus


def _both(plane) -> tuple[Callable, Callable]:
    return plane.first_piola_stress, plane.energy_density


@of_law(1e-10)
def objectivity(law: Law) -> float:
    """Return the change of stresses (turned back) and energies if the body, or the material in
    it, is turned, in units of K.
    """
    errors = []
    for name, plane in PLANES.items():
        F = _gradients(law, name)
        Q = _turns(np.random.default_rng(1), F.shape[-1])[: len(F)]
        P, W = (quantity(law, F) for quantity in _both(plane))
        for turned, expected in ((Q @ F, Q @ P), (F @ Q, P @ Q)):
            found = plane.first_piola_stress(law, turned), plane.energy_density(law, turned)
            errors += [
                _relative(law, one, other) for one, other in zip(found, (expected, W), strict=True)
            ]
    return np.max(errors)


def _relative(law: Law, found: np.ndarray, expected: np.ndarray) -> float:
    return float((np.abs(found - expected) / (_stiffest(law) + np.abs(expected))).max())


@of_law(1e-10)
def sheets_and_solids(law: Law) -> float:
    """Return the difference of stresses and energies of sheets and of solids in the same state,
    and the stress across sheets, over K.
    """
    errors = []
    for plane in (plane_stress, plane_strain):
        F = _gradients(law, "stress" if plane is plane_stress else "strain")
        trace, J = plane_stress.invariants(F)
        full = _in_space(F, plane.volume_ratio(law, trace, J) / J)
        P, W = (quantity(law, full) for quantity in _both(solid))
        errors += [
            _relative(law, plane.first_piola_stress(law, F), P[:, :2, :2]),
            _relative(law, plane.energy_density(law, F), W),
        ]
        if plane is plane_stress:
            errors.append(np.abs(P[:, 2, 2]).max() / _stiffest(law))
    return np.max(errors)


@of_law(1e-4)
def small_strain_moduli(law: Law) -> float:
    """Return the relative error of Young's modulus 9 K mu/(3 K + mu) and of Poisson's ratio (3 K
    - 2 mu)/(6 K + 2 mu) in tension.
    """
    K = law.bulk_modulus
    mu = law.shear_modulus
    state = homogeneous.uniaxial(law, 1 + FAINT)
    found = np.array([state.nominal_stress, 1 - state.lateral_stretch]) / FAINT
    expected = np.array([9 * K * mu / (3 * K + mu), (3 * K - 2 * mu) / (6 * K + 2 * mu)])
    return np.max(np.abs(found / expected - 1))


@of_law(1e-10)
def compiled_and_numpy(law: Law) -> float:
    """Return the difference of the compiled responses and of the same expressions in NumPy,
    relative to the greatest value of each row.
    """
    errors = []
    for name, plane in PLANES.items():
        state = plane.invariants(_gradients(law, name))
        state = (
            state
            if name == "space"
            else (*state, np.random.default_rng(2).uniform(0.9, 1.1, len(state[0])))
        )
        pairs = zip(
            compiled_response(law, *state, response=plane.response),
            plane.response(law, *state),
            strict=True,
        )
        errors += [
            _relative(law, law.shear_modulus * compiled, law.shear_modulus * plain)
            for compiled, plain in pairs
        ]
    return np.max(errors)


@of_law(1e-12)
def unit_of_stress(law: Law) -> float:
    """Return the relative change of stresses if all moduli are multiplied by 1e6 (``scaled``),
    in the changed unit.
    """
    F = _gradients(law, "space")
    return off(solid.first_piola_stress(law.scaled(1e6), F) / 1e6, solid.first_piola_stress(law, F))


@of_law(0.0)
def description(law: Law) -> float:
    """Return 0 if the law that a scene or card makes from ``describe()`` equals the law,
    otherwise 1.
    """
    required(
        LAWS.get(law.name) is type(law),
        "it is not in pdsurrogate.materials.LAWS, so that scenes cannot name it",
    )
    return float(MaterialSpec(**law.describe()).build() != law)


LAW_PROPERTIES = tuple(found for found in globals().values() if isinstance(found, Property))
"""All properties required of a law, in the order in which `pdsurrogate.testing.check_law`
measures them.
"""
