"""Safe reading of files of plain arrays from untrusted sources, without running code from a
file, or expanding compressed arrays.
"""

import zipfile
from collections.abc import Collection
from typing import BinaryIO

import numpy as np


class DamagedFile(ValueError):
    """Error for a file that is no uncompressed archive of plain arrays."""


def read_arrays(file: BinaryIO, names: Collection[str] | None = None) -> dict[str, np.ndarray]:
    """Return the arrays in a file that ``numpy.savez`` wrote, by name: all arrays, or only those
    listed in `names`.

    Raises
    ------
    DamagedFile
        If the file is damaged or compressed, or holds arrays of objects, whose pickles could run
        code.
    """
    try:
        with np.load(file, allow_pickle=False) as archive:
            # Uncompressed: no array is larger than the file.
            if any(member.compress_type != zipfile.ZIP_STORED for member in archive.zip.infolist()):
                raise DamagedFile("the file is compressed; only uncompressed .npz files are read")
            arrays = {key: archive[key] for key in archive.files if names is None or key in names}
    except DamagedFile:
        raise
    except Exception as error:  # any error of NumPy and zipfile about damaged files
        raise DamagedFile(
            f"the file is damaged, or not an .npz file of plain arrays: {type(error).__name__}:"
            f" {error}"
        ) from None
    # NumPy returns members without the header of an array as bytes.
    if not all(isinstance(array, np.ndarray) for array in arrays.values()):
        raise DamagedFile("the file is damaged: the header of an array is missing")
    return arrays
