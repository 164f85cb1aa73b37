"""What processes cost: processor time, wall time and memory."""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

START = """
import os, sys
process = os.posix_spawnp(sys.argv[2], sys.argv[2:], os.environ)
_, code, usage = os.wait4(process, 0)
told = os.waitstatus_to_exitcode(code), usage.ru_utime + usage.ru_stime, usage.ru_maxrss
os.write(int(sys.argv[1]), " ".join(map(str, told)).encode())
"""
"""Starts a process and tells its status, seconds and memory (kB) to a pipe. The memory of a process
counts that of the one which starts it, so this one is small.
"""


class NotRun(SystemExit):
    """What a commit was asked is unknown to it or failed; the message is its own."""


def environment(path, **more):
    """The variables of processes of a checkout."""
    # Threads that turn for milliseconds after their work would take the cores from the process
    # whose turn is next.
    return {"GOMP_SPINCOUNT": "1000", **os.environ, "PYTHONPATH": str(path), **more}


def spent(path, *words, python=(sys.executable,), ranks=0, together=1, status=0, **variables):
    """Cost of processes of Python that start at once on a checkout, and the figures that the last
    one prints as JSON.

    `python` is what starts it. Processor time counts user and system, of all processes and those
    that they start; memory is the greatest of one process.
    """
    launcher = (
        [str(Path(sys.executable).with_name("mpiexec")), "-n", str(ranks)] if ranks > 1 else []
    )
    command = [
        *launcher,
        *python,
        *(["-W", "ignore", "-m", "mpi4py"] if ranks else []),
        *words,
    ]
    began, seconds, memory, ended = time.perf_counter(), 0.0, 0.0, []
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as errors:
        reads = []
        for _ in range(together):
            read, write = os.pipe()
            subprocess.Popen(
                [sys.executable, "-S", "-c", START, str(write), *command],
                cwd=path,
                env=environment(path, **variables),
                stdout=out,
                stderr=errors,
                pass_fds=(write,),
            )
            os.close(write)
            reads.append(read)
        for read in reads:
            with os.fdopen(read) as told:
                code, used, most = map(float, told.read().split())
            ended.append(int(code))
            seconds += used
            memory = max(memory, most / 1024)
        wall = time.perf_counter() - began
        printed, said = (file.seek(0) or file.read().strip().splitlines() for file in (out, errors))
    if set(ended) != {status}:
        raise NotRun(next((line for line in reversed(said) if line), f"status {ended}"))
    figures = json.loads(printed[-1]) if printed and printed[-1].startswith("{") else {}
    return {"processor time (s)": seconds, "wall time (s)": wall, "memory (MB)": memory, **figures}
