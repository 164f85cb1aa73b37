"""Precuts of a scene together: which bonds they cross, and where their ends and edges are touched."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from ..kernels.polygons import encloses
from ..scenes.shapes import ENDS
from ..scenes.solids import AnyPrecut

BESIDE = 8.0
"""Distance, in those within which places coincide, by which points on a cut are moved to its side. A piece may end one such distance beyond
the cut on which it ends, and another one belongs to it there, so that points must be moved by more than three; where the normals of two
pieces that meet form an angle of 90 degrees, by more than 4.2."""

Crosses = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function that takes starts and ends of segments (k, d) and returns flags (k,) of those that cross a cut."""


class Cuts:
    """Cuts of a body, together: a bond is cut if it crosses one of the pieces, or meets an end at which a piece touches something else.

    Pieces touch where they coincide to rounding. A bond that meets the free end of a piece, a tip, is not cut.

    Parameters
    ----------
    pieces : sequence of Precut, ParallelogramCut or DiscCut
    rounding : float
        Distance within which places coincide.
    inside : callable
        ``inside(places)`` returns whether places (k, d) lie in the body, shape (k,).

    Attributes
    ----------
    beside : float
        Distance from a cut of places that lie beside it and not on it, far below all lengths of a body.
    pieces
    """

    def __init__(self, pieces: Sequence[AnyPrecut], rounding: float, inside: Callable[[np.ndarray], np.ndarray]) -> None:
        self.pieces, self._rounding, self._inside = pieces, rounding, inside
        self.beside = 4 * BESIDE * rounding

    def touched(self, number: int, places: np.ndarray) -> np.ndarray:
        """Return which places (k, d) on a piece, given by its number, another piece touches or the boundary of the body."""
        axes = np.eye(places.shape[1])
        touched = np.zeros(len(places), dtype=bool)
        for step in (*axes, *-axes):
            touched |= ~self._inside(places + self._rounding * step)
        for other, piece in enumerate(self.pieces):
            if other != number:
                touched |= piece.distances(places) <= self._rounding
        return touched

    def crosses(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return which segments from `starts` to `ends` (k, d) are cut.

        Points on a cut count as lying to the left of each piece on which they are, in space on the side of its normal.
        """
        near, beside = np.zeros(len(starts), dtype=bool), BESIDE * self._rounding
        for piece in self.pieces:
            place, normal, _ = piece.plane()
            heights = (starts - place) @ normal, (ends - place) @ normal
            near |= (np.minimum(*heights) <= beside) & (np.maximum(*heights) >= -beside)
        chosen, crossing = np.flatnonzero(near), np.zeros(len(starts), dtype=bool)
        one, other = self._beside(starts[chosen]), self._beside(ends[chosen])
        for number, piece in enumerate(self.pieces):
            apart, meets = piece.met_by(one, other, self._rounding)
            crossing[chosen[apart]] |= self._belong(number, meets)
        return crossing

    def on(self, places: np.ndarray) -> np.ndarray:
        """Return which places (k, d) lie on a cut, to rounding; free ends are not part of it."""
        return np.any([self._lie_on(number, places) for number in range(len(self.pieces))], axis=0)

    def straight_parts(self, boundary: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Yield the straight parts of plane cuts, between ends, places where pieces meet, and the boundary of the body.

        Each is given by the number of its piece and its two ends (2, 2). Parts outside the body, of which `boundary` are the two ends of
        each facet (f, 2, 2), are left out.
        """
        for number, piece in enumerate(self.pieces):
            ends = piece.edge(1.0)[0]
            start, along = ends[0], ends[1] - ends[0]
            length = float(np.linalg.norm(along))
            shares = [0.0, 1.0]
            for other in (piece for index, piece in enumerate(self.pieces) if index != number):
                theirs = other.edge(1.0)[0]
                met = [piece.met_by(theirs[:1], theirs[1:], self._rounding)[1], theirs]
                places = np.concatenate(met)
                places = places[(piece.distances(places) <= self._rounding) & (other.distances(places) <= self._rounding)]
                shares += ((places - start) @ along / length**2).tolist()
            starts, sides = boundary[:, 0] - start, boundary[:, 1] - boundary[:, 0]
            across = along[0] * sides[:, 1] - along[1] * sides[:, 0]
            with np.errstate(divide="ignore", invalid="ignore"):
                share = (starts[:, 0] * sides[:, 1] - starts[:, 1] * sides[:, 0]) / across
                of_side = (starts[:, 0] * along[1] - starts[:, 1] * along[0]) / across
            shares += share[(of_side >= -ENDS) & (of_side <= 1 + ENDS) & (share > 0) & (share < 1)].tolist()
            shares = np.unique(np.clip(shares, 0, 1))
            for low, high in pairwise(shares[np.append(True, np.diff(shares) > self._rounding / length)]):
                part = start + np.array([[low], [high]]) * along
                if encloses(part.mean(axis=0)[None], boundary[:, 0], boundary[:, 1])[0]:
                    yield number, part

    def _belong(self, number: int, places: np.ndarray) -> np.ndarray:
        """Return which places (k, d) on the plane of a piece belong to it: those within it, and those of its edge that are touched."""
        piece = self.pieces[number]
        found = piece.covers(places)
        edge = np.flatnonzero(~found & (piece.distances(places) <= self._rounding))
        if len(edge):
            found[edge] = self.touched(number, places[edge])
        return found

    def _lie_on(self, number: int, places: np.ndarray) -> np.ndarray:
        place, normal, _ = self.pieces[number].plane()
        level = np.flatnonzero(np.abs((places - place) @ normal) <= self._rounding)
        found = np.zeros(len(places), dtype=bool)
        found[level] = self._belong(number, places[level])
        return found

    def _beside(self, places: np.ndarray) -> np.ndarray:
        """Return the places (k, d), those on a cut moved to the side on which they count as lying."""
        ways = np.zeros(places.shape)
        for number in reversed(range(len(self.pieces))):
            on, normal = self._lie_on(number, places), self.pieces[number].plane()[1]
            ways[on] += normal
            ways[on & ~ways.any(axis=1)] = normal  # of two pieces with opposite sides, the first one decides
        lengths = np.linalg.norm(ways, axis=1, keepdims=True)
        return places + BESIDE * self._rounding * ways / np.where(lengths > 0, lengths, 1.0)
