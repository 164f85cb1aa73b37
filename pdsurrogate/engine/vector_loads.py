"""Loads, stores and sums of short records, written with explicit vector instructions.

A point's position is a record of two or three doubles, its state or gradient one of four or nine reals. LLVM compiles indexed loads in a
loop over bonds into gather instructions, one component at a time; loading a whole record at once is faster. Each function states its gain
over a plain loop, by ``python pipelines/vector_loads.py`` on a processor with AVX-512, in single and in double precision; one that gains
less than 1.3 has no place here. ``tests/test_kernels.py`` compares the results. Records are transposed into the rows of a block, so that
everything after the load is an ordinary loop over bonds.
"""

from functools import cache

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_INDEX = ir.IntType(64)
_CONTRACT = ("contract",)


def _constant(value):
    return ir.Constant(_INDEX, value)


def _data(context, builder, array_type, array):
    return context.make_array(array_type)(context, builder, array).data


def _element(builder, data, index, width=1):
    """Return the address of ``data[index * width]``."""
    if index.type.width < 64:
        index = builder.zext(index, _INDEX)
    if width != 1:
        index = builder.mul(index, _constant(width))
    return builder.gep(data, [index], inbounds=True)


def _load(builder, address, count):
    scalar = address.type.pointee
    value = builder.load(builder.bitcast(address, ir.VectorType(scalar, count).as_pointer()))
    value.align = 4 if scalar == ir.FloatType() else 8
    return value


def _store(builder, value, address):
    instruction = builder.store(value, builder.bitcast(address, value.type.as_pointer()))
    instruction.align = 4 if value.type.element == ir.FloatType() else 8


def _shuffle(builder, first, second, lanes):
    return builder.shuffle_vector(first, second, ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes))


def _as_real(builder, value, scalar):
    """Convert a vector to the given scalar type."""
    if value.type.element == scalar:
        return value
    target = ir.VectorType(scalar, value.type.count)
    return builder.fptrunc(value, target) if scalar == ir.FloatType() else builder.fpext(value, target)


def _scalar_of(context, array_type):
    return context.get_value_type(array_type.dtype)


@intrinsic
def gather_pairs(typingctx, records, positions, first, second, at, sums, differences, column):
    """Write sums of the records and differences of the positions of the ends of four pairs in the plane, one row per component.

    ``sums[r, column + k] = records[first[at + k], r] + records[second[at + k], r]`` for r in 0 … 3 and ``differences[r, column + k] =
    positions[second[at + k], r] - positions[first[at + k], r]`` for r in 0, 1, each for k in 0 … 3. A plain loop takes 3.7 (float32) or 2.7
    (float64) times as long.
    """
    signature = types.void(records, positions, first, second, types.int64, sums, differences, types.int64)

    def codegen(context, builder, signature, arguments):
        table, places, left, right = (_data(context, builder, signature.args[n], arguments[n]) for n in range(4))
        pairs = _ends(builder, left, right, arguments[4])
        rows = [builder.fadd(*(_load(builder, _element(builder, table, end, 4), 4) for end in pair)) for pair in pairs]
        columns = _transposed(builder, rows)
        vectors = _difference_columns(builder, places, pairs, _scalar_of(context, signature.args[6]))
        columns = [_as_real(builder, column, _scalar_of(context, signature.args[5])) for column in columns]
        _store_rows(context, builder, signature.args[5], arguments[5], columns, arguments[7])
        _store_rows(context, builder, signature.args[6], arguments[6], vectors, arguments[7])
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def gather_pairs_in_space(typingctx, records, positions, first, second, at, sums, differences, column):
    """Write sums and differences as `gather_pairs` does, of records of nine reals and positions of three.

    A plain loop takes 2.5 (float32) or 2.2 (float64) times as long.
    """
    signature = types.void(records, positions, first, second, types.int64, sums, differences, types.int64)

    def codegen(context, builder, signature, arguments):
        table, places, left, right = (_data(context, builder, signature.args[n], arguments[n]) for n in range(4))
        pairs = _ends(builder, left, right, arguments[4])
        ends = [[_element(builder, table, end, 9) for end in pair] for pair in pairs]
        columns = []
        for offset in (0, 4):
            rows = [builder.fadd(*(_load(builder, _element(builder, end, _constant(offset)), 4) for end in pair)) for pair in ends]
            columns += _transposed(builder, rows)
        columns.append(_vector(builder, [builder.fadd(*(_component(builder, end, 8) for end in pair)) for pair in ends]))
        ends = [[_element(builder, places, end, 3) for end in pair] for pair in pairs]
        rows = [builder.fsub(*(_load(builder, end, 2) for end in reversed(pair))) for pair in ends]
        halves = [_shuffle(builder, rows[n], rows[n + 1], [0, 1, 2, 3]) for n in (0, 2)]
        vectors = [_shuffle(builder, *halves, lanes) for lanes in ([0, 2, 4, 6], [1, 3, 5, 7])]
        vectors.append(_vector(builder, [builder.fsub(*(_component(builder, end, 2) for end in reversed(pair))) for pair in ends]))
        scalar = _scalar_of(context, signature.args[6])
        columns = [_as_real(builder, column, _scalar_of(context, signature.args[5])) for column in columns]
        _store_rows(context, builder, signature.args[5], arguments[5], columns, arguments[7])
        _store_rows(context, builder, signature.args[6], arguments[6], [_as_real(builder, v, scalar) for v in vectors], arguments[7])
        return context.get_dummy_value()

    return signature, codegen


