"""Processes of their own for runs on several ranks: a test that hangs must end too."""

import base64
import importlib.util
import os
import pickle
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest

HERE = Path(__file__).parent
MPIEXEC = Path(sys.executable).with_name("mpiexec")
TIMEOUT = 600
"""Seconds, on cores that others use too; alone none of these takes more than twenty."""

several = pytest.mark.skipif(
    importlib.util.find_spec("mpi4py") is None or not MPIEXEC.exists(),
    reason="needs mpi4py and mpich: pip install 'pdsurrogate[mpi]'",
)


SLEEPING = {"MPIR_CVAR_ENABLE_HEAVY_YIELD": "1", "MPIR_CVAR_POLLS_BEFORE_YIELD": "1"}
"""With these ranks of MPICH that wait sleep between polls, and leave the core to the rank that
they wait for and to other tests.
"""


def environment():
    return {
        **os.environ,
        **SLEEPING,
        "NUMBA_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join(map(str, (HERE.parent, HERE))),
    }


def on_ranks(ranks, *arguments, mpi4py=True):
    """The command that starts Python on some ranks."""
    command = [sys.executable, *(["-m", "mpi4py"] if mpi4py else []), *map(str, arguments)]
    return [str(MPIEXEC), "-n", str(ranks), *command]


class Ranks:
    """Processes that run cases of `tests/ranks` one after another, each on one rank or several:
    a process takes seconds to begin.
    """

    def __init__(self, size):
        self.size, self.compiled = size, False
        self._process, self._log = None, tempfile.TemporaryFile("w+")  # noqa: SIM115 - as long as the processes

    def __enter__(self):
        command = on_ranks(self.size, HERE / "ranks" / "served.py")
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": self._log}
        self._process, self.compiled = (
            subprocess.Popen(command, text=True, env=environment(), **pipes),
            False,
        )
        return self

    def __exit__(self, *error):
        self._process.stdin.close()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __call__(self, ranks, function, *arguments, module="cases", folder=HERE):
        """What a function of `tests/ranks` does on each of so many ranks: its value, or its
        status and error, and what it prints.
        """
        order = (
            ranks,
            str(folder),
            module,
            function,
            tuple(str(one) if isinstance(one, Path) else one for one in arguments),
        )
        limit = threading.Timer(TIMEOUT, self._process.kill)
        limit.start()
        try:
            self._process.stdin.write(base64.b64encode(pickle.dumps(order)).decode() + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        finally:
            limit.cancel()
        if not line:
            self.__exit__()
            self.__enter__()
            self._log.seek(0)
            raise AssertionError(f"the ranks have ended: {self._log.read()}")
        replies = pickle.loads(base64.b64decode(line))
        self.compiled |= any(reply["compiled"] for reply in replies)
        return replies

    def value(self, ranks, *case, **where):
        """What a function returns on the first of so many ranks."""
        return self(ranks, *case, **where)[0]["value"]

    def alone(self, *case, **where):
        """What a function returns on one rank with all code from the cache."""
        return self.loaded(1, *case, **where)[0]["value"]

    def load(self):
        """Begin anew if the processes have compiled anything, and return whether they do.

        What a process compiles itself may differ from what others load, in the last bits: so a
        bonded cube in space did.
        """
        compiled = self.compiled
        if compiled:
            self.__exit__()
            self.__enter__()
        return compiled

    def loaded(self, *case, **where):
        """What a function does with all code from the cache."""
        replies = self(*case, **where)
        return self(*case, **where) if self.load() else replies
