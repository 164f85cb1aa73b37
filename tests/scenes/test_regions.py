"""Regions: what of a body they are, how they are combined, and what is said about those that
make no sense.
"""

import numpy as np
import pytest
from described import SCENES
from meshes import write_plate
from refusals import raising, refused, saying

import pdsurrogate as pds
from pdsurrogate.discretization import discretize, surface_of
from pdsurrogate.problem.regions import BodyRegions
from pdsurrogate.scenes import Region, SceneError, load_scene
from pdsurrogate.scenes.regions import label_of_region

PLATE = SCENES["plate with holes"]


def scene_of(**changes):
    return pds.Scene(**{**PLATE, **changes})


def regions_of(scene):
    body, lower, upper = discretize(scene)
    return body, BodyRegions(
        scene, body, lower, upper, lambda: surface_of(scene, body, lower, upper)
    )


@pytest.fixture(scope="module")
def plate():
    """Regions of a plate with two holes, some of them named."""
    names = {
        "grip": {"edge": "right"},
        "again": {"and": ["grip"]},
        "lower-half": {"half_plane": {"point": [0, 0.5], "normal": [0, -1]}},
        "quarter": {"and": ["lower-half", {"box": [[0, 0], [1, 1]]}]},
    }
    return regions_of(scene_of(regions=names))


def x1_below(limit):
    return lambda x: x[:, 0] < limit


POINTS = {
    "an edge": ("left", x1_below(0.1)),
    "a box": (
        {"box": [[0.1, 0.2], [0.5, 0.4]]},
        lambda x: (x >= [0.1, 0.2]).all(axis=1) & (x <= [0.5, 0.4]).all(axis=1),
    ),
    "a disc": (
        {"disc": {"center": [1, 0.5], "radius": 0.3}},
        lambda x: np.linalg.norm(x - [1, 0.5], axis=1) <= 0.3 + 1e-9,
    ),
    "a half-plane": (
        {"half_plane": {"point": [1, 0.5], "normal": [3, 4]}},
        lambda x: (x - [1, 0.5]) @ [3, 4] >= -1e-9,
    ),
    "all of several": ({"and": ["left", "bottom"]}, lambda x: (x < 0.1).all(axis=1)),
    "what is not in one": ({"not": "lower-half"}, lambda x: x[:, 1] > 0.5),
    "a name": ("quarter", lambda x: (x[:, 1] < 0.5) & (x[:, 0] < 1)),
    "combinations of combinations": (
        {
            "and": [
                {"not": {"or": ["left", "right"]}},
                {"or": ["quarter", {"and": ["again", "top"]}]},
            ]
        },
        lambda x: (x[:, 1] < 0.5) & (x[:, 0] < 1) & (x[:, 0] > 0.1),
    ),
}


@pytest.mark.parametrize("case", POINTS)
def test_points_of_regions(plate, case):
    said, expected = POINTS[case]
    body, regions = plate
    reference = said if isinstance(said, str) else Region(**said)
    np.testing.assert_array_equal(regions.points(reference), np.flatnonzero(expected(body.points)))


def test_points_by_their_numbers_and_nearest_to_a_place(plate):
    body, regions = plate
    np.testing.assert_array_equal(regions.points(Region(points=(7, 3, 3))), [3, 7])
    place = np.array([1.23, 0.61])
    np.testing.assert_array_equal(
        regions.points(Region(near=tuple(place))),
        [np.linalg.norm(body.points - place, axis=1).argmin()],
    )


def test_places_on_the_boundary_of_a_region_belong_to_it():
    """To 1e-9 of the extent: the centers of cells are not where their decimal numbers are, 0.15
    + 0.1 + 0.1 is above 0.35.
    """
    body, regions = regions_of(scene_of(holes=()))
    inside = regions.points(Region(box=((0.15, 0.25), (0.35, 0.35))))
    np.testing.assert_allclose(
        body.points[inside],
        [[0.15, 0.25], [0.25, 0.25], [0.35, 0.25], [0.15, 0.35], [0.25, 0.35], [0.35, 0.35]],
    )
    assert len(regions.points(Region(disc={"center": (0.55, 0.55), "radius": 0.3}))) == 29
    assert (
        len(regions.points(Region(half_plane={"point": (0.35, 0.0), "normal": (-1e-9, 0)}))) == 40
    )


