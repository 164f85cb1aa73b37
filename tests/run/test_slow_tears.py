"""Tears in equilibrium: the energy that they need, their account, the order in which bonds break,
and what is refused.
"""

import dataclasses
import itertools
import sys
import warnings
from contextlib import nullcontext

import numpy as np
import pytest
from bodies import sheet
from stopping import Killed, while_bonds_break

import pdsurrogate as pds
from pdsurrogate.cli.simulation import print_result
from pdsurrogate.materials import homogeneous
from pdsurrogate.problem import compile_scene
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.run import account, checkpoints, tear_window, tearing
from pdsurrogate.run.damage import Damage

RUBBER = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 20.0}
ENERGY = 0.35


def strip(**changes):
    """Strip in pure shear with a precut, of 12 rows, whose G is that of an infinite strip."""
    given = {
        "name": "strip",
        "spacing": 1 / 12,
        "horizon_ratio": 2.2,
        "body": {"shape": "rectangle", "size": [4.0, 1.0]},
        "precuts": [{"start": [-1.0, 0.5], "end": [1.5, 0.5]}],
        "material": RUBBER,
        "grips": [{"edge": "bottom"}, {"edge": "top", "travel": 1.0}],
        "stretches": [1.4, 1.6],
        "fracture": {"energy": ENERGY},
    }
    return pds.Scene.model_validate(given | changes)


def cantilever(**changes):
    """Double cantilever, whose ends move apart: it tears stably."""
    given = {
        "name": "cantilever",
        "spacing": 1 / 8,
        "horizon_ratio": 2.2,
        "body": {"shape": "rectangle", "size": [3.0, 1.0]},
        "precuts": [{"start": [-1.0, 0.5], "end": [1.0, 0.5]}],
        "material": RUBBER,
        "regions": {
            "up": {"box": [[-0.1, 0.5], [0.2, 1.1]]},
            "down": {"box": [[-0.1, -0.1], [0.2, 0.5]]},
        },
        "prescribed": [
            {"region": "up", "x1": 0.0, "x2": 1.0},
            {"region": "down", "x1": 0.0, "x2": -1.0},
        ],
        "steps": [{"to": 1.0, "outputs": 5}],
        "fracture": {"critical_stretch": 1.8},
    }
    return pds.Scene.model_validate(given | changes)


def short():
    """A smaller strip."""
    return strip(
        spacing=1 / 8,
        body={"shape": "rectangle", "size": [1.5, 1.0]},
        precuts=[{"start": [-1.0, 0.5], "end": [0.75, 0.5]}],
        fracture={"critical_stretch": 1.8},
        stretches=[1.3, 1.6],
    )


@pytest.fixture(scope="module")
def torn():
    return pds.simulate(strip(), "bond-energy", threads=1)


@pytest.fixture(scope="module")
def opened():
    return pds.simulate(cantilever(), "bond-energy", threads=1)


def test_a_strip_tears_at_its_fracture_energy_and_comes_apart(torn):
    """G = W h at the peak, as accurate as in dynamics (`test_fracture_energy.py`)."""
    crack = torn.summary["crack"]
    law = torn.scene.law()
    found = homogeneous.pure_shear(law, crack["peak"]["stretch"]).energy_density
    assert found == pytest.approx(ENERGY, rel=0.07)
    assert crack["through"]
    assert torn.summary["status"] == "done"
    assert torn.levels[-1]["stretch"] < 1.6
    assert abs(torn.history[-1]["nominal_stress"]) < 1e-3 * crack["peak"]["nominal_stress"]
    path = crack["path"]  # of a crack that jumps between two outputs
    assert abs(path["direction"]) < 2.0
    assert path["stray"] < torn.summary["spacing"]
    assert torn.summary["peak_nominal_stress"] == crack["peak"]["nominal_stress"]


