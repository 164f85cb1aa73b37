"""Plane strain for a bond force that was learnt at plane stress."""

from functools import cache

import numpy as np
from numba import carray

from ..engine.block_arrays import BLOCK, SCRATCH_ROWS, STATE_ROWS, TRACTION_ROWS, put_column
from ..engine.compile import bond_force_signature, call_block, compile_block_function, widest_vectors
from .analytic import doubles_at

MODEL, VOLUMETRIC, OWN = 0, 1, 2
"""Places in the sizes: addresses of the model's block function and of the law's volumetric one, and the first of the model's own sizes."""

MOST_SIZES = 4096
"""Length of the array view of a model's `sizes`, an upper bound for all models; each model reads only its own."""


@cache
def plane_strain_bond_force(dtype):
    """Return the block function that adds the pressure of a held thickness to a model's force, T + (J3 U' - tr(T U)/3) U^-1 (theory (47)).

    The isochoric Kirchhoff stress has no trace; at plane stress the model has subtracted its component across the plane from all three.
    """

    def bond_force(states, sizes, weights, response, parameters, work, scratch, traction):
        widest_vectors()
        model = carray(sizes, (MOST_SIZES,))
        call_block(model[MODEL], states, model[OWN:], weights, response, parameters, work, scratch, traction)
        states = carray(states, (STATE_ROWS, BLOCK))
        traction = carray(traction, (TRACTION_ROWS, BLOCK))
        scratch = carray(scratch, (SCRATCH_ROWS, BLOCK))
        for k in range(BLOCK):
            J = np.float64(states[3, k])
            put_column(scratch, k, (1.0, J, J * np.sqrt(np.float64(states[4, k]))))
        call_block(model[VOLUMETRIC], scratch[0:3], parameters, scratch[3:7])
        for k in range(BLOCK):
            a, b, U_mm = doubles_at(states, k)
            T_nn, T_nm, T_mm = doubles_at(traction, k)
            q = (scratch[5, k] - (T_nn * a + 2.0 * T_nm * b + T_mm * U_mm) / 3.0) / scratch[1, k]
            put_column(traction, k, (T_nn + q * U_mm, T_nm - q * b, T_mm + q * a))

    return compile_block_function(bond_force, bond_force_signature(np.dtype(dtype)))
