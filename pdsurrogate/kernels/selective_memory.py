"""Branches and softening of the isochoric energy of the bonds: passes of a selective energy with
memory, theory (91)-(97).

Trials read the coefficients of their steps, which `begin_steps` computes from the history once for
a step in time, and `accept_steps` adds an accepted state to the history.
"""

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows, put_column, rows_from
from ..engine.compile import inlined, widest_vectors
from ..engine.passes import Pass, share_of
from ..engine.vector_loads import fetch
from .algebra import ByDimension
from .branches import tensors_of
from .elementary import inverse_cube_root, like
from .selective_energy import (
    RESULT_ROWS,
    STATE_ROWS,
    buffer_rows,
    evaluate_isochoric_energy,
    gradient_of_bond,
    parts_of_stress,
    pressure_of,
    rest_state,
)
from .softening import soften, softening_loss
from .sums import counted_at, rest_others, visits_of


def memory_rows(dimension: int) -> int:
    """Return the number of rows of a thread's buffer for a pass with memory: states and results of
    `selective_energy`, four tensors, and two numbers.
    """
    return buffer_rows(dimension) + 4 * tensors_of(dimension).TENSOR + 2


@inlined
def put_durations(passed, block, branch, h, durations):
    """Write the relaxation times that pass in a step, `h` or those `passed`, to a row."""
    for k in range(BLOCK):
        durations[0, k] = h
    if passed.shape[0] > 0:
        for k in range(BLOCK):
            durations[0, k] = passed[block, branch, k]


@ByDimension
def begin_steps(algebra):
    """Build the pass that computes the coefficients of the branches for trials at a time."""
    tensors = tensors_of(algebra.DIMENSION)
    tensor = tensors.TENSOR

    @Pass
    def begin_steps(
        chunk,
        elapsed,
        ratio,
        unit,
        pairs,
        times,
        passed,
        softening,
        greatest_b,
        history,
        buffers,
        coefficients,
    ):
        """Write (B, b) of every branch and, with softening, the greatest energy of every pair and
        what it has dissipated to `coefficients` (n_blocks, rows, BLOCK).

        `pairs` are the numbers of the pairs in the `history`, C_k of the branches, Cb, the greatest
        energies, dissipated energies, which are not read, and Cb before; they fill blocks, to which
        any number may be added. The step is `ratio` times as long as the one before, 0 if this does
        not count, and negative for a straight step. `passed` are the relaxation times that pass,
        see `rates`, empty for branches of constant times. `greatest_b` bounds b, and energies of
        the history are divided by `unit`.
        """
        states, strains, greatest, _, all_earlier = history
        widest_vectors()
        C_k = block_rows(buffers[chunk.thread])
        Cb = rows_from(C_k, tensor)
        earlier = rows_from(Cb, tensor)
        durations = rows_from(earlier, tensor)
        for block in share_of(coefficients.shape[0], chunk):
            at = block * BLOCK
            into = block_rows(coefficients[block])
            if times.shape[0] > 0:
                for k in range(0, BLOCK, 4):
                    tensors.take_listed(strains, tensor, pairs, at + k, 0, Cb, k)
                    if ratio >= 0.0:
                        tensors.take_listed(all_earlier, tensor, pairs, at + k, 0, earlier, k)
            for branch in range(times.shape[0]):
                h = elapsed / times[branch]
                place = branch * tensor
                for k in range(0, BLOCK, 4):
                    tensors.take_listed(states, states.shape[1], pairs, at + k, place, C_k, k)
                found = rows_from(into, branch * tensors.STEP)
                put_durations(passed, block, branch, h, durations)
                # Loops with one kind of step each, which are vectorized.
                if ratio >= 0.0:
                    for k in range(BLOCK):
                        state = tensors.tensor_at(C_k, k), tensors.tensor_at(Cb, k)
                        before = tensors.tensor_at(earlier, k)
                        B, b = tensors.begin_curved_step(*state, durations[0, k], before, ratio)
                        put_column(found, k, (*tensors.kept_of(B), min(b, greatest_b)))
                else:
                    for k in range(BLOCK):
                        state = tensors.tensor_at(C_k, k), tensors.tensor_at(Cb, k)
                        B, b = tensors.begin_step(*state, durations[0, k])
                        put_column(found, k, (*tensors.kept_of(B), min(b, greatest_b)))
            if softening.shape[0] > 0:
                known = rows_from(into, times.shape[0] * tensors.STEP)
                for k in range(BLOCK):
                    known[0, k] = greatest[pairs[at + k]] / unit
                for k in range(BLOCK):
                    known[1, k] = softening_loss(known[0, k], softening)

    return begin_steps


