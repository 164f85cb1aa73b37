"""Loads: their resultants, work and potentials, against what is known of them without any force
model; and a bar pulled by tractions.
"""

import numpy as np
import pytest
from bodies import sheet
from described import SCENES
from refusals import raising
from scipy import sparse
from scipy.spatial import cKDTree

import pdsurrogate as pds
from pdsurrogate.body import Body, ReflectionPlane, grid
from pdsurrogate.body.surface import Following, Surface
from pdsurrogate.forces import FORCES, ForceSettings, InvalidState
from pdsurrogate.materials import Branch, Memory, NeoHookean, plane_stress
from pdsurrogate.problem.loads import loads_of
from pdsurrogate.solvers.loaded_force import LoadedForce
from pdsurrogate.testing.bodies import wavy

LAW = NeoHookean(2.0, 200.0)
DOUBLE = ForceSettings(precision="float64")
WIDTH, HEIGHT = 1.2, 1.0
ABOUT = np.array([0.3, -0.7])


def interpolation(body, nodes):
    """Rows of a linear fit to the points within five cells, nearer ones counting more: they follow
    affine motions exactly.

    In homogeneous stress the forces beside a straight edge reach two horizons deep; rows that do so
    too disturb it least.
    """
    points, rows = body.points, np.zeros((len(nodes), len(body)))
    near = cKDTree(points).query_ball_point(nodes, 5 * body.spacing)
    for row, node, own in zip(rows, nodes, near, strict=True):
        weights = np.exp(-(((points[own] - node) / (2 * body.spacing)) ** 2).sum(axis=1) / 2)
        affine = np.vstack([np.ones(len(own)), (points[own] - node).T]) * weights
        row[own] = np.linalg.pinv(affine)[:, 0] * weights
    return Following(sparse.csr_array(rows))


def surface_of(body, loops):
    """A surface of closed loops of nodes, given with the body on the left, each with the part
    that its facets belong to.
    """
    nodes, facets, parts, begin = [], [], [], 0
    for loop, names in loops:
        numbers = begin + np.arange(len(loop))
        nodes.append(loop)
        facets.append(np.stack([numbers, np.roll(numbers, -1)], axis=1))
        parts += names
        begin += len(loop)
    nodes = np.concatenate(nodes)
    return Surface(nodes, np.concatenate(facets), np.array(parts), interpolation(body, nodes))


QUARTER = SCENES["quarter under a load"]


@pytest.mark.parametrize("thickness", ["deformed", "undeformed"])
def test_planes_of_symmetry_move_what_is_followed_and_carry_a_part_of_loads(thickness):
    """A quarter whose left plane moves has the displacements and forces of one at rest, but for the
    motion; images carry loads to the planes, and all are in balance.
    """
    loads = [QUARTER["loads"][0] | {"thickness": thickness}, QUARTER["loads"][1]]
    rest, moved = (
        pds.simulate(
            pds.Scene(
                **QUARTER
                | {
                    "loads": loads,
                    "prescribed": [{"region": "left", "x1": way}, {"region": "bottom", "x2": 0.0}],
                }
            ),
            "bond-energy",
        ).levels[0]
        for way in (0.0, 0.2)
    )
    for kind in ("displacements", "probes"):
        for name, before in rest[kind].items():
            after = moved[kind][name]
            both = [
                each if kind == "displacements" else each["displacement"]
                for each in (before, after)
            ]
            np.testing.assert_allclose(np.subtract(*both[::-1]), [0.2, 0.0], atol=1e-8)
    for name, force in rest["forces"].items():
        np.testing.assert_allclose(moved["forces"][name], force, atol=1e-8)
    assert rest["probes"]["hole"]["displacement"][1] == pytest.approx(0, abs=1e-12)
    assert max(rest["force_balance"], moved["force_balance"]) < 1e-8


def outline_of_sheet(spacing=0.1):
    """Corners of the boundary cells of a sheet, counter-clockwise."""
    x, y = np.arange(round(WIDTH / spacing)) * spacing, np.arange(round(HEIGHT / spacing)) * spacing
    sides = {
        "bottom": np.stack([x, 0 * x], axis=1),
        "right": np.stack([0 * y + WIDTH, y], axis=1),
        "top": np.stack([WIDTH - x, 0 * x + HEIGHT], axis=1),
        "left": np.stack([0 * y, HEIGHT - y], axis=1),
    }
    return np.concatenate(list(sides.values())), [
        name for name, side in sides.items() for _ in side
    ]


