"""Fields in the frame of an image: the map comes back with the law, and mistakes are named."""

import re
from unittest.mock import patch

import numpy as np
import pytest
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.calibration.causes import Trial, cause_of
from pdsurrogate.calibration.image_map import ImageMap, Sight, weights_of
from pdsurrogate.calibration.kinematics import Kinematics, start_of_map
from pdsurrogate.calibration.measured import MeasuredScene
from pdsurrogate.calibration.scatter import Rows

SPACING, PIXELS, NOISE = 0.2, 152.0, 3e-4
STEPS = [1, 2, 3]
PLACES = np.array(
    [
        (x, y)
        for x in np.linspace(-1.4, 1.4, 11)
        for y in np.linspace(-1.9, 1.9, 14)
        if x * x + y * y > 0.45**2
    ]
)


def turned(degrees):
    angle = np.radians(degrees)
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.fixture(scope="module")
def scene():
    return pds.load_scene(
        "hole",
        {
            "spacing": SPACING,
            "stretches": [1.15, 1.3, 1.5],
            "reference": None,
            "grips": [{"edge": "bottom", "travel": 0.0}, {"edge": "top", "travel": 1.0}],
            "material": {"law": "gent", "shear_modulus": 400.0, "bulk_modulus": 4e4}
            | {"chain_limit": 15.0},
        },
    )


@pytest.fixture(scope="module")
def result(scene):
    return pds.simulate(scene, "bond-energy")


@pytest.fixture(scope="module")
def motion(result):
    return Kinematics.of(result, [0, 1, 2])


@pytest.fixture(scope="module")
def moved(motion):
    """Displacements of all places in the steps, without noise."""
    return np.array([motion.at(np.full(len(PLACES), k), PLACES)[0] for k in range(3)])


@pytest.fixture
def noisy(moved, random):
    return moved + NOISE * random.standard_normal(moved.shape)


def sight(places, displacements, scale=1.0):
    """Return measured displacements of places, one set or one for each step."""
    places = np.broadcast_to(places, displacements.shape).reshape(-1, 2)
    index = np.repeat(np.arange(len(displacements)), displacements.shape[1])
    return Sight(
        index, places, displacements.reshape(-1, 2), np.full(places.shape, 1 / (scale * NOISE))
    )


def in_image(places, displacements, degrees=0.0, scale=PIXELS, origin=(700.0, 900.0), shifts=0.0):
    """Return what a camera sees that is turned and moved in the steps: the image is the scene
    turned, scaled and shifted.
    """
    rotation = scale * turned(degrees)
    seen = places @ rotation.T + origin
    return seen, (places + displacements + shifts) @ rotation.T + origin - seen


def test_derivatives_of_seen_places_are_those_of_differences(random):
    for d in (2, 3):
        steps = (1, 2, 3)
        start = ImageMap.at_rest(0.01, np.eye(d), np.ones(d), np.full(d, 300.0), steps)
        start = start.at(0.2 * random.standard_normal(start.unknowns))
        index = np.array([0, 1, 2, 2])
        places = 300 + 100 * random.standard_normal((4, d))
        gradient = np.eye(d) + 0.3 * random.standard_normal((4, d, d))

        def seen(one, index=index, places=places, gradient=gradient):
            return one.seen(index, np.einsum("nij,nj->ni", gradient, one.to_scene(places)))

        reached = np.einsum("nij,nj->ni", gradient, start.to_scene(places))
        found = start.derivatives(index, start.to_scene(places), reached, gradient)
        units = 1e-6 * np.eye(start.unknowns)
        expected = np.stack(
            [(seen(start.at(unit)) - seen(start.at(-unit))) / 2e-6 for unit in units], axis=2
        )
        np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
        np.testing.assert_allclose(start.moved(index, start.seen(index, reached)), reached)


