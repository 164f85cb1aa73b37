"""Displacement fields from the files of programs for image correlation."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..arguments import check_path
from .dialects import EXPORTS, OWN, Dialect, Rows
from .field import MeasuredField
from .field_arrays import READERS, rows_of_arrays
from .field_tables import headings_of, rows_of_table


def read_fields(
    *paths: str | Path, unit: str | None = None, up: bool | None = None, dimension: int = 2
) -> MeasuredField:
    r"""Read the displacement field that a program for image correlation wrote.

    Parameters
    ----------
    *paths : str or path
        Files: one for all images, or one for each, which are then taken in the order of the
        numbers in their names. A folder stands for its files, and a pattern such as
        ``camera/*.csv`` for those that match.
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
    >>> import tempfile
    >>> from pathlib import Path
    >>> from pdsurrogate.measurements import read_fields
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "frame.csv"
    ...     _ = path.write_text("step,x1,x2,u1,u2\n1,0.5,1.0,0.1,0.2\n")
    ...     read_fields(path).displacements.tolist()
    [[0.1, 0.2]]
    """
    if not paths:
        raise ValueError("there is no file of a field")
    for path in paths:
        check_path(path, "field")
    files = sorted(files_at(*paths), key=_numbers)
    read = [_rows(file, unit, dimension) for file in files]
    first = read[0]
    where = f"{files[0]}: {first.dialect.form}"
    if len({(one.dialect.form, one.dialect.down, one.unit, one.numbered) for one in read}) > 1:
        raise ValueError(f"{where}: {', '.join(map(str, files[1:]))} are not all of this form")
    notes = [note for part in read for note in part.notes]
    if not first.numbered and len(files) > 1:
        keys = [_numbers(file) for file in files]
        if len({*keys}) < len(files) or len({*map(len, keys)}) > 1:
            raise ValueError(
                f"{where}: the numbers in the names {', '.join(file.name for file in files)} give"
                " no order of the images: name the files as frame_1, frame_2, ..."
            )
        notes.append(
            f"images by the numbers in the names of files, {files[0].name} to {files[-1].name}"
        )
    if first.numbered and sum(len({*part.image}) for part in read) > len(
        {number for part in read for number in part.image}
    ):
        raise ValueError(
            f"{where}: {', '.join(map(str, files))} have the same numbers of images: give each"
            " image a number of its own"
        )
    starts = np.cumsum([0, *(part.image.max() for part in read)]) * (not first.numbered)
    image = np.concatenate(
        [part.image + start for part, start in zip(read, starts[:-1], strict=True)]
    )
    places, displacements, deviation, lost = (
        np.concatenate([vars(part)[name] for part in read])
        for name in ("places", "displacements", "deviation", "lost")
    )
    if (image % 1 != 0).any():
        raise ValueError(f"{where}: the numbers of images must be whole")
    lost |= np.isnan(places + displacements).any(axis=1)
    if lost.all():
        raise ValueError(f"{where}: all points are lost")
    places[lost] = displacements[lost] = np.nan
    signs = _signs(first.dialect, up, where)
    if first.dialect.down is not None and first.dialect.said:
        notes.append(first.dialect.said)
    if first.dialect.deformed or _places_move(image, places, displacements):
        places = places - displacements
        notes.append("places are those of the deformed body: displacements are subtracted")
    step = image
    kept = ~lost
    if first.dialect is not OWN:
        numbers, step = np.unique(image, return_inverse=True)
        if first.numbered:
            notes.append(f"images by their numbers, {numbers[0]:g} to {numbers[-1]:g}")
        size = np.abs(displacements[kept & (step == 0)]).max(initial=0.0)
        rounding = 1e-6 * np.ptp(places[kept], axis=0).max()
        if len(numbers) > 1 and (kept & (step == 0)).any() and size <= rounding:
            notes.append("the first image, without displacements, is the reference image")
            kept &= step > 0
        else:
            step = step + 1
    return MeasuredField(
        first.dialect.form,
        str(first.unit),
        step[kept].astype(int),
        places[kept] * signs[0, :dimension],
        displacements[kept] * signs[1, :dimension],
        np.where(deviation > 0, deviation, np.nan)[kept],
        int(lost[step > 0].sum()),
        first.subset,
        bool(signs[0, 1] < 0),
        tuple(dict.fromkeys(notes)),
    )


def files_at(*paths: str | Path) -> list[Path]:
    """Return files: those in a folder in its place, and those that match a pattern.

    Raises
    ------
    ValueError
        If a folder has no files, or nothing matches a pattern.
    """
    found: list[Path] = []
    for path in map(Path, paths):
        folder, pattern = (path, "*") if path.is_dir() else (path.parent, path.name)
        several = path.is_dir() or (not path.exists() and re.search(r"[*?]", pattern))
        named = (one for one in sorted(folder.glob(pattern)) if not one.name.startswith("."))
        files = [one for one in named if one.is_file()] if several else [path]
        if not files:
            raise ValueError(f"{path}: there are no such files")
        found += files
    return found


def is_field(path: str | Path) -> str | None:
    """Return the form of a file of displacements, such as "DICe"; None for any other file."""
    path = Path(path)
    ending = path.suffix.lower()
    try:
        if ending in EXPORTS:
            return EXPORTS[ending].partition(":")[0]
        if ending in READERS:
            return rows_of_arrays(path).dialect.form
        found = headings_of(path)
    except (OSError, ValueError):
        return None
    return found.dialects[0].form if found else None


def _rows(file: Path, unit: str | None, dimension: int) -> Rows:
    """Return the rows of a file, in a unit that is known."""
    if file.suffix.lower() not in (*READERS, *EXPORTS):
        found = rows_of_table(file, unit, dimension)
    elif dimension != 2:
        raise ValueError(f"{file}: places of solids are read from tables alone")
    else:
        found = rows_of_arrays(file)
    if unit is not None and found.unit not in (None, unit):
        raise ValueError(f"{file}: {found.dialect.form} is in {found.unit}, not in {unit}")
    if (stated := found.unit if found.unit is not None else unit) is None:
        raise ValueError(
            f"{file}: {found.dialect.form}: the file states no unit of places and displacements;"
            " state it: --unit px, --unit mm"
        )
    return replace(found, unit=stated)


def _places_move(image: np.ndarray, places: np.ndarray, displacements: np.ndarray) -> bool:
    """Whether places move from the first image to the last as their displacements do, in rows of
    the same points.
    """
    first, last = image == image.min(), image == image.max()
    if first.sum() != last.sum() or first.sum() < 3:
        return False
    moved, by = (part[last] - part[first] for part in (places, displacements))
    off = moved - by  # of rounded numbers
    return bool(np.nansum(off**2) < 0.01 * np.nansum(moved**2))


def _numbers(file: Path) -> tuple[int, ...]:
    """Return the numbers in the name of a file."""
    return tuple(map(int, re.findall(r"\d+", file.stem)))


def _signs(dialect: Dialect, up: bool | None, where: str) -> np.ndarray:
    """Return the signs of places and displacements, (2, 3), that turn them upward."""
    down = dialect.down
    if down is None and up is None:
        raise ValueError(
            f"{where}: whether y and v are counted upward or downward is not known{dialect.said};"
            " state it: --up or --down, up=True or up=False"
        )
    if up is not None and (down is None or up == ("y" in down)):
        if down is not None and dialect.unit == "px":
            raise ValueError(
                f"{where} counts y {'downward' if up else 'upward'} from the first row of pixels;"
                f" leave {'--up' if up else '--down'} out"
            )
        down = "" if up else "yzvw"
    return np.array([[1.0 - 2 * (axis in str(down)) for axis in row] for row in ("xyz", "uvw")])
