"""The preconditioner of sheets, which becomes softer where they are stretched."""

import numpy as np
import pytest

import pdsurrogate as pds
from pdsurrogate.body import Body
from pdsurrogate.forces import FORCES, ForceSettings
from pdsurrogate.materials import NeoHookean, homogeneous
from pdsurrogate.solvers.nearest_bonds import Preconditioner
from pdsurrogate.solvers.preconditioner import softened

NEARLY = NeoHookean(1.0, 1e4)


def scales(gradient):
    """Factors by which the preconditioner of a homogeneously deformed sheet scales a force and its displacement, for either component."""
    points = np.stack(np.meshgrid(*[(np.arange(8) + 0.5) / 8] * 2), axis=-1).reshape(-1, 2)
    force = FORCES["bond-energy"]().bind(Body(points, np.full(64, 1 / 64), 3.15 / 8, 1 / 8), NEARLY, ForceSettings(precision="float64"))
    force(points @ np.transpose(gradient), np.empty_like(points))
    found = softened(force, Preconditioner(lambda forces: forces.copy()))
    found.update()
    return np.sqrt(found.solve(np.ones_like(points))[0])


def test_a_sheet_at_rest_has_the_preconditioner_of_its_network():
    np.testing.assert_allclose(scales(np.eye(2)), 1.0, rtol=1e-12)


@pytest.mark.parametrize("gradient", [(2.5, 2.5**-0.5), (1.4, 1.2), (3.0, 1.0)])
def test_the_softening_is_that_of_incompressible_rubber(gradient):
    """(36a) against speeds of waves in all directions, whose squares are stiffnesses, in the mean 1 + 3/2 M for a component."""
    left = 2 / scales(np.diag(gradient)) ** 2 - 1
    normals = [(np.cos(angle), np.sin(angle)) for angle in np.linspace(0, np.pi, 60, endpoint=False)]
    squares = [np.sum(np.square(homogeneous.wave_speeds(NEARLY, np.diag(gradient), normal, 1.0))) for normal in normals]
    assert np.mean(squares) == pytest.approx(2 + 1.5 * left.sum(), rel=2e-3)


def test_a_compressed_sheet_is_not_softened():
    """The compressed component is stiffer than at rest, and the preconditioner leaves it as it is."""
    np.testing.assert_allclose(scales(np.diag([0.5, 2**0.5])), 1.0, rtol=1e-12)


def test_a_cloud_needs_at_most_twice_the_evaluations_of_the_lattice():
    """All rows of the lattice are alike in tension. The numbers are 35 and 20; with the preconditioner at rest the cloud needs 44."""
    counts = []
    for cloud in ({}, {"arrangement": "relaxed", "seed": 1}):
        held = [{"region": "left", "x1": 0.0}, {"region": "bottom", "x2": 0.0}, {"region": "right", "x1": 4.5}]
        rubber = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 20.0}
        scene = {"name": "sheet", "body": {"size": [3.0, 1.0]} | cloud, "material": rubber, "prescribed": held, "spacing": 0.05}
        scene |= {"horizon_ratio": 2.2, "steps": [{"to": 1.0, "outputs": 2}]}
        levels = pds.simulate(pds.Scene.model_validate(scene), "bond-energy", threads=1).levels
        counts.append(sum(level["evaluations"] for level in levels))
    assert counts[1] <= 2 * counts[0]
