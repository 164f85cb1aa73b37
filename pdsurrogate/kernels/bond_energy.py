"""Energy of the bonds (theory (27)-(31)) and its exact gradient, for a sheet; the bond volumes come
from `reference_state.bond_shares`.

Every pair has its own deformation gradient, F_ij = Fbar + (y/l - Fbar n) (x) n. In the bond's frame
(n, m) its columns are the bond vector c = F_ij n = y/l and the mean gradient across the bond, e =
F_ij m = Fbar m, so that

    tr C = c.c + e.e,   J = c x e,   P n = 2 psi_I c + psi_J (e2, -e1),   P m = 2 psi_I e + psi_J
    (-c2, c1).

The force has two parts: V_b P n/l on the bond's own ends, and S = 1/2 V_b P (I - n (x) n) = 1/2 V_b
(P m) (x) m conjugate to the gradient of either end, V_b being the volume that the bond represents.

The reference data of a pair are n, 1/l and V_b. A broken pair, or one that pads a block, has V_b =
0 and is given the undeformed state, so that it is neither invalid nor outside a domain.
"""

import numpy as np

from ..engine.block_arrays import BLOCK, block_rows, put_column, rows_from, tuple_of
from ..engine.compile import call_block, inlined, widest_vectors
from ..engine.passes import Pass
from .algebra import algebra_of
from .bond_force import FALL_BACK, UNGUARDED
from .domain import BLEND, N_LIMITS, edge_distances, exact_share
from .energy_density import ENERGY_ROWS, INVARIANT_ROWS
from .sums import counted_at, rest_others, visits_of

COUNTED = 1
"""Guard that counts bonds outside the domain and otherwise leaves them to the surrogate; the module
`bond_force` defines the other guards, `FALL_BACK` and `UNGUARDED`.
"""

plane = algebra_of(2)

RESULT = INVARIANT_ROWS
EXACT_RESULT = RESULT + ENERGY_ROWS
BOND = EXACT_RESULT + ENERGY_ROWS
COLUMNS = BOND + 2
BUFFER_ROWS = COLUMNS + 4
"""First rows of the parts of a thread's buffer, and its number of rows. The invariants of the pairs
begin at row 0; psi and its derivatives at `RESULT`, those of the exact energy at `EXACT_RESULT`,
the deformed bond vectors at `BOND`, and the columns c and e of the deformation gradients at
`COLUMNS`.
"""

COLLAPSED = 0.3
"""Greatest det F_ij, the area or volume ratio at a bond, at which the bond counts as collapsed.

Intact rubber in a tear stays above 0.5. Bonds left across a crack draw their points together faster
than sound; below a third the volumetric energy makes such a bond stiffer than the time step allows.
"""


@inlined
def columns_of(reference, bonds, means, k, half):
    """Return the columns c = F_ij n and e = F_ij m of the deformation gradient of pair k, n along
    its undeformed bond and m across.

    The rows of `reference` are n1, n2 and 1/l, where l is the undeformed length. `bonds` holds the
    deformed bond vectors, `means` the sums of the deformation gradients of both points, and `half`
    is 0.5.
    """
    n = plane.column_in(reference, k, half)
    F = plane.matrix_column_in(means, k, half)
    e = half * (n[0] * F[2] - n[1] * F[0]), half * (n[0] * F[3] - n[1] * F[1])
    return plane.times(reference[2, k], plane.column_at(bonds, k)), e


@inlined
def stress(c, e, p, q):
    """Return (P n, P m) = (p c + q (e2, -e1), p e + q (-c2, c1)), the first Piola-Kirchhoff stress
    times directions n and m.

    n is the direction along a bond, m across; c and e are the columns F n and F m of the bond's
    deformation gradient F; p = 2 dpsi/dtr C and q = dpsi/dJ.
    """
    return p * c[0] + q * e[1], p * c[1] - q * e[0], p * e[0] - q * c[1], p * e[1] + q * c[0]


@inlined
def put_parts(pair, moment, k, reference, P, half):
    """Write the force P n/l of pair k into column k of `pair`, and its moment S = (P m) (x) m/2, by
    columns, into column k of `moment`.

    `P` is (P n, P m), the first Piola-Kirchhoff stress times the directions n along and m across
    the undeformed bond; the rows of `reference` are n1, n2 and 1/l, where l is the undeformed
    length; `half` is 0.5.
    """
    n1 = reference[0, k]
    n2 = reference[1, k]
    inverse_length = reference[2, k]
    h1 = half * P[2]
    h2 = half * P[3]
    put_column(pair, k, (inverse_length * P[0], inverse_length * P[1]))
    put_column(moment, k, (-n2 * h1, -n2 * h2, n1 * h1, n1 * h2))


