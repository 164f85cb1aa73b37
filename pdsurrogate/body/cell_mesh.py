"""Cells of the points of a body, from its lattice or mesh, for pictures and result files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..ranks.share import connected

CORNERS = {2: np.array([[0, 0], [1, 0], [1, 1], [0, 1]])}
CORNERS[3] = np.array([[*corner, height] for height in (0, 1) for corner in CORNERS[2]])
"""Positions of the corners of a lattice cell, 0 or 1 along each axis, by dimension, in the order
of VTK's quadrilaterals and hexahedra.
"""

FACES = {
    (2, 3): ((0, 1), (1, 2), (2, 0)),
    (2, 4): ((0, 1), (1, 2), (2, 3), (3, 0)),
    # A triangle repeats its last corner, so that all faces in three dimensions have four.
    (3, 4): ((0, 2, 1, 1), (0, 1, 3, 3), (1, 2, 3, 3), (0, 3, 2, 2)),
    (3, 8): ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
"""Sides of a cell, given by the numbers of their corners in the cell, by dimension and number of
corners of the cell.

In three dimensions the normals of the sides point outwards by the right-hand rule.
"""


def _around(corners: int) -> tuple[tuple[int, int], ...]:
    """Return the sides of a polygon, given by the numbers of their corners in the polygon."""
    return tuple((corner, (corner + 1) % corners) for corner in range(corners))


SLAB = 2**16
"""Number of cells whose nodes are moved, or that are drawn into an image, together."""

TORN = 0.5
"""Relative distance between the two positions that neighboring cells predict for their common side,
above which the side is drawn as open. The distance is divided by the length from one cell through
the side to the other. In a smooth deformation it is of second order in that length; across an open
crack it is the opening. Chosen: with a smaller value strong gradients at a crack tip are drawn as
cracks, with a greater one cracks appear only once they are wide open.
"""


@dataclass(frozen=True)
class CellMesh:
    """Mesh of the cells around the points of a body, in the order of the points, for pictures and
    result files.

    Attributes
    ----------
    nodes : ndarray, shape (k, d)
        Reference positions of the corners of cells.
    blocks : tuple of ndarray of int, each of shape (m, corners)
        Nodes at the corners of triangles and quadrilaterals, or tetrahedra and hexahedra, in the
        order of VTK; or of polygons in the plane with as many corners as the one with most, of
        which others repeat their last.
    """

    nodes: np.ndarray
    blocks: tuple[np.ndarray, ...]

    def __len__(self) -> int:
        return sum(map(len, self.blocks))

    @classmethod
    def of_lattice(cls, points: np.ndarray, volumes: np.ndarray, cell: np.ndarray) -> CellMesh:
        """Return the cell mesh of lattice points, of cells with sides `cell`; a cell cut by the
        body's surface is included in full.

        The first point with the volume of a full cell fixes the lattice, as the middle of its cell;
        other points may lie off the middle.
        """
        full = np.flatnonzero(np.isclose(volumes, cell.prod(), rtol=1e-9, atol=0))
        middle = points[full[0] if len(full) else 0]
        place = np.rint((points - middle) / cell).astype(np.int64)
        lowest = place.min(axis=0)
        counts = place.max(axis=0) - lowest + 2
        offsets = np.ravel_multi_index(tuple(CORNERS[len(cell)].T), tuple(counts))
        number = np.ravel_multi_index(tuple((place - lowest).T), tuple(counts))[:, None] + offsets
        found = np.zeros(counts.prod(), dtype=bool)
        found[number] = True
        used = np.flatnonzero(found)
        corners = (found.cumsum(dtype=np.int32) - 1)[number]
        nodes = (
            middle + (np.stack(np.unravel_index(used, tuple(counts)), axis=1) + lowest - 0.5) * cell
        )
        return cls(nodes, (corners,))

    @classmethod
    def of_mesh(cls, nodes: np.ndarray, blocks: Sequence[np.ndarray], kept: np.ndarray) -> CellMesh:
        """Return the cell mesh of the cells of a mesh for which `kept` (one flag per cell, block
        by block) is true, with all its nodes.
        """
        parts = np.split(kept, np.cumsum([len(block) for block in blocks])[:-1])
        return cls(
            nodes,
            tuple(block[part] for block, part in zip(blocks, parts, strict=True) if part.any()),
        )

    def only(self, kept: np.ndarray) -> tuple[CellMesh, np.ndarray]:
        """Return the mesh of the cells for which `kept` is true, with their nodes alone, and the
        old numbers of these nodes.
        """
        blocks = CellMesh.of_mesh(self.nodes, self.blocks, kept).blocks
        used, corners = np.unique(
            np.concatenate([block.ravel() for block in blocks]), return_inverse=True
        )
        parts = np.split(corners.astype(np.int32), np.cumsum([block.size for block in blocks])[:-1])
        return (
            CellMesh(
                self.nodes[used],
                tuple(part.reshape(block.shape) for part, block in zip(parts, blocks, strict=True)),
            ),
            used,
        )

    @property
    def dimension(self) -> int:
        """Number of coordinates of a node, 2 or 3."""
        return self.nodes.shape[1]

    def extents(self, axis: int) -> np.ndarray:
        """Return the extents of the cells along an axis, shape (n,)."""
        return np.concatenate([np.ptp(self.nodes[block, axis], axis=1) for block in self.blocks])

    def touching(self, chosen: np.ndarray) -> np.ndarray:
        """Return flags of the cells with a corner at a chosen node, shape (n,), from flags of
        the nodes.
        """
        return np.concatenate([chosen[block].any(axis=1) for block in self.blocks])

    @cached_property
    def _owners(self) -> np.ndarray:
        """Number of the cell to which each entry of `blocks` (a corner of a cell) belongs, in
        the order of `_entries`.
        """
        widths = np.concatenate([np.full(len(block), block.shape[1]) for block in self.blocks])
        return np.repeat(np.arange(len(self)), widths)

    @cached_property
    def _entries(self) -> np.ndarray:
        """Nodes at the corners of all cells: the entries of all `blocks` in one array."""
        return np.concatenate([block.ravel() for block in self.blocks])

    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the sides of all cells, cell by cell: nodes at their corners, shape (s, 2 or 4),
        and their cells, shape (s,).

        A side is an edge of a cell in the plane, and a face in three dimensions, where a triangle
        repeats one of its nodes. A polygon may repeat its last corner; there it has no side.
        """
        faces = [
            np.array(FACES.get((self.dimension, block.shape[1]), _around(block.shape[1])))
            for block in self.blocks
        ]
        corners = np.concatenate(
            [
                block[:, face].reshape(-1, face.shape[1])
                for block, face in zip(self.blocks, faces, strict=True)
            ]
        )
        owners = np.repeat(
            np.arange(len(self)),
            np.repeat([len(face) for face in faces], [len(block) for block in self.blocks]),
        )
        long = corners[:, 0] != corners[:, 1]
        return corners[long], owners[long]

    @cached_property
    def faces(self) -> tuple[np.ndarray, np.ndarray]:
        """Edges (in 3D faces) of the cells, each listed once: nodes at its corners (f, 2 or 4), and
        its two cells (f, 2), -1 for none.

        A triangle repeats one of its nodes.
        """
        corners, owners = self.sides()
        number = side_numbers(corners)
        _, first = np.unique(number, return_index=True)
        beyond = np.full(len(first), -1)
        further = np.ones(len(number), dtype=bool)
        further[first] = False
        beyond[number[further]] = owners[further]
        return corners[first], np.stack([owners[first], beyond], axis=1)

    @cached_property
    def outer_sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Sides on the boundary of the mesh: nodes at their corners, as of `sides`, and their
        cells.
        """
        return self.boundary(np.ones(len(self), dtype=bool))[:2]

    def boundary(self, kept: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the sides on the boundary of a part of the cells, flagged by `kept` (n,): nodes
        at their corners, their cells, and the cells on their other side, -1 where there is none.
        """
        corners, owners = self.sides()
        number = side_numbers(corners)
        inside = kept[owners]
        times = np.bincount(number[inside], minlength=len(number))
        beyond = np.full(len(number), -1)
        beyond[number[~inside]] = owners[~inside]
        sides = np.flatnonzero(inside & (times[number] == 1))
        return corners[sides], owners[sides], beyond[number[sides]]

    def moved(
        self, points: np.ndarray, displacement: np.ndarray, gradients: np.ndarray
    ) -> np.ndarray:
        """Return the displacements of the nodes, shape (k, d), from the motion of the body's
        points.

        Each cell extrapolates the displacement of its point linearly to its nodes; a node has the
        mean over its cells. `points` and `displacement` have shape (n, d), and the deformation
        gradients `gradients` shape (n, d, d).
        """
        counts = np.zeros(len(self.nodes), dtype=np.int32)
        total = np.zeros_like(self.nodes)
        begin = 0
        for block in self.blocks:
            for corners in np.split(block, range(SLAB, len(block), SLAB)):
                own = slice(begin, begin + len(corners))
                changes = gradients[own] - np.eye(self.dimension)
                for corner in corners.T:
                    said = displacement[own] + np.einsum(
                        "nij,nj->ni", changes, self.nodes[corner] - points[own]
                    )
                    np.add.at(counts, corner, 1)
                    for column, values in zip(total.T, said.T, strict=True):
                        np.add.at(column, corner, values)
                begin += len(corners)
        total /= np.maximum(counts, 1)[:, None]
        return total

    def torn(
        self, points: np.ndarray, displacement: np.ndarray, gradients: np.ndarray, parted: Callable
    ) -> CellMesh:
        """Return the cell mesh with separate nodes on the two sides of open cracks, from the motion
        of the points.

        Each of the two cells of a face predicts the position of its middle. The face is open if the
        predictions differ by more than `TORN` times the deformed distance from point to face to
        point, and ``parted(one, other)``, of the numbers of points, flags the cells. See `moved`
        for the other arguments.
        """
        corners, beside = self.faces
        inner = beside[:, 1] >= 0
        corners = corners[inner]
        one, other = beside[inner].T
        # The repeated corner of a triangle does not matter: any place on the common side will do.
        middle = self.nodes[corners].mean(axis=1)
        toward = np.einsum("nij,nj->ni", gradients[one], middle - points[one])
        onwards = np.einsum("nij,nj->ni", gradients[other], points[other] - middle)
        apart = points[other] + displacement[other] - points[one] - displacement[one]
        gap = np.linalg.norm(apart - toward - onwards, axis=1)
        open_ = gap > TORN * (np.linalg.norm(toward, axis=1) + np.linalg.norm(onwards, axis=1))
        open_[open_] = parted(one[open_], other[open_])
        return (
            self
            if not open_.any()
            else self._separated(corners, np.stack([one, other], axis=1), open_)
        )

    def _separated(self, corners: np.ndarray, beside: np.ndarray, open_: np.ndarray) -> CellMesh:
        """Return the mesh in which each node of an open face is copied for every group of cells
        around it that intact faces connect.

        `corners` (f, 2 or 4) are the nodes of faces between two cells, `beside` (f, 2) these cells,
        and `open_` (f,) flags open faces.
        """
        split = np.zeros(len(self.nodes), dtype=bool)
        split[corners[open_]] = True
        entries = np.flatnonzero(split[self._entries])
        nodes = self._entries[entries]
        # A cell and a node identify an entry; an intact face connects the entries of both its cells
        # at each corner.
        keys = self._owners[entries] * len(self.nodes) + nodes
        order = np.argsort(keys)
        whole = ~open_ & split[corners].any(axis=1)
        face, corner = np.nonzero(split[corners[whole]])
        common = corners[whole][face, corner]
        pairs = beside[whole][face]
        one, other = (
            order[np.searchsorted(keys[order], cells * len(self.nodes) + common)]
            for cells in pairs.T
        )
        # corners that a polygon repeats
        again = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
        one = np.append(one, order[again])
        other = np.append(other, order[again + 1])
        count, group = connected(len(entries), one, other)
        node_of_group = np.zeros(count, dtype=np.int64)
        node_of_group[group] = nodes
        # The first group of a node keeps it; every other group gets a new node.
        by_node = np.argsort(node_of_group, kind="stable")
        further = np.zeros(count, dtype=bool)
        further[by_node[1:]] = node_of_group[by_node[1:]] == node_of_group[by_node[:-1]]
        number = node_of_group.copy()
        number[further] = len(self.nodes) + np.arange(further.sum())
        renewed = self._entries.copy()
        renewed[entries] = number[group]
        sizes = np.cumsum([block.size for block in self.blocks])[:-1]
        blocks = (
            part.reshape(block.shape)
            for part, block in zip(np.split(renewed, sizes), self.blocks, strict=True)
        )
        return CellMesh(
            np.concatenate([self.nodes, self.nodes[node_of_group[further]]]), tuple(blocks)
        )


