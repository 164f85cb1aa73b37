"""The learned isochoric energy: its samples and pipeline, its kernel against NumPy, the edge of
its domain, and bodies.
"""

import numpy as np
import pytest
from bodies import sheet
from commands import commanded
from conftest import SHIPPED
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.artifacts import load_surrogate
from pdsurrogate.discretization.cells import lattice_of
from pdsurrogate.forces import (
    Domain,
    ForceSettings,
    InvalidState,
    MaterialPart,
    OutsideDomain,
    OutsideDomainWarning,
    bind_portions,
)
from pdsurrogate.kernels.domain import distance_coefficients
from pdsurrogate.learning.isochoric import ISOCHORIC_ENERGY
from pdsurrogate.materials import plane_strain, solid
from pdsurrogate.testing.subject import forces_at

LAW = pds.materials.Ogden()
NAMES = ("neo-hookean", "ogden", "arruda-boyce", "full-network")
PLANES = {"strain": plane_strain, "space": solid}


@pytest.fixture(scope="module")
def ogden():
    return load_surrogate(SHIPPED / "ogden-isochoric")


@pytest.fixture(scope="module")
def fitted():
    samples = pds.training_samples(LAW, 400, target="isochoric-energy")
    return (
        pds.surrogate_pipeline(
            pds.learning.SobolevRegressor(4, max_iter=200, random_state=0), "isochoric-energy"
        ).fit(samples.X, samples.y),
        samples,
    )


def states_of(stretches, plane, J):
    """States of a response at isochoric principal stretches (n, 3); in plane strain the volume
    ratio follows from the third, 1/J^(1/3).
    """
    s = stretches**2 * J[:, None] ** (2 / 3)
    if plane == "space":
        return np.stack(
            [s.sum(axis=1), s[:, 0] * s[:, 1] + s[:, 1] * s[:, 2] + s[:, 2] * s[:, 0], J]
        )
    return np.stack([s[:, 0] + s[:, 1], J, J])


def kirchhoff(rows, squares, J, plane):
    """Principal Kirchhoff stresses, shape (n, 2) in the plane or (n, 3), from the rows of a
    response and the squares of the stretches.
    """
    p, q, r, _ = rows[..., None]
    return (
        p * squares[:, :2] + q
        if plane == "strain"
        else p * squares + q * J[:, None] + r * squares**2
    )


def drawn(n, plane, low=0.3, high=3.5, seed=3):
    """States within a range of isochoric stretches, and the squares of their stretches."""
    random = np.random.default_rng(seed)
    logs = np.log(ISOCHORIC_ENERGY.draw(LAW, n, (low, high), 0.2, random).stretches)
    J = random.uniform(0.9, 1.1, n)
    if plane == "strain":
        # The thickness is held: its isochoric stretch is J^(-1/3).
        logs = np.stack([logs[:, 0], np.log(J) / 3 - logs[:, 0], -np.log(J) / 3], axis=1)
    return states_of(np.exp(logs), plane, J), np.exp(2 * logs) * J[:, None] ** (2 / 3)


def test_samples_are_the_energy_of_the_law():
    """Derivatives of a law of invariants are its own; of principal stretches, differences of the
    energy.
    """
    law = pds.materials.MooneyRivlin()
    samples = pds.training_samples(law, 200, random_state=2, target="isochoric-energy")
    np.testing.assert_allclose(
        samples.y.T,
        np.broadcast_arrays(*law.isochoric(*samples.X.T, law.parameters)[:3]),
        rtol=1e-9,
        atol=1e-12,
    )
    samples = pds.training_samples(LAW, 200, (0.4, 3.0), 0.0, target="isochoric-energy")
    assert samples.stretches.min() >= 0.4
    assert samples.stretches.max() <= 3.0
    np.testing.assert_allclose(samples.stretches.prod(axis=1), 1, rtol=1e-12)
    one, h = np.ones(len(samples)), 1e-5
    for column, shift in ((1, (h, 0)), (2, (0, h))):
        high, low = (
            solid.isochoric_response(LAW, *(samples.X + sign * np.array(shift)).T, one)[3]
            for sign in (1, -1)
        )
        inner = np.ptp(np.log(samples.stretches), axis=1) > 0.5  # where both steps are states
        np.testing.assert_allclose(
            samples.y[inner, column], (high - low)[inner] / (2 * h), rtol=1e-3, atol=1e-4
        )


def test_pipeline_and_surrogate_are_one_function(fitted, tmp_path):
    model, samples = fitted
    unseen = pds.training_samples(LAW, 500, random_state=5, target="isochoric-energy")
    assert unseen.target.errors(model.predict(unseen.X), unseen)["rms"] < 2e-3
    surrogate = pds.learning.surrogate_of(model, LAW, samples)
    expected = model.predict(unseen.X)
    np.testing.assert_allclose(
        np.stack(surrogate.isochoric_derivatives(*unseen.X.T), axis=1),
        expected,
        rtol=1e-9,
        atol=1e-11,
    )
    assert surrogate.isochoric_derivatives(3.0, 3.0)[0] == 0
    path = pds.store(model, samples, LAW, tmp_path, "mine", "1", "test")
    card = pds.load_card(path)
    assert (card.kind, card.material.shape) == ("isochoric-network", LAW.shape)
    np.testing.assert_array_equal(load_surrogate(path).hidden_weights, surrogate.hidden_weights)
    assert list(model.regressor_[0].get_feature_names_out()) == ["log(I1bar/3)", "log(I2bar/3)"]


