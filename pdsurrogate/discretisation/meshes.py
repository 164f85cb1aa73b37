"""Bodies from mesh files: what is read of a file, the points that its cells become, its boundary and its groups."""

from __future__ import annotations

import io
from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..scenes import Mesh
from .places import same_places


@dataclass(frozen=True)
class MeshFile:
    """What is read of a mesh file.

    Attributes
    ----------
    nodes : ndarray, shape (k, 2)
    cells : tuple of ndarray of int, shapes (n, 3) and (n, 4)
        Corners of the triangles and quadrilaterals, block by block; cells are numbered through all blocks.
    cell_groups : mapping of str to ndarray of int
        Cells of each physical group of them.
    line_groups : mapping of str to ndarray of int, shape (l, 2)
        Ends of the lines of each physical group of them.
    """

    nodes: np.ndarray
    cells: tuple[np.ndarray, ...]
    cell_groups: Mapping[str, np.ndarray]
    line_groups: Mapping[str, np.ndarray]

    def corners(self) -> list[np.ndarray]:
        """Corners of the cells of each block, arrays of shape (n, 3 or 4, 2)."""
        return [self.nodes[block] for block in self.cells]

    def edges(self) -> Edges:
        """The sides of the cells."""
        extent = np.ptp(self.nodes, axis=0).max()
        # Nodes at one place are one: a crack is said by a precut, and bonds ask for no nodes in common.
        number = same_places(self.nodes, 1e-9 * extent)
        first, second, owners = [], [], []
        begin = 0
        for block, corners in zip(self.cells, self.corners(), strict=True):
            clockwise = signed_areas(corners) < 0
            block = np.where(clockwise[:, None], block[:, ::-1], block)
            first.append(number[block].ravel())
            second.append(number[np.roll(block, -1, axis=1)].ravel())
            owners.append(np.repeat(np.arange(begin, begin + len(block)), block.shape[1]))
            begin += len(block)
        return Edges(np.stack([np.concatenate(first), np.concatenate(second)], axis=1), np.concatenate(owners), number)

    def groups_of_cells(self) -> dict[str, np.ndarray]:
        """The cells of every physical group; those of a group of lines are the ones that have one of its lines for a side."""
        groups = dict(self.cell_groups)
        if self.line_groups:
            edges = self.edges()
            for name, lines in self.line_groups.items():
                groups[name] = np.unique(edges.owners[edges.among(lines)])
        return groups


