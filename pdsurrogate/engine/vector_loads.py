"""Records of a few reals that are loaded, combined and stored as vectors of the processor, and sums of them.

A point's position is a record of two or three doubles, its gradient one of four or nine reals. LLVM compiles a plain loop over bonds into
gather instructions, one component of a record at a time; loading whole records as vectors is faster. Each function states how many times
as long a plain loop takes, by ``python pipelines/vector_loads.py`` on one thread of an AMD EPYC with AVX-512 on 23 November 2026, in single
and in double precision where both occur; one that gains less than 1.3 has no place here. ``tests/kernels/test_kernels.py`` compares the
results.
"""

from functools import cache

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.extending import intrinsic, register_model

from .block_arrays import BLOCK
from .compile import inlined
from .intrinsics import data_of

MOST_LANES = 8
"""Greatest length of a vector; a longer record is two vectors, since LLVM would take, say, a vector of nine apart into single reals."""

REAL_BYTES = {ir.FloatType(): 4, ir.DoubleType(): 8}


class Record(types.Type):
    """Numba type of a record of reals, kept in one or two vectors of the processor."""

    def __init__(self, dtype, count):
        super().__init__(f"Record({dtype}, {count})")
        self.dtype, self.count = dtype, count


@register_model(Record)
class _RecordModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        scalar = manager.lookup(kind.dtype).get_value_type()
        super().__init__(manager, kind, ir.LiteralStructType([ir.VectorType(scalar, count) for _, count in _parts(kind.count)]))


def _parts(count):
    """Return the first component and the length of each vector of a record."""
    return [(at, min(MOST_LANES, count - at)) for at in range(0, count, MOST_LANES)]


def _compiled(result):
    """Return a decorator of ``build(builder, kinds, *values)``, which becomes an intrinsic.

    `build` gets arrays as addresses, and tuples and records as lists; it returns a record as a list. ``result(*kinds)`` is the numba type
    of what it builds; there is none for arguments that must be literals and are not.
    """

    def decorate(build):
        @intrinsic
        def called(typingctx, *kinds):
            def codegen(context, builder, signature, values):
                built = build(builder, kinds, *data_of(context, builder, signature.args[0], values[0]))
                if signature.return_type == types.void:
                    return context.get_dummy_value()
                return cgutils.pack_struct(builder, built) if isinstance(signature.return_type, Record) else built

            kinds = tuple(kinds[0]) if isinstance(kinds[0], types.BaseTuple) and len(kinds) == 1 else kinds
            found = result(*kinds)
            return found and (found(types.StarArgTuple(kinds)), codegen)

        return called

    return decorate


def _of_length(dtype, count):
    return Record(dtype, count.literal_value) if isinstance(count, types.IntegerLiteral) else None


def _shuffled(builder, vector, other, lanes):
    return builder.shuffle_vector(vector, other, ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes)))


def _chosen(builder, record, numbers):
    """Return one vector of the components with the given numbers."""
    whole = record[0]
    if len(record) > 1:
        rest = record[1].type.count
        whole = _shuffled(
            builder, whole, _shuffled(builder, record[1], record[1], [n % rest for n in range(MOST_LANES)]), range(MOST_LANES + rest)
        )
    return _shuffled(builder, whole, whole, numbers)


def _at(builder, data, place, count):
    """Return the address of a vector at a place of an array of reals."""
    return builder.bitcast(builder.gep(data, [place], inbounds=True), ir.VectorType(data.type.pointee, count).as_pointer())


def _put(builder, vector, data, place):
    """Write a vector into an array of either precision."""
    builder.store(
        _converted(builder, vector, data.type.pointee), _at(builder, data, place, vector.type.count), REAL_BYTES[data.type.pointee]
    )


def _places(builder, kind, index, count):
    """Return the place and the length of each vector of a record in an array; see `load`."""
    index = builder.zext(index, ir.IntType(64)) if index.type.width < 64 else index
    first = builder.mul(index, ir.Constant(index.type, count if kind.ndim == 2 else 1))
    return [(builder.add(first, ir.Constant(index.type, at)), size) for at, size in _parts(count)]