@pytest.mark.parametrize("spacing", [0.1, 0.05])
def test_points_beside_the_boundary_are_the_outermost(plate, spacing):
    """Those within 0.99 cells of the facets: half a cell inside a straight side, up to 0.75
    where a part of a cell was added.
    """
    _, regions = plate if spacing == 0.1 else regions_of(scene_of(spacing=spacing))
    body = regions_of(scene_of(spacing=spacing))[0]
    x = body.points
    outline = np.flatnonzero((np.minimum(x, [2, 1] - x) < spacing).any(axis=1))
    np.testing.assert_array_equal(regions.points("outline"), outline)
    square = np.abs(x - [1.5, 0.5]).max(axis=1)
    corner = (np.abs(x - [1.5, 0.5]) > 0.1).all(axis=1)  # diagonally 0.71 cells away
    beside = (square < 0.1 + spacing) & (square > 0.1)
    np.testing.assert_array_equal(regions.points("holes.1"), np.flatnonzero(beside))
    assert corner[regions.points("holes.1")].sum() == 4
    distance = np.linalg.norm(x - [0.5, 0.5], axis=1) - 0.2
    around = regions.points("holes.0")
    assert (distance[around] < spacing).all()
    assert set(np.flatnonzero(distance < 0.95 * spacing)) <= set(around)
    np.testing.assert_array_equal(
        regions.points("holes"), np.union1d(around, regions.points("holes.1"))
    )


FACETS = {
    "an edge": ("right", lambda x: np.isclose(x[:, 0], 2)),
    "the outline": (
        "outline",
        lambda x: np.isclose(x, 0).any(axis=1) | np.isclose(x, [2, 1]).any(axis=1),
    ),
    "the body": ("body", lambda x: x[:, 0] > -1),
    "part of an edge": (
        {"and": ["top", {"box": [[0.5, 0], [1, 1]]}]},
        lambda x: np.isclose(x[:, 1], 1) & (np.abs(x[:, 0] - 0.75) < 0.25),
    ),
    "a disc about a hole": (
        {"disc": {"center": [0.5, 0.5], "radius": 0.3}},
        lambda x: np.linalg.norm(x - [0.5, 0.5], axis=1) < 0.3,
    ),
    "all but an edge": (
        {"and": ["outline", {"not": "grip"}]},
        lambda x: np.isclose(x, 0).any(axis=1) | np.isclose(x[:, 1], 1),
    ),
    "a half-plane": ("lower-half", lambda x: x[:, 1] <= 0.5),
}


@pytest.mark.parametrize("case", FACETS)
def test_facets_of_regions(plate, case):
    said, expected = FACETS[case]
    _, regions = plate
    reference = said if isinstance(said, str) else Region(**said)
    np.testing.assert_array_equal(
        regions.facets(reference), np.flatnonzero(expected(regions.surface().midpoints()))
    )


def test_names_and_edges(plate):
    _, regions = plate
    assert [
        regions.edge(said) for said in ("left", "grip", "again", "quarter", "body", "holes.0")
    ] == ["left", "right", "right"] + 3 * [None]
    assert regions.edge(Region(edge="top")) == "top"
    assert regions.edge(Region(**{"or": ["bottom"]})) == "bottom"
    assert regions.edge(Region(**{"not": "bottom"})) is None
    assert regions.edge(Region(**{"and": ["bottom", "left"]})) is None
    assert label_of_region("quarter", "loads.0") == "quarter"
    assert label_of_region(Region(edge="top"), "loads.0") == "top"
    assert label_of_region(Region(box=((0, 0), (1, 1))), "loads.0") == "loads.0"


def said_of(kind, said, **changes):
    """What is said of a region of points or facets that the scene prescribes or loads."""
    load = {"region": said, "traction": [1.0, 0.0]}
    where = (
        {"prescribed": [{"region": said, "x1": 0.0}]}
        if kind == "points"
        else {"prescribed": (), "loads": [load]}
    )
    scene = scene_of(**where, **changes)
    key, entry = (
        ("prescribed", scene.prescribed[0]) if kind == "points" else ("loads", scene.loads[0])
    )
    with raising(r"\S") as caught:
        getattr(regions_of(scene)[1], kind)(entry.region, f"{key}.0.region")
    return str(caught.value)


@refused("empty regions")
def test_empty_regions_say_what_is_nearby(kind, said, message):
    assert message in said_of(kind, said, regions={"corner": {"box": [[0, 0], [0.01, 0.04]]}})


def test_edges_that_are_not_there():
    """A disc has points within a cell of its left end, and no straight side there; a slot takes
    all of an edge.
    """
    disc = {"body": {"shape": "circle", "radius": 1.0}, "holes": ()}
    message = said_of("facets", "left", **disc)
    assert (
        message
        == "loads.0.region: the region contains no part of the boundary; no straight side of the"
        " body is on its left edge"
    )
    body, regions = regions_of(scene_of(**disc))
    np.testing.assert_array_equal(
        regions.points("left"), np.flatnonzero(body.points[:, 0] < -0.901)
    )
    slot = {"holes": [{"shape": "rectangle", "size": [0.5, 1.2], "lower": [-0.1, -0.1]}]}
    message = said_of("points", {"edge": "left"}, **slot)
    assert (
        message
        == "prescribed.0.region: the region contains no point of the body; the nearest is point 0"
        " at (0.45, 0.05), 0.45 away"
    )
    covered = {
        "holes": [
            {"shape": "circle", "radius": 0.2, "center": [1, 0.5]},
            {"shape": "circle", "radius": 0.1, "center": [1, 0.55]},
        ]
    }
    assert (
        said_of("facets", "holes.1", **covered)
        == "loads.0.region: there is no boundary holes.1; there are holes.0"
    )


