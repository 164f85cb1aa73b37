"""Results in the forms of those who measure: pixels of an image, the table of a machine."""

import dataclasses

import numpy as np
import pytest
from commands import invoke
from refusals import raising, refused

import pdsurrogate as pds
from pdsurrogate.cli.exchange import write_machine
from pdsurrogate.measurements import read_fields, read_tables
from pdsurrogate.scenes import Units


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    folder = tmp_path_factory.mktemp("block") / "out"
    scene = pds.load_scene(
        "bonded-block", spacing=0.25, stretches=[1.1], units={"length": "mm", "stress": "kPa"}
    )
    pds.simulate(scene, "bond-energy").save(folder)
    return folder


def show(folder, *arguments):
    return invoke("show", folder, *arguments)


def test_fields_lie_on_the_pixels_of_an_image(folder, tmp_path):
    place = "--pixels-per mm 2 --origin 10 30"
    done = show(folder, "--grid", tmp_path / "image.npz", place, "--field", "stress_11")
    assert done.exit_code == 0, done.output
    image = dict(np.load(tmp_path / "image.npz"))
    # 20 pixels per cm: the sheet has columns 10 to 70 and rows 30 up to 10.
    assert image["x"].tolist() == list(range(71))
    assert image["y"].tolist() == list(range(31))
    assert image["u"].shape == image["stress_11"].shape == (2, 31, 71)
    inside = np.isfinite(image["u"])
    assert inside[:, 10:31, 10:71].all()
    assert inside.sum() == 2 * 21 * 61
    result = pds.load_result(folder)
    for state, stretch in enumerate((1.2, 1.5)):
        lateral = 2 * result.levels[state]["greatest_lateral_displacement_reference"]
        u = (stretch - 1) * (image["x"] - 10.0)
        # The lower half moves up, which is a negative v: rows count down.
        v = -lateral * (image["y"] - 20.0)
        np.testing.assert_allclose(image["u"][state, 20, 10:], u[10:], atol=1e-3)
        np.testing.assert_allclose(image["v"][state, 10:, 40], v[10:], atol=1e-3)
    assert np.nanmean(image["stress_11"][1]) == pytest.approx(
        result.levels[1]["nominal_stress_reference"], rel=1e-4
    )
    # The table has the same numbers, and the reader of such tables takes it.
    assert show(folder, "--grid", tmp_path / "image.csv", place).exit_code == 0
    field = read_fields(tmp_path / "image.csv", up=False)
    assert field.unit == "px"
    assert len(field.step) == 2 * 21 * 61
    x, y = field.places.T.astype(int)
    np.testing.assert_allclose(field.displacements[:, 0], image["u"][field.step - 1, -y, x])
    np.testing.assert_allclose(field.displacements[:, 1], -image["v"][field.step - 1, -y, x])


def test_a_hole_has_no_values(tmp_path):
    scene = pds.load_scene("hole", spacing=0.2, stretches=[1.1])
    pds.simulate(scene, "bond-energy").save(tmp_path / "out")
    place = "--pixels-per cm 20 --origin 40 50"
    assert show(tmp_path / "out", "--grid", tmp_path / "image.npz", place).exit_code == 0
    inside = np.isfinite(np.load(tmp_path / "image.npz")["u"][0])
    assert not inside[50, 40]  # the middle of the hole, which is the origin
    assert inside[50, 40 + 29]
    # The sheet of 3 x 4 cm without its hole of radius 0.4, but for cells at the edge of the hole.
    assert inside.sum() == pytest.approx(61 * 81 - np.pi * 8**2, rel=0.02)


def test_the_history_is_that_of_a_machine(folder, block, tmp_path):
    done = show(folder, "--machine", tmp_path / "test.csv", "--thickness", "2mm")
    assert done.exit_code == 0, done.output
    (table,) = read_tables(tmp_path / "test.csv").blocks
    assert [(one.quantities, one.unit) for one in table.columns] == [
        (("extension",), "mm"),
        (("force",), "N"),
    ]
    extension, load = (one.values for one in table.columns)
    np.testing.assert_allclose(extension, [0, 6, 15], atol=1e-6)  # of 30 mm
    # kPa on 1 cm x 2 mm
    stresses = [level["nominal_stress"] for level in pds.load_result(folder).levels]
    np.testing.assert_allclose(load, [0, *np.array(stresses) * 1e3 * 0.01 * 0.002], rtol=1e-9)
    done = show(block, "--machine", tmp_path / "block.csv")
    assert done.exit_code == 0, done.output
    extension, load = (one.values for one in read_tables(tmp_path / "block.csv").blocks[0].columns)
    np.testing.assert_allclose(extension, [0, 0.1], atol=1e-6)
    (level,) = pds.load_result(block).levels
    assert load[1] == pytest.approx(level["nominal_stress"] * 1e3 * 1e-6, rel=1e-6)


def test_a_machine_has_the_time_of_dynamics(folder, tmp_path):
    result = pds.load_result(folder)
    rows = [{**row, "time": 0.5 * number} for number, row in enumerate(result.history, 1)]
    scene = result.scene.model_copy(update={"units": Units(length="mm", stress="MPa", time="ms")})
    timed = dataclasses.replace(result, history=rows, scene=scene)
    write_machine(tmp_path / "test.csv", timed, "3 mm")
    time, extension, load = (
        one.values for one in read_tables(tmp_path / "test.csv").blocks[0].columns
    )
    np.testing.assert_allclose(time, [0, 0.5e-3, 1e-3])
    np.testing.assert_allclose(extension, [0, 0.6, 1.5], atol=1e-6)
    np.testing.assert_allclose(load[1:], [3 * row["force_right_1"] for row in rows])  # MPa mm^2
    scene = scene.model_copy(update={"units": Units(length="mm", stress="MPa")})
    with raising("does not name its unit of time"):
        write_machine(tmp_path / "no.csv", dataclasses.replace(timed, scene=scene), "3 mm")
    without = [{"time": 1.0, "stretch": 1.2}]
    with raising("the history of the run has no displacement_right_1"):
        write_machine(tmp_path / "no.csv", dataclasses.replace(timed, history=without), "3 mm")


@refused("exchanges")
def test_what_cannot_be_written_is_told_in_one_line(
    folder, tmp_path, monkeypatch, arguments, message
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.csv").write_text("mine")
    done = show(folder, arguments)
    assert done.exit_code == 2, done.output
    assert message in done.stderr
    assert "Traceback" not in done.output
    assert [path.name for path in tmp_path.iterdir()] == ["mine.csv"]
    assert (tmp_path / "mine.csv").read_text() == "mine"


def test_a_solid_has_neither_pixels_nor_thickness(block, tmp_path):
    place = "--pixels-per mm 9 --origin 0 9"
    done = show(block, "--grid", tmp_path / "i.npz", place)
    assert (done.exit_code, "a solid has no field on the pixels" in done.stderr) == (2, True)
    done = show(block, "--machine", tmp_path / "m.csv", "--thickness", "2mm")
    assert (done.exit_code, "a solid has none" in done.stderr) == (2, True)
