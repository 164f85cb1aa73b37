"""Stages in equilibrium of bodies with viscoelastic branches, whose increments are short enough for
the overstress (theory, section 30).
"""

import logging
import warnings
from typing import Any

import numpy as np

from ..forces.internal_force import path_error
from ..scenes.amplitudes import amplitude_of, values_of
from ..scenes.model import entries_of
from ..solvers.equilibrium import Equilibrium
from ..solvers.increments import Increments
from .levels import Accepted, Equilibria

logger = logging.getLogger(__name__)

PATH_ERROR = 5e-4
"""Greatest estimate of the error of an overstress, over the greatest one so far, and distance of an
amplitude from the path of a step, over its range. Chosen: errors of homogeneous motions in
steps of many relaxation times are twice the estimate.
"""

GROWTH = 1 / 4
"""Change of the error if increments are halved: it is of second order."""

LEAST_SHARE = 1 / 4096
"""Least part of a planned increment. After a sudden load bodies creep within a few percent of a
relaxation time, and increments grow again by doubling.
"""


class Relaxing(Equilibria):
    """Stage in equilibrium of a body with branches, which takes time.

    Steps of branches follow the parabola through the last three equilibria. Where the motion turns,
    two equal increments begin a new one, and are found again together if they were too long.
    Amplitudes are known beforehand: increments are divided until a loading keeps to the path.
    """

    def __init__(self, *of_stage: Any) -> None:
        super().__init__(*of_stage)
        run = self.run
        # Of branches whose times depend on the overstress, errors are not known.
        self._known = not any(term.settles for term in run.force.terms)
        self._total = sum(stage.duration or 0.0 for stage in run.stages)
        branches = [one for law, _ in run.force.laws for one in law.memory.branches]
        self._least = min(self._total, *(one.time for one in branches)) if self._known else 0.0
        ends = [0.0, *(stage.to for stage in run.stages if stage.control is None)]
        entries = entries_of(run.problem.scene, "prescribed", "loads", "obstacles")
        amplitudes = {one.amplitude for _, one in entries}
        curved = {one for one in amplitudes if isinstance(one, str)} - {"ramp"}
        self._rows = [t for table in amplitudes if not isinstance(table, str) for t, _ in table]
        if self.stage.control or not self._known:
            curved = set()
        ranges = {one: float(np.ptp(values_of(one, min(ends), max(ends))[1])) for one in curved}
        self._ranges = {one: size for one, size in sorted(ranges.items()) if size}
        if self._ranges:
            self.least = LEAST_SHARE

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
        return bool(np.isclose(self._rows, self.run.state.parameter, rtol=1e-9, atol=1e-12).any())

    def _leaves_path(self, increments: Increments) -> float:
        """Return the greatest distance, over its range, of an amplitude in the present increment
        from the path of a step: the parabola through its last three values, first a straight line.
        """
        run, state = self.run, self.run.state
        greatest = 0.0
        for amplitude, size in self._ranges.items():
            x, values = values_of(amplitude, state.parameter, increments.target)
            begin, end = values[0], values[-1]
            path = begin + (end - begin) * x
            if state.before and run.earlier:
                p = state.before / increments.duration
                earlier = amplitude_of(amplitude)(run.earlier[0])
                bend = earlier - begin + (end - begin) * p
                path += bend * x * (x - 1) / (p * (1 + p))
            greatest = max(greatest, float(np.abs(values - path).max()) / size)
        return greatest

    def _judged(self, begins: bool) -> tuple[float, float]:
        """Return the estimate of the error of the present increment, over the greatest overstress,
        and that overstress; `begins` is that of `path_error`.
        """
        run, before = self.run, self.run.state.overstress
        error, lasting, overstress = path_error(run.force, run.positions, begins, self._total)
        # Errors add up to a part of the greatest overstress if they are that part of what they add
        # to it, or if they are less the more of them there are.
        grown, greatest = overstress - before, max(overstress, before)
        lasting = lasting / greatest if greatest else 0.0
        return (min(error / grown, lasting) if grown > 0 else lasting), greatest

    def _go_to(self, stop: float, time: float) -> Equilibrium | None:
        run, state = self.run, self.run.state
        if self._turns_here():
            state.before = 0.0
        increments = self._path.increments_to(stop, time)
        begin = None if state.before or not time else Accepted(run, self.solver)
        if begin and increments.size:
            increments.shorten()
        taken, greatest, worst, lost = 0, 0.0, 0.0, 0.0
        while not increments.finished:
            bent = self._leaves_path(increments) if time else 0.0
            while bent > PATH_ERROR and increments.shorten(LEAST_SHARE):
                bent = self._leaves_path(increments)
            equilibrium, before = self._attempt(increments)
            # The first of two increments that begin a motion is judged with the second.
            waits = begin and not state.before and increments.share < 1
            error, overstress = 0.0, state.overstress
            if time and not waits:
                error, overstress = self._judged(begins=bool(begin and state.before))
                tried, share, left = increments.target, increments.share, error
                while left > PATH_ERROR and increments.shorten(LEAST_SHARE):
                    left *= GROWTH
                if increments.share < share:
                    run.note(tried, reason=f"shorter increments: path error {error:.1e}")
                    (begin or before).restore(run, self.solver)
                    if begin:
                        increments.restart()
                        taken, worst, lost = 0, 0.0, 0.0
                    continue
            increments.grows = error < GROWTH * PATH_ERROR
            state.overstress = overstress
            if not waits:
                begin = None
            if bent > PATH_ERROR:
                # Overstresses remember a distance for a relaxation time.
                worst, lost = max(worst, bent), lost + bent * increments.duration / self._least
            taken, greatest = taken + 1, max(greatest, error * overstress)
            self._accept(increments, before)
            if run.damage is not None and run.body.share.any(
                len(run.damage.failing(run.force).pairs) > 0
            ):
                return None
        # An error counts over the greatest overstress now, which may be far above that of its time.
        greatest /= state.overstress or 1.0
        self._count(taken, max(greatest, min(worst, lost)))
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
            "path_error": max(self.taken.get("path_error") or 0.0, error) if self._known else None,
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
