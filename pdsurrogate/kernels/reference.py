"""Kernels of the reference state: shape tensors, the reference vectors of the pair forces, and the shares of the bonds in an energy.

They run once for a body without damage, and again for the rows and pairs around every bond that breaks.
"""

import numpy as np
from numba import prange

from .blocks import BLOCK
from .compile import kernel, parallel_kernel

LEAST_SHAPE_QUALITY = 1e-3
"""A horizon whose 4 det K / (tr K)^2 falls below this does not span the plane.  1 for a full horizon, 0.59 at an intact corner."""

NO_CORRECTION, SCALAR_CORRECTION, TENSOR_CORRECTION = 0, 1, 2
CORRECTIONS = {"none": NO_CORRECTION, "scalar": SCALAR_CORRECTION, "tensor": TENSOR_CORRECTION}

LEAST_TILT_STIFFNESS = 0.01
"""Epsilon of `bond_shares`: at an edge some 0.08 horizons are left of a mean bond of 0.42."""

MOST_NEWTON_STEPS = 100


@parallel_kernel
def shape_rows(rows, pointers, neighbours, points, weighted_bonds, inverse_shape, supported):
    """Shape tensors (21) of the given points.

    Parameters
    ----------
    rows : points to compute.
    weighted_bonds : (n_bonds, 2) w x V_j of every directed bond, zero where broken.  K is summed with them as they are rounded, so
        that in single precision, too, F of a homogeneous deformation is that deformation to some 1e-9.
    inverse_shape : (n, 3) out: K^-1 as (11, 12, 22); zero for points without support.
    supported : (n,) out: 1 where the bonds span the plane.
    """
    for r in prange(rows.shape[0]):
        i = rows[r]
        K11 = 0.0
        K12 = 0.0
        K22 = 0.0
        for b in range(pointers[i], pointers[i + 1]):
            j = neighbours[b]
            x1 = points[j, 0] - points[i, 0]
            x2 = points[j, 1] - points[i, 1]
            K11 += weighted_bonds[b, 0] * x1
            K12 += 0.5 * (weighted_bonds[b, 0] * x2 + weighted_bonds[b, 1] * x1)
            K22 += weighted_bonds[b, 1] * x2
        determinant = K11 * K22 - K12 * K12
        trace = K11 + K22
        if trace > 0.0 and 4.0 * determinant > LEAST_SHAPE_QUALITY * trace * trace:
            supported[i] = 1
            inverse_shape[i, 0] = K22 / determinant
            inverse_shape[i, 1] = -K12 / determinant
            inverse_shape[i, 2] = K11 / determinant
        else:
            supported[i] = 0
            inverse_shape[i, 0] = 0.0
            inverse_shape[i, 1] = 0.0
            inverse_shape[i, 2] = 0.0


@kernel
def reflect_shapes(n_points, mirror, inverse_shape, supported):
    """Shape tensors of the images, from the points they mirror: a reflection changes the sign of K12."""
    for m in range(mirror.shape[0]):
        inverse_shape[n_points + m, 0] = inverse_shape[mirror[m], 0]
        inverse_shape[n_points + m, 1] = -inverse_shape[mirror[m], 1]
        inverse_shape[n_points + m, 2] = inverse_shape[mirror[m], 2]
        supported[n_points + m] = supported[mirror[m]]


