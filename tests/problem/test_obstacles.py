"""Obstacles: the energy of their penetration, homogeneous states, contact in dynamics, what
results report, and scenes that are refused.
"""

import numpy as np
import pytest
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.materials.homogeneous import uniaxial
from pdsurrogate.problem import compile_scene
from pdsurrogate.solvers.preconditioner import preconditioner_of

MODELS = [pds.BondEnergyForce(), pds.BondEnergyForce()]
RUBBER = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 10.0}
PLATE = {"half_plane": {"point": (0.0, 1.0), "normal": (0.0, 2.0)}, "x2": -0.2, "name": "plate"}


def pressed(*obstacles, **changes):
    """A sheet between rollers at the left and below, and obstacles."""
    fields = {
        "name": "pressed",
        "spacing": 0.125,
        "body": pds.shapes.Rectangle(size=(1.0, 1.0)),
        "material": RUBBER,
        "prescribed": (
            pds.Prescribed(region="bottom", x2=0.0),
            pds.Prescribed(region="left", x1=0.0),
        ),
        "obstacles": obstacles or (PLATE,),
        "steps": 1.0,
    }
    return pds.Scene(**{**fields, **changes})


def box(*obstacles, **changes):
    held = (pds.Prescribed(region="back", x1=0.0, x2=0.0, x3=0.0),)
    return pressed(
        *obstacles,
        body=pds.shapes.Box(size=(1.0, 1.0, 0.5)),
        prescribed=held,
        spacing=0.25,
        **changes,
    )


ROUND = {"disc": {"center": (0.6, 1.5), "radius": 0.5}, "x2": -0.1, "x1": 0.05}
SPATIAL = (
    {"ball": {"center": (0.6, 0.5, 1.5), "radius": 1.0}, "x3": -0.06},
    {"cylinder": {"center": (2.0, 0.0, 0.5), "axis": (0.0, 3.0, 1.0), "radius": 0.9}, "x1": -0.16},
    {"half_space": {"point": (0.0, 1.05, 0.0), "normal": (0.0, 1.0, 0.1)}, "x2": -0.15},
)


CLOUD = pds.shapes.Rectangle(size=(1.0, 1.0), arrangement="relaxed", seed=1)


@pytest.mark.parametrize(
    "scene",
    [
        pressed(PLATE, ROUND, support="points"),
        box(*SPATIAL),
        pressed(PLATE, ROUND, body=CLOUD, support="points"),
    ],
    ids=["sheet", "solid", "relaxed sheet"],
)
def test_forces_are_minus_the_gradient_of_the_energy_and_balance_those_of_the_obstacles(scene):
    """Without planes of symmetry, beside which images carry a part of the forces."""
    problem = compile_scene(scene, [pds.BondEnergyForce()])
    loads, points = problem.loading.loads, problem.body.points
    loads.set(1.0)
    rng = np.random.default_rng(3)
    positions = points + 0.02 * rng.standard_normal(points.shape)
    # Some places that touch push without penetration, some that do not push if they come nearer.
    loads.pushes[:] = 0.5 * loads.pushed(positions, loads.pushes)
    loads.pushes[::3] += 0.01 * np.array([one.stiffness > 0 for one in loads.obstacles]).T[::3]
    forces = np.zeros_like(points)
    loads.forces(positions, None, forces)
    by_name = loads.by_name(positions)
    assert len(by_name) == len(scene.obstacles)
    assert all(np.linalg.norm(force) > 0.01 for force in by_name.values())
    np.testing.assert_allclose(forces.sum(axis=0), sum(by_name.values()), atol=1e-11)
    moments = sum(
        np.atleast_1d(moment)
        for moment in loads.moments(positions, np.zeros(points.shape[1])).values()
    )
    turning = (
        np.cross(positions, forces).sum(axis=0)
        if points.shape[1] == 3
        else [np.linalg.det(np.stack([positions, forces], 1)).sum()]
    )
    np.testing.assert_allclose(moments, turning, atol=1e-10)
    way, step = rng.standard_normal(points.shape), 1e-6
    slope = (loads.potential(positions + step * way) - loads.potential(positions - step * way)) / (
        2 * step
    )
    assert slope == pytest.approx(-(forces * way).sum(), rel=1e-8)


