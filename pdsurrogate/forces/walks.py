"""Walks over the pairs of a material that sum moments and forces at both ends at once."""

from typing import NamedTuple

import numpy as np

from ..body.bonds import pointers_to
from ..engine.block_arrays import BLOCK, aligned_rows
from ..engine.passes import BoundPass
from .kinematics import Kinematics
from .material_points import MaterialPoints

PARTS = 8
MOST_PAIRS = 64 * BLOCK
FEWEST_PAIRS = 16 * BLOCK
"""Number of slabs into which a walk is divided, unless they had too many or too few pairs. Chosen:
with more pairs in a slab, fewer of its points are in others too; their sums still fit into the
second-level cache. With fewer, more blocks belong to two slabs.
"""


class Walk(NamedTuple):
    """Order in which a pass goes through blocks of pairs, and the sums at their ends.

    A slab has the pairs of some consecutive first points, and a row of sums for each of their ends.
    No two chunks of a pass write to one row, and what is in a row does not depend on the number of
    threads or ranks. A block with pairs of two slabs is visited for each.

    Attributes
    ----------
    blocks : ndarray of uint32, shape (v,)
        Block of each visit.
    lanes : ndarray of int, shape (v, 2)
        Places in the block between which pairs belong to the slab.
    slabs : ndarray of int, shape (n_slabs + 1, 2)
        First visit and first row of each slab.
    ends : tuple of ndarray of uint32, shape (v * BLOCK,)
        Rows of both ends of the pairs of each visit; the first row of a slab for those of others.
    sums : ndarray, shape (rows, d d + d)
        Moment and force of each row, summed over the pairs.
    """

    blocks: np.ndarray
    lanes: np.ndarray
    slabs: np.ndarray
    ends: tuple[np.ndarray, np.ndarray]
    sums: np.ndarray


def walk_over(kinematics: Kinematics, points: MaterialPoints) -> tuple[Walk, tuple]:
    """Return the walk over the pairs of a material, and for `sum_at_points` the bounds of the rows
    of each of its points, and these rows.
    """
    body = kinematics.body
    d = body.dimension
    first = body.bonds.first[points.pairs]
    # From what all ranks know, so that slabs are the same on any number of them.
    of_point = (np.pi / 2 if d == 2 else 2 * np.pi / 3) * (body.horizon / body.spacing) ** d
    pairs = np.clip(body.share.size * of_point / PARTS, FEWEST_PAIRS, MOST_PAIRS)
    slab_of = body.share.numbers[first] // max(1, int(pairs / of_point))
    starts = np.flatnonzero(np.diff(slab_of, prepend=-1))
    stops = np.append(starts[1:], len(first))[: len(starts)]
    begun = starts // BLOCK
    counts = -(-stops // BLOCK) - begun
    visits = np.append(0, np.cumsum(counts))
    blocks = np.repeat(begun - visits[:-1], counts) + np.arange(visits[-1])
    bounds = np.stack([np.repeat(starts, counts), np.repeat(stops, counts)], axis=1)
    lanes = np.clip(bounds - BLOCK * blocks[:, None], 0, BLOCK)
    ends = np.empty((2, BLOCK * len(blocks)), dtype=np.uint32)
    row_of = np.empty(len(points.positions), dtype=np.int64)
    rows = [0]
    numbers = [np.empty(0, dtype=np.uint32)]
    of_slabs = zip(starts, stops, visits[:-1], visits[1:], begun, strict=True)
    for start, stop, visit, after, block in of_slabs:
        of_slab = np.stack([points.first[start:stop], points.second[start:stop]])
        every = of_slab.ravel()
        # Each point of the slab once, and the row after the slab's first one for each.
        row_of[every] = np.arange(len(every))
        found = np.sort(every[row_of[every] == np.arange(len(every))])
        row_of[found] = rows[-1] + 1 + np.arange(len(found))
        place = BLOCK * (visit - block) + start
        ends[:, BLOCK * visit : BLOCK * after] = rows[-1]
        ends[:, place : place + stop - start] = row_of[of_slab]
        numbers.append(found)
        rows.append(rows[-1] + 1 + len(found))
    slabs = np.stack([visits, rows], axis=1)
    sums = aligned_rows((rows[-1], d * d + d))
    walk = Walk(blocks.astype(np.uint32), lanes, slabs, (ends[0], ends[1]), sums)
    of_rows = np.concatenate(numbers)
    order = np.argsort(of_rows, kind="stable")
    listed = np.delete(np.arange(rows[-1]), rows[:-1])[order]
    return walk, (pointers_to(of_rows, len(row_of)), listed.astype(np.uint32))


def each_pair(bound: BoundPass, places: np.ndarray) -> np.ndarray:
    """Return the moments and forces (k, d d + d) of the pairs at some places, which a pass over a
    walk finds again at the present positions, with a row of sums for each pair.
    """
    *others, walk = bound.arguments["results"]
    found = np.empty((len(places), walk.sums.shape[1]))
    every, number = np.unique(places // BLOCK, return_inverse=True)
    order = np.argsort(number, kind="stable")
    bounds = np.searchsorted(number[order], np.arange(len(every) + 1))
    for start in range(0, len(every), MOST_PAIRS // BLOCK):
        blocks = every[start : start + MOST_PAIRS // BLOCK].astype(np.uint32)
        rows = np.arange(1, BLOCK * len(blocks) + 1, dtype=np.uint32)
        sums = aligned_rows((len(rows) + 1, found.shape[1]))
        lanes = np.tile([0, BLOCK], (len(blocks), 1))
        slabs = np.array([[0, 0], [len(blocks), len(sums)]])
        listing = Walk(blocks, lanes, slabs, (rows, np.zeros_like(rows)), sums)
        unused = (
            np.zeros((max(len(one), len(blocks)), *one.shape[1:]), one.dtype) for one in others
        )
        bound.bound_to(results=(*unused, listing))()
        here = order[bounds[start] : bounds[start + len(blocks)]]
        found[here] = sums[1 + BLOCK * (number[here] - start) + places[here] % BLOCK]
    return found
