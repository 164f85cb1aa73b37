"""Stress in space and in plane strain, for every law, against what shares no code with it."""

import numpy as np
import pytest

import pdsurrogate as pds
from pdsurrogate.materials import PrincipalStretchLaw, solid
from pdsurrogate.testing.laws import compiled_response

# Every law and dimension has to be compiled.
pytestmark = pytest.mark.slow


def rotations(random, n):
    Q, _ = np.linalg.qr(random.standard_normal((n, 3, 3)))
    return Q * np.linalg.det(Q)[:, None, None]


def random_gradients(random, n, low=0.6, high=2.0):
    """Rotation times stretch times rotation, and the volume near that of rubber."""
    stretches = np.exp(random.uniform(np.log(low), np.log(high), (n, 3)))
    stretches *= (random.uniform(0.9, 1.1, n) / stretches.prod(axis=1))[:, None] ** (1 / 3)
    return rotations(random, n) @ (stretches[:, :, None] * rotations(random, n))


def principal(law, stretches):
    """Principal Kirchhoff stresses and energy from the stretches themselves, dimensionless,
    without invariants.
    """
    J = stretches.prod(axis=1)
    x = np.log(stretches) - np.log(J)[:, None] / 3
    s = np.exp(2 * x)
    U, slope, _ = law.volumetric(J, law.parameters)
    if isinstance(law, PrincipalStretchLaw):
        terms = [
            law.term(*x.T, *s.T, law.coefficients(law.parameters, k)) for k in range(len(law.terms))
        ]
        W, *g = [sum(parts) for parts in zip(*terms, strict=True)][:4]
        g = np.stack(g, axis=1)
    else:
        W, W1, W2, *_ = law.isochoric(s.sum(axis=1), (1 / s).sum(axis=1), law.parameters)
        g = 2 * (W1[:, None] * s - W2[:, None] / s)
    return g - g.mean(axis=1, keepdims=True) + (J * slope)[:, None], W + U


SPACINGS = {
    "apart": lambda random, n: random.uniform(-0.7, 0.7, (n, 3)),
    "all equal": lambda random, n: np.repeat(random.uniform(-0.05, 0.05, (n, 1)), 3, axis=1),
    "all nearly equal": (
        lambda random, n: 10 ** random.uniform(-9, -3, (n, 1)) * random.standard_normal((n, 3))
    ),
    "two equal, one larger": lambda random, n: random.uniform(0, 1.3, (n, 1)) * [1.0, -0.5, -0.5],
    "two equal, one smaller": lambda random, n: random.uniform(0, 0.65, (n, 1)) * [1.0, 1.0, -2.0],
    "two nearly equal": (
        lambda random, n: (
            random.uniform(-0.6, 0.6, (n, 1)) * [1.0, 1.0, -2.0]
            + 1e-6 * random.standard_normal((n, 3))
        )
    ),
    "far apart": (
        lambda random, n: (
            random.uniform(1.1, 1.3, (n, 1)) * [1.0, 0.0, -1.0]
            + 0.1 * random.standard_normal((n, 3))
        )
    ),
}


@pytest.mark.parametrize("spacing", SPACINGS)
def test_stretches_equal_or_not(law, spacing, random):
    """Stress and energy from the invariants against those from the stretches: the cubic's roots
    and their separation cost 1e-10.
    """
    n = 500
    stretches = np.exp(SPACINGS[spacing](random, n))
    tau, energy = principal(law, stretches)
    there = np.isfinite(energy)
    left, right = rotations(random, n), rotations(random, n)
    F = left @ (stretches[:, :, None] * right)
    P = left @ ((tau / stretches)[:, :, None] * right)
    size = 1 + np.abs(P).max(axis=(1, 2))
    found = solid.first_piola_stress(law, F) / law.shear_modulus
    scale = law.bulk_modulus / law.shear_modulus
    assert there.mean() > 0.8
    assert (np.abs(found - P).max(axis=(1, 2)) / size)[there].max() < 2e-11 + 1e-14 * scale
    assert (
        np.abs(solid.energy_density(law, F) / law.shear_modulus - energy)[there].max()
        < 1e-10 + 1e-13 * scale
    )
    p, q, r, psi = compiled_response(law, *solid.invariants(F), response=solid.response)
    cofactor = np.linalg.det(F)[:, None, None] * np.linalg.inv(F).swapaxes(1, 2)
    compiled = (
        p[:, None, None] * F
        + q[:, None, None] * cofactor
        + r[:, None, None] * (F @ F.swapaxes(1, 2) @ F)
    )
    assert (np.abs(compiled - P).max(axis=(1, 2)) / size)[there].max() < 2e-11 + 1e-14 * scale
    assert np.abs(psi - energy)[there].max() < 1e-10 + 1e-13 * scale


@pytest.mark.parametrize(
    "law",
    [pds.materials.Gent(), pds.materials.ArrudaBoyce(), pds.materials.FullNetwork(chain_links=8.0)],
    ids=lambda law: law.name,
)
def test_past_the_limit_there_is_no_stress(law):
    F = np.diag([12.0, 12.0**-0.5, 12.0**-0.5])[None]
    assert np.isnan(solid.first_piola_stress(law, F)).all()
    p, q, _, energy = compiled_response(law, *solid.invariants(F), response=solid.response)
    assert np.isnan([p, q, energy]).all()
