"""Bodies of scenes: shapes, holes, precuts and meshes, and what is said about those that make no
sense.
"""

import math
import warnings

import meshio
import numpy as np
import pytest
from bodies import build_body
from meshes import CUBE, TETRAHEDRA
from refusals import raising, refused, saying
from scipy.spatial import cKDTree

import pdsurrogate as pds
from pdsurrogate.body import Cells
from pdsurrogate.discretization import check_size, discretize, grip_areas, memory_here
from pdsurrogate.materials import homogeneous
from pdsurrogate.problem import compile_scene
from pdsurrogate.scenes import SceneError, load_scene
from pdsurrogate.scenes.references import finite_element_level, reference_level


def scene_of(**changes):
    return load_scene("hole", {"spacing": 0.1, "reference": "uniaxial", **changes})


CURVED = {
    "plate with a hole": (
        {"holes": [{"shape": "circle", "radius": 0.4}]},
        12 - np.pi * 0.16,
        (0, 0),
    ),
    "off the grid": (
        {"holes": [{"shape": "circle", "radius": 0.33, "center": [0.217, -0.131]}]},
        12 - np.pi * 0.1089,
        None,
    ),
    "disc": (
        {"body": {"shape": "circle", "radius": 1.03, "center": [0.2, 0.1]}, "holes": []},
        np.pi * 1.0609,
        (0.2, 0.1),
    ),
    "triangle": (
        {"body": {"shape": "polygon", "vertices": [[0, 0], [2, 0.3], [0.7, 1.7]]}, "holes": []},
        (2 * 1.7 - 0.7 * 0.3) / 2,
        (0.9, 2 / 3),
    ),
}


@pytest.mark.parametrize("case", CURVED)
def test_curved_outlines_enclose_their_area(case):
    """Area and centroid of what is there, whatever the outline cuts: to the raster, some 1/1000 of
    a cell for each of the cells cut.

    Those errors average out between cells; a disc, which its grid fills, is cut alike in eight
    parts, and they do not between these.
    """
    changes, area, centroid = CURVED[case]
    scene = scene_of(**changes)
    body = build_body(scene)
    assert body.volumes.sum() == pytest.approx(
        area, abs=0.1 * scene.spacing**2 * (np.sqrt(8) if case == "disc" else 1)
    )
    if centroid is not None:
        moment = (body.volumes[:, None] * (body.points - centroid)).sum(axis=0)
        np.testing.assert_allclose(moment, 0, atol=0.1 * scene.spacing**2)
    cell = body.spacing**2
    assert 0.5 * cell <= body.volumes.min()
    assert body.volumes.max() < 2 * cell
    assert cKDTree(body.points).query(body.points, 2)[0][:, 1].min() > 0.5 * scene.spacing


def test_straight_outlines_on_cell_boundaries_change_no_cell():
    body = build_body(
        scene_of(holes=[{"shape": "rectangle", "size": [0.6, 0.8], "lower": [-0.3, -0.4]}])
    )
    assert len(body) == 30 * 40 - 6 * 8
    np.testing.assert_allclose(body.volumes, 0.01, rtol=1e-12)
    whole = build_body(scene_of(holes=[])).points
    assert cKDTree(whole).query(body.points)[0].max() < 1e-12


def test_spacings_that_divide_give_squares_to_the_last_bit():
    """Whatever divides to rounding: 3 cm by 0.1 is 30 cells less 4e-15."""
    for spacing in (0.1, 0.05, 0.02, 1 / 30, 0.0625):
        cells = Cells.filling((0.0, -1.0), (3.0, 2.0), spacing)
        assert cells.sides == (spacing, spacing)
        assert cells.spacing == spacing
        assert np.array_equal(
            np.unique(cells.centers()[:, 0]), (np.arange(round(3 / spacing)) + 0.5) * spacing
        )


