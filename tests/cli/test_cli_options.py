"""Options that all commands share, JSON in the place of tables, own laws from a module, and
scenes to start from.
"""

import io
import json
import logging
import os
import re
import subprocess
import sys
import warnings

import pytest
import typer
from commands import commanded, invoke
from refusals import raising
from rich.console import Console
from typer.testing import CliRunner

import pdsurrogate as pds
from pdsurrogate.cli import COMMANDS, app, terminal
from pdsurrogate.cli.command import warnings_as_lines
from pdsurrogate.engine.threads import most_threads, thread_count, threads_for
from pdsurrogate.forces import OutsideDomainWarning
from pdsurrogate.materials import LAWS
from pdsurrogate.progress import event
from pdsurrogate.results import drawings
from pdsurrogate.run.run import Oversubscribed


@pytest.mark.parametrize(
    ("command", "status", "error"),
    [
        ("run nothing", 2, "unknown scene 'nothing'"),
        ("run uniaxial --wizardry", 2, "No such option: --wizardry"),
        ("run", 2, "Missing argument 'SCENE'"),
        ("show nowhere", 2, "not a folder with results of a run"),
        ("evaluate nothing", 2, "nothing"),
        (["wizardry"], 2, "No such command 'wizardry'"),
    ],
)
def test_errors_are_json_where_json_is_asked_for(command, status, error):
    """Standard output was empty, and a program that read it had to guess."""
    done = invoke(command, "--json")
    assert done.exit_code == status
    told = json.loads(done.stdout)
    assert told["exit_status"] == status
    assert error in told["error"]
    assert done.stderr
    assert invoke(command).stdout == ""


def test_a_run_that_fails_says_so_in_its_summary_alone():
    done = commanded("run uniaxial", FAST, "--set solver.most_evaluations=1 --json", status=1)
    assert json.loads(done.stdout)["status"] == "failed"


FAST = "--set spacing=0.1 --set stretches=1.2"

OWN_LAW = '''
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pdsurrogate.materials import InvariantLaw


@dataclass(frozen=True)
class Doubled(InvariantLaw):
    """W = (I1bar - 3)/2."""

    name: ClassVar[str] = "doubled"
    reference: ClassVar[str] = "a test"

    @property
    def parameters(self):
        return np.array([self.bulk_modulus / self.shear_modulus])

    @property
    def shape(self):
        return {}

    @staticmethod
    def isochoric(I1, I2, parameters):
        zero = 0 * I1
        return 0.5 * (I1 - 3), zero + 0.5, zero, zero, zero, zero
'''


@pytest.fixture
def own_law(tmp_path):
    path = tmp_path / "own_laws_of_a_test.py"
    path.write_text(OWN_LAW)
    yield path
    LAWS.pop("doubled", None)
    sys.modules.pop("own_laws_of_a_test", None)


def test_the_version_and_the_completion_of_shells():
    assert invoke("--version").stdout == f"pdsurrogate {pds.__version__}\n"
    assert "--install-completion" in invoke("--help").output
    for typed, meant in (
        ("st", {"study"}),
        ("run --thr", {"--threads"}),
        ("export gent --to f", {"felupe", "febio"}),
    ):
        assert completed(typed) == meant


def completed(typed):
    """What a shell offers after words that were typed, the last of which may be empty."""
    asked = {
        "_PDSURROGATE_COMPLETE": "complete_bash",
        "COMP_WORDS": f"pdsurrogate {typed}",
        "COMP_CWORD": str(1 + typed.count(" ")),
    }
    return set(CliRunner().invoke(app, [], prog_name="pdsurrogate", env=asked).output.split())


def in_a_process(program):
    """Run a program that fails by an assertion, in an environment that says nothing of threads
    of BLAS.
    """
    own = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, env=own)


def test_commands_are_loaded_when_they_are_called():
    group = typer.main.get_command(app)
    for name, (_, text) in COMMANDS.items():
        with group.make_context("pdsurrogate", [name]) as context:
            assert group.resolve_command(context, [name])[1].help == text
    program = (
        "import sys; from pdsurrogate.cli import app; app(['--help'], standalone_mode=False);"
        " assert 'numpy' not in sys.modules"
    )
    in_a_process(program)