@pytest.mark.parametrize("model", ["bond-energy", "analytic"])
@pytest.mark.parametrize("body", [pressed().body, CLOUD], ids=["lattice", "relaxed"])
@pytest.mark.parametrize("parts", [1, 2])
def test_a_plate_without_friction_leaves_the_body_in_the_homogeneous_state(parts, body, model):
    """With the stiffness of contact alone the force is 0.8 % too low, and without balanced
    gradients beside interfaces 0.9 % off in a body of two materials with nearly the same law.
    """
    left = {
        "region": {"box": ((0.0, 0.0), (0.5, 1.0))},
        "material": RUBBER | {"shear_modulus": 1.0 + 1e-9},
    }
    scene = pressed(body=body, materials=(left,)[: parts - 1])
    result = pds.simulate(scene, model)
    level = result.levels[-1]
    depth = level["contact"]["plate"]["penetration"]
    exact = uniaxial(pds.materials.NeoHookean(1.0, 10.0), 0.8)
    assert -level["forces"]["plate"][1] == pytest.approx(-exact.nominal_stress, rel=1e-4)
    assert depth < 5e-4 * 0.125
    # Of the free side the part counts that is nearer than 0.01 spacings.
    assert level["contact"]["plate"]["area"] == pytest.approx(
        exact.lateral_stretch + 0.01 * 0.125, abs=1e-4
    )
    assert level["displacements"]["plate"] == pytest.approx([0, -0.2])
    row = result.history[-1]
    assert row["contact_area_plate"] == level["contact"]["plate"]["area"]
    assert row["contact_penetration_plate"] == depth
    assert row["force_plate_2"] == level["forces"]["plate"][1]


SLAB = pds.shapes.Box(size=(1.0, 1.0, 0.5))


@pytest.mark.parametrize(
    "changes",
    [
        {"plane": "strain"},
        {"plane": "strain", "body": CLOUD, "steps": [pds.Step(to=1.0, outputs=2)]},
        {"body": SLAB, "spacing": 0.25},
        {"body": SLAB.model_copy(update={"arrangement": "relaxed", "seed": 1}), "spacing": 0.25},
    ],
    ids=["strain", "relaxed, strain", "space", "relaxed, space"],
)
def test_a_plate_gives_the_force_of_the_same_motion_prescribed(changes):
    """It was 0.4 % less, by the penetration; finding it takes few evaluations."""
    solid = "spacing" in changes
    place = {"point": (0.0, 1.0, 0.0)[: 2 + solid], "normal": (0.0, 1.0, 0.0)[: 2 + solid]}
    plate = {"half_space" if solid else "half_plane": place, "x2": -0.2, "name": "plate"}
    held = [{"region": "bottom", "x2": 0.0}, {"region": "left", "x1": 0.0}]
    held += [{"region": "back", "x3": 0.0}] * solid
    top = {"region": "top", "x2": -0.2, "name": "plate"}
    results = [
        pds.simulate(pressed(**changes, prescribed=held, obstacles=(plate,)), "bond-energy"),
        pds.simulate(pressed(**changes, prescribed=[*held, top], obstacles=()), "bond-energy"),
    ]
    touched, prescribed = (result.levels[-1]["forces"]["plate"] for result in results)
    np.testing.assert_allclose(touched, prescribed, rtol=0, atol=1e-4 * abs(prescribed[1]))
    evaluations = [result.summary["n_force_evaluations"] for result in results]
    assert evaluations[0] < 1.5 * evaluations[1]


def test_the_lowest_mode_in_contact_is_that_of_the_same_motion_prescribed():
    """A plate holds a face normal to it, but leaves its points half a cell inside some freedom."""
    top = pds.Prescribed(region="top", x2=-0.2)
    held = pressed(prescribed=[*pressed().prescribed, top]).model_copy(update={"obstacles": ()})
    one, other = (
        pds.simulate(scene, "bond-energy").lowest_mode().eigenvalue for scene in (pressed(), held)
    )
    assert one == pytest.approx(other, rel=0.03)


