"""Round interfaces between the materials of a scene, and the cells of a lattice that they divide."""

from collections.abc import Iterator, Sequence

import numpy as np

from ..body import Round
from ..scenes import Region, Scene
from .chains import ROUNDING

TIED = 1e-6
"""Relative difference of distances up to which points are equally near to a part of a cell, which is then divided among them: on the
diagonal of a circle rounding, and so the unit of length, would otherwise choose one of two. Chosen: far above rounding, and far below the
distance of sampled places."""


def round_interfaces(scene: Scene) -> tuple[Round, ...]:
    """Return the circles or spheres that bound regions of a scene's `materials`, each once."""
    found = (shape for part in scene.materials for shape in _round_shapes(scene, part.region))
    return tuple(dict.fromkeys(Round(tuple(shape.center), shape.radius) for shape in found))


def _round_shapes(scene: Scene, reference: str | Region) -> Iterator:
    """Yield the discs and balls of which a region of the scene, given itself or by name, consists."""
    region = scene.regions.get(reference) if isinstance(reference, str) else reference
    if region is not None:
        yield from (shape for shape in (region.disc, region.ball) if shape is not None)
        for _, member in region.members():
            yield from _round_shapes(scene, member)


def sides_of(places: np.ndarray, rounds: Sequence[Round]) -> np.ndarray:
    """Number the sides of round interfaces on which places (k, d) lie, by the bits of one integer, shape (k,).

    A place on an interface, to rounding, lies within it, as in the region that it bounds.
    """
    return (1 << np.arange(len(rounds))) @ np.array([each.distances(places) <= ROUNDING * each.radius for each in rounds])


def divided_volumes(points: np.ndarray, volumes: np.ndarray, sides: np.ndarray, raster: np.ndarray, rounds: Sequence[Round]) -> np.ndarray:
    """Return volumes of the points of a lattice, shape (n,), so that the points on each side of round interfaces have its whole volume.

    The point of a cell that an interface divides keeps the part of the cell on its own side. The other parts go to the nearest points of
    theirs. Cells that the boundary of the body cuts remain as they are.

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
    whole = np.isclose(volumes, sides.prod(), rtol=1e-9, atol=0)
    near = np.min([np.abs(each.distances(points)) for each in rounds], axis=0) < np.linalg.norm(sides) / 2
    own, found = sides_of(points, rounds), volumes.copy()
    for cell in np.flatnonzero(whole & near):
        places = points[cell] + raster * sides
        numbers = sides_of(places, rounds)
        for other in np.setdiff1d(numbers, own[cell]):
            part = numbers == other
            heirs = np.flatnonzero(whole & (own == other))
            if len(heirs):  # an inclusion smaller than a cell has no point
                distances = np.linalg.norm(points[heirs] - places[part].mean(axis=0), axis=1)
                nearest = heirs[distances <= distances.min() * (1 + TIED)]
                volume = sides.prod() * part.mean()
                found[cell] -= volume
                found[nearest] += volume / len(nearest)
    return found
