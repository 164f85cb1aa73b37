"""Bodies in space: shapes, holes, cuts, meshes and regions, and what is said about those that
make no sense.
"""

import meshio
import numpy as np
import pytest
from described import SCENES
from meshes import CUBE as UNIT_CUBE
from meshes import TETRAHEDRA, write_deck
from refusals import raising, refused, saying
from scipy.spatial import cKDTree

from pdsurrogate.discretization import discretize, grip_areas, surface_of
from pdsurrogate.discretization.cells import lattice_of
from pdsurrogate.problem.regions import BodyRegions
from pdsurrogate.scenes import Region, Scene, SceneError

BOX = {"shape": "box", "size": [1.0, 0.8, 0.6], "lower": [-0.2, 0.1, 0.0]}
GRIPS = ({"edge": "back", "travel": 0.5}, {"edge": "front", "travel": 0.5})


def scene_of(body=None, spacing=0.1, **changes):
    """Gripped along x3 unless it is loaded otherwise."""
    loading = {} if {"loads", "prescribed"} & changes.keys() else {"grips": GRIPS, "stretches": 1.5}
    return Scene(
        **{
            "name": "solid",
            "body": BOX if body is None else body,
            "spacing": spacing,
            "material": "neo-hookean",
            **loading,
            **changes,
        }
    )


def test_a_box_is_filled_with_cells_and_continued_beyond_its_grips():
    """Of 10 by 8 by 6 cubes, each with its 26 neighbors, images among them: those beyond x3 move
    with the grips in all components.
    """
    scene = scene_of()
    assert (scene.dimension, scene.plane, scene.horizon_ratio) == (3, "space", 1.75)
    body, lower, upper = discretize(scene)
    assert len(body) == 480
    assert body.volumes.sum() == pytest.approx(0.48, rel=1e-12)
    np.testing.assert_allclose(lower, [-0.2, 0.1, 0.0])
    np.testing.assert_allclose(upper, [0.8, 0.9, 0.6])
    np.testing.assert_allclose(body.points[:2], [[-0.15, 0.15, 0.05], [-0.05, 0.15, 0.05]])
    assert [plane.parity for plane in body.planes] == [(-1, -1, -1)] * 2
    assert len(body.ghosts) == 2 * 160
    inner = (np.abs(body.points[:, :2] - [0.3, 0.5]) < [0.35, 0.25]).all(axis=1)
    assert set(np.diff(body.bonds.pointers)[inner]) == {26}
    assert grip_areas(scene, lower, upper) == pytest.approx({"back": 0.8, "front": 0.8}, rel=1e-12)


@refused("bodies in space")
def test_what_makes_no_sense_is_told_in_one_line(changes, message):
    with saying(message, SceneError, begins=True):
        scene_of(**changes)


PI = np.pi
CYLINDER = {"shape": "cylinder", "radius": 0.5, "length": 1.0}
ANGLE = {"shape": "polygon", "vertices": [[0, 0], [1, 0], [1, 0.5], [0.5, 0.5], [0.5, 1], [0, 1]]}
CUBE = {"shape": "box", "size": [1.0, 1.0, 1.0], "lower": [-0.5, -0.5, -0.5]}


def bore(radius, axis="x3"):
    return {
        "shape": "cylinder",
        "radius": radius,
        "length": 1.4,
        "axis": axis,
        "base": [-0.7 * (axis == f"x{n}") for n in (1, 2, 3)],
    }


