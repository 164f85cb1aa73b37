"""The command line: words, files and exit statuses."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from commands import commanded, invoke, words_of
from conftest import SHIPPED, sealed
from numba.core.caching import _CacheLocator
from refusals import refused
from typer.testing import CliRunner

import pdsurrogate as pds
from pdsurrogate.cli import COMMANDS, app, terminal

FAST = "--set spacing=0.1 --set stretches=1.2"


def test_run_writes_results_and_a_table(tmp_path):
    done = commanded("run uniaxial", FAST, "--out", tmp_path / "out")
    assert "exact" in done.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["converged"] is True
    assert abs(summary["levels"][0]["nominal_stress_error"]) < 5e-4


@pytest.mark.parametrize(
    "force",
    [
        "analytic",
        "nosb",
        "ba-nosb",
        "neo-hookean",
        "neo-hookean@1",
        "neo-hookean-paper",
        SHIPPED / "neo-hookean" / "1",
    ],
)
def test_forces_by_every_kind_of_reference(force):
    commanded("run uniaxial", FAST, "--force", force)


def test_the_cells_taken_are_told_where_the_spacing_does_not_divide():
    done = commanded("run uniaxial --set spacing=0.12 --set stretches=1.2 --force analytic")
    assert "The cells measure 0.12 x 0.125 cm; the horizon is 0.378 cm" in " ".join(
        done.stdout.split()
    )
    assert "The cells measure" not in invoke("run uniaxial", FAST, "--force analytic").stdout


@refused("commands")
def test_bad_input_is_one_clear_line_and_status_2(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = commanded(arguments, status=2)
    error = done.stderr.strip()
    assert message in error
    assert len([line for line in error.splitlines() if "Compiling" not in line]) == 1
    assert "Traceback" not in done.output


def test_a_run_takes_the_same_force_beside_its_own_output(tmp_path, monkeypatch):
    """``pdsurrogate run pure-shear --out neo-hookean`` twice in one folder: the second run took
    the analytic force.
    """
    monkeypatch.chdir(tmp_path)
    (tmp_path / "neo-hookean").mkdir()
    (tmp_path / "neo-hookean" / "summary.json").write_text("{}")
    done = invoke("run uniaxial", FAST)
    assert "force neo-hookean@2" in done.output


def test_a_bound_left_out_is_as_far_as_the_law_goes(tmp_path):
    options = [
        "--law gent --set chain_limit=20 --samples 300 --folds 0 --degree 6 --out",
        tmp_path,
    ]
    done = commanded("fit x", options, "--least 0.6")
    assert "stretches 0.6 to 2.89" in " ".join(done.output.split())


def test_data_that_no_law_describes_make_no_artifact(tmp_path):
    data = tmp_path / "negative.csv"
    data.write_text(
        "mode,stretch,nominal_stress\n"
        + "".join(f"uniaxial,{1 + k / 10},{-k}\n" for k in range(1, 9))
    )
    done = commanded("fit x --data", data, "--law gent --out", tmp_path / "a", status=2)
    words = " ".join(done.stderr.split())
    assert "all stresses are against their strains, which are of tension" in words
    data.write_text("mode,stretch,nominal_stress\nuniaxial,1.5,0\nuniaxial,2,0\n")
    done = commanded("identify", data, "--law gent", status=2)
    assert "the stresses of mode uniaxial are all zero" in done.stderr


@pytest.mark.parametrize("width", [60, 80])
def test_tables_cut_nothing_off(width, monkeypatch):
    """In a terminal of 80 columns figures were cut (``384.793…``)."""
    monkeypatch.setattr(terminal.out, "width", width)
    figures = ["-384.79312", "1234567.12345", "+0.00012", "6.02214e+23"]
    titles = [
        "stretch",
        "greatest lateral (cm) [kPa]",
        "error (%)",
        "a sentence of many words that may break",
    ]
    with terminal.out.capture() as captured:
        terminal.print_table("figures", titles, [figures, figures], left=1)
    for figure in figures:
        assert captured.get().count(figure) == 2
    assert captured.get().count("[kPa]") == 1
    assert "…" not in captured.get()
    assert max(map(len, captured.get().splitlines())) <= width
    with terminal.out.capture() as captured:
        terminal.print_table("words", ["what it is"], [["many words " * 30]], left=1)
    assert max(map(len, captured.get().splitlines())) <= width
    assert captured.get().count("many") == 30
    name = "second_logarithm"
    rows = [[name, name, "several words " * 9, "others"]]
    with terminal.out.capture() as captured:
        terminal.print_table("names", ["one", "other", "what it is", "what else"], rows, left=4)
    assert max(map(len, captured.get().splitlines())) <= width
    assert captured.get().count(name) == 2
    assert captured.get().count("several") == 9


@pytest.mark.parametrize(
    "command",
    [
        # as `hole` and `tear`, with a reference
        "run pure-shear --set spacing=0.2 --force analytic",
        "run ring-pressure --set spacing=0.2 --force analytic",
        "run inflation --set spacing=0.2 --set steps=0.1 --force bond-energy",
        "scenes",
        "scenes tear",
        "materials",
        "artifacts",
        "identify treloar --law gent --law yeoh --hold-out",
        "evaluate analytic --samples 200",
        "evaluate neo-hookean-energy --samples 200",
        *(f"{name} -h" for name in ("", *COMMANDS)),
    ],
)
def test_no_line_is_longer_than_80_characters(command):
    done = CliRunner().invoke(app, command.split(), env={"COLUMNS": "80"})
    assert done.exit_code == 0, done.output
    assert "…" not in done.stdout
    assert [line for line in done.stdout.splitlines() if len(line) > 80] == []


def test_what_is_turned_shows_its_moments():
    table = invoke("run disc-torsion --set spacing=0.1 --set steps=0.5 --force analytic").stdout
    assert "Moments about the origin (kPa·cm²)" in table
    assert re.search(r"outline +0\.5 +0 +0\n", table)


def test_output_that_cannot_be_written_is_refused_before_work(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    done = commanded("run uniaxial", FAST, "--out", blocked / "out", status=2)
    assert "ns per directed bond" not in done.output


def test_a_folder_belongs_to_one_scene(tmp_path):
    """The same command works twice; another scene is refused before any work, unless asked to
    replace.
    """
    command = ["run uniaxial", FAST, "--force analytic --out", tmp_path]
    for _ in range(2):
        commanded(command)
    other = ["run gent", FAST, "--force analytic --out", tmp_path]
    done = commanded(other, status=2)
    assert (
        "contains the results of another run of uniaxial (name is uniaxial there and gent here"
        in done.stderr
    )
    assert "ns per directed bond" not in done.output
    commanded(other, "--overwrite")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *(
            "checkpoint.npz",
            "convergence.csv",
            "gent-000.vtu",
            "gent.png",
            "gent.pvd",
            "history.csv",
            "summary.json",
        ),
    ]


def test_unlike_cross_sections_are_told(tmp_path):
    """An L reported the force over the width of its bounding box as its stress, without a word."""
    grips = "grips=[{edge='bottom'},{edge='top',travel=1.0}]"
    body = "body={shape='polygon',vertices=[[0,0],[3,0],[3,1],[1,1],[1,3],[0,3]]}"
    done = commanded("run pure-shear", FAST, "--force analytic --set", body, "--set", grips)
    assert "force of the top grip divided by its cross-section of 1 cm" in " ".join(
        done.output.split()
    )
    assert "cross-section" not in invoke("run pure-shear", FAST, "--force analytic").output


def test_failed_runs_say_so_and_save_what_they_reached(tmp_path):
    done = commanded(
        "run uniaxial --set spacing=0.1 --set solver.most_evaluations=5 --out",
        tmp_path / "out",
        status=1,
    )
    assert "the run failed: stretch" in done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["converged"] is False
    assert summary["failure"]


def test_fit_evaluate_and_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fitted = commanded(
        "fit mine --samples 1500 --units 10 --iterations 80 --folds 2 --greatest 2",
    )
    assert "Fold 1" in fitted.output
    again = commanded("fit mine --version 1 --samples 1500", status=2)
    assert "already exists" in again.stderr
    report = commanded("evaluate mine --samples 500 --json")
    assert json.loads(report.stdout)["on_surface"]["rms"] < 5e-3
    assert "least slope" in invoke("evaluate mine@1 --samples 500").output
    assert "mine@1" in invoke("artifacts").output
    assert json.loads(invoke("artifacts mine").stdout)["name"] == "mine"
    commanded("run uniaxial", FAST, "--force mine")


def test_materials_are_listed_with_their_parameters():
    text = invoke("materials").output
    for word in (
        "gent",
        "chain_limit",
        "ogden",
        "exponents",
        "full-network",
        "chain_links",
        "Yeoh 1993",
    ):
        assert word in text


def test_from_test_data_to_a_simulation(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = tmp_path / "tests.csv"
    rows = [
        f"uniaxial,{stretch},{0.4 * (stretch - stretch**-2)}"
        for stretch in (1.2, 1.6, 2.0, 2.5, 3.0)
    ]
    data.write_text("\n".join(["mode,stretch,nominal_stress", *rows]) + "\n")
    commanded(
        "identify",
        data,
        "--law mooney-rivlin --law gent --up-to 2.6 --bulk-ratio 1000000.0 --out",
        tmp_path / "found",
    )
    laws = json.loads((tmp_path / "found" / "identify.json").read_text())["laws"]
    assert laws[0]["rows"] == 4
    assert laws[0]["parameters"]["shear_modulus"] == pytest.approx(0.4, rel=1e-3)
    assert (tmp_path / "found" / "identify.png").stat().st_size > 5000
    # A report is not replaced unasked.
    other = commanded(
        "identify",
        data,
        "--law gent --bulk-ratio 1000000.0 --out",
        tmp_path / "found",
        status=2,
    )
    assert "identify.json exists: use another folder, or --overwrite" in other.stderr
    commanded(
        "fit measured --data",
        data,
        "--law mooney-rivlin --bulk-ratio 10000.0 --samples 2000 --folds 2",
    )
    card = json.loads(invoke("artifacts measured").stdout)
    assert card["training"]["identification"]["parameters"]["shear_modulus"] == pytest.approx(
        0.4, rel=1e-3
    )
    law = card["material"]["trained_with"]
    parameters = [
        f"material.{key}={law[key]}" for key in ("shear_modulus", "bulk_modulus", "second_share")
    ]
    changes = [
        item for change in ("material=mooney-rivlin", *parameters) for item in ("--set", change)
    ]
    commanded("run uniaxial", FAST, changes, "--force measured")


def test_bad_identifications_exit_with_2(tmp_path):
    for arguments, message in (
        ("identify treloar --up-to 0.5", "all rows have stretches above 0.5"),
        ("identify kawabata --law gent --hold-out", "no mode can be held out"),
        (
            "fit x --data treloar --law gent --set chain_limit=3",
            "choose one",
        ),
        ("fit x --degree high", "degree must be whole numbers"),
        ("fit x --data treloar --free --law gent", "choose one"),
        ("fit x --terms 2", "--terms"),
        ("identify treloar --law gent --terms 2", "--terms"),
        (["scenes uniaxial --out", tmp_path], "--plot"),
    ):
        done = commanded(arguments, status=2)
        assert message in done.stderr


def test_lists():
    assert "uniaxial" in invoke("scenes").output
    assert {"neo-hookean@1", "neo-hookean@2"} <= set(invoke("artifacts").output.split())
    usage = invoke("evaluate --help").output
    assert "analytic, bond-energy, or an artifact" in " ".join(usage.replace("│", " ").split())
    assert "nosb" not in usage  # which has nothing to evaluate


def test_a_second_run_compiles_nothing(tmp_path):
    """In a cache that lacks one kernel of NOSB: to compile all takes ten seconds."""
    commanded("run uniaxial --force nosb", FAST)
    for path in Path(pds.__file__).parent.glob("*/__pycache__/*.nb?"):
        if not path.name.startswith("nosb_forces"):
            place = (
                tmp_path
                / "cache"
                / _CacheLocator.get_suitable_cache_subpath(str(path.parents[1] / "module.py"))
            )
            place.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, place)
    first, second = (
        run_compiling(tmp_path, "nosb", {"NUMBA_CACHE_DIR": str(tmp_path / "cache")})
        for _ in range(2)
    )
    assert first["announced"]
    assert first["seconds"] > 0
    assert second == {"announced": False, "seconds": 0}


@pytest.mark.slow
def test_a_second_run_of_a_learned_force_compiles_nothing(tmp_path):
    """In the cache that all tests share: what a network or polynomial is made of takes forty
    seconds to compile.
    """
    run_compiling(tmp_path, "neo-hookean", {})
    assert run_compiling(tmp_path, "neo-hookean", {}) == {"announced": False, "seconds": 0}


def run_compiling(folder, force, environment):
    """Whether a run says that it compiles, and the seconds that it counts for that."""
    command = "-m pdsurrogate run uniaxial --force", force, FAST, "--out", folder / "out"
    done = subprocess.run(
        [sys.executable, *words_of(command)],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    seconds = json.loads((folder / "out" / "summary.json").read_text())["seconds_compile"]
    return {"announced": "Compiling kernels" in done.stderr, "seconds": seconds}


def test_an_identification_that_failed_says_so(tmp_path):
    (tmp_path / "falling.csv").write_text(
        "mode,stretch,nominal_stress\nuniaxial,1.2,3\nuniaxial,1.5,2.8\nuniaxial,2.0,2.5\n"
    )
    output = " ".join(invoke("identify", tmp_path / "falling.csv", "--law gent").output.split())
    assert "chain_limit reached a bound of the search range" in output
    assert "gent describes uniaxial worse than the mean stress does (R^2 below 0)" in output


def test_a_surrogate_of_no_use_is_not_written(tmp_path):
    result = commanded(
        "fit poor --law ogden --degree 0 --samples 200 --folds 0 --out",
        tmp_path,
        status=1,
    )
    assert "poor@1 has an RMS error of" in result.output
    assert not (tmp_path / "poor").exists()


def test_a_run_says_what_error_a_card_states(tmp_path):
    poor = shutil.copytree(SHIPPED / "neo-hookean" / "1", tmp_path / "poor" / "1")
    card = json.loads((poor / "card.json").read_text())
    card["errors"]["box"]["on_surface"] = {"rms": 0.03, "max": 0.3}
    (poor / "card.json").write_text(sealed(card))
    for force, said in ((poor, True), (SHIPPED / "neo-hookean" / "1", False)):
        output = " ".join(invoke("run uniaxial", FAST, "--force", force).output.split())
        assert ("has an RMS error of 3 %" in output) == said


def test_contact_with_obstacles_is_printed_with_its_area_and_penetration(tmp_path):
    (tmp_path / "pressed.toml").write_text("""
        name = "pressed"
        spacing = 0.25
        steps = [1.0]
        body = {shape = "rectangle", size = [1.0, 1.0]}
        units = {length = "mm", stress = "MPa"}
        material = {law = "neo-hookean", shear_modulus = 1.0}
        prescribed = [{region = "bottom", x1 = 0.0, x2 = 0.0}]
        [[obstacles]]
        name = "plate"
        half_plane = {point = [0.0, 1.0], normal = [0.0, 1.0]}
        x2 = -0.1
    """)
    done = commanded(
        "run", tmp_path / "pressed.toml", "--force bond-energy --out", tmp_path / "out"
    )
    contact = json.loads((tmp_path / "out" / "summary.json").read_text())["levels"][0]["contact"][
        "plate"
    ]
    headings, _, row = done.stdout.split("Contact with obstacles")[1].splitlines()[1:4]
    assert " ".join(headings.split()) == "name t area (mm) penetration (mm)"
    *words, penetration = row.split()
    assert words == ["plate", "1", f"{contact['area']:.5g}"]
    assert float(penetration) == pytest.approx(contact["penetration"], abs=1e-5)