def _converted(builder, vector, scalar):
    if vector.type.element == scalar:
        return vector
    target = ir.VectorType(scalar, vector.type.count)
    return builder.fptrunc(vector, target) if scalar == ir.FloatType() else builder.fpext(vector, target)


@_compiled(lambda array, index, count: _of_length(array.dtype, count))
def load(builder, kinds, array, index, count):
    """Return row `index` of an array of rows of `count` reals, a literal, or as many reals of a flat array from entry `index` on."""
    align = REAL_BYTES[array.type.pointee]
    places = _places(builder, kinds[0], index, kinds[2].literal_value)
    return [builder.load(_at(builder, array, place, size), align=align) for place, size in places]


@_compiled(lambda array, index, record: types.void)
def store(builder, kinds, array, index, record):
    """Write a record where `load` would read it, in the precision of the array."""
    for vector, (place, _) in zip(record, _places(builder, kinds[0], index, kinds[2].count), strict=True):
        _put(builder, vector, array, place)


@_compiled(lambda rows, column, records: types.void)
def store_columns(builder, kinds, rows, column, records):
    """Write four records as columns of a block, from the given one on."""
    count = kinds[2].dtype.count
    whole = [_chosen(builder, record, range(count)) for record in records]
    halves = [_shuffled(builder, *whole[n : n + 2], [m for r in range(count) for m in (r, count + r)]) for n in (0, 2)]
    for r in range(count):
        row = _shuffled(builder, *halves, [2 * r, 2 * r + 1, 2 * (count + r), 2 * (count + r) + 1])
        _put(builder, row, rows, builder.add(column, ir.Constant(column.type, r * BLOCK)))


def _operation(name):
    # A product and a sum may become one instruction.
    @_compiled(lambda v, w: v)
    def operation(builder, kinds, v, w):
        return [getattr(builder, name)(*parts, flags=("contract",)) for parts in zip(v, w, strict=True)]

    return operation


plus, minus, times = _operation("fadd"), _operation("fsub"), _operation("fmul")


@_compiled(lambda record: Record(types.float64, record.count))
def doubles(builder, kinds, record):
    """Return a record in double precision."""
    return [_converted(builder, part, ir.DoubleType()) for part in record]


@_compiled(lambda v, w: Record(v.dtype, 2 * v.count))
def joined(builder, kinds, v, w):
    """Return one record of the components of two of the same length, at most four."""
    return [_shuffled(builder, *v, *w, range(2 * v[0].type.count))]


@_compiled(lambda values, count: _of_length(values.dtype, count))
def record_of(builder, kinds, values, count):
    """Return a record of `count` components, a literal, that repeats the values of a tuple in turn."""
    parts = []
    for at, size in _parts(kinds[1].literal_value):
        parts.append(ir.Constant(ir.VectorType(values[0].type, size), ir.Undefined))
        for n in range(size):
            parts[-1] = builder.insert_element(parts[-1], values[(at + n) % len(values)], ir.Constant(ir.IntType(32), n))
    return parts


@_compiled(lambda record: types.UniTuple(record.dtype, record.count))
def values_of(builder, kinds, record):
    """Return the components of a short record as a tuple."""
    return cgutils.pack_array(builder, [builder.extract_element(*record, ir.Constant(ir.IntType(32), n)) for n in range(kinds[0].count)])


@cache
def components(*numbers):
    """Return the intrinsic that makes a record of the components of another that have the given numbers."""

    @_compiled(lambda record: Record(record.dtype, len(numbers)))
    def chosen(builder, kinds, record):
        return [_chosen(builder, record, numbers[at : at + size]) for at, size in _parts(len(numbers))]

    return chosen


