"""Runs of a study: the scene or fit of each run, and their execution on the cores of this
machine or on the workers of Dask.
"""

import importlib.util
import json
import os
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Self

import joblib
import numba
from joblib.externals.loky.process_executor import TerminatedWorkerError

from .. import artifacts
from ..arguments import check_whole_number, suggestion
from ..discretization import check_size
from ..forces import FORCES, ForceModel
from ..forces.identity import digest_of, identity_of
from ..problem.materials import checked_models
from ..problem.program import names_of_forces
from ..results import Result, checkpoint, load_result
from ..results.contents import digest_of_mesh
from ..results.files import write_json
from ..results.folder import LOCK, SUMMARY, occupied
from ..run.derivatives import differentiate
from ..run.parameters import PLACES, numbers_in
from ..run.reopened import check_models
from ..run.simulate import SimulationFailed, SimulationInterrupted, simulate
from ..scenes import MaterialSpec, Mesh, Scene, SceneError, load_scene
from ..scenes.reading import apply_change
from .description import FORCE, Fit, Study, scene_of

SURROGATE = ("fitted", "1")
"""Name and version of the artifact that a fit leaves in its folder."""

OUTCOME = "outcome.json"
"""File that is written last in the folder of a run and marks it as done."""

SECONDS_TO_LEAVE = 10.0
"""Seconds to wait for another process that still holds the folder of a run; a process whose
study was killed ends within a second.
"""

DERIVATIVES = "derivatives.json"
"""File in the folder of a run with the derivatives that the study asked for, by column, or the
reason why there are none.
"""

NOT_DONE = "not done yet"
"""Text in place of the reason of failure for a run that is not finished: not started,
interrupted, or out of time.
"""


@dataclass(frozen=True)
class SceneTask:
    """One run of a scene in a study, which any process can carry out.

    Attributes
    ----------
    scene : Scene
    force : str or None
        Name of the force model, for an artifact with its version (or its absolute path if it cannot
        be found by name); None for the default force.
    digest : str
        Digest of everything that the result depends on: the scene, the force models and the mesh.
    outputs : tuple of str
        Measurements whose derivatives are computed.
    numbers : dict of str
        Parameters of the study by which they are computed, with the names that `differentiate` has
        for them.
    """

    scene: Scene
    force: str | None
    digest: str
    outputs: tuple[str, ...] = ()
    numbers: dict[str, str] = field(default_factory=dict)

    def carry_out(self, folder: Path, threads: int, max_time: float | None) -> str | None:
        """Simulate the scene and save the result in `folder`, that of this run, resuming from a
        checkpoint if there is one.

        Return the reason if the simulation failed, otherwise None. Raise SimulationInterrupted if
        it is stopped or `max_time` seconds are over, RuntimeError if the force or the mesh has
        changed since the task was made.
        """
        model = (
            artifacts.default_force(self.scene)
            if self.force is None
            else artifacts.load_surrogate(self.force)
        )
        if _scene_digest(self.scene, model) != self.digest:
            raise RuntimeError("the mesh or the force has changed since the study was started")
        failure = None
        if read_json(folder / OUTCOME) == {
            "digest": self.digest,
            "failure": None,
        }:  # without the derivatives
            result = load_result(folder)
        else:
            try:
                result = self._simulated(model, threads=threads, folder=folder, max_time=max_time)
            except SimulationInterrupted:
                raise
            except SimulationFailed as error:
                failure, result = str(error), error.result
            except SceneError as error:
                return str(error)
            result.save(folder)
        if self.outputs and failure is None:
            self._differentiate(checked_models(self.scene, model), result, folder)
        return failure

    def lacks_derivatives(self, folder: Path) -> bool:
        """Return whether the derivatives that the study asks for are not in the folder of this
        run.
        """
        return (
            bool(self.outputs)
            and (read_json(folder / DERIVATIVES) or {}).get("asked") != self._asked
        )

    @property
    def _asked(self) -> dict[str, list[str]]:
        return {"outputs": list(self.outputs), "parameters": list(self.numbers)}

    def _differentiate(self, models: list[ForceModel], result: Result, folder: Path) -> None:
        """Write the derivatives at the last output of the result, by the names of their columns,
        or why there are none.
        """
        values, failure = {}, None
        try:
            found = differentiate(
                self.scene, models, result, self.outputs, list(self.numbers.values()), -1
            )
        except (ValueError, IndexError) as error:
            failure = f"derivatives: {error}"
        else:
            rates = zip(found.outputs, found.derivatives.tolist(), strict=True)
            values = {
                f"d {name} / d {key}": rate
                for name, row in rates
                for key, rate in zip(self.numbers, row, strict=True)
            }
        write_json(
            folder / DERIVATIVES, {"asked": self._asked, "values": values, "failure": failure}
        )

    def _simulated(self, model: ForceModel, **options) -> Result:
        """Return the result of the simulation with a force model, resumed if the run's folder holds
        a usable checkpoint.

        `options`, with ``folder`` among them, are those of `simulate`.
        """
        with suppress(checkpoint.CheckpointError):
            return simulate(self.scene, model, **options, resume=True)
        return simulate(self.scene, model, **options, overwrite=True)


