"""From the energy of a law to what is asked of it in one kind of state: under plane stress, in plane strain, or in space.

A kind of state is a `Response`: in which numbers a state is given, at which invariants or principal stretches W is taken there, and what
is made of the derivatives of W and U.  Evaluating a law, in NumPy or compiled over a block of states, is written here once for all of them.
"""

from __future__ import annotations

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
"""Numbers that give a state."""

MOST_PARAMETERS = 4096
"""More than the parameters of any law; an expression reads those that its law has."""


@dataclass(frozen=True)
class Response:
    """What a law answers in one kind of state; the functions are plain elementwise expressions of tuples.

    Attributes
    ----------
    rows : int
        Numbers in a result.
    volume : int
        Which number of a state is the volume ratio that U is taken at.
    invariants : callable
        ``invariants(state)``: I1bar and I2bar.
    of_invariants : callable
        ``of_invariants(state, isochoric, volumetric)``: the result, from (W, W1, W2, W11, W12, W22) and (U, U', U'').
    stretches : callable
        ``stretches(state)``: logarithms and squares (x1, x2, x3, s1, s2, s3) of the isochoric principal stretches, no two of them equal.
    of_stretches : callable
        ``of_stretches(state, stretches, sums, volumetric)``: the result, from the sums (W, g1, g2, g3, h) over the terms.
    curvature : bool
        Whether it needs h, which is 0 otherwise.
    """

    rows: int
    volume: int
    invariants: Callable
    of_invariants: Callable
    stretches: Callable
    of_stretches: Callable
    curvature: bool

    def __call__(self, law: Law, *state) -> tuple:
        """The result on NumPy arrays, dimensionless."""
        state, parameters = tuple(np.asarray(value, dtype=float) for value in state), law.parameters
        volumetric = law.volumetric(state[self.volume], parameters)
        if isinstance(law, InvariantLaw):
            return self.of_invariants(state, law.isochoric(*self.invariants(state), parameters), volumetric)
        stretches = self.stretches(state)
        terms = (law.term(*stretches, law.coefficients(parameters, k)) for k in range(law.n_terms))
        return self.of_stretches(state, stretches, [sum(parts) for parts in zip(*terms, strict=True)], volumetric)

    def block(self, law: Law) -> CFunc:
        """The same compiled as a block function (`pdsurrogate.engine.compile.STRESS_RESPONSE`).

        Raises
        ------
        ValueError
            If the law's derivatives are not those of its energy (`check_consistency`).
        """
        check_consistency(law)
        shared = law.volumetric, self.rows, self.volume
        if isinstance(law, InvariantLaw):
            parts = law.isochoric, self.invariants, self.of_invariants, law.n_parameters
            return block_function_of(_invariant_block, STRESS_RESPONSE, *parts, *shared)
        parts = law.coefficients, law.term, self.stretches, self.of_stretches, self.curvature
        return block_function_of(_principal_block, STRESS_RESPONSE, *parts, *shared)


def volume_energy_block(law: Law) -> CFunc:
    """Block function of a law's energy of the volume: U and U' from the volume ratio in the first row of the states."""
    check_consistency(law)
    return block_function_of(_volume_block, STRESS_RESPONSE, law.volumetric)


def _volume_block(volumetric):
    """Builder of the block functions of U."""

    def response(states, parameters, result):
        widest_vectors()
        states = carray(states, (1, BLOCK))
        result = carray(result, (2, BLOCK))
        parameters = carray(parameters, (MOST_PARAMETERS,))
        for k in range(BLOCK):
            U, dU, _ = volumetric(states[0, k], parameters)
            result[0, k] = U
            result[1, k] = dU

    return response


def _invariant_block(isochoric, invariants, of_invariants, n_parameters, volumetric, n_rows, volume):
    """Builder of the block functions of an `InvariantLaw`."""

    def response(states, parameters, result):
        widest_vectors()
        states = carray(states, (STATE_NUMBERS, BLOCK))
        result = carray(result, (n_rows, BLOCK))
        parameters = carray(parameters, (n_parameters,))
        for k in range(BLOCK):
            state = states[0, k], states[1, k], states[2, k]
            I1, I2 = invariants(state)
            found = of_invariants(state, isochoric(I1, I2, parameters), volumetric(state[volume], parameters))
            put_column(result, k, found)

    return response


def _principal_block(coefficients, term, stretches, of_stretches, curvature, volumetric, n_rows, volume):
    """Builder of the block functions of a `PrincipalStretchLaw`."""

    def response(states, parameters, result):
        widest_vectors()
        states = carray(states, (STATE_NUMBERS, BLOCK))
        result = carray(result, (n_rows, BLOCK))
        n_terms = np.int64(carray(parameters, (2,))[1])
        # How long they are is for the law to know; it reads no further than its last term.
        parameters = carray(parameters, (MOST_PARAMETERS,))
        rows = block_rows(stack_rows(6, 1.0))
        for k in range(BLOCK):
            put_column(rows, k, stretches((states[0, k], states[1, k], states[2, k])))
        # On its own: a loop within the one above would split rounds off it.
        for row in range(n_rows):
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
                if curvature:
                    result[4, k] += h
        for k in range(BLOCK):
            state = states[0, k], states[1, k], states[2, k]
            at = rows[0, k], rows[1, k], rows[2, k], rows[3, k], rows[4, k], rows[5, k]
            sums = result[0, k], result[1, k], result[2, k], result[3, k], result[4, k] if curvature else 0.0
            put_column(result, k, of_stretches(state, at, sums, volumetric(state[volume], parameters)))

    return response
