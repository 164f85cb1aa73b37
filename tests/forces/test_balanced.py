"""Balanced gradients: a uniform stress exerts the load of the boundary on every point, so that
homogeneous states under loads are exact.
"""

import numpy as np
import pytest
import scipy
from described import SCENES
from meshes import divided
from probes import assert_slope

import pdsurrogate as pds
from pdsurrogate.forces import FORCES, ForceSettings
from pdsurrogate.materials import PLANES, homogeneous
from pdsurrogate.problem import compile_scene
from pdsurrogate.testing.subject import forces_at

RUBBER = {"law": "neo-hookean", "shear_modulus": 1.5, "bulk_modulus": 30.0}
LAW = pds.materials.NeoHookean(1.5, 30.0)
RING = SCENES["pressed ring"]
BLOCK = {
    "body": {"size": (1.0, 0.7)},
    "holes": [{"shape": "circle", "radius": 0.15, "center": (0.55, 0.4)}],
    "prescribed": [{"region": "left", "x1": 0.0, "x2": 0.0}],
}
TUBE = SCENES["pressed tube"]

SIDES = ("left", "bottom", "back"), ("right", "top", "front")


def body_of(spacing, plane="stress", balanced=True, **keys):
    scene = pds.Scene(
        name="balanced", material=RUBBER, spacing=spacing, plane=plane, steps=[1.0], **keys
    )
    body = compile_scene(scene).body
    if not balanced:
        vars(body)["outward"] = None
    return body


def bound(body, plane, breakable=False, model="bond-energy"):
    settings = ForceSettings(precision="float64", plane=plane, breakable=breakable)
    return FORCES[model]().bind(body, LAW, settings)


def left_over(body, plane, F, model="bond-energy"):
    """Greatest force on a point in a homogeneous state, beside the load of the boundary,
    relative to the greatest load.
    """
    force = bound(body, plane, model=model)
    found = forces_at(force, body.points @ F.T)
    np.testing.assert_allclose(
        force.deformation_gradients(), np.broadcast_to(F, (len(body), *F.shape)), atol=1e-12
    )
    d = len(F)
    loads = body.boundary(body) @ force.stress_and_energy()[0][:, :d, :d].mean(axis=0).T
    return np.abs(found + loads).max() / np.abs(loads).max()


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_what_the_volumes_of_cells_are_off_is_spread(plane):
    """The cells of the ring and the polygon that encloses it differ in area by 4e-4, of which
    all points get a part.
    """
    body, F = body_of(0.2, plane, **RING), np.array([[1.2, 0.1], [-0.2, 0.95]])
    excess = body.outward.T @ body.points - body.volumes.sum() * np.eye(2)
    assert np.abs(excess).max() < 5e-4 * body.volumes.sum()
    assert left_over(body, plane, F) < 2e-3


def test_between_planes_of_symmetry():
    """An eighth of a thick sphere, whose loads are those of the whole sphere."""
    body, F = (
        compile_scene(pds.load_scene("inflation", {"spacing": 0.125})).body,
        np.diag([1.1, 0.95, 1.02]),
    )
    assert left_over(body, "space", F) < 1e-3
    vars(body)["outward"] = None
    assert left_over(body, "space", F) > 0.1


@pytest.mark.parametrize(
    ("model", "plane"),
    [("nosb", "stress"), ("nosb", "space"), ("ba-nosb", "stress"), ("ba-nosb", "strain")],
)
@pytest.mark.parametrize("arrangement", ["lattice", "relaxed"])
def test_correspondence_models_are_balanced_where_loads_act(model, plane, arrangement):
    """The greatest force left over was a tenth of the greatest load and more; without loads the
    models stay as they were published.
    """
    d = 3 if plane == "space" else 2
    keys, loads = under_tension(d, 0.5, arrangement)
    held = [{"region": side, f"x{axis + 1}": 0.0} for axis, side in enumerate(SIDES[0][:d])]
    keys = {"body": keys, "prescribed": held}
    bodies = [body_of(0.2 if d == 3 else 0.1, plane, loads=each, **keys) for each in ([], loads)]
    F = np.diag([1.2, 0.95, 1.1][:d])
    without, with_loads = (left_over(body, plane, F, model) for body in bodies)
    assert with_loads < 1e-6
    assert without > 0.1


