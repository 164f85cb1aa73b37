"""What the geometry of a scene does to its results: meshes and their groups, outlines that
cross, supports at a place, folded corners.
"""

import matplotlib
import numpy as np
import pytest
from described import SCENES
from meshes import write_bar, write_triangles
from refusals import raising, refused
from runs import started

import pdsurrogate as pds
from pdsurrogate.discretization import discretize

matplotlib.use("Agg")

RUBBER = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 100.0}
CLAMPED = {"x1": 0.0, "x2": 0.0}


def run_of(**fields):
    scene = pds.Scene(**{"name": "trial", "material": RUBBER, "steps": (1.0,), **fields})
    return started(scene)


def cantilever(body, **fields):
    """Displacement of the tip of a body of 2 x 1 that a traction bends, and what is told of the
    body.
    """
    conditions = {
        "prescribed": ({"region": "left", **CLAMPED},),
        "loads": ({"region": "right", "traction": (0.0, -0.02)},),
        "probes": ({"name": "tip", "at": (2.0, 0.5)},),
    }
    scene = pds.Scene(name="bent", material=RUBBER, steps=(1.0,), body=body, **conditions, **fields)
    result = pds.simulate(scene, "bond-energy")
    return np.array(result.levels[-1]["probes"]["tip"]["displacement"]), result.summary


def test_a_mesh_has_its_own_spacing(tmp_path):
    """Triangles of 1/400 of the body make 800 points 0.05 apart, and the tip goes where that of a
    fine lattice does.

    The tip of lattices at 0.1, 0.05 and 0.025 goes by 0.2485, 0.2516 and 0.2524: toward 0.2527.  A
    mesh of points as far apart as 0.05 is allowed an error as large as that of a lattice at twice
    the spacing, 1.7 %; by a horizon of 3.15 times 0.1 it took 123 evaluations.
    """
    mesh = {"shape": "mesh", "file": str(write_triangles(tmp_path / "fine.vtu", 10))}
    tip, summary = cantilever(mesh)
    assert summary["spacing"] == pytest.approx(0.05)
    assert summary["horizon"] == pytest.approx(3.15 * 0.05)
    np.testing.assert_allclose(tip[1], -0.2527, rtol=0.017)
    with pytest.warns(UserWarning, match=r"^scene bent: spacing: ignored, .* 0\.05; leave it out$"):
        told, summary = cantilever(mesh, spacing=0.1)
    np.testing.assert_array_equal(told, tip)
    assert summary["spacing"] == pytest.approx(0.05)


def test_only_a_mesh_needs_no_spacing():
    with raising("spacing: this key is missing", pds.SceneError):
        cantilever({"shape": "rectangle", "size": (2.0, 1.0)})
    with raising("spacing: must be a number, unless the body is a mesh", pds.SceneError):
        cantilever({"shape": "rectangle", "size": (2.0, 1.0)}, spacing=None)


@pytest.fixture(scope="module")
def bar(tmp_path_factory):
    path = write_bar(tmp_path_factory.mktemp("meshes") / "bar.inp", (4, 2, 2))
    return {"shape": "mesh", "dimension": 3, "file": str(path)}


def pulled(bar, lower, upper, **fields):
    held = {"x1": 0.0, "x2": 0.0, "x3": 0.0}
    return {
        "body": bar,
        "prescribed": ({"region": lower, **held}, {"region": upper, **held, "x1": 0.2}),
        **fields,
    }


def test_groups_that_are_a_whole_face_are_held_as_that(bar):
    """By reflection in its plane, to the same forces, and told by their names in letters that a
    table takes.
    """
    by_name, by_group = (
        pds.simulate(
            pds.Scene(name="bar", material=RUBBER, steps=(1.0,), **pulled(bar, *ends)),
            "bond-energy",
        )
        for ends in (("left", "right"), ({"group": "lower end"}, {"group": "upper"}))
    )
    assert len(by_group.body.planes) == 2
    assert list(by_group.levels[-1]["forces"]) == ["lower_end", "upper"]
    for name, group in (("left", "lower_end"), ("right", "upper")):
        assert by_group.levels[-1]["forces"][group] == by_name.levels[-1]["forces"][name]
    assert by_group.summary["n_force_evaluations"] == by_name.summary["n_force_evaluations"]


def test_groups_that_are_a_part_of_a_face_hold_their_points(bar):
    run = run_of(**pulled(bar, {"group": "part"}, {"and": [{"group": "upper"}]}))
    assert [plane.side for plane in run.body.planes] == [1]
    assert run.loading.names == ("part", "prescribed.1")
    assert (run.loading.free[run.body.groups["part"]] == 0).all()
    assert not run_of(**pulled(bar, {"group": "lower end"}, "right", support="points")).body.planes


