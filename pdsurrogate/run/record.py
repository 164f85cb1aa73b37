"""Record of a run in its folder: a run that is killed leaves its history and a summary of its progress."""

from __future__ import annotations

import time

from ..results.result import write_tables
from .run import Run

SECONDS = 1.0
"""Between two times of writing, at least, where no state was recorded."""

SHARE = 20
"""Of the time that writing took, at least as many go by before the next."""


class Record:
    """Progress that keeps the tables of a run in its folder, and passes reports on.

    Parameters
    ----------
    run : Run
        With a folder.
    summary : dict
        Of the run as it begins.
    """

    def __init__(self, run: Run, summary: dict) -> None:
        self._run, self._summary, self._to = run, summary, run.progress
        self._began, self._due, self._due_with_state = time.monotonic(), 0.0, 0.0

    def keep(self) -> None:
        """Write history, convergence and summary."""
        run, began = self._run, time.monotonic()
        reached = {
            "n_force_evaluations": run.force.evaluations,
            "seconds_total": self._summary["seconds_total"] + began - self._began,
            "levels": run.levels,
            "states": len(run.states),
            **({"n_steps": run.steps} if "n_steps" in self._summary else {}),
            **({"critical_stretch": run.critical_stretch, "crack": run.crack} if run.crack is not None else {}),
        }
        write_tables(run.folder, self._summary | reached, run.history, run.convergence, run.scene.units)
        ended = time.monotonic()
        self._due_with_state = ended + SHARE * (ended - began)
        self._due = max(self._due_with_state, ended + SECONDS)

    def state(self) -> None:
        """Write what is new with a recorded state: the first at once, others as soon as writing is cheap enough."""
        if len(self._run.states) == 1 or time.monotonic() >= self._due_with_state:
            self.keep()

    def _keep_if_due(self) -> None:
        if time.monotonic() >= self._due:
            self.keep()

    def compiling(self) -> None:
        """Pass it on."""
        self._to.compiling()

    def level(self, number: int, parameter: float) -> None:
        """Pass it on, and write what is new."""
        self._to.level(number, parameter)
        self._keep_if_due()

    def residual(self, evaluations: int, residual: float, tolerance: float) -> None:
        """Pass it on, and write what is new."""
        self._to.residual(evaluations, residual, tolerance)
        self._keep_if_due()

    def dynamics(self, done: float, parameter: float, broken_bonds: int) -> None:
        """Pass it on."""
        self._to.dynamics(done, parameter, broken_bonds)

    def account(self, steps: int, kinetic_energy: float, strain_energy: float) -> None:
        """Pass it on, and write what is new."""
        self._to.account(steps, kinetic_energy, strain_energy)
        self._keep_if_due()
