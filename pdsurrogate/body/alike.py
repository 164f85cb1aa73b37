"""Points of a body whose bonds are alike: what is constant in their bonds is stored once."""

import numpy as np

from ..kernels.lists import find_firsts, key_blocks, key_points
from .body import Body, lengths_of
from .bonds import ON_LATTICE


def vectors_between(body: Body, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the undeformed vectors (k, d) from points to other points or ghosts; on a lattice
    those of equal bonds are equal to the last bit, on all ranks.
    """
    cell = np.asarray(body.cell)
    vectors = body.all_points.take(second, axis=0)
    vectors -= body.all_points.take(first, axis=0)
    steps = np.rint(vectors / cell)
    steps *= cell
    steps += 0.0  # no zero is negative
    np.copyto(vectors, steps, where=np.abs(vectors - steps) <= ON_LATTICE * cell)
    return vectors


def pair_strength(body: Body, pairs: np.ndarray | slice) -> np.ndarray:
    """Return the product w V_i V_j of the weight of each of some `pairs` and the volumes of its
    ends.
    """
    first, second = body.bonds.first[pairs], body.bonds.second[pairs]
    weights = body.weigh(lengths_of(vectors_between(body, first, second)))
    return weights * body.all_volumes[first] * body.all_volumes[second]


def alike(body: Body) -> np.ndarray:
    """Return, for every point, the first point with the same bond vectors, and the same volumes of
    itself and its neighbors, shape (n,).

    What is compared is a number of 64 bits made of all these: that two of a million different
    points have the same one happens once in 10^7 bodies.
    """
    bonds = body.bonds
    keys = np.empty(len(body), dtype=np.uint64)
    volumes = body.all_volumes.view(np.uint64)
    lattice = np.asarray(body.cell), ON_LATTICE
    key_points(body.all_points, volumes, *lattice, *bonds.pairs_of_points, bonds.ends, keys)
    return _firsts(keys)


def alike_blocks(body: Body, alike: np.ndarray, block: int) -> np.ndarray:
    """Return, for every block of so many pairs, the first block whose pairs have the same vectors
    between points that are `alike`.
    """
    ghosts = body.ghosts
    n = len(alike)
    names = np.concatenate([alike, n * (1 + ghosts.image.astype(np.int64)) + alike[ghosts.source]])
    bonds = body.bonds
    keys = np.empty(-(-bonds.n_pairs // block), dtype=np.uint64)
    own, others, _ = bonds.pairs_of_points
    key_blocks(names.view(np.uint64), own, others, bonds.ends, block, keys)
    return _firsts(keys)


def _firsts(keys: np.ndarray) -> np.ndarray:
    """Return the index of the first equal key of each."""
    firsts = np.empty(len(keys), dtype=np.int64)
    find_firsts(keys, np.zeros(2 << len(keys).bit_length(), dtype=np.int64), firsts)
    return firsts


def stored_lists(pointers: np.ndarray, alike: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points whose lists are stored, one for all that are alike, and the place at which
    the list of every point begins, where `pointers` bound the lists of all points.
    """
    rows = np.flatnonzero(alike == np.arange(len(alike)))
    counts = np.diff(pointers)[rows]
    starts = np.zeros(len(alike), dtype=np.uint64)
    starts[rows] = np.cumsum(counts) - counts
    return rows.astype(np.uint32), starts[alike]