def stretch_under(plane, load, follows=False, law=LAW):
    """Stretch under a tension in all directions that are free, or under a pressure that follows
    the deformed boundary.
    """
    d = 3 if plane == "space" else 2

    def excess(stretch):
        stress = PLANES[plane].first_piola_stress(law, stretch * np.eye(d)[None])[0][0, 0]
        return stress - load * (stretch ** (d - 1) if follows else 1.0)

    return scipy.optimize.brentq(excess, 0.6, 1.6, xtol=1e-14)


def under_tension(d, tension, arrangement):
    """A square or cube of side 1, and a tension on all of its upper sides."""
    loads = [
        {"region": side, "traction": tension * np.eye(d)[axis]}
        for axis, side in enumerate(SIDES[1][:d])
    ]
    shape = "box" if d == 3 else "rectangle"
    return {"shape": shape, "size": (1.0,) * d, "arrangement": arrangement}, loads


@pytest.mark.parametrize("arrangement", ["lattice", "relaxed"])
def test_a_disc_under_pressure(arrangement):
    """Its boundary was displaced by 26 % too little, and in the middle of the radius by 5 %;
    4e-4 is the error of its volume.
    """
    held = {"e": ((0.5, 0.0), "x2"), "w": ((-0.5, 0.0), "x2"), "n": ((0.0, 0.0), "x1")}
    prescribed = [
        {"region": {"near": place}, "name": name, component: 0.0}
        for name, (place, component) in held.items()
    ]
    loads = [{"region": "outline", "pressure": 1.0}]
    keys = {
        "body": {"shape": "circle", "radius": 1.0, "arrangement": arrangement},
        "prescribed": prescribed,
        "loads": loads,
    }
    law, settings = (
        {**RUBBER, "bulk_modulus": 7.5},
        {
            "precision": "float64",
            "solver": {"tolerance": 1e-8},
        },
    )
    scene = pds.Scene(
        name="disc", material=law, spacing=0.1, plane="strain", steps=[1.0], **keys, **settings
    )
    result = pds.simulate(scene, "bond-energy")
    exact = stretch_under("strain", -1.0, True, pds.materials.NeoHookean(1.5, 7.5))
    gradients = result.field("deformation_gradient")[:, :2, :2]
    turned = gradients[:, 0, 1].mean()
    np.testing.assert_allclose(
        gradients - [[0, turned], [-turned, 0]],
        np.broadcast_to(exact * np.eye(2), gradients.shape),
        atol=2e-4,
    )


def rollers(d):
    return [{"region": side, f"x{axis + 1}": 0.0} for axis, side in enumerate(SIDES[0][:d])]


@pytest.mark.parametrize(("plane", "count"), [("stress", 8), ("space", 3)])
def test_triangles_and_tetrahedra_in_tension(tmp_path, plane, count):
    """Halved squares and cubes in six parts, uniaxial: the force was 1.4 and 4.4 % too small,
    whatever the number of cells.
    """
    d = 3 if plane == "space" else 2
    keys = {
        "body": divided(tmp_path, d, count),
        "prescribed": [*rollers(d), {"region": "right", "x1": 0.5}],
        "precision": "float64",
        "solver": {"tolerance": 1e-7},
    }
    result = pds.simulate(
        pds.Scene(name="cells", material=RUBBER, spacing=None, plane=plane, steps=[1.0], **keys),
        "bond-energy",
    )
    stress = homogeneous.uniaxial(LAW, 1.5).nominal_stress
    assert result.levels[-1]["forces"]["right"][0] == pytest.approx(stress, rel=1e-5)
    assert result.summary["n_force_evaluations"] < 150


