"""Small compiled callers of block functions."""

import numba
import numpy as np

from pdsurrogate.kernels.block_arrays import BLOCK
from pdsurrogate.kernels.compile import call_block


@numba.njit
def _call_response(address, states, parameters, result):
    call_block(address, states, parameters, result)


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
