"""Relaxed points: the same everywhere, of the right volumes, without rows, and a body on which
everything works.
"""

import hashlib

import numpy as np
import pytest
from described import SCENES
from refusals import raising
from scipy.spatial import cKDTree

import pdsurrogate as pds
from pdsurrogate.discretization import clouds, discretize
from pdsurrogate.discretization.material import material_at
from pdsurrogate.engine.threads import most_threads, thread_count
from pdsurrogate.results import vtk
from pdsurrogate.results.states import deformed_cells
from pdsurrogate.scenes import SceneError, load_scene

RELAXED = {"body.arrangement": "relaxed"}
BODIES = SCENES["clouds"]
AREAS = {"hole": 2.6 - np.pi * 0.09, "bent": 1.4 + 0.81}


def scene_of(name, **keys):
    bodies = BODIES[name] if isinstance(name, str) else name
    across = {"prescribed": [{"region": "body", "x1": 0.0}], "steps": 1.0}
    return pds.Scene(
        **({"name": "cloud", "spacing": 0.1, "material": "neo-hookean"} | across | bodies | keys)
    )


def square(spacing=0.05, seed=0, arrangement="relaxed", **keys):
    return scene_of(
        {"body": {"size": [1.0, 1.0], "arrangement": arrangement, "seed": seed}},
        spacing=spacing,
        **keys,
    )


@pytest.mark.parametrize("name", BODIES)
def test_points_lie_in_the_body_and_have_its_volume(name):
    scene = scene_of(name)
    body, lower, upper = discretize(scene)
    assert material_at(scene, body.points).all()
    rng = np.random.default_rng(3)
    places = lower + (upper - lower) * rng.random((400_000, len(lower)))
    there = places[material_at(scene, places)]
    volume = np.prod(upper - lower) * len(there) / len(places)
    assert body.volumes.sum() == pytest.approx(
        AREAS.get(name, volume), rel=1e-12 if name in AREAS else 0.005
    )
    assert len(body) == round(body.volumes.sum() / 0.1**scene.dimension)
    assert body.horizon == pytest.approx(scene.horizon_ratio * 0.1, rel=2e-3)
    # Each place belongs to the point nearest to it, by other places and another search.
    nearest = (
        np.bincount(cKDTree(body.points).query(there)[1], minlength=len(body)) * volume / len(there)
    )
    np.testing.assert_allclose(
        nearest, body.volumes, rtol=0, atol=6 * np.sqrt(volume * body.volumes.max() / len(there))
    )


def test_cells_need_not_divide_the_body():
    body, _, _ = discretize(scene_of({"body": {"size": [0.72, 0.33], "arrangement": "relaxed"}}))
    assert len(body) == 24
    assert body.volumes.sum() == pytest.approx(0.72 * 0.33, rel=1e-14)


def test_a_cloud_has_no_rows_and_no_near_points():
    def fourfold(points):
        pairs = cKDTree(points).query_pairs(1.3 * 0.02, output_type="ndarray")
        across = points[pairs[:, 1]] - points[pairs[:, 0]]
        return abs(np.exp(4j * np.arctan2(*across.T)).mean())

    body, lattice = (
        discretize(square(0.02, arrangement=each))[0] for each in ("relaxed", "lattice")
    )
    assert fourfold(body.points) < 0.05 < 0.99 < fourfold(lattice.points)
    assert cKDTree(body.points).query(body.points, 2)[0][:, 1].min() > 0.5 * 0.02
    assert body.volumes.std() < 0.12 * body.volumes.mean()
    # Half a spacing from each side, as reflection wants.
    beside = body.points[body.points[:, 0] < 0.02, 0]
    assert beside.mean() == pytest.approx(0.01, rel=0.1)


def test_points_are_the_same_on_every_machine_and_on_any_number_of_threads():
    """The digest was computed once; coordinates are integers in units of a cell."""
    cells_of_body = np.array([20, 20])
    found = []
    for threads in {1, most_threads()}:
        with thread_count(threads):
            found.append(discretize(square())[0].points)
    np.testing.assert_array_equal(found[0], found[-1])
    whole = np.rint(found[0] * cells_of_body * clouds.UNITS).astype("<i8")
    assert hashlib.sha256(whole.tobytes()).hexdigest()[:16] == "41e90b8bb8770a09"
    assert np.abs(discretize(square(seed=1))[0].points - found[0]).max() > 0.005


