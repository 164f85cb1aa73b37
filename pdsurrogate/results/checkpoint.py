"""Checkpoints: everything that a run needs to go on as if it had not been interrupted, in one file of plain arrays."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..array_files import read_arrays
from .contents import Contents
from .files import write_with

FORMAT = 9
NAME = "checkpoint.npz"
_DESCRIPTION = "description"
ANEW = "begin anew by --overwrite in the place of --resume"


class CheckpointError(ValueError):
    """A checkpoint that cannot be resumed from; the message says why."""


@dataclass(frozen=True)
class Checkpoint:
    """State of a run.

    Attributes
    ----------
    identity : dict
        What must be the same in the run that resumes: scene and force models, as `Contents` describes them, and sizes.
    progress : dict
        Plain numbers, strings and lists.
    arrays : dict of ndarray
    """

    identity: dict
    progress: dict
    arrays: dict[str, np.ndarray]

    def write(self, folder: Path) -> None:
        """Write to a folder, whole or not at all."""
        text = json.dumps({"format": FORMAT, "identity": self.identity, "progress": self.progress}, allow_nan=False)
        # First, so that what the file is stands in its head.
        arrays = {_DESCRIPTION: np.frombuffer(text.encode(), dtype=np.uint8), **self.arrays}

        def write_arrays(path: Path) -> None:
            with path.open("wb") as file:
                np.savez(file, **arrays)

        write_with(folder / NAME, write_arrays)

    @classmethod
    def read(cls, folder: Path, identity: dict, shapes: dict[str, tuple]) -> Checkpoint:
        """Read from a folder.

        Parameters
        ----------
        folder : Path
        identity : dict
            Of the run that wants to resume.
        shapes : dict
            Shape and dtype of every array that it needs.

        Raises
        ------
        CheckpointError
            If there is none, it is damaged, or belongs to another run.
        """
        path = Path(folder) / NAME
        if not path.is_file():
            raise CheckpointError(f"there is no checkpoint in {folder}; run without --resume")
        try:
            with path.open("rb") as file:
                arrays = read_arrays(file)
            described = json.loads(arrays.pop(_DESCRIPTION).tobytes().decode())
            found, written, progress = described["format"], described["identity"], described["progress"]
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            raise CheckpointError(f"{path} is damaged ({type(error).__name__}); {ANEW}") from None
        if found != FORMAT:
            raise CheckpointError(f"{path} has format {found!r}, this version reads {FORMAT}; {ANEW}")
        there, here = Contents.read(written), Contents.read(identity)
        if there is None or here is None:
            raise CheckpointError(f"{path} is damaged: it does not tell its scene; {ANEW}")
        if differences := there.differences(here):
            raise CheckpointError(f"{path} belongs to another run: {differences}; {ANEW}, or resume with what is there")
        for key in identity:
            if written.get(key) != json.loads(json.dumps(identity[key])):
                raise CheckpointError(f"{path} belongs to another run: its {key} differs; {ANEW}")
        for key, (shape, dtype) in shapes.items():
            if key not in arrays or arrays[key].shape != shape or arrays[key].dtype != dtype:
                raise CheckpointError(f"{path} is damaged: {key} is missing or of another shape; {ANEW}")
        for key, array in arrays.items():
            if array.dtype.kind not in "fiub" or not np.isfinite(array).all():
                raise CheckpointError(f"{path} is damaged: {key} holds what is not a number; {ANEW}")
        return cls(identity, progress, arrays)


def identity_in(folder: Path) -> dict | None:
    """Return the identity of the run that left a checkpoint in a folder, see `Checkpoint`; None where there is none, or a damaged one."""
    try:
        with (Path(folder) / NAME).open("rb") as file:
            return json.loads(read_arrays(file, [_DESCRIPTION])[_DESCRIPTION].tobytes().decode())["identity"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
