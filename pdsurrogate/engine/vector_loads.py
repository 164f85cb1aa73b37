"""Loads, stores and sums of short records, written with explicit vector instructions.

A point's position is a record of two or three doubles, its gradient one of four or nine reals. LLVM compiles indexed loads in a loop over
bonds into gather instructions, one component at a time; loading a record as a few vectors of four, two or one reals is faster. Each
function states how many times as long a plain loop takes, by ``python pipelines/vector_loads.py`` on a processor with AVX2, in single and
in double precision; one that gains less than 1.3 has no place here. ``tests/kernels/test_kernels.py`` compares the results.
"""

from functools import cache

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

_INDEX = ir.IntType(64)
_DOUBLE = ir.DoubleType()

_CONTRACT = ("contract",)
"""A product and a sum may become one instruction."""


def _constant(value):
    return ir.Constant(_INDEX, value)


def _lane(number):
    return ir.Constant(ir.IntType(32), number)


def _data(context, builder, signature, arguments, *places):
    """Return the addresses of the data of the array arguments at the given places."""
    return [context.make_array(signature.args[n])(context, builder, arguments[n]).data for n in places]


def _element(builder, data, index, width=1):
    """Return the address of ``data[index * width]``."""
    if index.type.width < 64:
        index = builder.zext(index, _INDEX)
    if width != 1:
        index = builder.mul(index, _constant(width))
    return builder.gep(data, [index], inbounds=True)


def _listed(builder, indices, position):
    """Return an entry of a list of indices."""
    return builder.zext(builder.load(_element(builder, indices, position)), _INDEX)


def _load(builder, address, count):
    scalar = address.type.pointee
    value = builder.load(builder.bitcast(address, ir.VectorType(scalar, count).as_pointer()))
    value.align = 4 if scalar == ir.FloatType() else 8
    return value


def _store(builder, value, address):
    """Write a vector, converted to the precision of the address."""
    value = _as_real(builder, value, address.type.pointee)
    instruction = builder.store(value, builder.bitcast(address, value.type.as_pointer()))
    instruction.align = 4 if value.type.element == ir.FloatType() else 8


def _parts(length):
    """Return the first index and the length of each vector, of four, two or one reals, into which a record is cut."""
    parts = [(at, 4) for at in range(0, length - 3, 4)]
    for count in (2, 1):
        if length % 4 & count:
            parts.append((sum(n for _, n in parts), count))
    return parts


def _record(builder, data, index, length):
    """Return the record at an index as a list of vectors, cut as `_parts` defines."""
    base = _element(builder, data, index, length)
    return [_load(builder, _element(builder, base, _constant(at)), count) for at, count in _parts(length)]


def _put_record(builder, parts, data, index, length):
    """Write a record given as a list of vectors, cut as `_parts` defines."""
    base = _element(builder, data, index, length)
    for part, (at, _) in zip(parts, _parts(length), strict=True):
        _store(builder, part, _element(builder, base, _constant(at)))


def _shuffle(builder, first, second, lanes):
    return builder.shuffle_vector(first, second, ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes))


def _as_real(builder, value, scalar):
    """Convert a vector to the given scalar type."""
    if value.type.element == scalar:
        return value
    target = ir.VectorType(scalar, value.type.count)
    return builder.fptrunc(value, target) if scalar == ir.FloatType() else builder.fpext(value, target)


def _component(builder, address, r):
    """Return one real of a record."""
    return builder.load(_element(builder, address, _constant(r)))


def _vector(builder, values):
    """Return a vector of the given reals."""
    vector = ir.Constant(ir.VectorType(values[0].type, len(values)), ir.Undefined)
    for k, value in enumerate(values):
        vector = builder.insert_element(vector, value, _lane(k))
    return vector


def _add(builder, term, accumulator):
    builder.store(builder.fadd(builder.load(accumulator), term, flags=_CONTRACT), accumulator)


