"""Learnt bond forces: polynomials in two features, cheaper than a network where the law's response is smooth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.feature_sets import FEATURE_SETS, N_OUTPUTS
from ..kernels.polynomial import MOST_DEGREE, pack, polynomial_block
from .learnt import LearntBondForce, checked_array, checked_feature_set
from .protocol import Domain


@dataclass(frozen=True, repr=False)
class PolynomialForce(LearntBondForce):
    """A sum of products of Chebyshev polynomials in two features.

    Parameters
    ----------
    centre, half_width : ndarray, shape (2,)
        Features are mapped to (x - centre)/half_width, [-1, 1] where it was trained.
    coefficients : ndarray, shape (2, degree1 + 1, degree2 + 1)
        Of T_i(x1) T_j(x2), by output.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> pds.load_surrogate("gent@1")
    <PolynomialForce gent@1 of gent>
    """

    centre: np.ndarray
    half_width: np.ndarray
    coefficients: np.ndarray

    kind: ClassVar[str] = "bond-force-polynomial"

    @property
    def size(self) -> str:
        first, second = (length - 1 for length in self.coefficients.shape[1:])
        return f"degree {first}" if first == second else f"degrees {first} and {second}"

    def outputs(self, features: np.ndarray) -> np.ndarray:
        scaled = (features - self.centre) / self.half_width
        return np.stack([np.polynomial.chebyshev.chebval2d(*scaled.T, coefficients) for coefficients in self.coefficients], axis=1)

    def packed(self, dtype) -> tuple[int, np.ndarray, np.ndarray, int]:
        counts, weights = pack(self.centre, self.half_width, self.coefficients, self.at_rest, dtype)
        block = polynomial_block(FEATURE_SETS[self.feature_set], counts, dtype)
        return block.address, np.zeros(1, dtype=np.int64), weights, 0

    def payload(self) -> dict[str, np.ndarray | str]:
        return {
            "feature_set": self.feature_set,
            "centre": self.centre,
            "half_width": self.half_width,
            "coefficients": self.coefficients,
            "at_rest": self.at_rest,
        }

    @classmethod
    def from_payload(cls, name: str, payload: dict, domain: Domain, law: str, shape: Mapping[str, float]) -> PolynomialForce:
        if set(payload) != {"feature_set", "centre", "half_width", "coefficients", "at_rest"}:
            raise ValueError("a polynomial's payload has feature_set, centre, half_width, coefficients and at_rest")
        feature_set = checked_feature_set(payload)
        if len(FEATURE_SETS[feature_set].names) != 2:
            raise ValueError(f"a polynomial takes two features, {feature_set} are {len(FEATURE_SETS[feature_set].names)}")
        centre, half_width = (checked_array(payload[key], key, (2,)) for key in ("centre", "half_width"))
        if not (half_width > 0).all():
            raise ValueError("half_width must be positive")
        coefficients = checked_array(payload["coefficients"], "coefficients")
        if coefficients.ndim != 3 or coefficients.shape[0] != N_OUTPUTS:
            raise ValueError(f"coefficients have shape {coefficients.shape}, not ({N_OUTPUTS}, degree + 1, degree + 1)")
        if not all(1 <= length <= MOST_DEGREE + 1 for length in coefficients.shape[1:]):
            raise ValueError(f"the degrees must be 0 to {MOST_DEGREE}")
        at_rest = checked_array(payload["at_rest"], "at_rest", (N_OUTPUTS,))
        return cls(name, feature_set, at_rest, domain, law, dict(shape), centre, half_width, coefficients)
