"""Bond-associated correspondence (BA-NOSB), paper Eqs. (11)-(15).

Every directed bond has its own deformation gradient, formed over the points that the horizons of both its ends share. The product (y_k -
y_i) (x) w x V of a neighbour k occurs in about fifteen bonds of point i: it is computed once into a table that stays in the first-level
cache, and each bond sums the entries that it lists.
"""

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows, pair_records, quad_records, triple_records
from ..engine.compile import inline, kernel, widest_vectors
from ..engine.passes import Pass, share_of
from ..engine.vector_loads import outer_products, sum_listed_records
from .by_dimension import ByDimension
from .node_state import solve_volume_ratios

TILE = 64
"""Points per tile. Tiles do not depend on the number of threads, so neither does the grouping of bonds into blocks."""


@kernel
def list_common_points(points, table_pointers, table, bond_pointers, targets, horizon, count, common_pointers, common):
    """List, for every directed bond, the entries of its point's table that lie within the horizon of the bond's other end.

    With `count` true only the numbers of entries are found, into ``common_pointers[1:]``.
    """
    reach = horizon * horizon * (1.0 + 1e-9) * (1.0 + 1e-9)
    at = np.uint64(0)
    for i in range(table_pointers.shape[0] - 1):
        for b in range(bond_pointers[i], bond_pointers[i + 1]):
            j = targets[b]
            for k in range(table_pointers[i], table_pointers[i + 1]):
                d1 = points[table[k], 0] - points[j, 0]
                d2 = points[table[k], 1] - points[j, 1]
                if d1 * d1 + d2 * d2 <= reach:
                    if not count:
                        common[at] = k - table_pointers[i]
                    at += np.uint64(1)
            if count:
                common_pointers[b + np.uint64(1)] = at


@kernel
def bond_references(
    points,
    volumes,
    table_pointers,
    table,
    table_weights,
    owners,
    targets,
    common_pointers,
    common,
    horizon_volumes,
    inverse_shapes,
    vectors,
):
    """Compute the inverse shape tensor (12) of every directed bond, and the vector that turns its stress into its force (13)-(15).

    The vector is phi_xi/(2 phi) w K_xi^-1 x V_i V_j, in place of w x in `vectors`. Volumes are sums over the lists: a point is not its own
    neighbour, but a bond's far end is one of its shared points. `inverse_shapes` is zero where the shared points do not span the plane;
    `table_weights` is w x V of every table entry.
    """
    for b in range(owners.shape[0]):
        i = owners[b]
        j = targets[b]
        K11 = 0.0
        K12 = 0.0
        K22 = 0.0
        shared = 0.0
        for c in range(common_pointers[b], common_pointers[b + 1]):
            place = table_pointers[i] + common[c]
            k = table[place]
            x1 = points[k, 0] - points[i, 0]
            x2 = points[k, 1] - points[i, 1]
            K11 += table_weights[place, 0] * x1
            K12 += table_weights[place, 0] * x2
            K22 += table_weights[place, 1] * x2
            shared += volumes[k]
        determinant = K11 * K22 - K12 * K12
        trace = K11 + K22
        factor = 0.0
        if 4.0 * determinant > 1e-3 * trace * trace:
            inverse_shapes[b, 0] = K22 / determinant
            inverse_shapes[b, 1] = -K12 / determinant
            inverse_shapes[b, 2] = K11 / determinant
            phi_bond = shared / horizon_volumes[i]
            phi = horizon_volumes[i] / (horizon_volumes[i] + horizon_volumes[j])
            factor = 0.5 * phi_bond / phi * volumes[i] * volumes[j]
        else:
            inverse_shapes[b, :] = 0.0
        v1 = vectors[b, 0]
        v2 = vectors[b, 1]
        vectors[b, 0] = factor * (inverse_shapes[b, 0] * v1 + inverse_shapes[b, 1] * v2)
        vectors[b, 1] = factor * (inverse_shapes[b, 1] * v1 + inverse_shapes[b, 2] * v2)