@cache
def put_records(length):
    """Return an intrinsic that writes four records: ``records[at + k, r] = rows[r, column + k]`` for r below `length`, k in 0 … 3.

    LLVM scatters longer records one component at a time: a plain loop takes 1.8 times as long for four reals, 2.4 (float32) or 1.4
    (float64) times for nine. For two reals it takes no longer.
    """

    @intrinsic
    def put(typingctx, rows, column, records, at):
        signature = types.void(rows, types.int64, records, types.int64)

        def codegen(context, builder, signature, arguments):
            source = context.make_array(signature.args[0])(context, builder, arguments[0])
            target, scalar = _data(context, builder, signature.args[2], arguments[2]), _scalar_of(context, signature.args[2])
            starts = [builder.mul(_constant(r), builder.extract_value(source.shape, 1)) for r in range(length)]
            columns = [_load(builder, _element(builder, source.data, builder.add(start, arguments[1])), 4) for start in starts]
            columns = [_as_real(builder, column, scalar) for column in columns]
            places = [_element(builder, target, builder.add(arguments[3], _constant(k)), length) for k in range(4)]
            start = 0
            while start < length:
                count = 4 if length - start >= 4 else 2 if length - start >= 2 else 1
                part = columns[start : start + count]
                if count == 4:
                    pieces = _transposed(builder, part)
                elif count == 2:
                    pieces = [_shuffle(builder, *part, [k, 4 + k]) for k in range(4)]
                else:
                    pieces = [_shuffle(builder, part[0], part[0], [k]) for k in range(4)]
                for place, piece in zip(places, pieces, strict=True):
                    _store(builder, piece, _element(builder, place, _constant(start)))
                start += count
            return context.get_dummy_value()

        return signature, codegen

    return put


def _transposed(builder, rows):
    """Return the columns of four vectors of four."""
    low = [_shuffle(builder, rows[n], rows[n + 1], [0, 4, 1, 5]) for n in (0, 2)]
    high = [_shuffle(builder, rows[n], rows[n + 1], [2, 6, 3, 7]) for n in (0, 2)]
    return [_shuffle(builder, *pair, lanes) for pair in (low, high) for lanes in ([0, 1, 4, 5], [2, 3, 6, 7])]


def _component(builder, address, r):
    """Return one real of a record."""
    return builder.load(_element(builder, address, _constant(r)))


def _vector(builder, values):
    """Return a vector of the given reals."""
    vector = ir.Constant(ir.VectorType(values[0].type, len(values)), ir.Undefined)
    for k, value in enumerate(values):
        vector = builder.insert_element(vector, value, ir.Constant(ir.IntType(32), k))
    return vector


@intrinsic
def subtract_positions(typingctx, positions, first, second, at, out, column):
    """Write the differences of positions as `gather_pairs` does, without sums; a plain loop takes 2.0 times as long."""
    signature = types.void(positions, first, second, types.int64, out, types.int64)

    def codegen(context, builder, signature, arguments):
        places, left, right = (_data(context, builder, signature.args[n], arguments[n]) for n in range(3))
        pairs = _ends(builder, left, right, arguments[3])
        columns = _difference_columns(builder, places, pairs, _scalar_of(context, signature.args[4]))
        _store_rows(context, builder, signature.args[4], arguments[4], columns, arguments[5])
        return context.get_dummy_value()

    return signature, codegen


