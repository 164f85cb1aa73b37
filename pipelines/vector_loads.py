"""Gain of the explicit vector loads of `pdsurrogate.engine.vector_loads` over plain loops, on the bonds of a sheet and of a block.

python pipelines/vector_loads.py       print the table (about two minutes, most of them compiling)

Each function runs over all points or pairs of a body on one thread, in turns with a plain loop that does the same and is compiled with the
same options. The cost of either is its least over all turns.
"""

from __future__ import annotations

import time

import numba
import numpy as np
from hard_cases import regular

from pdsurrogate.engine import vector_loads as loads
from pdsurrogate.engine.block_arrays import BLOCK, aligned_rows, block_rows, put_row
from pdsurrogate.engine.compile import OPTIONS, widest_vectors
from pdsurrogate.kernels.algebra import entries

TURNS = 60
"""Turns of each function, of some milliseconds."""


def compiled(function):
    """Compile a pass without a cache."""
    return numba.njit(**OPTIONS)(function)


def gather(intrinsic, width, dimension):
    """Return the pass over blocks of pairs by an intrinsic, and its plain twin."""

    @compiled
    def fast(table, positions, first, second, sums, bonds):
        widest_vectors()
        sums, bonds = block_rows(sums), block_rows(bonds)
        for at in range(0, first.shape[0], BLOCK):
            for k in range(0, BLOCK, 4):
                intrinsic(table, positions, (first, second), at + k, sums, bonds, k)

    @compiled
    def plain(table, positions, first, second, sums, bonds):
        widest_vectors()
        sums, bonds = block_rows(sums), block_rows(bonds)
        for at in range(0, first.shape[0], BLOCK):
            for k in range(BLOCK):
                i, j = first[at + k], second[at + k]
                for r in range(width):
                    sums[r, k] = table[i, r] + table[j, r]
                for r in range(dimension):
                    bonds[r, k] = positions[j, r] - positions[i, r]

    return fast, plain


def subtract(dimension):
    """Return the pass that subtracts positions by the intrinsic, and its plain twin."""
    intrinsic = loads.subtract_positions(dimension)

    @compiled
    def fast(positions, first, second, bonds):
        widest_vectors()
        bonds = block_rows(bonds)
        for at in range(0, first.shape[0], BLOCK):
            for k in range(0, BLOCK, 4):
                intrinsic(positions, (first, second), at + k, bonds, k)

    @compiled
    def plain(positions, first, second, bonds):
        widest_vectors()
        bonds = block_rows(bonds)
        for at in range(0, first.shape[0], BLOCK):
            for k in range(BLOCK):
                i, j = first[at + k], second[at + k]
                for r in range(dimension):
                    bonds[r, k] = positions[j, r] - positions[i, r]

    return fast, plain


def put(length):
    """Return the pass that writes blocks of rows as records by the intrinsic, and its plain twin."""
    intrinsic = loads.put_records(length)

    @compiled
    def fast(rows, records):
        widest_vectors()
        rows = block_rows(rows)
        for at in range(0, records.shape[0], BLOCK):
            for k in range(0, BLOCK, 4):
                intrinsic(rows, k, records, at + k)

    @compiled
    def plain(rows, records):
        widest_vectors()
        rows = block_rows(rows)
        for at in range(0, records.shape[0], BLOCK):
            for k in range(BLOCK):
                for r in range(length):
                    records[at + k, r] = rows[r, k]

    return fast, plain


@compiled
def outer_sums(positions, pointers, neighbors, weights, out):
    """Sum outer products by the intrinsic."""
    for i in range(pointers.shape[0] - 1):
        loads.sum_outer_products(positions, neighbors, weights, (pointers[i], pointers[i + 1]), i, out)


