"""A body from a mesh file of triangles, written here by meshio, in uniaxial tension."""

import tempfile
from pathlib import Path

import meshio
import numpy as np
from scipy.spatial import Delaunay

import pdsurrogate as pds

x1, x2 = np.meshgrid(np.linspace(0, 2, 33), np.linspace(0, 1, 17))
corners = np.column_stack([x1.ravel(), x2.ravel(), np.zeros(x1.size)])
triangles = Delaunay(corners[:, :2]).simplices
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "sheet.vtk"
    meshio.write_points_cells(file, corners, [("triangle", triangles)])
    scene = pds.Scene(
        name="from-a-mesh",
        body=pds.shapes.Mesh(file=str(file)),
        material=pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=1e4),
        prescribed=(
            pds.Prescribed(region="left", x1=0.0),
            pds.Prescribed(region="bottom", x2=0.0),
            pds.Prescribed(region="right", x1=1.0),
        ),
        steps=(1.0,),
    )
    level = pds.simulate(scene, "bond-energy").levels[-1]

exact = 1.5 - 1.5**-2  # incompressible: mu (l - l^-2) on a side of 1
print(f"force {level['forces']['right'][0]:.5f}, exact {exact:.5f}")
assert abs(level["forces"]["right"][0] / exact - 1) < 1e-3  # mu/K, and the solver
