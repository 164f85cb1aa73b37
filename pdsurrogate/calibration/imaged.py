"""Scene whose displacements were measured in the images of a camera: the map from image to scene
is fitted anew to each law.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ..body import Body
from ..materials import Law
from ..scenes import Scene
from .image_map import Fit, ImageMap, fit_map, weights_of
from .measured import MeasuredScene
from .scatter import Rows

WIDTH = 0.25
"""Half the distance, in cells, of places whose displacements give the gradient, and the motion of a
place from which on the gradient is taken anew.
"""


class ImagedScene(MeasuredScene):
    """Scene with a table of what was measured on it, whose places and displacements are those in
    the images of a camera.

    The `map` is the best for each law: it is no unknown of the search, but the derivatives by the
    law are those at the best map (variable projection).
    """

    def __init__(
        self, scene: Scene, rows: Rows, outputs: Sequence[str] | None = None, number: int = 0
    ) -> None:
        super().__init__(scene, rows, outputs, number)
        self.image_places = self._places

    def take(self, start: ImageMap, deviations: np.ndarray, beside: np.ndarray) -> None:
        """Set the start of the map, the standard deviations of its unknowns, and which places lie
        outside the body, (k,).
        """
        self._start = start
        self._deviations = deviations
        self._x = np.zeros(len(deviations))
        self.map = start
        self._beside = beside
        self._places = start.to_scene(self.image_places)

    def follow(self, maps: Mapping[int, ImageMap]) -> None:
        start = maps.get(self.number)
        fields = set(self.rows.step[self.rows.is_field].tolist())
        if start is None or not fields <= set(start.steps):
            raise ValueError("X: displacements of a step whose images were not fitted are unknown")
        self.take(start, np.zeros(start.unknowns), np.zeros(len(self.image_places), dtype=bool))

    def fitted_map(self, law: np.ndarray, factor: float) -> ImageMap:
        """Return the map with standard errors, from the covariance of the variables of the search
        and the factor of the squared deviations.
        """
        variances = factor * self._own + np.einsum(
            "ij,jk,ik->i", self._response, law, self._response
        )
        return replace(self.map, standard_errors=np.sqrt(variances))

    def at(self, places: np.ndarray) -> np.ndarray:
        """Return a mask of the rows that are displacements at the places in a mask."""
        found = self.rows.is_field.copy()
        found[found] = places[self._entry_of[found] // self.scene.dimension]
        return found

    def weigh(self, y: np.ndarray, root: np.ndarray) -> None:
        self._followed = None
        self._root = root
        self._sight, self._entry, self._place = self.rows.sight(self.steps, y, root)

    def robust(self, off: np.ndarray) -> np.ndarray:
        """Return weights of all rows, (n,), from their residuals in standard deviations: those of
        both components of a displacement together, 1 for outputs.
        """
        found = np.ones(len(off))
        residuals = np.zeros(self._sight.root.shape)
        residuals[self._entry] = off[self.rows.is_field]
        found[self.rows.is_field] = weights_of(residuals)[self._entry[0]]
        return found

    def begin(self, law: Law) -> np.ndarray:
        super().begin(law)
        self._fit(robust=True)
        self._followed = None
        return super().differentiate(law, [])[0]

    def differentiate(self, law: Law, names) -> tuple[np.ndarray, np.ndarray]:
        if self._followed is None or self._followed[0] != law:
            values = super().differentiate(law, [])[0]
            fit = self._fit()
            for step in self.steps:
                here = self.rows.is_field & (self.rows.step == step)
                fields = self._base.moved_places(self._guesses[step], self._parameters[step])
                values[here] = self._seen(step, fields).flat[self._entry_of[here]]
            self._followed = law, fit, values
        _, fit, values = self._followed
        if not len(names):
            return values, np.empty((len(values), 0))
        values, derivatives = super().differentiate(law, names)
        return values, self._projected(fit, derivatives)

    def weak_form(self, law_of, start, y) -> tuple[np.ndarray, np.ndarray]:
        fit = self._fit()
        jacobian, right = super().weak_form(law_of, start, y)
        projected = self._projected(fit, np.column_stack([jacobian, right]))
        return projected[:, :-1], projected[:, -1]

    def _seen(self, step: int, fields: np.ndarray) -> np.ndarray:
        index = np.full(len(fields), self.map.steps.index(step))
        return self.map.seen(index, self._places + fields) - self.image_places

    def _seen_changes(self, step: int, fields: np.ndarray) -> np.ndarray:
        return self.map.inverse(np.full(len(fields), self.map.steps.index(step))) @ fields

    def _in_scene(self, step: int, off: np.ndarray) -> np.ndarray:
        turned = self.map.turns[self.map.steps.index(step)] @ self.map.rotation
        return self.map.scale * off @ turned.T

    def _projected(self, fit: Fit, derivatives: np.ndarray) -> np.ndarray:
        """Return derivatives of the rows (n, k) where the map follows, and keep how it does."""
        field = self.rows.is_field & (self._root > 0)
        entry = tuple(each[field[self.rows.is_field]] for each in self._entry)
        root = self._root[field, None]
        by_map = fit.jacobian.reshape(*fit.residuals.shape, -1)[entry]
        by_map = by_map * self._deviations
        squares, axes = np.linalg.eigh(by_map.T @ by_map)
        singular = np.sqrt(np.maximum(squares, 1e-20))
        left = by_map @ axes / singular
        scaled = self._deviations[:, None] * axes
        inside = left.T @ (root * derivatives[field])
        # The start of the map is a measurement, too: its directions are left out in part only.
        self._own = self._deviations**2 - (scaled**2 @ (singular**2 / (1 + singular**2)))
        self._response = -(scaled * (singular / (1 + singular**2))) @ inside
        self.used = float((singular**2 / (1 + singular**2)).sum())
        found = derivatives.copy()
        left_out = 1 - 1 / np.sqrt(1 + singular**2)
        found[field] -= (left * left_out) @ inside / root
        return found

    def chain(self, matrix: np.ndarray) -> None:
        self._response = self._response @ matrix

    def _fit(self, robust: bool = False) -> Fit:
        """Fit the map to the displacements of the points in the present equilibria."""
        body = self._base.system.body
        cell = np.broadcast_to(body.cell, (body.dimension,))
        last: list = []

        def moved_at(places: np.ndarray) -> np.ndarray:
            self._places = places
            self._base = self._at_places(self._base)
            return np.array(
                [
                    self._base.moved_places(self._guesses[step], self._parameters[step])
                    for step in self.steps
                ]
            )

        def at(index: np.ndarray, mapped: np.ndarray) -> tuple[np.ndarray, ...]:
            places = np.zeros_like(self.image_places)
            places[self._place] = mapped
            if not last or np.abs(places - last[0]).max() > WIDTH * cell.max():
                gradient = np.stack(
                    [
                        (moved_at(places + way) - moved_at(places - way)) / (2 * np.abs(way).max())
                        for way in WIDTH * np.diag(cell)
                    ],
                    axis=3,
                )
                last[:] = [places, gradient + np.eye(body.dimension)]
            u = moved_at(places)
            rows = index, self._place
            return u[rows], last[1][rows], np.zeros((*mapped.shape, 0))

        fit = fit_map(self._start, self._sight, at, self._deviations, self._x, robust)
        self._x = fit.x
        self.map = fit.map
        return fit

    def _places_in(self, body: Body) -> np.ndarray:
        """Return the places, those outside the body at its nearest points."""
        distance, near = cKDTree(body.points).query(self._places)
        # A trial of the map may move places out, where there is no motion: those farther than a
        # cell from the nearest point are moved towards the body.
        most = np.where(self._beside, 0.0, np.max(body.cell))
        share = np.minimum(1.0, most / np.maximum(distance, 1e-300))
        return body.points[near] + share[:, None] * (self._places - body.points[near])