@ByDimension
def pair_energies(algebra):
    """Build the pass that computes energies, forces and moments of pairs with memory."""
    tensors = tensors_of(algebra.DIMENSION)
    of_bond = gradient_of_bond(algebra)
    put_parts = parts_of_stress(algebra)
    tensor = tensors.TENSOR
    matrix = algebra.MATRIX
    dimension = algebra.DIMENSION
    state_rows = matrix + dimension
    result_rows = state_rows + STATE_ROWS
    strain_rows = result_rows + RESULT_ROWS
    sum_rows = strain_rows + tensor
    volume = dimension + 1
    fetch_geometry = fetch(4 * (dimension + 2))
    fetch_shares = fetch(4 * 2)
    fetch_steps = fetch(4 * tensors.STEP)
    undeformed = rest_state(algebra)

    @Pass
    def pair_energies(
        chunk,
        positions,
        gradients,
        pressures,
        pairs,
        shares,
        energy,
        constants,
        memory,
        buffers,
        results,
    ):
        """Compute energies, forces and moments of pairs as `selective_energy.pair_energies`, with
        branches and softening.

        `memory` are the moduli of the branches over the shear modulus, the parameters of softening
        or none, and the coefficients of `begin_steps`. The results begin with two arrays of
        energies of visits: those of which forces and moments are the derivatives, and those that
        are stored.
        """
        ends, geometry = pairs
        energies, stored, walk = results
        blocks, all_lanes, _, rows_of_ends, sums_at_ends = walk
        moduli, softening, coefficients = memory
        widest_vectors()
        sums = block_rows(buffers[chunk.thread])
        bonds = rows_from(sums, matrix)
        states = rows_from(sums, state_rows)
        result = rows_from(sums, result_rows)
        strains = rows_from(sums, strain_rows)
        added = rows_from(sums, sum_rows)
        one = like(sums[0, 0], 1.0)
        zero = like(one, 0.0)
        third = like(one, 1.0 / 3.0)
        counted = geometry.shape[1] - 1
        modulus = 0.0
        for branch in range(moduli.shape[0]):
            modulus += moduli[branch]
        for visit in visits_of(walk, chunk):
            block = np.int64(blocks[visit])
            lanes = all_lanes[visit, 0], all_lanes[visit, 1]
            at = block * BLOCK
            reference = block_rows(geometry[block])
            share = block_rows(shares[block])
            steps = block_rows(coefficients[block])
            for k in range(0, BLOCK, 4):
                algebra.gather_pairs(gradients, positions, ends, at + k, sums, bonds, k)
            for k in range(BLOCK):
                F = of_bond(sums, bonds, reference, k)
                put_column(sums, k, F)
                put_column(states, k, algebra.response_state(F, one))
                r = inverse_cube_root(algebra.determinant(F))
                Cb = tensors.scaled(r * r, tensors.green(F, one))
                put_column(strains, k, Cb)
                put_column(added, k, (*tensors.scaled(zero, Cb), r))
            rest_others(states, lanes, undeformed)
            evaluate_isochoric_energy(energy, constants, states, result)
            # The bonds are no longer needed: their rows are reused for pressures and stored
            # energies.
            for k in range(BLOCK):
                bonds[0, k] = pressure_of(share, pressures, ends, at, k)
                bonds[1, k] = result[3, k]
            if softening.shape[0] > 0:
                known = rows_from(steps, moduli.shape[0] * tensors.STEP)
                for k in range(BLOCK):
                    eta, potential, rest = soften(
                        np.float64(result[3, k]), known[0, k], known[1, k], softening
                    )
                    for row in range(3):
                        result[row, k] *= eta
                    result[3, k] = potential
                    bonds[1, k] = rest
            total = 0.0
            kept = 0.0
            for branch in range(moduli.shape[0]):
                step = rows_from(steps, branch * tensors.STEP)
                weight = like(one, moduli[branch])
                for k in range(BLOCK):
                    Cb = tensors.tensor_at(strains, k)
                    B, b = tensors.step_in(step, k, one)
                    M, gained = tensors.take_step(B, b, Cb)
                    put_column(added, k, tensors.combined(tensors.tensor_at(added, k), weight, M))
                    total += counted_at(reference, counted, lanes, k) * (weight * gained)
            for k in range(BLOCK):
                F = algebra.matrix_column_at(sums, k)
                V = like(F[0], reference[volume, k])
                state = states[0, k], states[1, k], states[2, k]
                found = result[0, k], result[1, k], result[2, k]
                M = tensors.tensor_at(added, k)
                mean = tensors.contraction(M, tensors.tensor_at(strains, k))
                cofactor = algebra.cofactor(F)
                P = algebra.first_piola(F, state, found, V)
                # Branches: J^(-2/3) F (M - (M : C)/3 C^-1).
                r = added[tensor, k]
                drive = V * (r * r)
                P = algebra.plus_matrix(
                    P, algebra.times_matrix(drive, tensors.gradient_times(F, M))
                )
                q = bonds[0, k] - drive * r * mean * third
                P = algebra.plus_matrix(P, algebra.times_matrix(q, cofactor))
                total += counted_at(reference, counted, lanes, k) * result[3, k]
                kept += counted_at(reference, counted, lanes, k) * (
                    bonds[1, k] + 0.5 * (mean - 3.0 * modulus)
                )
                put_parts(bonds, sums, reference, k, P)
            algebra.add_at_ends(sums, bonds, rows_of_ends, visit * BLOCK, sums_at_ends)
            for k in range(0, BLOCK, 4):
                fetch_geometry(geometry, (at + BLOCK + k) * geometry.shape[1])
                fetch_shares(shares, (at + BLOCK + k) * 2)
                for branch in range(moduli.shape[0]):
                    row = (block + 1) * coefficients.shape[1] + branch * tensors.STEP
                    fetch_steps(coefficients, row * BLOCK + k * tensors.STEP)
            energies[visit] = total
            stored[visit] = kept

    return pair_energies


