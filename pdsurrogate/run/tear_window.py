"""Windows on a body that tears in equilibrium: parts of it in which bonds break one after another
while the rest of the body stays where it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..body.division import part_of
from ..forces import InvalidState
from ..forces.protocol import bind_portions
from ..solvers.equilibrium import NoEquilibrium
from ..solvers.loaded_force import LoadedForce
from ..solvers.loads import DeadLoad, Loads
from ..solvers.quasi_newton import QuasiNewton
from .run import Run

TEARS, MOVES, REACHES = 1.0, 2.0, 4.0
"""Distances from the middle of a window, in horizons, within which bonds break, points move, and
points belong to it.

Forces on moving points depend on gradients of points up to a horizon away, which have all their
bonds here. What lies farther away acts with constant forces.
"""

MOST = 0.1
"""Greatest part of the points of a body in a window. Chosen: with 0.06 a tear takes a third of the
time, with 0.15 as long as without.
"""


def can_have_windows(run: Run) -> bool:
    """Return whether bonds of a body may break in windows: they hold no history, contact, or places
    between points, and no strength, which depends on means over regions.
    """
    return not (
        run.body.share.divided
        or run.force.history
        or run.loaded.supports
        or run.loads.obstacles
        or run.problem.strengths is not None
    )


class Window:
    """Part of a body whose inner points find equilibrium while all others rest.

    Parameters
    ----------
    run : Run
    centre : ndarray, shape (d,)

    Attributes
    ----------
    fits : bool
        Whether the window is much smaller than the body, and far enough from reflection planes.
    """

    def __init__(self, run: Run, centre: np.ndarray) -> None:
        self.centre = centre
        self._run = run
        body = run.body
        bonds = body.bonds
        away = np.linalg.norm(body.points - centre, axis=1) / body.horizon
        images = bonds.first[bonds.second >= len(body)]
        self._points = np.flatnonzero(away <= REACHES)
        self.fits = len(self._points) <= MOST * len(body) and bool((away[images] > MOVES + 1).all())
        if not self.fits:
            return
        inside = np.append(away <= REACHES, np.zeros(len(body.ghosts), dtype=bool))
        self._pairs = np.flatnonzero(inside[bonds.first] & inside[bonds.second])
        part = part_of(body, self._points)
        portions = [
            replace(portion, points=np.flatnonzero(np.isin(self._points, portion.points)))
            for portion in run.problem.portions
        ]
        self._force = bind_portions(
            part, [one for one in portions if len(one.points)], run.problem.settings
        )
        self._force.break_bonds(np.flatnonzero(run.damage.broken[self._pairs]))
        moves = away[self._points] <= MOVES
        self._moving = np.flatnonzero(moves)
        free = run.loading.free[self._points] * moves[:, None]
        self._solver = QuasiNewton(free, part.volumes)
        self._positions = part.points.copy()
        self._seen = np.flatnonzero(moves[part.bonds.first] | moves[part.bonds.second])
        self._ends = part.bonds.first[self._seen], part.bonds.second[self._seen]

    def contains(self, pairs: np.ndarray) -> bool:
        """Return whether pairs of the body lie so far inside that they may break here."""
        off = self._run.damage.middles(pairs) - self.centre
        return bool((np.linalg.norm(off, axis=1) <= TEARS * self._run.body.horizon).all())

    def begin(self, forces: np.ndarray) -> None:
        """Take the state of the body, in which it has forces (n, d)."""
        run = self._run
        points = self._points
        self._positions[:] = run.positions[points]
        for name, values in self._force.state_arrays.items():
            rows = points if len(values) == len(points) else self._pairs
            values[:] = run.force.state_arrays[name][rows]
        body = self._force.body
        found = np.empty_like(self._positions)
        self._force(self._positions, found)
        # Constant forces stand for all that the window lacks.
        rest = DeadLoad("rest", lambda _: 1.0, body.share, slice(None), forces[points] - found)
        self._loaded = LoadedForce(self._force, Loads(body, [rest]))

    def break_bonds(self, pairs: np.ndarray) -> float:
        """Break pairs of the body; return the energy released at constant positions, NaN where it
        is undefined.
        """
        force = self._force
        before = force.energy() if force.has_energy else np.nan
        force.break_bonds(np.searchsorted(self._pairs, pairs))
        if not force.has_energy:
            return np.nan
        force.pass_bonds(np.empty_like(self._positions))
        return before - force.energy()

    def solve(self, tolerance: float, end_if_sure: Callable) -> bool:
        """Find equilibrium, and return whether there is one; otherwise the points stay.

        ``end_if_sure(residual, overloads)`` may end the search by an error.
        """
        before = self._positions.copy()

        def report(_: int, residual: float) -> None:
            end_if_sure(residual, lambda: self.overloaded()[1])

        try:
            self._solver.solve(self._loaded, self._positions, tolerance, report)
        except (NoEquilibrium, InvalidState):
            self._positions[:] = before
            return False
        return True

    def overloaded(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the overloaded pairs, as numbers of the body, with their loads."""
        first, second = self._ends
        pairs = self._pairs[self._seen]
        square = np.square(self._positions[second] - self._positions[first]).sum(axis=1)
        square /= self._run.damage.limits[pairs]
        over = square > 1
        return pairs[over], np.sqrt(square[over])

    def leave(self) -> None:
        """Move the points of the body to their places in the window."""
        moving = self._moving
        self._run.positions[self._points[moving]] = self._positions[moving]