ALMOST = 1.5 * (1 + 1e-9)
"""Shear modulus of a rubber that is the same as one of 1.5, and another material."""


def pulled(plane, body, spacing, second, loads, held=(), bulk=150.0, **keys):
    """Result of a square or cube of side 1 of which one half, or a disc, has the shear modulus
    `second`, K = 100 mu in either.
    """
    d = 3 if plane == "space" else 2
    half = keys.pop("half", {"box": [[-1] * d, [0.5, 2, 2][:d]]})
    keys |= {
        "material": {**RUBBER, "bulk_modulus": bulk},
        "prescribed": [*rollers(d), *held],
        "loads": loads,
        "steps": [1.0],
    }
    keys["materials"] = [
        {
            "region": half,
            "material": {**RUBBER, "shear_modulus": second, "bulk_modulus": bulk * second / 1.5},
        }
    ]
    settings = {"precision": "float64", "solver": {"tolerance": 1e-9}}
    return pds.simulate(
        pds.Scene(name="two", body=body, spacing=spacing, plane=plane, **keys, **settings),
        "bond-energy",
    )


PARTS = {
    "stress": ("stress", "lattice", 0.1, 1e-5),
    "strain": ("strain", "lattice", 0.1, 1e-5),
    "fine": ("strain", "lattice", 0.05, 1e-5),
    "relaxed": ("strain", "relaxed", 0.1, 1e-4),
    "triangles": ("strain", "triangles", None, 1e-4),
    "space": ("space", "lattice", 1 / 6, 1e-5),
    "relaxed space": ("space", "relaxed", 0.2, 1e-4),
}


@pytest.mark.parametrize(("plane", "arrangement", "spacing", "most"), PARTS.values(), ids=PARTS)
def test_two_parts_of_one_rubber_are_pulled_like_one(plane, arrangement, spacing, most, tmp_path):
    """Tension on all sides; the loaded edges were off by 7 % in plane stress, and by 184 and 33
    % in plane strain.
    """
    d, tension = 3 if plane == "space" else 2, 0.75
    body, loads = under_tension(d, tension, arrangement)
    if arrangement == "triangles":
        body = divided(tmp_path, 2, 8)
    result = pulled(plane, body, spacing, ALMOST, loads)
    found = result.field("displacement")[:, :d]
    exact = stretch_under(plane, tension, law=pds.materials.NeoHookean(1.5, 150.0)) - 1
    np.testing.assert_allclose(found, exact * result.body.points, atol=most * exact)


@pytest.mark.parametrize("ratio", [3.0, 10.0])
@pytest.mark.parametrize(
    ("plane", "spacing"), [("stress", 0.1), ("strain", 0.1), ("strain", 0.05), ("space", 1 / 6)]
)
def test_two_rubbers_in_series(plane, spacing, ratio):
    """Held across and pulled: both are homogeneous. The loaded edge was off by 6 to 105 %."""
    d, tension, laws = (
        3 if plane == "space" else 2,
        0.3,
        [pds.materials.NeoHookean(1.5 * each, 150.0 * each) for each in (1, ratio)],
    )
    held = [{"region": side, f"x{axis + 2}": 0.0} for axis, side in enumerate(SIDES[1][1:d])]
    body = {"shape": "box" if d == 3 else "rectangle", "size": (1.0,) * d}
    result = pulled(
        plane,
        body,
        spacing,
        1.5 * ratio,
        [{"region": "right", "traction": tension * np.eye(d)[0]}],
        held,
    )

    def excess(stretch, law):
        return (
            PLANES[plane].first_piola_stress(law, np.diag([stretch, *[1.0] * (d - 1)])[None])[0][
                0, 0
            ]
            - tension
        )

    soft, stiff = (
        scipy.optimize.brentq(excess, 1.0, 1.6, args=(law,), xtol=1e-14) - 1 for law in laws
    )
    x = result.body.points[:, 0]
    exact = np.where(x < 0.5, stiff * x, 0.5 * stiff + soft * (x - 0.5))
    found = result.field("displacement")[:, :d]
    np.testing.assert_allclose(found, np.outer(exact, np.eye(d)[0]), atol=1e-4 * exact.max())


