"""The command ``data``, and files of machines given to the commands that take tests: the files of
tests/data/machines, from which TRUTH.json says what law is found.
"""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from commands import commanded, invoke
from PIL import Image
from refusals import raising

import pdsurrogate as pds
from pdsurrogate.artifacts.card import IdentificationEntries
from pdsurrogate.artifacts.material import material_on
from pdsurrogate.calibration.field_files import FieldFacts
from pdsurrogate.calibration.measurement_files import measurements
from pdsurrogate.measurements import read_fields
from pdsurrogate.results.measured import field_figure

MACHINES = Path(__file__).parents[1] / "data" / "machines"
TRUTH = json.loads((MACHINES / "TRUTH.json").read_text("utf-8"))
MODE = "--mode uniaxial"
GEOMETRY = f"{MODE} --gauge-length '25 mm' --area 12mm2"
MISSING = {
    "bluehill-raw.csv": GEOMETRY,
    "bluehill-geometry.csv": MODE,
    "bluehill-inch-pound.csv": GEOMETRY,
    "bluehill-chinese.csv": GEOMETRY,
    "decimal-comma.txt": [],
    "semicolons-and-notes.csv": MODE,
    "cycle-in-kN.csv": GEOMETRY,
    "strain-percent.csv": MODE,
    "stretch-stress.csv": f"{MODE} --unit stress=MPa",
    "lambda-P.csv": MODE,
    "stress-first.txt": (f"{MODE} --column nominal-stress=1 --column stretch=2 --unit stress=MPa"),
    "specimens-side-by-side.csv": MODE,
    "abaqus-test-data.inp": "--unit stress=MPa",
    "workbook.xlsx": [],
}


def gent_of(*arguments):
    """Shear modulus and chain limit that a command finds in files of machines."""
    done = commanded("identify", arguments, "--law gent --json")
    report = json.loads(done.stdout)["laws"][0]
    return report["parameters"]["shear_modulus"], report["parameters"]["chain_limit"]


@pytest.mark.parametrize("name", MISSING)
def test_one_command_finds_the_law_in_the_file_of_a_machine(name):
    if name.endswith("xlsx"):
        pytest.importorskip("python_calamine")
    shear_modulus, limit = gent_of(MACHINES / name, MISSING[name])
    assert shear_modulus == pytest.approx(TRUTH[name]["shear_modulus_MPa"], rel=0.01)
    assert limit == pytest.approx(TRUTH[name]["chain_limit"], rel=0.03)


def test_every_file_is_described():
    assert set(MISSING) == set(TRUTH)
    for name, options in MISSING.items():
        if not name.endswith("xlsx"):
            done = commanded("data", MACHINES / name, options)
            assert "Tests: stretch and nominal stress" in done.stdout
            assert "missing" not in done.stderr


def test_a_file_is_described_and_completed_to_a_table(tmp_path):
    file, table = MACHINES / "cycle-in-kN.csv", tmp_path / "tests.csv"
    open_ = commanded("data", file)
    assert "--gauge-length" in open_.stderr
    assert "Displacement  extension  0 to 50" in open_.stdout
    picture = tmp_path / "cycle.png"
    done = commanded("data", file, GEOMETRY, "--plot", picture, "--out", table)
    assert "loading 41" in done.stdout
    assert "missing" not in done.stderr
    heading = [line for line in table.read_text().splitlines() if line.startswith("#")]
    assert hashlib.sha256(file.read_bytes()).hexdigest() in heading[1]
    assert "area 12mm2" in heading[1]
    assert any("40 of unloading" in line for line in heading)
    # Both branches are drawn, in one color and with different lines.
    assert np.asarray(Image.open(picture).convert("RGB")).std() > 5

    with pytest.warns(pds.identification.TestDataWarning, match="hysteresis"):
        read = pds.load_test_data(
            file, mode="uniaxial", gauge_length="25 mm", area="12 mm2", stress_unit="MPa"
        )
    again = pds.load_test_data(table)
    assert again.unit == read.unit == "MPa"
    for name in ("mode", "stretches", "nominal_stress", "weight"):
        assert getattr(again, name).tolist() == getattr(read, name).tolist()
    # The table may be written again; another file is not replaced.
    commanded("data", file, GEOMETRY, "--out", table)
    table.write_text("my notes\n")
    refused = commanded("data", file, GEOMETRY, "--out", table, status=2)
    assert "use another name" in refused.stderr
    assert table.read_text() == "my notes\n"