def _zeros(builder, scalar, counts):
    """Return zero accumulators, vectors of the given lengths."""
    accumulators = [cgutils.alloca_once(builder, ir.VectorType(scalar, count)) for count in counts]
    for accumulator, count in zip(accumulators, counts, strict=True):
        builder.store(ir.Constant(ir.VectorType(scalar, count), [0.0] * count), accumulator)
    return accumulators


def _in_steps(builder, start, stop, step, body):
    """Loop over ``start … stop`` in whole steps of a power of two; return where the rest begins."""
    shift = _constant(step.bit_length() - 1)
    steps = builder.lshr(builder.sub(stop, start), shift)
    with cgutils.for_range(builder, steps) as loop:
        body(builder.add(start, builder.shl(loop.index, shift)))
    return builder.add(start, builder.shl(steps, shift))


def _accumulate(builder, start, stop, add, counts, scalar=_DOUBLE):
    """Return sums over ``start … stop``, vectors of the given lengths.

    ``add(position, accumulators)`` adds the terms of one position. Four chains are summed at the same time, so that one addition need not
    wait for the one before.
    """
    chains = [_zeros(builder, scalar, counts) for _ in range(4)]

    def add_four(base):
        for n, chain in enumerate(chains):
            add(builder.add(base, _constant(n)), chain)

    rest = _in_steps(builder, start, stop, 4, add_four)
    _in_steps(builder, rest, stop, 1, lambda position: add(position, chains[0]))
    found = [[builder.load(accumulator) for accumulator in accumulators] for accumulators in zip(*chains, strict=True)]
    return [builder.fadd(builder.fadd(a, b), builder.fadd(c, d)) for a, b, c, d in found]


def _accumulate_twos(builder, start, stop, add_two, add_one, count):
    """Return sums over ``start … stop``, two at a time, `count` vectors of four doubles; an odd last position is added alone."""
    chains = [_zeros(builder, _DOUBLE, [4] * count) for _ in range(2)]

    def add_four(base):
        for n, accumulators in enumerate(chains):
            add_two(builder.add(base, _constant(2 * n)), accumulators)

    rest = _in_steps(builder, start, stop, 4, add_four)
    rest = _in_steps(builder, rest, stop, 2, lambda position: add_two(position, chains[0]))
    _in_steps(builder, rest, stop, 1, lambda position: add_one(position, chains[1]))
    return [builder.fadd(builder.load(first), builder.load(second)) for first, second in zip(*chains, strict=True)]


def _joined(builder, first, second):
    """Return one vector of the components of two."""
    return _shuffle(builder, first, second, list(range(2 * first.type.count)))


def _sum_halves(builder, vector):
    """Return the sum of the first and the second half of the components."""
    half = vector.type.count // 2
    return builder.fadd(*(_shuffle(builder, vector, vector, list(range(at, at + half))) for at in (0, half)))


def _transposed(builder, rows):
    """Return the components of four vectors of one length, each a vector over the four."""
    count, ends = rows[0].type.count, (0, 2)
    if count == 4:
        low, high = ([_shuffle(builder, rows[n], rows[n + 1], lanes) for n in ends] for lanes in ([0, 4, 1, 5], [2, 6, 3, 7]))
        return [_shuffle(builder, *pair, lanes) for pair in (low, high) for lanes in ([0, 1, 4, 5], [2, 3, 6, 7])]
    halves = [_joined(builder, rows[n], rows[n + 1]) for n in ends]
    return [_shuffle(builder, *halves, list(range(c, 4 * count, count))) for c in range(count)]


def _ends(builder, first, second, at):
    """Return the numbers of the points at both ends of four pairs."""
    places = [builder.add(at, _constant(k)) for k in range(4)]
    return [tuple(_listed(builder, ends, place) for ends in (first, second)) for place in places]


def _put_combined(context, builder, array_type, array, data, pairs, length, combine, column):
    """Combine the records at both ends of four pairs, and write the result into rows by component, from the given column on."""
    records = []
    for pair in pairs:
        ends = [_record(builder, data, end, length) for end in pair]
        records.append([combine(*parts) for parts in zip(*ends, strict=True)])
    components = [component for parts in zip(*records, strict=True) for component in _transposed(builder, parts)]
    rows = context.make_array(array_type)(context, builder, array)
    width = builder.extract_value(rows.shape, 1)
    for r, component in enumerate(components):
        _store(builder, component, _element(builder, rows.data, builder.add(builder.mul(_constant(r), width), column)))


