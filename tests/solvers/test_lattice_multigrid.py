"""Multigrid cycles on lattices in place of factors."""

import numpy as np
import pytest
from described import SCENES

import pdsurrogate as pds
import pdsurrogate.solvers.nearest_bonds as nearest_bonds
from pdsurrogate.discretization import discretize
from pdsurrogate.solvers.nearest_bonds import held_matrix, inverse_of, springs_of

CONDITION = 9.0
"""Greatest ratio of eigenvalues with which a step of conjugate gradients halves the error."""

LATTICES = SCENES["lattices"]


@pytest.mark.parametrize("name", LATTICES)
def test_cycles_are_symmetric_and_near_the_inverse(name, random, monkeypatch):
    """Also where only a few points are held, and with a material a hundred times as stiff."""
    scene, changes = LATTICES[name]
    body = discretize(pds.load_scene(scene, changes))[0]
    moduli = np.where(body.points[:, 0] > body.points[:, 0].mean(), 100.0, 1.0)
    network = springs_of(body, moduli)
    free = np.ones_like(body.points)
    free[body.points[:, 0] < body.points[:, 0].min() + 0.1 * body.spacing] = 0
    free[:3] = 0
    monkeypatch.setattr(nearest_bonds, "MOST_SOLVED", {2: 0, 3: 0})
    inverse = inverse_of(network, free)
    moving = np.flatnonzero(free)
    columns = np.empty((len(moving), len(moving)))
    for number, place in enumerate(moving):
        force = np.zeros(free.size)
        force[place] = 1.0
        columns[number] = inverse(force.reshape(free.shape)).ravel()[moving]
    np.testing.assert_allclose(columns, columns.T, rtol=0, atol=1e-5 * np.abs(columns).max())
    matrix = held_matrix(network.matrix(), free.ravel())
    matrix = matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
    half = np.linalg.cholesky(matrix[np.ix_(moving, moving)])
    values = np.linalg.eigvalsh(half.T @ (columns + columns.T) / 2 @ half)
    assert values[-1] < CONDITION * values[0], values[[0, 1, 2, -3, -2, -1]]


def test_a_sheet_with_a_hole_needs_as_many_evaluations_as_with_a_factor(monkeypatch):
    scene = pds.load_scene("hole", spacing=0.1)
    evaluations = []
    for most in (nearest_bonds.MOST_SOLVED, {2: 0}):
        monkeypatch.setattr(nearest_bonds, "MOST_SOLVED", most)
        evaluations.append(pds.simulate(scene).summary["n_force_evaluations"])
    assert evaluations[1] <= 1.1 * evaluations[0]


def test_large_clouds_have_a_laplacian_in_place_of_a_factor(monkeypatch):
    """It costs evaluations, but finds the same equilibrium."""
    changes = {"spacing": 0.1, "stretches": 1.3, "body.arrangement": "relaxed"}
    scene = pds.load_scene("uniaxial", changes)
    before = pds.simulate(scene)
    monkeypatch.setattr(nearest_bonds, "MOST_SCATTERED", 0)
    monkeypatch.setattr(nearest_bonds, "MOST_FACTORIZED", 0)
    after = pds.simulate(scene)
    assert after.levels[-1]["method"] == before.levels[-1]["method"]
    np.testing.assert_allclose(
        after.levels[-1]["nominal_stress"], before.levels[-1]["nominal_stress"], rtol=1e-4
    )
