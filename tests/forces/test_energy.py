"""The bond-level energy: forces that are its gradient, its tangent, its stability, and the
surrogate behind it.
"""

import numpy as np
import pytest
from bodies import disc_with_hole, gripped_sheet, jittered, sheet
from conftest import SHIPPED
from probes import assert_slope, directions_of, fourth_order
from refusals import raising
from scipy.optimize import minimize

import pdsurrogate as pds
from pdsurrogate.artifacts import load_surrogate
from pdsurrogate.body import ReflectionPlane
from pdsurrogate.forces import (
    FORCES,
    EnergyNetwork,
    ForceSettings,
    OutsideDomain,
    OutsideDomainWarning,
)
from pdsurrogate.materials import LAWS, Gent, NeoHookean, homogeneous
from pdsurrogate.solvers.nearest_bonds import Preconditioner, inverse_of, springs_of
from pdsurrogate.solvers.stability import NEGATIVE, least_curvature
from pdsurrogate.testing.bodies import wavy
from pdsurrogate.testing.subject import forces_at

LAW = NeoHookean(2.0, 200.0)
MODELS = {
    "bond-energy": FORCES["bond-energy"](),
    "neo-hookean-energy": load_surrogate(SHIPPED / "neo-hookean-energy"),
}
DOUBLE = ForceSettings(precision="float64", breakable=True)


def cracked_sheet():
    """A crack from the left edge to the middle, between two rows of points."""

    def separates(start, end):
        share = (0.5 - start[:, 1]) / np.where(
            end[:, 1] == start[:, 1], np.inf, end[:, 1] - start[:, 1]
        )
        return (share > 0) & (share < 1) & (start[:, 0] + share * (end[:, 0] - start[:, 0]) < 0.6)

    return sheet(separates=separates)


BODIES = {
    "sheet": sheet,
    "disc": disc_with_hole,
    "crack": cracked_sheet,
    "rollers": lambda: gripped_sheet((-1, 1)),
    "clamps": lambda: gripped_sheet((-1, -1)),
}


def deformed(body, amount=1.0):
    """An inhomogeneous deformation; gentle between grips that stay where they are."""
    return body.points + (0.05 if len(body.ghosts) else 1.0) * amount * (
        wavy(body.points) - body.points
    )


def bound(name, body, settings=DOUBLE, law=LAW):
    return MODELS[name].bind(body, law, settings)


@pytest.mark.parametrize("make", sorted(BODIES))
@pytest.mark.parametrize("name", sorted(MODELS))
def test_forces_are_the_gradient_of_the_energy(name, make, random):
    """At single points of every kind (corner, edge, interior, beside crack and grip) and along
    random directions, to 1e-7.
    """
    body = BODIES[make]()
    ends = body.points.min(axis=0), body.points.max(axis=0)
    targets = *ends, [0.6, 0.5], [0.5, 0.55], [0.05, 0.5], [0.6, 0.05]
    assert_slope(bound(name, body), deformed(body), directions_of(random, body, 3, targets))


@pytest.mark.parametrize("make", sorted(BODIES))
@pytest.mark.parametrize("name", sorted(MODELS))
def test_tangent_is_symmetric_and_the_derivative_of_the_forces(name, make, random):
    body = BODIES[make]()
    force, y = bound(name, body), deformed(body)
    tangent, direction, other = (
        force.tangent(y),
        random.standard_normal(y.shape),
        random.standard_normal(y.size),
    )
    product = (tangent @ direction.ravel()).reshape(-1, 2)
    image = tangent @ other
    # Differences leave 1e-10 of the greatest stiffness.
    assert abs(direction.ravel() @ image - other @ product.ravel()) < 1e-9 * np.linalg.norm(
        direction
    ) * np.linalg.norm(image)

    def forces(step):
        return forces_at(force, y + step * direction)

    # Rounding of the forces over the step, 1e-16/1e-5 of the stiffness, and the differences' own
    # fourth-order error.
    np.testing.assert_allclose(
        product, -fourth_order(forces, 1e-5), atol=1e-7 * np.abs(product).max()
    )


def test_every_law_has_an_exact_energy():
    body = sheet()
    for law in (cls() for cls in LAWS.values()):
        force = bound("bond-energy", body, law=law)
        assert_slope(force, deformed(body), [np.cos(7 * body.points)], 1e-5)


