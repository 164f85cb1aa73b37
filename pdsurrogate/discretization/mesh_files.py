"""Mesh files as gmsh, Abaqus and CAD programs write them, read and checked."""

from __future__ import annotations

import io
import warnings
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..body import CellMesh
from ..body.cell_mesh import among, side_numbers
from ..decks import Deck, Elements, read_deck
from .chains import ROUNDING, same_places
from .gmsh_groups import check_names, signed_entities
from .mesh_cells import CELL_TYPES, EDGES, SHAPES, corners_of, kind_of, upright, volumes_of
from .mesh_groups import MeshFile, only, side_of, with_groups

BESIDE_CELLS = {2: ("vertex", "line"), 3: ("vertex", "line", "triangle", "quad")}
"""First letters of meshio's names of points, edges and faces, which a mesh may list in addition
to its cells.
"""


LISTING = ("CPS", "M3D9", "CAX", "R3D")
"""First letters of the types of elements by which gmsh (4.15.2) and meshio (5.3.5) list faces of
solids in decks.
"""

CURVED = 1e-3
"""Distance of the middle of an edge from the line between its ends, in lengths of the edge, above
which a warning tells that the edge is curved. Chosen: a straight edge then changes the area of a
cell by less than a thousandth.
"""

NEAR = 1e-3
"""Distance in lengths of the shortest edge of a cell below which nodes are one. Chosen: no cell
loses an edge, and parts that touch meet in spite of the noise of CAD programs.
"""

FLAT = 1e-3
"""Greatest inclination of the cells of a flat mesh, and greatest extent across its plane divided by
that along it. Chosen: flattening changes lengths by the square of the inclination, a millionth; the
noise of CAD programs across a plane is far less.
"""


def contents_of(file: str) -> Deck:
    """Return the contents of a mesh file; raise ValueError if it cannot be read."""
    try:
        contents = read_deck(file) if file.lower().endswith(".inp") else _of_meshio(file)
    except (ValueError, KeyError, IndexError) as error:
        raise ValueError(f"body.file: cannot read {file}: {error}") from None
    wrong = np.argwhere(~np.isfinite(contents.points))
    if len(wrong):
        raise ValueError(
            f"body.file: node {wrong[0, 0]} of {file} has a position that is not finite"
        )
    return contents


def _of_meshio(file: str) -> Deck:
    """Return the contents of a file that meshio reads, as those of a deck."""
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
        advice = (
            "; gmsh's version 4.1 is read without partitions, and without Mesh.SaveAll (Save all"
            " elements) if some elements are in no physical group"
            if file.lower().endswith(".msh")
            else ""
        )
        raise ValueError(f"meshio: {' '.join(str(reason).split())}{advice}") from None
    data = Path(file).read_bytes()
    contents = Deck([np.asarray(read.points, dtype=float)])
    groups = contents.sets.elements
    # Files of gmsh's version 2 have no sets, but a group of every cell, which they list once for
    # each of its groups.
    if "gmsh:physical" in read.cell_data:
        check_names(data)
        numbers = np.concatenate(read.cell_data["gmsh:physical"])
        dimensions = np.repeat(
            *zip(*((block.dim, len(block)) for block in read.cells), strict=True)
        )
        for name, entry in read.field_data.items():
            if np.size(entry) == 2:
                groups[name] = np.flatnonzero((numbers == entry[0]) & (dimensions == entry[1]))
    begins = np.cumsum([0, *(len(block.data) for block in read.cells)])
    for name, given in read.cell_sets.items():
        # gmsh:bounding_entities is no group: it has signed numbers of entities.
        if not name.startswith("gmsh:"):
            groups[name] = np.concatenate(
                [
                    begin + np.asarray(() if of is None else of, dtype=int)
                    for begin, of in zip(begins, given, strict=False)
                ]
            )
    numbered = {tuple(np.ravel(entry).tolist()): name for name, entry in read.field_data.items()}
    for dim, group, entity in signed_entities(data):
        if name := numbered.get((group, dim)):
            of_entity = [
                np.arange(begin, begin + len(block))
                for begin, block, tags in zip(
                    begins, read.cells, read.cell_data["gmsh:geometrical"], strict=False
                )
                if block.dim == dim and (tags == entity).all()
            ]
            groups[name] = np.union1d(groups[name], np.concatenate(of_entity))
    if "gmsh:physical" in read.cell_data:
        known = {0, *(group for group, *_ in numbered)}
        if unnamed := sorted({*np.abs(numbers).tolist()} - known):
            warnings.warn(
                f"body.file: {file}: physical groups without names are left out: "
                f'{", ".join(map(str, unnamed))}; in gmsh: Physical Curve("left", {unnamed[0]})',
                stacklevel=6,
            )
    contents.sets.names |= {name: name for name in groups}
    contents.elements += [
        Elements("", block.type, np.arange(begin, begin + len(block.data)), np.asarray(block.data))
        for begin, block in zip(begins, read.cells, strict=False)
    ]
    return contents


@lru_cache(maxsize=1)
def read_mesh(
    file: str, dimension: int, parts: tuple[str, ...] | None, _state: tuple[tuple[int, int], ...]
) -> MeshFile:
    """Return the contents of a mesh file as a body has them, read again if times of change or sizes
    of its files are others; for the errors see `mesh_of`.
    """
    return in_body(file, contents_of(file), dimension, parts)