def test_the_energy_put_in_is_stored_released_or_damped(torn, opened):
    for result in (torn, opened):
        account = result.summary["quasi_static"]
        assert abs(account["greatest_energy_gap"]) < 0.2
        assert account["remark"] is None
        rows = result.history
        assert account["energy_put_in"] == max(row["work"] for row in rows)
        assert abs(account["energy_gap"]) <= abs(account["greatest_energy_gap"])
        breaks = [
            after["broken_bonds"] > before["broken_bonds"]
            for before, after in itertools.pairwise(rows)
        ]
        assert account["events"] == sum(breaks)
        for before, after in itertools.pairwise(result.history):
            for key in ("released_energy", "damped_energy", "broken_bonds"):
                # Damped energy is a difference of energies in single precision.
                assert after[key] >= before[key] - 1e-6
    last = torn.history[-1]
    assert last["released_energy"] + last["damped_energy"] == pytest.approx(last["work"], rel=2e-3)


def test_a_stable_tear_follows_its_load(opened):
    """The crack grows with the opening, bond by bond, and no avalanche crosses a fifth of what is
    left.
    """
    tips = opened.summary["crack"]["tips"]
    broken = [tip["broken_bonds"] for tip in tips]
    assert broken == sorted(broken)
    assert len({*broken[1:]}) >= 4
    events = np.diff([row["broken_bonds"] for row in opened.history])
    assert events.max() <= 5  # those of one spacing
    assert not opened.summary["crack"]["through"]
    forces = [abs(row["force_up_2"]) for row in opened.history]
    assert forces[-1] < 0.95 * max(forces)


def test_what_softens_in_a_fall_is_not_released():
    """Gradients change where bonds break, and there softening takes energy: of the fall."""
    stiff = {"law": "neo-hookean", "shear_modulus": 3.0, "bulk_modulus": 60.0}
    softening = {"r": 1.5, "m": 0.1, "beta": 0.0}
    scene = strip(
        spacing=1 / 8,
        body={"shape": "rectangle", "size": [2.0, 1.0]},
        precuts=[{"start": [-1.0, 0.5], "end": [0.7, 0.5]}],
        regions={"upper": {"box": [[0.0, 0.5], [2.0, 1.0]]}},
        materials=[{"region": "upper", "material": {**stiff, "softening": softening}}],
        stretches=[1.33],
        fracture={"critical_stretch": 1.6},
    )
    result = pds.simulate(scene, "bond-energy", threads=1)
    damped = [row["damped_energy"] for row in result.history]
    assert result.history[-1]["broken_bonds"] > 2
    assert min(np.diff(damped)) > -1e-9


def test_a_load_that_turns_between_outputs_tears_as_far_as_it_goes(opened):
    """The turn is in the history too, and unloading breaks nothing."""
    sides = [("up", 1.0), ("down", -1.0)]
    amplitude = [[0.0, 0.0], [0.5, 1.0], [1.0, 0.0]]
    scene = cantilever(
        prescribed=[
            {"region": side, "x1": 0.0, "x2": way, "amplitude": amplitude} for side, way in sides
        ],
        steps=[{"to": 1.0, "outputs": 1}],
    )
    result = pds.simulate(scene, "bond-energy", threads=1)
    (turn,) = [row for row in result.history if row["t"] == 0.5]
    last = opened.history[-1]
    assert turn["force_up_2"] == pytest.approx(last["force_up_2"], rel=0.02)
    broken = result.history[-1]["broken_bonds"]
    assert broken == turn["broken_bonds"] == pytest.approx(last["broken_bonds"], abs=1)
    assert abs(result.summary["quasi_static"]["greatest_energy_gap"]) < 0.5


