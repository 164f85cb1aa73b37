"""Energy account of a body that tears in equilibrium: work of supports and loads, energy released
by broken bonds, and energy that dynamics would dissipate.
"""

from dataclasses import dataclass

import numpy as np

from ..solvers.reactions import Reactions, support_reactions
from .account import entries_of
from .run import Run


@dataclass
class Totals:
    """Running totals of the energy balance since the body was at rest, saved in checkpoints; in two
    dimensions energies are per unit thickness.

    Attributes
    ----------
    work, released_energy, damped_energy : float
        Work of all supports and loads, energy of bonds when they broke, and the fall of the total
        energy from there to the next equilibrium under constant loads.
    most_put_in : float
        Greatest work so far.
    gap, greatest_gap : float
        Stored, dissipated, damped and released energy minus the work, in the last equilibrium, and
        the value of greatest magnitude so far.
    first, last : float
        Work on the last way between two equilibria with the forces at its begin and at its end; 0
        if bonds have broken since.
    corrected, single : bool
        Whether the work so far contains the correction for the curvature of the last way, and
        whether that way was the first of a series.
    load, slope : float
        Greatest load of a bond in the last equilibrium, and its change per change of the loading
        parameter; 0 while unknown.
    events : int
        Equilibria in which bonds broke.
    jumps : int
        Equilibria with a bond loaded beyond its limit to which the body jumped from one without,
        however small the increment.
    breaking : bool
        Whether bonds may be overloaded in the last equilibrium, of an avalanche.
    stored : float
        Stored energy where the last avalanche began.
    unsure : float
        Load of a bond, minus 1, above which the bond breaks next, where an avalanche did not wait
        for equilibrium.
    window : list of float, optional
        Middle of the last window in which bonds broke (`tear_window.py`).
    """

    work: float = 0.0
    released_energy: float = 0.0
    damped_energy: float = 0.0
    most_put_in: float = 0.0
    gap: float = 0.0
    greatest_gap: float = 0.0
    first: float = 0.0
    last: float = 0.0
    corrected: bool = False
    single: bool = True
    load: float = 0.0
    slope: float = 0.0
    events: int = 0
    jumps: int = 0
    breaking: bool = False
    stored: float = 0.0
    unsure: float = 0.0
    window: list[float] | None = None


@dataclass
class Known:
    """State of a body in equilibrium, as far as its energy account needs it.

    Attributes
    ----------
    parameter : float
    positions : ndarray, shape (n, d)
    planes : ndarray, shape (planes,)
        Positions of planes of symmetry.
    pushes : ndarray, shape (places, obstacles)
        `Loads.pushes`.
    reactions : Reactions or None
        None in the midst of an avalanche.
    thickness : ndarray, shape (n,), or None
    energy, dissipated : float
        Stored energy, and energy that the materials have dissipated.
    """

    parameter: float
    positions: np.ndarray
    planes: np.ndarray
    pushes: np.ndarray
    reactions: Reactions | None
    thickness: np.ndarray | None
    energy: float
    dissipated: float


