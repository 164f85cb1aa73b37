"""Displacement fields from the files of programs for image correlation."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..arguments import check_path
from .dialects import OWN, Dialect
from .field import MeasuredField
from .field_tables import form_of, rows_of_table


def read_fields(
    *paths: str | Path, unit: str | None = None, up: bool | None = None, dimension: int = 2
) -> MeasuredField:
    r"""Read the displacement field that a program for image correlation wrote.

    Parameters
    ----------
    *paths : str or path
        Files: one for all images, or one for each, which are then taken in the order of the
        numbers in their names.
    unit : str, optional
        Unit of places and displacements, such as "px" or "mm", if the files state none. If a file
        has places in several units, those in this one are read.
    up : bool, optional
        Whether y and v point upward, if the files do not say it.
    dimension : int
        Number of coordinates of a place.

    Returns
    -------
    MeasuredField
        With y upward; points that the program marks as lost are left out.

    Raises
    ------
    ValueError
        If a file cannot be read or is of no known form, has displacements that are not those from
        the reference image, or does not say its unit or direction and they are not given.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pdsurrogate.measurements import read_fields
    >>> _ = Path("frame.csv").write_text("step,x1,x2,u1,u2\n1,0.5,1.0,0.1,0.2\n")
    >>> read_fields("frame.csv").displacements.tolist()
    [[0.1, 0.2]]
    """
    if not paths:
        raise ValueError("there is no file of a field")
    for path in paths:
        check_path(path, "field")
    files = _in_order([Path(path) for path in paths])
    parts = [rows_of_table(file, unit, dimension) for file in files]
    first = parts[0]
    for file, part in zip(files, parts, strict=True):
        if (part.dialect, part.unit, part.numbered) != (first.dialect, first.unit, first.numbered):
            raise ValueError(f"{file} and {files[0]} are of different forms")
    notes = [note for part in parts for note in part.notes]
    if not first.numbered:  # images of one file follow those of the file before
        ends = np.cumsum([part.image.max() for part in parts])
        parts = [
            replace(part, image=part.image + end - part.image.max())
            for part, end in zip(parts, ends, strict=True)
        ]
        if len(parts) > 1:
            notes.insert(0, f"images in the order {', '.join(file.name for file in files)}")
    image, places, displacements, deviation, lost = (
        np.concatenate([vars(part)[name] for part in parts])
        for name in ("image", "places", "displacements", "deviation", "lost")
    )
    lost = lost | np.isnan(places).any(axis=1) | np.isnan(displacements).any(axis=1)
    if lost.all():
        raise ValueError(f"{files[0]}: all points are lost")
    if first.dialect.down is None and up is None:
        raise ValueError(
            f"{files[0]}: {first.dialect.form}: whether y and v are counted upward or downward is"
            " not known; state it: --up or --down, up=True or up=False"
        )
    signs = _signs(first.dialect, up, files[0])
    kept = ~lost
    if first.dialect.deformed:
        places = places - displacements
        notes.append("places are those of the deformed body: displacements are subtracted")
    step = image
    if first.dialect is not OWN:
        names, step = np.unique(image, return_inverse=True)
        at_rest = not displacements[kept & (step == 0)].any()
        if at_rest and len(names) > 1:
            notes.append("the first image, without displacements, is the reference image")
            kept &= step > 0
            lost &= step > 0
        step = step + (not at_rest or len(names) == 1)
    return MeasuredField(
        first.dialect.form,
        first.unit,
        step[kept].astype(int),
        places[kept] * signs[0, :dimension],
        displacements[kept] * signs[1, :dimension],
        deviation[kept],
        int(lost.sum()),
        first.subset,
        tuple(dict.fromkeys(notes)),
    )


def is_field(path: str | Path) -> str | None:
    """Return the form of a file of displacements, such as "DICe"; None for any other file."""
    return form_of(Path(path))


def _in_order(files: list[Path]) -> list[Path]:
    """Return files in the order of the numbers in their names; raise ValueError if there is no
    such order.
    """
    keys = [tuple(map(int, re.findall(r"\d+", file.stem))) for file in files]
    if len({*keys}) < len(files) or len({*map(len, keys)}) > 1:
        raise ValueError(
            f"the numbers in the names {', '.join(file.name for file in files)} give no order of"
            " the images: name the files as frame_1, frame_2, ..."
        )
    return [files[place] for place in sorted(range(len(files)), key=keys.__getitem__)]


def _signs(dialect: Dialect, up: bool | None, file: Path) -> np.ndarray:
    """Return the signs of places and displacements, (2, 3), that turn them upward."""
    down = dialect.down
    if up is not None and (down is None or up == ("y" in down)):
        if dialect.unit == "px":
            raise ValueError(
                f"{file}: {dialect.form} counts y {'downward' if up else 'upward'} from the first"
                f" row of pixels; leave {'--up' if up else '--down'} out"
            )
        down = "" if up else "yzvw"
    return np.array(
        [[-1.0 if axis in (down or "") else 1.0 for axis in row] for row in ("xyz", "uvw")]
    )