@cache
def gather_pairs(dimension):
    """Return an intrinsic that sums the matrices and subtracts the positions of the ends of four pairs, one row per component.

    ``sums[r, column + k] = matrices[first[at + k], r] + matrices[second[at + k], r]`` and ``differences[r, column + k] =
    positions[second[at + k], r] - positions[first[at + k], r]``, each for k in 0 … 3. A plain loop takes 3.5 (float32) or 2.4 (float64)
    times as long in the plane, 2.1 or 1.9 times in three dimensions.
    """

    @intrinsic
    def gather(typingctx, matrices, positions, first, second, at, sums, differences, column):
        signature = types.void(matrices, positions, first, second, types.int64, sums, differences, types.int64)

        def codegen(context, builder, signature, arguments):
            table, places, *ends = _data(context, builder, signature, arguments, 0, 1, 2, 3)
            pairs, column = _ends(builder, *ends, arguments[4]), arguments[7]
            add, subtract = builder.fadd, lambda first, second: builder.fsub(second, first)
            _put_combined(context, builder, signature.args[5], arguments[5], table, pairs, dimension**2, add, column)
            _put_combined(context, builder, signature.args[6], arguments[6], places, pairs, dimension, subtract, column)
            return context.get_dummy_value()

        return signature, codegen

    return gather


@cache
def subtract_positions(dimension):
    """Return an intrinsic that writes the differences of positions as `gather_pairs` does; a plain loop takes 2.0 times as long."""

    @intrinsic
    def subtract(typingctx, positions, first, second, at, out, column):
        signature = types.void(positions, first, second, types.int64, out, types.int64)

        def codegen(context, builder, signature, arguments):
            places, *ends = _data(context, builder, signature, arguments, 0, 1, 2)
            pairs = _ends(builder, *ends, arguments[3])
            difference = lambda first, second: builder.fsub(second, first)  # noqa: E731
            _put_combined(context, builder, signature.args[4], arguments[4], places, pairs, dimension, difference, arguments[5])
            return context.get_dummy_value()

        return signature, codegen

    return subtract


@intrinsic
def sum_outer_products(typingctx, positions, neighbours, weights, start, stop, point, out):
    """Write ``out[point] = sum over b in start … stop of (positions[neighbours[b]] - positions[point]) (x) weights[b]``, by columns.

    This one is for the plane. A plain loop takes 2.4 (float32) or 2.2 (float64) times as long.
    """
    signature = types.void(positions, neighbours, weights, types.uint64, types.uint64, types.uint64, out)

    def codegen(context, builder, signature, arguments):
        source, indices, factors, target = _data(context, builder, signature, arguments, 0, 1, 2, 6)
        (own,) = _record(builder, source, arguments[5], 2)
        twice = _joined(builder, own, own)

        def end(position):
            return _record(builder, source, _listed(builder, indices, position), 2)[0]

        def add(ends, weights, accumulators):
            """Add two bonds at once: their differences times the first and times the second component of their weights."""
            differences = builder.fsub(ends, twice)
            for accumulator, lanes in zip(accumulators, ([0, 0, 2, 2], [1, 1, 3, 3]), strict=True):
                _add(builder, builder.fmul(differences, _shuffle(builder, weights, weights, lanes), flags=_CONTRACT), accumulator)

        def add_two(position, accumulators):
            weights = _load(builder, _element(builder, factors, position, 2), 4)
            ends = _joined(builder, end(position), end(builder.add(position, _constant(1))))
            add(ends, _as_real(builder, weights, _DOUBLE), accumulators)

        def add_one(position, accumulators):
            weights = _as_real(builder, *_record(builder, factors, position, 2), _DOUBLE)
            add(_joined(builder, end(position), own), _joined(builder, weights, ir.Constant(weights.type, [0.0, 0.0])), accumulators)

        by_first, by_second = _accumulate_twos(builder, arguments[3], arguments[4], add_two, add_one, 2)
        halves = (_shuffle(builder, by_first, by_second, lanes) for lanes in ([0, 1, 4, 5], [2, 3, 6, 7]))
        _put_record(builder, [builder.fadd(*halves)], target, arguments[5], 4)
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def outer_products(typingctx, positions, neighbours, weights, start, stop, point, out):
    """Write ``out[b - start] = (positions[neighbours[b]] - positions[point]) (x) weights[b]`` for b in start … stop, by columns.

    A plain loop takes 1.6 times as long.
    """
    signature = types.void(positions, neighbours, weights, types.uint64, types.uint64, types.uint64, out)

    def codegen(context, builder, signature, arguments):
        source, indices, factors, target = _data(context, builder, signature, arguments, 0, 1, 2, 6)

        def twice(place):
            (value,) = _record(builder, source, place, 2)
            return _joined(builder, value, value)

        own = twice(arguments[5])
        with cgutils.for_range(builder, builder.sub(arguments[4], arguments[3])) as loop:
            position = builder.add(arguments[3], loop.index)
            (factor,) = _record(builder, factors, position, 2)
            difference = builder.fsub(twice(_listed(builder, indices, position)), own)
            product = builder.fmul(difference, _shuffle(builder, factor, factor, [0, 0, 1, 1]))
            _put_record(builder, [product], target, loop.index, 4)
        return context.get_dummy_value()

    return signature, codegen