def test_pipelines_of_other_energies_are_refused(fitted):
    model, _ = fitted
    with raising(r"target isochoric-energy, .* the target sheet-energy"):
        pds.learning.surrogate_of(model, LAW, pds.training_samples(LAW, 10, target="sheet-energy"))
    with raising("I2bar must be positive"):
        model.predict([[3.0, -1.0]])


def test_laws_that_lock_are_learned_as_far_as_they_go():
    law = pds.materials.Gent(chain_limit=5.0)
    low, high = pds.learning.reachable_stretches(law, (0.25, 4.0), target="isochoric-energy")
    assert low > 0.25
    assert high < 4.0
    assert np.isfinite(
        pds.training_samples(law, 500, (low, high), target="isochoric-energy").y
    ).all()
    with raising(r"gent does not reach the stretches 0\.25 to 4"):
        pds.training_samples(law, 500, target="isochoric-energy")


@pytest.mark.parametrize("bounds", [(0.4, 4.0), (0.05, 3.0), (0.25, 20.0)])
def test_the_domain_is_told_from_the_invariants(bounds):
    """A state is outside where one of its stretches is, also with bounds of which product 1
    leaves one no work.
    """
    logs = np.log(
        ISOCHORIC_ENERGY.draw(pds.materials.NeoHookean(), 20_000, (0.02, 30.0), 0.0, 0).stretches
    )
    squares = np.exp(2 * logs)
    invariants = np.stack([np.ones(len(logs)), squares.sum(axis=1), (1 / squares).sum(axis=1)])
    inside = (distance_coefficients(*bounds) @ invariants > 0).all(axis=0)
    expected = (np.exp(logs) > bounds[0]).all(axis=1) & (np.exp(logs) < bounds[1]).all(axis=1)
    edge = np.abs(logs[..., None] - np.log(bounds)).min(axis=(1, 2)) < 1e-9
    np.testing.assert_array_equal(inside | edge, expected | edge)
    assert 0.05 < expected.mean() < 0.95


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("name", NAMES)
def test_shipped_artifacts_are_as_exact_as_they_state(name, plane):
    """Energy and stress are the law's, the latter within five times the greatest error that the
    card states: the states are others.
    """
    model = load_surrogate(SHIPPED / f"{name}-isochoric")
    law = pds.materials.LAWS[name]()
    states, squares = drawn(200, plane)
    found = model.isochoric_energy(law, plane, "extrapolate", "float64").evaluate(*states)
    exact = np.array(PLANES[plane].isochoric_response(law, *states))
    assert np.sqrt(((found[3] - exact[3]) ** 2).mean() / (exact[3] ** 2).mean()) < 5e-5
    assert model.stated["rms"] < 1e-4
    # Principal Kirchhoff stresses at the same stretches, over their root mean square.
    errors, sizes = (kirchhoff(rows, squares, states[-1], plane) for rows in (found - exact, exact))
    assert np.linalg.norm(errors, axis=1).max() < 5 * model.stated["max"] * np.sqrt(
        (sizes**2).sum(axis=1).mean()
    )


def block(plane, counts=6, reach=None):
    if plane == "strain":
        return sheet()
    axis = (np.arange(counts) + 0.5) / counts
    points = lattice_of(axis, axis, axis)
    return pds.Body(points, np.full(len(points), counts**-3.0), 1.75 / counts, 1 / counts)


def wavy(points, stretch=1.6):
    d = points.shape[1]
    F = np.diag([stretch, *[stretch ** (-1 / (d - 1))] * (d - 1)])
    return points @ F + 0.01 * np.sin(5 * np.roll(points, 1, axis=1))


@pytest.mark.parametrize("plane", PLANES)
def test_one_artifact_serves_every_bulk_modulus(ogden, plane):
    """Forces within ten times the stated error of the exact energy's, at K = 100 and 1000 mu,
    and the energy within it.
    """
    body = block(plane)
    for bulk in (100.0, 1000.0):
        law = pds.materials.Ogden(bulk_modulus=bulk)
        learned, exact = (
            model.bind(body, law, ForceSettings(plane=plane))
            for model in (ogden, pds.BondEnergyForce())
        )
        found, expected = (forces_at(force, wavy(body.points)) for force in (learned, exact))
        assert np.abs(found - expected).max() < 10 * ogden.stated["max"] * np.abs(expected).max()
        assert learned.energy() == pytest.approx(exact.energy(), rel=ogden.stated["max"])
        assert learned.pairs_outside == 0
        (found, energy), (expected, density) = (
            force.stress_and_energy() for force in (learned, exact)
        )
        assert (
            0 < np.abs(found - expected).max() < 10 * ogden.stated["max"] * np.abs(expected).max()
        )
        np.testing.assert_allclose(energy, density, rtol=1e-3)
        assert (learned.learned.domain_deviation() < 0).all()