def _ends(builder, left, right, at):
    """Return the numbers of the points at both ends of four pairs."""
    places = [builder.add(at, _constant(k)) for k in range(4)]
    return [tuple(builder.zext(builder.load(_element(builder, ends, place)), _INDEX) for ends in (left, right)) for place in places]


def _difference_columns(builder, positions, pairs, scalar):
    """Return the components of second position minus first, each a vector over four pairs."""
    loaded = [[_load(builder, _element(builder, positions, end, 2), 2) for end in pair] for pair in pairs]
    rows = [builder.fsub(second, first) for first, second in loaded]
    halves = [_shuffle(builder, rows[n], rows[n + 1], [0, 1, 2, 3]) for n in (0, 2)]
    return [_as_real(builder, _shuffle(builder, *halves, lanes), scalar) for lanes in ([0, 2, 4, 6], [1, 3, 5, 7])]


def _store_rows(context, builder, array_type, array, columns, column):
    """Write one vector into each row of a two-dimensional array, from the given column on."""
    array = context.make_array(array_type)(context, builder, array)
    width, target = builder.extract_value(array.shape, 1), array.data
    for r, value in enumerate(columns):
        _store(builder, value, _element(builder, target, builder.add(builder.mul(_constant(r), width), column)))


@intrinsic
def sum_outer_products(typingctx, positions, neighbours, weights, start, stop, point, out):
    """Write ``out[point] = sum over b in start … stop of (positions[neighbours[b]] - positions[point]) (x) weights[b]``, by columns.

    A plain loop takes 2.2 (float32) or 1.5 (float64) times as long.
    """
    signature = types.void(positions, neighbours, weights, types.uint64, types.uint64, types.uint64, out)

    def codegen(context, builder, signature, arguments):
        source, indices, factors, target = (_data(context, builder, signature.args[n], arguments[n]) for n in (0, 1, 2, 6))
        own = _load(builder, _element(builder, source, arguments[5], 2), 2)
        twice = _shuffle(builder, own, own, [0, 1, 0, 1])
        double = ir.DoubleType()

        def end(position):
            return _load(builder, _element(builder, source, builder.load(_element(builder, indices, position)), 2), 2)

        def add(ends, weights, accumulators):
            """Add two bonds at once: their differences times the first and times the second component of their weights."""
            differences = builder.fsub(ends, twice)
            for accumulator, lanes in zip(accumulators, ([0, 0, 2, 2], [1, 1, 3, 3]), strict=True):
                product = builder.fmul(differences, _shuffle(builder, weights, weights, lanes), flags=_CONTRACT)
                builder.store(builder.fadd(builder.load(accumulator), product, flags=_CONTRACT), accumulator)

        def add_two(position, accumulators):
            ends = _shuffle(builder, end(position), end(builder.add(position, _constant(1))), [0, 1, 2, 3])
            weights = _load(builder, _element(builder, factors, position, 2), 4)
            add(ends, _as_real(builder, weights, double), accumulators)

        def add_one(position, accumulators):
            weights = _as_real(builder, _load(builder, _element(builder, factors, position, 2), 2), double)
            nothing = ir.Constant(weights.type, [0.0, 0.0])
            add(_shuffle(builder, end(position), own, [0, 1, 2, 3]), _shuffle(builder, weights, nothing, [0, 1, 2, 3]), accumulators)

        by_first, by_second = _accumulate_twos(builder, arguments[3], arguments[4], add_two, add_one, 2)
        halves = (_shuffle(builder, by_first, by_second, lanes) for lanes in ([0, 1, 4, 5], [2, 3, 6, 7]))
        _store(builder, builder.fadd(*halves), _element(builder, target, arguments[5], 4))
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def sum_matrix_products(typingctx, matrices, neighbours, vectors, start, stop, point, out):
    """Write ``out[point] = sum over b in start … stop of (matrices[point] + matrices[neighbours[b]]) vectors[b]``, matrices by columns.

    A plain loop takes 2.8 (float32) or 2.5 (float64) times as long.
    """
    signature = types.void(matrices, neighbours, vectors, types.uint64, types.uint64, types.uint64, out)

    def codegen(context, builder, signature, arguments):
        source, indices, factors, target = (_data(context, builder, signature.args[n], arguments[n]) for n in (0, 1, 2, 6))
        own = _load(builder, _element(builder, source, arguments[5], 4), 4)

        def add_bond(position, accumulator):
            j = builder.load(_element(builder, indices, position))
            other = _load(builder, _element(builder, source, j, 4), 4)
            factor = _as_real(builder, _load(builder, _element(builder, factors, position, 2), 2), ir.DoubleType())
            product = builder.fmul(builder.fadd(own, other), _shuffle(builder, factor, factor, [0, 0, 1, 1]), flags=_CONTRACT)
            builder.store(builder.fadd(builder.load(accumulator), product, flags=_CONTRACT), accumulator)

        total = _accumulate(builder, arguments[3], arguments[4], add_bond, ir.VectorType(ir.DoubleType(), 4))
        total = builder.fadd(_shuffle(builder, total, total, [0, 1]), _shuffle(builder, total, total, [2, 3]))
        _store(builder, total, _element(builder, target, arguments[5], 2))
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def sum_matrix_products_in_space(typingctx, matrices, neighbours, vectors, start, stop, point, out):
    """Write sums as `sum_matrix_products` does, of matrices of nine reals and vectors of three.

    A plain loop takes 1.8 (float32) or 2.5 (float64) times as long.
    """
    signature = types.void(matrices, neighbours, vectors, types.uint64, types.uint64, types.uint64, out)
    double = ir.DoubleType()

    def codegen(context, builder, signature, arguments):
        source, indices, factors, target = (_data(context, builder, signature.args[n], arguments[n]) for n in (0, 1, 2, 6))

        def columns(number):
            """Return the three columns of a matrix, each with a fourth, unused component."""
            base = _element(builder, source, number, 9)
            loaded = [_load(builder, _element(builder, base, _constant(at)), 4) for at in (0, 3, 5)]
            return [*loaded[:2], _shuffle(builder, loaded[2], loaded[2], [1, 2, 3, 3])]

        own = columns(arguments[5])

        def add_bond(position, accumulator):
            others, total = columns(builder.load(_element(builder, indices, position))), builder.load(accumulator)
            place = _element(builder, factors, position, 3)
            for r, (mine, other) in enumerate(zip(own, others, strict=True)):
                factor = _component(builder, place, r)
                factor = factor if factor.type == double else builder.fpext(factor, double)
                splat = _vector(builder, [factor] * 4)
                total = builder.fadd(total, builder.fmul(builder.fadd(mine, other), splat, flags=_CONTRACT), flags=_CONTRACT)
            builder.store(total, accumulator)

        total = _accumulate(builder, arguments[3], arguments[4], add_bond, ir.VectorType(double, 4))
        place = _element(builder, target, arguments[5], 3)
        _store(builder, _shuffle(builder, total, total, [0, 1]), place)
        builder.store(builder.extract_element(total, ir.Constant(ir.IntType(32), 2)), _element(builder, place, _constant(2)))
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def sum_signed_records(typingctx, records, start, stop, indices, first, last, factor, point, out):
    """Write ``out[point] = factor * (sum of records[start … stop] - sum of records[indices[first … last]])``, summed in double.

    The records have two reals. A plain loop takes 2.3 (float32) or 1.6 (float64) times as long.
    """
    signature = types.void(records, *[types.uint64] * 2, indices, *[types.uint64] * 2, types.float64, types.uint64, out)

    def codegen(context, builder, signature, arguments):
        source, places, target = (_data(context, builder, signature.args[n], arguments[n]) for n in (0, 3, 8))
        total = _sum_pairs(builder, source, arguments[1], arguments[2])
        total = builder.fsub(total, _sum_pairs(builder, source, arguments[4], arguments[5], places))
        pair = total.type
        scale = builder.insert_element(ir.Constant(pair, ir.Undefined), arguments[6], ir.Constant(ir.IntType(32), 0))
        total = builder.fmul(total, _shuffle(builder, scale, scale, [0, 0]))
        _store(builder, total, _element(builder, target, arguments[7], 2))
        return context.get_dummy_value()

    return signature, codegen


