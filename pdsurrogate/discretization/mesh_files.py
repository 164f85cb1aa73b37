"""Contents of mesh files, as gmsh, Abaqus and CAD programs write them: cells and groups."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from ..body import CellMesh
from ..body.cell_mesh import FACES, among, side_numbers
from .chains import ROUNDING, same_places

CELL_TYPES = {2: ("triangle", "quad"), 3: ("tetra", "hexahedron")}
"""Accepted types of cells by dimension, by their names in meshio; names of quadratic cells end
with their number of nodes.
"""

EDGES = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": (
        (0, 1),
        (1, 2),
        (2, 3),
        (3, 0),
        (4, 5),
        (5, 6),
        (6, 7),
        (7, 4),
        (0, 4),
        (1, 5),
        (2, 6),
        (3, 7),
    ),
}
"""Edges of a cell by the numbers of their corners, in the order in which the middles of edges
follow the corners in a quadratic cell.
"""

QUADRATIC = ("triangle6", "triangle7", "quad8", "quad9", "tetra10", "hexahedron20", "hexahedron27")
"""Quadratic cells by their names in meshio, which become cells with the same corners and
straight edges.
"""

CURVED = 1e-3
"""Distance of the middle of an edge from the line between its ends, in lengths of the edge, above
which a warning tells that the edge is curved. Chosen: a straight edge then changes the area of a
cell by less than a thousandth.
"""

FLAT = 1e-3
"""Greatest inclination of the cells of a flat mesh, and greatest extent across its plane divided by
that along it. Chosen: flattening changes lengths by the square of the inclination, a millionth; the
noise of CAD programs across a plane is far less.
"""

BESIDE_CELLS = {2: ("vertex", "line"), 3: ("vertex", "line", "triangle", "quad")}
"""First letters of meshio's names of points, edges and faces, which a mesh may list in addition
to its cells.
"""

BESIDE_CORNERS = {
    4: [[1, 2, 3]],
    8: [[1, 3, 4], [2, 0, 5], [3, 1, 6], [0, 2, 7], [7, 5, 0], [4, 6, 1], [5, 7, 2], [6, 4, 3]],
}
"""Corners to which the three edges at each corner of a solid cell lead, in right-handed order, by
the cell's number of corners.

