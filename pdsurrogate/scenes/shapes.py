"""Shapes of bodies and holes in the plane, bodies from mesh files, and straight cuts."""

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field

from ..kernels.polygons import distances_to_segments, encloses
from .strict_model import Point, Positive, StrictModel, Whole


class Shape(StrictModel):
    """Closed shape of a body or a hole, in the plane or in three dimensions.

    Parameters
    ----------
    arrangement : {"lattice", "relaxed"}
        How the points of a body lie: in rows along the axes, or in an irregular cloud without rows,
        so that the direction of a crack does not depend on the axes. Holes leave it out.
    seed : int
        Number of the cloud of a relaxed body: other seeds give other clouds. Unit: none.

    Attributes
    ----------
    dimension : int
        Number of dimensions, 2 or 3.
    """

    dimension: ClassVar[int]

    arrangement: Literal["lattice", "relaxed"] = "lattice"
    seed: Annotated[Whole, Field(ge=0, le=2**63 - 1)] = 0  # the greatest integer of TOML

    @abstractmethod
    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return whether points lie inside the shape.

        Parameters
        ----------
        points : ndarray, shape (n, d)

        Returns
        -------
        ndarray of bool, shape (n,)

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> pds.shapes.Circle(radius=1.0).contains(np.array([[0.5, 0.5], [1.0, 1.0]])).tolist()
        [True, False]
        """

    @abstractmethod
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower and the upper corner of the bounding box of the shape.

        Returns
        -------
        lower, upper : ndarray, shape (d,)

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> [corner.tolist() for corner in pds.shapes.Circle(radius=1.0).bounds()]
        [[-1.0, -1.0], [1.0, 1.0]]
        """


