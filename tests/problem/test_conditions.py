"""Prescribed displacements: planes and points, what they exert, and what is said about those
that make no sense.
"""

import numpy as np
import pytest
from bodies import rotation
from force_models import TABLE
from refusals import raising, refused
from runs import started

import pdsurrogate as pds
from pdsurrogate.run.simulate import simulate
from pdsurrogate.solvers.reactions import support_moments, support_reactions

ROLLERS = (
    {"region": "left", "x1": 0.0},
    {"region": "right", "x1": 0.6},
    {"region": "bottom", "x2": 0.0},
    {"region": "top", "x2": 0.2},
)
CLAMPS = ({"region": "left", "x1": 0.0, "x2": 0.0}, {"region": "right", "x1": 0.3, "x2": 0.0})


def scene_of(prescribed=ROLLERS, **changes):
    described = {
        "name": "block",
        "spacing": 0.1,
        "body": pds.shapes.Rectangle(size=(1.2, 1.0)),
        "material": "neo-hookean",
        "steps": (1.0,),
    }
    return pds.Scene(**described | {"prescribed": prescribed} | changes)


@pytest.mark.parametrize("force", ["analytic", "bond-energy"])
def test_a_turn_by_a_right_angle_leaves_no_stress(force):
    result = simulate(pds.load_scene("rotation", spacing=0.1), force)
    points = result.body.points
    center = np.array([1.0, 0.5])
    for level, angle in zip(range(2), (np.pi / 4, np.pi / 2), strict=True):
        turned = (points - center) @ rotation(angle).T + center
        np.testing.assert_allclose(points + result.displacement(level), turned, atol=1e-6)
        assert np.abs(result.states[level][1]["stress"]).max() < 1e-5
    assert max(np.abs(force).max() for force in result.levels[-1]["forces"].values()) < 1e-5


def test_torsion_turns_without_force_and_its_moments_balance():
    """Of an energy, whose forces have no moment; by symmetry no forces either."""
    result = simulate(pds.load_scene("disc-torsion", spacing=0.1, steps=(0.5, 1.0)), "bond-energy")
    for level in result.levels:
        moments, forces = level["moments"], level["forces"]
        assert moments["holes"] > 0.1
        assert moments["outline"] == pytest.approx(-moments["holes"], rel=1e-4)
        assert np.abs(list(forces.values())).max() < 1e-4 * moments["holes"]


@pytest.mark.parametrize("plane", ["strain", "stress", "space"])
def test_moments_on_rollers_and_of_tractions_balance(plane):
    """Of an energy, whose forces have no moment. Tangential forces on images beside the corners
    leave the rollers a couple.
    """
    space = plane == "space"
    scene = pds.Scene(
        name="sheared",
        spacing=0.2,
        plane=plane,
        body=(pds.shapes.Box if space else pds.shapes.Rectangle)(size=(1.0,) * (3 if space else 2)),
        material={"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 10.0},
        prescribed=(*({"region": "front", "x3": 0.0},) * space, *ROLLERS[::2]),
        loads=(
            {"region": "right", "traction": [0.3, 0.1, 0.05][: 2 + space]},
            {"region": "top", "traction": [-0.05, 0.2, 0.0][: 2 + space]},
        ),
        steps=(1.0,),
    )
    moments = simulate(scene, "bond-energy").levels[0]["moments"]
    size = max(np.abs(moment).max() for moment in moments.values())
    assert np.abs(sum(map(np.asarray, moments.values()))).max() < 1e-6 * size


def test_conditions_that_agree_may_share_points():
    scene = scene_of(
        (*CLAMPS, {"region": {"box": [[0.0, 0.0], [0.2, 0.2]]}, "x1": 0.0, "name": "corner"}),
        support="points",
    )
    assert set(simulate(scene, "analytic").levels[0]["forces"]) == {"left", "right", "corner"}


@refused("conditions")
def test_conditions_that_make_no_sense_are_refused(prescribed, message):
    with raising(message, pds.SceneError):
        started(scene_of(prescribed), "analytic")


@pytest.mark.parametrize("support", ["reflected", "points"])
@pytest.mark.parametrize(
    "row", [row for row in TABLE if row.plane == "stress"], ids=lambda row: row.name
)
def test_reactions_and_loads_balance_what_is_left_on_free_points(row, support):
    """Linear momentum in any state, for every force model: to rounding, some hundreds of sums of
    doubles.

    Moments too, of models that have them, where points are held: mirror images of a state out of
    equilibrium have moments of their own.
    """
    loads = (
        {"region": "top", "traction": [0.02, 0.05]},
        {"body_force": [0.1, -0.2]},
        {"region": {"near": [0.6, 0.5]}, "force": [0.0, 0.1]},
    )
    prescribed = ({"region": "left", "x1": 0.0, "x2": 0.0}, {"region": "right", "x1": 0.1})
    subject = row.subject
    scene = scene_of(
        prescribed,
        support=support,
        loads=loads,
        precision="float64",
        material=subject.law.describe(),
    )
    run = started(scene, subject.model)
    x1, x2 = run.body.points.T
    start = run.body.points + 0.02 * np.stack(
        [np.sin(2 * x1 + 3 * x2), np.cos(3 * x1 - 2 * x2)], axis=1
    )
    out, loading = np.empty_like(start), run.loading
    loading.apply(0.5, run.loaded, start)
    run.loaded(start, out)
    reactions, left = support_reactions(loading, run.loaded), out * loading.free
    applied = sum(run.loads.by_name(start).values())
    scale = np.abs(run.force.pair_forces()).sum()
    # Along a roller the forces of a bond and of its image cancel, if the model knows mirror
    # symmetry.
    kept = [0] if support == "reflected" and "mirror" in row.departures else [0, 1]
    np.testing.assert_allclose(
        (reactions.forces.sum(axis=0) + applied)[kept], left.sum(axis=0)[kept], atol=1e-13 * scale
    )
    if support == "points" and "angular_momentum" not in row.departures:
        moments = support_moments(loading, run.loaded, reactions).sum() + sum(
            run.loads.moments(start, np.zeros(2)).values()
        )
        assert moments == pytest.approx(
            (start[:, 0] * left[:, 1] - start[:, 1] * left[:, 0]).sum(), abs=1e-13 * scale
        )


@pytest.mark.parametrize("second", [{"and": ["right"]}, {"box": [[0.7, -1], [2, 2]]}])
def test_what_later_entries_hold_too_is_not_reported_as_zero(second):
    """The force on the first entry was zero, without a word."""
    body = {"shape": "rectangle", "size": (1.0, 1.0)}
    support = "reflected" if "and" in second else "points"
    held = (
        {"region": "left", "x1": 0.0, "x2": 0.0},
        {"region": "right", "x1": 0.3},
        {"region": second, "x1": 0.3},
    )
    scene = pds.Scene(
        name="twice",
        spacing=0.25,
        body=body,
        material="neo-hookean",
        prescribed=held,
        support=support,
        steps=(1.0,),
    )
    with raising(
        r"prescribed\.1: later entries hold .* x1 as well; remove one of the entries",
        pds.SceneError,
    ):
        pds.simulate(scene)
