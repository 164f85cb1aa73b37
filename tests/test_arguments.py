"""Bad arguments of the public functions that fit, store, evaluate, compare and study: named in
our words, before work starts.
"""

import re

import numpy as np
import pytest
from refusals import raising

import pdsurrogate as pds

LAW = pds.materials.NeoHookean()
SAMPLES = pds.training_samples(LAW, 200, (0.7, 2.0), random_state=0)


class Unworkable(pds.learning.ChebyshevRegressor):
    """Fails where work starts."""

    def fit(self, X, y, sample_weight=None):
        raise AssertionError("work has started")


MODEL = pds.surrogate_pipeline(Unworkable(3), features="isochoric")
ENERGY = pds.surrogate_pipeline(target="isochoric-energy")


def validated(samples=SAMPLES, model=MODEL, **arguments):
    return pds.cross_validate(model, samples, **arguments)


def stored(folder, **arguments):
    names = ("model", "samples", "law", "folder", "name", "version", "text")
    given = dict(zip(names, (MODEL, SAMPLES, LAW, folder, "x", None, "x"), strict=True))
    return pds.store(**{**given, **arguments})


def bound(body="a body", law=LAW, settings=None):
    body = pds.Body.rectangle(1.0, 1.0, 0.25, 0.7875) if body == "a body" else body
    return pds.load_surrogate("analytic").bind(body, law, settings or pds.ForceSettings())


BAD = [
    (
        lambda _: bound(None),
        TypeError,
        r"body must be a Body, such as Body.rectangle\(1.0, 1.0, 0.1, 0.315\), not None",
    ),
    (lambda _: bound(law="gent"), TypeError, "law must be a material law"),
    (
        lambda _: bound(settings="polar"),
        TypeError,
        r"settings must be ForceSettings\(\), not 'polar'",
    ),
    (lambda _: validated(folds=1), ValueError, "folds must be from 2 to 200, not 1"),
    (
        lambda _: validated(model=3),
        TypeError,
        "model must be an estimator with fit, predict and get_params, not 3",
    ),
    (
        lambda _: validated(model=Unworkable),
        TypeError,
        r"model must be an estimator, not its class: give Unworkable\(\)",
    ),
    (
        lambda _: validated(SAMPLES.X),
        TypeError,
        "samples must be Samples, such as training_samples draws, not a ndarray",
    ),
    (
        lambda _: validated(n_jobs=0),
        ValueError,
        "n_jobs must be at least 1, or -1 for all cores, not 0",
    ),
    (lambda to: stored(to, samples=None), TypeError, "samples must be Samples, .* not None"),
    (
        lambda to: stored(to, model=pds.learning.ChebyshevRegressor),
        TypeError,
        "ChebyshevRegressor is a class: give an instance",
    ),
    (
        lambda to: stored(to, model=lambda *bond: 1),
        ValueError,
        r"must return t_n and t_tau, an array of shape \(200, 2\), not \(\)",
    ),
    (lambda to: stored(3), TypeError, "folder must be text or a path, not 3"),
    (
        lambda to: stored(to, name=None),
        ValueError,
        "name None is not allowed: it must be text that matches",
    ),
    (
        lambda _: pds.CardText("x", cross_validation="x"),
        TypeError,
        "cross_validation must be a list of dictionaries, or None, not 'x'",
    ),
    (
        lambda _: pds.CardText("x", search=[{"rms": np.nan}]),
        ValueError,
        "search.0.rms: must be a finite number, text, a list or a table, not nan",
    ),
    (
        lambda _: pds.CardText("x", identification="x"),
        TypeError,
        "identification must be a dictionary, or None, not 'x'",
    ),
    (
        lambda to: pds.store(ENERGY, SAMPLES, LAW, to, "x", "1", "x"),
        ValueError,
        "predicts the target isochoric-energy, .* the target bond-force",
    ),
    (
        lambda _: pds.learning.surrogate_of(ENERGY, LAW, SAMPLES),
        ValueError,
        "predicts the target isochoric-energy, .* the target bond-force",
    ),
    (lambda _: pds.evaluate(object, LAW), TypeError, "object is a class: give an instance"),
    (
        lambda _: pds.evaluate("neo-hookean", LAW, "ab"),
        ValueError,
        "stretch_range must be two numbers, .* not 'ab'",
    ),
    (
        lambda _: pds.evaluate("neo-hookean", LAW, None, 100, -1),
        ValueError,
        "random_state must be from 0",
    ),
    (
        lambda _: pds.training_samples(LAW, near_rest=2.5),
        ValueError,
        "near_rest must be from 0 to 1, not 2.5",
    ),
    (
        lambda _: pds.training_samples(LAW, off_surface=np.nan),
        ValueError,
        "off_surface must be from 0 to 1, not nan",
    ),
    (
        lambda _: pds.training_samples(LAW, random_state="x", target="sheet-energy"),
        TypeError,
        "random_state must be a whole number, not 'x'",
    ),
    (
        lambda _: pds.learning.algorithm_1(LAW, horizon=-1.0),
        ValueError,
        "horizon must be positive and finite, not -1",
    ),
    (
        lambda _: pds.learning.algorithm_1(LAW, weight="x"),
        ValueError,
        "unknown weight 'x'; there are",
    ),
    (
        lambda _: pds.surrogate_pipeline(features=[]),
        ValueError,
        r"unknown features \[\]; there are",
    ),
    (
        lambda _: pds.LevenbergMarquardtRegressor(()).fit(SAMPLES.X, SAMPLES.y),
        ValueError,
        "at least one layer",
    ),
    (lambda _: pds.load_test_data(None), TypeError, "test data must be text or a path, not None"),
    (lambda _: pds.load_scene(3), TypeError, "a scene's reference must be text or a path, not 3"),
    (
        lambda _: pds.load_surrogate(None),
        TypeError,
        "an artifact's reference must be text or a path, not None",
    ),
    (lambda _: pds.load_result(None), TypeError, "folder must be text or a path, not None"),
    (lambda to: pds.study(3, to), TypeError, "a study must be text or a path, not 3"),
    (
        lambda _: pds.preview("uniaxial"),
        TypeError,
        "scene must be Scene, such as load_scene gives, not 'uniaxial'",
    ),
    (
        lambda _: pds.simulate("uniaxial", threads="x"),
        TypeError,
        "threads must be a whole number, not 'x'",
    ),
]


@pytest.mark.parametrize(
    ("call", "kind", "message"), BAD, ids=[re.sub(r"\W+", "-", message)[:50] for *_, message in BAD]
)
def test_bad_arguments_are_told_before_work_starts(call, kind, message, tmp_path):
    with raising(message, kind):
        call(tmp_path)
    assert list(tmp_path.iterdir()) == []
