"""Programs of steps: in equilibrium and in dynamics, automatic increments, forces by name,
resuming, and what is said on failure.
"""

import json
import re

import numpy as np
import pytest
from refusals import raising
from runs import started
from stopping import interrupt, killed_with_levels

import pdsurrogate as pds
from pdsurrogate.progress import listening
from pdsurrogate.run import transient
from pdsurrogate.run.simulate import SimulationFailed, SimulationInterrupted, simulate

SHEET = {
    "name": "sheet",
    "spacing": 0.1,
    "body": pds.shapes.Rectangle(size=(1.0, 0.8)),
    "material": "neo-hookean",
}
CLAMPS = ({"region": "left", "x1": 0.0, "x2": 0.0}, {"region": "right", "x1": 1.0, "x2": 0.0})


def scene_of(steps=(1.0,), prescribed=CLAMPS, **changes):
    return pds.Scene(**SHEET | {"prescribed": prescribed, "steps": steps} | changes)


def gripped(**changes):
    grips = ({"edge": "left", "travel": 0.0}, {"edge": "right", "travel": 1.0})
    return pds.Scene(**SHEET | {"grips": grips} | changes)


def forces_of(history, name, component=1):
    return np.array(
        [row[f"force_{name}_{component}"] for row in history if f"force_{name}_{component}" in row]
    )


def dynamic(to, duration, outputs=1, **changes):
    return {
        "to": to,
        "outputs": outputs,
        "dynamics": {"duration": duration, "density": 0.01, **changes},
    }


def test_what_moves_at_the_end_of_a_program_has_its_velocity_there():
    """With viscosity, forces look a little ahead: the last row is that of a program that goes on
    alike.
    """
    step = dynamic(0.2, 0.2, viscosity=0.02)
    short = simulate(scene_of((step,)), "bond-energy").history[-1]
    longer = simulate(scene_of((step, dynamic(0.4, 0.2, viscosity=0.02))), "bond-energy").history
    same = next(row for row in longer if row["t"] == short["t"])
    for key in ("force_right_1", "force_left_1", "work", "damped_energy", "kinetic_energy"):
        assert short[key] == pytest.approx(same[key], rel=1e-10), key


def test_steps_follow_the_states_of_stretches():
    """The same problem said in both ways: stretch 1 + t."""
    short, general = (
        simulate(gripped(stretches=(1.2, 1.4)), "analytic"),
        simulate(scene_of((0.2, 0.4)), "analytic"),
    )
    for number, (level, other) in enumerate(zip(short.levels, general.levels, strict=True)):
        np.testing.assert_allclose(
            general.displacement(number), short.displacement(number), atol=1e-6
        )
        np.testing.assert_allclose(
            list(other["forces"].values()), list(level["forces"].values()), atol=1e-6
        )
    assert [(moment.run_time, moment.t, moment.time) for moment in general.states.moments] == [
        (1, 0.2, 0),
        (2, 0.4, 0),
    ]


def test_a_cycle_ends_at_rest_and_has_no_hysteresis():
    result = simulate(
        pds.load_scene("load-cycle", spacing=0.1, **{"solver.tolerance": 1e-8}), "bond-energy"
    )
    levels = {0: result.levels[0], 2: result.levels[2]}
    assert [level["t"] for level in result.levels] == [0.5, 1.0, 0.5, 0.0, -0.5, 0.0]
    for rest in (3, 5):
        assert np.abs(result.displacement(rest)).max() < 1e-6
        assert np.abs(list(result.levels[rest]["forces"].values())).max() < 1e-6
    assert levels[0]["forces"]["right"] == pytest.approx(levels[2]["forces"]["right"], abs=1e-6)
    assert levels[0]["energy"] == pytest.approx(levels[2]["energy"], rel=1e-6)
    assert result.levels[4]["forces"]["right"][0] < -0.1


@pytest.fixture
def every_step(monkeypatch):
    """A row of the history, and a term of the account, for every step."""
    monkeypatch.setattr(transient, "STEPS_PER_ROW", 1)


