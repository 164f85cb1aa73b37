"""Random strengths in a run: a sheet in uniform tension breaks at its weakest place."""

import numpy as np
import pytest
from runs import started

import pdsurrogate as pds
from pdsurrogate.materials import NeoHookean, homogeneous
from pdsurrogate.materials.tearing import stretch_at
from pdsurrogate.problem.random_strength import strength_factors
from pdsurrogate.scenes import SceneError

LAW = NeoHookean(1.0, 20.0)
BREAK = homogeneous.uniaxial(LAW, 3.0)
SCATTER = {"modulus": 10.0, "length": 0.4, "specimen": [1.2, 1.6], "seed": 1}
SHEET = {
    "name": "sheet",
    "spacing": 0.1,
    "body": {"shape": "rectangle", "size": [1.2, 1.6]},
    "stretches": [1.1],
    "material": {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 20.0},
    "grips": [
        {"edge": "bottom", "holds": "normal"},
        {"edge": "top", "holds": "normal", "travel": 1},
    ],
    "dynamics": {"stretch": 6.0, "stretch_rate": 0.1, "density": 1.0},
}


def scene(scatter, **changes):
    strength = {"uniaxial": BREAK.nominal_stress, "scatter": SCATTER | scatter}
    fracture = {"energy": BREAK.energy_density, "strength": strength}
    return pds.Scene.model_validate({**SHEET, "fracture": fracture, **changes})


def failing(run, stretch):
    """Bonds that break by strength at a homogeneous stretch."""
    across = homogeneous.uniaxial(LAW, stretch).lateral_stretch
    run.positions[:] = run.body.points * [across, stretch]
    run.loading.apply(stretch, run.force, run.positions)
    run.force.place(run.positions)
    return run.damage.failing(run.force).pairs


@pytest.mark.parametrize("seed", [1, 2])
def test_the_weakest_place_breaks_at_its_own_strength(seed):
    run = started(scene({"seed": seed}))
    points = run.body.points
    factors = strength_factors(points, np.zeros(2), 0.4, 10.0, (1.2, 1.6), seed)
    weakest = factors.min()
    at = stretch_at(
        LAW,
        lambda one: homogeneous.uniaxial(LAW, one).nominal_stress,
        BREAK.nominal_stress * weakest,
        "",
    )
    assert not len(failing(run, 0.995 * at))
    pairs = failing(run, 1.005 * at)
    assert len(pairs)
    middle = (points[run.body.bonds.first[pairs]] + points[run.body.bonds.second[pairs]]) / 2
    cell = points[factors == weakest]
    radius = run.problem.strengths.zones[0].radius
    least, greatest = cell.min(axis=0) - radius, cell.max(axis=0) + radius
    assert ((middle > least) & (middle < greatest)).all(axis=1).any()


@pytest.mark.parametrize(
    ("scatter", "message"),
    [
        ({"length": 0.05}, "fracture.strength.scatter: length must be at least the spacing"),
        ({"length": 2.0}, "fracture.strength.scatter: specimen must be as large"),
    ],
)
def test_what_no_scatter_can_be_is_refused(scatter, message):
    with pytest.raises(SceneError, match=message):
        started(scene(scatter))


def test_numbers_that_are_left_to_no_artifact_are_refused():
    given = scene({"modulus": "artifact"})
    with pytest.raises(SceneError, match=r"scatter\.modulus: the force model is no artifact"):
        started(given)


def test_a_study_takes_means_over_the_seeds_of_strengths():
    study = pds.Study(scene="tear", parameters={"fracture.strength.scatter.seed": [1, 2]})
    assert study.repeated == ("fracture.strength.scatter.seed",)