@cache
def folded(length, count):
    """Return the function that adds the components of a record of `count` whose numbers are equal modulo `length`."""
    found, *others = (components(*range(at, at + length)) for at in range(0, count, length))
    for piece in others:
        found = _sum_of_both(found, piece)
    return found


def _sum_of_both(first, second):
    return inlined(lambda record: plus(first(record), second(record)))


_ONE = np.uint64(1)


def sums_of(of_two, of_one):
    """Return the function ``sums(bonds, zero, of)`` of two sums over b from ``bonds[0]`` to ``bonds[1]``.

    They run at the same time, so that one addition need not wait for the one before. ``of_two(b, of)`` returns what b and b + 1 add to
    either, and ``of_one(b, of, zero)`` what the last b adds if it has no partner.
    """
    of_two, of_one = inlined(of_two), inlined(of_one)

    @inlined
    def sums(bonds, zero, of):
        start, stop = np.uint64(bonds[0]), np.uint64(bonds[1])
        first, second = zero, zero
        pairs = (stop - start) >> _ONE
        for pair in range(pairs):
            terms = of_two(start + pair + pair, of)
            first, second = plus(first, terms[0]), plus(second, terms[1])
        for b in range(start + pairs + pairs, stop):
            terms = of_one(b, of, zero)
            first, second = plus(first, terms[0]), plus(second, terms[1])
        return first, second

    return sums


def total_of(term):
    """Return the function ``total(bonds, zero, of)`` that adds the records ``term(b, of)`` for b from ``bonds[0]`` to ``bonds[1]``."""
    term = inlined(term)
    sums = sums_of(lambda b, of: (term(b, of), term(b + _ONE, of)), lambda b, of, zero: (term(b, of), zero))

    @inlined
    def total(bonds, zero, of):
        first, second = sums(bonds, zero, of)
        return plus(first, second)

    return total


def _for_four_pairs(of_ends, length):
    """Return the function that writes the records ``of_ends(array, first, second)`` of four pairs as columns of a block."""

    @inlined
    def of_pair(array, ends, pair):
        return of_ends(load(array, ends[0][pair], length), load(array, ends[1][pair], length))

    @inlined
    def write(array, ends, at, out, column):
        # Numbers without sign need no test for places counted from the end.
        a, b, c, d = np.uint64(at), np.uint64(at + 1), np.uint64(at + 2), np.uint64(at + 3)
        store_columns(out, column, (of_pair(array, ends, a), of_pair(array, ends, b), of_pair(array, ends, c), of_pair(array, ends, d)))

    return write


@cache
def subtract_positions(dimension):
    """Return the function that writes the differences of positions as `gather_pairs` does; a plain loop takes 2.0 times as long."""
    return _for_four_pairs(inlined(lambda first, second: minus(second, first)), dimension)


@cache
def gather_pairs(dimension):
    """Return the function that sums the matrices and subtracts the positions of the ends of four pairs, one row of a block per component.

    ``sums[r, column + k] = matrices[first[at + k], r] + matrices[second[at + k], r]`` and ``differences[r, column + k] =
    positions[second[at + k], r] - positions[first[at + k], r]``, each for k in 0 … 3, where ``ends = first, second``. A plain loop takes
    2.9 (float32) or 2.4 (float64) times as long in the plane, 2.1 or 2.0 times in three dimensions.
    """
    add, subtract = _for_four_pairs(plus, dimension**2), subtract_positions(dimension)

    @inlined
    def gather(matrices, positions, ends, at, sums, differences, column):
        add(matrices, ends, at, sums, column)
        subtract(positions, ends, at, differences, column)

    return gather


_by_row, _by_column = components(0, 1, 0, 1), components(0, 0, 1, 1)


@inlined
def outer_products(positions, neighbours, weights, bonds, point, out):
    """Write ``out[b - start] = (positions[neighbours[b]] - positions[point]) (x) weights[b]`` for b in bonds, by columns, in the plane.

    A plain loop takes 2.0 times as long.
    """
    own = _by_row(load(positions, point, 2))
    for b in range(bonds[0], bonds[1]):
        difference = minus(_by_row(load(positions, neighbours[b], 2)), own)
        store(out, b - bonds[0], times(difference, _by_column(load(weights, b, 2))))


