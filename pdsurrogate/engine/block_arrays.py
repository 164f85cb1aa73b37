"""Arrays whose row length is known to the compiler, access to array entries as tuples, and an
atomic counter, for compiled code.
"""

import math
from functools import cache

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .intrinsics import data_of

BLOCK = 256
"""Number of states (of bonds or points) in a block, and so of values per row: a dozen rows of
doubles fit into a 32 kB first-level cache, and the number is a multiple of every vector width.
"""

STATE_ROWS = 6
"""Number of rows of the states of a bond force: the components a = U_nn, b = U_nm and U_mm of the
stretch tensor, n along the bond and m across, the area ratio J, the squared thickness stretch C33,
and for models that need it the bond length in horizons.
"""

TRACTION_ROWS = 3
"""Number of rows of the result of a bond force: the components T_nn, T_nm, T_mm, along and across
the bond, of its dimensionless stress T = R^T P (theory (11)).
"""

SCRATCH_ROWS = 9
"""Number of rows of doubles for a stress response: three for its states, five for its result,
one of working memory.
"""

CACHE_LINE = 64
"""Bytes of a cache line of x86-64 processors, and of their widest vectors (AVX-512): aligned rows
are loaded without crossing a line, and threads that write to different lines do not slow each
other.
"""


def power_of_two(size: float) -> float:
    """Return the smallest power of two greater than `size`, and 1 if `size` is 0.

    Division by this power of two brings numbers of about this size into the range of single
    precision without rounding them.
    """
    return float(np.ldexp(1.0, int(np.frexp(size)[1]))) if size > 0 else 1.0


def aligned_rows(shape, dtype=np.float64, value=0):
    """Return an array filled with `value` that begins at a cache line, so that no vector of a row
    lies across two cache lines.

    NumPy promises an alignment of 16 bytes only; half of all 32-byte loads and every 64-byte load
    would then touch two cache lines.
    """
    dtype = np.dtype(dtype)
    size = math.prod(shape) * dtype.itemsize
    memory = np.empty(size + CACHE_LINE, dtype=np.uint8)
    start = -memory.ctypes.data % CACHE_LINE
    array = memory[start : start + size].view(dtype).reshape(shape)
    array[...] = value
    return array


def array_over(context, builder, kind, data, shape):
    """Return an LLVM value for an array of numba type `kind`, in C order, whose entries lie in the
    memory at address `data`.

    Entries of `shape` that are LLVM constants are known to the compiler.
    """
    size = ir.Constant(
        context.get_value_type(types.intp),
        context.get_abi_sizeof(context.get_data_type(kind.dtype)),
    )
    strides = [size]
    for extent in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], extent))
    array = context.make_array(kind)(context, builder)
    context.populate_array(
        array,
        data=data,
        shape=cgutils.pack_array(builder, shape),
        strides=cgutils.pack_array(builder, strides),
        itemsize=size,
        meminfo=None,
        parent=None,
    )
    return array._getvalue()


@cache
def rows_of(length):
    """Return an intrinsic that views a two-dimensional array as an array with rows of exactly
    `length` values, unchecked.

    With a constant row length LLVM sees that the rows of an array do not overlap. Otherwise every
    pair of rows in a loop costs a test at run time, and beyond eight rows the loop is not
    vectorized.
    """

    @intrinsic
    def stated(typingctx, array):
        result_type = types.Array(array.dtype, 2, "C")

        def codegen(context, builder, signature, arguments):
            given = context.make_array(signature.args[0])(context, builder, arguments[0])
            rows = builder.extract_value(given.shape, 0)
            return array_over(
                context, builder, result_type, given.data, [rows, ir.Constant(rows.type, length)]
            )

        return result_type(array), codegen

    return stated


block_rows = rows_of(BLOCK)

pair_records = rows_of(2)
quad_records = rows_of(4)


