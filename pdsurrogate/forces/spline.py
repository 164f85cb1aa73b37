"""Learnt bond forces: tensor-product cubic splines, which can resample any function of two or three features."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np

from ..kernels.feature_sets import FEATURE_SETS, N_OUTPUTS
from ..kernels.spline import FEATURES, SUPPORT, WORK_ROWS, cubic_weights, pack, spline_block
from .learnt import LearntBondForce, check_shape

MOST_COEFFICIENTS = 2**20
"""Maximum number of entries of a table: single precision represents all their indices exactly."""


@dataclass(frozen=True, repr=False)
class SplineForce(LearntBondForce):
    """Cubic spline of two or three features, with two continuous derivatives; beyond its box it has the value at the box's edge.

    Parameters
    ----------
    low, step : ndarray, shape (n,)
        Lower end of the box by feature, and the width of a cell.
    coefficients : ndarray, shape (2, cells_1 + 3, …, cells_n + 3)
        Coefficients of the B-splines, by output.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.forces.SplineForce.kind, issubclass(pds.forces.SplineForce, pds.forces.ForceModel)
    ('bond-force-spline', True)
    """

    low: np.ndarray
    step: np.ndarray
    coefficients: np.ndarray

    kind: ClassVar[str] = "bond-force-spline"
    arrays: ClassVar[tuple[str, ...]] = ("low", "step", "coefficients")

    @property
    def size(self) -> str:
        return f"{' x '.join(str(count - SUPPORT + 1) for count in self.coefficients.shape[1:])} cells"

    def outputs(self, features: np.ndarray) -> np.ndarray:
        cells = np.array(self.coefficients.shape[1:]) - (SUPPORT - 1)
        place = (features - self.low) / self.step
        place = np.minimum(np.where(place > 0, place, 0), cells)
        first = np.minimum(np.floor(place), cells - 1).astype(int)
        weights = [cubic_weights(within) for within in (place - first).T]
        found = np.zeros((len(features), N_OUTPUTS))
        for offsets in product(range(SUPPORT), repeat=len(cells)):
            share = np.prod([weight[offset] for weight, offset in zip(weights, offsets, strict=True)], axis=0)
            found += share[:, None] * self.coefficients[:, *(first + offsets).T].T
        return found

    def packed(self, dtype) -> tuple[int, np.ndarray, np.ndarray, int]:
        sizes, weights = pack(self.low, self.step, self.coefficients, self.at_rest, dtype)
        return spline_block(FEATURE_SETS[self.feature_set], dtype).address, sizes, weights, WORK_ROWS

    def check_arrays(self) -> None:
        count, shape = len(self.features), self.coefficients.shape
        if count not in FEATURES:
            raise ValueError(f"a spline takes two or three features, {self.feature_set} are {count}")
        for key in ("low", "step"):
            check_shape(getattr(self, key), key, (count,))
        if not (self.step > 0).all():
            raise ValueError("step must be positive")
        if len(shape) != 1 + count or shape[0] != N_OUTPUTS or min(shape[1:]) < SUPPORT:
            raise ValueError(f"coefficients have shape {shape}, not {N_OUTPUTS} and at least {SUPPORT} by each of {count} features")
        if self.coefficients.size > MOST_COEFFICIENTS:
            raise ValueError(f"there are {self.coefficients.size} coefficients, at most {MOST_COEFFICIENTS} are taken")
