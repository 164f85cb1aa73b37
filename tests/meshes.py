"""Mesh files for tests."""

import meshio
import numpy as np

from pdsurrogate.discretization.cells import lattice_of
from pdsurrogate.testing.runs import write_mesh

__all__ = ["divided", "write_bar", "write_deck", "write_plate", "write_triangles"]

GMSH_TYPES = {"line": 1, "triangle": 2, "quad": 3}


CUBE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
"""Corners of a cube in the order of a hexahedron."""

TETRAHEDRA = ([0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6])
"""Of a hexahedron, about the diagonal from its first corner to its seventh."""


def write_bar(path, counts=(8, 4, 4), size=(2.0, 1.0, 1.0), jitter=0.25):
    """A box of tetrahedra whose inner nodes are moved at random; its ends along x1 are the
    groups lower end and upper, half of one part.
    """
    axes = [np.linspace(0, length, count + 1) for count, length in zip(counts, size, strict=True)]
    nodes = lattice_of(*axes)
    inner = ((nodes > 1e-9) & (nodes < np.array(size) - 1e-9)).all(axis=1, keepdims=True)
    nodes += (
        inner
        * np.random.default_rng(0).uniform(-jitter, jitter, nodes.shape)
        * np.array(size)
        / counts
    )
    number = np.arange(len(nodes)).reshape([count + 1 for count in counts])
    corners = [(a, b, c) for c in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    cells = np.array(
        [[number[i + a, j + b, k + c] for a, b, c in corners] for i, j, k in np.ndindex(*counts)]
    )
    tetrahedra = np.concatenate([cells[:, four] for four in TETRAHEDRA])
    faces = np.concatenate(
        [tetrahedra[:, three] for three in ([0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2])]
    )
    x = nodes[faces]
    ends = [faces[np.isclose(x[..., 0], end).all(axis=1)] for end in (0.0, size[0])]
    part = np.flatnonzero(nodes[ends[0]][..., 1].max(axis=1) < size[1] / 2 + 1e-9)
    blocks = [("tetra", tetrahedra), *(("triangle", end) for end in ends)]
    chosen = {
        "lower end": (1, np.arange(len(ends[0]))),
        "upper": (2, np.arange(len(ends[1]))),
        "part": (1, part),
    }
    sets = {
        name: [members if k == block else np.arange(0) for k in range(3)]
        for name, (block, members) in chosen.items()
    }
    meshio.write(path, meshio.Mesh(nodes, blocks, cell_sets=sets))
    return path


def write_triangles(path, count, size=(2.0, 1.0)):
    """A rectangle of squares, so many to a unit of length, each of four triangles about its
    middle.
    """
    axes = [np.linspace(0, length, round(count * length) + 1) for length in size]
    nodes = lattice_of(*axes)
    number = np.arange(len(nodes)).reshape([len(axis) for axis in axes])
    around = np.stack(
        [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1
    ).reshape(-1, 4)
    middle = len(nodes) + np.arange(len(around))
    nodes = np.concatenate([nodes, nodes[around].mean(axis=1)])
    triangles = np.concatenate(
        [np.stack([around[:, k], around[:, (k + 1) % 4], middle], axis=1) for k in range(4)]
    )
    meshio.write(
        path, meshio.Mesh(np.column_stack([nodes, np.zeros(len(nodes))]), [("triangle", triangles)])
    )
    return path


def write_plate(path, count=12, hole=((4, 4), (8, 8)), turned=False, version=4):
    """A square of side 1.2 with a square hole, of quadrilaterals left and triangles right, with
    physical groups.

    Of cells soft, those left of the middle, and stiff, the rest; of lines pull, the right edge,
    cavity, around the hole, and seam, the middle below the hole, inside the material.  Triangles
    run clockwise where `turned`.

    A path that ends with .inp becomes an Abaqus file, one with .msh one of gmsh, as it writes today
    (version 4.1) or did (2.2).
    """
    side = 1.2 / count
    points = np.array(
        [[i * side, j * side, 0.0] for j in range(count + 1) for i in range(count + 1)]
    )

    def node(i, j):
        return i + (count + 1) * j

    (i0, j0), (i1, j1) = hole
    cells = [
        (i, j) for j in range(count) for i in range(count) if not (i0 <= i < i1 and j0 <= j < j1)
    ]
    corners = {
        (i, j): [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)] for i, j in cells
    }
    quads = [corners[i, j] for i, j in cells if i < count // 2]
    triangles = [
        three
        for i, j in cells
        if i >= count // 2
        for three in (corners[i, j][:3], [corners[i, j][k] for k in (0, 2, 3)])
    ]
    if turned:
        triangles = [three[::-1] for three in triangles]
    pull = [[node(count, j), node(count, j + 1)] for j in range(count)]
    cavity = [[node(i, j), node(i + 1, j)] for i in range(i0, i1) for j in (j0, j1)]
    cavity += [[node(i, j), node(i, j + 1)] for j in range(j0, j1) for i in (i0, i1)]
    seam = [[node(count // 2, j), node(count // 2, j + 1)] for j in range(j0)]
    blocks = [
        ("quad", quads),
        ("triangle", triangles),
        ("line", pull),
        ("line", cavity),
        ("line", seam),
    ]
    names = {"soft": (1, 2), "stiff": (2, 2), "pull": (3, 1), "cavity": (4, 1), "seam": (5, 1)}
    if path.suffix == ".inp":
        write_deck(path, points, blocks, {name: number - 1 for name, (number, _) in names.items()})
    elif version == 2:
        numbers = [np.full(len(of_block), number) for number, (_, of_block) in enumerate(blocks, 1)]
        data = {"gmsh:physical": numbers, "gmsh:geometrical": numbers}
        fields = {name: np.array(entry) for name, entry in names.items()}
        meshio.write(
            path,
            meshio.Mesh(points, blocks, cell_data=data, field_data=fields),
            file_format="gmsh22",
            binary=False,
        )
    else:
        path.write_text("\n".join(_gmsh_lines(points, blocks, names)) + "\n")
    return path


DECK_TYPES = {"line": "T3D2", "triangle": "CPS3", "quad": "CPS4", "hexahedron": "C3D8"}


def write_deck(path, points, blocks, names):
    """An Abaqus deck whose block number k has the element set of the name that names gives k."""
    of = {number: name for name, number in names.items()}
    lines = ["*NODE"]
    lines += [f"{k}, " + ", ".join(map(repr, place)) for k, place in enumerate(points.tolist(), 1)]
    label = 0
    for number, (kind, cells) in enumerate(blocks):
        lines.append(f"*ELEMENT, TYPE={DECK_TYPES[kind]}, ELSET={of.get(number, f'block{number}')}")
        for cell in cells:
            label += 1
            lines.append(", ".join(map(str, [label, *(corner + 1 for corner in cell)])))
    path.write_text("\n".join(lines) + "\n")


def _gmsh_lines(points, blocks, names):
    """A file of gmsh's version 4.1, with one entity for each block."""
    yield from ("$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names)))
    yield from (f'{dimension} {number} "{name}"' for name, (number, dimension) in names.items())
    yield from ("$EndPhysicalNames", "$Entities", "0 3 2 0")
    yield from (f"{number} 0 0 0 1 1 0 1 {number} 0" for number in (3, 4, 5, 1, 2))
    yield from (
        "$EndEntities",
        "$Nodes",
        f"1 {len(points)} 1 {len(points)}",
        f"2 1 0 {len(points)}",
    )
    yield from map(str, range(1, len(points) + 1))
    yield from (f"{x1!r} {x2!r} 0" for x1, x2, _ in points.tolist())
    total = sum(len(cells) for _, cells in blocks)
    yield from ("$EndNodes", "$Elements", f"{len(blocks)} {total} 1 {total}")
    tag = 0
    for number, (kind, cells) in enumerate(blocks, 1):
        yield f"{1 if kind == 'line' else 2} {number} {GMSH_TYPES[kind]} {len(cells)}"
        for cell in cells:
            tag += 1
            yield " ".join(map(str, [tag, *(corner + 1 for corner in cell)]))
    yield "$EndElements"


def divided(folder, dimension, count):
    """The body of a scene of a unit square of halved squares, or a cube of cubes in six parts, in
    a file.
    """
    path = folder / "cells.vtu"
    write_mesh(path, dimension, count)
    return {"shape": "mesh", "file": str(path), "dimension": dimension}
