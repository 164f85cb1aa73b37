"""Three-dimensional shapes of bodies and holes, and flat cuts."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import model_validator

from .shapes import AnyOutline, Circle, Ellipse, Outline, Rectangle, Shape
from .strict_model import Finite, Positive, SpacePoint, StrictModel

AXES = {"x1": 0, "x2": 1, "x3": 2}
"""Number of each coordinate."""


class Solid(Shape):
    """A closed three-dimensional shape."""

    dimension: ClassVar[int] = 3

    @property
    @abstractmethod
    def convex(self) -> bool:
        """Whether the shape is known to be convex."""


class Prism(Solid):
    """A plane section along one axis, between two flat ends."""

    @property
    @abstractmethod
    def along(self) -> int:
        """Number of the axis."""

    @property
    @abstractmethod
    def span(self) -> tuple[float, float]:
        """Coordinate of either end."""

    @property
    @abstractmethod
    def section(self) -> Outline:
        """Outer boundary, in the two coordinates of `across`."""

    @property
    def bores(self) -> tuple[Outline, ...]:
        """Holes along all of it, likewise."""
        return ()

    @property
    def across(self) -> list[int]:
        """The other two axes, in the order that makes a right-handed system with `along` last."""
        return [(self.along + 1) % 3, (self.along + 2) % 3]

    @property
    def convex(self) -> bool:
        return not self.bores and isinstance(self.section, Rectangle | Circle | Ellipse)

    def contains(self, points: np.ndarray) -> np.ndarray:
        low, high = self.span
        inside = (points[:, self.along] > low) & (points[:, self.along] < high)
        within = np.flatnonzero(inside)
        inside[within] = in_section(points[within][:, self.across], self.section, self.bores)
        return inside

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        corners = np.empty((2, 3))
        corners[:, self.across] = self.section.bounds()
        corners[:, self.along] = self.span
        return corners[0], corners[1]


def in_section(places: np.ndarray, section: Outline, bores: tuple[Outline, ...]) -> np.ndarray:
    """Return which places (n, 2) lie in a section and in none of its bores."""
    inside = section.contains(places)
    for bore in bores:
        inside &= ~bore.contains(places)
    return inside


class Box(Prism):
    """A box with its lower left back corner at `lower`.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Box(size=(1.0, 1.0, 2.0)).dimension
    3
    """

    shape: Literal["box"] = "box"
    size: tuple[Positive, Positive, Positive]
    lower: SpacePoint = (0.0, 0.0, 0.0)

    @property
    def along(self) -> int:
        return 2

    @property
    def span(self) -> tuple[float, float]:
        return self.lower[2], self.lower[2] + self.size[2]

    @property
    def section(self) -> Outline:
        return Rectangle(size=self.size[:2], lower=self.lower[:2])


class Round(Prism):
    """A round body along an axis; `base` is the centre of its lower end."""

    length: Positive
    axis: Literal["x1", "x2", "x3"] = "x3"
    base: SpacePoint = (0.0, 0.0, 0.0)

    @property
    def along(self) -> int:
        return AXES[self.axis]

    @property
    def span(self) -> tuple[float, float]:
        low = self.base[self.along]
        return low, low + self.length

    def _circle(self, radius: float) -> Circle:
        return Circle(radius=radius, centre=tuple(self.base[axis] for axis in self.across))


class Cylinder(Round):
    """A round cylinder; `base` is the centre of its lower end.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Cylinder(radius=1.0, length=2.0).shape
    'cylinder'
    """

    shape: Literal["cylinder"] = "cylinder"
    radius: Positive

    @property
    def section(self) -> Outline:
        return self._circle(self.radius)


class Tube(Round):
    """A round tube; `base` is the centre of its lower end.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Tube(outer_radius=1.0, inner_radius=0.5, length=2.0).dimension
    3
    """

    shape: Literal["tube"] = "tube"
    inner_radius: Positive
    outer_radius: Positive

    @model_validator(mode="after")
    def _has_a_wall(self) -> Tube:
        if not self.inner_radius < self.outer_radius:
            raise ValueError(f"inner_radius must be less than outer_radius, {self.outer_radius:g}, not {self.inner_radius:g}")
        return self

    @property
    def section(self) -> Outline:
        return self._circle(self.outer_radius)

    @property
    def bores(self) -> tuple[Outline, ...]:
        return (self._circle(self.inner_radius),)


class Extrusion(Prism):
    """A shape of the plane, less others, extruded along x3 from `lower`.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Extrusion(outline=pds.shapes.Rectangle(size=(1.0, 2.0)), thickness=0.5).dimension
    3
    """

    shape: Literal["extrusion"] = "extrusion"
    outline: AnyOutline
    holes: tuple[AnyOutline, ...] = ()
    thickness: Positive
    lower: Finite = 0.0

    @property
    def along(self) -> int:
        return 2

    @property
    def span(self) -> tuple[float, float]:
        return self.lower, self.lower + self.thickness

    @property
    def section(self) -> Outline:
        return self.outline

    @property
    def bores(self) -> tuple[Outline, ...]:
        return self.holes


class Sphere(Solid):
    """A sphere, or the part of it where x1, x1 and x2, or all coordinates are greater than those of its centre.

    The flat faces of a part go through the centre: held by reflection they are planes of symmetry.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Sphere(radius=1.0).dimension
    3
    """

    shape: Literal["sphere"] = "sphere"
    radius: Positive
    centre: SpacePoint = (0.0, 0.0, 0.0)
    part: Literal["whole", "half", "quarter", "eighth"] = "whole"

    @property
    def halved(self) -> tuple[int, ...]:
        """Axes along which it is cut at its centre, in two halves of which it is the upper one."""
        return tuple(range(("whole", "half", "quarter", "eighth").index(self.part)))

    @property
    def convex(self) -> bool:
        return True

    def contains(self, points: np.ndarray) -> np.ndarray:
        offsets = points - np.array(self.centre)
        return ((offsets**2).sum(axis=1) < self.radius**2) & (offsets[:, self.halved] > 0).all(axis=1)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        centre = np.array(self.centre)
        lower = centre - self.radius
        lower[list(self.halved)] = centre[list(self.halved)]
        return lower, centre + self.radius


class FlatCut(StrictModel):
    """A flat cut of a solid: the body has no bonds that cross it."""

    dimension: ClassVar[int] = 3

    @abstractmethod
    def plane(self) -> tuple[np.ndarray, np.ndarray, float]:
        """A place on its plane, the unit normal, and the extent of the cut."""

    @abstractmethod
    def covers(self, places: np.ndarray) -> np.ndarray:
        """Return which of the places (k, 3) on the plane of the cut belong to the cut."""

    def crosses(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return which of the segments from `starts` to `ends`, each of shape (k, 3), cross the cut.

        A point on the cut's plane counts as lying on the side of the normal, to rounding, so that a cut through a layer of points
        separates them from one side.
        """
        place, normal, extent = self.plane()
        heights = [(points - place) @ normal for points in (starts, ends)]
        sides = [height >= -1e-9 * extent for height in heights]
        apart = np.flatnonzero(sides[0] != sides[1])
        crossing = np.zeros(len(starts), dtype=bool)
        below, above = heights[0][apart], heights[1][apart]
        meets = starts[apart] + (below / (below - above))[:, None] * (ends[apart] - starts[apart])
        crossing[apart] = self.covers(meets)
        return crossing