@pytest.mark.parametrize(
    ("degrees", "scale"), [(0.0, PIXELS), (1.0, PIXELS), (93.0, 10.0), (-88.0, 1.01)]
)
def test_the_map_of_a_moving_camera_is_found_without_a_start(motion, noisy, degrees, scale):
    shifts = 0.02 * np.arange(1, 4)[:, None, None] / 3 * np.array([1.0, 0.0])
    seen = in_image(PLACES, noisy, degrees, scale, shifts=shifts)
    fit, _ = start_of_map(motion, sight(*seen, scale), STEPS)
    assert fit.rms == pytest.approx(1.0, rel=0.1)
    assert fit.map.scale == pytest.approx(1 / scale, rel=2e-3)
    np.testing.assert_allclose(fit.map.rotation, turned(-degrees), atol=1e-3)
    np.testing.assert_allclose(fit.map.to_scene(seen[0]), PLACES, atol=5e-3)
    np.testing.assert_allclose(np.linalg.norm(fit.map.shifts, axis=1), shifts[:, 0, 0], atol=2e-3)


def test_outliers_count_less():
    residuals = np.tile([1.0, 0.0], (1000, 1))
    residuals[:4] = [[3.0, 0.0], [0.0, 6.0], [0.0, 9.0], [60.0, 80.0]]
    assert weights_of(residuals)[:5].tolist() == [1.0, 0.5, 0.0, 0.0, 1.0]


