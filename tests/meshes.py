"""Mesh files for tests."""

import meshio
import numpy as np

__all__ = ["write_plate"]


def write_plate(path, count=12, hole=((4, 4), (8, 8)), version=None, turned=False):
    """A square of side 1.2 with a square hole, of quadrilaterals left and triangles right, with physical groups.

    Of cells soft, those left of the middle, and stiff, the rest; of lines pull, the right edge, cavity, around the hole, and seam, the
    middle below the hole, inside the material.  Cells of one kind run counter-clockwise, of the other clockwise where `turned`.
    """
    side = 1.2 / count
    points = np.array([[i * side, j * side, 0.0] for j in range(count + 1) for i in range(count + 1)])

    def node(i, j):
        return i + (count + 1) * j

    (i0, j0), (i1, j1) = hole
    cells = [(i, j) for j in range(count) for i in range(count) if not (i0 <= i < i1 and j0 <= j < j1)]
    corners = {
        cell: [node(*cell), node(cell[0] + 1, cell[1]), node(cell[0] + 1, cell[1] + 1), node(cell[0], cell[1] + 1)] for cell in cells
    }
    quads = [corners[i, j] for i, j in cells if i < count // 2]
    triangles = [three for i, j in cells if i >= count // 2 for three in (corners[i, j][:3], [corners[i, j][k] for k in (0, 2, 3)])]
    if turned:
        triangles = [three[::-1] for three in triangles]
    pull = [[node(count, j), node(count, j + 1)] for j in range(count)]
    cavity = [[node(i, j), node(i + 1, j)] for i in range(i0, i1) for j in (j0, j1)]
    cavity += [[node(i, j), node(i, j + 1)] for j in range(j0, j1) for i in (i0, i1)]
    seam = [[node(count // 2, j), node(count // 2, j + 1)] for j in range(j0)]
    blocks = [("quad", quads), ("triangle", triangles), ("line", pull), ("line", cavity), ("line", seam)]
    names = {"soft": (1, 2), "stiff": (2, 2), "pull": (3, 1), "cavity": (4, 1), "seam": (5, 1)}
    if version is None:  # named sets of cells
        sets = {
            name: [np.arange(len(cells)) if k == number - 1 else [] for k, (_, cells) in enumerate(blocks)]
            for name, (number, _) in names.items()
        }
        meshio.write(path, meshio.Mesh(points, blocks, cell_sets=sets))
    else:  # numbered groups, and names for the numbers
        numbers = [np.full(len(cells), number) for number, (_, cells) in enumerate(blocks, 1)]
        mesh = meshio.Mesh(
            points,
            blocks,
            cell_data={"gmsh:physical": numbers, "gmsh:geometrical": numbers},
            field_data={name: np.array(entry) for name, entry in names.items()},
        )
        meshio.write(path, mesh, file_format=version, binary=False)
    return path
