"""Derivatives through the history of bodies that remember."""

import numpy as np
import pytest
from described import SCENES
from memory_references import Rubber
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.materials.covariance import numbers_of, with_numbers_of
from pdsurrogate.materials.histories import stress_history
from pdsurrogate.problem.materials import checked_models
from pdsurrogate.run.followed import FollowedRun
from pdsurrogate.scenes.reading import apply_change, leaves

SOFT = {"r": 1.5, "m": 0.1, "beta": 0.1}
STRIP = SCENES["followed strip"]
TORN = SCENES["followed tear"]
CONSTANT = {"modulus": 1.0, "time": 1.0}
CONVERGED = {"solver.method": "newton", "solver.tolerance": 1e-10, "precision": "float64"}


def scene_of(branches, law="neo-hookean", softening=None, **changes):
    material = {"law": law, "shear_modulus": 1.0, "branches": branches, "softening": softening}
    return pds.Scene(**{**STRIP, "material": material, **changes})


def by_runs(scene, parameter, outputs):
    """Return derivatives of the last output, from two runs that are converged to 1e-10."""
    rows, data = [], scene.model_dump(mode="json")
    value = dict(leaves(data))[parameter]
    for sign in (1, -1):
        for key, number in (CONVERGED | {parameter: value * (1 + 1e-4 * sign)}).items():
            apply_change(data, key, number)
        level = pds.simulate(pds.Scene.model_validate(data), "bond-energy").levels[-1]
        rows.append(np.array([dict(leaves(level))[name] for name in outputs]))
    return (rows[0] - rows[1]) / (2e-4 * value)


@pytest.mark.parametrize("softening", [None, SOFT])
def test_derivatives_of_a_homogeneous_sheet_are_those_of_its_stress_history(softening):
    """Steps of the run and of the history err by less than a thousandth of the overstress."""
    branches = [{"modulus": 1.0, "time": 1.0}, {"modulus": 0.3, "time": 0.2}]
    scene = scene_of(branches, "gent", softening)
    law, names = scene.law(), [name for name in numbers_of(scene.law()) if name != "bulk_modulus"]
    result = pds.simulate(scene, "bond-energy")
    found = result.sensitivity(["nominal_stress"], [f"material.{name}" for name in names])

    def stress(name, value):
        changed = with_numbers_of(law, {name: value})
        program = [0.0, *scene.times], [1.0, *scene.stretches]
        return stress_history(changed, "uniaxial", *program).nominal_stress[-1]

    expected = [
        (stress(name, value + step) - stress(name, value - step)) / (2 * step)
        for name in names
        for value, step in [(numbers_of(law)[name], 1e-5 * numbers_of(law)[name])]
    ]
    assert len(names) == 6 + 3 * bool(softening)
    assert found.derivatives[0] == pytest.approx(expected, rel=1e-3, abs=3e-4)


def test_derivatives_are_those_of_an_integration_of_the_branch():
    """A ramp and a hold in ten steps, against SciPy at 1e-10; errors are those of the steps."""
    times = [*np.linspace(0.1, 0.5, 5), 0.6, 0.8, 1.1, 1.5, 2.0]
    stretches = [*np.linspace(1.06, 1.3, 5), *[1.3] * 5]
    result = pds.simulate(
        scene_of([{"modulus": 1.0, "time": 1.0}], times=times, stretches=stretches), "bond-energy"
    )
    names = [f"material.branches.0.{key}" for key in ("modulus", "time")]
    found = result.sensitivity(["nominal_stress"], names)

    def stress(modulus, time):
        rubber = Rubber(branches=((modulus, time),))
        return rubber.history("uniaxial", [0.0, 0.5, 2.0], [1.0, 1.3, 1.3], times)[-1, 3]

    h = 1e-3
    expected = [
        (stress(1 + h, 1) - stress(1 - h, 1)) / (2 * h),
        (stress(1, 1 + h) - stress(1, 1 - h)) / (2 * h),
    ]
    assert found.derivatives[0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("fracture", "parameters"),
    [
        (TORN["fracture"], ["material.branches.0.time", "material.softening.r"]),
        (None, ["prescribed.1.x1"]),
    ],
)
def test_derivatives_of_a_body_with_a_hole_are_those_of_converged_runs(fracture, parameters):
    """Forces, a probe and what was dissipated, while the body is pulled, held and let go.

    Increments of scenes that may tear follow from strains, so that runs with other displacements
    take others; derivatives are those at given increments.
    """
    changes = {**TORN, "fracture": fracture}
    scene = scene_of([{"modulus": 1.0, "time": 1.0}], softening=SOFT, **changes)
    outputs = ["forces.right.0", "probes.rim.u2", "dissipated_energy"]
    found = pds.simulate(scene, "bond-energy").sensitivity(outputs, parameters)
    for column, parameter in zip(found.derivatives.T, parameters, strict=True):
        expected = by_runs(scene, parameter, found.outputs)
        assert column == pytest.approx(expected, abs=1e-6 * np.abs(expected).max()), parameter


