"""The paper's rotation of a horizon, Eqs. (22)-(23): the mean rotation of the two convected base
vectors.

It is not objective: a stretch along axes other than those of the grid causes a spurious rotation,
and beyond a right angle the arcsine folds.
"""

import numpy as np

from ..engine.passes import Pass, share_of


@Pass
def convected_rotations(chunk, gradients, records):
    """Write cos and sin of every point's rotation, as defined in the paper, to the first two
    columns of `records`, a row for each point.

    The rotation is the mean of those of the two base vectors by the deformation gradient;
    `gradients`, shape (n, 4), holds F11, F21, F12, F22. A thread works on the points of one
    `chunk`.
    """
    for i in share_of(gradients.shape[0], chunk):
        F11 = gradients[i, 0]
        F21 = gradients[i, 1]
        F12 = gradients[i, 2]
        F22 = gradients[i, 3]
        angle = 0.5 * (
            np.arcsin(F21 / np.sqrt(F11 * F11 + F21 * F21))
            - np.arcsin(F12 / np.sqrt(F12 * F12 + F22 * F22))
        )
        records[i, 0] = np.cos(angle)
        records[i, 1] = np.sin(angle)
