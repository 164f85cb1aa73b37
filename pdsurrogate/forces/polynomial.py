"""Learnt bond forces: polynomials in two features, cheaper than a network where the law's response is smooth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..kernels.feature_sets import FEATURE_SETS, N_OUTPUTS
from ..kernels.polynomial import MOST_DEGREE, pack, polynomial_block
from .learnt import LearntBondForce, check_shape


@dataclass(frozen=True, repr=False)
class PolynomialForce(LearntBondForce):
    """Sum of products of Chebyshev polynomials in two features.

    Parameters
    ----------
    centre, half_width : ndarray, shape (2,)
        Features are mapped to (x - centre)/half_width, which is in [-1, 1] for the training states.
    coefficients : ndarray, shape (2, degree1 + 1, degree2 + 1)
        Coefficients of T_i(x1) T_j(x2), by output.

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
    arrays: ClassVar[tuple[str, ...]] = ("centre", "half_width", "coefficients")

    @property
    def size(self) -> str:
        first, second = (length - 1 for length in self.coefficients.shape[1:])
        return f"degree {first}" if first == second else f"degrees {first} and {second}"

    def outputs(self, features: np.ndarray) -> np.ndarray:
        x, y = ((features - self.centre) / self.half_width).T
        return np.stack([np.polynomial.chebyshev.chebval2d(x, y, coefficients) for coefficients in self.coefficients], axis=1)

    def packed(self, dtype) -> tuple[int, np.ndarray, np.ndarray, int]:
        counts, weights = pack(self.centre, self.half_width, self.coefficients, self.at_rest, dtype)
        block = polynomial_block(FEATURE_SETS[self.feature_set], counts, dtype)
        return block.address, np.zeros(1, dtype=np.int64), weights, 0

    def check_arrays(self) -> None:
        count = len(self.features)
        if count != 2:
            raise ValueError(f"a polynomial takes two features, {self.feature_set} are {count}")
        for key in ("centre", "half_width"):
            check_shape(getattr(self, key), key, (2,))
        if not (self.half_width > 0).all():
            raise ValueError("half_width must be positive")
        shape = self.coefficients.shape
        if len(shape) != 3 or shape[0] != N_OUTPUTS:
            raise ValueError(f"coefficients have shape {shape}, not ({N_OUTPUTS}, degree + 1, degree + 1)")
        if not all(1 <= length <= MOST_DEGREE + 1 for length in shape[1:]):
            raise ValueError(f"the degrees must be 0 to {MOST_DEGREE}")
