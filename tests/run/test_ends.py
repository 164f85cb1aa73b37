"""Runs that end before their time: killed, interrupted, or out of time; what they leave, and how
it goes on.
"""

import csv
import json
import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from commands import commanded, words_of
from refusals import raising
from stopping import Killed, at_level, interrupt

import pdsurrogate as pds
from pdsurrogate.progress import listening
from pdsurrogate.results import tables
from pdsurrogate.results.checkpoint import CheckpointError
from pdsurrogate.results.files import TEMPORARY
from pdsurrogate.results.folder import FolderTaken
from pdsurrogate.run import checkpoints
from pdsurrogate.run.simulate import SimulationInterrupted, simulate

PATIENCE = 300
"""Seconds for what takes some on a free machine."""

SLOWLY = """
import sys, time
from pdsurrogate.run.run import Run
from pdsurrogate.cli import main

record = Run.record
def slow(run, *rest):
    record(run, *rest)
    time.sleep(0.3)  # so that the run is there for a while after every output
Run.record = slow
sys.argv = ["pdsurrogate", *sys.argv[1:]]
main()
"""
"""A run that is not over before it is looked at."""

HELD_UP = """
import hashlib, sys, time
from pdsurrogate.solvers import methods
from pdsurrogate.cli import main

how, *arguments = sys.argv[1:]
def never(*rest):
    print("held up", flush=True)
    while True:
        # In a call of C that hears of no signal, and in Python.
        hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1) if how == "C" else time.sleep(600)
methods.QuasiNewton.preconditioner = never
sys.argv = ["pdsurrogate", *arguments]
main()
"""
"""The set-up of a preconditioner that takes for ever."""

HELD_UP_WRITING = """
import sys, time, zipfile
import numpy as np
from matplotlib.figure import Figure
from pdsurrogate.cli import main

what, *arguments = sys.argv[1:]
def never(*rest, **options):
    print("held up", flush=True)
    while True:
        time.sleep(0.01)
def half_an_archive(file, **arrays):
    with zipfile.ZipFile(file, "w") as archive:
        member = archive.open("member", "w")  # which is still open when the archive is closed
        member.write(b"half")
        never()
if what == "checkpoint":
    np.savez = half_an_archive
elif what == "picture":
    Figure.savefig = never
sys.argv = ["pdsurrogate", *arguments]
main()
"""
"""A file that takes for ever to be written."""

SHEET = "--force analytic --set spacing=0.25"


