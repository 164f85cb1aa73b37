"""Points of a body whose bonds are alike: what is constant in their bonds is stored once."""

import numpy as np

from .body import Body, lengths_of
from .bonds import ON_LATTICE, SLAB


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


def pair_strength(body: Body) -> np.ndarray:
    """Return the product w V_i V_j of the weight of every pair and the volumes of its ends."""
    bonds = body.bonds
    found = np.empty(len(bonds.first))
    for part in bonds.slabs():
        ends = bonds.first[part], bonds.second[part]
        weights = body.weigh(lengths_of(vectors_between(body, *ends)))
        found[part] = weights * body.all_volumes[ends[0]] * body.all_volumes[ends[1]]
    return found


def alike(body: Body) -> np.ndarray:
    """Return, for every point, the first point with the same bond vectors, and the same volumes of
    itself and its neighbors, shape (n,).

    What is compared is a number of 64 bits made of all these: that two of a million different
    points have the same one happens once in 10^7 bodies.
    """
    bonds = body.bonds
    pointers = bonds.pointers.astype(np.int64)
    counts = np.diff(pointers)
    random = np.random.default_rng(0)
    most = int(counts.max())
    odd = 2 * random.integers(2**63, size=most + body.dimension + 2, dtype=np.uint64) + 1
    by_place, by_value, by_volume = np.split(odd, [most, -1])
    keys = by_volume * body.volumes.view(np.uint64)
    step = max(1, SLAB // most)
    for start in range(0, len(body), step):
        rows = np.arange(start, min(start + step, len(body)))
        starts = pointers[start : rows[-1] + 2] - pointers[start]
        owners = np.repeat(rows, counts[rows])
        ends = bonds.neighbors[pointers[start] : pointers[rows[-1] + 1]]
        vectors = vectors_between(body, owners, ends)
        values = np.column_stack([vectors, body.all_volumes[ends]]).view(np.uint64)
        values = _mixed(_mixed(values) @ by_value)
        values *= by_place[np.arange(len(ends)) - np.repeat(starts[:-1], counts[rows])]
        keys[rows] += np.diff(np.append(np.uint64(0), values.cumsum())[starts])
    return _firsts(keys)


def alike_blocks(body: Body, alike: np.ndarray, block: int) -> np.ndarray:
    """Return, for every block of so many pairs, the first block whose pairs have the same vectors
    between points that are `alike`.
    """
    ghosts = body.ghosts
    n = len(alike)
    every = np.concatenate([alike, n * (1 + ghosts.image.astype(np.int64)) + alike[ghosts.source]])
    first, second = body.bonds.ends_in_blocks(block)
    own, others, _ = body.bonds.pairs_of_points
    # leads from a pair to its place in the list of its first point
    shift = (np.diff(others) - own[:-1]).astype(np.int64)
    random = np.random.default_rng(0)
    odd = 2 * random.integers(2**63, size=block + 3, dtype=np.uint64) + 1
    keys = np.empty(len(first) // block, dtype=np.uint64)
    step = SLAB // block
    for start in range(0, len(keys), step):
        pairs = np.arange(start * block, min((start + step) * block, len(first)))
        one = first[pairs]
        values = np.column_stack([every[one], every[second[pairs]], pairs + shift[one]])
        values = _mixed(values.astype(np.uint64) @ odd[block:])
        keys[start : start + step] = values.reshape(-1, block) @ odd[:block]
    return _firsts(keys)


def _mixed(values: np.ndarray) -> np.ndarray:
    """Return values of 64 bits of which each bit depends on many bits of the given ones; a product
    alone would leave signs, the highest bits, where they are.
    """
    values = (values ^ (values >> np.uint64(32))) * np.uint64(0x9E3779B97F4A7C15)
    return values ^ (values >> np.uint64(29))


def _firsts(keys: np.ndarray) -> np.ndarray:
    """Return the index of the first equal key of each."""
    _, firsts, numbers = np.unique(keys, return_index=True, return_inverse=True)
    return firsts[numbers]


def stored_lists(pointers: np.ndarray, alike: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points whose lists are stored, one for all that are alike, and the place at which
    the list of every point begins, where `pointers` bound the lists of all points.
    """
    rows = np.flatnonzero(alike == np.arange(len(alike)))
    counts = np.diff(pointers)[rows]
    starts = np.zeros(len(alike), dtype=np.uint64)
    starts[rows] = np.cumsum(counts) - counts
    return rows.astype(np.uint32), starts[alike]
