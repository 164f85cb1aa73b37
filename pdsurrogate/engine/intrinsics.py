"""A quotient without infinities for compiled code, and the arguments of intrinsics in the form in
which they are used.

`data_of` reads the arguments of intrinsics: arrays, tuples and scalars.
"""

from numba import types
from numba.extending import intrinsic


def data_of(context, builder, kind, value):
    """Return the LLVM form in which an intrinsic uses an argument of numba type `kind`.

    An array becomes the address of its data, a tuple the list of its items in this form, and any
    other value stays as it is.
    """
    if isinstance(kind, types.BaseTuple):
        return [
            data_of(context, builder, item, builder.extract_value(value, n))
            for n, item in enumerate(kind.types)
        ]
    return (
        context.make_array(kind)(context, builder, value).data
        if isinstance(kind, types.Array)
        else value
    )


def writes(write):
    """Return the intrinsic that generates its code by ``write(builder, *arguments)`` and returns
    nothing to its caller.

    `write` receives arrays as addresses of their data, and tuples as lists.
    """

    @intrinsic
    def called(typingctx, *arguments):
        arguments = (
            arguments[0]
            if len(arguments) == 1 and isinstance(arguments[0], types.BaseTuple)
            else arguments
        )

        def codegen(context, builder, signature, values):
            write(builder, *data_of(context, builder, signature.args[0], values[0]))
            return context.get_dummy_value()

        return types.void(types.StarArgTuple(arguments)), codegen

    return called


@intrinsic
def finite_quotient(typingctx, x, y):
    """Return x/y, compiled on the promise that no operand or result is infinite.

    The compiler may then use the processor's estimate of 1/y and refine it.
    """

    def codegen(context, builder, signature, arguments):
        return builder.fdiv(*arguments, flags=("ninf", "arcp", "contract"))

    return x(x, y), codegen
