"""Material in the cells of a grid: which cells a boundary cuts, and what the points of a lattice
are there.
"""

from collections.abc import Callable

import numpy as np
import scipy

from ..body import Cells
from ..body.body import owners_and_items

RASTER = 16
"""Number of sampled places along each side of a cell in the plane, which determine the area of
its material to some 1/1000 of a cell.
"""

SCATTERED = 128
"""Number of sampled places in one eighth of a 3D cell, with mirror images in the others. No two in
an eighth have equal coordinates along an axis: the volume on one side of a plane normal to an axis
is found to within 1/40 of a cell.
"""

WITHIN = 1 - 1e-6
"""Share of the way from the middle of a cell to its corners, edges and faces at which material is
tested: a little inside, so that a boundary between two cells cuts neither.
"""

ROOT_OF_CUBES = 1.2207440846057596
"""Root g of g^4 = g + 1: multiples of its first three inverse powers fill a cube evenly (the
sequence of which the plastic number is the member for a square).
"""

MOST_PLACES = 1_000_000
"""Number of places on bonds, or in cells, tested together. Chosen: in three dimensions their
coordinates take 24 MB; larger numbers only take more memory.
"""

TIED = 1e-6
"""Relative difference of distances up to which points are equally near to a part of a cell, which
is then divided among them: on the diagonal of a circle rounding, and so the unit of length, would
otherwise choose one of two. Chosen: far above rounding, and far below the distance of sampled
places.
"""


def lattice_of(*axes: np.ndarray) -> np.ndarray:
    """Return the places with all combinations of the given coordinates along each axis, shape (k,
    d); the last coordinate varies fastest.
    """
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def raster_of(dimension: int) -> np.ndarray:
    """Return places in a cell, relative to its middle in units of its sides, that sample the share
    of material in it.
    """
    if dimension == 2:
        return lattice_of(*[(np.arange(RASTER) + 0.5) / RASTER - 0.5] * 2)
    # Multiples of the powers of 1/g, g^4 = g + 1, fill a cube evenly.
    eighth = (0.5 + np.arange(SCATTERED)[:, None] * ROOT_OF_CUBES ** -np.arange(1.0, 4.0)) % 1 / 2
    return (lattice_of(*[[-1, 1]] * 3)[:, None] * eighth).reshape(-1, 3)


def whole_and_cut(
    cells: Cells, material: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return flags of the cells that lie in material, and the numbers of the cells that a boundary
    cuts.

    ``material(places)`` flags the places, shape (k, d), in material.
    """
    centers = cells.centers()
    sides = np.array(cells.sides)
    whole = material(centers)
    some = whole.copy()
    for way in lattice_of(*[[-1, 0, 1]] * len(sides)):
        if way.any():
            there = material(centers + WITHIN / 2 * way * sides)
            whole &= there
            some |= there
    return whole, np.flatnonzero(some & ~whole)


def material_of_cells(
    cells: Cells, material: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return centroids and volumes of the material in each cell; a cell less than half full is
    merged into the nearest other cells.

    A raster of places in each cell that a boundary cuts determines its volume of material. If cells
    were kept or left out whole, a curved boundary would be a staircase, whose steps carry no
    stress, and a hole would be larger than it is.
    """
    raster = raster_of(len(cells.sides)) * cells.sides
    all_there, cut = whole_and_cut(cells, material)
    points = cells.centers()
    volumes = np.where(all_there, cells.volume, 0.0)
    for some in np.array_split(cut, len(cut) * len(raster) // MOST_PLACES + 1):
        samples = points[some, None] + raster
        there = material(samples.reshape(-1, raster.shape[1])).reshape(samples.shape[:2])
        points[some] = np.einsum("cs,csd->cd", there, samples) / np.maximum(
            there.sum(axis=1, keepdims=True), 1
        )
        volumes[some] = cells.volume * there.mean(axis=1)
    whole = np.flatnonzero(volumes >= 0.5 * cells.volume)
    slivers = np.flatnonzero((volumes > 0) & (volumes < 0.5 * cells.volume))
    if not len(whole):
        whole, slivers = slivers, whole
    if len(slivers):
        giver, heir, share = nearest_of(points[whole], points[slivers])
        moments = volumes[:, None] * points
        for sums in (volumes, moments):
            np.add.at(sums, whole[heir], (share * sums[slivers[giver]].T).T)
        points[whole] = moments[whole] / volumes[whole, None]
    return points[whole], volumes[whole]


def nearest_of(points: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the numbers of places, those of the points nearest to each, and the share of each of
    these: the same for all that are equally near (`TIED`).
    """
    tree = scipy.spatial.cKDTree(points)
    place, point = owners_and_items(
        tree.query_ball_point(places, tree.query(places)[0] * (1 + TIED))
    )
    return place, point, 1 / np.bincount(place)[place]
