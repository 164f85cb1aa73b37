"""Tasks of a study: a run that simulates a scene or fits a surrogate, with its results in its own folder."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from pydantic import ValidationError

from .. import artifacts
from ..discretisation import check_size
from ..forces import FORCES, ForceModel
from ..forces.identity import digest_of, identity_of
from ..problem.materials import checked_models
from ..results import Result
from ..results.checkpoint import NAME as CHECKPOINT
from ..results.checkpoint import CheckpointError
from ..results.contents import digest_of_mesh
from ..results.files import write_json
from ..results.folder import SUMMARY
from ..run.simulate import SimulationFailed, SimulationInterrupted, simulate
from ..scenes import Mesh, Scene, SceneError, load_scene
from ..scenes.problems import explain
from ..scenes.reading import apply_change
from .description import FORCE, Fit, Study, scene_of

SURROGATE = ("fitted", "1")
"""Name and version of the artefact that a fit leaves in its folder."""


class Task(Protocol):
    """One checked run of a study, which can be carried out in any process.

    Attributes
    ----------
    digest : str
        Digest of everything that its result depends on.
    """

    digest: str

    def carry_out(self, folder: Path, threads: int, max_time: float | None) -> str | None:
        """Carry out the run in its own folder; return why it failed, or None; raise SimulationInterrupted if it is stopped."""


@dataclass(frozen=True)
class SceneTask:
    """Run of a scene; `force` is a reference that other machines resolve alike, or None for the default."""

    scene: Scene
    force: str | None
    digest: str

    def carry_out(self, folder: Path, threads: int, max_time: float | None) -> str | None:
        """Simulate, from the checkpoint in the folder if there is one."""
        model = artifacts.default_force(self.scene) if self.force is None else artifacts.load_surrogate(self.force)
        if _scene_digest(self.scene, model) != self.digest:
            raise RuntimeError("the mesh or the force has changed since the study was started")
        failure = None
        try:
            result = self._simulated(model, threads=threads, folder=folder, max_time=max_time)
        except SimulationInterrupted:
            raise
        except SimulationFailed as error:
            failure, result = str(error), error.result
        except SceneError as error:
            return str(error)
        result.save(folder)
        return failure

    def _simulated(self, model: ForceModel, **options) -> Result:
        """Return the result of the run, resumed from its checkpoint if there is a usable one."""
        if (options["folder"] / CHECKPOINT).is_file():
            with suppress(CheckpointError):
                return simulate(self.scene, model, **options, resume=True)
        return simulate(self.scene, model, **options, overwrite=True)


@dataclass(frozen=True)
class FitTask:
    """Fit of a surrogate."""

    fit: Fit
    digest: str

    def carry_out(self, folder: Path, threads: int, max_time: float | None = None) -> str | None:
        """Fit, cross-validate, and store the artefact with its scores."""
        # Imported here, since only a fit needs scikit-learn.
        from threadpoolctl import threadpool_limits

        from ..learning.fitting import TooInexact

        began = time.perf_counter()
        law, settings = self.fit.material.build(), settings_of(self.fit)
        place = folder / Path(*SURROGATE)
        with threadpool_limits(threads):
            if not place.exists():  # it exists if an earlier attempt ended before writing its summary
                try:
                    settings.train(law)(folder, *SURROGATE)
                except (TooInexact, ValueError) as error:
                    return str(error)
        card = artifacts.load_card(place)
        folds = card.training["cross_validation"]
        summary = {
            "material": law.describe(),
            "artefact": "/".join(SURROGATE),
            **card.errors["box"],
            "outcome": card.training["outcome"],
            "cross_validation": folds,
            "cross_validated_rms": (sum(row["rms"] ** 2 for row in folds) / len(folds)) ** 0.5 if folds else None,
            "seconds_total": time.perf_counter() - began,
        }
        write_json(folder / SUMMARY, summary)
        return None


def settings_of(fit: Fit):
    """Return the settings of a fit in the form used by `pdsurrogate.learning`."""
    from ..learning.settings import FitSettings

    return FitSettings(**{key: value for key, value in fit if key != "material"})


def tasks_of(study: Study, folder: Path, runs: list[dict[str, Any]], memory: float) -> list[Task]:
    """Return all runs of a study, checked as far as possible without building a body.

    `folder` is that of relative scene files, `runs` are the parameters of each run, and `memory` the bytes that a run may use. Raise
    SceneError, which names the run and the key, if a run is invalid, and ArtifactError if a force cannot be found or read.
    """
    tasks: list[Task] = []
    for number, parameters in enumerate(runs, 1):
        try:
            tasks.append(_fit_task(study, parameters) if study.fit is not None else _scene_task(study, folder, parameters, memory))
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
        return SceneTask(scene, None, _scene_digest(scene, artifacts.default_force(scene)))
    if not isinstance(force, str):
        raise SceneError(f"force: must be the name or path of a force model, not {force!r}")
    scene, model = artifacts.with_material(scene, force)
    if force not in FORCES:
        # The name with its present version; an artefact that cannot be found by name is given by its whole path.
        named, which = artifacts.find_artifact(force), artifacts.parted(force)[1]
        force = f"{named.parent.name}@{named.name}" if _found_by_name(named) else str(named.resolve())
        force += "" if which is None else f"#{which}"
    return SceneTask(scene, force, _scene_digest(scene, model))


def _found_by_name(place: Path) -> bool:
    try:
        return artifacts.find_artifact(f"{place.parent.name}@{place.name}").resolve() == place.resolve()
    except artifacts.ArtifactError:
        return False


def _scene_digest(scene: Scene, model: ForceModel) -> str:
    described = {"scene": scene.model_dump(mode="json"), "forces": [identity_of(own) for own in checked_models(scene, model)]}
    if isinstance(scene.body, Mesh):
        del described["scene"]["body"]["file"]  # the digest covers its contents, not its path
        described["mesh"] = digest_of_mesh(scene.body)
    return digest_of(described)


def _fit_task(study: Study, parameters: dict[str, Any]) -> FitTask:
    data = json.loads(json.dumps(study.fit))  # a deep copy of tables and lists
    for key, value in parameters.items():
        apply_change(data, key, value)
    try:
        fit = Fit.model_validate(data)
        settings_of(fit)
    except ValueError as error:
        raise SceneError(f"fit: {explain(error, Fit) if isinstance(error, ValidationError) else error}") from None
    return FitTask(fit, digest_of(fit.model_dump(mode="json")))
