"""Material of an artifact, for scenes (descriptions of a simulation) that state no material of
their own.
"""

import json
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..forces import FORCES, ForceModel, OutsideDomainWarning
from ..forces.learned_energy import LearnedEnergy
from ..materials import Law
from ..materials.memory import untested_rates
from ..scenes import MaterialSpec, Scene, SceneError, load_scene, scene_names
from .card import NOTED, Card
from .measured import unit_of_stress, with_measured
from .places import find_artifact
from .store import default_force, law_of, load_card, load_surrogate

SECONDS = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
"""Units of time in seconds, in which times of tests and relaxation times on cards are."""


def with_material(scene: Scene, reference: str | Path | None) -> tuple[Scene, ForceModel]:
    """Return a scene, with a material for which a force model holds, and the force model.

    Materials that are those of an artifact are read first, see `sourced`. An exact force model
    then leaves the scene as it is. With an artifact as the force, a built-in scene with its
    default material takes the law on the artifact's card, with these moduli:

    * moduli identified from test data with a unit are converted to the scene's unit of stress, and
      relaxation times, in seconds, to its unit of time; a scene without such a unit of stress is
      refused;
    * other identified or user-given moduli are taken as numbers in the scene's unit of stress;
    * moduli left at the law's defaults have no unit, and are scaled so that the shear modulus is
      that of the scene.

    Numbers of `fracture` that are ``"artifact"`` are the means of the tests on the card, converted
    in the same way.

    With branches or softening it has no reference any more, since references are elastic solutions.

    Any other scene keeps the material that it states; a scene without a material takes the material
    of the card unchanged.

    Parameters
    ----------
    scene : Scene
    reference : str or path, optional
        Force model or artifact, as for `load_surrogate`; by default that of `default_force`.

    Raises
    ------
    ArtifactError
        If the artifact cannot be read.
    SceneError
        As of `sourced`; and if the scene states another material than the artifact's; the message
        gives both, and how to take the artifact's.

    Warns
    -----
    UserWarning
        If the RMS error that the card states exceeds 1 % (`pdsurrogate.artifacts.card.NOTED`); or
        if a learned energy of a body with branches or softening has none for the scene's plane,
        where the exact energy of its material is used.
    OutsideDomainWarning
        If grips stretch a body with branches at rates that the tests behind them did not have.
    """
    scene = sourced(scene)
    if reference is None:
        return scene, default_force(scene)
    model = load_surrogate(reference)
    if isinstance(reference, str) and reference in FORCES:
        return scene, model
    own = None if scene.material is None else scene.law()
    card = load_card(reference)
    rms = card.errors["box"]["on_surface"]["rms"]
    if rms > NOTED:
        warnings.warn(
            f"according to its card, {model.name} has an RMS error of {100 * rms:.2g} % relative"
            f" to {card.material.law}; results are not more accurate than that; force=analytic is"
            " exact",
            stacklevel=3,
        )
    is_example = scene.name in scene_names() and scene.material == load_scene(scene.name).material
    try:
        if own is None:
            raise ValueError("the scene states no material")
        model.check_material(own)
        described = own
    except ValueError as error:
        try:
            described = material_on(card, scene)
            model.check_material(described)
        except SceneError:  # a unit of stress is missing
            raise
        except ValueError:  # the model contradicts its own card
            raise SceneError(f"scene {scene.name}: {error}") from None
        if own is not None and not is_example:
            raise SceneError(
                f"scene {scene.name}: material: {error}; to use the material of {model.name}, add"
                f" --set 'material={in_words(described)}'"
            ) from None
    if described is own and is_example and not scene.materials and _has_moduli(card):
        described = material_on(card, scene)
    if described != own:
        update = {"material": MaterialSpec.model_validate(described.describe())}
        # References are elastic solutions.
        update |= {"reference": None} if described.memory else {}
        scene = scene.model_copy(update=update)
    measured = card.domain.rates
    rates = rates_between_grips(scene) if described.memory.branches else None
    if measured and rates and (words := untested_rates(measured, *rates)):
        warnings.warn(f"scene {scene.name}: {words}", OutsideDomainWarning, stacklevel=3)
    if described.memory and scene.plane not in model.remembers and isinstance(model, LearnedEnergy):
        warnings.warn(
            f"scene {scene.name}: {model.name} has no energy with branches or softening for"
            f" plane={scene.plane}: the exact energy of its material is used (bond-energy), without"
            " a check of its domain",
            stacklevel=3,
        )
        model = load_surrogate("bond-energy")
    return with_measured(scene, card), model


