"""Reading scenes: built-in scenes by name, users' scenes from TOML files, and changes to their
keys.
"""

import copy
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from ..arguments import check_path, suggestion
from .model import MEMORY
from .problems import SceneError
from .scene import Scene

MOST_BYTES = 16 * 2**20
"""Greatest size of a scene or study file in bytes, enough for an outline of half a million
corners.
"""


def scene_names() -> list[str]:
    """Return the names of the built-in scenes.

    Returns
    -------
    list of str
        In alphabetical order.

    See Also
    --------
    pdsurrogate.load_scene : loads a scene.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> "uniaxial" in pds.scene_names()
    True
    """
    return sorted(
        path.name.removesuffix(".toml")
        for path in resources.files(__package__).iterdir()
        if path.name.endswith(".toml")
    )


def load_scene(
    reference: str | Path, changes: Mapping[str, Any] | Iterable[str] = (), **parameters: Any
) -> Scene:
    """Load a built-in scene by name, or a scene file.

    Parameters
    ----------
    reference : str or path
        Name of a built-in scene, or path of a TOML file.
    changes : mapping or iterable of str
        Changes by dotted key, e.g. ``{"material.shear_modulus": 2}`` or
        ``["material.shear_modulus=2"]``.
    **parameters
        Further changes of top-level keys.

    Returns
    -------
    Scene

    Raises
    ------
    SceneError
        If there is no such scene, the file is not valid TOML, or the description makes no sense.

    See Also
    --------
    pdsurrogate.scene_names : names of the built-in scenes.
    pdsurrogate.simulate : runs a scene.
    pdsurrogate.preview : draws a scene before it runs.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.load_scene("uniaxial", {"material.shear_modulus": 2.0}, spacing=0.1)
    <Scene uniaxial: rectangle, spacing 0.1 cm, neo-hookean, 3 stretches>
    """
    check_path(reference, "a scene's reference")
    place, source = _place_of(reference)
    data = read_description(place, "scene")
    if isinstance(changes, str):
        raise SceneError(
            f"changes must be a list of key=value, or a mapping, not the text {changes!r}"
        )
    pairs = changes.items() if isinstance(changes, Mapping) else map(parse_change, changes)
    changed = [*pairs, *parameters.items()]
    for key, value in changed:
        apply_change(data, key, value)
    built_in = str(reference) in scene_names()
    material = data.get("material")
    if (
        built_in
        and isinstance(material, dict)
        and {*MEMORY} & material.keys()
        and "reference" not in dict(changed)
    ):
        data.pop("reference", None)  # it is a solution for the elastic material
    body = data.get("body")
    if isinstance(body, dict) and isinstance(body.get("file"), str) and not built_in:
        # A scene file names its mesh from where it stands itself.
        body["file"] = str(Path(reference).parent / body["file"])
    parts = data.get("materials")
    for part in [data, *(parts if isinstance(parts, list) else ())]:
        spec = part.get("material") if isinstance(part, dict) else None
        if isinstance(spec, dict) and "card" in spec and not built_in:
            spec["card"] = str(Path(reference).parent / str(spec["card"]))
    try:
        return Scene(**data)
    except SceneError as error:
        raise SceneError(f"{source}: {error}") from None


def read_description(path: Path | Traversable, kind: str) -> dict[str, Any]:
    """Return the content of a scene or study file in TOML as a dictionary; `kind` is "scene" or
    "study", for messages.

    Raises
    ------
    SceneError
        If the file cannot be read, is not valid TOML, or has more than `MOST_BYTES`.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise SceneError(
                f"{path}: the file has more than {MOST_BYTES / 2**20:.0f} MiB, so it is not a scene"
                " or study"
            )
        return tomllib.loads(content.decode("utf-8-sig").replace("\r\n", "\n"))
    except OSError as error:
        raise SceneError(f"cannot read {kind} file {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SceneError(f"{path}: not valid TOML: it is not UTF-8 text") from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise SceneError(f"{path}: not valid TOML: {error}") from None


def parse_change(change: str) -> tuple[str, Any]:
    """Return the key and the value of a text ``key=value``; the value is read as TOML if
    possible, else as text, with commas as a list.
    """
    key, separator, value = change.partition("=")
    key = key.strip()
    value = value.strip()
    if not separator or not key or not value:
        raise SceneError(f"a change must have the form key=value, not {change!r}")
    for candidate in (value, f"[{value}]" if "," in value else value):
        try:
            return key, tomllib.loads(f"value = {candidate}")["value"]
        except (tomllib.TOMLDecodeError, RecursionError):
            continue
    if value[0] in "{[":
        raise SceneError(
            f"{key}: {value} is not valid TOML; text inside a table or list needs quotes, and"
            " numbers a digit before the point"
        )
    return key, [item.strip() for item in value.split(",")] if "," in value else value


def leaves(
    value: Any, whole: Callable[[Any], bool] = lambda value: False, key: str = ""
) -> Iterator[tuple[str, Any]]:
    """Yield each value in a nested table or list, at any depth, that is neither table nor list,
    preceded by its dotted key.

    A table or list for which the function `whole` returns True is not entered but yielded as one
    value. `key` is the dotted key of `value`.
    """
    if whole(value) or not isinstance(value, Mapping | list | tuple):
        yield key, value
        return
    for name, inner in value.items() if isinstance(value, Mapping) else enumerate(value):
        yield from leaves(inner, whole, f"{key}.{name}" if key else str(name))


def apply_change(data: dict, key: str, value: Any) -> None:
    """Change a description in place: set a dotted key, with numbers for entries of lists
    (``loads.0.traction``), to a copy of a value.

    Raises
    ------
    SceneError
        If the description has no place for the key.
    """
    *path, last = key.split(".")
    place: Any = data
    for depth, step in enumerate(path, 1):
        name = ".".join(path[:depth])
        following = (*path, last)[depth]
        number = _entry(place, step, key, path[: depth - 1])
        inner = place.get(number) if isinstance(place, dict) else place[number]
        if isinstance(inner, str) and step == "material":
            inner = {"law": inner}
        elif isinstance(inner, tuple):
            inner = list(inner)
        elif inner is None and not following.isdecimal():
            inner = {}
        if not isinstance(inner, dict | list):
            why = f"{name} is {inner!r}, which has no keys or entries; set {name}=... instead"
            raise SceneError(f"{key}: {'the scene has no ' + name if inner is None else why}")
        place[number] = inner
        place = inner
    place[_entry(place, last, key, path)] = copy.deepcopy(value)


def _entry(place: dict | list, step: str, key: str, before: list[str]) -> str | int:
    if isinstance(place, dict):
        return step
    if step.isdecimal() and int(step) < len(place):
        return int(step)
    name = ".".join(before)
    there = (
        f"its entries are {', '.join(f'{name}.{number}' for number in range(len(place)))}"
        if place
        else "it is empty"
    )
    raise SceneError(f"{key}: the list {name} has no entry {step!r}; {there}")


def _place_of(reference: str | Path) -> tuple[Path | Traversable, str]:
    """Return the path of a scene's file, and a name of the scene for messages; raise SceneError
    for an unknown name.
    """
    name = str(reference)
    if name in scene_names():
        return resources.files(__package__) / f"{name}.toml", f"scene {name}"
    path = Path(reference)
    if not name or (path.suffix != ".toml" and not path.exists()):
        hint = suggestion(
            name, scene_names(), "give the path of a .toml file, or a built-in scene:"
        )
        raise SceneError(f"unknown scene {name!r}; {hint}")
    return path, str(path)
