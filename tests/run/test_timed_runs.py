"""Runs of materials with branches and softening: time in equilibrium, accounts, checkpoints."""

import itertools
import json

import numpy as np
import pytest
from described import SCENES
from memory_references import Rubber
from refusals import raising, refused
from stopping import killed_with_levels

import pdsurrogate as pds

BRANCHES = [{"modulus": 1.0, "time": 1.0}]
FALLING = {"modulus": 0.5, "times": [[0.05, 2.0], [1.0, 0.05]]}
STRIP = SCENES["timed strip"]
MOVED = SCENES["moves of a timed strip"]


def scene_of(**changes):
    return pds.Scene(**{**STRIP, **changes})


def divided(knots, stretches, parts):
    """Return times and stretches of a program in equal parts between knots."""
    times = np.concatenate(
        [np.linspace(*pair, parts + 1)[1:] for pair in itertools.pairwise(knots)]
    )
    return times.tolist(), np.interp(times, knots, stretches).tolist()


@pytest.mark.parametrize(("plane", "mode"), [("strain", "plane-strain"), ("stress", "uniaxial")])
def test_stress_of_a_run_is_that_of_an_integration(plane, mode):
    """Of the greatest overstress, errors are below a thousandth whatever the increments asked for:
    those of a stretch each, up to 300 relaxation times, are divided.
    """
    stretches = [1.0, 1.5, 1.5, 1.1]
    for scale, parts in ((1.0, 1), (1.0, 8), (300.0, 1)):
        knots = [0.0, 0.5 * scale, 2.0 * scale, 2.4 * scale]
        times, values = divided(knots, stretches, parts)
        solver = {"largest_increment": 1.0, "tolerance": 1e-6}
        scene = scene_of(times=times, stretches=values, plane=plane, solver=solver)
        result = pds.simulate(scene, "bond-energy")
        stress, elastic = (
            Rubber(branches=one).history(mode, knots, stretches, times)
            for one in (((1.0, 1.0),), ((1e-9, 1.0),))
        )
        found = np.array([level["nominal_stress"] for level in result.levels])
        overstress = np.abs(stress - elastic)[:, 3].max()
        assert found == pytest.approx(stress[:, 3], abs=1e-3 * overstress)
        lost = [level["dissipated_energy"]["branches"] for level in result.levels]
        assert lost[-1] == pytest.approx(stress[-1, 6] * 0.5, rel=0.02)
        assert (np.diff(lost) >= 0).all()
        assert [level["time"] for level in result.levels] == pytest.approx(times)
        assert max(level["path_error"] for level in result.levels) <= 5e-4
        taken = [level["increments"] for level in result.levels]
        assert taken[0] > 1
        assert parts == 1 or sum(taken) < 2 * len(times)


@pytest.mark.parametrize(("plane", "mode"), [("strain", "plane-strain"), ("stress", "uniaxial")])
def test_times_that_fall_with_the_overstress_settle_in_every_increment(plane, mode):
    """Steps of up to fifty relaxation times; the course has kinks, which no extrapolation sees."""
    pairs, knots, stretches = [[0.1, 1.0], [10.0, 1e-6]], [0.0, 0.5, 2.0, 2.4], [1.0, 1.5, 1.5, 1.1]
    times, values = divided(knots, stretches, 10)
    material = {"law": "neo-hookean", "branches": [{"modulus": 1.0, "times": pairs}]}
    scene = scene_of(times=times, stretches=values, plane=plane, material=material)
    result = pds.simulate(scene, "bond-energy")
    rubber = Rubber(branches=((1.0, 1.0),), factor=lambda s: np.clip(s / 0.1, 1, 100) ** 3)
    expected = rubber.history(mode, knots, stretches, times)
    found = [level["nominal_stress"] for level in result.levels]
    assert found == pytest.approx(expected[:, 3], abs=0.015 * expected[:, 3].max())
    lost = result.levels[-1]["dissipated_energy"]["branches"]
    assert lost == pytest.approx(expected[-1, 6] * 0.5, rel=0.01)