def test_a_plate_that_moves_away_leaves_the_body_undeformed():
    scene = pressed(steps=(1.0, -0.5))
    result = pds.simulate(scene, "bond-energy")
    assert result.levels[-1]["forces"]["plate"] == [0, 0]
    assert result.levels[-1]["contact"]["plate"] == {"area": 0, "penetration": 0}
    assert np.abs(result.displacement()).max() < 1e-6


# The reference of docs/validation/obstacles.md at 30 %: finite elements, see
# `pipelines/obstacles.py`.
BLOCK = 5.0372


def test_a_bonded_block_whose_sides_roll_over_the_plate_has_the_force_of_finite_elements():
    rubber = {**RUBBER, "bulk_modulus": 100.0}
    base = {"half_plane": {"point": (0.0, 0.0), "normal": (0.0, -1.0)}, "name": "base"}
    held = (pds.Prescribed(region="bottom", x1=0.0, x2=0.0),)
    fields = {
        "body": pds.shapes.Rectangle(size=(2.0, 1.0)),
        "plane": "strain",
        "horizon_ratio": 1.75,
        "material": rubber,
        "spacing": 0.05,
    }
    result = pds.simulate(
        pressed(
            {**PLATE, "x2": -0.3},
            base,
            prescribed=held,
            steps=[pds.Step(to=1.0, outputs=2)],
            **fields,
        ),
        "bond-energy",
    )
    level = result.levels[-1]
    assert -level["forces"]["plate"][1] == pytest.approx(BLOCK, rel=0.01)
    assert level["contact"]["plate"]["area"] == pytest.approx(2.979, rel=0.05)
    assert level["contact"]["base"]["area"] > 0.1
    assert max(contact["penetration"] for contact in level["contact"].values()) < 5e-5 * 0.05


def test_a_body_thrown_at_a_wall_bounces_and_keeps_its_energy():
    """A wall pushes a bar, which flies away: the account of energies closes, and contact that
    begins later does not upset the time step.
    """
    there_and_back = "max(0, 0.5 - 0.5 * cos(pi * t))"
    wall = {
        "half_plane": {"point": (0.0, 1.02), "normal": (0.0, 1.0)},
        "x2": -0.1,
        "amplitude": there_and_back,
        "name": "wall",
    }
    step = pds.Step(to=2.0, outputs=40, dynamics=pds.StepDynamics(duration=4.0, density=1.0))
    result = pds.simulate(pressed(wall, steps=[step], prescribed=()), "bond-energy")
    pushes = [level["forces"]["wall"][1] for level in result.levels]
    assert min(pushes) < -0.1
    assert pushes[0] == pushes[-1] == 0
    assert max(level["contact"]["wall"]["penetration"] for level in result.levels) < 0.1 * 0.125
    assert abs(result.summary["dynamics"][0]["greatest_energy_gap"]) < 1
    # Without friction and supports the body moves along x2 alone, as a whole, by the momentum that
    # the wall has given it.
    last, before = (result.displacement(number).mean(axis=0) for number in (-1, -2))
    momentum = (last - before) / 0.1
    assert abs(momentum[0]) < 1e-6 < 0.1 < -momentum[1]
    assert result.history[-1]["kinetic_energy"] >= momentum[1] ** 2 / 2
    assert result.history[-1]["work"] == pytest.approx(
        result.history[-1]["kinetic_energy"] + result.history[-1]["strain_energy"], rel=0.01
    )


def test_contact_after_an_equilibrium_ends_where_the_obstacle_leaves():
    """A plate that has left comes back to a gap at which it pushed before: it pushes no more. While
    it leaves, it pushes at gaps that count as contact.
    """
    way = [[0, 0], [1, 1], [2, -0.25], [3, -0.0005], [4, -0.0005]]
    inertia = pds.StepDynamics(duration=3.0, density=1.0, damping=4.0)
    moving = [pds.Step(to=to, outputs=2, dynamics=inertia) for to in (2.0, 3.0, 4.0)]
    plate = {**PLATE, "x2": -0.4, "amplitude": way}
    result = pds.simulate(pressed(plate, spacing=0.25, steps=[1.0, *moving]), "bond-energy")
    forces = [level["forces"]["plate"][1] for level in result.levels]
    assert max(forces[:2]) < -0.1
    assert result.levels[1]["contact"]["plate"]["area"] > 0.9
    assert forces[2:] == [0.0] * 5
    assert all(abs(part["greatest_energy_gap"]) < 1 for part in result.summary["dynamics"])


