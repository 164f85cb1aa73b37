"""Learnt bond forces: tensor-product cubic splines, which any function of two or three features can be resampled onto."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np

from ..kernels.feature_sets import FEATURE_SETS
from ..kernels.spline import FEATURES, SUPPORT, WORK_ROWS, cubic_weights, pack, spline_block
from .learnt import N_OUTPUTS, LearntBondForce, checked_array, checked_feature_set
from .protocol import Domain

MOST_COEFFICIENTS = 2**20
"""Of a table: so many places are counted exactly in single precision, too."""


@dataclass(frozen=True)
class SplineForce(LearntBondForce):
    """A cubic spline of two or three features, with two continuous derivatives; beyond its box it has the value at the box's edge.

    Parameters
    ----------
    low, step : ndarray, shape (n,)
        Lower end of the box by feature, and the width of a cell.
    coefficients : ndarray, shape (2, cells_1 + 3, …, cells_n + 3)
        Of the B-splines, by output.

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

    def payload(self) -> dict[str, np.ndarray | str]:
        return {
            "feature_set": self.feature_set,
            "low": self.low,
            "step": self.step,
            "coefficients": self.coefficients,
            "at_rest": self.at_rest,
        }

    @classmethod
    def from_payload(cls, name: str, payload: dict, domain: Domain, law: str, shape: Mapping[str, float]) -> SplineForce:
        if set(payload) != {"feature_set", "low", "step", "coefficients", "at_rest"}:
            raise ValueError("a spline's payload has feature_set, low, step, coefficients and at_rest")
        feature_set = checked_feature_set(payload)
        count = len(FEATURE_SETS[feature_set].names)
        if count not in FEATURES:
            raise ValueError(f"a spline takes two or three features, {feature_set} are {count}")
        low, step = (checked_array(payload[key], key, (count,)) for key in ("low", "step"))
        if not (step > 0).all():
            raise ValueError("step must be positive")
        coefficients = checked_array(payload["coefficients"], "coefficients")
        if coefficients.ndim != 1 + count or coefficients.shape[0] != N_OUTPUTS or min(coefficients.shape[1:]) < SUPPORT:
            raise ValueError(
                f"coefficients have shape {coefficients.shape}, not {N_OUTPUTS} and at least {SUPPORT} by each of {count} features"
            )
        if coefficients.size > MOST_COEFFICIENTS:
            raise ValueError(f"there are {coefficients.size} coefficients, at most {MOST_COEFFICIENTS} are taken")
        at_rest = checked_array(payload["at_rest"], "at_rest", (N_OUTPUTS,))
        return cls(name, feature_set, at_rest, domain, law, dict(shape), low, step, coefficients)