@pytest.mark.usefixtures("every_step")
def test_dynamics_follow_those_of_the_short_way():
    """From stretch 1.1 on at the same rate: the same motion and the same account, which closes."""
    damped = {"density": 0.01, "damping": 1.0, "viscosity": 1e-3, "safety": 0.1}
    short = simulate(
        gripped(
            stretches=(1.1,), dynamics={"stretch": 1.3, "stretch_rate": 2.0, "outputs": 2, **damped}
        ),
        "bond-energy",
    )
    general = simulate(scene_of((0.1, dynamic(0.3, 0.1, 2, **damped))), "bond-energy")
    rows, others = ([row for row in result.history if "time" in row] for result in (short, general))
    assert len(others) > 100
    for key in ("time", "work", "kinetic_energy", "strain_energy", "force_left_1", "force_right_2"):
        expected, found = ([row[key] for row in account] for account in (rows, others))
        np.testing.assert_allclose(
            found, expected, atol=1e-6 * np.abs(expected).max() + 1e-9, rtol=0
        )
    np.testing.assert_allclose(general.displacement(), short.displacement(), atol=1e-6)
    energies = [
        sum(row[key] for key in ("kinetic_energy", "strain_energy", "damped_energy")) - row["work"]
        for row in others
    ]
    np.testing.assert_allclose(energies, energies[0], atol=1e-5 * others[-1]["work"], rtol=0)


@pytest.mark.usefixtures("every_step")
def test_dynamics_may_stand_anywhere():
    """Loaded slowly, let swing, pulled while it swings, and brought to rest: at the end the
    equilibrium that slow loading leads to.
    """
    program = (0.1, dynamic(0.1, 0.2, 2), dynamic(0.2, 0.2), 0.2)
    result = simulate(scene_of(program), "bond-energy")
    slow = simulate(scene_of((0.2,)), "bond-energy")
    assert [level["step"] for level in result.levels] == [0, 1, 1, 2, 3]
    assert [level.get("time") for level in result.levels] == [
        None,
        *(pytest.approx(t, abs=0.01) for t in (0.1, 0.2, 0.4)),
        None,
    ]
    times = [moment.run_time for moment in result.states.moments]
    assert times == sorted(times)
    np.testing.assert_allclose(result.displacement(), slow.displacement(), atol=1e-5)
    # Nothing moves in the hold but rounding; the pull starts from rest, since a step of dynamics
    # keeps the velocities of the one before.
    kinetic = [row["kinetic_energy"] for row in result.history if row.get("step") == 1]
    assert max(kinetic) < 1e-8
    first = next(row for row in result.history if row.get("step") == 2)
    assert first["kinetic_energy"] < 1e-8
    # What the grips put in is there.
    last = [row for row in result.history if row.get("step") == 2][-1]
    gained = last["strain_energy"] + last["kinetic_energy"] - first["strain_energy"]
    assert last["work"] == pytest.approx(gained, rel=0.02)
    assert len(forces_of(result.history, "right")) > 10


DISC = {"disc": {"center": (0.4, 1.3), "radius": 0.5}, "x2": -0.5, "name": "disc"}


def test_dynamics_begin_with_the_contact_of_equilibrium():
    """A disc that stands still: the body rests, and its contact stays as it is."""
    program = ({"to": 0.3}, dynamic(0.3, 0.1))
    result = simulate(
        scene_of(program, body=pds.shapes.Rectangle(size=(0.8, 0.8)), obstacles=(DISC,)),
        "bond-energy",
    )
    before, after = (level["forces"]["disc"][1] for level in result.levels)
    assert after == pytest.approx(before, rel=1e-4)
    assert before < -0.1
    assert result.history[-1]["kinetic_energy"] < 1e-8
    assert abs(result.history[-1]["work"]) < 1e-6


@pytest.mark.parametrize(
    ("interrupted", "obstacles"), [(1, ()), (3, ()), (4, ()), (1, (DISC,)), (3, (DISC,))]
)
def test_a_program_resumes_to_the_same_bits(tmp_path, interrupted, obstacles):
    """After an output in equilibrium within a step, in dynamics, and after dynamics."""
    scene = scene_of(
        ({"to": 0.3, "outputs": 2}, dynamic(0.4, 0.1, 2), 0.2, 0.0),
        body=pds.shapes.Rectangle(size=(0.8, 0.8)),
        obstacles=obstacles,
    )
    whole = simulate(scene, "bond-energy", folder=tmp_path / "whole")
    with killed_with_levels(interrupted):
        simulate(scene, "bond-energy", folder=tmp_path / "cut")
    resumed = simulate(scene, "bond-energy", folder=tmp_path / "cut", resume=True)
    assert resumed.history == whole.history
    assert resumed.convergence == whole.convergence
    assert resumed.levels == whole.levels
    assert resumed.states.moments == whole.states.moments
    np.testing.assert_array_equal(resumed.displacement(), whole.displacement())
    resumed.save(tmp_path / "cut")
    names = {path.name for path in (tmp_path / "cut").iterdir()}
    assert {
        "summary.json",
        "history.csv",
        "sheet.png",
        "sheet-loading.png",
        "sheet-000.vtu",
    } <= names
    assert (tmp_path / "cut" / "history.csv").read_text().startswith("step,t,")
    assert [
        level["t"]
        for level in json.loads((tmp_path / "cut" / "summary.json").read_text())["levels"]
    ][-1] == 0.0


