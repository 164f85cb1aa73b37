"""The bond pass of every force model that maps bond quantities to a bond force, and the sum of its pair forces."""

import numpy as np
from numba import prange

from .blocks import BLOCK, block_rows, pair_records
from .compile import call_block, inline, parallel_kernel
from .records import subtract_positions, sum_records, sum_signed_records

EXTRAPOLATE, COUNT, FALL_BACK = 0, 1, 2
"""What is done about bonds outside the domain of a surrogate: nothing, counting, or counting and the exact bond force."""

BUFFER_ROWS = 18
"""Rows of the buffer in the precision of the model: states, then the bond vector, the traction,
the exact traction, and the sums of the node records."""


@inline
def is_outside(a, b, U_mm, J, C33, limits):
    """1 for a state outside the domain, else 0.

    With J the product of the principal stretches, both lie within [low, high] exactly if J lies within [low**2, high**2] and
    tr C is at most high**2 + J**2/high**2 and low**2 + J**2/low**2: no eigenvalue is needed.  NaN is outside.

    `limits` is a tuple of low**2, high**2 and their inverses, the least and greatest J3**2 = J**2 C33, 0 and 1.
    """
    trace = a * a + b * b + b * b + U_mm * U_mm
    square = J * J
    bulk = square * C33
    inside = (
        (trace <= limits[1] + square * limits[3])
        & (trace <= limits[0] + square * limits[2])
        & (limits[0] <= J)
        & (limits[1] >= J)
        & (bulk >= limits[4])
        & (bulk <= limits[5])
        & (a > limits[6])
    )
    return limits[6] if inside else limits[7]


@parallel_kernel
def pair_forces(
    positions,
    records,
    first,
    second,
    geometry,
    n_pairs,
    bond_force,
    sizes,
    weights,
    exact_bond_force,
    response,
    parameters,
    guard,
    domain,
    buffers,
    work,
    scratch,
    outside,
    forces,
):
    """Dimensionless force on the first point of every pair.

    Each pair is evaluated once: its averaged features are the same seen from either end, so the force on the second point is the opposite.

    Parameters
    ----------
    positions : (n, 2) doubles.
    records : (n, 4) node records (cos, sin, J, C33).
    first, second : (n_blocks * BLOCK,) the pairs, padded with pairs of point 0 with itself.
    geometry : (n_blocks, 5, BLOCK) see `pdsurrogate.kernels.reference.pair_rows`.
    bond_force, sizes, weights : address of the force model's block function, and its constants.
    exact_bond_force, response, parameters : the exact bond force and the material law behind it.
    guard : EXTRAPOLATE, COUNT or FALL_BACK.
    domain : (8,) see `is_outside`.
    buffers, work, scratch : (n_chunks, rows, BLOCK), the first two in the model's precision, the last doubles.
    outside : (n_chunks,) out: pairs outside the domain.
    forces : (n_blocks * BLOCK, 2) out.
    """
    n_blocks = geometry.shape[0]
    chunks = buffers.shape[0]
    for chunk in prange(chunks):
        buffer = buffers[chunk]
        states = block_rows(buffer[0:6])
        means = block_rows(buffer[14:18])
        bond = block_rows(buffer[6:8])
        traction = block_rows(buffer[8:11])
        exact = block_rows(buffer[11:14])
        real = buffer.dtype.type
        half = real(0.5)
        # Scalars, not an array: loads from one would stand in the way of the vectoriser.
        limits = (domain[0], domain[1], domain[2], domain[3], domain[4], domain[5], domain[6], domain[7])
        count = 0
        for block in range(chunk * n_blocks // chunks, (chunk + 1) * n_blocks // chunks):
            at = block * BLOCK
            reference = block_rows(geometry[block])
            for k in range(0, BLOCK, 4):
                sum_records(records, first, second, at + k, means, k)
            for k in range(0, BLOCK, 4):
                subtract_positions(positions, first, second, at + k, bond, k)
            for k in range(BLOCK):
                # The mean of two rotations is the direction of the sum of their (cos, sin).
                c = means[0, k]
                s = means[1, k]
                norm = real(1.0) / np.sqrt(c * c + s * s)
                c = c * norm
                s = s * norm
                r1 = c * reference[0, k] - s * reference[1, k]
                r2 = s * reference[0, k] + c * reference[1, k]
                d1 = bond[0, k]
                d2 = bond[1, k]
                a = r1 * d1 + r2 * d2
                b = r1 * d2 - r2 * d1
                J = half * means[2, k]
                C33 = half * means[3, k]
                states[0, k] = a
                states[1, k] = b
                states[2, k] = (J + b * b) / a
                states[3, k] = J
                states[4, k] = C33
                states[5, k] = reference[4, k]
                bond[0, k] = r1
                bond[1, k] = r2
            call_block(bond_force, states, sizes, weights, response, parameters, work[chunk], scratch[chunk], traction)
            if guard != EXTRAPOLATE:
                size = min(BLOCK, n_pairs - at)
                # Counted in the precision of the lanes, which another width would halve.
                found = real(0.0)
                for k in range(BLOCK):
                    found += is_outside(states[0, k], states[1, k], states[2, k], states[3, k], states[4, k], limits)
                # The pairs that pad the last block are bonds of no length, and outside every domain.
                found -= real(BLOCK - size)
                if found > real(0.0):
                    count += int(found)
                    if guard == FALL_BACK:
                        call_block(exact_bond_force, states, sizes, weights, response, parameters, work[chunk], scratch[chunk], exact)
                        for k in range(BLOCK):
                            if is_outside(states[0, k], states[1, k], states[2, k], states[3, k], states[4, k], limits) > real(0.0):
                                traction[0, k] = exact[0, k]
                                traction[1, k] = exact[1, k]
                                traction[2, k] = exact[2, k]
            pair = pair_records(forces[at : at + BLOCK])
            for k in range(BLOCK):
                r1 = bond[0, k]
                r2 = bond[1, k]
                alpha = reference[2, k]
                beta = reference[3, k]
                along = alpha * traction[0, k] + beta * traction[1, k]
                across = alpha * traction[1, k] + beta * traction[2, k]
                pair[k, 0] = r1 * along - r2 * across
                pair[k, 1] = r2 * along + r1 * across
        outside[chunk] = count


@parallel_kernel
def sum_pair_forces(forces, pair_pointers, incidence_pointers, incidence, unit, out):
    """Force on every point, times `unit` (the shear modulus), summed in double precision in an order that no thread count changes."""
    for i in prange(out.shape[0]):
        sum_signed_records(
            forces,
            pair_pointers[i],
            pair_pointers[i + 1],
            incidence,
            incidence_pointers[i],
            incidence_pointers[i + 1],
            unit,
            np.uint64(i),
            out,
        )
