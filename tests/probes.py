"""Small compiled callers and plain twins of kernels."""

import numba
import numpy as np

from pdsurrogate.kernels.blocks import BLOCK, SCRATCH_ROWS, STATE_ROWS, TRACTION_ROWS
from pdsurrogate.kernels.compile import call_block


@numba.njit
def _call_response(address, states, parameters, result):
    call_block(address, states, parameters, result)


@numba.njit
def _call_bond_force(address, states, sizes, weights, response, parameters, work, scratch, traction):
    call_block(address, states, sizes, weights, response, parameters, work, scratch, traction)


def compiled_response(law, trace, area_ratio, volume_ratio):
    """The compiled stress response on vectors of any length, rows of its result."""
    n = len(trace)
    columns = []
    for at in range(0, n, BLOCK):
        states = np.ones((3, BLOCK))
        size = min(BLOCK, n - at)
        states[:, :size] = trace[at : at + size], area_ratio[at : at + size], volume_ratio[at : at + size]
        states[:, size:] = [[2.0], [1.0], [1.0]]
        result = np.zeros((5, BLOCK))
        _call_response(law.response_block().address, states, law.parameters, result)
        columns.append(result[:, :size])
    return np.hstack(columns)


def compiled_bond_force(model, law, X, dtype):
    """(t_n, t_tau) of a model's block function for rows (stretch, rotation, length, C33, J), shape (n, 2), and T_mm."""
    stretch, rotation, length, C33, J = np.asarray(X, dtype=float).T
    a, b = stretch * np.cos(rotation), stretch * np.sin(rotation)
    full = np.stack([a, b, (J + b * b) / a, J, C33, length])
    compiled = model.compiled(dtype)
    tractions = []
    for at in range(0, full.shape[1], BLOCK):
        states = np.ones((STATE_ROWS, BLOCK), dtype=dtype)
        size = min(BLOCK, full.shape[1] - at)
        states[:, :size] = full[:, at : at + size]
        states[1, size:] = 0
        traction = np.zeros((TRACTION_ROWS, BLOCK), dtype=dtype)
        work = np.zeros((max(1, compiled.work_rows), BLOCK), dtype=dtype)
        _call_bond_force(
            compiled.address,
            states,
            compiled.sizes,
            compiled.weights,
            law.response_block().address,
            law.parameters,
            work,
            np.zeros((SCRATCH_ROWS, BLOCK)),
            traction,
        )
        tractions.append(traction[:, :size])
    T_nn, T_nm, T_mm = np.hstack(tractions).astype(float)
    return np.stack([(T_nn * a + T_nm * b) / stretch, (T_nm * a - T_nn * b) / stretch], axis=1), T_mm
