"""The boundary of bodies, and the motion of places on it and within from that of the points."""

import numpy as np
import pytest
from meshes import write_plate
from refusals import raising

from pdsurrogate.body import fields_at
from pdsurrogate.body.local_fit import empty_rows
from pdsurrogate.discretization import discretize, surface_of
from pdsurrogate.scenes import load_scene

SQUARE = {"shape": "rectangle", "size": [2.0, 2.0], "lower": [-1.0, -1.0]}
DISC = {"shape": "circle", "radius": 1.0}
TRIANGLE = {"shape": "polygon", "vertices": [[0, 0], [1.3, 2.2], [2.1, 0]]}  # clockwise
LETTER = {"shape": "polygon", "vertices": [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]}
BOW = {
    "shape": "polygon",
    "vertices": [[-1, -1], [-1 / 7, -1 / 7], [1, -1], [1, 1], [-1 / 7, -1 / 7], [-1, 0.5]],
}  # two triangles


def circle(radius, x1, x2):
    return {"shape": "circle", "radius": radius, "center": [x1, x2]}


def box(lower, upper):
    return {
        "shape": "rectangle",
        "size": [upper[0] - lower[0], upper[1] - lower[1]],
        "lower": list(lower),
    }


# of a disc of radius 0.5, beyond a chord 0.3 from its center
SEGMENT = 0.25 * np.arccos(0.6) - 0.3 * 0.4

BODIES = {
    "square": (SQUARE, [], 4.0, 1e-12),
    "square with a hole": (SQUARE, [circle(0.5, 0.1, 0.0)], 4 - np.pi / 4, 1e-12),
    "ring": (DISC, [circle(0.4, 0.0, 0.0)], np.pi * (1 - 0.16), 1e-12),
    "ellipse": ({"shape": "ellipse", "semi_axes": [1.5, 0.6]}, [], np.pi * 0.9, 1e-12),
    "triangle": (TRIANGLE, [], 2.1 * 2.2 / 2, 1e-12),
    "letter": (LETTER, [box((0.3, 0.3), (0.7, 0.7))], 3 - 0.16, 1e-12),
    "sides that touch": (BOW, [], 12.5 / 7, 1e-12),
    "hole across an edge": (SQUARE, [circle(0.5, 1.3, 0.0)], 4 - SEGMENT, 2e-3),
    "slot across an edge": (SQUARE, [box((0.4, -0.15), (1.2, 0.15))], 4 - 0.18, 1e-12),
    "slot along an edge but for rounding": (
        SQUARE,
        [box((0.7, -0.15), (1.0 - 1e-10, 0.15))],
        4 - 0.09,
        1e-9,
    ),
    "holes that share a side but for rounding": (
        SQUARE,
        [box((-0.5, -0.5), (-1e-10, 0.1)), box((0.0, -0.5), (0.5, 0.3))],
        4 - 0.7,
        1e-9,
    ),
    "holes that share an edge on one side": (
        SQUARE,
        [box((-0.5, -0.5), (0.0, 0.5)), box((-0.5, -0.5), (0.5, 0.0))],
        4 - 0.75,
        1e-12,
    ),
    "hole within a hole": (
        SQUARE,
        [circle(0.5, 0.0, 0.0), circle(0.3, 0.1, 0.0)],
        4 - np.pi / 4,
        1e-12,
    ),
    "two pieces": (SQUARE, [box((-0.15, -2.0), (0.15, 2.0))], 4 - 0.6, 1e-12),
}


def bodied(body, holes=(), spacing=0.1, **changes):
    """Scene of a body, the body, and its surface."""
    scene = load_scene(
        "uniaxial",
        {"body": body, "holes": list(holes), "spacing": spacing, "support": "points", **changes},
    )
    discretized = discretize(scene)
    return scene, discretized, surface_of(scene, *discretized)


def check_closed(surface):
    """Every node is the end of as many facets as it is the start of, and the normals cancel."""
    first, second = surface.facets.T
    ends = np.arange(len(surface.nodes))
    assert np.array_equal(
        np.bincount(first, minlength=len(ends)), np.bincount(second, minlength=len(ends))
    )
    assert np.bincount(first).min() >= 1
    np.testing.assert_allclose(surface.normals().sum(axis=0), 0, atol=1e-12)
    assert len(np.unique(np.sort(surface.facets, axis=1), axis=0)) == len(surface.facets)