class Regions:
    """What loads ask of the regions of a body: edges and holes by the parts of a surface, points
    by a list, or all of them.
    """

    def __init__(self, body, surface):
        self._body, self._surface = body, surface

    def surface(self):
        return self._surface

    def points(self, reference, key):
        return np.arange(len(self._body)) if reference == "body" else np.array(reference.points)

    def facets(self, reference, key):
        parts = self._surface.parts
        return np.flatnonzero(parts != "holes" if reference == "outline" else parts == reference)

    def edge(self, reference):
        return (
            reference if isinstance(reference, str) and reference in self._surface.parts else None
        )

    def label(self, reference, otherwise):
        return reference if isinstance(reference, str) else otherwise


def scene_of(*loads, steps=1, **options):
    body, hole = (
        pds.shapes.Rectangle(size=(WIDTH, HEIGHT)),
        pds.shapes.Circle(radius=0.2, center=(WIDTH / 2, HEIGHT / 2)),
    )
    return pds.Scene(
        name="loads",
        spacing=0.1,
        body=body,
        holes=(hole,),
        material="neo-hookean",
        loads=loads,
        steps=steps,
        **options,
    )


def holed_sheet():
    """A sheet with a round hole, and the surface of both; the hole's facets go round clockwise."""
    points = grid((0, 0), (WIDTH, HEIGHT), 0.1)
    middle = np.array([WIDTH, HEIGHT]) / 2
    kept = points[np.linalg.norm(points - middle, axis=1) > 0.2]
    body = Body(kept, np.full(len(kept), 0.01), 0.315, 0.1)
    angles = -2 * np.pi * np.arange(16) / 16
    hole = middle + 0.2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return body, surface_of(body, [outline_of_sheet(), (hole, ["holes"] * 16)])


def loads_on(body, surface, *loads, t=1.0, **options):
    loads = loads_of(scene_of(*loads, **options), body, Regions(body, surface))
    loads.set(t)
    return loads


def plain_sheet(spacing=0.1):
    body = sheet(spacing)
    return body, surface_of(body, [outline_of_sheet(spacing)])


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def point_forces(loads, positions, thickness=None):
    out = np.zeros_like(positions)
    loads.forces(positions, thickness, out)
    return out


def totals(loads, positions, thickness=None):
    """Resultant and moment of the forces on the points; those that the loads report must be the
    same.
    """
    out = point_forces(loads, positions, thickness)
    total, moment = out.sum(axis=0), cross(positions - ABOUT, out).sum()
    np.testing.assert_allclose(sum(loads.by_name(positions, thickness).values()), total, atol=1e-13)
    assert sum(loads.moments(positions, ABOUT, thickness).values()) == pytest.approx(
        moment, abs=1e-13
    )
    return total, moment


def test_resultant_and_moment_of_a_traction():
    """In a deformed state those of forces at the middles of the deformed facets."""
    body, surface = plain_sheet()
    y = wavy(body.points)
    loads = loads_on(
        body, surface, {"region": "right", "traction": (0.3, -0.2), "amplitude": "2*t"}, t=0.75
    )
    total, moment = totals(loads, y)
    force = 1.5 * np.array([0.3, -0.2])
    np.testing.assert_allclose(total, force * HEIGHT, atol=1e-13)
    nodes = surface.interpolation(y)[surface.facets[surface.parts == "right"]]
    assert moment == pytest.approx(cross(nodes.mean(axis=1) - ABOUT, force).sum() * 0.1, abs=1e-13)


def test_resultant_and_moment_of_body_and_point_forces(random):
    body, surface = plain_sheet()
    y = wavy(body.points)
    total, moment = totals(loads_on(body, surface, {"body_force": (0.5, -2.0)}), y)
    np.testing.assert_allclose(total, np.array([0.5, -2.0]) * WIDTH * HEIGHT, atol=1e-13)
    assert moment == pytest.approx(cross(y.mean(axis=0) - ABOUT, total), abs=1e-13)
    chosen = random.choice(len(body), 7, replace=False)
    total, moment = totals(
        loads_on(body, surface, {"region": {"points": chosen.tolist()}, "force": (0.1, 0.4)}), y
    )
    np.testing.assert_allclose(total, [0.1, 0.4], atol=1e-15)
    assert moment == pytest.approx(cross(y[chosen].mean(axis=0) - ABOUT, total), abs=1e-14)


