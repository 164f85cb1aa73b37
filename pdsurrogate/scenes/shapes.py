"""Shapes in the plane, of which bodies are made and holes are cut, and straight cuts."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from .strict_model import Point, Positive, StrictModel


class Outline(StrictModel):
    """A closed shape."""

    @abstractmethod
    def contains(self, points: np.ndarray) -> np.ndarray:
        """Which of the points (n, 2) lie inside."""

    @abstractmethod
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower left and upper right corner of the bounding box."""


class Rectangle(Outline):
    """A rectangle with its lower left corner at `lower`."""

    shape: Literal["rectangle"] = "rectangle"
    size: tuple[Positive, Positive]
    lower: Point = (0.0, 0.0)

    def contains(self, points: np.ndarray) -> np.ndarray:
        low, high = self.bounds()
        return ((points > low) & (points < high)).all(axis=1)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        lower = np.array(self.lower)
        return lower, lower + np.array(self.size)


class Ellipse(Outline):
    """An ellipse with semi-axes along x1 and x2."""

    shape: Literal["ellipse"] = "ellipse"
    semi_axes: tuple[Positive, Positive]
    centre: Point = (0.0, 0.0)

    def contains(self, points: np.ndarray) -> np.ndarray:
        return (((points - np.array(self.centre)) / np.array(self.semi_axes)) ** 2).sum(axis=1) < 1

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        centre, reach = np.array(self.centre), np.array(self.semi_axes)
        return centre - reach, centre + reach


class Circle(Outline):
    """A circle."""

    shape: Literal["circle"] = "circle"
    radius: Positive
    centre: Point = (0.0, 0.0)

    def contains(self, points: np.ndarray) -> np.ndarray:
        return ((points - np.array(self.centre)) ** 2).sum(axis=1) < self.radius**2

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        centre = np.array(self.centre)
        return centre - self.radius, centre + self.radius


class Polygon(Outline):
    """A polygon by its vertices, in either sense of rotation."""

    shape: Literal["polygon"] = "polygon"
    vertices: Annotated[tuple[Point, ...], Field(min_length=3)]

    @model_validator(mode="after")
    def _has_an_area(self) -> Polygon:
        x1, x2 = np.array(self.vertices).T
        area = 0.5 * abs(np.dot(x1, np.roll(x2, -1)) - np.dot(x2, np.roll(x1, -1)))
        extent = max(np.ptp(x1), np.ptp(x2))
        if not area > 1e-9 * extent**2:
            raise ValueError("the polygon has no area")
        return self

    def contains(self, points: np.ndarray) -> np.ndarray:
        inside = np.zeros(len(points), dtype=bool)
        corners = np.array(self.vertices)
        # A point is inside if a ray from it towards larger x1 crosses the outline an odd number of times.
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            spans = (start[1] > points[:, 1]) != (end[1] > points[:, 1])
            with np.errstate(divide="ignore", invalid="ignore"):
                crossing = start[0] + (points[:, 1] - start[1]) * (end[0] - start[0]) / (end[1] - start[1])
            inside ^= spans & (points[:, 0] < crossing)
        return inside

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        corners = np.array(self.vertices)
        return corners.min(axis=0), corners.max(axis=0)


class Mesh(StrictModel):
    """A body from a mesh file that meshio reads: its triangles and quadrilaterals become points at their centroids, with their areas."""

    shape: Literal["mesh"] = "mesh"
    file: Annotated[str, Field(min_length=1)]


class Precut(StrictModel):
    """A straight cut: the bonds that cross it are no part of the body."""

    start: Point
    end: Point

    @model_validator(mode="after")
    def _has_a_length(self) -> Precut:
        if self.start == self.end:
            raise ValueError("a precut needs two different ends")
        return self

    def crosses(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Which of the segments from `starts` to `ends`, each of shape (k, 2), cross the cut.

        A point on the cut's line counts as lying on its left, to rounding, so that a cut through a row of points separates
        them from one side.
        """
        a, b = np.array(self.start), np.array(self.end)
        along = b - a
        tolerance = 1e-9 * np.linalg.norm(along)

        def left_of(points, origin, direction):
            offset = points - origin
            return direction[..., 0] * offset[..., 1] - direction[..., 1] * offset[..., 0]

        sides = [left_of(points, a, along) >= -tolerance * np.linalg.norm(along) for points in (starts, ends)]
        apart = np.flatnonzero(sides[0] != sides[1])
        crossing = np.zeros(len(starts), dtype=bool)
        origin, direction = starts[apart], ends[apart] - starts[apart]
        crossing[apart] = (left_of(a, origin, direction) >= 0) != (left_of(b, origin, direction) >= 0)
        return crossing