PULLED = {0.125: 4.3136e-6, 0.375: 4.1420e-6, 0.625: 4.1352e-6, 0.875: 4.2816e-6}
"""Displacements of places on the right edge of a square with a disc at small strains, of linear
finite elements.
"""


def test_a_disc_three_times_as_stiff_in_a_pulled_square():
    """Displacement of the pulled edge, in plane strain, beside finite elements (nine nodes, 120
    a side); it was off by 62 %.
    """
    loads = [
        {"region": side, "traction": 1.5e-3 * np.eye(2)[axis]}
        for axis, side in enumerate(SIDES[1][:2])
    ]
    places = [{"name": f"at-{y}", "at": (1.0, y)} for y in PULLED]
    half = {"disc": {"center": (0.5, 0.5), "radius": 0.27}}
    result = pulled("strain", {"size": (1.0, 1.0)}, 0.05, 4.5, loads, half=half, probes=places)
    found = [result.levels[-1]["probes"][each["name"]]["displacement"][0] for each in places]
    np.testing.assert_allclose(found, list(PULLED.values()), atol=0.015 * max(PULLED.values()))


@pytest.mark.parametrize("breaks", [False, True])
@pytest.mark.parametrize(
    ("plane", "arrangement", "spacing"),
    [("stress", "lattice", 0.1), ("strain", "relaxed", 0.1), ("space", "lattice", 1 / 6)],
)
def test_bonds_beside_an_interface_may_break(plane, arrangement, spacing, breaks):
    """Balanced before; gradients stay exact in what is homogeneous on either side, and forces
    those of an energy.
    """
    d, random = 3 if plane == "space" else 2, np.random.default_rng(6)
    body = {
        "shape": "box" if d == 3 else "rectangle",
        "size": (1.0,) * d,
        "arrangement": arrangement,
    }
    keys = {
        "fracture": {"critical_stretch": 5.0},
        "steps": [{"to": 1.0, "dynamics": {"duration": 1.0, "density": 1.0}}],
    }
    half = [
        {
            "region": {"box": [[-1] * d, [0.5, 2, 2][:d]]},
            "material": {**RUBBER, "shear_modulus": ALMOST},
        }
    ]
    keys |= {
        "material": RUBBER,
        "materials": half,
        "loads": [{"region": "right", "traction": np.eye(d)[0]}],
        "precision": "float64",
    }
    problem = compile_scene(
        pds.Scene(name="breaks", body=body, spacing=spacing, plane=plane, **keys),
        [pds.BondEnergyForce()] * 2,
    )
    force, body = problem.bind()[0], problem.body
    F = np.diag([1.2, 0.95, 1.1][:d])
    found = forces_at(force, body.points @ F)
    loads = body.boundary(body) @ force.stress_and_energy()[0][:, :d, :d].mean(axis=0).T
    assert np.abs(found + loads).max() < 1e-5 * np.abs(loads).max()
    bonds, one = body.bonds, force.portion_of == 0
    if breaks:
        force.break_bonds(
            np.flatnonzero(
                (one[bonds.first] != one[bonds.second]) & (body.points[bonds.first, 1] > 0.5)
            )[::4]
        )
    slope = random.uniform(-0.2, 0.2, d)
    moved = body.points @ F + np.maximum(body.points[:, :1] - 0.5, 0.0) * slope
    force.place(moved)
    if (
        arrangement == "lattice"
    ):  # elsewhere the interface is a fitted line; here its normal is off by a degree at the ends
        expected = F + np.where(body.points[:, :1] > 0.5, slope, 0.0)[:, :, None] * np.eye(d)[0]
        np.testing.assert_allclose(force.deformation_gradients(), expected, atol=1e-3)
    moved += 0.02 * spacing * random.uniform(-1, 1, moved.shape)
    assert_slope(force, moved, random.uniform(-1, 1, (3, *moved.shape)), 1e-5, 1e-8)


