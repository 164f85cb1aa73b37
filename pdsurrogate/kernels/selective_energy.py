"""Isochoric energy of the bonds and mean dilatation of the points: passes of a selective energy
(theory (48)-(52)).

The reference data of a pair are n, 1/l and the volume that its isochoric energy represents. A
broken pair, or one that pads a block, has volume zero and is given the undeformed state.
"""

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows, put_column, rows_from
from ..engine.compile import call_block, inline, inlined, widest_vectors
from ..engine.passes import Pass, share_of
from ..engine.vector_loads import fetch
from .algebra import ByDimension
from .elementary import like
from .sums import counted_at, rest_others, visits_of

STATE_ROWS = 3
RESULT_ROWS = 4
"""Numbers of rows of the states and of the result of an isochoric response; the last row of the
result is the energy.
"""


@inline
def evaluate_isochoric_energy(energy, constants, states, result):
    """Evaluate the isochoric energy over a block of states: the learned one at address `energy`, or
    the exact one of the law if that is 0.

    `constants` are the sizes and weights of the learned energy, the address of the response of the
    law and the parameters of the law.
    """
    if energy == 0:
        call_block(constants[2], states, constants[3], result)
    else:
        call_block(energy, states, constants, result)


def buffer_rows(dimension: int) -> int:
    """Return the number of rows of a thread's buffer for the pair passes: gradients, bond
    vectors, states and results.
    """
    return dimension * dimension + dimension + STATE_ROWS + RESULT_ROWS


def gradient_of_bond(algebra):
    """Build the function that returns the deformation gradient of a pair, F_ij = Fbar + (y/l - Fbar
    n) (x) n of theory (27).

    Fbar is the mean of the deformation gradients of the two points, y the deformed bond vector, n
    and l are the direction and the length of the undeformed bond.
    """
    length = algebra.DIMENSION
    volume = algebra.DIMENSION + 1

    @inlined
    def of_bond(sums, bonds, reference, k):
        """Return the deformation gradient F_ij of pair k; I for a pair of volume zero.

        `sums` holds the sums of the gradients of both points, `bonds` the deformed bond vectors,
        `reference` n, 1/l and the volume of the pair.
        """
        # All terms have the precision of the sums and the bonds.
        one = like(sums[0, k], 1.0)
        zero = like(one, 0.0)
        n = algebra.column_in(reference, k, one)
        mean = algebra.times_matrix(like(one, 0.5), algebra.matrix_column_at(sums, k))
        along = algebra.times(like(one, reference[length, k]), algebra.column_at(bonds, k))
        F = algebra.add_outer_product(
            mean, algebra.minus(along, algebra.matrix_times_vector(mean, n)), n
        )
        alive = one if reference[volume, k] > 0.0 else zero
        return algebra.plus_diagonal(algebra.times_matrix(alive, F), one - alive)

    return of_bond


@inlined
def pressure_of(shares, pressures, ends, at, k):
    """Return the pressure of pair k of a block that begins at pair `at`: the sum of those of both
    `ends`, each times the share of the pair in the volume of the point.
    """
    first, second = ends
    return shares[0, k] * pressures[first[at + k]] + shares[1, k] * pressures[second[at + k]]


def rest_state(algebra):
    """Return the state of a pair that is not deformed."""
    return 3.0 if algebra.DIMENSION == 3 else 2.0, 3.0 if algebra.DIMENSION == 3 else 1.0, 1.0


def parts_of_stress(algebra):
    """Build the function that writes the force and the moment of a pair from its stress."""
    length = algebra.DIMENSION

    @inlined
    def put_parts(forces, moments, reference, k, P):
        """Write P n/l and P (I - n (x) n)/2 of pair k into columns k of `forces` and `moments`; P
        is its stress times its volume, and `reference` holds n and 1/l.
        """
        n = algebra.column_in(reference, k, P[0])
        traction = algebra.matrix_times_vector(P, n)
        across = algebra.add_outer_product(P, algebra.times(like(P[0], -1.0), traction), n)
        put_column(forces, k, algebra.times(like(P[0], reference[length, k]), traction))
        put_column(moments, k, algebra.times_matrix(like(P[0], 0.5), across))

    return put_parts


@inlined
def following_row(rows, block):
    """Return the number of pairs stored before the block after `block`, see `pair_volumes`."""
    return np.int64(rows[min(block + 1, rows.shape[0] - 1)]) * BLOCK


