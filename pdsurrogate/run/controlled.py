"""Stage in equilibrium that prescribes the displacement of a probe and finds the loading parameter t (theory, section 27)."""

import numpy as np

from ..problem import Stage
from ..results.checkpoint import Checkpoint
from ..scenes import SceneError
from ..scenes.loading import controlled_place
from ..solvers.control import ControlledForce, DisplacementControl
from ..solvers.equilibrium import EquilibriumSolver
from ..solvers.increments import Increments
from ..solvers.nearest_bonds import strain_of_step
from .levels import Equilibria
from .run import Run

METHODS = ("automatic", "newton")
"""Methods that a scene with a controlled step may name: the solver of this step is Newton's method."""


class Controlled(Equilibria):
    """Stage in equilibrium whose increments change the displacement of a probe instead of the loading parameter.

    Parameters
    ----------
    run : Run
    stage : Stage
        Stage with a `control`.
    solver : EquilibriumSolver
        Solver of the stages without control.
    """

    def __init__(self, run: Run, stage: Stage, solver: EquilibriumSolver) -> None:
        spec, self._control = run.problem.scene.solver, _control_of(run, stage)
        controlled = DisplacementControl(self._control, run.loading.free, run.body.volumes, spec.tolerance, spec.most_evaluations)
        super().__init__(run, stage, controlled)
        self.solver.gave_up, self._others = solver.gave_up, solver
        self._force = controlled.controlled(run.loaded)
        self._largest_strain = spec.largest_increment

    def resume(self, checkpoint: Checkpoint) -> None:
        super().resume(checkpoint)
        self._others.gave_up = self.solver.gave_up

    def _target(self, goal: float) -> float:
        return self.run.state.parameter

    def _increments_to(self, target: float) -> Increments:
        begin = self._value(self.run.positions)
        strain = strain_of_step(self.run.body, self._along())
        return Increments(begin, target, min(self.stage.largest_increment or np.inf, self._largest_strain / strain))

    def _guesses(self, target: float) -> list[np.ndarray]:
        run, value = self.run, self._value(self.run.positions)
        along = self._along()
        guesses = [run.positions + (target - value) * along]
        if run.earlier is not None and (before := self._value(run.earlier[1])) != value:
            guess = run.positions + (target - value) / (value - before) * (run.positions - run.earlier[1])
            guesses.append(guess + (target - self._value(guess)) * along)
        return guesses

    def _force_at(self, target: float, positions: np.ndarray) -> ControlledForce:
        super()._force_at(self.run.state.parameter, positions)
        return self._force

    def _reached(self, target: float) -> float:
        return self.solver.factor

    def _check_branch(self, reached: float, guess: np.ndarray) -> None:
        self.run.loading.check_inside(reached, self.run.loaded, self.run.positions)

    def _least_drive(self, target: float) -> float:
        return self.run.state.greatest_drive or np.inf if target == 0 else 0.0

    def _record_reached(self) -> None:
        """Record nothing further: the outputs before the failure tell how far the displacement was followed."""

    def _at(self, value: float) -> str:
        return f"{self.stage.control} = {value:g}"

    def _last(self) -> str:
        return f"{self._at(self._value(self.run.positions))} ({self.run.loading.at(self.run.state.parameter)})"

    def _value(self, positions: np.ndarray) -> float:
        """Return the controlled displacement at positions (n, d)."""
        return float(np.vdot(self._control, positions - self.run.body.points))

    def _along(self) -> np.ndarray:
        """Return the displacements (n, d) in which the controlled one changes by 1 from the present equilibrium, by the preconditioner."""
        self._force(self.run.positions, np.empty_like(self.run.positions))
        self._force.update()
        found = self._force.along()
        self.run.loading.apply(self.run.state.parameter, self.run.loaded, self.run.positions)
        return found


def prepare(run: Run) -> None:
    """Change a run with controlled stages to double precision, which products of the tangent need.

    Raises
    ------
    SceneError
        If the run cannot have double precision, or has several ranks, or if its scene names another solver.
    """
    key = next((stage.key for stage in run.stages if stage.control is not None), None)
    if key is None:
        return
    method = run.problem.scene.solver.method
    if run.ranks.size > 1:
        raise SceneError(f"scene {run.problem.scene.name}: {key} is supported on one rank only; run without mpiexec")
    if method not in METHODS:
        raise SceneError(f"scene {run.problem.scene.name}: {key} needs solver.method={' or '.join(METHODS)}, not {method}")
    if run.takes_double():
        run.take_double()
    if run.force.precision != "float64":
        why = f"{run.model.name} has none" if run.problem.settings.precision is None else "the scene sets precision=float32"
        raise SceneError(f"scene {run.problem.scene.name}: {key} needs forces in double precision, but {why}")


def _control_of(run: Run, stage: Stage) -> np.ndarray:
    """Return the weights (n, d) of the displacements of the points in the displacement that a stage controls."""
    name, axis = controlled_place(stage.control)
    weights = np.zeros_like(run.body.points)
    weights[:, axis] = run.probes.weights(name)[axis].toarray()[0]
    return weights


def displacement_of(run: Run, stage: Stage) -> float:
    """Return the displacement that a stage controls, at the present positions of a run."""
    return float(np.vdot(_control_of(run, stage), run.positions - run.body.points))
