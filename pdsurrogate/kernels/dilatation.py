"""The linearized dilatation D and its transpose (theory (58)), with the derivatives of every pair
in single precision.

D is the derivative of the volume ratios of the points by the positions of the points. A
preconditioner needs no more digits. Memory limits the speed of these passes: they read the
derivatives of a pair once for each of its two points, and write one number for every pair.
"""

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows
from ..engine.compile import widest_vectors
from ..engine.passes import Pass, share_of
from ..engine.vector_loads import multiply_pairs, sum_scaled_records
from .algebra import ByDimension
from .selective_energy import gradient_of_bond, smoothed_value


def record_length(dimension: int) -> int:
    """Return the number of derivatives of a pair's volume ratio: d by its bond vector, and d*d
    by the sum of its points' gradients.
    """
    return dimension + dimension * dimension


@ByDimension
def volume_derivatives(algebra):
    """Build the pass that computes the derivatives of det F_ij, the volume ratio of a pair, by
    bond vector and deformation gradients.
    """
    of_bond = gradient_of_bond(algebra)
    matrix = algebra.MATRIX
    dimension = algebra.DIMENSION
    length = dimension

    @Pass
    def volume_derivatives(chunk, positions, gradients, pairs, buffers, derivatives):
        """Compute the derivatives of det F_ij of every pair of points by its bond vector and by the
        deformation gradients of its points.

        A row of `derivatives` holds cof F_ij n/l, the derivative by the bond vector, and cof F_ij
        (I - n (x) n)/2, the derivative by F_i + F_j, by columns; n and l are the direction and the
        length of the undeformed bond. The other arguments are those of
        `selective_energy.pair_volumes`.
        """
        ends, geometry, rows = pairs
        widest_vectors()
        sums = block_rows(buffers[chunk.thread, 0:matrix])
        bonds = block_rows(buffers[chunk.thread, matrix : matrix + dimension])
        for block in share_of(rows.shape[0], chunk):
            at = block * BLOCK
            reference = block_rows(geometry[rows[block]])
            for k in range(0, BLOCK, 4):
                algebra.gather_pairs(gradients, positions, ends, at + k, sums, bonds, k)
            for k in range(BLOCK):
                n = algebra.column_at(reference, k)
                G = algebra.cofactor(of_bond(sums, bonds, reference, k))
                along = algebra.matrix_times_vector(G, n)
                across = algebra.times_matrix(
                    0.5, algebra.add_outer_product(G, algebra.times(-1.0, along), n)
                )
                along = algebra.times(reference[length, k], along)
                for r in range(dimension):
                    derivatives[at + k, r] = np.float32(along[r])
                for r in range(matrix):
                    derivatives[at + k, dimension + r] = np.float32(across[r])

    return volume_derivatives


@Pass
def displacement_records(chunk, displacements, gradients, records):
    """Write the displacement of every point and ghost, and the change of its gradient, into a
    row of `records` (n + m, d + d d).
    """
    total, dimension = displacements.shape
    for i in share_of(total, chunk):
        for r in range(dimension):
            records[i, r] = np.float32(displacements[i, r])
        for r in range(dimension * dimension):
            records[i, dimension + r] = np.float32(gradients[i, r])


@ByDimension
def volume_changes(algebra):
    """Build the pass that computes the change of det F_ij of every pair of points under
    displacements, to first order.
    """
    multiply = multiply_pairs(algebra.DIMENSION)

    @Pass
    def volume_changes(chunk, derivatives, records, pair_pointers, second, changes):
        """Compute the change of det F_ij of every pair of points under displacements, to first
        order.

        `derivatives` comes from `volume_derivatives` and `records` from `displacement_records`.
        Point i is the first point of the pairs ``pair_pointers[i]`` to ``pair_pointers[i + 1]``;
        `second` holds the second point of every pair. `changes` receives the result.
        """
        for i in share_of(pair_pointers.shape[0] - 1, chunk):
            multiply(
                derivatives, records, i, second, (pair_pointers[i], pair_pointers[i + 1]), changes
            )

    return volume_changes


@Pass
def pair_pressures(chunk, pressures, first, second, rows, shares, found):
    """Compute the pressure of every pair of points, the factor of the derivatives of det F_ij in
    `sum_pressures`.

    The pressure of a pair is the sum of the pressures of both points, each times the pair's share
    in the volume of the point; `shares` (k, 2, BLOCK) holds these shares in the `rows` of the
    blocks, and `found` receives the pressures of the pairs.
    """
    widest_vectors()
    for block in share_of(rows.shape[0], chunk):
        at = block * BLOCK
        share = block_rows(shares[rows[block]])
        for k in range(BLOCK):
            found[at + k] = np.float32(
                share[0, k] * pressures[first[at + k]] + share[1, k] * pressures[second[at + k]]
            )


@ByDimension
def sum_pressures(algebra):
    """Build the pass that applies the transpose of the linearized dilatation to the pressures of
    the pairs.
    """
    add_up = sum_scaled_records(algebra.DIMENSION)

    @Pass
    def sum_pressures(
        chunk, derivatives, pressures, pair_pointers, incidence_pointers, incidence, forces, moments
    ):
        """Sum, over the pairs of every point and ghost, the derivatives of det F_ij of a pair times
        the pressure of the pair.

        `forces` (n + m, d) receives the sums of the derivatives by the position of the point, and
        `moments` (n + m, d d) the sums of the derivatives by its deformation gradient, by columns.
        `pair_pointers` bound the pairs that have the point as first point, `incidence` lists the
        pairs that have it as second point.
        """
        for i in share_of(forces.shape[0], chunk):
            own = pair_pointers[i], pair_pointers[i + 1]
            others = incidence_pointers[i], incidence_pointers[i + 1]
            add_up(
                derivatives,
                pressures,
                own,
                (incidence, incidence.shape[0]),
                others,
                i,
                (forces, moments),
            )

    return sum_pressures


@Pass
def smooth_and_add(chunk, smoothing, values, factor, others, out):
    """Compute ``out = factor * W values`` plus three further vectors, each times a factor of its
    own.

    `smoothing` is the sparse matrix W, see `selective_energy.smoothed_value`; `others` are three
    tuples of factor and vector, and `out` may be one of these vectors.
    """
    (of_first, first), (of_second, second), (of_third, third) = others
    for i in share_of(smoothing[3].shape[0], chunk):
        smoothed = smoothed_value(smoothing, values, i)
        out[i] = np.float32(
            factor * smoothed + of_first * first[i] + of_second * second[i] + of_third * third[i]
        )