def area_within(surface):
    """By the divergence theorem: half the integral of X . N over the boundary."""
    return (surface.midpoints() * surface.normals()).sum() / 2


def check_affine(surface, body):
    rows = surface.interpolation.rows
    assert surface.followed().all()
    np.testing.assert_allclose(rows.sum(axis=1), 1, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rows @ body.points, surface.nodes, rtol=0, atol=1e-12)


@pytest.mark.parametrize("case", BODIES)
def test_boundaries_are_closed_and_enclose_the_body(case):
    """Area by the divergence theorem; that of the points is found on a raster, to some 1/1000 of a
    cell for each cell that is cut.

    Whole circles have their areas to rounding, and quarters of them, which begin on an axis.  An
    arc cut elsewhere ends within a facet, which lies beyond the circle by up to theta^2/12 of the
    radius: (h/2)^3/(12 r) = 2e-5 of area at either end, and more at the edge.
    """
    shape, holes, area, tolerance = BODIES[case]
    _, (body, _, _), surface = bodied(shape, holes)
    check_closed(surface)
    assert area_within(surface) == pytest.approx(area, abs=tolerance)
    assert body.volumes.sum() == pytest.approx(area, abs=0.01)
    check_affine(surface, body)
    assert surface.areas().max() < 0.15 + 1e-9
    # The body is on the left of every facet.
    normals = surface.normals() / surface.areas()[:, None]
    assert surface.encloses(surface.midpoints() - 1e-4 * normals).all()
    assert not surface.encloses(surface.midpoints() + 1e-4 * normals).any()


def test_parts_are_named_where_they_lie():
    _, _, surface = bodied(LETTER, [circle(0.2, 0.5, 0.5), circle(0.2, 0.5, 1.5)])
    assert dict(zip(*np.unique(surface.parts, return_counts=True), strict=True)) == {
        "bottom": 20,
        "left": 20,
        "right": 10,
        "top": 10,
        "outline": 20,
        "holes.0": 28,
        "holes.1": 28,
    }
    # A notch through an edge is of the hole, and the edge is what is left of it.
    _, _, notched = bodied(SQUARE, [box((0.4, -0.15), (1.2, 0.15))])
    assert notched.areas()[notched.parts == "right"].sum() == pytest.approx(1.7)
    assert notched.areas()[notched.parts == "holes.0"].sum() == pytest.approx(0.3 + 2 * 0.6)
    assert not (bodied(DISC)[2].parts != "outline").any()


def smooth(places):
    """A field of second degree and more; its second derivatives are below 3."""
    x1, x2 = places.T
    return np.stack(
        [np.sin(1.5 * x1 + 0.4) * np.cos(x2), x1**2 - 0.7 * x1 * x2 + np.exp(0.5 * x2)], axis=1
    )


@pytest.mark.parametrize("case", ["square", "ring", "letter", "hole across an edge"])
def test_the_boundary_follows_smooth_motions_to_second_order(case):
    """Half the spacing gives a quarter of the error, at corners too; beside curved ones, where
    cells are cut at random, less than 0.4.

    The fit at a straight edge has an error of h^2 times the second derivative across it, and a
    corner has that of both directions.
    """
    errors = []
    for spacing in (0.1, 0.05, 0.025):
        shape, holes, *_ = BODIES[case]
        _, (body, _, _), surface = bodied(shape, holes, spacing)
        errors.append(
            np.abs(surface.interpolation(smooth(body.points)) - smooth(surface.nodes)).max()
        )
        assert errors[-1] < 6 * spacing**2
    assert errors[1] < 0.4 * errors[0]
    assert errors[2] < 0.4 * errors[1]