def _sum_pairs(builder, source, start, stop, places=None):
    """Return the sum, in double precision, of the records of two reals at ``start … stop``, or at ``places[start … stop]``."""
    double = ir.DoubleType()

    def record(position, count=2):
        return _load(builder, _element(builder, source, position, 2), count)

    def listed(position):
        return record(builder.load(_element(builder, places, position)))

    def add(value, accumulator):
        builder.store(builder.fadd(builder.load(accumulator), _as_real(builder, value, double)), accumulator)

    def add_two(position, accumulators):
        if places is None:
            add(record(position, 4), *accumulators)
        else:
            add(_shuffle(builder, listed(position), listed(builder.add(position, _constant(1))), [0, 1, 2, 3]), *accumulators)

    def add_one(position, accumulators):
        value = record(position) if places is None else listed(position)
        add(_shuffle(builder, value, ir.Constant(value.type, [0.0, 0.0]), [0, 1, 2, 3]), *accumulators)

    (total,) = _accumulate_twos(builder, start, stop, add_two, add_one, 1)
    return builder.fadd(_shuffle(builder, total, total, [0, 1]), _shuffle(builder, total, total, [2, 3]))


def _sum_quads(builder, source, start, stop, places=None):
    """Return the sum, in double precision, of the records of four reals at ``start … stop``, or at ``places[start … stop]``."""
    double = ir.DoubleType()

    def add(position, accumulator):
        at = position if places is None else builder.load(_element(builder, places, position))
        record = _as_real(builder, _load(builder, _element(builder, source, at, 4), 4), double)
        builder.store(builder.fadd(builder.load(accumulator), record), accumulator)

    return _accumulate(builder, start, stop, add, ir.VectorType(double, 4))


