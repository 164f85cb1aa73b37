"""Vector and matrix algebra in three dimensions, for kernels written once for two and three; `algebra2` has the same names.

Vectors are (1, 2, 3), matrices are stored by columns (11, 21, 31, 12, 22, 32, 13, 23, 33), symmetric matrices as (11, 12, 13, 22, 23, 33).
"""

import numpy as np

from ..engine.block_arrays import rows_of
from ..engine.compile import inlined
from ..engine.vector_loads import gather_pairs_in_space as gather_pairs
from ..engine.vector_loads import put_records
from ..engine.vector_loads import sum_matrix_products_in_space as sum_matrix_products
from .feature_sets import like

DIMENSION, MATRIX, SYMMETRIC = 3, 9, 6
"""Dimension, and numbers of reals in a matrix and in a symmetric matrix."""

__all__ = ["gather_pairs", "sum_matrix_products"]

vector_rows, symmetric_rows, matrix_rows = rows_of(DIMENSION), rows_of(SYMMETRIC), rows_of(MATRIX)
put_vectors, put_matrices = put_records(DIMENSION), put_records(MATRIX)


@inlined
def no_vector():
    """Return the zero vector."""
    return 0.0, 0.0, 0.0


@inlined
def no_symmetric():
    """Return the zero symmetric matrix."""
    return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@inlined
def vector_at(array, k):
    """Return row k of an array of vectors."""
    return (array[k, 0], array[k, 1], array[k, 2])


@inlined
def column_at(rows, k):
    """Return the vector in column k of an array with one row per component."""
    return rows[0, k], rows[1, k], rows[2, k]


@inlined
def column_in(rows, k, x):
    """Return the vector in column k of an array with one row per component, in the precision of x."""
    return like(x, rows[0, k]), like(x, rows[1, k]), like(x, rows[2, k])


@inlined
def symmetric_at(array, k):
    """Return row k of an array of symmetric matrices."""
    return (array[k, 0], array[k, 1], array[k, 2], array[k, 3], array[k, 4], array[k, 5])


@inlined
def matrix_at(array, k):
    """Return row k of an array of matrices."""
    return (array[k, 0], array[k, 1], array[k, 2], array[k, 3], array[k, 4], array[k, 5], array[k, 6], array[k, 7], array[k, 8])


@inlined
def put_vector(array, k, v):
    """Write row k of an array of vectors."""
    array[k, 0] = v[0]
    array[k, 1] = v[1]
    array[k, 2] = v[2]


@inlined
def put_symmetric(array, k, Z):
    """Write row k of an array of symmetric matrices."""
    array[k, 0] = Z[0]
    array[k, 1] = Z[1]
    array[k, 2] = Z[2]
    array[k, 3] = Z[3]
    array[k, 4] = Z[4]
    array[k, 5] = Z[5]


@inlined
def put_matrix(array, k, F):
    """Write row k of an array of matrices."""
    array[k, 0] = F[0]
    array[k, 1] = F[1]
    array[k, 2] = F[2]
    array[k, 3] = F[3]
    array[k, 4] = F[4]
    array[k, 5] = F[5]
    array[k, 6] = F[6]
    array[k, 7] = F[7]
    array[k, 8] = F[8]


@inlined
def plus(v, w):
    """Return the sum of two vectors."""
    return v[0] + w[0], v[1] + w[1], v[2] + w[2]


@inlined
def minus(v, w):
    """Return the difference of two vectors."""
    return v[0] - w[0], v[1] - w[1], v[2] - w[2]


@inlined
def times(factor, v):
    """Return a multiple of a vector."""
    return factor * v[0], factor * v[1], factor * v[2]


@inlined
def dot(v, w):
    """Return the inner product of two vectors."""
    return v[0] * w[0] + v[1] * w[1] + v[2] * w[2]


