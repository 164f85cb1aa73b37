"""The force pass of non-ordinary state-based peridynamics (correspondence), paper Eqs. (2) and (19)."""

import numpy as np
from numba import prange

from .blocks import BLOCK, block_rows, quad_records, triple_records
from .compile import call_block, parallel_kernel, widest_vectors
from .elementary import not_finite
from .records import sum_matrix_products


@parallel_kernel
def weighted_stresses(gradients, volume_ratios, inverse_shape, unit, response, parameters, scratch, stresses):
    """P K^-1 of every point, as records (11, 21, 12, 22)."""
    n = gradients.shape[0]
    n_blocks = (n + BLOCK - 1) // BLOCK
    chunks = scratch.shape[0]
    for chunk in prange(chunks):
        widest_vectors()
        states = block_rows(scratch[chunk, 0:3])
        result = block_rows(scratch[chunk, 3:8])
        for block in range(chunk * n_blocks // chunks, (chunk + 1) * n_blocks // chunks):
            at = block * BLOCK
            size = min(BLOCK, n - at)
            F = quad_records(gradients[at : at + size])
            J3 = volume_ratios[at : at + size]
            Z = triple_records(inverse_shape[at : at + size])
            stress = quad_records(stresses[at : at + size])
            for k in range(size):
                states[0, k] = F[k, 0] * F[k, 0] + F[k, 1] * F[k, 1] + F[k, 2] * F[k, 2] + F[k, 3] * F[k, 3]
                states[1, k] = F[k, 0] * F[k, 3] - F[k, 1] * F[k, 2]
                states[2, k] = J3[k]
            call_block(response, states, parameters, result)
            for k in range(size):
                # P = p F + q F^-T
                p = result[0, k] * unit
                q = result[1, k] / states[1, k] * unit
                P11 = p * F[k, 0] + q * F[k, 3]
                P21 = p * F[k, 1] - q * F[k, 2]
                P12 = p * F[k, 2] - q * F[k, 1]
                P22 = p * F[k, 3] + q * F[k, 0]
                Z11 = Z[k, 0]
                Z12 = Z[k, 1]
                Z22 = Z[k, 2]
                stress[k, 0] = P11 * Z11 + P12 * Z12
                stress[k, 1] = P21 * Z11 + P22 * Z12
                stress[k, 2] = P11 * Z12 + P12 * Z22
                stress[k, 3] = P21 * Z12 + P22 * Z22


@parallel_kernel
def correspondence_forces(stresses, pointers, neighbours, weighted_bonds, volumes, out):
    """Force on every point: sum over j of (P_i K_i^-1 + P_j K_j^-1) w x V_i V_j; returns the number of points where it is not finite."""
    strange = 0
    for i in prange(out.shape[0]):
        sum_matrix_products(stresses, neighbours, weighted_bonds, pointers[i], pointers[i + 1], np.uint64(i), out)
        out[i, 0] *= volumes[i]
        out[i, 1] *= volumes[i]
        strange += not_finite(out[i, 0], out[i, 1])
    return strange
