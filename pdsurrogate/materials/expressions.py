"""Stresses and energies from the derivatives of W and U, as elementwise expressions of the numbers
that describe a state.

A sheet with F = R U in the plane has a first Piola-Kirchhoff stress that is coaxial with U,

    R^T P = p U + q U^-1.

The coefficients (p, q) are functions of the trace of C in the plane, of J = det F in the plane, and
of the three-dimensional volume ratio J3 = J sqrt(C33). Under plane stress P33 = 0 eliminates the
pressure; plane strain has the same expressions at J3 = J, and a reaction stress across the plane,
which keeps C33 = 1. A solid has three coefficients of tr C, tr cof C and J = det F,

    P = p F + q cof F + r F C.

All results are dimensionless, in units of the law's shear modulus.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..engine.compile import inlined
from ..kernels.elementary import exponential, inverse_cube_root, like, logarithm, select
from .response import Response

LEAST_SEPARATION = 3e-6
"""Least difference between the logarithms of two principal stretches in the plane; equal stretches
are moved apart by as much.

All results are even in the difference, so they change by some 1e-11, which is the size of rounding
there.
"""


@inlined
def sheet_invariants(state):
    """Return I1bar and I2bar of a sheet from its state: tr C and det F = J in the plane, and
    volume ratio J3, with C33 = (J3/J)**2.
    """
    trace, J, J3 = state
    c = inverse_cube_root(J3 * J3)
    C33 = (J3 / J) * (J3 / J)
    return c * (trace + C33), c * c * (J * J + C33 * trace)


@inlined
def of_sheet_invariants(state, isochoric, volumetric):
    """Return the plane-stress response (p, q, residual, its slope, energy) of a sheet from the
    derivatives of W(I1bar, I2bar) + U(J3).

    `isochoric` is (W, W1, W2, W11, W12, W22), and `volumetric` is (U, U', U''). p and q are the
    coefficients of the stress in theory (7). The residual is J3 dPsi/dJ3 at fixed F in the plane,
    which vanishes in plane stress, and its slope is the derivative by J3 (Eq. (9) of the paper,
    with the exponent of C33 in its first term corrected from -2/3 to +2/3).
    """
    trace, J, J3 = state
    W, W1, W2, W11, W12, W22 = isochoric
    U, dU, ddU = volumetric
    c = inverse_cube_root(J3 * J3)
    C33 = (J3 / J) * (J3 / J)
    c33 = c * C33
    p = 2 * c * (W1 + c33 * W2)
    q = -2 * c * (C33 * W1 + c * (C33 * trace - J * J) * W2)

    I1, I2 = sheet_invariants(state)
    mixed = c * c33 * trace
    # d1 and d2 are J3/2 times the derivatives of the two invariants by J3 at fixed F in the plane.
    d1 = c33 - I1 / 3
    d2 = mixed - 2 * I2 / 3
    residual = 2 * (W1 * d1 + W2 * d2) + J3 * dU
    # Derivatives by J3: I1bar' = 2 d1/J3, I2bar' = 2 d2/J3, (c C33)' = 4/3 c C33/J3, (c^2 C33 tr)'
    # = 2/3 c^2 C33 tr/J3.
    d1_slope = (4 * c33 - 2 * d1) / 3
    d2_slope = (2 * mixed - 4 * d2) / 3
    curvature = W11 * d1 * d1 + 2 * W12 * d1 * d2 + W22 * d2 * d2
    slope = (2 * (W1 * d1_slope + W2 * d2_slope) + 4 * curvature) / J3 + dU + J3 * ddU
    return p, q, residual, slope, W + U


@inlined
def sheet_stretches(state):
    """Return logarithms and squares of the isochoric principal stretches of a sheet, thickness
    last, from tr C, in-plane J and J3.
    """
    trace, J, J3 = state
    half = trace / 2
    # cosh and sinh of the difference of the logarithms; a trace below 2 J can only be a rounding
    # error.
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
def of_sheet_stretches(state, stretches, sums, volumetric):
    """Return the plane-stress response (p, q, residual, its slope, energy) of a sheet from the
    derivatives of W(x1, x2, x3) + U(J3).

    x1, x2 and x3 are the logarithms of the isochoric principal stretches. The residual is that of
    P33 = 0, from which J3 is found, and its slope is the derivative by J3. The principal stresses
    in the plane are P_a = (g_a - g_3)/lambda_a, with the derivatives g_a = dW/dx_a and the pressure
    eliminated by P33 = 0; the coefficients p and q follow from p lambda_a^2 + q = g_a - g_3 for
    both. `sums` is (W, g1, g2, g3, h), see `PrincipalStretchLaw.term`.
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


@inlined
def _held(state):
    """Return the state (tr C, J, J3) of a sheet with its J3 replaced by J, so that C33 = 1."""
    return state[0], state[1], state[1]


@inlined
def _stress_rows(state, found):
    """Return the results of `PLANE_STRAIN` from the plane-stress results `found` at C33 = 1: q +
    J3 dPsi/dJ3 takes the place of q.
    """
    p, q, across, _, energy = found
    return p, q + across, state[2] / state[1] - 1, 1 / state[1], energy


@inlined
def _isochoric_rows(state, found):
    """Return the results of `ISOCHORIC_PLANE_STRAIN` (p, q, stress across, energy) from the
    plane-stress results `found` at C33 = 1.
    """
    p, q, across, _, energy = found
    return p, q + across, across, energy


def _energy_before_slope(response: Callable) -> Callable:
    """Return the plane-stress response with energy and slope exchanged: the energy is then in the
    row in which other isochoric responses have it.
    """

    @inlined
    def exchanged(state, *derivatives):
        p, q, residual, slope, energy = response(state, *derivatives)
        return p, q, residual, energy, slope

    return exchanged


def _of_held_sheet(rows: int, result: Callable, isochoric: bool) -> Response:
    """Return a `Response` for plane strain, whose results ``result(state, found)`` computes from
    the plane-stress results at C33 = 1.
    """

    @inlined
    def invariants(state):
        return sheet_invariants(_held(state))

    @inlined
    def of_invariants(state, isochoric, volumetric):
        return result(state, of_sheet_invariants(_held(state), isochoric, volumetric))

    @inlined
    def stretches(state):
        return sheet_stretches(_held(state))

    @inlined
    def of_stretches(state, stretches, sums, volumetric):
        return result(state, of_sheet_stretches(_held(state), stretches, sums, volumetric))

    return Response(
        rows, 1, invariants, of_invariants, stretches, of_stretches, isochoric=isochoric
    )


@inlined
def _solid_invariants(state):
    """Return the isochoric invariants I1bar and I2bar of a solid from its state (tr C, tr cof C,
    J).
    """
    trace, cofactor_trace, J = state
    c = inverse_cube_root(J * J)
    return c * trace, c * c * cofactor_trace


@inlined
def _of_solid_invariants(state, isochoric, volumetric):
    """Return the stress coefficients p, q, r and the energy of a solid from the derivatives of
    W(I1bar, I2bar) + U(J).
    """
    trace, cofactor_trace, J = state
    W, W1, W2, _, _, _ = isochoric
    U, dU, _ = volumetric
    c = inverse_cube_root(J * J)
    two = like(J, 2.0)
    # dI1 = 2 F, dI2 = 2 (I1 F - F C), dJ = cof F.
    p = two * c * (W1 + c * trace * W2)
    q = dU - two * c * (W1 * trace + two * W2 * c * cofactor_trace) / (like(J, 3.0) * J)
    return p, q, -two * c * c * W2, W + U


@inlined
def _solid_stretches(state):
    """Return logarithms and squares of the isochoric principal stretches of a solid, with the
    stretch farthest from the others last.

    The eigenvalues of C are mean + 2 sqrt(spread) cos(phi + 2 pi k/3) with cos(3 phi) = c. The
    greatest, for c > 0, or else the least is given by the root y = cos(arccos(abs(c))/3) of 4 y^3 -
    3 y = abs(c): between sqrt(3)/2 and 1, where Newton's method reaches rounding in three steps.
    The other two follow from the invariants without cancellation, by the formula for a sheet.

    Nearly equal stretches, as roots of a cubic, are only known to some 6e-6; equal ones are moved
    apart by as much. But they belong to invariants within 1e-11 of the given ones, of which energy
    and stress are smooth functions: energy and stress are accurate to 2e-11, and to rounding at
    distinct stretches (``tests/materials/test_responses.py``). The single coefficients are less
    accurate: at three equal stretches r is off by some 1e-5, and compensating errors in p and q
    keep the stress accurate.
    """
    trace, cofactor_trace, J = state
    mean = trace / 3
    spread = mean * mean - cofactor_trace / 3
    # Three equal stretches are separated by the same difference of logarithms as two in a plane.
    least = LEAST_SEPARATION * mean
    spread = select(spread < least * least, least * least, spread)
    root = np.sqrt(spread)
    skew = mean * (mean * mean - cofactor_trace / 2) + J * J / 2
    c = abs(skew) / (spread * root)
    c = select(c < 1, c, 1.0)
    # Exact in value and slope at c = 0; 0.0327 = sqrt(3/4) + 1/6 - 1 makes it exact at c = 1.
    y = np.sqrt(0.75) + c * (1 / 6 - 0.0327 * c)
    for _ in range(3):
        y = y - (y * (4 * y * y - 3) - c) / (12 * y * y - 3)
    apart = mean + 2 * root * y * select(skew < 0, -1.0, 1.0)
    # Sum and product of the other two: for a greatest one the product is computed first, for a
    # least one the sum.
    rest = trace - apart
    product = select(skew < 0, cofactor_trace - apart * rest, J * J / apart)
    rest = select(skew < 0, rest, (cofactor_trace - product) / apart)
    return sheet_stretches((rest, np.sqrt(product), J))


@inlined
def _of_solid_stretches(state, stretches, sums, volumetric):
    """Return the stress coefficients p, q, r and the energy of a solid from the derivatives of
    W(x1, x2, x3) + U(J).

    The principal Kirchhoff stresses are g_a - (g_1 + g_2 + g_3)/3 + J U', with the derivatives g_a
    of W by the logarithmic stretches. The quadratic polynomial q J + p s + r s^2 of the squared
    stretches s takes these values; divided differences give the coefficients.
    """
    J = state[2]
    _, _, _, s1, s2, s3 = stretches
    W, g1, g2, g3, _ = sums
    U, dU, _ = volumetric
    first = (g1 - g2) / (s1 - s2)
    second = (first - (g1 - g3) / (s1 - s3)) / (s2 - s3)
    constant = (2 * g1 - g2 - g3) / 3 - s1 * (first - second * s2)
    unit = inverse_cube_root(J * J)
    return unit * (first - second * (s1 + s2)), constant / J + dU, unit * unit * second, W + U


PLANE_STRESS = Response(
    5, 2, sheet_invariants, of_sheet_invariants, sheet_stretches, of_sheet_stretches, curvature=True
)
"""Response of a sheet in plane stress to (tr C, J, J3): stress coefficients p and q, residual,
slope of the residual, and energy Psi.

The residual of P33 = 0 is J3 dPsi/dJ3 at fixed F in the plane, and its slope is the derivative by
J3.
"""

ISOCHORIC_PLANE_STRESS = replace(
    PLANE_STRESS,
    of_invariants=_energy_before_slope(of_sheet_invariants),
    of_stretches=_energy_before_slope(of_sheet_stretches),
    isochoric=True,
)
"""Response of a sheet in plane stress as `PLANE_STRESS`, with all results from W alone, the energy
before the slope; p and q have the pressure eliminated by P33 = 0.
"""

PLANE_STRAIN = _of_held_sheet(5, _stress_rows, isochoric=False)
"""Response of a sheet in plane strain to (tr C, J, J3), with the rows of `PLANE_STRESS`, so that
kernels can use either response.

p, q and the energy are those at J3 = J, whatever J3 is passed; the condition P33 = 0 is replaced by
J3/J - 1 = 0, with its derivative by J3.
"""

ISOCHORIC_PLANE_STRAIN = _of_held_sheet(4, _isochoric_rows, isochoric=True)
"""Response of a sheet in plane strain to (tr C, J, J3): p, q, the Kirchhoff stress across the
plane, and the energy, all from W alone.

U adds J U' to q and to the stress across the plane, since the first Piola-Kirchhoff stress from U
is U' times the cofactor of F.
"""

SOLID = Response(
    4, 2, _solid_invariants, _of_solid_invariants, _solid_stretches, _of_solid_stretches
)
"""Response of a solid to (tr C, tr cof C, J): stress coefficients p, q and r of P = p F + q cof
F + r F C, and the energy.
"""

ISOCHORIC_SOLID = replace(SOLID, isochoric=True)
"""Response of a solid as `SOLID`, with all results from W alone; U adds U' to q."""
