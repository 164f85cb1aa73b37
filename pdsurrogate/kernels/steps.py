"""Steps of dynamic relaxation and of explicit dynamics in place, and the Rayleigh quotient,
greatest force and strain of a step, and its energies.

The functions take arrays of vectors of any dimension, and allocate no memory.
"""

import numpy as np

from ..engine.block_arrays import BLOCK
from ..engine.compile import inlined, kernel
from ..engine.passes import Pass, share_of


@kernel
def rayleigh_parts(velocities, forces, last_forces, mass):
    """Return v . K v and v . M v, numerator and denominator of the Rayleigh quotient of the
    velocities v.

    K v, stiffness matrix times velocities, is minus the change of the forces over the last time
    step, of length 1.
    """
    stiffness = 0.0
    inertia = 0.0
    for i in range(velocities.shape[0]):
        for c in range(velocities.shape[1]):
            stiffness -= velocities[i, c] * (forces[i, c] - last_forces[i, c])
            inertia += mass[i] * velocities[i, c] * velocities[i, c]
    return stiffness, inertia


@kernel
def relaxation_step(positions, velocities, forces, last_forces, free, mass, damping):
    """Advance `positions` and `velocities` in place by one step of dynamic relaxation of length 1;
    copy `forces` to `last_forces`.

    `free` is 1 where a component may move and 0 elsewhere, `mass` is fictitious, and the `damping`
    rate is below 2.
    """
    decay = (2.0 - damping) / (2.0 + damping)
    growth = 2.0 / (2.0 + damping)
    for i in range(positions.shape[0]):
        for c in range(positions.shape[1]):
            v = (decay * velocities[i, c] + growth * forces[i, c] / mass[i]) * free[i, c]
            velocities[i, c] = v
            positions[i, c] += v
            last_forces[i, c] = forces[i, c]


@kernel
def greatest_force_density(forces, free, volumes):
    """Return the largest magnitude of force per volume over the free components of all points; NaN
    if any is not finite.

    `free` is 1 where a component may move and 0 elsewhere.
    """
    largest = 0.0
    total = 0.0
    for i in range(forces.shape[0]):
        for c in range(forces.shape[1]):
            value = abs(forces[i, c]) * free[i, c] / volumes[i]
            largest = max(largest, value)
            total += value
    return largest if total < np.inf else np.nan


@kernel
def greatest_strain(displacements, points, first, second, broken):
    """Return the largest component of u_j - u_i over the undeformed bond length, of all bonds; u
    are the `displacements`.

    `first` and `second` are the numbers of the points of every pair. Bonds to ghosts are left out,
    and `broken` ones, an array of flags that is empty if none is.
    """
    largest = 0.0
    for b in range(first.shape[0]):
        i = first[b]
        j = second[b]
        if j < points.shape[0] and not (broken.shape[0] > 0 and broken[b]):
            square = 0.0
            change = 0.0
            for c in range(points.shape[1]):
                square += (points[j, c] - points[i, c]) ** 2
                change = max(change, abs(displacements[j, c] - displacements[i, c]))
            largest = max(largest, change * change / square)
    return np.sqrt(largest)


@kernel
def greatest_change_of_length(before, after, points, first, second):
    """Return the largest change of the length of a bond from positions `before` to `after`, over
    its undeformed length; NaN if any is not finite. For the others see `greatest_strain`.
    """
    largest = 0.0
    total = 0.0
    for b in range(first.shape[0]):
        i = first[b]
        j = second[b]
        if j < points.shape[0]:
            square = one = other = 0.0
            for c in range(points.shape[1]):
                square += (points[j, c] - points[i, c]) ** 2
                one += (before[j, c] - before[i, c]) ** 2
                other += (after[j, c] - after[i, c]) ** 2
            change = abs(np.sqrt(other) - np.sqrt(one)) / np.sqrt(square)
            largest = max(largest, change)
            total += change
    return largest if total < np.inf else np.nan


@kernel
def central_difference_step(positions, velocities, forces, free, mass, damping, step, last_step):
    """Take one explicit time step of M (a + c v) = f in place, with a `damping` c proportional to
    mass.

    a is the acceleration, f the force, and `velocities` v are those in the middle between two
    positions.

    `step` and `last_step` are the lengths of this time step and of the step before; the velocity
    changes over the mean of both.
    """
    rule = _rule(0.5 * (step + last_step), damping)
    for i in range(positions.shape[0]):
        for k in range(positions.shape[1]):
            v = _following(velocities[i, k], forces[i, k], mass[i], rule) * free[i, k]
            velocities[i, k] = v
            positions[i, k] += step * v


