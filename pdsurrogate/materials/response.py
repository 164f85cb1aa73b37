"""Responses: stress and energy of a law from the derivatives of its energy, for one kind of state.

A `Response` defines the numbers that describe a state, the invariants or principal stretches at
which W is evaluated there, and the result computed from the derivatives of W and U. This module
evaluates any law with any response, in NumPy or compiled over a block of states.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import carray
from numba.core.ccallback import CFunc

from ..engine.block_arrays import BLOCK, block_rows, put_column, stack_rows
from ..engine.compile import STRESS_RESPONSE, block_function_of, widest_vectors
from .consistency import check_consistency
from .law import InvariantLaw, Law

STATE_NUMBERS = 3
"""Count of numbers that describe a state."""

MOST_PARAMETERS = 4096
"""Length of the array view of a law's parameters, an upper bound for all laws; an expression
reads those of its own law.
"""


@dataclass(frozen=True)
class Response:
    """Stress and energy of a law in one kind of state; the functions are plain elementwise
    expressions of tuples.

    Attributes
    ----------
    rows : int
        Count of numbers in a result.
    volume : int
        Index, within a state, of the volume ratio at which U is evaluated.
    invariants : callable
        ``invariants(state)`` returns I1bar and I2bar.
    of_invariants : callable
        ``of_invariants(state, isochoric, volumetric)`` returns the result from (W, W1, W2, W11,
        W12, W22) and (U, U', U'').
    stretches : callable
        ``stretches(state)`` returns logarithms and squares (x1, x2, x3, s1, s2, s3) of the
        isochoric principal stretches; equal stretches are moved slightly apart.
    of_stretches : callable
        ``of_stretches(state, stretches, sums, volumetric)`` returns the result from the sums (W,
        g1, g2, g3, h) over the terms of a `PrincipalStretchLaw`.
    curvature : bool
        Whether `of_stretches` uses h; if not, h is 0 in compiled functions.
    isochoric : bool
        Whether U is left out.
    """

    rows: int
    volume: int
    invariants: Callable
    of_invariants: Callable
    stretches: Callable
    of_stretches: Callable
    curvature: bool = False
    isochoric: bool = False

    def __call__(self, law: Law, *state) -> tuple:
        """Return the dimensionless response of a law, a tuple of `rows` values, in states given
        as NumPy arrays or numbers.
        """
        state = tuple(np.asarray(value, dtype=float) for value in state)
        parameters = law.parameters
        volumetric = self._volumetric(law)(state[self.volume], parameters)
        if isinstance(law, InvariantLaw):
            return self.of_invariants(
                state, law.isochoric(*self.invariants(state), parameters), volumetric
            )
        stretches = self.stretches(state)
        return self.of_stretches(state, stretches, law.sums(stretches, parameters), volumetric)

    def block(self, law: Law) -> CFunc:
        """Return the response of a law as a function compiled for blocks of states
        (`pdsurrogate.engine.compile.STRESS_RESPONSE`).

        Raise ValueError if the law's derivatives are not those of its energy (`check_consistency`).
        """
        check_consistency(law)
        shared = self._volumetric(law), self.rows, self.volume
        if isinstance(law, InvariantLaw):
            parts = law.isochoric, self.invariants, self.of_invariants
            return block_function_of(_invariant_block, STRESS_RESPONSE, *parts, *shared)
        parts = law.coefficients, law.term, self.stretches, self.of_stretches, self.curvature
        return block_function_of(_principal_block, STRESS_RESPONSE, *parts, *shared)

    def _volumetric(self, law: Law) -> Callable:
        """Return the function of (J3, parameters) for U and its derivatives in this response:
        zeros if the response is isochoric.
        """
        return _nothing if self.isochoric else law.volumetric


def _nothing(J3, parameters):
    """Return zeros in the place of U, U' and U'' for a response that leaves the volumetric
    energy out.
    """
    return 0.0, 0.0, 0.0


def volume_energy_block(law: Law) -> CFunc:
    """Return a compiled function that computes a law's U and U' for a block of states, with the
    volume ratio in the first row of states.
    """
    check_consistency(law)
    return block_function_of(_volume_block, STRESS_RESPONSE, law.volumetric, _energy, 0, 0)


def volume_residual_block(law: Law) -> CFunc:
    """Return a compiled function that computes J3 U' and its derivative by J3 for a block of
    states, with J3 in row 2 of the states.

    The results are in rows 2 and 3, as in `PLANE_STRESS`.
    """
    return block_function_of(_volume_block, STRESS_RESPONSE, law.volumetric, _residual, 2, 2)


def _energy(J3, volumetric):
    """Return U and U' from the tuple (U, U', U'') of a volumetric energy."""
    return volumetric[0], volumetric[1]


def _residual(J3, volumetric):
    """Return J3 U' and its derivative by J3 from the tuple (U, U', U'') of a volumetric energy."""
    _, dU, ddU = volumetric
    return J3 * dU, dU + J3 * ddU


def _volume_block(volumetric, of_volume, volume, row):
    """Build the function that writes the two results of `of_volume` for a block of states into the
    rows `row` and `row` + 1.

    ``of_volume(J3, volumetric)`` is called with the result (U, U', U'') of `volumetric`; J3 is in
    row `volume` of the states.
    """

    def response(states, parameters, result):
        widest_vectors()
        states = carray(states, (STATE_NUMBERS, BLOCK))
        result = carray(result, (4, BLOCK))
        parameters = carray(parameters, (MOST_PARAMETERS,))
        for k in range(BLOCK):
            J3 = states[volume, k]
            result[row, k], result[row + 1, k] = of_volume(J3, volumetric(J3, parameters))

    return response


def _invariant_block(isochoric, invariants, of_invariants, volumetric, n_rows, volume):
    """Build the function that writes the response of an `InvariantLaw` for a block of states."""

    def response(states, parameters, result):
        widest_vectors()
        states = carray(states, (STATE_NUMBERS, BLOCK))
        result = carray(result, (n_rows, BLOCK))
        parameters = carray(parameters, (MOST_PARAMETERS,))
        for k in range(BLOCK):
            state = states[0, k], states[1, k], states[2, k]
            I1, I2 = invariants(state)
            found = of_invariants(
                state, isochoric(I1, I2, parameters), volumetric(state[volume], parameters)
            )
            put_column(result, k, found)

    return response


def _principal_block(
    coefficients, term, stretches, of_stretches, curvature, volumetric, n_rows, volume
):
    """Build the function that writes the response of a `PrincipalStretchLaw` for a block of
    states.
    """

    def response(states, parameters, result):
        widest_vectors()
        states = carray(states, (STATE_NUMBERS, BLOCK))
        result = carray(result, (n_rows, BLOCK))
        n_terms = np.int64(carray(parameters, (2,))[1])
        # The law contains the number of terms and reads no parameters after the last one.
        parameters = carray(parameters, (MOST_PARAMETERS,))
        rows = block_rows(stack_rows(6, 1.0))
        for k in range(BLOCK):
            put_column(rows, k, stretches((states[0, k], states[1, k], states[2, k])))
        # This loop stands alone: within the one above it would split iterations off that one.
        for row in range(n_rows):
            for k in range(BLOCK):
                result[row, k] = 0.0
        for number in range(n_terms):
            constants = coefficients(parameters, number)
            for k in range(BLOCK):
                W, g1, g2, g3, h = term(
                    rows[0, k],
                    rows[1, k],
                    rows[2, k],
                    rows[3, k],
                    rows[4, k],
                    rows[5, k],
                    constants,
                )
                result[0, k] += W
                result[1, k] += g1
                result[2, k] += g2
                result[3, k] += g3
                if curvature:
                    result[4, k] += h
        for k in range(BLOCK):
            state = states[0, k], states[1, k], states[2, k]
            at = rows[0, k], rows[1, k], rows[2, k], rows[3, k], rows[4, k], rows[5, k]
            sums = (
                result[0, k],
                result[1, k],
                result[2, k],
                result[3, k],
                result[4, k] if curvature else 0.0,
            )
            put_column(
                result, k, of_stretches(state, at, sums, volumetric(state[volume], parameters))
            )

    return response
