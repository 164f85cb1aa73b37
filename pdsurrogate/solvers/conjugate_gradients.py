"""Conjugate gradients for matrices that are known by their products alone."""

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
    """Yield length and direction of every step, and the square of the rest before it, until the rest is small enough, or after `most`.

    The solution is the sum of the lengths times the directions.

    Parameters
    ----------
    left : ndarray
        Right hand side, changed in place to the rest that the solution leaves.
    precondition : callable
        Approximate inverse of the matrix: fixed, symmetric and positive definite.
    image_of : callable
        Product of the matrix and a direction.
    dot : callable
        Inner product.
    share_left : float
        Size of the rest at the end over that of the right hand side, both in the norm of `precondition`.
    most : int
    """
    direction = better = precondition(left)
    size = dot(left, better)
    least = share_left**2 * size
    for _ in range(most):
        if not size > least:
            return
        image = image_of(direction)
        length = size / dot(direction, image)
        yield length, direction, size
        left -= length * image
        better = precondition(left)
        size, before = dot(left, better), size
        direction = better + size / before * direction


def solution(left: np.ndarray, *settings) -> np.ndarray:
    """Return the solution for a right hand side, the sum of all `steps`; the arguments are theirs."""
    found = np.zeros_like(left)
    for length, direction, _ in steps(left, *settings):
        found += length * direction
    return found