@inlined
def _rule(span, damping):
    """Return the numbers by which velocities change over a span of time."""
    return span, 1.0 - 0.5 * damping * span, 1.0 / (1.0 + 0.5 * damping * span)


@inlined
def _following(velocity, force, mass, rule):
    """Return the velocity component after a span of time, see `_rule`."""
    span, decay, growth = rule
    return (decay * velocity + span * force / mass) * growth


@Pass
def take_step(chunk, positions, velocities, forces, free, mass, damping, spans, most_travel):
    """Take one explicit time step as `central_difference_step` does; return whether a point would
    move by more than `most_travel` in the next step.

    `spans` begin with the lengths of this time step, of the step before and of the next.
    """
    step = spans[0]
    rule = _rule(0.5 * (step + spans[1]), damping)
    greatest = 0.0
    for i in share_of(positions.shape[0], chunk):
        for k in range(positions.shape[1]):
            v = _following(velocities[i, k], forces[i, k], mass[i], rule) * free[i, k]
            velocities[i, k] = v
            positions[i, k] += step * v
            greatest = max(greatest, abs(v))
    return not greatest * spans[2] <= most_travel


@Pass
def look_ahead(chunk, positions, velocities, time, ahead):
    """Write the positions a `time` ahead, at constant velocities."""
    for i in share_of(positions.shape[0], chunk):
        for k in range(positions.shape[1]):
            ahead[i, k] = positions[i, k] + time * velocities[i, k]


@Pass
def follow(chunk, forces, spans, elastic):
    """Add the part `spans[3]` of the difference between forces and `elastic` to the latter."""
    for i in share_of(forces.shape[0], chunk):
        for k in range(forces.shape[1]):
            elastic[i, k] += spans[3] * (forces[i, k] - elastic[i, k])


@Pass
def next_row(chunk, row):
    """Go on to the next row of tables, whose number `row` (1,) has."""
    if chunk.number == 0:
        row[0] += 1


@Pass
def put_row(chunk, table, row, places, values):
    """Copy a row of a table to `places` of flat `values`."""
    for i in share_of(places.shape[0], chunk):
        values[places[i]] = table[row[0], i]


@Pass
def keep_row(chunk, values, places, row, table):
    """Copy `places` of flat `values` to a row of a table."""
    for i in share_of(places.shape[0], chunk):
        table[row[0], i] = values[places[i]]


@Pass
def copy_rows(chunk, values, out):
    """Copy the first rows of `values`, as many as `out` has."""
    for i in share_of(out.shape[0], chunk):
        for k in range(out.shape[1]):
            out[i, k] = values[i, k]


@Pass
def count_infinite(chunk, values):
    """Return whether a value is not finite."""
    if chunk.number > 0:
        return 0
    total = 0.0
    for i in range(values.shape[0]):
        total += abs(values[i])
    return not total < np.inf


@Pass
def count_positive(chunk, values):
    """Return whether a value of an array of rows is positive."""
    found = 0
    for i in share_of(values.shape[0], chunk):
        for k in range(values.shape[1]):
            found += values[i, k] > 0
    return found


@Pass
def energies_of_step(
    chunk, arriving, velocities, forces, free, mass, damping, spans, elastic, sums
):
    """Write sums over blocks of points to `sums` (n_blocks, 4): the kinetic energies before and
    after the present time, and the powers of damping and viscosity with the velocities of these
    times, see `ExplicitDynamics.balance`.

    `velocities` are those in the middle of the last step, `arriving` the same without the impulse
    of bonds that have just broken; viscous forces are `forces` minus `elastic`. `spans` are as of
    `take_step`.
    """
    n, dimension = velocities.shape
    present = _rule(spans[0], damping)
    mean = _rule(0.5 * (spans[0] + spans[2]), damping)
    for block in share_of(sums.shape[0], chunk):
        kinetic = left = taken = lost = 0.0
        for i in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            for k in range(dimension):
                old = velocities[i, k]
                force = forces[i, k]
                before = arriving[i, k]
                after = _following(old, force, mass[i], mean) * free[i, k]
                now = 0.5 * (old + _following(old, force, mass[i], present) * free[i, k])
                kinetic += mass[i] * before * (now - 0.5 * before)
                left += mass[i] * after * (now - 0.5 * after)
                taking = damping * mass[i] * now + free[i, k] * (elastic[i, k] - force)
                taken += taking * before
                lost += taking * after
        sums[block, 0] = kinetic
        sums[block, 1] = left
        sums[block, 2] = taken
        sums[block, 3] = lost
