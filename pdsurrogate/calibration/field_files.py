"""Displacement fields from the files of programs for image correlation, as rows of measurements."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel
from typer import Option

from ..identification.campaign import Up
from ..measurements import files_at, is_field, read_fields
from ..measurements.dialects import OWN
from ..measurements.field import MeasuredField
from ..measurements.quantities import factor
from ..scenes import Scene


class FieldFacts(BaseModel):
    """Statements of a user about files of displacements."""

    frame: Annotated[
        Literal["scene", "image"] | None,
        Option(
            metavar="FRAME",
            help=(
                "scene: places and displacements are those of the scene (default for columns x1,"
                " x2, u1, u2); image: the map from the image to the scene is fitted with the law"
                " (default for files of image correlation)."
            ),
        ),
    ] = None
    pixels_per: Annotated[
        tuple[str, float] | None,
        Option(
            metavar="UNIT N",
            help="Pixels per unit of length of the scene, as cm 152: starts the map.",
        ),
    ] = None
    origin: Annotated[
        tuple[float, float] | None,
        Option(
            metavar="X Y",
            help="Place in the image, in the axes of the file, of the origin of the scene.",
        ),
    ] = None
    up: Up = None
    subset: Annotated[
        float | None,
        Option(help="Width of a subset: points nearer to an edge than half of it are left out."),
    ] = None


@dataclass(frozen=True)
class FieldRows:
    """Displacements of files as rows of a table of measurements.

    Attributes
    ----------
    X : ndarray, shape (n, 2 + d)
    y, deviation : ndarray, shape (n,)
        Values and their standard deviations, NaN where the files state none.
    notes : tuple of str
    arguments : dict
        Arguments of a `SceneRegressor`.
    """

    X: np.ndarray
    y: np.ndarray
    deviation: np.ndarray
    notes: tuple[str, ...]
    arguments: dict


def is_own(paths: list[Path], facts: FieldFacts) -> bool:
    """Whether a file has the columns x1, x2, u1, u2 of a scene, and no image of it is meant."""
    paths = files_at(*paths)
    return len(paths) == 1 and facts.frame != "image" and is_field(paths[0]) in (OWN.form, None)


def displacement_rows(step: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the rows of all displacements at places (n, d) in steps, as columns of a table of
    measurements, (n * d, 2 + d): those along the first axis, then those along the second, ...
    """
    n, d = places.shape
    axes = np.repeat(np.arange(1, d + 1), n)
    return np.column_stack([np.tile(step, d), axes, np.tile(places, (d, 1))])


def field_rows(scene: Scene, paths: list[Path], facts: FieldFacts, unit: str | None) -> FieldRows:
    """Return the rows of files of displacements by image, in their own units."""
    d = scene.dimension
    field = read_fields(*paths, unit=unit, up=facts.up, dimension=d)
    lost = [f"{field.lost} points that the program marks as lost are left out"] * (field.lost > 0)
    subset = field.subset if facts.subset is None else facts.subset
    if subset is None and facts.frame != "scene":
        lost.append("no width of a subset is known: points at edges count as others (--subset)")
    origin = None
    if facts.origin is not None:
        x, y = facts.origin
        origin = (x, -y if field.down else y)
    return FieldRows(
        displacement_rows(field.step, field.places),
        field.displacements.T.ravel(),
        np.tile(field.deviation, d),
        (f"fields: {field.form}, in {field.unit or 'the unit of the scene'}", *field.notes, *lost),
        {"frame": "scene"}
        if facts.frame == "scene"
        else {
            "frame": "image",
            "pixels_per": _per_length(scene, field, facts),
            "origin": origin,
            "subset": subset,
        },
    )


def _per_length(scene: Scene, field: MeasuredField, facts: FieldFacts) -> float | None:
    """Return the length in the files of a unit of length of the scene, None if it is unknown."""
    own = scene.units.length
    if facts.pixels_per is None:
        if field.unit == "px" or not own:
            return None
        if not field.unit:
            return 1.0
        return factor(own, field.unit)
    unit, pixels = facts.pixels_per
    if field.unit not in ("px", ""):
        raise ValueError(f"--pixels-per: the files are in {field.unit}, not in pixels")
    if own and unit != own:
        raise ValueError(f"--pixels-per {unit}: state the pixels per {own}, the unit of the scene")
    return pixels
