"""Fields of the programs for image correlation: one affine motion without symmetry, written in
the form of each program, has its places, displacements and lost points again.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from refusals import raising
from scipy.io import savemat

import pdsurrogate as pds
from pdsurrogate.calibration.field_files import FieldFacts, field_rows
from pdsurrogate.measurements import files_at, is_field, read_fields

GRADIENT, SHIFT = np.array([[0.05, 0.02], [-0.03, -0.01]]), np.array([0.7, -0.4])
PIXELS = np.stack(np.meshgrid([20.0, 30, 40], [50.0, 60]), axis=-1).reshape(-1, 2)  # y downward
MOVED = PIXELS @ GRADIENT.T + SHIFT
UP = np.array([1, -1])
MM = 0.1 * PIXELS * UP + [1, 9]  # y upward
MM_MOVED = 0.1 * MOVED * UP


def write(path, heading, rows, separator=",", bom=""):
    lines = [heading, *(separator.join(str(one) for one in row) for row in rows)]
    path.write_text(bom + "\n".join(lines) + "\n", encoding="utf-8")
    return path


DICE = """***
*** Digital Image Correlation Engine (DICe), (git sha1: v1.0) Copyright 2021
*** Incremental correlation: false
*** Subset size: 27
*** Coordinates given with (0,0) as upper left corner of image, x positive right, y positive down
***
COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,GAMMA,MATCH"""


def dice(path):
    rows = [(*x, *u, 0.01, 0.0, 0) for x, u in zip(PIXELS, MOVED, strict=True)]
    return write(path, DICE, [*rows, (70, 80, 0, 0, -1, 0, -1)])


def vic_3d(path):
    rows = [
        (*X, 0.3, *U, 0.02, 0.01, *x, *u)
        for x, u, X, U in zip(PIXELS, MOVED, MM, MM_MOVED, strict=True)
    ]
    heading = '"X", "Y", "Z", "U", "V", "W", "sigma", "x", "y", "u", "v"'
    return write(path, heading, [*rows, (0, 0, 0, 0, 0, 0, -1, 0, 0, 0, 0)], ", ")


def al_dic(path):
    rows = [(k, *x, *(u * UP)) for k, (x, u) in enumerate(zip(PIXELS, MOVED, strict=True))]
    return write(path, "node_id,x_px,y_px,disp_u,disp_v", [*rows, (9, 5, 5, "", "")], bom="\ufeff")


def matchid(path):
    rows = [
        (*x, *((X + U) * UP), 0.3, *(U * UP), 0.0)
        for x, X, U in zip(PIXELS, MM, MM_MOVED, strict=True)
    ]
    heading = (
        "Coordinates.Image X [Pixel],Coordinates.Image Y [Pixel],coor.X [mm],coor.Y [mm],"
        "coor.Z [mm],disp.Horizontal Displacement U [mm],disp.Vertical Displacement V [mm],"
        "disp.Out-Of-Plane: W [mm]"
    )
    return write(path, heading, [*rows, (1, 1, 1, 1, 1, "", "", "")])


def aramis(path):
    rows = [
        (k, *X, 0.3, *U, 0.0) for k, (X, U) in enumerate(zip(MM, MM_MOVED, strict=True), start=1)
    ]
    heading = (
        "# facet_size : 19\n#     ID;   x_undef [mm];   y_undef [mm];  z_undef [mm];   u [mm];"
        "  v [mm];   w [mm]"
    )
    return write(path, heading, [*rows, (7, 1, 2, 3, "nan", "nan", "nan")], "; ")


def al_dic_3d(path):
    rows = [
        (*x, *((X + U) * UP), 500, *(U * UP), 0.0)
        for x, X, U in zip(PIXELS, MM, MM_MOVED, strict=True)
    ]
    return write(path, "x_px,y_px,X_mm,Y_mm,Z_mm,U,V,W", [*rows, (1, 1, *6 * ["nan"])])


def sun_dic(path):
    rows = [(*x, 0, *u, 0) for x, u in zip(PIXELS, MOVED, strict=True)]
    return write(
        path, "X Coord,Y Coord,Z Coord,X Disp,Y Disp,Z Disp", [*rows, (5, 5, 0, "", "", 0)]
    )


def gom(path):
    rows = [(*(X + U), 0.3, *U, 0) for X, U in zip(MM, MM_MOVED, strict=True)]
    heading = "# a\n# b\nx,y,z,displacement_x,displacement_y,displacement_z"
    return write(path, heading, [*rows, (7, 1, 2, "", "", "")])


def davis(path):
    rows = [(*X, 0.3, *U, 0) for X, U in zip(MM, MM_MOVED, strict=True)]
    heading = "x [mm];y [mm];z [mm];X-displacement [mm];Y-displacement [mm];Z-displacement [mm]"
    return write(path, heading, [*rows, (7, 1, 2, "", "", "")], ";")


@pytest.mark.parametrize(
    "program", [dice, vic_3d, al_dic, matchid, aramis, al_dic_3d, sun_dic, gom, davis]
)
def test_an_affine_motion_is_read_from_the_form_of_each_program(program, tmp_path):
    path = program(tmp_path / "file_3.csv")
    field = read_fields(path)
    pixels = field.unit == "px"
    np.testing.assert_allclose(field.places, PIXELS * UP if pixels else MM, atol=1e-9)
    np.testing.assert_allclose(field.displacements, MOVED * UP if pixels else MM_MOVED, atol=1e-9)
    assert (field.lost, field.step.tolist()) == (1, [1] * 6)
    assert is_field(path) == field.form


def ncorr(path):
    """Displacements on a grid of every tenth pixel, zero outside the region and at lost points."""
    u, v = np.zeros((2, 8, 6))
    for (x, y), moved in zip(PIXELS, MOVED, strict=True):
        u[int(y) // 10, int(x) // 10], v[int(y) // 10, int(x) // 10] = 0.1 * moved
    later = u.copy()
    later[7, 0] = 1.0
    images = [{"plot_u_ref_formatted": one, "plot_v_ref_formatted": v} for one in (u, later)]
    info = {"spacing": 9, "radius": 15, "pixtounits": 0.1, "units": "mm"}
    savemat(path, {"data_dic_save": {"displacements": images, "dispinfo": info}})
    return path


def test_ncorr_marks_points_by_zeros(tmp_path):
    field = read_fields(ncorr(tmp_path / "fields.mat"))
    first = field.step == 1
    np.testing.assert_allclose(field.places[first], 0.1 * PIXELS * UP)
    np.testing.assert_allclose(field.displacements[first], MM_MOVED)
    assert (field.unit, field.lost, len(field.step)) == ("mm", 1, 13)
    assert field.subset == pytest.approx(3.1)
    (tmp_path / "raw.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(105) + b"\x00\x02IM")
    with raising("rmfield"):
        read_fields(tmp_path / "raw.mat")


DATA = Path(__file__).parents[1] / "data" / "fields"
TRUE = np.array([[0.020, 0.010], [-0.015, -0.008]]), np.array([1.3, -0.7])  # y downward


@pytest.mark.parametrize(
    ("files", "options", "scales", "bottom"),
    [
        (["al-dic_frame_2.csv", "al-dic_frame_3.csv"], {}, [1, 2], 0),
        (["al-dic.npz"], {}, [1, 2], 0),
        (["al-dic.mat"], {}, [1, 2], 0),
        (["sun-dic_0.csv", "sun-dic_1.csv"], {}, [1, 2], 0),
        (["py3dic.dic"], {}, [1, 2], 0),
        (["pyxel_1.vtu", "pyxel_2.vtu"], {"unit": "px"}, [1, 2], 0),
        (["muDIC_list.npz"], {"up": False}, [0.5, 1], 0),
        (["muDIC_folder.npz"], {"up": True}, [0.5, 1], 179),  # the lowest row of pixels is 0
    ],
    ids=lambda one: one[0] if isinstance(one, list) and isinstance(one[0], str) else "",
)
def test_files_that_programs_wrote_have_the_motion_of_the_images(files, options, scales, bottom):
    field = read_fields(*(DATA / name for name in files), **options)
    assert (field.unit, field.lost) == ("px", 0)
    assert sorted(set(field.step)) == [1, 2]
    pixels = (field.places - [0, bottom]) * UP
    scale = np.array(scales)[field.step - 1, None]
    true = scale * (pixels @ TRUE[0].T + TRUE[1]) * UP
    assert np.abs(field.displacements - true).max() < 0.3
    assert np.sqrt(((field.displacements - true) ** 2).mean()) < 0.08
    assert is_field(DATA / files[0]) == field.form


def test_al_dic_states_the_width_of_a_subset_in_its_mat_file():
    assert read_fields(DATA / "al-dic.mat").subset == 20


def test_sigma_of_a_match_is_a_deviation_in_the_unit_of_the_displacements(tmp_path):
    assert read_fields(dice(tmp_path / "a.txt")).deviation == pytest.approx(0.01)
    assert read_fields(dice(tmp_path / "a.txt")).subset == 27
    path = vic_3d(tmp_path / "b.csv")
    assert read_fields(path).deviation == pytest.approx(0.001)  # 0.01 pixels of 0.1 mm
    assert read_fields(path, unit="px").displacements == pytest.approx(MOVED * UP)


def test_files_are_images_in_the_order_of_their_numbers(tmp_path):
    heading = "node_id,x_px,y_px,disp_u,disp_v"
    files = [
        write(
            tmp_path / f"frame_{k:.0f}.csv",
            heading,
            [(0, 5, 6, 0.1 * k, 0.2 * k), (1, 7, 6, 0.1 * k, 0.2 * k)],
        )
        for k in (1e-12, 2, 10)
    ]
    field = read_fields(files[2], files[0], files[1])
    assert field.step.tolist() == [1, 1, 2, 2]
    assert field.displacements[:, 0] == pytest.approx([0.2, 0.2, 1.0, 1.0])
    assert any("frame_0.csv to frame_10.csv" in note for note in field.notes)
    with raising("give no order"):
        read_fields(files[1], write(tmp_path / "frame_02.csv", heading, [(0, 5, 6, 1, 1)]))


def test_a_first_image_without_any_point_keeps_its_number(tmp_path):
    rows = [(10, 1, 2, 0, 0, -1), (20, 1, 2, 0.1, 0, 0.01), (20, 1, 3, 0.1, 0, 0.01)]
    heading = "FRAME,COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA"
    field = read_fields(write(tmp_path / "a.txt", heading, rows))
    assert (field.step.tolist(), field.lost) == ([2, 2], 1)
    assert field.notes == ("images by their numbers, 10 to 20",)


def test_rows_of_a_table_with_steps_are_numbered_by_them(tmp_path):
    path = write(tmp_path / "F.csv", "step,x1,x2,u1,u2", [(3, 0, 0, 0, 0), (7, 1, 2, 0.1, 0.2)])
    field = read_fields(path)
    assert (field.step.tolist(), field.unit, field.lost) == ([3, 7], "", 0)
    assert field.places.tolist() == [[0, 0], [1, 2]]


def test_places_of_solids_have_three_coordinates(tmp_path):
    path = write(tmp_path / "F.csv", "step,x1,x2,x3,u1,u2,u3", [(1, 1, 2, 3, 0.1, 0.2, 0.3)])
    field = read_fields(path, dimension=3)
    assert (field.places.tolist(), field.displacements.tolist()) == ([[1, 2, 3]], [[0.1, 0.2, 0.3]])
    field = read_fields(al_dic_3d(tmp_path / "a.csv"), dimension=3)  # Z away from the camera
    assert field.places[:, 2].tolist() == [-500] * 6
    with raising("no column x3"):
        read_fields(write(tmp_path / "F.csv", "step,x1,x2,u1,u2", [(1, 1, 2, 0, 0)]), dimension=3)
    with raising("tables alone"):
        read_fields(DATA / "al-dic.npz", dimension=3)


def test_a_deviation_of_zero_is_none(tmp_path):
    path = write(tmp_path / "a.txt", DICE, [(1, 2, 0.1, 0.2, 0, 0, 0)])
    assert np.isnan(read_fields(path).deviation).all()


def test_headings_again_begin_the_next_image(tmp_path):
    heading = "COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y"
    rows = [(1, 2, 0.1, 0), (heading,), (1, 2, 0.2, 0)]
    field = read_fields(write(tmp_path / "all.txt", heading, rows))
    assert field.step.tolist() == [1, 2]


def test_columns_of_no_known_program_need_a_unit_and_a_direction(tmp_path):
    path = write(tmp_path / "a.csv", "x;y;u;v", [("1,5", 2, "0,1", "0,2")], ";")
    with raising("--unit px"):
        read_fields(path)
    with raising("--up or --down"):
        read_fields(path, unit="px")
    field = read_fields(path, unit="px", up=False)
    assert (field.places.tolist(), field.displacements.tolist()) == ([[1.5, -2]], [[0.1, -0.2]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (DICE.replace("false", "true") + "\n1,2,0,0,0,0,0\n", "fixed pixels"),
        (DICE + "\n", "no rows"),
        (DICE + "\n1,2,0,0,-1,0,0\n", "all points are lost"),
        (DICE + "\n1,2,0,a,0,0,0\n", "line 8: DISPLACEMENT_Y is not a finite number: 'a'"),
        (DICE + "\n1,2,0,inf,0,0,0\n", "line 8: DISPLACEMENT_Y is not a finite number: 'inf'"),
        (DICE + "\n1,2,0\n", "line 8: the line has 3 values for 7 columns"),
        ("x1,x2,u1,u2\n1,2,0,0\n", "no column step"),
        ("step,x1,x2,u1,u2\n1.5,1,2,0,0\n", "must be whole"),
        ("x [px],y [px],u [mm],v [mm]\n1,2,0,0\n", "is in mm and px, not in one unit"),
        ("step,x1,x2,u1,u2,u2\n1,1,2,0,0,0\n", "two columns u2"),
        ("a,b\n1,2\n", "no line names columns"),
        ("a" * 200_000 + "\n1,2\n", "a line is too long for a table"),
        ("x;y;u;v\n5.5;2;0;0\n1,234;2;0;0\n", "line 3: 5.5 has a point and 1,234 a comma"),
    ],
)
def test_a_file_that_is_no_field_is_refused_with_the_cause(text, message, tmp_path):
    path = tmp_path / "field.txt"
    path.write_text(text)
    with raising(message):
        read_fields(path)


def test_heights_in_another_unit_are_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("x [mm],y [mm],z [um],u [mm],v [mm],w [um]\n1,2,3,0,0,0\n")
    with raising("is in mm and um, not in one unit"):
        read_fields(path, up=True, dimension=3)


def test_files_with_one_number_of_image_are_refused(tmp_path):
    paths = [tmp_path / f"frame_{k}.csv" for k in (1, 2)]
    for path in paths:
        path.write_text("step,x1,x2,u1,u2\n1,1,2,0,0\n")
    with raising("have the same numbers of images"):
        read_fields(*paths)


@pytest.mark.parametrize("ending", ["npz", "mat", "vtu", "dic"])
@pytest.mark.parametrize("text", ["", "junk", "PK\x03\x04 cut"])
def test_a_file_of_arrays_that_is_damaged_is_refused(ending, text, tmp_path):
    path = tmp_path / f"a.{ending}"
    path.write_text(text)
    with raising(re.escape(f"{path} cannot be read: ")):
        read_fields(path)
    assert is_field(path) is None


@pytest.mark.parametrize(
    ("name", "message"),
    [("a.sdic", "getDisplacements"), ("a.pyv", "can run code"), ("a.npz", "at fixed pixels")],
)
def test_a_file_that_is_not_read_says_what_to_export(name, message, tmp_path):
    if name == "a.npz":
        np.savez(tmp_path / name, u=np.zeros((2, 3, 3)), v=np.zeros((2, 3, 3)))
    with raising(message):
        read_fields(tmp_path / name)


def test_places_that_move_with_the_points_are_those_of_the_deformed_body(tmp_path):
    rows = [
        (step, *(x + step * u).round(2), *(step * u))
        for step in (1, 2)
        for x, u in zip(MM, MM_MOVED, strict=True)
    ]
    field = read_fields(write(tmp_path / "F.csv", "step,x1,x2,u1,u2", rows))
    np.testing.assert_allclose(field.places, np.vstack([MM, MM]), atol=0.006)
    assert "deformed body" in field.notes[0]


def test_py3dic_tables_are_refused_for_the_list_of_points(tmp_path):
    path = write(tmp_path / "a.csv", "index,pos_x,pos_y,disp_x,disp_y", [(0, 1, 2, 0.1, 0.2)])
    with raising("give its result"):
        read_fields(path, unit="px")


def test_a_direction_that_contradicts_the_program_is_refused(tmp_path):
    with raising("counts y downward"):
        read_fields(dice(tmp_path / "a.txt"), up=True)
    assert read_fields(dice(tmp_path / "a.txt"), up=False).lost == 1
    with raising("is in px, not in mm"):
        read_fields(dice(tmp_path / "a.txt"), unit="mm")


def test_a_folder_and_a_pattern_stand_for_their_files(tmp_path):
    """Hidden files do not count; a pattern that matches nothing is told."""
    for step in (1, 2, 10):
        (tmp_path / f"frame_{step}.csv").write_text(f"step,x1,x2,u1,u2\n1,0,0,{step},0\n")
    (tmp_path / ".notes").write_text("-")
    for given in (tmp_path, tmp_path / "frame_*.csv"):
        assert {file.name for file in files_at(given)} == {
            f"frame_{step}.csv" for step in (1, 2, 10)
        }
    with raising("no such files"):
        files_at(tmp_path / "image_*.csv")


@pytest.mark.parametrize(
    ("file", "unit", "y"),
    [(dice, None, -4.0), (matchid, None, -4.0), (vic_3d, None, 4.0), ("pyxel_1.vtu", "px", 4.0)],
)
def test_the_origin_is_stated_in_the_axes_of_the_file(file, unit, y, tmp_path):
    """It is turned upward where the places are."""
    path = DATA / file if isinstance(file, str) else file(tmp_path / "file.csv")
    found = field_rows(pds.load_scene("hole"), [path], FieldFacts(origin=(3.0, 4.0)), unit)
    assert found.arguments["origin"] == (3.0, y)
