"""Writing of files whole or not at all, and checks that a folder can be written to."""

import errno
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

TEMPORARY = ".pdsurrogate-tmp-"
"""Beginning of the names of files that are still being written."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to, in the folder of `path`; after success move the file
    to `path`, after an error remove it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"{TEMPORARY}{path.stem}-{uuid4().hex}{path.suffix}")
    try:
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except Exception as error:
        # An interrupt that leaves a member of a ZIP file open makes zipfile raise an error of its
        # own.
        if isinstance(error.__context__, KeyboardInterrupt):
            raise error.__context__ from None
        raise
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, data) -> None:
    """Write data as a JSON file, whole or not at all; raise ValueError for numbers that are not
    finite.
    """
    write_text(path, json.dumps(data, indent=2, allow_nan=False) + "\n")


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files that killed processes left in a folder."""
    for path in folder.glob(f"{TEMPORARY}*"):
        path.unlink(missing_ok=True)


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Create a folder and its missing parents when a context begins; when it ends, remove those
    that were created and are still empty.
    """
    new = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    finally:
        with suppress(OSError):  # the first that is not empty
            for place in new:
                place.rmdir()


def check_writable(folder: Path) -> None:
    """Check, before any work is done, that files can be created in a folder, or in the nearest
    existing parent of a new one.

    Raises
    ------
    OSError
        If no file can be created.
    """
    place = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not place.is_dir():
        raise NotADirectoryError(
            errno.ENOTDIR, "this is a file, but a folder is needed", str(place)
        )
    try:
        with tempfile.NamedTemporaryFile(dir=place):
            pass
    except OSError as error:
        where = "" if place == folder else f" ({place} is not writable)"
        raise type(error)(
            error.errno, f"files cannot be created here{where}: {error.strerror}", str(folder)
        ) from None