@compiled
def outer_sums_plain(positions, pointers, neighbors, weights, out):
    """Sum outer products by a plain loop."""
    for i in range(pointers.shape[0] - 1):
        x, y, a, b, c, d = positions[i, 0], positions[i, 1], 0.0, 0.0, 0.0, 0.0
        for k in range(pointers[i], pointers[i + 1]):
            j = neighbors[k]
            p, q, v, w = positions[j, 0] - x, positions[j, 1] - y, weights[k, 0], weights[k, 1]
            a, b, c, d = a + p * v, b + q * v, c + p * w, d + q * w
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = a, b, c, d


def products(intrinsic, dimension):
    """Return the pass that sums products of matrices and vectors by an intrinsic, and its plain twin."""

    @compiled
    def fast(matrices, pointers, neighbors, vectors, out):
        for i in range(pointers.shape[0] - 1):
            intrinsic(matrices, neighbors, vectors, (pointers[i], pointers[i + 1]), i, out)

    @compiled
    def plain_2(matrices, pointers, neighbors, vectors, out):
        for i in range(pointers.shape[0] - 1):
            s, t = 0.0, 0.0
            for k in range(pointers[i], pointers[i + 1]):
                j, v, w = neighbors[k], vectors[k, 0], vectors[k, 1]
                s += (matrices[i, 0] + matrices[j, 0]) * v + (matrices[i, 2] + matrices[j, 2]) * w
                t += (matrices[i, 1] + matrices[j, 1]) * v + (matrices[i, 3] + matrices[j, 3]) * w
            out[i, 0], out[i, 1] = s, t

    @compiled
    def plain_3(matrices, pointers, neighbors, vectors, out):
        for i in range(pointers.shape[0] - 1):
            s, t, u = 0.0, 0.0, 0.0
            for k in range(pointers[i], pointers[i + 1]):
                j, v, w, z = neighbors[k], vectors[k, 0], vectors[k, 1], vectors[k, 2]
                s += (matrices[i, 0] + matrices[j, 0]) * v + (matrices[i, 3] + matrices[j, 3]) * w + (matrices[i, 6] + matrices[j, 6]) * z
                t += (matrices[i, 1] + matrices[j, 1]) * v + (matrices[i, 4] + matrices[j, 4]) * w + (matrices[i, 7] + matrices[j, 7]) * z
                u += (matrices[i, 2] + matrices[j, 2]) * v + (matrices[i, 5] + matrices[j, 5]) * w + (matrices[i, 8] + matrices[j, 8]) * z
            out[i, 0], out[i, 1], out[i, 2] = s, t, u

    return fast, plain_2 if dimension == 2 else plain_3


def record_sums(length, sign):
    """Return the pass that sums records by an intrinsic, and its plain twin."""
    intrinsic = loads.sum_records(length, sign, fetched=length in (3, 9))
    record = entries("rows, k", [f"np.float64(rows[k, {r}])" for r in range(length)])
    plus = entries("v, w", [f"v[{r}] + w[{r}]" for r in range(length)])
    combine = plus if sign > 0 else entries("v, w", [f"v[{r}] - w[{r}]" for r in range(length)])
    zero = entries("", ["0.0"] * length)

    @compiled
    def fast(records, pointers, others, indices, out):
        for i in range(pointers.shape[0] - 1):
            intrinsic(records, (pointers[i], pointers[i + 1]), (indices, indices.shape[0]), (others[i], others[i + 1]), 1.0, i, out)

    @compiled
    def plain(records, pointers, others, indices, out):
        for i in range(pointers.shape[0] - 1):
            total = zero()
            for k in range(pointers[i], pointers[i + 1]):
                total = plus(total, record(records, k))
            for k in range(others[i], others[i + 1]):
                total = combine(total, record(records, indices[k]))
            put_row(out, i, total)

    return fast, plain


@compiled
def outer_table(positions, pointers, neighbors, weights, table):
    """Write outer products by the intrinsic."""
    for i in range(pointers.shape[0] - 1):
        loads.outer_products(positions, neighbors, weights, (pointers[i], pointers[i + 1]), i, table)


