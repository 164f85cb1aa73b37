"""Folder of results: which files in it belong to a run, and when a new run may replace them.

A run of a scene called NAME owns ``NAME.pvd``, ``NAME-000.vtu`` and so on (if every rank writes a
piece, ``NAME-000.pvtu`` and ``NAME-000.piece0.vtu``), ``NAME.png``, ``NAME-loading.png``,
``summary.json``, ``history.csv``, ``convergence.csv`` and ``checkpoint.npz``, and, while it writes,
the lock file ``.pdsurrogate-run``, see `occupied`.

A folder holds a run if its summary or, without one, its checkpoint describes one: scene, and
digests of force models and mesh, see `contents_of`. Files with the names of results in a folder
that holds no run are never replaced, but raise `FolderTaken`.
"""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .checkpoint import NAME as CHECKPOINT
from .checkpoint import identity_in
from .contents import contents_in, differences_between
from .files import made, remove_leftovers, write_json

SUMMARY = "summary.json"
HISTORY = "history.csv"
CONVERGENCE = "convergence.csv"

RUNNING = "running"
INTERRUPTED = "interrupted"
FAILED = "failed"
DONE = "done"
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
            process, host, *_ = [*path.read_text(errors="replace").split(), "", ""]
            raise FolderTaken(
                f"{folder}: {f'process {process} on {host}' if host else 'another process'} is"
                " writing a run to this folder; use another folder (or, if no run writes there,"
                f" remove {path})"
            ) from None
        with held:
            yield


WAY_OUT = "use another folder, or --overwrite (in Python overwrite=True)"


def check_room(folder: Path, contents: dict, overwrite: bool) -> None:
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
        interrupted, or, without a run, a file named like a result.
    """
    summary = read_summary(folder)
    name = contents["scene_as_run"]["name"]
    described = summary or identity_in(folder)
    if not described:
        for path in _files_of(folder, name):
            raise FolderTaken(
                f"{path} was not written by a run and would be overwritten; use another folder"
            )
    if overwrite or not described:
        return
    found = contents_in(described)
    if found is None:
        raise FolderTaken(
            f"{folder} contains results of {described.get('scene')} without a description of their"
            f" scene; {WAY_OUT}"
        )
    if differences := differences_between(found, contents):
        raise FolderTaken(
            f"{folder} contains the results of another run of {found['scene_as_run']['name']}"
            f" ({differences}); {WAY_OUT}"
        )
    ended = summary is not None and summary.get("status") not in (RUNNING, INTERRUPTED)
    if not ended and (folder / CHECKPOINT).exists():  # without a checkpoint nothing can be resumed
        raise FolderTaken(
            f"{folder} contains this run, which was interrupted: continue it with --resume, or"
            " start again with --overwrite (in Python resume=True or overwrite=True)"
        )


def make_room(folder: Path, contents: dict, overwrite: bool) -> None:
    """Remove the files of an earlier run, and no others, from a folder for a run with the given
    `contents`.

    Raise FolderTaken if `check_room` does not permit it.
    """
    check_room(folder, contents, overwrite)
    remove_leftovers(folder)
    begun = contents_in(identity_in(folder)) or contents
    earlier = (read_summary(folder) or {}).get("scene", begun["scene_as_run"]["name"])
    for name in {earlier, contents["scene_as_run"]["name"]}:
        for path in _files_of(folder, name):
            path.unlink()


def claim(folder: Path, summary: dict, overwrite: bool) -> None:
    """Make room in a folder for a run with the given `summary`, and write the summary as that of a
    run under way: by it the folder is known as that of the run, should it be killed before it has
    written more.

    Raise FolderTaken if `check_room` does not permit it.
    """
    make_room(folder, contents_in(summary), overwrite)
    write_json(folder / SUMMARY, summary | {"status": RUNNING})


def state_files(folder: Path, name: str) -> list[tuple[int, Path]]:
    """Return the number and the path of every file of a state of the scene `name`: VTU files,
    also of pieces, and PVTU files.
    """
    pattern = re.compile(re.escape(name) + r"-(\d{3,})(\.pvtu|(\.piece\d+)?\.vtu)")
    found = ((pattern.fullmatch(path.name), path) for path in sorted(folder.glob("*vtu")))
    return [(int(match[1]), path) for match, path in found if match]


def _files_of(folder: Path, name: str) -> list[Path]:
    """Return the files in a folder that have the names of results of a scene."""
    pictures = (f"{name}{ending}" for ending in (".pvd", ".png", "-loading.png"))
    names = (SUMMARY, HISTORY, CONVERGENCE, CHECKPOINT, *pictures)
    others = (folder / one for one in names)
    return [
        *(path for path in others if path.exists()),
        *(path for _, path in state_files(folder, name)),
    ]


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