def test_without_loads_gradients_beside_an_interface_stay_as_they_are():
    half = [{"region": {"box": [[-1, -1], [0.5, 2]]}, "material": {**RUBBER, "shear_modulus": 4.5}}]
    keys = {
        "name": "held",
        "body": {"size": (1.0, 1.0)},
        "material": RUBBER,
        "materials": half,
        "spacing": 0.05,
        "steps": [1.0],
    }
    held = [{"region": "left", "x1": 0.0}, {"region": "bottom", "x2": 0.0}]
    for loads in ([], [{"region": "right", "traction": (0.1, 0.0)}]):
        problem = compile_scene(
            pds.Scene(prescribed=held, loads=loads, **keys), [pds.BondEnergyForce()] * 2
        )
        weights = problem.bind()[0].terms[0].kinematics.balance
        beside = np.abs(problem.body.points[weights.owners, 0] - 0.5) < 6 * 0.05
        assert (np.abs(weights.changes[beside]).max(initial=0.0) > 0.1) == bool(loads)


CASES = {
    "sheet": ("stress", 0.1, BLOCK),
    "strain": ("strain", 0.1, BLOCK),
    "tube": ("space", 0.25, TUBE),
}


@pytest.mark.parametrize("model", ["bond-energy", "nosb"])
@pytest.mark.parametrize(("plane", "spacing", "keys"), CASES.values(), ids=CASES)
@pytest.mark.parametrize("breaks", [False, True])
def test_forces_are_the_gradient_of_the_energy(plane, spacing, keys, breaks, model):
    """Also where bonds of points with changed gradients break: the other changes stay, but for
    what affine motions would see of them. That of NOSB is the sum over its points; beside
    clamps its forces were others, with which dynamics gained energy.
    """
    d, random = 3 if plane == "space" else 2, np.random.default_rng(4)
    loads = [{"region": "right", "traction": (0.1, 0.0, 0.0)[:d]}]
    body = body_of(spacing, plane, loads=loads, **keys)
    force = bound(body, plane, breaks, model)
    assert len(force.terms[0].kinematics.balance.numbers)
    if model == "nosb":
        force.energy = lambda: (force.stress_and_energy()[1] * body.volumes).sum()
    if breaks:
        lost = (
            np.linalg.norm(body.all_points[body.bonds.first] - body.points.max(axis=0), axis=1)
            < 3 * spacing
        )
        force.break_bonds(np.flatnonzero(lost)[::4])
        F = np.diag([1.1, 1.0, 1.0][:d])  # the clamp holds the other directions
        force.place(body.points @ F)
        np.testing.assert_allclose(
            force.deformation_gradients(), np.broadcast_to(F, (len(body), d, d)), atol=1e-12
        )
    positions = body.points * [1.1, 0.96, 0.95][:d] + 0.05 * spacing * random.uniform(
        -1, 1, body.points.shape
    )
    found = forces_at(force, positions)
    scale = np.abs(found).max()
    # The forces of the pairs, from which reactions are summed, make up the forces on the points.
    pairs, total = force.pair_forces(), np.zeros(body.all_points.shape)
    np.add.at(total, body.bonds.first, pairs)
    np.add.at(total, body.bonds.second, -pairs)
    np.testing.assert_allclose(total[: len(body)], found, atol=1e-11 * scale)
    assert_slope(force, positions, random.uniform(-1, 1, (3, *positions.shape)), 1e-5, 1e-8)


def test_momentum_is_balanced():
    body, random = body_of(0.2, **RING), np.random.default_rng(5)
    positions = body.points * [1.1, 0.9] + 0.01 * random.uniform(-1, 1, body.points.shape)
    found = forces_at(bound(body, "stress"), positions)
    scale = np.abs(found).max()
    np.testing.assert_allclose(found.sum(axis=0), 0, atol=1e-12 * scale)
    np.testing.assert_allclose(
        (positions[:, 0] * found[:, 1] - positions[:, 1] * found[:, 0]).sum(), 0, atol=1e-11 * scale
    )