@inlined
def not_finite(v):
    """Return 1 if a component is infinite or NaN, else 0; the sum of finite components must not overflow."""
    return 0 if abs(v[0]) + abs(v[1]) + abs(v[2]) < np.inf else 1


@inlined
def add_symmetric_product(K, factor, v, w):
    """Return K + factor sym(v (x) w)."""
    return (
        K[0] + factor * (v[0] * w[0]),
        K[1] + factor * 0.5 * (v[0] * w[1] + v[1] * w[0]),
        K[2] + factor * 0.5 * (v[0] * w[2] + v[2] * w[0]),
        K[3] + factor * (v[1] * w[1]),
        K[4] + factor * 0.5 * (v[1] * w[2] + v[2] * w[1]),
        K[5] + factor * (v[2] * w[2]),
    )


@inlined
def times_factor(factor, K):
    """Return a multiple of a symmetric matrix."""
    return factor * K[0], factor * K[1], factor * K[2], factor * K[3], factor * K[4], factor * K[5]


@inlined
def plus_isotropic(K, value):
    """Return a symmetric matrix plus a multiple of I."""
    return K[0] + value, K[1], K[2], K[3] + value, K[4], K[5] + value


@inlined
def symmetric_determinant(K):
    """Return the determinant of a symmetric matrix."""
    return K[0] * (K[3] * K[5] - K[4] * K[4]) - K[1] * (K[1] * K[5] - K[4] * K[2]) + K[2] * (K[1] * K[4] - K[3] * K[2])


@inlined
def inverse_symmetric(K):
    """Return the inverse of a symmetric matrix."""
    scale = 1.0 / symmetric_determinant(K)
    return (
        scale * (K[3] * K[5] - K[4] * K[4]),
        scale * (K[2] * K[4] - K[1] * K[5]),
        scale * (K[1] * K[4] - K[2] * K[3]),
        scale * (K[0] * K[5] - K[2] * K[2]),
        scale * (K[1] * K[2] - K[0] * K[4]),
        scale * (K[0] * K[3] - K[1] * K[1]),
    )


@inlined
def symmetric_times_vector(Z, v):
    """Return Z v."""
    return Z[0] * v[0] + Z[1] * v[1] + Z[2] * v[2], Z[1] * v[0] + Z[3] * v[1] + Z[4] * v[2], Z[2] * v[0] + Z[4] * v[1] + Z[5] * v[2]


@inlined
def shape_quality(K):
    """Return 27 det K/(tr K)^3: 1 for a multiple of I, 0 for a singular K or one with zero trace."""
    trace = K[0] + K[3] + K[5]
    return 27.0 * symmetric_determinant(K) / (trace * trace * trace) if trace > 0.0 else 0.0


@inlined
def cofactor(F):
    """Return det F times F^-T."""
    return (
        F[4] * F[8] - F[7] * F[5],
        F[5] * F[6] - F[8] * F[3],
        F[3] * F[7] - F[6] * F[4],
        F[7] * F[2] - F[1] * F[8],
        F[8] * F[0] - F[2] * F[6],
        F[6] * F[1] - F[0] * F[7],
        F[1] * F[5] - F[4] * F[2],
        F[2] * F[3] - F[5] * F[0],
        F[0] * F[4] - F[3] * F[1],
    )


@inlined
def determinant(F):
    """Return det F."""
    return F[0] * (F[4] * F[8] - F[7] * F[5]) + F[1] * (F[5] * F[6] - F[8] * F[3]) + F[2] * (F[3] * F[7] - F[6] * F[4])


@inlined
def squared_norm(F):
    """Return the double contraction F : F, which is the trace of C = F^T F."""
    return F[0] * F[0] + F[1] * F[1] + F[2] * F[2] + F[3] * F[3] + F[4] * F[4] + F[5] * F[5] + F[6] * F[6] + F[7] * F[7] + F[8] * F[8]


