"""Precuts of a scene together: which bonds they cross, and where their ends and edges are
touched.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations, pairwise

import numpy as np
import scipy

from ..body import Cells, ReflectionPlane
from ..kernels.polygons import encloses
from ..scenes.shapes import ENDS
from ..scenes.solids import AnyPrecut
from .cells import lattice_of

BESIDE = 8.0
"""Distance, in those within which places coincide, by which points on a cut are moved to its side.
A piece may end one such distance beyond the cut on which it ends, and another one belongs to it
there, so that points must be moved by more than three; where the normals of two pieces that meet
form an angle of 90 degrees, by more than 4.2.
"""

ALONG_ROWS = 1e-3
"""Greatest distance, in cells, of the ends of a cut from a line (plane) between cells that still
counts as lying along it.
"""


class Cuts:
    """Cuts of a body, together: a bond is cut if it crosses one of the pieces, or meets an end at
    which a piece touches something else.

    Pieces touch where they coincide to rounding. A bond that meets the free end of a piece, a tip,
    is not cut.

    Parameters
    ----------
    pieces : sequence of Precut, ParallelogramCut or DiscCut
    rounding : float
        Distance within which places coincide.
    inside : callable
        ``inside(places)`` returns whether places (k, d) lie in the body, shape (k,).
    planes : sequence of ReflectionPlane, optional
        Planes beyond which the body and its cuts are continued by mirror images.

    Attributes
    ----------
    beside : float
        Distance from a cut of places that lie beside it and not on it, far below all lengths of a
        body.
    pieces
    """

    def __init__(
        self,
        pieces: Sequence[AnyPrecut],
        rounding: float,
        inside: Callable[[np.ndarray], np.ndarray],
        planes: Sequence[ReflectionPlane] = (),
    ) -> None:
        self.pieces = pieces
        self._rounding = rounding
        self._inside = inside
        self._planes = planes
        self.beside = 4 * BESIDE * rounding

    def only(self, number: int) -> Cuts:
        """Return the cut of one piece alone."""
        return Cuts(self.pieces[number : number + 1], self._rounding, self._inside, self._planes)

    def touched(self, number: int, places: np.ndarray) -> np.ndarray:
        """Return which places (k, d) on a piece, given by its number, another piece touches, the
        boundary of the body or a plane of reflection, unless the piece lies in this plane.
        """
        axes = np.eye(places.shape[1])
        touched = np.zeros(len(places), dtype=bool)
        steps = [*axes, *-axes]
        for plane in self._planes:
            if (np.abs(plane.mirrored(self.pieces[number].edge(1.0)[0])[1]) > self._rounding).any():
                touched |= plane.mirrored(places)[1] <= self._rounding
            else:  # beyond it the body goes on
                steps = [step for step in steps if plane.side * step[plane.axis] <= 0]
                places = places - self._rounding * plane.side * axes[plane.axis]
        for step in steps:
            touched |= ~self._inside(places + self._rounding * step)
        for other, piece in enumerate(self.pieces):
            if other != number:
                touched |= piece.distances(places) <= self._rounding
        return touched

    def crosses(
        self, starts: np.ndarray, ends: np.ndarray, planes: Sequence[ReflectionPlane] | None = None
    ) -> np.ndarray:
        """Return which segments from `starts` to `ends` (k, d) are cut; beyond the reflection
        planes (all, or `planes`) cuts are continued by their mirror images.

        Points on a cut count as lying to the left of each piece on which they are, in space on the
        side of its normal.
        """
        crossing = self._cross(starts, ends)
        planes = self._planes if planes is None else planes
        for number, plane in enumerate(planes):
            beyond = np.flatnonzero(plane.mirrored(ends)[1] < 0)
            images = (2 * plane.mirrored(end)[0] - end for end in (starts[beyond], ends[beyond]))
            crossing[beyond] |= self.crosses(*images, planes[number + 1 :])
        return crossing

    def _cross(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return which segments meet a cut where it lies on the body's side of all planes."""
        near = np.zeros(len(starts), dtype=bool)
        beside = BESIDE * self._rounding
        for piece in self.pieces:
            place, normal, _ = piece.plane()
            heights = (starts - place) @ normal, (ends - place) @ normal
            near |= (np.minimum(*heights) <= beside) & (np.maximum(*heights) >= -beside)
        chosen = np.flatnonzero(near)
        crossing = np.zeros(len(starts), dtype=bool)
        one = self._beside(starts[chosen])
        other = self._beside(ends[chosen])
        for number, piece in enumerate(self.pieces):
            apart, meets = piece.met_by(one, other, self._rounding)
            crossing[chosen[apart]] |= self._belong(number, meets)
        return crossing

    def on(self, places: np.ndarray) -> np.ndarray:
        """Return which places (k, d) lie on a cut, to rounding; free ends are not part of it."""
        return np.any([self._lie_on(number, places) for number in range(len(self.pieces))], axis=0)

    def straight_parts(self, boundary: np.ndarray) -> Iterator[np.ndarray]:
        """Yield the straight parts of plane cuts, between ends, places where pieces meet, and the
        boundary of the body.

        Each is given by its two ends (2, 2). Parts outside the body, of which `boundary` are the
        two ends of each facet (f, 2, 2), are left out.
        """
        import shapely  # here, because few bodies need it

        lines = shapely.linestrings([piece.edge(1.0)[0] for piece in self.pieces])
        for number, line in enumerate(lines):
            others = np.delete(lines, number)
            met = shapely.get_parts(
                shapely.intersection(line, [*others, shapely.multilinestrings(boundary)])
            )
            ends = shapely.points(shapely.get_coordinates(others))
            ends = ends[shapely.dwithin(line, ends, self._rounding)]
            met = np.concatenate([met[shapely.get_dimensions(met) == 0], ends])
            along = np.unique([0, *shapely.line_locate_point(line, met), shapely.length(line)])
            along = along[np.append(True, np.diff(along) > self._rounding)]
            for part in pairwise(shapely.get_coordinates(line.interpolate(along))):
                normal = np.subtract(*part)[::-1] * (1, -1)
                # A part in a plane of symmetry lies on the boundary.
                beside = self.beside * normal / np.linalg.norm(normal)
                middles = np.mean(part, axis=0) + np.stack([beside, -beside])
                if encloses(middles, boundary[:, 0], boundary[:, 1]).any():
                    yield np.array(part)

    def flat_parts(
        self,
        side: int,
        cell: Sequence[float],
        nodes: np.ndarray,
        facets: np.ndarray,
        planes: Sequence[ReflectionPlane],
    ) -> Iterator[tuple[np.ndarray, ...]]:
        """Yield places (k, 3) beside every cut in space, and the areas times outward normals (k, 3)
        of its facets there.

        They are of the face on the side of the normal if `side` is 1, else of the other one, within
        the boundary of the body, given by triangles, `facets` of `nodes`. Facets are about as large
        as a cell; those that another piece divides are divided there. `planes` of symmetry at right
        angles to a cut continue it: a facet that lies across one stands for its half.
        """
        import shapely  # here, because few bodies need it

        outlines = [_outline(piece, min(cell)) for piece in self.pieces]
        for number, piece in enumerate(self.pieces):
            place, normal, _ = piece.plane()
            place = place + side * self.beside * normal
            one = np.eye(3)[np.abs(normal).argmin()]
            one = (one - one @ normal * normal) / np.linalg.norm(one - one @ normal * normal)
            axes = np.stack([one, np.cross(normal, one)])
            section = shapely.build_area(
                shapely.multilinestrings((_sections(nodes, facets, place, normal) - place) @ axes.T)
            )
            # As a polygon, ends of an outline that differ by rounding would make it invalid.
            outline = shapely.multipoints((outlines[number] - place) @ axes.T)
            face = section.intersection(outline.convex_hull)
            traces = []
            for outline in outlines:
                ring = np.arange(len(outline))
                ends = _sections(
                    outline, np.stack([ring, np.roll(ring, -1)], axis=1), place, normal
                )
                traces += [(ends.reshape(2, 3) - place) @ axes.T] if len(ends) == 2 else []
            for part in shapely.get_parts(face):
                low, high = box = np.reshape(part.bounds, (2, 2))
                through = []
                for plane in planes:
                    along = np.abs(axes[:, plane.axis]).argmax()
                    level = (plane.position - place[plane.axis]) * axes[along, plane.axis]
                    (at,) = np.nonzero(np.abs(box[:, along] - level) <= self._rounding)
                    if abs(axes[along, plane.axis]) >= 1 - ENDS and len(at):
                        box[at[0], along] = 2 * level - box[1 - at[0], along]
                        through.append((along, level))
                counts = np.maximum(
                    1, np.rint(np.linalg.norm((high - low)[:, None] * axes / cell, axis=1))
                ).astype(int)
                grid = lattice_of(*map(np.arange, counts))
                size = (high - low) / counts
                tiles = shapely.box(*(low + grid * size).T, *(low + (grid + 1) * size).T)
                whole = shapely.contains_properly(face, tiles)
                tiles = np.concatenate(
                    [tiles[whole], shapely.get_parts(shapely.intersection(tiles[~whole], part))]
                )
                for trace in traces:
                    tiles = _split(tiles, trace, np.linalg.norm(high - low))
                areas = shapely.area(tiles)
                large = areas > self._rounding * size.min()
                tiles = tiles[large]
                areas = areas[large]
                centers = shapely.get_coordinates(shapely.centroid(tiles))
                for along, level in through:
                    across = np.abs(centers[:, along] - level) < size[along] / 2
                    centers[across & (counts[along] % 2 == 1), along] = level
                yield place + centers @ axes, -side * areas[:, None] * normal

    def _depths(self, places: np.ndarray) -> np.ndarray:
        """Return the least depths of places (k, d) below the planes of reflection, shape (k,)."""
        depths = (plane.mirrored(places)[1] for plane in self._planes)
        return np.min([np.full(len(places), np.inf), *depths], axis=0)

    def _belong(self, number: int, places: np.ndarray) -> np.ndarray:
        """Return which places (k, d) on the plane of a piece belong to it: those within it, and
        those of its edge that are touched.
        """
        piece = self.pieces[number]
        found = piece.covers(places)
        edge = np.flatnonzero(~found & (piece.distances(places) <= self._rounding))
        if len(edge):
            found[edge] = self.touched(number, places[edge])
        return found & (self._depths(places) >= -self._rounding)

    def _lie_on(self, number: int, places: np.ndarray) -> np.ndarray:
        place, normal, _ = self.pieces[number].plane()
        level = np.flatnonzero(np.abs((places - place) @ normal) <= self._rounding)
        found = np.zeros(len(places), dtype=bool)
        found[level] = self._belong(number, places[level])
        return found

    def _beside(self, places: np.ndarray) -> np.ndarray:
        """Return the places (k, d), those on a cut moved to the side on which they count as
        lying.
        """
        ways = np.zeros(places.shape)
        for number in reversed(range(len(self.pieces))):
            on = self._lie_on(number, places)
            normal = self.pieces[number].plane()[1]
            ways[on] += normal
            # of two pieces with opposite sides, the first one decides
            ways[on & ~ways.any(axis=1)] = normal
        lengths = np.linalg.norm(ways, axis=1, keepdims=True)
        return places + BESIDE * self._rounding * ways / np.where(lengths > 0, lengths, 1.0)