STATES = {
    "rest": np.eye(2),
    "uniaxial 2": np.diag([2.0, 0.7105]),
    "uniaxial 3": np.diag([3.0, 0.5813]),
    "shear": np.array([[1.0, 0.8], [0.0, 1.0]]),
    "equibiaxial 2": np.diag([2.0, 2.0]),
}


def matrix_of(operator):
    """The matrix of a small linear operator, column by column."""
    return operator @ np.eye(operator.shape[1])


@pytest.mark.parametrize("state", sorted(STATES))
@pytest.mark.parametrize("name", sorted(MODELS))
def test_no_zero_energy_mode(name, state):
    """12 x 12 points: after the rigid modes, the least eigenvalue is at least 5e-3 of the
    greatest; none is negative.
    """
    body, F = sheet(0.1, 1.2, 1.2), STATES[state]
    matrix = matrix_of(bound(name, body).tangent(body.points @ F.T))
    values = np.linalg.eigvalsh(matrix)
    # Two translations are exact zeros; turning the body costs as much as its stress, which a dead
    # load would balance.
    rest = state == "rest"
    assert np.abs(np.sort(np.abs(values))[: 3 if rest else 2]).max() < 1e-9 * values[-1]
    modes = rigid_free(matrix, body.points @ F.T)
    assert modes[0] >= 5e-3 * modes[-1]


@pytest.mark.parametrize(("stretch", "stable"), [(0.95, True), (0.85, False), (1.5, True)])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_the_least_curvature_has_the_sign_of_the_least_eigenvalue(precision, stretch, stable):
    """A sheet of 3 x 1 between rollers, in its homogeneous state: stable to a strain of about
    (pi/3)^2/12.
    """
    body = sheet(
        0.1,
        3.0,
        1.0,
        planes=(ReflectionPlane(0, 0.0, -1, (-1, 1)), ReflectionPlane(0, 3.0, 1, (-1, 1))),
    )
    positions = body.points * [stretch, homogeneous.uniaxial(LAW, stretch).lateral_stretch]
    force, double = (
        bound("neo-hookean-energy", body, ForceSettings(precision=name))
        for name in (precision, "float64")
    )
    for one in (force, double):
        one.move_plane(1, [3.0 * (stretch - 1), 0.0])
    values = np.linalg.eigvalsh(matrix_of(double.tangent(positions)))
    free = np.ones_like(positions)
    found = least_curvature(
        force,
        positions,
        free,
        Preconditioner(inverse_of(springs_of(body, LAW.shear_modulus), free)),
    )
    if stable:
        # The translation that nothing holds is an exact zero.
        assert values[0] > -1e-9 * values[-1]
        assert found > NEGATIVE[precision]
    else:
        assert values[0] < -1e-6 * values[-1]
        assert found < NEGATIVE[precision]


def rigid_free(matrix, positions):
    """Eigenvalues on the complement of translations and the infinitesimal rotation of the
    deformed body.
    """
    n = len(positions)
    rigid = np.zeros((2 * n, 3))
    rigid[0::2, 0], rigid[1::2, 1] = 1, 1
    rigid[:, 2] = np.stack([-positions[:, 1], positions[:, 0]], axis=1).ravel()
    complement = np.linalg.svd(rigid)[0][:, 3:]
    return np.linalg.eigvalsh(complement.T @ matrix @ complement)


@pytest.mark.parametrize("name", ["crack", "jittered"])
def test_shares_of_the_bonds_are_those_of_greatest_entropy(name, random):
    """Against scipy's minimizer of the same convex function; the mean bond is zero inside and
    much shorter than before at edges.
    """
    body = jittered(random) if name == "jittered" else BODIES[name]()
    force = bound("bond-energy", body)
    bonds, x = body.bonds, body.all_points
    for i in random.choice(len(body), 25, replace=False):
        mine = slice(int(bonds.pointers[i]), int(bonds.pointers[i + 1]))
        xi = (x[bonds.neighbors[mine]] - x[i]) / body.horizon
        plain = (
            body.weigh(body.horizon * np.linalg.norm(xi, axis=1))
            * body.all_volumes[bonds.neighbors[mine]]
        )
        tilt = minimize(
            lambda a, w=plain, xi=xi: np.log(w @ np.exp(-xi @ a)) + 0.005 * a @ a,
            np.zeros(2),
            tol=1e-12,
        ).x
        expected = plain * np.exp(-xi @ tilt)
        start = int(force.terms[0].kinematics.starts[i])
        shares = force.terms[0].shares.bond_shares[start : start + len(plain)] / body.volumes[i]
        np.testing.assert_allclose(shares, expected / expected.sum(), rtol=1e-4)
        assert shares.sum() == pytest.approx(1, rel=1e-12)
        mean = np.linalg.norm(shares @ xi)
        # At a corner no positive weights come closer than the middle between the two nearest
        # neighbors along its edges.
        assert mean < 0.01 + 0.5 * np.linalg.norm(plain @ xi) / plain.sum()


