"""Files of plain arrays that nobody vouches for: reading one runs nothing of it, and takes no more memory than the file itself."""

from __future__ import annotations

import zipfile
from collections.abc import Collection
from typing import BinaryIO

import numpy as np


class DamagedFile(ValueError):
    """A file that is no uncompressed archive of plain arrays."""


def read_arrays(file: BinaryIO, names: Collection[str] | None = None) -> dict[str, np.ndarray]:
    """The arrays of a file as ``numpy.savez`` writes it, by name: all, or those that are named.

    Raises
    ------
    DamagedFile
        If it is anything else: damaged, compressed, or with arrays of objects, whose pickles would be programs.
    """
    try:
        with np.load(file, allow_pickle=False) as archive:
            # Uncompressed, so that nothing in the file is larger than the file.
            if any(member.compress_type != zipfile.ZIP_STORED for member in archive.zip.infolist()):
                raise DamagedFile("it is compressed")
            arrays = {key: archive[key] for key in archive.files if names is None or key in names}
    except DamagedFile:
        raise
    except Exception as error:  # whatever a damaged file provokes in NumPy and zipfile
        raise DamagedFile(f"it is no file of plain arrays: {type(error).__name__}: {error}") from None
    # What does not begin as an array does, NumPy gives as bytes.
    if not all(isinstance(array, np.ndarray) for array in arrays.values()):
        raise DamagedFile("it is no file of plain arrays: one of them has lost its header")
    return arrays