@ByDimension
def accept_steps(algebra):
    """Build the pass that adds the state of every pair to the history."""
    tensors = tensors_of(algebra.DIMENSION)
    of_bond = gradient_of_bond(algebra)
    tensor = tensors.TENSOR
    matrix = algebra.MATRIX
    state_rows = matrix + algebra.DIMENSION
    # Rows of Cb, of dissipated energies, and of the history: Cb and C_k.
    lost_row = tensor
    before_row = tensor + 1
    volume = algebra.DIMENSION + 1

    @Pass
    def accept_steps(
        chunk,
        elapsed,
        ratio,
        unit,
        positions,
        gradients,
        ends,
        geometry,
        volumes,
        energy,
        constants,
        pairs,
        count,
        moduli,
        times,
        passed,
        softening,
        coefficients,
        history,
        memory,
        buffers,
    ):
        """Bring the `history`, see `begin_steps`, to the state at these positions, a time `elapsed`
        after the last one, for which `begin_steps` has computed the `coefficients`; the first
        `count` of the `pairs` are brought there.

        `volumes` are the volume ratios of the pairs of a sheet under plane stress, else empty.
        Dissipated energies of branches and of softening are added, and are in units in which
        `unit` is the shear modulus. `memory` holds the states and results of the isochoric energy,
        `buffers` all else in double precision.
        """
        all_states, all_strains, all_greatest, dissipated, all_earlier = history
        widest_vectors()
        sums = block_rows(buffers[chunk.thread])
        bonds = rows_from(sums, matrix)
        strains = rows_from(sums, state_rows)
        before = rows_from(strains, before_row)
        C_k = rows_from(before, tensor)
        durations = rows_from(C_k, tensor)
        stayed = rows_from(durations, 1)
        states = rows_from(block_rows(memory[chunk.thread]), state_rows)
        result = rows_from(states, STATE_ROWS)
        width = all_states.shape[1]
        free = volumes.shape[0] > 0
        for block in share_of(geometry.shape[0], chunk):
            at = block * BLOCK
            size = min(BLOCK, count - at)
            reference = block_rows(geometry[block])
            steps = block_rows(coefficients[block])
            for k in range(0, BLOCK, 4):
                algebra.gather_pairs(gradients, positions, ends, at + k, sums, bonds, k)
            if softening.shape[0] > 0:
                for k in range(BLOCK):
                    state = algebra.response_state(of_bond(sums, bonds, reference, k), 1.0)
                    put_column(states, k, state)
                if free:
                    for k in range(BLOCK):
                        states[2, k] = volumes[at + k]
                evaluate_isochoric_energy(energy, constants, states, result)
                known = rows_from(steps, times.shape[0] * tensors.STEP)
                for k in range(BLOCK):
                    new = max(known[0, k], np.float64(result[3, k]))
                    strains[0, k] = new
                    strains[1, k] = softening_loss(new, softening) - known[1, k]
                for k in range(size):
                    pair = pairs[at + k]
                    if strains[0, k] > known[0, k]:
                        all_greatest[pair] = unit * strains[0, k]
                    dissipated[pair, 1] += unit * reference[volume, k] * strains[1, k]
            if times.shape[0] == 0:
                continue
            for k in range(BLOCK):
                F = of_bond(sums, bonds, reference, k)
                J = algebra.determinant(F)
                J3 = volumes[at + k] if free else J
                Cb = tensors.isochoric(tensors.green(F, (J3 / J) * (J3 / J)), J3)
                put_column(strains, k, (*Cb, 0.0))
            for k in range(0, BLOCK, 4):
                tensors.take_listed(all_strains, tensor, pairs, at + k, 0, before, k)
            for k in range(size):
                for n in range(tensor):
                    all_strains[pairs[at + k], n] = strains[n, k]
                    if ratio >= 0.0:
                        all_earlier[pairs[at + k], n] = before[n, k]
            for branch in range(times.shape[0]):
                h = elapsed / times[branch]
                place = branch * tensor
                step = rows_from(steps, branch * tensors.STEP)
                for k in range(0, BLOCK, 4):
                    tensors.take_listed(all_states, width, pairs, at + k, place, C_k, k)
                put_durations(passed, block, branch, h, durations)
                if ratio > 0.0:
                    for k in range(BLOCK):
                        Cb_0 = tensors.tensor_at(before, k)
                        begun = tensors.tensor_at(C_k, k)
                        B, b = tensors.begin_curved_step(begun, Cb_0, h, Cb_0, 0.0)
                        put_column(stayed, k, tensors.end_step(B, b, Cb_0))
                else:
                    for k in range(BLOCK):
                        B, b = tensors.step_in(step, k, 1.0)
                        put_column(stayed, k, tensors.end_step(B, b, tensors.tensor_at(before, k)))
                for k in range(BLOCK):
                    Cb = tensors.tensor_at(strains, k)
                    begun = tensors.tensor_at(C_k, k)
                    B, b = tensors.step_in(step, k, 1.0)
                    ended = tensors.end_step(B, b, Cb)
                    Cb_0 = tensors.tensor_at(before, k)
                    held = tensors.tensor_at(stayed, k)
                    strains[lost_row, k] += moduli[branch] * tensors.dissipation(
                        Cb_0, begun, held, Cb, ended, durations[0, k]
                    )
                    put_column(C_k, k, ended)
                for k in range(size):
                    for n in range(tensor):
                        all_states[pairs[at + k], place + n] = C_k[n, k]
            for k in range(size):
                dissipated[pairs[at + k], 0] += unit * reference[volume, k] * strains[lost_row, k]

    return accept_steps
