"""Columns, units and directions of the files that programs for image correlation write."""

import tomllib
from dataclasses import dataclass
from importlib import resources

import numpy as np


@dataclass(frozen=True)
class Dialect:
    """Columns of a program, named without the units in brackets that may follow their names.

    Attributes
    ----------
    form : str
    places, displacements : tuple of str
        Columns of x, y and z, and of u, v and w; the third ones may be absent.
    unit : str, optional
        Unit unless the headings state one; empty for that of the scene, None if it must be told.
    down : str, optional
        Those of y, z, v, w that point downward or away from the camera; None if it must be told.
    lost : tuple of str
        Columns that are negative in the rows of lost points.
    zeros : bool
        Whether rows of zeros are lost points.
    deviation : str
        Column of standard deviations of the match, in pixels unless it states a unit.
    pixels : tuple of str
        Columns of places in pixels, y downward, that show the direction and the scale of the rows.
    needs : tuple of str
        Further columns by which the program is known.
    deformed : bool
        Whether places are those of the deformed body.
    refused : str
        Why displacements of this form cannot be used; empty if they can.
    said : str
        What is assumed, or what decides the direction if it must be told.
    """

    form: str
    places: tuple[str, ...] = ()
    displacements: tuple[str, ...] = ()
    unit: str | None = None
    down: str | None = None
    lost: tuple[str, ...] = ()
    zeros: bool = False
    deviation: str = ""
    pixels: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    deformed: bool = False
    refused: str = ""
    said: str = ""


@dataclass(frozen=True)
class RawField:
    """Rows of a file in its own axes: an image number (from the file, if `numbered`), places,
    displacements and deviation each, and whether its point is lost.
    """

    dialect: Dialect
    unit: str | None
    image: np.ndarray
    places: np.ndarray
    displacements: np.ndarray
    deviation: np.ndarray
    lost: np.ndarray
    numbered: bool = False
    subset: float | None = None
    notes: tuple[str, ...] = ()


_FILE = tomllib.loads(resources.files(__package__).joinpath("dialects.toml").read_text("utf-8"))

DIALECTS = {
    form: Dialect(
        form, **{key: tuple(one) if type(one) is list else one for key, one in keys.items()}
    )
    for form, keys in _FILE["dialects"].items()
}
"""Dialects by name, in the order in which they are sought: a table is of the first one whose
columns it has.
"""

OWN = DIALECTS["pdsurrogate"]

EXPORTS: dict[str, str] = _FILE["exports"]
"""Advice for files that are not read, by their endings: what to export in their place."""