@dataclass(frozen=True)
class FitTask:
    """One fit of a surrogate in a study: the material, the `FitSettings`, and a digest of both."""

    material: MaterialSpec
    settings: Any
    digest: str

    def lacks_derivatives(self, folder: Path) -> bool:
        """Return False: a fit has none."""
        return False

    def carry_out(self, folder: Path, threads: int, max_time: float | None = None) -> str | None:
        """Fit and cross-validate a surrogate, and store it and a summary of its errors in `folder`,
        that of this run.

        Return the reason if the fit failed, otherwise None; `max_time` has no effect on fits.
        """
        # Imported here, since only a fit needs scikit-learn.
        from threadpoolctl import threadpool_limits

        from ..learning.fitting import TooInexact

        began = time.perf_counter()
        law, place = self.material.build(), folder / Path(*SURROGATE)
        with threadpool_limits(threads):
            if (
                not place.exists()
            ):  # it exists if an earlier attempt ended before writing its summary
                try:
                    self.settings.train(law)(folder, *SURROGATE)
                except (TooInexact, ValueError) as error:
                    return str(error)
        card = artifacts.load_card(place)
        folds = card.training["cross_validation"]
        summary = {
            "material": law.describe(),
            "artifact": "/".join(SURROGATE),
            **card.errors["box"],
            "outcome": card.training["outcome"],
            "cross_validation": folds,
            "cross_validated_rms": (
                (sum(row["rms"] ** 2 for row in folds) / len(folds)) ** 0.5 if folds else None
            ),
            "seconds_total": time.perf_counter() - began,
        }
        write_json(folder / SUMMARY, summary)
        return None


def tasks_of(
    study: Study, folder: Path, runs: list[dict[str, Any]], memory: float
) -> list[SceneTask | FitTask]:
    """Return the tasks (runs of scenes, or fits) of a study, checked as far as possible without
    building a body.

    `folder` is the folder of relative scene files, `runs` lists the parameters of each run, and
    `memory` is the number of bytes that a run may use. Raise SceneError if a run is invalid or
    needs more memory, or if a force model cannot be found or read; the message names the run and
    the key.
    """
    tasks: list[SceneTask | FitTask] = []
    for number, parameters in enumerate(runs, 1):
        try:
            tasks.append(
                _fit_task(study, parameters)
                if study.fit is not None
                else _scene_task(study, folder, parameters, memory)
            )
        except (SceneError, artifacts.ArtifactError) as error:
            told = ", ".join(f"{key}={value}" for key, value in parameters.items())
            raise SceneError(f"run {number} of {len(runs)} ({told}): {error}") from None
    return tasks


def _scene_task(study: Study, folder: Path, parameters: dict[str, Any], memory: float) -> SceneTask:
    changes = {key: value for key, value in parameters.items() if key != FORCE}
    scene = load_scene(scene_of(study, folder), {**study.set, **changes})
    check_size(scene, memory)
    force = parameters.get(FORCE, study.force)
    if force is None:
        model = artifacts.default_force(scene)
        return SceneTask(
            scene, None, _scene_digest(scene, model), *_derivatives(study, scene, model, changes)
        )
    if not isinstance(force, str):
        raise SceneError(f"force: must be the name or path of a force model, not {force!r}")
    scene, model = artifacts.with_material(scene, force)
    if force not in FORCES:
        # The name with its present version; an artifact that cannot be found by name is given by
        # its whole path.
        named = artifacts.find_artifact(force)
        name, force = f"{named.parent.name}@{named.name}", str(named.resolve())
        with suppress(artifacts.ArtifactError):
            force = name if artifacts.find_artifact(name).resolve() == named.resolve() else force
    return SceneTask(
        scene, force, _scene_digest(scene, model), *_derivatives(study, scene, model, changes)
    )