def test_an_abandoned_search_for_the_first_equilibrium_is_not_counted(tmp_path):
    """The history of a run resumed from there had two more evaluations."""
    scene = scene_of((0.3,))
    whole = simulate(scene, "bond-energy")

    def listener(stage, done, total, **numbers):
        if numbers.get("evaluations", 0) >= 2:
            interrupt()

    with pytest.raises(SimulationInterrupted), listening(listener):
        simulate(scene, "bond-energy", folder=tmp_path)
    resumed = simulate(scene, "bond-energy", folder=tmp_path, resume=True)
    assert resumed.history == whole.history


def test_increments_are_chosen_by_what_the_first_guess_strains():
    """To stretch 3 in one step: its guess strains bonds by 2, four times what the solver may
    take at once.
    """
    run = started(scene_of((2.0,)), "analytic")
    assert run.loading.course.largest_increment(run.positions, 0.0, 2.0, None) == pytest.approx(0.5)
    assert run.loading.course.largest_increment(run.positions, 0.0, 2.0, 0.1) == pytest.approx(0.1)
    turned = started(pds.load_scene("rotation", spacing=0.1), "analytic")
    assert turned.loading.course.largest_increment(turned.positions, 0.0, 1.0, None) == 1.0
    result = simulate(scene_of((1.2,)), "analytic")
    taken = list(dict.fromkeys(row["increment"] for row in result.convergence if "residual" in row))
    assert taken == pytest.approx([0.3, 0.6, 0.9, 1.2])


def test_a_failure_says_how_far_the_loading_came():
    scene = scene_of((0.5,), solver={"method": "relaxation", "most_evaluations": 30})
    with raising(
        r"^t = 0\.5: .* t = 0, .* \(prescribed\.1 to x1 = 0\)", SimulationFailed
    ) as caught:
        simulate(scene, "analytic")
    assert "solver.most_evaluations" in str(caught.value)
    assert any("failure" in row for row in caught.value.result.convergence)


def test_a_load_beyond_its_maximum_ends_in_a_clear_failure():
    """The pressure in a sphere of this material has a maximum, and the last equilibrium before
    it is recorded.
    """
    with raising(r"loads carry .* t = 0\..*loads\.0 to pressure = 0\.", SimulationFailed) as caught:
        simulate(pds.load_scene("inflation", spacing=0.125, steps=(0.2, 0.4, 0.8, 1.6)))
    assert "prescribe displacements instead" in str(caught.value)
    result = caught.value.result
    assert [level["step"] for level in result.levels] == [0, 1, 2, 3]
    assert 0.8 < result.levels[-1]["t"] < 0.9
    assert result.levels[-1]["residual"] < 1e-6
    assert len(result.states) == 4
    # A try beyond the maximum takes some ten evaluations; there were tens of thousands.
    assert result.summary["n_force_evaluations"] < 1000


def test_a_body_that_buckles_is_not_taken_for_one_that_follows_its_grips():
    """Whatever it costs to follow it to its buckled state."""
    scene = pds.load_scene(
        "uniaxial",
        {"body.size": [4.0, 1.0], "reference": None},
        spacing=0.1,
        stretches=(0.9, 0.8, 0.6),
    )
    with raising(r"the body buckles between the stretches", SimulationFailed) as caught:
        simulate(scene, "analytic")
    reached = re.search(r"the last equilibrium was found at stretch ([0-9.]+)", str(caught.value))
    assert 0.6 < float(reached[1]) < 0.8


