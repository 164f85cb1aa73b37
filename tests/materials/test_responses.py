"""Stress in space and in plane strain, for every law, against what shares no code with it."""

import numpy as np
import pytest
from test_laws import Exponential

import pdsurrogate as pds
from pdsurrogate.forces.kinematics import Kinematics
from pdsurrogate.forces.material_points import MaterialPoints
from pdsurrogate.materials import PrincipalStretchLaw, plane_strain, solid
from pdsurrogate.testing.laws import compiled_response

# No scene uses these yet, and every law and dimension has to be compiled.
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
    """Principal Kirchhoff stresses and energy from the stretches themselves, dimensionless, without invariants."""
    J = stretches.prod(axis=1)
    x = np.log(stretches) - np.log(J)[:, None] / 3
    s = np.exp(2 * x)
    U, slope, _ = law.volumetric(J, law.parameters)
    if isinstance(law, PrincipalStretchLaw):
        terms = [law.term(*x.T, *s.T, law.coefficients(law.parameters, k)) for k in range(len(law.terms))]
        W, *g = [sum(parts) for parts in zip(*terms, strict=True)][:4]
        g = np.stack(g, axis=1)
    else:
        W, W1, W2, *_ = law.isochoric(s.sum(axis=1), (1 / s).sum(axis=1), law.parameters)
        g = 2 * (W1[:, None] * s - W2[:, None] / s)
    return g - g.mean(axis=1, keepdims=True) + (J * slope)[:, None], W + U


SPACINGS = {
    "apart": lambda random, n: random.uniform(-0.7, 0.7, (n, 3)),
    "all equal": lambda random, n: np.repeat(random.uniform(-0.05, 0.05, (n, 1)), 3, axis=1),
    "all nearly equal": lambda random, n: 10 ** random.uniform(-9, -3, (n, 1)) * random.standard_normal((n, 3)),
    "two equal, one larger": lambda random, n: random.uniform(0, 1.3, (n, 1)) * [1.0, -0.5, -0.5],
    "two equal, one smaller": lambda random, n: random.uniform(0, 0.65, (n, 1)) * [1.0, 1.0, -2.0],
    "two nearly equal": lambda random, n: random.uniform(-0.6, 0.6, (n, 1)) * [1.0, 1.0, -2.0] + 1e-6 * random.standard_normal((n, 3)),
    "far apart": lambda random, n: random.uniform(1.1, 1.3, (n, 1)) * [1.0, 0.0, -1.0] + 0.1 * random.standard_normal((n, 3)),
}


@pytest.mark.parametrize("spacing", SPACINGS)
def test_stretches_equal_or_not(law, spacing, random):
    """Stress and energy from the invariants against those from the stretches: the cubic's roots and their separation cost 1e-10."""
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
    assert np.abs(solid.energy_density(law, F) / law.shear_modulus - energy)[there].max() < 1e-10 + 1e-13 * scale
    p, q, r, psi = compiled_response(law, *solid.invariants(F), response=solid.response)
    cofactor = np.linalg.det(F)[:, None, None] * np.linalg.inv(F).swapaxes(1, 2)
    compiled = p[:, None, None] * F + q[:, None, None] * cofactor + r[:, None, None] * (F @ F.swapaxes(1, 2) @ F)
    assert (np.abs(compiled - P).max(axis=(1, 2)) / size)[there].max() < 2e-11 + 1e-14 * scale
    assert np.abs(psi - energy)[there].max() < 1e-10 + 1e-13 * scale


def test_kernels_of_a_sheet_take_plane_strain_for_plane_stress(random):
    """Its condition on the thickness makes C33 = 1, whatever iteration solves it."""
    body, law = pds.Body.rectangle(1.0, 1.0, 0.2, 0.5), pds.materials.Ogden()
    kinematics = Kinematics(body, "float64")
    points = MaterialPoints(kinematics, law, "float64")
    points.response = plane_strain.response.block(law)
    kinematics.place(body.points @ np.array([[1.4, 0.2], [-0.1, 0.9]]))
    points.find()
    np.testing.assert_allclose(points.volume_ratios, points.records[:, 2], rtol=1e-12)
    np.testing.assert_allclose(points.records[:, 3], 1.0, rtol=1e-12)


@pytest.mark.parametrize(
    "law", [pds.materials.Gent(), pds.materials.ArrudaBoyce(), pds.materials.FullNetwork(chain_links=8.0)], ids=lambda law: law.name
)
def test_past_the_limit_there_is_no_stress(law):
    F = np.diag([12.0, 12.0**-0.5, 12.0**-0.5])[None]
    assert np.isnan(solid.first_piola_stress(law, F)).all()
    p, q, _, energy = compiled_response(law, *solid.invariants(F), response=solid.response)
    assert np.isnan([p, q, energy]).all()


def test_a_users_own_law_has_all_three(random):
    law = Exponential(0.5, 50.0)
    F = random_gradients(random, 300)
    for compiled, plain in zip(
        compiled_response(law, *solid.invariants(F), response=solid.response), solid.response(law, *solid.invariants(F)), strict=True
    ):
        np.testing.assert_allclose(compiled, plain, rtol=1e-12, atol=1e-11)
    at_rest = np.eye(3)
    assert np.abs(solid.first_piola_stress(law, at_rest)).max() < 1e-13
    assert np.abs(plane_strain.first_piola_stress(law, at_rest[:2, :2])).max() < 1e-13
