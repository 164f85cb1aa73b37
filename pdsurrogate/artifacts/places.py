"""Places of artifacts: folders, names and versions, and the search path on which they are found."""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..arguments import check_path, suggestion
from ..forces import FORCES
from .card import NAME_PATTERN, VERSION_PATTERN, ArtifactError

CARD = "card.json"


@contextmanager
def reading() -> Iterator[None]:
    """Context manager or decorator that turns an OSError from reading files or folders into an
    ArtifactError with the path.
    """
    try:
        yield
    except OSError as error:
        raise ArtifactError(f"{error.filename}: cannot be read: {error.strerror}") from None


SHIPPED = (
    Path(__file__).resolve().parents[1] / "_artifacts",
    Path(__file__).resolve().parents[2] / "artifacts",
)
"""Folders of the artifacts that are shipped with the package: in an installed package, and in a
checkout of its repository.
"""

OWN = "artifacts"
OWN_IN_CHECKOUT = "own-artifacts"
"""Names of the folder of a user's own artifacts within the working folder: usually ``artifacts``.

In a checkout of this package ``artifacts`` holds the shipped artifacts, so the user's own are in
``own-artifacts``.
"""


def own_folder() -> Path:
    """Return the folder of a user's artifacts: the value of ``PDSURROGATE_ARTIFACTS``, a variable
    of the environment, if it is set.

    Otherwise the folder is ``artifacts`` in the working folder; or ``own-artifacts`` in a checkout
    of this package, where ``artifacts`` holds the shipped artifacts.
    """
    chosen = os.environ.get("PDSURROGATE_ARTIFACTS")
    return Path(chosen or (OWN_IN_CHECKOUT if Path(OWN).resolve() in SHIPPED else OWN))


def next_version(folder: str | Path, name: str) -> str:
    """Return the next version of artifact `name` in a folder: the first number of its highest
    version plus 1.

    Return 3 after 2.1.4, and 1 for a new name.
    """
    check_path(folder, "folder")
    _check_name(name)
    versions = _versions(Path(folder) / name)
    return str(_version_key(versions[-1])[0] + 1) if versions else "1"


def search_path() -> list[Path]:
    """Return the folders in which artifacts are looked up by name, first match first.

    The folders are ``PDSURROGATE_ARTIFACTS`` if set, ``own-artifacts`` and ``artifacts`` in the
    working folder, and the shipped folders.
    """
    chosen = os.environ.get("PDSURROGATE_ARTIFACTS")
    if chosen and not Path(chosen).is_dir():
        raise ArtifactError(
            f"PDSURROGATE_ARTIFACTS is {chosen!r}, which is not a folder: set it to a folder of"
            " artifacts, or unset it"
        )
    return [
        folder
        for folder in (
            *([Path(chosen)] if chosen else []),
            Path(OWN_IN_CHECKOUT),
            Path(OWN),
            *SHIPPED,
        )
        if folder.is_dir()
    ]


@reading()
def list_artifacts() -> list[Path]:
    """Return the folders of all versions of all artifacts on the search path, sorted by name and
    rising version.
    """
    names = {folder.name for root in search_path() for folder in root.iterdir() if folder.is_dir()}
    return [
        version
        for name in sorted(names)
        for version in _on_search_path(name)
        if (version / CARD).is_file()
    ]


@reading()
def find_artifact(reference: str | Path, models: Sequence[str] = tuple(FORCES)) -> Path:
    """Return the folder of an artifact.

    Parameters
    ----------
    reference : str or path
        ``NAME`` (its highest version) or ``NAME@VERSION``, looked up on the search path; or the
        path of an artifact's folder or of a folder of its versions.  Text is a path if it has a
        separator or begins with a dot, or if it names a folder that holds an artifact; a folder of
        that name without one, such as a folder of results, is ignored.
    models : sequence of str
        Force models without an artifact that the message about an unknown name suggests, too.

    Raises
    ------
    ArtifactError
        If there is no such artifact (the message suggests known ones), or the text is both the name
        of one and the folder of another.
    """
    check_path(reference, "an artifact's reference")
    text = str(reference)
    if (
        isinstance(reference, Path)
        or text.startswith(".")
        or os.sep in text
        or (os.altsep or os.sep) in text
    ):
        folder = _in_folder(Path(reference))
        if folder is None:
            raise ArtifactError(
                f"{text}: this is not the folder of an artifact, which would contain {CARD}"
            )
        return folder
    here = _in_folder(Path(text))
    named = by_name(text)
    if here and named and here.resolve() != named.resolve():
        raise ArtifactError(
            f"{text!r} is the name of the artifact in {named}, but the folder {here} contains"
            " another one; give the path"
        )
    if (found := here or named) is None:
        unknown = f"unknown force {text!r}" if models else f"unknown artifact {text!r}"
        raise ArtifactError(f"{unknown}; {_hint(text, models)}")
    return found


