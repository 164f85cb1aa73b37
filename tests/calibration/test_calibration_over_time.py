"""Laws with branches and softening from fields and forces over time."""

import json
import shlex
from unittest.mock import patch

import numpy as np
import pytest
from commands import commanded
from described import SCENES
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.artifacts.material import in_words, material_on
from pdsurrogate.calibration.asked import times_of
from pdsurrogate.calibration.measured import MeasuredScene
from pdsurrogate.calibration.reporting import report
from pdsurrogate.calibration.scatter import Rows
from pdsurrogate.materials import Branch, Memory, NeoHookean, Softening

START = {
    "law": "neo-hookean",
    "bulk_modulus": 100.0,
    "branches": [{"modulus": 0.8, "time": 1.2}],
}
SHEET = SCENES["relaxing sheet"]
THINNING = {"modulus": 1.0, "times": [(0.1, 1.0), (1.0, 0.1)]}
PLACES = np.array([(x, y) for x in np.linspace(0.3, 1.7, 6) for y in (0.2, 0.5, 0.8)])
NOISE, FORCE_NOISE = 5e-4, 5e-3


def scene_of(**changes):
    return pds.Scene(**{**SHEET, "material": START, **changes})


def measured(scene, law, rows):
    numbers = rows[:, :2].astype(int).T
    return MeasuredScene(scene, Rows(*numbers, rows[:, 2:])).simulate(law)[0]


def fitted(scene, rows, y, law="neo-hookean", deviation=1e-3):
    """Return the law at the spacing of the scene, which made the data: no discretization error."""
    with patch("pdsurrogate.calibration.fitting.ORDER", 60.0):
        model = pds.SceneRegressor(scene, law, refine=1)
        return model.fit(rows, y, standard_deviation=deviation)


def test_a_branch_comes_back_from_fields_and_forces_of_a_ramp_and_a_hold(random):
    scene, steps = scene_of(), (1, 2, 3)
    fields = [(step, axis, *place) for step in steps for axis in (1, 2) for place in PLACES]
    rows = np.array([*fields, *((step, 0, 0.0, 0.0) for step in steps)])
    deviation = np.where(rows[:, 1] > 0, NOISE, FORCE_NOISE)
    law = NeoHookean(0.8, 80.0, memory=Memory((Branch(0.5, 1.5),)))
    y = measured(scene, law, rows) + deviation * random.standard_normal(len(rows))
    model = fitted(scene, rows, y, deviation=deviation)
    assert model.parameter_names_ == ["shear_modulus", "branches.0.modulus", "branches.0.time"]
    off = (model.parameters_ - [0.8, 0.5, 1.5]) / model.standard_errors_
    assert (np.abs(off) < 2).all()
    assert (model.standard_errors_ < 0.1 * model.parameters_).all()
    assert model.at_bound_ == model.undetermined_ == []
    assert model.lack_of_fit_ == pytest.approx(1.0, abs=4 * (2 / len(rows)) ** 0.5)
    covariance = model.law_covariance()
    assert covariance.names == (
        *("shear_modulus", "bulk_modulus", "branches.0.modulus", "branches.0.time"),
    )
    assert report(model, rows, y, ["force"])["law"]["branches"][0]["time"] == model.parameters_[2]
    errors = pds.simulate(scene_of(material=model.law_.describe()), "bond-energy").standard_errors(
        ["nominal_stress"], covariance
    )
    assert 0 < errors["nominal_stress"] < FORCE_NOISE


def test_softening_comes_back_from_the_forces_of_a_cycle():
    """Exact forces; beta is zero in the scene, and no unknown."""
    material = {**START, "branches": [], "softening": {"r": 1.7, "m": 0.07}}
    scene = scene_of(material=material, stretches=[1.4, 1.3, 1.15], times=[])
    rows = np.array([(step, 0, 0.0, 0.0) for step in (1, 2, 3)])
    law = NeoHookean(0.8, 80.0, memory=Memory((), Softening(1.6, 0.06)))
    model = fitted(scene, rows, measured(scene, law, rows))
    assert model.parameter_names_ == ["shear_modulus", "softening.r", "softening.m"]
    np.testing.assert_allclose(model.parameters_, [0.8, 1.6, 0.06], rtol=1e-3)


@pytest.mark.parametrize(
    ("changes", "law", "words"),
    [
        ({}, None, "scene sheet: an energy without a law has no branches and no softening"),
        ({"times": []}, "neo-hookean", "scene sheet: times: missing"),
        (
            {"material": {"law": "neo-hookean", "branches": [THINNING]}},
            "neo-hookean",
            "branches whose times depend on the overstress are not fitted",
        ),
    ],
)
def test_what_cannot_be_fitted_is_refused_with_the_reason(changes, law, words):
    rows = [[step, 0, 0.0, 0.0] for step in (1, 2, 3)]
    with raising(words):
        fitted(scene_of(**changes), rows, [0.5, 0.4, 0.3], law)


def test_times_of_outputs_end_before_dynamics():
    moving = {"stretch": 1.4, "stretch_rate": 0.1, "density": 1.0}
    assert times_of(scene_of(dynamics=moving)).tolist() == SHEET["times"]


@pytest.mark.slow
def test_the_command_stores_branches_with_their_unit_of_time_and_rates(tmp_path):
    """Times are minutes, and a scene in seconds converts them; forces are those of 2 mm."""
    changes = {"material": START, "units.time": "min", "spacing": 0.25, "reference": None}
    changes |= {key: SHEET[key] for key in ("stretches", "times")}
    scene = pds.load_scene("uniaxial", changes)
    law = NeoHookean(0.8, 80.0, memory=Memory((Branch(0.5, 1.5),)))
    rows = np.array([(step, 0, 0.0, 0.0) for step in (1, 2, 3)])
    newtons = 0.02 * np.array([0.0, *measured(scene, law, rows)])  # of kPa cm
    seconds = 60 * np.array([0.0, *SHEET["times"]])
    table = "\n".join(f"{t},{f}" for t, f in zip(seconds, newtons, strict=True))
    (tmp_path / "machine.csv").write_text(f"Time (s),Load (N)\n{table}\n")
    command = ["calibrate uniaxial rubber --forces", tmp_path / "machine.csv"]
    command.append("--thickness 2mm --law neo-hookean --refine 1")
    for key, value in changes.items():
        text = in_words(scene.law()) if key == "material" else json.dumps(value)
        if value is not None:
            change = shlex.quote(f"{key}={text}")
            command.append(f"--set {change}")
    commanded(command, "--out", tmp_path)
    card = pds.load_card(tmp_path / "rubber")
    assert card.domain.rates == pytest.approx((0.3 / 6 / 60, 0.3 / 0.4 / 60))
    taken = pds.load_scene("uniaxial", {"times": [1.0], "units.time": "s"}, stretches=[1.1])
    branch = material_on(card, taken).memory.branches[0]
    assert branch.time == pytest.approx(90.0, rel=1e-2)