def test_a_branch_that_nothing_excites_has_no_effect():
    """After a hold of a hundred relaxation times, its overstress is below rounding; it acts again
    when the strip is let go.
    """
    clamped = [{"edge": "left"}, {"edge": "right", "travel": 1.0}]
    body = {"shape": "rectangle", "size": [2.0, 1.0]}
    changes = {"stretches": [1.3, 1.3, 1.3, 1.1], "times": [0.4, 1.5, 6.0, 6.4], "grips": clamped}
    scene = scene_of([{"modulus": 0.01, "time": 0.04}], body=body, **changes)
    result = pds.simulate(scene, "bond-energy")
    names = ["material.branches.0.time", "material.branches.0.modulus"]
    held = result.sensitivity(["nominal_stress"], names, level=2)
    assert np.abs(held.derivatives * [0.04, 0.01]).max() < 1e-8
    found = result.sensitivity(["nominal_stress"], names)
    expected = [by_runs(scene, name, ["nominal_stress"])[0] for name in names]
    assert found.derivatives[0] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(
    ("branch", "parameter", "words"),
    [
        (
            {"modulus": 1.0, "times": [[0.1, 1.0], [1.0, 0.1]]},
            "material.shear_modulus",
            "depend on the overstress have no derivatives",
        ),
        (CONSTANT, "stretch", "stretch changes with time, and with branches or softening"),
        (CONSTANT, "material.branches.1.time", "there is no number 'material.branches.1.time'"),
    ],
)
def test_what_has_no_derivative_is_refused(branch, parameter, words):
    result = pds.simulate(scene_of([branch]), "bond-energy")
    with raising(words):
        result.sensitivity(["nominal_stress"], [parameter])


def test_steps_in_dynamics_have_no_derivatives():
    moving = {"density": 1.0, "duration": 1.0}
    steps = [{"to": 0.5, "duration": 1.0}, {"to": 1.0, "dynamics": moving}]
    scene = scene_of([{"modulus": 1.0, "time": 1.0}], **{**TORN, "steps": steps})
    run = FollowedRun(scene, checked_models(scene, pds.load_surrogate("bond-energy")))
    with raising(r"steps\.1\.dynamics: with branches or softening there are"):
        run.follow(["forces.right.0"], ["material.shear_modulus"], 1)
    assert len(run.follow([], [], 0)) == 1


@pytest.mark.slow
def test_derivatives_of_a_nearly_incompressible_block_are_those_of_converged_runs():
    """Plane strain, K = 2000 mu: differences of fourth order, over wider steps."""
    material = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 2000.0}
    changes = {"spacing": 0.25, "reference": None, "stretches": [1.1, 1.1], "times": [0.5, 1.5]}
    branches = [{"modulus": 1.0, "time": 1.0}]
    scene = pds.load_scene(
        "plane-strain-block", {**changes, "material": {**material, "branches": branches}}
    )
    parameters = ["material.branches.0.time", "material.shear_modulus"]
    found = pds.simulate(scene, "bond-energy").sensitivity(["nominal_stress"], parameters)
    for derivative, parameter in zip(found.derivatives[0], parameters, strict=True):
        assert derivative == pytest.approx(by_runs(scene, parameter, found.outputs)[0], rel=1e-6)
