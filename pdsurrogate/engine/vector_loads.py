"""Loads, stores and sums of short rows of reals (records), written with explicit vector
instructions.

A record is what an array holds for one point or pair: two or three doubles of a position, four or
nine reals of a gradient. LLVM compiles indexed loads in a loop over bonds into gather instructions,
one component at a time; loading a record as a few vectors of four, two or one reals is faster. Each
function states how many times as long a plain loop takes on a processor with AVX2, in single and in
double precision; functions with a factor below 1.3 are not kept. ``tests/kernels/test_kernels.py``
compares the results.

The arrays of a solid do not fit into the caches, and a processor foresees neither which records a
list names nor that a new block begins. Passes over solids therefore ask for memory before they need
it (`fetch`). No result depends on that.
"""

from functools import cache

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .block_arrays import BLOCK, CACHE_LINE
from .intrinsics import data_of, writes

_INDEX = ir.IntType(64)
_DOUBLE = ir.DoubleType()

AHEAD = 64
"""Number of bonds by which a sum over bonds asks for memory ahead of its additions. Chosen: of 16,
32, 64 and 96, the energies of solids of 8,000 and 32,768 points are fastest with 64 and with 96.
"""

_CONTRACT = ("contract",)
"""Flag of LLVM instructions that allows a product and a sum to become one instruction."""


def _constant(value):
    return ir.Constant(_INDEX, value)


def _lane(number):
    return ir.Constant(ir.IntType(32), number)


def _element(builder, data, index, width=1):
    """Return the address of element ``data[index * width]`` of an array."""
    if index.type.width < 64:
        index = builder.zext(index, _INDEX)
    if width != 1:
        index = builder.mul(index, _constant(width))
    return builder.gep(data, [index], inbounds=True)


def _listed(builder, indices, position):
    """Return the entry of `indices` at a position, as a 64-bit index."""
    return builder.zext(builder.load(_element(builder, indices, position)), _INDEX)


def _end_of(builder, point, ways, place):
    """Return the number of the point to which the entry of `ways` (modulo 2^32) at a place leads
    from a point.
    """
    return builder.add(point, builder.sext(builder.load(_element(builder, ways, place)), _INDEX))


def _load(builder, address, count):
    scalar = address.type.pointee
    value = builder.load(builder.bitcast(address, ir.VectorType(scalar, count).as_pointer()))
    value.align = 4 if scalar == ir.FloatType() else 8
    return value


def _store(builder, value, address):
    """Write a vector to an address, converted to the precision of the array there."""
    value = _as_real(builder, value, address.type.pointee)
    instruction = builder.store(value, builder.bitcast(address, value.type.as_pointer()))
    instruction.align = 4 if value.type.element == ir.FloatType() else 8


def _parts(length):
    """Return how a record of `length` reals is cut into vectors of four, two or one reals: the
    first index and the length of each.
    """
    parts = [(at, 4) for at in range(0, length - 3, 4)]
    for count in (2, 1):
        if length % 4 & count:
            parts.append((sum(n for _, n in parts), count))
    return parts


def _record(builder, data, index, length):
    """Load the record at an index of an array; return it as a list of vectors, cut as `_parts`
    defines.
    """
    base = _element(builder, data, index, length)
    return [
        _load(builder, _element(builder, base, _constant(at)), count)
        for at, count in _parts(length)
    ]


def _put_record(builder, parts, data, index, length):
    """Write a record, given as a list of vectors cut as `_parts` defines, to an index of an
    array.
    """
    base = _element(builder, data, index, length)
    for part, (at, _) in zip(parts, _parts(length), strict=True):
        _store(builder, part, _element(builder, base, _constant(at)))


def _components(builder, parts):
    """Return the reals of vectors."""
    return [
        builder.extract_element(part, _lane(n)) for part in parts for n in range(part.type.count)
    ]


def _put_components(builder, values, data, index):
    """Write the reals of a record to an index of an array."""
    base = _element(builder, data, index, len(values))
    for r, value in enumerate(values):
        _store(builder, _vector(builder, [value]), _element(builder, base, _constant(r)))


