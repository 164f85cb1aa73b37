"""Stages in equilibrium in which bonds break: slow tears."""

import logging
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..forces import InvalidState
from ..problem import Stage
from ..results.checkpoint import Checkpoint
from ..solvers.equilibrium import Equilibrium, EquilibriumSolver, RanAway, TooSmall
from ..solvers.increments import Increments
from .checkpoints import Checkpoints
from .cracks import Cracks
from .interruption import Interrupted
from .levels import COARSE, FAILURES, FINE, Accepted, Equilibria
from .paths import ParameterPath
from .rows import equilibrium_columns, output_row
from .run import Run
from .tear_account import TearAccount, tear_entry
from .tear_window import Window, can_have_windows

logger = logging.getLogger(__name__)

OVERLOAD = 2e-3
"""Greatest excess over 1 of the load of a bond, stretch over critical stretch, with which the first
bond of an event may break, and difference of loads within which bonds count as equally loaded and
break together. Chosen: half of it changes the peak of the load by less than a thousandth.
"""

LARGEST_STRAIN = 0.1
PARTS = 8
"""Greatest strain of a bond by an increment, and least number of increments of a stage, so that the
work on them is known within a thousandth from the forces at their ends and those before.
"""

ROUGH = 0.3
LEAD = 0.3
"""Residual below which an avalanche need not wait for equilibrium, and the lead of a bond's load
over all others and over 1, divided by the residual, with which the bond breaks there.

From a residual of 0.3 on, loads change by up to half of it until equilibrium, and those of bonds
side by side alike. Chosen: with leads from 0.1 to 0.5 the same bonds break as in equilibrium in
five of six tears; in the sixth with 0.3 (strip, notched and `tear` of
docs/validation/slow-tears.md).
"""

STRANDS = 1e-3
"""Part of the stored energy that is left after an avalanche below which the body counts as
separated: strands of single bonds may still join its parts. Chosen far below what a ligament of
some points holds.
"""

ROUNDING = 1e-9
"""Part of a time that may be left by rounding."""

MOST_TRIALS = 12
"""Most trials to find the loading at which a bond breaks. Loads are nearly linear in it, so that
two suffice, and later trials at least halve the way; where the body jumps to another equilibrium,
no loading with an excess within `OVERLOAD` exists.
"""


class _SurelyBreaks(Exception):
    """Signal that it is known which bond of an avalanche breaks next, before equilibrium is."""