@pytest.mark.parametrize("case", ["square", "ring", "letter"])
def test_places_follow_quadratic_motions_exactly(case):
    """Inside and on the boundary; cubic ones leave third-order errors."""
    shape, holes, *_ = BODIES[case]
    errors = []
    for spacing in (0.1, 0.05):
        _, (body, _, _), surface = bodied(shape, holes, spacing)
        places = np.concatenate(
            [
                surface.nodes,
                surface.midpoints(),
                body.points[::7] + 0.3 * spacing * np.array([1, -0.5]),
            ]
        )
        values, _ = fields_at(body, places)
        np.testing.assert_allclose(values(body.points), places, rtol=0, atol=1e-12)
        square = np.stack([places[:, 0] ** 2, places[:, 0] * places[:, 1]], axis=1)
        at_points = np.stack(
            [body.points[:, 0] ** 2, body.points[:, 0] * body.points[:, 1]], axis=1
        )
        np.testing.assert_allclose(values(at_points), square, rtol=0, atol=1e-11)
        errors.append(np.abs(values(smooth(body.points)) - smooth(places)).max())
    assert errors[1] < errors[0] / 5


def test_nothing_is_taken_across_holes_notches_and_cuts():
    """Two halves that a slot or a cut divides: a place on one side asks no point of the other."""
    cut = {"precuts": [{"start": [-1.0, 0.0], "end": [0.3, 0.0]}]}
    for holes, changes in (([box((-1.1, -0.05), (0.3, 0.05))], {}), ([], cut)):
        _, (body, _, _), surface = bodied(SQUARE, holes, **changes)
        edge = (surface.parts == "left") & (np.abs(surface.midpoints()[:, 1]) < 0.3)
        nodes = np.unique(surface.facets[edge])
        nodes = nodes[
            np.abs(surface.nodes[nodes, 1]) > 1e-9
        ]  # the one at the mouth of a cut follows both sides
        above = surface.nodes[nodes, 1] > 0
        rows = surface.interpolation.rows[nodes].toarray()
        assert not rows[above][:, body.points[:, 1] < 0].any()
        assert not rows[~above][:, body.points[:, 1] > 0].any()
        places = np.array([[-0.5, 0.06], [-0.5, -0.06]])
        upper, lower = fields_at(body, places)[0].rows.toarray()
        assert not upper[body.points[:, 1] < 0].any()
        assert not lower[body.points[:, 1] > 0].any()


def test_ligaments_of_one_row_tell_no_deformation():
    """Between a slot and an edge one row of points is left, beyond which there is nothing;
    elsewhere all is well.
    """
    scene, (body, _, _), surface = bodied(SQUARE, [box((-1.0, 0.7), (1.0, 0.9))])
    lost = ~surface.followed()
    assert lost.any()
    assert (surface.nodes[lost, 1] > 0.85).all()
    assert surface.followed()[surface.nodes[:, 1] < 0.75].all()
    assert np.array_equal(empty_rows(surface.interpolation.rows), lost)
    with raising(r"\(0, 0\.95\): .*; use a smaller spacing"):
        fields_at(body, np.array([[0.5, 0.5], [0.0, 0.95]]))
    assert scene.spacing == 0.1


def test_places_outside_are_refused_with_what_is_near():
    _, (body, _, _), _ = bodied(SQUARE, [circle(0.5, 0.0, 0.0)])
    with raising(r"^\(3, 0\.25\) lies outside .* \(0\.95, 0\.25\), 2\.05 away$"):
        fields_at(body, np.array([[0.9, 0.9], [3.0, 0.25]]))
    with raising(r"^\(0, 0\) lies outside the body"):
        fields_at(body, np.array([[0.0, 0.0]]))


