"""Steps of dynamic relaxation and of explicit dynamics in place, and the Rayleigh quotient,
greatest force and strain of a step.

The functions take arrays of vectors of any dimension, and allocate no memory.
"""

import numpy as np

from ..engine.compile import kernel


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
def greatest_strain(displacements, points, first, second):
    """Return the largest component of u_j - u_i over the undeformed bond length, of all bonds; u
    are the `displacements`.

    `first` and `second` are the numbers of the points of every pair. Bonds to ghosts are left out.
    """
    largest = 0.0
    for b in range(first.shape[0]):
        i = first[b]
        j = second[b]
        if j < points.shape[0]:
            square = 0.0
            change = 0.0
            for c in range(points.shape[1]):
                square += (points[j, c] - points[i, c]) ** 2
                change = max(change, abs(displacements[j, c] - displacements[i, c]))
            largest = max(largest, change * change / square)
    return np.sqrt(largest)


@kernel
def central_difference_step(positions, velocities, forces, free, mass, damping, step, last_step):
    """Take one explicit time step of M (a + c v) = f in place, with a `damping` c proportional to
    mass.

    a is the acceleration, f the force, and `velocities` v are those in the middle between two
    positions.

    `step` and `last_step` are the lengths of this time step and of the step before; the velocity
    changes over the mean of both.
    """
    span = 0.5 * (step + last_step)
    decay = 1.0 - 0.5 * damping * span
    growth = 1.0 / (1.0 + 0.5 * damping * span)
    for i in range(positions.shape[0]):
        for k in range(positions.shape[1]):
            v = (decay * velocities[i, k] + span * forces[i, k] / mass[i]) * growth * free[i, k]
            velocities[i, k] = v
            positions[i, k] += step * v
