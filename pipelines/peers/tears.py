"""A strip with a cut, torn in pure shear: against phase fields written with DOLFINx."""

from pathlib import Path

LENGTH, CUT, ENERGY = 4.0, 1.5, 0.5
"""Of a strip of height 1 and shear modulus 1."""


def figures(stretch, energy, load, path, unknowns):
    """G at the peak of the load is the energy density there, times the height."""
    return {
        "G (%)": 100 * (energy / ENERGY - 1),
        "peak": load,
        "stretch": stretch,
        "off the row": path,
        "unknowns": unknowns,
    }


def phase_field(h, width, model="AT1", tuned=True, seed=0):
    """Phase field of an incompressible neo-Hookean sheet: alternate minimization, with bounds that
    make the damage irreversible, until the load has fallen by 5 %.

    Tuned: elements of size h where the crack runs alone, an energy corrected for their size,
    shorter steps where damage takes more iterations. A seed moves the nodes.
    """
    import numpy as np
    import ufl
    from dolfinx import fem, mesh
    from dolfinx.fem import petsc
    from mpi4py import MPI

    def places(end, *fine):
        """Of nodes: h apart between `fine`, farther by a quarter from each to the next outside."""
        sides = []
        for begin, far in zip(fine, (0, end), strict=True):
            at, step, long = [0.0], h, abs(far - begin)
            while at[-1] < long - 1e-9:
                step = min(1.25 * step, end / 16)
                at.append(at[-1] + step)
            sides.append(np.array(at[1:]) * (long / max(at[-1], h)))
        middle = np.linspace(*fine, 2 * round((fine[1] - fine[0]) / h / 2) + 1)
        return np.concatenate([fine[0] - sides[0][::-1], middle, fine[1] + sides[1]])

    xs, ys = places(LENGTH, 0, LENGTH), places(1, 0, 1)
    if tuned:
        xs, ys = (
            places(LENGTH, CUT - 4 * width, LENGTH),
            places(1, 0.5 - 3 * width, 0.5 + 3 * width),
        )
    cells = len(xs) - 1, len(ys) - 1
    sort = mesh.DiagonalType.left_right
    body = mesh.create_rectangle(MPI.COMM_SELF, [(0, 0), cells], cells, diagonal=sort)
    nodes = body.geometry.x
    free = (nodes[:, :2] % cells > 0).all(axis=1) & ~np.isclose(
        ys[nodes[:, 1].round().astype(int)], 0.5
    )
    moves = np.random.default_rng(seed).uniform(-0.25, 0.25, (len(nodes), 2)) * free[:, None]
    for k, at in enumerate((xs, ys)):
        nodes[:, k] = np.interp(nodes[:, k] + (seed > 0) * moves[:, k], np.arange(len(at)), at)
    V, S = (fem.functionspace(body, ("Lagrange", 1, shape)) for shape in ((2,), ()))
    u, moved, unit = (fem.Function(V) for _ in range(3))
    a, lower, upper = (fem.Function(S) for _ in range(3))
    c, w = (8 / 3, a) if model == "AT1" else (2, a**2)
    gc = ENERGY / (1 + h / (c * width)) if tuned else ENERGY
    F = ufl.Identity(2) + ufl.grad(u)
    elastic = ((1 - a) ** 2 + 1e-6) / 2 * (ufl.inner(F, F) + ufl.det(F) ** -2 - 3)
    crack = gc / c * (w / width + width * ufl.inner(ufl.grad(a), ufl.grad(a)))
    E = (elastic + crack) * ufl.dx(degree=2)
    top, bottom = (
        fem.locate_dofs_geometrical(V, lambda x, y=y: np.isclose(x[1], y)) for y in (1, 0)
    )
    cut = fem.locate_dofs_geometrical(S, lambda x: (x[0] < CUT + 1e-9) & np.isclose(x[1], 0.5))
    upper.x.array[:] = unit.x.array[2 * top + 1] = lower.x.array[cut] = 1
    options = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
    options |= {"snes_rtol": 1e-6, "snes_atol": 1e-9, "snes_linesearch_type": "bt"}
    held = [fem.dirichletbc(np.zeros(2), bottom, V), fem.dirichletbc(moved, top)]
    motion = petsc.NonlinearProblem(
        ufl.derivative(E, u), u, bcs=held, petsc_options_prefix="u", petsc_options=options
    )
    damage = petsc.NonlinearProblem(
        ufl.derivative(E, a),
        a,
        bcs=[fem.dirichletbc(upper, cut)],
        petsc_options_prefix="a",
        petsc_options=options | {"snes_type": "vinewtonrsls"},
    )
    damage.solver.setVariableBounds(lower.x.petsc_vec, upper.x.petsc_vec)
    reaction = fem.form(ufl.action(ufl.derivative(E, u), unit))
    stretch, step, load, peak = 1.0, 0.05, 0.0, (0.0, 1.0)
    while load >= 0.95 * peak[0]:
        stretch += step
        moved.x.array[1::2] = stretch - 1
        count, change = 0, 1.0
        while count < 500 and change > 1e-3 and load >= 0.95 * peak[0] * (count > 0):
            old = a.x.array.copy()
            motion.solve()
            damage.solve()
            load = float(fem.assemble_scalar(reaction)) / LENGTH
            count, change = count + 1, abs(a.x.array - old).max()
        lower.x.array[:] = np.maximum(lower.x.array, a.x.array)
        peak = max(peak, (load, stretch))
        step = 0.05 if stretch < 1.3 else 0.0025 if count > 12 and tuned else min(step, 0.01)
    broken = S.tabulate_dof_coordinates()[a.x.array > 0.9]
    path = float(abs(broken[broken[:, 0] > CUT, 1] - 0.5).max(initial=0))
    energy = (peak[1] - 1 / peak[1]) ** 2 / 2
    return figures(peak[1], energy, peak[0], path, 3 * len(a.x.array))


def ours(rows, seed=0, process="quasi-static", ratio=2.2):
    """A strip of so many rows, on the lattice or on relaxed points of a seed."""
    import numpy as np

    import pdsurrogate as pds

    changes = {"spacing": 1 / rows, "horizon_ratio": ratio, "fracture.process": process}
    changes |= {"body.arrangement": "relaxed", "body.seed": seed} if seed else {}
    scene = pds.load_scene(Path(__file__).parents[1] / "data" / "peer-strip.toml", changes)
    result = pds.simulate(scene, "bond-energy", threads=1)
    crack, law = result.summary["crack"], result.scene.law()
    peak = crack["peak"]
    energy = pds.materials.homogeneous.pure_shear(law, peak["stretch"]).energy_density
    broken = result.body.points[(result.field("damage") > 0.3) & (result.body.points[:, 0] > CUT)]
    path = float(np.abs(broken[:, 1] - 0.5).max(initial=0))
    return figures(peak["stretch"], energy, peak["nominal_stress"], path, result.body.points.size)


def repeated(function, seeds, **setting):
    """Mean and deviation over seeds, one process for all."""
    import numpy as np

    found = [globals()[function](seed=seed, **setting) for seed in range(1, seeds + 1)]
    off = [one["G (%)"] for one in found]
    mean = {key: float(np.mean([one[key] for one in found])) for key in found[0]}
    return mean | {"deviation (%)": float(np.std(off, ddof=1))}