def test_an_output_just_below_the_greatest_load_is_found():
    """It takes many times the evaluations of the outputs before, and no search for it is cut
    short.
    """
    result = simulate(
        pds.load_scene("ring-pressure", spacing=0.25, steps=(0.3, 0.5, 0.6, 0.72)), "analytic"
    )
    assert result.levels[-1]["t"] == 0.72  # none is found at 0.725
    assert result.levels[-1]["evaluations"] > 2 * result.levels[-2]["evaluations"]


def test_a_bond_that_would_break_hands_over_to_dynamics():
    """In equilibrium up to the output before; then the next step in dynamics, or an error that
    asks for one.
    """
    fracture = {"critical_stretch": 1.5}
    cut = {"start": [0.5, -0.1], "end": [0.5, 0.4]}
    steps = (0.1, 0.6, dynamic(1.0, 0.5, 4, viscosity=1e-3))
    result = simulate(scene_of(steps, fracture=fracture, precuts=[cut]), "bond-energy")
    assert [level["t"] for level in result.levels][:1] == [0.1]
    assert result.levels[1]["step"] == 2
    assert result.summary["crack"]["broken_bonds"] > 0
    assert result.summary["crack"]["start"]["t"] > 0.1
    with raising(r"a bond breaks after t = 0\.02: add a step in dynamics", SimulationFailed):
        simulate(
            scene_of((dynamic(0.02, 0.1), 0.6), fracture=fracture, precuts=[cut]), "bond-energy"
        )


def test_what_moves_faster_than_waves_is_refused():
    with raising(r"steps\.1\.dynamics\.duration: .* 100 cm/s", pds.SceneError):
        started(
            scene_of((0.1, dynamic(1.1, 0.01)), units={"length": "cm", "time": "s"}), "analytic"
        )


@pytest.mark.usefixtures("every_step")
@pytest.mark.parametrize(
    "load", [{"traction": (0.2, 0.0)}, {"pressure": -0.2, "thickness": "undeformed"}]
)
def test_viscosity_leaves_loads_as_they_are(load):
    """Internal forces are taken a retardation time ahead; loads were too, and of what they had
    gained the viscosity took its share.
    """
    viscous = dynamic(1.0, 0.5, viscosity=0.02, density=1.0)
    clamp = {"region": "left", "x1": 0.0, "x2": 0.0}
    result = simulate(
        scene_of((viscous,), (clamp,), loads=({"region": "right", **load},)), "bond-energy"
    )
    rows = [row for row in result.history if "time" in row]
    if "traction" in load:
        np.testing.assert_allclose(
            [row["force_right_1"] for row in rows],
            [0.2 * 0.8 * row["t"] for row in rows],
            rtol=1e-12,
            atol=1e-15,
        )
    # At rest and unloaded there is nothing to damp, however fast a load is going to grow.
    assert rows[0]["force_right_1"] == 0
    # What the load gives is there as strain, motion and what the viscosity took of the motion of
    # the bonds.
    last = rows[-1]
    assert last["work"] == pytest.approx(
        last["strain_energy"] + last["kinetic_energy"] + last["damped_energy"], rel=0.02
    )


UNIT = pds.shapes.Rectangle(size=(1.0, 1.0))
PULLED = ({"region": "left", "x1": 0.0, "x2": 0.0}, {"region": "right", "x1": 0.2})


def test_unloading_in_dynamics_does_not_run_away():
    """A force map has no energy: the account was held against the little that was left in the
    body, not against what it had held.
    """
    result = simulate(
        scene_of((1.0, dynamic(0.0, 10.0, density=1.0, damping=1.0)), PULLED, body=UNIT),
        "neo-hookean",
    )
    last = [row for row in result.history if "time" in row][-1]
    assert last["kinetic_energy"] + last["damped_energy"] > last["strain_energy"]


def test_a_body_at_rest_does_not_run_away():
    """Rounding moves it by 1e-15 of mu V, which was more than the nothing that had been put in."""
    late = (
        {"region": "left", "x1": 0.0, "x2": 0.0},
        {"region": "right", "x1": 0.2, "amplitude": [[0, 0], [0.8, 0], [1, 1]]},
    )
    result = simulate(scene_of((dynamic(1.0, 10.0, density=1.0),), late, body=UNIT), "neo-hookean")
    assert result.levels[-1]["t"] == 1.0


