"""Fields of the programs for image correlation: one affine motion without symmetry, written in
the form of each program, has its places, displacements and lost points again.
"""

import numpy as np
import pytest

from pdsurrogate.measurements import is_field, read_fields

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
        (*x, *(X * UP), 0.3, *(U * UP), 0.0) for x, X, U in zip(PIXELS, MM, MM_MOVED, strict=True)
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


@pytest.mark.parametrize("program", [dice, vic_3d, al_dic, matchid, aramis, al_dic_3d, sun_dic])
def test_an_affine_motion_is_read_from_the_form_of_each_program(program, tmp_path):
    path = program(tmp_path / "file_3.csv")
    field = read_fields(path)
    pixels = field.unit == "px"
    np.testing.assert_allclose(field.places, PIXELS * UP if pixels else MM, atol=1e-9)
    np.testing.assert_allclose(field.displacements, MOVED * UP if pixels else MM_MOVED, atol=1e-9)
    assert (field.lost, field.step.tolist()) == (1, [1] * 6)
    assert is_field(path) == field.form


def test_sigma_of_a_match_is_a_deviation_in_the_unit_of_the_displacements(tmp_path):
    assert read_fields(dice(tmp_path / "a.txt")).deviation == pytest.approx(0.01)
    assert read_fields(dice(tmp_path / "a.txt")).subset == 27
    path = vic_3d(tmp_path / "b.csv")
    assert read_fields(path).deviation == pytest.approx(0.001)  # 0.01 pixels of 0.1 mm
    assert read_fields(path, unit="px").displacements == pytest.approx(MOVED * UP)


def test_files_are_images_in_the_order_of_their_numbers(tmp_path):
    heading = "node_id,x_px,y_px,disp_u,disp_v"
    files = [
        write(tmp_path / f"frame_{k}.csv", heading, [(0, 5, 6, 0.1 * k, 0.2 * k)])
        for k in (0, 2, 10)
    ]
    field = read_fields(files[2], files[0], files[1])
    assert field.step.tolist() == [1, 2]
    assert field.displacements[:, 0] == pytest.approx([0.2, 1.0])
    assert any("frame_0.csv, frame_2.csv, frame_10.csv" in note for note in field.notes)
    with pytest.raises(ValueError, match="give no order"):
        read_fields(files[0], files[0].rename(tmp_path / "frame_00.csv"))


def test_rows_of_a_table_with_steps_are_numbered_by_them(tmp_path):
    path = write(tmp_path / "F.csv", "step,x1,x2,u1,u2", [(3, 0, 0, 0, 0), (7, 1, 2, 0.1, 0.2)])
    field = read_fields(path)
    assert (field.step.tolist(), field.unit, field.lost) == ([3, 7], "", 0)
    assert field.places.tolist() == [[0, 0], [1, 2]]


def test_headings_again_begin_the_next_image(tmp_path):
    heading = "COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y"
    rows = [(1, 2, 0.1, 0), (heading,), (1, 2, 0.2, 0)]
    field = read_fields(write(tmp_path / "all.txt", heading, rows))
    assert field.step.tolist() == [1, 2]


def test_columns_of_no_known_program_need_a_unit_and_a_direction(tmp_path):
    path = write(tmp_path / "a.csv", "x;y;u;v", [("1,5", 2, "0,1", "0,2")], ";")
    with pytest.raises(ValueError, match="--unit px"):
        read_fields(path)
    with pytest.raises(ValueError, match="--up or --down"):
        read_fields(path, unit="px")
    field = read_fields(path, unit="px", up=False)
    assert (field.places.tolist(), field.displacements.tolist()) == ([[1.5, -2]], [[0.1, -0.2]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (DICE.replace("false", "true") + "\n1,2,0,0,0,0,0\n", "fixed pixels"),
        (DICE + "\n", "no rows"),
        (DICE + "\n1,2,0,0,-1,0,0\n", "all points are lost"),
        (DICE + "\n1,2,0,a,0,0,0\n", "line 8: DISPLACEMENT_Y is not a number: 'a'"),
        (DICE + "\n1,2,0,inf,0,0,0\n", "line 8: DISPLACEMENT_Y must be finite"),
        (DICE + "\n1,2,0\n", "line 8: the line has 3 values for 7 columns"),
        ("x1,x2,u1,u2\n1,2,0,0\n", "no column step"),
        ("step,x1,x2,u1,u2,u2\n1,1,2,0,0,0\n", "two columns u2"),
        ("a,b\n1,2\n", "no line names columns"),
    ],
)
def test_a_file_that_is_no_field_is_refused_with_the_cause(text, message, tmp_path):
    path = tmp_path / "field.txt"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_fields(path)


def test_a_direction_that_contradicts_the_program_is_refused(tmp_path):
    with pytest.raises(ValueError, match="counts y downward"):
        read_fields(dice(tmp_path / "a.txt"), up=True)
    assert read_fields(dice(tmp_path / "a.txt"), up=False).lost == 1
    with pytest.raises(ValueError, match="is in px, not in mm"):
        read_fields(dice(tmp_path / "a.txt"), unit="mm")