def _derivatives(
    study: Study, scene: Scene, model: ForceModel, parameters: Mapping[str, Any]
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the measurements of which a run has derivatives, and the names of its numbers by the
    keys of the `parameters`.

    Raise SceneError if derivatives are asked for and no parameter is such a number, or the force
    has none.
    """
    if not study.derivatives:
        return (), {}
    try:
        check_models(scene, checked_models(scene, model))
    except ValueError as error:
        raise SceneError(f"derivatives: {error}") from None
    _check_measurements(study.derivatives, scene)
    known = numbers_in(scene, ())
    numbers = {key: key for key in parameters if key in known}
    if scene.stretched and "stretches" in parameters:
        numbers["stretches"] = "stretch"
    if not numbers:
        told = ", ".join(study.parameters)
        places = f"a number of {', '.join(PLACES)}, or stretches"
        raise SceneError(
            f"derivatives: none of the parameters ({told}) is {places}: an equilibrium has"
            " derivatives by these alone"
        )
    return study.derivatives, numbers


def _check_measurements(names: Iterable[str], scene: Scene) -> None:
    """Raise SceneError if the last output of a scene is no equilibrium, or if a name has the probe,
    support or load of no entry of the scene.
    """
    if scene.dynamics is not None or (scene.steps and scene.steps[-1].dynamics is not None):
        raise SceneError(
            "derivatives: the last output of the scene is one of dynamics; derivatives are those of"
            " equilibria"
        )
    places = dict.fromkeys(names_of_forces(scene).values())
    for name in names:
        first, _, rest = name.partition(".")
        known = [probe.name for probe in scene.probes] if first == "probes" else places
        if (
            first in ("probes", "forces", "moments", "displacements")
            and rest
            and not any(f"{rest}.".startswith(f"{one}.") for one in known)
        ):
            raise SceneError(
                f"derivatives: {name!r}: the scene has none of this name;"
                f" {suggestion(rest.split('.')[0], known)}"
            )


def _scene_digest(scene: Scene, model: ForceModel) -> str:
    described = {
        "scene": scene.model_dump(mode="json"),
        "forces": [identity_of(own) for own in checked_models(scene, model)],
    }
    if isinstance(scene.body, Mesh):
        del described["scene"]["body"]["file"]  # the digest covers its contents, not its path
        described["mesh"] = digest_of_mesh(scene.body)
    return digest_of(described)


def _fit_task(study: Study, parameters: dict[str, Any]) -> FitTask:
    # Imported here, since only a fit needs scikit-learn.
    from ..learning.settings import FitSettings

    data = json.loads(json.dumps(study.fit))  # a deep copy of tables and lists
    for key, value in parameters.items():
        apply_change(data, key, value)
    try:
        fit = Fit(**data)
        settings = FitSettings(**fit.model_extra)
    except ValueError as error:
        raise SceneError(f"fit: {error}") from None
    described = {
        "material": fit.material.model_dump(mode="json"),
        **settings.model_dump(mode="json"),
    }
    return FitTask(fit.material, settings, digest_of(described))


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
                start = f"start them with: dask worker {self.scheduler}"
                raise SceneError(
                    f"scheduler: the scheduler at {self.scheduler} has no workers; {start}"
                ) from None
            seen = client.run(os.path.isdir, str(folder))
            if blind := [worker for worker, found in seen.items() if not found]:
                count = f"{len(blind)} of {len(seen)} workers, the first {blind[0]}"
                raise SceneError(
                    f"scheduler: {count}, cannot access {folder}; use a folder on a shared disk"
                )
            yield None, {"backend": "dask", "client": client}, KilledWorker


def read_json(file: Path) -> Any:
    """Return the content of a JSON file; None if the file cannot be read or is not JSON."""
    try:
        return json.loads(file.read_text("utf-8"))
    except (OSError, ValueError):
        return None


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
    with the id `study`, which started this one, ends, this process ends as well.
    """
    if study is not None and os.getpid() != study:
        _end_without(study)
    try:
        with occupied(folder, SECONDS_TO_LEAVE):
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
def _end_without(parent: int) -> None:
    """Start a thread that ends this process when its parent has ended, so that no worker of a
    killed study goes on writing.

    `parent` is the process id of the parent.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.2)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