def between_cells(pieces: Sequence[AnyPrecut], cells: Cells, rounding: float) -> list[AnyPrecut]:
    """Return the pieces, those along rows of a lattice moved to the boundary between the cells of
    the points that they part.

    A point of a lattice stands for its whole cell, so that the faces of a cut between two rows lie
    where their cells meet, wherever the cut lies between the points. Pieces that touch are moved
    together, with tips elsewhere where they are; none is if they would part.
    """
    levels = [
        [_level(piece, axis, cells, rounding) for axis in range(len(cells.sides))]
        for piece in pieces
    ]
    found = list(pieces)
    if all(level is None or level[0] == level[1] for of_piece in levels for level in of_piece):
        return found
    touching = [
        pair
        for pair in combinations(range(len(pieces)), 2)
        if _touch(*(pieces[number] for number in pair), cells, rounding)
    ]
    graph = scipy.sparse.coo_array(
        (np.ones(len(touching)), np.reshape(touching, (-1, 2)).T), shape=(len(pieces),) * 2
    )
    group_of = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    for group in range(group_of.max() + 1):
        members = np.flatnonzero(group_of == group)
        ends = np.concatenate([pieces[number].edge(min(cells.sides) / 4)[0] for number in members])
        maps = []
        for axis, of_axis in enumerate(zip(*(levels[number] for number in members), strict=True)):
            known = dict(level for level in of_axis if level)
            limits = (
                ends[:, axis].min(),
                ends[:, axis].max(),
            )
            fixed = {
                end: end
                for end in limits
                if all(abs(end - height) > cells.sides[axis] for height in known)
            }
            maps.append(sorted({**fixed, **known}.items()))

        def moved(places: np.ndarray, maps: list = maps) -> np.ndarray:
            shifts = []
            for axis, of_axis in enumerate(maps):
                heights, sides = np.transpose(of_axis)
                shifts.append(np.interp(places[:, axis], heights, sides - heights))
            return places + np.stack(shifts, axis=1)

        there = {number: pieces[number].moved(moved) for number in members}
        if all(
            _touch(there[one], there[other], cells, rounding)
            for one, other in touching
            if one in there
        ):
            for number, piece in there.items():
                found[number] = piece
    return found


