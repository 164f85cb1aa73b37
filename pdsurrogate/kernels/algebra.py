"""Vector and matrix algebra in two and three dimensions, written once over the number of
components.

`algebra_of` builds a module of functions for a dimension d; kernels are written over such a module,
and `ByDimension` makes them from it. The components of a vector are in the order 1, …, d, those of
a matrix by columns (in the plane 11, 21, 12, 22), and those of a symmetric matrix by the rows of
its upper triangle (11, 12, 22). All functions take tuples of reals or rows of arrays and are
inlined into their callers. Most are made from one expression for each entry of their result, as
``v[0] + w[0]``: numba compiles the tuple of these without loops and arrays, and all entries stay in
registers.
"""

from collections.abc import Callable
from functools import cache
from types import ModuleType

import numpy as np  # noqa: F401 - read by expressions

from ..engine import vector_loads
from ..engine.block_arrays import put_row, rows_of
from ..engine.compile import inlined
from .elementary import like  # noqa: F401 - read by expressions


def entries(arguments, expressions):
    """Return an inlined function with the parameters `arguments`, "x, y", that returns the tuple
    of the values of Python expressions.
    """
    return scalar(arguments, f"({', '.join(expressions)},)")


def scalar(arguments, expression):
    """Return an inlined function with the parameters `arguments`, as in "x, y", that returns the
    value of a Python expression.
    """
    return inlined(eval(f"lambda {arguments}: {expression}", globals()))


def total(terms):
    """Return the Python expression, as text, that adds the given terms from left to right."""
    return " + ".join(terms)


state_at = entries("states, k", [f"states[{r}, k]" for r in range(5)])
"""Function ``state_at(states, k)``: the state (a, b, U_mm, J, C33) of bond k of a block."""


@cache
def algebra_of(dimension):
    """Return the module of functions on vectors and matrices in 2 or 3 dimensions; it is made
    once for each dimension.
    """
    found = ModuleType(f"{__name__}_{dimension}")
    vars(found).update(_components(dimension))
    vars(found).update(_plane(found) if dimension == 2 else _space(found))
    return found


class ByDimension(dict):
    """Table of kernels by dimension d, 2 or 3, used as a decorator of a function `build`: entry d
    is ``build(algebra_of(d))``.

    The table makes each kernel on first use: a sheet compiles nothing for three dimensions.
    """

    def __init__(self, build: Callable) -> None:
        super().__init__()
        self._build = build
        self.__doc__ = build.__doc__

    def __missing__(self, dimension: int):
        """Build the kernel of a dimension, keep it in the table, and return it."""
        self[dimension] = self._build(algebra_of(dimension))
        return self[dimension]