def _fetch(builder, data, start, count, to_write=False):
    """Ask for the `count` reals of an array from element `start` on, so that they are in the cache
    when they are read, or written.

    They may lie beyond the end of the array: then nothing happens.
    """
    number = ir.IntType(32)
    byte = ir.IntType(8).as_pointer()
    ask = builder.module.declare_intrinsic(
        "llvm.prefetch", [byte], ir.FunctionType(ir.VoidType(), [byte, number, number, number])
    )
    start = builder.zext(start, _INDEX) if start.type.width < 64 else start
    reals = CACHE_LINE // (4 if data.type.pointee == ir.FloatType() else 8)
    for at in range(0, count, reals):
        address = builder.bitcast(builder.gep(data, [builder.add(start, _constant(at))]), byte)
        # The nearest cache, for data.
        builder.call(ask, [address, _lane(int(to_write)), _lane(3), _lane(1)])


@cache
def fetch(count, to_write=False):
    """Return an intrinsic that asks for `count` reals of an array, from its element `start` in
    the order of memory, see `_fetch`.
    """

    @writes
    def fetch_reals(builder, array, start):
        _fetch(builder, array, start, count, to_write)

    return fetch_reals


def _shuffle(builder, first, second, lanes):
    return builder.shuffle_vector(
        first, second, ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes)
    )


def _as_real(builder, value, scalar):
    """Convert a vector to the precision `scalar`, single or double."""
    if value.type.element == scalar:
        return value
    target = ir.VectorType(scalar, value.type.count)
    return (
        builder.fptrunc(value, target) if scalar == ir.FloatType() else builder.fpext(value, target)
    )


def _vector(builder, values):
    """Return a vector made of the given scalars, LLVM values that are known only at run time."""
    vector = ir.Constant(ir.VectorType(values[0].type, len(values)), ir.Undefined)
    for k, value in enumerate(values):
        vector = builder.insert_element(vector, value, _lane(k))
    return vector


def _add(builder, term, accumulator):
    builder.store(builder.fadd(builder.load(accumulator), term, flags=_CONTRACT), accumulator)


def _zeros(builder, scalar, counts):
    """Allocate accumulators on the stack, vectors of the lengths `counts`, set them to zero, and
    return their addresses.
    """
    accumulators = [cgutils.alloca_once(builder, ir.VectorType(scalar, count)) for count in counts]
    for accumulator, count in zip(accumulators, counts, strict=True):
        builder.store(ir.Constant(ir.VectorType(scalar, count), [0.0] * count), accumulator)
    return accumulators


def _in_steps(builder, start, stop, step, body):
    """Call ``body(position)`` from `start` to `stop` in whole steps of `step`, a power of two;
    return where the remainder begins.
    """
    shift = _constant(step.bit_length() - 1)
    steps = builder.lshr(builder.sub(stop, start), shift)
    with cgutils.for_range(builder, steps) as loop:
        body(builder.add(start, builder.shl(loop.index, shift)))
    return builder.add(start, builder.shl(steps, shift))


def _accumulate(builder, bonds, add, counts, scalar=_DOUBLE, chains=4, together=1):
    """Return sums over the positions of `bonds` (start, stop), as vectors of the lengths `counts`.

    ``add(accumulators, position)`` adds the terms of one position, or of two positions where
    `together` is 2. Several sets of accumulators (`chains`) are summed side by side, so that an
    addition need not wait for the addition before.
    """
    start, stop = bonds
    sums = [_zeros(builder, scalar, counts) for _ in range(chains)]

    def add_to(used, count):
        def body(base):
            for n, accumulators in enumerate(used):
                add(
                    accumulators,
                    *(builder.add(base, _constant(n * count + m)) for m in range(count)),
                )

        return body

    rest = _in_steps(builder, start, stop, chains * together, add_to(sums, together))
    if together > 1:
        rest = _in_steps(builder, rest, stop, together, add_to(sums[:1], together))
    _in_steps(builder, rest, stop, 1, add_to(sums[:1] if together == 1 else sums[-1:], 1))
    found = [[builder.load(accumulator) for accumulator in accumulators] for accumulators in sums]
    while len(found) > 1:
        found = [
            [builder.fadd(*both) for both in zip(*found[n : n + 2], strict=True)]
            for n in range(0, len(found), 2)
        ]
    return found[0]


