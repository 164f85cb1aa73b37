"""Three-dimensional shapes of bodies and holes, and flat cuts."""

from abc import abstractmethod
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag

from ..kernels.polygons import distances_to_segments
from .shapes import (
    ENDS,
    AnyOutline,
    Circle,
    Cut,
    Ellipse,
    Mesh,
    Outline,
    Polygon,
    Precut,
    Rectangle,
    Shape,
    nearest_on_sphere,
    with_shape,
)
from .strict_model import Finite, Positive, SpaceDirection, SpacePoint


class Solid(Shape):
    """Closed three-dimensional shape of a body or a hole."""

    dimension: ClassVar[int] = 3


class Straight(NamedTuple):
    """Geometry of a prism: a plane section with holes, extended along one axis between two flat
    ends.

    Attributes
    ----------
    along : int
        Number of the axis along which the prism extends: 0, 1 or 2.
    section : Outline
        Outer boundary of the section, in the two coordinates of `across`.
    bores : tuple of Outline
        Holes through the whole length, in the two coordinates of `across`.
    span : tuple of float
        Coordinates of the two ends along the axis.
    """

    along: int
    section: Outline
    bores: tuple[Outline, ...]
    span: tuple[float, float]

    @property
    def across(self) -> list[int]:
        """Return the numbers of the two axes across the prism, in the order that makes a
        right-handed system with `along` last.
        """
        return [(self.along + 1) % 3, (self.along + 2) % 3]


class Prism(Solid):
    """Solid with a constant plane section along one axis: a box, cylinder, tube or extrusion."""

    @property
    @abstractmethod
    def straight(self) -> Straight:
        """Return the section of the solid, its axis and the span along the axis.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.shapes.Cylinder(radius=1.0, length=2.0).straight.section.shape
        'circle'
        """

    def contains(self, points: np.ndarray) -> np.ndarray:
        straight = self.straight
        along, section, bores, (low, high) = straight
        inside = (points[:, along] > low) & (points[:, along] < high)
        within = np.flatnonzero(inside)
        places = points[within][:, straight.across]
        inside[within] = section.contains(places) & ~np.any(
            [bore.contains(places) for bore in bores], axis=0
        )
        return inside

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        straight = self.straight
        corners = np.empty((2, 3))
        corners[:, straight.across], corners[:, straight.along] = (
            straight.section.bounds(),
            straight.span,
        )
        return corners[0], corners[1]


