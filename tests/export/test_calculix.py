"""Laws in CalculiX: its own cards, and user materials compiled into it, against the same energy in
FElupe and here.
"""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from calculix_cubes import bonded, cube, in_calculix, in_felupe
from test_export import SOURCES, imported, written

import pdsurrogate as pds
from pdsurrogate.export import source_of_law
from pdsurrogate.materials import Branch, Memory, Softening

OBJECTS = Path(__file__).parents[2] / "build/calculix"
needs_objects = pytest.mark.skipif(
    not (OBJECTS / "ccx.a").exists() or shutil.which("gfortran") is None,
    reason="needs gfortran and the objects of CalculiX in build/calculix: run .ci/solvers",
)
LIBRARIES = ("-lspooles", "-larpack", "-llapack", "-lblas", "-lpthread", "-lm", "-fopenmp")


REMEMBERING = Memory((Branch(0.8, 2.0), Branch(1.7, 0.3)), Softening(1.5, 0.1, 0.2))
MATERIALS = {name: SOURCES[name] for name in ("gent", "ogden", "neo-hookean-isochoric")} | {
    "memory": lambda: source_of_law(pds.materials.Yeoh(0.4, 4.0, memory=REMEMBERING)),
}


@needs_objects
@pytest.mark.parametrize("name", MATERIALS)
def test_a_user_material_in_calculix_has_the_stress_of_the_package(name, tmp_path):
    """One element that is turned and sheared, and a bonded cube, whose axes turn too."""
    source = MATERIALS[name]()
    path = written(source, "calculix-umat", tmp_path)
    objects = [OBJECTS / "ccx.o", "law.o", OBJECTS / "ccx.a"]
    subprocess.run(
        ["gfortran", "-O1", "-Wall", "-Wno-unused-dummy-argument", "-c", path, "-o", "law.o"],
        cwd=tmp_path,
        check=True,
    )
    subprocess.run(["gfortran", "-o", "ccx", *objects, *LIBRARIES], cwd=tmp_path, check=True)
    moduli = ", ".join(f"{modulus:.12g}" for modulus in source.moduli)
    card = (
        f"*MATERIAL, NAME=USER_LAW\n*USER MATERIAL, CONSTANTS=2\n{moduli}\n"
        f"*DEPVAR\n{source.n_state + 1}"
    )
    options = {"name": "USER_LAW", "command": tmp_path / "ccx"}
    module = imported(written(source, "felupe", tmp_path))
    material = module.Material()
    nodes, cells = cube(1)
    F = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]) @ [
        [1.4, 0.5, 0],
        [0, 0.8, 0.2],
        [0, 0, 0.9],
    ]
    moves = nodes @ (F - np.eye(3)).T
    _, stress = in_calculix(tmp_path, card, nodes, cells, moves, 8, **options)
    state = np.zeros((*material.x[-1].shape, 1, 1))
    material.time_step = 1 / 8
    for share in np.linspace(0, 1, 9)[1:]:
        path_of_F = np.eye(3) + share * (F - np.eye(3))
        P, state = material.gradient([path_of_F[:, :, None, None], state])
    exact = P[..., 0, 0] @ F.T / np.linalg.det(F)
    assert abs(stress - exact).max() <= 1e-5 * abs(exact).max()
    nodes, cells = cube(2)
    moves = bonded(nodes, 1.3)
    forces, _ = in_calculix(tmp_path, card, nodes, cells, moves, 4, **options)
    material.time_step = 1 / 4
    expected = in_felupe(material, nodes, cells, moves, 4)
    assert abs(forces - expected).max() <= 1e-5 * abs(expected).max()