@refused("outlines")
def test_outlines_that_cross_or_run_twice_are_refused(vertices, message):
    with raising(message, pds.SceneError):
        pds.shapes.Polygon(vertices=vertices)


@pytest.mark.parametrize("vertices", SCENES["outlines that touch themselves"]["cases"])
def test_outlines_that_touch_themselves_are_taken(vertices):
    assert pds.shapes.Polygon(vertices=vertices).shape == "polygon"
    assert (
        pds.shapes.Polygon(vertices=[(x1 + 1e6, x2 - 1e6) for x1, x2 in vertices]).shape
        == "polygon"
    )


def test_supports_on_an_axis_do_not_turn_the_body():
    """An eccentric ring, symmetric about x1, on points 0.2 apart: by the one point above the axis
    that is nearest it turned by 0.0027.

    Both halves are then mirror images but for the residual, 1e-6 of the shear modulus over the
    spacing: turns are far below 1e-5.  It takes 24 evaluations, as many as with one point held;
    with a preconditioner that knows only the held point it took 133.
    """
    places = {"north": (0.0, 1.8), "south": (0.0, -1.8)}
    scene = pds.Scene(
        name="ring",
        spacing=0.2,
        horizon_ratio=2.15,
        body={"shape": "circle", "radius": 2.0},
        holes=({"shape": "circle", "radius": 1.0, "center": (0.3, 0.0)},),
        material=RUBBER,
        loads=({"region": "holes", "pressure": 0.15},),
        prescribed=(
            {"region": {"near": (1.6, 0.0)}, **CLAMPED},
            {"region": {"near": (-1.5, 0.0)}, "x2": 0.0},
        ),
        probes=[{"name": name, "at": at} for name, at in places.items()],
        steps=(1.0,),
    )
    result = pds.simulate(scene)
    probes = result.levels[-1]["probes"]
    assert result.summary["n_force_evaluations"] < 50
    north, south = (np.array(probes[name]["displacement"]) for name in places)
    assert abs(north[0] - south[0]) / 3.6 < 1e-5
    assert abs(north[1] + south[1]) < 1e-5
    assert north[1] > 0.05


def test_a_support_at_a_place_keeps_nothing_from_turning():
    """The four points around a corner of cells are one support: they keep the body where they
    are, and a second one from turning.
    """
    sheet = {"body": {"shape": "rectangle", "size": (1.2, 1.0)}, "spacing": 0.1}
    pin = {"region": {"near": (0.6, 0.5)}, **CLAMPED}
    with raising("nothing keeps the body from turning", pds.SceneError):
        run_of(**sheet, prescribed=(pin,))
    run = run_of(**sheet, prescribed=(pin, {"region": {"near": (0.05, 0.5)}, "x2": 0.0}))
    assert (run.loading.free == 0).sum(axis=0).tolist() == [1, 2]
    dynamics = {"to": 1.0, "dynamics": {"duration": 1.0, "density": 1.0}}
    with raising(r"^scene trial: prescribed.0.region: 4 points", pds.SceneError):
        run_of(**sheet, prescribed=(pin,), steps=(dynamics,))


def test_a_beam_on_two_supports_at_places():
    """A beam of 4 x 1 under its weight of 0.016: each carries half of it, at the mean of its two
    points, half a cell inside the end.

    Held at both points in both components, one of them carried 7 % more than the other: it kept its
    end from turning.  Forces balance to the residual, 1e-6 of mu/spacing in force density: on 128
    points of 1/16 it is worth less than 2e-5 of the weight and its moment.
    """
    scene = pds.Scene(
        name="beam",
        spacing=0.25,
        body={"shape": "rectangle", "size": (4.0, 1.0), "lower": (0.0, -0.5)},
        material=RUBBER,
        prescribed=(
            {"region": {"near": (0.0, 0.0)}, **CLAMPED, "name": "pin"},
            {"region": {"near": (4.0, 0.0)}, "x2": 0.0, "name": "roller"},
        ),
        loads=({"body_force": (0.0, -0.004)},),
        solver={"tolerance": 1e-8},
        steps=(1.0,),
    )
    result = pds.simulate(scene, "bond-energy")
    level = result.levels[-1]
    np.testing.assert_allclose(level["forces"]["pin"], [0.0, 0.008], atol=1e-6)
    np.testing.assert_allclose(level["forces"]["roller"], [0.0, 0.008], atol=1e-6)
    assert level["moments"]["pin"] == pytest.approx(0.125 * 0.008, abs=1e-6)
    held = np.argsort(np.linalg.norm(result.body.points, axis=1))[:2]
    np.testing.assert_allclose(result.field("displacement")[held].mean(axis=0)[:2], 0.0, atol=1e-12)


