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
from typing import ClassVar

import numpy as np
from numba import carray

from ..kernels.block_arrays import BLOCK, block_rows, stack_rows
from ..kernels.compile import STRESS_RESPONSE, block_function_of, inlined, widest_vectors
from ..kernels.elementary import exponential, inverse_cube_root, logarithm, select

TRACE, AREA_RATIO, VOLUME_RATIO = 0, 1, 2
"""Rows of the states handed to a stress response: tr C in the plane, J = det F in the plane, J3."""

STRESS_U, STRESS_INVERSE_U, THICKNESS_RESIDUAL, THICKNESS_SLOPE, ENERGY = 0, 1, 2, 3, 4
"""Rows of its result: p, q, the residual J3 dPsi/dJ3 of P33 = 0 at fixed F in the plane, its derivative by J3, and Psi."""

RESPONSE_ROWS = 5

MOST_PARAMETERS = 4096
"""More than the parameters of any law; an expression reads those that its law has."""


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
    bounds: ClassVar[dict[str, tuple[float, float]]] = {}
    """Bounds of the parameters beside the two moduli, within which they are identified from test data."""

    costly: ClassVar[bool] = False
    """Whether the response costs more than a learnt bond force, so that such a force does better to solve the thickness by itself."""

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
        """Dimensionless parameters, float64, in the order the law's expressions read them; the first is K/mu."""

    @staticmethod
    def volumetric(J3, parameters):
        """U and its derivatives (U, U', U'') at the volume ratio; K/8 (J3 - 1/J3)^2, the paper's Eq. (6), unless a law has another."""
        K = parameters[0]
        inverse = 1 / J3
        square = inverse * inverse
        return (
            K / 8 * (J3 - inverse) * (J3 - inverse),
            K / 4 * (J3 - inverse * square),
            K / 4 * (1 + 3 * square * square),
        )

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

    @classmethod
    def volumetric_block(cls):
        """Block function of J3 U' and its derivative alone, in the rows that the whole response has for the residual and its slope."""
        return block_function_of(_volumetric_response, STRESS_RESPONSE, cls.volumetric)

    @property
    def shape(self) -> dict[str, float]:
        """Those dimensionless parameters that the bond force at given (a, b, J, C33) depends on; the bulk modulus is none."""
        return {}

    def describe(self) -> dict:
        """Name and parameters, as a scene or a card states them."""
        return {"law": self.name, **{field.name: getattr(self, field.name) for field in fields(self)}}


class InvariantLaw(Law):
    """A law W(I1bar, I2bar) + U(J3) of the isochoric invariants.

    A subclass gives `isochoric`, and `volumetric` where it has its own: static methods that are plain elementwise expressions.
    Everything else follows (theory (7) for the stress).
    """

    n_parameters: ClassVar[int] = 1
    """Length of `parameters`."""

    @staticmethod
    @abstractmethod
    def isochoric(I1, I2, parameters):
        """W and its derivatives (W, W1, W2, W11, W12, W22) at the isochoric invariants."""

    def response(self, trace, area_ratio, volume_ratio):
        I1, I2 = isochoric_invariants(trace, area_ratio, volume_ratio)
        p = self.parameters
        return invariant_response(trace, area_ratio, volume_ratio, *self.isochoric(I1, I2, p), *self.volumetric(volume_ratio, p))

    @classmethod
    def response_block(cls):
        return block_function_of(_invariant_block, STRESS_RESPONSE, cls.isochoric, cls.volumetric, cls.n_parameters)


def isochoric_invariants(trace, J, J3):
    """I1bar and I2bar from tr C in the plane, J in the plane and J3, with C33 = (J3/J)**2."""
    c = inverse_cube_root(J3 * J3)
    C33 = (J3 / J) * (J3 / J)
    return c * (trace + C33), c * c * (J * J + C33 * trace)


def invariant_response(trace, J, J3, W, W1, W2, W11, W12, W22, U, dU, ddU):
    """Stress response from the derivatives of W(I1bar, I2bar) + U(J3); theory (7) with U^3 reduced by Cayley-Hamilton.

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


class PrincipalStretchLaw(Law):
    """A law W + U(J3) whose isochoric part W is a sum of like terms in the isochoric principal stretches.

    The terms of Ogden's sum are such terms, and so are the directions of a quadrature on the sphere.  A subclass gives `coefficients`
    and `term`, static methods that are plain elementwise expressions, and `n_terms`.  Its `parameters` are K/mu, the number of terms,
    and whatever `coefficients` reads.
    """

    @property
    @abstractmethod
    def n_terms(self) -> int:
        """Number of terms."""

    @staticmethod
    @abstractmethod
    def coefficients(parameters, k):
        """Constants of term k, a tuple of numbers."""

    @staticmethod
    @abstractmethod
    def term(x1, x2, x3, s1, s2, s3, coefficients):
        """One term of W: its energy, g1, g2, g3, h.

        ``x`` are the logarithms of the isochoric principal stretches and ``s`` their squares; ``g`` are the derivatives by x1, x2 and
        x3, and ``h`` is the second derivative along (-1, -1, 2)/3, the way J3 changes them while the plane is held.
        """

    def response(self, trace, area_ratio, volume_ratio):
        trace, J, J3 = (np.asarray(value, dtype=float) for value in (trace, area_ratio, volume_ratio))
        state = principal_state(trace, J, J3)
        parameters = self.parameters
        terms = (self.term(*state, self.coefficients(parameters, k)) for k in range(self.n_terms))
        totals = [sum(parts) for parts in zip(*terms, strict=True)]
        return principal_response(trace, J, J3, state[3], state[4], *totals, *self.volumetric(J3, parameters))

    @classmethod
    def response_block(cls):
        return block_function_of(_principal_block, STRESS_RESPONSE, cls.coefficients, cls.term, cls.volumetric)


LEAST_SEPARATION = 3e-6
"""Two equal in-plane stretches are set apart by this much of their logarithm.

