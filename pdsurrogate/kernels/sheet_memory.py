"""Branches and softening of the pairs of a sheet under plane stress, theory (99), (100).

The thickness of a pair follows from the sum of all stresses: a first pass finds the volume ratio J3
at which the energy of the step is least, and forces are the derivatives at this J3. All is in
double precision, whatever the precision of the forces.
"""

import numpy as np

from ..engine.block_arrays import (
    BLOCK,
    block_rows,
    put_column,
    rows_from,
)
from ..engine.compile import call_block, inline, inlined, widest_vectors
from ..engine.passes import Pass, share_of
from ..engine.vector_loads import fetch
from .algebra import algebra_of
from .bond_energy import COLLAPSED
from .branches import tensors_of
from .elementary import inverse_cube_root
from .node_state import MOST_ITERATIONS, limited_step
from .selective_energy import gradient_of_bond, parts_of_stress
from .softening import soften, softening_factor
from .sums import counted_at, visits_of

plane = algebra_of(2)
tensors = tensors_of(2)
of_bond = gradient_of_bond(plane)
put_parts = parts_of_stress(plane)
fetch_steps = fetch(4 * tensors.STEP)

TENSOR = tensors.TENSOR
STATES = plane.MATRIX + plane.DIMENSION
RESULT = STATES + 3
ISOCHORIC = RESULT + 5
STRAINS = ISOCHORIC + 5
ADDED = STRAINS + TENSOR
KNOWN = ADDED + TENSOR + 2
BUFFER_ROWS = KNOWN + 5
"""First rows of the parts of a thread's buffer, and its number of rows. Gradients and bond vectors
begin at row 0; states (tr C, J, J3), the response of the law, its isochoric part, C of the plane
with J^2, and what branches add follow. The last rows are residual, inverse slope and J3 of the
iteration before, 1 once J3 is found, and 1/J^2.
"""

LAST_STEP = 1e-7
"""Greatest last relative step of J3: the error is about its square."""

ERROR = 1e-11
"""Relative error of J3, estimated from the last two terms of an interpolation, at which the search
ends. Chosen: forces have about the error of this times the shear modulus, and sums of forces in
double precision round no less in a body of some 10^4 points.
"""


@inlined
def across_of_step(B, b, C, area, factors):
    """Return the first and second derivatives of W_step by log J3, of a branch of modulus 1.

    `C` is that of the plane, `area` its determinant J^2; `factors` are s and z of Cb = s C in the
    plane and Cb33 = z. det(B + b Cb) is the product of a determinant in the plane and the entry
    across it.
    """
    s, z = factors
    linear = B[2] * C[0] - 2.0 * B[1] * C[1] + B[0] * C[2]
    square = b * s * area
    within = B[0] * B[2] - B[1] * B[1] + b * s * (linear + square)
    across = B[3] + b * z
    work = s * (linear + 2.0 * square)
    slope = 2.0 * z * within - across * work
    bend = 8.0 * z * (within - b * work) + 2.0 * across * s * (linear + 4.0 * square)
    r = inverse_cube_root(within * across)
    first = r * r * slope * (1.0 / 3.0)
    return first, r * (r * bend * (1.0 / 9.0) - (4.0 / 3.0) * b * first * first)


@inlined
def interpolated_step(residual, slope, J3, before):
    """Return the step by which J3 must decrease, 1/slope, and an estimate of the relative error of
    J3 after it.

    `before` are residual, 1/slope and J3 of the iteration before. Once the residual has fallen by
    half, the step comes from the cubic of J3 by the residual that has both values and slopes, and
    its error is of fourth order; else it is Newton's, of infinite error.
    """
    inverse = 1.0 / slope
    over = 1.0 / (residual - before[0])
    chord = (J3 - before[2]) * over
    second = (inverse - chord) * over
    third = (second - (chord - before[1]) * over) * over
    second = second * residual * residual
    third = third * residual * residual * before[0]
    falls = (abs(residual) < 0.5 * abs(before[0])) & (slope > 0.0)
    step = residual * inverse
    step = step - second + third if falls else step
    moves = (1.0 - before[2] / J3) * (step / J3)
    error = 4.0 * moves * moves + abs(third * third / (second * J3))
    return step, inverse, error if falls else np.inf


@inlined
def parts_of(sums):
    """Return the parts of a thread's buffer after the first, in the order of their rows."""
    return (
        rows_from(sums, plane.MATRIX),
        rows_from(sums, STATES),
        rows_from(sums, RESULT),
        rows_from(sums, ISOCHORIC),
        rows_from(sums, STRAINS),
        rows_from(sums, ADDED),
        rows_from(sums, KNOWN),
    )


