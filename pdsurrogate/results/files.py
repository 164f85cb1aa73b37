"""Writing files whole or not at all."""

from __future__ import annotations

import errno
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

TEMPORARY = ".pdsurrogate-tmp-"
"""How the names of files begin that are not whole yet."""

MARK = "pdsurrogate run"
"""Among the first `HEAD` bytes of every file of states and of every picture that this package writes, by which it knows them again."""

HEAD = 2048


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`; move the file into place on success and remove it on failure."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f"{TEMPORARY}{path.stem}-", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        # mkstemp gives 0600; a result is as readable as any file the user makes.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, data) -> None:
    """Write a JSON file whole; numbers that are not finite are refused."""
    write_text(path, json.dumps(data, indent=2, allow_nan=False) + "\n")


def remove_leftovers(folder: Path) -> None:
    """Remove the files that a process which was killed left in a folder before they were whole."""
    for path in folder.glob(f"{TEMPORARY}*"):
        path.unlink(missing_ok=True)


def head_of(path: Path) -> bytes:
    """First bytes of a file; of one that cannot be read, none that anything begins with."""
    try:
        with path.open("rb") as file:
            return file.read(HEAD)
    except OSError:
        return b"?"


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Context in which a folder is there; of the folders that were made for it those go again that are empty at the end."""
    new = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    finally:
        with suppress(OSError):  # the first that is not empty
            for place in new:
                place.rmdir()


def check_writable(folder: Path) -> None:
    """See, before any work is done, whether files can be made in a folder; of one that is not there yet, in the folder that it will be in.

    Raises
    ------
    OSError
        If that is not possible.
    """
    place = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not place.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, "a folder is needed, and this is a file", str(place))
    try:
        with tempfile.NamedTemporaryFile(dir=place):
            pass
    except OSError as error:
        where = "" if place == folder else f", as no file can be made in {place}"
        raise type(error)(error.errno, f"files cannot be made there{where}: {error.strerror}", str(folder)) from None
