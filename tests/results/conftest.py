"""A stored run that several files of tests read."""

import pytest

import pdsurrogate as pds


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """A sheet of 3 x 1 cm, stretched along x1 about its left edge, which contracts to x2 = 0.5."""
    folder = tmp_path_factory.mktemp("sheet") / "out"
    scene = pds.load_scene("uniaxial", spacing=0.1, stretches=[1.2, 1.5])
    pds.simulate(scene, "neo-hookean").save(folder)
    return folder
