"""Assignment of the samples of a body to their nearest points; compiled only if the points of a
scene are relaxed.
"""

import numpy as np

from ..engine.passes import Pass, share_of


@Pass
def sum_nearest(chunk, points, starts, grid, metric, raster, material, masks, buffers, sums):
    """Sum the samples of every cell of a grid at the points nearest to them: number and coordinates
    of the samples of each point.

    All numbers are integers in double precision, below 2^53, so that sums are exact: they depend
    neither on their order nor on the machine.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Coordinates, 0 along x3 in the plane, sorted by the cells in which the points lie.
    starts : ndarray of int, shape (cells + 1,)
        Where the points of each cell begin.
    grid : tuple of int
        Cells along x1, x2 and x3, of which x1 varies fastest, and the side of a cell.
    metric : tuple of float
        Factors of the squares of the three components in a squared distance.
    raster : ndarray, shape (3, samples)
        Places of the samples in a cell.
    material : ndarray of int, shape (cells,)
        Row of each cell in `masks`; -1 for cells all of whose samples are in material, -2 for cells
        without material.
    masks : ndarray of uint8, shape (m, samples)
        Flags of the samples in material.
    buffers : ndarray, shape (threads, 2, samples)
        Working memory.
    sums : ndarray, shape (threads, n, 4)
        Sums of each thread, of 1 and of the three coordinates, to which this pass adds.
    """
    n1, n2, n3, side = grid
    g1, g2, g3 = metric
    half = side / 2
    own = sums[chunk.thread]
    best = buffers[chunk.thread, 0]
    which = buffers[chunk.thread, 1]
    for cell in share_of(material.shape[0], chunk):
        if material[cell] == -2:
            continue
        i1 = cell % n1
        i2 = cell // n1 % n2
        i3 = cell // (n1 * n2)
        o1 = float(i1 * side)
        o2 = float(i2 * side)
        o3 = float(i3 * side)
        reach = 0
        farthest = np.inf
        # Points outside the block of cells are at least `reach` cells away.
        while farthest > g1 * float(reach * side) ** 2 and reach < n1 + n2 + n3:
            reach += 1
            least = np.inf
            for search in range(2):
                for j3 in range(max(i3 - reach, 0), min(i3 + reach + 1, n3)):
                    for j2 in range(max(i2 - reach, 0), min(i2 + reach + 1, n2)):
                        row = (j3 * n2 + j2) * n1
                        for p in range(
                            starts[row + max(i1 - reach, 0)], starts[row + min(i1 + reach + 1, n1)]
                        ):
                            p1 = points[p, 0] - o1
                            p2 = points[p, 1] - o2
                            p3 = points[p, 2] - o3
                            a1 = abs(p1 - half)
                            a2 = abs(p2 - half)
                            a3 = abs(p3 - half) if n3 > 1 else 0.0
                            if search == 0:
                                least = min(
                                    least,
                                    g1 * (a1 + half) ** 2
                                    + g2 * (a2 + half) ** 2
                                    + g3 * (a3 + half) ** 2,
                                )
                            elif (
                                g1 * max(a1 - half, 0.0) ** 2
                                + g2 * max(a2 - half, 0.0) ** 2
                                + g3 * max(a3 - half, 0.0) ** 2
                                <= least
                            ):
                                number = float(p)
                                for s in range(raster.shape[1]):
                                    d1 = raster[0, s] - p1
                                    d2 = raster[1, s] - p2
                                    d3 = raster[2, s] - p3
                                    distance = g1 * d1 * d1 + g2 * d2 * d2 + g3 * d3 * d3
                                    closer = distance < best[s]
                                    best[s] = distance if closer else best[s]
                                    which[s] = number if closer else which[s]
                if search == 0:
                    for s in range(raster.shape[1]):
                        best[s] = np.inf
            farthest = 0.0
            for s in range(raster.shape[1]):
                farthest = max(farthest, best[s])
        for s in range(raster.shape[1]):
            if material[cell] == -1 or masks[material[cell], s]:
                p = int(which[s])
                own[p, 0] += 1.0
                own[p, 1] += o1 + raster[0, s]
                own[p, 2] += o2 + raster[1, s]
                own[p, 3] += o3 + raster[2, s]