def test_a_point_without_bonds_carries_nothing():
    body = sheet()
    force, y, out = bound("bond-energy", body), deformed(body), np.empty_like(body.points)
    force(y, out)
    own = np.flatnonzero((body.bonds.first == 40) | (body.bonds.second == 40))
    force.break_bonds(own)
    y[40] += 100.0
    force(y, out)
    assert (out[40] == 0).all()
    assert np.isfinite(out).all()


def test_energy_is_smooth_across_the_edge_of_the_domain():
    """The exact energy takes over: no jump of energy or stress, and the force stays the gradient
    on the way.
    """
    body = sheet(0.2, 1.0, 1.0)
    force, exact = bound("neo-hookean-energy", body), bound("bond-energy", body)
    for stretch in np.linspace(4.6, 5.2, 13):
        y = body.points * [stretch, 0.9] + 0.01 * np.sin(9 * body.points)
        assert_slope(force, y, [np.cos(5 * body.points)], 1e-4)
    out, expected = (forces_at(of, body.points * [5.6, 0.9]) for of in (force, exact))
    np.testing.assert_allclose(out, expected, atol=1e-12 * np.abs(expected).max())
    assert force.energy() == pytest.approx(exact.energy(), rel=1e-13)
    assert force.fraction_outside > 0
    tangent, direction = force.tangent(body.points * [4.9, 0.9]), np.sin(8 * body.points)

    def forces(step):
        return forces_at(force, body.points * [4.9, 0.9] + step * direction)

    product = (tangent @ direction.ravel()).reshape(-1, 2)
    np.testing.assert_allclose(
        product, -fourth_order(forces, 1e-4), atol=1e-6 * np.abs(product).max()
    )


def test_domain_policies():
    body = sheet(0.2, 1.0, 1.0)
    with raising("outside the domain", OutsideDomain):
        bound("neo-hookean-energy", body, ForceSettings(outside="raise"))(
            body.points * [6.0, 1.0], np.empty_like(body.points)
        )
    with pytest.warns(OutsideDomainWarning, match="extrapolated"):
        bound("neo-hookean-energy", body, ForceSettings(outside="warn"))(
            body.points * [6.0, 1.0], np.empty_like(body.points)
        )


def test_the_shipped_surrogate_is_accurate():
    """Stress within 1e-3, relative RMS, over stretches 0.8 to 4, with at most 20 units; strongly
    elliptic like the law.
    """
    model = MODELS["neo-hookean-energy"]
    report = pds.evaluate(model, LAW, (0.8, 4.0), 5000, 77)
    assert model.output_weights.size <= 20
    assert report["on_surface"]["rms"] < 1e-3
    assert max(row["rms"] for row in report["by_strain"]) < 1e-3
    assert report["at_rest"] < 1e-14
    assert report["least_acoustic"] > 0.99 * report["least_acoustic_exact"] > 0


def test_another_material_is_refused():
    for law, message in ((NeoHookean(1.0, 50.0), "bulk_modulus"), (Gent(), "describes the law")):
        with raising(message):
            bound("neo-hookean-energy", sheet(), law=law)


def test_payloads_are_checked():
    model = MODELS["neo-hookean-energy"]
    again = EnergyNetwork.from_payload("x", model.payload(), model.domain, model.law, model.shape)
    np.testing.assert_array_equal(again.hidden_weights, model.hidden_weights)
    for key, value in (
        ("activation", "relu"),
        ("output_weights", np.ones((2, 2))),
        ("hidden_biases", np.full(8, np.nan)),
    ):
        with raising(r"activation|output_weights|hidden_biases"):
            EnergyNetwork.from_payload(
                "x", model.payload() | {key: value}, model.domain, model.law, model.shape
            )
    with raising("payload has"):
        EnergyNetwork.from_payload("x", {}, model.domain, model.law, model.shape)
