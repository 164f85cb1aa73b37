"""Bond forces of every pair of points in a sheet: the stretch tensor of a bond, the exact force,
and the pass that evaluates any model.

The exact force (theory (7), (11)) replaces that of a surrogate outside the surrogate's domain. A
surrogate that was learned at plane stress serves plane strain, too: `plane_strain_bond_force` adds
the pressure of the fixed thickness.
"""

from functools import cache

import numpy as np

from ..engine.block_arrays import (
    BLOCK,
    STATE_ROWS,
    TRACTION_ROWS,
    block_rows,
    pair_records,
    put_column,
    tuple_of,
)
from ..engine.compile import call_block, compile_bond_force, inlined, widest_vectors
from ..engine.passes import Pass, share_of
from .algebra import algebra_of, entries, state_at
from .domain import N_LIMITS, is_outside, share_inside
from .elementary import inverse_square_root, like, quotient

UNGUARDED = 0
TURNED = 1
FALL_BACK = 2
"""Guards for bonds outside the domain of a force model. UNGUARDED: the model has no domain. TURNED:
they are counted, and those turned so far that no stretch tensor exists get the exact force.
FALL_BACK: they are counted, and all of them get the exact force.
"""

COUNTED_ROW = 5
"""Row of the geometry of pairs that is positive for pairs to be counted when they lie outside the
domain; only a body with several materials or ranks has it, and in other bodies all pairs are
counted.
"""

plane = algebra_of(2)

BOND = STATE_ROWS
TRACTION = BOND + 2
EXACT_TRACTION = TRACTION + TRACTION_ROWS
MEANS = EXACT_TRACTION + TRACTION_ROWS
BUFFER_ROWS = MEANS + 4
"""First rows of the parts of a thread's buffer, and its number of rows. The states of the pairs
begin at row 0, the deformed bond vectors at `BOND`, the tractions at `TRACTION`, those of the exact
force at `EXACT_TRACTION`, and the sums of the records (cos, sin, J, C33) of both points at `MEANS`.
"""

MODEL = 0
VOLUMETRIC = 1
OWN = 2
"""Indices in the array ``sizes`` of a model in plane strain: the addresses of the model's block
function and of the law's volumetric block function, and the first of the model's own sizes.
"""

LEAST_NORMAL_STRETCH = 0.1
"""Value of U_nn, the component of the stretch tensor along a bond, below which the tangent of
1/U_nn replaces 1/U_nn: rubber is never compressed so far.
"""


@inlined
def lateral_stretch(a, b, J):
    """Return U_mm = (J + b^2)/a, the component of the stretch tensor across a bond (theory (10)),
    from a = U_nn and b = U_nm.

    A bond turned by a right angle or more against the mean rotation of its points has a <= 0 and no
    stretch tensor: U_mm would change sign through a pole, and the force would turn the bond further
    instead of back. Below `LEAST_NORMAL_STRETCH` 1/a therefore continues along its tangent. With p
    > 0 and q < 0 the traction T_nn = p a + q U_mm/J is then finite and rises with a at every angle:
    it pushes the bond back.
    """
    inverse = quotient(like(a, 1.0), np.maximum(a, like(a, LEAST_NORMAL_STRETCH)))
    return (J + b * b) * inverse * (like(a, 2.0) - a * inverse)


def along_and_across(T_nn, T_nm, a, b, stretch):
    """Return the components (t_n, t_tau) of bond forces along and across the deformed bond, shape
    (n, 2).

    `T_nn` and `T_nm` are the components of the traction along and across the undeformed bond, `a`
    and `b` the components U_nn and U_nm of the stretch tensor, and `stretch` is the deformed length
    of the bond divided by the undeformed one.
    """
    return np.stack([(T_nn * a + T_nm * b) / stretch, (T_nm * a - T_nn * b) / stretch], axis=1)


doubles_at = entries("rows, k", [f"np.float64(rows[{r}, k])" for r in range(3)])


