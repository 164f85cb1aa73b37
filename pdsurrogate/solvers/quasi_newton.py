"""Quasi-Newton methods for equilibrium: on the residual, or on the energy."""

from collections import deque
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from ..forces import InvalidState
from .equilibrium import (
    Diverging,
    Equilibrium,
    EquilibriumSolver,
    check_growth,
    no_report,
)


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
    # Greatest number of points at which a body that is not slender keeps so many, and half of them
    # above: they are a fifth of what a large sheet takes. Chosen: with 6 sheets and blocks of any
    # size take up to a twentieth more evaluations.
    MANY = 100_000
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
        large = not self._slender and self.share.size > self.MANY
        history: deque = deque(maxlen=self.MEMORY // 2 if large else self.MEMORY)
        residuals = [residual]
        scale = 1.0
        while not settled:
            if preconditioner.update():
                history.clear()
            step = self._direction(preconditioner, forces, history, scale)
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
            scale *= self._rescaled(share, self.share.dot(step, forces), curvature)
            if share < self.MISJUDGED and history:
                # The tangent has changed, and the pairs mislead: they would propose one step after
                # another that is much too long.
                history.clear()
            # Below it rounding decides the sign.
            elif curvature > 1e-10 * np.sqrt(
                self.share.dot(step, step) * self.share.dot(change, change)
            ):
                # Pairs need no more digits than the forces, and are most of a solver's memory.
                pair = (values.astype(force.precision, copy=False) for values in (step, change))
                history.append((*pair, 1 / curvature))
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

    def _rescaled(self, share: float, work: float, curvature: float) -> float:
        """Return the factor by which the scale of the preconditioner changes after a step.

        Here it stays: a step that is too long shows in the pairs at once, and costs nothing.
        """
        return 1.0

    def _direction(self, preconditioner, forces, history, scale):
        """Return the next step (n, d) by the two-loop recursion of L-BFGS, with the preconditioner,
        times its `scale`, between the loops.

        `history` holds tuples (step, change of the forces, 1 divided by the inner product of both).
        """
        q = forces.copy()
        factors = []
        for step, change, rho in reversed(history):
            factor = rho * self.share.dot(step, q)
            q -= factor * change
            factors.append(factor)
        q = scale * preconditioner.solve(q) * self.free
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
    # The energy tells which steps are too long. Chosen: a corner, where the strain of a step grows
    # as the spacing falls, shortens every step of a block with 0.25: `plane-strain-block` with
    # 80,000 points takes 202 evaluations with 0.25, 135 with 0.35, 123 with 0.5 and 128 with 1.
    LARGEST_STRAIN = 0.5
    # Greatest factor by which one step changes the scale of the preconditioner; a greater change of
    # the slope is that of forces far from linear. Chosen: 1.25 and 4 take as many evaluations.
    RESCALED = 2.0
    # Fraction of the decrease of the energy by the slope that a step must reach (Armijo): the usual
    # value, which refuses few steps.
    SUFFICIENT = 1e-4
    # Rounding of the energy by precision of the pass, in units of shear modulus times volume: a
    # hundred times that of a single number.
    ROUNDING: ClassVar = {"float32": 1e-5, "float64": 1e-14}

    def _rescaled(self, share, work, curvature):
        """Return the factor by which the scale of the preconditioner changes after a step.

        `work` is the inner product of the forces with the step, of which the fraction `share` was
        accepted, and `curvature` that of their change. Where the tangent is stiffer than the
        preconditioner every step would be too long, and be shortened by a further evaluation. The
        scale follows the geometric mean of the step and of the length at which the slope vanishes,
        since the pairs of L-BFGS have a part in both.
        """
        if not (work > 0 and curvature > 0):
            return 1.0
        return float(np.clip(np.sqrt(share * work / curvature), 1 / self.RESCALED, self.RESCALED))

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
