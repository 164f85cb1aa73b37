"""Bodies from mesh files: their boundary and its groups."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..body.cell_mesh import among, outward
from ..body.surface import IN_PLANE
from ..decks import files_of
from ..ranks.share import connected
from ..scenes import Mesh, Scene
from ..scenes.model import EDGES
from ..scenes.regions import edge_names
from .mesh_files import read_mesh
from .mesh_groups import MeshFile


def mesh_of(mesh: Mesh) -> MeshFile:
    """Return the contents of a body's mesh file; a file that has not changed since the last call is
    not read again.

    Raises
    ------
    ValueError
        If the file does not exist or cannot be read, or if it is neither a flat mesh of triangles
        and quadrilaterals nor a mesh of tetrahedra and hexahedra, whichever the scene requires.
    """
    path = Path(mesh.file)
    if not path.is_file():
        raise ValueError(f"body.file: the file {mesh.file} does not exist")
    try:
        states = [each.stat() for each in files_of(path)]
    except ValueError as error:
        raise ValueError(f"body.file: cannot read {mesh.file}: {error}") from None
    state = tuple((each.st_mtime_ns, each.st_size) for each in states)
    return read_mesh(mesh.file, mesh.dimension, mesh.parts, state)


def boundary_of_mesh(
    scene: Scene, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Return the boundary of a mesh body in a box: sides of cells, given by nodes at their corners,
    names of their parts, and numbers of the sides of each group, see `Surface`.

    Cells whose centroids lie in holes of the scene are left out. A boundary around empty space of
    the mesh itself is a hole too; such holes are numbered after the holes of the scene, from left
    to right.
    """
    mesh = mesh_of(scene.body)
    middles, _ = mesh.centroids
    hole = np.full(len(middles), -1)
    for number, shape in reversed(list(enumerate(scene.holes))):
        hole[shape.contains(middles)] = number
    sides, owners, beyond = mesh.cells.boundary(hole < 0)
    parts = np.where(beyond < 0, "outline", np.char.add("holes.", hole[beyond].astype(str)))
    nodes = mesh.cells.nodes
    first = sides[:, 0]
    loop = connected(len(nodes), np.repeat(first, sides.shape[1] - 1), sides[:, 1:].ravel())[1][
        first
    ]
    # The volume within a closed boundary is positive around material, negative around empty space.
    within = np.bincount(loop, (outward(nodes[sides]) * nodes[sides].mean(axis=1)).sum(axis=1))
    inner = np.intersect1d(np.flatnonzero(within < 0), loop[beyond < 0]).tolist()
    inner.sort(key=lambda number: tuple(nodes[first[loop == number]].min(axis=0)))
    for number, chain in enumerate(inner, len(scene.holes)):
        parts = np.where((loop == chain) & (beyond < 0), f"holes.{number}", parts)
    groups = {
        name: np.flatnonzero(np.isin(owners, cells)) for name, cells in mesh.cell_groups.items()
    }
    groups |= {
        name: np.flatnonzero(among(sides, members)) for name, members in mesh.side_groups.items()
    }
    return sides, named_edges(parts, nodes[sides], lower, upper, IN_PLANE), groups


def named_edges(
    parts: np.ndarray, corners: np.ndarray, lower: np.ndarray, upper: np.ndarray, rounding: float
) -> np.ndarray:
    """Return the names of parts of a boundary, those of the outline that lie in a side of the
    bounding box renamed to this side.

    The parts are given by positions of their corners (f, corners, d); `rounding` is the greatest
    distance from the side in extents of the body.
    """
    for edge in edge_names(corners.shape[2]):
        axis, side = EDGES[edge]
        distances = np.abs(corners[..., axis] - (lower, upper)[side > 0][axis])
        there = (distances <= rounding * (upper - lower).max()).all(axis=1)
        parts = np.where(there & (parts == "outline"), edge, parts)
    return parts


def faces_of_groups(scene: Scene, lower: np.ndarray, upper: np.ndarray) -> dict[str, str]:
    """Return a dictionary from each mesh group that covers a whole edge (or face) of the
    bounding box to the name of this edge.
    """
    mesh = mesh_of(scene.body) if isinstance(scene.body, Mesh) and scene.prescribed else None
    if mesh is None or not mesh.side_groups:
        return {}
    _, parts, groups = boundary_of_mesh(scene, lower, upper)
    return {
        name: edge
        for edge in np.intersect1d(parts, edge_names(scene.dimension)).tolist()
        for name in mesh.side_groups
        if np.array_equal(groups[name], np.flatnonzero(parts == edge))
    }


def triangles_of(nodes: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Divide faces of solid cells (f, 4) into triangles, quadrilaterals about their middle; return
    the nodes with the middles, the triangles (t, 3), and the face of each.

    Raise ValueError if triangles cover halves of quadrilaterals.
    """
    flat = faces[:, 2] == faces[:, 3]
    four = faces[~flat]
    halves = four[:, [[0, 1, 2, 2], [0, 1, 3, 3], [0, 2, 3, 3], [1, 2, 3, 3]]].reshape(-1, 4)
    if among(faces[flat], halves).any():
        raise ValueError(
            "body.file: faces of tetrahedra cover half faces of hexahedra; loads and probes need"
            " shared whole faces"
        )
    middles = len(nodes) + np.arange(len(four))
    around = [np.column_stack([*np.roll(four, -turn, axis=1).T[:2], middles]) for turn in range(4)]
    return (
        np.concatenate([nodes, nodes[four].mean(axis=1)]),
        np.concatenate([faces[flat, :3], *around]),
        np.concatenate([np.flatnonzero(flat), np.tile(np.flatnonzero(~flat), 4)]),
    )
