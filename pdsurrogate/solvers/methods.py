"""Methods for equilibrium: quasi-Newton on the residual or on the energy, dynamic relaxation,
damped explicit stepping, Newton's.

`Automatic` chooses among the first three. The explicit stepping is the method of the paper that
`pdsurrogate.paper` reproduces.
"""

import math
from abc import abstractmethod
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import ClassVar

import numpy as np

from ..forces import InternalForce, InvalidState
from ..kernels.steps import central_difference_step, rayleigh_parts, relaxation_step
from .equilibrium import (
    Diverging,
    Equilibrium,
    EquilibriumSolver,
    NotConverged,
    TooSmall,
    check_growth,
    falls,
    no_report,
    window_of,
)
from .preconditioner import with_short_displacements
from .stability import FrequencyEstimate
from .tangent import TangentEquations


class QuasiNewton(EquilibriumSolver):
    """Quasi-Newton method for equilibrium: preconditioned L-BFGS on the residual force, which needs
    no energy.

    The force map is not the gradient of an energy, so that no line search on an energy is possible:
    steps are bounded by the stretch that they cause and shortened if the residual grows. If the
    tangent is far from symmetric, or has zero-energy modes that the preconditioner, a network of
    springs, resists (`NOSBForce`), the method fails with an error within a bounded number of
    evaluations.

    References
    ----------
    Nocedal, Math. Comput. 35 (1980) 773-782.
    """

    name = "quasi-newton"
    NO_STEP = "no step along the quasi-Newton direction brings the residual down"

    # Pairs of steps and changes that L-BFGS keeps; 3 to 20 are usual. Chosen: slender bodies that
    # bend take a tenth to a third more evaluations with 6, and the work on 12 pairs is below a
    # hundredth of that of an evaluation in space.
    MEMORY = 12
    # Fraction of a step below which the kept pairs are dropped if no longer step is accepted.
    # Chosen: bent sheets (4 to 8 points across) take 44 to 79 evaluations with 0.2, 44 to 90
    # without dropping, and 53 to 121 with 0.3; with 0.6 some do not converge.
    MISJUDGED = 0.2
    # Accepted growth of the residual's norm: from a rough start it need not fall in every step. A
    # greater one accepts steps that diverge.
    MOST_GROWTH = 2.0
    # Least fraction of a step that is tried, after some thirteen halvings: a suitable direction
    # does not need a shorter one.
    LEAST_STEP = 1e-4
    # Evaluations after which a suitable method has converged, as it does in 20 to 60, or still
    # gains, as on slender bodies that bend: the least residual of the last `WINDOW` steps is then
    # below a tenth of that of the `WINDOW` steps before.
    PATIENCE = 250
    WINDOW = 100
    IDLE = WINDOW

    def solve(
        self, force, positions, tolerance=None, report=no_report, least_drive=0.0
    ) -> Equilibrium:
        tolerance = tolerance or self.tolerance
        began = force.evaluations
        preconditioner = self.preconditioner(force)
        forces = np.empty_like(positions)
        trial = np.empty_like(positions)
        self.begin(force, least_drive)
        self.evaluate(force, positions, forces)
        residual, settled = self.judge(force, forces, tolerance)
        history: deque = deque(maxlen=self.MEMORY)
        residuals = [residual]
        while not settled:
            if preconditioner.update():
                history.clear()
            step = self._direction(preconditioner, forces, history)
            self._bound(force, step)
            try:
                following, share = self._advance(force, positions, step, forces, trial)
            except Diverging:
                if self.least_left == np.inf:  # the forces left are more than rounding errors
                    raise
                self.evaluate(force, positions, forces)
                break
            change = forces - following
            residual, settled = self.judge(force, following, tolerance)
            evaluations = force.evaluations - began
            curvature = self.share.dot(step, change)
            if share < self.MISJUDGED and history:
                # The tangent has changed, and the pairs mislead: they would propose one step after
                # another that is much too long.
                history.clear()
            # Below it rounding decides the sign.
            elif curvature > 1e-10 * np.sqrt(
                self.share.dot(step, step) * self.share.dot(change, change)
            ):
                history.append((step, change, 1 / curvature))
            forces = following
            report(evaluations, residual)
            residuals.append(residual)
            check_growth(residuals[0], residual)
            before = residuals[-2 * self.WINDOW : -self.WINDOW]
            now = residuals[-self.WINDOW :]
            lost = evaluations >= self.PATIENCE and not min(now) < 0.1 * min(before, default=0.0)
            if not settled and (lost or evaluations >= self.most_evaluations):
                raise self.not_converged(force, residual, evaluations, tolerance)
        return Equilibrium(residual, force.evaluations - began, self.name, self._drive)

    def _advance(self, force, positions, step, forces, trial):
        """Move `positions` by the longest accepted fraction of a step, scale `step` by it in place,
        and return the new forces and it.

        `forces` (n, d) are those before the step, and `trial` (n, d) is overwritten.
        """
        accepts = self._criterion(force, step, forces)
        following = np.empty_like(forces)
        share = 1.0
        while share >= self.LEAST_STEP:
            np.multiply(step, share, out=trial)
            trial += positions
            shorter = 0.5
            try:
                self.evaluate(force, trial, following)
                accepted, shorter = accepts(following, share)
                if accepted:
                    step *= share
                    positions[:] = trial
                    return following, share
            except InvalidState:
                pass
            share *= shorter
        raise Diverging(self.NO_STEP)

    def _criterion(self, force, step, forces) -> Callable[[np.ndarray, float], tuple[bool, float]]:
        """Return a function ``accepts(following, share)`` that decides whether to accept the
        fraction `share` of a step.

        `forces` (n, d) are those before the step and `following` those after this fraction. The
        function returns whether to accept it, and the factor by which to shorten it otherwise. Here
        it accepts if the norm of the forces grows at most `MOST_GROWTH` times, or not at all if
        other places touch an obstacle then: they would touch it and leave it in turn.
        """
        square = self.share.dot(forces, forces)
        touched = force.touching() if force.obstacles else None

        def accepts(following: np.ndarray, share: float) -> tuple[bool, float]:
            same = touched is None or np.array_equal(force.touching(), touched)
            most = self.MOST_GROWTH if same else 1.0
            return self.share.dot(following, following) <= most**2 * square, 0.5

        return accepts

    def _direction(self, preconditioner, forces, history):
        """Return the next step (n, d) by the two-loop recursion of L-BFGS, with the preconditioner
        between the loops.

        `history` holds tuples (step, change of the forces, 1 divided by the inner product of both).
        """
        q = forces.copy()
        factors = []
        for step, change, rho in reversed(history):
            factor = rho * self.share.dot(step, q)
            q -= factor * change
            factors.append(factor)
        q = preconditioner.solve(q) * self.free
        for (step, change, rho), factor in zip(history, reversed(factors), strict=True):
            q += (factor - rho * self.share.dot(change, q)) * step
        return q


