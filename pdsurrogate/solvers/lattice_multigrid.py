"""Multigrid on lattices of cells by stencils, for networks of springs between their points."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ..body import Body
from ..engine.block_arrays import power_of_two
from ..engine.passes import BoundPass, Chain
from ..engine.threads import chunks_of
from ..kernels.stencils import passes_of

FEW = 400
"""Greatest number of cells of a level whose matrix is inverted as a dense array: the inverse takes
some 10 ms, and a product with it less than the levels above.
"""

SWEEPS = 4
"""Relaxations of all cells before and after the next level. Chosen: with 2, 3 and 4 the scene
`uniaxial` needs 63, 62 and 62 evaluations (with exact energies 61, 56 and 52), with a factor 58
(44).
"""

MOST_EMPTY = 8
"""Greatest number of cells, divided by that of the points, of the box around a body that is solved
for as a lattice. Chosen: a cycle over so many cells takes as long as one force evaluation.
"""


class Lattice(NamedTuple):
    """Scalar network of springs between the cells of a lattice, x1 along the last axis.

    Attributes
    ----------
    couplings : ndarray, shape (d, ..., n_2, n_1)
        Stiffness of the spring between each cell and the next one along each axis.
    grounds : ndarray, shape (d, ..., n_2, n_1)
        Stiffness of the springs from each cell along each axis to the ground.
    shifts : ndarray, shape (..., n_2, n_1)
        Further entries on the diagonal of the matrix, such that it has an inverse.
    free : ndarray of bool, shape (..., n_2, n_1)
        Whether the cell has an unknown; others are empty or held.
    """

    couplings: np.ndarray
    grounds: np.ndarray
    shifts: np.ndarray
    free: np.ndarray

    def diagonal(self) -> np.ndarray:
        """Return the diagonal of the matrix, 0 in cells without unknown."""
        found = self.shifts + self.grounds.sum(axis=0) + self.couplings.sum(axis=0)
        for axis, along in enumerate(self.couplings):
            target, values = _along(axis, found, along)
            target[1:] += values[:-1]
        return found * self.free

    def coarser(self) -> Lattice:
        """Return the network of cells that consist of two cells along each axis.

        The springs between two of them, and to the ground, are those of their cells, made longer
        at each end by half the distance of the cell from the one beside it in the same coarse cell,
        if a spring joins these two.
        """
        odd = [(0, count % 2) for count in self.free.shape]
        shape = [part for count in self.free.shape for part in (-(-count // 2), 2)]
        within = tuple(range(1, len(shape), 2))
        free = np.pad(self.free, odd)
        found = np.empty((2, len(self.couplings), *shape[::2]))
        for axis in range(len(self.couplings)):
            between, ground = np.pad([self.couplings[axis], self.grounds[axis]], [(0, 0), *odd])
            moves, joined, held = _along(axis, free, between, ground)
            pinned = joined[:-1] * (moves[:-1] ^ moves[1:])
            held[:-1] += pinned
            held[1:] += pinned
            held *= moves
            joined[:-1] -= pinned
            half = np.repeat(0.5 * inverted(joined[::2]), 2, axis=0)
            joined[::2] = 0.0
            way = np.zeros_like(joined)
            way[1:-1:2] = half[1:-1:2] + half[2::2]
            for values, more in ((joined, way), (held, half)):
                values /= 1.0 + values * more  # springs in series
            for coarse, fine in zip(found[:, axis], (between, ground), strict=True):
                fine.reshape(shape).sum(axis=within, out=coarse)
        shifts = np.pad(self.shifts * self.free, odd).reshape(shape).sum(axis=within)
        return Lattice(*found, shifts, free.reshape(shape).any(axis=within))

    def inverse(self) -> np.ndarray:
        """Return the inverse of the matrix as a dense array, 0 for cells without unknown."""
        free = self.free.ravel()
        matrix = np.diag(np.where(free, self.diagonal().ravel(), 1.0))
        stride = 1
        for along, count in zip(self.couplings, self.free.shape[::-1], strict=True):
            rows = np.flatnonzero(free[:-stride] & free[stride:])
            matrix[rows, rows + stride] = matrix[rows + stride, rows] = -along.ravel()[rows]
            stride *= count
        inverse = np.linalg.inv(matrix) * (free & free[:, None])
        return (inverse + inverse.T) / 2


def inverted(values: np.ndarray) -> np.ndarray:
    """Return 1/x, and 0 where x is 0."""
    return np.divide(1.0, values, out=np.zeros_like(values), where=values != 0)


def _along(axis: int, *arrays: np.ndarray) -> list[np.ndarray]:
    """Return views of arrays over cells that have an axis of the lattice as their first one."""
    return [np.moveaxis(values, -1 - axis, 0) for values in arrays]


class _Level:
    """Numbers and vectors of a level in single precision, see `kernels/stencils.py`."""

    def __init__(self, lattice: Lattice, unit: float) -> None:
        shape = lattice.free.shape
        size = lattice.free.size
        margin = size // shape[0]
        self.cells = slice(margin, margin + size)

        def padded(values: np.ndarray) -> np.ndarray:
            rows = values.reshape(-1, size).astype(np.float32)
            return np.pad(rows, [(0, 0), (margin, margin)])

        self.place = (*shape[::-1], 1)[:3], margin
        self.couplings = padded(lattice.couplings / unit)
        self.inverse = padded(inverted(lattice.diagonal() / unit))[0]
        self.right, self.found, self.rest = np.zeros((3, size + 2 * margin), dtype=np.float32)


class LatticeMultigrid:
    """Approximate inverse of the stiffness of a network on a lattice: a V cycle over lattices of
    cells twice as long, with Gauss-Seidel's relaxation of a checkerboard.

    The cycle is a fixed operator in single precision, symmetric and positive definite. Corrections
    are interpolated linearly between the centers of cells that springs join.

    Parameters
    ----------
    lattice : Lattice

    References
    ----------
    Mohr and Wienands, Computing and Visualization in Science 7 (2004) 129-140.
    """

    def __init__(self, lattice: Lattice) -> None:
        passes = passes_of(len(lattice.couplings))
        # A power of two scales into the range of single precision, in any units, without rounding.
        self._unit = power_of_two(float(lattice.couplings.max()))
        self._levels = [_Level(lattice, self._unit)]
        down: list[BoundPass] = []
        up: list[BoundPass] = []
        while lattice.free.size > FEW:
            fine = self._levels[-1]
            lattice = lattice.coarser()
            coarse = _Level(lattice, self._unit)
            self._levels.append(coarse)
            chunks = chunks_of(fine.right.size)
            system = *fine.place, fine.couplings, fine.inverse
            relaxations = [
                passes.relax.bind(*system, fine.right, fine.found, color, chunks=chunks)
                for color in (0, 1)
            ] * SWEEPS
            between = *system, fine.rest, *coarse.place
            down += [
                *relaxations,
                passes.residual.bind(*system, fine.right, fine.found, fine.rest, chunks=chunks),
                passes.restrict.bind(*between, coarse.right, chunks=chunks),
            ]
            up = [
                passes.inject.bind(*between, coarse.found, chunks=chunks),
                passes.correct.bind(*system, fine.rest, fine.found, chunks=chunks),
                *reversed(relaxations),
                *up,
            ]
        self._chains = [Chain(*some) for some in (down, up) if some]
        self._last = (lattice.inverse() * self._unit).astype(np.float32)

    def cycle(self, right: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """Return the approximate solution at `cells` (n,) for forces (n,) on them, 0 on others."""
        unit = power_of_two(float(np.abs(right).max(initial=0.0)))
        first, *_, last = self._levels[0], self._levels[-1]
        places = first.cells.start + cells
        first.right[places] = right / unit
        for level in self._levels:
            level.found[:] = 0.0
        for chain in self._chains[:1]:
            chain()
        last.found[last.cells] = self._last @ last.right[last.cells]
        for chain in self._chains[1:]:
            chain()
        return first.found[places] * (unit / self._unit)


def cycles_of(
    body: Body,
    springs: Callable[[int], Iterator[tuple[np.ndarray, ...]]],
    free: np.ndarray,
    shift: float,
) -> Callable[[np.ndarray], np.ndarray] | None:
    """Return the approximate inverse of the stiffness of springs by a cycle for each component,
    None if the body is no lattice or fills too little of its box.

    Parameters
    ----------
    body : Body
    springs : callable
        ``springs(axis)`` yields the springs part by part, see `NearestBonds.on_axis`. Oblique
        springs do not couple components here.
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    shift : float
        Fraction of the mean diagonal entry that is added to the diagonal.
    """
    places = np.rint((body.points - body.points.min(axis=0)) / body.cell).astype(np.int32)
    counts = tuple((places.max(axis=0) + 1).tolist())
    cells = np.ravel_multi_index(tuple(places.T), counts, order="F").astype(np.int32)
    size = math.prod(counts)
    if size > MOST_EMPTY * len(cells) or np.bincount(cells).max() > 1:
        return None
    cycles = []
    for component, moving in enumerate(free.T):
        couplings, grounds = np.zeros((2, len(counts), size))
        for first, second, sources, stiffness, sign in springs(component):
            image = second >= len(body)
            start = places[first]
            steps = places[sources] - start
            # The image of another point, and its image of this one, are half a spring each.
            joined = stiffness * np.where(image, 0.5 * (sign > 0), 1.0)
            add_couplings(start, steps, joined, counts, couplings)
            ends = np.flatnonzero(np.where(sources == first, sign < 1, sign < 0))
            first, second, sign = first[ends], second[ends], sign[ends]
            held = stiffness[ends] * np.where(sources[ends] == first, 1 - sign, 1.0)
            axis = np.abs(body.all_points[second] - body.points[first]).argmax(axis=1)
            np.add.at(grounds, (axis, cells[first]), held)
        shape = counts[::-1]
        lattice = Lattice(
            couplings.reshape(-1, *shape),
            grounds.reshape(-1, *shape),
            np.zeros(shape),
            np.ones(shape, dtype=bool),
        )
        diagonal = lattice.diagonal()
        moves = diagonal > 0  # also empty cells that springs go through
        moves.ravel()[cells] = moving > 0
        lattice.shifts.ravel()[cells] = shift * diagonal.mean()
        cycles.append(LatticeMultigrid(lattice._replace(free=moves)).cycle)

    def solve(forces: np.ndarray) -> np.ndarray:
        found = np.empty_like(forces)
        for component, cycle in enumerate(cycles):
            found[:, component] = cycle(forces[:, component], cells)
        return found

    return solve


def add_couplings(
    places: np.ndarray,
    steps: np.ndarray,
    stiffness: np.ndarray,
    counts: tuple[int, ...],
    out: np.ndarray,
) -> None:
    """Add the couplings of cells (see `Lattice`) for springs between places (k, d) and others,
    `steps` (k, d) away, to `out` (d, cells), and change these arrays in place; a spring between
    cells that do not touch becomes springs in series along axes.
    """
    stiffness = stiffness * np.abs(steps).sum(axis=1)
    for axis in range(len(counts)):
        while (moving := np.flatnonzero(steps[:, axis])).size:
            sign = np.sign(steps[moving, axis])
            lower = places[moving]
            lower[:, axis] -= sign < 0
            cells = np.ravel_multi_index(tuple(lower.T), counts, order="F")
            out[axis] += np.bincount(cells, stiffness[moving], out.shape[1])
            places[moving, axis] += sign
            steps[moving, axis] -= sign
