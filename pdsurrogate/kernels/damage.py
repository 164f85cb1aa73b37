"""The search for bonds that are stretched beyond what they bear; compiled only where a scene has a critical stretch."""

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows
from ..engine.compile import widest_vectors
from ..engine.passes import Pass, share_of
from .by_dimension import ByDimension


@ByDimension
def find_overstretched(algebra):
    """Pairs whose deformed length squared exceeds its limit (30)."""

    @Pass
    def find_overstretched(thread, chunk, chunks, positions, first, second, limits, buffers, found, counts):
        """Pairs whose deformed length squared exceeds its limit (30); returns how many.

        Parameters
        ----------
        positions : doubles.
        first, second : (n_blocks * BLOCK,) the pairs, padded.
        limits : (n_blocks, BLOCK) square of the critical length; infinite where the bond is broken already, and in the padding.
        buffers : (n_threads, dimension, BLOCK) doubles.
        found : (n_blocks * BLOCK,) out: numbers of the pairs, each chunk's from the first place of its own.
        counts : (n_chunks,) out: how many each chunk found.
        """
        widest_vectors()
        bond = block_rows(buffers[thread])
        begin, end = share_of(limits.shape[0], chunk, chunks)
        place = begin * BLOCK
        for block in range(begin, end):
            limit = limits[block]
            for k in range(0, BLOCK, 4):
                algebra.subtract_positions(positions, first, second, block * BLOCK + k, bond, k)
            beyond = 0.0
            for k in range(BLOCK):
                vector = algebra.column_at(bond, k)
                beyond += 1.0 if algebra.dot(vector, vector) > limit[k] else 0.0
            if beyond > 0.0:
                for k in range(BLOCK):
                    vector = algebra.column_at(bond, k)
                    if algebra.dot(vector, vector) > limit[k]:
                        found[place] = np.uint32(block * BLOCK + k)
                        place += 1
        counts[chunk] = place - begin * BLOCK
        return counts[chunk]

    return find_overstretched