@inlined
def double_dot(F, G):
    """Return the double contraction F : G."""
    return F[0] * G[0] + F[1] * G[1] + F[2] * G[2] + F[3] * G[3] + F[4] * G[4] + F[5] * G[5] + F[6] * G[6] + F[7] * G[7] + F[8] * G[8]


@inlined
def times_symmetric(F, Z):
    """Return F Z."""
    return (
        F[0] * Z[0] + F[3] * Z[1] + F[6] * Z[2],
        F[1] * Z[0] + F[4] * Z[1] + F[7] * Z[2],
        F[2] * Z[0] + F[5] * Z[1] + F[8] * Z[2],
        F[0] * Z[1] + F[3] * Z[3] + F[6] * Z[4],
        F[1] * Z[1] + F[4] * Z[3] + F[7] * Z[4],
        F[2] * Z[1] + F[5] * Z[3] + F[8] * Z[4],
        F[0] * Z[2] + F[3] * Z[4] + F[6] * Z[5],
        F[1] * Z[2] + F[4] * Z[4] + F[7] * Z[5],
        F[2] * Z[2] + F[5] * Z[4] + F[8] * Z[5],
    )


@inlined
def plus_diagonal(F, value):
    """Return F plus a multiple of I."""
    return F[0] + value, F[1], F[2], F[3], F[4] + value, F[5], F[6], F[7], F[8] + value


@inlined
def right_cauchy_green(F):
    """Return C = F^T F."""
    return (
        F[0] * F[0] + F[1] * F[1] + F[2] * F[2],
        F[0] * F[3] + F[1] * F[4] + F[2] * F[5],
        F[0] * F[6] + F[1] * F[7] + F[2] * F[8],
        F[3] * F[3] + F[4] * F[4] + F[5] * F[5],
        F[3] * F[6] + F[4] * F[7] + F[5] * F[8],
        F[6] * F[6] + F[7] * F[7] + F[8] * F[8],
    )


@inlined
def response_state(F, volume_ratio):
    """Return the arguments of a three-dimensional response: tr C, tr cof C and det F; the volume ratio is det F itself."""
    G = cofactor(F)
    return squared_norm(F), squared_norm(G), determinant(F)


@inlined
def first_piola(F, state, result, unit):
    """Return P = (p F + r F C + q cof F) unit, from a response's result (p, q, r)."""
    p, q, r = result[0] * unit, result[1] * unit, result[2] * unit
    G, H = cofactor(F), times_symmetric(F, right_cauchy_green(F))
    return (
        p * F[0] + q * G[0] + r * H[0],
        p * F[1] + q * G[1] + r * H[1],
        p * F[2] + q * G[2] + r * H[2],
        p * F[3] + q * G[3] + r * H[3],
        p * F[4] + q * G[4] + r * H[4],
        p * F[5] + q * G[5] + r * H[5],
        p * F[6] + q * G[6] + r * H[6],
        p * F[7] + q * G[7] + r * H[7],
        p * F[8] + q * G[8] + r * H[8],
    )


@inlined
def sum_outer_products(positions, neighbours, weights, start, stop, point, out):
    """Write ``out[point] = sum over b in start … stop of (positions[neighbours[b]] - positions[point]) (x) weights[b]``, by columns."""
    y1, y2, y3 = positions[point, 0], positions[point, 1], positions[point, 2]
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = s8 = 0.0
    for b in range(start, stop):
        j = neighbours[b]
        d0 = positions[j, 0] - y1
        d1 = positions[j, 1] - y2
        d2 = positions[j, 2] - y3
        w0 = np.float64(weights[b, 0])
        w1 = np.float64(weights[b, 1])
        w2 = np.float64(weights[b, 2])
        s0 += d0 * w0
        s1 += d1 * w0
        s2 += d2 * w0
        s3 += d0 * w1
        s4 += d1 * w1
        s5 += d2 * w1
        s6 += d0 * w2
        s7 += d1 * w2
        s8 += d2 * w2
    put_matrix(out, point, (s0, s1, s2, s3, s4, s5, s6, s7, s8))


