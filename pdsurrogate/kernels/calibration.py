"""Work that needs no memory: what threads gain where nothing but the processor limits them."""

import numpy as np
from numba import prange

from .compile import parallel_kernel


@parallel_kernel
def arithmetic(rounds, out):
    """Independent chains of multiply-adds, one value a chain written at the end; `out` has one place a chunk."""
    for chunk in prange(out.shape[0]):
        a = np.float32(chunk)
        b = a + np.float32(1.0)
        c = b + np.float32(1.0)
        d = c + np.float32(1.0)
        for _ in range(rounds):
            a = a * np.float32(0.999) + np.float32(0.1)
            b = b * np.float32(0.999) + np.float32(0.1)
            c = c * np.float32(0.999) + np.float32(0.1)
            d = d * np.float32(0.999) + np.float32(0.1)
        out[chunk] = a + b + c + d