def _components(d):
    """Return, by name, the functions on vectors and matrices that have one general formula for
    every number of dimensions `d`.
    """
    axes = range(d)
    upper = [(r, c) for r in axes for c in range(r, d)]
    symmetric = range(len(upper))
    matrix = range(d * d)
    # Places of the entries (r, c) of symmetric matrices and of matrices, and which of these lie on
    # the diagonal.
    Z = {place: n for n, (r, c) in enumerate(upper) for place in ((r, c), (c, r))}
    F = {(r, c): c * d + r for c in axes for r in axes}

    def added_to_diagonal(name, places):
        on_diagonal = {places[r, r] for r in axes}
        numbers = sorted({*places.values()})
        return entries(
            f"{name}, value",
            [f"{name}[{n}] + value" if n in on_diagonal else f"{name}[{n}]" for n in numbers],
        )

    def mixed(r, c):
        return (
            f"factor * (v[{r}] * w[{r}])"
            if r == c
            else f"factor * 0.5 * (v[{r}] * w[{c}] + v[{c}] * w[{r}])"
        )

    def cofactor(name, places, r, c):
        """Return the expression, as text, of entry (r, c) of det F times F^-T, the cofactor of the
        matrix F in the variable `name`.

        `places` maps the row and column of an entry of F to its index in that variable.
        """
        a = (r + 1) % d
        b = (r + 2) % d
        e = (c + 1) % d
        f = (c + 2) % d
        if d == 2:
            return f"{'' if r == c else '-'}{name}[{places[a, e]}]"
        return (
            f"({name}[{places[a, e]}] * {name}[{places[b, f]}] - {name}[{places[b, e]}] *"
            f" {name}[{places[a, f]}])"
        )

    def determinant(name, places):
        return total(f"{name}[{places[r, 0]}] * {cofactor(name, places, r, 0)}" for r in axes)

    determinant_of = scalar("K", determinant("K", Z))
    trace_of = scalar("K", total(f"K[{Z[r, r]}]" for r in axes))

    @inlined
    def shape_quality(K):
        """Return the quality det K/(tr K/d)^d of a shape tensor K: 1 for a multiple of I, 0 for
        a singular K or a K with zero trace.
        """
        trace = trace_of(K)
        return d**d * determinant_of(K) / trace**d if trace > 0.0 else 0.0

    return {
        "DIMENSION": d,
        "MATRIX": len(matrix),
        # Arrays of records: views with rows of a compile-time length, access to one row or column,
        # and writing of a row.
        "vector_rows": rows_of(d),
        "symmetric_rows": rows_of(len(symmetric)),
        "matrix_rows": rows_of(len(matrix)),
        "vector_at": entries("array, k", [f"array[k, {r}]" for r in axes]),
        "symmetric_at": entries("array, k", [f"array[k, {r}]" for r in symmetric]),
        "matrix_at": entries("array, k", [f"array[k, {r}]" for r in matrix]),
        "column_at": entries("rows, k", [f"rows[{r}, k]" for r in axes]),
        "column_in": entries(
            "rows, k, x", [f"like(x, rows[{r}, k])" for r in axes]
        ),  # in the precision of x
        "matrix_column_at": entries("rows, k", [f"rows[{r}, k]" for r in matrix]),
        "matrix_column_in": entries("rows, k, x", [f"like(x, rows[{r}, k])" for r in matrix]),
        "put": put_row,
        # Loads and sums over bonds, see `pdsurrogate.engine.vector_loads`.
        "gather_pairs": vector_loads.gather_pairs(d),
        "add_at_ends": vector_loads.add_at_ends(d),
        "sum_at_point": vector_loads.sum_at_point(d),
        "subtract_positions": vector_loads.subtract_positions(d),
        "sum_matrix_products": vector_loads.sum_matrix_products(d),
        "sum_signed_records": vector_loads.sum_records(d),
        # Vectors; 1 if a component is infinite or NaN, else 0: the sum of finite components must
        # not overflow.
        "no_vector": entries("", ["0.0" for _ in axes]),
        "plus": entries("v, w", [f"v[{r}] + w[{r}]" for r in axes]),
        "minus": entries("v, w", [f"v[{r}] - w[{r}]" for r in axes]),
        "times": entries("factor, v", [f"factor * v[{r}]" for r in axes]),
        "dot": scalar("v, w", total(f"v[{r}] * w[{r}]" for r in axes)),
        "greatest": scalar("v", f"max({', '.join(f'abs(v[{r}])' for r in axes)})"),
        "not_finite": scalar("v", f"0 if {total(f'abs(v[{r}])' for r in axes)} < np.inf else 1"),
        # Symmetric matrices: K + factor sym(v (x) w), a multiple, a multiple of I added, Z v, and
        # the inverse.
        "no_symmetric": entries("", ["0.0" for _ in symmetric]),
        "add_symmetric_product": entries(
            "K, factor, v, w", [f"K[{n}] + {mixed(r, c)}" for n, (r, c) in enumerate(upper)]
        ),
        "times_factor": entries("factor, K", [f"factor * K[{n}]" for n in symmetric]),
        "plus_isotropic": added_to_diagonal("K", Z),
        "symmetric_times_vector": entries(
            "Z, v", [total(f"Z[{Z[r, c]}] * v[{c}]" for c in axes) for r in axes]
        ),
        "inverse_symmetric": entries(
            "K", [f"{cofactor('K', Z, r, c)} / ({determinant('K', Z)})" for r, c in upper]
        ),
        "shape_quality": shape_quality,
        # Matrices: F : F, which is the trace of F^T F, the determinant and the cofactor, zero, a
        # sum, a multiple, a multiple of I added, F v, F Z, and F + v (x) w.
        "squared_norm": scalar("F", total(f"F[{n}] * F[{n}]" for n in matrix)),
        "determinant": scalar("F", determinant("F", F)),
        "cofactor": entries("F", [cofactor("F", F, r, c) for c in axes for r in axes]),
        "no_matrix": entries("", ["0.0" for _ in matrix]),
        "plus_matrix": entries("F, G", [f"F[{n}] + G[{n}]" for n in matrix]),
        "times_matrix": entries("factor, F", [f"factor * F[{n}]" for n in matrix]),
        "plus_diagonal": added_to_diagonal("F", F),
        "matrix_times_vector": entries(
            "F, v", [total(f"F[{F[r, c]}] * v[{c}]" for c in axes) for r in axes]
        ),
        "times_symmetric": entries(
            "F, Z",
            [total(f"F[{F[r, k]}] * Z[{Z[k, c]}]" for k in axes) for c in axes for r in axes],
        ),
        "add_outer_product": entries(
            "F, v, w", [f"F[{F[r, c]}] + v[{r}] * w[{c}]" for c in axes for r in axes]
        ),
    }