def test_a_scene_without_obstacles_carries_nothing_of_them():
    scene = pressed(
        prescribed=(
            pds.Prescribed(region="bottom", x1=0, x2=0),
            pds.Prescribed(region="top", x2=-0.1),
        ),
        obstacles=(),
    )
    problem = compile_scene(scene, [pds.BondEnergyForce()])
    _, loaded = problem.bind()
    assert problem.loading.loads.obstacles == []
    assert len(problem.loading.loads) == 0
    assert preconditioner_of(loaded, problem.loading.free).solve.__qualname__.startswith(
        ("spring_solver_of", "_inverse_here")
    )
    level = pds.simulate(scene, "bond-energy").levels[-1]
    assert "contact" not in level


TOO_SMALL = {"disc": {"center": (0.5, 1.2), "radius": 0.2}, "x2": -0.1}
INSIDE = {"disc": {"center": (0.5, 0.5), "radius": 0.25}}
TURNED = {"half_plane": {"point": (0.0, 1.0), "normal": (0.0, -1.0)}, "x2": -0.2}
REFUSED = [
    (
        (TOO_SMALL,),
        {},
        r"obstacles.0.disc.radius: 0.2 is less than 2 spacings \(0.25\), .*; use a smaller spacing",
    ),
    (
        (INSIDE,),
        {},
        (
            r"obstacles.0.disc: at t = 0 the obstacle overlaps the body, by 0.\d+ at \(.*\); begin"
            r" outside"
        ),
    ),
    (
        (PLATE, TURNED),
        {},
        r"obstacles.1.half_plane: at t = 0 .*, or turn its normal, which points into the obstacle",
    ),
    ((PLATE, PLATE | {"x1": 1.0}), {}, "obstacles.0 and obstacles.1 .* the same name 'plate'"),
    (
        (PLATE,),
        {"prescribed": ()},
        "nothing keeps the body from moving along x1 or moving along x2",
    ),
    (
        (PLATE,),
        {"steps": (2.0,), "obstacles": (PLATE | {"amplitude": {"t": (0, 1), "value": (0, 1)}},)},
        "obstacles.0.amplitude: ",
    ),
    (
        ({"ball": {"center": (0, 0, 3.0), "radius": 1.0}},),
        {},
        "obstacles.0.ball: this shape is 3D, but .* use half_plane or disc",
    ),
    ((PLATE | {"x3": 1.0},), {}, r"obstacles.0.x3: a 2D body has no x3, only x1 and x2$"),
    (
        (PLATE | {"disc": {"center": (0.5, 3.0), "radius": 1.0}},),
        {},
        "needs exactly one of half_plane, disc",
    ),
    (
        ({"disc": {"center": (0.5, 3.0, 0.0), "radius": 1.0}},),
        {},
        "disc.center: needs at most 2 entries, not 3",
    ),
    (
        ({"ball": {"center": (0.5, 3.0, 0.0, 0.0), "radius": 1.0}},),
        {},
        "ball.center: needs at most 3 entries, not 4",
    ),
    (({"x2": 1.0},), {}, "needs exactly one of half_plane"),
    ((PLATE,), {"steps": (), "prescribed": ()}, "obstacles: needs steps"),
]


@pytest.mark.parametrize(("obstacles", "changes", "message"), REFUSED)
def test_unsuitable_obstacles_are_refused_with_key_and_remedy(obstacles, changes, message):
    with raising(message, pds.SceneError):
        pds.simulate(pressed(*obstacles, **changes), "bond-energy")


def test_an_obstacle_that_jumps_into_the_body_is_told():
    """A ball that would be placed within the body, where no part of the boundary feels it."""
    jump = {"disc": {"center": (0.5, 1.5), "radius": 0.26}, "x2": -1.0, "name": "pin"}
    scene = pressed(jump)
    problem = compile_scene(scene, [pds.BondEnergyForce()])
    force, loaded = problem.bind()
    positions = problem.body.points.copy()
    problem.loading.apply(1.0, loaded, positions)
    with raising(
        "the obstacle pin, which has passed the boundary of the body", pds.forces.InvalidState
    ):
        problem.loading.check_inside(1.0, force, positions)


