"""Processes of their own for runs on several ranks: a test that hangs must end too."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
MPIEXEC = Path(sys.executable).with_name("mpiexec")
TIMEOUT = 600
"""Seconds, on cores that others use too; alone none of these takes more than twenty."""

several = pytest.mark.skipif(
    importlib.util.find_spec("mpi4py") is None or not MPIEXEC.exists(), reason="needs mpi4py and mpich: pip install 'pdsurrogate[mpi]'"
)


SLEEPING = {"MPIR_CVAR_ENABLE_HEAVY_YIELD": "1", "MPIR_CVAR_POLLS_BEFORE_YIELD": "1"}
"""With these ranks of MPICH that wait sleep between polls, and leave the core to the rank that they wait for and to other tests."""


def environment():
    return {**os.environ, **SLEEPING, "NUMBA_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(map(str, (HERE.parent, HERE)))}


def run(ranks, *arguments, mpi4py=True, expected=0, cwd=None):
    """Output of a Python command on some ranks."""
    command = [sys.executable, *(["-m", "mpi4py"] if mpi4py else []), *map(str, arguments)]
    if ranks > 1:
        command = [str(MPIEXEC), "-n", str(ranks), *command]
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT, env=environment(), cwd=cwd, check=False)
    assert (done.returncode == 0) == (expected == 0), done.stdout + done.stderr
    return done.stdout + done.stderr


def run_loaded(ranks, *arguments):
    """Output of a Python command that says "compiled" where it has compiled: it runs once more then, with all code from the cache.

    What a process compiles itself may differ from what others load, in the last bits: so a bonded cube in space did.
    """
    printed = run(ranks, *arguments, mpi4py=ranks > 1)
    return run(ranks, *arguments, mpi4py=ranks > 1) if "compiled" in printed else printed
