"""Rotation, J and C33 of every point of a sheet, with C33 from the learned bond force instead of
the law.

The principal values tau_1, tau_2, tau_3 of the isochoric Kirchhoff stress sum to zero. P33 = 0
requires tau_3 + J3 U'(J3) = 0, so that the principal values of the whole Kirchhoff stress are tau_1
- tau_3, tau_2 - tau_3 and 0. Their sum tr(T U) is -3 tau_3, and the thickness condition reads

    J3 U'(J3) = tr(T U)/3,        T = R^T P,

and the map that gives the force of a bond gives the pressure in a point as well: no second
surrogate is needed, and the error of the learned force is divided by K/mu.
"""

from ..engine.block_arrays import (
    BLOCK,
    STATE_ROWS,
    TRACTION_ROWS,
    block_rows,
    put_column,
    quad_records,
    tuple_of,
)
from ..engine.compile import call_block, widest_vectors
from ..engine.passes import Pass, share_of
from .algebra import algebra_of
from .domain import N_LIMITS, is_outside, share_inside
from .node_state import rotation, solve_volume_ratios, thickness_squared

plane = algebra_of(2)

MOST_ITERATIONS = 20
"""Greatest number of steps in the search for the volume ratio J3 with the learned force. Each step
changes J3 by at most a factor of two; where twenty, a factor of a million, do not suffice, J3 is
computed from the law.
"""

BUFFER_ROWS = STATE_ROWS + TRACTION_ROWS
"""Number of rows of the buffer in the precision of the model: bond states and tractions."""

SCRATCH_ROWS = 16
"""Number of rows of doubles: states and result of a response, the components of the stretch tensor
U in the rotated frame, three rows for the last step, its residual and slope, the last step divided
by J3, and working memory of `solve_volume_ratios`.
"""


@Pass
def surrogate_node_states(
    chunk,
    gradients,
    volume_ratios,
    volumetric,
    bond_force,
    constants,
    domain,
    tolerance,
    memory,
    records,
):
    """Compute the rotation, J and C33 of every point of a sheet from its deformation gradient, with
    C33 from the learned bond force.

    A row of `records` receives (cos, sin, J, C33) of a point. Return the number of points without a
    plane-stress state. `volume_ratios` holds J3, on entry the values of the last evaluation, on
    exit the new ones. `constants` are the sizes and weights of the learned force `bond_force`, and
    the response and parameters of the law, which serves points outside the `domain` (2, 7) of the
    learned force; in the band inside the edge of the domain J3 is blended as the bond force is.
    `tolerance` is the relative step of J3 at which the iteration ends. `memory` is, for each
    thread, a buffer that already holds the bond length, and the rows `work` and `scratch`.
    """
    _, _, response, parameters = constants
    buffers, work, scratch = memory
    n = gradients.shape[0]
    widest_vectors()
    states = block_rows(scratch[chunk.thread, 0:3])
    result = block_rows(scratch[chunk.thread, 3:8])
    frame = block_rows(scratch[chunk.thread, 8:11])
    last = block_rows(scratch[chunk.thread, 11:14])
    moved = scratch[chunk.thread, 14]
    bond = block_rows(buffers[chunk.thread, 0:6])
    traction = block_rows(buffers[chunk.thread, 6:9])
    outer = tuple_of(domain[0], N_LIMITS)
    inner = tuple_of(domain[1], N_LIMITS)
    count = 0
    for block in share_of((n + BLOCK - 1) // BLOCK, chunk):
        at = block * BLOCK
        size = min(BLOCK, n - at)
        gradient = plane.matrix_rows(gradients[at : at + size])
        J3 = volume_ratios[at : at + size]
        record = quad_records(records[at : at + size])
        for k in range(size):
            F = plane.matrix_at(gradient, k)
            c, s = rotation(F)
            record[k, 0] = c
            record[k, 1] = s
            put_column(frame, k, (c * F[0] + s * F[1], c * F[2] + s * F[3], c * F[3] - s * F[2]))
            put_column(states, k, plane.response_state(F, J3[k]))
        # States that fill up the last block are undeformed.
        for k in range(size, BLOCK):
            put_column(frame, k, (1.0, 0.0, 1.0))
            put_column(states, k, (2.0, 1.0, 1.0))
        for k in range(BLOCK):
            put_column(bond, k, (frame[0, k], frame[1, k], frame[2, k], states[1, k]))
            last[0, k] = 0.0
            moved[k] = 1.0
        largest = 1.0
        for _ in range(MOST_ITERATIONS):
            if largest < tolerance:
                break
            for k in range(BLOCK):
                bond[4, k] = thickness_squared(states, k)
            call_block(
                bond_force, bond, constants, work[chunk.thread], scratch[chunk.thread], traction
            )
            call_block(volumetric, states, parameters, result)
            largest = 0.0
            for k in range(BLOCK):
                power = (
                    traction[0, k] * frame[0, k]
                    + 2.0 * traction[1, k] * frame[1, k]
                    + traction[2, k] * frame[2, k]
                )
                residual = result[2, k] - power / 3.0
                # The slope is that of the chord over the last step, if that step was long enough,
                # else a multiple of the volumetric slope.
                plain = result[3, k]
                chord = (residual - last[1, k]) / last[0, k]
                slope = (
                    min(max(chord, 0.3 * plain), 3.0 * plain)
                    if abs(last[0, k]) > 1e-5
                    else last[2, k] * plain
                )
                slope = slope if last[0, k] != 0.0 else plain
                step = min(max(-residual / slope, -0.5 * states[2, k]), states[2, k])
                # A converged state stays as it is while others of the block go on.
                step = step if moved[k] >= tolerance else 0.0
                put_column(last, k, (step, residual, slope / plain))
                states[2, k] += step
                moved[k] = abs(step) / states[2, k]
                largest = max(largest, moved[k])
        # This first test, whether any state is near the edge, is vectorized; `last` is no longer
        # needed.
        near = 0.0
        for k in range(size):
            near += 0.0 if moved[k] < 100.0 * tolerance else 1.0
            # NaN is outside.
            near += is_outside(
                frame[0, k],
                frame[1, k],
                frame[2, k],
                states[1, k],
                thickness_squared(states, k),
                inner,
            )
        if near > 0.0:
            for k in range(size):
                C33 = thickness_squared(states, k)
                share = share_inside(
                    frame[0, k], frame[1, k], frame[2, k], states[1, k], C33, outer, inner
                )
                last[0, k] = share if moved[k] < 100.0 * tolerance else 0.0
                last[1, k] = states[2, k]
                states[2, k] = J3[k]
            count += solve_volume_ratios(
                size, states, result, scratch[chunk.thread, 15], response, parameters
            )
            for k in range(size):
                if last[0, k] == 1.0:
                    states[2, k] = last[1, k]
                elif last[0, k] > 0.0:
                    states[2, k] += last[0, k] * (last[1, k] - states[2, k])
        for k in range(size):
            J3[k] = states[2, k]
            record[k, 2] = states[1, k]
            record[k, 3] = thickness_squared(states, k)
    return count