# Body, holes, volume, centroid (None where symmetry does not give it), and area of each part of the
# boundary.
BODIES = {
    "cylinder": (
        CYLINDER,
        [],
        PI / 4,
        (0, 0, 0.5),
        {"back": PI / 4, "front": PI / 4, "outline": PI},
    ),
    "sphere": ({"shape": "sphere", "radius": 0.5}, [], PI / 6, (0, 0, 0), {"outline": PI}),
    "half of a sphere with a bubble in its face": (
        {"shape": "sphere", "radius": 0.5, "part": "half"},
        [{"shape": "sphere", "radius": 0.15, "center": [0.0, 0.1, -0.1]}],
        PI / 12 * (1 - 0.3**3),
        None,
        {"outline": PI / 2, "holes.0": PI * 0.045, "left": PI * (0.25 - 0.0225)},
    ),
    "eighth of a thick sphere": (
        {"shape": "sphere", "radius": 0.5, "part": "eighth"},
        [{"shape": "sphere", "radius": 0.25}],
        PI / 48 * 7 / 8,
        None,
        {
            "outline": PI / 8,
            "holes.0": PI / 32,
            **dict.fromkeys(("left", "bottom", "back"), PI / 16 * 3 / 4),
        },
    ),
    "tube": (
        {"shape": "tube", "inner_radius": 0.3, "outer_radius": 0.5, "length": 0.8, "axis": "x1"},
        [],
        PI * 0.16 * 0.8,
        (0.4, 0, 0),
        {"left": PI * 0.16, "right": PI * 0.16, "outline": 0.8 * PI, "holes.0": 0.8 * 0.6 * PI},
    ),
    "angle with a hole": (
        {
            "shape": "extrusion",
            "outline": ANGLE,
            "holes": [{"shape": "circle", "radius": 0.1, "center": [0.25, 0.25]}],
            "thickness": 0.5,
        },
        [],
        (0.75 - PI * 0.01) / 2,
        None,
        {
            **{
                "left": 0.5,
                "right": 0.25,
                "bottom": 0.5,
                "top": 0.25,
                "outline": 0.5,
                "holes.0": 0.1 * PI,
            },
            **{"back": 0.75 - PI * 0.01, "front": 0.75 - PI * 0.01},
        },
    ),
    "box with a bore": (
        CUBE,
        [bore(0.2, "x2")],
        1 - PI * 0.04,
        (0, 0, 0),
        {
            "left": 1,
            "right": 1,
            "back": 1,
            "front": 1,
            "bottom": 1 - PI * 0.04,
            "top": 1 - PI * 0.04,
            "holes.0": 0.4 * PI,
        },
    ),
    "box with a slot and a bubble": (
        CUBE,
        [
            {"shape": "sphere", "radius": 0.15, "center": [-0.2, 0.1, 0.1]},
            {"shape": "box", "size": [0.3, 0.2, 2.0], "lower": [0.3, -0.1, -1.0]},
        ],
        1 - PI / 6 * 0.027 - 0.04,
        None,
        {
            **{"left": 1, "right": 0.8, "bottom": 1, "top": 1, "back": 0.96, "front": 0.96},
            **{"holes.0": 0.09 * PI, "holes.1": 0.6},
        },
    ),
}


def free_body(name, spacing=0.1):
    """A body that is loaded alone, which asks nothing of its faces."""
    body, holes, *exact = BODIES[name]
    scene = scene_of(body, spacing, holes=holes, loads=[{"body_force": [0, 0, 1]}], steps=1)
    return scene, *discretize(scene), exact


@pytest.mark.parametrize("name", BODIES)
def test_volumes(name):
    """To the places asked in cut cells: some 1/1000 of a cell for each that is cut along the
    axes, 1/200 elsewhere, which average out.
    """
    _, body, lower, upper, (volume, centroid, _) = free_body(name)
    cell = 0.1**3
    assert body.volumes.sum() == pytest.approx(volume, rel=3e-3)
    assert 0.5 * cell <= body.volumes.min() <= body.volumes.max() < 2.5 * cell
    if centroid is not None:
        moment = (body.volumes[:, None] * (body.points - centroid)).sum(axis=0)
        np.testing.assert_allclose(moment, 0, atol=1e-12)  # as symmetric as the body
        images = cKDTree(body.points).query(2 * np.array(centroid) - body.points)
        assert images[0].max() < 1e-9
        np.testing.assert_allclose(body.volumes[images[1]], body.volumes, rtol=1e-9)
    assert (body.points > lower).all()
    assert (body.points < upper).all()


def test_grips_have_the_area_of_the_face_that_they_hold():
    """But for chords of round faces that are shorter than 1/16 of a cell.  A sphere has no flat
    face to be held by.
    """
    for body, holes, area, tolerance in (
        (BOX, [], 0.8, 1e-12),
        (CYLINDER, [], PI / 4, 1e-6),
        (CUBE, [bore(0.2)], 1 - PI * 0.04, 1e-6),
        (CUBE, [{"shape": "box", "size": [0.2, 2.0, 2.0], "lower": [-0.1, -1.0, -1.0]}], 0.8, 1e-9),
        (
            CUBE,
            [{"shape": "box", "size": [2.0, 0.21, 2.0], "lower": [-1.0, -0.1, -1.0]}],
            0.79,
            1e-6,
        ),
    ):
        scene = scene_of(body, holes=holes)
        _, lower, upper = discretize(scene)
        assert grip_areas(scene, lower, upper) == pytest.approx(
            {"back": area, "front": area}, rel=tolerance
        )
    scene = scene_of({"shape": "sphere", "radius": 0.5}, support="points")
    _, lower, upper = discretize(scene)
    with raising("no straight edge with material at its back end that could be held", SceneError):
        grip_areas(scene, lower, upper)