def _hint(text: str, models: Sequence[str]) -> str:
    """Return the end of a message about an unknown force: the versions of an artifact, or a
    suggestion among artifacts and `models`.
    """
    name = text.partition("@")[0]
    if versions := [folder.name for folder in _on_search_path(name)]:
        return f"{name} has the version{'s' * (len(versions) > 1)} {', '.join(versions)}"
    names = dict.fromkeys(folder.parent.name for folder in list_artifacts())
    return suggestion(name, [*models, *names])


def _in_folder(path: Path) -> Path | None:
    """Return the folder of the artifact at a path, of the highest version if the path holds
    versions; None if there is no card.
    """
    held = [folder for folder in (*_versions(path), path) if (folder / CARD).is_file()]
    return held[-1] if held else None


def by_name(text: str) -> Path | None:
    """Return the folder of artifact NAME or NAME@VERSION on the search path, even if it is
    damaged; None if there is none.
    """
    name, separator, version = text.partition("@")
    found = [folder for folder in _on_search_path(name) if not separator or version == folder.name]
    return found[-1] if found else None


def _on_search_path(name: str) -> list[Path]:
    """Return the folders of all versions of an artifact, in rising order; for a version found
    twice, the first on the search path.
    """
    if not re.fullmatch(NAME_PATTERN, name):
        return []
    found = {
        folder.name: folder for root in reversed(search_path()) for folder in _versions(root / name)
    }
    return sorted(found.values(), key=_version_key)


def _versions(folder: Path) -> list[Path]:
    """Return the subfolders whose names are versions, in rising order; subfolders of an
    interrupted writing have other names.
    """
    inner = folder.iterdir() if folder.is_dir() else ()
    return sorted(
        (path for path in inner if path.is_dir() and re.fullmatch(VERSION_PATTERN, path.name)),
        key=_version_key,
    )


def _version_key(folder: Path) -> tuple[int, ...]:
    return tuple(int(part) for part in folder.name.split("."))


def new_artifact(folder: str | Path, name: str, version: str) -> Path:
    """Return the path of the folder of a new artifact, ``folder/NAME/VERSION``, without creating
    it.

    Raises
    ------
    ArtifactError
        If it exists already (versions are immutable), or the name or version is not allowed, such
        as the name of a force model.
    """
    if not str(folder):
        raise ArtifactError(
            "folder: the name is empty; give a folder, or None for the one in which artifacts are"
            " found by name"
        )
    _check_name(name, version)
    target = Path(folder) / name / version
    if target.exists():
        raise ArtifactError(
            f"{name}@{version} already exists in {folder}, and versions never change; choose"
            " another version"
        )
    return target


def _check_name(name: str, version: str = "1") -> None:
    """Raise ArtifactError unless name and version match `NAME_PATTERN` and `VERSION_PATTERN`,
    and no exact force model has the name.
    """
    for key, value, pattern in (
        ("name", name, NAME_PATTERN),
        ("version", version, VERSION_PATTERN),
    ):
        if not isinstance(value, str) or not re.fullmatch(pattern, value):
            raise ArtifactError(
                f"{key} {value!r} is not allowed: it must be text that matches {pattern}"
            )
    if name in FORCES:
        raise ArtifactError(
            f"name {name!r} is not allowed: it is the name of an exact force model; choose another"
            " name"
        )
