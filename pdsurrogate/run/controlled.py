"""Path of a stage in equilibrium along the displacement of a probe, at which the loading
parameter t is found (theory, section 27).
"""

import numpy as np

from ..problem import Stage
from ..scenes import SceneError
from ..scenes.loading import controlled_place
from ..solvers.bond_strains import strain_of_step
from ..solvers.control import ControlledForce, DisplacementControl
from ..solvers.increments import Increments
from .run import Run
from .system import System

METHODS = ("automatic", "newton")
"""Methods that a scene with a controlled step may name: the solver of this step is Newton's
method.
"""


class DisplacementPath:
    """Values of the displacement of a probe between two outputs: increments, first guesses, and the
    force and the solver at each value.

    It has the attributes and methods of `ParameterPath`; `target` is a displacement.

    Parameters
    ----------
    run : Run
    stage : Stage
        Stage with a `control`.
    """

    def __init__(self, run: Run, stage: Stage) -> None:
        spec = run.problem.scene.solver
        self.solver = DisplacementControl(
            control_of(run, stage.control),
            run.loading.free,
            run.body.volumes,
            spec.tolerance,
            spec.most_evaluations,
        )
        self._run, self._stage, self._force = run, stage, self.solver.controlled(run.loaded)

    def parameter_at(self, goal: float) -> float:
        return self._run.state.parameter

    def increments_to(self, goal: float, time: float) -> Increments:
        begin = self._value(self._run.positions)
        strain = strain_of_step(self._run.body, self._along())
        largest = self._run.problem.scene.solver.largest_increment / strain
        largest = min(self._stage.largest_increment or np.inf, largest)
        return Increments(begin, goal, largest, time)

    def at(self, value: float) -> str:
        return f"{self._stage.control} = {value:g}"

    def last(self) -> str:
        return (
            f"{self.at(self._value(self._run.positions))}"
            f" ({self._run.loading.at(self._run.state.parameter)})"
        )

    def guesses(self, target: float) -> list[np.ndarray]:
        run = self._run
        value = self._value(self._run.positions)
        along = self._along()
        guesses = [run.positions + (target - value) * along]
        if run.earlier is not None and (before := self._value(run.earlier[1])) != value:
            guess = run.positions + (target - value) / (value - before) * (
                run.positions - run.earlier[1]
            )
            guesses.append(guess + (target - self._value(guess)) * along)
        return guesses

    def force_at(self, target: float, positions: np.ndarray) -> ControlledForce:
        self._run.loading.apply(self._run.state.parameter, self._run.loaded, positions)
        return self._force

    def reached(self, target: float) -> float:
        return self.solver.factor

    def check_branch(self, reached: float, guess: np.ndarray) -> None:
        self._run.loading.check_inside(reached, self._run.loaded, self._run.positions)

    def least_drive(self, target: float) -> float:
        return self._run.state.greatest_drive or np.inf if target == 0 else 0.0

    def _value(self, positions: np.ndarray) -> float:
        """Return the controlled displacement at positions (n, d)."""
        return displacement_of(self._run, self._stage.control, positions)

    def _along(self) -> np.ndarray:
        """Return the displacements (n, d) in which the controlled one changes by 1 from the
        present equilibrium, by the preconditioner.
        """
        run = self._run
        self._force(run.positions, np.empty_like(run.positions))
        self._force.update()
        found = self._force.along()
        run.loading.apply(run.state.parameter, run.loaded, run.positions)
        return found


def prepare(run: Run) -> None:
    """Change a run with controlled stages to double precision, which products of the tangent need.

    Raises
    ------
    SceneError
        If the run cannot have double precision, or has several ranks, or if its scene names another
        solver.
    """
    key = next((stage.key for stage in run.stages if stage.control is not None), None)
    if key is None:
        return
    method = run.problem.scene.solver.method
    if run.ranks.size > 1:
        raise SceneError(
            f"scene {run.problem.scene.name}: {key} is supported on one rank only; run without"
            " mpiexec"
        )
    if method not in METHODS:
        raise SceneError(
            f"scene {run.problem.scene.name}: {key} needs solver.method={' or '.join(METHODS)}, not"
            f" {method}"
        )
    if run.takes_double():
        run.take_double()
    if run.force.precision != "float64":
        why = (
            f"{run.model.name} has none"
            if run.problem.settings.precision is None
            else "the scene sets precision=float32"
        )
        raise SceneError(
            f"scene {run.problem.scene.name}: {key} needs forces in double precision, but {why}"
        )


def control_of(system: System, control: str) -> np.ndarray:
    """Return the weights (n, d) of the displacements of the points in a displacement that a
    stage controls, by its key.
    """
    name, axis = controlled_place(control)
    weights = np.zeros_like(system.body.points)
    weights[:, axis] = system.probes.weights(name, axis)
    return weights


def displacement_of(system: System, control: str, positions: np.ndarray) -> float:
    """Return the displacement that a stage controls, by its key, at positions (n, d) of the
    points.
    """
    name, axis = controlled_place(control)
    found = system.probes.displacements(positions - system.body.points, system.loads.planes_moved)
    return found[name]["displacement"][axis]