@cache
def analytic_bond_force(dtype):
    """Return the function, compiled for blocks of bonds, that computes the exact traction of a bond
    from the response of a law.

    States and tractions have the type `dtype`; the function computes in double precision.
    """

    def bond_force(states, sizes, weights, response, parameters, work, scratch, traction):
        for k in range(BLOCK):
            a, b, U_mm = doubles_at(states, k)
            J = np.float64(states[3, k])
            put_column(
                scratch,
                k,
                (a * a + 2.0 * b * b + U_mm * U_mm, J, J * np.sqrt(np.float64(states[4, k]))),
            )
        call_block(response, scratch[0:3], parameters, scratch[3:8])
        for k in range(BLOCK):
            p = scratch[3, k]
            q = scratch[4, k] / scratch[1, k]
            a, b, U_mm = doubles_at(states, k)
            put_column(traction, k, (p * a + q * U_mm, (p - q) * b, p * U_mm + q * a))

    return compile_bond_force(bond_force, dtype)


@cache
def plane_strain_bond_force(dtype):
    """Return the function, compiled for blocks of bonds, that turns the traction T of a
    plane-stress model into that of plane strain.

    The result is T + (J3 U' - tr(T U)/3) U^-1 (theory (47)), U the stretch tensor and U' the slope
    of the volumetric energy. The isochoric Kirchhoff stress has no trace, and the plane-stress
    model returns its components in the plane minus its component tau_33, so that tr(T U)/3 =
    -tau_33: the formula adds tau_33 and the pressure J3 U' of the fixed thickness.
    """

    def bond_force(states, sizes, weights, response, parameters, work, scratch, traction):
        call_block(
            sizes[MODEL],
            states,
            sizes[OWN:],
            weights,
            response,
            parameters,
            work,
            scratch,
            traction,
        )
        for k in range(BLOCK):
            J = np.float64(states[3, k])
            put_column(scratch, k, (1.0, J, J * np.sqrt(np.float64(states[4, k]))))
        call_block(sizes[VOLUMETRIC], scratch[0:3], parameters, scratch[3:7])
        for k in range(BLOCK):
            a, b, U_mm = doubles_at(states, k)
            T_nn, T_nm, T_mm = doubles_at(traction, k)
            q = (scratch[5, k] - (T_nn * a + 2.0 * T_nm * b + T_mm * U_mm) / 3.0) / scratch[1, k]
            put_column(traction, k, (T_nn + q * U_mm, T_nm - q * b, T_mm + q * a))

    return compile_bond_force(bond_force, dtype)