class EnergyMinimizer(QuasiNewton):
    """Minimization of the energy for equilibrium: preconditioned L-BFGS, with steps that lower the
    energy.

    A step is accepted if the energy falls enough or, if its change is lost in rounding, by a
    condition on the slope along the step.

    References
    ----------
    Nocedal, Math. Comput. 35 (1980) 773-782; Hager and Zhang, SIAM J. Optim. 16 (2005) 170-192 (the
    second condition).
    """

    name = "minimizer"
    NO_STEP = "no step along the direction of descent brings the energy down"
    needs_energy = True

    # Each step lowers the energy, so the method need not give up before a run gives up an
    # increment.
    PATIENCE = 2_000
    IDLE = EquilibriumSolver.IDLE
    # Fraction of the decrease of the energy by the slope that a step must reach (Armijo): the usual
    # value, which refuses few steps.
    SUFFICIENT = 1e-4
    # Rounding of the energy by precision of the pass, in units of shear modulus times volume: a
    # hundred times that of a single number.
    ROUNDING: ClassVar = {"float32": 1e-5, "float64": 1e-14}

    def _criterion(self, force, step, forces):
        slope = -self.share.dot(forces, step)
        before = self._energy(force)
        if slope >= 0:
            # Rounding has spoiled the curvature that was gathered: the preconditioned force itself
            # is downhill.
            step[:] = self.preconditioner(force).solve(forces) * self.free
            self._bound(force, step)
            slope = -self.share.dot(forces, step)
        noise = (
            self.ROUNDING[force.precision] * force.law.shear_modulus * self.share.sum(self.volumes)
        )

        def accepts(following: np.ndarray, share: float) -> tuple[bool, float]:
            change = self._energy(force) - before
            slope_there = -self.share.dot(following, step)
            falls = change <= self.SUFFICIENT * share * slope and -share * slope > noise
            accepted = falls or (
                change <= noise and slope_there <= (2 * self.SUFFICIENT - 1) * slope
            )
            # The slope vanishes at this share of the step if it changes evenly.
            return accepted, (
                float(np.clip(slope / (slope - slope_there), 0.1, 0.5))
                if slope_there > slope
                else 0.5
            )

        return accepts

    def _energy(self, force) -> float:
        return self.share.total(force.energy())


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
                if residual <= tolerance:
                    raise TooSmall(
                        "the forces that drive the body are too small for single precision"
                    )
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
    it, and the energy, if the force has one, limits them. Bodies whose factorization would exceed
    memory are relaxed from the outset. A faster method that has failed on a body is not tried there
    again (see `gave_up`).
    """

    name = "automatic"

    # 1.25 million points in pure shear: 130 s and 7 GiB, of which the factor needs some 3 kB per
    # point. A little less is allowed.
    MOST_POINTS = 1_000_000

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
            self.gave_up |= (
                not force.nearly_incompressible
                and self.share.total(len(self.volumes)) > self.MOST_POINTS
            )
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
