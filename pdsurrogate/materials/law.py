"""What a material law is here, and what every law shares.

A law is a small frozen dataclass.  It states its energy and the derivatives of its energy as elementwise expressions, once; NumPy evaluates
them on arrays for checking, and the same expressions are compiled into the *stress response* that the kernels call through a pointer.

All of it is dimensionless: energies and stresses in units of the law's shear modulus.  For an isotropic law under plane stress, with
F = R U in the plane, the first Piola-Kirchhoff stress is coaxial with U,

    R^T P = p U + q U^-1,

and two coefficients (p, q) say everything.  They are functions of the trace of C in the plane, of J = det F in the
plane, and of the three-dimensional volume ratio J3 = J sqrt(C33), with the pressure already eliminated by P33 = 0.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from functools import cache
from typing import ClassVar

import numpy as np
from numba import carray

from ..kernels.blocks import BLOCK
from ..kernels.compile import STRESS_RESPONSE, compile_block_function, inlined
from ..kernels.elementary import inverse_cube_root

TRACE, AREA_RATIO, VOLUME_RATIO = 0, 1, 2
"""Rows of the states handed to a stress response: tr C in the plane, J = det F in the plane, J3."""

STRESS_U, STRESS_INVERSE_U, THICKNESS_RESIDUAL, THICKNESS_SLOPE, ENERGY = 0, 1, 2, 3, 4
"""Rows of its result: p, q, the residual J3 dPsi/dJ3 of P33 = 0 at fixed F in the plane, its derivative by J3, and Psi."""

RESPONSE_ROWS = 5


@dataclass(frozen=True)
class Law(ABC):
    """A slightly compressible isotropic hyperelastic law.

    Parameters
    ----------
    shear_modulus : float
        Shear modulus in the undeformed state, in any unit of stress; everything else is computed in units of it.
    bulk_modulus : float
        Bulk modulus in the undeformed state, same unit.
    """

    name: ClassVar[str]
    reference: ClassVar[str]
    n_parameters: ClassVar[int]
    """Length of `parameters`."""

    shear_modulus: float = 1.0
    bulk_modulus: float = 100.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not np.all(np.isfinite(value)):
                raise ValueError(f"{self.name}: {field.name} must be finite, not {value}")
        for key in ("shear_modulus", "bulk_modulus"):
            if getattr(self, key) <= 0:
                raise ValueError(f"{self.name}: {key} must be positive, not {getattr(self, key):g}")
        self.check()

    def check(self) -> None:  # noqa: B027  (most laws have nothing to add)
        """Raise ValueError where a parameter of the law's own makes no sense."""

    @property
    @abstractmethod
    def parameters(self) -> np.ndarray:
        """Dimensionless parameters, float64, in the order the law's expressions read them."""

    @abstractmethod
    def response(self, trace, area_ratio, volume_ratio):
        """Stress response on NumPy arrays: (p, q, residual, slope, energy), dimensionless."""

    def limit(self, trace: float, area_ratio: float) -> str:
        """Why there is no plane-stress state at tr C and J in the plane, for the error that says so."""
        return "beyond the law's limit"

    @classmethod
    @abstractmethod
    def response_block(cls):
        """The same compiled as a block function (`pdsurrogate.kernels.compile.STRESS_RESPONSE`)."""

    @property
    def shape(self) -> dict[str, float]:
        """Those dimensionless parameters that the bond force at given (a, b, J, C33) depends on; the bulk modulus is none."""
        return {}

    def describe(self) -> dict:
        """Name and parameters, as a scene or a card states them."""
        return {"law": self.name, **{field.name: getattr(self, field.name) for field in fields(self)}}


