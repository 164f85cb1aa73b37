"""Arrays of a body in parts, in the order of the whole body and back, on several ranks."""

import numpy as np
from every_model import cut

from pdsurrogate.body import ReflectionPlane, divided, rows_of
from pdsurrogate.ranks import communicator
from pdsurrogate.testing.bodies import notched


def names(body, numbers, total):
    """What points, images, directed bonds and pairs are called everywhere, by their kinds."""
    ends = np.concatenate([numbers, numbers[body.ghosts.source] + total * body.ghosts.image])
    bonds = body.bonds
    owners = np.repeat(np.arange(len(body)), np.diff(bonds.pointers).astype(np.int64))
    span = total * 2 ** len(body.planes)
    return {
        "points": numbers,
        "images": ends,
        "bonds": ends[owners] * span + ends[bonds.neighbors],
        "pairs": ends[bonds.first] * span + ends[bonds.second],
    }


def check():
    ranks = communicator()
    for d in (2, 3):
        planes = (
            ReflectionPlane(0, 0.0, -1, (-1, 1, 1)[:d]),
            ReflectionPlane(1, 0.0, -1, (1, -1, 1)[:d]),
        )
        whole = notched(d, planes=planes, separates=cut)
        expected = names(whole, np.arange(len(whole)), len(whole))
        body = divided(notched(d, planes=planes, separates=cut), ranks)
        here = names(body, body.share.numbers, len(whole))
        for kind, values in here.items():
            rows = rows_of(body, kind)
            assert rows.size == len(expected[kind]), kind
            assert np.array_equal(expected[kind][rows.numbers], values)
            there = rows.gather(values)
            if ranks.rank == 0:
                assert np.array_equal(there, expected[kind]), (d, kind)
            assert np.array_equal(rows.hand_out(there), values), (d, kind, ranks.rank)