class Box(Prism):
    """Box.

    Parameters
    ----------
    arrangement : {"lattice", "relaxed"}
        How the points of a body lie: in rows along the axes, or in an irregular cloud without rows,
        so that the direction of a crack does not depend on the axes. Holes leave it out.
    seed : int
        Number of the cloud of a relaxed body: other seeds give other clouds. Unit: none.
    shape : {"box"}
        Name of the shape.
    size : three floats
        Sides along x1, x2 and x3. Unit: length.
    lower : point
        Corner with the least coordinates. Unit: length.

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
    def straight(self) -> Straight:
        return self.straight_along(2)

    def straight_along(self, axis: int) -> Straight:
        """Return the box as a prism along an axis.

        Parameters
        ----------
        axis : int
            Number of the axis: 0, 1 or 2.

        Returns
        -------
        Straight
            Rectangular section, and span along the axis.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.shapes.Box(size=(1.0, 1.0, 2.0)).straight_along(2).span
        (0.0, 2.0)
        """
        across = (axis + 1) % 3, (axis + 2) % 3
        section = Rectangle(
            size=tuple(self.size[other] for other in across),
            lower=tuple(self.lower[other] for other in across),
        )
        return Straight(axis, section, (), (self.lower[axis], self.lower[axis] + self.size[axis]))


class Round(Prism):
    """Base of cylinder and tube: a round body along an axis.

    Parameters
    ----------
    length : float
        Length along the axis. Unit: length.
    axis : {"x1", "x2", "x3"}
        Axis along which the body extends.
    base : point
        Center of its lower end. Unit: length.
    """

    length: Positive
    axis: Literal["x1", "x2", "x3"] = "x3"
    base: SpacePoint = (0.0, 0.0, 0.0)

    def _straight(self, radius: float, *bores: float) -> Straight:
        """Return the circular section and axis of the body with an outer `radius` and concentric
        holes of the radii `bores`.
        """
        along = int(self.axis[1:]) - 1
        center = self.base[(along + 1) % 3], self.base[(along + 2) % 3]
        outer, *inner = (Circle(radius=each, center=center) for each in (radius, *bores))
        return Straight(
            along, outer, tuple(inner), (self.base[along], self.base[along] + self.length)
        )


class Cylinder(Round):
    """Round cylinder.

    Parameters
    ----------
    arrangement : {"lattice", "relaxed"}
        How the points of a body lie: in rows along the axes, or in an irregular cloud without rows,
        so that the direction of a crack does not depend on the axes. Holes leave it out.
    seed : int
        Number of the cloud of a relaxed body: other seeds give other clouds. Unit: none.
    length : float
        Length along the axis. Unit: length.
    axis : {"x1", "x2", "x3"}
        Axis along which the body extends.
    base : point
        Center of its lower end. Unit: length.
    shape : {"cylinder"}
        Name of the shape.
    radius : float
        Radius. Unit: length.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Cylinder(radius=1.0, length=2.0).shape
    'cylinder'
    """

    shape: Literal["cylinder"] = "cylinder"
    radius: Positive

    @property
    def straight(self) -> Straight:
        return self._straight(self.radius)


class Tube(Round):
    """Round tube.

    Parameters
    ----------
    arrangement : {"lattice", "relaxed"}
        How the points of a body lie: in rows along the axes, or in an irregular cloud without rows,
        so that the direction of a crack does not depend on the axes. Holes leave it out.
    seed : int
        Number of the cloud of a relaxed body: other seeds give other clouds. Unit: none.
    length : float
        Length along the axis. Unit: length.
    axis : {"x1", "x2", "x3"}
        Axis along which the body extends.
    base : point
        Center of its lower end. Unit: length.
    shape : {"tube"}
        Name of the shape.
    inner_radius : float
        Radius of the bore, less than the outer radius. Unit: length.
    outer_radius : float
        Radius of the outer surface. Unit: length.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Tube(outer_radius=1.0, inner_radius=0.5, length=2.0).dimension
    3
    """

    shape: Literal["tube"] = "tube"
    inner_radius: Positive
    outer_radius: Positive

    def model_post_init(self, _) -> None:
        if not self.inner_radius < self.outer_radius:
            raise ValueError(
                f"inner_radius must be less than outer_radius, {self.outer_radius:g}, not"
                f" {self.inner_radius:g}"
            )

    @property
    def straight(self) -> Straight:
        return self._straight(self.outer_radius, self.inner_radius)


class Extrusion(Prism):
    """Solid made by extruding a shape of the plane, with or without holes, along x3.

    Parameters
    ----------
    arrangement : {"lattice", "relaxed"}
        How the points of a body lie: in rows along the axes, or in an irregular cloud without rows,
        so that the direction of a crack does not depend on the axes. Holes leave it out.
    seed : int
        Number of the cloud of a relaxed body: other seeds give other clouds. Unit: none.
    shape : {"extrusion"}
        Name of the shape.
    outline : Rectangle, Circle, Ellipse or Polygon
        Outer boundary of the section.
    holes : list of shapes of the plane
        Holes through the whole thickness.
    thickness : float
        Length along x3. Unit: length.
    lower : float
        Least x3. Unit: length.

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
    def straight(self) -> Straight:
        return Straight(2, self.outline, self.holes, (self.lower, self.lower + self.thickness))


