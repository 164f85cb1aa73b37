"""Identity of a run: its scene, its force models and its mesh, by which results are told from results of other runs."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationError

from ..forces import ForceModel
from ..forces.identity import digest_of_model
from ..scenes import Mesh, Scene, SceneError

MESH = "mesh"
"""Key of the digest of a mesh file."""

MOST_TOLD, MOST_CHARACTERS = 3, 60
"""Number of differences that a message lists, and characters of a value in it. Chosen: the message stays some lines long, and three
differences tell a changed setting from another scene."""


@dataclass(frozen=True)
class Contents:
    """Inputs of a run that determine its results: the scene, the force models and the mesh file.

    Attributes
    ----------
    scene : dict
        The scene with all defaults, as plain values.
    force : str
        Name of the force model; with several materials, of the force model of the body outside the regions of ``materials``.
    digests : dict of str
        Digest of every force model by its name, and of the mesh file under `MESH`.
    """

    scene: dict[str, Any]
    force: str
    digests: dict[str, str]

    @classmethod
    def of(cls, scene: Scene, models: Sequence[ForceModel]) -> Self:
        """Return the contents of a new run from its scene and its force models; raise SceneError if its mesh file cannot be read."""
        digests = {model.name: digest_of_model(model) for model in models}
        if isinstance(scene.body, Mesh):
            digests[MESH] = digest_of_mesh(scene.body)
        return cls(_dump(scene), models[0].name, digests)

    @classmethod
    def read(cls, description: Any) -> Self | None:
        """Return the contents stored in a summary or in the identity of a checkpoint; None if they are missing, as in earlier versions."""
        try:
            scene = Scene.model_validate(description["scene_as_run"])
            return cls(_dump(scene), description["force"], dict(description["digests"]))
        except (KeyError, TypeError, ValueError, ValidationError):
            return None

    def describe(self) -> dict[str, Any]:
        """Return the contents as entries for a summary or a checkpoint, from which `read` restores them."""
        return {"force": self.force, "digests": self.digests, "scene_as_run": self.scene}

    def differences(self, now: Self) -> str:
        """Return a text that says how the contents of another run, `now`, differ from these; empty if they are equal."""
        found = differences_of({**self.scene, "title": None}, {**now.scene, "title": None})
        if self.force != now.force:
            found.append(f"force is {self.force} there and {now.force} here")
        changed = [name for name in self.digests if name in now.digests and self.digests[name] != now.digests[name]]
        found += [f"the file of the {MESH} has changed" if name == MESH else f"{name} is another one by that name" for name in changed]
        return told(found)


def differences_of(there: dict[str, Any], here: dict[str, Any]) -> list[str]:
    """Return texts such as "spacing is 0.1 there and 0.2 here", one for each entry that differs between two nested dictionaries."""
    before, now = _leaves(there), _leaves(here)
    return [
        f"{key} is {_value(before, key)} there and {_value(now, key)} here"
        for key in dict.fromkeys([*before, *now])
        if key not in before or key not in now or before[key] != now[key]
    ]


def told(differences: list[str]) -> str:
    """Return one text with the first few of a list of differences and the count of the rest; empty for an empty list."""
    more = f", and {len(differences) - MOST_TOLD} more" if len(differences) > MOST_TOLD else ""
    return "; ".join(differences[:MOST_TOLD]) + more


def digest_of_mesh(mesh: Mesh) -> str:
    """Return the SHA-256 digest of the file of a mesh; raise SceneError if the file cannot be read."""
    try:
        return hashlib.sha256(Path(mesh.file).read_bytes()).hexdigest()
    except OSError as error:
        raise SceneError(f"body.file: cannot read {mesh.file}: {error.strerror}") from None


def _dump(scene: Scene) -> dict[str, Any]:
    return scene.model_dump(mode="json", by_alias=True, exclude_none=True)


def _leaves(value: Any, key: str = "") -> dict[str, Any]:
    """Return the values in nested mappings and lists by dotted key; a list without mappings counts as one value."""
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        value = dict(enumerate(value))
    if not isinstance(value, dict):
        return {key: value}
    found: dict[str, Any] = {}
    for name, item in value.items():
        found |= _leaves(item, f"{key}.{name}" if key else str(name))
    return found


def _value(leaves: dict[str, Any], key: str) -> str:
    if key not in leaves:
        return "not given"
    text = str(leaves[key])
    return text if len(text) <= MOST_CHARACTERS else text[:MOST_CHARACTERS] + " ..."
