"""Files are written whole or not at all: kills at any moment, full disks, interrupts."""

import errno
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from commands import commanded, invoke
from conftest import SHIPPED
from stopping import interrupt

from pdsurrogate.artifacts import load_card, load_surrogate
from pdsurrogate.artifacts.store import save_artifact
from pdsurrogate.cli.simulation import how_to_resume
from pdsurrogate.progress import listening
from pdsurrogate.results import files
from pdsurrogate.run.simulate import SimulationInterrupted, simulate
from pdsurrogate.scenes import load_scene

FAST = ["--set", "spacing=0.1", "--set", "stretches=1.2"]

ENDLESS_JSON = """
import sys
from pathlib import Path
from pdsurrogate.results.files import write_json
path, k = Path(sys.argv[1]) / "summary.json", 0
print("ready", flush=True)
while True:
    k += 1
    write_json(path, {"number": k, "data": [k] * 50_000})
"""


def killed(program: str, delay: float, *arguments) -> None:
    """Run a program that writes without end, and kill it without warning."""
    process = subprocess.Popen(
        [sys.executable, "-c", program, *map(str, arguments)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "ready\n"
    time.sleep(delay)
    process.send_signal(signal.SIGKILL)
    assert process.wait(10) == -signal.SIGKILL
    process.stdout.close()


def test_a_kill_leaves_the_old_file_or_the_new_one(tmp_path):
    (tmp_path / "summary.json").write_text(json.dumps({"number": 0, "data": [0] * 50_000}))
    killed(ENDLESS_JSON, 0.05, tmp_path)
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["data"] == [content["number"]] * 50_000


@pytest.mark.parametrize("step", ["write", "fsync", "replace"])
def test_a_failure_at_any_step_leaves_the_old_file(tmp_path, monkeypatch, step):
    path = tmp_path / "x.json"
    files.write_json(path, {"old": 1})

    def fail(*arguments, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    if step == "write":
        monkeypatch.setattr("pathlib.Path.write_text", fail)
    else:
        monkeypatch.setattr(f"os.{step}", fail)
    with pytest.raises(OSError, match="No space left"):
        files.write_json(path, {"new": 2})
    monkeypatch.undo()
    assert json.loads(path.read_text()) == {"old": 1}
    assert [item.name for item in tmp_path.iterdir()] == ["x.json"]


def full_disk(monkeypatch) -> None:
    """Space runs out when data are to reach the disk."""

    def fail(handle):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", fail)


def assert_one_clear_line(done, *words) -> None:
    assert done.exit_code == 1, done.output
    lines = [line for line in done.stderr.splitlines() if line.strip() and "Compiling" not in line]
    assert len(lines) == 1
    assert all(word in lines[0] for word in words)
    assert "Traceback" not in done.output


def test_a_full_disk_is_reported_by_run(tmp_path, monkeypatch):
    full_disk(monkeypatch)
    done = invoke("run", "uniaxial", *FAST, "--out", tmp_path / "out")
    assert_one_clear_line(done, "could not write", "No space left")
    assert not (tmp_path / "out" / "summary.json").exists()


def test_a_full_disk_is_reported_by_fit(tmp_path, monkeypatch):
    def fail(*arguments, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("joblib.dump", fail)
    done = invoke("fit", "mine", "--samples", "300", "--degree", "4", "--out", tmp_path / "a")
    assert_one_clear_line(done, "could not write", "No space left")
    assert not list((tmp_path / "a").iterdir())


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
@pytest.mark.parametrize("command", [["materials"], ["artifacts", "gent"]])
def test_standard_output_on_a_full_disk(command):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "pdsurrogate", *command],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 1
    assert done.stderr == "pdsurrogate: standard output: No space left on device\n"


def test_a_version_that_exists_is_told_from_a_disk_that_fails(tmp_path, monkeypatch):
    source = SHIPPED / "neo-hookean" / "1"
    card = {
        key: value
        for key, value in load_card(source).model_dump().items()
        if key not in ("format", "schema_version", "payloads")
    }
    surrogate = load_surrogate(source)

    def fail(*arguments):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "rename", fail)
    with pytest.raises(OSError, match="Input/output"):
        save_artifact(tmp_path, {**card, "name": "mine"}, surrogate)
    assert not list((tmp_path / "mine").iterdir())
    monkeypatch.undo()
    found = load_surrogate(save_artifact(tmp_path, {**card, "name": "mine"}, surrogate))
    np.testing.assert_array_equal(
        found.bond_force([1.2], [0.1], [0.5], [0.9], [1.1]),
        surrogate.bond_force([1.2], [0.1], [0.5], [0.9], [1.1]),
    )


TEAR = [
    *("spacing=0.1", "body.size=3.0,1.0", "stretches=1.1,1.2", "fracture.critical_stretch=2.0"),
    *("dynamics.stretch=1.9", "dynamics.stretch_rate=60.0", "dynamics.outputs=8"),
    "precuts=[{start = [0.0, 0.5], end = [1.0, 0.5]}]",
]


def in_dynamics(share):
    """Context that interrupts a run once, at a share of a stage in dynamics after two in
    equilibrium.
    """
    left = [2 + share]

    def listener(stage, done, total, **numbers):
        if stage == "dynamics" and left and done >= left[0]:
            left.clear()
            interrupt()

    return listening(listener)


def tear():
    return load_scene("tear", TEAR)


@pytest.fixture
def heeds_interrupts():
    """A shell that starts the tests in the background has them ignore Ctrl-C, and what they
    start as well.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heeds_interrupts")
def test_an_interrupt_saves_a_checkpoint_that_resumes_to_the_same_bits(tmp_path):
    with pytest.raises(SimulationInterrupted, match="interrupted") as caught, in_dynamics(0.4):
        simulate(tear(), "analytic", folder=tmp_path / "a")
    assert len(caught.value.result.levels) == 2
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    resumed = simulate(tear(), "analytic", folder=tmp_path / "a", resume=True)
    whole = simulate(tear(), "analytic", folder=tmp_path / "b")
    assert resumed.history == whole.history
    np.testing.assert_array_equal(resumed.displacement(), whole.displacement())


@pytest.mark.usefixtures("heeds_interrupts")
def test_ctrl_c_on_the_command_line(tmp_path):
    """Exit status 130, results of what was reached, one line that says how to go on; and going
    on works.
    """
    command = [
        sys.executable,
        "-m",
        "pdsurrogate",
        "run",
        "tear",
        "--force",
        "analytic",
        "--out",
        str(tmp_path),
    ]
    command += [word for change in TEAR for word in ("--set", change)]
    slow = [*command, "--set", "dynamics.stretch_rate=0.5"]
    process = subprocess.Popen(slow, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not (tmp_path / "checkpoint.npz").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    output, error = process.communicate(timeout=60)
    assert process.returncode == 130, error
    assert "interrupted" in error
    assert "--resume" in error
    assert "Traceback" not in error + output
    assert json.loads((tmp_path / "summary.json").read_text())["failure"].endswith("interrupted")
    other = commanded(*command[3:], "--resume", status=2)
    assert "belongs to another run" in other.stderr


def test_nothing_to_resume_is_said_too(tmp_path):
    assert "--out" in how_to_resume(None)
    assert "not yet written a checkpoint" in how_to_resume(tmp_path)
    (tmp_path / "checkpoint.npz").touch()
    assert "--resume" in how_to_resume(tmp_path)
