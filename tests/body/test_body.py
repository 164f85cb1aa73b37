"""Bodies, bonds and ghosts."""

import numpy as np
import pytest
from refusals import raising

from pdsurrogate.body import Body, ReflectionPlane, grid
from pdsurrogate.kernels.weights import WEIGHT_FUNCTIONS


def test_bonds_are_all_pairs_within_the_horizon(random):
    points = random.uniform(0, 1, (60, 2))
    body = Body(points, np.full(60, 1 / 60), 0.3)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    expected = {(i, j) for i in range(60) for j in range(60) if i != j and distance[i, j] <= 0.3}
    bonds = body.bonds
    owners = np.repeat(np.arange(60), np.diff(bonds.pointers).astype(int))
    assert set(zip(owners.tolist(), bonds.neighbors.tolist(), strict=True)) == expected
    assert bonds.n_directed == len(expected)
    assert set(zip(bonds.first.tolist(), bonds.second.tolist(), strict=True)) == {
        pair for pair in expected if pair[0] < pair[1]
    }
    # Every entry of a list knows its pair, and every pair its two ends.
    ends = np.stack([owners, bonds.neighbors], axis=1)
    pairs = np.stack([bonds.first, bonds.second], axis=1)[bonds.pair_of]
    assert (np.sort(ends, axis=1) == np.sort(pairs, axis=1)).all()
    pairs, others, incidence = bonds.pairs_of_points
    for i in range(60):
        assert (bonds.second[incidence[int(others[i]) : int(others[i + 1])]] == i).all()
        own = slice(int(pairs[i]), int(pairs[i + 1]))
        assert (bonds.first[own] == i).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_pairs_include_images_and_coinciding_points_are_refused(random, dimension):
    points = random.uniform(0, 1, (200, dimension))
    planes = (ReflectionPlane(0, 0.0, -1, (-1,) + (1,) * (dimension - 1)),)
    body = Body(points, np.full(200, 1 / 200), 0.25, planes=planes)
    apart = np.linalg.norm(body.all_points[:, None] - body.all_points, axis=2)
    pairs = np.argwhere(np.triu(apart <= 0.25, 1)[:200])
    assert len(pairs) > 200
    np.testing.assert_array_equal(np.stack([body.bonds.first, body.bonds.second], axis=1), pairs)
    with raising("points 1 and 199 coincide"):
        Body(np.vstack([points[:199], points[1]]), np.full(200, 1 / 200), 0.25)


@pytest.mark.parametrize("order", ["of the cells", "any"])
def test_pairs_of_a_lattice_are_those_of_a_search(random, order):
    points = grid((-1.0, 0.0, 2.0), (0.0, 1.2, 2.6), 0.1)
    points = points[random.uniform(size=len(points)) < 0.8]
    points = points if order == "of the cells" else random.permutation(points)
    volumes, n = np.full(len(points), 1e-3), len(points)
    plane = ReflectionPlane(1, 1.2, 1, (1, -1, 1))
    for horizon in (0.175, 0.3):
        body = Body(points, volumes, horizon, 0.1, planes=(plane,), cell=(0.1,) * 3)
        # cells of another size than the lattice's have their points on no lattice
        searched = Body(points, volumes, horizon, 0.1, planes=(plane,), cell=(0.0901,) * 3)
        assert len(body.all_points) > n
        assert (body.bonds.ends == searched.bonds.ends).all()
        assert (body.bonds.neighbors == searched.bonds.neighbors).all()


def test_the_papers_sheet_has_the_papers_bonds():
    body = Body.rectangle(3, 1, 0.02, 3.15 * 0.02)
    assert len(body) == 7500
    assert body.bonds.n_directed == 202_836  # 150 x 50 grid, delta = 3.15 dx


def test_images_mirror_the_points_near_a_plane():
    body = Body.rectangle(
        1,
        1,
        0.1,
        0.25,
        planes=(ReflectionPlane(0, 0.0, -1, (-1, 1)), ReflectionPlane(0, 1.0, 1, (-1, -1))),
    )
    ghosts = body.ghosts
    # three columns on either side lie within the horizon of the edge
    assert len(ghosts) == 2 * 3 * 10
    mirrored = body.points[ghosts.source]
    position = np.where(ghosts.plane == 0, 0.0, 1.0)
    np.testing.assert_allclose(ghosts.points[:, 0] + mirrored[:, 0], 2 * position)
    np.testing.assert_allclose(ghosts.points[:, 1], mirrored[:, 1])
    bonds = body.bonds
    assert (bonds.first < len(body)).all()
    assert bonds.n_directed < len(bonds.neighbors)


@pytest.mark.parametrize("name", sorted(WEIGHT_FUNCTIONS))
def test_kappa_is_the_shape_tensor_of_a_full_horizon(name):
    """Against a fine sum; the sum's error is that of the circle's edge, of order
    spacing/horizon.
    """
    points = grid((-1.1, -1.1), (1.1, 1.1), 0.01)
    body = Body(points, np.full(len(points), 1e-4), 1.0, weight=name)
    length = np.linalg.norm(points, axis=1)
    inside = (length <= 1) & (length > 0)
    K11 = (body.weigh(length[inside]) * points[inside, 0] ** 2).sum() * 1e-4
    assert body.kappa == pytest.approx(K11, rel=0.01)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"points": np.eye(3), "planes": (ReflectionPlane(0, 0.0, -1, (-1, 1)),)},
            r"parity.* 3 components, not \(-1, 1\)",
        ),
        ({"points": np.zeros((3, 4))}, "shape"),
        (
            {"points": np.array([[0.0, 0.0], [np.nan, 1.0]]), "volumes": np.ones(2)},
            "point 1 has a position that is not finite",
        ),
        ({"volumes": np.array([1.0, -1.0, 1.0])}, "volumes must be positive"),
        ({"volumes": np.ones(2)}, "volumes must have shape"),
        ({"horizon": -1.0}, "horizon must be positive"),
        ({"horizon": np.nan}, "horizon must be positive"),
        ({"weight": "cubic"}, "unknown weight function 'cubic'"),
    ],
)
def test_bad_bodies_are_refused(change, message):
    good = {
        "points": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
        "volumes": np.ones(3),
        "horizon": 1.5,
    }
    with raising(message):
        Body(**{**good, **change})


def test_points_that_coincide_or_reach_nobody_are_refused():
    with raising("coincide"):
        Body(np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]]), np.ones(3), 1.5)
    for points in (
        np.zeros((4, 2)),
        np.zeros((4, 3)),
        np.vstack([grid((0, 0), (1, 1), 0.25), [[0.5, 0.5]] * 4]),
    ):
        with raising(r"points \d+ and \d+ coincide at "):
            # it was built, and failed wherever its bonds were first asked for
            Body(points, np.ones(len(points)), 1.5)
    with raising("contains no neighbor"):
        _ = Body(np.array([[0.0, 0.0], [3.0, 0.0]]), np.ones(2), 1.5).bonds


@pytest.mark.parametrize(
    ("spacing", "message"),
    [
        (5.0, "larger than the body"),
        (0.3, "does not divide"),
        (0.0, "positive"),
        (np.inf, "positive"),
    ],
)
def test_spacings_that_do_not_fit_are_refused(spacing, message):
    with raising(message):
        grid((0, 0), (1, 1), spacing)
