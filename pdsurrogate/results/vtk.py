"""Writing and reading of states as VTU files with a PVD index, for ParaView."""

import zlib
from base64 import b64decode, b64encode
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from html import escape
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import TextIO
from xml.etree import ElementTree

import numpy as np

from ..body import CellMesh
from .files import replacing, write_text

CELL_TYPES = {(2, 3): "triangle", (2, 4): "quad", (3, 4): "tetra", (3, 8): "hexahedron"}
"""Names of the types of cells by dimension and number of corners; others are polygons in the
plane.
"""

CODES = {"triangle": 5, "polygon": 7, "quad": 9, "tetra": 10, "hexahedron": 12}
"""Numbers of the types of cells in VTK."""

BLOCK = 2**15
"""Bytes of an array that are compressed together, as VTK does."""

ROWS = 2**16
"""Rows of an array that are converted to the numbers of a file together."""

LEVEL = 1
"""Level of the compression. Chosen: smooth fields take 2 % more than with the usual 6, in a fifth
of the time.
"""

DISPLACEMENT = "displacement"
EXACT = ("position", DISPLACEMENT, "volume")
"""Fields that are written in double precision: all others follow from them, and are written in
single.
"""

NUMBER = "number"
"""Field of a piece with the numbers of its points in the whole body."""


class Packed:
    """Numbers of an array in a VTU file, compressed part by part as they come.

    Parameters
    ----------
    kind : dtype
        Kind of the numbers in the file.
    *parts : ndarray
        See `add`.
    columns : int
        Least number of columns, zero where the parts have none.
    """

    def __init__(self, kind, *parts: np.ndarray, columns: int = 0) -> None:
        self.columns = columns
        self.kind = np.dtype(kind).newbyteorder("<")  # as the files state
        self.components = 1
        self._blocks: list[bytes] = []
        self._rest = np.empty(0, dtype=np.uint8)
        for part in parts:
            self.add(part)

    def add(self, values: np.ndarray) -> None:
        """Add the next rows."""
        for rows in np.split(values, range(ROWS, len(values), ROWS)):
            if missing := max(0, self.columns - rows[0:1].size):
                rows = np.pad(rows, ((0, 0), (0, missing)))
            self.components = int(np.prod(rows.shape[1:]))
            numbers = np.ascontiguousarray(rows, self.kind).reshape(-1).view(np.uint8)
            rest = np.append(self._rest, numbers)
            whole = len(rest) // BLOCK * BLOCK
            self._blocks += [
                zlib.compress(rest[i : i + BLOCK], LEVEL) for i in range(0, whole, BLOCK)
            ]
            self._rest = rest[whole:].copy()

    def write(self, file: TextIO, name: str) -> None:
        """Write the array to a VTU file, after the last part."""
        left = len(self._rest)
        self._blocks += [zlib.compress(self._rest, LEVEL)] if left else []
        sizes = [len(block) for block in self._blocks]
        head = np.array([len(sizes), BLOCK, left, *sizes], "<u4")
        kind = self.kind.name.capitalize().replace("Ui", "UI")
        many = f' NumberOfComponents="{self.components}"' if self.components > 1 else ""
        file.write(f'<DataArray type="{kind}" Name="{escape(name)}"{many} format="binary">')
        for part in (head.tobytes(), b"".join(self._blocks)):
            file.write(b64encode(part).decode("ascii"))
        file.write("</DataArray>")


def pack(parts: Iterable[dict[str, np.ndarray]]) -> dict[str, Packed]:
    """Return fields, which come as parts of the points of a body, as `write_state` takes them."""
    packed: dict[str, Packed] = {}
    for fields in parts:
        for name, values in fields.items():
            packed.setdefault(name, Packed(_kind(name))).add(values)
    return packed


