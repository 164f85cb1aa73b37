"""Training data of bond forces: states of bonds, and the exact force in each of them."""

from itertools import product

import numpy as np

from ..arguments import check_share
from ..kernels.bond_force import along_and_across
from ..kernels.weights import WEIGHT_FUNCTIONS
from ..materials import Law, plane_stress
from .base import named

COLUMNS = ("stretch", "rotation", "length", "C33", "J")
"""Columns of X: bond stretch, rotation of the bond relative to its horizon in radians, bond
length, C33, and det F in the plane.
"""

OUTPUTS = ("t_n", "t_tau")
"""Columns of y: bond force along and across the deformed bond."""


def wide_bonds(
    law: Law,
    n_samples: int,
    stretch_range: tuple[float, float],
    near_rest: float,
    off_surface: float,
    random_state: int,
) -> tuple[np.ndarray, np.ndarray, dict, np.ndarray]:
    """Draw bond-force samples uniform in log-stretch (theory, section 5): return X, y, their design
    and principal stretches.

    The design is the dictionary of the parameters with which the samples were drawn.

    The share `near_rest` of the states, with small strains (`log_stretches`), comes first. The
    share `off_surface` is off the plane-stress surface, on which C33 follows from the in-plane
    stretches: bond stretch, rotation and C33 are perturbed independently, by amounts that shrink
    with the strain, and y is the law's exact bond force as a function of the perturbed values.
    """
    check_share(off_surface, "off_surface")
    low, high = stretch_range
    random = np.random.default_rng(random_state)
    logs = log_stretches(random, n_samples, low, high, near_rest)
    stretches = np.exp(logs)
    angle = random.uniform(0, 2 * np.pi, n_samples)
    length = random.uniform(0, 1, n_samples)
    U_nn, U_nm, J, C33 = on_surface(law, *stretches.T, angle)

    # The greatest perturbations, or less where the range of stretches ends below their full size.
    share = min(1.0, max(np.log(high), -np.log(low)) / PERTURBATION["full_from_strain"])
    perturbation = {key: float(share * value) for key, value in PERTURBATION.items()}
    perturbed = random.random(n_samples) < off_surface
    scale = np.minimum(1, np.abs(logs).max(axis=1) * perturbed / perturbation["full_from_strain"])
    stretch = np.hypot(U_nn, U_nm) * np.exp(
        perturbation["log_stretch"] * scale * random.uniform(-1, 1, n_samples)
    )
    rotation = np.arctan2(U_nm, U_nn) + perturbation["rotation"] * scale * random.uniform(
        -1, 1, n_samples
    )
    C33 = C33 * np.exp(perturbation["log_C33"] * scale * random.uniform(-1, 1, n_samples))
    X, y = force_on_bonds(
        law, stretch * np.cos(rotation), stretch * np.sin(rotation), J, C33, 1 - length
    )
    design = {
        "name": "wide",
        "n_samples": n_samples,
        "stretch_range": [low, high],
        "near_rest": near_rest,
        "off_surface": off_surface,
        "perturbation": perturbation,
        "random_state": random_state,
        "nondimensional": True,
    }
    return X, y, design, stretches


def random_order(n_samples: int, near_rest: float, random_state: int) -> np.ndarray:
    """Return a random order of the rows of drawn samples, in which states of small strain come
    first and would make folds unequal.
    """
    return (
        np.arange(n_samples)
        if near_rest == 0
        else np.random.default_rng([random_state, 1]).permutation(n_samples)
    )


def log_stretches(
    random: np.random.Generator, n_samples: int, low: float, high: float, near_rest: float
) -> np.ndarray:
    """Return logarithms of principal stretches, shape (n_samples, 2), uniform within their bounds
    except near the undeformed state.

    The share `near_rest` of the samples, the first ones, has strains uniform in the logarithm of
    the strain, with upper limit 30 % or, if that is less, the strain at the bound `low` or `high`,
    and lower limit 0.1 % or, if that is less, a tenth of the upper limit.
    """
    logs = random.uniform(np.log(low), np.log(high), (n_samples, 2))
    n_near = int(near_rest * n_samples)
    direction = random.standard_normal((n_near, 2))
    to_bounds = (
        np.where(direction < 0, np.log(low), np.log(high))
        * np.linalg.norm(direction, axis=1, keepdims=True)
        / direction
    )
    greatest = np.minimum(0.3, to_bounds.min(axis=1))
    size = np.exp(random.uniform(np.log(np.minimum(1e-3, greatest / 10)), np.log(greatest)))
    logs[:n_near] = np.clip(
        size[:, None] * direction / np.linalg.norm(direction, axis=1, keepdims=True),
        np.log(low),
        np.log(high),
    )
    return logs


