"""Body in a state under the conditions of its scene, with the forces on it: what a run advances,
and what derivatives and modes are taken of.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from ..body import Body
from ..forces import ForceModel, InternalForce
from ..forces.internal_force import dissipated_by, numbers_in_place
from ..problem import Problem
from ..problem.materials import scene_errors
from ..ranks import Communicator
from ..results import measures
from ..scenes import Scene
from ..solvers.conditions import Loading
from ..solvers.loaded_force import LoadedForce
from ..solvers.loads import Loads
from .state import State


@dataclass
class System:
    """Body in a state under the conditions of a problem, with the forces on it.

    Attributes
    ----------
    problem : Problem
    force : InternalForce
    loaded : LoadedForce
        Force that the solvers for equilibrium evaluate: `force` plus loads, supports at places
        between points, and rigid regions, if any.
    probes : Probes
    positions : ndarray, shape (n, d)
    state : State
        Number of the present stage, loading parameter and recorded numbers, as stored in
        checkpoints.
    """

    problem: Problem
    force: InternalForce
    loaded: LoadedForce
    probes: measures.Probes
    positions: np.ndarray
    state: State

    @property
    def body(self) -> Body:
        """Part of the body on this rank."""
        return self.problem.body

    @property
    def loading(self) -> Loading:
        """Conditions of the problem."""
        return self.problem.loading

    @property
    def loads(self) -> Loads:
        """Loads of the problem."""
        return self.problem.loading.loads

    @property
    def ranks(self) -> Communicator:
        """Ranks that share the body."""
        return self.body.share.ranks

    @property
    def measures_cracks(self) -> bool:
        """Whether the results have energy release rates: of a body with precuts, whose force has
        an energy.
        """
        return bool(self.problem.scene.precuts) and self.force.has_energy

    def strain_energy(self) -> float:
        """Return the body's strain energy in the state last evaluated, in two dimensions per
        unit thickness (`measures.strain_energy`).
        """
        return self.body.share.total(measures.strain_energy(self.force))

    def dissipated_energy(self) -> dict[str, float]:
        """Return the energy that the materials have dissipated since the body was at rest, by its
        cause, "branches" or "softening"; empty without memory.
        """
        total = self.body.share.total
        return {cause: total(energy) for cause, energy in dissipated_by(self.force).items()}

    def place(self, positions: np.ndarray) -> None:
        """Bring the body to positions (n, d), with its supports and loads in their places."""
        self.positions[:] = positions
        self.loading.apply(self.state.parameter, self.loaded, self.positions)

    def beside(self, scene: Scene, models: Sequence[ForceModel], parameter: float) -> "System":
        """Return a system of the same body, in double precision, at a value of the loading
        parameter, for a scene as in `Problem.changed`.
        """
        problem = self.problem.changed(scene, models)
        return self._of(problem, *problem.bind("float64"), parameter)

    def _of(
        self, problem: Problem, force: InternalForce, loaded: LoadedForce, parameter: float
    ) -> "System":
        positions = self.positions.copy()
        state = State(parameter, parameter)
        problem.loading.loads.pushes[:] = self.loads.pushes
        return System(problem, force, loaded, self.probes, positions, state)

    @contextmanager
    def lending_force(
        self, scene: Scene, models: Sequence[ForceModel], parameter: float
    ) -> Iterator["System"]:
        """Provide a system as `beside` returns, which has the force of this one with other numbers
        until the end of a ``with`` block.

        It binds a force of its own if the points of the materials differ, as where a change makes
        two like materials different.
        """
        problem = self.problem.changed(scene, models)
        numbers = np.arange(len(self.body))
        theirs, ours = (
            [numbers[portion.points] for portion in portions]
            for portions in (problem.portions, self.force.portions)
        )
        if len(theirs) != len(ours) or not all(map(np.array_equal, theirs, ours)):
            yield self._of(problem, *problem.bind("float64"), parameter)
            return
        loading = problem.loading
        loaded = LoadedForce(self.force, loading.loads, loading.supports, self.loaded.rigid)
        with numbers_in_place(
            self.force, [(portion.law, portion.model) for portion in problem.portions]
        ):
            yield self._of(problem, self.force, loaded, parameter)


def bound(problem: Problem, precision: str | None = None) -> System:
    """Return a problem with its force, at rest; `precision` is one in place of the scene's."""
    force, loaded = problem.bind(precision)
    portion_of = force.portion_of
    share = problem.body.share
    if portion_of is not None:  # of the whole body
        portion_of = share.ranks.to_all(share.gather(portion_of[: len(problem.body)]))
    with scene_errors(problem.scene):
        probes = measures.Probes(problem.whole, problem.scene.probes, portion_of, share)
    rest = problem.loading.rest
    return System(problem, force, loaded, probes, problem.body.points.copy(), State(rest, rest))
