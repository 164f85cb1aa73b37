"""Small compiled callers of block functions."""

import numba
import numpy as np

from pdsurrogate.kernels.block_arrays import BLOCK
from pdsurrogate.kernels.compile import call_block
from pdsurrogate.materials import plane_stress


@numba.njit
def _call_response(address, states, parameters, result):
    call_block(address, states, parameters, result)


def compiled_response(law, *state, response=plane_stress.response):
    """A compiled response on vectors of any length, rows of its result."""
    n = len(state[0])
    columns = []
    for at in range(0, n, BLOCK):
        size = min(BLOCK, n - at)
        states = np.stack([np.pad(values[at : at + size], (0, BLOCK - size), "edge") for values in state])
        result = np.zeros((response.rows, BLOCK))
        _call_response(response.block(law).address, states, law.parameters, result)
        columns.append(result[:, :size])
    return np.concatenate(columns, axis=1)
