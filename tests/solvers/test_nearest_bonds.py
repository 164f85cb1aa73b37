"""Inverses of networks of springs."""

import numpy as np
import pytest

import pdsurrogate.solvers.nearest_bonds as nearest_bonds
from pdsurrogate.body import Body, ReflectionPlane
from pdsurrogate.solvers.nearest_bonds import held_matrix, inverse_of, laplacian_of, springs_of


@pytest.mark.parametrize("network_of", [springs_of, laplacian_of])
def test_dense_and_sparse_inverses_agree(random, monkeypatch, network_of):
    """Also with the matrix itself, to rounding times the condition of the matrix, at most 1e6 for 200 points."""
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
        assert np.abs(system @ moved - (forces * free)[:, components].reshape(len(matrix), -1)).max() < 1e-9
    monkeypatch.setattr(nearest_bonds, "MOST_DENSE", 0)
    assert not isinstance(network.systems(free)[0][1], np.ndarray)
    sparse = inverse_of(network, free)(forces)
    assert np.abs(dense - sparse).max() < 1e-9 * np.abs(sparse).max()