class TearAccount:
    """Energy account of a run whose bonds break in equilibrium.

    Parameters
    ----------
    run : Run
        Run with the force last evaluated in its present equilibrium.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self.totals = Totals(**(run.state.tear or {}))
        run.state.tear = vars(self.totals)
        self._known = self._present()

    def _present(self, breaking: bool = False) -> Known:
        run = self._run
        return Known(
            run.state.parameter,
            run.positions.copy(),
            run.loads.planes.copy(),
            run.loads.pushes.copy(),
            None if breaking else support_reactions(run.loading, run.loaded),
            run.loaded.thickness(),
            run.strain_energy(),
            sum(run.dissipated_energy().values()),
        )

    @property
    def energy(self) -> float:
        """Stored energy in the present equilibrium."""
        return self._known.energy

    def expects_event(self, load: float, stop: float) -> float:
        """Return the loading parameter at which the greatest load of a bond is expected to reach
        `load`, or `stop` if that is nearer.
        """
        at = self._known.parameter
        totals = self.totals
        way = (load - totals.load) / totals.slope if totals.slope > 0 else np.inf
        return stop if way >= abs(stop - at) else float(at + np.sign(stop - at) * way)

    def follow(self, load: float) -> None:
        """Count the work of supports and loads on the way to the present equilibrium, on which no
        bond broke; `load` is the greatest load of a bond there.
        """
        totals = self.totals
        old = self._known
        new = self._known = self._present()
        first, last = (self._work_with(one, old, new) for one in (old, new))
        totals.work += (first + last) / 2
        totals.corrected = first * totals.last > 0
        if totals.corrected:
            # The third point of a parabola corrects the trapezoidal rule, for the first way of a
            # series together with the second one. Ways are measured by the work on them of the
            # forces between both.
            bend = (last / first - 1) / first - (1 - totals.first / totals.last) / totals.last
            cubes = first**3 + (totals.last**3 if totals.single else 0.0)
            totals.work -= cubes * bend / (6 * (first + totals.last))
        totals.first, totals.last, totals.single = first, last, not totals.corrected
        size = new.parameter - old.parameter
        if size:
            totals.slope = (load - totals.load) / abs(size)
        totals.load = load
        self._close()

    def energy_left(self, known: bool) -> float:
        """Return the energy that is left after bonds broke, at constant positions: that of which
        the forces are the derivative, since what softening takes of it there is not accepted. NaN
        where it is undefined. `known` says whether these positions have forces.
        """
        run = self._run
        if not run.force.has_energy:
            return np.nan
        if not known:
            run.force.pass_bonds(np.zeros_like(run.positions))
        return run.body.share.total(run.force.energy())

    def fall(self, left: float | None) -> None:
        """Count the energy of bonds that have just broken, which leave `left` (None if none has),
        and the fall of the energy since then to the present equilibrium, under constant loads.

        Without energy right after the break, all of the fall counts as damped.
        """
        totals = self.totals
        old = self._known
        new = self._known = self._present(breaking=True)
        work = sum(self._work_of_loads(one, old, new) for one in (old, new)) / 2
        if not np.isfinite(left):
            left = old.energy
        totals.work += work
        totals.released_energy += old.energy - left
        totals.damped_energy += left + old.dissipated - new.energy - new.dissipated + work
        totals.last = 0.0
        totals.corrected = True
        self._close()

    def settle(self) -> None:
        """Find the reactions in the present equilibrium, in which no bond breaks."""
        run = self._run
        self._known.reactions = support_reactions(run.loading, run.loaded)

    def _work_with(self, one: Known, old: Known, new: Known) -> float:
        """Return the work on the way between two equilibria of the supports and loads of `one` of
        them.
        """
        work = self._run.loading.course.work(one.reactions, old.parameter, new.parameter)
        return work + self._work_of_loads(one, old, new)

    def _work_of_loads(self, one: Known, old: Known, new: Known) -> float:
        run = self._run
        if not run.loads:
            return 0.0
        self._set_loads(one)
        moves = new.positions - old.positions, new.planes - old.planes
        work = run.body.share.total(run.loads.power(one.positions, *moves, one.thickness))
        self._set_loads(new)
        return work

    def _set_loads(self, one: Known) -> None:
        """Set the loads to those of an equilibrium, with the pushes of obstacles in it."""
        loads = self._run.loads
        loads.set(one.parameter)
        loads.pushes[:] = one.pushes
        loads.planes[:] = one.planes

    def _close(self) -> None:
        totals = self.totals
        known = self._known
        totals.most_put_in = max(totals.most_put_in, totals.work)
        if self._run.force.has_energy:
            spent = totals.damped_energy + totals.released_energy + known.dissipated
            totals.gap = known.energy + spent - totals.work
            if totals.corrected:
                totals.greatest_gap = max(totals.greatest_gap, totals.gap, key=abs)

    def columns(self) -> dict[str, float]:
        """Return the energies of a row of the history."""
        totals = self.totals
        if not self._run.force.has_energy:
            return {"work": totals.work}
        return {
            "work": totals.work,
            "damped_energy": totals.damped_energy,
            "released_energy": totals.released_energy,
        }


def tear_entry(run: Run) -> dict:
    """Return the entry of the summary about the energy account of a run that tears slowly (see
    `entries_of`), with the number of equilibria in which bonds broke.
    """
    totals = Totals(**(run.state.tear or {}))
    gaps = totals.gap, totals.greatest_gap
    advice = "use more outputs, or smaller increments"
    found = entries_of(run, totals.most_put_in, *gaps, advice) | {"events": totals.events}
    if totals.jumps:
        jumped = f"the body jumped {totals.jumps} times to a state with a bond beyond its limit"
        found["remark"] = "; ".join(filter(None, (found["remark"], jumped)))
    return found