_of_first, _of_second, _half, _to_column = components(0, 0, 2, 2), components(1, 1, 3, 3), components(0, 1), folded(2, 4)


@inlined
def _columns(ends, own, weights):
    """Return two bonds' differences, each times the first and times the second component of its weight."""
    differences, across = minus(ends, own), doubles(weights)
    return times(differences, _of_first(across)), times(differences, _of_second(across))


def _of_two(b, of):
    own, positions, neighbours, weights = of
    ends = joined(load(positions, neighbours[b], 2), load(positions, neighbours[b + _ONE], 2))
    return _columns(ends, own, joined(load(weights, b, 2), load(weights, b + _ONE, 2)))


def _of_one(b, of, zero):
    own, positions, neighbours, weights = of
    weight = load(weights, b, 2)
    return _columns(joined(load(positions, neighbours[b], 2), _half(own)), own, joined(weight, weight))


_sums_of_columns = sums_of(_of_two, _of_one)


@inlined
def sum_outer_products(positions, neighbours, weights, bonds, point, out):
    """Write ``out[point] = sum over b in bonds of (positions[neighbours[b]] - positions[point]) (x) weights[b]``, by columns.

    `bonds` are start and stop. This one is for the plane. A plain loop takes 2.2 times as long; in three dimensions it is as fast.
    """
    of = _by_row(load(positions, point, 2)), positions, neighbours, weights
    first, second = _sums_of_columns(bonds, record_of((0.0,), 4), of)
    store(out, point, joined(_to_column(first), _to_column(second)))


@cache
def sum_matrix_products(dimension):
    """Return the function that sums products of matrices by columns: ``out[point] = sum of (matrices[point] + matrices[j]) vectors[b]``.

    The sum is over b in bonds, and j is ``neighbours[b]``. A plain loop takes 2.7 (float32) or 3.1 (float64) times as long in the plane,
    2.5 times in three dimensions.
    """
    places, length = range(dimension), dimension**2
    by_column, sum_columns = components(*[c for c in places for _ in places]), folded(dimension, length)

    def product(b, of):
        own, matrices, neighbours, vectors = of
        return times(plus(own, load(matrices, neighbours[b], length)), doubles(by_column(load(vectors, b, dimension))))

    total = total_of(product)

    @inlined
    def add_up(matrices, neighbours, vectors, bonds, point, out):
        of = load(matrices, point, length), matrices, neighbours, vectors
        store(out, point, sum_columns(total(bonds, record_of((0.0,), length), of)))

    return add_up


@cache
def sum_records(length, sign):
    """Return the function for ``out[point] = factor * (sum of records[own] + sign * sum of records[indices[others]])``.

    `own` and `others` are start and stop, the sums are in double precision, and `sign` is 1 or -1. A plain loop takes 2.4 (float32) or 1.8
    (float64) times as long for records of two reals, 1.8 times for three, 3.8 or 2.5 times for four, 3.1 or 2.4 times for nine.
    """
    own_total = total_of(lambda b, of: doubles(load(of[0], b, length)))
    listed_total = total_of(lambda b, of: doubles(load(of[0], of[1][b], length)))
    combine = plus if sign > 0 else minus

    @inlined
    def add_up(records, own, indices, others, factor, point, out):
        zero = record_of((0.0,), length)
        both = combine(own_total(own, zero, (records,)), listed_total(others, zero, (records, indices)))
        store(out, point, times(record_of((factor,), length), both))

    return add_up


_total_of_four = total_of(lambda b, of: load(of[0], of[1][b], 4))