@cache
def sum_matrix_products(dimension):
    """Return an intrinsic that sums products of matrices by columns: ``out[point] = sum of (matrices[point] + matrices[j]) vectors[b]``.

    The sum is over b in start … stop, and j is ``neighbours[b]``. A plain loop takes 3.0 (float32) or 2.9 (float64) times as long in the
    plane, 1.9 or 2.1 times in three dimensions.
    """

    @intrinsic
    def add_up(typingctx, matrices, neighbours, vectors, start, stop, point, out):
        signature = types.void(matrices, neighbours, vectors, types.uint64, types.uint64, types.uint64, out)

        def codegen(context, builder, signature, arguments):
            source, indices, factors, target = _data(context, builder, signature, arguments, 0, 1, 2, 6)

            def columns(number):
                """Return a plane matrix as one vector, and the columns of another, each with a fourth, unused component."""
                if dimension == 2:
                    return _record(builder, source, number, 4)
                base = _element(builder, source, number, 9)
                loaded = [_load(builder, _element(builder, base, _constant(at)), 4) for at in (0, 3, 5)]
                return [*loaded[:2], _shuffle(builder, loaded[2], loaded[2], [1, 2, 3, 3])]

            def spread(position):
                """Return the components of a vector, repeated to multiply the columns."""
                if dimension == 2:
                    factor = _as_real(builder, *_record(builder, factors, position, 2), _DOUBLE)
                    return [_shuffle(builder, factor, factor, [0, 0, 1, 1])]
                place = _element(builder, factors, position, 3)
                return [_as_real(builder, _vector(builder, [_component(builder, place, r)] * 4), _DOUBLE) for r in range(3)]

            own = columns(arguments[5])

            def add_bond(position, accumulators):
                others = columns(_listed(builder, indices, position))
                for mine, other, factor in zip(own, others, spread(position), strict=True):
                    _add(builder, builder.fmul(builder.fadd(mine, other), factor, flags=_CONTRACT), accumulators[0])

            (total,) = _accumulate(builder, arguments[3], arguments[4], add_bond, [4])
            parts = [_sum_halves(builder, total)] if dimension == 2 else [_shuffle(builder, total, total, lanes) for lanes in ([0, 1], [2])]
            _put_record(builder, parts, target, arguments[5], dimension)
            return context.get_dummy_value()

        return signature, codegen

    return add_up


