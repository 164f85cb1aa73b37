"""Checkpoints: everything that a run needs to go on as if it had not been interrupted, in one file of plain arrays."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..array_files import read_arrays
from .files import write_with

FORMAT = 5
NAME = "checkpoint.npz"
_DESCRIPTION = "description"


class CheckpointError(ValueError):
    """A checkpoint that cannot be resumed from; the message says why."""


@dataclass(frozen=True)
class Checkpoint:
    """State of a run.

    Attributes
    ----------
    identity : dict
        What must be the same in the run that resumes: scene, force model, sizes.
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
        arrays = {**self.arrays, _DESCRIPTION: np.frombuffer(text.encode(), dtype=np.uint8)}

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
            raise CheckpointError(f"{path} is damaged ({type(error).__name__}); run without --resume") from None
        if found != FORMAT:
            raise CheckpointError(f"{path} has format {found!r}, this version reads {FORMAT}; run without --resume")
        for key in identity:
            if not isinstance(written, dict) or written.get(key) != json.loads(json.dumps(identity[key])):
                raise CheckpointError(f"{path} belongs to another run: its {key} differs; run without --resume, or with the same {key}")
        for key, (shape, dtype) in shapes.items():
            if key not in arrays or arrays[key].shape != shape or arrays[key].dtype != dtype:
                raise CheckpointError(f"{path} is damaged: {key} is missing or of another shape; run without --resume")
        for key, array in arrays.items():
            if array.dtype.kind not in "fiub" or not np.isfinite(array).all():
                raise CheckpointError(f"{path} is damaged: {key} holds what is not a number; run without --resume")
        return cls(identity, progress, arrays)
