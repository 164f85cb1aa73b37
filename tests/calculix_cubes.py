"""Cubes of hexahedra with displacements on their faces, in CalculiX and in FElupe."""

from itertools import product

import numpy as np
import pytest
from calculix import CORNERS, run


def cube(n):
    """Nodes (m, 3) of a unit cube and its n^3 cells of eight numbers of nodes."""
    nodes = np.array(list(product(range(n + 1), repeat=3)))
    starts = np.array(list(product(range(n), repeat=3)))
    return nodes / n, (starts[:, None] + CORNERS) @ [(n + 1) ** 2, n + 1, 1]


def bonded(nodes, stretch):
    """Displacements of a cube between plates that move apart along x1, NaN where it is free."""
    moves = np.full(nodes.shape, np.nan)
    moves[nodes[:, 0] == 0] = 0
    moves[nodes[:, 0] == 1] = [stretch - 1, 0, 0]
    return moves


def in_calculix(folder, material, nodes, cells, moves, increments, name="RUBBER", command="ccx"):
    """Forces (m, 3) on the nodes and mean Cauchy stress (3, 3) after `increments` equal increments
    of a second in all to the displacements `moves` (m, 3).
    """
    held = [
        f"{node + 1}, {axis + 1}, {axis + 1}, {moves[node, axis]:.12g}"
        for node, axis in np.argwhere(np.isfinite(moves))
    ]
    lines = [
        "*NODE, NSET=ALL",
        *(f"{k}, {', '.join(f'{x:.12g}' for x in at)}" for k, at in enumerate(nodes, 1)),
        "*ELEMENT, TYPE=C3D8, ELSET=BODY",
        *(", ".join(map(str, [k, *(cell + 1)])) for k, cell in enumerate(cells, 1)),
        f"{material}\n*SOLID SECTION, ELSET=BODY, MATERIAL={name}",
        f"*STEP, NLGEOM, INC=1000\n*STATIC, DIRECT\n{1 / increments:.12g}, 1.\n*BOUNDARY",
        *held,
        "*NODE PRINT, NSET=ALL, FREQUENCY=1000\nRF",
        "*EL PRINT, ELSET=BODY, FREQUENCY=1000\nS\n*END STEP\n",
    ]
    forces, stresses = run("\n".join(lines), folder, command).split("stresses (elem")
    rows = [[float(word) for word in line.split()] for line in forces.splitlines()[2:]]
    forces = np.array([row[1:] for row in rows if len(row) == 4])
    rows = [[float(word) for word in line.split()] for line in stresses.splitlines()[1:]]
    mean = np.mean([row[2:] for row in rows if len(row) == 8], axis=0)
    return forces, mean[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]


def in_felupe(material, nodes, cells, moves, increments):
    """Forces (m, 3) on the nodes in FElupe, whose hexahedron is that of CalculiX's C3D8: eight
    nodes, eight points of integration.
    """
    felupe = pytest.importorskip("felupe", reason="needs felupe")
    mesh = felupe.Mesh(nodes, cells, "hexahedron")
    field = felupe.FieldContainer([felupe.Field(felupe.RegionHexahedron(mesh), dim=3)])
    solid = felupe.SolidBody(umat=material, field=field)
    held = {
        str(axis): felupe.Boundary(
            field[0],
            mask=np.isfinite(moves[:, axis]),
            skip=tuple(int(other != axis) for other in range(3)),
        )
        for axis in range(3)
    }
    ramp = {
        boundary: [
            share * moves[np.isfinite(moves[:, int(axis)]), int(axis)]
            for share in np.linspace(0, 1, increments + 1)[1:]
        ]
        for axis, boundary in held.items()
    }
    step = felupe.Step([solid], ramp=ramp, boundaries=held)
    felupe.Job([step]).evaluate(verbose=0, tol=1e-10)
    return solid.results.force.toarray().reshape(-1, 3)
