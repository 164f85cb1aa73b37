"""Points and blocks of pairs that are alike, against a comparison of all their numbers."""

import numpy as np
import pytest

from pdsurrogate.body import Body, ReflectionPlane, grid
from pdsurrogate.body.alike import alike, alike_blocks, vectors_between


def lists_of(body):
    """The vectors, ways and volumes of every point's bonds, and the volume of the point."""
    bonds = body.bonds
    owners = body.bond_owners
    vectors = vectors_between(body, owners, bonds.neighbors)
    ways = bonds.neighbors - owners
    values = np.column_stack([vectors, ways, body.all_volumes[bonds.neighbors]])
    parts = np.split(values, bonds.pointers[1:-1].astype(int))
    return [(volume, part.tobytes()) for volume, part in zip(body.volumes, parts, strict=True)]


def mirrored(random, d):
    """Jittered points and their mirror images, whose vectors differ in signs alone."""
    points = grid((0.0,) * d, (1.0,) * d, 0.2)
    points = points + random.uniform(-0.03, 0.03, points.shape)
    for axis in range(d):
        points = np.concatenate([points, points * np.where(np.arange(d) == axis, -1.0, 1.0)])
    return Body(points, np.full(len(points), 0.2**d), 0.41, 0.2)


def holed(random, d):
    """A lattice far from the origin, with holes, a plane and two volumes."""
    points = grid((100.0,) * d, (101.5,) * d, 0.1)
    points = points[random.uniform(size=len(points)) < 0.97]
    volumes = np.where(points[:, 0] > 100.7, 0.1**d, 0.09**d)
    planes = (ReflectionPlane(1, 101.5, 1, (1, -1, 1)[:d]),)
    return Body(points, volumes, 0.176, 0.1, planes=planes, cell=(0.1,) * d)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("make", [mirrored, holed])
def test_points_are_alike_that_have_the_same_lists(random, make, d):
    body = make(random, d)
    found = alike(body)
    firsts = {}
    expected = [firsts.setdefault(each, i) for i, each in enumerate(lists_of(body))]
    assert found.tolist() == expected
    assert (len(set(expected)) == len(body)) == (make is mirrored)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("make", [mirrored, holed])
def test_blocks_are_alike_whose_pairs_have_the_same_vectors_and_ends(random, make, d):
    body = make(random, d)
    points = alike(body)
    blocks = alike_blocks(body, points, 4)
    ghosts = body.ghosts
    ends = np.stack(body.bonds.ends_in_blocks(4))
    kinds = np.concatenate([points, points[ghosts.source]])[ends]
    images = np.concatenate([np.zeros(len(body), dtype=int), ghosts.image])[ends[1]]
    values = np.column_stack([vectors_between(body, *ends), *kinds, images]) + 0.0
    values[body.bonds.n_pairs :] = np.arange(len(values) - body.bonds.n_pairs)[:, None]
    firsts = {}
    each = [
        firsts.setdefault(v.tobytes(), b) for b, v in enumerate(values.reshape(-1, 4 * (d + 3)))
    ]
    assert blocks.tolist() == each
