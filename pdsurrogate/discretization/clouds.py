"""Relaxed points: an irregular cloud without rows, along which a crack could run, made by
Lloyd's method for a body of any shape.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np

from ..array_files import DamagedFile, read_arrays
from ..body import Cells
from ..engine.compile import cache_folder
from ..engine.threads import Chunks, chunks_of
from ..kernels.samples import sum_nearest
from .cells import MOST_PLACES, lattice_of, whole_and_cut

UNITS = 2**16
"""Side of a cell of the grid of samples, in the integers that all coordinates are: squared
distances over a thousand cells are exact.
"""

SAMPLES = {2: 16, 3: 8}
"""Samples along each side of a cell, by dimension."""

STEPS = {2: 10, 3: 15}
"""Steps of Lloyd's method by dimension: few, since after some hundred a plane cloud is a patchwork
of hexagonal lattices, along whose rows cracks would run. Chosen: neighbors are 0.6 spacings apart
or more, and volumes deviate by some 9 % in the plane (standard deviation).
"""

GROUP = 2
"""Cells along each side of a block, which has as many points as cells at the start. With one cell,
four directions of the grid remain visible in the cloud; with more, or with random points,
differences of density do.
"""

METRIC = 2**10
"""Factor of squared distances, with which their ratios along the axes of cells that are no
squares are rounded to integers.
"""

MOST_THREADS = 8
CHUNKS = 256
"""Greatest number of threads, each of which needs memory for sums at all points, and number of
parts of the grid that they share.
"""

FORMAT = 1
"""Version of the algorithm, a part of the digest of kept clouds."""

LEAST_KEPT = 20_000
"""Least number of points of a cloud that is kept on disk; smaller ones are made within a second."""


def relaxed_points(
    cells: Cells,
    material: Callable[[np.ndarray], np.ndarray],
    spacing: float,
    seed: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and volumes of a cloud in a body, the same on every machine and on any
    number of threads and ranks.

    The body is represented by samples on a fine raster. The points start at samples that are drawn
    with `seed`, equally many in equal volumes. In each step a point moves to the centroid of the
    samples that are nearer to it than to any other point.

    Parameters
    ----------
    cells : Cells
        Grid of cells about as large as a point's volume that fill the box around the body.
    material : callable
        ``material(places)`` flags places, shape (k, d), in material.
    spacing : float
        Mean distance of neighboring points; their number is that of squares or cubes with this side
        that fill the body.
    seed : int
        Number of the cloud; other seeds give other clouds.
    """
    samples = Samples.of(cells, material)
    n = max(1, round(samples.total * samples.volume / spacing ** len(cells.counts)))
    path = _path_of(samples, n, seed) if n >= LEAST_KEPT else None
    found = None if path is None else _kept(path)
    if found is None:
        found = samples.relaxed(samples.start(n, seed))
        if path is not None:
            _keep(path, found)
    points = found[:, :-1]
    numbers = found[:, -1]
    return np.array(cells.lower) + points / UNITS * np.array(cells.sides), numbers * samples.volume


def nearest_volumes(
    cells: Cells,
    material: Callable[[np.ndarray], np.ndarray],
    points: np.ndarray,
) -> np.ndarray:
    """Return the volumes of a part of the body nearest to each of its points, shape (n,); for
    the part see `relaxed_points`.
    """
    samples = Samples.of(cells, material)
    places = np.zeros((len(points), 3))
    places[:, : points.shape[1]] = np.rint(
        (points - np.array(cells.lower)) / np.array(cells.sides) * UNITS
    )
    sorted_places, sums = samples.sums(places)
    volumes = np.empty(len(points))
    volumes[np.lexsort(places.T)] = sums[np.lexsort(sorted_places.T), 0]
    return np.maximum(volumes, 1) * samples.volume


