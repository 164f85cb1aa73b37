"""Bond forces of bond-associated correspondence (BA-NOSB), paper Eqs. (11)-(15), in the plane.

Every directed bond has its own deformation gradient, formed over the points that the horizons of
both its ends share. The dyad (y_k - y_i) (x) (w V x_ik) of a neighbor k, with the undeformed bond
vector x_ik, occurs in about fifteen bonds of point i: the pass computes each dyad once, into a
table that stays in the first-level cache, and every bond sums the entries of the points that its
ends share.
"""

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows, put_column
from ..engine.compile import inline, kernel, widest_vectors
from ..engine.passes import Pass, share_of
from ..engine.vector_loads import outer_products, sum_listed_records
from .algebra import algebra_of
from .node_state import solve_volume_ratios
from .reference_state import LEAST_SHAPE_QUALITY

plane = algebra_of(2)

TILE = 64
"""Number of points per tile, the portion of a body whose bonds one thread collects into blocks.
Tiles do not depend on the number of threads, so neither does the grouping of bonds into blocks.
Chosen: the bonds of 64 points (28 each in the plane) fill seven blocks, so that the last, partly
filled block of a tile costs little, and also small bodies have a tile for each thread.
"""


@kernel
def list_common_points(
    points, table_pointers, table, bond_pointers, targets, horizon, count, common_pointers, common
):
    """List, for every directed bond, which neighbors of its first end lie within the horizon of its
    second end.

    The neighbors of point i are entries ``table_pointers[i]`` to ``table_pointers[i + 1]`` of
    `table`. A first call with `count` true writes only the cumulative numbers of shared neighbors,
    to ``common_pointers[1:]``; a second call with `count` false writes only `common`, the indices
    of the shared neighbors, counted from ``table_pointers[i]``. The directed bonds of point i are
    entries ``bond_pointers[i]`` to ``bond_pointers[i + 1]`` of `targets`, which holds the second
    ends of bonds.
    """
    reach = horizon * horizon * (1.0 + 1e-9) * (1.0 + 1e-9)
    at = np.uint64(0)
    for i in range(table_pointers.shape[0] - 1):
        for b in range(bond_pointers[i], bond_pointers[i + 1]):
            end = plane.vector_at(points, targets[b])
            for k in range(table_pointers[i], table_pointers[i + 1]):
                away = plane.minus(plane.vector_at(points, table[k]), end)
                if plane.dot(away, away) <= reach:
                    if not count:
                        common[at] = k - table_pointers[i]
                    at += np.uint64(1)
            if count:
                common_pointers[b + np.uint64(1)] = at


@kernel
def bond_references(
    points, volumes, table, bonds, common, horizon_volumes, inverse_shapes, vectors
):
    """Compute the inverse shape tensor of every directed bond, paper (12), and the vector that
    turns its stress into its force, (13)-(15).

    The force of a bond is its stress P times the vector phi_xi/(2 phi) w K_xi^-1 x V_i V_j;
    `vectors` holds w x on entry and this vector on exit. Here w is the weight, x the undeformed
    bond vector, K_xi the shape tensor of the bond, and V_i, V_j are the volumes of its ends. phi_xi
    is the volume of the points that the horizons of both ends share, divided by the horizon volume
    of the first end; phi is the horizon volume of the first end divided by the sum of the horizon
    volumes of both. Volumes are sums over lists of neighbors: a point is not its own neighbor, but
    the second end of a bond is one of the shared points. `inverse_shapes` becomes zero where the
    shared points do not span the plane. `table` holds the pointers, the numbers of the neighbors of
    each point, and w x V of each neighbor; `bonds` the first and second ends of the bonds; `common`
    the pointers and the indices of the shared points from `list_common_points`.
    """
    table_pointers, entries, table_weights = table
    owners, targets = bonds
    common_pointers, places = common
    for b in range(owners.shape[0]):
        i = owners[b]
        own = plane.vector_at(points, i)
        K = plane.no_symmetric()
        shared = 0.0
        for c in range(common_pointers[b], common_pointers[b + 1]):
            place = table_pointers[i] + places[c]
            x = plane.minus(plane.vector_at(points, entries[place]), own)
            K = plane.add_symmetric_product(K, 1.0, plane.vector_at(table_weights, place), x)
            shared += volumes[entries[place]]
        factor = 0.0
        inverse_shapes[b, :] = 0.0
        if plane.shape_quality(K) > LEAST_SHAPE_QUALITY:
            plane.put(inverse_shapes, b, plane.inverse_symmetric(K))
            share_of_horizons = horizon_volumes[i] / (
                horizon_volumes[i] + horizon_volumes[targets[b]]
            )
            factor = (
                0.5
                * shared
                / horizon_volumes[i]
                / share_of_horizons
                * volumes[i]
                * volumes[targets[b]]
            )
        turned = plane.symmetric_times_vector(
            plane.symmetric_at(inverse_shapes, b), plane.vector_at(vectors, b)
        )
        plane.put(vectors, b, plane.times(factor, turned))


