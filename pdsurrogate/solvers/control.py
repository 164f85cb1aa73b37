"""Equilibrium at a prescribed displacement of a place, with the factor of the loads as a further
unknown (theory, section 27).
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ..forces import InvalidState
from .equilibrium import Diverging, Equilibrium, EquilibriumSolver, no_report
from .loaded_force import LoadedForce
from .nearest_bonds import Preconditioner
from .tangent import TangentEquations

BALANCED = 1e-13
MOST_SECANTS = 20
"""Sum of weighted forces that is left, relative to that of the internal forces, where the factor of
the loads is found; and greatest number of secants. Chosen: a hundred roundings; dead loads need one
secant, pressures on the deformed thickness some five.
"""


class ControlledForce(LoadedForce):
    """Force of a body whose loads have the factor t at which a weighted sum of the forces on free
    components vanishes, theory (82).

    The loads must be proportional to t, and nothing else may depend on t. In its tangent, too, the
    factor of the loads changes.

    Parameters
    ----------
    loaded : LoadedForce
    free : ndarray, shape (n, d)
        1 where a component may move, 0 where it is held.
    control : ndarray, shape (n, d)
        Weights of the displacements of the points in the controlled displacement.
    inner : Preconditioner
        Approximation of the tangent of the loaded force.

    Attributes
    ----------
    factor : float
        Value of t in the state last evaluated.
    """

    def __init__(
        self,
        loaded: LoadedForce,
        free: np.ndarray,
        control: np.ndarray,
        inner: Preconditioner,
        weights: np.ndarray | None = None,
    ) -> None:
        super().__init__(loaded.internal, loaded.loads, loaded.supports, loaded.rigid)
        self.has_energy = False
        self.no_energy_because = "the loads depend on the displacements in displacement control"
        self._free = free
        self._control = control * free
        self._inner = inner
        self._dot = loaded.body.share.dot
        self._weights = weights
        self._unit = np.zeros_like(control)
        self.factor = 0.0

    def beside(self, loaded: LoadedForce) -> ControlledForce:
        """Return another loaded force of the same body with the factor of its loads as an
        unknown, with the weights of this one.
        """
        return ControlledForce(loaded, self._free, self._control, self._inner, self._weights)

    def __call__(self, positions: np.ndarray, out: np.ndarray) -> None:
        """Write internal force plus loads at positions (n, d) to `out` (n, d), as `LoadedForce`
        does, and find the factor of the loads.

        Raises
        ------
        InvalidState
            As for `LoadedForce`, and if the loads do no work on the controlled displacement.
        """
        self.loads.set(0.0)
        super().__call__(positions, out)
        if self._weights is None:
            self.update()
        force = self._dot(self._weights, out)
        # Secants, since the thickness on which a pressure acts depends on the pressure a little;
        # for other loads the first one is exact.
        last, self.factor, self._unit = (0.0, force), 1.0, self._loads_at(1.0)
        applied = self._unit
        for _ in range(MOST_SECANTS):
            here = self.factor, force + self._dot(self._weights, applied)
            if abs(here[1]) <= BALANCED * abs(force):
                break
            slope = (here[1] - last[1]) / (here[0] - last[0])
            if not (np.isfinite(slope) and slope):
                raise InvalidState("the loads do not change the controlled displacement")
            last = here
            self.factor = here[0] - here[1] / slope
            applied = self._loads_at(self.factor)
        else:
            raise InvalidState("no factor of the loads balances the controlled displacement")
        if self.factor:
            self._unit = applied / self.factor
        out += applied

    def _loads_at(self, factor: float) -> np.ndarray:
        """Set the loads to a factor, and return their forces on the points (n, d)."""
        self.loads.set(factor)
        found = self.applied()
        for support in self.supports:
            support.fold(found)
        return found

    def update(self) -> bool:
        """Adapt the preconditioner and the weights to the state last evaluated, see
        `Preconditioner`.
        """
        changed = self._inner.update()
        self._weights = self._inner.solve(self._control) * self._free
        return changed

    def bordered(self, forces: np.ndarray) -> np.ndarray:
        """Return the displacements (n, d) under forces (n, d) and a change of t that leaves the
        controlled displacement as it is.
        """
        moved = self._inner.solve(forces) * self._free
        along = self.along()
        return moved - self._dot(self._control, moved) * along

    def equations(self, positions: np.ndarray) -> TangentEquations:
        """Return the linear equations at positions (n, d) for displacements that leave the
        controlled one as it is.
        """
        return TangentEquations(
            self, positions, self._free, Preconditioner(self.bordered, self.update)
        )

    def along(self) -> np.ndarray:
        """Return the displacements (n, d) under a change of t at which the controlled
        displacement is 1, by the preconditioner.
        """
        moved = self._inner.solve(self._unit * self._free) * self._free
        return moved / self._dot(self._control, moved)


class DisplacementControl(EquilibriumSolver):
    """Solver for equilibrium at a given displacement of a place: Newton's method, whose steps do
    not change this displacement.

    The equilibrium of loads that fall while the body deforms further, beyond a limit load, is
    stable under this constraint. Products of the tangent are differences of forces, so the force
    must be in double precision, and the body on one rank.

    Parameters
    ----------
    control : ndarray, shape (n, d)
        As for `ControlledForce`.
    settings
        As for `EquilibriumSolver`.

    Attributes
    ----------
    factor : float
        Factor of the loads in the equilibrium found last.

    References
    ----------
    Batoz and Dhatt, Int. J. Numer. Methods Eng. 14 (1979) 1262-1267.
    """

    name = "displacement-control"
    needs_tangent = True

    # Permitted residual of the linear equations of an iteration, divided by the forces on free
    # points: far from equilibrium their solution need not be better than the linearization.
    SHARE_LEFT = 1e-2

    # Least fraction of a step that is tried, and greatest number of iterations: usual are the whole
    # step, and three to six.
    LEAST_STEP = 1 / 16
    MOST = 30
    IDLE = 5

    def __init__(self, control: np.ndarray, *settings) -> None:
        super().__init__(*settings)
        self._control = control
        self.factor = np.nan

    def controlled(self, force: LoadedForce) -> ControlledForce:
        """Return a loaded force with the factor of its loads as an unknown."""
        return ControlledForce(force, self.free, self._control, self.preconditioner(force))

    def solve(
        self, force, positions, tolerance=None, report=no_report, least_drive=0.0
    ) -> Equilibrium:
        tolerance = tolerance or self.tolerance
        began = force.evaluations
        controlled = self.controlled(force)
        forces = np.empty_like(positions)
        trial = np.empty_like(positions)
        self.begin(force, least_drive)
        self.evaluate(controlled, positions, forces)
        residual, settled = self.judge(controlled, forces, tolerance)
        for _ in range(self.MOST):
            if settled:
                self.factor = controlled.factor
                return Equilibrium(residual, force.evaluations - began, self.name, self._drive)
            equations = controlled.equations(positions)
            step = equations.displacements(forces, self.SHARE_LEFT)
            size = float(np.linalg.norm(forces))
            share = 1.0
            self._bound(force, step)
            while True:
                np.multiply(step, share, out=trial)
                trial += positions
                with suppress(InvalidState):
                    self.evaluate(controlled, trial, forces)
                    if float(np.linalg.norm(forces)) < size:
                        break
                share /= 2
                if share < self.LEAST_STEP:
                    raise Diverging(
                        f"a step of Newton's method does not reduce the residual of {residual:.2g}"
                    )
            positions[:] = trial
            residual, settled = self.judge(controlled, forces, tolerance)
            report(force.evaluations - began, residual)
        raise self.not_converged(force, residual, force.evaluations - began, tolerance)
