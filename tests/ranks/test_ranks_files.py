"""Runs on several ranks: what they leave in their folder, how they go on from it, and how they end when something fails."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from several_ranks import HERE, MPIEXEC, TIMEOUT, environment, several

from pdsurrogate.results.states import StatesInFiles

pytestmark = several

PROGRAM = """
import os, resource, sys
from pdsurrogate.cli import main
from pdsurrogate.ranks import communicator
from pdsurrogate.run.transient import Transient

what, at, *arguments = sys.argv[1:]
ranks, step = communicator(), Transient.step

if what == "pieces":
    from contextlib import suppress

    from pdsurrogate.run import run

    sys.argv = ["pdsurrogate", "run", *arguments, "--out", at]
    with suppress(SystemExit):
        main()
    run.MOST_GATHERED = 10

def happens(transient):
    run = transient.run
    if ranks.rank == 0:
        open(arguments[arguments.index("--out") + 1] + ".happened", "w").close()
    if what == "interrupted" and ranks.rank == ranks.size - 1:
        run.interruption.told = True
    elif what == "invalid" and ranks.rank == ranks.size - 1:
        run.positions[run.body.share.own.nonzero()[0][-1]] += 100 * run.body.spacing
    elif what == "killed" and ranks.rank == ranks.size - 1:
        os.kill(os.getpid(), 9)
    elif what == "full" and ranks.rank == 0:
        resource.setrlimit(resource.RLIMIT_FSIZE, (500, resource.RLIM_INFINITY))

def counted(transient):
    if at.isdigit() and transient.integrator.steps == int(at):
        happens(transient)
    step(transient)

Transient.step = counted
sys.argv = ["pdsurrogate", "run", *arguments]
main()
"""

HOLE = ["hole", "--force", "analytic", "--set", "spacing=0.25", "--set", "stretches=1.05"]
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
        head = [str(MPIEXEC), "-n", str(ranks), sys.executable, "-m", "mpi4py"] if ranks > 1 else [sys.executable]
        return [*head, str(program), what, str(at), *scene, "--out", str(folder), "--threads", "1", *options]

    return made


def run(command):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=TIMEOUT, env=environment())


def last_state(folder):
    """Displacements of the last state, which are written in double precision."""
    return StatesInFiles.saved(folder, json.loads((folder / "summary.json").read_text())["scene"])[-1][1]["displacement"]


def test_arrays_of_parts_come_in_the_order_of_the_whole_body_and_go_back():
    """Of points, images, directed bonds and pairs, in the plane and in space, between two planes of reflection and beside a cut."""
    done = run([str(MPIEXEC), "-n", "3", sys.executable, "-m", "mpi4py", str(HERE / "ranks" / "orders.py")])
    assert done.stdout.strip().endswith("in order"), done.stdout


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
    # The forces of grips are summed rank by rank.
    stresses = [crack["peak"].pop("nominal_stress") for crack in cracks]
    assert stresses == pytest.approx(stresses[:1] * 3, rel=1e-12)
    assert cracks[0] == cracks[1] == cracks[2]


def ends(command, status, happened, interrupt=False):
    """Output of a run that has to fail, with all its ranks and with a status, within ten seconds of what happens to it."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment())
    try:
        if interrupt:
            until = time.monotonic() + 600
            while not happened.exists() and process.poll() is None and time.monotonic() < until:
                time.sleep(0.02)
            process.send_signal(signal.SIGINT)
        told = process.communicate(timeout=600)[0]
    finally:
        process.kill()
    took = time.time() - happened.stat().st_mtime
    assert process.returncode == status, told
    # On a machine with more work than cores all takes longer.
    assert took < 10 * max(1.0, os.getloadavg()[0] / os.cpu_count()), told
    assert "Traceback" not in told
    return told


@pytest.fixture
def moving(command, tmp_path):
    """Function that runs a sheet of 188 points in some hundred steps, with three outputs, until something happens in the second third."""

    def made(what, status, interrupt=False, steps=1):
        dynamics = f"dynamics={{stretch=1.2, stretch_rate=0.5, density=0.01, outputs=3, safety={0.1 / steps}}}"
        given = command(2, [*HOLE, "--set", dynamics], tmp_path / "out", what=what, at=60)
        return ends([*given], status, tmp_path / "out.happened", interrupt), tmp_path / "out"

    return made


def test_an_invalid_state_on_one_rank_ends_all_with_its_message(moving):
    told, folder = moving("invalid", 1)
    assert told.count("the run failed") == 1, told
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["converged"] is False
    assert len(summary["levels"]) == 1
    assert len(list(folder.glob("*.vtu"))) >= 2


def test_a_rank_that_is_killed_ends_all_and_leaves_a_checkpoint(moving, command):
    _, folder = moving("killed", 9)
    assert sorted(path.name for path in folder.glob("*.vtu")) == ["hole-000.vtu", "hole-001.vtu"]
    assert (folder / "checkpoint.npz").exists()


def test_a_full_disk_ends_all_with_its_message(moving):
    told, folder = moving("full", 1)
    assert "could not write" in told
    assert "File too large" in told
    assert sorted(path.name for path in folder.glob("*.vtu")) == ["hole-000.vtu", "hole-001.vtu"]
    with np.load(folder / "checkpoint.npz") as arrays:
        assert np.isfinite(arrays["positions"]).all()


def test_ctrl_c_ends_all_with_results_and_a_checkpoint(moving):
    told, folder = moving("told", 130, interrupt=True, steps=10)
    assert "interrupted; the checkpoint is in" in told, told
    assert (folder / "checkpoint.npz").exists()
    assert json.loads((folder / "summary.json").read_text())["failure"].endswith("interrupted")


def test_large_bodies_are_written_in_pieces(command, tmp_path):
    folder = tmp_path / "pieces"
    done = run(command(2, HOLE, folder, what="pieces", at=tmp_path / "whole"))  # as a whole first, in one start of the ranks
    assert done.returncode == 0, done.stdout
    assert "no picture of it is drawn" in done.stdout
    assert sorted(path.name for path in folder.glob("*vtu")) == ["hole-000.piece0.vtu", "hole-000.piece1.vtu", "hole-000.pvtu"]
    whole, pieces = (StatesInFiles.saved(tmp_path / name, "hole")[0][1] for name in ("whole", "pieces"))
    assert list(whole) == list(pieces)
    for name, values in whole.items():
        np.testing.assert_array_equal(pieces[name], values)


def test_a_force_with_state_at_the_bonds_of_images_writes_checkpoints(command, tmp_path):
    """Two ranks ended in an error at the first checkpoint of `ba-nosb`; the residual is held to 1e-6 of a shear modulus over a spacing."""
    scene, stresses = ["uniaxial", "--force", "ba-nosb", "--set", "spacing=0.25", "--set", "stretches=1.05"], []
    for ranks in (1, 2):
        done = run(command(ranks, scene, tmp_path / str(ranks)))
        assert done.returncode == 0, done.stdout
        stresses.append(json.loads((tmp_path / str(ranks) / "summary.json").read_text())["levels"][0]["nominal_stress"])
    assert stresses[1] == pytest.approx(stresses[0], rel=1e-5)