class Outline(Shape):
    """Closed shape in the plane, with nodes along its boundary."""

    dimension: ClassVar[int] = 2

    @abstractmethod
    def boundary(self, cell: np.ndarray) -> np.ndarray:
        """Return the positions of nodes in order around the shape, shape (k, 2).

        Nodes of straight sides, which include the corners, are about a cell apart; nodes of round
        sides are at most half a cell apart.

        Parameters
        ----------
        cell : ndarray, shape (2,)
            Sides of a cell.

        Returns
        -------
        ndarray, shape (k, 2)

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> pds.shapes.Rectangle(size=(1.0, 1.0)).boundary(np.array([0.5, 0.5])).shape
        (8, 2)
        """

    @abstractmethod
    def nearest(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the points of the boundary that are nearest to places, and the curvature of the
        boundary there.

        Parameters
        ----------
        places : ndarray, shape (k, 2)

        Returns
        -------
        feet : ndarray, shape (k, 2)
        curvature : ndarray, shape (k, 1)
            Inverse radius of curvature; 0 on straight sides and at corners.

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> feet, curvature = pds.shapes.Circle(radius=2.0).nearest(np.array([[1.0, 0.0]]))
        >>> feet.tolist(), curvature.tolist()
        ([[2.0, 0.0]], [[0.5]])
        """


class Sided(Outline):
    """Closed shape in the plane with straight sides."""

    @property
    @abstractmethod
    def _corners(self) -> np.ndarray:
        """Return the corners in order around the shape, shape (k, 2)."""

    def boundary(self, cell: np.ndarray) -> np.ndarray:
        # Every side is divided into equal pieces, as near as possible to the size of a cell.
        corners = self._corners
        sides = np.roll(corners, -1, axis=0) - corners
        pieces = [max(1, round(float(np.hypot(*(side / cell))))) for side in sides]
        divided = zip(corners, sides, pieces, strict=True)
        return np.concatenate(
            [corner + np.arange(count)[:, None] / count * side for corner, side, count in divided]
        )

    def nearest(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        import shapely  # here, because few bodies need it

        sides = shapely.linearrings(self._corners)
        feet = shapely.line_interpolate_point(
            sides, shapely.line_locate_point(sides, shapely.points(places))
        )
        return shapely.get_coordinates(feet), np.zeros((len(places), 1))


class Rectangle(Sided):
    """Rectangle.

    Parameters
    ----------
    arrangement : {"lattice", "relaxed"}
        How the points of a body lie: in rows along the axes, or in an irregular cloud without rows,
        so that the direction of a crack does not depend on the axes. Holes leave it out.
    seed : int
        Number of the cloud of a relaxed body: other seeds give other clouds. Unit: none.
    shape : {"rectangle"}
        Name of the shape.
    size : pair of float
        Sides along x1 and x2. Unit: length.
    lower : point
        Lower left corner. Unit: length.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Rectangle(size=(3.0, 1.0)).size
    (3.0, 1.0)
    """

    shape: Literal["rectangle"] = "rectangle"
    size: tuple[Positive, Positive]
    lower: Point = (0.0, 0.0)

    def contains(self, points: np.ndarray) -> np.ndarray:
        low, high = self.bounds()
        return np.all((points > low) & (points < high), axis=1)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        lower = np.array(self.lower)
        return lower, lower + np.array(self.size)

    @property
    def _corners(self) -> np.ndarray:
        (left, bottom), (right, top) = self.bounds()
        return np.array([[left, bottom], [right, bottom], [right, top], [left, top]])


class Ellipse(Outline):
    """Ellipse.

    Parameters
    ----------
    arrangement : {"lattice", "relaxed"}
        How the points of a body lie: in rows along the axes, or in an irregular cloud without rows,
        so that the direction of a crack does not depend on the axes. Holes leave it out.
    seed : int
        Number of the cloud of a relaxed body: other seeds give other clouds. Unit: none.
    shape : {"ellipse"}
        Name of the shape.
    semi_axes : pair of float
        Semi-axes along x1 and x2. Unit: length.
    center : point
        Center. Unit: length.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Ellipse(center=(0.0, 0.0), semi_axes=(2.0, 1.0)).shape
    'ellipse'
    """

    shape: Literal["ellipse"] = "ellipse"
    semi_axes: tuple[Positive, Positive]
    center: Point = (0.0, 0.0)

    def contains(self, points: np.ndarray) -> np.ndarray:
        return (((points - np.array(self.center)) / np.array(self.semi_axes)) ** 2).sum(axis=1) < 1

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        center = np.array(self.center)
        reach = np.array(self.semi_axes)
        return center - reach, center + reach

    def boundary(self, cell: np.ndarray) -> np.ndarray:
        return _around(np.array(self.center), np.array(self.semi_axes), cell)

    def nearest(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        center = np.array(self.center)
        semi_axes = np.array(self.semi_axes)
        # Within a quadrant, the center of curvature of the last foot leads to the next one.
        offsets = np.abs(places - center)
        along = np.full(places.shape, math.sqrt(0.5))
        # Twelve steps reach rounding at semi-axes in a ratio of 10 (measured).
        for _ in range(12):
            evolute = (semi_axes**2 - semi_axes[::-1] ** 2) * along**3 / semi_axes
            arms = semi_axes * along - evolute
            ways = offsets - evolute
            ways *= (
                np.linalg.norm(arms, axis=1) / np.maximum(np.linalg.norm(ways, axis=1), 1e-300)
            )[:, None]
            along = np.clip((evolute + ways) / semi_axes, 0, 1)
            along /= np.linalg.norm(along, axis=1)[:, None]
        curvature = (
            semi_axes.prod() / np.linalg.norm(semi_axes[::-1] * along, axis=1, keepdims=True) ** 3
        )
        return center + np.copysign(semi_axes * along, places - center), curvature


class Circle(Outline):
    """Circle.

    Parameters
    ----------
    arrangement : {"lattice", "relaxed"}
        How the points of a body lie: in rows along the axes, or in an irregular cloud without rows,
        so that the direction of a crack does not depend on the axes. Holes leave it out.
    seed : int
        Number of the cloud of a relaxed body: other seeds give other clouds. Unit: none.
    shape : {"circle"}
        Name of the shape.
    radius : float
        Radius. Unit: length.
    center : point
        Center. Unit: length.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> hole = pds.shapes.Circle(center=(1.5, 0.5), radius=0.2)
    >>> hole.shape
    'circle'
    """

    shape: Literal["circle"] = "circle"
    radius: Positive
    center: Point = (0.0, 0.0)

    def contains(self, points: np.ndarray) -> np.ndarray:
        return ((points - np.array(self.center)) ** 2).sum(axis=1) < self.radius**2

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        center = np.array(self.center)
        return center - self.radius, center + self.radius

    def boundary(self, cell: np.ndarray) -> np.ndarray:
        return _around(np.array(self.center), np.full(2, self.radius), cell)

    def nearest(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return nearest_on_sphere(places, np.array(self.center), self.radius)


class Polygon(Sided):
    """Polygon.

    Parameters
    ----------
    arrangement : {"lattice", "relaxed"}
        How the points of a body lie: in rows along the axes, or in an irregular cloud without rows,
        so that the direction of a crack does not depend on the axes. Holes leave it out.
    seed : int
        Number of the cloud of a relaxed body: other seeds give other clouds. Unit: none.
    shape : {"polygon"}
        Name of the shape.
    vertices : list of points
        Corners, once around in either direction. Sides may touch but not cross. Unit: length.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Polygon(vertices=((0.0, 0.0), (2.0, 0.0), (0.0, 2.0))).shape
    'polygon'
    """

    shape: Literal["polygon"] = "polygon"
    vertices: Annotated[tuple[Point, ...], Field(min_length=3)]

    def model_post_init(self, _) -> None:
        import shapely  # here, because few bodies need it

        corners = self._corners
        outline = shapely.Polygon(corners - corners.mean(axis=0))
        extent = np.ptp(corners, axis=0).max()
        # Parts around which the outline runs backward, twice or more make the area of its corners
        # another one than that of the parts around which it runs once, or an odd number of times.
        around = outline.area
        once = shapely.make_valid(outline).area
        if abs(around - once) > 1e-9 * extent**2:
            raise ValueError(
                "the outline crosses itself, or runs around itself more than once; give the corners"
                " in order, once around, and cut-outs as holes"
            )
        if not around > 1e-9 * extent**2:
            raise ValueError("the polygon has no area")

    @property
    def _corners(self) -> np.ndarray:
        return np.array(self.vertices)

    def contains(self, points: np.ndarray) -> np.ndarray:
        corners = self._corners
        return encloses(points, corners, np.roll(corners, -1, axis=0))

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        corners = self._corners
        return corners.min(axis=0), corners.max(axis=0)


def nearest_on_sphere(
    places: np.ndarray, center: np.ndarray, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of a circle or sphere nearest to places, shape (k, d), and its
    curvatures there, shape (k, d - 1).
    """
    offsets = places - center
    distances = np.linalg.norm(offsets, axis=1, keepdims=True)
    ways = np.where(distances > 0, offsets / np.maximum(distances, 1e-300), np.eye(len(center))[0])
    return center + radius * ways, np.full((len(places), len(center) - 1), 1 / radius)


def _around(center: np.ndarray, semi_axes: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """Return nodes around an ellipse, shape (k, 2), symmetric about its axes; the polygon through
    the nodes has the area of the ellipse.

    With nodes on the curve the polygon's area would be too small, by a share of theta^2/6 for an
    angle of theta between nodes.  The work of a pressure is the pressure times the change of the
    area: with the right area the work is exact in every affine motion.  Nodes lie outside the curve
    by theta^2/12 of its radius, middles of facets inside it by theta^2/24, and the length is right
    to theta^2/24.
    """
    quarter = max(3, math.ceil(math.pi * semi_axes.max() / cell.min()))
    step = math.pi / (2 * quarter)
    angles = step * np.arange(4 * quarter)
    return center + math.sqrt(step / math.sin(step)) * semi_axes * np.column_stack(
        [np.cos(angles), np.sin(angles)]
    )


def with_shape(value: Any) -> Any:
    """Return the description of a shape with the key ``shape``, set to ``"rectangle"`` if it is
    not given.
    """
    return {"shape": "rectangle", **value} if isinstance(value, dict) else value


AnyOutline = Annotated[
    Rectangle | Circle | Ellipse | Polygon,
    Field(discriminator="shape"),
    BeforeValidator(with_shape),
]


class Mesh(StrictModel):
    """Body from a mesh file that meshio reads: every cell becomes a point at its centroid, with the
    volume of the cell.

    The spacing of the points is the side of a square or cube as large as the mean cell.

    Parameters
    ----------
    shape : {"mesh"}
        Name of the shape.
    file : str
        Path of the mesh file; in a scene file relative to the folder of that file.
    dimension : {2, 3}
        2 for triangles and quadrilaterals, of unit thickness; 3 for tetrahedra and hexahedra.
    parts : list of str, optional
        Groups of cells that make up the body: physical groups, element sets, or instances of the
        parts of a deck. By default all cells.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Mesh(file="sheet.msh").dimension
    2
    """

    shape: Literal["mesh"] = "mesh"
    file: Annotated[str, Field(min_length=1)]
    dimension: Literal[2, 3] = 2
    parts: Annotated[tuple[str, ...] | None, Field(min_length=1)] = None


ENDS = 1e-9
"""Part of a cut's length beside its ends in which a segment does not cross it: one that meets an
end exactly does not, whatever the unit of length and the rounding.
"""


class Cut(StrictModel):
    """Base of straight cuts in the plane and flat cuts of solids: the body has no bonds that
    cross them.
    """

    dimension: ClassVar[int] = 3

    @abstractmethod
    def plane(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the plane of the cut, in two dimensions the line.

        Returns
        -------
        place : ndarray, shape (d,)
            A place on the plane.
        normal : ndarray, shape (d,)
            Unit normal; in two dimensions it points to the left of the cut.
        extent : float
            Longest side or radius of the cut.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> place, normal, extent = pds.shapes.DiscCut(
        ...     center=(0.0, 0.0, 1.0), radius=0.4, normal=(0.0, 0.0, 2.0)
        ... ).plane()
        >>> normal.tolist(), extent
        ([0.0, 0.0, 1.0], 0.4)
        """

    @abstractmethod
    def moved(self, way: Callable[[np.ndarray], np.ndarray]) -> Self:
        """Return the cut with its ends, corners or center moved.

        Parameters
        ----------
        way : callable
            ``way(places)`` returns where places (k, d) are moved.

        Returns
        -------
        Cut

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.shapes.Precut(start=(0.0, 1.5), end=(3.0, 1.5)).moved(
        ...     lambda places: places + [0.0, 0.5]
        ... ).end
        (3.0, 2.0)
        """

    @abstractmethod
    def covers(self, places: np.ndarray) -> np.ndarray:
        """Return whether places on the plane of the cut belong to the cut; places on its edge do
        not.

        Parameters
        ----------
        places : array_like, shape (k, d)

        Returns
        -------
        ndarray of bool, shape (k,)

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> pds.shapes.DiscCut(center=(0.0, 0.0, 1.0), radius=0.4, normal=(0.0, 0.0, 1.0)).covers(
        ...     [[0.3, 0.0, 1.0]]
        ... ).tolist()
        [True]
        """

    @abstractmethod
    def distances(self, places: np.ndarray) -> np.ndarray:
        """Return the distances of places from the cut.

        Parameters
        ----------
        places : ndarray, shape (k, d)

        Returns
        -------
        ndarray, shape (k,)

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> pds.shapes.Precut(start=(0.0, 1.5), end=(3.0, 1.5)).distances(
        ...     np.array([[1.0, 2.0], [5.0, 1.5]])
        ... ).tolist()
        [0.5, 2.0]
        """

    @abstractmethod
    def edge(self, pitch: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return places along the edge of the cut; in two dimensions its two ends.

        Parameters
        ----------
        pitch : float
            Greatest distance of neighboring places. Unit: length.

        Returns
        -------
        places, outward : ndarray, shape (k, d)
            Places, and the unit vectors along which the cut would grow there.
        lengths : ndarray, shape (k,)
            Length of the edge for which each place stands; 1 in two dimensions.

        Examples
        --------
        >>> import pdsurrogate as pds
        >>> places, outward, _ = pds.shapes.Precut(start=(0.0, 1.5), end=(3.0, 1.5)).edge(0.1)
        >>> places.tolist(), outward.tolist()
        ([[0.0, 1.5], [3.0, 1.5]], [[-1.0, 0.0], [1.0, 0.0]])
        >>> places, outward, lengths = pds.shapes.DiscCut(
        ...     center=(0.0, 0.0, 1.0), radius=0.4, normal=(0.0, 0.0, 1.0)
        ... ).edge(0.1)
        >>> places.shape, round(float(lengths.sum()), 3)
        ((28, 3), 2.513)
        """

    def crosses(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return whether segments cross the cut, its edge not included.

        A point on the cut's plane, to rounding, counts as lying on the side of the normal, in two
        dimensions to the left: a cut through a layer of points separates these points from those on
        the other side, and not from those on the side of the normal.

        Parameters
        ----------
        starts, ends : ndarray, shape (k, d)
            Ends of the segments.

        Returns
        -------
        ndarray of bool, shape (k,)

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> cut = pds.shapes.Precut(start=(0.0, 0.5), end=(1.0, 0.5))
        >>> cut.crosses(
        ...     np.array([[0.5, 0.0], [2.0, 0.0]]), np.array([[0.5, 1.0], [2.0, 1.0]])
        ... ).tolist()
        [True, False]
        """
        crossing = np.zeros(len(starts), dtype=bool)
        apart, meets = self.met_by(starts, ends, ENDS * self.plane()[2])
        crossing[apart] = self.covers(meets)
        return crossing

    def met_by(
        self, starts: np.ndarray, ends: np.ndarray, rounding: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return where segments meet the plane of the cut.

        Parameters
        ----------
        starts, ends : ndarray, shape (k, d)
            Ends of the segments.
        rounding : float
            Distance behind the plane within which points count as lying on the side of its normal.
            Unit: length.

        Returns
        -------
        numbers : ndarray of int, shape (m,)
            Numbers of the segments with ends on different sides of the plane.
        places : ndarray, shape (m, d)
            Places where they meet it.

        Examples
        --------
        >>> import numpy as np
        >>> import pdsurrogate as pds
        >>> cut = pds.shapes.Precut(start=(0.0, 0.5), end=(1.0, 0.5))
        >>> numbers, places = cut.met_by(
        ...     np.array([[0.5, 0.0], [2.0, 0.7]]), np.array([[0.5, 1.0], [2.0, 1.0]]), 1e-9
        ... )
        >>> numbers.tolist(), places.tolist()
        ([0], [[0.5, 0.5]])
        """
        place, normal, _ = self.plane()
        heights = [(points - place) @ normal for points in (starts, ends)]
        sides = [height >= -rounding for height in heights]
        apart = np.flatnonzero(sides[0] != sides[1])
        first = heights[0][apart]
        second = heights[1][apart]
        return apart, starts[apart] + (first / (first - second))[:, None] * (
            ends[apart] - starts[apart]
        )


class Precut(Cut):
    """Straight cut in the plane: the body has no bonds that cross it.

    Parameters
    ----------
    start : point
        One end. Unit: length.
    end : point
        The other end. Unit: length.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.shapes.Precut(start=(0.0, 1.5), end=(3.0, 1.5)).end
    (3.0, 1.5)
    """

    dimension: ClassVar[int] = 2

    start: Point
    end: Point

    def model_post_init(self, _) -> None:
        if self.start == self.end:
            raise ValueError("a precut needs two different ends")

    def plane(self) -> tuple[np.ndarray, np.ndarray, float]:
        start = np.array(self.start)
        along = np.subtract(self.end, self.start)
        length = float(np.linalg.norm(along))
        return start, np.array([-along[1], along[0]]) / length, length

    def moved(self, way: Callable[[np.ndarray], np.ndarray]) -> Self:
        start, end = way(np.array([self.start, self.end])).tolist()
        return self.model_copy(update={"start": tuple(start), "end": tuple(end)})

    def covers(self, places: np.ndarray) -> np.ndarray:
        start = np.array(self.start)
        along = np.subtract(self.end, self.start)
        share = (places - start) @ along / (along @ along)
        return (share > ENDS) & (share < 1 - ENDS)

    def distances(self, places: np.ndarray) -> np.ndarray:
        return distances_to_segments(places, np.array(self.start), np.array(self.end))

    def edge(self, pitch: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        ends = np.array([self.start, self.end])
        outward = ends - ends[::-1]
        return ends, outward / np.linalg.norm(outward[1]), np.ones(2)