@pytest.mark.parametrize("make", [Cells.filling, Cells.near])
def test_the_number_of_cells_does_not_depend_on_the_unit_of_length(make):
    """1.15 by 0.1 is 11.5: rounding must not decide between 11 and 12 cells."""
    for unit in (1e-5, 1e-3, 3.7, 1e3):
        for length in (1.05, 1.15, 1.65, 2.05):
            assert (
                make((0.0, 0.0), (length * unit, unit), 0.1 * unit).counts
                == make((0.0, 0.0), (length, 1.0), 0.1).counts
            )


def test_the_nearest_cells_fill_a_body_that_the_spacing_does_not_divide():
    """``pdsurrogate run tear --set spacing=0.06``: "spacing 0.06 does not divide the body's 11
    along x1; 0.0601093 would".
    """
    body = build_body(
        load_scene("tear", {"spacing": 0.06, "precuts": [{"start": [0.0, 1.5], "end": [3.0, 1.5]}]})
    )
    np.testing.assert_allclose(body.cell, [11 / 183, 3 / 50])
    assert len(body) == 183 * 50
    np.testing.assert_allclose(body.volumes, 33 / len(body))
    np.testing.assert_allclose(body.points.min(axis=0), body.cell / 2)
    np.testing.assert_allclose(body.points.max(axis=0), [11, 3] - body.cell / 2)
    np.testing.assert_allclose(body.ghosts.points[:, 1].min(), -2.5 * body.cell[1])
    # The horizon takes in the neighbors that it has among squares: 28 of a point away from all
    # edges and cuts.
    inner = np.argmin(np.linalg.norm(body.points - [8.0, 1.0], axis=1))
    assert np.diff(body.bonds.pointers.astype(int))[inner] == 28


@pytest.mark.parametrize("spacing", [0.1, 0.05])
def test_a_precut_through_a_row_of_points_cuts_on_one_side_of_it(spacing):
    """Points on the line belong to its left, above a cut that runs to the right: the row is
    bound to what is above it alone.
    """
    body = build_body(
        load_scene(
            "tear",
            {
                "spacing": spacing,
                "body.size": [2.0, 1.0],
                "precuts": [{"start": [-1, 0.45], "end": [3, 0.45]}],
            },
        )
    )
    bonds, points = body.bonds, body.all_points
    above = points[:, 1] > 0.45 - 1e-9
    assert (above[bonds.first] == above[bonds.second]).all()
    assert (above[bonds.cut[:, 0]] != above[bonds.cut[:, 1]]).all()


@refused("bodies and programs")
def test_bodies_and_programs_that_make_no_sense(changes, message):
    with saying(message, SceneError):
        build_body(scene_of(**changes))