@intrinsic
def rows_from(typingctx, rows, start):
    """Return a view of the rows of a block from row `start` on.

    A slice would hide from LLVM how far its rows are from the other rows of the block, since the
    start of a slice is clipped at run time.
    """
    signature = rows(rows, types.intp)

    def codegen(context, builder, signature, arguments):
        given = context.make_array(signature.args[0])(context, builder, arguments[0])
        number, length = cgutils.unpack_tuple(builder, given.shape)
        data = builder.gep(given.data, [builder.mul(arguments[1], length)], inbounds=True)
        return array_over(
            context,
            builder,
            signature.return_type,
            data,
            [builder.sub(number, arguments[1]), length],
        )

    return signature, codegen


def _put(place):
    """Return the intrinsic ``put(array, number, values)``, which writes value q of a tuple to entry
    ``place(number, q)`` of the array.

    Values are converted to the type of the array.
    """

    @intrinsic
    def put(typingctx, array, number, values):
        signature = types.void(array, types.intp, values)

        def codegen(context, builder, signature, arguments):
            into = context.make_array(array)(context, builder, arguments[0])
            for q, (value, kind) in enumerate(
                zip(cgutils.unpack_tuple(builder, arguments[2]), values, strict=True)
            ):
                at = cgutils.get_item_pointer(
                    context,
                    builder,
                    array,
                    into,
                    place(arguments[1], ir.Constant(arguments[1].type, q)),
                )
                builder.store(context.cast(builder, value, kind, array.dtype), at)
            return context.get_dummy_value()

        return signature, codegen

    return put


put_column = _put(lambda column, q: [q, column])
"""Intrinsic ``put_column(rows, column, values)``: ``rows[q, column] = values[q]`` for every value
of a tuple.

A loop over q would make LLVM split the first columns off the enclosing loop, whose vectors then lie
across cache lines.
"""

put_row = _put(lambda row, q: [row, q])
"""Intrinsic ``put_row(records, row, values)``: ``records[row, q] = values[q]`` for every value
of a tuple.
"""


@intrinsic
def tuple_of(typingctx, array, count):
    """Return the first `count` values of an array as a tuple, so that a loop keeps them in
    registers and need not load them again.

    `count` is a literal.
    """
    if not isinstance(count, types.IntegerLiteral):
        return None
    result_type = types.UniTuple(array.dtype, count.literal_value)

    def codegen(context, builder, signature, arguments):
        data = data_of(context, builder, signature.args[0], arguments[0])
        values = [
            builder.load(builder.gep(data, [ir.Constant(ir.IntType(64), n)]))
            for n in range(count.literal_value)
        ]
        return cgutils.pack_array(builder, values)

    return result_type(array, count), codegen


@intrinsic
def add_to(typingctx, counters, number, count):
    """Add `count` to entry `number` of an array of counters, atomically, and return the previous
    value of the entry.
    """

    def codegen(context, builder, signature, arguments):
        data = data_of(context, builder, signature.args[0], arguments[0])
        return builder.atomic_rmw(
            "add", builder.gep(data, [arguments[1]]), arguments[2], "monotonic"
        )

    return types.int64(counters, types.int64, types.int64), codegen


@intrinsic
def stack_rows(typingctx, count, x):
    """Return an array of `count` rows of `BLOCK` values on the stack, in the precision of x, for
    intermediate values.

    `count` is a literal.
    """
    if not isinstance(count, types.IntegerLiteral):
        return None
    rows = count.literal_value
    result_type = types.Array(x, 2, "C")

    def codegen(context, builder, signature, arguments):
        real = context.get_value_type(x)
        index = context.get_value_type(types.intp)
        memory = cgutils.alloca_once(builder, ir.ArrayType(real, rows * BLOCK))
        memory.align = CACHE_LINE
        data = builder.bitcast(memory, real.as_pointer())
        return array_over(
            context,
            builder,
            result_type,
            data,
            [ir.Constant(index, rows), ir.Constant(index, BLOCK)],
        )

    return result_type(count, x), codegen
