"""Positions of images and deformation gradients, the first pass of every force evaluation."""

import numpy as np
from numba import prange

from .compile import kernel, parallel_kernel
from .records import sum_outer_products


@kernel
def place(given, positions, mirror, parity, shift):
    """Take the positions given of the points, and move every image with the point it mirrors: y = shift + parity * y_mirror."""
    n_points = given.shape[0]
    for i in range(n_points):
        positions[i, 0] = given[i, 0]
        positions[i, 1] = given[i, 1]
    for m in range(mirror.shape[0]):
        positions[n_points + m, 0] = shift[m, 0] + parity[m, 0] * positions[mirror[m], 0]
        positions[n_points + m, 1] = shift[m, 1] + parity[m, 1] * positions[mirror[m], 1]


@parallel_kernel
def deformation_gradients(positions, pointers, neighbours, weighted_bonds, inverse_shape, unsupported, gradients):
    """F of every point (20), as records (F11, F21, F12, F22); `unsupported` times I where the bonds do not span the plane.

    Points without a gradient carry no stress: theirs is I, and a change of it zero.
    """
    for i in prange(pointers.shape[0] - 1):
        sum_outer_products(positions, neighbours, weighted_bonds, pointers[i], pointers[i + 1], np.uint64(i), gradients)
        z11 = inverse_shape[i, 0]
        z12 = inverse_shape[i, 1]
        z22 = inverse_shape[i, 2]
        rest = unsupported if z11 == 0.0 else 0.0
        s1 = gradients[i, 0]
        s2 = gradients[i, 1]
        s3 = gradients[i, 2]
        s4 = gradients[i, 3]
        gradients[i, 0] = s1 * z11 + s3 * z12 + rest
        gradients[i, 1] = s2 * z11 + s4 * z12
        gradients[i, 2] = s1 * z12 + s3 * z22
        gradients[i, 3] = s2 * z12 + s4 * z22 + rest


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