def side_numbers(corners: np.ndarray) -> np.ndarray:
    """Return an identification number of every side, shape (s,): sides with equal corners (s, 2
    or 4), in any order, have equal numbers.
    """
    keys = np.sort(corners, axis=1)
    # A triangle may repeat any corner: its greatest is made the one that counts twice.
    keys[:, 1:-1] = np.where(keys[:, 1:-1] == keys[:, :-2], keys[:, -1:], keys[:, 1:-1])
    keys.sort(axis=1)
    order = np.lexsort(keys.T)
    number = np.zeros(len(keys), dtype=np.int64)
    number[order[1:]] = np.cumsum((keys[order[1:]] != keys[order[:-1]]).any(axis=1))
    return number


def numbers_in(*lists: np.ndarray) -> list[np.ndarray]:
    """Return the `side_numbers` of the sides in several lists, which have them in common."""
    ends = np.cumsum([len(each) for each in lists])[:-1]
    return np.split(side_numbers(np.concatenate(lists)), ends)


def among(corners: np.ndarray, members: np.ndarray) -> np.ndarray:
    """Return flags of the sides (s,) that occur among `members`, both given by their nodes."""
    return np.isin(*numbers_in(corners, members))


def outward(corners: np.ndarray) -> np.ndarray:
    """Return the outward normals times areas, in the plane times lengths, of sides of cells or of
    facets, shape (s, d), from positions of their corners (s, corners, d).
    """
    if corners.shape[2] == 2:
        return (corners[:, 1] - corners[:, 0])[:, ::-1] * [1, -1]
    return np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]) / 2