@compiled
def outer_table_plain(positions, pointers, neighbors, weights, table):
    """Write outer products by a plain loop."""
    for i in range(pointers.shape[0] - 1):
        x, y, start = positions[i, 0], positions[i, 1], pointers[i]
        for k in range(pointers[i], pointers[i + 1]):
            j = neighbors[k]
            p, q, v, w = positions[j, 0] - x, positions[j, 1] - y, weights[k, 0], weights[k, 1]
            at = k - start
            table[at, 0], table[at, 1], table[at, 2], table[at, 3] = p * v, q * v, p * w, q * w


@compiled
def listed_sums(records, pointers, listed, out):
    """Sum listed records of four doubles by the intrinsic."""
    for i in range(pointers.shape[0] - 1):
        loads.sum_listed_records(records, listed, (pointers[i], pointers[i + 1]), out, i)


@compiled
def listed_sums_plain(records, pointers, listed, out):
    """Sum listed records of four doubles by a plain loop."""
    for i in range(pointers.shape[0] - 1):
        s, t, u, v = 0.0, 0.0, 0.0, 0.0
        for k in range(pointers[i], pointers[i + 1]):
            p = listed[k]
            s, t, u, v = s + records[p, 0], t + records[p, 1], u + records[p, 2], v + records[p, 3]
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = s, t, u, v


def multiply(dimension):
    """Return the pass that multiplies records of pairs with those of their ends, and its plain twin."""
    intrinsic, length = loads.multiply_pairs(dimension), dimension + dimension**2

    @compiled
    def fast(pairs, points, pointers, second, out):
        for i in range(pointers.shape[0] - 1):
            intrinsic(pairs, points, i, second, (pointers[i], pointers[i + 1]), out)

    @compiled
    def plain(pairs, points, pointers, second, out):
        for i in range(pointers.shape[0] - 1):
            for k in range(pointers[i], pointers[i + 1]):
                j, total = second[k], np.float32(0.0)
                for r in range(dimension):
                    total += pairs[k, r] * (points[j, r] - points[i, r])
                for r in range(dimension, length):
                    total += pairs[k, r] * (points[j, r] + points[i, r])
                out[k] = total

    return fast, plain


def scaled(dimension):
    """Return the pass that sums records of pairs times factors, and its plain twin."""
    intrinsic, length = loads.sum_scaled_records(dimension), dimension + dimension**2

    @compiled
    def fast(records, factors, pointers, others, indices, vectors, matrices):
        for i in range(pointers.shape[0] - 1):
            both = (pointers[i], pointers[i + 1]), (indices, indices.shape[0]), (others[i], others[i + 1])
            intrinsic(records, factors, *both, i, (vectors, matrices))

    @compiled
    def plain(records, factors, pointers, others, indices, vectors, matrices):
        for i in range(pointers.shape[0] - 1):
            vectors[i, :], matrices[i, :] = 0, 0
            for k in range(pointers[i], pointers[i + 1]):
                for r in range(dimension):
                    vectors[i, r] += records[k, r] * factors[k]
                for r in range(dimension, length):
                    matrices[i, r - dimension] += records[k, r] * factors[k]
            for k in range(others[i], others[i + 1]):
                p = indices[k]
                for r in range(dimension):
                    vectors[i, r] -= records[p, r] * factors[p]
                for r in range(dimension, length):
                    matrices[i, r - dimension] += records[p, r] * factors[p]

    return fast, plain


def weighted(width):
    """Return the pass that multiplies a sparse matrix with rows of reals, and its plain twin."""
    intrinsic = loads.sum_weighted_rows(width)

    @compiled
    def fast(weights, pointers, columns, rows, out):
        for i in range(pointers.shape[0] - 1):
            intrinsic(weights, columns, (pointers[i], pointers[i + 1]), rows, i, out)

    @compiled
    def plain(weights, pointers, columns, rows, out):
        for i in range(pointers.shape[0] - 1):
            for r in range(width):
                out[i, r] = 0
            for k in range(pointers[i], pointers[i + 1]):
                for r in range(width):
                    out[i, r] += weights[k] * rows[columns[k], r]

    return fast, plain


