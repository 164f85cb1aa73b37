"""Threads of the kernels: how many, and how they wait for each other."""

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
"""Turns that a thread of GNU OpenMP takes in a waiting loop before it sleeps.

Its own default, 300,000, lasts some milliseconds, in which a thread that waits keeps the core from the one it waits for wherever there are
fewer free cores than threads. `python pipelines/threads.py` measures this choice against others, on free and on busy cores.
"""

PAIRS_PER_THREAD = 5_000
"""Pairs of points below which a further thread costs more in waiting than it takes over (`python pipelines/threads.py`)."""

PAIRS_PER_CHUNK = 1_000
"""Pairs of points in a chunk of a pass, which takes some ten microseconds: less than the turns of `SPIN_COUNT`, so that threads that end
half a chunk apart do not fall asleep."""

_WAITING = ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")
"""Variables by which a user says how threads wait."""


class ThreadsSpinWarning(RuntimeWarning):
    """The kernels' threads wait for each other in loops, because they ran before that could be set."""


_started = False


def start_threads() -> None:
    """Start numba's threading layer with threads that soon sleep when they wait, unless the user has set how they wait.

    GNU OpenMP reads that from the environment once, when it is loaded; the environment is left as it was. Says so once where it comes too
    late.
    """
    global _started
    if _started:
        return
    _started = True
    if any(variable in os.environ for variable in _WAITING):
        return
    if _runs_already():
        warnings.warn(
            "numba's threads ran before pdsurrogate could set how they wait: beside other work, two threads may be far slower than one; "
            f"set GOMP_SPINCOUNT={SPIN_COUNT} in the environment, or import and use pdsurrogate first",
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
    """The process was forked from one whose kernels had threads, and has none itself."""


_lost = False


def threads_are_lost() -> bool:
    """Whether the kernels of this process run on the thread that calls, because it was forked from one that had started threads."""
    return _lost


def _say_lost() -> None:
    warnings.warn(
        "this process was forked from one whose kernels had started threads, which do not survive that: it takes one thread; for more, "
        "start processes by 'spawn' or 'forkserver', as multiprocessing.get_context does",
        ThreadsLostWarning,
        stacklevel=3,
    )


def _after_fork() -> None:
    """Note in a new process that GNU OpenMP, once started, does not survive a fork: numba ends a process that calls it then."""
    global _lost
    _lost = parallel._is_initialized and numba.threading_layer() == "omp"


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def _runs_already() -> bool:
    """Whether numba's threads run on GNU OpenMP, or another library has loaded the same one."""
    if parallel._is_initialized:
        return numba.threading_layer() == "omp"
    if sys.platform != "linux":
        return False
    # Wheels bring copies of their own, which are not the one that numba takes.
    mapped = {line.split()[-1] for line in Path("/proc/self/maps").read_text().splitlines() if "/libgomp" in line}
    return any("site-packages" not in file for file in mapped)


def threads_in_use() -> int:
    """Threads that passes bound now are shared among."""
    start_threads()
    return numba.get_num_threads()


_most: int | None = None


def most_threads() -> int:
    """Threads that numba was started with, or fewer within `at_most`; one where they did not survive a fork."""
    return 1 if _lost else _most or numba.config.NUMBA_NUM_THREADS


@contextmanager
def at_most(threads: int | None) -> Iterator[None]:
    """Context in which everything keeps to so many threads; None for all.

    Raises
    ------
    ValueError
        If there are not so many.
    """
    global _most
    before = _most
    with thread_count(threads):
        _most = threads or before
        try:
            yield
        finally:
            _most = before


def threads_for(pairs: int) -> int:
    """How many threads pay for a body of so many pairs of points: at most `most_threads`."""
    if _lost and pairs >= 2 * PAIRS_PER_THREAD:
        _say_lost()
    return max(1, min(most_threads(), pairs // PAIRS_PER_THREAD))


class Chunks(NamedTuple):
    """Into how many parts the work of a pass is cut, and how many threads share them."""

    threads: int
    number: int


def chunks_of(pairs: int) -> Chunks:
    """How passes over a body of so many pairs are cut up for the threads in use: at least into one chunk for each of them."""
    threads = threads_in_use()
    return Chunks(threads, 1 if threads == 1 else max(threads, pairs // PAIRS_PER_CHUNK))


@contextmanager
def thread_count(threads: int | None) -> Iterator[int]:
    """Context in which the kernels use `threads` threads (all that numba was started with if None); yields their number.

    Raises
    ------
    ValueError
        If there are not so many.
    """
    if _lost and threads not in (None, 1):
        _say_lost()
        threads = 1
    most = most_threads()
    if threads is not None and not 1 <= threads <= most:
        raise ValueError(f"threads must be between 1 and {most} on this machine, not {threads}")
    before = threads_in_use()
    numba.set_num_threads(threads or most)
    try:
        yield threads or most
    finally:
        numba.set_num_threads(before)
