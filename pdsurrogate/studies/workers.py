"""Execution of the runs of a study on the cores of this machine or on the workers of Dask."""

import importlib.util
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Self

import joblib
import numba
from joblib.externals.loky.process_executor import TerminatedWorkerError

from ..arguments import check_whole_number
from ..results.files import write_json
from ..results.folder import LOCK, occupied
from ..run.simulate import SimulationInterrupted
from ..scenes import SceneError
from .runs import NOT_DONE, OUTCOME, FitTask, SceneTask

Outcome = tuple[str, str | None]
"""Name of a run's folder, and the reason of its failure; None if it succeeded; `NOT_DONE` if its
`max_time` was over.
"""


@dataclass(frozen=True)
class Workers:
    """Processes on this machine, or Dask workers, that carry out the runs of a study.

    Attributes
    ----------
    jobs : int
        Number of local runs at the same time; has no effect with Dask, which runs as many as its
        workers have threads.
    threads : int
        Threads of the kernels in each run.
    scheduler : str or None
        Address of the Dask scheduler.
    """

    jobs: int
    threads: int
    scheduler: str | None = None

    @classmethod
    def chosen(
        cls, runs: int, jobs: int | None, threads: int | None, scheduler: str | None
    ) -> Self:
        """Return workers with given numbers of jobs and threads; None stands for a number chosen
        from the cores and the number of `runs`.

        Raise TypeError or ValueError if a number is invalid; raise SceneError if jobs are given
        together with a scheduler, or if a scheduler is given but Dask is not installed.
        """
        for key, value in (("jobs", jobs), ("threads", threads)):
            if value is not None:
                check_whole_number(value, key, 1)
        if scheduler is not None:
            if jobs is not None:
                raise SceneError(
                    "jobs: with a scheduler, the threads of its workers set the number of parallel"
                    " runs; leave jobs out"
                )
            if importlib.util.find_spec("distributed") is None:
                raise SceneError(
                    'scheduler: Dask is not installed; pip install "pdsurrogate[dask]"'
                )
            return cls(1, threads or 1, scheduler)
        cores = joblib.cpu_count()
        if jobs is None:
            jobs = max(1, min(runs, cores // (threads or 1)))
        return cls(jobs, threads or max(1, cores // jobs))

    def carry_out(
        self, tasks: dict[str, SceneTask | FitTask], folder: Path, max_time: float | None = None
    ) -> Iterator[Outcome]:
        """Carry out the tasks, in parallel and for at most `max_time` seconds each, and yield the
        outcome of every run as it ends.

        `tasks` has, for each run, the name of its folder under `folder` as the key. Runs under way
        when a process is killed, for example when memory runs out, fail; the next study of the
        same description tries them again.
        """
        if not tasks:
            return
        left = dict(tasks)
        with self._backend(folder) as (study, backend, lost):
            while left:
                # Each worker gets one run at a time: only that run is lost with the worker.
                with joblib.parallel_config(**backend):
                    parallel = joblib.Parallel(return_as="generator_unordered", batch_size=1)
                calls = [
                    joblib.delayed(carry_out)(task, folder / place, self.threads, study, max_time)
                    for place, task in left.items()
                ]
                try:
                    for place, failure in parallel(calls):
                        del left[place]
                        yield place, failure
                except lost:
                    begun = [place for place in left if (folder / place / LOCK).exists()]
                    for place in begun or list(left):
                        del left[place]
                        yield place, "a process was killed beside it, or its own for lack of memory"

    @contextmanager
    def _backend(
        self, folder: Path
    ) -> Iterator[tuple[int | None, dict[str, Any], type[Exception]]]:
        """Yield the process id of the study, options of `joblib.parallel_config`, and the class of
        the error raised if a worker is killed.

        Local workers end when the process with that id ends; with Dask the id is None. Raise
        SceneError if no Dask scheduler answers, if it has no workers, or if one of them does not
        see `folder`.
        """
        if self.scheduler is None:
            yield (
                os.getpid(),
                {"backend": "loky", "n_jobs": self.jobs, "inner_max_num_threads": self.threads},
                TerminatedWorkerError,
            )
            return
        from distributed import Client
        from distributed.scheduler import KilledWorker

        try:
            client = Client(self.scheduler, timeout="10s", set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise SceneError(
                f"scheduler: no Dask scheduler answers at {self.scheduler}: {error}"
            ) from None
        with client:
            try:
                client.wait_for_workers(1, timeout=10)
            except TimeoutError:
                raise SceneError(
                    f"scheduler: the scheduler at {self.scheduler} has no workers; start them"
                    f" with: dask worker {self.scheduler}"
                ) from None
            seen = client.run(os.path.isdir, str(folder))
            if blind := [worker for worker, found in seen.items() if not found]:
                raise SceneError(
                    f"scheduler: {len(blind)} of {len(seen)} workers, the first {blind[0]}, cannot"
                    f" access {folder}; use a folder on a shared disk"
                )
            yield None, {"backend": "dask", "client": client}, KilledWorker


def carry_out(
    task: SceneTask | FitTask,
    folder: Path,
    threads: int,
    study: int | None,
    max_time: float | None = None,
) -> Outcome:
    """Carry out one run of a study in this process; write its outcome to the run's folder and
    return it.

    The kernels use `threads` threads, but at most as many as numba was started with. If the process
    with the id `study`, which started this one, ends, this process ends as well; Ctrl-C is left to
    that process.
    """
    if study is not None and os.getpid() != study:
        _depend_on(study)
    try:
        # A process whose study was killed, and which may hold the folder, ends within a second.
        with occupied(folder, 10.0):
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
    return folder.name, failure


@cache
def _depend_on(parent: int) -> None:
    """Let this process ignore Ctrl-C, and start a thread that ends it when its parent has ended, so
    that no worker of a killed study goes on writing.

    `parent` is the process id of the parent.
    """
    # A terminal sends Ctrl-C to the workers as well. It may reach one between two runs, in a
    # callback of Python that cannot raise and prints a traceback; the parent ends its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.2)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
