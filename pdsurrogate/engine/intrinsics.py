"""Instructions that numba lacks: bit patterns of reals, a quotient without infinities, tuples of array entries, a shared counter."""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


def data_of(context, builder, kind, value):
    """Return the address of an array's data, the items of a tuple as a list, or another value itself."""
    if isinstance(kind, types.BaseTuple):
        return [data_of(context, builder, item, builder.extract_value(value, n)) for n, item in enumerate(kind.types)]
    return context.make_array(kind)(context, builder, value).data if isinstance(kind, types.Array) else value


INT_OF = {types.float32: types.int32, types.float64: types.int64}
REAL_OF = {types.int32: types.float32, types.int64: types.float64}


@intrinsic
def bits_of(typingctx, value):
    """Return the bit pattern of a real as an integer of the same width."""

    def codegen(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

    return INT_OF[value](value), codegen


@intrinsic
def real_of(typingctx, bits):
    """Return the real with the given bit pattern."""

    def codegen(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

    return REAL_OF[bits](bits), codegen


@intrinsic
def finite_quotient(typingctx, x, y):
    """Return x/y, compiled on the promise that nothing is infinite, so that the processor's estimate of 1/y may be used and refined."""

    def codegen(context, builder, signature, arguments):
        return builder.fdiv(*arguments, flags=("ninf", "arcp", "contract"))

    return x(x, y), codegen


@intrinsic
def tuple_of(typingctx, array, count):
    """Return the first `count` values of an array, a literal number of them, as a tuple: scalars that a loop need not load again."""
    if not isinstance(count, types.IntegerLiteral):
        return None
    result_type = types.UniTuple(array.dtype, count.literal_value)

    def codegen(context, builder, signature, arguments):
        data = data_of(context, builder, signature.args[0], arguments[0])
        values = [builder.load(builder.gep(data, [ir.Constant(ir.IntType(64), n)])) for n in range(count.literal_value)]
        return cgutils.pack_array(builder, values)

    return result_type(array, count), codegen


@intrinsic
def add_to(typingctx, counters, number, count):
    """Add to one of an array of counters, atomically, and return its previous value."""

    def codegen(context, builder, signature, arguments):
        data = data_of(context, builder, signature.args[0], arguments[0])
        return builder.atomic_rmw("add", builder.gep(data, [arguments[1]]), arguments[2], "monotonic")

    return types.int64(counters, types.int64, types.int64), codegen