def cases():
    """Yield a name, both functions, and their arguments, the last of which is an output."""
    random = np.random.default_rng(0)

    def drawn(*shape, dtype=np.float64):
        return random.standard_normal(shape).astype(dtype)

    for dimension, cells in ((2, 80), (3, 18)):
        body, d, m = regular(dimension, cells), dimension, dimension**2
        bonds, n = body.bonds, len(body)
        first, second = bonds.ends_in_blocks(BLOCK)
        pairs, table, directed = len(first), (bonds.pointers, bonds.neighbors), len(bonds.neighbors)
        incidence = bonds.pair_pointers, bonds.incidence_pointers, bonds.incidence
        for dtype in (np.float32, np.float64):
            name = f"{d}D, {np.dtype(dtype).name}"
            rows = aligned_rows((m, BLOCK), dtype), aligned_rows((d, BLOCK), dtype)
            ends = body.points, first, second
            yield f"gather_pairs, {name}", gather(loads.gather_pairs(d), m, d), (drawn(n, m, dtype=dtype), *ends, *rows)
            weights = drawn(directed, d, dtype=dtype)
            summed_products = products(loads.sum_matrix_products(d), d)
            yield f"sum_matrix_products, {name}", summed_products, (drawn(n, m), *table, weights, np.zeros((n, d)))
            yield f"subtract_positions, {name}", subtract(d), (*ends, rows[1])
            for length in (d, m):
                yield f"put_records({length}), {name}", put(length), (drawn(length, BLOCK), np.zeros((pairs, length), dtype))
            if d == 2:
                yield f"sum_outer_products, {name}", (outer_sums, outer_sums_plain), (body.points, *table, weights, np.zeros((n, 4)))
            for length, sign in ((d, -1), (m, 1)):
                arguments = drawn(pairs, length, dtype=dtype), *incidence, np.zeros((n, length))
                yield f"sum_records({length}), {name}", record_sums(length, sign), arguments
        if d == 2:
            weights = drawn(directed, 2)
            yield "outer_products, 2D", (outer_table, outer_table_plain), (body.points, *table, weights, np.zeros((64, 4)))
            yield "sum_listed_records, 2D", (listed_sums, listed_sums_plain), (drawn(n, 4), *table, np.zeros((n, 4)))
        single = np.float32
        records, points = drawn(pairs, d + m, dtype=single), drawn(n, d + m, dtype=single)
        pair_pointers = bonds.pair_pointers
        yield f"multiply_pairs, {d}D", multiply(d), (records, points, pair_pointers, second, np.zeros(pairs, single))
        yield (
            f"sum_scaled_records, {d}D",
            scaled(d),
            (records, drawn(pairs, dtype=single), *incidence, np.zeros((n, d), single), np.zeros((n, m), single)),
        )
        for width in (1, d, 7):
            yield (
                f"sum_weighted_rows({width}), {d}D",
                weighted(width),
                (drawn(directed, dtype=single), *table, drawn(n, width, dtype=single), np.zeros((n, width), single)),
            )


def main() -> None:
    """Print the gain of every function."""
    for name, functions, arguments in cases():
        results, best = [], [np.inf, np.inf]
        for function in functions:
            function(*arguments)
            results.append(np.array(arguments[-1], dtype=float))
        scale = np.abs(results[1]).max()
        assert np.abs(results[0] - results[1]).max() <= 1e-4 * scale, name
        for _ in range(TURNS):
            for number, function in enumerate(functions):
                began = time.perf_counter()
                function(*arguments)
                best[number] = min(best[number], time.perf_counter() - began)
        print(f"{name:40s} {1e6 * best[0]:9.1f} us {1e6 * best[1]:9.1f} us   {best[1] / best[0]:5.2f}", flush=True)


if __name__ == "__main__":
    main()
