"""State of every point from its deformation gradient: rotation, J, and C33 by the plane-stress condition."""

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows, quad_records
from ..engine.compile import call_block, inline, widest_vectors
from ..engine.passes import Pass, share_of
from .by_dimension import ByDimension
from .elementary import inverse_square_root

MOST_ITERATIONS = 40

SWELLING = 0.02
"""Relative growth of J3 in an iteration in which J3 is below the least that the law allows."""


@inline
def solve_volume_ratios(n, states, result, last, response, parameters, last_step=1e-8):
    """Solve P33 = 0 for J3 by Newton's method, in place in ``states[2]``, for the first n states of a block.

    Return the number of states without a solution. Each state ends with a relative step below `last_step`; convergence is quadratic, so the
    error is about its square. `result` holds the response before that step. A converged state waits for the others of its block, so its
    result depends on nothing but itself, to the last bit. `last` is a row of working memory. The residual is J3 dPsi/dJ3, whose slope is
    about the bulk modulus: from the J3 of the last evaluation one step reaches rounding, and a second confirms it.
    """
    for _ in range(MOST_ITERATIONS):
        call_block(response, states, parameters, result)
        beyond = -np.inf
        for k in range(n):
            J3 = states[2, k]
            step = result[2, k] / result[3, k]
            # For a negative slope or a large step J3 is halved or doubled, which keeps it positive from any start.
            step = step if result[3, k] > 0.0 else np.copysign(J3, result[2, k])
            step = min(max(step, -J3), 0.5 * J3)
            # NaN: the chains of the law are overstretched at this J3, which a larger volume may relieve.
            step = step if result[2, k] == result[2, k] else -SWELLING * J3
            left = abs(step) - last_step * J3
            last[k] = step if left < 0.0 else 0.0
            states[2, k] = J3 - (0.0 if left < 0.0 else step)
            beyond = max(beyond, left)
        if beyond < 0.0:
            break
    for k in range(n):
        states[2, k] -= last[k]
    unsolved = 0
    for k in range(n):
        # NaN fails both comparisons.
        solved = states[0, k] < np.inf and abs(result[2, k]) <= 1e-5 * result[3, k] and states[1, k] > 0.0
        unsolved += 0 if solved else 1
    return unsolved


@ByDimension
def volume_ratios(algebra):
    """Build the pass that computes det F of every point, for models that need nothing else of a point's state."""

    @Pass
    def volume_ratios(chunk, chunks, gradients, volume_ratios):
        """Compute det F of every point from F by columns; return the number of points with det F <= 0 or non-finite F."""
        widest_vectors()
        start, stop = share_of(gradients.shape[0], chunk, chunks)
        F = algebra.matrix_rows(gradients[start:stop])
        J = volume_ratios[start:stop]
        count = 0
        for k in range(stop - start):
            gradient = algebra.matrix_at(F, k)
            J[k] = algebra.determinant(gradient)
            # NaN fails both comparisons.
            count += 0 if (J[k] > 0.0) & (algebra.squared_norm(gradient) < np.inf) else 1
        return count

    return volume_ratios


@Pass
def held_states(chunk, chunks, gradients, volume_ratios, records):
    """Write the points' records with the thickness held fixed, C33 = 1 and J3 = J.

    Return the number of points with det F <= 0 or non-finite F.
    """
    widest_vectors()
    start, stop = share_of(gradients.shape[0], chunk, chunks)
    F = quad_records(gradients[start:stop])
    J3 = volume_ratios[start:stop]
    record = quad_records(records[start:stop])
    count = 0
    for k in range(stop - start):
        trace = F[k, 0] * F[k, 0] + F[k, 1] * F[k, 1] + F[k, 2] * F[k, 2] + F[k, 3] * F[k, 3]
        J = F[k, 0] * F[k, 3] - F[k, 1] * F[k, 2]
        c = F[k, 0] + F[k, 3]
        s = F[k, 1] - F[k, 2]
        norm = inverse_square_root(c * c + s * s)
        J3[k] = J
        record[k, 0] = c * norm
        record[k, 1] = s * norm
        record[k, 2] = J
        record[k, 3] = 1.0
        # NaN fails both comparisons.
        count += 0 if (J > 0.0) & (trace < np.inf) else 1
    return count


@Pass
def node_states(thread, chunk, chunks, gradients, volume_ratios, response, parameters, scratch, records):
    """Write the points' records (cos, sin, J, C33) from F (11, 21, 12, 22), with C33 from the law.

    Return the number of points with det F <= 0, non-finite F or no plane-stress state. `volume_ratios` holds J3, the last values on entry
    and the new ones on exit.
    """
    n = gradients.shape[0]
    widest_vectors()
    first_block, last_block = share_of((n + BLOCK - 1) // BLOCK, chunk, chunks)
    states = block_rows(scratch[thread, 0:3])
    result = block_rows(scratch[thread, 3:8])
    count = 0
    for block in range(first_block, last_block):
        at = block * BLOCK
        size = min(BLOCK, n - at)
        # Slices are used because the compiler would test an index at + k for a negative value, which prevents vectorisation.
        F = quad_records(gradients[at : at + size])
        J3 = volume_ratios[at : at + size]
        record = quad_records(records[at : at + size])
        for k in range(size):
            states[0, k] = F[k, 0] * F[k, 0] + F[k, 1] * F[k, 1] + F[k, 2] * F[k, 2] + F[k, 3] * F[k, 3]
            states[1, k] = F[k, 0] * F[k, 3] - F[k, 1] * F[k, 2]
            states[2, k] = J3[k]
        count += solve_volume_ratios(size, states, result, scratch[thread, 8], response, parameters)
        for k in range(size):
            J3[k] = states[2, k]
        # All four entries are written at once; written one by one they would be scattered.
        for k in range(size):
            thickness = states[2, k] / states[1, k]
            c = F[k, 0] + F[k, 3]
            s = F[k, 1] - F[k, 2]
            norm = inverse_square_root(c * c + s * s)
            record[k, 0] = c * norm
            record[k, 1] = s * norm
            record[k, 2] = states[1, k]
            record[k, 3] = thickness * thickness
    return count
