"""Bond forces as polynomials in two features, sums of products of Chebyshev polynomials, compiled
for blocks of bonds.

The sum is unrolled over the terms that a polynomial has, so that features, polynomial and traction
are one loop over bonds whose intermediate values stay in registers. Coefficients are arguments; all
polynomials with the same terms share one compiled function.
"""

from functools import cache, reduce

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from ..engine.block_arrays import BLOCK, tuple_of
from ..engine.compile import compile_bond_force, inlined
from .algebra import state_at
from .feature_sets import N_OUTPUTS, FeatureSet

MOST_DEGREE = 24
"""Greatest degree of a polynomial in either feature. Chosen: fits of rubber take degrees of about
twelve, and the kernel is written out term by term, up to 625 for each output.
"""

SCALING = 4
"""Number of constants before the coefficients in the packed weights: centers and inverse half
widths of both features.
"""

_FLAGS = ("contract", "reassoc", "nsz")


def pack(center, half_width, coefficients, at_rest, dtype):
    """Pack a polynomial for `polynomial_block`: return the number of terms for each degree in the
    second feature, and the weights.

    Features are mapped to (x - center)/half_width; ``coefficients[output, j, i]``, shape (2, inner
    + 1, outer + 1), multiplies T_j(x1) T_i(x2). For each i, the coefficients after the last
    non-zero one are left out. `at_rest`, the two outputs in the undeformed state, is appended for
    subtraction.
    """
    outer = coefficients.shape[2] - 1
    used = (coefficients != 0).any(axis=0)
    counts = tuple(
        int(np.flatnonzero(used[:, i])[-1]) + 1 if used[:, i].any() else 0 for i in range(outer + 1)
    )
    # For each i the coefficients of both outputs are stored next to each other.
    terms = [coefficients[:, :count, i].T.ravel() for i, count in enumerate(counts)]
    return counts, np.concatenate([center, 1 / np.asarray(half_width), *terms, at_rest]).astype(
        dtype
    )


@intrinsic
def chebyshev_sums(typingctx, counts, x1, x2, weights):
    """Return both outputs of a polynomial: the sums over i and j < counts[i] of c_ij T_j(x1)
    T_i(x2), T the Chebyshev polynomials.

    `counts` is a literal text, the counts separated by commas; `weights` is the tuple of all
    weights from `pack`, in which the coefficients begin at `SCALING`.
    """
    if not isinstance(counts, types.StringLiteral):
        return None
    terms = [int(count) for count in counts.literal_value.split(",")]

    def codegen(context, builder, signature, arguments):
        _, x1, x2, weights = arguments
        coefficients = iter(cgutils.unpack_tuple(builder, weights)[SCALING:])

        def product(a, b):
            return builder.fmul(a, b, flags=_FLAGS)

        def total(values):
            """Return the sum of LLVM values, added in groups of three, so that the processor
            works on several groups at a time.
            """
            while len(values) > 1:
                values = [
                    reduce(lambda a, b: builder.fadd(a, b, flags=_FLAGS), values[n : n + 3])
                    for n in range(0, len(values), 3)
                ]
            return values[0]

        def chebyshev(x, count):
            """Return the Chebyshev polynomials T_0 … T_count-1 at x, by T_(p+m) = 2 T_p T_m -
            T_(p-m) with p a power of two.

            Each polynomial is thus only a few operations from x.
            """
            values = [ir.Constant(x.type, 1.0), x]
            while len(values) < count:
                p = 1 << (len(values) - 1).bit_length() - 1
                m = len(values) - p
                if m == 1:
                    twice = builder.fadd(values[p], values[p], flags=_FLAGS)
                values.append(builder.fsub(product(twice, values[m]), values[p - m], flags=_FLAGS))
            return values[:count]

        inner = chebyshev(x1, max(terms))
        outer = chebyshev(x2, len(terms))
        sums = [[ir.Constant(x1.type, 0.0)] for _ in range(N_OUTPUTS)]
        for count, factor in zip(terms, outer, strict=True):
            parts = [
                [product(next(coefficients), value) for _ in range(N_OUTPUTS)]
                for value in inner[:count]
            ]
            if parts:
                for output in range(N_OUTPUTS):
                    sums[output].append(product(total([part[output] for part in parts]), factor))
        return cgutils.pack_array(builder, [total(values) for values in sums])

    return types.UniTuple(x1, N_OUTPUTS)(counts, x1, x2, weights), codegen


@cache
def polynomial_block(features: FeatureSet, counts, dtype):
    """Return the function, compiled for blocks of bonds, that evaluates polynomials in two features
    as a bond force.

    `counts` are the numbers of terms from `pack`. The function takes the weights from `pack` as an
    argument, and ignores its sizes.
    """
    shared_of = inlined(features.shared)
    inputs = inlined(features.inputs)
    traction_of = inlined(features.traction)
    terms = ",".join(str(count) for count in counts)
    rest = SCALING + N_OUTPUTS * sum(counts)
    size = rest + N_OUTPUTS

    def polynomial(states, sizes, weights, response, parameters, work, scratch, traction):
        values = tuple_of(weights, size)
        center1 = values[0]
        center2 = values[1]
        scale1 = values[2]
        scale2 = values[3]
        rest0 = values[rest]
        rest1 = values[rest + 1]
        for k in range(BLOCK):
            a, b, U_mm, J, C33 = state_at(states, k)
            shared = shared_of(a, b, J, C33)
            x1, x2 = inputs(shared, a, b, U_mm, J, C33, states[5, k])
            one, two = chebyshev_sums(
                terms, (x1 - center1) * scale1, (x2 - center2) * scale2, values
            )
            traction[0, k], traction[1, k], traction[2, k] = traction_of(
                shared, one - rest0, two - rest1, a, b, U_mm, J, C33
            )

    return compile_bond_force(polynomial, dtype)
