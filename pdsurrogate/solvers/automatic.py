"""The method that suits a force, and the sure one where that fails."""

from dataclasses import replace

from ..forces import InvalidState
from .equilibrium import Diverging, Equilibrium, EquilibriumSolver, NotConverged, no_report
from .quasi_newton import EnergyMinimiser, QuasiNewton
from .stepping import DampedExplicit, DynamicRelaxation


class Automatic(EquilibriumSolver):
    """Choose energy minimisation for nearly incompressible bodies, else the quasi-Newton method, and dynamic relaxation if that fails.

    The preconditioner of the minimisation contains the bulk modulus, and its steps are long compared with the shear that corrects a change
    of volume: the energy, if the force has one, limits them. Bodies whose factor would exceed memory are relaxed from the outset. A faster
    method that has failed on a body is not tried there again, see `gave_up`.
    """

    name = "automatic"

    # 1.25 million points in pure shear: 130 s and 7 GiB, of which the factor needs some 3 kB per point.
    MOST_POINTS = 1_000_000

    # Most evaluations of relaxation, over the spacings in the body's extent, and at least.  It takes some tens for each of them where the
    # body is as thick as it is long, more where it is slender.
    RELAXED, LEAST_RELAXED = 100, 2_000

    _quick: EquilibriumSolver | None = None

    def __init__(self, *settings) -> None:
        super().__init__(*settings)
        self._settings, self._sure = settings, DynamicRelaxation(*settings)

    def preconditioner(self, force):
        return self._method(force).preconditioner(force)

    def _method(self, force) -> EquilibriumSolver:
        """Return the quicker method that suits the force."""
        if self._quick is None:
            self._quick = (EnergyMinimiser if force.nearly_incompressible and force.has_energy else QuasiNewton)(*self._settings)
            self.gave_up |= not force.nearly_incompressible and self.share.total(len(self.volumes)) > self.MOST_POINTS
        return self._quick

    def solve(self, force, positions, tolerance=None, report=no_report, least_drive=0.0) -> Equilibrium:
        quick = self._method(force)
        start, began = positions.copy(), force.evaluations
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
        found = self._sure.solve(force, positions, tolerance, report, least_drive)
        return replace(found, evaluations=force.evaluations - began)


SOLVERS = {solver.name: solver for solver in (Automatic, EnergyMinimiser, QuasiNewton, DynamicRelaxation, DampedExplicit)}
"""Methods for equilibrium by their names in a scene."""