def _accumulate_twos(builder, start, stop, add_two, add_one, count):
    """Sum over ``start … stop``, two at a time, into `count` vectors of four doubles; an odd last item is added alone."""
    quad = ir.VectorType(ir.DoubleType(), 4)
    sets = [_zeros(builder, quad, count) for _ in range(2)]

    def add_four(base):
        for n, accumulators in enumerate(sets):
            add_two(builder.add(base, _constant(2 * n)), accumulators)

    rest = _in_steps(builder, start, stop, 4, add_four)
    rest = _in_steps(builder, rest, stop, 2, lambda position: add_two(position, sets[0]))
    _in_steps(builder, rest, stop, 1, lambda position: add_one(position, sets[1]))
    return [builder.fadd(builder.load(first), builder.load(second)) for first, second in zip(*sets, strict=True)]


def _accumulate(builder, start, stop, add, vector_type):
    """Sum over ``start … stop``, one at a time, in four independent chains."""
    accumulators = _zeros(builder, vector_type, 4)

    def add_four(base):
        for n, accumulator in enumerate(accumulators):
            add(builder.add(base, _constant(n)), accumulator)

    rest = _in_steps(builder, start, stop, 4, add_four)
    _in_steps(builder, rest, stop, 1, lambda position: add(position, accumulators[0]))
    values = [builder.load(accumulator) for accumulator in accumulators]
    return builder.fadd(builder.fadd(values[0], values[1]), builder.fadd(values[2], values[3]))


def _zeros(builder, vector_type, count):
    """Return zero accumulators; there are several, so that one addition need not wait for the one before."""
    zero = ir.Constant(vector_type, [0.0] * vector_type.count)
    accumulators = [cgutils.alloca_once(builder, vector_type) for _ in range(count)]
    for accumulator in accumulators:
        builder.store(zero, accumulator)
    return accumulators


def _in_steps(builder, start, stop, step, body):
    """Loop over ``start … stop`` in whole steps of a power of two; return where the rest begins."""
    shift = _constant(step.bit_length() - 1)
    steps = builder.lshr(builder.sub(stop, start), shift)
    with cgutils.for_range(builder, steps) as loop:
        body(builder.add(start, builder.shl(loop.index, shift)))
    return builder.add(start, builder.shl(steps, shift))