def test_a_cloud_is_kept_and_made_again_where_its_file_is_damaged(tmp_path, monkeypatch):
    monkeypatch.setattr(clouds, "LEAST_KEPT", 100)
    monkeypatch.setattr(clouds, "cache_folder", lambda function: tmp_path)
    made = discretize(square())[0]
    (path,) = tmp_path.iterdir()
    for damaged in (False, True):
        if damaged:
            data = bytearray(path.read_bytes())
            data[len(data) // 2] ^= 1
            path.write_bytes(data)
        else:
            monkeypatch.setattr(clouds.Samples, "start", lambda *_: pytest.fail("made again"))
        body = discretize(square())[0]
        np.testing.assert_array_equal(body.points, made.points)
        np.testing.assert_array_equal(body.volumes, made.volumes)
        monkeypatch.undo()
        monkeypatch.setattr(clouds, "LEAST_KEPT", 100)
        monkeypatch.setattr(clouds, "cache_folder", lambda function: tmp_path)
    discretize(square(seed=1))
    assert len(list(tmp_path.iterdir())) == 2


def test_volumes_follow_a_disc_of_another_material():
    stiff = [
        {
            "region": {"disc": {"center": [0.5, 0.5], "radius": 0.25}},
            "material": {"law": "neo-hookean", "shear_modulus": 9.0},
        }
    ]
    body, _, _ = discretize(square(materials=stiff))
    within = np.hypot(*(body.points - 0.5).T) < 0.25
    assert body.volumes[within].sum() == pytest.approx(np.pi / 16, rel=2e-3)
    assert body.volumes.sum() == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize(
    ("scene", "changes", "words"),
    [
        ("hole", {"body.seed": 3}, "body.seed: a lattice has no seed"),
        ("hole", {**RELAXED, "body.seed": -1}, "body.seed"),
        ("hole", {"holes.0.arrangement": "relaxed"}, "holes.0: only the body has an arrangement"),
        ("hole", {"body.arrangement": "random"}, "body.arrangement"),
        (
            "tear",
            {**RELAXED, "fracture": {"energy": 1.0}, "horizon_ratio": 6.0},
            r"fracture\.energy is available only in cases",
        ),
    ],
)
def test_what_a_cloud_cannot_do_is_refused(scene, changes, words):
    with raising(words, SceneError):
        load_scene(scene, changes)


def test_shapes_within_an_extrusion_have_no_arrangement():
    outline = {"shape": "rectangle", "size": [1.0, 1.0], "arrangement": "relaxed"}
    with raising(r"body\.outline: only the body has an arrangement", SceneError):
        scene_of({"body": {"shape": "extrusion", "outline": outline, "thickness": 0.5}})


# Results.


def stress_of(scene, force, changes):
    level = pds.simulate(load_scene(scene, changes), force, threads=1).levels[-1]
    return level["nominal_stress"], level["greatest_lateral_displacement"], level["evaluations"]


@pytest.mark.parametrize("scene", ["uniaxial", "hole", "pure-shear"])
def test_stress_and_contraction_are_those_of_the_lattice(scene):
    """Within 0.3 %; the greatest contraction, at one place of an uneven edge, within 4 %."""
    changes = {"spacing": 0.1, "stretches": 1.4}
    lattice, cloud = (stress_of(scene, "bond-energy", changes | more) for more in ({}, RELAXED))
    assert cloud[0] == pytest.approx(lattice[0], rel=3e-3)
    assert cloud[1] == pytest.approx(lattice[1], rel=0.04)


# Cells of pictures and files.


def area_of(cells):
    x, y = np.moveaxis(cells.nodes[cells.blocks[0]], -1, 0)
    return (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1) / 2


@pytest.mark.parametrize("name", ["hole", "bent"])
def test_cells_of_a_sheet_fill_it_and_meet(name):
    body, _, _ = discretize(scene_of(name))
    areas = area_of(body.cells)
    assert areas.sum() == pytest.approx(AREAS[name], rel=1e-3)
    np.testing.assert_allclose(areas, body.volumes, rtol=0.06)
    corners, owners = body.cells.faces
    lengths = np.linalg.norm(np.diff(body.cells.nodes[corners], axis=1), axis=2)[:, 0]
    assert lengths[owners[:, 1] < 0].sum() == pytest.approx(
        {"hole": 6.6 + 0.6 * np.pi, "bent": 7.2}[name], rel=0.01
    )


def test_a_precut_opens_between_cells_and_states_are_read_back(tmp_path):
    cut = {"precuts": [{"start": [0.0, 0.5], "end": [0.6, 0.5]}]}
    apart = [{"region": "bottom", "x1": 0.0, "x2": 0.0}, {"region": "top", "x1": 0.0, "x2": 0.3}]
    result = pds.simulate(square(0.1, **cut, prescribed=apart), "bond-energy", threads=1)
    fields = result.states[-1][1]
    cells, nodes = deformed_cells(result.body, fields)
    opened, whole = (len(mesh.outer_sides[0]) for mesh in (cells, result.body.cells))
    assert opened > whole + 6
    assert (
        len(
            deformed_cells(result.body, fields | {"displacement": 0 * fields["displacement"]})[
                0
            ].outer_sides[0]
        )
        >= whole
    )
    vtk.write_state(tmp_path / "x.vtu", cells, nodes, vtk.pack([fields]), {})
    again, moved = vtk.read_cells(tmp_path / "x.vtu")
    kept = vtk.StoredFields(tmp_path / "x.vtu")
    np.testing.assert_array_equal(again.blocks[0], cells.blocks[0])
    np.testing.assert_allclose(moved, nodes, atol=1e-6)
    assert kept["displacement"].shape == (len(result.body), 3)
    result.plot("stress_22")


def test_a_solid_has_a_cube_around_each_point(tmp_path):
    body, _, _ = discretize(scene_of("tube", spacing=0.25))
    corners = body.cells.nodes[body.cells.blocks[0]]
    np.testing.assert_allclose(np.ptp(corners, axis=1).prod(axis=1), body.volumes)
    np.testing.assert_allclose(corners.mean(axis=1), body.points)
