"""Regions of a body, given by a name, a shape, a list of points or a combination; conditions,
loads and materials refer to regions.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Literal, get_args

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    model_validator,
)

from .strict_model import (
    Direction,
    Point,
    Positive,
    SpaceDirection,
    SpacePoint,
    StrictModel,
    Vector,
    Whole,
    refused,
    the_one,
)

Face = Literal["left", "right", "bottom", "top", "back", "front"]
FACES: tuple[Face, ...] = get_args(Face)
"""Faces of the bounding box of a body in three dimensions; the first four are the edges of a
body in the plane.
"""


EDGES = {name: (number // 2, 2 * (number % 2) - 1) for number, name in enumerate(FACES)}
"""Normal axis of each edge or face of the bounding box (0 for x1), and its side: -1 at the lower
end of the axis, +1 at the upper.
"""


def edge_names(dimension: int) -> tuple[str, ...]:
    """Return the names of the edges of the bounding box of a sheet (dimension 2), or of the
    faces of the bounding box of a solid (3).
    """
    return FACES[: 2 * dimension]


def reserved_names(dimension: int) -> tuple[str, ...]:
    """Return the names of the regions that every body has: edges or faces, ``body``, ``outline``
    (outer boundary) and ``holes``.
    """
    return (*edge_names(dimension), "body", "outline", "holes")


_MISNAMED = "the name of a region begins with a letter, and goes on with letters, digits, - and _"
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}")
RegionName = Annotated[
    str, AfterValidator(refused(lambda name: not _NAME.fullmatch(name), _MISNAMED))
]


class Disc(StrictModel):
    """Disc: all places within a radius of its center.

    Parameters
    ----------
    center : point
        Center. Unit: length.
    radius : float
        Radius. Unit: length.
    """

    center: Point
    radius: Positive


class HalfPlane(StrictModel):
    """Half-plane bounded by a straight line, which belongs to it.

    Parameters
    ----------
    point : point
        A place on the line. Unit: length.
    normal : vector
        Direction across the line that points into the half-plane, of any length. Unit: none.
    """

    point: Point
    normal: Direction


class Ball(StrictModel):
    """Ball: all places within a radius of its center, in three dimensions.

    Parameters
    ----------
    center : point
        Center. Unit: length.
    radius : float
        Radius. Unit: length.
    """

    center: SpacePoint
    radius: Positive


class HalfSpace(StrictModel):
    """Half-space bounded by a plane, which belongs to it.

    Parameters
    ----------
    point : point
        A place on the plane. Unit: length.
    normal : vector
        Direction across the plane that points into the half-space, of any length. Unit: none.
    """

    point: SpacePoint
    normal: SpaceDirection


class Region(StrictModel):
    """Region of a body, defined in exactly one way.

    Parameters
    ----------
    edge : {"left", "right", "bottom", "top", "back", "front"}, optional
        Edge of the bounding box; ``"back"`` and ``"front"`` are faces of solids, normal to x3.
    box : pair of points, optional
        Two opposite corners of a box, the first with the least coordinates; the boundary belongs to
        the region. Unit: length.
    disc : Disc, optional
        A disc, for a body in the plane.
    half_plane : HalfPlane, optional
        A half-plane, for a body in the plane.
    ball : Ball, optional
        A ball, for a solid.
    half_space : HalfSpace, optional
        A half-space, for a solid.
    points : list of int, optional
        Numbers of points of the body, from 0.
    near : point, optional
        A place: the region is the point of the body nearest to it, or all points that are equally
        near, as on both sides of an axis. Unit: length.
    group : str, optional
        Name of a physical group of a mesh.
    both : list of Region or str, optional
        Intersection of regions; the key in scene files is ``and``.
    either : list of Region or str, optional
        Union of regions; the key in scene files is ``or``.
    other : Region or str, optional
        Complement of a region; the key in scene files is ``not``.

    See Also
    --------
    pdsurrogate.Prescribed, pdsurrogate.Load, pdsurrogate.Part

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> region = pds.Region(box=((0.0, 0.0), (1.0, 0.2)))
    >>> region.box
    ((0.0, 0.0), (1.0, 0.2))
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    edge: Face | None = None
    box: tuple[Vector, Vector] | None = None
    disc: Disc | None = None
    half_plane: HalfPlane | None = None
    ball: Ball | None = None
    half_space: HalfSpace | None = None
    points: Annotated[tuple[Annotated[Whole, Field(ge=0)], ...] | None, Field(min_length=1)] = None
    near: Vector | None = None
    group: str | None = None
    both: Annotated[tuple[RegionReference, ...] | None, Field(alias="and", min_length=1)] = None
    either: Annotated[tuple[RegionReference, ...] | None, Field(alias="or", min_length=1)] = None
    other: Annotated[RegionReference | None, Field(alias="not")] = None

    @model_validator(mode="after")
    def _given_once(self) -> Region:
        the_one(self, type(self).model_fields)
        if self.box is not None and not all(
            low <= high for low, high in zip(*self.box, strict=False)
        ):
            raise ValueError(
                "box must be two corners, first the one with the smallest and then the one with the"
                " greatest coordinates"
            )
        return self

    def members(self) -> Iterator[tuple[str, str | Region]]:
        """Yield the regions that this region combines, each preceded by its key: and.0, and.1,
        or.0, not.

        Yields
        ------
        key : str
            Key of the region in a scene file.
        region : str or Region
            Region or its name.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> list(pds.Region(both=("top", "left")).members())
        [('and.0', 'top'), ('and.1', 'left')]
        """
        yield from ((f"and.{number}", member) for number, member in enumerate(self.both or ()))
        yield from ((f"or.{number}", member) for number, member in enumerate(self.either or ()))
        yield from () if self.other is None else [("not", self.other)]


_NO_REGION = 'must be the name of a region, or a region such as {edge = "left"}'
RegionReference = Annotated[
    Annotated[str, Tag("name")] | Annotated[Region, Tag("region")],
    Discriminator(lambda value: "name" if isinstance(value, str) else "region"),
    BeforeValidator(refused(lambda value: not isinstance(value, str | dict | Region), _NO_REGION)),
]
"""Name of a region, or a region given in place."""

Region.model_rebuild()


def references_in(key: str, region: str | Region) -> Iterator[tuple[str, str | Region]]:
    """Yield a region, or its name, and all regions that it combines, at any depth, each preceded
    by its dotted key.
    """
    yield key, region
    if isinstance(region, Region):
        for inner, member in region.members():
            yield from references_in(f"{key}.{inner}", member)


def label_of_region(reference: str | Region, otherwise: str) -> str:
    """Return a region's label for results: its name, edge or group (other characters than
    A-Za-z0-9_.- become _), else `otherwise`.
    """
    if isinstance(reference, str):
        return reference
    return (
        reference.edge
        or re.sub(r"[^A-Za-z0-9_.-]", "_", reference.group or "").lstrip("_.-")[:64]
        or otherwise
    )
