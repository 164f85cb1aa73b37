"""The force pass of non-ordinary state-based peridynamics (correspondence), paper Eqs. (2) and (19)."""

import numpy as np
from numba import prange

from .blocks import BLOCK, block_rows
from .compile import call_block, parallel_kernel
from .records import sum_matrix_products


@parallel_kernel
def weighted_stresses(gradients, volume_ratios, inverse_shape, unit, response, parameters, scratch, stresses):
    """P K^-1 of every point, as records (11, 21, 12, 22)."""
    n = gradients.shape[0]
    n_blocks = (n + BLOCK - 1) // BLOCK
    chunks = scratch.shape[0]
    for chunk in prange(chunks):
        states = block_rows(scratch[chunk, 0:3])
        result = block_rows(scratch[chunk, 3:8])
        for block in range(chunk * n_blocks // chunks, (chunk + 1) * n_blocks // chunks):
            at = block * BLOCK
            size = min(BLOCK, n - at)
            for k in range(size):
                F11 = gradients[at + k, 0]
                F21 = gradients[at + k, 1]
                F12 = gradients[at + k, 2]
                F22 = gradients[at + k, 3]
                states[0, k] = F11 * F11 + F21 * F21 + F12 * F12 + F22 * F22
                states[1, k] = F11 * F22 - F12 * F21
                states[2, k] = volume_ratios[at + k]
            call_block(response, states, parameters, result)
            for k in range(size):
                # P = p F + q F^-T
                p = result[0, k] * unit
                q = result[1, k] / states[1, k] * unit
                P11 = p * gradients[at + k, 0] + q * gradients[at + k, 3]
                P21 = p * gradients[at + k, 1] - q * gradients[at + k, 2]
                P12 = p * gradients[at + k, 2] - q * gradients[at + k, 1]
                P22 = p * gradients[at + k, 3] + q * gradients[at + k, 0]
                Z11 = inverse_shape[at + k, 0]
                Z12 = inverse_shape[at + k, 1]
                Z22 = inverse_shape[at + k, 2]
                stresses[at + k, 0] = P11 * Z11 + P12 * Z12
                stresses[at + k, 1] = P21 * Z11 + P22 * Z12
                stresses[at + k, 2] = P11 * Z12 + P12 * Z22
                stresses[at + k, 3] = P21 * Z12 + P22 * Z22


@parallel_kernel
def correspondence_forces(stresses, pointers, neighbours, weighted_bonds, volumes, out):
    """Force on every point: sum over j of (P_i K_i^-1 + P_j K_j^-1) w x V_i V_j."""
    for i in prange(out.shape[0]):
        sum_matrix_products(stresses, neighbours, weighted_bonds, pointers[i], pointers[i + 1], np.uint64(i), out)
        out[i, 0] *= volumes[i]
        out[i, 1] *= volumes[i]
