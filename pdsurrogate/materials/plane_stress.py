"""Plane stress of any law: the response of a sheet, and the NumPy functions that check the kernels.

In-plane tensors have shape (..., 2, 2). Stresses and energies have the unit of the law's shear modulus; `bond_traction` is dimensionless.

With F = R U in the plane, the first Piola-Kirchhoff stress of an isotropic law under plane stress is coaxial with U,

    R^T P = p U + q U^-1.

The coefficients (p, q) are functions of the trace of C in the plane, of J = det F in the plane, and of the three-dimensional volume ratio
J3 = J sqrt(C33), with the pressure already eliminated by P33 = 0.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import carray
from numba.core.ccallback import CFunc

from ..engine.block_arrays import BLOCK
from ..engine.compile import STRESS_RESPONSE, block_function_of, inlined, widest_vectors
from ..kernels.bond_state import lateral_stretch
from ..kernels.elementary import exponential, inverse_cube_root, logarithm, select
from ..kernels.node_state import SWELLING
from .consistency import check_consistency
from .law import InvariantLaw, Law
from .response import MOST_PARAMETERS, STATE_NUMBERS, Response

LEAST_SEPARATION = 3e-6
"""Difference of the logarithms to which two equal in-plane stretches are separated.

All results are even in the difference, so they change by some 1e-11, which is the size of rounding there.
"""

INVARIANTS = ((1, 0, -2 / 3), (0, -2, 4 / 3)), ((0, 2, -4 / 3), (1, -2, 2 / 3))
"""Exponents of tr C, J and J3 in the two terms of which I1bar and I2bar are the sums, with C33 = (J3/J)**2."""


@inlined
def isochoric_invariants(state):
    """Return I1bar and I2bar from tr C in the plane, J in the plane and J3, with C33 = (J3/J)**2."""
    trace, J, J3 = state
    c = inverse_cube_root(J3 * J3)
    C33 = (J3 / J) * (J3 / J)
    return c * (trace + C33), c * c * (J * J + C33 * trace)


@inlined
def of_invariants(state, isochoric, volumetric):
    """Return the response from the derivatives of W(I1bar, I2bar) + U(J3); theory (7) with U^3 reduced by Cayley-Hamilton.

    ``d1`` and ``d2`` are J3/2 times the derivatives of the two invariants by J3 at fixed F in the plane, which makes the residual J3
    dPsi/dJ3, the plane-stress condition (paper, Eq. (9), with the exponent of its first term corrected to +2/3).
    """
    trace, J, J3 = state
    W, W1, W2, W11, W12, W22 = isochoric
    U, dU, ddU = volumetric
    c = inverse_cube_root(J3 * J3)
    C33 = (J3 / J) * (J3 / J)
    c33 = c * C33
    p = 2 * c * (W1 + c33 * W2)
    q = -2 * c * (C33 * W1 + c * (C33 * trace - J * J) * W2)

    I1 = c * (trace + C33)
    I2 = c * c * (J * J + C33 * trace)
    mixed = c * c33 * trace
    d1 = c33 - I1 / 3
    d2 = mixed - 2 * I2 / 3
    residual = 2 * (W1 * d1 + W2 * d2) + J3 * dU
    # Derivatives by J3: I1bar' = 2 d1/J3, I2bar' = 2 d2/J3, (c C33)' = 4/3 c C33/J3, (c^2 C33 tr)' = 2/3 c^2 C33 tr/J3.
    d1_slope = (4 * c33 - 2 * d1) / 3
    d2_slope = (2 * mixed - 4 * d2) / 3
    curvature = W11 * d1 * d1 + 2 * W12 * d1 * d2 + W22 * d2 * d2
    slope = (2 * (W1 * d1_slope + W2 * d2_slope) + 4 * curvature) / J3 + dU + J3 * ddU
    return p, q, residual, slope, W + U


@inlined
def principal_stretches(state):
    """Return logarithms and squares of the isochoric principal stretches, those in the plane first, from tr C, J in the plane and J3."""
    trace, J, J3 = state
    half = trace / 2
    # cosh and sinh of the difference of the logarithms; a trace below 2 J can only be a rounding error.
    excess = (half - J) * (half + J) / (J * J)
    least = LEAST_SEPARATION * LEAST_SEPARATION
    excess = select(excess < least, least, excess)
    x1 = logarithm(half / J + np.sqrt(excess)) / 2
    middle = logarithm(J) / 2 - logarithm(J3) / 3
    x2 = middle - x1
    x1 = middle + x1
    x3 = -(x1 + x2)
    return x1, x2, x3, exponential(2 * x1), exponential(2 * x2), exponential(2 * x3)


@inlined
def of_stretches(state, stretches, sums, volumetric):
    """Return the response from the derivatives of W(x1, x2, x3) + U(J3).

    The principal stresses are P_a = (g_a - g_3)/lambda_a, the pressure eliminated by P33 = 0; p lambda_a^2 + q = g_a - g_3 for both.
    """
    trace, _, J3 = state
    _, _, _, s1, s2, _ = stretches
    W, g1, g2, g3, h = sums
    U, dU, ddU = volumetric
    unit = inverse_cube_root(J3 * J3)
    p = unit * (g1 - g2) / (s1 - s2)
    q = (g1 + g2) / 2 - g3 - p * trace / 2
    residual = (2 * g3 - g1 - g2) / 3 + J3 * dU
    slope = h / J3 + dU + J3 * ddU
    return p, q, residual, slope, W + U


response = Response(5, 2, isochoric_invariants, of_invariants, principal_stretches, of_stretches, curvature=True)
"""Response ``response(law, trace, J, J3)``: p, q, the residual J3 dPsi/dJ3 of P33 = 0 at fixed F in the plane, its derivative by J3, and
Psi.
"""


def volumetric_block(law: Law) -> CFunc:
    """Return the compiled function that evaluates J3 U' and its derivative by J3 for a block of states.

    It writes them to the rows in which the full response has the residual of P33 = 0 and its derivative.
    """
    return block_function_of(_volumetric_block, STRESS_RESPONSE, law.volumetric)


def _volumetric_block(volumetric):
    def response(states, parameters, result):
        widest_vectors()
        states = carray(states, (STATE_NUMBERS, BLOCK))
        result = carray(result, (4, BLOCK))
        parameters = carray(parameters, (MOST_PARAMETERS,))
        for k in range(BLOCK):
            J3 = states[2, k]
            _, dU, ddU = volumetric(J3, parameters)
            result[2, k] = J3 * dU
            result[3, k] = dU + J3 * ddU

    return response


def invariants(F):
    """Return tr C and det F of in-plane deformation gradients, each of shape (...)."""
    F = np.asarray(F, dtype=float)
    return (F * F).sum(axis=(-2, -1)), F[..., 0, 0] * F[..., 1, 1] - F[..., 0, 1] * F[..., 1, 0]


def stretch_squares(trace: float, area_ratio: float) -> np.ndarray:
    """Return the squares of the principal stretches at tr C and det F in the plane and constant volume, shape (3,)."""
    half = trace / 2
    root = np.sqrt(max(half**2 - area_ratio**2, 0.0))
    return np.array([half - root, half + root, area_ratio**-2])


def volume_ratio(law: Law, trace, area_ratio):
    """Return the J3 that makes P33 = 0 (paper, Eq. (9)), shape (...), by Newton's method from 1; then C33 = (J3/J)**2.

    Raise ValueError where J = det F is not positive or the law has no such state (beyond its limit), and if the law's derivatives are not
    those of its energy.
    """
    check_consistency(law)
    trace, J = np.broadcast_arrays(np.asarray(trace, float), np.asarray(area_ratio, float))
    if np.any(~(J > 0)):
        raise ValueError(f"det F must be positive; the least given is {np.nanmin(J):g}")
    J3 = newton(lambda J3: response(law, trace, J, J3)[2:4], np.ones_like(J), 1e-15)
    with np.errstate(all="ignore"):
        residual = response(law, trace, J, J3)[2]
    # NaN, and a residual that does not vanish, both mean that the state is beyond the law's limit.
    scale = law.bulk_modulus / law.shear_modulus
    failed = ~(np.abs(residual) <= 1e-9 * scale)
    if np.any(failed):
        first = np.flatnonzero(failed.ravel())[0]
        state = float(trace.ravel()[first]), float(J.ravel()[first])
        raise ValueError(
            f"{law.name}: no plane-stress state at tr C = {state[0]:g}, det F = {state[1]:g}: {law.limit(stretch_squares(*state))}"
        )
    return J3


def newton(function: Callable[[np.ndarray], tuple], start: np.ndarray, tolerance: float) -> np.ndarray:
    """Return the zeros of increasing functions of positive numbers, up to a last relative step of `tolerance`.

    ``function(x)`` returns values and slopes. A number at most halves or doubles in one step, so it stays positive from any start. Beyond
    a law's limit the value is NaN, and the number grows: a state with a larger volume may lie within the limit.
    """
    found = start
    with np.errstate(all="ignore"):
        for _ in range(60):
            value, slope = function(found)
            step = np.where(slope > 0, value / slope, np.sign(value) * found)
            found = found - np.where(np.isnan(value + slope), -SWELLING * found, np.clip(step, -found, 0.5 * found))
            if np.all(np.abs(step) <= tolerance * found):
                break
    return found


def thickness_stretch_squared(law: Law, trace, area_ratio):
    """Return C33 of the plane-stress state."""
    return (volume_ratio(law, trace, area_ratio) / area_ratio) ** 2


def first_piola_stress(law: Law, F):
    """Return the in-plane first Piola-Kirchhoff stress P (paper, Eq. (8)), shape (..., 2, 2), in the same unit as the shear modulus."""
    trace, J = invariants(F)
    p, q, *_ = response(law, trace, J, volume_ratio(law, trace, J))
    return law.shear_modulus * in_plane_stress(F, p, q)


def in_plane_stress(F, p, q):
    """Return P = p F + q F^-T in the plane, shape (..., 2, 2)."""
    F = np.asarray(F, dtype=float)
    cofactor = np.empty_like(F)
    cofactor[..., 0, 0], cofactor[..., 0, 1] = F[..., 1, 1], -F[..., 1, 0]
    cofactor[..., 1, 0], cofactor[..., 1, 1] = -F[..., 0, 1], F[..., 0, 0]
    return p[..., None, None] * F + (q / invariants(F)[1])[..., None, None] * cofactor


def energy_density(law: Law, F):
    """Return the strain energy density of the plane-stress state, shape (...), in the same unit as the shear modulus."""
    trace, J = invariants(F)
    return law.shear_modulus * response(law, trace, J, volume_ratio(law, trace, J))[4]


def energy_at(law: Law, F, volume_ratio):
    """Return the energy density in units of mu, shape (n,), at the volume ratio J3 (n,) of the points."""
    return response(law, *invariants(F), volume_ratio)[4]


def stress_and_energy(law: Law, F, volume_ratio, bulk_stress=None):
    """Return the first Piola-Kirchhoff stress (n, 3, 3) and the energy density (n,) of points at their J3, dimensional.

    `bulk_stress` is unused: under plane stress J3 determines the stress.
    """
    p, q, _, _, energy = response(law, *invariants(F), volume_ratio)
    stress = np.zeros((len(F), 3, 3))
    stress[:, :2, :2] = in_plane_stress(F, p, q)
    return law.shear_modulus * stress, law.shear_modulus * energy


def energy_derivatives(law: Law, trace, area_ratio):
    """Return psi, psi_I, psi_J, psi_II, psi_IJ, psi_JJ of the plane-stress energy as a function of I = tr C and J, dimensionless.

    At fixed J3 the energy has the derivatives of the law; J3 follows from dPsi/dJ3 = 0, so the first derivatives are those at fixed J3, and
    the second ones are psi_ab = Psi_ab - Psi_ax Psi_bx/Psi_xx, x = J3. For a law that is no `InvariantLaw` the second derivatives are
    fourth-order differences of the first, accurate to some ten digits. All arrays have shape (n,). Raise ValueError where J is not positive
    or the law has no plane-stress state.
    """
    trace, J = (np.asarray(value, dtype=float) for value in (trace, area_ratio))
    x = volume_ratio(law, trace, J)
    p, q, _, slope, energy = response(law, trace, J, x)
    if not isinstance(law, InvariantLaw):
        return energy, p / 2, q / J, *_differences(law, trace, J)
    state = np.stack([trace, J, x])
    _, W1, W2, W11, W12, W22 = law.isochoric(*isochoric_invariants(state), law.parameters)
    (a, A), (b, B) = (_power_derivatives(np.array(terms), state) for terms in INVARIANTS)
    second = W1 * A + W2 * B + W11 * a * a[:, None] + W12 * (a * b[:, None] + b * a[:, None]) + W22 * b * b[:, None]
    condensed = second - second[2] * second[:, 2:] / (slope / x)
    return energy, p / 2, q / J, condensed[0, 0], condensed[0, 1], condensed[1, 1]


def _power_derivatives(exponents: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and second derivatives, (3, n) and (3, 3, n), of a sum of products of powers of three numbers."""
    terms = np.prod(state ** exponents[:, :, None], axis=1)
    twice = exponents[:, :, None] * (exponents[:, None] - np.eye(3))
    return exponents.T @ terms / state, np.einsum("kij,kn->ijn", twice, terms) / (state * state[:, None])


