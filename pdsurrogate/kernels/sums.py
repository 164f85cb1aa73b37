"""Passes that sum pair forces, and moments S (derivatives of the energy by deformation gradients),
to forces on points; sparse products.

The order of each sum does not depend on the number of threads.
"""

from functools import cache

from ..engine.block_arrays import BLOCK, put_column
from ..engine.compile import inlined
from ..engine.passes import Pass, share_of
from ..engine.vector_loads import sum_weighted_rows
from .algebra import ByDimension
from .elementary import like


@ByDimension
def sum_pair_forces(algebra):
    """Build the pass that sums the forces of the pairs to forces on points."""

    @Pass
    def sum_pair_forces(chunk, forces, pair_pointers, incidence_pointers, incidence, unit, out):
        """Write the force on every point, times `unit` (the shear modulus), summed in double
        precision; return how many are not finite.

        The force of a pair acts on its first point, and the opposite force on the second.
        `pair_pointers` bound the pairs that have the point as first point, `incidence` lists the
        pairs that have it as second point. The pass sums directed bonds, too, where `incidence`
        lists the reverse bonds.
        """
        without_force = 0
        for i in share_of(out.shape[0], chunk):
            own = pair_pointers[i], pair_pointers[i + 1]
            others = incidence_pointers[i], incidence_pointers[i + 1]
            algebra.sum_signed_records(forces, own, incidence, others, unit, i, out)
            without_force += algebra.not_finite(algebra.vector_at(out, i))
        return without_force

    return sum_pair_forces


@inlined
def visits_of(walk, chunk):
    """Return the range of the visits of a chunk to blocks of pairs, and clear the sums of its
    slabs; a `walk` is that of `pdsurrogate.forces.walks`.
    """
    slabs = walk[2]
    share = share_of(slabs.shape[0] - 1, chunk)
    walk[4][slabs[share.start, 1] : slabs[share.stop, 1]] = 0.0
    return range(slabs[share.start, 0], slabs[share.stop, 0])


@inlined
def rest_others(states, lanes, state):
    """Give the pairs of a block that belong to another visit the undeformed `state`, with which
    they do not count as outside of a domain.
    """
    for k in range(lanes[0]):
        put_column(states, k, state)
    for k in range(lanes[1], BLOCK):
        put_column(states, k, state)


@inlined
def counted_at(reference, row, lanes, k):
    """Return the volume of pair k that counts in a visit, in a row of the geometry; zero if the
    pair belongs to another visit.
    """
    volume = reference[row, k]
    return volume if (lanes[0] <= k) & (k < lanes[1]) else like(volume, 0.0)


@ByDimension
def sum_at_points(algebra):
    """Build the pass that sums the moments and forces of the pairs of every point and ghost, times
    `unit`, from the sums of a walk: those of row ``rows[b]`` for b between two `pointers`.
    """

    @Pass
    def sum_at_points(chunk, sums, pointers, rows, unit, moments, forces):
        for i in share_of(pointers.shape[0] - 1, chunk):
            entries = pointers[i], pointers[i + 1]
            algebra.sum_at_point(sums, rows, entries, unit, i, moments, forces)

    return sum_at_points


@ByDimension
def weigh_moments(algebra):
    """Build the pass that multiplies the moment S of every point by K^-1/V in place, K the shape
    tensor and V the volume of the point.
    """

    @Pass
    def weigh_moments(chunk, moments, inverse_shape, volumes):
        for i in share_of(volumes.shape[0], chunk):
            Z = algebra.times_factor(1.0 / volumes[i], algebra.symmetric_at(inverse_shape, i))
            algebra.put(moments, i, algebra.times_symmetric(algebra.matrix_at(moments, i), Z))

    return weigh_moments


@ByDimension
def add_node_forces(algebra):
    """Build the pass that adds to the forces on points the forces that follow from the weighted
    moments S K^-1/V of the points.
    """

    @Pass
    def add_node_forces(
        chunk,
        stresses,
        pointers,
        neighbors,
        starts,
        weighted_bonds,
        volumes,
        first_point,
        node_parts,
        out,
    ):
        """Add the sum over j of (S_i K_i^-1/V_i + S_j K_j^-1/V_j) w x V_i V_j to every force;
        return how many forces are not finite.

        S is the moment, K the shape tensor and V the volume of a point, w the weight and x the
        undeformed vector of a bond; `weighted_bonds` holds w x V_j, for the bonds of a point
        from its place in `starts` on. `stresses` holds S K^-1/V from `weigh_moments`. The directed
        bonds are those of the points from `first_point` on; `out` is changed at these points only.
        `node_parts` is working memory with the shape of `out`.
        """
        without_force = 0
        for r in share_of(pointers.shape[0] - 1, chunk):
            i = first_point + r
            bonds = pointers[r], pointers[r + 1], starts[r]
            algebra.sum_matrix_products(stresses, neighbors, weighted_bonds, bonds, i, node_parts)
            force = algebra.plus(
                algebra.vector_at(out, i),
                algebra.times(volumes[i], algebra.vector_at(node_parts, i)),
            )
            algebra.put(out, i, force)
            without_force += algebra.not_finite(force)
        return without_force

    return add_node_forces


@cache
def multiply_rows(width: int) -> Pass:
    """Return the pass that multiplies rows of a sparse matrix by an array with rows of `width`
    reals.
    """
    add_up = sum_weighted_rows(width)

    @Pass
    def multiply_rows(chunk, rows, pointers, columns, weights, values, kept, products, out):
        """Write ``out[i] = kept out[i] + (sum of weights * values[columns])`` for each i in `rows`;
        `products` is working memory.

        `kept` is 1 or 0; with 0 values that are not finite are overwritten. `pointers` bound the
        entries of each of `rows`.
        """
        for r in share_of(rows.shape[0], chunk):
            add_up(weights, columns, (pointers[r], pointers[r + 1]), values, r, products)
            for c in range(width):
                out[rows[r], c] = products[r, c] + (out[rows[r], c] if kept == 1 else 0.0)

    return multiply_rows
