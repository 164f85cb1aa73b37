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

    Attributes
    ----------
    vector : ndarray, shape (n, 2)
        Latest estimate of the mode.
    fresh : bool
        Whether it has yet to be improved for the first time.
    """

    def __init__(self, mass: np.ndarray, free: np.ndarray, random_state: int = 0) -> None:
        self._mass = mass[:, None]
        self._free = free
        self.vector = np.random.default_rng(random_state).standard_normal(free.shape) * free
        self.fresh = True

    def __call__(self, force: InternalForce, positions: np.ndarray) -> float:
        """Greatest eigenvalue of M^-1 K at the given positions (square of the highest frequency)."""
        probe = 1e-6 * force.body.spacing
        at_rest, moved = np.empty_like(positions), np.empty_like(positions)
        force(positions, at_rest)
        value = 0.0
        for _ in range(25 if self.fresh else 6):
            self.vector /= np.abs(self.vector).max()
            force(positions + probe * self.vector, moved)
            image = (at_rest - moved) / probe / self._mass * self._free
            # The norm bounds the Rayleigh quotient from above for a tangent that is not quite symmetric.
            value = np.sqrt((image**2).sum() / (self.vector**2).sum())
            self.vector = image
        self.fresh = False
        return float(value)
