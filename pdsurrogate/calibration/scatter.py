"""Rows of a table of measurements on one scene, and the scatter of their values: standard
deviations that are not given.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from .image_map import Sight

FORCE_SCATTER = 0.005
"""Standard deviation of outputs such as forces without a given one, relative to the greatest in
the table: that of common load cells.
"""

LEAST_SCATTER = 1e-6
"""Least standard deviation of displacements without a given one, relative to the greatest
displacement: files have about six digits.
"""

NEIGHBORS = 13
"""Number of places, with the place itself, to which a quadratic is fitted in order to estimate the
scatter of displacements: about twice its six coefficients in the plane. In space 20 neighbors serve
its ten coefficients.
"""


@dataclass(frozen=True)
class Rows:
    """Rows of a table of measurements on one scene.

    Attributes
    ----------
    step : ndarray of int, shape (n,)
        Number of the output of the scene, from 1.
    quantity : ndarray of int, shape (n,)
        1, 2 or 3 for a component of the displacement; 0, -1 and so on for the first, the second
        output and so on.
    places : ndarray, shape (n, d)
        Undeformed places of displacements; without meaning for outputs.
    """

    step: np.ndarray
    quantity: np.ndarray
    places: np.ndarray

    @property
    def is_field(self) -> np.ndarray:
        """Mask, shape (n,), of the rows that are displacements."""
        return self.quantity > 0

    def sight(
        self, steps: Sequence[int], y: np.ndarray, root: np.ndarray
    ) -> tuple[Sight, tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Return measured displacements by place and step, from values and roots of weights of the
        rows; the row of it and the axis of each row that is a displacement; and the numbers of its
        places among all, in their order.
        """
        field = self.is_field
        index = np.searchsorted(steps, self.step[field])
        places, at = np.unique(self.places[field], axis=0, return_inverse=True)
        pairs, point = np.unique(np.column_stack([index, at.ravel()]), axis=0, return_inverse=True)
        entry = point.ravel(), self.quantity[field] - 1
        displacements = np.full((len(pairs), places.shape[1]), np.nan)
        weights = np.zeros(displacements.shape)
        displacements[entry] = y[field]
        weights[entry] = root[field]
        return Sight(pairs[:, 0], places[pairs[:, 1]], displacements, weights), entry, pairs[:, 1]


def local_fit(places: np.ndarray, targets: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of the places (n, d) nearest to targets (m, d), and their weights in a
    quadratic fit there, each (m, count).
    """
    near = np.asarray(cKDTree(places).query(targets, count)[1])
    off = places[near] - targets[:, None]
    d = places.shape[1]
    off /= np.abs(off).max(axis=(1, 2), keepdims=True)
    quadratic = [off[..., i] * off[..., j] for i in range(d) for j in range(i, d)]
    return (
        near,
        np.linalg.pinv(
            np.concatenate([np.ones((*near.shape, 1)), off, np.stack(quadratic, axis=-1)], axis=2)
        )[:, 0],
    )


def estimated_deviations(rows: Rows, values: np.ndarray) -> np.ndarray:
    """Return estimated standard deviations of measurements on one scene, shape (n,)."""
    found = np.empty(len(values))
    for quantity in np.unique(rows.quantity):
        same = rows.quantity == quantity
        size = np.abs(values[same]).max() or 1.0
        found[same] = (
            FORCE_SCATTER * size
            if quantity < 1
            else max(_scatter(rows, values, same), LEAST_SCATTER * size)
        )
    return found


def _scatter(rows: Rows, values: np.ndarray, same: np.ndarray) -> float:
    """Return the standard deviation of one component of measured displacements, from its
    differences from local quadratic fits.

    The median over all places is that of a normal distribution, and does not notice the few places
    where the field bends sharply. With too few places in each field it is 0.
    """
    found = []
    for step in np.unique(rows.step[same]):
        here = same & (rows.step == step)
        places, once = np.unique(rows.places[here], axis=0, return_index=True)
        u = values[here][once]
        d = places.shape[1]
        count = NEIGHBORS if d == 2 else 20
        if len(u) < 2 * count:
            continue
        # Row of the hat matrix of each place in its own fit: the variance of the residual is 1 - h.
        near, hat = local_fit(places, places, count)
        left = 1 - hat[:, 0]
        residual = u - (hat * u[near]).sum(axis=1)
        found.append((residual / np.sqrt(np.maximum(left, 1e-6)))[left > 1e-6])
    return float(np.median(np.abs(np.concatenate(found))) / 0.6745) if found else 0.0
