"""Runs on several ranks: what they leave in their folder, how they go on from it, and how they end when something fails."""

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

MPIEXEC = shutil.which("mpiexec", path=str(Path(sys.executable).parent)) or shutil.which("mpiexec")
pytestmark = pytest.mark.skipif(
    MPIEXEC is None or importlib.util.find_spec("mpi4py") is None, reason='no MPI is installed: pip install "pdsurrogate[mpi]"'
)

PROGRAM = """
import os, resource, sys
from pdsurrogate.cli import main
from pdsurrogate.ranks import communicator
from pdsurrogate.run.transient import Transient

what, at, *arguments = sys.argv[1:]
ranks, step = communicator(), Transient.step

def happens(transient):
    run = transient.run
    if what == "interrupted" and ranks.rank == ranks.size - 1:
        run.interruption.asked = True
    elif what == "invalid" and ranks.rank == ranks.size - 1:
        run.positions[run.body.part.own.nonzero()[0][-1]] += 100 * run.body.spacing
    elif what == "killed" and ranks.rank == ranks.size - 1:
        os.kill(os.getpid(), 9)
    elif what == "full" and ranks.rank == 0:
        resource.setrlimit(resource.RLIMIT_FSIZE, (500, resource.RLIM_INFINITY))
    elif what == "told" and ranks.rank == 0:
        print("under way", file=sys.stderr, flush=True)

def counted(transient):
    if transient.integrator.steps == int(at):
        happens(transient)
    step(transient)

Transient.step = counted
sys.argv = ["pdsurrogate", "run", *arguments]
main()
"""

HOLE = ["hole", "--force", "analytic", "--set", "spacing=0.25", "--set", "stretches=1.05"]
MOVING = ["--set", "dynamics={stretch=1.2, stretch_rate=0.5, density=0.01, outputs=%d, safety=%g}"]
TEAR = ["tear", "--force", "analytic", "--set", "spacing=0.25", "--set", "stretches=1.1", "--set", "body.size=[4.0, 3.0]"]
TEAR += ["--set", "precuts=[{start=[0.0, 1.5], end=[1.5, 1.5]}]", "--set", "fracture.critical_stretch=1.5"]
TEAR += ["--set", "dynamics.stretch=1.3", "--set", "dynamics.outputs=4", "--set", "dynamics.stretch_rate=40.0"]
"""A sheet of 192 points, whose crack begins at step 39 and has run through half of it at step 75."""


@pytest.fixture
def command(tmp_path):
    """Function that makes the command of a run on some ranks, in which something happens before a step of the dynamics."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)

    def made(ranks, scene, folder, *options, what="nothing", at=-1):
        head = [MPIEXEC, "-n", str(ranks), sys.executable, "-m", "mpi4py"] if ranks > 1 else [sys.executable]
        return [*head, str(program), what, str(at), *scene, "--out", str(folder), "--threads", "1", *options]

    return made


def run(command, timeout=240):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=timeout)


def last_state(folder):
    """Displacements of the last state, which are written in double precision."""
    from pdsurrogate.results.states import SavedStates

    return SavedStates(folder, json.loads((folder / "summary.json").read_text())["scene"])[-1][1]["displacement"]


def test_a_run_checkpointed_on_two_ranks_goes_on_on_three_and_on_one(command, tmp_path):
    done = run(command(2, TEAR, tmp_path / "a", what="interrupted", at=49))
    assert "interrupted; the checkpoint is in" in done.stdout, done.stdout
    arrays = np.load(tmp_path / "a" / "checkpoint.npz")
    assert arrays["positions"].shape == (192, 2)
    assert 0 < arrays["broken"].sum() < 140
    folders = {1: tmp_path / "one", 2: tmp_path / "a", 3: tmp_path / "three"}
    for folder in (folders[1], folders[3]):
        shutil.copytree(tmp_path / "a", folder)
    for ranks, folder in folders.items():
        done = run(command(ranks, TEAR, folder, "--resume"))
        assert "140 bonds broken" in done.stdout, done.stdout
    displacements = [last_state(folder) for folder in folders.values()]
    # Explicit steps are the same on any number of ranks to the last bit, and so are the pairs that break.
    assert np.array_equal(displacements[0], displacements[1])
    assert np.array_equal(displacements[0], displacements[2])
    cracks = [json.loads((folder / "summary.json").read_text())["crack"] for folder in folders.values()]
    assert cracks[0] == cracks[1] == cracks[2]


def ends(command, within=10.0):
    """Output of a run that fails, and its status; it must end so soon after it says that something happens."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        told = process.communicate(timeout=240)[0]
    finally:
        process.kill()
    return told, process.returncode


def test_an_invalid_state_on_one_rank_ends_all_with_its_message(command, tmp_path):
    told, status = ends(command(2, [*HOLE, "--set", MOVING[1] % (3, 0.1)], tmp_path / "out", what="invalid", at=40))
    assert status == 1, told
    assert told.count("the run failed") == 1, told
    assert "Traceback" not in told
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["converged"] is False
    assert len(summary["levels"]) == 1
