"""Displacement fields that cameras measured, whichever program wrote them."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class MeasuredField:
    """Displacements of places of a body by image, as the program that wrote them has them.

    Axes are right-handed with the second one up, whatever the file has: a reader turns the signs
    of rows of pixels that are counted downward.

    Attributes
    ----------
    form : str
        Program and form of the file, such as "DICe text".
    unit : str
        Unit of places and displacements: "px", "mm", ..., or empty for that of the scene.
    step : ndarray of int, shape (n,)
        Number of the image, from 1 for the first one after the reference image.
    places : ndarray, shape (n, d)
        Places in the reference image.
    displacements : ndarray, shape (n, d)
        Displacements from the reference image.
    deviation : ndarray, shape (n,)
        Standard deviations of the displacements, NaN where the file states none.
    lost : int
        Number of points that the program itself marks as lost, which are left out.
    subset : float, optional
        Width of a subset (facet) in `unit`, if the file states it.
    down : bool
        Whether the file counts y downward, so that a reader turned it.
    notes : tuple of str
        What was assumed on reading.
    """

    form: str
    unit: str
    step: np.ndarray
    places: np.ndarray
    displacements: np.ndarray
    deviation: np.ndarray
    lost: int = 0
    subset: float | None = None
    down: bool = False
    notes: tuple[str, ...] = ()
