"""Methods for equilibrium: quasi-Newton (`quasi_newton.py`), dynamic relaxation,
damped explicit stepping, Newton's.

`Automatic` chooses among the first three. The explicit stepping is the method of the paper that
`pdsurrogate.paper` reproduces.
"""

import math
from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..forces import InternalForce, InvalidState
from ..kernels.steps import central_difference_step, rayleigh_parts, relaxation_step
from .equilibrium import (
    Diverging,
    Equilibrium,
    EquilibriumSolver,
    NotConverged,
    check_growth,
    falls,
    no_report,
    window_of,
)
from .preconditioner import with_short_displacements
from .quasi_newton import EnergyMinimizer, QuasiNewton
from .stability import FrequencyEstimate
from .tangent import TangentEquations


class SteppingSolver(EquilibriumSolver):
    """Base class of solvers for equilibrium by damped motion in time steps, with one force
    evaluation per step.
    """

    # Searches with fictitious mass that doubles each time: the last allows for a tangent that
    # becomes 32 times as stiff.
    MOST_RESTARTS = 6
    # In single precision a residual that has not fallen by a tenth for so many evaluations has
    # reached its rounding error. While it falls, the residual oscillates with the slowest mode,
    # whose period is some hundreds of evaluations.
    PATIENCE = 3_000
    # Evaluations in which the residual must halve (see `falls`).
    window = np.inf

    def solve(
        self, force, positions, tolerance=None, report=no_report, least_drive=0.0
    ) -> Equilibrium:
        start = positions.copy()
        began = force.evaluations
        # The state is new in every call, so that a resumed run repeats an uninterrupted one.
        self.frequency = FrequencyEstimate(self.volumes, self.free, self.share)
        search = force, positions, tolerance or self.tolerance, began, report, least_drive
        for restart in range(self.MOST_RESTARTS - 1):
            # The tangent may stiffen beyond the stability limit of the step: restart with a larger
            # fictitious mass.
            with suppress(InvalidState, Diverging):
                return self._iterate(*search, caution=2.0**restart)
            positions[:] = start
        return self._iterate(*search, caution=2.0 ** (self.MOST_RESTARTS - 1))

    @abstractmethod
    def prepare(
        self, force: InternalForce, positions: np.ndarray, caution: float
    ) -> Callable[[np.ndarray], None]:
        """Prepare a search, and return a function ``step(forces)`` that moves `positions`, in
        place, by one time step.

        `caution`, at least 1, is a safety factor: the step must be stable even if the squared
        highest frequency is so many times greater.
        """

    def _iterate(
        self, force, positions, tolerance, began, report, least_drive, caution
    ) -> Equilibrium:
        step = self.prepare(force, positions, caution)
        forces = np.empty_like(positions)
        first = None
        least = np.inf
        found = 0
        course = []
        self.begin(force, least_drive)
        while True:
            self.evaluate(force, positions, forces)
            residual, settled = self.judge(force, forces, tolerance)
            evaluations = force.evaluations - began
            first = first or residual
            check_growth(first, residual)
            if residual < 0.9 * least:
                least = residual
                found = evaluations
            if settled or evaluations % 10 == 0:
                report(evaluations, residual)
            if settled:
                return Equilibrium(residual, evaluations, self.name, self._drive)
            if force.precision == "float32" and evaluations - found >= self.PATIENCE:
                raise self.not_converged(force, least, evaluations, tolerance)
            if evaluations % 10 == 0:
                course.append((evaluations, residual))
            if evaluations >= self.most_evaluations or not falls(course, self.window):
                raise self.not_converged(force, residual, evaluations, tolerance)
            step(forces)


class DynamicRelaxation(SteppingSolver):
    """Solver for equilibrium by adaptive dynamic relaxation: fictitious masses for a unit time
    step, and critical damping.

    The mode that is damped critically is the dominant one, with the Rayleigh quotient of the
    velocity as squared frequency.

    References
    ----------
    Underwood, "Dynamic relaxation", in Computational Methods for Transient Analysis (1983) 245-265;
    Kilic and Madenci, Theor. Appl. Fract. Mech. 53 (2010) 194-204.
    """

    name = "relaxation"

    # Ratio of the fictitious mass to the least stable one, with a margin for a tangent that
    # stiffens on the way.
    MARGIN = 2.0

    def prepare(self, force, positions, caution):
        mass = caution * self.MARGIN / 4 * self.frequency(force, positions) * self.volumes
        velocities = np.zeros_like(positions)
        last_forces = np.zeros_like(positions)

        quotient = rayleigh_parts
        take = relaxation_step

        def step(forces):
            stiffness, inertia = self.share.total(quotient(velocities, forces, last_forces, mass))
            # Beyond 2 the step would be unstable for the fastest mode.
            damping = (
                min(2 * math.sqrt(stiffness / inertia), 1.9)
                if stiffness > 0 and inertia > 0
                else 0.0
            )
            take(positions, velocities, forces, last_forces, self.free, mass, damping)

        return step


class DampedExplicit(SteppingSolver):
    """Solver for equilibrium by damped explicit stepping with a fixed time step and damping rate,
    the method of the reproduced paper.

    Time is in units in which the density is one, which does not affect the equilibrium.
    """

    name = "explicit"

    # Squared time step relative to the critical one at the start, where the tangent may be half as
    # stiff as later.
    SAFETY = 0.4

    def prepare(self, force, positions, caution):
        step_length = 2 * np.sqrt(self.SAFETY / caution / self.frequency(force, positions))
        # Critical for the slowest longitudinal mode of a bar of the body's extent, held at both
        # ends, with E = 3 mu.
        extent = force.body.extent
        damping = 2 * np.pi / extent * np.sqrt(3 * force.law.shear_modulus)
        velocities = np.zeros_like(positions)
        take = central_difference_step
        constants = self.free, self.volumes, damping, step_length, step_length
        return lambda forces: take(positions, velocities, forces, *constants)


