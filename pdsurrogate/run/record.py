"""Record of a run in its folder: a run that is killed leaves its history and a summary of its progress."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from ..results.tables import write_tables

if TYPE_CHECKING:
    from .run import Run

SECONDS = 1.0
"""Least time between two records where no state was recorded in between."""

SHARE = 20
"""Least time between two records, over the time that writing one took."""


class Record:
    """Tables of a run in its folder, written as the run goes on.

    Parameters
    ----------
    run : Run
        With a folder.
    summary : dict
        Summary of the run as it begins.
    """

    def __init__(self, run: Run, summary: dict) -> None:
        self._run, self._summary = run, summary
        self._began, self._earliest = time.monotonic(), 0.0

    def keep(self) -> None:
        """Write history, convergence and summary."""
        run, began = self._run, time.monotonic()
        reached = {
            "n_force_evaluations": run.force.evaluations,
            "seconds_total": self._summary["seconds_total"] + began - self._began,
            "levels": run.state.levels,
            "states": len(run.states),
            **({"n_steps": run.state.steps} if "n_steps" in self._summary else {}),
            **({"critical_stretch": run.problem.critical_stretch, "crack": run.state.crack} if run.state.crack is not None else {}),
        }
        write_tables(run.folder, self._summary | reached, run.state.history, run.state.convergence, run.problem.units)
        ended = time.monotonic()
        self._earliest = ended + SHARE * (ended - began)

    def keep_if_due(self, rest: float = SECONDS) -> None:
        """Write the record if the last one is older by `rest` than writing it allows."""
        if time.monotonic() >= self._earliest + rest:
            self.keep()