def _one_or_two(builder, records, places):
    """Return one or two records of two reals as one vector of four, the second half zero if
    there is only one place.
    """
    found = [_record(builder, records, place, 2)[0] for place in places]
    return _joined(
        builder, found[0], found[1] if len(found) == 2 else ir.Constant(found[0].type, [0.0, 0.0])
    )


def _joined(builder, first, second):
    """Return the vector of the components of two vectors, one after the other."""
    return _shuffle(builder, first, second, list(range(2 * first.type.count)))


def _sum_halves(builder, vector, flags=()):
    """Return the first half of a vector plus its second half, a vector of half the length."""
    half = vector.type.count // 2
    return builder.fadd(
        *(_shuffle(builder, vector, vector, list(range(at, at + half))) for at in (0, half)),
        flags=flags,
    )


def _transposed(builder, rows):
    """Return the transpose of four vectors of equal length: one vector of four lanes for each
    component.
    """
    count = rows[0].type.count
    ends = (0, 2)
    if count == 4:
        low, high = (
            [_shuffle(builder, rows[n], rows[n + 1], lanes) for n in ends]
            for lanes in ([0, 4, 1, 5], [2, 6, 3, 7])
        )
        return [
            _shuffle(builder, *pair, lanes)
            for pair in (low, high)
            for lanes in ([0, 1, 4, 5], [2, 3, 6, 7])
        ]
    halves = [_joined(builder, rows[n], rows[n + 1]) for n in ends]
    return [_shuffle(builder, *halves, list(range(c, 4 * count, count))) for c in range(count)]


def _put_combined(builder, data, pairs, length, combine, rows, column):
    """Combine the records at both ends of four pairs of points, and write component r of the
    results to row r of a block.

    The results of the four pairs lie in the columns from `column` on; ``combine(first, second)``
    returns the vector of a result.
    """
    records = []
    for pair in pairs:
        ends = [_record(builder, data, end, length) for end in pair]
        records.append([combine(*parts) for parts in zip(*ends, strict=True)])
    components = [
        component
        for parts in zip(*records, strict=True)
        for component in _transposed(builder, parts)
    ]
    for r, component in enumerate(components):
        _store(
            builder, component, _element(builder, rows, builder.add(_constant(r * BLOCK), column))
        )


def _ends_of(builder, ends, at):
    """Return, for the four pairs from number `at` on, the numbers of the points at their first and
    second ends.

    `ends` holds two arrays, the first and the second point of every pair.
    """
    places = [builder.add(at, _constant(k)) for k in range(4)]
    return [[_listed(builder, points, place) for points in ends] for place in places]


@cache
def gather_pairs(dimension):
    """Return an intrinsic that, for four pairs of points, writes sums of the matrices and
    differences of the positions of both ends.

    ``sums[r, column + k] = matrices[first[at + k], r] + matrices[second[at + k], r]`` and
    ``differences[r, column + k] = positions[second[at + k], r] - positions[first[at + k], r]``,
    each for k in 0 … 3, where ``ends = first, second``: one row for each component. A plain loop
    takes 3.5 (float32) or 2.4 (float64) times as long in the plane, 2.1 or 1.9 times in three
    dimensions.
    """

    @writes
    def gather(builder, matrices, positions, ends, at, sums, differences, column):
        pairs = _ends_of(builder, ends, at)
        _put_combined(builder, matrices, pairs, dimension**2, builder.fadd, sums, column)
        _put_combined(
            builder,
            positions,
            pairs,
            dimension,
            lambda first, second: builder.fsub(second, first),
            differences,
            column,
        )

    return gather


