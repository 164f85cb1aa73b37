"""Runs of a study: the scene or fit of each run, which any process can carry out."""

import json
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .. import artifacts
from ..arguments import suggestion
from ..discretization import check_size
from ..forces import FORCES, ForceModel
from ..forces.identity import digest_of, identity_of
from ..problem.materials import checked_models
from ..problem.program import names_of_forces
from ..results import Result, checkpoint, load_result
from ..results.contents import digest_of_mesh
from ..results.files import write_json
from ..results.folder import SUMMARY
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
                failure = str(error)
                result = error.result
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
        values = {}
        failure = None
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
        law = self.material.build()
        place = folder / Path(*SURROGATE)
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
    if force is not None and not isinstance(force, str):
        raise SceneError(f"force: must be the name or path of a force model, not {force!r}")
    scene, model = artifacts.with_material(scene, force)
    if force is not None and force not in FORCES:
        # The name with its present version; an artifact that cannot be found by name is given by
        # its whole path.
        named = artifacts.find_artifact(force)
        name = f"{named.parent.name}@{named.name}"
        force = str(named.resolve())
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
        raise SceneError(
            f"derivatives: none of the parameters ({told}) is a number of {', '.join(PLACES)}, or"
            " stretches: an equilibrium has derivatives by these alone"
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


def read_json(file: Path) -> Any:
    """Return the content of a JSON file; None if the file cannot be read or is not JSON."""
    try:
        return json.loads(file.read_text("utf-8"))
    except (OSError, ValueError):
        return None