@pytest.mark.parametrize(
    ("name", "version"), [("plate.inp", None), ("plate.msh", 2), ("plate.msh", 4)]
)
def test_boundaries_of_meshes(tmp_path, name, version):
    """Sides of one cell alone, with the mesh's own hole, which is the first one, and its groups,
    however the file says them.
    """
    path = write_plate(tmp_path / name, turned=version == 4, version=version)
    mesh = {"shape": "mesh", "file": str(path)}
    _, (body, _, _), surface = bodied(mesh)
    check_closed(surface)
    assert area_within(surface) == pytest.approx(1.44 - 0.16, rel=1e-12)
    assert body.volumes.sum() == pytest.approx(1.44 - 0.16, rel=1e-12)
    check_affine(surface, body)
    counts = {"left": 12, "right": 12, "bottom": 12, "top": 12, "holes.0": 16}
    assert dict(zip(*np.unique(surface.parts, return_counts=True), strict=True)) == counts
    assert set(body.groups) == {"soft", "stiff", "pull", "cavity", "seam"}
    np.testing.assert_array_equal(surface.groups["pull"], np.flatnonzero(surface.parts == "right"))
    np.testing.assert_array_equal(
        surface.groups["cavity"], np.flatnonzero(surface.parts == "holes.0")
    )
    assert len(surface.groups["seam"]) == 0
    assert (surface.midpoints()[surface.groups["soft"], 0] < 0.6).all()
    assert len(surface.groups["soft"]) + len(surface.groups["stiff"]) == len(surface.facets)
    np.testing.assert_array_equal(
        np.sort(body.groups["soft"]), np.flatnonzero(body.points[:, 0] < 0.6)
    )
    # The cells beside a line: above and below the diagonal of a square one of two triangles has it
    # for a side.
    np.testing.assert_allclose(body.points[body.groups["pull"], 0], 1.2 - 0.1 / 3)
    assert len(body.groups["pull"]) == 12
    assert len(body.groups["seam"]) == 4 + 4


def test_holes_in_meshes_leave_out_whole_cells(tmp_path):
    """The boundary of what is left, around the points that are left; the mesh's own hole is
    numbered after those of the scene.
    """
    path = write_plate(tmp_path / "plate.msh")
    mesh = {"shape": "mesh", "file": str(path)}
    _, (body, _, _), surface = bodied(mesh, [box((-0.05, 0.0), (0.2, 0.2)), circle(0.11, 0.6, 1.0)])
    check_closed(surface)
    assert area_within(surface) == pytest.approx(body.volumes.sum(), rel=1e-12)
    assert {*surface.parts} == {"left", "right", "bottom", "top", "holes.0", "holes.1", "holes.2"}
    assert surface.areas()[surface.parts == "holes.0"].sum() == pytest.approx(0.4)
    assert surface.areas()[surface.parts == "holes.2"].sum() == pytest.approx(1.6)
    for members in body.groups.values():
        assert members.max() < len(body)
    np.testing.assert_array_equal(
        np.sort(body.groups["soft"]), np.flatnonzero(body.points[:, 0] < 0.6)
    )


def test_a_mesh_is_read_once_and_again_when_it_has_changed(tmp_path, monkeypatch):
    import os

    import meshio

    path = write_plate(tmp_path / "plate.msh")
    reads = []
    read = meshio.read
    monkeypatch.setattr(meshio, "read", lambda file: reads.append(file) or read(file))
    mesh = {"shape": "mesh", "file": str(path)}
    assert len(bodied(mesh)[1][0]) == 64 + 2 * 64
    assert len(reads) == 1
    write_plate(path, hole=((4, 4), (6, 6)))
    os.utime(path, ns=(1, 1))
    assert len(bodied(mesh)[1][0]) == 68 + 2 * 72
    assert len(reads) == 2


@pytest.mark.parametrize("noise", [1e-12, 1e-6])
def test_nodes_of_a_mesh_at_one_place_are_one(tmp_path, noise):
    """Two squares that share a side but no nodes: bonds bind them, and their common side is no
    boundary, whatever the noise of a drawing.
    """
    import meshio

    corners = [
        [0, 0, 0],
        [1, 0, 0],
        [1, 1, 0],
        [0, 1, 0],
        [1, 0, 0],
        [2, 0, 0],
        [2, 1, 0],
        [1, 1 + noise, 0],
    ]
    meshio.write(
        tmp_path / "two.vtu",
        meshio.Mesh(np.array(corners, float), [("quad", [[0, 1, 2, 3], [4, 7, 6, 5]])]),
    )
    scene = load_scene(
        "uniaxial",
        {
            "body": {"shape": "mesh", "file": str(tmp_path / "two.vtu")},
            "spacing": 1.0,
            "support": "points",
        },
    )
    surface = surface_of(scene, *discretize(scene))
    assert len(surface.facets) == 6
    check_closed(surface)
    assert not surface.followed().any()  # two points are in one row