@cache
def add_at_ends(dimension):
    """Return an intrinsic that adds the moments and forces of a block of pairs, one pair after the
    other, to the rows of both ends in an array of sums, in double precision.

    Moment r of pair k, in ``moments[r, k]``, and force q, in ``forces[q, k]``, are added to row
    ``one[at + k]`` of `sums`, the moment and minus the force to row ``two[at + k]``, where ``ends =
    one, two``. A row has the d d numbers of a moment, then the d of a force.
    """
    matrix = dimension**2
    length = matrix + dimension
    parts = _parts(length)

    @writes
    def add(builder, moments, forces, ends, at, sums):
        one, two = ends

        def places(row):
            base = _element(builder, sums, row, length)
            return [(_element(builder, base, _constant(start)), count) for start, count in parts]

        def move(row, write):
            """Write the sums that are held to a row, or hold those of the row."""
            for (place, count), own in zip(places(row), held, strict=True):
                if write:
                    _store(builder, builder.load(own), place)
                else:
                    builder.store(_load(builder, place, count), own)

        # The sums of a first point are held in registers while its pairs follow one another; those
        # of a solid are too many.
        held = _zeros(builder, _DOUBLE, [count for _, count in parts]) if dimension == 2 else []
        before = cgutils.alloca_once(builder, _INDEX)
        if held:
            builder.store(_listed(builder, one, at), before)
            move(builder.load(before), False)
        with cgutils.for_range(builder, _constant(BLOCK // 4)) as loop:
            column = builder.mul(loop.index, _constant(4))
            columns = [
                _load(
                    builder, _element(builder, rows, builder.add(_constant(r * BLOCK), column)), 4
                )
                for rows, count in ((moments, matrix), (forces, dimension))
                for r in range(count)
            ]
            pieces_of = [
                _transposed(builder, columns[start : start + 4])
                if count == 4
                else [_shuffle(builder, *columns[start:], [k, 4 + k]) for k in range(4)]
                for start, count in parts
            ]
            for k, pieces in enumerate(zip(*pieces_of, strict=True)):
                terms = [_as_real(builder, piece, _DOUBLE) for piece in pieces]
                pair = builder.add(builder.add(at, column), _constant(k))
                row = _listed(builder, one, pair)
                if held:
                    last = builder.load(before)
                    with builder.if_then(builder.icmp_unsigned("!=", row, last)):
                        move(last, True)
                        move(row, False)
                        builder.store(row, before)
                    for own, term in zip(held, terms, strict=True):
                        _add(builder, term, own)
                else:
                    for (place, count), term in zip(places(row), terms, strict=True):
                        _store(builder, builder.fadd(_load(builder, place, count), term), place)
                others = zip(places(_listed(builder, two, pair)), terms, parts, strict=True)
                for (place, count), term, (start, _) in others:
                    signs = [1.0 if start + n < matrix else -1.0 for n in range(count)]
                    signed = builder.fmul(term, ir.Constant(term.type, signs), flags=_CONTRACT)
                    total = builder.fadd(_load(builder, place, count), signed, flags=_CONTRACT)
                    _store(builder, total, place)
        if held:
            move(builder.load(before), True)

    return add


@cache
def take_listed(length):
    """Return an intrinsic that reads parts of four listed records: ``rows[r, column + k] =
    records[numbers[at + k], start + r]`` for r below `length` and k from 0 to 3.

    Its arguments are ``(records, width, numbers, at, start, rows, column)``, with the `width` of a
    record. A plain loop takes 1.7 times as long.
    """

    @writes
    def take(builder, records, width, numbers, at, start, rows, column):
        found = []
        for k in range(4):
            number = _listed(builder, numbers, builder.add(at, _constant(k)))
            place = builder.add(builder.mul(number, width), start)
            found.append(_record(builder, _element(builder, records, place), _constant(0), length))
        for (first, _), parts in zip(_parts(length), zip(*found, strict=True), strict=True):
            for r, component in enumerate(_transposed(builder, parts)):
                row = builder.add(_constant((first + r) * BLOCK), column)
                _store(builder, component, _element(builder, rows, row))

    return take


@cache
def subtract_positions(dimension):
    """Return an intrinsic that writes the differences of the positions of both ends of four pairs,
    one row for each component.

    ``out[r, column + k] = positions[second[at + k], r] - positions[first[at + k], r]`` for k in 0 …
    3, where ``ends = first, second``. A plain loop takes 2.0 times as long.
    """

    @writes
    def subtract(builder, positions, ends, at, out, column):
        pairs = _ends_of(builder, ends, at)
        _put_combined(
            builder,
            positions,
            pairs,
            dimension,
            lambda first, second: builder.fsub(second, first),
            out,
            column,
        )

    return subtract


@writes
def sum_outer_products(builder, positions, ways, weights, bonds, point, out):
    """Write ``out[point] = sum over b in bonds of (positions[point + ways[b]] - positions[point])
    (x) weights[b]``, by columns.

    `bonds` are start and stop; `ways` are modulo 2^32, positions and weights in the plane. A plain
    loop takes 2.4 (float32) or 2.2 (float64) times as long.
    """
    own = _one_or_two(builder, positions, [point, point])

    def add(accumulators, *places):
        """Add one bond, or two at once if two `places` in the list of bonds are given, to both
        accumulators.

        The first sums the difference of positions times the first component of the weight, the
        second that times the second component.
        """
        ends = _one_or_two(
            builder, positions, [_end_of(builder, point, ways, place) for place in places]
        )
        factors = _as_real(builder, _one_or_two(builder, weights, places), _DOUBLE)
        differences = builder.fsub(ends, own)
        for accumulator, lanes in zip(accumulators, ([0, 0, 2, 2], [1, 1, 3, 3]), strict=True):
            _add(
                builder,
                builder.fmul(
                    differences, _shuffle(builder, factors, factors, lanes), flags=_CONTRACT
                ),
                accumulator,
            )

    sums = _accumulate(builder, bonds, add, [4, 4], chains=2, together=2)
    halves = (_shuffle(builder, *sums, lanes) for lanes in ([0, 1, 4, 5], [2, 3, 6, 7]))
    _put_record(builder, [builder.fadd(*halves)], out, point, 4)


def _repeated(builder, vectors, position):
    """Return the three components of vector number `position` in space, each as a vector of four
    doubles.
    """
    place = _element(builder, vectors, position, 3)
    components = [builder.load(_element(builder, place, _constant(r))) for r in range(3)]
    return [_as_real(builder, _vector(builder, [one] * 4), _DOUBLE) for one in components]


@writes
def sum_outer_products_in_space(builder, positions, ways, weights, bonds, point, out):
    """Do what `sum_outer_products` does in the plane. A plain loop takes 1.4 (float64)
    times as long.
    """

    def position_of(number):
        """Load a position; the fourth component is not used."""
        plane, last = _record(builder, positions, number, 3)
        return _shuffle(builder, plane, _shuffle(builder, last, last, [0, 0]), [0, 1, 2, 3])

    own = position_of(point)

    def add(accumulators, position):
        ahead = builder.add(position, _constant(AHEAD))
        _fetch(builder, weights, builder.mul(ahead, _constant(3)), 3)
        difference = builder.fsub(position_of(_end_of(builder, point, ways, position)), own)
        for accumulator, factor in zip(
            accumulators, _repeated(builder, weights, position), strict=True
        ):
            _add(builder, builder.fmul(difference, factor, flags=_CONTRACT), accumulator)

    columns = _accumulate(builder, bonds, add, [4, 4, 4], chains=2)
    place = _element(builder, out, point, 9)
    for number, column in enumerate(columns):
        parts = [_shuffle(builder, column, column, lanes) for lanes in ([0, 1], [2])]
        _put_record(builder, parts, place, _constant(number), 3)


@writes
def outer_products(builder, positions, neighbors, weights, bonds, point, out):
    """Write ``out[b - start] = (positions[neighbors[b]] - positions[point]) (x) weights[b]`` for b
    in bonds, by columns, in the plane.

    `bonds` are start and stop. A plain loop takes 1.6 times as long.
    """
    start, stop = bonds
    own = _one_or_two(builder, positions, [point, point])
    with cgutils.for_range(builder, builder.sub(stop, start)) as loop:
        b = builder.add(start, loop.index)
        (factor,) = _record(builder, weights, b, 2)
        end = _listed(builder, neighbors, b)
        difference = builder.fsub(_one_or_two(builder, positions, [end, end]), own)
        _put_record(
            builder,
            [builder.fmul(difference, _shuffle(builder, factor, factor, [0, 0, 1, 1]))],
            out,
            loop.index,
            4,
        )


def _with_shift(builder, bonds):
    """Return start and stop of `bonds`, and what leads from a bond to the place of its weight."""
    start, stop, place = bonds
    return start, stop, builder.sub(place, start)


@cache
def sum_matrix_products(dimension):
    """Return an intrinsic that sums products of matrices and vectors: ``out[point] = sum of
    (matrices[point] + matrices[j]) vectors[b]``.

    The sum is over b from start to stop, the first two items of `bonds`, and j is
    ``neighbors[b]``; the third item is the place of the first vector. Matrices are stored by
    columns. A plain loop takes 3.0 (float32) or 2.9 (float64) times as long
    in the plane, 1.9 or 2.1 times in three dimensions.
    """

    @writes
    def add_up(builder, matrices, neighbors, vectors, bonds, point, out):
        def columns(number):
            """Load matrix `number`: return a 2 x 2 matrix as one vector, and a 3 x 3 matrix as its
            columns.

            Each column of a 3 x 3 matrix has a fourth, unused component.
            """
            if dimension == 2:
                return _record(builder, matrices, number, 4)
            base = _element(builder, matrices, number, 9)
            loaded = [_load(builder, _element(builder, base, _constant(at)), 4) for at in (0, 3, 5)]
            return [*loaded[:2], _shuffle(builder, loaded[2], loaded[2], [1, 2, 3, 3])]

        def spread(position):
            """Return vector number `position` as factors of the columns of a matrix, each
            component repeated for every row.
            """
            if dimension == 2:
                factor = _as_real(builder, *_record(builder, vectors, position, 2), _DOUBLE)
                return [_shuffle(builder, factor, factor, [0, 0, 1, 1])]
            return _repeated(builder, vectors, position)

        own = columns(point)
        *bonds, shift = _with_shift(builder, bonds)

        def add_bond(accumulators, position):
            place = builder.add(position, shift)
            if dimension == 3:
                ahead = builder.add(place, _constant(AHEAD))
                _fetch(builder, vectors, builder.mul(ahead, _constant(3)), 3)
            others = columns(_listed(builder, neighbors, position))
            for mine, other, factor in zip(own, others, spread(place), strict=True):
                _add(
                    builder,
                    builder.fmul(builder.fadd(mine, other), factor, flags=_CONTRACT),
                    accumulators[0],
                )

        (total,) = _accumulate(builder, bonds, add_bond, [4])
        parts = (
            [_sum_halves(builder, total)]
            if dimension == 2
            else [_shuffle(builder, total, total, lanes) for lanes in ([0, 1], [2])]
        )
        _put_record(builder, parts, out, point, dimension)

    return add_up


def _sum_of(builder, records, length, bonds, listed=None, factors=None, size=None):
    """Return the sum of the records at ``start … stop``, or at ``listed[start … stop]``, as a list
    of vectors cut as `_parts` defines.

    Without `factors` the sum is in double precision. With `factors`, records times factors are
    summed in the precision of the records. With `size`, the number of all entries of `listed`, the
    function asks for records before they are needed.
    """
    scalar = _DOUBLE if factors is None else records.type.pointee

    def fetch_ahead(position):
        ahead = builder.add(position, _constant(AHEAD))
        if listed is not None:
            last = builder.sub(size, _constant(1))
            ahead = _listed(
                builder, listed, builder.select(builder.icmp_signed("<", ahead, last), ahead, last)
            )
        _fetch(builder, records, builder.mul(ahead, _constant(length)), length)

    def add(accumulators, *positions):
        for position in positions if size is not None else ():
            fetch_ahead(position)
        places = (
            positions
            if listed is None
            else [_listed(builder, listed, position) for position in positions]
        )
        parts = (
            [_one_or_two(builder, records, places)]
            if length == 2
            else _record(builder, records, places[0], length)
        )
        for part, accumulator in zip(parts, accumulators, strict=True):
            term = _as_real(builder, part, scalar)
            if factors is not None:
                factor = builder.load(_element(builder, factors, places[0]))
                term = builder.fmul(
                    term, _vector(builder, [factor] * term.type.count), flags=_CONTRACT
                )
            _add(builder, term, accumulator)

    if length == 2:
        (total,) = _accumulate(builder, bonds, add, [4], chains=2, together=2)
        return [_sum_halves(builder, total)]
    return _accumulate(
        builder,
        bonds,
        add,
        [count for _, count in _parts(length)],
        scalar,
        4 if factors is None else 1,
    )


@cache
def sum_records(length):
    """Return an intrinsic that sums records: ``out[point] = factor * (sum of records[own] - sum of
    records[indices[others]])``.

    Each record has `length` reals. `own` and `others` are start and stop; the sums are in double
    precision. A plain loop takes 2.4 (float32) or 1.8 (float64) times as long for records of two
    reals.
    """

    @writes
    def add_up(builder, records, own, indices, others, factor, point, out):
        sums = (_sum_of(builder, records, length, *bonds) for bonds in ((own,), (others, indices)))
        both = [builder.fsub(*parts) for parts in zip(*sums, strict=True)]
        _put_record(
            builder,
            [builder.fmul(part, _vector(builder, [factor] * part.type.count)) for part in both],
            out,
            point,
            length,
        )

    return add_up


@cache
def sum_at_point(dimension):
    """Return an intrinsic that sums rows of `add_at_ends` at a point, times a factor: the moment to
    row `point` of `moments`, the force to row `point` of `forces`.

    The rows are ``listed[b]`` for b in `entries` (start, stop).
    """
    matrix = dimension**2

    @writes
    def add_up(builder, sums, listed, entries, factor, point, moments, forces):
        found = [
            builder.fmul(value, factor)
            for value in _components(
                builder, _sum_of(builder, sums, matrix + dimension, entries, listed)
            )
        ]
        _put_components(builder, found[:matrix], moments, point)
        _put_components(builder, found[matrix:], forces, point)

    return add_up


@writes
def sum_listed_records(builder, records, listed, bonds, out, at):
    """Write ``out[at] = sum of records[listed[b]] for b in bonds``, where records have four doubles
    and `bonds` are start and stop.

    A plain loop takes 3.2 times as long.
    """
    _put_record(builder, _sum_of(builder, records, 4, bonds, listed), out, at, 4)


@cache
def multiply_pairs(dimension):
    """Return an intrinsic that computes scalar products of the records of pairs with the records of
    their two points, in single precision.

    ``out[b] = records[b] . (points[second[b]] + s * points[first])`` for b in bonds (start, stop),
    where `first` is one point, records have d + d d reals, and s is -1 for the first d reals and 1
    for the others. A plain loop takes 2.3 times as long in the plane and 4.1 times in three
    dimensions.
    """
    length = dimension + dimension**2
    signs = [-1.0] * dimension + [1.0] * dimension**2

    @writes
    def multiply(builder, records, points, first, second, bonds, out):
        start, stop = bonds
        own = [
            builder.fmul(part, ir.Constant(part.type, signs[at : at + count]))
            for part, (at, count) in zip(
                _record(builder, points, first, length), _parts(length), strict=True
            )
        ]
        with cgutils.for_range(builder, builder.sub(stop, start)) as loop:
            b = builder.add(start, loop.index)
            if dimension == 3:
                _fetch(
                    builder,
                    records,
                    builder.mul(builder.add(b, _constant(AHEAD)), _constant(length)),
                    length,
                )
            others = _record(builder, points, _listed(builder, second, b), length)
            totals = {}
            for record, mine, other in zip(
                _record(builder, records, b, length), own, others, strict=True
            ):
                product = builder.fmul(record, builder.fadd(mine, other), flags=_CONTRACT)
                count = record.type.count
                totals[count] = (
                    builder.fadd(totals[count], product, flags=_CONTRACT)
                    if count in totals
                    else product
                )
            total = _sum_halves(builder, totals[4])
            total = builder.fadd(total, totals[2]) if 2 in totals else total
            both = (builder.extract_element(total, _lane(n)) for n in range(2))
            builder.store(builder.fadd(*both), _element(builder, out, b))

    return multiply


@cache
def sum_scaled_records(dimension):
    """Return an intrinsic that sums, at a point, the records of its pairs, each times a factor.

    A record has d + d*d reals in single precision. Two sums are formed: over the pairs `own` that
    have `point` as first point, and over the pairs ``indices[others]`` that have it as second
    point; `listed` holds the `indices` and their number. `outputs` are two arrays: row `point` of
    ``outputs[0]`` receives the first d entries of (first sum - second sum), and row `point` of
    ``outputs[1]`` the other d*d entries of (first sum + second sum). A plain loop takes 5.6 times
    as long in the plane and 5.8 times in three dimensions.
    """
    length = dimension + dimension**2

    @writes
    def add_up(builder, records, factors, own, listed, others, point, outputs):
        indices = listed[0]
        size = listed[1] if dimension == 3 else None

        mine, theirs = (
            _components(builder, _sum_of(builder, records, length, *bonds, factors, size))
            for bonds in ((own, None), (others, indices))
        )
        pairs = list(zip(mine, theirs, strict=True))
        for target, combine, values in zip(
            outputs,
            (builder.fsub, builder.fadd),
            (pairs[:dimension], pairs[dimension:]),
            strict=True,
        ):
            _put_components(builder, [combine(*both) for both in values], target, point)

    return add_up


@cache
def sum_weighted_rows(width):
    """Return an intrinsic for one row of a sparse matrix times an array: ``out[point] = sum of
    weights[e] * rows[columns[e]]``.

    The sum is over e from start to stop, the two items of `entries`. `rows` is an array with rows
    of `width` reals, in the precision of `weights`. LLVM gathers as many entries at a time as fit
    into a register, which rows of seven never fill: a plain loop takes 3.3 times as long for seven
    reals, 2.1 times for two or three, and 1.3 times for one.
    """

    @writes
    def add_up(builder, weights, columns, entries, rows, point, out):
        def add(accumulators, e):
            row = _load(
                builder, _element(builder, rows, _listed(builder, columns, e), width), width
            )
            factor = _vector(builder, [builder.load(_element(builder, weights, e))] * width)
            _add(builder, builder.fmul(row, factor, flags=_CONTRACT), *accumulators)

        (total,) = _accumulate(builder, entries, add, [width], weights.type.pointee)
        _store(builder, total, _element(builder, out, point, width))

    return add_up


@intrinsic
def sums_of_rows(typingctx, table, begin, row, first, second):
    """Return two sums over p and q < 4: of ``first[p] second[q] table[k]`` and of ``first[p]
    second[q] table[k + 1]``.

    Here k is ``begin + p row + 2 q``; `first` and `second` are tuples of four, and the numbers in
    `table` are coefficients of the two outputs of a spline. Eight consecutive numbers, four places
    with two outputs each, are loaded as one vector: written as sixteen sums, LLVM gathers every
    number by itself, which takes three times as long.
    """
    real = table.dtype
    flags = ("contract", "reassoc", "nsz")

    def codegen(context, builder, signature, arguments):
        data, begin, row, weights, across = (
            data_of(context, builder, *pair) for pair in zip(signature.args, arguments, strict=True)
        )
        total = None
        for number, weight in enumerate(weights):
            at = builder.add(begin, builder.mul(row, ir.Constant(begin.type, number)))
            part = builder.fmul(
                _vector(builder, [weight] * 8),
                _load(builder, _element(builder, data, at), 8),
                flags=flags,
            )
            total = part if total is None else builder.fadd(total, part, flags=flags)
        factors = _vector(builder, across)
        total = builder.fmul(
            total, _shuffle(builder, factors, factors, [n // 2 for n in range(8)]), flags=flags
        )
        while total.type.count > 2:
            total = _sum_halves(builder, total, flags)
        return cgutils.pack_array(
            builder, [builder.extract_element(total, _lane(n)) for n in range(2)]
        )

    return types.UniTuple(real, 2)(table, begin, row, first, second), codegen
