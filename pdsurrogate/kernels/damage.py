"""The search for bonds that are stretched beyond what they bear; compiled only where a scene has a critical stretch."""

import numpy as np
from numba import prange

from .blocks import BLOCK, block_rows
from .compile import parallel_kernel, widest_vectors
from .records import subtract_positions


@parallel_kernel
def find_overstretched(positions, first, second, limits, buffers, found, counts):
    """Pairs whose deformed length squared exceeds its limit (30).

    Parameters
    ----------
    positions : (n, 2) doubles.
    first, second : (n_blocks * BLOCK,) the pairs, padded.
    limits : (n_blocks, BLOCK) square of the critical length; infinite where the bond is broken already, and in the padding.
    buffers : (n_chunks, 2, BLOCK) doubles.
    found : (n_blocks * BLOCK,) out: numbers of the pairs, each chunk's from the first place of its own.
    counts : (n_chunks,) out: how many each chunk found.
    """
    n_blocks = limits.shape[0]
    chunks = counts.shape[0]
    for chunk in prange(chunks):
        widest_vectors()
        bond = block_rows(buffers[chunk])
        begin = chunk * n_blocks // chunks
        place = begin * BLOCK
        for block in range(begin, (chunk + 1) * n_blocks // chunks):
            limit = limits[block]
            for k in range(0, BLOCK, 4):
                subtract_positions(positions, first, second, block * BLOCK + k, bond, k)
            beyond = 0.0
            for k in range(BLOCK):
                square = bond[0, k] * bond[0, k] + bond[1, k] * bond[1, k]
                beyond += 1.0 if square > limit[k] else 0.0
            if beyond > 0.0:
                for k in range(BLOCK):
                    if bond[0, k] * bond[0, k] + bond[1, k] * bond[1, k] > limit[k]:
                        found[place] = np.uint32(block * BLOCK + k)
                        place += 1
        counts[chunk] = place - begin * BLOCK