@pytest.mark.parametrize("plane", PLANES)
def test_policies_outside_the_domain(ogden, plane):
    body = block(plane)
    far = wavy(body.points, 5.0)

    def bound(outside):
        return ogden.bind(body, LAW, ForceSettings(plane=plane, outside=outside))

    force = bound("fallback")
    assert force.learned.domain_deviation() == pytest.approx(-np.log(4.0))
    exact = pds.BondEnergyForce().bind(body, LAW, ForceSettings(plane=plane))
    np.testing.assert_allclose(forces_at(force, far), forces_at(exact, far), rtol=1e-9, atol=1e-9)
    assert force.pairs_outside == len(body.bonds.first)
    assert (force.learned.domain_deviation() > 0).all()
    np.testing.assert_allclose(
        force.stress_and_energy()[0], exact.stress_and_energy()[0], rtol=1e-9, atol=1e-9
    )
    forces_at(force, wavy(body.points))
    assert force.pairs_outside == len(body.bonds.first)
    with raising("are outside the domain of ogden-isochoric@1", OutsideDomain):
        forces_at(bound("raise"), far)
    with pytest.warns(OutsideDomainWarning, match="extrapolated"):
        forces_at(bound("warn"), far)
    assert np.isfinite(forces_at(bound("extrapolate"), far)).all()
    with raising("inside out", InvalidState):
        forces_at(force, -far if plane == "space" else far * [-1, 1])


def test_what_it_does_not_serve_it_says(ogden):
    with raising(r"ogden-isochoric@1 .* supports plane=strain\|space; force=bond-energy supports"):
        ogden.bind(sheet(), LAW, ForceSettings())
    with raising("describes the law ogden, not gent"):
        ogden.bind(block("space"), pds.materials.Gent(), ForceSettings(plane="space"))
    with raising(r"describes ogden with modulus_1 = 1\.49.*, not 1\.38"):
        ogden.check_material(pds.materials.Ogden(exponents=(1.4, 5.0, -2.0)))
    wrong = load_surrogate(SHIPPED / "ogden-isochoric")
    wrong.output_weights[0] *= 1.1
    with raising("differs from the forces of ogden"):
        wrong.check_material(LAW)
    assert wrong.domain == Domain(0.25, 4.0, 1.0, 1.0)


def test_fitted_from_the_command_line(tmp_path):
    arguments = "fit mine --energy --law yeoh --units 4 --samples 300 --iterations 150 --folds 2"
    outcome = commanded(arguments, "--out", tmp_path)
    assert "State at rest, and stiffness" in outcome.output
    assert "shear modulus at rest" in outcome.output
    card = pds.load_card(tmp_path / "mine")
    assert card.kind == "isochoric-network"
    assert len(card.training["cross_validation"]) == 2
    outcome = commanded("fit other --energy --degree 4 --out", tmp_path, status=2)
    assert "degree applies to bond forces only" in outcome.output


@pytest.mark.parametrize("scene", ["plane-strain-block", "bonded-block"])
def test_bonded_blocks_agree_with_the_exact_energy(scene):
    """Stress and probes of a scene within the error that the card states, and the solver's
    tolerance.
    """
    changes = {"material.law": "ogden", "spacing": 0.25, "stretches": [1.3]}
    learned, exact = (
        pds.simulate(pds.load_scene(scene, changes), force).levels[-1]
        for force in ("ogden-isochoric", "bond-energy")
    )
    for name, force in exact["forces"].items():
        np.testing.assert_allclose(
            learned["forces"][name], force, atol=1e-4 * np.abs(list(exact["forces"].values())).max()
        )
    for name, probe in exact["probes"].items():
        np.testing.assert_allclose(
            learned["probes"][name]["displacement"], probe["displacement"], atol=1e-4
        )


def test_bodies_of_two_materials(ogden):
    """Learned on one side and exact on the other, or learned on both; pairs outside are counted
    by material.
    """
    body, soft, stiff = block("space"), pds.materials.Ogden(), pds.materials.NeoHookean(3.0, 300.0)
    left = body.points[:, 0] < 0.5
    neo_hookean, exact = load_surrogate(SHIPPED / "neo-hookean-isochoric"), pds.BondEnergyForce()

    def forces(*models):
        portions = [
            MaterialPart(law, model, np.flatnonzero(side))
            for law, model, side in zip((soft, stiff), models, (left, ~left), strict=True)
        ]
        force = bind_portions(body, portions, ForceSettings(plane="space"))
        return forces_at(force, wavy(body.points, 1.3)), force.pairs_outside

    expected, _ = forces(exact, exact)
    for models in ((ogden, exact), (ogden, neo_hookean)):
        found, outside = forces(*models)
        assert 0 < np.abs(found - expected).max() < 1e-3 * np.abs(expected).max()
        assert outside == 0
