"""Products with the sparse matrices of a multigrid cycle, for several right-hand sides at once, each fused with the step that follows.

Matrices are given by the pointers, columns and values of their rows; vectors have a row for every unknown. All arrays are in single
precision.
"""

from functools import cache
from types import SimpleNamespace

from ..engine.passes import Pass, share_of
from ..engine.vector_loads import sum_weighted_rows


@cache
def passes_of(width: int) -> SimpleNamespace:
    """Return the passes `scale`, `relax`, `residual` and `add_product` for vectors with rows of `width` reals."""
    add_up = sum_weighted_rows(width)

    @Pass
    def scale(chunk, chunks, relaxation, right, out):
        """Compute ``r b``, a step of Jacobi's iteration from zero."""
        start, stop = share_of(right.shape[0], chunk, chunks)
        for i in range(start, stop):
            for c in range(width):
                out[i, c] = relaxation[i] * right[i, c]

    @Pass
    def relax(chunk, chunks, pointers, columns, values, relaxation, right, found, out):
        """Compute a step of Jacobi's iteration, ``x + r (b - A x)``."""
        start, stop = share_of(right.shape[0], chunk, chunks)
        for i in range(start, stop):
            add_up(values, columns, (pointers[i], pointers[i + 1]), found, i, out)
            for c in range(width):
                out[i, c] = found[i, c] + relaxation[i] * (right[i, c] - out[i, c])

    @Pass
    def residual(chunk, chunks, pointers, columns, values, right, found, out):
        """Compute ``b - A x``."""
        start, stop = share_of(right.shape[0], chunk, chunks)
        for i in range(start, stop):
            add_up(values, columns, (pointers[i], pointers[i + 1]), found, i, out)
            for c in range(width):
                out[i, c] = right[i, c] - out[i, c]

    @Pass
    def add_product(chunk, chunks, pointers, columns, values, vectors, kept, product, out):
        """Compute ``kept * out + A x`` in place; `product` is working memory like `out`."""
        start, stop = share_of(out.shape[0], chunk, chunks)
        for i in range(start, stop):
            add_up(values, columns, (pointers[i], pointers[i + 1]), vectors, i, product)
            for c in range(width):
                out[i, c] = kept * out[i, c] + product[i, c]

    return SimpleNamespace(scale=scale, relax=relax, residual=residual, add_product=add_product)