For tetrahedra only corner 0 is listed: the edges at every corner span the same volume, whose sign
tells whether the cell is inverted.
"""


@dataclass(frozen=True)
class MeshFile:
    """Contents of a mesh file.

    Attributes
    ----------
    cells : CellMesh
        Triangles and quadrilaterals, counter-clockwise, or tetrahedra and hexahedra; nodes at one
        place are one.
    cell_groups : mapping of str to ndarray of int
        Numbers of the cells in each physical group of cells.
    side_groups : mapping of str to ndarray of int, shape (l, 2) or (l, 4)
        Nodes of the lines (in three dimensions faces) in each physical group of lines (faces); a
        triangle repeats its last node.
    """

    cells: CellMesh
    cell_groups: Mapping[str, np.ndarray]
    side_groups: Mapping[str, np.ndarray]

    def corners(self) -> list[np.ndarray]:
        """Return the positions of the corners of the cells, an array of shape (n, corners, d)
        for every block of `cells`.
        """
        return [self.cells.nodes[block] for block in self.cells.blocks]

    @cached_property
    def centroids(self) -> tuple[np.ndarray, np.ndarray]:
        """Centroids (n, d) and volumes (n,) of all cells."""
        points, volumes = zip(*map(centroids, self.corners()), strict=True)
        return np.concatenate(points), np.concatenate(volumes)

    def groups_of_cells(self) -> dict[str, np.ndarray]:
        """Return the numbers of the cells in every physical group; a group of lines or faces
        contains the cells that have them as sides.
        """
        corners, owners = self.cells.sides() if self.side_groups else ((), ())
        return dict(self.cell_groups) | {
            name: np.unique(owners[among(corners, members)])
            for name, members in self.side_groups.items()
        }


@lru_cache(maxsize=1)
def read_mesh(file: str, dimension: int, _changed: int, _size: int) -> MeshFile:
    """Return the contents of a mesh file, read again if its time of change or size are others; for
    the errors see `mesh_of`.
    """
    import meshio

    printed = io.StringIO()
    try:
        with redirect_stdout(printed), redirect_stderr(printed):
            read = meshio.read(file)
    except (
        Exception,
        SystemExit,
        # meshio's readers raise errors of any type, and print and exit if none accepts the file
    ) as error:
        reason = printed.getvalue() if isinstance(error, SystemExit) else error
        raise ValueError(
            f"body.file: meshio cannot read {file}: {' '.join(str(reason).split())}"
        ) from None
    points = np.asarray(read.points, dtype=float)
    if not np.isfinite(points).all():
        raise ValueError(
            f"body.file: node {np.argwhere(~np.isfinite(points))[0, 0]} of {file} has a position"
            " that is not finite"
        )
    # Points, edges and faces are those of boundaries and may be skipped; skipping cells of other
    # types would leave holes.
    kinds = {_kind(block.type) for block in read.cells if len(block.data)}
    refused = sorted(
        kind
        for kind in kinds - set(CELL_TYPES[dimension])
        if not kind.startswith(BESIDE_CELLS[dimension])
    )
    if refused:
        advice = (
            "; set dimension = 3 for a solid"
            if dimension == 2 and kinds & set(CELL_TYPES[3])
            else ""
        )
        raise ValueError(
            f"body.file: {file} has {', '.join(refused)} cells; use only"
            f" {' and '.join(CELL_TYPES[dimension])}{advice}"
        )
    cells = []
    for block in read.cells:
        kind = _kind(block.type)
        if kind in CELL_TYPES[dimension]:
            count = max(map(max, EDGES[kind])) + 1
            cells.append(block.data[:, :count])
            if block.type != kind:
                _warn_of_curves(
                    file,
                    points[cells[-1][:, np.array(EDGES[kind])]],
                    points[block.data[:, count : count + len(EDGES[kind])]],
                )
    if not any(map(len, cells)):
        words, flat = (
            ("triangles or quadrilaterals", False)
            if dimension == 2
            else ("tetrahedra or hexahedra", kinds & set(CELL_TYPES[2]))
        )
        raise ValueError(
            f"body.file: {file} has no {words}"
            + ("; set dimension = 2 for a sheet" if flat else "")
        )
    if dimension == 3:
        for block in cells:
            _check_solid_cells(file, points[block])
    elif points.shape[1] == 3:
        points = _flattened(file, points, cells)
    # Nodes at one place are one: scenes state cracks as precuts, and bonds need no common nodes.
    number = same_places(points, ROUNDING * np.ptp(points, axis=0).max())
    if dimension == 2:
        clockwise = [volumes_of(points[block]).sum(axis=1) < 0 for block in cells]
        cells = [
            np.where(turned[:, None], block[:, ::-1], block)
            for turned, block in zip(clockwise, cells, strict=True)
        ]
    cell_groups, side_groups = _groups(file, read, dimension)
    return MeshFile(
        *_each_once(CellMesh(points, tuple(number[block] for block in cells)), cell_groups),
        {name: number[lines] for name, lines in side_groups.items()},
    )


def _kind(name: str) -> str:
    """Return the type of linear cell that has the corners of cells of the type `name`; a type
    that is not read remains as it is.
    """
    return name.rstrip("0123456789") if name in QUADRATIC else name


def _warn_of_curves(file: str, ends: np.ndarray, middles: np.ndarray) -> None:
    """Warn of edges with `ends` (n, edges, 2, d) that are curved, by the places of their
    `middles` (n, edges, d); see `CURVED`.
    """
    along = ends[:, :, 1] - ends[:, :, 0]
    off = middles - ends[:, :, 0]
    squares = np.einsum("nec,nec->ne", along, along)
    off = (
        off
        - (np.einsum("nec,nec->ne", off, along) / np.maximum(squares, 1e-300))[..., None] * along
    )
    greatest = float(
        np.sqrt(np.einsum("nec,nec->ne", off, off) / np.maximum(squares, 1e-300)).max(initial=0.0)
    )
    if greatest > CURVED:
        what = f"{file} has curved edges, by up to {100 * greatest:.2g} % of their length"
        warnings.warn(
            f"body.file: {what}: they become straight lines between corners; a finer mesh follows"
            " the curve",
            stacklevel=7,
        )


def _flattened(file: str, points: np.ndarray, cells: list[np.ndarray]) -> np.ndarray:
    """Return the places (k, 2) of points (k, 3) in the coordinate plane in which flat `cells`
    lie, the lower of its two axes first.
    """
    corners = [points[block] for block in cells]
    # A triangle by two sides, a quadrilateral by its diagonals.
    areas = np.concatenate(
        [
            np.cross(each[:, -2] - each[:, 0], each[:, -1] - each[:, each.shape[1] - 3])
            for each in corners
        ]
    )
    across = int(np.abs(areas).sum(axis=0).argmax())
    extents = np.ptp(np.concatenate([block.reshape(-1, 3) for block in corners]), axis=0)
    inclined = np.linalg.norm(np.delete(areas, across, axis=1), axis=1) > FLAT * np.abs(
        areas[:, across]
    )
    if inclined.any() or extents[across] > FLAT * extents.max():
        raise ValueError(
            f"body.file: {file} is not flat, or not parallel to two axes: turn it into the plane of"
            " x1 and x2"
        )
    return np.delete(points, across, axis=1)


def _each_once(
    mesh: CellMesh, groups: Mapping[str, np.ndarray]
) -> tuple[CellMesh, dict[str, np.ndarray]]:
    """Return a mesh, and groups of numbers of its cells, with cells of equal corners as one.

    meshio lists a cell of two physical groups of gmsh's version 2 twice.
    """
    width = max(block.shape[1] for block in mesh.blocks)
    corners = [
        np.pad(block, ((0, 0), (0, width - block.shape[1])), mode="edge") for block in mesh.blocks
    ]
    _, first, which = np.unique(
        side_numbers(np.concatenate(corners)), return_index=True, return_inverse=True
    )
    kept = np.isin(np.arange(len(mesh)), first)
    number = (np.cumsum(kept) - 1)[first[which]]
    return CellMesh.of_mesh(mesh.nodes, mesh.blocks, kept), {
        name: np.unique(number[members]) for name, members in groups.items()
    }


def _check_solid_cells(file: str, cells: np.ndarray) -> None:
    """Raise ValueError if a cell of `cells` (n, corners, 3) is inverted or flat, or if it is a
    hexahedron not convex at a corner.
    """
    kind = CELL_TYPES[3][cells.shape[1] == 8]
    edges = (
        cells[:, BESIDE_CORNERS[cells.shape[1]]]
        - cells[:, : len(BESIDE_CORNERS[cells.shape[1]]), None]
    )
    turns = np.linalg.det(edges)  # volume that the three edges at each corner span
    wrong = np.flatnonzero(
        ~(turns > 1e-12 * np.linalg.norm(edges, axis=-1).max(axis=-1) ** 3).all(axis=1)
    )
    if len(wrong):
        number = wrong[0]
        what = (
            "inverted: its volume is negative"
            if (turns[number] < 0).all()
            else "flat, or folded at a corner"
        )
        raise ValueError(
            f"body.file: {file} has {len(wrong)} invalid cells; {kind} {number} (counted from 0) is"
            f" {what}"
        )


def _element_sets(file: str, read) -> dict[str, list[np.ndarray]]:
    """Return the element sets of an Abaqus or CalculiX deck as meshio stores sets, for each of its
    blocks the numbers of the members.

    meshio itself loses members of sets that several blocks of lines give, or that name other sets.
    Raise ValueError if two elements have one number, as those of several parts may.
    """
    sets: dict[str, list[int]] = {}
    names: dict[str, str] = {}
    labels = []
    for keyword, options, rows in _keywords(Path(file)):
        entries = [entry for row in rows for entry in row.replace(" ", "").split(",") if entry]
        members = []
        if keyword == "ELEMENT":
            members = [
                int(entry) for entry in entries[:: read.cells[len(labels)].data.shape[-1] + 1]
            ]
            labels.append(members)
        elif keyword == "ELSET" and "GENERATE" in options:
            for row in rows:
                begin, end, *step = (int(entry) for entry in row.split(",") if entry.strip())
                members += range(begin, end + 1, *step)
        elif keyword == "ELSET":
            members = [
                label
                for entry in entries
                for label in ([int(entry)] if entry.isdigit() else sets.get(entry.upper(), ()))
            ]
        if name := options.get("ELSET"):
            sets.setdefault(name.upper(), []).extend(members)
            names.setdefault(name.upper(), name)
    if sets and len(np.unique(np.concatenate(labels))) != sum(map(len, labels)):
        raise ValueError(
            f"body.file: two elements of {file} have one number, so that its sets are ambiguous;"
            " write the deck as one part"
        )
    return {
        names[name]: [np.flatnonzero(np.isin(block, members)) for block in labels]
        for name, members in sets.items()
    }


def _keywords(path: Path) -> Iterator[tuple[str, dict[str, str], list[str]]]:
    """Yield the keywords of a deck with their options and lines of data, those of included files
    in their place.
    """
    keyword = ""
    options = {}
    rows = []
    for line in [*path.read_text(errors="replace").splitlines(), "*"]:
        if line.startswith("**"):
            continue
        if not line.startswith("*"):
            rows.append(line)
            continue
        if keyword == "INCLUDE":
            inner = Path(options["INPUT"])
            # as meshio looks for it
            yield from _keywords(inner if inner.exists() else path.parent / inner)
        elif keyword:
            yield keyword, options, rows
        head, *given = (part.strip() for part in line[1:].split(","))
        pairs = (part.partition("=") for part in given)
        keyword = head.upper()
        options = {key.strip().upper(): value.strip() for key, _, value in pairs}
        rows = []


def _groups(file: str, read, dimension: int) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the physical groups of cells and of sides from what meshio has read: `cell_groups` and
    `side_groups` of `MeshFile`.

    meshio stores groups as sets of cells, block by block; for gmsh files of version 2 it stores a
    group number for each cell, and names of the numbers.
    """
    sets = _element_sets(file, read) if file.lower().endswith(".inp") else read.cell_sets
    members: dict[str, list] = {
        name: given for name, given in sets.items() if not name.startswith("gmsh:")
    }
    numbers = read.cell_data.get("gmsh:physical")
    if numbers is not None:
        named = {name: entry for name, entry in read.field_data.items() if np.size(entry) == 2}
        for name, (number, of_dimension) in named.items():
            fitting = [block.dim == of_dimension for block in read.cells]
            members.setdefault(
                name,
                [
                    np.flatnonzero(of_block == number) if fits else []
                    for of_block, fits in zip(numbers, fitting, strict=True)
                ],
            )
    cell_groups = {}
    side_groups = {}
    for name, sets in members.items():
        cells = []
        sides = []
        begin = 0
        for block, chosen in zip(read.cells, sets, strict=True):
            chosen = np.asarray(() if chosen is None else chosen, dtype=int)
            if _kind(block.type) in CELL_TYPES[dimension]:
                cells.append(begin + chosen)
                begin += len(block.data)
            elif dimension == 2 and block.type.startswith("line"):
                sides.append(block.data[chosen][:, :2])
            elif dimension == 3 and block.type.startswith("triangle"):
                sides.append(block.data[chosen][:, [0, 1, 2, 2]])
            elif dimension == 3 and block.type.startswith("quad"):
                sides.append(block.data[chosen][:, :4])
        if any(map(len, cells)):
            cell_groups[name] = np.concatenate(cells)
        elif any(map(len, sides)):
            side_groups[name] = np.concatenate(sides)
    return cell_groups, side_groups