@Pass
def pair_energies(
    chunk,
    positions,
    gradients,
    pairs,
    energy_density,
    exact,
    constants,
    guard,
    domain,
    memory,
    results,
):
    """Compute the energy, the force and the moment S of every pair of points of a sheet, from
    dimensionless stress and energy density.

    S = 1/2 V_b P (I - n (x) n) is the derivative of the energy by the deformation gradient of
    either point: P is the first Piola-Kirchhoff stress of the pair, V_b the volume that its bond
    represents, and n and l are the direction and the length of the undeformed bond. `pairs` are the
    numbers of their first and second points, the geometry (k, 4 or 5, BLOCK): n1, n2, 1/l, V_b and,
    where a body has several materials or ranks, the part of V_b whose energy counts here, and the
    row of every block in the geometry. `energy_density` and `exact` are the addresses of functions
    compiled for blocks of pairs, and `constants` their constants, see `bond_force.pair_forces`.
    `guard` is UNGUARDED, COUNTED or FALL_BACK; `domain` holds the limits of
    `pdsurrogate.kernels.domain`. `memory` is, for each thread, a buffer, sums of the gradients of
    both points, and the rows `work` and `scratch` of an energy function. The results are: `counts`
    (n_chunks, 3), the numbers of pairs outside the domain, of pairs with det F_ij <= COLLAPSED, and
    of pairs with det F_ij <= 0 or NaN; `energies`, the sums of V_b psi over the pairs of each visit
    of a walk; the walk, to whose sums at both ends the pass adds the force V_b P n/l on the first
    point and S by columns.
    """
    ends, geometry, rows = pairs
    buffers, sums, work, scratch = memory
    counts, energies, walk = results
    blocks, all_lanes, _, rows_of_ends, sums_at_ends = walk
    widest_vectors()
    buffer = buffers[chunk.thread]
    states = block_rows(buffer)
    result = rows_from(states, RESULT)
    exact_result = rows_from(states, EXACT_RESULT)
    bond = rows_from(states, BOND)
    columns = rows_from(states, COLUMNS)
    means = block_rows(sums[chunk.thread])
    real = buffer.dtype.type
    half = real(0.5)
    zero = real(0.0)
    one = real(1.0)
    two = one + one
    least = real(COLLAPSED)
    limits = tuple_of(domain, N_LIMITS)
    edge = -real(BLEND) if guard == FALL_BACK else zero
    counted = geometry.shape[1] - 1
    count = 0
    small = 0
    bad = 0
    for visit in visits_of(walk, chunk):
        block = np.int64(blocks[visit])
        lanes = all_lanes[visit, 0], all_lanes[visit, 1]
        at = block * BLOCK
        reference = block_rows(geometry[rows[block]])
        for k in range(0, BLOCK, 4):
            plane.gather_pairs(gradients, positions, ends, at + k, means, bond, k)
        few = zero
        for k in range(BLOCK):
            c, e = columns_of(reference, bond, means, k, half)
            put_column(columns, k, c + e)
            alive = reference[3, k] > zero
            J = c[0] * e[1] - c[1] * e[0] if alive else one
            states[0, k] = plane.dot(c, c) + plane.dot(e, e) if alive else two
            states[1, k] = J
            # NaN is counted, too.
            few += zero if least < J else one
        if few > zero:
            for k in range(lanes[0], lanes[1]):
                small += 0 if least < states[1, k] else 1
                bad += 0 if states[1, k] > zero else 1
        rest_others(states, lanes, (two, one))
        call_block(
            energy_density, states, constants, work[chunk.thread], scratch[chunk.thread], result
        )
        if guard != UNGUARDED:
            found = zero
            near = zero
            for k in range(BLOCK):
                x1, x2, x3, x4 = edge_distances(states[0, k], states[1, k], limits)
                inside = (x1 <= zero) & (x2 <= zero) & (x3 <= zero) & (x4 <= zero)
                deep = (x1 <= edge) & (x2 <= edge) & (x3 <= edge) & (x4 <= edge)
                found += zero if inside | (reference[counted, k] == zero) else one
                near += zero if deep else one
            if found > zero:
                count += int(found)
            if guard == FALL_BACK and near > zero:
                call_block(
                    exact,
                    states,
                    constants,
                    work[chunk.thread],
                    scratch[chunk.thread],
                    exact_result,
                )
                for k in range(BLOCK):
                    share, by_trace, by_J = exact_share(
                        np.float64(states[0, k]), np.float64(states[1, k]), domain
                    )
                    if share >= 1.0:
                        put_column(
                            result, k, (exact_result[0, k], exact_result[1, k], exact_result[2, k])
                        )
                    elif share > 0.0:
                        excess = exact_result[0, k] - result[0, k]
                        result[0, k] += real(share) * excess
                        result[1, k] += (
                            real(share) * (exact_result[1, k] - result[1, k])
                            + real(by_trace) * excess
                        )
                        result[2, k] += (
                            real(share) * (exact_result[2, k] - result[2, k]) + real(by_J) * excess
                        )
        total = 0.0
        for k in range(BLOCK):
            bond_volume = reference[3, k]
            p = bond_volume * (result[1, k] + result[1, k])
            q = bond_volume * result[2, k]
            P = stress((columns[0, k], columns[1, k]), (columns[2, k], columns[3, k]), p, q)
            # The bonds and the columns are no longer needed.
            put_parts(bond, columns, k, reference, P, half)
            total += np.float64(counted_at(reference, counted, lanes, k) * result[0, k])
        plane.add_at_ends(columns, bond, rows_of_ends, visit * BLOCK, sums_at_ends)
        energies[visit] = total
    counts[chunk.number, 0] = count
    counts[chunk.number, 1] = small
    counts[chunk.number, 2] = bad
    return 0
