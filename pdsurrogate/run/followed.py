"""Derivatives through the history of a body that remembers (theory, section 30): every increment
of the run is differentiated before the history takes it.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..engine.threads import thread_count
from ..forces import ForceModel
from ..scenes import Scene
from .differentiated import Differentiated
from .parameters import numbers_in
from .run import Run
from .sensitivity import Jacobian, present_jacobian
from .stages import go, ready


class _Followed(Exception):
    """The last output whose derivatives are wanted was reached."""


class FollowedRun(Run):
    """Run of a scene in double precision, whose equilibria are found by Newton's method and
    differentiated.

    Parameters
    ----------
    scene : Scene
    models : sequence of ForceModel
        As of `Run`.
    """

    def __init__(self, scene: Scene, models: Sequence[ForceModel]) -> None:
        scene = scene.model_copy(update={"precision": "float64"})
        super().__init__(scene, models)
        if any(law.memory.thinning for law, _ in self.force.laws):
            raise ValueError(
                "relaxation times that depend on the overstress have no derivatives; give branches"
                " constant times"
            )
        self.followed = Differentiated(self, numbers_in(scene, models), history={})
        solver = {"method": "newton", "tolerance": self.followed.balanced}
        scene = scene.model_copy(update={"solver": scene.solver.model_copy(update=solver)})
        self.problem = replace(self.problem, scene=scene)

    def follow(
        self,
        outputs: Sequence[str],
        parameters: Sequence[str],
        last: int,
        measuring: Callable[[Differentiated], Differentiated] = lambda body: body,
    ) -> list[Jacobian]:
        """Return the measurements of all outputs up to the number `last`, counted from 0, with
        their derivatives, see `jacobian` in `run/sensitivity.py`.

        ``measuring(body)`` returns a body with places that are measured besides the outputs.

        Raises
        ------
        NoEquilibrium, InvalidState
            If an increment has no equilibrium, or its tangent is nearly singular.
        """
        before = np.cumsum([0, *(stage.outputs for stage in self.stages)])[:-1]
        self.stages = self.stages[: np.count_nonzero(before <= last)]  # no dynamics follow
        for stage in self.stages:
            if stage.control or stage.inertia:
                raise ValueError(
                    f"{stage.key}: with branches or softening there are no derivatives through a"
                    " step in dynamics, or with the key control"
                )
        self._asked = outputs, parameters, last
        self._at_outputs = measuring(self.followed)
        self._found: dict[int, Jacobian] = {}
        with thread_count(None), threadpool_limits(1, user_api="blas"):
            program = ready(self, resume=False)
            self._solver = program[0]
            with suppress(_Followed):
                go(self, *program)
        return [*self._found.values()]

    def accept(self) -> None:
        outputs, parameters, _ = self._asked
        ends = self.state.parameter == self.target
        here = self._at_outputs if ends else self.followed
        body = replace(here, history=self.followed.history)
        found = present_jacobian(body, outputs if ends else [], parameters, self._solver)
        self._found[len(self.state.levels)] = found  # the last increment of an output stays
        self.followed = replace(self.followed, history=found.history)
        self.loaded(self.positions, np.empty_like(self.positions))  # rows are of this state
        super().accept()

    def record(self, time: float = 0.0) -> None:
        if len(self.state.levels) > self._asked[2]:
            raise _Followed