class Automatic(EquilibriumSolver):
    """Solver that chooses energy minimization for nearly incompressible bodies, else quasi-Newton,
    and dynamic relaxation if that fails.

    In nearly incompressible bodies a little shear corrects a change of volume. Steps of the
    quasi-Newton method, whose preconditioner then contains the bulk modulus, are long compared with
    it, and the energy, if the force has one, limits them. A faster method that has failed on a body
    is not tried there again (see `gave_up`).
    """

    name = "automatic"

    # Bound of the evaluations of relaxation: a number for each spacing in the body's extent, and
    # the least bound.  Relaxation takes some tens for each spacing where the body is as thick as it
    # is long, more where it is slender.
    RELAXED = 100
    LEAST_RELAXED = 2_000

    _quick: EquilibriumSolver | None = None

    def __init__(self, *settings) -> None:
        super().__init__(*settings)
        self._settings = settings
        self._sure = DynamicRelaxation(*settings)

    def preconditioner(self, force):
        return self._method(force).preconditioner(force)

    def _method(self, force) -> EquilibriumSolver:
        """Return the solver to try first on a force: the energy minimizer or the quasi-Newton
        method, made on first use.
        """
        if self._quick is None:
            self._quick = (
                EnergyMinimizer if force.nearly_incompressible and force.has_energy else QuasiNewton
            )(*self._settings)
        return self._quick

    def solve(
        self, force, positions, tolerance=None, report=no_report, least_drive=0.0
    ) -> Equilibrium:
        quick = self._method(force)
        start = positions.copy()
        began = force.evaluations
        if not self.gave_up:
            try:
                return quick.solve(force, positions, tolerance, report, least_drive)
            except (Diverging, InvalidState, NotConverged):
                if force.evaluations - began >= self.most_evaluations:
                    raise
                self.gave_up = True
                positions[:] = start
        most = max(self.LEAST_RELAXED, int(self.RELAXED * force.body.extent / force.body.spacing))
        self._sure.most_evaluations = min(self.most_evaluations, most)
        # Pressure waves, which limit the step, are so many times faster than shear waves.
        slow = (
            np.sqrt(force.law.bulk_modulus / force.law.shear_modulus)
            if force.nearly_incompressible
            else 1.0
        )
        self._sure.window = slow * window_of(force.body)
        found = self._sure.solve(force, positions, tolerance, report, least_drive)
        return replace(found, evaluations=force.evaluations - began)


class Newton(EquilibriumSolver):
    """Newton's method for equilibrium, after the automatic method has reduced the residual to
    `START`.

    Products of the tangent are differences of forces, so the force must be in double precision, and
    the body on one rank. Each iteration squares the error, so that residuals of 1e-10 are reached,
    which other methods need many evaluations for.
    """

    name = "newton"
    needs_tangent = True

    # Residual, in units of shear modulus / spacing, at which the automatic method ends, and
    # permitted residual of the linear equations of an iteration, divided by the forces on free
    # points. Chosen: an iteration then gains what the curvature of the forces permits, with some 15
    # products of the tangent.
    START = 1e-3
    SHARE_LEFT = 1e-4

    # Greatest number of iterations, each of which gains far more than a third: a search that needs
    # more than the usual two to five fails.
    MOST = 20
    IDLE = 5

    def __init__(self, *settings) -> None:
        super().__init__(*settings)
        self._first = Automatic(*settings)
        self._equations: TangentEquations | None = None

    def preconditioner(self, force):
        return self._first.preconditioner(force)

    def equations(self, force: InternalForce, positions: np.ndarray) -> TangentEquations:
        """Return the equations of the tangent at the equilibrium found, with the directions of
        the last iteration.
        """
        if self._equations is None:
            return self._equations_at(force, positions)
        self._equations.move(positions)
        return self._equations

    def _equations_at(self, force: InternalForce, positions: np.ndarray) -> TangentEquations:
        return TangentEquations(
            force,
            positions,
            self.free,
            with_short_displacements(self.preconditioner(force), force, self.free),
        )

    def solve(
        self, force, positions, tolerance=None, report=no_report, least_drive=0.0
    ) -> Equilibrium:
        self._equations = None
        tolerance = tolerance or self.tolerance
        began = force.evaluations
        found = self._first.solve(force, positions, max(tolerance, self.START), report, least_drive)
        if tolerance >= self.START:
            return found
        forces = np.empty_like(positions)
        self.begin(force, least_drive)
        self.evaluate(force, positions, forces)
        residual, settled = self.judge(force, forces, tolerance)
        for _ in range(self.MOST):
            if settled:
                return Equilibrium(residual, force.evaluations - began, self.name, self._drive)
            self._equations = self._equations_at(force, positions)
            step = self._equations.displacements(forces, self.SHARE_LEFT)
            before = self.residual(force, forces)
            try:
                self.evaluate(force, positions + step, forces)
            except InvalidState as error:
                raise Diverging(f"a step of Newton's method has no force: {error}") from None
            positions += step
            residual, settled = self.judge(force, forces, tolerance)
            report(force.evaluations - began, residual)
            if not settled and not residual < before:
                raise Diverging(
                    f"a step of Newton's method does not reduce the residual of {before:.2g}"
                )
        raise self.not_converged(force, residual, force.evaluations - began, tolerance)


SOLVERS = {
    solver.name: solver
    for solver in (
        Automatic,
        EnergyMinimizer,
        QuasiNewton,
        DynamicRelaxation,
        DampedExplicit,
        Newton,
    )
}
"""Classes of the solvers for equilibrium, by the names that a scene gives them."""