def write_mesh(path, size=0.1):
    """A 1 x 1 square: quadrilaterals below, triangles above."""
    count = round(1 / size)
    x = np.linspace(0, 1, count + 1)
    points = np.array([[x1, x2, 0] for x2 in x for x1 in x])
    corner = np.array([[i + j * (count + 1) for i in range(count)] for j in range(count)])
    quads = np.stack([corner, corner + 1, corner + count + 2, corner + count + 1], axis=2).reshape(
        -1, 4
    )
    lower, upper = quads[: len(quads) // 2], quads[len(quads) // 2 :]
    meshio.write(
        path,
        meshio.Mesh(
            points,
            [("quad", lower), ("triangle", np.vstack([upper[:, [0, 1, 2]], upper[:, [0, 2, 3]]]))],
        ),
    )


def test_mesh_bodies(tmp_path):
    """Centroids and areas become points and volumes.

    Where cells change shape a horizon is not symmetric, and a force map leaves the homogeneous
    state by a discretization error: 0.5 % allows for it with ten cells to a side.
    """
    write_mesh(tmp_path / "square.vtu")
    (tmp_path / "mine.toml").write_text("""
        name = "mine"
        spacing = 0.1
        stretches = [1.5]
        body = { shape = "mesh", file = "square.vtu" }
        material = "neo-hookean"
        [[grips]]
        edge = "left"
        holds = "normal"
        [[grips]]
        edge = "right"
        holds = "normal"
        travel = 1.0
        """)
    scene = load_scene(tmp_path / "mine.toml")
    body = build_body(scene)
    assert len(body) == 50 + 100
    assert body.volumes.sum() == pytest.approx(1.0)
    np.testing.assert_allclose((body.points * body.volumes[:, None]).sum(axis=0), 0.5)
    level = pds.simulate(scene, "analytic").levels[0]
    exact = homogeneous.uniaxial(scene.material.build(), 1.5).nominal_stress
    assert level["nominal_stress_work_conjugate"] == pytest.approx(exact, rel=5e-3)
    assert "lateral_displacement" not in level


def test_cross_sections_at_grips(tmp_path):
    """The straight edge of a rectangle, less a hole; of a trapezium, at its very ends; of a
    mesh, from its cells.
    """
    write_mesh(tmp_path / "square.vtu")
    for body, holes, expected in (
        ({"shape": "rectangle", "size": [3.0, 1.1]}, [], 1.1),
        (
            {"shape": "rectangle", "size": [3.0, 1.0]},
            [{"shape": "circle", "radius": 0.25, "center": [0.05, 0.5]}],
            {"left": 1 - 2 * np.sqrt(0.25**2 - 0.05**2), "right": 1.0},
        ),
        (
            {"shape": "polygon", "vertices": [[0, 0], [2, 0], [2, 1], [0, 0.4]]},
            [],
            {"left": 0.4, "right": 1.0},
        ),
        ({"shape": "mesh", "file": str(tmp_path / "square.vtu")}, [], 1.0),
        (
            {"shape": "mesh", "file": str(tmp_path / "square.vtu")},
            [{"shape": "rectangle", "size": [0.3, 0.4], "lower": [0.0, 0.0]}],
            {"left": 0.6, "right": 1.0},
        ),
    ):
        scene = load_scene("uniaxial", {"spacing": 0.1, "body": body, "holes": holes})
        _, lower, upper = discretize(scene)
        expected = expected if isinstance(expected, dict) else {"left": expected, "right": expected}
        assert grip_areas(scene, lower, upper) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    "body",
    [
        {"shape": "circle", "radius": 1.0},
        {"shape": "polygon", "vertices": [[0, 0.5], [1, 0], [2, 0], [2, 1], [1, 1]]},
    ],
)
def test_ends_without_a_straight_edge_are_refused(body):
    """A disc was given the area of its chord half a cell inside, which is another at every
    spacing.
    """
    scene = load_scene("uniaxial", {"spacing": 0.1, "body": body})
    _, lower, upper = discretize(scene)
    with raising("no straight edge with material at its left end", SceneError):
        grip_areas(scene, lower, upper)


CORNERS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [3, 0, 0], [2, 1, 0]]


@refused("meshes")
def test_meshes_that_make_no_body(tmp_path, corners, cells, message):
    path = tmp_path / "bad.vtu"
    meshio.write(path, meshio.Mesh(np.array(corners, float), list(map(tuple, cells))))
    with raising(message, SceneError):
        build_body(scene_of(body={"shape": "mesh", "file": str(path)}, holes=[]))


def bodies_of(path, dimension=2, **changes):
    """The body of a mesh, and the same with middles of edges."""
    return build_body(
        scene_of(
            spacing=None,
            support="points",
            body={"shape": "mesh", "file": str(path), "dimension": dimension},
            holes=[],
            **changes,
        )
    )


@pytest.mark.parametrize("axes", [(0, 1), (0, 2), (1, 2)])
@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_a_flat_mesh_may_lie_in_any_plane_of_two_axes_with_the_noise_of_a_drawing(
    tmp_path, axes, noise
):
    """Those in other planes than that of x1 and x2, and with a millionth across it, were not
    flat.
    """
    write_mesh(tmp_path / "square.vtu")
    mesh = meshio.read(tmp_path / "square.vtu")
    expected = bodies_of(tmp_path / "square.vtu")
    points = np.zeros_like(mesh.points)
    points[:, list(axes)] = mesh.points[:, :2]
    (across,) = {0, 1, 2} - {*axes}
    points[:, across] = 3.0 + noise * np.random.default_rng(0).uniform(-1, 1, len(points))
    meshio.write(tmp_path / "turned.vtu", meshio.Mesh(points, mesh.cells))
    found = bodies_of(tmp_path / "turned.vtu")
    np.testing.assert_array_equal(found.points, expected.points)
    np.testing.assert_array_equal(found.volumes, expected.volumes)