def begun(program, *arguments, **options):
    command = [sys.executable, "-c", program, *words_of(arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **options
    )


def wait(condition, process):
    until = time.monotonic() + PATIENCE
    while not condition():
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < until
        time.sleep(0.02)


def told(folder):
    """What the summary says, which is written after the history."""
    path = folder / "summary.json"
    return json.loads(path.read_text()) if path.exists() else {"levels": [], "n_steps": 0}


STRETCHES = [round(1.1 + 0.01 * number, 2) for number in range(80)]


def test_a_run_that_is_killed_leaves_its_history_and_goes_on(tmp_path):
    """It left neither a history nor a summary, and nothing could be plotted."""
    change = f"--set 'stretches={STRETCHES}'"
    process = begun(SLOWLY, "run uniaxial", SHEET, change, "--out", tmp_path)
    wait(lambda: len(told(tmp_path)["levels"]) > 1, process)
    process.kill()
    process.communicate(timeout=PATIENCE)
    read, rows = (
        pds.load_result(tmp_path),
        len(list(csv.DictReader((tmp_path / "history.csv").read_text().splitlines()))),
    )
    assert told(tmp_path)["status"] == read.status == "running"
    assert not read.summary["converged"]
    assert len(STRETCHES) > rows >= len(read.levels) == len(read.states)
    assert repr(read).endswith("running>")
    shown = commanded("show", tmp_path, "--out", tmp_path)
    assert "under way, or was ended from without" in shown.stderr
    assert (tmp_path / "uniaxial-displacement.png").exists()
    # What a process leaves that is killed while it writes goes when the run goes on.
    (tmp_path / f"{TEMPORARY}uniaxial-004-abcdefgh.vtu").write_text("half")
    scene = pds.load_scene("uniaxial", spacing=0.25, stretches=STRETCHES)
    with raising("was interrupted: continue it with --resume", FolderTaken):
        simulate(scene, "analytic", folder=tmp_path)
    resumed = simulate(scene, "analytic", folder=tmp_path, resume=True)
    assert resumed.history == simulate(scene, "analytic").history
    assert not list(tmp_path.glob(f"{TEMPORARY}*"))
    assert pds.load_result(tmp_path).status == "done"


def test_a_run_that_was_killed_before_its_first_checkpoint_is_begun_anew(tmp_path):
    """There is nothing to go on from, and nothing lost."""
    scene = pds.load_scene("uniaxial", spacing=0.25, stretches=[1.2])

    def kill(stage, done, total, **numbers):
        if "residual" in numbers:
            raise KeyboardInterrupt  # which nobody asked for: as good as a kill

    with pytest.raises(KeyboardInterrupt), listening(kill):
        simulate(scene, "analytic", folder=tmp_path)
    assert pds.load_result(tmp_path).status == "running"
    assert not pds.load_result(tmp_path).states
    with raising(r"another run of uniaxial \(stretches", FolderTaken):
        simulate(
            pds.load_scene("uniaxial", spacing=0.25, stretches=[1.3]), "analytic", folder=tmp_path
        )
    assert simulate(scene, "analytic", folder=tmp_path).status == "done"


@pytest.mark.parametrize(("share", "outputs"), [(1e9, 0), (1e9, 1), (0.0, 2)])
def test_the_summary_of_a_killed_run_lists_the_states_that_lie_there(
    share, outputs, tmp_path, monkeypatch
):
    """The summary was written once a second at most, and `show` denied a state whose file lay
    there.
    """
    monkeypatch.setattr(checkpoints, "SECONDS_BETWEEN_TABLES", 1e9)
    monkeypatch.setattr(checkpoints, "PAUSE_SHARE", share)
    scene = pds.load_scene("uniaxial", spacing=0.25, stretches=[1.1, 1.2, 1.3])
    with pytest.raises(Killed), at_level(outputs):
        simulate(scene, "analytic", folder=tmp_path)
    read = pds.load_result(tmp_path)
    assert len(read.states) == len(read.levels) == len(list(tmp_path.glob("*.vtu"))) == outputs
    shown = commanded("show", tmp_path, "--out", tmp_path)
    assert (
        "there is no output to draw: the run has not finished; resume it with --resume"
        in shown.stderr
    ) == (not outputs)
    assert (tmp_path / "uniaxial-displacement.png").exists() == bool(outputs)


def after_reports(number):
    """Context that interrupts a run after so many residuals of an equilibrium."""
    residuals = []

    def listener(stage, done, total, **numbers):
        residuals.extend([numbers["residual"]] if "residual" in numbers else [])
        if len(residuals) == number:
            interrupt()

    return listening(listener)


SCENES = {
    "uniaxial": (pds.load_scene("uniaxial", spacing=0.25, stretches=[2.0]), "analytic"),
    "ba-nosb": (pds.load_scene("uniaxial", spacing=0.25, stretches=[1.6]), "ba-nosb"),
    "pressure": (pds.load_scene("ring-pressure", spacing=0.25), "bond-energy"),
}


@pytest.mark.parametrize("name", SCENES)
def test_a_run_that_is_interrupted_in_an_equilibrium_begins_it_anew(tmp_path, name):
    """Also in the first one, with the same bits in the end."""
    scene, force = SCENES[name]
    with pytest.raises(SimulationInterrupted) as stopped, after_reports(8):
        simulate(scene, force, folder=tmp_path)
    assert not stopped.value.result.levels
    assert pds.load_result(tmp_path).status == "interrupted"
    resumed, whole = simulate(scene, force, folder=tmp_path, resume=True), simulate(scene, force)
    assert len(resumed.levels) == len(whole.levels)
    np.testing.assert_array_equal(resumed.displacement(), whole.displacement())


def test_a_run_ends_when_its_time_is_over_and_goes_on(tmp_path):
    command = ["run uniaxial --json", SHEET, "--out", tmp_path]
    done = commanded(command, "--max-time 1e-6", status=130)
    assert "stopped after max_time" in done.stderr
    assert "add --resume to the command" in done.stderr
    assert json.loads(done.stdout)["status"] == "interrupted"
    done = commanded(command, "--resume")
    assert len(pds.load_result(tmp_path).levels) == 3
    for wrong in (0, -1.0, math.inf):
        with raising("max_time must be a number of seconds greater than 0"):
            simulate("uniaxial", max_time=wrong)


def test_every_run_of_a_study_ends_when_its_time_is_over(tmp_path):
    keys = {
        "scene": "uniaxial",
        "force": "analytic",
        "set": {"spacing": 0.25},
        "parameters": {"stretches": [1.2, 1.5]},
    }
    stopped = pds.study(keys, tmp_path, jobs=1, threads=1, max_time=1e-6)
    assert len(stopped.not_done) == 2
    assert len(list(tmp_path.glob("runs/*/checkpoint.npz"))) == 2
    done = pds.study(keys, tmp_path, jobs=1, threads=1)
    assert [row["failure"] for row in done.rows] == [None, None]
    with raising("max_time: a fit cannot be resumed"):
        pds.study(
            {"fit": {"material": "gent"}, "parameters": {"degree": [3]}},
            tmp_path / "fits",
            max_time=1.0,
        )


def interrupted_where_held_up(code, where, folder):
    """Interrupt a run that a program holds up, check that it ends with status 130 and without a
    traceback, and return what it printed.
    """
    process = begun(code, where, "run uniaxial --set stretches=1.5", SHEET, "--out", folder)
    while process.stdout.readline().strip() != "held up":
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    told = process.communicate(timeout=60)[0]
    assert process.returncode == 130, told
    assert "interrupted" in told
    assert "Traceback" not in told
    return told


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("how", ["Python", "C"])
def test_ctrl_c_ends_what_does_not_hear_it(tmp_path, how):
    """While a preconditioner was set up, or a kernel compiled, an interrupt was noted and
    nothing happened for minutes.
    """
    interrupted_where_held_up(HELD_UP, how, tmp_path)
    assert pds.load_result(tmp_path).status in ("interrupted", "running")


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("what", ["checkpoint", "picture"])
def test_ctrl_c_while_a_file_is_written_ends_with_one_line(tmp_path, what):
    """An archive left open made the command end with status 2 and "Can't close the ZIP file", or
    print "Exception ignored".
    """
    told = interrupted_where_held_up(HELD_UP_WRITING, what, tmp_path)
    for words in ("Exception ignored", "ZIP file"):
        assert words not in told
    assert pds.load_result(tmp_path).status in ("done", "interrupted", "running")
    assert not list(tmp_path.glob(f"{TEMPORARY}*"))


def sheet(*stretches):
    return pds.load_scene("uniaxial", {"spacing": 0.1, "stretches": list(stretches)})


def content_of(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def cut_short(folder):
    path = folder / "checkpoint.npz"
    path.write_bytes(path.read_bytes()[:1000])


@pytest.mark.parametrize(
    ("stretches", "force", "change", "message"),
    [
        (
            (1.1, 1.3),
            "analytic",
            None,
            r"another run: stretches is \[1.1, 1.2\] there and \[1.1, 1.3\] here",
        ),
        ((1.1, 1.2), "neo-hookean", None, "force is analytic there.*again with --overwrite"),
        ((1.1, 1.2), "analytic", cut_short, "is damaged"),
        (
            (1.1, 1.2),
            "analytic",
            lambda folder: (folder / "checkpoint.npz").unlink(),
            "there is no checkpoint",
        ),
        (
            (1.1, 1.2),
            "analytic",
            lambda folder: (folder / "uniaxial-000.vtu").unlink(),
            r"not the file uniaxial-000 \(.vtu or .pvtu\) of a state",
        ),
    ],
    ids=["steps", "force", "damaged", "absent", "states"],
)
def test_a_refused_resume_changes_nothing(tmp_path, stretches, force, change, message):
    """Summary and history of the finished run were replaced by those of a run that had not begun,
    and missing states ended in an error of the reader of VTU files.
    """
    simulate(sheet(1.1, 1.2), "analytic", folder=tmp_path).save(tmp_path)
    (tmp_path / f"{TEMPORARY}x.vtu").write_text("x")
    if change is not None:
        change(tmp_path)
    before = content_of(tmp_path)
    with raising(message, CheckpointError):
        simulate(sheet(*stretches), force, folder=tmp_path, resume=True)
    assert content_of(tmp_path) == before


def test_a_resume_in_a_folder_without_a_run_leaves_the_users_files(tmp_path, monkeypatch):
    """Before any work: every new run of a study made its body twice."""
    monkeypatch.setattr("pdsurrogate.run.simulate.Run", None)
    (tmp_path / "summary.json").write_text('{"mine": 1}')
    (tmp_path / "history.csv").write_text("year,price\n")
    before = content_of(tmp_path)
    with raising("there is no checkpoint", CheckpointError):
        simulate(sheet(1.1), "analytic", folder=tmp_path, resume=True)
    assert content_of(tmp_path) == before
    with raising("there is no checkpoint", CheckpointError):
        simulate(sheet(1.1), "analytic", folder=tmp_path / "new", resume=True)
    assert content_of(tmp_path) == before


def test_tables_that_are_killed_half_way_leave_a_folder_of_the_run(tmp_path, monkeypatch):
    """The history is written after a summary that says that the run is under way."""

    def killed(*_):
        raise KeyboardInterrupt

    scene = pds.load_scene("uniaxial", spacing=0.5, stretches=[1.1])
    with monkeypatch.context() as patched:
        patched.setattr(tables, "as_csv", killed)
        with pytest.raises(KeyboardInterrupt):
            pds.simulate(scene, "analytic", folder=tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["status"] == "running"
    assert pds.simulate(scene, "analytic", folder=tmp_path).summary["status"] == "done"
