"""Identity of a run: its scene, its force models and its mesh, by which results are told from
results of other runs.
"""

import hashlib
from collections.abc import Sequence
from typing import Any

from pydantic import ValidationError

from ..decks import files_of
from ..forces import ForceModel
from ..forces.identity import digest_of_model
from ..scenes import Mesh, Scene, SceneError
from ..scenes.reading import leaves

MESH = "mesh"
"""Key of the digest of the scene's mesh file among the digests of the force models."""

MOST_TOLD = 3
MOST_CHARACTERS = 60
"""Greatest number of differences between the inputs of two runs that a message lists, and of
characters that it shows of a value.
"""


def contents_of(scene: Scene, models: Sequence[ForceModel]) -> dict[str, Any]:
    """Return the inputs of a run that determine its results, as entries for its summary and its
    checkpoints.

    Raise SceneError if the file of the scene's mesh cannot be read.

    Returns
    -------
    dict
        ``scene_as_run``: the scene with all defaults, as plain values; ``force``: name of the force
        model (in a body of several materials, of the model for the points outside all regions of
        ``materials``); ``digests``: digest of every force model by its name, and of the mesh file
        under `MESH`.
    """
    digests = {model.name: digest_of_model(model) for model in models}
    if isinstance(scene.body, Mesh):
        digests[MESH] = digest_of_mesh(scene.body)
    return {"force": models[0].name, "digests": digests, "scene_as_run": _dump(scene)}


def contents_in(entries: Any) -> dict[str, Any] | None:
    """Return the scene, the name of the force and the digests of a run, in the form of
    `contents_of`; None if they are missing or invalid.

    `entries` is what was read from the run's ``summary.json`` or from the identity in its
    checkpoint (`Checkpoint.write`).
    """
    try:
        scene = Scene.model_validate(entries["scene_as_run"])
        return {
            "force": entries["force"],
            "digests": dict(entries["digests"]),
            "scene_as_run": _dump(scene),
        }
    except (KeyError, TypeError, ValueError, ValidationError):
        return None


def differences_between(there: dict[str, Any], now: dict[str, Any]) -> str:
    """Return a text that says how two runs differ in scene, force model or mesh file; empty if they
    are equal but for the scene's title.

    `there` is the run found in a folder, `now` the run that is to begin, both in the form of
    `contents_of`.
    """
    before, after = (
        {
            **leaves_of({**contents["scene_as_run"], "title": None}),
            "force": contents["force"],
        }
        for contents in (there, now)
    )
    found = [
        f"{key} is {_value(before, key)} there and {_value(after, key)} here"
        for key in {**before, **after}
        if before.get(key) != after.get(key)
    ]
    found += [
        f"the file of the {MESH} has changed" if name == MESH else f"{name} is another one now"
        for name, digest in there["digests"].items()
        if now["digests"].get(name, digest) != digest
    ]
    more = f", and {len(found) - MOST_TOLD} more" if len(found) > MOST_TOLD else ""
    return "; ".join(found[:MOST_TOLD]) + more


def digest_of_mesh(mesh: Mesh) -> str:
    """Return the SHA-256 digest of the file of a mesh with those that it includes; raise
    SceneError if one cannot be read.
    """
    try:
        return hashlib.sha256(
            b"".join(path.read_bytes() for path in files_of(mesh.file))
        ).hexdigest()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise SceneError(f"body.file: cannot read {mesh.file}: {reason}") from None


def _dump(scene: Scene) -> dict[str, Any]:
    return scene.model_dump(mode="json", by_alias=True, exclude_none=True)


def leaves_of(value: Any) -> dict[str, Any]:
    """Return the values in nested mappings and lists by dotted key; a list without mappings
    counts as one value.
    """
    return dict(
        leaves(
            value,
            lambda inner: (
                isinstance(inner, list) and not any(isinstance(item, dict) for item in inner)
            ),
        )
    )


def _value(entries: dict[str, Any], key: str) -> str:
    text = str(entries.get(key, "not given"))
    return text if len(text) <= MOST_CHARACTERS else text[:MOST_CHARACTERS] + " ..."