def _level(
    piece: AnyPrecut, axis: int, cells: Cells, rounding: float
) -> tuple[float, float] | None:
    """Return the coordinate of a piece normal to an axis, and that of the boundary between the
    rows that it parts; None if oblique.
    """
    place, normal, size = piece.plane()
    cell = cells.sides[axis]
    if size * np.delete(np.abs(normal), axis).max() > ALONG_ROWS * cell:
        return None
    # Points on a cut count as lying on the side of its normal, so that the boundary is the one on
    # the other side.
    before = np.ceil(
        (place[axis] - cells.lower[axis] - np.sign(normal[axis]) * rounding) / cell - 0.5
    )
    parts = 0 < before < cells.counts[axis]
    return place[axis], cells.lower[axis] + cell * before if parts else place[axis]


def _touch(one: AnyPrecut, other: AnyPrecut, cells: Cells, rounding: float) -> bool:
    """Return whether two pieces touch or cross, to rounding."""
    for first, second in ((one, other), (other, one)):
        ring = second.edge(min(cells.sides) / 4)[0]
        met = np.concatenate([first.met_by(ring, np.roll(ring, -1, axis=0), rounding)[1], ring])
        if ((first.distances(met) <= rounding) & (second.distances(met) <= rounding)).any():
            return True
    return False


