"""Deformation gradient of every point, and the state that follows from the gradient: rotation,
J, and C33 at plane stress.
"""

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows, put_column, put_row, quad_records
from ..engine.compile import call_block, inline, inlined, widest_vectors
from ..engine.passes import Pass, share_of
from .algebra import ByDimension, algebra_of
from .elementary import inverse_square_root

plane = algebra_of(2)

MOST_ITERATIONS = 40
"""Greatest number of Newton steps in the search for the volume ratio J3. Each step changes J3 by at
most a factor of two, so that forty reach a value 10^12 times as large or small as the first.
"""

SWELLING = 0.02
"""Relative growth of the volume ratio J3 in an iteration that begins below the least J3 for which
the law has a response. Chosen: `MOST_ITERATIONS` such iterations more than double J3; a greater
growth would carry states just below the least J3 farther beyond it.
"""


@ByDimension
def deformation_gradients(algebra):
    """Build the pass that computes the deformation gradient F of every point, paper (20)."""

    @Pass
    def deformation_gradients(
        chunk,
        positions,
        pointers,
        starts,
        ways,
        weighted_bonds,
        inverse_shape,
        unsupported,
        gradients,
    ):
        """Compute the deformation gradient F of every point, by columns.

        Where the bonds of a point do not span the plane or space, the point carries no stress, and
        F is `unsupported` times I: 1 for a deformation gradient, 0 for a change of F. The weights
        of a point's bonds, and the ways to their second ends, begin at its place in `starts`.
        """
        for i in share_of(pointers.shape[0] - 1, chunk):
            bonds = starts[i], starts[i] + pointers[i + 1] - pointers[i]
            algebra.sum_outer_products(positions, ways, weighted_bonds, bonds, i, gradients)
            Z = algebra.symmetric_at(inverse_shape, i)
            F = algebra.times_symmetric(algebra.matrix_at(gradients, i), Z)
            algebra.put(gradients, i, algebra.plus_diagonal(F, unsupported if Z[0] == 0.0 else 0.0))

    return deformation_gradients


@inlined
def limited_step(step, residual, slope, J3):
    """Return the decrease of J3 that replaces a step where it would leave the range of the law."""
    # For a negative slope or a large step J3 is halved or doubled, which keeps it positive from any
    # start.
    step = step if slope > 0.0 else np.copysign(J3, residual)
    step = min(max(step, -J3), 0.5 * J3)
    # NaN: the chains of the law are overstretched at this J3, which a larger volume may relieve.
    return step if residual == residual else -SWELLING * J3


@inline
def solve_volume_ratios(n, states, result, last, response, parameters, last_step=1e-8):
    """Solve P33 = 0 for the volume ratio J3 by Newton's method, in place in ``states[2]``, for the
    first n states of a block.

    The rows of `states` are tr C and J in the plane, and J3. Return the number of states without a
    solution. Each state ends with a relative step below `last_step`; convergence is quadratic, so
    the error is about the square of that step. `result` holds the response before the last step. A
    converged state takes no further steps while other states of its block do, so that its J3 does
    not depend on them. `last` is a row of working memory. The residual is J3 dPsi/dJ3, whose slope
    is about the bulk modulus: from the J3 of the last evaluation one step reaches rounding, and a
    second confirms it.
    """
    for _ in range(MOST_ITERATIONS):
        call_block(response, states, parameters, result)
        beyond = -np.inf
        for k in range(n):
            J3 = states[2, k]
            step = result[2, k] / result[3, k]
            step = limited_step(step, result[2, k], result[3, k], J3)
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
        solved = (
            states[0, k] < np.inf
            and abs(result[2, k]) <= 1e-5 * result[3, k]
            and states[1, k] > 0.0
        )
        unsolved += 0 if solved else 1
    return unsolved


@inlined
def thickness_squared(states, k):
    """Return C33 = (J3/J)^2, the squared thickness stretch, of state k of a block; the rows of
    `states` are tr C, J and J3.
    """
    thickness = states[2, k] / states[1, k]
    return thickness * thickness


@inlined
def rotation(F):
    """Return the cosine and the sine of the rotation in a plane deformation gradient F (11, 21,
    12, 22).
    """
    c = F[0] + F[3]
    s = F[1] - F[2]
    norm = inverse_square_root(c * c + s * s)
    return c * norm, s * norm


@ByDimension
def held_states(algebra):
    """Build the pass that computes the state of every point of a solid, or of a sheet in plane
    strain, where J3 = det F.
    """
    sheet = algebra.DIMENSION == 2

    @Pass
    def held_states(chunk, gradients, volume_ratios, records):
        """Write det F of every point into `volume_ratios`; return the number of points with det F
        <= 0 or non-finite F.

        `gradients` holds F by columns. In a sheet `records` receives the rotation, J = det F and
        C33 = 1 of every point, (cos, sin, J, 1); for a solid it is not written.
        """
        widest_vectors()
        share = share_of(gradients.shape[0], chunk)
        F = algebra.matrix_rows(gradients[share.start : share.stop])
        J3 = volume_ratios[share.start : share.stop]
        record = quad_records(records[share.start : share.stop])
        count = 0
        for k in range(len(share)):
            gradient = algebra.matrix_at(F, k)
            J = algebra.determinant(gradient)
            J3[k] = J
            if sheet:
                c, s = rotation(gradient)
                put_row(record, k, (c, s, J, 1.0))
            # NaN fails both comparisons.
            count += 0 if (J > 0.0) & (algebra.squared_norm(gradient) < np.inf) else 1
        return count

    return held_states


@Pass
def node_states(chunk, gradients, volume_ratios, response, parameters, scratch, records):
    """Compute the rotation, J and C33 of every point of a sheet from its deformation gradient F
    (11, 21, 12, 22), with C33 from the law.

    A row of `records` receives (cos, sin, J, C33) of a point. Return the number of points with det
    F <= 0, non-finite F or no plane-stress state. `volume_ratios` holds J3, on entry the values of
    the last evaluation, on exit the new ones.
    """
    n = gradients.shape[0]
    widest_vectors()
    states = block_rows(scratch[chunk.thread, 0:3])
    result = block_rows(scratch[chunk.thread, 3:8])
    count = 0
    for block in share_of((n + BLOCK - 1) // BLOCK, chunk):
        at = block * BLOCK
        size = min(BLOCK, n - at)
        # Slices are used because the compiler would test an index at + k for a negative value,
        # which prevents vectorization.
        F = plane.matrix_rows(gradients[at : at + size])
        J3 = volume_ratios[at : at + size]
        record = quad_records(records[at : at + size])
        for k in range(size):
            put_column(states, k, plane.response_state(plane.matrix_at(F, k), J3[k]))
        count += solve_volume_ratios(
            size, states, result, scratch[chunk.thread, 8], response, parameters
        )
        for k in range(size):
            J3[k] = states[2, k]
        # All four entries are written at once; written one by one they would be scattered.
        for k in range(size):
            c, s = rotation(plane.matrix_at(F, k))
            put_row(record, k, (c, s, states[1, k], thickness_squared(states, k)))
    return count