THROUGH = {"disc": {"center": (0.5, 1.3), "radius": 0.25}, "x2": -3.0, "name": "pin"}
ALONG = {"disc": {"center": (1.6, 0.5), "radius": 0.25}, "x1": -3.0, "name": "pin"}


@pytest.mark.parametrize(
    "obstacle",
    [THROUGH, ALONG, {**THROUGH, "amplitude": ((0.0, 0.0), (0.5, 1.0), (1.0, 0.0))}],
    ids=["down", "along", "to and fro"],
)
def test_an_obstacle_does_not_pass_through_the_body_in_one_increment(obstacle):
    """It touches the body neither at the beginning nor at the end of the step; such runs once
    ended well, without any force.
    """
    with raising(r"\(pin moved by \(", pds.SimulationFailed) as failed:
        pds.simulate(pressed(obstacle), "bond-energy")
    for level in failed.value.result.levels:  # the pin presses on the body
        assert np.linalg.norm(level["forces"]["pin"]) > 0.1


LID = {"region": {"box": ((0.0, 0.6), (1.0, 1.0))}, "material": "rigid"}


@pytest.mark.parametrize("obstacle", [PLATE, {**ROUND, "name": "plate"}], ids=["flat", "round"])
def test_an_obstacle_in_the_way_of_which_a_rigid_region_is_refused(obstacle):
    """A rigid lid on one place of a disc slid off it, so that no increment was short enough."""
    held = {"region": "bottom", "x1": 0.0, "x2": 0.0}
    with raising(
        r"obstacles.0: the obstacle plate reaches the rigid region lid; .*: prescribe",
        pds.SceneError,
    ):
        compile_scene(
            pressed(
                obstacle,
                prescribed=(held,),
                regions={"lid": LID["region"]},
                materials=({**LID, "region": "lid"},),
            ),
            MODELS,
        )


def test_a_rigid_region_that_the_body_pushes_into_an_obstacle_ends_the_run():
    wall = {"half_plane": {"point": (1.02, 0.0), "normal": (1.0, 0.0)}, "name": "wall"}
    held = ({"region": "left", "x1": 0.1, "x2": 0.0}, {"region": "bottom", "x2": 0.0})
    stud = {"region": {"box": ((0.7, 0.3), (1.0, 0.7))}, "material": "rigid"}
    with raising(
        r"obstacle wall touches the rigid region materials.0, .*\(prescribed.0 to x1 = \S+\);",
        pds.SimulationFailed,
    ):
        pds.simulate(pressed(wall, prescribed=held, materials=(stud,)), "bond-energy")


def test_an_obstacle_presses_rubber_on_a_rigid_base():
    base = {"region": {"box": ((0.0, 0.0), (1.0, 0.3))}, "material": "rigid"}
    held = ({"region": "bottom", "x1": 0.0, "x2": 0.0},)
    level = pds.simulate(
        pressed({**PLATE, "x2": -0.05}, prescribed=held, materials=(base,)), "bond-energy"
    ).levels[-1]
    assert level["forces"]["plate"][1] == pytest.approx(-level["forces"]["bottom"][1], rel=1e-4)
    assert level["contact"]["plate"]["area"] == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("up", [True, False], ids=["top", "bottom"])
def test_an_obstacle_cannot_enter_a_held_edge(up):
    plate = {
        "half_plane": {"point": (0.0, float(up)), "normal": (0.0, 1.0 if up else -1.0)},
        "x2": -0.2 if up else 0.2,
        "name": "plate",
    }
    held = tuple({"region": name, "x1": 0.0, "x2": 0.0} for name in ("bottom", "top"))
    with raising(
        rf"the obstacle plate lies .* inside the {'top' if up else 'bottom'} .*not into held"
        r" parts",
        pds.SimulationFailed,
    ):
        pds.simulate(pressed(plate, prescribed=held), "bond-energy")