@dataclass(frozen=True)
class Edges:
    """Sides of the cells of a mesh, each once for every cell that has it.

    Attributes
    ----------
    ends : ndarray of int, shape (e, 2)
        Nodes, counter-clockwise around the cell.
    owners : ndarray of int, shape (e,)
        The cells.
    number : ndarray of int, shape (k,)
        Node that stands for each of the file's nodes: the first at its place.
    """

    ends: np.ndarray
    owners: np.ndarray
    number: np.ndarray

    def keys(self, ends: np.ndarray) -> np.ndarray:
        """One number for both directions of a side."""
        low, high = np.sort(ends, axis=1).T
        return low * len(self.number) + high

    def among(self, lines: np.ndarray) -> np.ndarray:
        """Which edges are one of the lines, whose ends are nodes of the file."""
        return np.isin(self.keys(self.ends), self.keys(self.number[lines]))

    def boundary(self, kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Edges around the kept cells.

        Parameters
        ----------
        kept : ndarray of bool, shape (cells,)

        Returns
        -------
        edges : ndarray of int, shape (b,)
            Their numbers.
        beyond : ndarray of int, shape (b,)
            The cell on the other side, which is not kept; -1 where there is none.
        """
        here, there = np.flatnonzero(kept[self.owners]), np.flatnonzero(~kept[self.owners])
        keys, beside = self.keys(self.ends[here]), self.keys(self.ends[there])
        _, where, times = np.unique(keys, return_inverse=True, return_counts=True)
        outer = times[where] == 1
        edges, keys = here[outer], keys[outer]
        beyond = np.full(len(edges), -1)
        order = np.argsort(beside)
        found = np.searchsorted(beside, keys, sorter=order)
        found[found == len(order)] = 0
        if len(order):
            found = order[found]
            beyond = np.where(beside[found] == keys, self.owners[there[found]], -1)
        return edges, beyond


def mesh_of(mesh: Mesh) -> MeshFile:
    """The mesh of a body; a file that has not changed since it was last asked for is not read again.

    Raises
    ------
    ValueError
        If there is no such file, it cannot be read, or is no flat mesh of triangles and quadrilaterals.
    """
    path = Path(mesh.file)
    if not path.is_file():
        raise ValueError(f"body.file: there is no file {mesh.file}")
    state = path.stat()
    return _read(mesh.file, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=1)
def _read(file: str, _changed: int, _size: int) -> MeshFile:
    import meshio

    printed = io.StringIO()
    try:
        with redirect_stdout(printed), redirect_stderr(printed):
            read = meshio.read(file)
    except (Exception, SystemExit) as error:  # meshio's readers raise whatever they meet, and print and exit on what none of them reads
        reason = printed.getvalue() if isinstance(error, SystemExit) else error
        raise ValueError(f"body.file: meshio cannot read {file}: {' '.join(str(reason).split())}") from None
    points = np.asarray(read.points, dtype=float)
    if not np.isfinite(points).all():
        raise ValueError(f"body.file: node {np.argwhere(~np.isfinite(points))[0, 0]} of {file} has a position that is not finite")
    # Of points and edges meshes have those of their boundaries; other cells would leave holes where they are left out.
    others = {block.type for block in read.cells} - {"triangle", "quad"}
    refused = sorted(kind for kind in others if not kind.startswith(("vertex", "line")))
    if refused:
        raise ValueError(f"body.file: {file} has cells of type {', '.join(refused)}; triangle and quad are taken")
    if points.shape[1] == 3 and np.ptp(points[:, 2]) > 1e-9 * np.ptp(points[:, :2]):
        raise ValueError(f"body.file: {file} is not flat: its third coordinate varies")
    cells = tuple(block.data for block in read.cells if block.type in ("triangle", "quad") and len(block.data))
    if not cells:
        raise ValueError(f"body.file: {file} has no triangles or quadrilaterals")
    return MeshFile(points[:, :2], cells, *_groups(read))


def _groups(read) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Physical groups of cells and of lines.

    meshio has groups as sets of cells, block by block, or, of gmsh's files of version 2, by a number for each cell and a name for it.
    """
    members: dict[str, list] = {name: sets for name, sets in read.cell_sets.items() if not name.startswith("gmsh:")}
    numbers = read.cell_data.get("gmsh:physical")
    if numbers is not None:
        named = {name: entry for name, entry in read.field_data.items() if np.size(entry) == 2}
        for name, (number, dimension) in named.items():
            fitting = [block.dim == dimension for block in read.cells]
            members.setdefault(
                name, [np.flatnonzero(of_block == number) if fits else [] for of_block, fits in zip(numbers, fitting, strict=True)]
            )
    cell_groups, line_groups = {}, {}
    for name, sets in members.items():
        cells, lines, begin = [], [], 0
        for block, chosen in zip(read.cells, sets, strict=True):
            chosen = np.asarray(() if chosen is None else chosen, dtype=int)
            if block.type in ("triangle", "quad"):
                cells.append(begin + chosen)
                begin += len(block.data)
            elif block.type.startswith("line"):
                lines.append(block.data[chosen][:, :2])
        if any(map(len, cells)):
            cell_groups[name] = np.concatenate(cells)
        elif any(map(len, lines)):
            line_groups[name] = np.concatenate(lines)
    return cell_groups, line_groups


def signed_areas(cells: np.ndarray) -> np.ndarray:
    """Areas of polygons, shape (n, corners, 2), negative where the corners run clockwise."""
    return _cross_products(cells).sum(axis=1) / 2


def _cross_products(cells: np.ndarray) -> np.ndarray:
    following = np.roll(cells, -1, axis=1)
    return cells[..., 0] * following[..., 1] - following[..., 0] * cells[..., 1]


def centroids(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centroids and areas of polygons, shapes (n, 2) and (n,)."""
    cross = _cross_products(cells)
    area = cross.sum(axis=1) / 2
    if (area == 0).any():
        raise ValueError("body.file: a cell has no area")
    if cells.shape[1] == 4 and _crossed(cells).any():
        raise ValueError("body.file: the sides of a quadrilateral cross each other; its corners must be in order around it")
    middles = ((cells + np.roll(cells, -1, axis=1)) * cross[..., None]).sum(axis=1) / (6 * area[:, None])
    return middles, np.abs(area)


def _crossed(quadrilaterals: np.ndarray) -> np.ndarray:
    """Which quadrilaterals, shape (n, 4, 2), have sides that cross: either diagonal then cuts them into triangles of opposite senses."""
    a, b, c, d = quadrilaterals.transpose(1, 0, 2)

    def sense(start, middle, end):
        one, two = middle - start, end - start
        return one[:, 0] * two[:, 1] - two[:, 0] * one[:, 1]

    return (sense(a, b, c) * sense(a, c, d) < 0) & (sense(a, b, d) * sense(b, c, d) < 0)


def loops_of(ends: np.ndarray) -> np.ndarray:
    """Number of the connected chain that each edge, shape (b, 2), belongs to."""
    names, compact = np.unique(ends, return_inverse=True)
    compact = compact.reshape(ends.shape)
    graph = coo_array((np.ones(len(ends)), compact.T), shape=(len(names), len(names)))
    return connected_components(graph, directed=False)[1][compact[:, 0]]
