"""Contents of a mesh file as a body has them: cells and groups of cells or of their sides."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..body import CellMesh
from ..body.cell_mesh import FACES, numbers_in
from ..decks import EDGE, Deck, Elements
from .mesh_cells import CELL_TYPES, centroids, corners_of, kind_of


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
        if not self.side_groups:
            return dict(self.cell_groups)
        corners, owners = self.cells.sides()
        own, *groups = numbers_in(corners, *self.side_groups.values())
        return self.cell_groups | {
            name: np.unique(owners[np.isin(own, members)])
            for name, members in zip(self.side_groups, groups, strict=True)
        }


def side_of(points: np.ndarray, elements: Elements) -> np.ndarray:
    """Return the corners of elements that are lines or faces, a triangle with its last twice."""
    nodes = elements.nodes
    if elements.kind != "line3":
        return nodes[:, {"l": [0, 1], "t": [0, 1, 2, 2], "q": [0, 1, 2, 3]}[elements.kind[0]]]
    # The ends are farthest apart: programs write the middle second or last.
    pairs = nodes[:, [[0, 1], [0, 2], [1, 2]]]
    lengths = np.linalg.norm(points[pairs[..., 1]] - points[pairs[..., 0]], axis=-1)
    return pairs[np.arange(len(nodes)), lengths.argmax(axis=1)]


def with_groups(
    mesh: CellMesh, contents: Deck, of_cell: np.ndarray, of_node: np.ndarray
) -> MeshFile:
    """Return a mesh with the groups of its file, whose cells and nodes have the numbers `of_cell`
    and `of_node` in the mesh.

    Sets of one name and of different kinds are one if they have the same cells; else the kind
    follows each of their names.
    """
    sets = contents.sets
    places = contents.points
    every = MeshFile(mesh, {}, {})
    labels: dict[str, list[str]] = {}
    neither = []
    for key, name in sets.names.items():
        cells = [np.arange(0)]
        sides = []
        faces = []
        begin = 0
        members = sets.elements.get(key, np.arange(0))
        there = not len(members)
        of_surface = sets.sides.get(key, np.zeros((0, 2), dtype=int))
        for each in contents.elements:
            kind = kind_of(each.kind)
            chosen = np.isin(each.numbers, members)
            there |= chosen.any()
            if kind in CELL_TYPES[mesh.dimension]:
                cells.append(of_cell[begin + np.flatnonzero(chosen)])
                begin += len(chosen)
                faces.append(_faces_in(name, of_surface, each, mesh.dimension))
            elif kind.startswith("line" if mesh.dimension == 2 else CELL_TYPES[2]):
                sides.append(side_of(places, each)[chosen])
        found = {}
        if any(map(len, cells)):
            found["ELSET"] = "cell_groups", np.unique(np.concatenate(cells))
        elif any(map(len, sides)):
            found["ELSET"] = "side_groups", of_node[np.concatenate(sides)]
        if key in sets.sides:
            found["SURFACE"] = "side_groups", of_node[np.concatenate(faces)]
        if key in sets.nodes:
            found["NSET"] = _of_nodes(mesh, of_node[sets.nodes[key]])
        if not found and there:
            neither.append(name)
        labels[name] = [f"{name} ({word})" for word in found]
        for label, (groups, own) in zip(labels[name], found.values(), strict=True):
            getattr(every, groups)[label] = own
    if neither:
        warnings.warn(
            f"body.file: groups without cells or sides of cells are left out: {', '.join(neither)}",
            stacklevel=6,
        )
    shared = any(len(of) > 1 for of in labels.values())
    points = every.groups_of_cells() if shared else {}
    names = {}
    for name, of in labels.items():
        if len(of) > 1:
            of = [label for label in of if len(points[label])] or of[:1]
            if all(np.array_equal(points[label], points[of[0]]) for label in of):
                # Sides say also where loads act.
                of = sorted(of, key=lambda label: label not in every.side_groups)[:1]
        names |= {label: name if len(of) == 1 else label for label in of}
    return MeshFile(
        mesh,
        *(
            {names[label]: groups[label] for label in groups if label in names}
            for groups in (every.cell_groups, every.side_groups)
        ),
    )


def _faces_in(name: str, surface: np.ndarray, cells: Elements, dimension: int) -> np.ndarray:
    """Return the nodes of the sides of cells in a surface of some name, given by elements and
    their faces as in `Sets`.

    Raise ValueError for a face that is no side of its cell.
    """
    kind = kind_of(cells.kind)
    sides = np.array(FACES[dimension, corners_of(kind)])
    owners, numbers = surface[np.isin(surface[:, 0], cells.numbers)].T
    if cells.type.startswith(("S", "M3D")):  # S1 and S2 are the faces of a shell, S3 its first edge
        numbers = np.where(numbers < EDGE, numbers - 2, numbers - EDGE)
    if (numbers < 0).any():
        raise ValueError(
            f"body.file: surface {name} is a face (S1, S2) of {cells.type} elements; the boundary"
            " of a sheet is made of edges, in CalculiX S3 to S6, in Abaqus E1 to E4 (plane"
            " elements, CPS and CPE, have the edges S1 to S4)"
        )
    if (numbers >= len(sides)).any():
        raise ValueError(f"body.file: surface {name}: a {kind} has {len(sides)} faces")
    rows = np.searchsorted(cells.numbers, owners)
    return cells.nodes[rows[:, None], sides[numbers]]


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
    for sides in (mesh.outer_sides[0], mesh.faces[0]):
        if flags := whole(sides):
            return "side_groups", sides[flags[0]]
    return "side_groups", mesh.faces[0][:0]


def only(file: str, contents: Deck, parts: tuple[str, ...] | None, beside: tuple) -> Deck:
    """Return the contents of a file with the cells of those sets alone that a scene names, and all
    elements of types that begin with `beside`; by default all, with a warning if the file is a deck
    of several instances of parts.
    """
    sets = {name: contents.sets.elements.get(key, []) for key, name in contents.sets.names.items()}
    cells = [each for each in contents.elements if each.kind and not each.kind.startswith(beside)]
    if parts is None:
        counts = {
            name: sum(int(np.isin(each.numbers, of).sum()) for each in cells)
            for name, of in contents.instances.items()
        }
        several = [name for name, count in counts.items() if count]
        if len(several) > 1:
            told = ", ".join(f"{name} ({counts[name]})" for name in several)
            warnings.warn(
                f"body.file: the body has the cells of all parts of {file}: {told}; parts ="
                f' ["{several[0]}"] takes one, and parts that touch are bonded',
                stacklevel=6,
            )
        return contents
    for name in parts:
        if not len(sets.get(name, ())):
            known = ", ".join(name for name, of in sets.items() if len(of))
            raise ValueError(f"body.parts: {file} has no elements in {name!r}; it has {known}")
    members = np.concatenate([sets[name] for name in parts])
    kept = [
        each
        if each.kind.startswith(beside)
        else each._replace(numbers=each.numbers[chosen], nodes=each.nodes[chosen])
        for each in contents.elements
        for chosen in [np.isin(each.numbers, members)]
    ]
    return replace(contents, elements=kept)
