"""Conjugate gradients for whoever solves with a matrix that is known by its products alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

Operator = Callable[[np.ndarray], np.ndarray]


def steps(
    left: np.ndarray,
    precondition: Operator,
    image_of: Operator,
    dot: Callable[[np.ndarray, np.ndarray], float],
    share_left: float,
    most: int,
) -> Iterator[tuple[float, np.ndarray, float]]:
    """Share and direction of every step, and the square of what was left before it, until no more than a share is left, or after `most`.

    The solution is the sum of the shares times the directions; what a caller sums from them it need not be.

    Parameters
    ----------
    left : ndarray
        The right hand side, changed in place to what is left of it.
    precondition : callable
        Nearly the inverse of the matrix: fixed, symmetric and positive definite.
    image_of : callable
        The matrix times a direction.
    dot : callable
        Inner product.
    share_left : float
        Of the right hand side, both measured in the inverse of what `precondition` stands for.
    most : int
    """
    direction = better = precondition(left)
    size = dot(left, better)
    least = share_left**2 * size
    for _ in range(most):
        if not size > least:
            return
        image = image_of(direction)
        share = size / dot(direction, image)
        yield share, direction, size
        left -= share * image
        better = precondition(left)
        size, before = dot(left, better), size
        direction = better + size / before * direction
