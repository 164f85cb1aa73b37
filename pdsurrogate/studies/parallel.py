"""Parallel execution of the runs of a study, on the cores of this machine or on the workers of a Dask scheduler."""

from __future__ import annotations

import importlib.util
import os
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import joblib
import numba
from joblib.externals.loky.process_executor import TerminatedWorkerError

from ..arguments import check_whole_number
from ..results.files import write_json
from ..results.folder import LOCK, FolderTaken, occupied
from ..run.simulate import SimulationInterrupted
from ..scenes import SceneError
from .tasks import Task

OUTCOME = "outcome.json"
"""File that is written last in the folder of a run and marks it as done."""

SECONDS_TO_LEAVE = 10.0
"""Seconds to wait for another process that still holds the folder of a run; a process whose study was killed ends within a second."""

NOT_DONE = "not done yet"
"""Failure of a run that has not been carried out to its end."""

MOST_ENDS = 2
"""Number of times that a run may lose its process before it counts as failed."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run.

    Attributes
    ----------
    place : str
        Name of its folder.
    failure : str or None
        Why it failed, if it did; `NOT_DONE` if its time was over, after which it resumes with the study.
    """

    place: str
    failure: str | None


@dataclass(frozen=True)
class Workers:
    """Processes or Dask workers that carry out the runs.

    Attributes
    ----------
    jobs : int
        Runs at the same time; with Dask, the threads of its workers.
    threads : int
        Threads of the kernels in each run.
    scheduler : str or None
        Address of the Dask scheduler.
    """

    jobs: int
    threads: int
    scheduler: str | None = None

    @classmethod
    def chosen(cls, runs: int, jobs: int | None, threads: int | None, scheduler: str | None) -> Workers:
        """Return workers with the given jobs and threads; values left open are chosen from the number of cores.

        Raise TypeError or ValueError if a number is invalid, SceneError if jobs are given together with a scheduler, or if Dask is not
        installed.
        """
        for key, value in (("jobs", jobs), ("threads", threads)):
            if value is not None:
                check_whole_number(value, key, 1)
        if scheduler is not None:
            if jobs is not None:
                raise SceneError("jobs: with a scheduler the number of jobs is that of its workers' threads; leave jobs out")
            if importlib.util.find_spec("distributed") is None:
                raise SceneError('scheduler: Dask is not installed; pip install "pdsurrogate[dask]"')
            return cls(1, threads or 1, scheduler)
        cores = joblib.cpu_count()
        if jobs is None:
            jobs = max(1, min(runs, cores // (threads or 1)))
        return cls(jobs, threads or max(1, cores // jobs))

    @property
    def caution(self) -> str | None:
        """Warning if more threads are requested than there are cores, else None."""
        cores = joblib.cpu_count()
        if self.scheduler is None and self.jobs * self.threads > max(cores, self.threads):
            return f"{self.jobs} jobs of {self.threads} threads share {cores} cores and will slow each other down"
        return None

    def carry_out(self, tasks: dict[str, Task], folder: Path, max_time: float | None = None) -> Iterator[Outcome]:
        """Carry out the runs, each in its folder under `folder` and for at most `max_time` seconds; yield the outcome of each as it ends.

        A run whose process is killed, for example when memory runs out, is tried once more.
        """
        if not tasks:
            return
        left, ends = dict(tasks), dict.fromkeys(tasks, 0)
        with self._backend(folder) as (study, backend, lost):
            while left:
                # Each worker gets one run at a time: only that run is lost with the worker.
                with joblib.parallel_config(**backend):
                    parallel = joblib.Parallel(return_as="generator_unordered", batch_size=1)
                calls = [joblib.delayed(carry_out)(task, folder / place, self.threads, study, max_time) for place, task in left.items()]
                try:
                    for outcome in parallel(calls):
                        del left[outcome.place]
                        yield outcome
                except lost:
                    begun = [place for place in left if (folder / place / LOCK).exists()]
                    for place in begun or list(left):
                        ends[place] += 1
                        if ends[place] >= MOST_ENDS:
                            del left[place]
                            yield Outcome(place, f"its process was killed {MOST_ENDS} times, possibly for lack of memory")

    @contextmanager
    def _backend(self, folder: Path) -> Iterator[tuple[int | None, dict[str, Any], type[Exception]]]:
        """Yield the process id of the study, options of `joblib.parallel_config`, and the exception raised when a worker is killed.

        Local workers end when the process of that id ends; it is None with Dask. Raise SceneError unless the workers of a Dask scheduler
        see the study's folder.
        """
        if self.scheduler is None:
            yield os.getpid(), {"backend": "loky", "n_jobs": self.jobs, "inner_max_num_threads": self.threads}, TerminatedWorkerError
            return
        from distributed import Client
        from distributed.scheduler import KilledWorker

        try:
            client = Client(self.scheduler, timeout="10s", set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise SceneError(f"scheduler: no Dask scheduler answers at {self.scheduler}: {error}") from None
        with client:
            try:
                client.wait_for_workers(1, timeout=10)
            except TimeoutError:
                start = f"start them with: dask worker {self.scheduler}"
                raise SceneError(f"scheduler: the one at {self.scheduler} has no workers; {start}") from None
            seen = client.run(os.path.isdir, str(folder))
            if blind := [worker for worker, found in seen.items() if not found]:
                count = f"{len(blind)} of {len(seen)} workers, the first {blind[0]}"
                raise SceneError(f"scheduler: {count}, do not see {folder}; put it on a shared disk")
            yield None, {"backend": "dask", "client": client}, KilledWorker


def carry_out(task: Task, folder: Path, threads: int, study: int | None, max_time: float | None = None) -> Outcome:
    """Carry out one run in this process and return its outcome, which is also in its folder.

    `threads` is limited to those that numba was started with. If `study`, the process of the study, ends, this process ends as well.
    """
    if study is not None and os.getpid() != study:
        _end_without(study)
    try:
        with _held(folder):
            failure = task.carry_out(folder, min(threads, numba.config.NUMBA_NUM_THREADS), max_time)
            write_json(folder / OUTCOME, {"digest": task.digest, "failure": failure})
    except SimulationInterrupted as stopped:
        if not stopped.out_of_time:
            raise KeyboardInterrupt from None
        failure = NOT_DONE
    except OSError as error:
        failure = f"could not write {error.filename or folder}: {error.strerror or error}"
    except Exception as error:  # a failed run must not stop the others
        failure = f"{type(error).__name__}: {error}"
    return Outcome(folder.name, failure)


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Hold the folder like `occupied`, but first wait for a process whose study was killed and that will soon end."""
    until = time.monotonic() + SECONDS_TO_LEAVE
    with ExitStack() as held:
        while True:
            try:
                held.enter_context(occupied(folder))
                break
            except FolderTaken:
                if time.monotonic() > until:
                    raise
                time.sleep(0.2)
        yield


@cache
def _end_without(parent: int) -> None:
    """End this process once its parent is gone, so that no orphan of a killed study writes to the folder."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.2)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