CUTS = SCENES["cuts of boxes"]


BETWEEN = {
    "through a layer of points": {**CUTS["through a layer of points"], "corner": [-0.6, -0.6, 0.0]}
}
"""Cuts along layers of points part whole cells, with the points on them above."""


def meets(cut, start, end):
    """Whether a segment meets a flat cut, by solving for the place where it does; a start on the
    plane counts as above it.
    """
    if "radius" in cut:
        normal, origin = np.array(cut["normal"]), np.array(cut["center"])
    else:
        normal, origin = np.cross(*cut["sides"]), np.array(cut["corner"])
    before, after = ((place - origin) @ normal for place in (start, end))
    if (before >= -1e-12) == (after >= -1e-12):
        return False
    place = start + before / (before - after) * (end - start) - origin
    if "radius" in cut:
        return np.linalg.norm(place) <= cut["radius"]
    shares = np.linalg.lstsq(np.array(cut["sides"]).T, place, rcond=None)[0]
    return bool((shares >= 0).all() and (shares <= 1).all())


@pytest.mark.parametrize("kind", CUTS)
def test_precuts_separate_exactly_the_bonds_that_cross_them(kind):
    whole = discretize(scene_of(CUBE))[0]
    scene = scene_of(CUBE, precuts=[CUTS[kind]])
    body = discretize(scene)[0]
    bonds = np.stack([whole.bonds.first, whole.bonds.second], axis=1)
    crossing = np.array(
        [meets(BETWEEN.get(kind, CUTS[kind]), *whole.all_points[bond]) for bond in bonds]
    )
    assert crossing.any()
    np.testing.assert_array_equal(
        np.stack([body.bonds.first, body.bonds.second], axis=1), bonds[~crossing]
    )
    assert {tuple(pair) for pair in body.bonds.cut} == {tuple(pair) for pair in bonds[crossing]}


def test_precuts_that_cut_nothing_are_refused():
    with raising(r"precuts\.0: the precut crosses no bond", SceneError):
        discretize(scene_of(CUBE, precuts=[{**CUTS["disc"], "center": [0, 0, 2.0]}]))


def test_no_bond_crosses_empty_space():
    """A slot one cell wide: no bond leads from one side to the other, and those around its end
    stay.  A bubble of two cells, likewise.
    """
    slot = {"shape": "box", "size": [0.7, 2.0, 0.1], "lower": [-0.5, -1.0, 0.0]}
    body = discretize(scene_of(CUBE, holes=[slot], horizon_ratio=2.3))[0]
    first, second = body.all_points[body.bonds.first], body.all_points[body.bonds.second]
    share = (0.05 - first[:, 2]) / np.where(
        first[:, 2] == second[:, 2], np.inf, second[:, 2] - first[:, 2]
    )
    middle = first + share[:, None] * (second - first)
    across = (share > 0) & (share < 1)
    assert across.any()
    assert middle[across, 0].min() > 0.2 - 0.04
    bubble = {"shape": "sphere", "radius": 0.2}
    body = discretize(scene_of(CUBE, holes=[bubble], horizon_ratio=3.0))[0]
    assert not (
        np.linalg.norm(
            (body.all_points[body.bonds.first] + body.all_points[body.bonds.second]) / 2, axis=1
        )
        < 0.1
    ).any()


def check_boundary(surface, body, volume):
    """Closed, of the body's volume by the divergence theorem, and following affine motions."""
    edges = np.concatenate(
        [surface.facets[:, [0, 1]], surface.facets[:, [1, 2]], surface.facets[:, [2, 0]]]
    )
    n = len(surface.nodes)
    forth, back = edges @ [n, 1], edges @ [1, n]
    assert len(np.unique(forth)) == len(forth)
    np.testing.assert_array_equal(np.sort(forth), np.sort(back))
    np.testing.assert_allclose(surface.normals().sum(axis=0), 0, atol=1e-13)
    assert (surface.midpoints() * surface.normals()).sum() / 3 == pytest.approx(volume, rel=1e-12)
    assert surface.followed().all()
    F, shift = np.array([[1.2, 0.1, 0.3], [0.0, 0.9, 0.2], [-0.1, 0.4, 1.1]]), [1, 2, 3]
    np.testing.assert_allclose(
        surface.interpolation(body.points @ F.T + shift),
        surface.nodes @ F.T + shift,
        rtol=0,
        atol=1e-12,
    )


