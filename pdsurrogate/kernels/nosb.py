"""Forces of non-ordinary state-based peridynamics (correspondence), paper Eqs. (2) and (19)."""

from ..engine.block_arrays import BLOCK, block_rows
from ..engine.compile import call_block, widest_vectors
from ..engine.passes import Pass, share_of
from .algebra import ByDimension


@ByDimension
def weighted_stresses(algebra):
    """Build the pass that computes P K^-1 of every point, the first Piola-Kirchhoff stress times
    the inverse shape tensor.
    """

    @Pass
    def weighted_stresses(
        chunk,
        gradients,
        volume_ratios,
        inverse_shape,
        unit,
        response,
        parameters,
        scratch,
        stresses,
    ):
        """Compute P K^-1 of every point, by columns: first Piola-Kirchhoff stress, times `unit`,
        times inverse shape tensor.
        """
        widest_vectors()
        n = gradients.shape[0]
        states = block_rows(scratch[chunk.thread, 0:3])
        result = block_rows(scratch[chunk.thread, 3:8])
        for block in share_of((n + BLOCK - 1) // BLOCK, chunk):
            at = block * BLOCK
            size = min(BLOCK, n - at)
            F = algebra.matrix_rows(gradients[at : at + size])
            J3 = volume_ratios[at : at + size]
            Z = algebra.symmetric_rows(inverse_shape[at : at + size])
            stress = algebra.matrix_rows(stresses[at : at + size])
            for k in range(size):
                state = algebra.response_state(algebra.matrix_at(F, k), J3[k])
                states[0, k] = state[0]
                states[1, k] = state[1]
                states[2, k] = state[2]
            call_block(response, states, parameters, result)
            for k in range(size):
                state = states[0, k], states[1, k], states[2, k]
                found = result[0, k], result[1, k], result[2, k]
                P = algebra.first_piola(algebra.matrix_at(F, k), state, found, unit)
                algebra.put(stress, k, algebra.times_symmetric(P, algebra.symmetric_at(Z, k)))

    return weighted_stresses


@ByDimension
def nosb_forces(algebra):
    """Build the pass that computes the forces on points from P K^-1, stress times inverse shape
    tensor, of every point.
    """

    @Pass
    def nosb_forces(
        chunk, stresses, pointers, neighbors, starts, weighted_bonds, volumes, pulls, out
    ):
        """Compute the force on every point i, the sum over j of (P_i K_i^-1 + P_j K_j^-1) w x V_i
        V_j and its row of `pulls`, which may have none; return how many are not finite.

        P is the first Piola-Kirchhoff stress, K the shape tensor, V the volume of a point, w the
        weight and x the undeformed vector of a bond. `stresses` holds P K^-1 of every point,
        `weighted_bonds` w x V_j of bonds, those of point i from ``starts[i]`` on.
        """
        without_force = 0
        for i in share_of(out.shape[0], chunk):
            bonds = pointers[i], pointers[i + 1], starts[i]
            algebra.sum_matrix_products(stresses, neighbors, weighted_bonds, bonds, i, out)
            force = algebra.times(volumes[i], algebra.vector_at(out, i))
            if pulls.shape[0]:
                force = algebra.plus(force, algebra.vector_at(pulls, i))
            algebra.put(out, i, force)
            without_force += algebra.not_finite(force)
        return without_force

    return nosb_forces
