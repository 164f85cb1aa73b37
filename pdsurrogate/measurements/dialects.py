"""What programs for image correlation write into tables: columns, units, directions."""

from dataclasses import dataclass

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
    image : tuple of str
        Columns of places in pixels, y downward, that show the direction and the scale of the rows.
    needs : tuple of str
        Further columns by which the program is known.
    deformed : bool
        Whether places are those of the deformed body.
    """

    form: str
    places: tuple[str, ...]
    displacements: tuple[str, ...]
    unit: str | None
    down: str | None
    lost: tuple[str, ...] = ()
    zeros: bool = False
    deviation: str = ""
    image: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    deformed: bool = False


XYZ, UVW = ("X", "Y", "Z"), ("U", "V", "W")
xyz, uvw = ("x", "y", "z"), ("u", "v", "w")  # fmt: skip
VIC = {"lost": ("sigma",), "zeros": True, "deviation": "sigma"}
DICE = {"lost": ("SIGMA", "MATCH"), "deviation": "SIGMA"}
MATCHID = tuple(f"disp.{name}" for name in ("Horizontal Displacement U", "Vertical Displacement V"))
PIXELS = ("Coordinates.Image X", "Coordinates.Image Y")

OWN = Dialect("pdsurrogate", ("x1", "x2", "x3"), ("u1", "u2", "u3"), "", "")

DIALECTS = (
    OWN,
    Dialect(
        "DICe, stereo",
        tuple(f"MODEL_COORDINATES_{axis}" for axis in XYZ),
        tuple(f"MODEL_DISPLACEMENT_{axis}" for axis in XYZ),
        None,
        None,
        ("SIGMA", "MATCH"),
    ),
    Dialect(
        "DICe",
        ("COORDINATE_X", "COORDINATE_Y"),
        ("DISPLACEMENT_X", "DISPLACEMENT_Y"),
        "px",
        "yv",
        **DICE,
    ),
    Dialect(
        "al-dic-3d",
        ("X_mm", "Y_mm", "Z_mm"),
        UVW,
        "mm",
        "yzvw",
        deformed=True,
    ),
    Dialect("al-dic", ("x_px", "y_px"), ("disp_u", "disp_v"), "px", "y"),
    Dialect("VIC-2D, calibrated", ("x_c", "y_c"), ("u_c", "v_c"), "mm", "", image=xyz[:2], **VIC),
    Dialect("VIC-3D", XYZ, UVW, "mm", "", image=xyz[:2], needs=("sigma",), **VIC),
    Dialect("VIC", xyz[:2], uvw[:2], "px", "yv", needs=("sigma",), **VIC),
    Dialect("ARAMIS", ("x_undef", "y_undef", "z_undef"), uvw, "mm", ""),
    Dialect(
        "MatchID",
        tuple(f"coor.{axis}" for axis in XYZ),
        (*MATCHID, "disp.Out-Of-Plane: W"),
        "mm",
        "yzvw",
        deviation="stats.Sigma",
        image=PIXELS,
    ),
    Dialect("MatchID", PIXELS, MATCHID, "px", "yv", deviation="stats.Sigma"),
    Dialect(
        "MatchID 2023", xyz, uvw, "mm", "yzvw", image=("x_pic", "y_pic"), needs=("x_pic", "y_pic")
    ),
    Dialect(
        "sun-dic",
        tuple(f"{axis} Coord" for axis in XYZ),
        tuple(f"{axis} Disp" for axis in XYZ),
        "px",
        "yv",
    ),
    Dialect("columns x, y, u, v of no known program", xyz, uvw, None, None),
    Dialect("columns X, Y, U, V of no known program", XYZ, UVW, None, None),
)
"""Dialects in the order in which they are sought: the first one whose columns a table has is its
own.
"""

STEPS = ("step", "FRAME", "frame", "Frame", "stage", "Stage", "image", "Image")
"""Columns that number the images."""


@dataclass(frozen=True)
class Rows:
    """Rows of a file in its own axes: an image number (from the file, if `numbered`), places,
    displacements and deviation each, and whether its point is lost.
    """

    dialect: Dialect
    unit: str
    image: np.ndarray
    places: np.ndarray
    displacements: np.ndarray
    deviation: np.ndarray
    lost: np.ndarray
    numbered: bool = False
    subset: float | None = None
    notes: tuple[str, ...] = ()