@pytest.mark.parametrize("name", BODIES)
def test_boundaries(name):
    """Areas of flat parts to rounding; of round ones to theta^2/24 and less, with theta = h/a
    for facets of a cell.
    """
    scene, body, lower, upper, (volume, _, parts) = free_body(name)
    surface = surface_of(scene, body, lower, upper)
    check_boundary(surface, body, volume)
    found = {
        part: surface.areas()[surface.parts == part].sum() for part in np.unique(surface.parts)
    }
    assert set(found) == set(parts)
    for part, area in parts.items():
        round_ = part in ("outline", "holes.0") or "part" in scene.body.model_fields_set
        assert found[part] == pytest.approx(area, rel=0.02 if round_ else 1e-9), part
    assert surface.areas().min() > 0.05 * 0.1**2
    assert (
        np.linalg.norm(surface.nodes[surface.facets] - surface.midpoints()[:, None], axis=2).max()
        < 0.13
    )
    some = slice(None, None, 37)
    normals = surface.normals() / surface.areas()[:, None]
    assert surface.encloses(surface.midpoints()[some] - 1e-3 * normals[some]).all()
    assert not surface.encloses(surface.midpoints()[some] + 1e-3 * normals[some]).any()
    # The outermost points lie about half a cell inside, fewer of a cut cell's.
    distance = surface.distances(body.points, 0.2)
    assert 0.01 < distance.min() < 0.051


def test_holes_whose_boundary_meets_another_have_bonds_but_no_boundary():
    scene = scene_of(CUBE, holes=[{"shape": "sphere", "radius": 0.2, "center": [0.5, 0.0, 0.0]}])
    body, lower, upper = discretize(scene)
    assert body.volumes.sum() == pytest.approx(1 - PI * 0.032 / 6, rel=1e-3)
    with raising(r"^holes\.0: .*; with loads or probes, a hole must lie inside the body,"):
        surface_of(scene, body, lower, upper)


def regions_of(scene):
    body, lower, upper = discretize(scene)
    return BodyRegions(scene, body, lower, upper, lambda: surface_of(scene, body, lower, upper))


def test_regions():
    scene = scene_of(
        BOX,
        regions={"corner": {"and": ["left", "top", {"edge": "front"}]}},
        holes=[{**CYLINDER, "radius": 0.15, "base": [0.3, 0.5, -0.1]}],
    )
    regions = regions_of(scene)
    points = discretize(scene)[0].points
    for said, expected in (
        ("front", points[:, 2] > 0.5),
        ("bottom", points[:, 1] < 0.2),
        ("corner", (points[:, 0] < -0.1) & (points[:, 1] > 0.8) & (points[:, 2] > 0.5)),
        (
            Region(ball={"center": [0, 0.5, 0.3], "radius": 0.2}),
            np.linalg.norm(points - [0, 0.5, 0.3], axis=1) <= 0.2,
        ),
        (
            Region(half_space={"point": [0, 0, 0.3], "normal": [0, 1, -1]}),
            points[:, 1] - points[:, 2] >= -0.3 - 1e-9,
        ),
        (Region(box=[[0, 0.1, 0], [0.8, 0.9, 0.2]]), (points[:, 0] > 0) & (points[:, 2] < 0.2)),
        (Region(**{"not": "front"}), points[:, 2] < 0.5),
    ):
        np.testing.assert_array_equal(regions.points(said), np.flatnonzero(expected))
    beside = np.linalg.norm(points[:, :2] - [0.3, 0.5], axis=1)[regions.points("holes.0")]
    assert 0.15 < beside.min() <= beside.max() < 0.26
    surface = regions.surface()
    assert surface.areas()[regions.facets("front")].sum() == pytest.approx(
        0.8 - PI * 0.0225, rel=1e-9
    )
    assert surface.areas()[regions.facets("holes.0")].sum() == pytest.approx(
        0.3 * PI * 0.6, rel=0.02
    )
    assert regions.edge("front") == "front"
    assert len(regions.points(Region(near=[0.01, 0.21, 0.33]))) == 1
    with raising(r"^region: .*; the nearest is point \d+ at \(.*, 0\.55\), 0\.35 away$"):
        regions.points(Region(box=[[-1, -1, 0.9], [1, 1, 1]]))
    assert len(regions.facets("outline")) == np.count_nonzero(surface.parts != "holes.0")
    with raising(r"^probes\.0\.at: \(0\.3, 0\.5, 0\.3\) .* its nearest point is"):
        regions.check_place("probes.0.at", (0.3, 0.5, 0.3))
    regions.check_place("probes.0.at", (0.8, 0.9, 0.6))