def test_a_support_at_a_place_goes_where_it_is_told():
    """A sheet is turned by 30 degrees, by a rotation at one place and by what that does at
    another: it turns rigidly.
    """
    angle = np.radians(30)
    turned = np.array([[np.cos(angle) - 1, -np.sin(angle)], [np.sin(angle), np.cos(angle) - 1]])
    x1, x2 = turned @ [0.6, 0.0]
    scene = pds.Scene(
        name="sheet",
        spacing=0.1,
        body={"shape": "rectangle", "size": (1.2, 1.0), "lower": (-0.6, -0.5)},
        material=RUBBER,
        prescribed=(
            {"region": {"near": (0.0, 0.0)}, "rotation": 30.0, "about": (0.0, 0.0)},
            {"region": {"near": (0.5, 0.0)}, "x1": float(x1 * 5 / 6), "x2": float(x2 * 5 / 6)},
        ),
        steps=(1.0,),
    )
    result = pds.simulate(scene, "bond-energy")
    moved = result.field("displacement")[:, :2]
    # What is prescribed at the second place is that at 0.5; its four points have their mean there.
    np.testing.assert_allclose(moved, result.body.points @ turned.T, atol=1e-4)


def gasket(**changes):
    """Half of a block bonded to two plates, a quarter of it by symmetry."""
    rollers = {"region": "top", "x2": -0.15}, {"region": "right", "x1": 0.0}
    fields = {
        "name": "gasket",
        "spacing": 0.05,
        "plane": "strain",
        "body": {"shape": "rectangle", "size": (0.6, 0.5)},
        "material": RUBBER,
        "prescribed": ({"region": "bottom", **CLAMPED}, *rollers),
        "steps": ({"to": 1.0, "largest_increment": 0.25},),
    }
    return pds.Scene(**{**fields, **changes})


def test_a_corner_that_folds_over_the_plate_is_told():
    with pytest.raises(pds.SimulationFailed) as caught:
        pds.simulate(gasket())
    told = str(caught.value)
    assert "beyond the bottom edge" in told
    assert "the body bulges over what it is bonded to" in told
    assert "contact is modeled at obstacles alone, and a smaller spacing folds earlier" in told
    assert "use a smaller spacing" not in told


def test_bodies_in_pieces_that_are_all_held_are_remarked_on():
    cut = {"start": (-0.1, 0.5), "end": (1.3, 0.5)}
    sheet = {"body": {"shape": "rectangle", "size": (1.2, 1.0)}, "spacing": 0.1, "precuts": (cut,)}
    message = (
        "the body consists of 2 pieces without bonds between them, for example because a cut goes"
        " all the way"
    )
    with pytest.warns(UserWarning, match=message):
        run_of(**sheet, prescribed=({"region": "left", **CLAMPED},))
    grips = {
        "grips": ({"edge": "left"}, {"edge": "right", "travel": 1.0}),
        "stretches": (1.1,),
        "steps": (),
    }
    with pytest.warns(UserWarning, match=message):
        run_of(**sheet, **grips)


@refused("previews")
def test_the_preview_refuses_what_a_run_refuses(changes, message):
    sheet = {
        "body": {"shape": "rectangle", "size": (1.2, 1.0)},
        "spacing": 0.1,
        "prescribed": ({"region": "left", **CLAMPED},),
    }
    scene = pds.Scene(name="sheet", material=RUBBER, steps=(1.0,), **{**sheet, **changes})
    told = []
    for look in (pds.preview, started):
        with pytest.raises(pds.SceneError) as caught:
            look(scene)
        told.append(str(caught.value))
    assert told[0] == told[1]
    assert message in told[0]


