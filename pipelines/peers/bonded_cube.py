"""A cube between bonded plates, pulled to 1.5: an eighth of it, between planes of symmetry."""

import time
from pathlib import Path

FORCES = {100.0: 1.24139, 1000.0: 1.25451}
"""Force on a plate of side 1 by K / mu, by finer elements; `cube-references` agree to 0.03 %."""


def found(n, force, K, unknowns, began):
    """Figures of a row: `force` is that on the eighth."""
    error = 100 * (4 * force / FORCES[K] - 1)
    return {
        "n": n,
        "unknowns": unknowns,
        "force": 4 * force,
        "error (%)": error,
        "solving (s)": time.process_time() - began,
    }


def ours(n, K, **solver):
    """The package with n points along a side of the cube."""
    import pdsurrogate as pds

    changes = {"material.bulk_modulus": K, "prescribed.1.x1": 0.25, "solver": solver}
    changes["steps.0.largest_increment"] = 0.2
    file = Path(__file__).parents[1] / "data" / "bonded-eighth.toml"
    pds.simulate(pds.load_scene(file, changes))  # loads compiled code
    began = time.process_time()
    result = pds.simulate(pds.load_scene(file, changes, spacing=1 / n))
    return found(n, result.levels[-1]["forces"]["right"][0], K, result.body.points.size, began)


def graded(x, tuned):
    """Places along the axis of the cube from 0 to 0.5, finer towards the bonded end if tuned."""
    return 0.5 * (1 - (1 - 2 * x) ** 2) if tuned else x


def pulled(field, umat, boundaries, ends, tuned, steps):
    """Force on the first of the boundaries that FElupe moves to the ends, by Newton's method."""
    import felupe as fem

    solid, more = fem.SolidBody(umat, field), {}
    if tuned:
        from pypardiso import spsolve

        more["solver"] = spsolve
    for step in range(1, steps + 1):
        for name, end in ends.items():
            boundaries[name].update(end * step / steps)
        fixed, free = fem.dof.partition(field, boundaries)
        given = fem.dof.apply(field, boundaries, fixed)
        result = fem.newtonraphson(
            items=[solid], x0=field, dof0=fixed, dof1=free, ext0=given, verbose=0, **more
        )
        field.link(result.x)
    return float(fem.tools.force(field, result.fun, boundaries[next(iter(ends))])[0])


def computed(lines, K, section, held, moved, tuned):
    """Rows of figures that CalculiX prints for a deck of nodes, elements and sets of ALL."""
    import subprocess

    lines = [
        *lines,
        "*MATERIAL, NAME=RUBBER\n*HYPERELASTIC, NEO HOOKE",
        f"0.5, {2 / K:.9g}",
        f"*SOLID SECTION, ELSET=ALL, MATERIAL=RUBBER\n{section}*BOUNDARY\n{held}",
        "*STEP, NLGEOM, INC=100\n*STATIC" + ("\n0.5, 1." if tuned else "\n0.2, 1."),
        f"*BOUNDARY\n{moved}\n*NODE PRINT, NSET=POINT\nU",
        "*NODE PRINT, NSET=END, TOTALS=ONLY\nRF\n*END STEP\n",
    ]
    with open("deck.inp", "w") as file:
        file.write("\n".join(lines))
    subprocess.run(["ccx", "-i", "deck"], check=True, stdout=subprocess.DEVNULL)
    with open("deck.dat") as file:
        rows = [line.split() for line in file if "." in line and "time" not in line]
    return [[float(one) for one in row] for row in rows]


def felupe(n, K, quadratic=True, tuned=False):
    """FElupe with n hexahedra along half a side: fields of displacement, pressure and volume."""
    import felupe as fem
    import numpy as np

    began = time.process_time()
    mesh = fem.Cube(b=(0.5, 0.5, 0.5), n=n + 1)
    if tuned:
        mesh.update(points=graded(mesh.points, tuned))
    if quadratic:
        mesh = mesh.add_midpoints_edges().add_midpoints_faces().add_midpoints_volumes()
        mesh.update(cells=mesh.cells, cell_type="hexahedron27")
    region = (fem.RegionTriQuadraticHexahedron if quadratic else fem.RegionHexahedron)(mesh)
    field = fem.FieldsMixed(region, n=3)
    end = np.isclose(mesh.x, 0.5)
    boundaries = {
        "x": fem.Boundary(field[0], fx=0.0, skip=(0, 1, 1)),
        "y": fem.Boundary(field[0], fy=0.0, skip=(1, 0, 1)),
        "z": fem.Boundary(field[0], fz=0.0, skip=(1, 1, 0)),
        "bonded": fem.Boundary(field[0], mask=end, skip=(1, 0, 0)),
        "move": fem.Boundary(field[0], mask=end, skip=(0, 1, 1)),
    }
    umat = fem.NearlyIncompressible(
        fem.NeoHooke(mu=1.0),
        K,
        dUdJ=lambda J, K: K / 4 * (J - 1 / J) * (1 + 1 / J**2),
        d2UdJdJ=lambda J, K: K / 4 * (1 + 3 / J**4),
    )
    force = pulled(field, umat, boundaries, {"move": 0.25}, tuned, 2 if tuned else 5)
    return found(n, force, K, sum(one.values.size for one in field.fields), began)


