"""Vector arithmetic within the first-level cache, which measures the gain from threads where only the processor limits it."""

import numpy as np

from ..engine.block_arrays import block_rows
from ..engine.compile import widest_vectors
from ..engine.passes import Pass

ROWS = 2
"""Rows of the buffer: arguments and values."""


@Pass
def arithmetic(thread, chunk, chunks, rounds, buffers):
    """Evaluate a polynomial on a block of single-precision numbers, `rounds` times, shared among the chunks of `buffers`."""
    widest_vectors()
    rows = block_rows(buffers[thread])
    for _ in range(chunk * rounds // chunks, (chunk + 1) * rounds // chunks):
        for k in range(rows.shape[1]):
            x = rows[0, k]
            # Two chains depend on each other, so that the compiler cannot remove a part of them.
            even = x * x
            odd = even * x
            for _ in range(8):
                even = odd * x + even
                odd = even * x - odd
            rows[1, k] = np.float32(0.5) * (even + odd)