def _sum_twos(builder, source, start, stop, places=None):
    """Return the sum, in double precision, of the records of two reals at ``start … stop``, or at ``places[start … stop]``."""

    def record(position):
        return _record(builder, source, position if places is None else _listed(builder, places, position), 2)[0]

    def add(value, accumulators):
        _add(builder, _as_real(builder, value, _DOUBLE), *accumulators)

    def add_two(position, accumulators):
        if places is None:
            add(_load(builder, _element(builder, source, position, 2), 4), accumulators)
        else:
            add(_joined(builder, record(position), record(builder.add(position, _constant(1)))), accumulators)

    def add_one(position, accumulators):
        value = record(position)
        add(_joined(builder, value, ir.Constant(value.type, [0.0, 0.0])), accumulators)

    (total,) = _accumulate_twos(builder, start, stop, add_two, add_one, 1)
    return _sum_halves(builder, total)


def _sum_fours(builder, source, start, stop, places=None):
    """Return the sum, in double precision, of the records of four reals at ``start … stop``, or at ``places[start … stop]``."""

    def add(position, accumulators):
        (record,) = _record(builder, source, position if places is None else _listed(builder, places, position), 4)
        _add(builder, _as_real(builder, record, _DOUBLE), *accumulators)

    return _accumulate(builder, start, stop, add, [4])[0]


@cache
def sum_records(length, sign):
    """Return an intrinsic: ``out[point] = factor * (sum of records[start … stop] + sign * sum of records[indices[first … last]])``.

    The records have two or four reals, the sums are in double precision, and `sign` is 1 or -1. A plain loop takes 1.6 (float32) or 1.4
    (float64) times as long for records of two reals, 2.8 or 1.8 times for records of four.
    """
    total = _sum_twos if length == 2 else _sum_fours

    @intrinsic
    def add_up(typingctx, records, start, stop, indices, first, last, factor, point, out):
        signature = types.void(records, *[types.uint64] * 2, indices, *[types.uint64] * 2, types.float64, types.uint64, out)

        def codegen(context, builder, signature, arguments):
            source, places, target = _data(context, builder, signature, arguments, 0, 3, 8)
            own, others = total(builder, source, *arguments[1:3]), total(builder, source, *arguments[4:6], places)
            both = (builder.fadd if sign > 0 else builder.fsub)(own, others)
            _put_record(builder, [builder.fmul(both, _vector(builder, [arguments[6]] * length))], target, arguments[7], length)
            return context.get_dummy_value()

        return signature, codegen

    return add_up


@intrinsic
def sum_listed_records(typingctx, records, listed, start, stop, out, at):
    """Write ``out[at] = sum of records[listed[b]] for b in start … stop``, records of four doubles.

    A plain loop takes 3.2 times as long.
    """
    signature = types.void(records, listed, types.uint64, types.uint64, out, types.uint64)

    def codegen(context, builder, signature, arguments):
        source, indices, target = _data(context, builder, signature, arguments, 0, 1, 4)
        _put_record(builder, [_sum_fours(builder, source, *arguments[2:4], indices)], target, arguments[5], 4)
        return context.get_dummy_value()

    return signature, codegen


@cache
def multiply_pairs(dimension):
    """Return an intrinsic that multiplies the records of pairs with those of their ends, all of d + d d reals in single precision.

    ``out[b] = records[b] . (points[second[b]] + s * points[first])`` for b in start … stop, where s is -1 for the first d reals and 1 for
    the others. A plain loop takes 2.3 times as long in the plane and 4.1 times in three dimensions.
    """
    length = dimension + dimension**2

    @intrinsic
    def multiply(typingctx, records, points, first, second, start, stop, out):
        signature = types.void(records, points, types.uint64, second, *[types.uint64] * 2, out)

        def codegen(context, builder, signature, arguments):
            pairs, ends, indices, target = _data(context, builder, signature, arguments, 0, 1, 3, 6)
            signs = [-1.0 if at < dimension else 1.0 for at in range(length)]
            own = [
                builder.fmul(part, ir.Constant(part.type, signs[at : at + count]))
                for part, (at, count) in zip(_record(builder, ends, arguments[2], length), _parts(length), strict=True)
            ]
            with cgutils.for_range(builder, builder.sub(arguments[5], arguments[4])) as loop:
                b = builder.add(arguments[4], loop.index)
                others = _record(builder, ends, _listed(builder, indices, b), length)
                totals = {}
                for record, mine, other in zip(_record(builder, pairs, b, length), own, others, strict=True):
                    product, count = builder.fmul(record, builder.fadd(mine, other), flags=_CONTRACT), record.type.count
                    totals[count] = builder.fadd(totals[count], product, flags=_CONTRACT) if count in totals else product
                total = _sum_halves(builder, totals[4])
                total = builder.fadd(total, totals[2]) if 2 in totals else total
                first, last = (builder.extract_element(total, _lane(n)) for n in range(2))
                builder.store(builder.fadd(first, last), _element(builder, target, b))
            return context.get_dummy_value()

        return signature, codegen

    return multiply