def write_state(
    path: Path,
    cells: CellMesh,
    nodes: np.ndarray,
    fields: dict[str, Packed],
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
    fields : dict of Packed
        Fields on the points.
    values : dict of float
        Single values by name, such as the time.
    """
    counts = [len(block) for block in cells.blocks]
    corners = [block.shape[1] for block in cells.blocks]
    types = [CODES[CELL_TYPES.get((cells.dimension, many), "polygon")] for many in corners]
    of_cells = {
        "connectivity": Packed("i4", *(block.ravel() for block in cells.blocks)),
        "offsets": Packed("i8", np.repeat(corners, counts).cumsum()),
        "types": Packed("u1", np.repeat(types, counts)),
    }
    parts = {
        "Points": {"Points": Packed("f8", cells.nodes, columns=3)},
        "Cells": of_cells,
        "PointData": {DISPLACEMENT: Packed("f4", nodes, columns=3)},
        "CellData": fields,
    }
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(
            '<?xml version="1.0"?><VTKFile type="UnstructuredGrid" version="0.1"'
            ' byte_order="LittleEndian" header_type="UInt32" compressor="vtkZLibDataCompressor">'
            "<UnstructuredGrid><FieldData>"
        )
        for name, value in values.items():
            file.write(
                f'<DataArray type="Float64" Name="{escape(name)}" NumberOfTuples="1"'
                f' format="ascii">{value:.17g}</DataArray>'
            )
        file.write(
            f'</FieldData><Piece NumberOfPoints="{len(nodes)}" NumberOfCells="{len(cells)}">'
        )
        for element, arrays in parts.items():
            file.write(f"<{element}>")
            for name, packed in arrays.items():
                packed.write(file, name)
            file.write(f"</{element}>")
        file.write("</Piece></UnstructuredGrid></VTKFile>")


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
    inner = "\n".join(f"    {line}" for line in lines)
    write_text(
        path,
        f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="0.1" byte_order="LittleEndian">\n'
        f"  <{kind}{attributes}>\n{inner}\n  </{kind}>\n</VTKFile>\n",
    )


def pieces_of(path: Path) -> list[Path]:
    """Return the files of the pieces of a state: the files that a PVTU file lists, or the VTU
    file itself.
    """
    if path.suffix != ".pvtu":
        return [path]
    return [path.parent / piece.get("Source") for piece in ElementTree.parse(path).iter("Piece")]


class Arrays(Mapping):
    """Arrays of one element of a VTU file by name, such as the fields of its cells, read when they
    are asked for.

    Parameters
    ----------
    path : Path
    element : str
        Name of the element, such as "CellData".
    """

    def __init__(self, path: Path, element: str) -> None:
        self._path = path
        self._places: dict[str, tuple[int, int, dict[str, str]]] = {}
        with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as text:
            begin = text.find(f"<{element}>".encode())
            end = text.find(f"</{element}>".encode())
            while (begin := text.find(b"<DataArray", begin, end)) >= 0:
                start = text.find(b">", begin) + 1
                head = ElementTree.fromstring(text[begin : start - 1] + b"/>").attrib
                begin = text.find(b"<", start)
                self._places[head["Name"]] = start, begin, head

    def __getitem__(self, name: str) -> np.ndarray:
        start, end, head = self._places[name]
        with self._path.open("rb") as file:
            file.seek(start)
            text = file.read(end - start).strip()
        count, _, _ = np.frombuffer(b64decode(text[:16]), "<u4")
        after = 4 * -(-4 * (3 + int(count)) // 3)
        sizes = np.frombuffer(b64decode(text[:after]), "<u4")[3:]
        data = memoryview(b64decode(text[after:]))
        ends = np.cumsum(sizes, dtype=np.int64)
        blocks = (zlib.decompress(data[b - n : b]) for b, n in zip(ends, sizes, strict=True))
        kind = np.dtype(head["type"].lower()).newbyteorder("<")
        values = np.frombuffer(b"".join(blocks), kind).astype(kind.newbyteorder("="), copy=False)
        many = int(head.get("NumberOfComponents", 1))
        return values if many == 1 else values.reshape(-1, many)

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


class StoredFields(Mapping):
    """Fields of a state by name, in the order of the points of the body, from its pieces; read
    when they are asked for.
    """

    def __init__(self, path: Path) -> None:
        self._pieces = [Arrays(piece, "CellData") for piece in pieces_of(path)]
        self.divided = NUMBER in self._pieces[0]
        self._last: tuple[str, np.ndarray] | None = None

    def __getitem__(self, name: str) -> np.ndarray:
        if self._last is None or self._last[0] != name:
            values = np.concatenate([piece[name] for piece in self._pieces])
            self._last = name, values[self.order] if self.divided else values
        return self._last[1]

    @cached_property
    def order(self) -> np.ndarray:
        """Order of the points of pieces, whose cells are those of a lattice, in one block."""
        return np.argsort(np.concatenate([piece[NUMBER] for piece in self._pieces]))

    def __iter__(self) -> Iterator[str]:
        return (name for name in self._pieces[0] if name != NUMBER)

    def __len__(self) -> int:
        return len(list(iter(self)))


def read_cells(path: Path) -> tuple[CellMesh, np.ndarray]:
    """Return the cells of a state that `write_state` wrote, in the order of the points of the
    body, and the displacements of their nodes, shape (k, d).

    Pieces are joined; nodes between two pieces occur twice.
    """
    pieces = []
    begin = 0
    for piece in pieces_of(path):
        places = Arrays(piece, "Points")["Points"]
        lists = Arrays(piece, "Cells")
        sizes = np.diff(lists["offsets"], prepend=0)
        kinds = lists["types"]
        ends = np.flatnonzero((np.diff(sizes) != 0) | (np.diff(kinds) != 0)) + 1
        counts = sizes[np.append(0, ends)]
        parts = np.split(lists["connectivity"] + begin, lists["offsets"][ends - 1])
        blocks = [part.reshape(-1, many) for part, many in zip(parts, counts, strict=True)]
        d = 3 if kinds[0] in (CODES["tetra"], CODES["hexahedron"]) else 2
        begin += len(places)
        pieces.append((places[:, :d], Arrays(piece, "PointData")[DISPLACEMENT][:, :d], blocks))
    nodes, moved, blocks = (list(parts) for parts in zip(*pieces, strict=True))
    joined = [np.concatenate(parts) for parts in zip(*blocks, strict=True)]
    fields = StoredFields(path)
    if fields.divided:
        joined = [joined[0][fields.order]]
    return CellMesh(np.concatenate(nodes), tuple(joined)), np.concatenate(moved).astype(float)


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
