"""Writing and reading of states as VTU files with a PVD index, for ParaView."""

from html import escape
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..body import CellMesh
from .files import replacing, write_text

CELL_TYPES = {(2, 3): "triangle", (2, 4): "quad", (3, 4): "tetra", (3, 8): "hexahedron"}
"""Names of the types of cells in meshio, by dimension and number of corners; others are polygons
in the plane.
"""

DISPLACEMENT = "displacement"
EXACT = ("position", DISPLACEMENT, "volume")
"""Fields that are written in double precision: all others follow from them, and are written in
single.
"""

NUMBER = "number"
"""Field of a piece with the numbers of its points in the whole body."""


def write_state(
    path: Path,
    cells: CellMesh,
    nodes: np.ndarray,
    fields: dict[str, np.ndarray],
    values: dict[str, float],
) -> None:
    """Write a VTU file of one state: fields on the cells of a body, and single values as field
    data.

    The cells are at their reference positions; warp by the ``displacement`` of the nodes to see the
    deformed body.

    Parameters
    ----------
    path : Path
    cells : CellMesh
        Cells in the order of the points of the body.
    nodes : ndarray, shape (k, d)
        Displacements of the nodes of the cells.
    fields : dict of ndarray, each of shape (n,) or (n, components)
        Fields on the points.
    values : dict of float
        Single values by name, such as the time.
    """
    import meshio

    flat = ((0, 0), (0, 3 - cells.dimension))
    ends = np.cumsum([len(block) for block in cells.blocks])[:-1]
    data = {name: np.split(field.astype(_kind(name)), ends) for name, field in fields.items()}
    blocks = [
        (
            CELL_TYPES.get((cells.dimension, block.shape[1]), "polygon"),
            block.astype(np.int32, copy=False),
        )
        for block in cells.blocks
    ]
    moved = {DISPLACEMENT: np.pad(nodes, flat).astype(np.float32)}
    mesh = meshio.Mesh(np.pad(cells.nodes, flat), blocks, point_data=moved, cell_data=data)
    with replacing(path) as temporary:
        meshio.write(temporary, mesh, file_format="vtu")
        # meshio reads field data from VTU files but does not write them.
        head, grid, rest = temporary.read_text("utf-8").partition("<UnstructuredGrid>")
        arrays = "".join(
            f'<DataArray type="Float64" Name="{escape(name)}" NumberOfTuples="1"'
            f' format="ascii">{value:.17g}</DataArray>'
            for name, value in values.items()
        )
        temporary.write_text(f"{head}{grid}<FieldData>{arrays}</FieldData>{rest}", encoding="utf-8")


def _kind(name: str) -> type:
    return np.float64 if name in EXACT else np.int64 if name == NUMBER else np.float32


def write_pieces(path: Path, pieces: list[str], fields: dict[str, int]) -> None:
    """Write a PVTU file that joins the pieces of one state, each of which `write_state` wrote on
    one rank.

    Parameters
    ----------
    path : Path
    pieces : list of str
        Names of the files of the pieces, in the same folder.
    fields : dict of int
        Number of components of each field on the cells.
    """

    def array(name: str, kind: type, components: int) -> str:
        type_in_vtk = np.dtype(kind).name.capitalize()
        return (
            f'<PDataArray type="{type_in_vtk}" Name="{escape(name)}"'
            f' NumberOfComponents="{components}"/>'
        )

    on_cells = "".join(array(name, _kind(name), components) for name, components in fields.items())
    points = (
        f"<PPoints>{array('Points', np.float64, 3)}</PPoints>",
        f"<PPointData>{array(DISPLACEMENT, np.float32, 3)}</PPointData>",
    )
    listed = (f'<Piece Source="{escape(piece)}"/>' for piece in pieces)
    _write_listing(
        path,
        "PUnstructuredGrid",
        ' GhostLevel="0"',
        [*points, f"<PCellData>{on_cells}</PCellData>", *listed],
    )


def write_index(path: Path, entries: list[tuple[float, str]]) -> None:
    """Write a PVD index file, which lists states: `entries` are the time and the file name of
    each.
    """
    lines = [
        f'<DataSet timestep="{time:.17g}" part="0" file="{escape(file)}"/>'
        for time, file in entries
    ]
    _write_listing(path, "Collection", "", lines)


def _write_listing(path: Path, kind: str, attributes: str, lines: list[str]) -> None:
    """Write an XML file of VTK that lists other files: one element of a given `kind` and
    `attributes`, with `lines` as its content.
    """
    head = f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="0.1" byte_order="LittleEndian">'
    inner = "\n".join(f"    {line}" for line in lines)
    write_text(path, f"{head}\n  <{kind}{attributes}>\n{inner}\n  </{kind}>\n</VTKFile>\n")


def pieces_of(path: Path) -> list[Path]:
    """Return the files of the pieces of a state: the files that a PVTU file lists, or the VTU
    file itself.
    """
    if path.suffix != ".pvtu":
        return [path]
    return [path.parent / piece.get("Source") for piece in ElementTree.parse(path).iter("Piece")]


def read_state(path: Path) -> tuple[CellMesh, np.ndarray, dict[str, np.ndarray]]:
    """Return the cells, the displacements of their nodes, shape (k, d), and the fields of a state
    that `write_state` wrote.

    Cells are in the order of the points of the body. Pieces are joined; nodes between two pieces
    occur twice.
    """
    import meshio

    pieces = [meshio.read(piece) for piece in pieces_of(path)]
    kinds = [block.type for block in pieces[0].cells]
    d = next((dimension for (dimension, _), name in CELL_TYPES.items() if name == kinds[0]), 2)
    begins = np.cumsum([0, *(len(piece.points) for piece in pieces[:-1])])
    blocks = [
        np.concatenate(
            [piece.cells[k].data + begin for piece, begin in zip(pieces, begins, strict=True)]
        )
        for k in range(len(kinds))
    ]
    fields = {
        name: np.concatenate([part for piece in pieces for part in piece.cell_data[name]])
        for name in pieces[0].cell_data
    }
    if NUMBER in fields:  # of pieces, whose cells are those of a lattice, in one block
        order = np.argsort(fields.pop(NUMBER))
        blocks = [blocks[0][order]]
        fields = {name: values[order] for name, values in fields.items()}
    nodes, moved = (
        np.concatenate(parts)[:, :d]
        for parts in zip(*((p.points, p.point_data[DISPLACEMENT]) for p in pieces), strict=True)
    )
    return CellMesh(nodes, tuple(blocks)), moved.astype(float), fields


def read_index(path: Path) -> list[Path]:
    """Return the file of every state that a PVD index file lists, in order."""
    return [path.parent / entry.get("file") for entry in ElementTree.parse(path).iter("DataSet")]


def read_values(path: Path) -> dict[str, float]:
    """Return the single values, such as the time, by name from a state's file that `write_state`
    wrote, without reading its fields.
    """
    for _, element in ElementTree.iterparse(pieces_of(path)[0]):
        if element.tag == "FieldData":
            return {array.get("Name"): float(array.text) for array in element}
    return {}
