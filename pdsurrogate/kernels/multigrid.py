"""Products with the sparse matrices of a multigrid cycle, for several right-hand sides at once,
each fused with the step that follows.

Matrices are given by the pointers, columns and values of their rows; vectors have a row for every
unknown and a column for every right-hand side. All arrays are in single precision.
"""

from functools import cache
from types import SimpleNamespace

from ..engine.passes import Pass, share_of
from ..engine.vector_loads import sum_weighted_rows


@cache
def passes_of(width: int) -> SimpleNamespace:
    """Return four passes over vectors with rows of `width` reals: `scale`, `relax`, `residual` and
    `add_product`.

    For A x = b, `scale` is the first step of Jacobi's iteration, from x = 0, and `relax` a step
    from any x. `residual` is b - A x, and `add_product` adds A x to a multiple of a vector.
    """
    add_up = sum_weighted_rows(width)

    @Pass
    def scale(chunk, relaxation, right, out):
        """Compute ``out = r b``, the step of Jacobi's iteration from x = 0 for A x = b; r is
        `relaxation` (a factor per row), b `right`.
        """
        for i in share_of(right.shape[0], chunk):
            for c in range(width):
                out[i, c] = relaxation[i] * right[i, c]

    @Pass
    def relax(chunk, pointers, columns, values, relaxation, right, found, out):
        """Compute ``out = x + r (b - A x)``, a step of Jacobi's iteration; x is `found`, r
        `relaxation` and b `right`.
        """
        for i in share_of(right.shape[0], chunk):
            add_up(values, columns, (pointers[i], pointers[i + 1]), found, i, out)
            for c in range(width):
                out[i, c] = found[i, c] + relaxation[i] * (right[i, c] - out[i, c])

    @Pass
    def residual(chunk, pointers, columns, values, right, found, out):
        """Compute the residual ``out = b - A x``; x is `found` and b is `right`."""
        for i in share_of(right.shape[0], chunk):
            add_up(values, columns, (pointers[i], pointers[i + 1]), found, i, out)
            for c in range(width):
                out[i, c] = right[i, c] - out[i, c]

    @Pass
    def add_product(chunk, pointers, columns, values, vectors, kept, product, out):
        """Compute ``out = kept * out + A x`` in place; x is `vectors`, and `product` is working
        memory with the shape of `out`.
        """
        for i in share_of(out.shape[0], chunk):
            add_up(values, columns, (pointers[i], pointers[i + 1]), vectors, i, product)
            for c in range(width):
                out[i, c] = kept * out[i, c] + product[i, c]

    return SimpleNamespace(scale=scale, relax=relax, residual=residual, add_product=add_product)
