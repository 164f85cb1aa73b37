"""Random strengths in a run: a sheet in uniform tension breaks at its weakest place."""

import numpy as np
import pytest
from described import SCENES
from refusals import raising
from runs import started
from scipy import stats

import pdsurrogate as pds
from pdsurrogate.forces import InvalidState
from pdsurrogate.materials import NeoHookean, homogeneous
from pdsurrogate.materials.tearing import stretch_at
from pdsurrogate.problem.random_strength import strength_factors
from pdsurrogate.scenes import SceneError

LAW = NeoHookean(1.0, 20.0)
BREAK = homogeneous.uniaxial(LAW, 3.0)
SCATTER = {"modulus": 10.0, "length": 0.4, "specimen": [1.2, 1.6], "seed": 1}
SHEET = SCENES["sheet with scatter"]


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
    with raising(message, SceneError):
        started(scene(scatter))


def test_numbers_that_are_left_to_no_artifact_are_refused():
    given = scene({"modulus": "artifact"})
    with raising(r"scatter\.modulus: neither the force model nor", SceneError):
        started(given)


def test_a_study_takes_means_over_the_seeds_of_strengths():
    study = pds.Study(scene="tear", parameters={"fracture.strength.scatter.seed": [1, 2]})
    assert study.repeated == ("fracture.strength.scatter.seed",)


@pytest.mark.slow  # eight tears
def test_loads_at_break_of_a_study_are_those_of_the_weakest_link(tmp_path):
    """Each sheet in uniform tension begins to break at its weakest square, so that the study has
    Weibull's mean and deviation. Most come apart at once; stronger squares may hold a short crack.
    """
    changes = {"spacing": 0.15, "body": {"shape": "rectangle", "size": [0.9, 1.2]}}
    specimen = [0.9, 1.2]
    given = scene({"length": 0.3, "specimen": specimen}, **changes)
    described = given.model_dump(exclude={"dynamics"}) | {
        "stretches": [2.0, 2.4, 2.8, 3.2, 3.6, 4.0],
    }
    loads, peaks, least = [], [], []
    for seed in range(8):
        described["fracture"]["strength"]["scatter"]["seed"] = seed
        sheet = pds.Scene.model_validate(described)
        result = pds.simulate(sheet, "bond-energy", threads=1)
        crack = result.summary["crack"]
        loads.append(crack["start"]["nominal_stress"] / BREAK.nominal_stress)
        peaks.append(result.summary["peak_nominal_stress"] / BREAK.nominal_stress)
        places = started(sheet).body.points
        least.append(strength_factors(places, np.zeros(2), 0.3, 10.0, specimen, seed).min())
    np.testing.assert_allclose(loads, least, rtol=5e-3)
    assert np.median(np.array(peaks) / loads) < 1.005
    assert max(np.array(peaks) / loads) < 1.1
    deviation = stats.weibull_min(10.0).std() / stats.weibull_min(10.0).mean()
    assert np.mean(loads) == pytest.approx(1.0, abs=3 * deviation / np.sqrt(8))


def test_a_plane_holds_only_what_bonds_join_to_images_in_it():
    run = started(scene({}))
    bonds, points = run.body.bonds, run.body.points
    intact = np.ones(len(bonds.first), dtype=bool)
    bottom, top = run.loading.ends(intact)
    assert points[bottom, 1].max() < 0.4
    assert points[top, 1].min() > 1.2
    intact[bonds.second >= len(points)] = False
    assert [len(one) for one in run.loading.ends(intact)] == [0, 0]
    assert all(len(one) for one in run.loading.ends())


def test_what_is_torn_off_a_clamp_may_pass_it():
    """A single strand that swings through its clamp loses its bonds."""
    run = started(scene({}))
    bonds, points = run.body.bonds, run.body.points
    loading, low = run.loading, run.positions - [0.0, 1.0]
    with pytest.raises(InvalidState, match="beyond the bottom edge"):
        loading.check_inside(1.0, run.force, low)
    broken = (bonds.second >= len(points)) & (points[bonds.first, 1] < 0.75)
    assert loading.check_inside(1.0, run.force, low, broken) == ["bottom edge"]
    assert not loading.check_inside(1.0, run.force, run.positions, broken)
    torn = np.unique(bonds.first[broken])
    assert not len(loading.swung_through(1.0, low, torn, broken))
    last = np.flatnonzero(broken)[0]
    broken[last] = False
    assert loading.swung_through(1.0, low, torn, broken) == bonds.first[last]
    with pytest.raises(InvalidState):
        loading.check_inside(1.0, run.force, low, broken)


@pytest.mark.parametrize(
    "timed", [None, {"damping": 1.0}, {}], ids=["slowly", "damped", "undamped"]
)
def test_a_sheet_torn_off_a_clamp_is_through(timed):
    """The weakest square lies at the lower clamp, whose points keep no bond to it. Undamped, a
    strand swings through the clamp, which ended the run.
    """
    scatter = {"modulus": 10.0, "length": 0.5, "specimen": [2.0, 3.0], "seed": 2}
    program = (
        {"dynamics": None, "stretches": [3.5]}
        if timed is None
        else {"dynamics": {"stretch": 3.5, "stretch_rate": 0.1, "density": 1.0, **timed}}
    )
    given = scene(
        {},
        spacing=0.25,
        horizon_ratio=2.2,
        body={"shape": "rectangle", "size": [2.0, 3.0]},
        grips=[{"edge": "bottom"}, {"edge": "top", "travel": 1}],
        fracture={"energy": 4.0, "strength": {"stretch": 2.0, "scatter": scatter}},
        **program,
    )
    result = pds.simulate(given, "bond-energy", threads=1)
    crack = result.summary["crack"]
    assert (crack["start"]["cause"], crack["through"]) == ("strength", True)
    assert crack["start"]["x"][1] < 0.5 or crack["start"]["x"][1] > 2.5
    assert result.history[-1]["stretch"] < 3.5