def test_scatter_of_specimens_and_two_stretches_are_written_too(tmp_path):
    both, table = MACHINES / "specimens-side-by-side.csv", tmp_path / "tests.csv"
    commanded("data", both, MODE, "--out", table)
    with pytest.warns(pds.identification.TestDataWarning):
        read = pds.load_test_data(both, mode="uniaxial")
    again = pds.load_test_data(table)
    assert len({*again.weight.tolist()}) > 1
    assert again.weight.tolist() == read.weight.tolist()
    assert again.nominal_stress.tolist() == read.nominal_stress.tolist()
    grid = tmp_path / "grid.csv"
    grid.write_text(
        "stretch,lateral_stretch,nominal_stress,lateral_stress\n1.5,1.2,0.8,0.5\n2,1,1.2,0.4\n"
    )
    commanded("data", grid, "--out", table)
    assert pds.load_test_data(table).stretches.tolist() == [[1.5, 1.2], [1.2, 1.5], [2, 1], [1, 2]]
    commanded("data", grid, f"{both}:uniaxial", "--unit stress=MPa --out", table, status=2)


def test_json_says_what_the_tables_say():
    told = json.loads(invoke("data", MACHINES / "decimal-comma.txt", "--json").stdout)[0]
    (file,) = told["files"]
    assert file["form"] == "Zwick testXpert"
    assert (file["separator"], file["decimal_sign"]) == ("\t", ",")
    assert file["tables"][0]["states"]["gauge length"] == "25 mm"
    assert told["specimens"][0]["stretch"] == pytest.approx([1, 4])
    assert {row["column"]: row["quantity"] for row in told["columns"]}["Dehnung"] == (
        "engineering-strain"
    )