def test_a_refused_scene_loads_neither_numba_nor_parts_of_scipy():
    program = (
        "import sys; from pdsurrogate.cli import app\nassert app(['run', 'uniaxial', '--set',"
        " 'spacings=1'], standalone_mode=False) == 2\nslow = {'numba', 'llvmlite', 'scipy.spatial',"
        " 'scipy.sparse', 'scipy.linalg', 'scipy.optimize', 'joblib', 'sklearn'}\nassert not slow &"
        " set(sys.modules)"
    )
    in_a_process(program)


def test_forces_and_solvers_load_parts_of_scipy_where_they_need_them():
    program = (
        "import sys, pdsurrogate.forces, pdsurrogate.solvers, pdsurrogate.run\nslow ="
        " {'scipy.spatial', 'scipy.sparse', 'scipy.linalg', 'scipy.optimize'}\nassert not slow &"
        " set(sys.modules)"
    )
    in_a_process(program)


def test_a_command_ends_without_a_search_for_unused_objects():
    program = (
        "import gc, sys; from pdsurrogate.cli import main\n"
        "sys.argv = ['pdsurrogate', 'materials']\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code\n"
        "assert gc.get_freeze_count() > 10000"
    )
    in_a_process(program)


def test_json_is_all_that_is_printed_for_programs(tmp_path):
    run = commanded("run uniaxial", FAST, "--json --out", tmp_path / "out")
    assert json.loads(run.stdout) == json.loads((tmp_path / "out" / "summary.json").read_text())
    assert {law["law"] for law in json.loads(invoke("materials --json").stdout)} == set(LAWS)
    assert {scene["name"] for scene in json.loads(invoke("scenes --json").stdout)} == set(
        pds.scene_names()
    )
    assert json.loads(invoke("scenes tear --json").stdout)["body"]["size"] == [11.0, 3.0]
    assert "neo-hookean" in {
        entry["name"] for entry in json.loads(invoke("artifacts --json").stdout)
    }
    found = invoke("identify treloar --law gent --json")
    assert set(json.loads(found.stdout)) == {"laws", "held_out"}
    # The next command prints tables again.
    assert "uniaxial" in invoke("scenes").stdout


def test_how_much_is_said(tmp_path, monkeypatch):
    # pictures take most of the time of these runs
    monkeypatch.setattr(drawings, "save_drawings", lambda result, folder: None)
    command = ["run uniaxial", FAST, "--out", tmp_path / "out"]
    assert f"Results in {tmp_path / 'out'}" in invoke(command).stderr.replace("\n", "")
    quiet = invoke(command, "-q")
    assert quiet.stderr == ""
    assert "exact" in quiet.stdout
    told = invoke(command, "-v").stderr
    assert "pdsurrogate.run.simulate: uniaxial with neo-hookean@2: 300 points" in told
    assert "stretch 1.2: equilibrium after" in told
    assert (
        "evaluations, residual"
        not in told.replace("equilibrium after", "").split("ended")[0].split("by")[1]
    )
    assert invoke(command, "-vv").stderr.count("evaluations, residual") > told.count(
        "evaluations, residual"
    )
    assert "equilibrium after" not in invoke(command).stderr


def test_the_package_logs_under_its_own_name(caplog):
    with caplog.at_level(logging.INFO, logger="pdsurrogate"):
        pds.simulate(pds.load_scene("uniaxial", spacing=0.1, stretches=1.2), "neo-hookean")
    assert {record.name for record in caplog.records} == {
        "pdsurrogate.run.simulate",
        "pdsurrogate.run.levels",
    }


@pytest.mark.parametrize("drawn", [True, False])
def test_progress_is_drawn_on_terminals_alone(monkeypatch, drawn):
    file = io.StringIO()
    monkeypatch.setattr(terminal, "err", Console(file=file, force_terminal=drawn, width=100))
    monkeypatch.setattr(terminal.settings, "quiet", False)
    with terminal.Bar("page"):
        event("drawing", 3, 6)
    assert ("drawing" in file.getvalue()) == drawn
    assert drawn or file.getvalue() == ""


