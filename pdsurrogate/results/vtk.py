"""VTU files with a PVD index, for ParaView."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np

from ..body import CellMesh
from .files import MARK, write_text, write_with

CELL_TYPES = {(2, 3): "triangle", (2, 4): "quad", (3, 4): "tetra", (3, 8): "hexahedron"}
"""Names of cells by the dimension and the number of their corners."""

DISPLACEMENT = "displacement"
EXACT = ("position", DISPLACEMENT)
"""The fields that are written in double precision: all others follow from them, and are written in single."""

NUMBER = "number"
"""Field of a piece: numbers of its points in the whole body."""

VTK_KINDS = {np.float64: "Float64", np.float32: "Float32", np.int64: "Int64"}


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
    data = {name: np.split(field.astype(_kind(name)), ends) for name, field in fields.items()}
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
        temporary.write_text(f"{head}<!--{MARK}-->{grid}<FieldData>{arrays}</FieldData>{rest}", encoding="utf-8")

    write_with(path, write)


def _kind(name: str) -> type:
    return np.float64 if name in EXACT else np.int64 if name == NUMBER else np.float32


def write_pieces(path: Path, pieces: list[str], fields: dict[str, int]) -> None:
    """Write a PVTU that lists pieces, each written by `write_state`.

    Parameters
    ----------
    path : Path
    pieces : list of str
        Names of their files, in the same folder.
    fields : dict of int
        Components of the fields on the cells, by name.
    """

    def array(name: str, kind: type, components: int) -> str:
        return f'<PDataArray type="{VTK_KINDS[kind]}" Name={quoteattr(name)} NumberOfComponents="{components}"/>'

    lines = [
        "    <PPoints>" + array("Points", np.float64, 3) + "</PPoints>",
        "    <PPointData>" + array(DISPLACEMENT, np.float32, 3) + "</PPointData>",
        "    <PCellData>" + "".join(array(name, _kind(name), components) for name, components in fields.items()) + "</PCellData>",
        *(f"    <Piece Source={quoteattr(piece)}/>" for piece in pieces),
    ]
    head = f'<?xml version="1.0"?>\n<!--{MARK}-->\n<VTKFile type="PUnstructuredGrid" version="0.1" byte_order="LittleEndian">\n'
    write_text(path, head + '  <PUnstructuredGrid GhostLevel="0">\n' + "\n".join(lines) + "\n  </PUnstructuredGrid>\n</VTKFile>\n")


def pieces_of(path: Path) -> list[Path]:
    """Files of the pieces of a state: those that a PVTU lists, or the file itself."""
    if path.suffix != ".pvtu":
        return [path]
    return [path.parent / piece.get("Source") for piece in ElementTree.parse(path).iter("Piece")]


def read_fields(path: Path) -> dict[str, np.ndarray]:
    """The fields on the points that `write_state` wrote, in the order of the body; of pieces all together."""
    pieces = [{name: np.concatenate(parts) for name, parts in meshio.read(piece).cell_data.items()} for piece in pieces_of(path)]
    fields = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    if NUMBER in fields:
        order = np.argsort(fields.pop(NUMBER))
        fields = {name: values[order] for name, values in fields.items()}
    return fields


def read_cells(path: Path) -> tuple[CellMesh, np.ndarray]:
    """The cells that `write_state` wrote, and the displacements of their nodes, shape (k, d); of pieces all together."""
    if path.suffix == ".pvtu":
        return _joined(pieces_of(path))
    mesh = meshio.read(path)
    d = next(dimension for (dimension, _), name in CELL_TYPES.items() if name == mesh.cells[0].type)
    return CellMesh(mesh.points[:, :d], tuple(block.data for block in mesh.cells)), mesh.point_data[DISPLACEMENT][:, :d].astype(float)


def _joined(paths: list[Path]) -> tuple[CellMesh, np.ndarray]:
    """Cells of pieces, of a lattice, in the order of the body; the nodes between two pieces are there twice."""
    pieces = [read_cells(path) for path in paths]
    numbers = np.concatenate([np.concatenate(meshio.read(path).cell_data[NUMBER]) for path in paths])
    begins = np.cumsum([0, *(len(cells.nodes) for cells, _ in pieces[:-1])])
    corners = np.concatenate([cells.blocks[0] + begin for (cells, _), begin in zip(pieces, begins, strict=True)])
    nodes, moved = np.concatenate([cells.nodes for cells, _ in pieces]), np.concatenate([moved for _, moved in pieces])
    return CellMesh(nodes, (corners[np.argsort(numbers)],)), moved


def read_index(path: Path) -> list[tuple[float, Path]]:
    """Times and files of the states that `write_index` wrote, in order."""
    entries = ElementTree.parse(path).iter("DataSet")
    return [(float(entry.get("timestep")), path.parent / entry.get("file")) for entry in entries]


def read_values(path: Path) -> dict[str, float]:
    """The single values that `write_state` wrote."""
    found = {}
    for _, element in ElementTree.iterparse(pieces_of(path)[0]):
        if element.tag == "FieldData":
            found = {array.get("Name"): float(array.text) for array in element}
            break
    return found


def write_index(path: Path, entries: list[tuple[float, str]]) -> None:
    """Write a PVD that lists VTU files with their times."""
    lines = [f'    <DataSet timestep="{time:.17g}" part="0" file={quoteattr(file)}/>' for time, file in entries]
    head = f'<?xml version="1.0"?>\n<!--{MARK}-->\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>\n'
    write_text(path, head + "\n".join(lines) + "\n  </Collection>\n</VTKFile>\n")
