"""Script for a Python with DOLFINx 0.11: Newton's method for a bonded cube of an exported energy.

Arguments: the exported file, the number of elements along an edge, and the stretch. Prints the
reaction on the moved plate along x1, the stored energy, and the number of iterations.
"""

import importlib.util
import sys

import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

path, n, stretch = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
spec = importlib.util.spec_from_file_location("law", path)
law = importlib.util.module_from_spec(spec)
spec.loader.exec_module(law)
box = mesh.create_unit_cube(MPI.COMM_WORLD, n, n, n, mesh.CellType.hexahedron)
V = fem.functionspace(box, ("Lagrange", 1, (3,)))
u, v, du = fem.Function(V), ufl.TestFunction(V), ufl.TrialFunction(V)
dx = ufl.dx(metadata={"quadrature_degree": 3})  # two points of Gauss along an edge
F = ufl.Identity(3) + ufl.grad(u)
energy, force, stiffness = (
    fem.form(integrand * dx)
    for integrand in (
        law.psi(F),
        ufl.inner(law.stress(F), ufl.grad(v)),
        ufl.inner(law.tangent(F, ufl.grad(du)), ufl.grad(v)),
    )
)
x = V.tabulate_dof_coordinates()
plates = [3 * np.flatnonzero(np.isclose(x[:, 0], at))[:, None] + np.arange(3) for at in (0, 1)]
free = np.setdiff1d(np.arange(3 * len(x)), np.concatenate(plates))
iterations = 0
for reached in np.linspace(1, stretch, 5)[1:]:
    u.x.array[plates[1][:, 0]] = reached - 1
    while True:
        residual = fem.assemble_vector(force).array
        if np.abs(residual[free]).max() < 1e-12:
            break
        tangent = fem.assemble_matrix(stiffness).to_dense()
        u.x.array[free] -= np.linalg.solve(tangent[np.ix_(free, free)], residual[free])
        iterations += 1
print(residual[plates[1][:, 0]].sum(), fem.assemble_scalar(energy), iterations)
