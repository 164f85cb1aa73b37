"""Contents of mesh files, as gmsh, Abaqus and CAD programs write them: cells and groups."""

from __future__ import annotations

import io
import re
import warnings
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from ..body import CellMesh
from ..body.cell_mesh import FACES, among, side_numbers
from ..decks import Deck, Elements, read_deck
from .chains import ROUNDING, same_places
from .mesh_cells import centroids, upright, volumes_of

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


@dataclass(frozen=True)
class MeshFile:
    """Contents of a mesh file.

    Attributes
    ----------
    cells : CellMesh
        Triangles and quadrilaterals, counter-clockwise, or tetrahedra and hexahedra; nodes at one
        place are one.
    cell_groups : mapping of str to ndarray of int
        Numbers of the cells in each physical group or element set of cells, and each instance of
        a part.
    side_groups : mapping of str to ndarray of int, shape (l, 2) or (l, 4)
        Nodes of the lines (in three dimensions faces) in each physical group of lines (faces),
        surface, and set of nodes; a triangle repeats its last node.
    """

    cells: CellMesh
    cell_groups: dict[str, np.ndarray]
    side_groups: dict[str, np.ndarray]

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
        raise ValueError(f"meshio: {' '.join(str(reason).split())}") from None
    contents = Deck([np.asarray(read.points, dtype=float)])
    groups = contents.sets.elements
    # Files of gmsh's version 2 have no sets, but a group of every cell, which they list once for
    # each of its groups.
    numbers = read.cell_data.get("gmsh:physical")
    if numbers is not None:
        _check_names(file)
        for name, entry in read.field_data.items():
            if np.size(entry) == 2 and name not in read.cell_sets:
                groups[name] = np.flatnonzero(
                    np.concatenate(
                        [
                            (of == entry[0]) & (block.dim == entry[1])
                            for of, block in zip(numbers, read.cells, strict=True)
                        ]
                    )
                )
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
    contents.sets.names |= {name: name for name in groups}
    contents.elements += [
        Elements("", block.type, np.arange(begin, begin + len(block.data)), np.asarray(block.data))
        for begin, block in zip(begins, read.cells, strict=False)
    ]
    return contents


def _check_names(file: str) -> None:
    """Raise ValueError if two physical groups of a gmsh file have one name: meshio keeps one."""
    names = re.search(
        rb"\$PhysicalNames(.*?)\$EndPhysicalNames", Path(file).read_bytes(), flags=re.DOTALL
    )
    found = re.findall(rb'"(.*)"', names[1]) if names else []
    twice = [name.decode(errors="replace") for name, times in Counter(found).items() if times > 1]
    if twice:
        raise ValueError(f"two physical groups are named {twice[0]}; give each a name of its own")


@lru_cache(maxsize=1)
def read_mesh(
    file: str, dimension: int, parts: tuple[str, ...] | None, _state: tuple[tuple[int, int], ...]
) -> MeshFile:
    """Return the contents of a mesh file, read again if times of change or sizes of its files are
    others; for the errors see `mesh_of`.
    """
    contents = contents_of(file)
    points = contents.points
    _check_kinds(file, contents, dimension)
    cells = []
    for _, name, _, data in contents.elements:
        kind = _kind(name)
        if kind in CELL_TYPES[dimension]:
            count = _corners(kind)
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
    of_node = same_places(points, ROUNDING * np.ptp(points, axis=0).max())
    cells, of_cell = _each_once(CellMesh(points, tuple(of_node[block] for block in cells)))
    mesh = _with_groups(cells, contents, of_cell, of_node)
    _tell_of_others(file, contents, cells, of_node)
    mesh = _parts_of(file, mesh, tuple(contents.instances), parts)
    return replace(mesh, cells=_righted(file, mesh.cells))


