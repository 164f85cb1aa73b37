"""Bonds that break in bodies in space: energy account, resuming, tips and damage; the trouser
tear and the disc crack.
"""

import numpy as np
import pytest
from described import SCENES
from refusals import raising
from stopping import Killed, while_bonds_break

import pdsurrogate as pds
from pdsurrogate.run import checkpoints, transient
from pdsurrogate.run.simulate import simulate
from pdsurrogate.scenes import Scene, SceneError, load_scene

STRIP = SCENES["strip in space"]
"""Lengths in spacings, the speed of shear waves 1."""


def account(rows):
    """What the energies of the last row miss of what was put in, over that."""
    first, last = rows[0], rows[-1]
    put_in = first["kinetic_energy"] + first["strain_energy"] + last["work"]
    return (
        sum(
            last[key]
            for key in ("kinetic_energy", "strain_energy", "damped_energy", "released_energy")
        )
        / put_in
        - 1
    )


def in_dynamics(result):
    return [row for row in result.history if "time" in row]


@pytest.fixture(scope="module")
def torn(tmp_path_factory):
    return simulate(Scene.model_validate(STRIP), folder=tmp_path_factory.mktemp("torn"))


def test_a_crack_in_space(torn):
    """The tip starts at the precut's end and goes on along its plane.

    The energy account has no error of the time step but where forces are not linear within one.
    Until a bond breaks the power that the viscosity takes is summed over rows of 20 steps by the
    trapezoidal rule, 0.07 % while the motion begins; with most of so small a strip torn it is 0.1
    %.
    """
    crack, points = torn.summary["crack"], torn.body.points
    start, tip = crack["start"]["x"], crack["tips"][-1]["tip"]
    assert len(start) == len(tip) == 3
    np.testing.assert_allclose(start[:2], [5.0, 5.0], atol=1.0)
    assert tip[0] > 8
    assert abs(tip[1] - 5) < 1.75
    rows = in_dynamics(torn)
    assert abs(account([row for row in rows if row["broken_bonds"] == 0])) < 0.001
    assert abs(account(rows)) < 0.003
    damage = torn.field("damage")
    assert damage[(np.abs(points[:, 1] - 5) < 1) & (points[:, 0] < 8)].min() > 0.2
    assert damage[np.abs(points[:, 1] - 5) > 3].max() == 0


def test_the_account_of_a_strip_has_no_error_of_the_time_step(monkeypatch):
    """With what viscosity takes found in every step; the grips' part of it and the end of the
    stage within a step are in it.
    """
    monkeypatch.setattr(transient, "STEPS_PER_ROW", 1)
    pulled = {**STRIP["dynamics"], "stretch": 1.34, "outputs": 1}
    rows = in_dynamics(
        simulate(
            Scene.model_validate(
                {**STRIP, "fracture": {"critical_stretch": 9.0}, "dynamics": pulled}
            )
        )
    )
    assert len(rows) > 50
    assert rows[-1]["damped_energy"] > 0.05
    assert abs(account(rows)) < 1e-6


def test_a_crack_in_space_resumes_to_the_same_bits(torn, tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoints, "SECONDS_BETWEEN_CHECKPOINTS", 0.0)

    scene = Scene.model_validate(STRIP)
    with pytest.raises(Killed), while_bonds_break():
        simulate(scene, folder=tmp_path)
    resumed = simulate(scene, folder=tmp_path, resume=True)
    assert resumed.history == torn.history
    assert resumed.summary["crack"] == torn.summary["crack"]
    np.testing.assert_array_equal(resumed.field("damage"), torn.field("damage"))
    np.testing.assert_array_equal(resumed.displacement(), torn.displacement())


def test_cuts_of_scenes_in_space():
    with raising(r"precuts", SceneError):
        load_scene("trousers", {"precuts": [{"start": [0.0, 8.0], "end": [16.0, 8.0]}]})


@pytest.mark.slow
def test_a_small_trouser_tear():
    """Legs of 4 mm, torn by 6 mm. The diameter is that of strips; trouser tears need 3 to 9 %
    less.

    As in tests with a groove the bonds across the plane of the cut are weaker than others. A crack
    of this resolution strays otherwise, and its energy depends on the time step: 1.2 and 1.4.
    """
    regions = {
        name: {"box": [[0.0, low, 0.66], [0.46, low + 4, 1.01]]}
        for name, low in (("one", 0.0), ("two", 4.0))
    }
    regions["upper"] = {"box": [[-1.0, 4.0, -1.0], [19.0, 9.0, 3.0]]}
    rubber = load_scene("trousers").material
    dynamics = {"duration": 14.0, "density": 1e-3, "damping": 0.1, "viscosity": 0.002}
    changes = {
        "body.size": [18.0, 8.0, 2.0],
        "precuts": [{"corner": [-1.0, 4.0, -1.0], "sides": [[9.0, 0.0, 0.0], [0.0, 0.0, 4.0]]}],
        "regions": regions,
        "materials": [{"region": "upper", "material": rubber}],
        "fracture.energy": 3.0,
        "fracture.interfaces": [{"between": ["rest", "upper"], "energy": 1.0}],
        "steps": [{"to": 3.0}, {"to": 17.0, "outputs": 14, "dynamics": dynamics}],
    }
    result = simulate(load_scene("trousers", changes))
    rows = in_dynamics(result)[:-1]  # in the last row the legs come to a halt
    force = np.mean([row["force_one_3"] for row in rows if row["t"] > 11])
    assert pds.tearing_energy(result.scene.material.build(), force, 4.0, 2.0) == pytest.approx(
        1.0, rel=0.15
    )
    assert abs(account(rows)) < 0.01
    assert result.summary["crack"]["tips"][-1]["tip"][0] > 13