def test_the_work_of_obstacles_is_that_of_their_forces_before_and_after():
    scene = cantilever(
        body={"shape": "rectangle", "size": [1.5, 1.0]},
        precuts=[{"start": [0.75, -1.0], "end": [0.75, 0.4]}],
        regions={},
        prescribed=[{"region": side, "x1": 0.0, "x2": 0.0} for side in ("left", "right")],
        obstacles=[{"name": "disc", "disc": {"center": [0.75, 1.4], "radius": 0.4}, "x2": -0.3}],
        fracture={"critical_stretch": 1.15},
    )
    result = pds.simulate(scene, "bond-energy", threads=1)
    assert result.summary["crack"]["broken_bonds"] > 0
    assert abs(result.summary["quasi_static"]["greatest_energy_gap"]) < 0.5


def test_the_work_of_a_place_between_points_is_that_of_all_points_around_it():
    """With the reaction of the held one of two points alone half the work was missing."""
    scene = cantilever(
        regions={},
        prescribed=[
            {"region": {"near": [0.0, 0.75]}, "x1": 0.0, "x2": 0.6},
            {"region": {"near": [0.0, 0.25]}, "x1": 0.0, "x2": -0.6},
        ],
        fracture={"critical_stretch": 1.2},
    )
    result = pds.simulate(scene, "bond-energy", threads=1)
    assert result.summary["crack"]["broken_bonds"] > 0
    assert abs(result.summary["quasi_static"]["greatest_energy_gap"]) < 0.5


def test_a_body_that_its_loads_carry_away_comes_apart():
    """Under a dead load no equilibrium follows the first broken bonds."""
    scene = cantilever(
        body={"shape": "rectangle", "size": [1.0, 1.0]},
        precuts=[{"start": [-1.0, 0.5], "end": [0.4, 0.5]}],
        regions={},
        prescribed=[{"region": "bottom", "x1": 0.0, "x2": 0.0}],
        loads=[{"region": "top", "traction": [0.0, 0.8]}],
    )
    result = pds.simulate(scene, "bond-energy", threads=1)
    crack = result.summary["crack"]
    assert crack["through"]
    assert 0.2 < crack["peak"]["t"] < 1.0
    assert abs(result.summary["quasi_static"]["greatest_energy_gap"]) < 0.5


@pytest.mark.parametrize(
    ("outputs", "gap"), [(1, 10.0), pytest.param(16, 0.5, marks=pytest.mark.slow)]
)
def test_a_held_load_tears_a_material_that_creeps_after_a_time(outputs, gap):
    """Branches and softening are in the balance, time stands still in an avalanche, and goes on
    after it without an output.
    """
    memory = {
        "branches": [{"modulus": 2.0, "time": 1.0}],
        "softening": {"r": 4.0, "m": 0.5, "beta": 0.1},
    }
    scene = cantilever(
        body={"shape": "rectangle", "size": [1.0, 1.0]},
        precuts=[{"start": [-1.0, 0.5], "end": [0.5, 0.5]}],
        plane="strain",
        material={**RUBBER, **memory},
        regions={},
        prescribed=[{"region": "bottom", "x1": 0.0, "x2": 0.0}],
        loads=[{"region": "top", "traction": [0.0, 0.3]}],
        steps=[{"to": 1.0, "duration": 0.1}, {"to": 1.0, "duration": 5.0, "outputs": outputs}],
        fracture={"critical_stretch": 1.6},
    )
    result = pds.simulate(scene, "bond-energy", threads=1)
    crack = result.summary["crack"]
    assert 0.11 < crack["start"]["time"] < 4.0
    rows = result.history
    times = [row["time"] for row in rows if 0 < row["broken_bonds"] < rows[-1]["broken_bonds"]]
    assert max(times) > 1.2 * min(times)
    assert all(after["time"] >= before["time"] for before, after in itertools.pairwise(rows))
    assert min(rows[-1][f"dissipated_by_{cause}"] for cause in ("branches", "softening")) > 0
    assert abs(result.summary["quasi_static"]["greatest_energy_gap"]) < gap


