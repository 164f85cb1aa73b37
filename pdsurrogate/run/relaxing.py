"""Stages in equilibrium of bodies with viscoelastic branches, whose increments are short enough for
the overstress (theory, section 30).
"""

import logging
import warnings

import numpy as np

from ..forces.internal_force import path_error
from ..scenes.model import entries_of
from ..solvers.equilibrium import Equilibrium
from ..solvers.increments import Increments
from .levels import Accepted, Equilibria

logger = logging.getLogger(__name__)

PATH_ERROR = 3e-4
"""Greatest estimate of the error of an overstress in an increment, over the greatest overstress so
far. Chosen: errors of homogeneous ramps, holds and creep are up to three times the estimate, and
stay below 1e-3.
"""

GROWTH = 1 / 8
"""Change of the error if an increment is halved: it is of third order."""

LEAST_SHARE = 1 / 4096
"""Least part of a planned increment. After a sudden load bodies creep within a few percent of a
relaxation time, and increments grow again by doubling.
"""


class Relaxing(Equilibria):
    """Stage in equilibrium of a body with branches, which takes time.

    Steps of branches follow the parabola through the last three equilibria. Where the motion turns,
    two equal increments begin a new one, and are found again together if they were too long.
    """

    def go(self) -> bool:
        state = self.run.state
        if not (state.outputs or self._goes_on()):
            state.before = 0.0
        return super().go()

    def _goes_on(self) -> bool:
        """Return whether the loading goes on at the rate of the stage before."""
        run = self.run
        state = run.state
        if (
            not (state.before and self.stage.duration and run.earlier)
            or self.stage.control
            or run.stages[state.stage - 1].control
        ):
            return False
        rate = (self.stage.to - state.begin) / self.stage.duration
        return bool(np.isclose(rate * state.before, state.parameter - run.earlier[0], rtol=1e-6))

    def _turns_here(self) -> bool:
        """Return whether a table of amplitudes has a row at the present loading parameter."""
        entries = entries_of(self.run.problem.scene, "prescribed", "loads", "obstacles")
        tables = (entry.amplitude for _, entry in entries)
        rows = [t for table in tables if not isinstance(table, str) for t, _ in table]
        return bool(np.isclose(rows, self.run.state.parameter, rtol=1e-9, atol=1e-12).any())

    def _go_to(self, stop: float, time: float) -> Equilibrium | None:
        run, state = self.run, self.run.state
        if self._turns_here():
            state.before = 0.0
        increments = self._path.increments_to(stop, time)
        begin = None if state.before or not time else Accepted(run, self.solver)
        if begin and increments.size:
            increments.shorten()
        taken, greatest = 0, 0.0
        while not increments.finished:
            equilibrium, before = self._attempt(increments)
            # The first of two increments that begin a motion is judged with the second.
            waits = begin and not state.before and increments.share < 1
            error, overstress = 0.0, 0.0
            if time and not waits:
                begins = bool(begin and state.before)
                error, overstress = path_error(run.force, run.positions, begins)
                overstress = max(overstress, state.overstress)
                error = error / overstress if overstress else 0.0
                tried, share, left = increments.target, increments.share, error
                while left > PATH_ERROR and increments.shorten(LEAST_SHARE):
                    left *= GROWTH
                if increments.share < share:
                    run.note(tried, reason=f"shorter increments: path error {error:.1e}")
                    (begin or before).restore(run, self.solver)
                    if begin:
                        increments.restart()
                        taken = 0
                    continue
            increments.grows = error < GROWTH * PATH_ERROR
            state.overstress = max(overstress, state.overstress)
            if not waits:
                begin = None
            taken, greatest = taken + 1, max(greatest, error)
            self._accept(increments, before)
            if run.damage is not None and run.body.share.any(
                len(run.damage.failing(run.force).pairs) > 0
            ):
                return None
        self._count(taken, greatest)
        return equilibrium

    def _check(self, increments: Increments, reached: float, guess: np.ndarray) -> None:
        # Parts of an increment that was divided for its overstress alone are not checked.
        if increments.completes or self._telling:
            super()._check(increments, reached, guess)

    def _accept(self, increments: Increments, before: Accepted) -> None:
        duration = increments.duration
        super()._accept(increments, before)
        self.run.state.before = duration

    def _count(self, taken: int, error: float) -> None:
        """Add increments, and the greatest estimate of their errors, to the next output."""
        self.taken = {
            "increments": self.taken.get("increments", 0) + taken,
            "path_error": max(self.taken.get("path_error", 0.0), error),
        }
        if error > PATH_ERROR and self.run.ranks.rank == 0:
            warnings.warn(
                f"{self._path.last()}: the overstress of branches may be off by {100 * error:.2g} %"
                " of the greatest one, since strains bend within the shortest increments; add"
                " outputs, or lessen largest_increment",
                stacklevel=6,
            )

    def _record(self, equilibrium: Equilibrium) -> None:
        super()._record(equilibrium)
        self.taken = {}
