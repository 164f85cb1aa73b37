"""Folder of results: which files in it belong to a run, and when a new run may replace them.

A run of a scene called NAME owns ``NAME.pvd``, ``NAME-000.vtu`` and so on (if every rank writes a
piece, ``NAME-000.pvtu`` and ``NAME-000.piece0.vtu``), ``NAME.png``, ``NAME-loading.png``,
``summary.json``, ``history.csv``, ``convergence.csv`` and ``checkpoint.npz``, and,
while it writes, the lock file ``.pdsurrogate-run``, see `occupied`.

A file with such a name belongs to a run if its first bytes contain `MARK` (state files, PVD index,
pictures) or match a pattern of `_HEADS` (tables, checkpoint), or if it is a valid summary; any
other file is never replaced, but raises `FolderTaken`.

A folder holds a run of a scene if its summary or, without one, its checkpoint names the scene, or
if a PVD index of that name contains `MARK`.  Summary and checkpoint also hold the scene of the run
and the digests of its force models and mesh, see `contents_of`.
"""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .checkpoint import NAME as CHECKPOINT
from .checkpoint import identity_in
from .contents import contents_in, differences_between, differences_of, told
from .files import MARK, head_of, made, remove_leftovers

SUMMARY, HISTORY, CONVERGENCE = "summary.json", "history.csv", "convergence.csv"

RUNNING, INTERRUPTED, FAILED, DONE = "running", "interrupted", "failed", "done"
"""Values of ``status`` in a summary; the summary of a killed run still has ``running``."""


class FolderTaken(ValueError):
    """Error for a folder that a run may not write to; the message gives the reason and the
    remedy.
    """


LOCK = ".pdsurrogate-run"


@contextmanager
def occupied(folder: Path, patience: float = 0.0) -> Iterator[None]:
    """Reserve a folder for this run during a context; create the folder if necessary, and remove it
    if it stays empty.

    A thread may reserve a folder again that it holds already. A lock file names the process and its
    host; a run replaces the lock of a process on this host that no longer exists. If another run is
    writing there, wait up to `patience` seconds for its end.

    Raises
    ------
    FolderTaken
        If another run is still writing there after the wait.
    """
    from filelock import SoftFileLock, Timeout  # here, because only runs with a folder need them

    with made(folder):
        path = folder.resolve() / LOCK
        lock = SoftFileLock(path, is_singleton=True)
        try:
            held = lock.acquire(patience, 0.2)
        except Timeout:
            process, host, *_ = [*head_of(path).decode(errors="replace").split(), "", ""]
            taken = (
                f"{folder}: {f'process {process} on {host}' if host else 'another process'} is"
                " writing a run to this folder"
            )
            raise FolderTaken(
                f"{taken}; use another folder (or, if no run writes there, remove {path})"
            ) from None
        with held:
            yield


_HEADS = {
    HISTORY: rb"step,(stretch|t),evaluations|\Z",
    CONVERGENCE: rb"(stretch|t),increment,evaluation|\Z",
    CHECKPOINT: rb'(?s).*description\.npy.*\{"format": |\Z',
}
"""Patterns of the first bytes of files that have the same name in every run; an empty or damaged
file of a run still matches.
"""

WAY_OUT = "use another folder, or --overwrite (in Python overwrite=True)"


def check_room(folder: Path, contents: dict, overwrite: bool = False) -> None:
    """Check that a run may write its results to a folder; by default only finished results of an
    equal run may be replaced.

    Parameters
    ----------
    folder : Path
    contents : dict
        Scene, force models and mesh of the run, see `contents_of`.
    overwrite : bool
        Whether to replace results of other runs as well, and interrupted runs with a checkpoint.

    Raises
    ------
    FolderTaken
        If the folder holds results of another run, a checkpoint of an equal run that was
        interrupted, or a file named like a result that no run wrote.
    """
    names, name = _scenes_in(folder), contents["scene_as_run"]["name"]
    check_names(folder, name)
    if overwrite or not names:
        return
    if others := sorted(names - {name}):
        raise FolderTaken(
            f"{folder} contains the results of another scene ({', '.join(others)}); {WAY_OUT}"
        )
    summary = read_summary(folder)
    found = contents_in(summary or identity_in(folder))
    if found is None:
        raise FolderTaken(
            f"{folder} contains results of {name} without a description of their scene; {WAY_OUT}"
        )
    if differences := differences_between(found, contents):
        raise FolderTaken(
            f"{folder} contains the results of another run of {name} ({differences}); {WAY_OUT}"
        )
    ended = summary is not None and summary.get("status") not in (RUNNING, INTERRUPTED)
    if not ended and (folder / CHECKPOINT).exists():  # without a checkpoint nothing can be resumed
        ways = (
            "continue it with --resume, or start again with --overwrite (in Python resume=True or"
            " overwrite=True)"
        )
        raise FolderTaken(f"{folder} contains this run, which was interrupted: {ways}")