@intrinsic
def outer_products(typingctx, positions, neighbours, weights, start, stop, point, out):
    """Write ``out[b - start] = (positions[neighbours[b]] - positions[point]) (x) weights[b]`` for b in start … stop, by columns.

    A plain loop takes 1.4 times as long.
    """
    signature = types.void(positions, neighbours, weights, types.uint64, types.uint64, types.uint64, out)

    def codegen(context, builder, signature, arguments):
        source, indices, factors, target = (_data(context, builder, signature.args[n], arguments[n]) for n in (0, 1, 2, 6))
        own = _load(builder, _element(builder, source, arguments[5], 2), 2)
        own = _shuffle(builder, own, own, [0, 1, 0, 1])
        with cgutils.for_range(builder, builder.sub(arguments[4], arguments[3])) as loop:
            position = builder.add(arguments[3], loop.index)
            j = builder.load(_element(builder, indices, position))
            other = _load(builder, _element(builder, source, j, 2), 2)
            factor = _load(builder, _element(builder, factors, position, 2), 2)
            difference = builder.fsub(_shuffle(builder, other, other, [0, 1, 0, 1]), own)
            product = builder.fmul(difference, _shuffle(builder, factor, factor, [0, 0, 1, 1]))
            _store(builder, product, _element(builder, target, loop.index, 4))
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def sum_listed_records(typingctx, records, listed, start, stop, out, at):
    """Write ``out[at] = sum of records[listed[b]] for b in start … stop``, records of four doubles.

    A plain loop takes 3.1 times as long.
    """
    signature = types.void(records, listed, types.uint64, types.uint64, out, types.uint64)

    def codegen(context, builder, signature, arguments):
        source, indices, target = (_data(context, builder, signature.args[n], arguments[n]) for n in (0, 1, 4))
        total = _sum_quads(builder, source, arguments[2], arguments[3], indices)
        _store(builder, total, _element(builder, target, arguments[5], 4))
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def sum_quad_records(typingctx, records, start, stop, indices, first, last, point, out):
    """Write ``out[point] = sum of records[start … stop] + sum of records[indices[first … last]]``, records of four, summed in double.

    A plain loop takes 3.8 (float32) or 1.8 (float64) times as long.
    """
    signature = types.void(records, *[types.uint64] * 2, indices, *[types.uint64] * 2, types.uint64, out)

    def codegen(context, builder, signature, arguments):
        source, places, target = (_data(context, builder, signature.args[n], arguments[n]) for n in (0, 3, 7))
        total = _sum_quads(builder, source, arguments[1], arguments[2])
        total = builder.fadd(total, _sum_quads(builder, source, arguments[4], arguments[5], places))
        _store(builder, total, _element(builder, target, arguments[6], 4))
        return context.get_dummy_value()

    return signature, codegen


def _parts(length):
    """Return the first index and the length of each vector, four or at the end two reals long, into which a record is cut."""
    return [(at, 4) for at in range(0, length - 3, 4)] + [(length - 2, 2)] * (length % 4 == 2)


def _record(builder, data, index, length):
    """Return the record at an index as a list of vectors, cut as `_parts` defines."""
    base = _element(builder, data, index, length)
    return [_load(builder, _element(builder, base, _constant(at)), count) for at, count in _parts(length)]


@cache
def multiply_pairs(dimension):
    """Return an intrinsic that multiplies the records of pairs with those of their ends, all of d + d d reals in single precision.

    ``out[b] = records[b] . (points[second[b]] + s * points[first])`` for b in start … stop, where s is -1 for the first d reals and 1 for
    the others. A plain loop takes 1.9 times as long in the plane and 2.3 times in three dimensions.
    """
    length = dimension + dimension**2

    @intrinsic
    def multiply(typingctx, records, points, first, second, start, stop, out):
        signature = types.void(records, points, types.uint64, second, *[types.uint64] * 2, out)

        def codegen(context, builder, signature, arguments):
            pairs, ends, indices, target = (_data(context, builder, signature.args[n], arguments[n]) for n in (0, 1, 3, 6))
            signs = [-1.0 if at < dimension else 1.0 for at in range(length)]
            own = [
                builder.fmul(part, ir.Constant(part.type, signs[at : at + count]))
                for part, (at, count) in zip(_record(builder, ends, arguments[2], length), _parts(length), strict=True)
            ]
            with cgutils.for_range(builder, builder.sub(arguments[5], arguments[4])) as loop:
                b = builder.add(arguments[4], loop.index)
                others = _record(builder, ends, builder.load(_element(builder, indices, b)), length)
                totals = {}
                for record, mine, other in zip(_record(builder, pairs, b, length), own, others, strict=True):
                    product, count = builder.fmul(record, builder.fadd(mine, other), flags=_CONTRACT), record.type.count
                    totals[count] = builder.fadd(totals[count], product, flags=_CONTRACT) if count in totals else product
                quad = totals[4]
                total = builder.fadd(_shuffle(builder, quad, quad, [0, 1]), _shuffle(builder, quad, quad, [2, 3]))
                total = builder.fadd(total, totals[2]) if 2 in totals else total
                first, last = (builder.extract_element(total, ir.Constant(ir.IntType(32), lane)) for lane in (0, 1))
                builder.store(builder.fadd(first, last), _element(builder, target, b))
            return context.get_dummy_value()

        return signature, codegen

    return multiply