def test_resultant_and_moment_of_a_pressure_on_a_deformed_edge():
    """-p times the turned vector between the ends of the edge, whatever lies between; its moment
    from the distances of the ends.
    """
    body, surface = plain_sheet()
    y, p = wavy(body.points), 0.4
    loads = loads_on(body, surface, {"region": "right", "pressure": p, "thickness": "undeformed"})
    total, moment = totals(loads, y)
    ends = surface.nodes[:, 0] == WIDTH
    nodes = surface.interpolation(y)[ends]
    order = np.argsort(surface.nodes[ends, 1])
    low, high = nodes[order[0]], nodes[order[-1]]
    along = high - low
    np.testing.assert_allclose(total, -p * np.array([along[1], -along[0]]), atol=1e-13)
    assert moment == pytest.approx(
        p / 2 * (((high - ABOUT) ** 2).sum() - ((low - ABOUT) ** 2).sum()), abs=1e-13
    )


def test_work_is_done_at_the_boundary():
    """In affine deformation the work of a traction is traction times length times the
    displacement of the middle of the edge itself.
    """
    body, surface = plain_sheet()
    H, traction = np.array([[0.4, -0.2], [0.3, 0.15]]), np.array([0.7, -0.4])
    middles = {"left": (0, 0.5), "right": (WIDTH, 0.5), "bottom": (0.6, 0), "top": (0.6, HEIGHT)}
    for edge, middle in middles.items():
        loads = loads_on(body, surface, {"region": edge, "traction": tuple(traction)})
        work = (point_forces(loads, body.points) * (body.points @ H.T)).sum()
        length = HEIGHT if edge in ("left", "right") else WIDTH
        assert work == pytest.approx(length * traction @ H @ middle, abs=1e-14)
        assert loads.potential(body.points + body.points @ H.T) == pytest.approx(-work, abs=1e-14)


ALL_KINDS = (
    {"region": "right", "traction": (0.3, -0.2)},
    {"body_force": (0.1, -0.5), "amplitude": "1 + t"},
    {"region": {"points": [3, 40]}, "force": (-0.2, 0.1)},
    {"region": "holes", "pressure": 0.7, "thickness": "undeformed", "amplitude": "1 - t/2"},
    {"region": "outline", "pressure": 0.2, "thickness": "undeformed"},
)


def test_forces_are_the_derivative_of_the_potential(random):
    """The potential is of second order in the positions: central differences of any step are
    exact but for rounding.
    """
    body, surface = holed_sheet()
    loads = loads_on(body, surface, *ALL_KINDS, t=0.6)
    assert loads.no_potential_because is None
    assert loads.potential(body.points) == pytest.approx(0, abs=1e-15)
    y = wavy(body.points)
    for _ in range(3):
        direction = random.standard_normal(y.shape)
        change = loads.potential(y + 0.1 * direction) - loads.potential(y - 0.1 * direction)
        expected = -(point_forces(loads, y) * direction).sum()
        assert change / 0.2 == pytest.approx(expected, abs=1e-12)
        assert loads.power(y, direction) == pytest.approx(-expected, abs=1e-12)


@pytest.mark.parametrize("name", sorted(FORCES))
def test_a_pressure_acts_on_the_thickness_that_every_model_has(name):
    """In affine deformation all models have the thickness of the law; the force on an edge is -p
    lambda_3 cof F N L (Nanson).
    """
    body, surface = plain_sheet()
    p, F = 0.3, np.array([[1.5, 0.3], [-0.1, 0.82]])
    traction = {"region": "top", "traction": (0.0, 0.25), "name": "pull"}
    loads = loads_on(body, surface, {"region": "right", "pressure": p}, traction)
    force, out = FORCES[name]().bind(body, LAW, ForceSettings()), np.empty_like(body.points)
    y = body.points @ F.T
    force(y, out)
    loaded, internal = LoadedForce(force, loads), out.copy()
    loaded(y, out)
    assert loaded.evaluations == 2
    trace, J = plane_stress.invariants(F)
    thickness = plane_stress.volume_ratio(LAW, trace, J) / J
    pressure = -p * thickness * J * np.linalg.inv(F).T @ [1, 0] * HEIGHT
    # The thickness is found to 1e-9 or better in double, the forces to 1e-7 of themselves in single
    # precision.
    found = loads.by_name(y, loaded.thickness())
    np.testing.assert_allclose(found["right"], pressure, rtol=1e-7)
    np.testing.assert_allclose(found["pull"], [0, 0.25 * WIDTH], atol=1e-15)
    np.testing.assert_allclose(
        (out - internal).sum(axis=0), found["right"] + found["pull"], atol=1e-13
    )


