"""What every solver for equilibrium takes, gives and raises."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..forces import InternalForce
from ..kernels.steps import greatest_force_density
from .preconditioner import Preconditioner, preconditioner_of
from .reductions import LOCAL, LocalReductions
from .supports import SupportedPreconditioner

Report = Callable[[int, float], None]
"""Called with the force evaluations so far and the residual."""


def no_report(evaluations: int, residual: float) -> None:
    """Report to nobody."""


class NotConverged(RuntimeError):
    """The residual did not fall below the tolerance."""


class Diverging(RuntimeError):
    """The iteration blows up."""


class Unstable(RuntimeError):
    """An equilibrium that was found, but is not stable or not a continuation of the one before."""


class TooFar(RuntimeError):
    """An increment whose first guess strains the body more than a solver could put right."""


class RanAway(RuntimeError):
    """A body that loads carry far away within one increment, as they do beyond the greatest load that it bears."""


def told_of_zero_energy_modes(force: InternalForce, consequence: str) -> str:
    """What a message about a failure adds where the force has modes without energy; nothing where it has none."""
    if not force.zero_energy_modes:
        return ""
    others = "force=bond-energy" if force.body.dimension == 3 else "force=analytic or force=bond-energy"
    return f" (this force does not resist all displacements from point to point, {consequence}: {others} does)"


@dataclass(frozen=True)
class Equilibrium:
    """What a solver reached.

    Attributes
    ----------
    residual : float
        Largest force density over the free components, in units of shear modulus / spacing.
    evaluations : int
        Force evaluations it took.
    method : str
        Name of the method that found it.
    """

    residual: float
    evaluations: int
    method: str


class EquilibriumSolver(ABC):
    """A solver for equilibrium.

    Parameters
    ----------
    free : ndarray, shape (n, 2)
        1 where a component may move, 0 where it is held.
    volumes : ndarray, shape (n,)
    tolerance : float
        Of the residual, in units of shear modulus / spacing.
    most_evaluations : int
        Per call of `solve`.
    reductions : LocalReductions, optional
    """

    name: str
    needs_energy = False
    """Whether it works only with forces that have an energy."""
    gave_up = False
    """Whether a quicker method has been found to fail on this body: all that a solver remembers from one call to the next."""

    def __init__(
        self,
        free: np.ndarray,
        volumes: np.ndarray,
        tolerance: float = 1e-6,
        most_evaluations: int = 50_000,
        reductions: LocalReductions = LOCAL,
    ) -> None:
        self.free, self.volumes, self.reductions = free, volumes, reductions
        self.tolerance, self.most_evaluations = tolerance, most_evaluations
        self._preconditioner: Preconditioner | None = None

    @abstractmethod
    def solve(self, force: InternalForce, positions: np.ndarray, tolerance: float | None = None, report: Report = no_report) -> Equilibrium:
        """Bring `positions` to equilibrium, in place.

        Parameters
        ----------
        force : InternalForce
        positions : ndarray, shape (n, 2)
            A start; the equilibrium on return, and the last state reached if an error is raised.
        tolerance : float, optional
            Instead of the solver's own, for states on the way.
        report : callable
            Called every few evaluations.

        Raises
        ------
        NotConverged
            After `most_evaluations`.
        Diverging, InvalidState
            Where the start has no force, or the iteration leaves the states that have one even with small steps.
        """

    def preconditioner(self, force: InternalForce) -> Preconditioner:
        """What approximates the tangent of the force, made when it is first asked for."""
        if self._preconditioner is None:
            self._preconditioner = preconditioner_of(force, self.free, self.reductions)
            supports = getattr(force, "supports", None)
            if supports is not None:
                self._preconditioner = SupportedPreconditioner(self._preconditioner, supports, self.reductions)
        return self._preconditioner

    def residual(self, force: InternalForce, forces: np.ndarray) -> float:
        """Largest force density in units of shear modulus / spacing, see `InternalForce.force_scale`."""
        unit, volumes = force.force_scale, self.volumes
        if isinstance(unit, np.ndarray):  # several materials: every point by its own
            unit, volumes = 1.0, volumes * unit
        greatest = self.reductions.greatest_of_parts(greatest_force_density[forces.shape[1]](forces, self.free, volumes))
        return greatest * force.body.spacing / unit

    def not_converged(self, force: InternalForce, residual: float, evaluations: int, tolerance: float) -> NotConverged:
        """The error for a residual that is still too large."""
        reached = f"the residual is {residual:.2g} shear modulus / spacing after {evaluations} force evaluations; asked for {tolerance:.2g}"
        return NotConverged(reached + told_of_zero_energy_modes(force, "which then never come to rest"))