def test_work_is_stored_or_dissipated():
    """The work follows from forces and stretches of the results, by the trapezoidal rule."""
    softening = {"r": 1.5, "m": 0.05, "beta": 0.1}
    branches = [*BRANCHES, FALLING]
    material = {"law": "neo-hookean", "branches": branches, "softening": softening}
    times, values = divided([0.0, 0.5, 0.7, 1.2], [1.0, 1.5, 1.2, 1.4], 24)
    result = pds.simulate(scene_of(material=material, times=times, stretches=values), "bond-energy")
    rows = result.history
    forces = np.array([0.0, *(row["force_right_1"] for row in rows)])
    stretch = np.array([1.0, *values])
    work = np.cumsum((forces[1:] + forces[:-1]) / 2 * np.diff(stretch))
    held = [
        row["strain_energy"] + row["dissipated_by_branches"] + row["dissipated_by_softening"]
        for row in rows
    ]
    assert rows[-1]["dissipated_by_softening"] > 0.01 * work.max()
    assert held == pytest.approx(work, abs=5e-3 * work.max())


def test_steps_take_a_duration():
    ways = [scene_of(stretches=[1.15, 1.3, 1.3], times=[0.25, 0.5, 2.0]), scene_of(**MOVED)]
    short, general = (pds.simulate(scene, "bond-energy") for scene in ways)
    assert [level["time"] for level in general.levels] == [0.25, 0.5, 2.0]
    forces = [[level["forces"]["right"][0] for level in one.levels] for one in (short, general)]
    assert forces[1] == pytest.approx(forces[0], rel=1e-6)


def test_sudden_and_slow_changes_are_those_of_the_fast_and_the_relaxed_material():
    scene = scene_of(stretches=[1.3, 1.3], times=[0.0, 1e9])
    levels = pds.simulate(scene, "bond-energy").levels
    for level, modulus in zip(levels, (2.0, 1.0), strict=True):
        material = {"law": "neo-hookean", "shear_modulus": modulus, "bulk_modulus": 1e2}
        elastic = scene_of(material=material, stretches=[1.3], times=[])
        expected = pds.simulate(elastic, "bond-energy").levels[0]["nominal_stress"]
        assert level["nominal_stress"] == pytest.approx(expected, rel=1e-5)


def test_shortened_increments_take_their_share_of_the_time():
    """Failures of long increments leave neither time nor history behind."""
    program = {"stretches": [2.0, 2.0], "times": [1.0, 3.0]}
    once = {"solver": {"largest_increment": 0.125}}
    smooth = pds.simulate(scene_of(**program, **once), "bond-energy")
    from pdsurrogate.run import levels
    from pdsurrogate.solvers.equilibrium import NoEquilibrium

    follow = levels.Equilibria.follow

    def failing(self, increments):
        equilibrium = follow(self, increments)
        if increments.share > 0.25 and self.run.state.stage == 0:
            raise NoEquilibrium("too long")
        return equilibrium

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(levels.Equilibria, "follow", failing)
        wild = {"solver": {"largest_increment": 0.5}}
        halting = pds.simulate(scene_of(**program, **wild), "bond-energy")
    stresses = [[level["nominal_stress"] for level in one.levels] for one in (smooth, halting)]
    assert stresses[1] == pytest.approx(stresses[0], rel=1e-5)
    assert [level["time"] for level in halting.levels] == [1.0, 3.0]