def test_dynamics_meet_their_outputs_and_end():
    """0.25 ended at 0.2763; a step is shortened for it, never lengthened."""
    scene = scene_of(
        (dynamic(0.1, 0.25, 4, density=1.0), dynamic(0.1, 0.1, 3, density=1.0)), PULLED, body=UNIT
    )
    result = simulate(scene, "analytic")
    times = [0.0625, 0.125, 0.1875, 0.25, 0.25 + 0.1 / 3, 0.25 + 0.2 / 3, 0.35]
    assert [moment.time for moment in result.states.moments] == pytest.approx(times, rel=1e-14)
    assert [level["t"] for level in result.levels] == pytest.approx(
        [0.025, 0.05, 0.075, 0.1, 0.1, 0.1, 0.1], rel=1e-14
    )
    assert result.levels[3]["t"] == 0.1


@pytest.mark.parametrize("held", ["pulled", "swung", "loaded"])
def test_the_account_closes_with_rows_of_every_twentieth_step(held):
    """Work was summed from row to row, over several swings of a small body: a third of what a
    load was given back was missing.
    """
    clamp = {"region": "left", "x1": 0.0, "x2": 0.0}
    conditions = {
        "pulled": {"prescribed": PULLED},
        "swung": {
            "prescribed": (clamp, {"region": "right", "x1": 0.2, "amplitude": "1 - cos(6*t)"})
        },
        "loaded": {"prescribed": (clamp,), "loads": ({"region": "right", "traction": (0.2, 0.0)},)},
    }[held]
    # The error is of second order in the time step; with the step of the default safety that of the
    # swung body is 2.06 %.
    step = dynamic(0.0, 2.0, density=1.0, safety=0.5)
    result = simulate(scene_of((1.0, step), body=UNIT, **conditions), "bond-energy")
    rows = [row for row in result.history if "time" in row]
    assert len(rows) < 6
    first, last = rows[0], rows[-1]
    change = sum(
        last[key] - first[key] for key in ("kinetic_energy", "strain_energy", "damped_energy")
    )
    assert last["work"] == pytest.approx(
        change, abs=0.02 * abs(last["work"]) if held == "swung" else 2e-3 * first["strain_energy"]
    )


def test_the_summary_of_a_crack_has_every_key():
    """In a program without grips there is no nominal stress: the peak is that of the forces."""
    step = {"to": 0.1, "outputs": 2, "dynamics": {"duration": 0.5, "density": 1.0}}
    held = [{"region": "left", "x1": 0.0, "x2": 0.0}, {"region": "right", "x1": 0.1, "x2": 0.0}]
    scene = pds.Scene(
        name="tear",
        spacing=0.1,
        body={"size": [1.0, 0.6]},
        material={"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 5.0},
        precuts=[{"start": [0.5, 0.0], "end": [0.5, 0.2]}],
        prescribed=held,
        steps=[step],
        fracture={"critical_stretch": 3.0},
    )
    result = pds.simulate(scene, "bond-energy")
    crack = result.summary["crack"]
    assert set(crack) == {
        "start",
        "peak",
        "path",
        "tips",
        "broken_bonds",
        "failed_points",
        "through",
    }
    assert crack["start"] is None
    forces = {
        (name, row["time"]): np.hypot(row[f"force_{name}_1"], row[f"force_{name}_2"])
        for row in result.history
        for name in ("left", "right")
    }
    peak = crack["peak"]
    assert peak["force"] == pytest.approx(max(forces.values()))
    assert forces[peak["name"], peak["time"]] == peak["force"]


@pytest.mark.parametrize("edge", ["bottom", "top"])
def test_a_precut_along_all_of_a_held_edge_is_named(edge):
    height = {"bottom": 0.0, "top": 1.0}[edge]
    held = [{"region": "bottom", "x1": 0.0, "x2": 0.0}, {"region": "top", "x1": 0.0, "x2": 0.1}]
    cut = {"start": [-1.0, height], "end": [2.0, height]}
    material = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 5.0}
    scene = pds.Scene(
        name="cut",
        spacing=0.1,
        body={"size": [1.0, 1.0]},
        material=material,
        precuts=[cut],
        prescribed=held,
        steps=[1.0],
    )
    with raising(
        rf"no bond crosses the {edge} edge of the body: precuts run along all of it", pds.SceneError
    ):
        pds.simulate(scene, "bond-energy")