def test_an_element_in_two_physical_groups_is_one(tmp_path):
    """gmsh's version 2 lists it once for each group, so that points coincided."""
    path, nodes = tmp_path / "two.msh", np.array(CORNERS, float)
    cells = [("quad", [[0, 1, 2, 3], [1, 4, 5, 2]]), ("quad", [[1, 2, 5, 4][::-1]])]
    data = {
        name: [np.array([1, 1]), np.array([2])] for name in ("gmsh:physical", "gmsh:geometrical")
    }
    fields = {"all": np.array([1, 2]), "right": np.array([2, 2])}
    meshio.write(
        path,
        meshio.Mesh(nodes, cells, cell_data=data, field_data=fields),
        file_format="gmsh22",
        binary=False,
    )
    body = bodies_of(path)
    np.testing.assert_allclose(body.volumes, [1.0, 1.5])
    assert {name: members.tolist() for name, members in body.groups.items()} == {
        "all": [0, 1],
        "right": [1],
    }


def with_middles(nodes, kind, cells, edges, bulge=0.0):
    """Quadratic cells of a linear mesh, with the middle of every edge, and of a cell if its type
    has one, moved by `bulge` along x1.
    """
    nodes, found, middles = list(map(list, nodes)), [], {}
    for cell in cells:
        row = list(cell)
        for one, other in edges:
            key = frozenset((cell[one], cell[other]))
            if key not in middles:
                middles[key] = len(nodes)
                nodes.append(
                    (np.add(nodes[cell[one]], nodes[cell[other]]) / 2 + [bulge, 0, 0]).tolist()
                )
            row.append(middles[key])
        while len(row) < int(kind.lstrip("abcdefghijklmnopqrstuvwxyz")):
            nodes.append(np.mean([nodes[corner] for corner in cell], axis=0).tolist())
            row.append(len(nodes) - 1)
        found.append(row)
    return meshio.Mesh(np.array(nodes), [(kind, np.array(found))])