@dataclass(frozen=True)
class Samples:
    """Samples of a body: a raster in each cell of a grid, of which those in material count.

    Attributes
    ----------
    cells : Cells
    raster : ndarray, shape (3, k)
        Places of the samples in a cell, in `UNITS`, 0 along x3 in the plane.
    kinds : ndarray of int, shape (cells,)
        Row of each cell in `masks`; -1 for cells that lie in material, -2 for cells without.
    masks : ndarray of uint8, shape (m, k)
        Flags of the samples in material.
    """

    cells: Cells
    raster: np.ndarray
    kinds: np.ndarray
    masks: np.ndarray

    @classmethod
    def of(cls, cells: Cells, material: Callable[[np.ndarray], np.ndarray]) -> Samples:
        """Return the samples of a body; for the arguments see `relaxed_points`."""
        whole, cut = whole_and_cut(cells, material)
        d = len(cells.counts)
        sides = np.array(cells.sides)
        centers = cells.centers()
        width = SAMPLES[d]
        along = (2 * np.arange(width) + 1) * (UNITS // width // 2)
        raster = np.zeros((3, width**d))
        raster[:d] = lattice_of(*[along] * d).T[::-1]
        places = (raster[:d].T / UNITS - 0.5) * sides
        masks = np.zeros((len(cut), width**d), dtype=np.uint8)
        for some in np.array_split(np.arange(len(cut)), masks.size // MOST_PLACES + 1):
            masks[some] = material((centers[cut[some], None] + places).reshape(-1, d)).reshape(
                -1, width**d
            )
        kinds = np.where(whole, -1, -2)
        kinds[cut] = np.arange(len(cut))
        return cls(cells, raster, kinds, masks)

    @property
    def volume(self) -> float:
        """Volume of a sample."""
        return self.cells.volume / self.raster.shape[1]

    @cached_property
    def counts(self) -> np.ndarray:
        """Number of samples in material in each cell."""
        counts = np.where(self.kinds == -1, self.raster.shape[1], 0)
        counts[self.kinds >= 0] = self.masks.sum(axis=1)[self.kinds[self.kinds >= 0]]
        return counts

    @cached_property
    def total(self) -> int:
        """Number of all samples in material."""
        return int(self.counts.sum())

    def start(self, n: int, seed: int) -> np.ndarray:
        """Return n different samples, shape (n, 3), drawn so that blocks of equal volume have
        equal numbers, see `GROUP`.
        """
        size = GROUP ** len(self.cells.counts)
        grid = (*self.cells.counts, 1)[:3]
        number = np.arange(len(self.counts))
        place = np.stack(
            [number % grid[0], number // grid[0] % grid[1], number // (grid[0] * grid[1])]
        )
        by_block = np.lexsort(place // GROUP)
        ends = np.cumsum(self.counts[by_block])
        point = np.arange(n, dtype=np.int64)
        # The samples of a block are dealt to its points in turn, so that no two points draw the
        # same.
        begin = point // size * size
        turn = point % size
        low = begin * self.total // n
        deals = (np.minimum(begin + size, n) * self.total // n - low) // np.minimum(size, n - begin)
        draws = np.random.PCG64(seed).random_raw(n)
        chosen = (
            low
            + (draws % deals.astype(np.uint64)).astype(np.int64) * np.minimum(size, n - begin)
            + turn
        )
        block = np.searchsorted(ends, chosen, side="right")
        cell = by_block[block]
        within = chosen - (ends - self.counts[by_block])[block]
        cut = np.flatnonzero(self.kinds[cell] >= 0)
        within[cut] = (self.masks[self.kinds[cell[cut]]].cumsum(axis=1) <= within[cut, None]).sum(
            axis=1
        )
        return UNITS * place[:, cell].T + self.raster[:, within].T

    def relaxed(self, points: np.ndarray) -> np.ndarray:
        """Return points after steps of Lloyd's method, and the numbers of the samples nearest to
        them, shape (n, d + 1).
        """
        d = len(self.cells.counts)
        for step in range(STEPS[d] + 1):
            points, sums = self.sums(points)
            used = sums[:, 0] > 0  # beside thin gaps a point may have moved out of the body
            points = points[used]
            sums = sums[used]
            if step < STEPS[d]:
                points = np.rint(sums[:, 1:] / sums[:, :1])
        return np.column_stack([points[:, :d], sums[:, 0]])

    def sums(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return points (n, 3) sorted by cells, and the number and summed coordinates of the
        samples nearest to each, shape (n, 4).
        """
        grid = (*self.cells.counts, 1)[:3]
        ratios = (np.array(self.cells.sides) / min(self.cells.sides)) ** 2
        metric = (*(float(ratio) for ratio in np.rint(METRIC * ratios)), 0.0)[:3]
        chunks = Chunks(min(chunks_of(0).threads, MOST_THREADS), CHUNKS)
        place = np.clip(points // UNITS, 0, np.array(grid) - 1).astype(np.int64)
        cell = (place[:, 2] * grid[1] + place[:, 1]) * grid[0] + place[:, 0]
        order = np.argsort(cell, kind="stable")
        points = np.ascontiguousarray(points[order])
        starts = np.searchsorted(cell[order], np.arange(len(self.kinds) + 1))
        buffers = np.zeros((chunks.threads, 2, self.raster.shape[1]))
        sums = np.zeros((chunks.threads, len(points), 4))
        arrays = (
            points,
            starts,
            (*grid, UNITS),
            metric,
            self.raster,
            self.kinds,
            self.masks,
            buffers,
            sums,
        )
        sum_nearest.bind(*arrays, chunks=chunks)()
        return points, sums.sum(axis=0)


def _path_of(samples: Samples, n: int, seed: int) -> Path | None:
    """Return the file that keeps a cloud, beside the compiled code; None if no folder can be
    written to.
    """
    folder = cache_folder(relaxed_points)
    settings = (
        FORMAT,
        UNITS,
        METRIC,
        GROUP,
        STEPS,
        n,
        seed,
        samples.cells.counts,
        samples.cells.sides,
    )
    parts = (
        repr(settings).encode(),
        samples.raster.tobytes(),
        samples.kinds.tobytes(),
        samples.masks.tobytes(),
    )
    return folder and folder / f"cloud-{hashlib.sha256(b''.join(parts)).hexdigest()[:40]}.npz"


def _kept(path: Path) -> np.ndarray | None:
    """Return the cloud in a file; None if there is none, or the file is damaged."""
    with suppress(OSError, DamagedFile, KeyError), path.open("rb") as file:
        return read_arrays(file)["cloud"]
    return None


def _keep(path: Path, cloud: np.ndarray) -> None:
    """Write a cloud to a file, whole or not at all; a folder that cannot be written to keeps
    none.
    """
    with suppress(OSError):
        with NamedTemporaryFile(dir=path.parent, delete=False) as file:
            np.savez(file, cloud=cloud)
        os.replace(file.name, path)