class InvariantLaw(Law):
    """A law W(I1bar, I2bar) + U(J3) of the isochoric invariants.

    A subclass gives `isochoric` and `volumetric`, static methods that are plain elementwise expressions; everything else follows
    (THEORY [4] for the stress).
    """

    @staticmethod
    @abstractmethod
    def isochoric(I1, I2, parameters):
        """W and its derivatives (W, W1, W2, W11, W12, W22) at the isochoric invariants."""

    @staticmethod
    @abstractmethod
    def volumetric(J3, parameters):
        """U and its derivatives (U, U', U'') at the volume ratio."""

    def response(self, trace, area_ratio, volume_ratio):
        I1, I2 = isochoric_invariants(trace, area_ratio, volume_ratio)
        p = self.parameters
        return invariant_response(trace, area_ratio, volume_ratio, *self.isochoric(I1, I2, p), *self.volumetric(volume_ratio, p))

    @classmethod
    @cache
    def response_block(cls):
        isochoric, isochoric_print = inlined(cls.isochoric)
        volumetric, volumetric_print = inlined(cls.volumetric)
        prints = isochoric_print + volumetric_print
        n_parameters = cls.n_parameters

        def response(states, parameters, result):
            prints  # noqa: B018  (part of the cache key)
            states = carray(states, (3, BLOCK))
            result = carray(result, (RESPONSE_ROWS, BLOCK))
            parameters = carray(parameters, (n_parameters,))
            for k in range(BLOCK):
                trace = states[0, k]
                J = states[1, k]
                J3 = states[2, k]
                I1, I2 = isochoric_invariants(trace, J, J3)
                W, W1, W2, W11, W12, W22 = isochoric(I1, I2, parameters)
                U, dU, ddU = volumetric(J3, parameters)
                p, q, residual, slope, energy = invariant_response(trace, J, J3, W, W1, W2, W11, W12, W22, U, dU, ddU)
                result[0, k] = p
                result[1, k] = q
                result[2, k] = residual
                result[3, k] = slope
                result[4, k] = energy

        return compile_block_function(response, STRESS_RESPONSE)


def isochoric_invariants(trace, J, J3):
    """I1bar and I2bar from tr C in the plane, J in the plane and J3, with C33 = (J3/J)**2."""
    c = inverse_cube_root(J3 * J3)
    C33 = (J3 / J) * (J3 / J)
    return c * (trace + C33), c * c * (J * J + C33 * trace)


def invariant_response(trace, J, J3, W, W1, W2, W11, W12, W22, U, dU, ddU):
    """Stress response from the derivatives of W(I1bar, I2bar) + U(J3); THEORY [4] with U^3 reduced by Cayley-Hamilton.

    ``d1`` and ``d2`` are J3/2 times the derivatives of the two invariants by J3 at fixed F in the plane, which makes the residual
    J3 dPsi/dJ3, the plane-stress condition (paper, Eq. (9), with the exponent of its first term corrected to +2/3).
    """
    c = inverse_cube_root(J3 * J3)
    C33 = (J3 / J) * (J3 / J)
    c33 = c * C33
    p = 2 * c * (W1 + c33 * W2)
    q = -2 * c * (C33 * W1 + c * (C33 * trace - J * J) * W2)

    I1 = c * (trace + C33)
    I2 = c * c * (J * J + C33 * trace)
    mixed = c * c33 * trace
    d1 = c33 - I1 / 3
    d2 = mixed - 2 * I2 / 3
    residual = 2 * (W1 * d1 + W2 * d2) + J3 * dU
    # Derivatives by J3: I1bar' = 2 d1/J3, I2bar' = 2 d2/J3, (c C33)' = 4/3 c C33/J3, (c^2 C33 tr)' = 2/3 c^2 C33 tr/J3.
    d1_slope = (4 * c33 - 2 * d1) / 3
    d2_slope = (2 * mixed - 4 * d2) / 3
    curvature = W11 * d1 * d1 + 2 * W12 * d1 * d2 + W22 * d2 * d2
    slope = (2 * (W1 * d1_slope + W2 * d2_slope) + 4 * curvature) / J3 + dU + J3 * ddU
    return p, q, residual, slope, W + U


isochoric_invariants = inlined(isochoric_invariants)[0]
invariant_response = inlined(invariant_response)[0]
