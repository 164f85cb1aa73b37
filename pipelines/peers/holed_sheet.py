"""A square sheet with a hole, stretched to 1.5 both ways on rollers, in plane stress: a quarter."""

import math
from pathlib import Path

from bonded_cube import computed, pulled

STRESS, HOLE = 1.1323729165387342, 0.43987790023302137
"""Nominal stress, and displacement of the hole of radius 0.3 on an axis: nine-node elements."""
THICKNESS = 0.01


def found(n, stress, hole, unknowns):
    """Figures of a row."""
    errors = 100 * (stress / STRESS - 1), 100 * (hole / HOLE - 1)
    names = "error of stress (%)", "error at hole (%)"
    return {"n": n, "unknowns": unknowns, **dict(zip(names, errors, strict=True))}


def ours(n, force=None):
    """The package with n points along the side of the quarter."""
    import pdsurrogate as pds

    file = Path(__file__).parents[1] / "data" / "quarter-with-hole.toml"
    result = pds.simulate(pds.load_scene(file, spacing=1 / n), force)
    (level,) = result.levels
    hole = level["probes"]["hole"]["displacement"][0]
    return found(n, level["forces"]["right"][0], hole, result.body.points.size)


def place(s, t, tuned):
    """Place in the quarter: s from the hole to the outer sides, t from one axis to the other."""
    angle, s = 0.5 * math.pi * t, s**1.5 if tuned else s
    x, y = math.cos(angle), math.sin(angle)
    outer = max(x, y)
    return [0.3 * (1 - s) * one + s * one / outer for one in (x, y)]


def felupe(n, tuned=False):
    """FElupe, which has rubber in three dimensions alone: a layer of quadratic hexahedra, n from
    the hole to the outer side and 2 n around.
    """
    import felupe as fem
    import numpy as np

    mesh = fem.Cube(b=(1, 1, THICKNESS / 2), n=(n + 1, 2 * n + 1, 2)).add_midpoints_edges()
    hole = int(np.argmin(mesh.points.sum(axis=1)))
    right = np.isclose(mesh.x, 1) & (mesh.y < 0.5 + 1e-9)
    top = np.isclose(mesh.x, 1) & (mesh.y > 0.5 - 1e-9)
    left, bottom = np.isclose(mesh.y, 1), np.isclose(mesh.y, 0)
    points = mesh.points.copy()
    points[:, :2] = [place(s, t, tuned) for s, t in points[:, :2]]
    mesh.update(points=points)
    field = fem.FieldContainer([fem.Field(fem.RegionQuadraticHexahedron(mesh), dim=3)])
    boundaries = {
        "left": fem.Boundary(field[0], mask=left, skip=(0, 1, 1)),
        "bottom": fem.Boundary(field[0], mask=bottom, skip=(1, 0, 1)),
        "middle": fem.Boundary(field[0], fz=0.0, skip=(1, 1, 0)),
        "right": fem.Boundary(field[0], mask=right, skip=(0, 1, 1)),
        "top": fem.Boundary(field[0], mask=top, skip=(1, 0, 1)),
    }
    umat, ends = fem.NeoHooke(mu=1.0, bulk=100.0), {"right": 0.5, "top": 0.5}
    force = pulled(field, umat, boundaries, ends, tuned, 5)
    moved = float(field[0].values[hole, 0])
    return found(n, 2 * force / THICKNESS, moved, field[0].values.size)


def calculix(n, tuned=False):
    """CalculiX with quadratic elements of plane stress, n from the hole to the outer side and 2 n
    around.
    """
    number, lines = {}, ["*NODE, NSET=ALL"]
    for s in range(2 * n + 1):
        for t in range(4 * n + 1):
            if not (s % 2 and t % 2):
                number[s, t] = len(number) + 1
                x, y = place(s / (2 * n), t / (4 * n), tuned)
                lines.append(f"{number[s, t]}, {x:.9g}, {y:.9g}")
    lines.append("*ELEMENT, TYPE=CPS8R, ELSET=ALL")
    around = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
    cells = [(s, t) for s in range(0, 2 * n, 2) for t in range(0, 4 * n, 2)]
    for count, (s, t) in enumerate(cells, 1):
        corners = [number[s + a, t + b] for a, b in around]
        lines.append(", ".join(map(str, [count, *corners])))
    sets = {
        "LEFT": lambda s, t: t == 4 * n,
        "BOTTOM": lambda s, t: t == 0,
        "END": lambda s, t: s == 2 * n and t <= 2 * n,
        "TOP": lambda s, t: s == 2 * n and t >= 2 * n,
    }
    for name, inside in sets.items():
        lines += [f"*NSET, NSET={name}", *(str(one) for at, one in number.items() if inside(*at))]
    lines.append(f"*NSET, NSET=POINT\n{number[0, 0]}")
    held, ends = "LEFT, 1, 1\nBOTTOM, 2, 2", "END, 1, 1, 0.5\nTOP, 2, 2, 0.5"
    *_, point, force = computed(lines, 100.0, f"{THICKNESS}\n", held, ends, tuned)
    return found(n, force[0] / THICKNESS, point[1], 3 * len(number))