def test_loads_of_one_name_are_summed():
    body, surface = plain_sheet()
    loads = loads_on(
        body,
        surface,
        {"region": "right", "traction": (1.0, 0.0)},
        {"region": "right", "pressure": 0.25, "thickness": "undeformed"},
        {"region": {"points": [5]}, "force": (0.0, 1.0)},
        {"region": "right", "traction": (0.0, 2.0), "name": "shear"},
    )
    found = loads.by_name(body.points)
    assert list(found) == ["right", "loads.2", "shear"]
    np.testing.assert_allclose(found["right"], [0.75 * HEIGHT, 0], atol=1e-14)
    np.testing.assert_allclose(found["shear"], [0, 2.0 * HEIGHT], atol=1e-14)


def test_pressures_without_a_potential_say_why():
    body, surface = holed_sheet()
    force = FORCES["bond-energy"]().bind(body, LAW, DOUBLE)
    deformed = {"region": "holes", "pressure": 1.0}
    for load, why in (
        (deformed, "deformed thickness"),
        ({**deformed, "region": "right", "thickness": "undeformed"}, "is not closed"),
    ):
        loaded = LoadedForce(force, loads_on(body, surface, load))
        assert not loaded.has_energy
        assert why in loaded.no_energy_because
    assert loads_on(body, surface, deformed, plane="strain").no_potential_because is None
    assert not loads_on(body, surface, deformed, plane="strain").needs_thickness


def test_edges_with_memory_have_the_thickness_of_their_points():
    """The thickness by the law alone is that of an elastic state."""
    body, surface = holed_sheet()
    scene = scene_of({"region": "holes", "pressure": 1.0})
    relaxing = NeoHookean(memory=Memory((Branch(1.0, 1.0),)))
    for law, continued in ((NeoHookean(), False), (relaxing, True)):
        loads = loads_of(scene, body, Regions(body, surface), [law])
        assert loads.needs_thickness is continued


def test_states_without_a_load_are_invalid():
    body, surface = plain_sheet()
    loads = loads_on(
        body, surface, {"region": "right", "pressure": 1.0, "amplitude": "1 / (t - 0.5)"}
    )
    for thickness in (np.full(len(body), np.nan), np.full(len(body), -1.0)):
        with raising("thickness", InvalidState):
            loads.forces(body.points, thickness, np.zeros_like(body.points))
    with raising("the force of a pressure", InvalidState):
        loads.forces(body.points * np.inf, np.ones(len(body)), np.zeros_like(body.points))
    with raising(r"no value at t = 0\.5", InvalidState):
        loads.set(0.5)
    huge = loads_on(body, surface, {"body_force": (1e300, 0.0), "amplitude": "exp(50*t)"}, t=0.0)
    with raising("not finite at t = 1", InvalidState):
        huge.set(1.0)


def test_wrong_loads_are_refused():
    with raising(r"loads\.0\.thickness: under plane strain"):
        scene_of({"region": "right", "pressure": 1.0, "thickness": "deformed"}, plane="strain")
    with raising(r"loads\.1\.amplitude: .*no value at t = 2"):
        scene_of(
            {"body_force": (1, 0)}, {"body_force": (1, 0), "amplitude": "1 / (t - 2)"}, steps=2
        )
    body = sheet(planes=(ReflectionPlane(0, 0.0, -1, (-1, -1)),))
    surface = surface_of(body, [outline_of_sheet()])
    with raising(r"loads\.0\.region: the region contains the left edge"):
        loads_on(body, surface, {"region": "outline", "pressure": 1.0})
    loads_on(body, surface, {"region": "right", "pressure": 1.0})
