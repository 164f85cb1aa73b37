"""VTU files with a PVD index, for ParaView."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np

from ..body import CellMesh
from .files import write_text, write_with

CELL_TYPES = {(2, 3): "triangle", (2, 4): "quad", (3, 4): "tetra", (3, 8): "hexahedron"}
"""Names of cells by the dimension and the number of their corners."""

DISPLACEMENT = "displacement"
EXACT = ("position", DISPLACEMENT)
"""The fields that are written in double precision: all others follow from them, and are written in single."""


def write_state(path: Path, cells: CellMesh, nodes: np.ndarray, fields: dict[str, np.ndarray], values: dict[str, float]) -> None:
    """Write the fields of one state on the cells of a body, and single values as field data.

    The cells are at their reference positions; warp by the ``displacement`` of the nodes to see the deformed body.

    Parameters
    ----------
    path : Path
    cells : CellMesh
        In the order of the points of the body.
    nodes : ndarray, shape (k, d)
        Displacements of their corners.
    fields : dict of ndarray, each of shape (n,) or (n, k)
        On the points.
    values : dict of float
    """
    flat = ((0, 0), (0, 3 - cells.dimension))
    ends = np.cumsum([len(block) for block in cells.blocks])[:-1]
    data = {name: np.split(field if name in EXACT else field.astype(np.float32), ends) for name, field in fields.items()}
    blocks = [(CELL_TYPES[cells.dimension, block.shape[1]], block.astype(np.int32, copy=False)) for block in cells.blocks]
    moved = {DISPLACEMENT: np.pad(nodes, flat).astype(np.float32)}
    mesh = meshio.Mesh(np.pad(cells.nodes, flat), blocks, point_data=moved, cell_data=data)

    def write(temporary: Path) -> None:
        meshio.write(temporary, mesh, file_format="vtu")
        # meshio reads field data from VTU files and does not write them.
        head, grid, rest = temporary.read_text("utf-8").partition("<UnstructuredGrid>")
        arrays = "".join(
            f'<DataArray type="Float64" Name={quoteattr(name)} NumberOfTuples="1" format="ascii">{value:.17g}</DataArray>'
            for name, value in values.items()
        )
        temporary.write_text(f"{head}{grid}<FieldData>{arrays}</FieldData>{rest}", encoding="utf-8")

    write_with(path, write)


def read_fields(path: Path) -> dict[str, np.ndarray]:
    """The fields on the points that `write_state` wrote."""
    return {name: np.concatenate(parts) for name, parts in meshio.read(path).cell_data.items()}


def read_cells(path: Path) -> tuple[CellMesh, np.ndarray]:
    """The cells that `write_state` wrote, and the displacements of their nodes, shape (k, d)."""
    mesh = meshio.read(path)
    d = next(dimension for (dimension, _), name in CELL_TYPES.items() if name == mesh.cells[0].type)
    return CellMesh(mesh.points[:, :d], tuple(block.data for block in mesh.cells)), mesh.point_data[DISPLACEMENT][:, :d].astype(float)


def read_index(path: Path) -> list[tuple[float, Path]]:
    """Times and files of the states that `write_index` wrote, in order."""
    entries = ElementTree.parse(path).iter("DataSet")
    return [(float(entry.get("timestep")), path.parent / entry.get("file")) for entry in entries]


def read_values(path: Path) -> dict[str, float]:
    """The single values that `write_state` wrote."""
    found = {}
    for _, element in ElementTree.iterparse(path):
        if element.tag == "FieldData":
            found = {array.get("Name"): float(array.text) for array in element}
            break
    return found


def write_index(path: Path, entries: list[tuple[float, str]]) -> None:
    """Write a PVD that lists VTU files with their times."""
    lines = [f'    <DataSet timestep="{time:.17g}" part="0" file={quoteattr(file)}/>' for time, file in entries]
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>\n'
    write_text(path, head + "\n".join(lines) + "\n  </Collection>\n</VTKFile>\n")
