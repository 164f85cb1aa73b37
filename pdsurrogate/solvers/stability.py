"""The highest frequency of a discretised body: what limits an explicit step."""

from __future__ import annotations

import numpy as np

from ..forces import InternalForce


class FrequencyEstimate:
    """Power iteration on M^-1 K with K v from force differences; keeps its vector, so that a later call needs few iterations.

    Parameters
    ----------
    mass : ndarray, shape (n,)
    free : ndarray, shape (n, 2)
        1 where a component may move.
    random_state : int
        Seed of the first vector.
    """

    def __init__(self, mass: np.ndarray, free: np.ndarray, random_state: int = 0) -> None:
        self._mass = mass[:, None]
        self._free = free
        self._vector = np.random.default_rng(random_state).standard_normal(free.shape) * free
        self._fresh = True

    def __call__(self, force: InternalForce, positions: np.ndarray) -> float:
        """Greatest eigenvalue of M^-1 K at the given positions (square of the highest frequency)."""
        probe = 1e-6 * force.body.spacing
        at_rest, moved = np.empty_like(positions), np.empty_like(positions)
        force(positions, at_rest)
        value = 0.0
        for _ in range(25 if self._fresh else 6):
            self._vector /= np.abs(self._vector).max()
            force(positions + probe * self._vector, moved)
            image = (at_rest - moved) / probe / self._mass * self._free
            # The norm bounds the Rayleigh quotient from above for a tangent that is not quite symmetric.
            value = np.sqrt((image**2).sum() / (self._vector**2).sum())
            self._vector = image
        self._fresh = False
        return float(value)
