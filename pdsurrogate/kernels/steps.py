"""Steps of dynamic relaxation and of explicit dynamics, and what bounds a step: vectors in, vectors out, no allocation."""

import numpy as np

from ..engine.compile import kernel
from .by_dimension import ByDimension


@ByDimension
def rayleigh_parts(algebra):
    """Numerator and denominator of the Rayleigh quotient of the velocities, v . K v and v . M v."""
    dimension = algebra.DIMENSION

    @kernel
    def rayleigh_parts(velocities, forces, last_forces, mass):
        """Numerator and denominator of the Rayleigh quotient of the velocities, v . K v and v . M v.

        K v is taken from the change of the forces (n, d) over the last step of unit length.
        """
        stiffness = 0.0
        inertia = 0.0
        for i in range(velocities.shape[0]):
            for c in range(dimension):
                v = velocities[i, c]
                stiffness -= v * (forces[i, c] - last_forces[i, c])
                inertia += mass[i] * v * v
        return stiffness, inertia

    return rayleigh_parts


@ByDimension
def relaxation_step(algebra):
    """One step of dynamic relaxation with unit time step."""
    dimension = algebra.DIMENSION

    @kernel
    def relaxation_step(positions, velocities, forces, last_forces, free, mass, damping):
        """One step of dynamic relaxation with unit time step.

        Parameters
        ----------
        positions, velocities : (n, d) in and out.
        forces, last_forces : (n, d) now, and one step ago; the latter is overwritten with the former.
        free : (n, d) 1 where a component may move.
        mass : (n,) fictitious mass.
        damping : rate, below 2.
        """
        for i in range(positions.shape[0]):
            for c in range(dimension):
                v = ((2.0 - damping) * velocities[i, c] + 2.0 * forces[i, c] / mass[i]) / (2.0 + damping) * free[i, c]
                velocities[i, c] = v
                positions[i, c] += v
                last_forces[i, c] = forces[i, c]

    return relaxation_step


@ByDimension
def greatest_force_density(algebra):
    """Largest force per volume over the free components; NaN if any is not finite."""
    dimension = algebra.DIMENSION

    @kernel
    def greatest_force_density(forces, free, volumes):
        """Largest force per volume over the free components; NaN if any is not finite."""
        largest = 0.0
        total = 0.0
        for i in range(forces.shape[0]):
            for c in range(dimension):
                value = abs(forces[i, c]) * free[i, c] / volumes[i]
                largest = max(largest, value)
                total += value
        return largest if total < np.inf else np.nan

    return greatest_force_density


@ByDimension
def greatest_strain(algebra):
    """Largest relative displacement, in any component, of two bonded points over their distance; pairs with ghosts are left out."""
    dimension = algebra.DIMENSION

    @kernel
    def greatest_strain(displacements, points, first, second):
        """Largest relative displacement, in any component, of two bonded points over their distance; pairs with ghosts are left out."""
        largest = 0.0
        for b in range(first.shape[0]):
            i = first[b]
            j = second[b]
            if j < points.shape[0]:
                square = 0.0
                change = 0.0
                for c in range(dimension):
                    x = points[j, c] - points[i, c]
                    square += x * x
                    change = max(change, abs(displacements[j, c] - displacements[i, c]))
                largest = max(largest, change / np.sqrt(square))
        return largest

    return greatest_strain


@ByDimension
def central_difference_step(algebra):
    """One explicit step with velocities at half steps and damping proportional to mass."""
    dimension = algebra.DIMENSION

    @kernel
    def central_difference_step(positions, velocities, forces, free, mass, damping, step, last_step):
        """One explicit step with velocities at half steps and damping proportional to mass.

        Parameters
        ----------
        damping : rate c in M (a + c v) = f.
        step, last_step : time step, and the one before; the velocities span half of each.
        """
        span = 0.5 * (step + last_step)
        decay = 1.0 - 0.5 * damping * span
        growth = 1.0 / (1.0 + 0.5 * damping * span)
        for i in range(positions.shape[0]):
            for k in range(dimension):
                v = (decay * velocities[i, k] + span * forces[i, k] / mass[i]) * growth * free[i, k]
                velocities[i, k] = v
                positions[i, k] += step * v

    return central_difference_step