def _differences(law: Law, trace, J):
    """Return psi_II, psi_IJ and psi_JJ by differences towards larger tr C and smaller J, since no states exist below tr C = 2 J."""
    weights = np.array([-25, 48, -36, 16, -3]) / 12
    step_trace, step_J = 2e-3 * trace, 2e-3 * J
    by_trace, by_J = np.zeros((2, *np.shape(J))), np.zeros((2, *np.shape(J)))
    for number, weight in enumerate(weights):
        for total, I, area in ((by_trace, trace + number * step_trace, J), (by_J, trace, J - number * step_J)):  # noqa: E741
            p, q, *_ = response(law, I, area, volume_ratio(law, I, area))
            total += weight * np.stack([p / 2, q / area])
    return by_trace[0] / step_trace, by_trace[1] / step_trace, -by_J[1] / step_J


def bond_traction(law: Law, normal_stretch, shear_stretch, area_ratio, C33):
    """Return (T_nn, T_nm, T_mm) of the exact bond force in the corotated frame, R^T P / mu (theory (7), (11)).

    The bond is given by a = U_nn = lambda_b cos(dtheta), b = U_nm = lambda_b sin(dtheta), J and C33; these need not satisfy plane stress.
    """
    a, b, J, C33 = (np.asarray(value, dtype=float) for value in (normal_stretch, shear_stretch, area_ratio, C33))
    U_mm = lateral_stretch(a, b, J)
    p, q, *_ = response(law, a * a + 2 * b * b + U_mm * U_mm, J, J * np.sqrt(C33))
    return p * a + q * U_mm / J, (p - q / J) * b, p * U_mm + q * a / J