def test_where_a_body_is_too_thin_for_loads():
    slot = {"holes": [{"shape": "rectangle", "size": [1.0, 0.2], "lower": [0.5, 0.7]}]}
    message = said_of("facets", "top", **slot)
    assert message.startswith("loads.0.region: the body is too thin at (1.1, 1), where")
    assert message.endswith("fewer than three, or in one row; use a smaller spacing")
    scene = scene_of(**slot)
    assert len(regions_of(scene)[1].facets("bottom")) == 20  # where it is not, loads act


def test_places_of_probes(plate):
    _, regions = plate
    for place in (
        (0.03, 0.02),
        (0.0, 0.0),
        (2.0, 0.5),
        (0.7, 0.5),
        (0.5 + 0.2 / np.sqrt(2), 0.5 + 0.2 / np.sqrt(2)),
        (1.4, 0.4),
    ):
        regions.check_place("probes.0.at", place)
    message = (
        r"^probes.0.at: \(2\.02, 0\.52\) lies outside the body; its nearest point is 10\d at"
        r" \(1\.95, 0\.55\), 0\.0762 away$"
    )
    with raising(message):
        regions.check_place("probes.0.at", (2.02, 0.52))
    with raising(r"^probes.1.at: \(0\.52, 0\.5\) lies outside"):
        regions.check_place("probes.1.at", (0.52, 0.5))


@pytest.fixture
def meshed(tmp_path):
    path = write_plate(tmp_path / "plate.msh")
    scene = scene_of(
        body={"shape": "mesh", "file": str(path)},
        holes=(),
        prescribed=[{"region": {"group": "pul"}, "x1": 0.0}],
    )
    return *regions_of(scene), scene


def test_groups_of_a_mesh(meshed):
    body, regions, scene = meshed
    middles = regions.surface().midpoints()
    np.testing.assert_array_equal(
        regions.points(Region(group="soft")), np.flatnonzero(body.points[:, 0] < 0.6)
    )
    np.testing.assert_array_equal(
        regions.facets(Region(group="pull")), np.flatnonzero(np.isclose(middles[:, 0], 1.2))
    )
    np.testing.assert_array_equal(regions.facets(Region(group="pull")), regions.facets("right"))
    np.testing.assert_array_equal(regions.facets(Region(group="cavity")), regions.facets("holes.0"))
    assert len(regions.points(Region(group="seam"))) == 8
    half = Region(**{"and": [{"group": "cavity"}, {"group": "soft"}]})
    np.testing.assert_allclose(middles[regions.facets(half), 0].max(), 0.55)
    with raising(
        r"^region: the region contains no part of the boundary"
    ):  # the seam is inside the material
        regions.facets(Region(group="seam"))
    with raising(r"^prescribed.0.region: .*'pul'; did you mean pull\?$"):
        regions.points(scene.prescribed[0].region, "prescribed.0.region")
    with raising(r"the mesh has no group 'xyz'; it has soft, stiff, pull, cavity, seam$"):
        regions.points(Region(group="xyz"))


@refused("regions")
def test_mistakes_are_told_in_one_line_with_the_authors_own_key(tmp_path, said, message):
    path = tmp_path / "mine.toml"
    path.write_text(
        'name = "mine"\nspacing = 0.1\nsteps = 1\nmaterial = "neo-hookean"\nbody = {size = [2.0,'
        ' 1.0]}\nholes = [{shape = "circle", radius = 0.2, center = [0.5, 0.5]}, {shape = "circle",'
        ' radius = 0.2, center = [1.5, 0.5]}]\nprescribed = [{region = "left", x1 ='
        ' 0.0}]\nregions.grip.edge = "right"\n'
    )
    load_scene(path)
    first = f"{path}: " * message.startswith("prescribed")
    with saying(first + message, SceneError, begins=bool(first)) as caught:
        load_scene(path, {"prescribed.0.region": said})
    assert str(caught.value).count("; ") <= 1 + ("this key is missing" in str(caught.value))


@refused("named regions")
def test_named_regions_that_make_no_sense(named, message):
    with saying(message, SceneError, begins=True):
        scene_of(regions=named, holes=())


def test_regions_composed_in_python():
    """By their names or those of the file, told alike."""
    assert Region(both=("left", Region(edge="top"))) == Region(**{"and": ["left", {"edge": "top"}]})
    with raising(r"^both\.1: must be the name of a region", SceneError):
        Region(both=("left", 3))
    with raising(r"^boths: unknown key", SceneError):
        Region(boths=("left",))
    scene = scene_of(regions={"x": Region(other="left")})
    assert pds.Scene(**scene.model_dump()) == scene


def test_the_point_nearest_to_a_place_far_away_is_refused():
    _, regions = regions_of(scene_of(prescribed=[{"region": {"near": [50, 0]}, "x1": 0.0}]))
    with raising(
        r"no point is close enough to \(50, 0\): the nearest one is point \d+ at .* away$"
    ):
        regions.points(Region(near=(50.0, 0.0)))