@Pass
def ba_nosb_forces(
    thread,
    chunk,
    chunks,
    positions,
    table_pointers,
    table,
    table_weights,
    bond_pointers,
    common_pointers,
    common,
    inverse_shapes,
    vectors,
    volume_ratios,
    response,
    parameters,
    tables,
    sums,
    scratch,
    forces,
):
    """Compute the dimensionless force t V_i V_j of every directed bond.

    Return the number of bonds with det F <= 0, non-finite F or no plane-stress state. `volume_ratios` holds J3 of every bond, the last
    values on entry and the new ones on exit. Working memory: `tables` (n_threads, longest table, 4), `sums` (n_threads, BLOCK, 4),
    `scratch` (n_threads, SCRATCH_ROWS + 4, BLOCK).
    """
    n = table_pointers.shape[0] - 1
    widest_vectors()
    first_tile, last_tile = share_of((n + TILE - 1) // TILE, chunk, chunks)
    table_here = tables[thread]
    block = sums[thread]
    rows = block_rows(scratch[thread])
    count = 0
    for tile in range(first_tile, last_tile):
        held = 0
        at = bond_pointers[tile * TILE]
        for i in range(tile * TILE, min(n, (tile + 1) * TILE)):
            if bond_pointers[i + 1] > bond_pointers[i]:
                outer_products(positions, table, table_weights, table_pointers[i], table_pointers[i + 1], np.uint64(i), table_here)
            for b in range(bond_pointers[i], bond_pointers[i + 1]):
                sum_listed_records(table_here, common, common_pointers[b], common_pointers[b + np.uint64(1)], block, np.uint64(held))
                held += 1
                if held == BLOCK:
                    count += _block_forces(at, held, block, inverse_shapes, vectors, volume_ratios, response, parameters, rows, forces)
                    at += np.uint64(BLOCK)
                    held = 0
        if held > 0:
            count += _block_forces(at, held, block, inverse_shapes, vectors, volume_ratios, response, parameters, rows, forces)
    return count


@inline
def _block_forces(at, size, sums, inverse_shapes, vectors, volume_ratios, response, parameters, rows, forces):
    """Compute the forces of up to `BLOCK` consecutive bonds from their sums of products."""
    at = np.int64(at)
    states = block_rows(rows[0:3])
    result = block_rows(rows[3:8])
    F = block_rows(rows[9:13])
    sums = quad_records(sums)
    inverse_shapes = triple_records(inverse_shapes[at : at + size])
    vectors = pair_records(vectors[at : at + size])
    forces = pair_records(forces[at : at + size])
    volume_ratios = volume_ratios[at : at + size]
    for k in range(size):
        z11 = inverse_shapes[k, 0]
        z12 = inverse_shapes[k, 1]
        z22 = inverse_shapes[k, 2]
        # A bond without support carries no force; setting F = I keeps its state defined.
        rest = 1.0 if z11 == 0.0 else 0.0
        F11 = sums[k, 0] * z11 + sums[k, 2] * z12 + rest
        F21 = sums[k, 1] * z11 + sums[k, 3] * z12
        F12 = sums[k, 0] * z12 + sums[k, 2] * z22
        F22 = sums[k, 1] * z12 + sums[k, 3] * z22 + rest
        F[0, k] = F11
        F[1, k] = F21
        F[2, k] = F12
        F[3, k] = F22
        states[0, k] = F11 * F11 + F21 * F21 + F12 * F12 + F22 * F22
        states[1, k] = F11 * F22 - F12 * F21
        states[2, k] = volume_ratios[k]
    unsolved = solve_volume_ratios(size, states, result, rows[8], response, parameters)
    for k in range(size):
        p = result[0, k]
        q = result[1, k] / states[1, k]
        v1 = vectors[k, 0]
        v2 = vectors[k, 1]
        volume_ratios[k] = states[2, k]
        forces[k, 0] = (p * F[0, k] + q * F[3, k]) * v1 + (p * F[2, k] - q * F[1, k]) * v2
        forces[k, 1] = (p * F[1, k] - q * F[2, k]) * v1 + (p * F[3, k] + q * F[0, k]) * v2
    return unsolved


@ByDimension
def sum_bond_forces(algebra):
    """Build the pass that sums the forces of directed bonds to forces on points."""

    @Pass
    def sum_bond_forces(chunk, chunks, forces, bond_pointers, reverse, unit, out):
        """Sum the forces of every point's bonds minus those of the reverse bonds; return for how many points the sum is not finite."""
        without_force = 0
        begin, end = share_of(out.shape[0], chunk, chunks)
        for i in range(begin, end):
            start = bond_pointers[i]
            stop = bond_pointers[i + 1]
            algebra.sum_signed_records(forces, start, stop, reverse, start, stop, unit, np.uint64(i), out)
            without_force += algebra.not_finite(algebra.vector_at(out, i))
        return without_force

    return sum_bond_forces
