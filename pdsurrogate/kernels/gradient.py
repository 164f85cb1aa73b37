"""Positions of images and deformation gradients, the first pass of every force evaluation."""

import numpy as np
from numba import prange

from .compile import kernel, parallel_kernel
from .records import sum_outer_products


@kernel
def place_images(positions, n_points, mirror, parity, shift):
    """Move every image with the point it mirrors: y = shift + parity * y_mirror."""
    for m in range(mirror.shape[0]):
        positions[n_points + m, 0] = shift[m, 0] + parity[m, 0] * positions[mirror[m], 0]
        positions[n_points + m, 1] = shift[m, 1] + parity[m, 1] * positions[mirror[m], 1]


@parallel_kernel
def deformation_gradients(positions, pointers, neighbours, gradient_weights, gradients):
    """F of every point (20), as records (F11, F21, F12, F22)."""
    for i in prange(pointers.shape[0] - 1):
        sum_outer_products(positions, neighbours, gradient_weights, pointers[i], pointers[i + 1], np.uint64(i), gradients)


@kernel
def reflect_gradients(gradients, n_points, mirror, parity, axis):
    """F of every image from that of the point it mirrors: F - I = parity * (F_mirror - I) S, S the reflection along `axis`.

    On a body that is symmetric about the plane this equals (20) over the image's own horizon, at none of its cost.
    """
    for m in range(mirror.shape[0]):
        p1 = parity[m, 0]
        p2 = parity[m, 1]
        s1 = -1.0 if axis[m] == 0 else 1.0
        s2 = -s1
        source = mirror[m]
        gradients[n_points + m, 0] = 1.0 + p1 * (gradients[source, 0] - 1.0) * s1
        gradients[n_points + m, 1] = p2 * gradients[source, 1] * s1
        gradients[n_points + m, 2] = p1 * gradients[source, 2] * s2
        gradients[n_points + m, 3] = 1.0 + p2 * (gradients[source, 3] - 1.0) * s2


@kernel
def hold_unsupported(gradients, unsupported):
    """F = I for points whose bonds do not span the plane: they carry no stress."""
    for r in range(unsupported.shape[0]):
        gradients[unsupported[r], 0] = 1.0
        gradients[unsupported[r], 1] = 0.0
        gradients[unsupported[r], 2] = 0.0
        gradients[unsupported[r], 3] = 1.0
