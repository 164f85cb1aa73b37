"""Bodies of scenes: shapes, holes, precuts and meshes, and what is said about those that make no sense."""

import meshio
import numpy as np
import pytest
from scipy.spatial import cKDTree

import pdsurrogate as pd
from pdsurrogate.discretisation import build_body, discretise, grip_areas
from pdsurrogate.scenes import Circle, Ellipse, Polygon, Precut, Rectangle, SceneError, load_scene
from pdsurrogate.scenes.references import finite_element_level


def scene_of(**changes):
    return load_scene("hole", {"spacing": 0.1, "reference": "uniaxial", **changes})


@pytest.mark.parametrize(
    ("shape", "area"),
    [
        (Rectangle(size=(2.0, 1.0), lower=(-1.0, -0.5)), 2.0),
        (Circle(radius=0.7, centre=(0.1, 0.2)), np.pi * 0.49),
        (Ellipse(semi_axes=(0.9, 0.4)), np.pi * 0.36),
        (Polygon(vertices=((-1, -1), (1, -1), (0, 1))), 2.0),
        (Polygon(vertices=((0, 0), (0, 1), (1, 1), (1, 0.5), (0.5, 0.5), (0.5, 0))), 0.75),  # an L, which is not convex
    ],
)
def test_shapes_contain_their_area(shape, area):
    """Monte Carlo with 10^5 points: the relative standard error is below 1 %."""
    low, high = shape.bounds()
    points = np.random.default_rng(0).uniform(low - 0.1, high + 0.1, (100_000, 2))
    inside = shape.contains(points)
    assert inside.mean() * np.prod(high - low + 0.2) == pytest.approx(area, rel=0.03)
    assert ((points[inside] >= low) & (points[inside] <= high)).all()


CURVED = {
    "plate with a hole": ({"holes": [{"shape": "circle", "radius": 0.4}]}, 12 - np.pi * 0.16, (0, 0)),
    "off the grid": ({"holes": [{"shape": "circle", "radius": 0.33, "centre": [0.217, -0.131]}]}, 12 - np.pi * 0.1089, None),
    "disc": ({"body": {"shape": "circle", "radius": 1.03, "centre": [0.2, 0.1]}, "holes": []}, np.pi * 1.0609, (0.2, 0.1)),
    "triangle": (
        {"body": {"shape": "polygon", "vertices": [[0, 0], [2, 0.3], [0.7, 1.7]]}, "holes": []},
        (2 * 1.7 - 0.7 * 0.3) / 2,
        (0.9, 2 / 3),
    ),
}


@pytest.mark.parametrize("case", CURVED)
def test_curved_outlines_enclose_their_area(case):
    """Area and centroid of what is there, whatever the outline cuts: to the raster, some 1/1000 of a cell for each of the cells cut."""
    changes, area, centroid = CURVED[case]
    scene = scene_of(**changes)
    body = build_body(scene)
    assert body.volumes.sum() == pytest.approx(area, abs=0.1 * scene.spacing**2)
    if centroid is not None:
        moment = (body.volumes[:, None] * (body.points - centroid)).sum(axis=0)
        np.testing.assert_allclose(moment, 0, atol=0.1 * scene.spacing**2)
    cell = scene.spacing**2
    assert 0.5 * cell <= body.volumes.min()
    assert body.volumes.max() < 2 * cell
    assert cKDTree(body.points).query(body.points, 2)[0][:, 1].min() > 0.5 * scene.spacing


def test_straight_outlines_on_cell_boundaries_change_no_cell():
    body = build_body(scene_of(holes=[{"shape": "rectangle", "size": [0.6, 0.8], "lower": [-0.3, -0.4]}]))
    assert len(body) == 30 * 40 - 6 * 8
    np.testing.assert_allclose(body.volumes, 0.01, rtol=1e-12)
    whole = build_body(scene_of(holes=[])).points
    assert cKDTree(whole).query(body.points)[0].max() < 1e-12


def test_precuts_separate_what_they_cross_and_nothing_else():
    cut = Precut(start=(0.0, 0.0), end=(1.0, 0.0))
    starts = np.array([[0.5, -1], [0.5, -1], [1.5, -1], [-0.5, 1], [0.5, 1]], float)
    ends = np.array([[0.5, 1], [0.6, -0.1], [1.5, 1], [-0.5, -1], [0.5, -1]], float)
    assert cut.crosses(starts, ends).tolist() == [True, False, False, False, True]