@pytest.mark.parametrize("dynamics", [False, True])
def test_a_run_with_memory_resumes_to_the_same_bits(tmp_path, dynamics):
    steps = [{"to": 0.5, "duration": 0.5, "outputs": 2}, {"to": 0.5, "duration": 1.0}]
    if dynamics:
        steps[1] = {"to": 0.6, "outputs": 2, "dynamics": {"duration": 0.5, "density": 0.1}}
    branches = [*BRANCHES, FALLING] if dynamics else BRANCHES
    material = {"law": "neo-hookean", "branches": branches}
    scene = scene_of(**MOVED | {"steps": steps, "material": material})
    whole = pds.simulate(scene, "bond-energy", folder=tmp_path / "whole")
    with killed_with_levels(2 + dynamics):
        pds.simulate(scene, "bond-energy", folder=tmp_path / "part")
    resumed = pds.simulate(scene, "bond-energy", folder=tmp_path / "part", resume=True)
    assert json.dumps(resumed.history) == json.dumps(whole.history)
    last = len(whole.states) - 1
    for name in whole.field_names():
        assert np.array_equal(whole.field(name, last), resumed.field(name, last))


def test_the_account_of_dynamics_contains_what_branches_dissipate():
    """A body that is let go after a sudden pull comes to rest by its branches alone."""
    steps = [
        {"to": 1.0, "duration": 0.0},
        {"to": 0.9, "outputs": 4, "dynamics": {"duration": 4.0, "density": 0.2}},
    ]
    result = pds.simulate(scene_of(**MOVED | {"steps": steps}), "bond-energy")
    account = result.summary["dynamics"][0]
    row = result.history[-1]
    assert row["dissipated_by_branches"] > 0.1 * account["energy_put_in"]
    assert abs(account["greatest_energy_gap"]) < 0.5
    assert account["remark"] is None


@refused("times")
def test_programs_without_the_time_that_branches_need_are_refused(changes, told):
    with raising(told):
        pds.simulate(scene_of(**changes), "bond-energy")


def test_a_scene_without_memory_takes_times_and_forgets_them():
    material = {"law": "neo-hookean"}
    timed, timeless = (
        pds.simulate(scene_of(material=material, times=times), "bond-energy")
        for times in ([0.5, 2.0, 2.4], [])
    )
    for one, other in zip(timed.levels, timeless.levels, strict=True):
        assert one["nominal_stress"] == other["nominal_stress"]
    assert [level["time"] for level in timed.levels] == [0.5, 2.0, 2.4]


def test_viscosity_does_not_move_grips_ahead_in_the_history():
    """In first loading stored and dissipated energy are the elastic one, as is the damped energy:
    viscosity evaluates forces ahead of the present, where the history has not been.
    """
    found = []
    for softening in (None, {"r": 1.5, "m": 0.1, "beta": 0.1}):
        scene = scene_of(
            plane="stress",
            material={"law": "neo-hookean", "softening": softening},
            fracture={"critical_stretch": 5.0},
            dynamics={"stretch": 1.15, "stretch_rate": 0.2, "density": 1.0, "outputs": 2},
            stretches=[1.05],
            times=[],
        )
        row = pds.simulate(scene, "bond-energy").history[-1]
        held = row["strain_energy"] + row.get("dissipated_by_softening", 0.0)
        found.append([held, row["damped_energy"]])
    assert found[1] == pytest.approx(found[0], rel=1e-3)


def test_a_hold_dissipates_what_it_loses_and_a_sudden_change_nothing():
    result = pds.simulate(
        scene_of(stretches=[1.25, 1.5, 1.5], times=[0.0, 0.0, 5.0]), "bond-energy"
    )
    lost = [level["dissipated_energy"]["branches"] for level in result.levels]
    energy = [level["energy"] for level in result.levels]
    assert lost[:2] == [0.0, 0.0]
    assert lost[2] == pytest.approx(energy[1] - energy[2], rel=1e-2)