@Pass
def pair_forces(
    chunk, positions, records, pairs, bond_force, exact, constants, guard, domain, memory, forces
):
    """Compute the dimensionless force on the first point of every pair; return the number of pairs
    outside the domain.

    The pass evaluates every pair once, since the mean state of its points is the same from either
    end. For pairs without force (normal_factor = 0: padding, broken bonds, points without support)
    the pass replaces the state by the undeformed one, so that they neither produce NaN nor count.

    `records` (n, 4) holds the state (cos, sin, J, C33) of every point: its rotation, volume ratio
    in the plane and squared thickness stretch. `pairs` are the numbers of the first and second
    points, the geometry (k, 4 to 6, BLOCK) from `reference_state.pair_rows`, with `COUNTED_ROW`,
    and the row of every block in it. `bond_force` and `exact` are addresses of functions compiled
    for blocks of bonds, a model's and the exact one, and `constants` the sizes, weights, response
    and parameters that both take. `guard` is UNGUARDED, TURNED or FALL_BACK. `domain` (2, 7) holds
    the limits of the domain and of its interior, see `pdsurrogate.kernels.domain`. `memory` is, for
    each thread, a buffer and the rows `work` in the model's precision, and the rows `scratch` in
    double precision.
    """
    ends, geometry, rows = pairs
    buffers, work, scratch = memory
    widest_vectors()
    buffer = buffers[chunk.thread]
    states = block_rows(buffer[:BOND])
    bond = block_rows(buffer[BOND:TRACTION])
    traction = block_rows(buffer[TRACTION:EXACT_TRACTION])
    exact_traction = block_rows(buffer[EXACT_TRACTION:MEANS])
    means = block_rows(buffer[MEANS:BUFFER_ROWS])
    real = buffer.dtype.type
    zero = real(0.0)
    half = real(0.5)
    one = real(1.0)
    tiny = real(1e-30)
    # Loads from an array would prevent vectorization.
    outer = tuple_of(domain[0], N_LIMITS)
    inner = tuple_of(domain[1], N_LIMITS)
    counted = COUNTED_ROW if geometry.shape[1] > COUNTED_ROW else 2
    count = 0
    for block in share_of(rows.shape[0], chunk):
        at = block * BLOCK
        reference = block_rows(geometry[rows[block]])
        for k in range(0, BLOCK, 4):
            plane.gather_pairs(records, positions, ends, at + k, means, bond, k)
        for k in range(BLOCK):
            # The mean of two rotations is the direction of the sum of their (cos, sin); opposite
            # rotations have no mean.
            c = means[0, k]
            s = means[1, k]
            norm = inverse_square_root(c * c + s * s + tiny)
            c = c * norm
            s = s * norm
            r1 = c * reference[0, k] - s * reference[1, k]
            r2 = s * reference[0, k] + c * reference[1, k]
            d1 = bond[0, k]
            d2 = bond[1, k]
            live = reference[2, k] != zero
            a = r1 * d1 + r2 * d2 if live else one
            b = r1 * d2 - r2 * d1 if live else zero
            J = half * means[2, k] if live else one
            C33 = half * means[3, k] if live else one
            states[0, k] = a
            states[1, k] = b
            states[2, k] = lateral_stretch(a, b, J)
            states[3, k] = J
            states[4, k] = C33
            bond[0, k] = r1
            bond[1, k] = r2
        if geometry.shape[1] > 4:
            for k in range(BLOCK):
                states[5, k] = reference[4, k]
        call_block(
            bond_force, states, constants, work[chunk.thread], scratch[chunk.thread], traction
        )
        if guard != UNGUARDED:
            # The count has the precision of the loop, since another width would halve its speed.
            # Pairs without force are inside.
            near = zero
            for k in range(BLOCK):
                near += is_outside(
                    states[0, k], states[1, k], states[2, k], states[3, k], states[4, k], inner
                )
            if near > zero:
                call_block(
                    exact,
                    states,
                    constants,
                    work[chunk.thread],
                    scratch[chunk.thread],
                    exact_traction,
                )
                for k in range(BLOCK):
                    a, b, U_mm, J, C33 = state_at(states, k)
                    if (
                        reference[2, k] != zero
                        and reference[counted, k] > zero
                        and is_outside(a, b, U_mm, J, C33, outer) > zero
                    ):
                        count += 1
                    if guard == FALL_BACK:
                        share = real(share_inside(a, b, U_mm, J, C33, outer, inner))
                    else:
                        share = one if a > real(LEAST_NORMAL_STRETCH) else zero
                    if share < one:
                        # A factor of 0 would not suffice: outside its domain a model may return
                        # NaN.
                        for row in range(3):
                            learned = share * traction[row, k] if share > zero else zero
                            traction[row, k] = learned + (one - share) * exact_traction[row, k]
        pair = pair_records(forces[at : at + BLOCK])
        for k in range(BLOCK):
            r1 = bond[0, k]
            r2 = bond[1, k]
            normal_factor = reference[2, k]
            tilt_factor = reference[3, k]
            along = normal_factor * traction[0, k] + tilt_factor * traction[1, k]
            across = normal_factor * traction[1, k] + tilt_factor * traction[2, k]
            pair[k, 0] = r1 * along - r2 * across
            pair[k, 1] = r2 * along + r1 * across
    return count