@inlined
def sum_listed_records(records, listed, bonds, out, at):
    """Write ``out[at] = sum of records[listed[b]] for b in bonds``, records of four doubles.

    A plain loop takes 4.1 times as long.
    """
    store(out, at, _total_of_four(bonds, record_of((0.0,), 4), (records, listed)))


@cache
def multiply_pairs(dimension):
    """Return the function that multiplies the records of pairs with those of their ends, all of d + d d reals in single precision.

    ``out[b] = records[b] . (points[second[b]] + s * points[first])`` for b in bonds, where s is -1 for the first d reals and 1 for the
    others. A plain loop takes 2.6 times as long in the plane and 4.4 times in three dimensions.
    """
    length = dimension + dimension**2
    signs = (np.float32(-1.0),) * dimension + (np.float32(1.0),) * dimension**2
    to_few, to_two, to_one = folded(2 * dimension - 2, length), folded(2, 2 * dimension - 2), folded(1, 2)

    @inlined
    def multiply(records, points, first, second, bonds, out):
        own = times(record_of(signs, length), load(points, first, length))
        for b in range(bonds[0], bonds[1]):
            store(out, b, to_one(to_two(to_few(times(load(records, b, length), plus(own, load(points, second[b], length)))))))

    return multiply


@cache
def sum_scaled_records(dimension):
    """Return the function that sums records of pairs, of d + d d reals in single precision, each times a factor.

    The sums run over the pairs in `own` and, at ``indices[others]``, over pairs of which the point is the other end: ``vectors[point]`` is
    the difference of both sums of the first d reals, ``matrices[point]`` the sum of those of the others. A plain loop takes 6.4 times as
    long in the plane and 6.9 times in three dimensions.
    """
    length = dimension + dimension**2
    vector, matrix = components(*range(dimension)), components(*range(dimension, length))
    own_total = total_of(lambda b, of: times(load(of[0], b, length), record_of((of[1][b],), length)))
    listed_total = total_of(lambda b, of: times(load(of[0], of[2][b], length), record_of((of[1][of[2][b]],), length)))

    @inlined
    def add_up(records, factors, own, indices, others, point, outputs):
        zero = record_of((np.float32(0.0),), length)
        mine, listed = own_total(own, zero, (records, factors)), listed_total(others, zero, (records, factors, indices))
        store(outputs[0], point, vector(minus(mine, listed)))
        store(outputs[1], point, matrix(plus(mine, listed)))

    return add_up


@cache
def sum_weighted_rows(width):
    """Return the function for rows of `width` reals in single precision: ``out[point] = sum over e in entries of w[e] x[columns[e]]``.

    A plain loop takes 3.9 times as long for seven reals, 2.4 times for two or three, and 1.2 to 1.4 times for one.
    """
    total = total_of(lambda e, of: times(load(of[0], of[1][e], width), record_of((of[2][e],), width)))

    @inlined
    def add_up(weights, columns, entries, rows, point, out):
        store(out, point, total(entries, record_of((np.float32(0.0),), width), (rows, columns, weights)))

    return add_up


_to_four, _to_two = folded(4, 8), folded(2, 4)
_each_twice = components(0, 0, 1, 1, 2, 2, 3, 3)


@inlined
def sums_of_rows(table, begin, row, first, second):
    """Return the sums over p and q < 4 of first_p second_q times both outputs at ``table[begin + p row + 2 q]``.

    `first` and `second` are tuples of four. A row of eight numbers, four places with two outputs, is one vector: written as sixteen sums,
    LLVM gathers every number by itself, which takes three times as long.
    """
    total = times(record_of((first[0],), 8), load(table, begin, 8))
    total = plus(total, times(record_of((first[1],), 8), load(table, begin + row, 8)))
    total = plus(total, times(record_of((first[2],), 8), load(table, begin + 2 * row, 8)))
    total = plus(total, times(record_of((first[3],), 8), load(table, begin + 3 * row, 8)))
    return values_of(_to_two(_to_four(times(total, _each_twice(record_of(second, 4))))))
