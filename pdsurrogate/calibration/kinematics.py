"""Simulated motion at any place, fast, and the start of the map from an image to the scene."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations, product

import numpy as np
from scipy.spatial import cKDTree

from ..results import Result
from .image_map import GIVEN, LOOSE, Fit, ImageMap, Sight, fit_map

SIZES = (1.0, 0.9, 1.1, 0.8, 0.65, 0.5)
"""Scales that are tried, in those at which the cloud of measured places just fits into the body:
it may be smaller, or have some points beside the body.
"""

FIRST = 1.1
"""Among starts whose residuals are within this factor of the least, the one with the least motion
of the camera is taken, and then that with the least rotation and the scale by the outline.
"""


@dataclass(frozen=True)
class Kinematics:
    """Simulated motion of a body in steps, at any place.

    Attributes
    ----------
    points : ndarray, shape (n, d)
    cell : ndarray, shape (d,)
    displacements : ndarray, shape (n_steps, n, d)
    gradients : ndarray, shape (n_steps, n, d, d)
        Deformation gradients.
    responses : ndarray, shape (n_steps, n, d, k)
        Derivatives of the displacements by changes of the law.
    """

    points: np.ndarray
    cell: np.ndarray
    displacements: np.ndarray
    gradients: np.ndarray
    responses: np.ndarray

    @classmethod
    def of(
        cls, result: Result, numbers: list[int], responses: list[np.ndarray] | None = None
    ) -> "Kinematics":
        """Return the motion in states of a result, by their numbers."""
        body = result.body
        d = body.dimension
        displacements = np.array([result.displacement(number) for number in numbers])
        return cls(
            body.points,
            np.broadcast_to(body.cell, (d,)),
            displacements,
            np.array([result.field("deformation_gradient", each)[:, :d, :d] for each in numbers]),
            np.zeros((*displacements.shape, 0)) if responses is None else np.array(responses),
        )

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    @cached_property
    def _scaled(self) -> cKDTree:
        return cKDTree(self.points / self.cell)

    @property
    def box(self) -> np.ndarray:
        """Lower and upper corner (2, d)."""
        half = self.cell / 2
        return np.array([self.points.min(axis=0) - half, self.points.max(axis=0) + half])

    @property
    def size(self) -> float:
        return float(np.ptp(self.box, axis=0).max())

    def outside(self, places: np.ndarray) -> np.ndarray:
        """Return which places (n, d) lie outside the cells of the points, with a tenth of one to
        spare.
        """
        near = self._scaled.query(places / self.cell, p=np.inf)[0]
        return near > 0.6

    def at(self, index: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return displacements (n, d), gradients (n, d, d) and responses (n, d, k) at places in
        the steps of given indices.

        The motion is expanded about the nearest points with the mean of the gradients here and
        there, so that quadratic motions are exact where gradients are.
        """
        distance, near = self._tree.query(places, 4)
        weights = 1 / (distance + 1e-6 * self.cell.max()) ** 2
        weights /= weights.sum(axis=1, keepdims=True)
        step = index[:, None]
        there = self.gradients[step, near]
        here = np.einsum("nk,nkij->nij", weights, there)
        mean = (there + here[:, None]) / 2 - np.eye(places.shape[1])
        off = places[:, None] - self.points[near]
        moved = self.displacements[step, near] + np.einsum("nkij,nkj->nki", mean, off)
        return (
            np.einsum("nk,nki->ni", weights, moved),
            here,
            np.einsum("nk,nkij->nij", weights, self.responses[step, near]),
        )


def start_of_map(
    body: Kinematics,
    sight: Sight,
    steps: list[int],
    pixels_per: float | None = None,
    origin: np.ndarray | None = None,
    sizes: Sequence[float] = SIZES,
) -> tuple[Fit, np.ndarray]:
    """Return a map of measured displacements fitted to a simulated motion, and the deviations of
    its unknowns, with rotations by right angles, scales and places by the outline of the body.

    ``pixels_per``, the length in the image of a length of the scene, and the place of the origin of
    the scene in the image, replace those by the outline.
    """
    body = replace(body, responses=body.responses[..., :0])
    box = np.ptp(body.box, axis=0)
    d = len(box)
    center = np.nanmean(sight.places, axis=0)
    cloud = np.array([sight.places.min(axis=0), sight.places.max(axis=0)])
    last = int(sight.index.max())
    few = sight.of(_some(sight, np.flatnonzero(sight.index == last)))
    tried = []
    for rotation in _right_angles(d):
        extent = np.abs(rotation) @ np.ptp(cloud, axis=0)
        fitting = float((box / np.maximum(extent, 1e-9 * extent.max())).min())
        for scale in [1 / pixels_per] if pixels_per else [fitting * each for each in sizes]:
            if origin is not None:
                translation = scale * rotation @ (center - origin)
            else:
                middle = scale * rotation @ (center - cloud.mean(axis=0))
                translation = body.box.mean(axis=0) + middle
            start = ImageMap.at_rest(scale, rotation, translation, center, steps)
            deviations = _about(start, body, pixels_per, origin)
            fit = fit_map(start, few, body.at, deviations, most=6)
            beside = body.outside(fit.map.to_scene(few.places)).mean()
            off = np.linalg.norm(fit.residuals, axis=1).mean()
            moving = np.linalg.norm(fit.map.shifts, axis=1).max() / body.size
            tried.append((off * (1 + 5 * beside), round(float(moving), 2), len(tried), fit.map))
    least = min(tried)[0]
    *_, start = min((one for one in tried if one[0] <= FIRST * least), key=lambda one: one[1:3])
    deviations = _about(start, body, pixels_per, origin)
    chosen = [_some(sight, np.flatnonzero(sight.index == one)) for one in np.unique(sight.index)]
    return fit_map(start, sight.of(np.concatenate(chosen)), body.at, deviations), deviations


def _about(start: ImageMap, body: Kinematics, pixels_per, origin) -> np.ndarray:
    return start.deviations(
        body.size,
        LOOSE if pixels_per is None else GIVEN,
        LOOSE,
        LOOSE if origin is None else GIVEN,
        LOOSE,
    )


def _some(sight: Sight, rows: np.ndarray) -> np.ndarray:
    """Return at most 150 of rows, spread evenly over their order in space."""
    order = rows[np.lexsort(sight.places[rows].T)]
    return order[np.unique(np.linspace(0, len(order) - 1, 150).round().astype(int))]


def _right_angles(d: int) -> list[np.ndarray]:
    """Return the rotations by right angles, first those that change the fewest axes."""
    found = []
    for order in permutations(range(d)):
        for signs in product((1.0, -1.0), repeat=d):
            matrix = np.diag(signs)[:, list(order)]
            if np.linalg.det(matrix) > 0:
                found.append(matrix)
    return sorted(found, key=lambda one: -np.trace(one))
