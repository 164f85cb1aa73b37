"""A term with history: only accepted states enter it, checkpoints have it, and results show it."""

import numpy as np
import pytest
from described import SCENES
from refusals import raising
from springs import SofteningForce, SofteningSprings
from stopping import Killed, killed_with_levels, while_bonds_break

import pdsurrogate as pds
from pdsurrogate.body import Body
from pdsurrogate.errors import InvalidState
from pdsurrogate.forces import ForceSettings
from pdsurrogate.materials import NeoHookean
from pdsurrogate.run.simulate import simulate
from pdsurrogate.solvers.stability import FrequencyEstimate

SCENE = {"spacing": 0.25, "stretches": [1.2, 1.1], "solver.method": "relaxation"}
TEAR = SCENES["coarse tear"]


def greatest(springs, states):
    """Greatest stretch of every bond at rest and in some accepted states."""
    lengths = [
        np.linalg.norm(positions[springs.neighbors] - positions[springs.owners], axis=1)
        for _, positions, _ in states
    ]
    return np.maximum.reduce([springs.length, *lengths]) / springs.length


def test_history_is_that_of_accepted_states_is_resumed_and_shown(tmp_path):
    scene = pds.load_scene("uniaxial", SCENE)
    whole = simulate(scene, SofteningForce())
    springs = SofteningSprings.latest
    assert [elapsed for elapsed, _, _ in springs.accepted] == [0.0, 0.0]
    np.testing.assert_array_equal(
        springs.accepted[-1][1][: len(springs.body)] - springs.body.points, whole.displacement()
    )
    np.testing.assert_array_equal(
        springs.kept["greatest_stretch"], greatest(springs, springs.accepted)
    )
    assert (
        springs.most > springs.kept["greatest_stretch"] + 1e-3
    ).any()  # the search went farther than the equilibrium
    stretched, released = (fields["greatest_stretch"] for _, fields in whole.states)
    assert (released >= stretched).all()
    assert stretched.max() > 1.1
    with killed_with_levels(1):
        simulate(scene, SofteningForce(), folder=tmp_path)
    resumed = simulate(scene, SofteningForce(), folder=tmp_path, resume=True)
    np.testing.assert_array_equal(resumed.displacement(), whole.displacement())
    np.testing.assert_array_equal(
        resumed.field("greatest_stretch"), np.float32(whole.field("greatest_stretch"))
    )


def test_a_refused_increment_leaves_the_history(monkeypatch):
    refused, find = [], SofteningSprings.find

    def failing(springs, out):
        find(springs, out)
        if len(springs.accepted) == 1 and springs.tried > 1.25:
            refused.append(springs.tried)
            raise InvalidState("refused")

    monkeypatch.setattr(SofteningSprings, "find", failing)
    simulate(pds.load_scene("uniaxial", {**SCENE, "stretches": [1.1, 1.3]}), SofteningForce())
    springs = SofteningSprings.latest
    assert refused
    assert len(springs.accepted) == 3  # the second output took two increments
    np.testing.assert_array_equal(
        springs.kept["greatest_stretch"], greatest(springs, springs.accepted)
    )


def test_differences_and_estimates_are_trials():
    body, law = Body.rectangle(1.0, 0.5, 0.1, 0.315), NeoHookean()
    force, out = SofteningForce().bind(body, law, ForceSettings()), np.empty((50, 2))
    positions = body.points * [1.2, 0.9]
    force(positions, out)
    force.accept(positions)
    held = {name: values.copy() for name, values in force.history.items()}
    force(body.points * [1.5, 0.8], out)
    force.tangent(positions) @ np.cos(7 * positions).ravel()
    FrequencyEstimate(body.volumes, np.ones_like(positions))(force, positions)
    force.mean_stress(), force.stress_and_energy(), force.pair_forces()
    np.testing.assert_array_equal(force.history["greatest_stretch"], held["greatest_stretch"])
    assert len(force.history) == 1


def test_derivatives_and_modes_are_refused_since_they_would_forget():
    result = pds.simulate(
        pds.load_scene("uniaxial", {**SCENE, "stretches": [1.1]}), SofteningForce()
    )
    for ask in (
        lambda: result.sensitivity(["nominal_stress"], ["material.shear_modulus"]),
        result.lowest_mode,
    ):
        with raising("the forces depend on earlier states of the body"):
            ask()


def test_steps_of_dynamics_are_accepted_one_by_one_from_the_last_output_on(tmp_path):
    """A bond would break on the way to 1.8, where increments had been accepted: the dynamics
    begin with the history at 1.1.
    """
    scene = pds.load_scene("tear", TEAR)
    with pytest.warns(UserWarning, match="a bond would break"):
        whole = simulate(scene, SofteningForce())
    springs = SofteningSprings.latest
    number = next(number for number, (elapsed, _, _) in enumerate(springs.accepted) if elapsed)
    steps, before = springs.accepted[number:], springs.accepted[number][2]
    assert number > 1
    np.testing.assert_array_equal(before, greatest(springs, springs.accepted[:1]))
    assert len(steps) == whole.summary["n_steps"]
    assert sum(elapsed for elapsed, _, _ in steps) == pytest.approx(
        whole.history[-1]["time"], rel=1e-12
    )
    np.testing.assert_array_equal(
        springs.kept["greatest_stretch"], np.maximum(before, greatest(springs, steps))
    )
    with (
        pytest.raises(Killed),
        pytest.warns(UserWarning, match="a bond would break"),
        while_bonds_break(4),
    ):
        simulate(scene, SofteningForce(), folder=tmp_path)
    resumed = simulate(scene, SofteningForce(), folder=tmp_path, resume=True)
    np.testing.assert_array_equal(resumed.displacement(), whole.displacement())
    np.testing.assert_array_equal(
        resumed.field("greatest_stretch"), np.float32(whole.field("greatest_stretch"))
    )