class Sphere(Solid):
    """Sphere, or a half, quarter or eighth of it.

    The flat faces of a part pass through the center; held by reflection planes they are planes of
    symmetry of a whole sphere.

    Parameters
    ----------
    arrangement : {"lattice", "relaxed"}
        How the points of a body lie: in rows along the axes, or in an irregular cloud without rows,
        so that the direction of a crack does not depend on the axes. Holes leave it out.
    seed : int
        Number of the cloud of a relaxed body: other seeds give other clouds. Unit: none.
    shape : {"sphere"}
        Name of the shape.
    radius : float
        Radius. Unit: length.
    center : point
        Center of the whole sphere. Unit: length.
    part : {"whole", "half", "quarter", "eighth"}
        Part of the sphere: a half lies above the center along x1, a quarter along x1 and x2, an
        eighth along all axes.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Sphere(radius=1.0).dimension
    3
    """

    shape: Literal["sphere"] = "sphere"
    radius: Positive
    center: SpacePoint = (0.0, 0.0, 0.0)
    part: Literal["whole", "half", "quarter", "eighth"] = "whole"

    @property
    def halved(self) -> tuple[int, ...]:
        """Return the numbers of the axes along which the body is only the upper half of the sphere;
        empty for a whole sphere.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.shapes.Sphere(radius=1.0, part="quarter").halved
        (0, 1)
        """
        return tuple(range(("whole", "half", "quarter", "eighth").index(self.part)))

    def contains(self, points: np.ndarray) -> np.ndarray:
        offsets = points - np.array(self.center)
        return ((offsets**2).sum(axis=1) < self.radius**2) & (offsets[:, self.halved] > 0).all(
            axis=1
        )

    def nearest(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the points of the whole sphere that are nearest to places, and its principal
        curvatures there.

        Parameters
        ----------
        places : ndarray, shape (k, 3)

        Returns
        -------
        feet : ndarray, shape (k, 3)
        curvatures : ndarray, shape (k, 2)
            The inverse radius, for both principal directions.

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> pds.shapes.Sphere(radius=2.0).nearest(np.array([[1.0, 0.0, 0.0]]))[0].tolist()
        [[2.0, 0.0, 0.0]]
        """
        return nearest_on_sphere(places, np.array(self.center), self.radius)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        center = np.array(self.center)
        lower = center - self.radius
        lower[list(self.halved)] = center[list(self.halved)]
        return lower, center + self.radius


class ParallelogramCut(Cut):
    """Flat cut in the shape of a parallelogram.

    Parameters
    ----------
    corner : point
        A corner. Unit: length.
    sides : pair of vectors
        The two sides that start at the corner. Unit: length.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> cut = pds.shapes.ParallelogramCut(
    ...     corner=(0.0, 0.0, 0.5), sides=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    ... )
    >>> cut.covers([[0.5, 0.5, 0.5], [1.5, 0.5, 0.5]]).tolist()
    [True, False]
    """

    corner: SpacePoint
    sides: tuple[SpacePoint, SpacePoint]

    def model_post_init(self, _) -> None:
        one, other = np.array(self.sides)
        if not np.linalg.norm(np.cross(one, other)) > 1e-9 * max(one @ one, other @ other):
            raise ValueError("sides: they span no area; give two of different directions")

    @property
    def _outline(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Ends of the sides in order around the cut."""
        one, other = np.array(self.sides)
        corners = np.add(self.corner, [0 * one, one, one + other, other])
        return list(zip(corners, np.roll(corners, -1, axis=0), strict=True))

    def plane(self) -> tuple[np.ndarray, np.ndarray, float]:
        one, other = np.array(self.sides)
        normal = np.cross(one, other)
        return (
            np.array(self.corner),
            normal / np.linalg.norm(normal),
            float(max(np.linalg.norm(one), np.linalg.norm(other))),
        )

    def moved(self, way: Callable[[np.ndarray], np.ndarray]) -> Self:
        ends = way(np.add(self.corner, [(0.0, 0.0, 0.0), *self.sides]))
        corner, one, other = map(tuple, [ends[0].tolist(), *(ends[1:] - ends[0]).tolist()])
        return self.model_copy(update={"corner": corner, "sides": (one, other)})

    def covers(self, places: np.ndarray) -> np.ndarray:
        shares = (places - np.array(self.corner)) @ np.linalg.pinv(np.array(self.sides))
        return ((shares > ENDS) & (shares < 1 - ENDS)).all(axis=1)

    def distances(self, places: np.ndarray) -> np.ndarray:
        corner, normal, _ = self.plane()
        beside = np.min([distances_to_segments(places, *ends) for ends in self._outline], axis=0)
        return np.where(self.covers(places), np.abs((places - corner) @ normal), beside)

    def edge(self, pitch: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        found = []
        normal = self.plane()[1]
        for start, end in self._outline:
            side = end - start
            length = np.linalg.norm(side)
            count = int(np.ceil(length / pitch))
            shares = (np.arange(count)[:, None] + 0.5) / count
            found.append(
                (
                    start + shares * side,
                    np.tile(np.cross(side, normal) / length, (count, 1)),
                    np.full(count, length / count),
                )
            )
        places, outward, lengths = map(np.concatenate, zip(*found, strict=True))
        return places, outward, lengths


class DiscCut(Cut):
    """Flat cut in the shape of a disc, such as a penny-shaped crack.

    Parameters
    ----------
    center : point
        Center. Unit: length.
    radius : float
        Radius. Unit: length.
    normal : vector
        Direction across the disc, of any length. Unit: none.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> cut = pds.shapes.DiscCut(center=(0.0, 0.0, 1.0), radius=0.4, normal=(0.0, 0.0, 1.0))
    >>> cut.covers([[0.3, 0.0, 1.0], [0.5, 0.0, 1.0]]).tolist()
    [True, False]
    """

    center: SpacePoint
    radius: Positive
    normal: SpaceDirection

    def plane(self) -> tuple[np.ndarray, np.ndarray, float]:
        normal = np.array(self.normal)
        return np.array(self.center), normal / np.linalg.norm(normal), self.radius

    def moved(self, way: Callable[[np.ndarray], np.ndarray]) -> Self:
        return self.model_copy(update={"center": tuple(way(np.array([self.center]))[0].tolist())})

    def covers(self, places: np.ndarray) -> np.ndarray:
        return np.linalg.norm(places - np.array(self.center), axis=1) < (1 - ENDS) * self.radius

    def distances(self, places: np.ndarray) -> np.ndarray:
        center, normal, radius = self.plane()
        heights = (places - center) @ normal
        return np.hypot(
            heights,
            np.maximum(
                0.0, np.linalg.norm(places - center - heights[:, None] * normal, axis=1) - radius
            ),
        )

    def edge(self, pitch: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        center, normal, radius = self.plane()
        count = 4 * int(np.ceil(np.pi / 2 * radius / pitch))  # symmetric about the axes
        angles = 2 * np.pi * (np.arange(count) + 0.5) / count
        axes = np.linalg.svd(normal[None])[2][1:]
        outward = np.column_stack([np.cos(angles), np.sin(angles)]) @ axes
        return center + radius * outward, outward, np.full(count, 2 * np.pi * radius / count)


def _cut_of(value: Any) -> str:
    """Return the kind of a described cut by its keys: "parallelogram", "disc", or else "line",
    the straight cut of a sheet.
    """
    given = value if isinstance(value, dict) else getattr(value, "__dict__", {})
    kinds = {"parallelogram": ParallelogramCut, "disc": DiscCut}
    return next((kind for kind, cut in kinds.items() if cut.model_fields.keys() & given), "line")


_Shape = Rectangle | Circle | Ellipse | Polygon | Box | Cylinder | Sphere | Tube | Extrusion
AnyShape = Annotated[_Shape, Field(discriminator="shape"), BeforeValidator(with_shape)]
AnyBody = Annotated[_Shape | Mesh, Field(discriminator="shape"), BeforeValidator(with_shape)]
AnyPrecut = Annotated[
    Annotated[Precut, Tag("line")]
    | Annotated[ParallelogramCut, Tag("parallelogram")]
    | Annotated[DiscCut, Tag("disc")],
    Discriminator(_cut_of),
]
