"""Passes for quantities of the undeformed body: shape tensors, reference vectors of pair forces,
volumes that bonds represent.

The reference vector of a pair is the vector that turns the stress of the pair into its force. These
passes run once for a body without damage, and again for the points and pairs around every bond that
breaks.
"""

import numpy as np

from ..engine.block_arrays import BLOCK, put_column
from ..engine.passes import Pass, share_of
from .algebra import ByDimension, algebra_of

plane = algebra_of(2)

LEAST_SHAPE_QUALITY = 1e-3
"""Shape quality, det K/(tr K/d)^d of the shape tensor K in d dimensions, below which the bonds of a
point count as not spanning the plane or space. The quality is 1 for a full horizon, and about 0.6
at an intact corner: 0.59 in the plane, 0.61 in three dimensions at 1.75 spacings and 0.58 at 3.015.
Chosen far below these, and above 0, the value of a single row or layer.
"""

SCALAR_CORRECTION = 1
TENSOR_CORRECTION = 2
CORRECTIONS = {"none": 0, "scalar": SCALAR_CORRECTION, "tensor": TENSOR_CORRECTION}
"""Codes of the corrections of the bond force at incomplete horizons, by the names that settings
use.
"""

LEAST_TILT_STIFFNESS = 0.01
"""Regularization epsilon of `bond_shares`, which tilts the shares of a point's bonds, by factors
exp(-a . x/horizon), until the mean bond is epsilon times the tilt a. With this value the mean bond
of a point at an edge shrinks from 0.42 to some 0.08 horizons. Chosen: with a smaller epsilon the
mean bond shrinks further, but the tilt, at most 1/epsilon, grows, and a few bonds carry all of a
point's volume.
"""

MOST_NEWTON_STEPS = round(1 / LEAST_TILT_STIFFNESS)
"""Greatest number of Newton steps, each of at most 1, for the tilt a in `bond_shares`. The tilt is
at most 1/`LEAST_TILT_STIFFNESS`, since epsilon times the tilt is the mean bond, which is at most 1
horizon long.
"""


@ByDimension
def shape_rows(algebra):
    """Build the pass that computes the inverse shape tensors of given points, paper (21)."""

    @Pass
    def shape_rows(
        chunk, rows, pointers, vectors, starts, weighted_bonds, inverse_shape, supported
    ):
        """Compute the inverse shape tensors of the points `rows`; zero, with ``supported`` 0, where
        the bonds do not span all dimensions.

        `pointers` bound the undeformed `vectors` of the bonds of each of these points.
        `weighted_bonds` is w x V_j (weight, undeformed vector, volume of the second end), zero
        where the bond is broken; the bonds of each of `rows` begin at its place in `starts`. The
        shape tensor is summed from these values as rounded, so that also in single precision F of a
        homogeneous deformation is exact to some 1e-9.
        """
        for r in share_of(rows.shape[0], chunk):
            i = rows[r]
            K = algebra.no_symmetric()
            for b in range(pointers[r], pointers[r + 1]):
                x = algebra.vector_at(vectors, b)
                weighted = algebra.vector_at(weighted_bonds, b - pointers[r] + starts[r])
                K = algebra.add_symmetric_product(K, 1.0, weighted, x)
            if algebra.shape_quality(K) > LEAST_SHAPE_QUALITY:
                supported[i] = 1
                algebra.put(inverse_shape, i, algebra.inverse_symmetric(K))
            else:
                supported[i] = 0
                inverse_shape[i, :] = 0.0

    return shape_rows