@ByDimension
def pair_volumes(algebra):
    """Build the pass that computes det F_ij, the volume ratio, of every pair of points."""
    of_bond = gradient_of_bond(algebra)
    matrix = algebra.MATRIX
    fetch_geometry = fetch(4 * (algebra.DIMENSION + 2))
    fetch_volumes = fetch(4, to_write=True)

    @Pass
    def pair_volumes(chunk, positions, gradients, pairs, buffers, volumes):
        """Compute det F_ij of every pair of points; return the number of pairs for which it is NaN
        or not positive.

        `pairs` are the numbers of the first and second points, the geometry (k, d + 2 or d + 3,
        BLOCK): n, 1/l, the volume of the pair and, where a body has several materials or ranks, the
        part of this volume counted here, and the row of every block in the geometry.
        """
        ends, geometry, rows = pairs
        widest_vectors()
        sums = block_rows(buffers[chunk.thread])
        bonds = rows_from(sums, matrix)
        bad = 0
        for block in share_of(rows.shape[0], chunk):
            at = block * BLOCK
            reference = block_rows(geometry[rows[block]])
            following = following_row(rows, block)
            found = volumes[at : at + BLOCK]
            for k in range(0, BLOCK, 4):
                algebra.gather_pairs(gradients, positions, ends, at + k, sums, bonds, k)
                fetch_geometry(geometry, (following + k) * geometry.shape[1])
                fetch_volumes(volumes, at + k)
            for k in range(BLOCK):
                J = algebra.determinant(of_bond(sums, bonds, reference, k))
                found[k] = J
                # NaN is counted, too.
                bad += 0 if J > 0.0 else 1
        return bad

    return pair_volumes


@Pass
def means_over_bonds(chunk, pointers, pair_of, starts, shares, values, otherwise, means):
    """Compute the mean of the `values` of every point's pairs, weighted by the shares of its bonds
    in the volume of the point.

    `pair_of` is the number of the pair of every directed bond, and `shares` holds the shares of the
    bonds of point i from ``starts[i]`` on. A point whose bonds have no share gets the value
    `otherwise`.
    """
    for i in share_of(pointers.shape[0] - 1, chunk):
        total = 0.0
        whole = 0.0
        for b in range(pointers[i], pointers[i + 1]):
            share = shares[b - pointers[i] + starts[i]]
            total += share * values[pair_of[b]]
            whole += share
        means[i] = total / whole if whole > 0.0 else otherwise


@inlined
def smoothed_value(smoothing, values, i):
    """Return the smoothed value at point i, ``own[i] * values[i]`` plus the sum of ``weights *
    values`` over the neighbors of the point.

    `smoothing` is a sparse matrix: pointers, columns, weights, and its diagonal `own`.
    """
    pointers, columns, weights, own = smoothing
    total = own[i] * values[i]
    for b in range(pointers[i], pointers[i + 1]):
        total += weights[b] * values[columns[b]]
    return total


@Pass
def smooth(chunk, smoothing, values, out):
    """Write the smoothed values ``W values`` of the points to the first rows of `out`; further rows
    stay as they are.

    `smoothing` is the sparse matrix W, see `smoothed_value`.
    """
    for i in share_of(smoothing[3].shape[0], chunk):
        out[i] = smoothed_value(smoothing, values, i)