FLAT = [(0, 1), (1, 2), (2, 0)], [(0, 1), (1, 2), (2, 3), (3, 0)]
TETRA = [*FLAT[0], (0, 3), (1, 3), (2, 3)]
BRICK = [*FLAT[1], (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
UNIT = [
    *CUBE,
    [2, 0, 0],
    [2, 1, 0],
    [2, 0, 1],
    [2, 1, 1],
]
HALVES = [[0, 1, 2, 3, 4, 5, 6, 7], [1, 8, 9, 2, 5, 10, 11, 6]]
SIMPLICES = [[half[k] for k in four] for half in HALVES for four in TETRAHEDRA]


@pytest.mark.parametrize(
    ("kind", "linear", "edges", "cells", "suffix"),
    [
        ("triangle6", "triangle", FLAT[0], [[0, 1, 2], [0, 2, 3], [1, 8, 9], [1, 9, 2]], "msh"),
        ("quad9", "quad", FLAT[1], [[0, 1, 2, 3], [1, 8, 9, 2]], "msh"),
        ("tetra10", "tetra", TETRA, SIMPLICES, "inp"),
        ("hexahedron27", "hexahedron", BRICK, HALVES, "vtu"),
    ],
)
def test_quadratic_cells_are_those_of_their_corners(tmp_path, kind, linear, edges, cells, suffix):
    """They were refused. Straight edges leave nothing out; the area that curved ones enclose is
    another, and a warning says so.
    """
    dimension = 2 if linear in ("triangle", "quad") else 3
    ends = {"edge": "left", "holds": "normal"}, {"edge": "right", "holds": "normal", "travel": 1.0}
    meshio.write(
        tmp_path / "linear.vtu", meshio.Mesh(np.array(UNIT, float), [(linear, np.array(cells))])
    )
    expected = bodies_of(tmp_path / "linear.vtu", dimension, grips=ends)
    form = {"file_format": "gmsh22", "binary": False} if suffix == "msh" else {}
    for bulge in (0.0, 0.05):
        path = tmp_path / f"quadratic{bulge}.{suffix}"
        meshio.write(path, with_middles(UNIT, kind, cells, edges, bulge), **form)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            found = bodies_of(path, dimension, grips=ends)
        np.testing.assert_allclose(found.points, expected.points, atol=1e-12)
        np.testing.assert_allclose(found.volumes, expected.volumes, rtol=1e-12)
        assert any(
            "curved edges, by up to 5 % of their length" in str(each.message) for each in told
        ) == (bulge > 0)


def write_graded(path, widths):
    """A bar of height 1 of four rows of cells with the given widths, from left to right."""
    x = np.cumsum([0.0, *widths])
    nodes = np.array([[x1, row / 4, 0.0] for x1 in x for row in range(5)])
    corner = np.array([5 * column + row for column in range(len(widths)) for row in range(4)])
    meshio.write(path, meshio.Mesh(nodes, [("quad", corner[:, None] + [0, 5, 6, 1])]))


@pytest.mark.parametrize("widths", [(0.75, 0.25, *12 * [0.125]), (*4 * [0.5], 0.25, *4 * [0.0625])])
def test_the_edge_of_a_graded_mesh_is_its_cells_there(tmp_path, widths):
    """Large cells at the left edge lie more than a mean cell inside: no point; of small ones
    several layers lie in a mean cell.
    """
    write_graded(tmp_path / "graded.vtu", widths)
    body = bodies_of(tmp_path / "graded.vtu")
    scene = scene_of(
        spacing=None,
        support="points",
        body={"shape": "mesh", "file": str(tmp_path / "graded.vtu")},
        holes=[],
    )
    regions = compile_scene(scene).regions
    x, length = body.points[:, 0], sum(widths)
    np.testing.assert_array_equal(regions.points("left"), np.flatnonzero(x < widths[0]))
    np.testing.assert_array_equal(regions.points("right"), np.flatnonzero(x > length - widths[-1]))
    outer = (x < widths[0]) | (x > length - widths[-1]) | (np.abs(body.points[:, 1] - 0.5) > 0.25)
    np.testing.assert_array_equal(regions.points("outline"), np.flatnonzero(outer))


def test_what_meshio_prints_is_in_the_message(tmp_path, capsys):
    """Of a .msh file that none of its readers takes it prints why, and exits with status 1:
    "meshio cannot read bad.msh: 1".
    """
    (tmp_path / "bad.msh").write_text("not a mesh")
    with raising(r"bad\.msh: .*as either of ansys, gmsh", SceneError):
        build_body(scene_of(body={"shape": "mesh", "file": str(tmp_path / "bad.msh")}, holes=[]))
    assert not any(capsys.readouterr())


SLIT = {"shape": "rectangle", "size": [0.2, 1.2], "lower": [1.4, -0.1]}
NOTCHED = [[0, 0], [1.4, 0], [1.5, 0.8], [1.6, 0], [3, 0], [3, 1], [0, 1]]


@pytest.mark.parametrize("width", [0.1, 0.2])
def test_no_bond_crosses_a_gap_narrower_than_the_horizon(width):
    """``uniaxial`` cut through by a hole 0.2 wide, at a horizon of 0.315, still bore a stress of
    0.51 kPa.
    """
    body = build_body(
        load_scene("uniaxial", {"spacing": 0.1, "holes": [{**SLIT, "size": [width, 1.2]}]})
    )
    bonds, left = body.bonds, body.all_points[:, 0] < 1.4 + width / 2
    assert (left[bonds.first] == left[bonds.second]).all()
    assert len(bonds.cut)


def test_bonds_across_notches_and_corners_are_cut_and_beside_smooth_holes_are_not():
    """The notch of the outline narrows to nothing, and binds above its end; the hole's radius is
    4 cells, the voids' are 5.
    """
    body = build_body(
        load_scene("uniaxial", {"spacing": 0.1, "body": {"shape": "polygon", "vertices": NOTCHED}})
    )
    bonds, points = body.bonds, body.all_points
    low = points[:, 1] < 0.25
    across = (points[bonds.first, 0] < 1.5) != (points[bonds.second, 0] < 1.5)
    assert not (across & low[bonds.first] & low[bonds.second]).any()
    assert across.any()
    letter = [[0, 0], [1, 0], [1, 1], [3, 1], [3, 2], [0, 2]]
    middles = build_body(
        load_scene("uniaxial", {"spacing": 0.1, "body": {"shape": "polygon", "vertices": letter}})
    ).bonds.cut
    assert len(middles)
    assert len(build_body(scene_of()).bonds.cut) == 0
    voids = load_scene("voids", spacing=0.05)
    body = build_body(voids)
    assert all(
        any(cut.crosses(start[None], end[None])[0] for cut in voids.precuts)
        for start, end in body.all_points[body.bonds.cut]
    )


def test_homogeneous_tension_belongs_to_homogeneous_problems():
    """``reference = "uniaxial"`` compared a sheet with a hole with one without, and told the
    difference as its error.
    """
    scene = load_scene("uniaxial")
    assert reference_level(scene, 2.0)["nominal_stress"] == pytest.approx(
        homogeneous.uniaxial(scene.material.build(), 2.0).nominal_stress
    )
    for change in (
        {"holes": [SLIT]},
        {"precuts": [{"start": [1, 0], "end": [1, 0.5]}]},
        {"holds": [{"points": [3]}]},
        {"grips.0.holds": "all"},
        {"body": {"shape": "polygon", "vertices": [[0, 0], [3, 0], [3, 1]]}},
    ):
        assert reference_level(load_scene("uniaxial", change), 2.0) == {}


def test_finite_element_references_belong_to_their_problem():
    scene = load_scene("pure-shear")
    level = finite_element_level(scene, 2.5)
    assert level == {
        "nominal_stress": pytest.approx(7.29858392),
        "greatest_lateral_displacement": pytest.approx(0.220180405),
    }
    stiffer = load_scene(
        "pure-shear", {"material.shear_modulus": 6.12, "material.bulk_modulus": 612.0}
    )
    assert finite_element_level(stiffer, 2.5)["nominal_stress"] == pytest.approx(2 * 7.29858392)
    for change in (
        {"body.size": [5.0, 1.2]},
        {"material.bulk_modulus": 900.0},
        {"holes": [{"shape": "circle", "radius": 0.1}]},
    ):
        assert finite_element_level(load_scene("pure-shear", change), 2.5) == {}
    assert finite_element_level(scene, 2.4) == {}


@pytest.mark.parametrize(
    ("scene", "spacing", "memory", "told"),
    [
        (
            "uniaxial",
            1e-9,
            1e12,
            (
                "makes 3e+18 points; they need at least 4.53e+12 GB of memory, and 1e+03 GB are"
                " available; use a spacing above 0.00039"
            ),
        ),
        (
            "uniaxial",
            3e-4,
            1e10,
            (
                "makes 3.33e+07 points; they need at least 50.3 GB of memory, and 10 GB are"
                " available; use a spacing above 0.00067"
            ),
        ),
        (
            "uniaxial",
            3e-4,
            math.inf,
            "makes 3.33e+07 points; the limit is 2e+07; use a spacing above 0.00039",
        ),
        ("inflation", 1e-3, 1e12, " points; the limit is 2e+07; use a spacing above "),
    ],
)
def test_bodies_that_memory_does_not_hold_are_refused_before_they_are_made(
    scene, spacing, memory, told
):
    with saying(told, SceneError) as caught:
        check_size(pds.load_scene(scene, spacing=spacing), memory)
    least = float(str(caught.value).rsplit(" ", 1)[1])
    check_size(pds.load_scene(scene, spacing=1.1 * least), memory)


def test_a_machine_has_memory_for_every_scene_that_comes_with_the_package():
    for name in pds.scene_names():
        check_size(pds.load_scene(name), memory_here())
