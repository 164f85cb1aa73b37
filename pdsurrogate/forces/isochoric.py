"""Isochoric energy of a bond, exact or learnt, for the pass over the pairs."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ..kernels.isochoric_energy import N_SIZES, OUTSIDE
from ..kernels.selective_energy import RESULT_ROWS, evaluate_isochoric_energy
from ..materials import PLANES, Law
from .protocol import by_blocks


@dataclass(frozen=True)
class IsochoricEnergy:
    """W and its stress for the pass over the pairs, as (p, q, r, energy) of `pdsurrogate.materials.response`, exact or learnt.

    Attributes
    ----------
    response : int
        Address of the law's isochoric response (`pdsurrogate.engine.compile.STRESS_RESPONSE`).
    parameters : ndarray
        Parameters of the law.
    address : int
        Address of a learnt energy (`pdsurrogate.kernels.isochoric_energy`); 0 for the exact one.
    sizes : ndarray of int64, shape (N_SIZES,)
    weights : ndarray
        Constants of a learnt energy; `sizes` counts the states found outside its domain.
    precision : {"float32", "float64"}
        Precision of states and results.
    """

    response: int
    parameters: np.ndarray
    address: int = 0
    sizes: np.ndarray = field(default_factory=lambda: np.zeros(N_SIZES, dtype=np.int64))
    weights: np.ndarray = field(default_factory=lambda: np.zeros(1))
    precision: str = "float64"

    @classmethod
    def exact(cls, law: Law, plane: str) -> IsochoricEnergy:
        """Return the energy of a law itself."""
        return cls(PLANES[plane].isochoric_response.block(law).address, law.parameters)

    @property
    def arguments(self) -> tuple:
        """Arguments of kernels that evaluate the energy."""
        return self.address, (self.sizes, self.weights, self.response, self.parameters)

    def count_outside(self) -> int:
        """Return the number of states found outside the domain since the last call."""
        count = int(self.sizes[OUTSIDE])
        self.sizes[OUTSIDE] = 0
        return count

    def evaluate(self, *state) -> np.ndarray:
        """Return the result at states given as three vectors of n numbers, shape (4, n); these states are not counted."""
        counted = self.sizes.copy()
        found = by_blocks(partial(evaluate_isochoric_energy, *self.arguments), np.stack(state), RESULT_ROWS, self.precision)
        self.sizes[:] = counted
        return found