def test_neither_the_excess_nor_the_tolerance_changes_the_peak(torn, monkeypatch):
    monkeypatch.setattr(tearing, "OVERLOAD", tearing.OVERLOAD / 2)
    monkeypatch.setattr(tearing, "FINE", tearing.FINE / 2)
    tighter = strip(stretches=[1.4, 1.515])
    peaks = [torn.summary["crack"]["peak"]]
    peaks.append(pds.simulate(tighter, "bond-energy", threads=1).summary["crack"]["peak"])
    stresses = [peak["nominal_stress"] for peak in peaks]
    assert stresses[1] == pytest.approx(stresses[0], rel=2e-3)


@pytest.mark.parametrize("stretches", [[2.0], [1.02, 1.1]])
def test_the_first_bond_breaks_at_its_limit_however_far_the_loading_goes(stretches):
    """The excess is at most that of an event: of a critical stretch near 1 the way to the first
    event was divided as if bonds at rest had no stretch, and it broke at 1.2 times its limit.
    """
    critical = 1.1
    summary = pds.simulate(
        strip(fracture={"critical_stretch": critical}, stretches=stretches), "bond-energy"
    ).summary
    finely = strip(
        fracture={"critical_stretch": 9.0}, stretches=[summary["crack"]["start"]["stretch"]]
    )
    held = pds.simulate(finely, "bond-energy")
    found = pds.greatest_bond_stretch(held.body, held.body.points + held.displacement())
    assert found == pytest.approx(critical, rel=2 * tearing.OVERLOAD)


def test_a_gap_in_the_balance_of_energy_is_told(monkeypatch):
    """As in dynamics: here of a part of the energy that every tear exceeds."""
    monkeypatch.setattr(account, "GAP_WARNED", 1e-12)
    scene = strip(spacing=0.125, fracture={"critical_stretch": 1.5}, stretches=[1.45])
    with pytest.warns(UserWarning, match="the energy balance has an error of"):
        pds.simulate(scene, "bond-energy", threads=1)


def test_a_jump_beyond_the_limit_is_told(monkeypatch, caplog):
    """Where the greatest load leaps, no increment ends at a small excess: here since the limits of
    all bonds fall to a part of them at a stretch.
    """
    load_of = Damage.greatest_load
    whole = {}

    def leaping(damage, force):
        intact = np.isfinite(damage.limits)
        start = whole.setdefault(damage, damage.limits.copy())
        top = force.positions[: len(damage.body), 1].max()
        fallen = top > 1.1 and not damage.broken.any()
        damage.limits[intact] = start[intact] * (0.5 if fallen else 1.0)
        return load_of(damage, force)

    monkeypatch.setattr(Damage, "greatest_load", leaping)
    scene = strip(spacing=0.125, fracture={"critical_stretch": 1.5}, stretches=[1.3])
    with pytest.warns(UserWarning, match="jumped 1 times"):
        pds.simulate(scene, "bond-energy", threads=1)
    assert sum("jumped to" in record.getMessage() for record in caplog.records) == 1


def test_avalanches_that_wait_for_no_equilibrium_break_the_same_bonds(monkeypatch):
    def broken_and_evaluations():
        result = pds.simulate(short(), "bond-energy", threads=1)
        return result.field("damage"), result.summary["n_force_evaluations"]

    damage, evaluations = broken_and_evaluations()
    monkeypatch.setattr(tearing, "ROUGH", 0.0)
    waiting, more = broken_and_evaluations()
    np.testing.assert_array_equal(damage, waiting)
    assert evaluations < more