def in_body(
    file: str, contents: Deck, dimension: int, parts: tuple[str, ...] | None = None
) -> MeshFile:
    """Return the contents of a mesh file as a body of a dimension has them, of some parts alone."""
    contents = only(file, contents, parts, BESIDE_CELLS[dimension])
    points = contents.points
    _check_kinds(file, contents, dimension)
    cells = []
    for _, name, _, data in contents.elements:
        kind = kind_of(name)
        if kind in CELL_TYPES[dimension]:
            count = corners_of(kind)
            cells.append(data[:, :count])
            if name != kind:
                _warn_of_curves(
                    file,
                    points[cells[-1][:, np.array(EDGES[kind])]],
                    points[data[:, count : count + len(EDGES[kind])]],
                )
    if dimension == 2 and points.shape[1] == 3:
        points = _flattened(file, points, cells)
    # Nodes at one place are one: scenes state cracks as precuts, and bonds need no common nodes.
    shortest = min(
        np.linalg.norm(np.diff(points[block[:, edges]], axis=2), axis=-1).min(initial=np.inf)
        for block in cells
        for edges in [np.array(EDGES[SHAPES[dimension, block.shape[1]]])]
    )
    of_node = same_places(points, max(ROUNDING * np.ptp(points, axis=0).max(), NEAR * shortest))
    cells, of_cell = _each_once(CellMesh(points, tuple(of_node[block] for block in cells)))
    mesh = with_groups(cells, contents, of_cell, of_node)
    _tell_of_others(file, contents, cells, of_node)
    return replace(mesh, cells=_righted(file, mesh.cells))


def kinds_of(contents: Deck) -> set[str]:
    """Return the types of linear cells that have the corners of the elements of a file."""
    return {kind_of(each.kind) for each in contents.elements if len(each.nodes) and each.kind}


def _check_kinds(file: str, contents: Deck, dimension: int) -> None:
    """Raise ValueError if a file has no cells of a dimension, or others that are not read."""
    # Points, edges and faces are those of boundaries and may be skipped; skipping cells of other
    # types would leave holes.
    kinds = kinds_of(contents)
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
    around = {each.type for each in contents.elements if each.type.startswith(("CAX", "R3D"))}
    if dimension == 2 and around:
        raise ValueError(
            f"body.file: {file} has {', '.join(sorted(around))} elements: axisymmetric bodies (CAX)"
            " and rigid ones (R3D) are not computed; mesh a sector of the solid (if meshio wrote"
            " the deck, which calls quadrilaterals CAX4P and triangles R3D3, name them CPS4, CPS3)"
        )
    if not kinds & set(CELL_TYPES[dimension]):
        words, flat = (
            ("triangles or quadrilaterals", False)
            if dimension == 2
            else ("tetrahedra or hexahedra", kinds & set(CELL_TYPES[2]))
        )
        raise ValueError(
            f"body.file: {file} has no {words}"
            + ("; set dimension = 2 for a sheet" if flat else "")
        )


def _tell_of_others(file: str, contents: Deck, mesh: CellMesh, of_node: np.ndarray) -> None:
    """Warn of elements of a deck that are left out: all but cells, and the elements by which gmsh
    lists sides of cells.
    """
    flat = mesh.dimension == 2
    others = [
        each
        for each in contents.elements
        if each.type and kind_of(each.kind) not in CELL_TYPES[mesh.dimension]
    ]
    told = Counter({each.type: 0 for each in others})
    for each in others:
        told[each.type] += len(each.numbers)
    listed = [each for each in others if each.type.startswith("T3D" if flat else LISTING)]
    if listed:
        sides = [of_node[side_of(contents.points, each)] for each in listed]
        types = np.repeat([each.type for each in listed], [len(each) for each in sides])
        told.subtract(types[among(np.concatenate(sides), mesh.sides()[0])].tolist())
    if +told:
        counts = ", ".join(f"{count} {name}" for name, count in (+told).items())
        warnings.warn(
            f"body.file: {file}: elements beside the cells are left out: {counts}", stacklevel=6
        )


def _righted(file: str, mesh: CellMesh) -> CellMesh:
    """Return a mesh whose cells all have positive volumes: those that are inverted get another
    order of corners, with a warning in three dimensions, or if others of the mesh are not.
    """
    blocks = []
    turned = 0
    for block in mesh.blocks:
        if mesh.dimension == 3:
            inverted, order = upright(file, mesh.nodes[block])
        else:
            inverted = volumes_of(mesh.nodes[block]).sum(axis=1) < 0
            order = np.arange(block.shape[1])[::-1]
        blocks.append(np.where(inverted[:, None], block[:, order], block))
        turned += int(inverted.sum())
    # A sheet seen from its back is clockwise in all cells.
    if turned and (mesh.dimension == 3 or turned < len(mesh)):
        warnings.warn(
            f"body.file: {turned} of {len(mesh)} cells of {file} were inverted (corners in the"
            " wrong order), and are turned",
            stacklevel=6,
        )
    return CellMesh(mesh.nodes, tuple(blocks))


def _each_once(mesh: CellMesh) -> tuple[CellMesh, np.ndarray]:
    """Return a mesh with cells of equal corners as one, and the new numbers of its cells.

    gmsh's version 2 lists a cell of two physical groups twice.
    """
    width = max(block.shape[1] for block in mesh.blocks)
    corners = [
        np.pad(block, ((0, 0), (0, width - block.shape[1])), mode="edge") for block in mesh.blocks
    ]
    _, first, which = np.unique(
        side_numbers(np.concatenate(corners)), return_index=True, return_inverse=True
    )
    kept = np.isin(np.arange(len(mesh)), first)
    return CellMesh.of_mesh(mesh.nodes, mesh.blocks, kept), (np.cumsum(kept) - 1)[first[which]]


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
            stacklevel=8,
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
