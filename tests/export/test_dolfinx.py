"""Exported energies in DOLFINx: a bonded cube by Newton's method, against FElupe."""

import os
import subprocess
from pathlib import Path

import pytest
from calculix_cubes import bonded, cube, in_felupe
from test_export import SOURCES, imported, written

PLACE = Path(__file__).parents[2] / "build/dolfinx"


@pytest.mark.skipif(
    not (PLACE / "bin/python").exists(),
    reason="needs DOLFINx 0.11 in build/dolfinx: run .ci/solvers",
)
@pytest.mark.parametrize(
    "name",
    [
        "gent",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("ogden", "neo-hookean-isochoric")
        ),
    ],
)
def test_a_bonded_cube_has_the_force_of_felupe(name, tmp_path):
    source = SOURCES[name]()
    path = written(source, "ufl", tmp_path)
    done = subprocess.run(
        [PLACE / "bin/python", Path(__file__).with_name("dolfinx_cube.py"), path, "2", "1.3"],
        env={**os.environ, "LD_LIBRARY_PATH": PLACE / "lib", "XDG_CACHE_HOME": tmp_path},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    force, _, iterations = map(float, done.stdout.split())
    material = imported(written(source, "felupe", tmp_path)).Material()
    nodes, cells = cube(2)
    expected = in_felupe(material, nodes, cells, bonded(nodes, 1.3), 4)
    assert force == pytest.approx(expected[nodes[:, 0] == 1, 0].sum(), rel=1e-9)
    assert iterations <= 20
