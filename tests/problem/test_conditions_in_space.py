"""Conditions and loads of bodies in space: faces held by reflection, also while they turn,
reactions, moments, and loads on triangles.
"""

import numpy as np
import pytest
from refusals import raising
from runs import started
from scipy.spatial.transform import Rotation

import pdsurrogate as pds
from pdsurrogate.scenes import Box
from pdsurrogate.solvers.reactions import support_moments, support_reactions
from pdsurrogate.testing.bodies import turn

AXIS = (1.0, 2.0, 0.5)
TURN = Rotation.from_rotvec(20.0 * np.array(AXIS) / np.linalg.norm(AXIS), degrees=True)
CLAMPS = (
    {"region": "left", "x1": 0.0, "x2": 0.0, "x3": 0.0},
    {"region": "right", "x1": 0.3, "x2": 0.0, "x3": 0.1},
)


def scene_of(prescribed=CLAMPS, count=5, **changes):
    described = {
        "name": "cube",
        "spacing": 1 / count,
        "body": Box(size=(1.0, 1.0, 1.0)),
        "material": "neo-hookean",
        "steps": (1.0,),
    }
    return pds.Scene(
        **described | {"prescribed": prescribed, "solver": {"method": "relaxation"}} | changes
    )


def run_of(force="bond-energy", **changes):
    return started(scene_of(**changes), force)


def wavy(points):
    """Positions of a state without symmetry."""
    x1, x2, x3 = points.T
    return points + 0.02 * np.stack(
        [np.sin(2 * x1 + 3 * x2), np.cos(3 * x1 - 2 * x3), np.sin(2 * x2 + x3)], axis=1
    )


def moment(places, forces):
    return np.cross(places, forces).sum(axis=0)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_forces_and_moments_of_turned_planes_are_virtual_work(plane, dimension):
    """Derivatives of the energy by further displacement and turning of a plane, in a state
    without symmetry.
    """
    if dimension == 3 and plane == "strain":
        pytest.skip("space has one plane")
    turned = {"region": "right", "rotation": 40.0, "about": (1.0, 0.5, 0.5)[:dimension], "x1": 0.1}
    body, axis = (
        (Box(size=(1.0, 1.0, 1.0)), {"axis": AXIS})
        if dimension == 3
        else (pds.shapes.Rectangle(size=(1.0, 1.0)), {})
    )
    about_nothing = {"plane": plane} if dimension == 2 else {}
    prescribed = (turned | axis, turned | axis | {"region": "left"})
    run = started(scene_of(prescribed, body=body, horizon_ratio=1.75, **about_nothing))
    loading, Q = run.loading, TURN.as_matrix() if dimension == 3 else turn(20.0)
    center = np.array(turned["about"])
    start = center + (run.body.points - center) @ Q.T + 0.01 * np.sin(3 * run.body.points[:, ::-1])
    start[:, 0] += 0.05
    out = np.empty_like(start)
    loading.apply(0.5, run.force, start)
    run.force(start, out)
    reactions = support_reactions(loading, run.force)
    moments = support_moments(loading, run.force, reactions)
    motions = [np.zeros((dimension, dimension + 1)) for _ in run.body.planes]
    for number in (0, 1):
        motions[number][:, :-1] = Q - np.eye(dimension)
        motions[number][:, -1] = np.eye(dimension)[0] * 0.05 - (Q - np.eye(dimension)) @ center

    def energy(number, spin, shift):
        turn, displacement = motions[number][:, :-1], motions[number][:, -1]
        turn, displacement = (
            turn + spin @ (np.eye(dimension) + turn),
            displacement + spin @ displacement + shift,
        )
        run.force.move_plane(number, displacement, turn)
        run.force(start, out)
        run.force.move_plane(number, motions[number][:, -1], motions[number][:, :-1])
        return run.force.energy()

    h = 1e-5
    spins = (
        [np.array([[0.0, -1.0], [1.0, 0.0]])]
        if dimension == 2
        else [np.cross(np.eye(3), np.eye(3)[c]) for c in range(3)]
    )
    for number in (0, 1):
        for component, shift in enumerate(np.eye(dimension)):
            numeric = (
                energy(number, 0 * spins[0], h * shift) - energy(number, 0 * spins[0], -h * shift)
            ) / (2 * h)
            assert reactions.forces[number][component] == pytest.approx(numeric, rel=1e-6, abs=1e-7)
        for component, spin in enumerate(spins):
            numeric = (energy(number, h * spin, 0.0) - energy(number, -h * spin, 0.0)) / (2 * h)
            assert np.atleast_1d(moments[number])[component] == pytest.approx(
                numeric, rel=1e-6, abs=1e-7
            )


def test_pressure_on_a_closed_surface_has_the_volume_it_sweeps_as_potential():
    run = run_of(
        prescribed=CLAMPS, support="points", loads=({"region": "outline", "pressure": 0.7},)
    )
    loads, start = run.loads, wavy(run.body.points)
    loads.set(1.0)
    assert loads.no_potential_because is None
    forces = np.zeros_like(start)
    loads.forces(start, None, forces)
    np.testing.assert_allclose(forces.sum(axis=0), 0, atol=1e-14)
    np.testing.assert_allclose(moment(start, forces), 0, atol=1e-14)
    direction, h = np.cos(3 * start), 1e-6
    numeric = (loads.potential(start + h * direction) - loads.potential(start - h * direction)) / (
        2 * h
    )
    assert (forces * direction).sum() == pytest.approx(-numeric, rel=1e-8)
    stretched = run.body.points * [1.1, 1.2, 0.9]
    assert loads.potential(stretched) == pytest.approx(0.7 * (1.1 * 1.2 * 0.9 - 1), rel=1e-12)


@pytest.mark.parametrize(
    ("prescribed", "message"),
    [
        (
            ({"region": "left", "rotation": 10.0, "about": (0, 0, 0)},),
            "prescribed.0.axis: a rotation of a solid needs",
        ),
        (
            ({"region": "left", "x1": 0.0, "axis": (1, 0, 0)},),
            "axis, the direction of the axis of a rotation, needs rotation",
        ),
        (
            ({"region": "left", "x1": 0.0},),
            (
                "nothing keeps the body from moving along x2 or moving along x3 or turning;"
                " prescribe x1, x2 or x3"
            ),
        ),
        (
            (
                {"region": "left", "x1": 0.0},
                {"region": "bottom", "x2": 0.0},
                {"region": "back", "x3": 0.0},
            ),
            None,
        ),
        (
            (*CLAMPS, {"region": "top", "x2": 0.1}),
            r"prescribed.0 and prescribed.2 move point .* differently along x2",
        ),
    ],
)
def test_conditions_that_make_no_sense_are_refused(prescribed, message):
    if message is None:
        run_of(prescribed=prescribed)
        return
    with raising(message, pds.SceneError):
        run_of(prescribed=prescribed)


def test_a_sheet_has_no_third_component():
    with raising(r"prescribed\.0\.x3: a 2D body has no x3, only x1 and x2$", pds.SceneError):
        scene_of(
            ({"region": "left", "x1": 0.0, "x3": 0.0},), body=pds.shapes.Rectangle(size=(1.0, 1.0))
        )