@inlined
def sum_signed_records(records, start, stop, indices, first, last, factor, point, out):
    """Write ``out[point] = factor * (sum of records[start … stop] - sum of records[indices[first … last]])``, summed in double."""
    s0 = s1 = s2 = 0.0
    for b in range(start, stop):
        s0 += np.float64(records[b, 0])
        s1 += np.float64(records[b, 1])
        s2 += np.float64(records[b, 2])
    for b in range(first, last):
        place = indices[b]
        s0 -= np.float64(records[place, 0])
        s1 -= np.float64(records[place, 1])
        s2 -= np.float64(records[place, 2])
    put_vector(out, point, (factor * s0, factor * s1, factor * s2))


@inlined
def sum_matrices(records, start, stop, indices, first, last, point, out):
    """Write ``out[point] = sum of records[start … stop] + sum of records[indices[first … last]]``, summed in double precision."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = s8 = 0.0
    for b in range(start, stop):
        s0 += np.float64(records[b, 0])
        s1 += np.float64(records[b, 1])
        s2 += np.float64(records[b, 2])
        s3 += np.float64(records[b, 3])
        s4 += np.float64(records[b, 4])
        s5 += np.float64(records[b, 5])
        s6 += np.float64(records[b, 6])
        s7 += np.float64(records[b, 7])
        s8 += np.float64(records[b, 8])
    for b in range(first, last):
        place = indices[b]
        s0 += np.float64(records[place, 0])
        s1 += np.float64(records[place, 1])
        s2 += np.float64(records[place, 2])
        s3 += np.float64(records[place, 3])
        s4 += np.float64(records[place, 4])
        s5 += np.float64(records[place, 5])
        s6 += np.float64(records[place, 6])
        s7 += np.float64(records[place, 7])
        s8 += np.float64(records[place, 8])
    put_matrix(out, point, (s0, s1, s2, s3, s4, s5, s6, s7, s8))


@inlined
def subtract_positions(positions, first, second, at, out, column):
    """Write ``out[r, column + k] = positions[second[at + k], r] - positions[first[at + k], r]`` for each k in 0 … 3."""
    for k in range(4):
        for r in range(3):
            out[r, column + k] = positions[second[at + k], r] - positions[first[at + k], r]


@inlined
def matrix_column_at(rows, k):
    """Return the matrix in column k of an array with one row per entry."""
    return rows[0, k], rows[1, k], rows[2, k], rows[3, k], rows[4, k], rows[5, k], rows[6, k], rows[7, k], rows[8, k]


@inlined
def plus_matrix(F, G):
    """Return the sum of two matrices."""
    return F[0] + G[0], F[1] + G[1], F[2] + G[2], F[3] + G[3], F[4] + G[4], F[5] + G[5], F[6] + G[6], F[7] + G[7], F[8] + G[8]


@inlined
def times_matrix(factor, F):
    """Return a multiple of a matrix."""
    return (
        factor * F[0],
        factor * F[1],
        factor * F[2],
        factor * F[3],
        factor * F[4],
        factor * F[5],
        factor * F[6],
        factor * F[7],
        factor * F[8],
    )


@inlined
def matrix_times_vector(F, v):
    """Return F v."""
    return (
        F[0] * v[0] + F[3] * v[1] + F[6] * v[2],
        F[1] * v[0] + F[4] * v[1] + F[7] * v[2],
        F[2] * v[0] + F[5] * v[1] + F[8] * v[2],
    )


@inlined
def add_outer_product(F, v, w):
    """Return F + v (x) w."""
    return (
        F[0] + v[0] * w[0],
        F[1] + v[1] * w[0],
        F[2] + v[2] * w[0],
        F[3] + v[0] * w[1],
        F[4] + v[1] * w[1],
        F[5] + v[2] * w[1],
        F[6] + v[0] * w[2],
        F[7] + v[1] * w[2],
        F[8] + v[2] * w[2],
    )
