"""How the kernels' threads wait, and how many there are."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest
from chunk_notes import note_chunks

import pdsurrogate as pds
from pdsurrogate.engine import threads
from pdsurrogate.engine.passes import Chain
from pdsurrogate.engine.threads import SPIN_COUNT, Chunks, threads_for

USE = """
import os, sys
import pdsurrogate as pds
import numpy as np
from chunk_notes import note_chunks
{first}
before = dict(os.environ)
for _ in range(2):
    note_chunks(*np.zeros((2, 1000), int))
    with pds.engine.threads.thread_count(2):
        pass
print(before == dict(os.environ), numba.threading_layer() if "numba" in globals() else "")
"""


def _used(first="", **variables):
    """Standard error of a process that uses a parallel kernel, with what GNU OpenMP says of its
    settings when it is loaded.
    """
    inherited = {
        key: value
        for key, value in os.environ.items()
        if key not in ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")
    }
    environment = {
        **inherited,
        "NUMBA_NUM_THREADS": "2",
        "OMP_DISPLAY_ENV": "verbose",
        "PYTHONPATH": os.pathsep.join(sys.path),
    } | variables
    done = subprocess.run(
        [sys.executable, "-c", USE.format(first=first)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split()[0] == "True", "the environment was changed"
    if "GOMP_SPINCOUNT" not in done.stderr:
        pytest.skip("numba does not run on GNU OpenMP here")
    return done.stderr


def test_threads_sleep_soon_when_they_wait():
    assert f"GOMP_SPINCOUNT = '{SPIN_COUNT}'" in _used()


@pytest.mark.parametrize(
    ("variables", "expected"),
    [({"GOMP_SPINCOUNT": "77"}, "77"), ({"OMP_WAIT_POLICY": "passive"}, "0")],
)
def test_what_the_user_has_set_stands(variables, expected):
    said = _used(**variables)
    assert f"GOMP_SPINCOUNT = '{expected}'" in said
    assert "ThreadsSpinWarning" not in said


def test_a_setting_that_comes_too_late_is_said_once():
    """Numba's threads were started before pdsurrogate's kernels."""
    assert _used("import numba; numba.set_num_threads(1)").count("ThreadsSpinWarning") == 1


def test_small_bodies_take_one_thread():
    most = numba.config.NUMBA_NUM_THREADS
    assert threads_for(0) == threads_for(threads.PAIRS_PER_THREAD) == 1
    assert threads_for(10**9) == most
    small = pds.load_scene("uniaxial", spacing=0.1, stretches=1.5)
    threads.start_threads()
    before = numba.get_num_threads()
    assert pds.simulate(small, "analytic").summary["threads"] == 1
    assert numba.get_num_threads() == before
    if most > 1:
        assert pds.simulate(small, "analytic", threads=2).summary["threads"] == 2


@pytest.mark.parametrize("chunks", [Chunks(1, 1), Chunks(2, 2), Chunks(2, 7), Chunks(3, 100)])
def test_every_chunk_of_every_pass_is_worked_on_once(chunks):
    """Whatever the order in which threads come, and also where there are fewer of them than the
    passes were bound for.
    """
    times, threads = np.zeros((2, chunks.number), dtype=np.int64), np.full((2, chunks.number), -1)
    chain = Chain(
        *(note_chunks.bind(*arrays, chunks=chunks) for arrays in zip(times, threads, strict=True))
    )
    for _ in range(50):
        assert chain() == [sum(range(chunks.number))] * 2
    assert (times == 50).all()
    assert set(threads.ravel()) <= set(range(chunks.threads))


FORKED = """
import multiprocessing, os, sys, warnings
import pdsurrogate as pds

scene = pds.load_scene("uniaxial", spacing=0.1, stretches=1.2)

def stress(threads):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        summary = pds.simulate(scene, "analytic", threads=threads).summary
    kinds = [w.category.__name__ for w in said]
    return summary["levels"][0]["nominal_stress"], summary["threads"], kinds

here = stress(2)
child = os.fork()
if child == 0:
    os._exit(0 if stress(2)[0] == here[0] else 3)
_, status = os.waitpid(child, 0)
if status:
    sys.exit(f"the child ended with status {status}")
with multiprocessing.get_context("fork").Pool(2) as pool:
    for found in pool.map(stress, [None, 2]):
        print(found[0] == here[0], *found[1:])
print(stress(2) == here)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_process_that_is_forked_after_a_run_on_threads_runs_on_one(tmp_path):
    """GNU OpenMP does not survive a fork: numba ended the child, and a pool of them waited for
    ever.
    """
    environment = {**os.environ, "NUMBA_NUM_THREADS": "2"}
    done = subprocess.run(
        [sys.executable, "-c", FORKED],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    one, two, again = done.stdout.splitlines()
    if two == "True 2 []":
        pytest.skip("numba's threads survive a fork here")
    assert (one, two, again) == ("True 1 []", "True 1 ['ThreadsLostWarning']", "True")