class ParallelogramCut(FlatCut):
    """A parallelogram between two sides that begin at a corner.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> cut = pds.shapes.ParallelogramCut(corner=(0.0, 0.0, 0.5), sides=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    >>> cut.covers([[0.5, 0.5, 0.5], [1.5, 0.5, 0.5]]).tolist()
    [True, False]
    """

    corner: SpacePoint
    sides: tuple[SpacePoint, SpacePoint]

    @model_validator(mode="after")
    def _has_an_area(self) -> ParallelogramCut:
        one, other = np.array(self.sides)
        if not np.linalg.norm(np.cross(one, other)) > 1e-9 * max(one @ one, other @ other):
            raise ValueError("sides: they span no area; give two of different directions")
        return self

    def plane(self) -> tuple[np.ndarray, np.ndarray, float]:
        one, other = np.array(self.sides)
        normal = np.cross(one, other)
        return np.array(self.corner), normal / np.linalg.norm(normal), max(np.linalg.norm(one), np.linalg.norm(other))

    def covers(self, places: np.ndarray) -> np.ndarray:
        shares = (places - np.array(self.corner)) @ np.linalg.pinv(np.array(self.sides))
        return ((shares >= 0) & (shares <= 1)).all(axis=1)


class DiscCut(FlatCut):
    """A disc, as the crack of a penny is.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> cut = pds.shapes.DiscCut(centre=(0.0, 0.0, 1.0), radius=0.4, normal=(0.0, 0.0, 1.0))
    >>> cut.covers([[0.3, 0.0, 1.0], [0.5, 0.0, 1.0]]).tolist()
    [True, False]
    """

    centre: SpacePoint
    radius: Positive
    normal: SpacePoint

    @model_validator(mode="after")
    def _has_a_direction(self) -> DiscCut:
        if not math.hypot(*self.normal) > 0:
            raise ValueError("normal: it must not be zero")
        return self

    def plane(self) -> tuple[np.ndarray, np.ndarray, float]:
        normal = np.array(self.normal)
        return np.array(self.centre), normal / np.linalg.norm(normal), self.radius

    def covers(self, places: np.ndarray) -> np.ndarray:
        return np.linalg.norm(places - np.array(self.centre), axis=1) <= self.radius


def cut_of(value: Any) -> str:
    """Return the kind of cut as which a part is read, by its keys: a straight cut of a sheet unless it has those of another kind."""
    if isinstance(value, FlatCut):
        return "disc" if isinstance(value, DiscCut) else "parallelogram"
    if not isinstance(value, dict):
        return "line"
    if {"corner", "sides"} & value.keys():
        return "parallelogram"
    return "disc" if {"centre", "radius", "normal"} & value.keys() else "line"
