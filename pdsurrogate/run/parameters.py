"""Names of sensitivities: numbers of a scene, its laws and learned models that can be
parameters, and measurements of an output.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..forces import ForceModel
from ..forces.learned import Learned
from ..materials import Law
from ..materials.covariance import numbers_of, with_numbers_of
from ..problem.materials import scene_errors
from ..scenes import Scene
from ..scenes.problems import suggestion
from ..scenes.reading import apply_change, leaves

PLACES = ("material", "materials", "loads", "prescribed", "obstacles")
"""Keys of a scene below which numbers can be parameters of sensitivities: they change neither
the points nor which of them are held.
"""

AT_BREAK = re.compile(r"(crack|(materials\.\d+\.)?fracture)(\..*)?|peak_nominal_stress")
"""Names of results that are the load at break or the crack's, and of numbers that decide it."""

MODULI = ("shear_modulus", "bulk_modulus")
"""Numbers of a law that are no part of its `Law.shape`."""


def check_not_at_break(names: Iterable[str], what: str) -> None:
    """Raise ValueError if one of the names is that of the load at break, or of a number that
    decides it; `what` says of what they are the names.
    """
    for name in names:
        if AT_BREAK.fullmatch(name):
            raise ValueError(
                f"{what}: {name}: what a body bears at break has no derivative, since bonds break"
                " one after another; compare runs, in a study over the number"
            )


def laws_of(scene: Scene) -> dict[str, Law]:
    """Return the laws of a scene by key: ``"material"``, and ``"materials.0.material"`` and so
    on for regions that are not rigid.
    """
    parts = {
        f"materials.{number}.material": part.material for number, part in enumerate(scene.materials)
    }
    return {"material": scene.law()} | {
        key: material.build() for key, material in parts.items() if not material.rigid
    }


def numbers_in(scene: Scene, models: Sequence[ForceModel]) -> dict[str, float]:
    """Return, by dotted key, the numbers that can be parameters: of a scene, of its laws and of the
    arrays of its learned models.

    Numbers of a law are parameters whether they are stated or have their default, except
    coefficients of terms that the law does not have. A learned model holds for one `Law.shape`:
    with it, the moduli alone are parameters.
    """
    laws = laws_of(scene)
    by_law = by_key(models, "material")
    found = {}
    for key, value in leaves(scene.model_dump(mode="json")):
        if (
            key.split(".")[0] in PLACES
            and ".region." not in key
            and not any(key.startswith(f"{law}.") for law in laws)
        ):
            found[key] = value
    for key, law in laws.items():
        for name, value in numbers_of(law).items():
            free = name in MODULI or name in law.memory.numbers()
            fixed = isinstance(by_law.get(key), Learned) and not free
            missing = False
            if (
                "." in name and not value
            ):  # a coefficient: with any other value a missing term would add parameters to the law
                missing = len(with_numbers_of(law, {name: law.shear_modulus}).parameters) > len(
                    law.parameters
                )
            if not (fixed or missing):
                found[f"{key}.{name}"] = value
    for key, model in _learned(models).items():
        arrays = {
            name: values.tolist()
            for name, values in model.payload().items()
            if isinstance(values, np.ndarray)
        }
        found |= dict(leaves(arrays, key=key))
    return {
        key: float(value)
        for key, value in found.items()
        if isinstance(value, float | int) and not isinstance(value, bool)
    }


def _learned(models: Sequence[ForceModel]) -> dict[str, Learned]:
    """Return the learned models by the key of the scene that names them; a model that regions
    share has the key of the first.
    """
    keys = {id(model): key for key, model in reversed(by_key(models, "force").items())}
    return {keys[id(model)]: model for model in models if isinstance(model, Learned)}


def by_key(models: Sequence[ForceModel], last: str) -> dict[str, ForceModel]:
    """Return force models by the keys of a scene that name them, or those of their laws; `last`
    is ``"force"`` or ``"material"``.
    """
    return {
        last if not number else f"materials.{number - 1}.{last}": model
        for number, model in enumerate(models)
    }


def array_of(name: str, models: Sequence[ForceModel]) -> np.ndarray | None:
    """Return the array of a learned model in which a parameter is a number; None for a number of
    the scene.
    """
    for key, model in _learned(models).items():
        if name.startswith(f"{key}."):
            return model.payload()[name.removeprefix(f"{key}.").split(".")[0]]
    return None


def with_numbers(
    scene: Scene, models: Sequence[ForceModel], values: Mapping[str, float]
) -> tuple[Scene, list[ForceModel]]:
    """Return a scene and its force models with other values of the numbers that `numbers_in`
    names.
    """
    data = scene.model_dump(mode="json")
    changed = by_key(models, "force")
    learned = _learned(models)
    others = dict(values)
    for key, law in laws_of(scene).items():
        own = {
            name.removeprefix(f"{key}."): others.pop(name)
            for name in values
            if name.startswith(f"{key}.")
        }
        if own:
            apply_change(data, key, with_numbers_of(law, own).describe())
    for name, value in others.items():
        owner = next((key for key in learned if name.startswith(f"{key}.")), None)
        if owner is None:
            apply_change(data, name, value)
            continue
        before = changed[owner]
        array, *place = name.removeprefix(f"{owner}.").split(".")
        payload = before.payload()
        payload[array] = payload[array].copy()
        payload[array][tuple(map(int, place))] = value
        new = type(before).from_payload(
            before.name, payload, before.domain, before.law, before.shape
        )
        new = replace(new, stated=before.stated)
        changed = {key: new if model is before else model for key, model in changed.items()}
    if any(name in dict(leaves(data)) for name in values):
        scene = Scene.model_validate(data)
        by_law = by_key(list(changed.values()), "material")
        with scene_errors(scene):
            for key, law in laws_of(scene).items():
                by_law[key].check_material(law)
    return scene, list(changed.values())


def names_below(outputs: Sequence[str], measured: dict[str, float]) -> list[str]:
    """Return the names of all measurements that `outputs` names, each with all below it; raise
    ValueError for a name without any.

    ``"probes.tip.u2"`` names the same measurement as ``"probes.tip.displacement.1"``.
    """
    found: list[str] = []
    for output in outputs:
        component = re.fullmatch(r"(probes\..+)\.u([123])", output)
        key = f"{component[1]}.displacement.{int(component[2]) - 1}" if component else output
        below = [name for name in measured if name == key or name.startswith(f"{key}.")]
        if not below:
            raise ValueError(
                f"outputs: the result has no {output!r}; {suggestion(output, measured)}"
            )
        found += below
    return found