def _corners(kind: str) -> int:
    """Return the number of corners of a linear cell."""
    return max(map(max, EDGES[kind])) + 1


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
    around = sorted({each.type for each in contents.elements if each.type.startswith("CAX")})
    if dimension == 2 and around:
        raise ValueError(
            f"body.file: {file} has {', '.join(around)} elements, and axisymmetric bodies are not"
            " computed: mesh a sector of the solid (if meshio wrote the deck, every quadrilateral"
            " is a CAX4P: name it CPS4)"
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
    told: Counter[str] = Counter()
    sides = None
    for each in contents.elements:
        if not each.type or _kind(each.kind) in CELL_TYPES[mesh.dimension]:
            continue
        told[each.type] += len(each.numbers)
        if each.type.startswith("T3D" if mesh.dimension == 2 else ("CPS", "M3D9")):
            sides = mesh.sides()[0] if sides is None else sides
            told[each.type] -= int(among(of_node[_side(contents.points, each)], sides).sum())
    if +told:
        counts = ", ".join(f"{count} {name}" for name, count in (+told).items())
        warnings.warn(
            f"body.file: {file}: elements beside the cells are left out: {counts}", stacklevel=5
        )


def _parts_of(
    file: str, mesh: MeshFile, instances: tuple[str, ...], parts: tuple[str, ...] | None
) -> MeshFile:
    """Return the mesh of those groups of cells alone that a scene names, by default of all cells;
    warn if a deck then has several instances of parts.
    """
    groups = mesh.cell_groups
    if parts is None:
        if len(instances) > 1:
            counts = ", ".join(f"{name} ({len(groups.get(name, ()))})" for name in instances)
            warnings.warn(
                f"body.file: the body has the cells of all parts of {file}: {counts}; parts ="
                f' ["{instances[0]}"] takes one, and parts that touch are bonded',
                stacklevel=5,
            )
        return mesh
    if missing := [name for name in parts if name not in groups]:
        raise ValueError(
            f"body.parts: {file} has no cells in a group {missing[0]!r}; it has"
            f" {', '.join(groups) or 'no groups of cells'}"
        )
    kept = np.zeros(len(mesh.cells), dtype=bool)
    kept[np.concatenate([groups[name] for name in parts])] = True
    number = np.cumsum(kept) - 1
    rest = {name: number[members[kept[members]]] for name, members in groups.items()}
    return MeshFile(
        CellMesh.of_mesh(mesh.cells.nodes, mesh.cells.blocks, kept),
        {name: members for name, members in rest.items() if len(members)},
        mesh.side_groups,
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
            stacklevel=5,
        )
    return CellMesh(mesh.nodes, tuple(blocks))


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


def _side(points: np.ndarray, elements: Elements) -> np.ndarray:
    """Return the corners of elements that are lines or faces, a triangle with its last twice."""
    nodes = elements.nodes
    if elements.kind != "line3":
        return nodes[:, {"l": [0, 1], "t": [0, 1, 2, 2], "q": [0, 1, 2, 3]}[elements.kind[0]]]
    # The ends are farthest apart: programs write the middle second or last.
    pairs = nodes[:, [[0, 1], [0, 2], [1, 2]]]
    lengths = np.linalg.norm(points[pairs[..., 1]] - points[pairs[..., 0]], axis=-1)
    return pairs[np.arange(len(nodes)), lengths.argmax(axis=1)]


def _with_groups(
    mesh: CellMesh, contents: Deck, of_cell: np.ndarray, of_node: np.ndarray
) -> MeshFile:
    """Return a mesh with the groups of its file, whose cells and nodes have the numbers `of_cell`
    and `of_node` in the mesh.

    Sets of one name and of different kinds are one if they have the same cells; else the kind
    follows each of their names.
    """
    sets = contents.sets
    files = {word: MeshFile(mesh, {}, {}) for word in ("ELSET", "SURFACE", "NSET")}
    for key, name in sets.names.items():
        cells = []
        sides = []
        faces = []
        begin = 0
        members = sets.elements.get(key, np.arange(0))
        of_surface = sets.sides.get(key, np.zeros((0, 2), dtype=int))
        for each in contents.elements:
            first = each.numbers[0] if len(each.numbers) else 0
            kind = _kind(each.kind)
            chosen = np.isin(each.numbers, members)
            if kind in CELL_TYPES[mesh.dimension]:
                cells.append(of_cell[begin + np.flatnonzero(chosen)])
                begin += len(chosen)
                rows, numbers = of_surface[np.isin(of_surface[:, 0], each.numbers)].T
                corners = np.array(FACES[mesh.dimension, _corners(kind)])[numbers]
                faces.append(each.nodes[(rows - first)[:, None], corners])
            elif kind.startswith("line" if mesh.dimension == 2 else CELL_TYPES[2]):
                sides.append(_side(contents.points, each)[chosen])
        if any(map(len, cells)):
            files["ELSET"].cell_groups[name] = np.unique(np.concatenate(cells))
        elif any(map(len, sides)):
            files["ELSET"].side_groups[name] = of_node[np.concatenate(sides)]
        if key in sets.sides:
            files["SURFACE"].side_groups[name] = of_node[np.concatenate(faces)]
        if key in sets.nodes:
            kind, found = _of_nodes(mesh, of_node[sets.nodes[key]])
            getattr(files["NSET"], kind)[name] = found
    points = {word: file.groups_of_cells() for word, file in files.items()}
    merged = MeshFile(mesh, {}, {})
    for name in sets.names.values():
        words = [word for word in files if name in points[word]]
        words = [word for word in words if len(points[word][name])] or words[:1]
        same = all(np.array_equal(points[word][name], points[words[0]][name]) for word in words)
        if same:
            # Sides say also where loads act.
            words = sorted(words, key=lambda word: name not in files[word].side_groups)[:1]
        for word in words:
            label = name if same else f"{name} ({word})"
            for kind in ("cell_groups", "side_groups"):
                if name in getattr(files[word], kind):
                    getattr(merged, kind)[label] = getattr(files[word], kind)[name]
    return merged


def _of_nodes(mesh: CellMesh, chosen: np.ndarray) -> tuple[str, np.ndarray]:
    """Return the cells or else the sides, with the name of the kind of their groups, all of whose
    corners are among chosen nodes, if these are all of the corners among them; else no side.
    """
    inside = np.zeros(len(mesh.nodes), dtype=bool)
    inside[chosen] = True
    used = np.zeros_like(inside)
    for block in mesh.blocks:
        used[block] = True
    inside &= used  # middles of edges and reference points are not

    def whole(*lists: np.ndarray) -> list[np.ndarray] | None:
        """Lists of flags of the rows with all nodes inside, if these have all nodes inside."""
        flags = [inside[rows].all(axis=1) for rows in lists]
        had = np.zeros_like(inside)
        for rows, flag in zip(lists, flags, strict=True):
            had[rows[flag]] = True
        return flags if inside.any() and (had == inside).all() else None

    if flags := whole(*mesh.blocks):
        return "cell_groups", np.flatnonzero(np.concatenate(flags))
    for sides in (mesh.outer_sides[0], mesh.sides()[0]):
        if flags := whole(sides):
            return "side_groups", sides[flags[0]]
    return "side_groups", mesh.sides()[0][:0]


def kinds_of(contents: Deck) -> set[str]:
    """Return the types of linear cells that have the corners of the elements of a file."""
    return {_kind(each.kind) for each in contents.elements if len(each.nodes) and each.kind}