def test_faces_that_are_not_flat_are_told():
    regions = regions_of(free_body("sphere")[0])
    with raising(r"^left: .*; no flat part of the body is on its left face$"):
        regions.facets("left")


def solid_mesh(count=6, jitter=0.2):
    """A cube of side 1 of hexahedra with a cubic cavity in its middle, whose inner nodes are
    moved at random: nodes and cells.
    """
    axis = np.arange(count + 1) / count
    nodes = lattice_of(axis, axis, axis)
    moved = ((nodes > 0.01) & (nodes < 0.99)) * np.random.default_rng(0).uniform(
        -jitter / count, jitter / count, nodes.shape
    )

    def node(i, j, k):
        return (i * (count + 1) + j) * (count + 1) + k

    around = ((0, 0), (1, 0), (1, 1), (0, 1))
    cells = [
        [node(i + a, j + b, k + c) for c in (0, 1) for a, b in around]
        for i, j, k in np.ndindex(count, count, count)
        if not all(count // 2 - 1 <= n <= count // 2 for n in (i, j, k))
    ]
    return nodes + moved, np.array(cells)


@pytest.mark.parametrize("kind", ["hexahedron", "tetra"])
def test_meshes(tmp_path, kind):
    """Volumes are those that the boundary encloses; the cavity is a hole, and groups are cells
    or what has their faces.
    """
    nodes, cells = solid_mesh()
    if kind == "hexahedron":
        sides = ("quad", cells[nodes[cells][..., 2].max(axis=1) > 0.99][:, 4:])
        blocks = [("hexahedron", cells), sides]
    else:
        sides, blocks = (
            None,
            [("tetra", np.concatenate([cells[:, corners] for corners in TETRAHEDRA]))],
        )
    path = tmp_path / "solid.vtu" if not sides else tmp_path / "solid.inp"
    if sides:
        write_deck(path, nodes, blocks, {"lid": 1})
    else:
        meshio.write(path, meshio.Mesh(nodes, blocks))
    scene = scene_of({"shape": "mesh", "dimension": 3, "file": str(path)}, 1 / 6)
    body, lower, upper = discretize(scene)
    assert len(body) == sum(len(block[1]) for block in blocks if block is not sides)
    surface = surface_of(scene, body, lower, upper)
    np.testing.assert_allclose([lower, upper], [[0, 0, 0], [1, 1, 1]], atol=1e-12)
    cavity = 1 - body.volumes.sum()
    assert cavity == pytest.approx(1 / 27, rel=0.2)
    assert grip_areas(scene, lower, upper) == pytest.approx({"back": 1.0, "front": 1.0}, rel=1e-9)
    check_boundary(surface, body, 1 - cavity)
    assert set(surface.parts) == {"left", "right", "bottom", "top", "back", "front", "holes.0"}
    if sides:
        np.testing.assert_array_equal(
            np.sort(surface.groups["lid"]), np.flatnonzero(surface.parts == "front")
        )
        assert (body.points[body.groups["lid"], 2] > 5 / 6 - 0.05).all()
        assert len(body.groups["lid"]) == 36


def test_meshes_whose_cells_share_no_faces_have_no_boundary(tmp_path):
    """The quadrilateral between a hexahedron and six tetrahedra would be twice on the boundary:
    as one face, and as two.
    """
    nodes = np.concatenate([UNIT_CUBE, np.add(UNIT_CUBE, [0, 0, 1])])
    above = np.array([[corner[k] for k in range(4)] for corner in TETRAHEDRA]) + 8
    meshio.write(
        tmp_path / "two.vtu",
        meshio.Mesh(nodes.astype(float), [("hexahedron", [list(range(8))]), ("tetra", above)]),
    )
    scene = scene_of(
        {"shape": "mesh", "dimension": 3, "file": str(tmp_path / "two.vtu")}, 1.0, support="points"
    )
    with raising(r"^body\.file: faces of tetrahedra "):
        surface_of(scene, *discretize(scene))


@refused("meshes in space")
def test_meshes_that_make_no_body_in_space(tmp_path, cells, dimension, message):
    path = tmp_path / "bad.vtu"
    meshio.write(
        path,
        meshio.Mesh(
            np.array(UNIT_CUBE, float), [(kind, np.array(corners)) for kind, corners in cells]
        ),
    )
    body = {"shape": "mesh", "dimension": dimension, "file": str(path)}
    grips = ({"edge": "left", "travel": 1.0}, {"edge": "right"})
    with saying(message, SceneError):
        discretize(scene_of(body, 1.0, **{"grips": grips, "stretches": 1.5}))
