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
from commands import invoke
from conftest import SHIPPED
from refusals import raising

from pdsurrogate.artifacts import load_card, load_surrogate
from pdsurrogate.artifacts.store import save_artifact
from pdsurrogate.cli.simulation import how_to_resume
from pdsurrogate.results import files

FAST = "--set spacing=0.1 --set stretches=1.2"

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
    with raising("No space left", OSError):
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
    done = invoke("run uniaxial", FAST, "--out", tmp_path / "out")
    assert_one_clear_line(done, "could not write", "No space left")
    assert not (tmp_path / "out" / "summary.json").exists()


def test_a_full_disk_is_reported_by_fit(tmp_path, monkeypatch):
    def fail(*arguments, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("joblib.dump", fail)
    done = invoke("fit mine --samples 300 --degree 4 --out", tmp_path / "a")
    assert_one_clear_line(done, "could not write", "No space left")
    assert not list((tmp_path / "a").iterdir())


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
@pytest.mark.parametrize("command", ["materials", "artifacts gent"])
def test_standard_output_on_a_full_disk(command):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "pdsurrogate", *command.split()],
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
    with raising("Input/output", OSError):
        save_artifact(tmp_path, {**card, "name": "mine"}, surrogate)
    assert not list((tmp_path / "mine").iterdir())
    monkeypatch.undo()
    found = load_surrogate(save_artifact(tmp_path, {**card, "name": "mine"}, surrogate))
    np.testing.assert_array_equal(
        found.bond_force([1.2], [0.1], [0.5], [0.9], [1.1]),
        surrogate.bond_force([1.2], [0.1], [0.5], [0.9], [1.1]),
    )


def test_nothing_to_resume_is_said_too(tmp_path):
    assert "--out" in how_to_resume(None)
    assert "not yet written a checkpoint" in how_to_resume(tmp_path)
    (tmp_path / "checkpoint.npz").touch()
    assert "--resume" in how_to_resume(tmp_path)