@parallel_kernel
def pair_rows(pairs, first, second, points, strength, inverse_shape, supported, correction, kappa, horizon, geometry):
    """Reference vectors of the pair forces, in blocks.

    The force on the first point of a pair is R T zeta, T the dimensionless traction of [3] and zeta = alpha n + beta m [5]:
    with the tensor correction zeta = strength (K_i^-1 + K_j^-1)/2 n, with the scalar one (24)-(25) strength/kappa (fac_i + fac_j)/2 n.

    Parameters
    ----------
    pairs : pairs to compute.
    strength : (n_pairs,) 2 w l V_i V_j, zero where broken.
    geometry : (n_blocks, 5, BLOCK) out: n1/l, n2/l, alpha l, beta l, l/horizon.
    """
    for r in prange(pairs.shape[0]):
        b = pairs[r]
        i = first[b]
        j = second[b]
        x1 = points[j, 0] - points[i, 0]
        x2 = points[j, 1] - points[i, 1]
        square = x1 * x1 + x2 * x2
        length = np.sqrt(square)
        alpha = 0.0
        beta = 0.0
        if supported[i] == 1 and supported[j] == 1:
            a11 = inverse_shape[i, 0]
            a12 = inverse_shape[i, 1]
            a22 = inverse_shape[i, 2]
            b11 = inverse_shape[j, 0]
            b12 = inverse_shape[j, 1]
            b22 = inverse_shape[j, 2]
            if correction == TENSOR_CORRECTION:
                z1 = 0.5 * ((a11 + b11) * x1 + (a12 + b12) * x2)
                z2 = 0.5 * ((a12 + b12) * x1 + (a22 + b22) * x2)
                alpha = strength[b] * (z1 * x1 + z2 * x2) / square
                beta = strength[b] * (z2 * x1 - z1 * x2) / square
            elif correction == SCALAR_CORRECTION:
                # fac = 2 kappa / tr K, and tr K = tr K^-1 / det K^-1.
                trace_i = (a11 + a22) / (a11 * a22 - a12 * a12)
                trace_j = (b11 + b22) / (b11 * b22 - b12 * b12)
                alpha = strength[b] * (1.0 / trace_i + 1.0 / trace_j)
            else:
                alpha = strength[b] / kappa
        block = b // BLOCK
        lane = b - block * BLOCK
        geometry[block, 0, lane] = x1 / square
        geometry[block, 1, lane] = x2 / square
        geometry[block, 2, lane] = alpha * length
        geometry[block, 3, lane] = beta * length
        geometry[block, 4, lane] = length / horizon


@parallel_kernel
def bond_shares(rows, pointers, neighbours, pair_of, points, volumes, strength, horizon, shares):
    """The volume of each of the given points, divided among its bonds.

    A bond's energy is that of the material about its middle.  Shares in proportion to w V_j alone put the energy of a point at an edge half
    a mean bond inside, where it is another: an error of first order in the horizon that lets holes yield.  Shares w V_j exp(-a . x/horizon)
    have their mean bond at zero, the vector a being the minimum of the convex log sum w V_j exp(-a . x/horizon): the weights of greatest
    entropy with that mean (Arroyo, Ortiz, Int. J. Numer. Meth. Engng 65 (2006) 2167).  Where no positive weights have it, as at an edge,
    epsilon/2 |a|^2 beside the logarithm keeps a finite.

    Parameters
    ----------
    rows : points to compute.
    strength : (n_pairs,) w V_i V_j, zero where a bond carries nothing.
    shares : (n_bonds,) out, of every directed bond of these points; they sum to V_i, or to nothing where no bond is left.
    """
    for r in prange(rows.shape[0]):
        i = rows[r]
        a1 = 0.0
        a2 = 0.0
        for _ in range(MOST_NEWTON_STEPS):
            m0 = 0.0
            m1 = 0.0
            m2 = 0.0
            m11 = 0.0
            m12 = 0.0
            m22 = 0.0
            for b in range(pointers[i], pointers[i + 1]):
                j = neighbours[b]
                x1 = (points[j, 0] - points[i, 0]) / horizon
                x2 = (points[j, 1] - points[i, 1]) / horizon
                weight = strength[pair_of[b]] * np.exp(-a1 * x1 - a2 * x2)
                shares[b] = weight
                m0 += weight
                m1 += weight * x1
                m2 += weight * x2
                m11 += weight * x1 * x1
                m12 += weight * x1 * x2
                m22 += weight * x2 * x2
            if m0 == 0.0:
                break
            m1 /= m0
            m2 /= m0
            h11 = m11 / m0 - m1 * m1 + LEAST_TILT_STIFFNESS
            h12 = m12 / m0 - m1 * m2
            h22 = m22 / m0 - m2 * m2 + LEAST_TILT_STIFFNESS
            g1 = LEAST_TILT_STIFFNESS * a1 - m1
            g2 = LEAST_TILT_STIFFNESS * a2 - m2
            determinant = h11 * h22 - h12 * h12
            s1 = (h22 * g1 - h12 * g2) / determinant
            s2 = (h11 * g2 - h12 * g1) / determinant
            size = np.sqrt(s1 * s1 + s2 * s2)
            if size < 1e-12:
                break
            # Steps of at most one horizon's worth, within which Newton's method on a log-sum of exponentials can be trusted.
            shrink = min(1.0, 1.0 / size)
            a1 -= shrink * s1
            a2 -= shrink * s2
        unit = volumes[i] / m0 if m0 > 0.0 else 0.0
        for b in range(pointers[i], pointers[i + 1]):
            shares[b] *= unit