def simplices_of(cells: np.ndarray) -> np.ndarray:
    """Divide cells (n, corners, d) into triangles or tetrahedra; return their corners, shape (n,
    parts, d + 1, d).

    A face of a hexahedron need not be flat: it is divided into four triangles about the mean of its
    corners, alike for both its cells.
    """
    if cells.shape[1] == cells.shape[2] + 1:
        return cells[:, None]
    if cells.shape[2] == 2:
        return cells[:, [[0, 1, 2], [0, 2, 3]]]
    faces = cells[:, np.array(FACES[3, 8])]
    middles = np.broadcast_to(faces.mean(axis=2, keepdims=True), faces.shape)
    tops = np.broadcast_to(cells.mean(axis=1)[:, None, None], faces.shape)
    # Faces run counter-clockwise as seen from outside: with the middle of the cell first, volumes
    # are positive.
    return np.stack([tops, faces, np.roll(faces, -1, axis=2), middles], axis=3).reshape(
        len(cells), -1, 4, 3
    )


def volumes_of(cells: np.ndarray) -> np.ndarray:
    """Return the signed volumes (n, parts) of the simplices (`simplices_of`) of cells; in the
    plane areas, negative where clockwise.
    """
    parts = simplices_of(cells)
    return np.linalg.det(parts[:, :, 1:] - parts[:, :, :1]) / math.factorial(cells.shape[2])


def centroids(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return centroids (n, d) and volumes (n,) of cells of one type, given by positions of their
    corners, shape (n, corners, d).

    Raise ValueError for a cell without volume, or a quadrilateral whose sides cross.
    """
    volumes = volumes_of(cells)
    volume = volumes.sum(axis=1)
    if (volume == 0).any():
        raise ValueError("body.file: the area of a cell is zero")
    # The sides of a quadrilateral cross if either diagonal cuts it into triangles of opposite
    # senses.
    if (
        cells.shape[1:] == (4, 2)
        and (
            (volumes.prod(axis=1) < 0) & (volumes_of(np.roll(cells, 1, axis=1)).prod(axis=1) < 0)
        ).any()
    ):
        raise ValueError(
            "body.file: the sides of a quadrilateral cross each other; its corners must be in order"
            " around it"
        )
    return (volumes[..., None] * simplices_of(cells).mean(axis=2)).sum(axis=1) / volume[
        :, None
    ], np.abs(volume)
