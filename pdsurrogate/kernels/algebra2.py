"""Vector and matrix algebra in two dimensions, for kernels written once for two and three; `algebra3` has the same names.

Vectors are (1, 2), matrices are stored by columns (11, 21, 12, 22), symmetric matrices as (11, 12, 22). All functions take tuples of reals
or rows of arrays and are inlined into their callers. The sums over bonds use explicit vector instructions
(`pdsurrogate.engine.vector_loads`).
"""

import numpy as np

from ..engine.block_arrays import rows_of
from ..engine.compile import inlined
from ..engine.vector_loads import gather_pairs, put_records, subtract_positions, sum_matrix_products, sum_outer_products, sum_signed_records
from ..engine.vector_loads import sum_quad_records as sum_matrices
from .feature_sets import like

DIMENSION, MATRIX, SYMMETRIC = 2, 4, 3
"""Dimension, and numbers of reals in a matrix and in a symmetric matrix."""

__all__ = ["gather_pairs", "subtract_positions", "sum_matrices", "sum_matrix_products", "sum_outer_products", "sum_signed_records"]

vector_rows, symmetric_rows, matrix_rows = rows_of(DIMENSION), rows_of(SYMMETRIC), rows_of(MATRIX)
put_vectors, put_matrices = put_records(DIMENSION), put_records(MATRIX)


@inlined
def no_vector():
    """Return the zero vector."""
    return 0.0, 0.0


@inlined
def no_symmetric():
    """Return the zero symmetric matrix."""
    return 0.0, 0.0, 0.0


@inlined
def vector_at(array, k):
    """Return row k of an array of vectors."""
    return array[k, 0], array[k, 1]


@inlined
def column_at(rows, k):
    """Return the vector in column k of an array with one row per component."""
    return rows[0, k], rows[1, k]


@inlined
def column_in(rows, k, x):
    """Return the vector in column k of an array with one row per component, in the precision of x."""
    return like(x, rows[0, k]), like(x, rows[1, k])


@inlined
def symmetric_at(array, k):
    """Return row k of an array of symmetric matrices."""
    return array[k, 0], array[k, 1], array[k, 2]


@inlined
def matrix_at(array, k):
    """Return row k of an array of matrices."""
    return array[k, 0], array[k, 1], array[k, 2], array[k, 3]


@inlined
def put_vector(array, k, v):
    """Write row k of an array of vectors."""
    array[k, 0] = v[0]
    array[k, 1] = v[1]


@inlined
def put_symmetric(array, k, Z):
    """Write row k of an array of symmetric matrices."""
    array[k, 0] = Z[0]
    array[k, 1] = Z[1]
    array[k, 2] = Z[2]


@inlined
def put_matrix(array, k, F):
    """Write row k of an array of matrices."""
    array[k, 0] = F[0]
    array[k, 1] = F[1]
    array[k, 2] = F[2]
    array[k, 3] = F[3]


@inlined
def plus(v, w):
    """Return the sum of two vectors."""
    return v[0] + w[0], v[1] + w[1]


@inlined
def minus(v, w):
    """Return the difference of two vectors."""
    return v[0] - w[0], v[1] - w[1]


@inlined
def times(factor, v):
    """Return a multiple of a vector."""
    return factor * v[0], factor * v[1]


@inlined
def dot(v, w):
    """Return the inner product of two vectors."""
    return v[0] * w[0] + v[1] * w[1]


@inlined
def not_finite(v):
    """Return 1 if a component is infinite or NaN, else 0; the sum of finite components must not overflow."""
    return 0 if abs(v[0]) + abs(v[1]) < np.inf else 1


@inlined
def add_symmetric_product(K, factor, v, w):
    """Return K + factor sym(v (x) w)."""
    return K[0] + factor * (v[0] * w[0]), K[1] + factor * 0.5 * (v[0] * w[1] + v[1] * w[0]), K[2] + factor * (v[1] * w[1])


@inlined
def times_factor(factor, K):
    """Return a multiple of a symmetric matrix."""
    return factor * K[0], factor * K[1], factor * K[2]


@inlined
def plus_isotropic(K, value):
    """Return a symmetric matrix plus a multiple of I."""
    return K[0] + value, K[1], K[2] + value


@inlined
def inverse_symmetric(K):
    """Return the inverse of a symmetric matrix."""
    determinant = K[0] * K[2] - K[1] * K[1]
    return K[2] / determinant, -K[1] / determinant, K[0] / determinant


@inlined
def symmetric_times_vector(Z, v):
    """Return Z v."""
    return Z[0] * v[0] + Z[1] * v[1], Z[1] * v[0] + Z[2] * v[1]


@inlined
def shape_quality(K):
    """Return 4 det K/(tr K)^2: 1 for a multiple of I, 0 for a singular K or one with zero trace."""
    trace = K[0] + K[2]
    return 4.0 * (K[0] * K[2] - K[1] * K[1]) / (trace * trace) if trace > 0.0 else 0.0


@inlined
def determinant(F):
    """Return det F."""
    return F[0] * F[3] - F[1] * F[2]


@inlined
def cofactor(F):
    """Return det F times F^-T."""
    return F[3], -F[2], -F[1], F[0]


@inlined
def squared_norm(F):
    """Return the double contraction F : F, which is the trace of C = F^T F."""
    return F[0] * F[0] + F[1] * F[1] + F[2] * F[2] + F[3] * F[3]


@inlined
def double_dot(F, G):
    """Return the double contraction F : G."""
    return F[0] * G[0] + F[1] * G[1] + F[2] * G[2] + F[3] * G[3]


@inlined
def times_symmetric(F, Z):
    """Return F Z."""
    return F[0] * Z[0] + F[2] * Z[1], F[1] * Z[0] + F[3] * Z[1], F[0] * Z[1] + F[2] * Z[2], F[1] * Z[1] + F[3] * Z[2]


@inlined
def plus_diagonal(F, value):
    """Return F plus a multiple of I."""
    return F[0] + value, F[1], F[2], F[3] + value


@inlined
def response_state(F, volume_ratio):
    """Return the arguments of a plane-stress response: tr C and det F in the plane, and J3."""
    return squared_norm(F), determinant(F), volume_ratio


@inlined
def first_piola(F, state, result, unit):
    """Return P = (p F + q F^-T) unit, from a response's result (p, q) in the state (tr C, J, J3)."""
    p = result[0] * unit
    q = result[1] / state[1] * unit
    return p * F[0] + q * F[3], p * F[1] - q * F[2], p * F[2] - q * F[1], p * F[3] + q * F[0]


@inlined
def matrix_column_at(rows, k):
    """Return the matrix in column k of an array with one row per entry."""
    return rows[0, k], rows[1, k], rows[2, k], rows[3, k]


@inlined
def plus_matrix(F, G):
    """Return the sum of two matrices."""
    return F[0] + G[0], F[1] + G[1], F[2] + G[2], F[3] + G[3]


@inlined
def times_matrix(factor, F):
    """Return a multiple of a matrix."""
    return factor * F[0], factor * F[1], factor * F[2], factor * F[3]


@inlined
def matrix_times_vector(F, v):
    """Return F v."""
    return F[0] * v[0] + F[2] * v[1], F[1] * v[0] + F[3] * v[1]


@inlined
def add_outer_product(F, v, w):
    """Return F + v (x) w."""
    return F[0] + v[0] * w[0], F[1] + v[1] * w[0], F[2] + v[0] * w[1], F[3] + v[1] * w[1]
