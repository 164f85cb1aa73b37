"""Number of threads on which the kernels run, number of chunks they share, and how waiting
threads spin or sleep.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numba
from numba.np.ufunc import parallel

SPIN_COUNT = 1000
"""Iterations for which a waiting thread of GNU OpenMP spins before it sleeps.

The default of GNU OpenMP, 300,000, lasts some milliseconds, during which a waiting thread occupies
a core that the thread it waits for may need. `python pipelines/timings.py threads` compares this
choice with others, on free and on busy cores.
"""

PAIRS_PER_THREAD = 5_000
"""Number of pairs of points per thread below which a further thread costs more in waiting than
it saves (`python pipelines/timings.py threads`).
"""

PAIRS_PER_CHUNK = 1_000
"""Number of pairs of points in a chunk of a pass. A chunk takes some ten microseconds, less than
`SPIN_COUNT` iterations, so that threads that finish half a chunk apart do not fall asleep.
"""

_WAITING = ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")
"""Environment variables by which a user sets how threads wait."""


class ThreadsSpinWarning(RuntimeWarning):
    """Warning that waiting threads occupy their cores, because numba's threads started before
    pdsurrogate could set how they wait.
    """


_started = False


def start_threads() -> None:
    """Start numba's threads such that a waiting thread soon sleeps, unless the user has set how
    threads wait.

    Warn once if the threads run already. GNU OpenMP reads the setting from the environment when it
    is loaded; the environment is restored afterwards.
    """
    global _started
    if _started:
        return
    _started = True
    if any(variable in os.environ for variable in _WAITING):
        return
    if _runs_already():
        warnings.warn(
            "numba's threads were started before pdsurrogate could limit how long they busy-wait:"
            " while other programs use the cores, two threads may be slower than one; set"
            f" GOMP_SPINCOUNT={SPIN_COUNT} in the environment, or use pdsurrogate before other"
            " kernels",
            ThreadsSpinWarning,
            stacklevel=2,
        )
        return
    os.environ["GOMP_SPINCOUNT"] = str(SPIN_COUNT)
    try:
        parallel._launch_threads()
    finally:
        del os.environ["GOMP_SPINCOUNT"]


class ThreadsLostWarning(RuntimeWarning):
    """Warning that kernels run on one thread, because this process was forked from a process
    whose kernels had started threads.
    """


_lost = False


def threads_are_lost() -> bool:
    """Return whether kernels run on the calling thread only, because this process was forked
    from a process that had started threads.
    """
    return _lost


def _say_lost() -> None:
    warnings.warn(
        "this process was forked from one with running threads, which a fork does not copy, so it"
        " uses one thread; to use more, start processes with 'spawn' or 'forkserver'"
        " (multiprocessing.get_context)",
        ThreadsLostWarning,
        stacklevel=3,
    )


def _after_fork() -> None:
    """Note in a forked process that the threads are lost, if GNU OpenMP had been started before the
    fork.

    GNU OpenMP does not survive a fork: numba ends a process that uses it afterwards.
    """
    global _lost
    _lost = parallel._is_initialized and numba.threading_layer() == "omp"


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def _runs_already() -> bool:
    """Return whether numba's threads already run on GNU OpenMP, or another library has loaded
    the same file of GNU OpenMP.
    """
    if parallel._is_initialized:
        return numba.threading_layer() == "omp"
    if sys.platform != "linux":
        return False
    # Wheels bring their own copies, which numba does not use.
    mapped = {
        line.split()[-1]
        for line in Path("/proc/self/maps").read_text().splitlines()
        if "/libgomp" in line
    }
    return any("site-packages" not in file for file in mapped)


def threads_in_use() -> int:
    """Return the number of threads on which passes bound from now on will run; start the threads
    if they do not run yet.
    """
    start_threads()
    return numba.get_num_threads()


_most: int | None = None


def most_threads() -> int:
    """Return the greatest number of threads that kernels can use: the number at numba's start, or
    the limit set by `thread_count`.

    It is 1 in a forked process in which the threads are lost.
    """
    return 1 if _lost else _most or numba.config.NUMBA_NUM_THREADS


def threads_for(pairs: int) -> int:
    """Return how many threads are worthwhile for a body with this number of pairs of points, at
    most `most_threads`.

    Warn if the threads are lost in a forked process and the body is large enough for several.
    """
    if _lost and pairs >= 2 * PAIRS_PER_THREAD:
        _say_lost()
    return max(1, min(most_threads(), pairs // PAIRS_PER_THREAD))


class Chunks(NamedTuple):
    """Number of threads that run a pass, and number of chunks of the body that the threads
    share.
    """

    threads: int
    number: int


def chunks_of(pairs: int) -> Chunks:
    """Return the number of threads and of chunks of passes over a body with this number of
    pairs, at least one chunk for each thread.
    """
    threads = threads_in_use()
    return Chunks(threads, 1 if threads == 1 else max(threads, pairs // PAIRS_PER_CHUNK))


@contextmanager
def thread_count(threads: int | None, limit: bool = False) -> Iterator[int]:
    """Run kernels on a number of threads within the context, None for all, and yield the number;
    raise ValueError for too many.

    With `limit` it is also what `most_threads` returns, so that nothing within the context uses
    more. In a forked process in which the threads are lost, warn and use one.
    """
    global _most
    if _lost and threads not in (None, 1):
        _say_lost()
        threads = 1
    most = most_threads()
    most_before = _most
    if threads is not None and not 1 <= threads <= most:
        raise ValueError(f"threads must be between 1 and {most} on this machine, not {threads}")
    before = threads_in_use()
    used = threads or most
    numba.set_num_threads(used)
    _most = used if limit else _most
    try:
        yield used
    finally:
        numba.set_num_threads(before)
        _most = most_before