Everything asked of them is even in the difference, so this changes it by some 1e-11, as much as rounding does there.
"""


def principal_state(trace, J, J3):
    """Logarithms and squares of the isochoric principal stretches, those in the plane first, from tr C and J in the plane and J3."""
    half = trace / 2
    # cosh and sinh of the difference of the logarithms; a trace below 2 J belongs to no stretch tensor, and is a rounding error.
    excess = (half - J) * (half + J) / (J * J)
    least = LEAST_SEPARATION * LEAST_SEPARATION
    excess = select(excess < least, least, excess)
    x1 = logarithm(half / J + np.sqrt(excess)) / 2
    middle = logarithm(J) / 2 - logarithm(J3) / 3
    x2 = middle - x1
    x1 = middle + x1
    x3 = -(x1 + x2)
    return x1, x2, x3, exponential(2 * x1), exponential(2 * x2), exponential(2 * x3)


def principal_response(trace, J, J3, s1, s2, W, g1, g2, g3, h, U, dU, ddU):
    """Stress response from the derivatives of W(x1, x2, x3) + U(J3).

    The principal stresses are P_a = (g_a - g_3)/lambda_a, the pressure eliminated by P33 = 0; p lambda_a^2 + q = g_a - g_3 for both.
    """
    unit = inverse_cube_root(J3 * J3)
    p = unit * (g1 - g2) / (s1 - s2)
    q = (g1 + g2) / 2 - g3 - p * trace / 2
    residual = (2 * g3 - g1 - g2) / 3 + J3 * dU
    slope = h / J3 + dU + J3 * ddU
    return p, q, residual, slope, W + U


isochoric_invariants = inlined(isochoric_invariants)
invariant_response = inlined(invariant_response)
principal_state = inlined(principal_state)
principal_response = inlined(principal_response)


def _volumetric_response(volumetric):
    """Builder of `Law.volumetric_block`."""

    def response(states, parameters, result):
        widest_vectors()
        states = carray(states, (3, BLOCK))
        result = carray(result, (RESPONSE_ROWS, BLOCK))
        parameters = carray(parameters, (MOST_PARAMETERS,))
        for k in range(BLOCK):
            J3 = states[2, k]
            _, dU, ddU = volumetric(J3, parameters)
            result[2, k] = J3 * dU
            result[3, k] = dU + J3 * ddU

    return response


def _invariant_block(isochoric, volumetric, n_parameters):
    """Builder of `InvariantLaw.response_block`."""

    def response(states, parameters, result):
        widest_vectors()
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

    return response


def _principal_block(coefficients, term, volumetric):
    """Builder of `PrincipalStretchLaw.response_block`."""

    def response(states, parameters, result):
        widest_vectors()
        states = carray(states, (3, BLOCK))
        result = carray(result, (RESPONSE_ROWS, BLOCK))
        n_terms = np.int64(carray(parameters, (2,))[1])
        # How long they are is for the law to know; it reads no further than its last term.
        parameters = carray(parameters, (MOST_PARAMETERS,))
        rows = block_rows(stack_rows(6))
        for k in range(BLOCK):
            x1, x2, x3, s1, s2, s3 = principal_state(states[0, k], states[1, k], states[2, k])
            rows[0, k] = x1
            rows[1, k] = x2
            rows[2, k] = x3
            rows[3, k] = s1
            rows[4, k] = s2
            rows[5, k] = s3
        # On its own: a loop within the one above would split rounds off it.
        for row in range(RESPONSE_ROWS):
            for k in range(BLOCK):
                result[row, k] = 0.0
        for number in range(n_terms):
            constants = coefficients(parameters, number)
            for k in range(BLOCK):
                W, g1, g2, g3, h = term(rows[0, k], rows[1, k], rows[2, k], rows[3, k], rows[4, k], rows[5, k], constants)
                result[0, k] += W
                result[1, k] += g1
                result[2, k] += g2
                result[3, k] += g3
                result[4, k] += h
        for k in range(BLOCK):
            J3 = states[2, k]
            U, dU, ddU = volumetric(J3, parameters)
            p, q, residual, slope, energy = principal_response(
                states[0, k],
                states[1, k],
                J3,
                rows[3, k],
                rows[4, k],
                result[0, k],
                result[1, k],
                result[2, k],
                result[3, k],
                result[4, k],
                U,
                dU,
                ddU,
            )
            result[0, k] = p
            result[1, k] = q
            result[2, k] = residual
            result[3, k] = slope
            result[4, k] = energy

    return response