@cache
def sum_scaled_records(dimension):
    """Return an intrinsic that sums records of pairs, of d + d d reals in single precision, each times a factor.

    The sums run over b in start … stop and, at ``indices[first … last]``, over pairs of which the point is the other end:
    ``vectors[point]`` is the difference of both sums of the first d reals, ``matrices[point]`` the sum of those of the others. A plain loop
    takes 5 times as long.
    """
    length = dimension + dimension**2

    @intrinsic
    def add_up(typingctx, records, factors, start, stop, indices, first, last, point, vectors, matrices):
        whole = types.uint64
        signature = types.void(records, factors, whole, whole, indices, whole, whole, whole, vectors, matrices)

        def codegen(context, builder, signature, arguments):
            pairs, scales, listed = (_data(context, builder, signature.args[n], arguments[n]) for n in (0, 1, 4))
            kinds = [ir.VectorType(ir.FloatType(), count) for _, count in _parts(length)]

            def total(start, stop, places=None):
                sums = [_zeros(builder, kind, 1)[0] for kind in kinds]
                with cgutils.for_range(builder, builder.sub(stop, start)) as loop:
                    b = builder.add(start, loop.index)
                    b = b if places is None else builder.zext(builder.load(_element(builder, places, b)), _INDEX)
                    factor = builder.load(_element(builder, scales, b))
                    for part, accumulator in zip(_record(builder, pairs, b, length), sums, strict=True):
                        product = builder.fmul(part, _vector(builder, [factor] * part.type.count), flags=_CONTRACT)
                        builder.store(builder.fadd(builder.load(accumulator), product, flags=_CONTRACT), accumulator)
                found = []
                for accumulator, kind in zip(sums, kinds, strict=True):
                    value = builder.load(accumulator)
                    found += [builder.extract_element(value, ir.Constant(ir.IntType(32), lane)) for lane in range(kind.count)]
                return found

            own, others = total(arguments[2], arguments[3]), total(arguments[5], arguments[6], listed)
            for which, places in ((8, range(dimension)), (9, range(dimension, length))):
                target, scalar = (
                    _data(context, builder, signature.args[which], arguments[which]),
                    _scalar_of(context, signature.args[which]),
                )
                base = _element(builder, target, arguments[7], len(places))
                for r, at in enumerate(places):
                    value = (builder.fsub if which == 8 else builder.fadd)(own[at], others[at])
                    value = value if value.type == scalar else builder.fpext(value, scalar)
                    builder.store(value, _element(builder, base, _constant(r)))
            return context.get_dummy_value()

        return signature, codegen

    return add_up


@cache
def sum_weighted_rows(width):
    """Return an intrinsic for rows of `width` reals in single precision: ``out[point] = sum over e in start … stop of w[e] x[columns[e]]``.

    LLVM gathers eight entries at a time, which rows of seven never fill: a plain loop takes 3.7 times as long for seven reals, 2.2 times
    for two, 1.2 times for one.
    """

    @intrinsic
    def add_up(typingctx, weights, columns, start, stop, rows, point, out):
        whole = types.uint64
        signature = types.void(weights, columns, whole, whole, rows, whole, out)

        def codegen(context, builder, signature, arguments):
            factors, indices, source, target = (_data(context, builder, signature.args[n], arguments[n]) for n in (0, 1, 4, 6))
            kind = ir.VectorType(ir.FloatType(), width)

            def add(e, accumulator):
                row = _load(builder, _element(builder, source, builder.load(_element(builder, indices, e)), width), width)
                product = builder.fmul(row, _vector(builder, [builder.load(_element(builder, factors, e))] * width), flags=_CONTRACT)
                builder.store(builder.fadd(builder.load(accumulator), product, flags=_CONTRACT), accumulator)

            total = _accumulate(builder, arguments[2], arguments[3], add, kind)
            _store(builder, total, _element(builder, target, arguments[5], width))
            return context.get_dummy_value()

        return signature, codegen

    return add_up