@Pass
def ba_nosb_forces(
    chunk, positions, table, bonds, volume_ratios, response, parameters, memory, forces
):
    """Compute the force of every directed bond on its first point, its force density times the
    volumes of both ends; it is dimensionless.

    Return the number of bonds with det F <= 0, non-finite F or no plane-stress state.
    `volume_ratios` holds J3 of every bond, on entry the values of the last evaluation, on exit the
    new ones. `table` holds the pointers, the numbers of the neighbors of each point, and w x V
    (weight, undeformed bond vector, volume) of each neighbor; `bonds` the pointers of the directed
    bonds, the pointers and indices of their shared points, their inverse shape tensors and their
    vectors (see `bond_references`). `memory` is, for each thread, three arrays of shapes (longest
    table, 4), (BLOCK, 4) and (SCRATCH_ROWS + 4, BLOCK).
    """
    table_pointers, entries, table_weights = table
    bond_pointers, common_pointers, common, inverse_shapes, vectors = bonds
    tables, sums, scratch = memory
    n = table_pointers.shape[0] - 1
    widest_vectors()
    table_here = tables[chunk.thread]
    block = sums[chunk.thread]
    rows = block_rows(scratch[chunk.thread])
    count = 0
    for tile in share_of((n + TILE - 1) // TILE, chunk):
        held = np.int64(0)  # numba would compile `_block_forces` once more for a literal 0
        at = bond_pointers[tile * TILE]
        last = min(n, (tile + 1) * TILE)
        for i in range(tile * TILE, last):
            if bond_pointers[i + 1] > bond_pointers[i]:
                outer_products(
                    positions,
                    entries,
                    table_weights,
                    (table_pointers[i], table_pointers[i + 1]),
                    i,
                    table_here,
                )
            for b in range(bond_pointers[i], bond_pointers[i + 1]):
                end = b + np.uint64(1)
                common_points = common_pointers[b], common_pointers[end]
                sum_listed_records(table_here, common, common_points, block, held)
                held += 1
                if held == BLOCK or end == bond_pointers[last]:
                    count += _block_forces(
                        at,
                        held,
                        block,
                        inverse_shapes,
                        vectors,
                        volume_ratios,
                        response,
                        parameters,
                        rows,
                        forces,
                    )
                    at = end
                    held = np.int64(0)
    return count


@inline
def _block_forces(
    at, size, sums, inverse_shapes, vectors, volume_ratios, response, parameters, rows, forces
):
    """Compute the forces of `size` <= `BLOCK` consecutive bonds, from bond `at` on; return how many
    bonds have no plane-stress state.

    `sums` holds, for each bond, the sum of (y_k - y_i) (x) w x V over the points k that the
    horizons of its ends share: deformed difference of positions, weight, undeformed difference and
    volume.
    """
    at = np.int64(at)
    states = block_rows(rows[0:3])
    result = block_rows(rows[3:8])
    gradients = block_rows(rows[9:13])
    sums = plane.matrix_rows(sums)
    inverse_shapes = plane.symmetric_rows(inverse_shapes[at : at + size])
    vectors = plane.vector_rows(vectors[at : at + size])
    forces = plane.vector_rows(forces[at : at + size])
    volume_ratios = volume_ratios[at : at + size]
    for k in range(size):
        Z = plane.symmetric_at(inverse_shapes, k)
        # A bond without support carries no force; setting F = I keeps its state defined.
        F = plane.plus_diagonal(
            plane.times_symmetric(plane.matrix_at(sums, k), Z), 1.0 if Z[0] == 0.0 else 0.0
        )
        put_column(gradients, k, F)
        put_column(states, k, plane.response_state(F, volume_ratios[k]))
    unsolved = solve_volume_ratios(size, states, result, rows[8], response, parameters)
    for k in range(size):
        volume_ratios[k] = states[2, k]
        found = result[0, k], result[1, k]
        P = plane.first_piola(
            plane.matrix_column_at(gradients, k), plane.column_at(states, k), found, 1.0
        )
        plane.put(forces, k, plane.matrix_times_vector(P, plane.vector_at(vectors, k)))
    return unsolved
