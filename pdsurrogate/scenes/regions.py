"""Regions of a body: places by name, by a shape, by a list, and combined; conditions, loads and materials refer to them."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import ConfigDict, Field, model_validator

from .strict_model import Point, Positive, StrictModel, Whole

EDGE_NAMES = ("left", "right", "bottom", "top")
"""Edges of the bounding box of a body."""

RESERVED = (*EDGE_NAMES, "body", "outline", "holes")
"""Regions that every body has: its edges, all of it, its outer boundary, and the boundary of its holes (``holes.0`` the first alone)."""

RegionName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]


class Disc(StrictModel):
    """A disc: everything within a radius of its centre."""

    centre: Point
    radius: Positive


class HalfPlane(StrictModel):
    """All on one side of a straight line through a point: the side that the normal points to, the line itself included."""

    point: Point
    normal: Point

    @model_validator(mode="after")
    def _has_a_direction(self) -> HalfPlane:
        if not math.hypot(*self.normal) > 0:
            raise ValueError("the normal of a half-plane must not be zero")
        return self


class Region(StrictModel):
    """A region, said in exactly one way.

    Attributes
    ----------
    edge : str
        Edge of the bounding box, as the names left, right, bottom and top mean it.
    box : pair of points
        Lower left and upper right corner; the boundary belongs to it.
    disc : Disc
    half_plane : HalfPlane
    points : list of int
        Numbers of points of the body.
    near : point
        The point of the body nearest to a place.
    group : str
        Physical group of a mesh, by its name.
    both, either : list of regions
        Written ``and``, ``or``: what is in all of them, or in one or more.
    other : region
        Written ``not``: what is not in it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    edge: str | None = None
    box: tuple[Point, Point] | None = None
    disc: Disc | None = None
    half_plane: HalfPlane | None = None
    points: Annotated[tuple[Annotated[Whole, Field(ge=0)], ...] | None, Field(min_length=1)] = None
    near: Point | None = None
    group: str | None = None
    both: Annotated[tuple[RegionReference, ...] | None, Field(alias="and", min_length=1)] = None
    either: Annotated[tuple[RegionReference, ...] | None, Field(alias="or", min_length=1)] = None
    other: Annotated[RegionReference | None, Field(alias="not")] = None

    @model_validator(mode="after")
    def _said_once(self) -> Region:
        given = [name for name, field in type(self).model_fields.items() if getattr(self, name) is not None]
        names = [field.alias or name for name, field in type(self).model_fields.items()]
        if len(given) != 1:
            raise ValueError(f"a region is said in exactly one way, by one of {', '.join(names)}")
        if self.edge is not None and self.edge not in EDGE_NAMES:
            raise ValueError(f"edge must be one of {', '.join(EDGE_NAMES)}, not {self.edge!r}")
        if self.box is not None and not all(low <= high for low, high in zip(*self.box, strict=True)):
            raise ValueError("a box is given by its lower left and its upper right corner")
        return self


RegionReference = str | Region
"""The name of a region, or a region said on the spot."""

Region.model_rebuild()