def _plane(algebra):
    """Return, by name, the functions on matrices and states whose formulas hold in two
    dimensions only.
    """

    @inlined
    def response_state(F, volume_ratio):
        """Return the state on which the plane-stress response of a law depends: tr C and det F
        in the plane, and the volume ratio J3.
        """
        return algebra.squared_norm(F), algebra.determinant(F), volume_ratio

    @inlined
    def first_piola(F, state, result, unit):
        """Return the first Piola-Kirchhoff stress P = (p F + q F^-T) unit in the plane.

        `result` (p, q) is a law's response in the `state` (tr C, J, J3), and `unit` is a factor,
        such as the shear modulus.
        """
        p = result[0] * unit
        q = result[1] / state[1] * unit
        return algebra.plus_matrix(
            algebra.times_matrix(p, F), algebra.times_matrix(q, algebra.cofactor(F))
        )

    return {
        "response_state": response_state,
        "stress_by_trace": first_piola,
        "first_piola": first_piola,
        "sum_outer_products": vector_loads.sum_outer_products,
    }


def _space(algebra):
    """Return, by name, the functions on matrices and states whose formulas hold in three
    dimensions only.
    """
    right_cauchy_green = entries(
        "F",
        [
            total(f"F[{3 * r + k}] * F[{3 * c + k}]" for k in range(3))
            for r in range(3)
            for c in range(r, 3)
        ],
    )

    @inlined
    def response_state(F, volume_ratio):
        """Return the state on which the response of a law depends in three dimensions: tr C, tr cof
        C and det F.

        `volume_ratio` is unused, since the volume ratio of a solid is det F.
        """
        return (
            algebra.squared_norm(F),
            algebra.squared_norm(algebra.cofactor(F)),
            algebra.determinant(F),
        )

    @inlined
    def stress_by_trace(F, state, result, unit):
        """Return `first_piola` where r is zero, as with laws that do not depend on tr cof C."""
        p = result[0] * unit
        q = result[1] * unit
        return algebra.plus_matrix(
            algebra.times_matrix(p, F), algebra.times_matrix(q, algebra.cofactor(F))
        )

    @inlined
    def first_piola(F, state, result, unit):
        """Return the first Piola-Kirchhoff stress P = (p F + q cof F + r F C) unit in three
        dimensions.

        `result` (p, q, r) is a law's response to F, and `unit` is a factor, such as the shear
        modulus; `state` is unused.
        """
        P = stress_by_trace(F, state, result, unit)
        r = result[2] * unit
        return algebra.plus_matrix(
            P, algebra.times_matrix(r, algebra.times_symmetric(F, right_cauchy_green(F)))
        )

    return {
        "response_state": response_state,
        "stress_by_trace": stress_by_trace,
        "first_piola": first_piola,
        "sum_outer_products": vector_loads.sum_outer_products_in_space,
    }