@pytest.mark.parametrize(
    ("rate", "changes", "process", "reason"),
    [
        (0.0011, {}, "dynamics", "0.0011 times the speed of shear waves"),
        (0.0009, {}, "quasi-static", "0.0009 times the speed of shear waves, less than 0.001"),
        (0.0009, {"process": "dynamics"}, "dynamics", "as the scene says"),
        (0.1, {"process": "quasi-static"}, "quasi-static", "as the scene says"),
    ],
)
def test_a_tear_is_one_in_equilibrium_where_grips_move_slowly_against_waves(
    rate, changes, process, reason
):
    """The wave speed is 1, and so is the distance of the grips. Settings of dynamics say how far a
    slow tear goes.
    """
    scene = strip(
        dynamics={"stretch": 1.7, "stretch_rate": rate, "density": 1.0, "outputs": 3},
        fracture={"critical_stretch": 2.0, **changes},
    )
    slow = process == "quasi-static"
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        problem = compile_scene(scene, checked_models(scene, pds.load_surrogate("bond-energy")))
    *_, last = problem.stages
    assert (last.inertia is None) == last.tears == slow
    assert (last.to, last.outputs) == (1.7, 3)
    assert not slow or last.duration == pytest.approx(0.1 / rate)
    assert reason in problem.critical_stretches.summary["process"]["reason"]
    left_out = any("viscosity have no effect" in str(one.message) for one in found)
    assert left_out == (slow and not changes)


@pytest.mark.parametrize("duration", [2000.0, 20.0])
def test_a_tear_that_its_rate_makes_slow_may_hold_a_place_between_points(duration):
    moving = {"duration": duration, "density": 1.0}
    held = [{"region": side, "x2": way} for side, way in (("up", 1.0), ("down", -1.0))]
    scene = cantilever(
        steps=[{"to": 0.1}, {"to": 1.0, "dynamics": moving}],
        prescribed=[*held, {"region": {"near": [3.0, 0.5]}, "name": "end", "x1": 0.0, "x2": 0.0}],
    )
    models = checked_models(scene, pds.load_surrogate("bond-energy"))
    refused = pytest.raises(pds.SceneError, match=r"2\.region: 2 points are equally near")
    with refused if duration < 1000 else nullcontext():
        assert compile_scene(scene, models).loading.supports


def test_a_crack_that_runs_in_a_held_body_keeps_its_inertia():
    held = [{"region": side, "x1": 0.0, "x2": 0.0} for side in ("up", "down")]
    moving = {"duration": 1.0, "density": 1.0}
    scene = cantilever(prescribed=held, steps=[{"to": 0.5}, {"to": 1.0, "dynamics": moving}])
    problem = compile_scene(scene, checked_models(scene, pds.load_surrogate("bond-energy")))
    assert problem.critical_stretches.summary["process"]["reason"] == "since no held part moves"
    assert problem.stages[-1].inertia is not None


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match=r"fracture.process: needs dynamics, or process"):
        strip(fracture={"energy": 1.0, "process": "dynamics"})


def test_a_scene_that_does_not_tear_slowly_does_not_load_it(monkeypatch):
    names = [
        "pdsurrogate.run.tearing",
        "pdsurrogate.run.tear_account",
        "pdsurrogate.run.tear_window",
    ]
    for name in names:
        monkeypatch.delitem(sys.modules, name, raising=False)
    pds.simulate(strip(spacing=0.25, precuts=[], fracture=None), "bond-energy")
    assert not {*names} & sys.modules.keys()


def test_of_each_place_the_most_loaded_bonds_break_first():
    """Two places farther apart than a horizon, in a sheet that is stretched more and more along
    x1, and one bond as long as the first within a difference.
    """
    body = sheet(0.1)
    damage = Damage(body, 1.5)
    bonds = body.bonds
    middles = (body.all_points[bonds.first] + body.all_points[bonds.second]) / 2
    near = np.linalg.norm(middles[:, None] - [[0.25, 0.5], [0.75, 0.5]], axis=2).argmin(axis=0)
    around = [
        np.flatnonzero(np.linalg.norm(middles - middles[pair], axis=1) < body.horizon)
        for pair in near
    ]
    pairs = np.unique(np.concatenate(around))
    loads = np.full(len(pairs), 1.1)
    one, other = np.searchsorted(pairs, near)
    loads[one], loads[other] = 1.3, 1.2
    first = damage.foremost(pairs, loads, 0.01)
    assert {*near} <= {*first.tolist()}
    # Others wait for them, except those farther than a horizon from both.
    apart = np.linalg.norm(middles[first][:, None] - middles[near], axis=2).min(axis=1)
    assert ((apart == 0) | (apart > body.horizon)).all()
    twin = next(number for number in around[0] if number != near[0])
    loads[np.searchsorted(pairs, twin)] = 1.295
    assert twin in damage.foremost(pairs, loads, 0.01)
    assert twin not in damage.foremost(pairs, loads, 0.001)