def test_the_moment_of_a_turned_plane_is_the_derivative_of_the_energy():
    held, about = {"region": "left", "x1": 0.0, "x2": 0.0}, (1.0, 0.3)
    turned = {"region": "right", "rotation": 20.0, "about": about}
    keys = {
        **BLOCK,
        "prescribed": [held, turned],
        "precision": "float64",
        "solver": {"tolerance": 1e-8},
    }
    steps = [0.98, 1.0, 1.02]
    before, level, after = pds.simulate(
        pds.Scene(name="turned", material=RUBBER, spacing=0.1, steps=steps, **keys), "bond-energy"
    ).levels
    force = level["forces"]["right"]
    # the result is about the origin
    moment = level["moments"]["right"] - (about[0] * force[1] - about[1] * force[0])
    assert (after["energy"] - before["energy"]) / np.deg2rad(0.04 * 20) == pytest.approx(
        moment, rel=1e-4
    )


def test_strains_of_a_ring_under_pressure_converge():
    """Lamé's solution under plane stress, at small strains; without the correction the error is
    13 and 11 %.
    """
    pressure, mu, bulk = 1e-3, 1.5, 30.0
    young = 9 * bulk * mu / (3 * bulk + mu)
    poisson = young / (2 * mu) - 1
    errors = []
    for spacing in (0.1, 0.05):
        loads = [{"region": "holes", "pressure": pressure, "thickness": "undeformed"}]
        scene = pds.Scene(
            name="ring", material=RUBBER, spacing=spacing, steps=[1.0], loads=loads, **RING
        )
        result = pds.simulate(scene, "bond-energy")
        X = result.body.points
        radius = np.linalg.norm(X, axis=1)[:, None, None]
        out = X[:, :, None] * X[:, None] / radius**2
        mean, part = pressure / 3, 4 * pressure / 3 / radius**2
        radial, around = (
            (mean - part - poisson * (mean + part)) / young,
            (mean + part - poisson * (mean - part)) / young,
        )
        exact = radial * out + around * (np.eye(2) - out)
        found = result.field("deformation_gradient")[:, :2, :2] - np.eye(2)
        errors.append(
            np.linalg.norm(found - exact, axis=(1, 2)).max()
            / np.linalg.norm(exact, axis=(1, 2)).max()
        )
    assert errors[1] < 0.08
    assert errors[1] < 0.65 * errors[0]


def test_a_curved_held_boundary_carries_no_load():
    """A free hole in a disc whose outline is held by images, against Lamé's solution; with loads
    on the outline energy was 22 % too low.
    """
    pressure, mu, bulk, inner, outer = 1e-3, 1.5, 30.0, 0.5, 1.5
    keys = {
        "body": {"shape": "circle", "radius": outer},
        "holes": [{"shape": "circle", "radius": inner}],
        "spacing": 0.1,
    }
    held = [{"region": "outline", "x1": 0.0, "x2": 0.0}]
    loads = [{"region": "holes", "pressure": pressure, "thickness": "undeformed"}]
    scene = pds.Scene(
        name="hole",
        material=RUBBER,
        steps=[1.0],
        prescribed=held,
        loads=loads,
        precision="float64",
        **keys,
    )
    result = pds.simulate(scene, "bond-energy")
    young = 9 * bulk * mu / (3 * bulk + mu)
    poisson = young / (2 * mu) - 1
    # u = A r + B/r, zero at the outer radius.
    slope = (
        pressure * (1 - poisson**2) / young / ((1 + poisson) + (1 - poisson) * (outer / inner) ** 2)
    )
    displacement = slope * (outer**2 / inner - inner)
    assert result.levels[-1]["energy"] == pytest.approx(
        np.pi * inner * pressure * displacement, rel=0.03
    )
