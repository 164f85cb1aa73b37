"""Three-dimensional stress of any law from the invariants of the deformation gradient.

Tensors have shape (..., 3, 3). Stresses and energies have the unit of the law's shear modulus.

The first Piola-Kirchhoff stress of an isotropic law is

    P = p F + q cof F + r F C,

with three coefficients that are functions of tr C, tr cof C and J = det F.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..engine.compile import inlined
from ..kernels.elementary import inverse_cube_root, select
from ..kernels.feature_sets import like
from . import plane_stress
from .consistency import check_consistency
from .law import Law
from .response import Response


@inlined
def isochoric_invariants(state):
    """Return I1bar and I2bar."""
    trace, cofactor_trace, J = state
    c = inverse_cube_root(J * J)
    return c * trace, c * c * cofactor_trace


@inlined
def of_invariants(state, isochoric, volumetric):
    """Return (p, q, r, energy) from the derivatives of W(I1bar, I2bar) + U(J)."""
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
def principal_stretches(state):
    """Return logarithms and squares of the isochoric principal stretches, the one farthest from the others last.

    The eigenvalues of C are mean + 2 sqrt(spread) cos(phi + 2 pi k/3) with cos(3 phi) = c. The greatest, for c > 0, or else the least is
    given by the root y = cos(arccos(abs(c))/3) of 4 y^3 - 3 y = abs(c): between sqrt(3)/2 and 1, where Newton's method reaches rounding in
    three steps. The other two follow from the invariants without cancellation, as the principal stretches of a plane.

    Nearly equal stretches, as roots of a cubic, are only known to some 6e-6 and are separated by as much. But they belong to invariants
    within 1e-11 of the given ones, of which energy and stress are smooth functions: these are accurate to 2e-11, and to rounding at
    distinct stretches (``tests/materials/test_responses.py``). The single coefficients are less accurate: at three equal stretches r is off
    by some 1e-5, which p and q compensate.
    """
    trace, cofactor_trace, J = state
    mean = trace / 3
    spread = mean * mean - cofactor_trace / 3
    # Three equal stretches are separated by the same difference of logarithms as two in a plane.
    least = plane_stress.LEAST_SEPARATION * mean
    spread = select(spread < least * least, least * least, spread)
    root = np.sqrt(spread)
    skew = mean * (mean * mean - cofactor_trace / 2) + J * J / 2
    c = abs(skew) / (spread * root)
    c = select(c < 1, c, 1.0)
    y = np.sqrt(0.75) + c * (1 / 6 - 0.0327 * c)
    for _ in range(3):
        y = y - (y * (4 * y * y - 3) - c) / (12 * y * y - 3)
    apart = mean + 2 * root * y * select(skew < 0, -1.0, 1.0)
    # Sum and product of the other two: for a greatest one the product is computed first, for a least one the sum.
    rest = trace - apart
    product = select(skew < 0, cofactor_trace - apart * rest, J * J / apart)
    rest = select(skew < 0, rest, (cofactor_trace - product) / apart)
    return plane_stress.principal_stretches((rest, np.sqrt(product), J))


@inlined
def of_stretches(state, stretches, sums, volumetric):
    """Return (p, q, r, energy) from the derivatives of W(x1, x2, x3) + U(J).

    The principal Kirchhoff stresses are g_a - (g_1 + g_2 + g_3)/3 + J U'; the polynomial in the squared stretches through them, by divided
    differences, has p, q J and r as coefficients.
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


response = Response(4, 2, isochoric_invariants, of_invariants, principal_stretches, of_stretches)
"""Response ``response(law, trace, cofactor_trace, J)``: p, q, r and the energy, dimensionless, from tr C, tr cof C and J = det F > 0."""


isochoric_response = replace(response, isochoric=True)
"""Response ``isochoric_response(law, trace, cofactor_trace, J)``: p, q, r and the energy, all from W alone; U adds U' to q."""


def invariants(F):
    """Return tr C, tr cof C and det F, each of shape (...)."""
    F = np.asarray(F, dtype=float)
    cofactor = _cofactor(F)
    return (F * F).sum(axis=(-2, -1)), (cofactor * cofactor).sum(axis=(-2, -1)), (F[..., 0] * cofactor[..., 0]).sum(axis=-1)


isochoric_state = invariants
"""Function that returns the arguments of `isochoric_response` from F."""


def stretch_squares(F):
    """Return the squares of the isochoric principal stretches, shape (..., 3)."""
    return np.linalg.svd(F, compute_uv=False) ** 2 / np.abs(np.linalg.det(F))[..., None] ** (2 / 3)


def why_no_energy(law: Law, F) -> str | None:
    """Explain why a law has no energy at one deformation gradient (3 by 3, or 2 by 2 in plane strain); return None where it has one."""
    full, d = np.eye(3), len(F)
    full[:d, :d] = F
    with np.errstate(all="ignore"):  # non-finite values are tested below
        found = isochoric_response(law, *invariants(full))[3]
    return None if np.isfinite(found) else law.limit(stretch_squares(full))


def first_piola_stress(law: Law, F):
    """Return the first Piola-Kirchhoff stress P, shape (..., 3, 3), a stress in the same unit as ``law.shear_modulus``."""
    check_consistency(law)
    F = np.asarray(F, dtype=float)
    p, q, r = (value[..., None, None] for value in response(law, *invariants(F))[:3])
    return law.shear_modulus * (p * F + q * _cofactor(F) + r * (F @ (F.swapaxes(-1, -2) @ F)))


def energy_density(law: Law, F):
    """Return the strain energy per undeformed volume, shape (...), in the same unit as ``law.shear_modulus``."""
    check_consistency(law)
    return law.shear_modulus * response(law, *invariants(F))[3]


def energy_at(law: Law, F, volume_ratio):
    """Return the energy density in units of mu, shape (n,): W at F plus U at the given volume ratio, which may differ from det F."""
    return isochoric_response(law, *invariants(F))[3] + law.volumetric(volume_ratio, law.parameters)[0]


def stress_and_energy(law: Law, F, volume_ratio, bulk_stress, isochoric=None):
    """Return stress and energy density of points like `plane_strain.stress_and_energy`, from F of shape (n, 3, 3)."""
    check_consistency(law)
    F = np.asarray(F, dtype=float)
    p, q, r, energy = isochoric_response(law, *invariants(F)) if isochoric is None else isochoric
    p, q, r = (value[:, None, None] for value in (p, q + bulk_stress, r))
    stress = p * F + q * _cofactor(F) + r * (F @ (F.swapaxes(-1, -2) @ F))
    return law.shear_modulus * stress, law.shear_modulus * (energy + law.volumetric(volume_ratio, law.parameters)[0])


def _cofactor(F):
    """Return det F times F^-T, whose columns are cross products of those of F."""
    return np.stack([np.cross(F[..., (k + 1) % 3], F[..., (k + 2) % 3]) for k in range(3)], axis=-1)
