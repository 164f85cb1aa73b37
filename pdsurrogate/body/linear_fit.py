"""Motion and its gradient at places between the points of a body, or half a cell beyond them."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from .body import Body

LEAST_REACH = 2.5
"""Cells within which points are taken where the horizon is shorter: at a straight edge two rows of them."""

THINNEST = 0.1
"""Cells, root mean square, by which points must deviate from every straight line; those of one row, or of two that coincide, tell no slope
across it."""

OUTSIDE = 1.25
"""Cells from the nearest point at which a place lies outside: a corner of a cell lies 0.71 away, and what cells take over from a cut
neighbour adds half a cell."""


def interpolation(body: Body, places: np.ndarray) -> tuple[sparse.csr_array, tuple[sparse.csr_array, ...]]:
    """Motion and deformation gradient at places in a body, from those of its points around them.

    A linear field is fitted to the points within a horizon of the place that no hole or cut separates from it, nearer ones counting more
    (`_weights`).  Positions and deformation gradients of every affine motion are exact; of others positions to second order in the spacing.

    Parameters
    ----------
    body : Body
    places : ndarray, shape (k, d)
        In the reference state.

    Returns
    -------
    values : csr_array, shape (k, n)
        ``values @ positions`` are the positions of the places; rows are 1 in sum.
    gradients : tuple of d csr_array, shape (k, n)
        ``gradients[b] @ positions`` are the derivatives of positions by X_b, columns of F; rows are 0 in sum.

    Raises
    ------
    ValueError
        If a place lies outside the body, or too few points are beside it.
    """
    distance, nearest = cKDTree(body.points).query(places)
    far = distance > OUTSIDE * body.cell.max()
    if far.any():
        place = int(far.argmax())
        raise ValueError(
            f"{_text(places[place])} lies outside the body; its nearest point is {nearest[place]} at {_text(body.points[nearest[place]])}, "
            f"{distance[place]:.3g} away"
        )
    values, gradients = fitted(body, places)
    lost = np.diff(values.indptr) == 0
    if lost.any():
        raise ValueError(
            f"{_text(places[lost.argmax()])}: the points of the body beside it, as far as no hole or cut lies between, are fewer than three "
            "or in one row, and tell no deformation; a smaller spacing has more of them"
        )
    return values, gradients


def fitted(body: Body, places: np.ndarray) -> tuple[sparse.csr_array, tuple[sparse.csr_array, ...]]:
    """As `interpolation`, with empty rows for places where there are too few points, and no check of where places lie."""
    reach = max(body.horizon, LEAST_REACH * body.cell.max()) * (1 + 1e-9)
    near = cKDTree(places).sparse_distance_matrix(cKDTree(body.points), reach, output_type="ndarray")
    place, point = near["i"], near["j"]
    order = np.lexsort((point, place))
    place, point = place[order], point[order]
    if body.separates is not None and len(place):
        bound = ~body.separates(places[place], body.points[point])
        place, point = place[bound], point[bound]
    offsets = (body.points[point] - places[place]) / reach
    weights = _weights(np.linalg.norm(offsets, axis=1)) * body.volumes[point]

    count, dimension = places.shape

    def total(terms: np.ndarray) -> np.ndarray:
        return np.bincount(place, terms, count)

    # About their weighted mean c the points have the covariance C: the fit's slope has the rows w (x - c) C^-1, its value at the place
    # those times the place's distance from the mean, and w.
    weights = weights / total(weights)[place]
    mean = np.stack([total(weights * offsets[:, axis]) for axis in range(dimension)], axis=1)
    centred = offsets - mean[place]
    covariance = np.empty((count, dimension, dimension))
    for row in range(dimension):
        for column in range(dimension):
            covariance[:, row, column] = total(weights * centred[:, row] * centred[:, column])
    followed = np.linalg.eigvalsh(covariance)[:, 0] > (THINNEST * body.cell.max() / reach) ** 2
    covariance[~followed] = np.eye(dimension)
    slopes = weights[:, None] * np.einsum("pab,pb->pa", np.linalg.inv(covariance)[place], centred)
    entries = weights - (slopes * mean[place]).sum(axis=1)  # a place is at zero of the offsets

    kept = followed[place]
    place, point = place[kept], point[kept]
    pointers = np.concatenate([[0], np.cumsum(np.bincount(place, minlength=count))])

    def rows(terms: np.ndarray) -> sparse.csr_array:
        return sparse.csr_array((terms[kept], point, pointers), shape=(count, len(body)))

    return rows(entries), tuple(rows(slopes[:, axis] / reach) for axis in range(dimension))


def _weights(distances: np.ndarray) -> np.ndarray:
    """Weights of points by their distance over the reach."""
    return (1 - distances**2) ** 2


def _text(place: np.ndarray) -> str:
    return f"({', '.join(f'{coordinate:.4g}' for coordinate in place)})"
