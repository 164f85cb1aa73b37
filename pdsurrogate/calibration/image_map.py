"""Map from the image of a camera to a scene, with the motion of the camera in each step, and its
fit to measured displacements.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from ..solvers.rigid import rigid_motions, rotation_of, turn_by

FAR = 4.0
"""Residual of a displacement, in standard deviations (or in robust ones of the residuals if these
are greater), from which on its weight falls, to zero at twice this. Of normal residuals in the
plane one in 3000 is greater.
"""

LOOSE = 0.1
"""Standard deviation of the start of a map: relative for the scale, in radians for rotations, in
sizes of the body for translations. It keeps a map where the measurements do not determine it.
"""

GIVEN = 0.02
"""Standard deviation of a given scale, relative, or origin, in sizes of the body: rulers and marks
in images are better.
"""


@dataclass(frozen=True, eq=False)
class ImageMap:
    """Map from the reference image of a test to its scene, ``x = translation + scale *
    rotation @ (p - center)``, and the motion of the camera in each step.

    A place of the body that is at p in the image of step k is at ``x = translation + shifts[k] +
    scale * turns[k] @ rotation @ (p - center)`` in the scene.

    Attributes
    ----------
    scale : float
        Length in the scene per length in the image.
    rotation : ndarray, shape (d, d)
    translation : ndarray, shape (d,)
        Place in the scene of the `center`.
    center : ndarray, shape (d,)
        Mean of the measured places in the image.
    steps : tuple of int
        Numbers of the outputs of the scene.
    turns : ndarray, shape (n_steps, d, d)
    shifts : ndarray, shape (n_steps, d)
    standard_errors : ndarray, shape (n,), optional
        Of the logarithm of the scale, rotations (rad; in space about the three axes) and the
        translation, and then of the rotations and shifts of each step.
    """

    scale: float
    rotation: np.ndarray
    translation: np.ndarray
    center: np.ndarray
    steps: tuple[int, ...]
    turns: np.ndarray
    shifts: np.ndarray
    standard_errors: np.ndarray | None = None

    @classmethod
    def at_rest(cls, scale, rotation, translation, center, steps) -> "ImageMap":
        """Return the map of a camera that does not move."""
        d = len(center)
        count = len(steps)
        turns = np.broadcast_to(np.eye(d), (count, d, d))
        return cls(
            float(scale), rotation, translation, center, tuple(steps), turns, np.zeros((count, d))
        )

    @cached_property
    def _counts(self) -> tuple[int, int]:
        """Number of axes and of rotations."""
        d = len(self.center)
        return d, d * (d - 1) // 2

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        d, g = self._counts
        return 1 + (g + d) * (1 + len(self.steps))

    def at(self, x: np.ndarray) -> "ImageMap":
        """Return the map that differs by unknowns: the logarithm of the scale, rotations and
        translation, and rotations and shift of each step.
        """
        d, g = self._counts
        moving = x[1 + g + d : self.unknowns].reshape(len(self.steps), g + d)
        return replace(
            self,
            scale=self.scale * float(np.exp(x[0])),
            rotation=turn_by(x[1 : 1 + g]) @ self.rotation,
            translation=self.translation + x[1 + g : 1 + g + d],
            turns=np.array([turn_by(each[:g]) for each in moving]) @ self.turns,
            shifts=self.shifts + moving[:, g:],
        )

    def deviations(
        self, size: float, scale: float, turn: float, origin: float, moving: float
    ) -> np.ndarray:
        """Return standard deviations of the unknowns about a start: of the scale, rotation and
        translation (in sizes of the body), and of the motions of the steps.
        """
        d, g = self._counts
        steps = [*[moving] * g, *[moving * size] * d] * len(self.steps)
        return np.array([scale, *[turn] * g, *[origin * size] * d, *steps])

    def to_scene(self, places: np.ndarray) -> np.ndarray:
        """Return the places of the scene (n, d) at places of the reference image (n, d)."""
        return self.translation + self.scale * (places - self.center) @ self.rotation.T

    def moved(self, index: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return the places of the scene at places (n, d) of the images of steps, by the indices
        of these, shape (n,).
        """
        turned = (self.turns @ self.rotation)[index]
        return (
            self.translation
            + self.shifts[index]
            + self.scale * np.einsum("nij,nj->ni", turned, places - self.center)
        )

    def inverse(self, index: np.ndarray) -> np.ndarray:
        """Return the derivatives (n, d, d) of places of the images by those of the scene."""
        return np.swapaxes(self.turns @ self.rotation, 1, 2)[index] / self.scale

    def seen(self, index: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """Return the places (n, d) in the images of steps at positions of the scene."""
        off = positions - self.translation - self.shifts[index]
        return self.center + np.einsum("nij,nj->ni", self.inverse(index), off)

    def derivatives(
        self, index: np.ndarray, places: np.ndarray, positions: np.ndarray, gradient: np.ndarray
    ) -> np.ndarray:
        """Return the derivatives of `seen` by the unknowns, shape (n, d, unknowns).

        `places` (n, d) are those of the scene in the reference state, `positions` (n, d) those in
        the steps, and `gradient` (n, d, d) the gradient of the positions.
        """
        d, g = self._counts
        inverse = self.inverse(index)
        off = places - self.translation
        away = positions - self.translation - self.shifts[index]
        found = np.zeros((len(index), d, self.unknowns))
        follow = inverse @ gradient
        found[..., 0] = np.einsum("nij,nj->ni", follow, off) - np.einsum(
            "nij,nj->ni", inverse, away
        )
        unturned = np.einsum("nji,nj->ni", self.turns[index], away)
        found[..., 1 : 1 + g] = (
            follow @ rigid_motions(off) - self.rotation.T / self.scale @ rigid_motions(unturned)
        )[..., d:]
        found[..., 1 + g : 1 + g + d] = follow - inverse
        moving = -inverse @ np.roll(rigid_motions(away), g, axis=2)  # the rotations first
        own = 1 + g + d + index[:, None] * (g + d) + np.arange(g + d)
        np.put_along_axis(found, own[:, None], moving, axis=2)
        return found

    def described(self) -> dict:
        """Return the map as plain values, with standard errors: scale, angle in degrees (in the
        plane), where the origin of the image lies, and the greatest motion of the camera.
        """
        d, g = self._counts
        found = {"scale": self.scale}
        if d == 2:
            found["degrees"] = float(np.degrees(rotation_of(self.rotation)))
        else:
            found["rotation"] = self.rotation.tolist()
        found["origin_of_image"] = self.to_scene(np.zeros((1, d)))[0].tolist()
        angles = [np.linalg.norm(rotation_of(turn)) for turn in self.turns]
        found["camera_moves"] = float(np.linalg.norm(self.shifts, axis=1).max(initial=0.0))
        found["camera_turns"] = float(np.degrees(max(angles)))
        if self.standard_errors is not None:
            scale, *rest = self.standard_errors[: 1 + g + d].tolist()
            found["standard_errors"] = {
                "scale": scale * self.scale,
                "degrees": float(np.degrees(rest[0])) if d == 2 else np.degrees(rest[:g]).tolist(),
                "translation": rest[g:],
            }
        return found


class Sight(NamedTuple):
    """Measured displacements of places of an image, one row for each place and step.

    Attributes
    ----------
    index : ndarray of int, shape (n,)
        Index of the step.
    places, displacements : ndarray, shape (n, d)
        In the image; NaN where a component was not measured.
    root : ndarray, shape (n, d)
        Inverse standard deviations; 0 where a component was not measured.
    """

    index: np.ndarray
    places: np.ndarray
    displacements: np.ndarray
    root: np.ndarray

    def of(self, kept: np.ndarray) -> "Sight":
        """Return some of the rows."""
        return Sight(*(each[kept] for each in self))


class Fit(NamedTuple):
    """Map fitted to measured displacements.

    Attributes
    ----------
    x : ndarray, shape (unknowns,)
        Unknowns of the map, and changes of the parameters of the law.
    map : ImageMap
    residuals : ndarray, shape (n, d)
        Measured minus simulated displacements in the image, in standard deviations.
    weights : ndarray, shape (n,)
        Those of a robust fit, 1 in another one.
    jacobian : ndarray, shape (n * d, unknowns)
        Derivatives of the simulated displacements in standard deviations, by the unknowns.
    """

    x: np.ndarray
    map: ImageMap
    residuals: np.ndarray
    weights: np.ndarray
    jacobian: np.ndarray

    @property
    def rms(self) -> float:
        """Root of the mean square of the weighted residuals."""
        measured = self.weights[:, None] * (self.residuals != 0)
        return float(np.sqrt((measured * self.residuals**2).sum() / max(measured.sum(), 1e-300)))


def fit_map(
    start: ImageMap,
    sight: Sight,
    at: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]],
    deviations: np.ndarray,
    x: np.ndarray | None = None,
    robust: bool = True,
    most: int = 15,  # from a start within a tenth three to six steps do
) -> Fit:
    """Fit the unknowns of a map, whose values are 0 +- `deviations` at the start, to measured
    displacements.

    ``at(index, places)`` returns displacements (n, d) and gradients of the positions (n, d, d) at
    places of the scene, and derivatives of the displacements by changes of the law (n, d, k), which
    are further unknowns, the last `k` of `deviations`.
    """
    x = np.zeros(len(deviations)) if x is None else x
    count = max(int((sight.root > 0).any(axis=1).sum()), 1)
    for step in range(most + 1):
        found = start.at(x)
        places = found.to_scene(sight.places)
        u, gradient, responses = at(sight.index, places)
        positions = places + u + responses @ x[start.unknowns :]
        derivatives = np.concatenate(
            [
                found.derivatives(sight.index, places, positions, gradient),
                found.inverse(sight.index) @ responses,
            ],
            axis=2,
        )
        off = sight.displacements + sight.places - found.seen(sight.index, positions)
        residuals = sight.root * np.where(sight.root > 0, off, 0.0)
        weights = weights_of(residuals) if robust else np.ones(len(residuals))
        jacobian = (sight.root[..., None] * derivatives).reshape(-1, len(x))
        if step == most:
            break
        root = np.repeat(np.sqrt(weights), residuals.shape[1])
        scaled = root[:, None] * jacobian * deviations
        change = np.linalg.solve(
            scaled.T @ scaled + np.eye(len(x)),
            scaled.T @ (root * residuals.ravel()) - x / deviations,
        )
        change /= max(1.0, np.abs(change).max() / 3)  # no farther than three deviations at once
        # rms change of the displacements in standard deviations
        if ((scaled @ change) ** 2).sum() < 0.01**2 * count:
            break
        x = x + deviations * change
    return Fit(x, found, residuals, weights, jacobian)


def weights_of(residuals: np.ndarray) -> np.ndarray:
    """Return weights (n,) of residuals in standard deviations (n, d): 1 for those within `FAR`,
    falling to 0 at twice this.
    """
    off = np.linalg.norm(residuals, axis=1)
    some = off > 0
    if not some.any():
        return np.ones(len(off))
    size = np.median(off[some]) / np.sqrt(chi2.ppf(0.5, residuals.shape[1]))
    return np.clip(2 - off / (FAR * max(1.0, size)), 0.0, 1.0)
