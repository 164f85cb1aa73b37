"""Balanced bonds of relaxed clouds: a uniform stress exerts hardly a force inside, states are exact, and lattices stay as they are."""

import numpy as np
import pytest

import pdsurrogate as pds
from pdsurrogate.body import Body
from pdsurrogate.discretization import discretize
from pdsurrogate.forces import ForceSettings

LAW = pds.materials.NeoHookean(1.5, 30.0)
FORCES = {"bond-energy": pds.BondEnergyForce(), "bond force": pds.AnalyticBondForce()}
SHEET, SOLID = {"size": [2.0, 1.2]}, {"shape": "box", "size": [1.4, 1.2, 1.2]}
CASES = {
    "sheet": (SHEET, "stress", 3.15),
    "thin horizon": (SHEET, "stress", 2.2),
    "strain": (SHEET, "strain", 3.15),
    "solid": (SOLID, "space", 2.2),
}
F = np.array([[1.3, 0.1, 0.05], [-0.1, 0.95, 0.0], [0.05, 0.02, 0.9]])


def body_of(case, arrangement="relaxed", spacing=None):
    shape, _, ratio = CASES[case]
    across = [{"region": "body", "x1": 0.0}]
    spacing = spacing or (0.05 if shape is SHEET else 0.1)
    keys = {"body": shape | {"arrangement": arrangement}, "prescribed": across, "steps": 1.0, "horizon_ratio": ratio}
    return discretize(pds.Scene(name="cloud", material="neo-hookean", spacing=spacing, **keys))[0]


def forces(force, positions):
    out = np.empty_like(positions)
    force(positions, out)
    return out


def bound(body, case, model, breakable=False):
    return FORCES[model].bind(body, LAW, ForceSettings(precision="float64", plane=CASES[case][1], breakable=breakable))


def left_over(body, case, model):
    """Root of the mean square force in an affine state on points two horizons from the boundary, in units of stress times a cell's side."""
    d, force = body.dimension, bound(body, case, model)
    found = forces(force, body.points @ F[:d, :d].T)
    lower, upper = body.points.min(axis=0), body.points.max(axis=0)
    deep = (np.minimum(body.points - lower, upper - body.points) > min(2 * body.horizon, 0.35)).all(axis=1)
    stress = np.abs(force.stress_and_energy()[0][:, :d, :d].mean(axis=0)).max()
    return np.sqrt((found[deep] ** 2).mean()) / (stress * body.spacing ** (d - 1))


@pytest.mark.parametrize(("case", "model"), [(case, "bond-energy") for case in CASES])
def test_a_uniform_stress_exerts_hardly_a_force_inside(case, model, monkeypatch):
    """What is left of the forces lowers the energy by its square, so that a third is a ninth of the error of stresses."""
    body = body_of(case)
    balanced = left_over(body, case, model)
    monkeypatch.setattr(Body, "relaxed", False)
    plain = left_over(body, case, model)
    assert balanced < plain / 2.4
    assert plain > 0.01


@pytest.mark.parametrize("case", CASES)
def test_affine_states_keep_their_energy(case):
    body = body_of(case)
    d, force = body.dimension, bound(body, case, "bond-energy")
    forces(force, body.points @ F[:d, :d].T)
    density = force.stress_and_energy()[1]
    np.testing.assert_allclose(density, density[0], rtol=1e-9)
    assert force.energy() == pytest.approx(density[0] * body.volumes.sum(), rel=1e-10)


def virial(force, body):
    first, second = body.bonds.first, body.bonds.second
    return np.einsum("bi,bj->ij", force.pair_forces(), body.all_points[second] - body.all_points[first]) / body.volumes.sum()


@pytest.mark.parametrize("model", FORCES)
def test_affine_states_keep_their_stress_where_bonds_are_broken_too(model):
    """The volume mean of the stress, which is the virial of the forces of the pairs."""
    body = body_of("sheet")
    force = bound(body, "sheet", model, breakable=True)
    positions = body.points @ F[:2, :2].T
    for _ in range(2):
        forces(force, positions)
        P = force.stress_and_energy()[0][:, :2, :2].mean(axis=0)
        np.testing.assert_allclose(virial(force, body), P, atol=1e-9 * np.abs(P).max())
        middle = np.abs(body.all_points[body.bonds.first] - [1.0, 0.6]).max(axis=1) < 0.08
        force.break_bonds(np.flatnonzero(middle)[::3].astype(np.uint32))


def test_lattices_have_no_factors(monkeypatch):
    monkeypatch.setattr("pdsurrogate.forces.bond_shares.balancing_factors", lambda *_: pytest.fail("a lattice was balanced"))
    body = body_of("sheet", "lattice")
    assert not body.relaxed
    for model in FORCES:
        bound(body, "sheet", model)