def test_a_log_gets_a_line_of_progress_with_the_time_left_every_half_a_minute(monkeypatch):
    """A tear of four minutes in a batch job said nothing until its end."""
    file, now = io.StringIO(), [100.0]
    monkeypatch.setattr(terminal, "err", Console(file=file, force_terminal=False, width=100))
    monkeypatch.setattr(terminal.settings, "quiet", False)
    monkeypatch.setattr(terminal.time, "monotonic", lambda: now[0])
    with terminal.Bar("tear"):
        for seconds in range(63):
            now[0] = 100.0 + seconds
            event(
                "dynamics",
                2 + seconds / 256,
                3,
                stretch=1.1 + seconds / 1000,
                broken_bonds=7 * seconds,
            )
    lines = file.getvalue().splitlines()
    assert [line.split(";")[0] for line in lines] == [
        "tear: dynamics: 71 % done, about 0:03:45 left",
        "tear: dynamics: 75 % done, about 0:03:14 left",
    ]
    assert lines[0].endswith("; 2 of 3, stretch 1.131, broken bonds 217")


def test_laws_of_the_users_own(own_law):
    options = ["--import", own_law]
    assert "doubled" in invoke("materials", options).stdout
    commanded("run uniaxial", FAST, "--set material=doubled --force nosb", options)
    # Given again, it is the same law.
    commanded("materials", options)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "this Python file does not exist"),
        ("x = ", "SyntaxError"),
        ("import nowhere_at_all", "ModuleNotFoundError: No module named 'nowhere_at_all'"),
        ("x = 1", "the file defines no law"),
        (
            OWN_LAW.replace('"doubled"', '"gent"'),
            "a law named 'gent' already exists; give Doubled another name",
        ),
    ],
)
def test_modules_without_laws_are_told_in_one_line(tmp_path, content, message):
    path = tmp_path / f"own_{abs(hash(content))}.py"
    if content is not None:
        path.write_text(content)
    done = invoke("materials --import", path)
    sys.modules.pop(path.stem, None)
    assert done.exit_code == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_scene_to_start_from(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    commanded("new my_scene.toml")
    scene = pds.load_scene("my_scene.toml")
    assert scene.name == "my_scene"
    assert (tmp_path / "my_scene.toml").read_text().count("#") > 15
    commanded("run my_scene.toml --set spacing=0.2 --set steps=0.2 --set probes=[]")
    for name, message in (("my_scene.toml", "choose another name"), ("my_scene", "ends in .toml")):
        again = commanded("new", name, status=2)
        assert message in again.stderr


def test_commands_keep_to_the_threads_that_are_asked_for():
    all_of_them = most_threads()
    with thread_count(1, limit=True):
        assert (most_threads(), threads_for(10**9)) == (1, 1)
        with (
            raising("threads must be between 1 and 1"),
            thread_count(2, limit=True),
        ):
            pass
    assert most_threads() == all_of_them
    done = commanded("run uniaxial --threads 10000", status=2)
    assert "threads must be between" in done.stderr


def test_warnings_are_said_in_one_line_without_the_place_in_the_source(capsys):
    with warnings_as_lines():
        for kind in (Oversubscribed, OutsideDomainWarning, UserWarning):
            warnings.warn(f"of kind [{kind.__name__}]", kind, stacklevel=1)
    told = capsys.readouterr().err.splitlines()
    assert told == [
        f"pdsurrogate: of kind [{name}]"
        for name in ("Oversubscribed", "OutsideDomainWarning", "UserWarning")
    ]


def test_training_says_how_far_it_is(monkeypatch, tmp_path):
    """A minute of training said nothing but that it went on: rate, time left and loss, on
    terminals alone.
    """
    file = io.StringIO()
    monkeypatch.setenv("PDSURROGATE_ARTIFACTS", str(tmp_path))
    monkeypatch.setattr(terminal, "err", Console(file=file, force_terminal=True, width=160))
    done = invoke(
        "fit mine --units 4 --samples 300 --greatest 1.5 --iterations 30 --folds 2",
    )
    assert done.exit_code in (0, 1), done.output
    for words in (
        "fitting",
        "cross-validating",
        "fold 2 of 2",
        r"loss \d\.\d+e-\d+, iterations \d+",
    ):
        assert re.search(words, file.getvalue())


def test_a_run_has_a_collector_of_unused_objects_and_one_thread_of_blas():
    """The collector is off only while the command is loaded; NumPy must be loaded after the
    number of threads is set.
    """
    code = """
import gc, sys
sys.argv = ["pdsurrogate", "run", "--help"]
from pdsurrogate.__main__ import main
try:
    main()
except SystemExit:
    pass
from threadpoolctl import threadpool_info
assert gc.isenabled()
pools = [pool for pool in threadpool_info() if pool["internal_api"] == "openblas"]
assert {pool["num_threads"] for pool in pools} <= {1}
"""
    in_a_process(code)