def _outline(piece: AnyPrecut, cell: float) -> np.ndarray:
    """Return the corners (k, 3) of a flat cut in order around it; those of a disc are ends of
    tangents, a quarter of a cell long.
    """
    places, outward, lengths = piece.edge(cell / 4)
    ways = np.cross(piece.plane()[1], outward) * lengths[:, None] / 2
    return np.stack([places - ways, places + ways], axis=1).reshape(-1, 3)


def _sections(
    nodes: np.ndarray, facets: np.ndarray, place: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """Return the places where a plane crosses sides of facets (f, m): in space the two ends of
    each segment (s, 2, 3), for sides (s, 3).
    """
    heights = (nodes - place) @ normal
    above = heights[facets] > 0
    crossed = facets[above.any(axis=1) & ~above.all(axis=1)]
    # Ends in the same order on both facets that share a side, so that neighboring segments meet to
    # the last digit.
    pairs = [(0, 1), (1, 2), (2, 0)][: 1 if facets.shape[1] == 2 else 3]
    sides = np.sort(np.stack([crossed[:, pair] for pair in pairs], axis=1), axis=2)
    first, second = sides[(heights[sides] > 0).sum(axis=2) == 1].T
    share = (heights[first] / (heights[first] - heights[second]))[:, None]
    found = nodes[first] + share * (nodes[second] - nodes[first])
    return found.reshape(-1, 2, 3) if facets.shape[1] == 3 else found


def _split(tiles: np.ndarray, trace: np.ndarray, reach: float) -> np.ndarray:
    """Return polygons in which those that a segment, `trace` (2, 2), meets are divided along its
    line; their extent is at most `reach`.
    """
    import shapely.ops  # here, because few bodies need it

    start, end = trace
    way = 2 * reach * (end - start) / np.linalg.norm(end - start)
    line = shapely.linestrings([start - way, end + way])
    met = shapely.intersects(tiles, shapely.linestrings(trace))
    divided = [shapely.get_parts(shapely.ops.split(tile, line)) for tile in tiles[met]]
    return np.concatenate([tiles[~met], *divided])
