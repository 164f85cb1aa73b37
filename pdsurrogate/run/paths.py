"""Path of a stage in equilibrium along the loading parameter, which its increments change from
one output to the next.
"""

from dataclasses import dataclass

import numpy as np

from ..problem import Stage
from ..solvers.equilibrium import EquilibriumSolver
from ..solvers.increments import Increments
from ..solvers.loaded_force import LoadedForce
from ..solvers.stability import check_branch
from .run import Run


@dataclass(eq=False)
class ParameterPath:
    """Values of the loading parameter between two outputs: increments, first guesses, and the force
    and the solver at each value.

    Parameters
    ----------
    run : Run
    stage : Stage
    solver : EquilibriumSolver
    largest_strain : float
        Greatest strain of a bond by a planned increment.
    """

    run: Run
    stage: Stage
    solver: EquilibriumSolver
    largest_strain: float = np.inf

    def parameter_at(self, goal: float) -> float:
        """Return the loading parameter of the output at the end `goal` of a path, as far as it
        is known before the equilibrium is found.
        """
        return goal

    def increments_to(self, goal: float, time: float) -> Increments:
        """Return the increments from the present equilibrium to the next output, which take a
        `time`.
        """
        run = self.run
        begin = self.run.state.parameter
        return Increments(
            begin,
            goal,
            self.run.loading.course.largest_increment(
                run.positions,
                begin,
                goal,
                self.stage.largest_increment,
                self.largest_strain,
            ),
            time,
        )

    def at(self, value: float) -> str:
        """Return a value of what the increments change, with its name, as text for messages."""
        return self.run.loading.at(value)

    def last(self) -> str:
        """Return the place of the last equilibrium on the path, as text for messages."""
        return self.at(self.run.state.parameter)

    def guesses(self, target: float) -> list[np.ndarray]:
        """Return first guesses (n, d) of the equilibrium at the end `target` of an increment."""
        return self.run.loading.course.guesses(
            self.run.positions, self.run.state.parameter, target, self.run.earlier
        )

    def force_at(self, target: float, positions: np.ndarray) -> LoadedForce:
        """Return the force at the end of an increment, with the held parts in their places, also
        those in `positions` (n, d).
        """
        self.run.loading.apply(target, self.run.loaded, positions)
        return self.run.loaded

    def reached(self, target: float) -> float:
        """Return the loading parameter of the equilibrium that was just found at the end of an
        increment.
        """
        return target

    def check_branch(self, reached: float, guess: np.ndarray) -> None:
        """Raise an error if the equilibrium at the parameter `reached` is unstable, or does not
        continue the last one.
        """
        run = self.run
        check_branch(
            run.loading, run.loaded, self.solver, run.state.parameter, reached, guess, run.positions
        )

    def least_drive(self, target: float) -> float:
        """Return the least driving force for the criterion of convergence, see
        `EquilibriumSolver.solve`.
        """
        return self.run.state.greatest_drive or np.inf if self.run.loading.at_rest(target) else 0.0