@Pass
def pair_rows(
    chunk,
    places,
    first,
    second,
    vectors,
    strength,
    inverse_shape,
    supported,
    correction,
    kappa,
    horizon,
    geometry,
):
    """Compute the reference vectors of the pair forces of given pairs, and write them into their
    `places` in the blocks of `geometry`.

    The rows of a block are n1/l, n2/l, normal_factor l, tilt_factor l and, if the block has a fifth
    row, l/horizon; n and l are the direction and the length of the undeformed bond, and m is the
    direction across it. The force on the first point of a pair is R T zeta: R is the mean rotation
    of the points, T the stress of theory (11), and zeta = normal_factor n + tilt_factor m the
    reference vector (theory (21)). With the tensor correction zeta = unit (K_i^-1 + K_j^-1)/2 n,
    where K_i is the shape tensor of point i; with the scalar correction, paper (24)-(25), zeta =
    unit/kappa (fac_i + fac_j)/2 n, where kappa is the shape tensor's eigenvalue for a full horizon
    and fac_i = 2 kappa/tr K_i; without a correction zeta = unit/kappa n. The unit is 2 l times the
    `strength` w V_i V_j (w the weight of the bond), zero where the bond is broken.
    """
    for r in share_of(places.shape[0], chunk):
        i = first[r]
        j = second[r]
        x = plane.vector_at(vectors, r)
        square = plane.dot(x, x)
        length = np.sqrt(square)
        unit = 2.0 * length * strength[r]
        normal_factor = 0.0
        tilt_factor = 0.0
        if supported[i] == 1 and supported[j] == 1:
            A = plane.symmetric_at(inverse_shape, i)
            B = plane.symmetric_at(inverse_shape, j)
            if correction == TENSOR_CORRECTION:
                z = plane.times(
                    0.5, plane.symmetric_times_vector((A[0] + B[0], A[1] + B[1], A[2] + B[2]), x)
                )
                normal_factor = unit * plane.dot(z, x) / square
                tilt_factor = unit * (z[1] * x[0] - z[0] * x[1]) / square
            elif correction == SCALAR_CORRECTION:
                # fac = 2 kappa / tr K.
                K = plane.inverse_symmetric(A)
                L = plane.inverse_symmetric(B)
                normal_factor = unit * (1.0 / (K[0] + K[2]) + 1.0 / (L[0] + L[2]))
            else:
                normal_factor = unit / kappa
        block = places[r] // BLOCK
        lane = places[r] - block * BLOCK
        put_column(
            geometry[block],
            lane,
            (x[0] / square, x[1] / square, normal_factor * length, tilt_factor * length),
        )
        if geometry.shape[1] > 4:
            geometry[block, 4, lane] = length / horizon


@ByDimension
def bond_shares(algebra):
    """Build the pass that divides the volume of each given point among the bonds of the point."""

    @Pass
    def bond_shares(chunk, rows, pointers, vectors, volumes, strength, horizon, starts, shares):
        """Divide the volume V_i of each point of `rows` among its bonds; the shares sum to V_i, or
        to zero where no bond is left.

        A bond's energy is that of the material about its middle. Shares proportional to w V_j,
        weight times volume of the second end, would place the energy of a point at an edge half a
        mean bond inside the body: an error of first order in the horizon, which makes holes too
        compliant. Shares w V_j exp(-a . x/horizon), with the bond vector x, have a zero mean bond,
        where the vector a minimizes the convex function log sum w V_j exp(-a . x/horizon): these
        are the weights of greatest entropy with zero mean (Arroyo, Ortiz, Int. J. Numer. Meth.
        Engng 65 (2006) 2167). Since no positive weights have a zero mean at an edge, epsilon/2
        |a|^2 is added to the function: this keeps a finite, and the mean bond vector becomes
        epsilon a horizon. `pointers` bound the undeformed `vectors` of the bonds of each of `rows`,
        and their `strength` w V_i V_j, zero for a bond that carries nothing. The shares of each of
        `rows` are written from its place in `starts` on.
        """
        for r in share_of(rows.shape[0], chunk):
            i = rows[r]
            zero = algebra.no_vector()
            tilt = zero
            for _ in range(MOST_NEWTON_STEPS):
                total = 0.0
                mean = zero
                second = algebra.no_symmetric()
                for b in range(pointers[r], pointers[r + 1]):
                    x = algebra.times(1.0 / horizon, algebra.vector_at(vectors, b))
                    weight = strength[b] * np.exp(-algebra.dot(tilt, x))
                    shares[b - pointers[r] + starts[r]] = weight
                    total += weight
                    mean = algebra.plus(mean, algebra.times(weight, x))
                    second = algebra.add_symmetric_product(second, weight, x, x)
                if total == 0.0:
                    break
                mean = algebra.times(1.0 / total, mean)
                slope = algebra.minus(algebra.times(LEAST_TILT_STIFFNESS, tilt), mean)
                curvature = algebra.add_symmetric_product(
                    algebra.times_factor(1.0 / total, second), -1.0, mean, mean
                )
                curvature = algebra.plus_isotropic(curvature, LEAST_TILT_STIFFNESS)
                step = algebra.symmetric_times_vector(algebra.inverse_symmetric(curvature), slope)
                size = np.sqrt(algebra.dot(step, step))
                if size < 1e-12:
                    break
                # Steps of at most 1 in a, within which Newton's method on a log-sum of exponentials
                # converges.
                tilt = algebra.minus(tilt, algebra.times(min(1.0, 1.0 / size), step))
            unit = volumes[i] / total if total > 0.0 else 0.0
            for b in range(pointers[r], pointers[r + 1]):
                shares[b - pointers[r] + starts[r]] *= unit

    return bond_shares
