"""Round interfaces between the materials of a scene, and the cells of a lattice that they
divide.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from ..body import Round
from ..body.body import lengths_of, owners_and_items
from ..scenes import Region, Scene
from .cells import MOST_PLACES, nearest_of
from .chains import ROUNDING


def round_interfaces(scene: Scene) -> tuple[Round, ...]:
    """Return the circles or spheres that bound regions of a scene's `materials`, each once."""
    found = (shape for part in scene.materials for shape in _round_shapes(scene, part.region))
    return tuple(dict.fromkeys(Round(tuple(shape.center), shape.radius) for shape in found))


def _round_shapes(scene: Scene, reference: str | Region) -> Iterator:
    """Yield the discs and balls of which a region of the scene, given itself or by name,
    consists.
    """
    region = scene.regions.get(reference) if isinstance(reference, str) else reference
    if region is not None:
        yield from (shape for shape in (region.disc, region.ball) if shape is not None)
        for _, member in region.members():
            yield from _round_shapes(scene, member)


def sides_of(
    places: np.ndarray, rounds: Sequence[Round], raster: np.ndarray | None = None
) -> np.ndarray:
    """Number the sides of round interfaces on which places (k, d) lie, shape (k,), or those of a
    `raster` (m, d) about each, shape (k, m).

    Two places have the same number if they lie within the same circles or spheres. A place on an
    interface, to rounding, lies within it, as in the region that it bounds.
    """
    around = np.zeros((1, places.shape[1])) if raster is None else raster
    numbers = np.zeros((len(places), len(around)), dtype=np.int64)
    centers, radii = _arrays_of(rounds)
    limits = radii * (1 + ROUNDING)
    reach = np.linalg.norm(around, axis=1).max() * (1 + ROUNDING)
    row, which = _beside(places, rounds, limits + reach)
    away = np.linalg.norm(places[row, None] + around - centers[which, None], axis=2)
    # Sums of random numbers of 62 bits differ where different shapes contain places.
    keys = np.random.default_rng(0).integers(2**62, size=len(rounds))
    np.add.at(numbers, row, (away <= limits[which, None]) * keys[which, None])
    return numbers[:, 0] if raster is None else numbers


def _arrays_of(rounds: Sequence[Round]) -> tuple[np.ndarray, np.ndarray]:
    """Return the centers (r, d) and radii (r,) of round shapes."""
    return np.array([each.center for each in rounds]), np.array([each.radius for each in rounds])


def _beside(
    places: np.ndarray, rounds: Sequence[Round], limits: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return all places within `limits` (r,) of the centers of round shapes, and the number of
    the shape of each, sorted by place.
    """
    which, row = owners_and_items(
        scipy.spatial.cKDTree(places).query_ball_point([each.center for each in rounds], limits)
    )
    order = np.argsort(row, kind="stable")
    return row[order], which[order]


def divided_volumes(
    points: np.ndarray,
    volumes: np.ndarray,
    sides: np.ndarray,
    raster: np.ndarray,
    rounds: Sequence[Round],
) -> np.ndarray:
    """Return volumes of the points of a lattice, shape (n,), so that the points on each side of
    round interfaces have its whole volume.

    The point of a cell that an interface divides keeps the part of the cell on its own side. The
    other parts go to the nearest points of theirs. Cells that the boundary of the body cuts remain
    as they are.

    Parameters
    ----------
    points, volumes : ndarray, shapes (n, d) and (n,)
        Centers of whole cells, and centroids of the material in cells that the boundary cuts.
    sides : ndarray, shape (d,)
        Sides of a cell.
    raster : ndarray, shape (m, d)
        Places in a cell, relative to its middle in units of its sides, that sample its parts.
    rounds : sequence of Round
    """
    half = np.linalg.norm(sides) / 2
    found = volumes.copy()
    centers, radii = _arrays_of(rounds)
    row, which = _beside(points, rounds, radii + half)
    row = np.unique(row[lengths_of(points[row] - centers[which]) > radii[which] - half])
    whole = np.flatnonzero(np.isclose(volumes, sides.prod(), rtol=1e-9, atol=0))
    cut = np.intersect1d(row, whole)
    own = sides_of(points, rounds)
    for cells in np.array_split(cut, len(cut) * len(raster) // MOST_PLACES + 1):
        numbers = sides_of(points[cells], rounds, raster * sides)
        while len(cells):
            # The first part of each cell on another side goes to the nearest points there.
            elsewhere = numbers != own[cells, None]
            left = elsewhere.any(axis=1)
            cells = cells[left]
            numbers = numbers[left]
            elsewhere = elsewhere[left]
            other = numbers[np.arange(len(cells)), elsewhere.argmax(axis=1)]
            part = numbers == other[:, None]
            middles = points[cells] + part @ (raster * sides) / part.sum(axis=1, keepdims=True)
            for side in np.unique(other):
                mine = other == side
                heirs = whole[own[whole] == side]
                if not len(heirs):  # an inclusion smaller than a cell has no point
                    continue
                giver, heir, share = nearest_of(points[heirs], middles[mine])
                volume = sides.prod() * part[mine].mean(axis=1)
                found[cells[mine]] -= volume
                np.add.at(found, heirs[heir], share * volume[giver])
            numbers = np.where(part, own[cells, None], numbers)
    return found
