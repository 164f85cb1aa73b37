"""The exact bond force (theory (7), (11)) as a block function; it replaces a surrogate outside the surrogate's domain."""

from functools import cache

import numpy as np
from numba import carray

from ..engine.block_arrays import BLOCK, SCRATCH_ROWS, STATE_ROWS, TRACTION_ROWS, put_column
from ..engine.compile import bond_force_signature, call_block, compile_block_function, widest_vectors
from .algebra import entries

doubles_at = entries("rows, k", [f"np.float64(rows[{r}, k])" for r in range(3)])


@cache
def analytic_bond_force(dtype):
    """Return the block function of the exact bond force of any law, which is evaluated in double precision for any `dtype`."""

    def bond_force(states, sizes, weights, response, parameters, work, scratch, traction):
        widest_vectors()
        states = carray(states, (STATE_ROWS, BLOCK))
        traction = carray(traction, (TRACTION_ROWS, BLOCK))
        scratch = carray(scratch, (SCRATCH_ROWS, BLOCK))
        for k in range(BLOCK):
            a, b, U_mm = doubles_at(states, k)
            J = np.float64(states[3, k])
            put_column(scratch, k, (a * a + 2.0 * b * b + U_mm * U_mm, J, J * np.sqrt(np.float64(states[4, k]))))
        call_block(response, scratch[0:3], parameters, scratch[3:8])
        for k in range(BLOCK):
            p = scratch[3, k]
            q = scratch[4, k] / scratch[1, k]
            a, b, U_mm = doubles_at(states, k)
            put_column(traction, k, (p * a + q * U_mm, (p - q) * b, p * U_mm + q * a))

    return compile_block_function(bond_force, bond_force_signature(np.dtype(dtype)))