def sourced(scene: Scene) -> Scene:
    """Return a scene in which the laws on the cards of artifacts replace materials that are those
    of artifacts, and the means of their tests the numbers of `fracture` that are ``"artifact"``.

    Moduli, times and means are converted to the units of the scene as in `with_material`.

    Raises
    ------
    ArtifactError
        If an artifact cannot be read.
    SceneError
        If the moduli on a card are the defaults of its law, or a number has no tests on it; the
        message names the key.
    """
    rest = scene.material and scene.material.artifact
    if not rest and not any(part.material.artifact for part in scene.materials):
        return scene
    own = _of_card(scene, scene.material, "material")
    laws = [
        _of_card(scene, part.material, f"materials.{number}.material")
        for number, part in enumerate(scene.materials)
    ]
    measured = with_measured(scene, load_card(rest) if rest else None)
    parts = tuple(
        part.model_copy(update={"material": law})
        for part, law in zip(measured.materials, laws, strict=True)
    )
    scene = measured.model_copy(update={"material": own, "materials": parts})
    # References are elastic solutions.
    return scene.model_copy(update={"reference": None}) if scene.remembers else scene


def _of_card(scene: Scene, given: MaterialSpec | None, key: str) -> MaterialSpec | None:
    """Return the material of a scene, that on its card if it is that of an artifact."""
    if given is None or given.artifact is None:
        return given
    card = load_card(find_artifact(given.artifact, ()))
    if not _has_moduli(card):
        raise SceneError(
            f"scene {scene.name}: {key}: the moduli on the card of {card.name}@{card.version} are"
            f" the defaults of {card.material.law}, of no material; state law and moduli"
        )
    return MaterialSpec.model_validate(material_on(card, scene).describe())


def rates_between_grips(scene: Scene) -> tuple[float, float] | None:
    """Return the mean and the greatest rate of stretch of a body between grips, per second, None
    for other bodies, whose rates loads determine, and for bodies without times.
    """
    if not scene.stretched or not scene.times:
        return None
    moved = np.abs(np.diff(scene.stretches, prepend=1.0))
    steps = np.diff(scene.times, prepend=0.0)
    going = moved > 0
    if not going.any():
        return None
    if not steps.sum() > 0:
        return np.inf, np.inf
    greatest = np.inf if not steps[going].all() else (moved[going] / steps[going]).max()
    second = SECONDS.get(scene.units.time or "s", 1.0)
    return float(moved.sum() / steps.sum() / second), float(greatest / second)


def material_on(card: Card, scene: Scene) -> Law:
    """Return the law of a card with its parameters, and moduli in the unit of stress of `scene`, by
    the rules of `with_material`.

    Raises
    ------
    ArtifactError
        If the law of the card is unknown.
    """
    law = law_of(card)
    if not _has_moduli(card):
        return (
            law
            if scene.material is None
            else law.scaled(scene.law().shear_modulus / law.shear_modulus)
        )
    law = law.scaled(unit_of_stress(card, scene))
    tests = card.training.get("identification") or {}
    second = SECONDS.get(tests.get("time_unit", "s"))
    if tests and law.memory and second and scene.units.time in SECONDS:
        law = replace(law, memory=law.memory.scaled(1.0, second / SECONDS[scene.units.time]))
    return law


def _has_moduli(card: Card) -> bool:
    """Return whether the moduli on a card were identified from test data or given by the user,
    rather than left at the law's defaults.
    """
    given = law_of(card)
    return (
        bool(card.training.get("identification"))
        or abs(given.shear_modulus - type(given)().shear_modulus) > 1e-9
    )


def in_words(law: Law) -> str:
    """Return a law as an inline table, the text of ``material`` in a scene file (TOML), with all
    digits.
    """
    return inline(law.describe())


def inline(value: Any) -> str:
    """Return a value as TOML in a line."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}={inline(one)}' for key, one in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(inline, value))}]"
    return json.dumps(value)