def dolfinx(n, K, degree=None, steps=5):
    """DOLFINx with n cells of six tetrahedra along half a side, with quadratic displacements and
    linear pressures; of the quadrature it chooses, or of a degree.
    """
    import numpy as np
    import ufl
    from dolfinx import fem, mesh, nls
    from mpi4py import MPI
    from petsc4py import PETSc

    box = mesh.create_box(MPI.COMM_WORLD, [[0, 0, 0], [0.5] * 3], [n] * 3)
    kinds = [ufl.VectorElement("CG", box.ufl_cell(), 2), ufl.FiniteElement("CG", box.ufl_cell(), 1)]
    space = fem.FunctionSpace(box, ufl.MixedElement(kinds))
    state = fem.Function(space)
    u, p = ufl.split(state)
    F = ufl.Identity(3) + ufl.grad(u)
    J = ufl.det(F)
    energy = (ufl.tr(F.T * F) * J ** (-2 / 3) - 3) / 2 + p * (J - 1 / J) / 2 - p**2 / (2 * K)
    dx = ufl.dx(metadata={"quadrature_degree": degree}) if degree else ufl.dx
    residual = ufl.derivative(energy * dx, state)
    moved = fem.Constant(box, PETSc.ScalarType(0.0))
    zero = fem.Constant(box, PETSc.ScalarType(0.0))

    def held(axis, at, value, component):
        facets = mesh.locate_entities_boundary(box, 2, lambda x: np.isclose(x[axis], at))
        part = space.sub(0).sub(component)
        return fem.dirichletbc(value, fem.locate_dofs_topological(part, 2, facets), part)

    conditions = [held(axis, 0.0, zero, axis) for axis in range(3)]
    conditions += [held(0, 0.5, value, axis) for axis, value in enumerate((moved, zero, zero))]
    problem = fem.petsc.NonlinearProblem(residual, state, conditions)
    solver = nls.petsc.NewtonSolver(box.comm, problem)
    solver.convergence_criterion = "incremental"
    solver.atol = solver.rtol = 1e-8
    solver.krylov_solver.setType("preonly")
    solver.krylov_solver.getPC().setType("lu")
    solver.krylov_solver.getPC().setFactorSolverType("mumps")
    began = time.process_time()
    for step in range(steps):
        moved.value = 0.25 * (step + 1) / steps
        solver.solve(state)
    reactions = fem.petsc.assemble_vector(fem.form(residual))
    force = float(reactions.array[conditions[3].dof_indices()[0]].sum())
    return found(n, force, K, space.dofmap.index_map.size_global * space.dofmap.index_map_bs, began)


def calculix(n, K, tuned=False):
    """CalculiX with n quadratic hexahedra with reduced integration along half a side."""
    import itertools

    began, ends = time.process_time(), range(2 * n + 1)
    number, lines = {}, ["*NODE, NSET=ALL"]
    for place in itertools.product(ends, repeat=3):
        if sum(one % 2 for one in place) < 2:
            number[place] = len(number) + 1
            at = (graded(one / (4 * n), tuned) for one in place)
            lines.append(", ".join([str(number[place]), *(f"{one:.9g}" for one in at)]))
    lines.append("*ELEMENT, TYPE=C3D20R, ELSET=ALL")
    ring = [(0, 0), (2, 0), (2, 2), (0, 2)]
    middle = [(1, 0), (2, 1), (1, 2), (0, 1)]
    corners = [(*at, z) for z, around in ((0, ring), (2, ring)) for at in around]
    corners += [(*at, z) for z in (0, 2) for at in middle] + [(*at, 1) for at in ring]
    for count, at in enumerate(itertools.product(range(0, 2 * n, 2), repeat=3), 1):
        cell = [number[tuple(a + b for a, b in zip(at, one, strict=True))] for one in corners]
        lines += [", ".join(map(str, [count, *cell[:15]])) + ",", ", ".join(map(str, cell[15:]))]
    for name, axis, value in (("X", 0, 0), ("Y", 1, 0), ("Z", 2, 0), ("END", 0, 2 * n)):
        lines.append(f"*NSET, NSET={name}")
        lines += [str(one) for place, one in number.items() if place[axis] == value]
    lines.append("*NSET, NSET=POINT\n1")
    held = "X, 1, 1\nY, 2, 2\nZ, 3, 3\nEND, 2, 3"
    force = computed(lines, K, "", held, "END, 1, 1, 0.25", tuned)[-1][0]
    row = found(n, force, K, 3 * len(number), began)
    del row["solving (s)"]
    return row
