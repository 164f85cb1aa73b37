"""Equilibrium by stepping: adaptive dynamic relaxation, and the paper's damped central differences."""

import math
from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from ..forces import InternalForce, InvalidState
from ..kernels.steps import central_difference_step, rayleigh_parts, relaxation_step
from .equilibrium import Diverging, Equilibrium, EquilibriumSolver, TooSmall, no_report
from .stability import FrequencyEstimate


class SteppingSolver(EquilibriumSolver):
    """Base class of solvers that step towards equilibrium, with one force evaluation per step."""

    # The iteration diverges if the residual exceeds this multiple of its first value (or of shear modulus / spacing).
    MOST_GROWTH = 1e3
    MOST_RESTARTS = 6
    # In single precision a residual that has not fallen by a tenth for so many evaluations has reached its rounding error.
    # While it falls, the residual oscillates with the slowest mode, whose period is some hundreds of evaluations.
    PATIENCE = 3_000

    def solve(self, force, positions, tolerance=None, report=no_report, least_drive=0.0) -> Equilibrium:
        start, began = positions.copy(), force.evaluations
        # The state is new in every call, so that a resumed run repeats an uninterrupted one.
        self.frequency = FrequencyEstimate(self.volumes, self.free, self.share)
        search = force, positions, tolerance or self.tolerance, began, report, least_drive
        for restart in range(self.MOST_RESTARTS - 1):
            # The tangent may stiffen beyond the stability limit of the step: restart with a larger fictitious mass.
            with suppress(InvalidState, Diverging):
                return self._iterate(*search, caution=2.0**restart)
            positions[:] = start
        return self._iterate(*search, caution=2.0 ** (self.MOST_RESTARTS - 1))

    @abstractmethod
    def prepare(self, force: InternalForce, positions: np.ndarray, caution: float) -> Callable[[np.ndarray], None]:
        """Prepare a search, and return a function that steps `positions`, given the forces there.

        `caution` multiplies the squared frequency for which the step must be stable.
        """

    def _iterate(self, force, positions, tolerance, began, report, least_drive, caution) -> Equilibrium:
        step, forces = self.prepare(force, positions, caution), np.empty_like(positions)
        first, least, found = None, np.inf, 0
        self.begin(force, least_drive)
        while True:
            self.evaluate(force, positions, forces)
            residual, settled = self.judge(force, forces, tolerance)
            evaluations, first = force.evaluations - began, first or residual
            if not residual < self.MOST_GROWTH * max(first, 1.0):
                raise Diverging(f"the residual grew from {first:.2g} to {residual:.2g} shear modulus / spacing")
            if residual < 0.9 * least:
                least, found = residual, evaluations
            if settled or evaluations % 10 == 0:
                report(evaluations, residual)
            if settled:
                return Equilibrium(residual, evaluations, self.name, self._drive)
            if force.precision == "float32" and evaluations - found >= self.PATIENCE:
                if residual <= tolerance:
                    raise TooSmall("the forces that drive the body are too small for single precision")
                raise self.not_converged(force, least, evaluations, tolerance)
            if evaluations >= self.most_evaluations:
                raise self.not_converged(force, residual, evaluations, tolerance)
            step(forces)


class DynamicRelaxation(SteppingSolver):
    """Adaptive dynamic relaxation: fictitious masses for a unit time step, and critical damping of the dominant mode.

    The frequency of that mode is the Rayleigh quotient of the velocity.

    References
    ----------
    Underwood, "Dynamic relaxation", in Computational Methods for Transient Analysis (1983) 245-265; Kilic and Madenci, Theor. Appl. Fract.
    Mech. 53 (2010) 194-204.
    """

    name = "relaxation"

    # Ratio of the fictitious mass to the least stable one, with a margin for a tangent that stiffens on the way.
    MARGIN = 2.0

    def prepare(self, force, positions, caution):
        mass = caution * self.MARGIN / 4 * self.frequency(force, positions) * self.volumes
        velocities, last_forces = np.zeros_like(positions), np.zeros_like(positions)

        quotient, take = rayleigh_parts[positions.shape[1]], relaxation_step[positions.shape[1]]

        def step(forces):
            stiffness, inertia = self.share.total(quotient(velocities, forces, last_forces, mass))
            # Beyond 2 the step would be unstable for the fastest mode.
            damping = min(2 * math.sqrt(stiffness / inertia), 1.9) if stiffness > 0 and inertia > 0 else 0.0
            take(positions, velocities, forces, last_forces, self.free, mass, damping)

        return step


class DampedExplicit(SteppingSolver):
    """Damped explicit stepping of the paper, with one fixed time step and one fixed damping rate.

    Time is in units in which the density is one, which does not affect the equilibrium.
    """

    name = "explicit"

    # Squared time step relative to the critical one at the start, where the tangent may be half as stiff as later.
    SAFETY = 0.4

    def prepare(self, force, positions, caution):
        step_length = 2 * np.sqrt(self.SAFETY / caution / self.frequency(force, positions))
        # Critical for the slowest longitudinal mode of a bar of the body's extent, held at both ends, with E = 3 mu.
        extent = force.body.extent
        damping = 2 * np.pi / extent * np.sqrt(3 * force.law.shear_modulus)
        velocities = np.zeros_like(positions)

        def step(forces):
            central_difference_step[positions.shape[1]](
                positions, velocities, forces, self.free, self.volumes, damping, step_length, step_length
            )

        return step