@pytest.mark.parametrize("unit", [1e-6, 3.7])
@pytest.mark.parametrize("dimension", [2, 3])
def test_the_bonds_that_a_precut_breaks_do_not_depend_on_the_unit_of_length(dimension, unit):
    """Diagonal bonds meet its end, halfway between columns of points, exactly: rounding must not
    decide which of them it breaks.
    """

    def bonds(unit):
        if dimension == 2:
            body, cut = (
                {"shape": "rectangle", "size": [3 * unit, unit]},
                {
                    "start": [0, unit / 2],
                    "end": [1.5 * unit, unit / 2],
                },
            )
        else:
            body = {"shape": "box", "size": [3 * unit, unit, 0.4 * unit]}
            cut = {"corner": [0, unit / 2, 0], "sides": [[1.5 * unit, 0, 0], [0, 0, 0.4 * unit]]}
        described = {
            "name": "cut",
            "spacing": 0.1 * unit,
            "body": body,
            "precuts": [cut],
            "stretches": [1.5],
        }
        material = {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": 20.0}
        grips = [{"edge": "bottom"}, {"edge": "top", "travel": 1.0}]
        return discretize(
            pds.Scene.model_validate({**described, "material": material, "grips": grips})
        )[0].bonds

    ours, usual = bonds(unit), bonds(1.0)
    np.testing.assert_array_equal(ours.first, usual.first)
    np.testing.assert_array_equal(ours.second, usual.second)


@pytest.mark.parametrize("unit", [1e-5, 3.7])
@pytest.mark.parametrize("radius", [0.22, 0.25])
@pytest.mark.parametrize("dimension", [2, 3])
def test_cells_at_a_round_hole_do_not_depend_on_the_unit_of_length(dimension, radius, unit):
    """Two (in space three) cells are equally near to the part of a cell on a diagonal: rounding
    must not decide which of them gets it.
    """

    def sheet(unit):
        shape, hole = (("rectangle", "circle"), ("box", "sphere"))[dimension - 2]
        body, center = {"shape": shape, "size": [unit] * dimension}, [0.5 * unit] * dimension
        holes = [{"shape": hole, "center": center, "radius": radius * unit}]
        grips = [{"edge": "bottom"}, {"edge": "top", "travel": 1.0}]
        fields = {
            "spacing": 0.1 * unit,
            "body": body,
            "holes": holes,
            "grips": grips,
            "stretches": [1.5],
            "material": RUBBER,
        }
        return discretize(pds.Scene.model_validate({"name": "hole", **fields}))[0]

    ours, usual = sheet(unit), sheet(1.0)
    np.testing.assert_allclose(ours.points / unit, usual.points, rtol=1e-9)
    np.testing.assert_allclose(ours.volumes / unit**dimension, usual.volumes, rtol=1e-9)
    # Like the sheet, its points are symmetric about the diagonal; the places sampled in a cell of a
    # solid are so about its middle alone.
    turned = usual.points[:, ::-1] if dimension == 2 else 1 - usual.points
    places = np.lexsort(np.rint(1e6 * turned).T), np.lexsort(np.rint(1e6 * usual.points).T)
    np.testing.assert_allclose(turned[places[0]], usual.points[places[1]], rtol=1e-9)
    np.testing.assert_allclose(usual.volumes[places[0]], usual.volumes[places[1]], rtol=1e-9)


# cuts of a sheet of which one half or quarter is computed, and those of the whole sheet
MIRRORED_CUTS = SCENES["mirrored cuts"]


def neighbors_in(corner, body, cuts, rollers):
    """Places of the neighbors of every point above `corner`, by the place of the point, in
    multiples of a thousandth.
    """
    fields = {
        "spacing": 0.1,
        "horizon_ratio": 3.15 if len(corner) == 2 else 1.75,
        "body": body,
        "precuts": cuts,
        "steps": 1.0,
    }
    held = [
        {"region": {"near": [0.55] * len(corner)}, "x1": 0.0},
        *({"region": edge, f"x{axis}": 0.0} for edge, axis in rollers),
    ]
    body = discretize(
        pds.Scene.model_validate({"name": "cut", "material": RUBBER, **fields, "prescribed": held})
    )[0]
    places = np.rint(1000 * body.all_points).astype(int)
    ends = np.split(body.bonds.neighbors, body.bonds.pointers[1:-1].astype(int))
    inside = (body.points > corner).all(axis=1)
    return {
        tuple(places[i]): {tuple(place) for place in places[ends[i]]}
        for i in np.flatnonzero(inside)
    }


@pytest.mark.parametrize("case", MIRRORED_CUTS)
def test_a_precut_goes_on_beyond_a_held_edge_as_its_mirror_image(case):
    """The points of a symmetric sheet have the same bonds if only a half or a quarter of it is
    computed.
    """
    cuts, all_cuts = MIRRORED_CUTS[case]
    quarter = "corner" in case
    size, lower = ([2.0, 2.0], [-1.0, -1.0]) if quarter else ([2.0, 1.0], [-1.0, 0.0])
    rollers = [("left", 1), ("bottom", 2)] if quarter else [("left", 1)]
    part = neighbors_in([0.0, 0.0], {"size": [1.0, 1.0]}, cuts, rollers)
    assert part == neighbors_in([0.0, 0.0], {"size": size, "lower": lower}, all_cuts, [])


MIRRORED_CUTS_OF_SOLIDS = SCENES["mirrored cuts of solids"]


@pytest.mark.parametrize("case", MIRRORED_CUTS_OF_SOLIDS)
def test_a_cut_of_a_solid_goes_on_beyond_a_held_face_as_its_mirror_image(case):
    cuts, all_cuts = MIRRORED_CUTS_OF_SOLIDS[case]
    part = neighbors_in([0.0] * 3, {"shape": "box", "size": [0.6, 0.6, 0.6]}, cuts, [("left", 1)])
    assert part == neighbors_in(
        [0.0] * 3,
        {"shape": "box", "size": [1.2, 0.6, 0.6], "lower": [-0.6, 0.0, 0.0]},
        all_cuts,
        [],
    )