MISTAKES = {
    "v has the opposite sign": (lambda p, u: (p, u * [1, -1]), r"with v \(u2\) of the opposite"),
    "u has the opposite sign": (lambda p, u: (p, u * [-1, 1]), r"with u \(u1\) of the opposite"),
    "old minus new places": (lambda p, u: (p, -u), "they are old places minus new ones"),
    "displacements in mm": (lambda p, u: (p, 10 * u), "with displacements times 0.1 "),
    "displacements in pixels": (lambda p, u: (p, 125 * u), "with displacements times 0.008 "),
    "places deformed": (lambda p, u: (p + u, u), "places are those in the deformed images"),
    "from the image before": (
        lambda p, u: (p, np.diff(np.concatenate([0 * u[:1], u]), axis=0)),
        "they are from the image before",
    ),
    "the reference image is step 1": (
        lambda p, u: (p, np.concatenate([0 * u[:1], u[:-1]])),
        "the steps are numbered one too high",
    ),
    "lost points as zeros": (
        lambda p, u: (p, np.where((np.arange(len(p)) % 50 == 7)[:, None], 0.0, u)),
        "points that the program lost",
    ),
    "camera turned": (lambda p, u: in_image(p, u, 1.0, 1.0, (0, 0)), r"turned by -1.* degrees"),
    "camera scaled": (lambda p, u: (1.01 * p, 1.01 * u), "scale 0.99"),
    "camera shifted": (
        lambda p, u: (p + np.array([0.05, 0]), u),
        r"origin at \(-0.05|origin at \(-0.049",
    ),
    "rigid motion taken out": (
        lambda p, u: (p, u - u.mean(axis=1, keepdims=True)),
        "a program took rigid motions out",
    ),
    "pixels": (lambda p, u: in_image(p, u), "with a map from image to scene"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_of_files_are_named(motion, noisy, mistake):
    change, message = MISTAKES[mistake]
    trial = Trial(motion, sight(*change(PLACES, noisy)), STEPS, np.zeros(0), False)
    cause = cause_of(trial)
    assert cause is not None
    assert re.search(message, cause), cause


def test_right_displacements_have_no_cause(motion, noisy):
    assert cause_of(Trial(motion, sight(PLACES, noisy), STEPS, np.zeros(0), False)) is None
    seen = sight(*in_image(PLACES, noisy, 1.0), PIXELS)
    assert cause_of(Trial(motion, seen, STEPS, np.zeros(0), True)) is None


def rows_of(places, displacements, forces):
    """Return a table of measurements, and their values."""
    count = len(displacements)
    steps = np.repeat(np.arange(1, count + 1), len(places))
    fields = [
        np.column_stack([steps, np.full(len(steps), axis), np.tile(places, (count, 1))])
        for axis in (1, 2)
    ]
    outputs = np.column_stack([np.arange(1, count + 1), np.zeros((count, 3))])
    values = [*displacements.reshape(-1, 2).T, forces]
    return np.vstack([*fields, outputs]), np.concatenate(values)


@pytest.fixture(scope="module")
def seen_and_fitted():
    """A camera turned by 1 degree that moves, with lost points as zeros and outliers; the body is
    that of the scene, so that there is no discretization error.
    """
    coarse = pds.load_scene(
        "hole",
        {
            "spacing": 0.5,
            "stretches": [1.2, 1.5],
            "reference": None,
            "grips": [{"edge": "bottom", "travel": 0.0}, {"edge": "top", "travel": 1.0}],
        },
    )
    places = PLACES[np.linalg.norm(PLACES, axis=1) > 0.6]
    X, _ = rows_of(places, np.zeros((2, len(places), 2)), np.zeros(2))
    rows = Rows(X[:, 0].astype(int), X[:, 1].astype(int), X[:, 2:])
    y = MeasuredScene(coarse, rows).simulate(pds.materials.Gent(0.8, 80.0, 12.0))[0]
    moved = y[:-2].reshape(2, 2, len(places)).transpose(1, 2, 0)
    random = np.random.default_rng(0)
    moved = moved + 1e-3 * random.standard_normal(moved.shape)
    shifts = 0.02 * np.arange(1, 3)[:, None, None] * np.array([1.0, 0.5])
    seen, displacements = in_image(places, moved, 1.0, shifts=shifts)
    displacements[:, ::40] = 0.0
    displacements[1, 5] += [3.0, -2.0]
    X, y = rows_of(seen, displacements, y[-2:])
    deviation = np.where(X[:, 1] > 0, PIXELS * 1e-3, 0.002)
    with patch("pdsurrogate.calibration.fitting.ORDER", 60.0):
        model = pds.SceneRegressor(coarse, "gent", refine=1, frame="image")
        model.fit(X, y, standard_deviation=deviation)
    return X, y, places, model


def test_a_law_and_the_map_of_a_camera_come_back_together(seen_and_fitted):
    X, y, places, model = seen_and_fitted
    off = (model.parameters_ - [0.8, 12.0]) / model.standard_errors_
    assert np.abs(off).max() < 3
    assert (model.standard_errors_ < 0.1 * model.parameters_).all()
    assert 0.7 < model.lack_of_fit_ < 1.3
    words = model.maps_[0].described()
    error = words["standard_errors"]
    assert abs(words["scale"] - 1 / PIXELS) < 3 * error["scale"] < 0.01 / PIXELS
    assert abs(words["degrees"] + 1) < 3 * error["degrees"] < 0.5
    assert words["camera_moves"] == pytest.approx(0.04 * np.hypot(1, 0.5), rel=0.1)
    assert model.left_out_ == 0
    lost = np.zeros((2, len(places)), dtype=bool)
    lost[:, ::40] = lost[1, 5] = True
    assert (model.weights_[:-2][np.tile(lost.ravel(), 2)] < 0.1).all()
    assert (model.weights_ > 0.9).sum() > len(y) - 2 * lost.sum() - 4
    kept = model.weights_ > 0
    off = (model.predict(X) - y)[kept] / model.standard_deviations_[kept]
    assert np.sqrt((off**2).mean()) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize(
    "mistake", ["v has the opposite sign", "u has the opposite sign", "old minus new places"]
)
def test_a_fit_refuses_mistakes_with_their_cause(scene, noisy, mistake):
    """Before the search, with the law not yet known."""
    change, message = MISTAKES[mistake]
    rows = Rows(np.arange(1, 4), np.zeros(3, dtype=int), np.zeros((3, 2)))
    forces = MeasuredScene(scene, rows).simulate(pds.materials.Gent(400.0, 4e4, 15.0))[0]
    places, displacements = (np.broadcast_to(one, noisy.shape) for one in change(PLACES, noisy))
    tables = [
        rows_of(p, u[None], f[None]) for p, u, f in zip(places, displacements, forces, strict=True)
    ]
    X = np.vstack([table + np.array([k, 0, 0, 0]) for k, (table, _) in enumerate(tables)])
    y = np.concatenate([values for _, values in tables])
    deviation = np.where(X[:, 1] > 0, NOISE, 1.0)
    with raising(message):
        pds.SceneRegressor(scene, "gent", refine=1).fit(X, y, standard_deviation=deviation)