def check_names(folder: Path, name: str, resumed: bool = False) -> None:
    """Raise FolderTaken if a folder has a file that is named like a result of the scene `name` but
    was not written by a run.

    For a run that is `resumed`, the checkpoint is not checked.
    """
    for path in (*(folder / kind for kind in (SUMMARY, *_HEADS)), *_files_of(folder, name)):
        if path.exists() and not _is_ours(path) and not (resumed and path.name == CHECKPOINT):
            raise FolderTaken(
                f"{path} was not written by a run and would be overwritten; use another folder"
            )


def make_room(folder: Path, contents: dict, overwrite: bool = False) -> None:
    """Remove the files of earlier runs, and no others, from a folder for a run with the given
    `contents`.

    Raise FolderTaken if `check_room` does not permit it.
    """
    check_room(folder, contents, overwrite)
    name = contents["scene_as_run"]["name"]
    remove_leftovers(folder)
    for scene in _scenes_in(folder) | {name}:
        for path in filter(_is_ours, _files_of(folder, scene)):
            path.unlink()
    for kind in (SUMMARY, *_HEADS):
        (folder / kind).unlink(missing_ok=True)


def check_report(path: Path, asked: dict, overwrite: bool = False) -> None:
    """Check that a report may be written to a path: no file is there, or a report whose entry
    ``asked`` equals the settings `asked`.

    Parameters
    ----------
    path : Path
        Path of a JSON file.
    asked : dict
        Settings that determine the report, as plain values.
    overwrite : bool
        Whether to replace any other file.

    Raises
    ------
    FolderTaken
        If there is a report with other settings, or a file that is no report.
    """
    if overwrite or not path.exists():
        return
    if differences := differences_from(path, "asked", asked)[1]:
        raise FolderTaken(f"{path} is the report of other settings: {differences}; {WAY_OUT}")


def differences_from(path: Path, key: str, asked: dict) -> tuple[dict, str]:
    """Return the content of a JSON file, and a text that says how its entry `key` differs from the
    settings `asked`, empty if it is equal.

    Raise FolderTaken if the file cannot be read or has no such entry.
    """
    try:
        written = json.loads(path.read_text("utf-8"))
        return written, told(differences_of(written[key], json.loads(json.dumps(asked))))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise FolderTaken(
            f"{path} is not a report with known settings, and would be overwritten; {WAY_OUT}"
        ) from None


def state_files(folder: Path, name: str) -> list[tuple[int, Path]]:
    """Return the number and the path of every file of a state of the scene `name`: VTU files,
    also of pieces, and PVTU files.
    """
    pattern = re.compile(re.escape(name) + r"-(\d{3,})(\.pvtu|(\.piece\d+)?\.vtu)")
    found = ((pattern.fullmatch(path.name), path) for path in sorted(folder.glob("*vtu")))
    return [(int(match[1]), path) for match, path in found if match]


def _files_of(folder: Path, name: str) -> list[Path]:
    others = (folder / f"{name}{ending}" for ending in (".pvd", ".png", "-loading.png"))
    return [
        *(path for _, path in state_files(folder, name)),
        *(path for path in others if path.exists()),
    ]


def _is_ours(path: Path) -> bool:
    """Return whether a file that is named like a result was written by a run of this package,
    judging by its first bytes.
    """
    if path.name == SUMMARY:
        return read_summary(path.parent) is not None
    return (
        bool(re.match(_HEADS[path.name], head_of(path))) if path.name in _HEADS else is_marked(path)
    )


def is_marked(path: Path) -> bool:
    """Return whether a state file (VTU or PVTU), a PVD index or a picture contains `MARK`, which
    identifies files of this package.
    """
    return MARK.encode() in head_of(path)


def _scenes_in(folder: Path) -> set[str]:
    """Return the names of the scenes whose runs a folder holds."""
    scenes = {path.stem for path in folder.glob("*.pvd") if is_marked(path)}
    if summary := read_summary(folder):
        scenes.add(summary["scene"])
    elif begun := contents_in(identity_in(folder)):
        scenes.add(begun["scene_as_run"]["name"])
    return scenes


def read_summary(folder: Path) -> dict | None:
    """Return the content of ``summary.json`` of the run in a folder; None if the folder has no
    valid summary.
    """
    with suppress(OSError, ValueError, RecursionError):
        read = json.loads((folder / SUMMARY).read_text("utf-8"))
        scene = (
            read.get("scene")
            if isinstance(read, dict) and isinstance(read.get("levels"), list)
            else None
        )
        if (
            isinstance(scene, str) and scene and scene == Path(scene).name
        ):  # not a path: files are named after it
            return read
    return None
