"""Search for bonds stretched beyond their critical stretch; compiled only if a scene gives a
critical stretch.
"""

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows
from ..engine.compile import widest_vectors
from ..engine.passes import Pass, share_of
from .algebra import ByDimension


@ByDimension
def find_overstretched(algebra):
    """Build the pass that finds pairs of points whose squared distance in the deformed body
    exceeds the limit of the pair, paper (30).
    """

    @Pass
    def find_overstretched(chunk, positions, first, second, limits, buffers, found, counts):
        """Find pairs of points whose squared distance in the deformed body exceeds the limit of the
        pair, paper (30); return their number.

        `limits` (n_blocks, BLOCK) holds the squared critical length of every pair, infinite for
        broken and padding pairs. `found` receives the numbers of the overstretched pairs: each
        chunk writes those that it finds to the entries from the number of its first pair on.
        `counts` receives how many each chunk has found.
        """
        widest_vectors()
        bond = block_rows(buffers[chunk.thread])
        share = share_of(limits.shape[0], chunk)
        place = share.start * BLOCK
        for block in share:
            limit = limits[block]
            for k in range(0, BLOCK, 4):
                algebra.subtract_positions(positions, (first, second), block * BLOCK + k, bond, k)
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
        counts[chunk.number] = place - share.start * BLOCK
        return counts[chunk.number]

    return find_overstretched
