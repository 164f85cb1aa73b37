"""The paper's rotation of a horizon, Eqs. (22)-(23): the mean turn of the two convected base vectors.

It is not objective: a stretch along axes off the grid gets a spurious rotation, and past a right angle the arcsine folds.
"""

import numpy as np

from ..engine.passes import Pass, share_of


@Pass
def convected_rotations(chunk, chunks, gradients, records):
    """Write the convected rotation over the one that node records hold.

    Parameters
    ----------
    gradients : (n, 4) F as (11, 21, 12, 22).
    records : (n, 4) out: (cos, sin), the first two of each.
    """
    first, last = share_of(gradients.shape[0], chunk, chunks)
    for i in range(first, last):
        F11, F21, F12, F22 = gradients[i, 0], gradients[i, 1], gradients[i, 2], gradients[i, 3]
        angle = 0.5 * (np.arcsin(F21 / np.sqrt(F11 * F11 + F21 * F21)) - np.arcsin(F12 / np.sqrt(F12 * F12 + F22 * F22)))
        records[i, 0] = np.cos(angle)
        records[i, 1] = np.sin(angle)