@Pass
def volume_energies(chunk, volume_ratios, volumes, response, parameters, buffers, energies, slopes):
    """Compute the derivative U' of the volumetric energy at the volume ratio of every point, and
    the sum of volume times U over each block.

    `slopes` receives U', `energies` the sums. `response` returns (U, U') for the volume ratio in
    the first row of its states.
    """
    widest_vectors()
    n = volumes.shape[0]
    states = block_rows(buffers[chunk.thread, 0:1])
    result = block_rows(buffers[chunk.thread, 1:3])
    for block in share_of((n + BLOCK - 1) // BLOCK, chunk):
        at = block * BLOCK
        size = min(BLOCK, n - at)
        ratio = volume_ratios[at : at + size]
        volume = volumes[at : at + size]
        slope = slopes[at : at + size]
        for k in range(BLOCK):
            states[0, k] = 1.0
        for k in range(size):
            states[0, k] = ratio[k]
        call_block(response, states, parameters, result)
        total = 0.0
        for k in range(size):
            total += volume[k] * result[0, k]
            slope[k] = result[1, k]
        energies[block] = total


def stresses_of_block(algebra, stress):
    """Build the function that writes moments and forces of the pairs of a block in the places of
    their gradients and bonds, and returns the energy of those in `lanes`.

    The first row of the bonds holds the pressures; `stress` is a function of the algebra.
    """
    put_parts = parts_of_stress(algebra)
    volume = algebra.DIMENSION + 1

    @inlined
    def put_stresses(sums, bonds, states, result, reference, lanes):
        counted = reference.shape[0] - 1
        total = 0.0
        for k in range(BLOCK):
            F = algebra.matrix_column_at(sums, k)
            state = states[0, k], states[1, k], states[2, k]
            found = result[0, k], result[1, k], result[2, k]
            P = stress(F, state, found, like(F[0], reference[volume, k]))
            P = algebra.plus_matrix(P, algebra.times_matrix(bonds[0, k], algebra.cofactor(F)))
            put_parts(bonds, sums, reference, k, P)
            total += counted_at(reference, counted, lanes, k) * result[3, k]
        return total

    return put_stresses


@ByDimension
def pair_energies(algebra):
    """Build the pass that computes the isochoric energy of pairs, and their forces and moments,
    which include the points' pressures.
    """
    of_bond = gradient_of_bond(algebra)
    by_trace, by_invariants = (
        stresses_of_block(algebra, stress)
        for stress in (algebra.stress_by_trace, algebra.first_piola)
    )
    matrix = algebra.MATRIX
    dimension = algebra.DIMENSION
    state_rows = matrix + dimension
    result_rows = matrix + dimension + STATE_ROWS
    fetch_geometry = fetch(4 * (dimension + 2))
    fetch_shares = fetch(4 * 2)
    undeformed = rest_state(algebra)

    @Pass
    def pair_energies(
        chunk, positions, gradients, pressures, pairs, shares, energy, constants, buffers, results
    ):
        """Compute the isochoric energy, the force and the moment S of every pair of points.

        Energies and stresses are dimensionless, and multiplied by the volume that the bond
        represents.

        The stress P of a pair includes the pressure of the pair: the sum of the `pressures` of both
        points, each times the share of the pair in the volume of the point (`shares`, (k, 2,
        BLOCK), in the rows of the geometry). The results are: `energies`, the sums over the pairs
        of each visit of a walk; the walk, to whose sums at both ends the pass adds the force P n/l
        on the first point, where n and l are the direction and the length of the undeformed bond,
        and the moment S = P (I - n (x) n)/2 by columns, the derivative of the energy by the
        deformation gradient of either point.
        """
        ends, geometry, rows = pairs
        energies, walk = results
        blocks, all_lanes, _, rows_of_ends, sums_at_ends = walk
        widest_vectors()
        sums = block_rows(buffers[chunk.thread])
        bonds = rows_from(sums, matrix)
        states = rows_from(sums, state_rows)
        result = rows_from(sums, result_rows)
        for visit in visits_of(walk, chunk):
            block = np.int64(blocks[visit])
            lanes = all_lanes[visit, 0], all_lanes[visit, 1]
            at = block * BLOCK
            reference = block_rows(geometry[rows[block]])
            share = block_rows(shares[rows[block]])
            following = following_row(rows, block)
            for k in range(0, BLOCK, 4):
                algebra.gather_pairs(gradients, positions, ends, at + k, sums, bonds, k)
                # The next block needs these.
                fetch_geometry(geometry, (following + k) * geometry.shape[1])
                fetch_shares(shares, (following + k) * 2)
            for k in range(BLOCK):
                F = of_bond(sums, bonds, reference, k)
                put_column(sums, k, F)
                put_column(states, k, algebra.response_state(F, like(F[0], 1.0)))
            rest_others(states, lanes, undeformed)
            evaluate_isochoric_energy(energy, constants, states, result)
            # The bonds are no longer needed: their first row is reused for the pressures.
            for k in range(BLOCK):
                bonds[0, k] = pressure_of(share, pressures, ends, at, k)
            second = like(result[2, 0], 0.0)
            for k in range(BLOCK):
                second += abs(result[2, k])
            rows_of_block = sums, bonds, states, result, reference
            energies[visit] = (
                by_trace(*rows_of_block, lanes)
                if second == 0.0
                else by_invariants(*rows_of_block, lanes)
            )
            algebra.add_at_ends(sums, bonds, rows_of_ends, visit * BLOCK, sums_at_ends)

    return pair_energies