def test_several_files_and_a_campaign_are_one_data_set(tmp_path):
    uniaxial, shear = tmp_path / "ut.csv", tmp_path / "ps.csv"
    stretch = np.linspace(1.1, 3.0, 15)
    for path, power in ((uniaxial, -2.0), (shear, -3.0)):
        stress = 0.5 * (stretch - stretch**power)  # neo-Hooke's law, incompressible
        rows = zip(stretch - 1, stress, strict=True)
        path.write_text(
            "Engineering strain,Engineering stress (MPa)\n"
            + "".join(f"{strain:.6f},{one:.6f}\n" for strain, one in rows)
        )
    campaign = tmp_path / "tests.toml"
    campaign.write_text(
        'stress_unit = "kPa"\n[[test]]\nfile = "ut.csv"\nmode = "uniaxial"\n'
        '[[test]]\nfile = "ps.csv"\nmode = "pure-shear"\nunit = { stress = "MPa" }\n'
    )
    for given, expected in (
        ([f"{uniaxial}:uniaxial", f"{shear}:pure-shear"], 0.5),
        ([uniaxial, f"{shear}:pure-shear", MODE], 0.5),  # what a file's own suffix says counts
        ([campaign], 500.0),
    ):
        done = commanded("identify", given, "--law neo-hookean --bulk-ratio 1000000.0 --json")
        report = json.loads(done.stdout)["laws"][0]
        assert set(report["r_squared"]) == {"uniaxial", "pure-shear"}
        assert report["parameters"]["shear_modulus"] == pytest.approx(expected, rel=1e-4)
        assert report["stress_unit"] == ("kPa" if expected > 1 else "MPa")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("bluehill-raw.csv", "the gauge length: --gauge-length '25 mm'"),
        ("bluehill-raw.csv:uniaxal", "unknown mode 'uniaxal'; did you mean uniaxial?"),
        ("bluehill-raw.csv --column force", "column: must have the form QUANTITY=NAME"),
        (f"bluehill-raw.csv {MODE} --area 12", "must be a number with its unit"),
        (f"bluehill-raw.csv {GEOMETRY} --column force=Kraft", "there is no column Kraft"),
        (f"tests.toml {MODE}", "write what --mode states into this file"),
        ("wrong.toml", "test.0.guage_length: unknown key; did you mean gauge_length?"),
        ("none.toml", "test: this key is missing"),
    ],
)
def test_what_is_wrong_is_said_with_the_remedy(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("bluehill-raw.csv",):
        (tmp_path / name).write_bytes((MACHINES / name).read_bytes())
    (tmp_path / "tests.toml").write_text('[[test]]\nfile = "bluehill-raw.csv"\n')
    (tmp_path / "wrong.toml").write_text('[[test]]\nfile = "a.csv"\nguage_length = "25 mm"\n')
    (tmp_path / "none.toml").write_text('mode = "uniaxial"\n')
    done = commanded("identify", arguments, "--law gent", status=2)
    assert message in " ".join(done.stderr.split())


def test_the_state_at_break_is_printed_and_stored(tmp_path):
    """Three specimens of 2 (l - 1) MPa break at 2.0, 2.2 and 2.4: stress 2, 2.4 and 2.8 MPa, work
    the stretch minus 1 squared.
    """
    files = []
    for number, most in enumerate((2.0, 2.2, 2.4)):
        stretch = np.append(np.linspace(1, most, 41), most + 0.05)
        stress = np.append(2 * (stretch[:-1] - 1), 0.01)
        files.append(tmp_path / f"{number}.csv")
        rows = zip(stretch, stress, strict=True)
        files[-1].write_text(
            "Stretch,Nominal stress (MPa)\n" + "".join(f"{a:.5f},{b:.5f}\n" for a, b in rows)
        )
    found = commanded("identify", files, MODE, "--law neo-hookean")
    assert "2.2 ± 0.2" in found.stdout
    done = invoke("identify", files, MODE, "--law neo-hookean --json")
    report = json.loads(done.stdout)["laws"][0]
    entries = {"data": report["data"], "law": report["law"], "at_break": report["at_break"]}
    (broken,) = IdentificationEntries(**entries).at_break.values()
    assert broken.specimens == 3
    assert broken.stretch == pytest.approx([2.2, 0.2], rel=1e-3)
    assert broken.nominal_stress == pytest.approx([2.4, 0.4], rel=1e-3)
    work = np.array([1.0, 1.2, 1.4]) ** 2
    assert broken.work == pytest.approx([work.mean(), work.std(ddof=1)], rel=1e-3)


@pytest.mark.slow  # a surrogate, and tests simulated with it
def test_a_card_has_the_unit_and_the_break_of_its_tests(tmp_path):
    stretch = np.append(np.linspace(1, 2, 41), 2.05)
    stress = np.append(2 * (stretch[:-1] - 1), 0.01)
    rows = zip(stretch, stress, strict=True)
    file = tmp_path / "0.csv"
    file.write_text(
        "Stretch,Nominal stress (MPa)\n" + "".join(f"{a:.5f},{b:.5f}\n" for a, b in rows)
    )
    commanded(
        "fit torn --data",
        f"{file}:uniaxial",
        "--degree 2,2 --samples 200 --folds 0 --out",
        tmp_path / "artifacts",
    )
    card = pds.load_card(tmp_path / "artifacts" / "torn" / "1")
    broken = card.training["identification"]["at_break"]["uniaxial"]
    assert broken["specimens"] == 1
    assert broken["nominal_stress"] == [pytest.approx(2.0), None]
    # The moduli, in MPa, are converted for a scene in kPa.
    scene = pds.load_scene("uniaxial")
    law = material_on(card, scene)
    moduli = card.material.trained_with["shear_modulus"]
    assert law.shear_modulus == pytest.approx(1000 * moduli)


def test_a_machines_forces_are_those_of_the_steps(tmp_path):
    """60 N on a sheet of 2 mm and in a scene of kPa and cm are 30 N/mm, or 3000 kPa cm."""
    scene = pds.load_scene("uniaxial", stretches=[1.1, 1.2, 1.3])
    file = tmp_path / "machine.csv"
    file.write_text("Time (s),Load (N)\n0,0\n10,20\n20,40\n30,60\n")
    of_camera = FieldFacts(), None
    X, y, outputs, _ = measurements(
        scene, None, file, {"thickness": "2 mm"}, "10,15,30", *of_camera
    )
    assert X[:, 0].tolist() == [1, 2, 3]
    assert y == pytest.approx([1000.0, 1500.0, 3000.0])
    assert outputs == {"force": "force"}
    timed = pds.load_scene(
        "uniaxial", {"units.time": "min"}, stretches=[1.1, 1.2, 1.3], times=[1 / 6, 0.25, 0.5]
    )
    of_scene = measurements(timed, None, file, {"thickness": "2 mm"}, None, *of_camera)
    assert of_scene[1] == pytest.approx(y)
    rows = tmp_path / "rows.csv"
    rows.write_text("Load (kN),Extension (mm)\n0.02,1\n0.04,2\n0.06,3\n")
    y = measurements(scene, None, rows, {"thickness": "2mm"}, None, *of_camera)[1]
    assert y == pytest.approx([1000.0, 2000.0, 3000.0])
    for path, stated, times, message in (
        (file, {"thickness": "2 mm"}, None, "4 rows for 3 steps of uniaxial"),
        (file, {"thickness": "2 mm"}, "1,2,40", "contain those of the steps"),
        (file, {"thickness": "2 mm"}, "1,2", "2 times for 3 steps"),
        (rows, {}, None, "state it, as --thickness 2mm"),
        (rows, {"thickness": "2 mm"}, "1,2,3", "there is no column of time"),
    ):
        with raising(message):
            measurements(scene, None, path, stated, times, *of_camera)
    with raising("--thickness is for --forces with the table of a machine"):
        measurements(scene, tmp_path / "F.csv", None, {"thickness": "2 mm"}, None, *of_camera)


def test_a_folder_with_one_file_of_a_scene_stands_for_this_file(tmp_path):
    scene = pds.load_scene("uniaxial", stretches=[1.1])
    (tmp_path / "F.csv").write_text("step,x1,x2,u1,u2\n1,0,0,0,0.1\n")
    X, y, *_ = measurements(scene, [tmp_path], None, {}, None, FieldFacts(), None)
    assert (X.tolist(), y.tolist()) == ([[1, 1, 0, 0], [1, 2, 0, 0]], [0, 0.1])


def test_fields_and_meshes_are_described_and_drawn(tmp_path):
    field = tmp_path / "F.csv"
    rows = [f"{k},{x},{y},{0.1 * k * x},0" for k in (1, 2) for x in range(5) for y in range(3)]
    field.write_text("step,x1,x2,u1,u2\n" + "\n".join(rows) + "\n")
    mesh = tmp_path / "part.inp"
    mesh.write_text(
        "*NODE\n1,0,0\n2,1,0\n3,1,1\n4,0,1\n5,2,0\n6,2,1\n*ELEMENT,TYPE=CPS4,ELSET=SOFT\n"
        "1,1,2,3,4\n*ELEMENT,TYPE=CPS4,ELSET=STIFF\n2,2,5,6,3\n"
    )
    done = commanded("data", field, mesh, "--plot", tmp_path / "drawn", "--json")
    first, second = json.loads(done.stdout)
    assert {first["kind"], second["kind"]} == {"field", "mesh"}
    seen = {one["kind"]: one for one in (first, second)}
    assert seen["field"]["x1"] == [0.0, 4.0]
    assert [row["greatest"] for row in seen["field"]["images"]] == pytest.approx([0.4, 0.8])
    assert {row["group"]: row["cells"] for row in seen["mesh"]["groups"]} == {
        "SOFT": 1,
        "STIFF": 1,
    }
    assert {path.name for path in (tmp_path / "drawn").iterdir()} == {"F.png", "part.png"}
    axes = field_figure(read_fields(field)).axes  # the file does not state the unit of the scene
    assert [axes[0].get_xlabel(), axes[0].get_ylabel()] == ["x₁", "x₂"]
    assert axes[-1].get_ylabel() == "displacement"
    refused = invoke("data", field, mesh, "--plot", tmp_path / "one.png")
    assert "there are 2 pictures" in refused.stderr
    assert "--mode is for tables of tests" in invoke("data", field, MODE).stderr