class Tearing(Equilibria):
    """Stage in equilibrium in which bonds break.

    The loading stops where the first bond exceeds its critical stretch or breaks by strength. The
    most overloaded bonds break, the body finds equilibrium again under constant loads, and so on
    until no bond is overloaded: an avalanche, during which no time passes. Then the loading goes
    on.

    Parameters
    ----------
    run : Run
    stage : Stage
    solver : EquilibriumSolver
    checkpoints : Checkpoints
    """

    def __init__(
        self, run: Run, stage: Stage, solver: EquilibriumSolver, checkpoints: Checkpoints
    ) -> None:
        super().__init__(run, stage, solver, checkpoints)
        part = abs(stage.to - run.state.begin) / PARTS
        bounds = [bound for bound in (stage.largest_increment, part) if bound]
        bounded = replace(stage, largest_increment=min(bounds, default=None))
        self._path = ParameterPath(run, bounded, solver, LARGEST_STRAIN)
        self._cracks = Cracks(run, stage.duration is not None)
        self._window: Window | None = None
        self._asked = -np.inf  # residual below which a search for equilibrium may end

    def resume(self, checkpoint: Checkpoint) -> None:
        super().resume(checkpoint)
        run = self.run
        evaluations = run.force.evaluations
        kept = Accepted(run, self.solver)
        run.loaded(run.positions, np.empty_like(run.positions))
        kept.restore(run, self.solver)
        run.force.evaluations = evaluations

    def go(self) -> bool:
        """Compute and record the remaining outputs of the stage, or those before the body has
        separated between its supports; return True.
        """
        self._account = TearAccount(self.run)
        if not self._account.totals.load:
            self._account.totals.load = self.run.damage.greatest_load(self.run.force)
        if not self._checkpoints.resumable:  # broken bonds cannot be restored otherwise
            self._checkpoint()
        super().go()
        remark = tear_entry(self.run)["remark"]
        if remark and self.run.force.has_energy and self.run.ranks.rank == 0:
            warnings.warn(remark, stacklevel=4)
        return True

    def _go_to(self, stop: float, time: float) -> Equilibrium | None:
        """Return the equilibrium at `stop`, as `Equilibria._go_to`, or the first one after the body
        has separated.
        """
        state = self.run.state
        self._output = self._outputs[state.outputs + 1]
        self._end = state.time + time
        equilibrium = self._avalanche(None)
        while not self.through and (equilibrium is None or not self._is_at(stop)):
            self._pause()
            goal = self._account.expects_event(1 + OVERLOAD / 2, stop)
            share = (goal - state.parameter) / (stop - state.parameter) if goal != stop else 1.0
            increments = self._path.increments_to(goal, share * (self._end - state.time))
            found = self._follow_to_event(increments)
            equilibrium = self._avalanche(found)
            if equilibrium is found and stop != self._output and self._is_at(stop):
                self._row()  # a turn of the loading, where forces may be greatest
        return equilibrium

    def _is_at(self, stop: float) -> bool:
        """Return whether the loading has reached `stop`, and the time there if it is held."""
        state = self.run.state
        return state.parameter == stop and self._end - state.time <= ROUNDING * self._end

    def _follow_to_event(self, increments: Increments) -> Equilibrium:
        """Return the equilibrium at the end of the present increment, or else the one at which
        the first bond is overloaded.
        """
        run = self.run
        begin = run.state.parameter
        at_begin = self._account.totals.load
        for trial in range(MOST_TRIALS):
            equilibrium, before = self._attempt(increments)
            load = run.damage.greatest_load(run.force)
            if load <= 1 + OVERLOAD:
                break
            if trial == MOST_TRIALS - 1:
                self._account.totals.jumps += 1
                jump = run.loading.at(run.state.parameter), load
                logger.warning("%s: the load of a bond jumped to %.4g of its limit", *jump)
                break
            before.restore(run, self.solver)
            part = (1 + OVERLOAD / 2 - at_begin) / (load - at_begin)
            part = part if trial == 0 else min(part, 0.5)
            goal = begin + part * (increments.target - begin)
            increments = Increments(begin, goal, np.inf, part * increments.duration)
        self._accept(increments, before)
        self._account.follow(load)
        return equilibrium

    def _avalanche(self, equilibrium: Equilibrium | None) -> Equilibrium | None:
        """Break overloaded bonds and find equilibrium again, until none is overloaded; return the
        last equilibrium, the given one if no bond breaks.
        """
        run = self.run
        totals = self._account.totals
        while not self.through:
            failing = run.damage.failing(run.force, alone=True)
            foremost = self._foremost(failing.pairs, failing.loads)
            if not run.body.share.any(len(foremost) > 0):
                break
            if not totals.breaking:
                self._row()
                totals.breaking = True
                totals.stored = self._account.energy
                totals.events += 1
            else:
                self._pause()
            equilibrium = self.break_bonds(foremost, failing.cause)
        if totals.breaking:
            totals.breaking = False
            self._account.settle()
            totals.load = run.damage.greatest_load(run.force)
            run.earlier = None
            hangs = self._account.energy > STRANDS * totals.stored
            self.through = self.through or not hangs or self._cracks.separated()
            run.note(run.state.parameter, reason=f"{run.state.crack['broken_bonds']} bonds broken")
            if not (self.through or self._is_at(self._output)):  # which follows as a row
                self._row()
        return equilibrium

    def break_bonds(self, pairs: np.ndarray, cause: str) -> Equilibrium:
        """Break pairs, given by number, those that follow in a `Window`, and the bonds of points
        that fail without them; find and return the equilibrium under the same loads.
        """
        run = self.run
        run.force.elapse(0.0)
        left = stored = self._account.energy
        if self._in_window(pairs):
            forces = self._forces()
            while forces is not None and self._in_window(pairs):
                released, pairs = self._tear_in_window(pairs, cause, forces)
                left -= released
                forces = self._forces()
                stored = self._account.energy_left(forces is not None)
            pairs = np.union1d(pairs, self._cracks.bonds_of_failed_points())
        while run.body.share.any(len(pairs) > 0):
            self._cracks.break_bonds(pairs, cause)
            # Forces without an energy know no collapsed pairs.
            known = run.force.has_energy and self._forces() is not None
            left -= stored
            stored = self._account.energy_left(known)
            left += stored
            pairs = self._cracks.bonds_of_failed_points()
        return self._find_again(left)

    def _forces(self) -> np.ndarray | None:
        """Return the forces (n, d) at the present positions; None if they are those of points and
        bonds that fail next.
        """
        run = self.run
        found = np.empty_like(run.positions)
        with suppress(InvalidState):
            run.loaded(run.positions, found)
            return found
        return None

    def _in_window(self, pairs: np.ndarray) -> bool:
        """Return whether pairs can break in a window: the last one, or one around them."""
        run = self.run
        totals = self._account.totals
        if not (len(pairs) and can_have_windows(run)):
            return False
        if self._window is None and totals.window:
            self._window = Window(run, np.array(totals.window))
        if self._window is None or not self._window.contains(pairs):
            self._window = Window(run, run.damage.middles(pairs).mean(axis=0))
            totals.window = self._window.centre.tolist()
        return self._window.fits and self._window.contains(pairs)

    def _tear_in_window(
        self, pairs: np.ndarray, cause: str, forces: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Break pairs, and those that are overloaded then in the window, from a state with these
        forces (n, d); return the energy released, and overloaded pairs too far out.

        All around stays where it was; it can only give way to the crack, so that these bonds would
        break, too, if it were in equilibrium.
        """
        run = self.run
        window = self._window
        totals = self._account.totals
        window.begin(forces)
        released = 0.0
        torn = []
        while len(pairs) and window.contains(pairs):
            self._cracks.mark(pairs, cause)
            torn.append(pairs)
            released += window.break_bonds(pairs)
            found = True
            totals.unsure = 0.0
            self._asked = ROUGH
            with suppress(_SurelyBreaks):
                found = window.solve(FINE, self._end_if_sure)
            pairs = self._foremost(*window.overloaded()) if found else pairs[:0]
        self._asked = -np.inf
        totals.unsure = 0.0
        window.leave()
        run.force.break_bonds(np.concatenate(torn))
        return released, pairs

    def _foremost(self, pairs: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """Return those of overloaded pairs, with these loads, that break next, see
        `Damage.foremost`; none if none is.
        """
        surely = loads > 1 + self._account.totals.unsure
        if not self.run.body.share.any(surely.any()):
            return pairs[:0]
        return self.run.damage.foremost(pairs[surely], loads[surely], OVERLOAD)

    def _find_again(self, left: float) -> Equilibrium:
        """Find and return the equilibrium under the present loads after bonds have broken, which
        leave the body the energy `left`, or the first state on the way in which another surely
        breaks.
        """
        run = self.run
        solver = self.solver
        before = Accepted(run, solver)
        tolerance = run.problem.scene.solver.tolerance
        if not run.force.history and run.state.parameter != self._output:
            tolerance = max(tolerance, FINE)
        totals = self._account.totals
        totals.unsure = 0.0
        self._asked = -np.inf if run.force.history else ROUGH
        try:
            equilibrium = self._solve(run.state.parameter, tolerance, before.arrays["positions"])
        except _SurelyBreaks:
            equilibrium = Equilibrium(run.residual, 0, solver.name)
        except (*FAILURES, TooSmall) as error:
            before.restore(run, solver)
            # What parts do that nothing holds, or that their loads carry away, is no result of the
            # tear.
            self.through = isinstance(error, RanAway) or self._cracks.separated()
            run.loaded(run.positions, np.empty_like(run.positions))
            # On the way to separation there may be no equilibrium before further bonds break.
            more = run.damage.failing(run.force, alone=True).pairs
            if not (self.through or run.body.share.any(len(more) > 0)):
                raise
            equilibrium = Equilibrium(run.residual, 0, solver.name)
        self._asked = -np.inf
        solver.gave_up = before.gave_up  # the next equilibrium is near
        run.accept()
        self._account.fall(left)
        return equilibrium

    def _pause(self) -> None:
        """Write a checkpoint if it is late, and stop on request."""
        run = self.run
        asked, late = run.body.share.total(
            (int(run.interruption.asked), int(self._checkpoints.late))
        )
        if asked or late:
            self._checkpoint()
        if asked:
            raise Interrupted

    def _stop_on_request(self) -> None:
        """Go on: a tear stops between equilibria, which take little time."""

    def _note(self, target: float, residual: float) -> None:
        """Add nothing: the table would have a row for each of thousands of evaluations. End the
        search after a break once it is sure which bond breaks next.
        """
        run = self.run
        self._end_if_sure(residual, lambda: run.damage.failing(run.force, alone=True).loads)

    def _end_if_sure(self, residual: float, overloads: Callable[[], np.ndarray]) -> None:
        """Raise _SurelyBreaks once it is sure, by the loads of overloaded bonds at a residual,
        which of them breaks next.
        """
        if residual > self._asked:
            return
        self._asked = residual / 2
        share = self.run.body.share
        loads = overloads()
        first = share.greatest(loads.max(initial=1.0))
        second = share.greatest(loads[loads < first - OVERLOAD].max(initial=1.0))
        rough = residual > COARSE
        if first > 1 and (not rough or first - second > LEAD * residual):
            self._account.totals.unsure = max(0.0, first - OVERLOAD - 1) if rough else 0.0
            raise _SurelyBreaks

    def _numbers(self) -> dict[str, float]:
        return {"broken_bonds": self.run.state.crack["broken_bonds"]}

    def _reports(self, increments: Increments) -> bool:
        return increments.target == self._output

    def _coarse(self) -> float:
        return FINE

    def _check(self, increments: Increments, reached: float, guess: np.ndarray) -> None:
        if self._reports(increments):
            super()._check(increments, reached, guess)

    def _record(self, equilibrium: Equilibrium) -> None:
        through = self._cracks.output(with_way=True)
        self.run.state.crack["through"] = through or self.through
        super()._record(equilibrium)

    def _row(self) -> None:
        """Add a row for the present equilibrium to the history."""
        run = self.run
        level = output_row(run, costly=False)
        if self.stage.duration is not None:
            level["time"] = run.state.elapsed + run.state.time
        run.state.history.append(equilibrium_columns(run, level) | self._columns())

    def _columns(self) -> dict[str, float]:
        points = self.run.body.share.count(~self.run.force.supported)
        return self._account.columns() | self._numbers() | {"free_points": points}
