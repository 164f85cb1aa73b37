"""Inverses of networks of springs."""

import numpy as np
import pytest
from meshes import write_bar

import pdsurrogate as pds
import pdsurrogate.solvers.nearest_bonds as nearest_bonds
from pdsurrogate.body import Body, ReflectionPlane
from pdsurrogate.discretization import discretize
from pdsurrogate.forces import ForceSettings
from pdsurrogate.solvers import preconditioner
from pdsurrogate.solvers.nearest_bonds import (
    held_matrix,
    inverse_of,
    laplacian_of,
    spring_solver_of,
    springs_of,
)
from pdsurrogate.solvers.quasi_newton import QuasiNewton


@pytest.mark.parametrize("network_of", [springs_of, laplacian_of])
def test_dense_and_sparse_inverses_agree(random, monkeypatch, network_of):
    """Also with the matrix itself, to rounding times the condition of the matrix, at most 1e6
    for 200 points.
    """
    body = Body.rectangle(2.0, 1.0, 0.1, 0.315, planes=(ReflectionPlane(1, 0.0, -1, (1, -1)),))
    free = np.ones_like(body.points)
    free[body.points[:, 0] < 0.1] = 0
    forces = random.standard_normal(free.shape)
    network = network_of(body, 1.0)
    dense = inverse_of(network, free)(forces)
    for components, matrix in network.systems(free):
        assert isinstance(matrix, np.ndarray)
        system = held_matrix(matrix, free[:, components].reshape(len(matrix), -1)[:, 0])
        moved = dense[:, components].reshape(len(matrix), -1)
        assert (
            np.abs(system @ moved - (forces * free)[:, components].reshape(len(matrix), -1)).max()
            < 1e-9
        )
    monkeypatch.setattr(nearest_bonds, "MOST_DENSE", 0)
    assert not isinstance(network.systems(free)[0][1], np.ndarray)
    sparse = inverse_of(network, free)(forces)
    assert np.abs(dense - sparse).max() < 1e-9 * np.abs(sparse).max()


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_cells_longer_than_wide_need_no_more_evaluations_than_cubes(tmp_path, jitter):
    """Six tetrahedra in each of 4 x 4 x 4 boxes twice as long as wide, stretched to 1.5, where
    cubes take 89 to 122 evaluations.
    """
    file = write_bar(tmp_path / "bar.msh", (4, 4, 4), jitter=jitter)
    scene = pds.Scene(
        name="bar",
        body={"shape": "mesh", "dimension": 3, "file": str(file)},
        spacing=(2 / 384) ** (1 / 3),
        material={"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 100.0},
        grips=[
            {"edge": "left", "holds": "normal"},
            {"edge": "right", "holds": "normal", "travel": 1.0},
        ],
        stretches=1.5,
    )
    assert pds.simulate(scene, "bond-energy").summary["n_force_evaluations"] <= 150


def test_a_factor_of_any_size_solves_by_itself(random, monkeypatch):
    """That of a cloud is exact, however many points it has: no conjugate gradients around it."""
    monkeypatch.setattr(nearest_bonds, "MOST_SOLVED", {2: 0})
    scene = pds.load_scene("uniaxial", {"spacing": 0.1, "body.arrangement": "relaxed"})
    body = discretize(scene)[0]
    free = (body.points > 0.2).astype(float)
    forces = random.standard_normal(free.shape)
    network = springs_of(body, 1.0)
    np.testing.assert_array_equal(
        spring_solver_of(network, free, 0.5)(forces), inverse_of(network, free)(forces)
    )


@pytest.mark.parametrize(
    ("middle", "half", "most"),
    [((0.0, 0.0), (1.3, 0.5), 0.8), ((1.0, 0.5), (0.25, 0.25), 1.0)],
    ids=["a crack", "a fragment"],
)
def test_springs_of_broken_bonds_give_way(monkeypatch, middle, half, most):
    """A crack opens in fewer evaluations than with whole springs, and a loose fragment, which no
    spring holds, disturbs no more than these do.
    """
    body = Body.rectangle(2.0, 1.0, 1 / 12, 2.2 / 12)
    free = np.ones_like(body.points)
    free[np.abs(body.points[:, 1] - 0.5) > 0.4] = 0
    inside = (np.abs(body.points - middle) < half).all(axis=1)
    bonds = body.bonds
    broken = np.flatnonzero(inside[bonds.first] != inside[bonds.second])

    def evaluations(left):
        monkeypatch.setattr(preconditioner, "LEFT", left)
        law = pds.materials.NeoHookean(1.0, 20.0)
        settings = ForceSettings(breakable=True)
        force = pds.load_surrogate("bond-energy").bind(body, law, settings)
        positions = body.points * [1.0, 1.2]
        solver = QuasiNewton(free, body.volumes)
        solver.solve(force, positions)
        force.break_bonds(broken)
        return solver.solve(force, positions).evaluations

    assert evaluations(preconditioner.LEFT) <= most * evaluations(1.0)