@inline
def find_states(sums, reference, law, memory, steps):
    """Compute the gradients of the pairs of a block and their states, with the J3 at which the
    stress across the sheet vanishes, NaN if there is none, in the rows of a thread's buffer.

    `sums` are the sums of the gradients of both points, `law` and `memory` as in `pair_energies`,
    and `steps` the coefficients of the block.
    """
    bonds, states, result, part, strains, added, known = parts_of(sums)
    response, isochoric, parameters = law
    moduli, softening, _ = memory
    kinked = softening.shape[0] > 0
    for k in range(BLOCK):
        F = of_bond(sums, bonds, reference, k)
        state = plane.response_state(F, 1.0)
        C = tensors.green(F, 1.0)
        put_column(sums, k, F)
        put_column(states, k, state)
        put_column(strains, k, (C[0], C[1], C[2], state[1] * state[1]))
        put_column(known, k, (0.0, 0.0, 0.0, 0.0, 1.0 / strains[3, k]))
    for _ in range(MOST_ITERATIONS):
        call_block(response, states, parameters, result)
        if kinked:
            greatest = rows_from(steps, moduli.shape[0] * tensors.STEP)
            call_block(isochoric, states, parameters, part)
            for k in range(BLOCK):
                eta, slope = softening_factor(part[3, k], greatest[0, k], softening)
                across = part[2, k]
                result[2, k] += (eta - 1.0) * across
                result[3, k] += (eta - 1.0) * part[4, k] + slope * across * across / states[2, k]
        if moduli.shape[0] > 0:
            for k in range(BLOCK):
                J3 = states[2, k]
                r = inverse_cube_root(J3)
                s = r * r
                put_column(added, k, (s, s * J3 * J3 * known[4, k], 0.0, 0.0, r * s))
            for branch in range(moduli.shape[0]):
                step = rows_from(steps, branch * tensors.STEP)
                weight = moduli[branch]
                for k in range(BLOCK):
                    first, second = across_of_step(
                        *tensors.step_in(step, k, 1.0),
                        tensors.tensor_at(strains, k),
                        strains[3, k],
                        (added[0, k], added[1, k]),
                    )
                    added[2, k] += weight * first
                    added[3, k] += weight * second
            for k in range(BLOCK):
                result[2, k] += added[2, k]
                result[3, k] += added[3, k] * added[4, k]
        unsettled = 0.0
        for k in range(BLOCK):
            residual, slope, J3 = result[2, k], result[3, k], states[2, k]
            before = known[0, k], known[1, k], known[2, k]
            step, inverse, error = interpolated_step(residual, slope, J3, before)
            if kinked:
                step = residual * inverse
                error = np.inf
            found = known[3, k]
            settled = (error <= ERROR) | ((abs(step) <= LAST_STEP * J3) & (slope > 0.0))
            settled = 1.0 if settled else found
            put_column(known, k, (residual, inverse, J3, settled))
            # A settled pair stays as it is while others of its block go on.
            states[2, k] -= 0.0 if found > 0.0 else limited_step(step, residual, slope, J3)
            unsettled += 1.0 - settled
        if unsettled == 0.0:
            break
    for k in range(BLOCK):
        solved = (known[3, k] > 0.0) & (states[1, k] > 0.0)
        states[2, k] = states[2, k] if solved else np.nan


@Pass
def pair_volumes(chunk, positions, gradients, pairs, law, memory, buffers, volumes):
    """Compute the volume ratio J3 of every pair of points, at which the stress across the sheet
    vanishes; NaN if there is none.
    """
    ends, geometry = pairs
    coefficients = memory[2]
    widest_vectors()
    sums = block_rows(buffers[chunk.thread])
    bonds = rows_from(sums, plane.MATRIX)
    states = rows_from(sums, STATES)
    for block in share_of(geometry.shape[0], chunk):
        at = block * BLOCK
        for k in range(0, BLOCK, 4):
            plane.gather_pairs(gradients, positions, ends, at + k, sums, bonds, k)
        find_states(sums, block_rows(geometry[block]), law, memory, block_rows(coefficients[block]))
        found = volumes[at : at + BLOCK]
        for k in range(BLOCK):
            found[k] = states[2, k]
    return 0


