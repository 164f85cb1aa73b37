"""The linearised dilatation of the points, D, and its transpose (theory (58)): passes that keep one record of a pair in single precision.

What a solver approximates the tangent with needs no more digits, and these passes wait for memory: a record is read once for every end
of its pair, and nothing by pairs is written but one number.
"""

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows
from ..engine.compile import widest_vectors
from ..engine.passes import Pass, share_of
from ..engine.vector_loads import multiply_pairs, sum_scaled_records
from .by_dimension import ByDimension
from .selective_energy import gradient_of_bond


def record_length(dimension: int) -> int:
    """Reals that say how det F_ij changes: with the bond, and with the sum of the ends' gradients."""
    return dimension + dimension * dimension


@ByDimension
def volume_derivatives(algebra):
    """Derivatives of det F_ij of every pair."""
    of_bond = gradient_of_bond(algebra)
    matrix, dimension = algebra.MATRIX, algebra.DIMENSION
    length = dimension

    @Pass
    def volume_derivatives(thread, chunk, chunks, positions, gradients, first, second, geometry, buffers, derivatives):
        """Derivatives of det F_ij of every pair, by y and by F_i + F_j: cof F_ij n/l and cof F_ij (I - n (x) n)/2.

        Parameters
        ----------
        positions, gradients, first, second, geometry, buffers : see `selective_energy.pair_volumes`.
        derivatives : (n_blocks * BLOCK, `record_length`) out, the second by columns.
        """
        widest_vectors()
        first_block, last_block = share_of(geometry.shape[0], chunk, chunks)
        sums = block_rows(buffers[thread, 0:matrix])
        bonds = block_rows(buffers[thread, matrix : matrix + dimension])
        for block in range(first_block, last_block):
            at = block * BLOCK
            reference = block_rows(geometry[block])
            for k in range(0, BLOCK, 4):
                algebra.gather_pairs(gradients, positions, first, second, at + k, sums, bonds, k)
            for k in range(BLOCK):
                n = algebra.column_at(reference, k)
                G = algebra.cofactor(of_bond(sums, bonds, reference, k))
                along = algebra.matrix_times_vector(G, n)
                across = algebra.times_matrix(0.5, algebra.add_outer_product(G, algebra.times(-1.0, along), n))
                along = algebra.times(reference[length, k], along)
                for r in range(dimension):
                    derivatives[at + k, r] = np.float32(along[r])
                for r in range(matrix):
                    derivatives[at + k, dimension + r] = np.float32(across[r])

    return volume_derivatives


@Pass
def displacement_records(chunk, chunks, displacements, gradients, source, gradient_parity, gradient_reflection, records):
    """Displacements of points and ghosts beside the changes of their gradients, of ghosts from those of their sources.

    Parameters
    ----------
    displacements : (n + m, d) of points and ghosts.
    gradients : (n or more, d d) changes of the points' gradients, by columns.
    source, gradient_parity, gradient_reflection : of the ghosts, see `pdsurrogate.body.Ghosts`.
    records : (n + m, d + d d) out.
    """
    total, dimension = displacements.shape
    n = total - source.shape[0]
    start, stop = share_of(n, chunk, chunks)
    for i in range(start, stop):
        for r in range(dimension):
            records[i, r] = np.float32(displacements[i, r])
        for r in range(dimension * dimension):
            records[i, dimension + r] = np.float32(gradients[i, r])
    start, stop = share_of(source.shape[0], chunk, chunks)
    for g in range(start, stop):
        for r in range(dimension):
            records[n + g, r] = np.float32(displacements[n + g, r])
        for c in range(dimension):
            for r in range(dimension):
                at = c * dimension + r
                value = gradient_parity[g, r] * gradients[source[g], at] * gradient_reflection[g, c]
                records[n + g, dimension + at] = np.float32(value)


@ByDimension
def volume_changes(algebra):
    """Change of det F_ij of every pair under displacements."""
    multiply = multiply_pairs(algebra.DIMENSION)

    @Pass
    def volume_changes(chunk, chunks, derivatives, records, pair_pointers, second, changes):
        """Change of det F_ij of every pair under displacements, to first order.

        Parameters
        ----------
        derivatives : see `volume_derivatives`.
        records : see `displacement_records`.
        pair_pointers : (n + 1,) where the pairs begin of which every point is the first.
        second : (n_pairs or more,) their other ends.
        changes : (n_pairs or more,) out.
        """
        start, stop = share_of(pair_pointers.shape[0] - 1, chunk, chunks)
        for i in range(start, stop):
            multiply(derivatives, records, np.uint64(i), second, pair_pointers[i], pair_pointers[i + 1], changes)

    return volume_changes


@Pass
def pair_pressures(chunk, chunks, pressures, first, second, shares, found):
    """What pressures at the points weigh the change of det F_ij of every pair with.

    Parameters
    ----------
    pressures : (n + m,) of points and ghosts.
    first, second : see `selective_energy.pair_volumes`.
    shares : (n_blocks, 2, BLOCK) of the volumes of both ends.
    found : (n_blocks * BLOCK,) out.
    """
    widest_vectors()
    first_block, last_block = share_of(shares.shape[0], chunk, chunks)
    for block in range(first_block, last_block):
        at = block * BLOCK
        share = block_rows(shares[block])
        for k in range(BLOCK):
            found[at + k] = np.float32(share[0, k] * pressures[first[at + k]] + share[1, k] * pressures[second[at + k]])


@ByDimension
def sum_pressures(algebra):
    """What pressures say of every point and ghost: by its place, and by its gradient."""
    add_up = sum_scaled_records(algebra.DIMENSION)

    @Pass
    def sum_pressures(chunk, chunks, derivatives, pressures, pair_pointers, incidence_pointers, incidence, forces, moments):
        """Sums over the pairs of every point and ghost of the derivatives of det F_ij, each times the pressure of the pair.

        Parameters
        ----------
        derivatives : see `volume_derivatives`.
        pressures : see `pair_pressures`.
        pair_pointers, incidence_pointers, incidence : pairs of which points and ghosts are the first, and the second.
        forces : (n + m, d) out.
        moments : (n + m, d d) out, by columns.
        """
        start, stop = share_of(forces.shape[0], chunk, chunks)
        for i in range(start, stop):
            own = pair_pointers[i], pair_pointers[i + 1]
            others = incidence_pointers[i], incidence_pointers[i + 1]
            add_up(derivatives, pressures, own[0], own[1], incidence, others[0], others[1], np.uint64(i), forces, moments)

    return sum_pressures


@Pass
def smooth_and_add(
    chunk, chunks, pointers, columns, weights, own, values, factor, first, of_first, second, of_second, third, of_third, out
):
    """``factor * W values + of_first * first + of_second * second + of_third * third`` at the points; `out` may be one of these three.

    Parameters
    ----------
    pointers, columns, weights, own : of the smoothing W, see `selective_energy.smooth`.
    values, first, second, third, out : (n,).
    """
    start, stop = share_of(own.shape[0], chunk, chunks)
    for i in range(start, stop):
        total = own[i] * values[i]
        for b in range(pointers[i], pointers[i + 1]):
            total += weights[b] * values[columns[b]]
        out[i] = np.float32(factor * total + of_first * first[i] + of_second * second[i] + of_third * third[i])
