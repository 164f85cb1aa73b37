"""Deformation gradients of the points, the first pass of every force evaluation."""

from ..engine.passes import Pass, share_of
from .by_dimension import ByDimension


@ByDimension
def deformation_gradients(algebra):
    """Build the pass that computes the deformation gradient of every point (20)."""

    @Pass
    def deformation_gradients(chunk, chunks, positions, pointers, neighbours, weighted_bonds, inverse_shape, unsupported, gradients):
        """Compute F of every point by columns; where the bonds do not span the space it is `unsupported` times I.

        Points without a gradient carry no stress: their F is I (`unsupported` = 1) and a change of it zero (`unsupported` = 0).
        """
        start, stop = share_of(pointers.shape[0] - 1, chunk, chunks)
        for i in range(start, stop):
            algebra.sum_outer_products(positions, neighbours, weighted_bonds, (pointers[i], pointers[i + 1]), i, gradients)
            Z = algebra.symmetric_at(inverse_shape, i)
            F = algebra.times_symmetric(algebra.matrix_at(gradients, i), Z)
            algebra.put(gradients, i, algebra.plus_diagonal(F, unsupported if Z[0] == 0.0 else 0.0))

    return deformation_gradients