def test_creep_after_a_sudden_load_is_divided_where_strains_bend():
    """One increment of ten relaxation times, against forty that are shorter after the load."""
    moved = {"prescribed": MOVED["prescribed"][:2], "loads": [{"region": "right", "force": [1, 0]}]}
    found = []
    for outputs in (1, 40):
        ends = 10 * (np.arange(1, outputs + 1) / outputs) ** 2 if outputs > 1 else [10.0]
        steps = [{"to": 0.4, "duration": 0.0}]
        steps += [{"to": 0.4, "duration": float(one)} for one in np.diff(ends, prepend=0.0)]
        levels = pds.simulate(scene_of(**MOVED | moved | {"steps": steps}), "bond-energy").levels
        found.append([level["displacements"]["right"][0] for level in (levels[0], levels[-1])])
        if outputs == 1:
            assert levels[-1]["increments"] > 4
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-6)
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-3)


def pulled_by(amplitude, branches, to=1.0):
    """Return the level of a strip that an amplitude pulls in a step with one output."""
    pulled = MOVED["prescribed"][2] | {"amplitude": amplitude}
    changes = {
        "prescribed": [*MOVED["prescribed"][:2], pulled],
        "steps": [{"to": to, "duration": to}],
        "material": {"law": "neo-hookean", "branches": branches},
    }
    return pds.simulate(scene_of(**MOVED | changes), "bond-energy").levels[-1]


@pytest.mark.parametrize(
    ("amplitude", "values", "to"),
    [
        ("max(0, sin(4*pi*t))", lambda t: np.maximum(0, np.sin(4 * np.pi * t)), 0.95),
        ("min(1, 10*t)", lambda t: np.minimum(1, 10 * t), 1.0),
        ("(1 - cos(12*pi*t))/2", lambda t: (1 - np.cos(12 * np.pi * t)) / 2, 0.98),
    ],
)
def test_kinks_saturation_and_cycles_between_outputs_are_followed(amplitude, values, to):
    """Errors stay below a thousandth of the greatest overstress, those of cycles do not add up."""
    knots = np.union1d(np.linspace(0, to, 401), [0.1, 0.25, 0.5, 0.75])
    found = pulled_by(amplitude, [{"modulus": 1.0, "time": 4.0}], to)
    stress, elastic = (
        Rubber(branches=one).history("plane-strain", knots, 1 + 0.3 * values(knots), [to])[0, 3]
        for one in (((1.0, 4.0),), ((1e-9, 4.0),))
    )
    peak = 0.7  # at least, of the overstress
    error = abs(found["forces"]["right"][0] / 0.5 - stress) / peak
    # Of homogeneous motions errors are at most twice the estimate.
    assert error <= min(1e-3, 2 * found["path_error"])
    assert abs(stress - elastic) > 0.01
    assert found["path_error"] <= 5e-4


def test_oscillations_that_increments_cannot_resolve_are_told(monkeypatch):
    """They fall in with a thousand even samples, so that no value of these shows them."""
    from pdsurrogate.run import relaxing

    monkeypatch.setattr(relaxing, "LEAST_SHARE", 1 / 16)
    with pytest.warns(UserWarning, match="off by"):
        found = pulled_by("t + 0.5*sin(1000*pi*t)**2", BRANCHES)
    assert found["path_error"] > 0.1


def test_errors_of_branches_whose_times_fall_are_not_known():
    for branches in ([FALLING], [*BRANCHES, FALLING]):
        assert pulled_by("ramp", branches)["path_error"] is None


@pytest.mark.parametrize("amplitude", [((0, 0), (0.9, 0), (0.95, 1), (1, 0)), "sin(pi*t)"])
def test_pulses_between_outputs_are_not_missed(amplitude):
    moved = [*MOVED["prescribed"][:2], MOVED["prescribed"][2] | {"amplitude": amplitude}]
    runs = [
        pds.simulate(
            scene_of(
                **MOVED
                | {"prescribed": moved, "steps": [{"to": 1.0, "duration": 1.0, "outputs": outputs}]}
            ),
            "bond-energy",
        )
        for outputs in (1, 80)
    ]
    few, many = (one.levels[-1]["dissipated_energy"]["branches"] for one in runs)
    assert many / 2 < few < 2 * many
    assert many > 1e-3
