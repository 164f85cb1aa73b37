"""The isochoric energy of a bond, exact or learnt, for the pass over the pairs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..engine.block_arrays import BLOCK
from ..kernels import selective_energy
from ..materials import PLANES, Law


@dataclass(frozen=True)
class IsochoricEnergy:
    """W and its stress for the pass over the pairs, as (p, q, r, energy) of `pdsurrogate.materials.response`, exact or learnt.

    Attributes
    ----------
    address : int
        Of the block function (`pdsurrogate.engine.compile.STRESS_RESPONSE`).
    parameters : ndarray
        What it reads.
    precision : {"float32", "float64"}
        Of states and results.
    outside : ndarray of int64, shape (1,)
        To which a learnt one adds the states that it finds outside its domain.
    """

    address: int
    parameters: np.ndarray
    precision: str = "float64"
    outside: np.ndarray = field(default_factory=lambda: np.zeros(1, dtype=np.int64))

    @classmethod
    def exact(cls, law: Law, plane: str) -> IsochoricEnergy:
        """Of a law itself."""
        return cls(PLANES[plane].isochoric_response.block(law).address, law.parameters)

    def evaluate(self, *state) -> np.ndarray:
        """The result at states given as three vectors of n numbers, shape (4, n); of points, whose states are not counted."""
        states, n = np.stack(state).astype(self.precision), len(state[0])
        found, counted = np.empty((selective_energy.RESULT_ROWS, n)), self.outside.copy()
        for at in range(0, n, BLOCK):
            size = min(BLOCK, n - at)
            # Filled up with the first, which is a state.
            rows = np.repeat(states[:, at : at + 1], BLOCK, axis=1)
            result = np.empty((selective_energy.RESULT_ROWS, BLOCK), self.precision)
            rows[:, :size] = states[:, at : at + size]
            selective_energy.evaluate_response(self.address, rows, self.parameters, result)
            found[:, at : at + size] = result[:, :size]
        self.outside[:] = counted
        return found