PERTURBATION = {"log_stretch": 0.15, "rotation": 0.08, "log_C33": 0.35, "full_from_strain": 0.2}
"""Greatest perturbations of bond stretch, rotation and C33 in samples, and the log-strain from
which perturbations have their full size.

In a run J and C33 of a bond are means over two points, so that bonds leave the plane-stress
surface, on which C33 follows from the in-plane stretches, the farther the greater the strain is
(theory, section 5). Chosen: with smaller perturbations more bonds leave the domain of a surrogate;
greater ones cost accuracy everywhere.
"""


def bond_states_reached(law: Law, low: float, high: float) -> bool:
    """Return whether a law is finite in all states of `wide_bonds` with log-stretches from `low`
    to `high`, by a test of the extremes.
    """
    # The perturbation stretches one direction at constant area; its rotation adds a little, for
    # which the factors 1.3 and 1.1 allow.
    stretch = 1.3 * PERTURBATION["log_stretch"]
    thickness = 1.1 * PERTURBATION["log_C33"]
    states = product((low, high), (low, high), (-stretch, 0, stretch), (-thickness, 0, thickness))
    first, second, J3 = np.exp(
        [(first + move, second - move, bulk / 2) for first, second, move, bulk in states]
    ).T
    with np.errstate(all="ignore"):
        response = plane_stress.response(law, first**2 + second**2, first * second, J3)
    return bool(np.isfinite(response).all())


def range_of_stretches(trace, J) -> tuple[float, float]:
    """Return the least and the greatest principal stretch that occur among states of a sheet,
    from tr C and J of each state.
    """
    total = np.sqrt(trace + 2 * J)
    difference = np.sqrt(np.maximum(trace - 2 * J, 0))
    return float((total - difference).min() / 2), float((total + difference).max() / 2)


@named()
def force_factor(length, horizon: float, weight: str, shear_modulus: float):
    """Return w l mu/kappa, the factor from a dimensionless bond force to the force of Eq. (2) of
    the paper on a full circular horizon.

    Here w is the weight and l the `length` of a bond, mu the shear modulus, and kappa I the shape
    tensor of the full horizon.
    """
    function = WEIGHT_FUNCTIONS[weight]
    return (
        function.function(length, horizon)
        * length
        * shear_modulus
        / (function.moments[0] * horizon**4)
    )


def checked_range(stretch_range) -> tuple[float, float]:
    """Return a range of principal stretches as two numbers; raise ValueError unless the
    undeformed state is within it.
    """
    try:
        low, high = map(float, stretch_range)
    except (TypeError, ValueError):
        raise ValueError(
            "stretch_range must be two numbers, the least principal stretch and the greatest, not"
            f" {stretch_range!r}"
        ) from None
    if not (np.isfinite(high) and 0 < low < 1 < high):
        raise ValueError(
            f"a range of principal stretches needs 0 < least < 1 < greatest, finite, not {low:g}"
            f" and {high:g}"
        )
    return low, high


def on_surface(law, stretch_1, stretch_2, angle):
    """Return the stretch components U_nn and U_nm, J, and C33 under plane stress of bonds in states
    with given principal stretches.

    The axis n is along a bond and m across; `angle` is that between the bond and the axis of
    `stretch_1`.
    """
    cos = np.cos(angle)
    sin = np.sin(angle)
    J = stretch_1 * stretch_2
    C33 = plane_stress.thickness_stretch_squared(law, stretch_1**2 + stretch_2**2, J)
    return stretch_1 * cos**2 + stretch_2 * sin**2, (stretch_2 - stretch_1) * sin * cos, J, C33


def force_on_bonds(law, U_nn, U_nm, J, C33, length):
    """Return inputs X and exact bond forces y of a law (columns `COLUMNS` and `OUTPUTS`) for
    bonds in given states.
    """
    T_nn, T_nm, _ = plane_stress.bond_traction(law, U_nn, U_nm, J, C33)
    stretch = np.hypot(U_nn, U_nm)
    X = np.column_stack([stretch, np.arctan2(U_nm, U_nn), length, C33, J])
    return X, along_and_across(T_nn, T_nm, U_nn, U_nm, stretch)