@Pass
def pair_energies(
    chunk,
    positions,
    gradients,
    pairs,
    law,
    memory,
    buffers,
    results,
):
    """Compute the energy, the force and the moment of every pair, see `bond_energy.pair_energies`.

    `pairs` are the numbers of the first and second points, and their geometry. `law` are the
    addresses of the law's response under plane stress and of its isochoric part, which softening
    needs, and its parameters. `memory` are the moduli of the branches over the shear modulus, the
    parameters of softening or none, and the coefficients of `selective_memory.begin_steps`. The
    results are: `counts`, of which the first column stays as it is; energies of visits of which
    forces and moments are the derivatives, and those that are stored; the walk that sums forces and
    moments.
    """
    ends, geometry = pairs
    moduli, softening, coefficients = memory
    response, isochoric, parameters = law
    counts, energies, stored, walk = results
    blocks, all_lanes, _, rows_of_ends, sums_at_ends = walk
    widest_vectors()
    sums = block_rows(buffers[chunk.thread])
    bonds, states, result, part, strains, added, known = parts_of(sums)
    counted = geometry.shape[1] - 1
    modulus = 0.0
    for branch in range(moduli.shape[0]):
        modulus += moduli[branch]
    small = 0
    bad = 0
    for visit in visits_of(walk, chunk):
        block = np.int64(blocks[visit])
        lanes = all_lanes[visit, 0], all_lanes[visit, 1]
        at = block * BLOCK
        reference = block_rows(geometry[block])
        steps = block_rows(coefficients[block])
        for k in range(0, BLOCK, 4):
            plane.gather_pairs(gradients, positions, ends, at + k, sums, bonds, k)
        find_states(sums, reference, law, memory, steps)
        few = 0.0
        for k in range(BLOCK):
            J3 = states[2, k]
            r = inverse_cube_root(J3)
            s = r * r
            put_column(added, k, (0.0, 0.0, 0.0, 0.0, s, s * J3 * J3 * known[4, k]))
            # NaN is counted, too.
            few += 0.0 if states[1, k] > COLLAPSED else 1.0
        if few > 0.0:
            for k in range(lanes[0], lanes[1]):
                small += 0 if states[1, k] > COLLAPSED else 1
                bad += 0 if states[1, k] > 0.0 else 1
        call_block(response, states, parameters, result)
        # Rows 2 and 3 are no longer needed: they hold the stored energy and the potential.
        for k in range(BLOCK):
            result[2, k] = result[4, k]
            result[3, k] = result[4, k]
        if softening.shape[0] > 0:
            before = rows_from(steps, moduli.shape[0] * tensors.STEP)
            call_block(isochoric, states, parameters, part)
            for k in range(BLOCK):
                eta, potential, rest = soften(part[3, k], before[0, k], before[1, k], softening)
                result[0, k] *= eta
                result[1, k] *= eta
                result[2, k] += rest - part[3, k]
                result[3, k] += potential - part[3, k]
        total = 0.0
        for branch in range(moduli.shape[0]):
            step = rows_from(steps, branch * tensors.STEP)
            weight = moduli[branch]
            for k in range(BLOCK):
                s = added[4, k]
                Cb = s * strains[0, k], s * strains[1, k], s * strains[2, k], added[5, k]
                B, b = tensors.step_in(step, k, 1.0)
                M, gained = tensors.take_step(B, b, Cb)
                put_column(added, k, tensors.combined(tensors.tensor_at(added, k), weight, M))
                total += counted_at(reference, counted, lanes, k) * (weight * gained)
        kept = 0.0
        for k in range(BLOCK):
            F = plane.matrix_column_at(sums, k)
            V = np.float64(reference[3, k])
            M = tensors.tensor_at(added, k)
            s, z = added[4, k], added[5, k]
            C = tensors.tensor_at(strains, k)
            mean = s * (M[0] * C[0] + 2.0 * M[1] * C[1] + M[2] * C[2]) + z * M[3]
            # As in (7) the pressure is eliminated by the stress across the sheet, which is zero.
            state = states[0, k], states[1, k], states[2, k]
            P = plane.first_piola(F, state, (result[0, k], result[1, k] - M[3] * z), V)
            P = plane.plus_matrix(P, plane.times_matrix(V * s, tensors.gradient_times(F, M)))
            total += counted_at(reference, counted, lanes, k) * result[3, k]
            kept += counted_at(reference, counted, lanes, k) * (
                result[2, k] + 0.5 * (mean - 3.0 * modulus)
            )
            put_parts(bonds, sums, reference, k, P)
        plane.add_at_ends(sums, bonds, rows_of_ends, visit * BLOCK, sums_at_ends)
        for k in range(0, BLOCK, 4):
            row = (block + 1) * coefficients.shape[1] * BLOCK
            for branch in range(moduli.shape[0]):
                fetch_steps(coefficients, row + (branch * BLOCK + k) * tensors.STEP)
        energies[visit] = total
        stored[visit] = kept
    counts[chunk.number, 1] = small
    counts[chunk.number, 2] = bad
    return 0
