"""Bodies in space: shapes, holes, cuts, meshes and regions, and what is said about those that make no sense."""

import numpy as np
import pytest

from pdsurrogate.discretisation import discretise, grip_areas
from pdsurrogate.scenes import Scene, SceneError

BOX = {"shape": "box", "size": [1.0, 0.8, 0.6], "lower": [-0.2, 0.1, 0.0]}
GRIPS = ({"edge": "back", "travel": 0.5}, {"edge": "front", "travel": 0.5})


def scene_of(body=None, spacing=0.1, **changes):
    """Gripped along x3 unless it is loaded otherwise."""
    loading = {} if {"loads", "prescribed"} & changes.keys() else {"grips": GRIPS, "stretches": 1.5}
    return Scene(**{"name": "solid", "body": body or BOX, "spacing": spacing, "material": "neo-hookean", **loading, **changes})


def test_a_box_is_filled_with_cells_and_continued_beyond_its_grips():
    """Of 10 by 8 by 6 cubes, each with its 26 neighbours, images among them: those beyond x3 move with the grips in all components."""
    scene = scene_of()
    assert (scene.dimension, scene.plane, scene.horizon_ratio) == (3, "space", 1.75)
    body, lower, upper = discretise(scene)
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


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"plane": "stress"}, "plane: a box lies in space and takes plane=space, which is also the default, not stress"),
        ({"body": {"shape": "circle", "radius": 1.0}, "plane": "space"}, "plane: a circle lies in the plane and takes plane=stress or"),
        ({"holes": [{"shape": "circle", "radius": 0.1}]}, "holes.0: a circle belongs to the plane, and the body, a box, to space"),
        ({"precuts": [{"start": [0, 0], "end": [1, 0]}]}, "precuts.0: this cut belongs to the plane, and the body, a box, to space"),
        ({"body": {"shape": "cube", "size": [1, 1, 1]}}, "body: unknown shape 'cube'; did you mean tube?"),
        ({"body": {"shape": "box", "size": [1, 1]}}, "body.size.2: Field required"),
        ({"body": {"shape": "box", "size": [1, 1, -1]}}, "body.size.2: Input should be greater than 0"),
        ({"body": {"shape": "cylinder", "radius": 1, "length": 1, "axis": "z"}}, "body.axis: Input should be 'x1', 'x2' or 'x3'"),
        (
            {"body": {"shape": "tube", "inner_radius": 2, "outer_radius": 1, "length": 1}},
            "body: inner_radius must be less than outer_radius, 1, not 2",
        ),
        ({"body": {"shape": "extrusion", "thickness": 1.0, "outline": {"shape": "sphere"}}}, "body.outline: unknown shape 'sphere'"),
        ({"precuts": [{"corner": [0, 0, 0], "sides": [[1, 0, 0], [2, 0, 0]]}]}, "precuts.0: sides: they span no area"),
        ({"precuts": [{"centre": [0, 0, 0], "radius": 1, "normal": [0, 0, 0]}]}, "precuts.0: normal: it must not be zero"),
        ({"precuts": [{"centre": [0, 0, 0], "radius": 1}]}, "precuts.0.normal: Field required"),
        ({"regions": {"x": {"disc": {"centre": [0, 0], "radius": 1}}}}, "regions.x: disc is a region of the plane; in space give ball"),
        ({"regions": {"x": {"half_plane": {"point": [0, 0], "normal": [1, 0]}}}}, "regions.x: half_plane is a region of the plane; in"),
        ({"regions": {"x": {"box": [[0, 0], [1, 1]]}}}, "regions.x.box.0: needs 3 components for a body in space, not 2"),
        ({"regions": {"x": {"near": [0, 0, 0, 0]}}}, "regions.x.near: needs at most 3 entries, not 4"),
        ({"regions": {"front": {"near": [0, 0, 0]}}}, "regions: front is the name of a region that every body has; take another"),
        ({"probes": [{"name": "a", "at": [0, 0]}]}, "probes.0.at: needs 3 components for a body in space, not 2"),
        ({"grips": [{"edge": "left", "travel": 1.0}, {"edge": "front"}]}, "grips must hold two opposite edges, left and right or bottom"),
        ({"loads": [{"region": "holes.0", "pressure": 1.0}], "steps": 1}, "loads.0.region: there is no region 'holes.0': the body has no"),
        ({"body": {"shape": "rectangle", "size": [1, 1]}}, "grips.0.edge: a body in the plane has no back; it has left, right, bottom"),
        (
            {
                "body": {"shape": "rectangle", "size": [1, 1]},
                "loads": [{"region": {"and": ["left", {"edge": "front"}]}, "pressure": 1.0}],
                "steps": 1,
            },
            "loads.0.region.and.1: a body in the plane has no front; its edges are left, right, bottom, top",
        ),
    ],
)
def test_what_makes_no_sense_is_told_in_one_line(changes, message):
    with pytest.raises(SceneError) as told:
        scene_of(**changes)
    assert str(told.value).startswith(message)
    assert "\n" not in str(told.value)
