"""Equilibrium as the least energy: preconditioned L-BFGS with a line search, for forces that have an energy."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from .quasi_newton import QuasiNewton


class EnergyMinimiser(QuasiNewton):
    """L-BFGS from the preconditioner that suits the force, each step along a direction in which the energy falls.

    A step is accepted if the energy falls enough or, if its change is lost in rounding, by a condition on the slope along the step.

    References
    ----------
    Nocedal, Math. Comput. 35 (1980) 773-782; Hager and Zhang, SIAM J. Optim. 16 (2005) 170-192 (the second condition).
    """

    name = "minimiser"
    NO_STEP = "no step along the direction of descent brings the energy down"
    needs_energy = True

    # Each step lowers the energy, so the method need not give up early.
    PATIENCE = 2_000
    SUFFICIENT = 1e-4
    # Rounding of the energy by precision of the pass, in units of shear modulus times volume.
    ROUNDING: ClassVar = {"float32": 1e-5, "float64": 1e-14}

    def _criterion(self, force, step, forces):
        slope, before = -self.share.dot(forces, step), self._energy(force)
        if slope >= 0:
            # Rounding has spoilt the curvature that was gathered: the preconditioned force itself is downhill.
            step[:] = self.preconditioner(force).solve(forces) * self.free
            self._bound(force, step)
            slope = -self.share.dot(forces, step)
        noise = self.ROUNDING[force.precision] * force.law.shear_modulus * self.share.sum(self.volumes)

        def accepts(following: np.ndarray, share: float) -> tuple[bool, float]:
            change, slope_there = self._energy(force) - before, -self.share.dot(following, step)
            falls = change <= self.SUFFICIENT * share * slope and -share * slope > noise
            accepted = falls or (change <= noise and slope_there <= (2 * self.SUFFICIENT - 1) * slope)
            # The slope vanishes at this share of the step if it changes evenly.
            return accepted, float(np.clip(slope / (slope - slope_there), 0.1, 0.5)) if slope_there > slope else 0.5

        return accepts

    def _energy(self, force) -> float:
        return self.share.total(force.energy())
