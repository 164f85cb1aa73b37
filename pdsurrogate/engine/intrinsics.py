"""Instructions for compiled code that numba lacks: bit patterns of reals, and a quotient without infinities.

`data_of` reads the arguments of intrinsics: arrays, tuples and scalars.
"""

from numba import types
from numba.extending import intrinsic


def data_of(context, builder, kind, value):
    """Return the LLVM form in which an intrinsic uses an argument of numba type `kind`.

    An array becomes the address of its data, a tuple the list of its items in this form, and any other value stays as it is.
    """
    if isinstance(kind, types.BaseTuple):
        return [data_of(context, builder, item, builder.extract_value(value, n)) for n, item in enumerate(kind.types)]
    return context.make_array(kind)(context, builder, value).data if isinstance(kind, types.Array) else value


INT_OF = {types.float32: types.int32, types.float64: types.int64}
REAL_OF = {types.int32: types.float32, types.int64: types.float64}


@intrinsic
def bits_of(typingctx, value):
    """Return the bit pattern of a real as an integer with as many bits."""

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
    """Return x/y, compiled on the promise that no operand or result is infinite.

    The compiler may then use the processor's estimate of 1/y and refine it.
    """

    def codegen(context, builder, signature, arguments):
        return builder.fdiv(*arguments, flags=("ninf", "arcp", "contract"))

    return x(x, y), codegen
