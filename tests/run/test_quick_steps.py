"""Steps of dynamics without Python, and how long steps are."""

import numpy as np
import pytest
from bodies import nothing_held, sheet

import pdsurrogate as pds
from pdsurrogate import ForceSettings
from pdsurrogate.run import quick_steps, transient
from pdsurrogate.solvers.stability import FrequencyEstimate

RUBBER = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 20.0}
REGIONS = {"low": {"box": [[0, 0], [2, 0.15]]}, "high": {"box": [[0, 0.85], [2, 1]]}}
HELD = {
    "points": {"low": {"x1": 0.0, "x2": 0.0}, "high": {"x1": 0.0, "x2": 0.5}},
    "planes": {"left": {"x1": 0.0}, "bottom": {"x2": 0.0}, "top": {"x2": 0.5}},
    "in turns": {
        "bottom": {"x1": 0.0, "x2": 0.0},
        "top": {"x2": 0.3, "amplitude": [[0, 0], [0.4, 1], [0.6, 1], [1, 0.5]]},
    },
}


def pulled(held, plane, **keys):
    """A sheet with a cut whose supports move it in dynamics."""
    return pds.Scene(
        name="pulled",
        spacing=0.15,
        plane=plane,
        body={"size": [2.0, 1.0]},
        precuts=[{"start": [-0.1, 0.5], "end": [0.4, 0.5]}],
        material=RUBBER,
        regions=REGIONS if held == "points" else {},
        prescribed=[{"region": region, **values} for region, values in HELD[held].items()],
        steps=[{"to": 1.0, "outputs": 3, "dynamics": {"duration": 6.0, "density": 1.0}}],
        **keys,
    )


@pytest.mark.parametrize(
    ("held", "force", "plane", "keys"),
    [
        ("points", "bond-energy", "strain", {"fracture": {"critical_stretch": 1.7}}),
        ("planes", "bond-energy", "strain", {"fracture": {"critical_stretch": 9.0}}),
        ("in turns", "bond-energy", "stress", {"fracture": {"critical_stretch": 9.0}}),
        ("points", "neo-hookean", "stress", {"fracture": {"critical_stretch": 1.7}}),
        ("points", "nosb", "stress", {}),
        ("planes", "bond-energy", "strain", {}),
    ],
)
def test_steps_without_python_have_the_bits_of_others(held, force, plane, keys, monkeypatch):
    """Bonds break, supports turn round, and outputs come within rows of twenty steps."""
    scene = pulled(held, plane, **keys)
    taken = []
    take = quick_steps.QuickSteps.take

    def counted(steps, due):
        before = steps.integrator.steps
        moved = take(steps, due)
        taken.append(steps.integrator.steps - before)
        return moved

    monkeypatch.setattr(quick_steps.QuickSteps, "take", counted)
    quick = pds.simulate(scene, force)
    monkeypatch.setattr(transient, "can_run", lambda *_: False)
    slow = pds.simulate(scene, force)
    assert sum(taken) > 0.2 * quick.summary["n_steps"]
    assert quick.history == slow.history
    assert quick.summary["n_force_evaluations"] == slow.summary["n_force_evaluations"]
    np.testing.assert_array_equal(quick.displacement(), slow.displacement())


def breakable(precision):
    body = sheet(0.1, 3.0, 0.6)
    law = pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=20.0)
    settings = ForceSettings(precision=precision, breakable=True)
    return body, pds.load_surrogate("neo-hookean").bind(body, law, settings)


def test_the_highest_frequency_in_single_precision_is_that_in_double():
    """The rounding of differences of forces was a tenth of them: at single points frequencies of
    twice the highest one, in the same state.
    """
    found = []
    for precision in ("float64", "float32"):
        body, force = breakable(precision)
        estimate = FrequencyEstimate(body.volumes, np.ones_like(body.points), everywhere=True)
        positions = body.points * [1.5, 0.9]
        forces = np.empty_like(positions)
        estimate(force, positions)
        found.append([estimate.follow(force, positions, forces) for _ in range(20)])
    np.testing.assert_allclose(found[1], found[0], rtol=0.1)


def test_an_estimate_that_rises_is_confirmed_while_no_bonds_break(monkeypatch):
    body, force = breakable("float64")
    still = {"damping": 0.0, "viscosity": 0.0, "safety": 0.7}
    integrator = nothing_held(force, body, np.zeros_like(body.points), **still)
    squared = integrator.frequency(force, body.points)
    values = []
    monkeypatch.setattr(integrator.frequency, "follow", lambda *_: values.pop(0))
    steps = []
    for bonds_break in (False, True):
        integrator.limit(squared)
        values[:] = [4 * squared, squared]
        integrator.evaluate(bonds_break)
        steps.append(integrator.time_step)
    assert steps[0] == pytest.approx(2 * steps[1])


def test_steps_are_limited_by_what_bonds_stretch_and_not_by_how_fast_a_part_flies():
    """A part that flies off took steps of a third; one of two that meet must not pass the other."""
    body, force = breakable("float64")
    flying = np.full_like(body.points, 100.0)
    still = {"damping": 0.0, "viscosity": 0.0, "safety": 0.7}
    integrator = nothing_held(force, body, flying, **still)
    assert integrator.next_step() == integrator.time_step
    assert 100.0 * integrator.time_step > body.spacing
    meeting = np.where(body.points < 1.5, 100.0, -100.0) * [1.0, 0.0]
    step = nothing_held(force, body, meeting, **still).next_step()
    assert 100.0 * step == pytest.approx(0.5 * body.spacing)