@cache
def sum_scaled_records(dimension):
    """Return an intrinsic that sums records of pairs, of d + d d reals in single precision, each times a factor.

    The sums run over b in start … stop and, at ``indices[first … last]``, over pairs of which the point is the other end:
    ``vectors[point]`` is the difference of both sums of the first d reals, ``matrices[point]`` the sum of those of the others. A plain loop
    takes 5.6 times as long in the plane and 5.8 times in three dimensions.
    """
    length = dimension + dimension**2
    counts = [count for _, count in _parts(length)]

    @intrinsic
    def add_up(typingctx, records, factors, start, stop, indices, first, last, point, vectors, matrices):
        whole = types.uint64
        signature = types.void(records, factors, whole, whole, indices, whole, whole, whole, vectors, matrices)

        def codegen(context, builder, signature, arguments):
            pairs, scales, listed, *targets = _data(context, builder, signature, arguments, 0, 1, 4, 8, 9)

            def total(start, stop, places=None):
                sums = _zeros(builder, ir.FloatType(), counts)

                def add(position):
                    b = position if places is None else _listed(builder, places, position)
                    factor = builder.load(_element(builder, scales, b))
                    for part, accumulator in zip(_record(builder, pairs, b, length), sums, strict=True):
                        _add(builder, builder.fmul(part, _vector(builder, [factor] * part.type.count), flags=_CONTRACT), accumulator)

                _in_steps(builder, start, stop, 1, add)
                values = zip(map(builder.load, sums), counts, strict=True)
                return [builder.extract_element(value, _lane(n)) for value, count in values for n in range(count)]

            own, others = total(arguments[2], arguments[3]), total(arguments[5], arguments[6], listed)
            for target, combine, places in zip(
                targets, (builder.fsub, builder.fadd), (range(dimension), range(dimension, length)), strict=True
            ):
                base = _element(builder, target, arguments[7], len(places))
                for r, at in enumerate(places):
                    _store(builder, _vector(builder, [combine(own[at], others[at])]), _element(builder, base, _constant(r)))
            return context.get_dummy_value()

        return signature, codegen

    return add_up


@cache
def sum_weighted_rows(width):
    """Return an intrinsic for rows of `width` reals in single precision: ``out[point] = sum over e in start … stop of w[e] x[columns[e]]``.

    LLVM gathers as many entries at a time as fit into a register, which rows of seven never fill: a plain loop takes 3.3 times as long for
    seven reals, 2.1 times for two or three, and 1.3 times for one.
    """

    @intrinsic
    def add_up(typingctx, weights, columns, start, stop, rows, point, out):
        whole = types.uint64
        signature = types.void(weights, columns, whole, whole, rows, whole, out)

        def codegen(context, builder, signature, arguments):
            factors, indices, source, target = _data(context, builder, signature, arguments, 0, 1, 4, 6)

            def add(e, accumulators):
                row = _load(builder, _element(builder, source, _listed(builder, indices, e), width), width)
                factor = _vector(builder, [builder.load(_element(builder, factors, e))] * width)
                _add(builder, builder.fmul(row, factor, flags=_CONTRACT), *accumulators)

            (total,) = _accumulate(builder, arguments[2], arguments[3], add, [width], ir.FloatType())
            _store(builder, total, _element(builder, target, arguments[5], width))
            return context.get_dummy_value()

        return signature, codegen

    return add_up
