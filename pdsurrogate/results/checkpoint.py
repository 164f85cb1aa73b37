"""Checkpoints: files of plain arrays with everything that an interrupted run needs to continue
with unchanged results.
"""

import json
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from ..array_files import read_arrays
from .contents import contents_in, differences_between
from .files import replacing

FORMAT = 14
"""Number of the format of checkpoints; it rises with every change that an older or newer version
would misread, and other numbers are refused.
"""

NAME = "checkpoint.npz"
_DESCRIPTION = "description"
_DAMAGE = (OSError, ValueError, KeyError, TypeError, RecursionError)
ANEW = "start again with --overwrite instead of --resume"


class CheckpointError(ValueError):
    """Error for a checkpoint from which a run cannot resume; the message gives the reason."""


class Checkpoint(NamedTuple):
    """State of a run, from which the run can be resumed.

    Attributes
    ----------
    progress : dict
        State of the run as plain numbers, strings and lists.
    arrays : dict of ndarray
        State of the run as arrays of numbers.
    """

    progress: dict
    arrays: dict[str, np.ndarray]

    def write(self, folder: Path, identity: dict) -> None:
        """Write the checkpoint to a folder, whole or not at all.

        Parameters
        ----------
        folder : Path
        identity : dict
            Entries that must be equal in the run that resumes: its scene, force models and mesh
            (see `contents_of`), and its numbers of points and bonds.
        """
        text = json.dumps(
            {"format": FORMAT, "identity": identity, "progress": self.progress}, allow_nan=False
        )
        arrays = {_DESCRIPTION: np.frombuffer(text.encode(), dtype=np.uint8), **self.arrays}
        with replacing(folder / NAME) as temporary, temporary.open("wb") as file:
            np.savez(file, **arrays)

    @classmethod
    def read(cls, folder: Path, identity: dict, shapes: dict[str, tuple]) -> Self:
        """Return the checkpoint in a folder, after checking that it is undamaged and belongs to the
        run that resumes.

        Parameters
        ----------
        folder : Path
        identity : dict
            Identity of the run that resumes, as for `write`.
        shapes : dict
            Shape and dtype of every required array.

        Raises
        ------
        CheckpointError
            If there is no checkpoint, or it is damaged or belongs to another run.
        """
        path = checkpoint_in(folder)
        try:
            described, arrays = _parts_of(path)
            found, written, progress = (
                described[key] for key in ("format", "identity", "progress")
            )
        except _DAMAGE as error:
            raise CheckpointError(f"{path} is damaged ({type(error).__name__}); {ANEW}") from None
        if found != FORMAT:
            raise CheckpointError(
                f"{path} has the format {found!r}, but this version reads {FORMAT}; {ANEW}"
            )
        there = contents_in(written)
        if there is None:
            raise CheckpointError(f"{path} is damaged: it does not name its scene; {ANEW}")
        if differences := differences_between(there, identity):
            raise CheckpointError(
                f"{path} belongs to another run: {differences}; {ANEW}, or resume with the values"
                " of the checkpoint"
            )
        for key in identity.keys() - there.keys():
            if written.get(key) != identity[key]:
                raise CheckpointError(f"{path} belongs to another run: its {key} differs; {ANEW}")
        for key, (shape, dtype) in shapes.items():
            if key not in arrays or arrays[key].shape != shape or arrays[key].dtype != dtype:
                raise CheckpointError(
                    f"{path} is damaged: {key} is missing or has another shape; {ANEW}"
                )
        for key, array in arrays.items():
            if array.dtype.kind not in "fiub" or not np.isfinite(array).all():
                raise CheckpointError(
                    f"{path} is damaged: {key} contains values that are not finite numbers; {ANEW}"
                )
        return cls(progress, arrays)


def checkpoint_in(folder: Path) -> Path:
    """Return the path of the checkpoint in a folder; raise CheckpointError if there is none."""
    path = Path(folder) / NAME
    if not path.is_file():
        raise CheckpointError(f"there is no checkpoint in {folder}; run without --resume")
    return path


def identity_in(folder: Path) -> dict | None:
    """Return the identity of the run that left a checkpoint in a folder, see `Checkpoint.write`;
    None if it is missing or damaged.
    """
    with suppress(*_DAMAGE):
        return _parts_of(Path(folder) / NAME, [_DESCRIPTION])[0]["identity"]
    return None


def _parts_of(
    path: Path, names: Collection[str] | None = None
) -> tuple[dict, dict[str, np.ndarray]]:
    """Return the description (a dictionary) and the arrays of a checkpoint's file: all arrays, or
    only the arrays listed in `names`.

    The description is stored as JSON in the array named `_DESCRIPTION`, which `names` must contain.
    Raise one of the exception types in `_DAMAGE` if the file cannot be read.
    """
    with path.open("rb") as file:
        arrays = read_arrays(file, names)
    return json.loads(arrays.pop(_DESCRIPTION).tobytes().decode()), arrays