def test_windows_break_the_same_bonds(monkeypatch):
    """A crack along a row of a lattice takes them one by one; its surroundings follow later."""
    scene = cantilever(spacing=1 / 12)
    whole = pds.simulate(scene, "bond-energy", threads=1)
    monkeypatch.setattr(tear_window, "MOST", 1.0)
    part = pds.simulate(scene, "bond-energy", threads=1)
    np.testing.assert_array_equal(part.field("damage"), whole.field("damage"))
    assert part.summary["n_force_evaluations"] < whole.summary["n_force_evaluations"]
    forces = [result.summary["crack"]["peak"]["force"] for result in (part, whole)]
    assert forces[0] == pytest.approx(forces[1], rel=tearing.OVERLOAD)
    assert abs(part.summary["quasi_static"]["greatest_energy_gap"]) < 0.2
    works = [result.history[-1]["work"] for result in (part, whole)]
    assert works[0] == pytest.approx(works[1], rel=tearing.OVERLOAD)


@pytest.mark.parametrize(
    ("scene", "bonds"),
    [(short, 0), (short, 15), (cantilever, 15)],
    ids=["before", "in an avalanche", "with windows"],
)
def test_a_killed_slow_tear_resumes_to_the_same_bits(tmp_path, monkeypatch, scene, bonds):
    monkeypatch.setattr(tear_window, "MOST", 1.0)
    whole = pds.simulate(scene(), "bond-energy", threads=1)
    monkeypatch.setattr(checkpoints, "SECONDS_BETWEEN_CHECKPOINTS", 0.0)
    monkeypatch.setattr(checkpoints, "PAUSE_SHARE", 0.0)
    with pytest.raises(Killed), while_bonds_break(bonds):
        pds.simulate(scene(), "bond-energy", threads=1, folder=tmp_path)
    resumed = pds.simulate(scene(), "bond-energy", threads=1, folder=tmp_path, resume=True)
    assert resumed.history == whole.history
    assert resumed.levels == whole.levels
    for key in ("crack", "quasi_static", "n_force_evaluations"):
        assert resumed.summary[key] == whole.summary[key]
    np.testing.assert_array_equal(resumed.displacement(), whole.displacement())


@pytest.mark.parametrize(
    ("status", "since", "said"),
    [
        ("done", 0, "the body holds together, and its force was still rising"),
        ("done", 7, "the body holds together Energy"),
        ("failed", 7, "failed before the body came apart: its peak is a lower bound"),
    ],
)
def test_a_force_rises_only_where_no_bond_broke_after_the_peak(torn, status, since, said, capsys):
    """A run that ends in an avalanche has its row before the first of its bonds as its last."""
    peak = torn.summary["crack"]["peak"]
    last = next(row for row in torn.history if row["nominal_stress"] == peak["nominal_stress"])
    crack = {"through": False, "broken_bonds": last["broken_bonds"] + since}
    ended = dataclasses.replace(
        torn,
        summary=torn.summary | {"status": status, "crack": torn.summary["crack"] | crack},
        history=torn.history[: torn.history.index(last) + 1],
    )
    print_result(ended)
    assert said in " ".join(capsys.readouterr().out.split())