@pytest.mark.parametrize("spacing", [0.1, 0.05])
def test_a_precut_through_a_row_of_points_cuts_on_one_side_of_it(spacing):
    """Points on the line belong to its left, above a cut that runs to the right: the row is bound to what is above it alone."""
    body = build_body(
        load_scene("tear", {"spacing": spacing, "body.size": [2.0, 1.0], "precuts": [{"start": [-1, 0.45], "end": [3, 0.45]}]})
    )
    bonds, points = body.bonds, body.all_points
    above = points[:, 1] > 0.45 - 1e-9
    assert (above[bonds.first] == above[bonds.second]).all()
    assert (above[bonds.cut[:, 0]] != above[bonds.cut[:, 1]]).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"holes": [{"shape": "circle", "radius": 3.0}]}, "its holes take all of it"),
        ({"holes": [{"shape": "rectangle", "size": [1.5, 4], "lower": [-1.5, -2]}, {"shape": "circle", "radius": 5}]}, "holes take all"),
        ({"holes": [{"shape": "circle", "radius": 0.4, "centre": [9, 9]}]}, "holes.0: no point of the body lies in it"),
        ({"holes": [{"shape": "circle", "radius": -1}]}, "holes.0.radius: Input should be greater than 0"),
        ({"holes": [{"shape": "star"}]}, "unknown shape 'star'"),
        ({"holes": [{"shape": "circle", "radius": 0.4, "colour": "red"}]}, "holes.0.colour: unknown key"),
        ({"holes": [{"shape": "polygon", "vertices": [[0, 0], [1, 1], [2, 2]]}]}, "the polygon has no area"),
        ({"holes": 3}, "holes: "),
        ({"precuts": [{"start": [7, 7], "end": [8, 8]}]}, "precuts.0: it cuts no bond; it lies outside the body"),
        ({"precuts": [{"start": [0, 1], "end": [0, 1]}]}, "precuts.0: a precut needs two different ends"),
        ({"precuts": [{"start": [0, 1]}]}, "precuts.0.end: Field required"),
        ({"body": {"shape": "mesh", "file": "missing.vtu"}}, "there is no file missing.vtu"),
        ({"fracture": {"critical_stretch": 0.9}}, "fracture.critical_stretch: Input should be greater than 1"),
        ({"fracture": {}}, "fracture: fracture needs either a critical_stretch or an energy"),
        ({"fracture": {"critical_stretch": 2.0}}, "fracture needs dynamics"),
        ({"dynamics": {"stretch": 1.1, "stretch_rate": 1, "density": 1}}, "dynamics.stretch must be greater than the last of stretches"),
        ({"dynamics": {"stretch": 2, "stretch_rate": -1, "density": 1}}, "dynamics.stretch_rate: Input should be greater than 0"),
        ({"stretches": []}, "the programme is empty"),
    ],
)
def test_bodies_and_programmes_that_make_no_sense(changes, message):
    with pytest.raises(SceneError) as caught:
        build_body(scene_of(**changes))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def write_mesh(path, size=0.1):
    """A 1 x 1 square: quadrilaterals below, triangles above."""
    count = round(1 / size)
    x = np.linspace(0, 1, count + 1)
    points = np.array([[x1, x2, 0] for x2 in x for x1 in x])
    corner = np.array([[i + j * (count + 1) for i in range(count)] for j in range(count)])
    quads = np.stack([corner, corner + 1, corner + count + 2, corner + count + 1], axis=2).reshape(-1, 4)
    lower, upper = quads[: len(quads) // 2], quads[len(quads) // 2 :]
    meshio.write(path, meshio.Mesh(points, [("quad", lower), ("triangle", np.vstack([upper[:, [0, 1, 2]], upper[:, [0, 2, 3]]]))]))


def test_mesh_bodies(tmp_path):
    """Centroids and areas become points and volumes.

    Where cells change shape a horizon is not symmetric, and a force map leaves the homogeneous state by a discretisation error:
    0.5 % allows for it with ten cells to a side.
    """
    write_mesh(tmp_path / "square.vtu")
    (tmp_path / "mine.toml").write_text(
        """
        name = "mine"
        spacing = 0.1
        stretches = [1.5]
        reference = "uniaxial"
        body = { shape = "mesh", file = "square.vtu" }
        material = "neo-hookean"
        grips = [{ edge = "left", holds = "normal" }, { edge = "right", holds = "normal", travel = 1.0 }]
        """
    )
    scene = load_scene(tmp_path / "mine.toml")
    body = build_body(scene)
    assert len(body) == 50 + 100
    assert body.volumes.sum() == pytest.approx(1.0)
    np.testing.assert_allclose((body.points * body.volumes[:, None]).sum(axis=0), 0.5)
    level = pd.simulate(scene, "analytic").levels[0]
    assert level["nominal_stress_work_conjugate"] == pytest.approx(level["nominal_stress_reference"], rel=5e-3)
    assert "lateral_displacement" not in level


def test_cross_sections_at_grips(tmp_path):
    """The straight edge of a rectangle, less a hole; half a spacing inside a round one; of a mesh, from its cells."""
    write_mesh(tmp_path / "square.vtu")
    half_chord = np.sqrt(1 - 0.95**2)
    for body, holes, expected in (
        ({"shape": "rectangle", "size": [3.0, 1.1]}, [], 1.1),
        (
            {"shape": "rectangle", "size": [3.0, 1.0]},
            [{"shape": "circle", "radius": 0.25, "centre": [0.05, 0.5]}],
            {"left": 0.5, "right": 1.0},
        ),
        ({"shape": "circle", "radius": 1.0}, [], 2 * half_chord),
        ({"shape": "polygon", "vertices": [[0, 0], [2, 0], [2, 1], [0, 0.4]]}, [], {"left": 0.4 + 0.05 * 0.3, "right": 1 - 0.05 * 0.3}),
        ({"shape": "mesh", "file": str(tmp_path / "square.vtu")}, [], 1.0),
        (
            {"shape": "mesh", "file": str(tmp_path / "square.vtu")},
            [{"shape": "rectangle", "size": [0.3, 0.4], "lower": [0.0, 0.0]}],
            {"left": 0.6, "right": 1.0},
        ),
    ):
        scene = load_scene("uniaxial", {"spacing": 0.1, "body": body, "holes": holes})
        _, lower, upper = discretise(scene)
        expected = expected if isinstance(expected, dict) else {"left": expected, "right": expected}
        assert grip_areas(scene, lower, upper) == pytest.approx(expected, rel=1e-9)


def test_grips_that_hold_nothing_are_refused():
    scene = load_scene("uniaxial", {"spacing": 0.1, "holes": [{"shape": "rectangle", "size": [0.2, 2.0], "lower": [2.8, -0.5]}]})
    with pytest.raises(SceneError, match="grips: there is no material at the right edge"):
        pd.simulate(scene, "analytic")


@pytest.mark.parametrize("content", ["", "not a mesh"])
def test_meshes_that_cannot_be_read(tmp_path, content):
    (tmp_path / "bad.vtu").write_text(content)
    with pytest.raises(SceneError, match=r"meshio cannot read"):
        build_body(scene_of(body={"shape": "mesh", "file": str(tmp_path / "bad.vtu")}, holes=[]))


def test_finite_element_references_belong_to_their_problem():
    scene = load_scene("pure-shear")
    level = finite_element_level(scene, 2.5)
    assert level == {"nominal_stress": pytest.approx(7.29858392), "greatest_lateral_displacement": pytest.approx(0.220180405)}
    stiffer = load_scene("pure-shear", {"material.shear_modulus": 6.12, "material.bulk_modulus": 612.0})
    assert finite_element_level(stiffer, 2.5)["nominal_stress"] == pytest.approx(2 * 7.29858392)
    for change in ({"body.size": [5.0, 1.2]}, {"material.bulk_modulus": 900.0}, {"holes": [{"shape": "circle", "radius": 0.1}]}):
        assert finite_element_level(load_scene("pure-shear", change), 2.5) == {}
    assert finite_element_level(scene, 2.4) == {}


def test_scenes_composed_in_python():
    """The same objects that a file describes."""
    scene = pd.Scene(
        name="notched",
        spacing=0.1,
        stretches=(1.2,),
        body=Rectangle(size=(2.0, 1.0)),
        holes=(Circle(radius=0.15, centre=(1.5, 0.5)),),
        precuts=(Precut(start=(0.0, 0.5), end=(0.5, 0.5)),),
        material="neo-hookean",
        grips=({"edge": "bottom"}, {"edge": "top", "travel": 1.0}),
    )
    result = pd.simulate(scene)
    assert result.summary["converged"]
    assert result.summary["force"] == "neo-hookean@1"
