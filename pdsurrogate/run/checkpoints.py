"""State of a run, and what the run writes to its folder as it goes on: checkpoints, and tables that a killed run leaves."""

from __future__ import annotations

import time
from dataclasses import astuple, dataclass, field
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from ..body import rows_of
from ..ranks import Rows
from ..results.checkpoint import Checkpoint
from ..results.states import Moment
from ..results.tables import write_tables

if TYPE_CHECKING:
    from .run import Run

SECONDS_BETWEEN_CHECKPOINTS = 30.0
"""Time between two checkpoints, which bounds the work that is lost when a run is killed."""

CHECKPOINT_SHARE = 20
"""Least time between two checkpoints, over the time that writing one took."""

SECONDS_BETWEEN_TABLES, TABLES_SHARE = 1.0, 20
"""The same of tables, where no state was recorded in between."""

ACCEPTED = "accepted_"
"""Beginning of the names of arrays that belong to the last equilibrium on the way to an output."""


@dataclass
class State:
    """Numbers and text that describe the progress of a run, in addition to its arrays.

    Attributes
    ----------
    parameter : float
        Loading parameter at the positions.
    begin : float
        Loading parameter where the stage under way began.
    stage, outputs : int
        Number of the stage that is under way, and of its outputs so far.
    elapsed : float
        Time that earlier stages in dynamics took.
    steps : int
        Steps in dynamics.
    wasted : int
        Evaluations of increments that failed.
    greatest_drive : float
        Greatest `Equilibrium.drive` of the outputs so far.
    crack : dict or None
        Entry of the summary about cracks.
    dynamics : list of dict
        Entries of the summary about the stages in dynamics.
    levels, history, convergence : list of dict
        Measures at every level; rows of the history; rows about the search for equilibrium.
    beyond_data : list of dict
        For every recorded state of an energy from test data, the share of the bonds that is beyond them, and the farthest distance.
    """

    parameter: float
    begin: float
    stage: int = 0
    outputs: int = 0
    elapsed: float = 0.0
    steps: int = 0
    wasted: int = 0
    greatest_drive: float = 0.0
    crack: dict | None = None
    dynamics: list[dict] = field(default_factory=list)
    levels: list[dict] = field(default_factory=list)
    history: list[dict] = field(default_factory=list)
    convergence: list[dict] = field(default_factory=list)
    beyond_data: list[dict] = field(default_factory=list)


class Checkpoints:
    """Checkpoints of a run; without a folder none is written.

    Arrays are in the order of the whole body, so that any number of ranks can continue from them.

    Parameters
    ----------
    run : Run

    Attributes
    ----------
    resumable : bool
        Whether the run has written or restored a checkpoint, from which it can resume.
    """

    def __init__(self, run: Run) -> None:
        self.run, self._share, self._rows = run, run.body.share, cache(partial(rows_of, run.body))
        self.resumable, self._due = False, time.monotonic() + SECONDS_BETWEEN_CHECKPOINTS

    @property
    def late(self) -> bool:
        """Return whether a checkpoint is due."""
        return self.run.folder is not None and time.monotonic() >= self._due

    @property
    def identity(self) -> dict:
        """Return the identity that a checkpoint of the run must have."""
        run = self.run
        sizes = {"n_points": self._share.size, "n_pairs": self._share.total(run.counted_pairs())}
        return {**run.contents.describe(), **sizes}

    def write(self, progress: dict, arrays: dict[str, np.ndarray]) -> None:
        """Write a checkpoint, with entries and arrays of the present stage."""
        run = self.run
        if run.folder is None:
            return
        began = time.monotonic()
        common = {
            "state": vars(run.state),
            "earlier": None if run.earlier is None else run.earlier[0],
            "moments": [astuple(moment) for moment in run.states.moments],
            "evaluations": run.force.evaluations,
            "precision": run.force.precision,
            "outside": self._share.total(run.force.pairs_outside),
        }
        held = {**self._held(), **arrays}
        if run.earlier is not None:
            held["earlier"] = run.earlier[1]
        whole = {key: self._rows_of(key).gather(array) for key, array in held.items()}
        kept = Checkpoint(self.identity, {**common, **progress}, whole)  # evaluated on all ranks, which compute its sums together
        if run.ranks.rank == 0:
            kept.write(run.folder)
        ended = time.monotonic()
        self.resumable, self._due = True, ended + max(SECONDS_BETWEEN_CHECKPOINTS, CHECKPOINT_SHARE * (ended - began))

    def restore(self) -> Checkpoint:
        """Read a checkpoint on the first rank, restore the run except for its stage, and return every rank's rows of the checkpoint."""
        run, held, identity = self.run, self._held(), self.identity
        shapes = {key: ((self._rows_of(key).total, *array.shape[1:]), array.dtype) for key, array in held.items()}
        with run.ranks.together():
            whole = None if run.ranks.rank else Checkpoint.read(run.folder, identity, shapes)
        progress, keys = run.ranks.to_all(whole and (whole.progress, list(whole.arrays)))
        arrays = {key: self._rows_of(key).hand_out(whole and whole.arrays[key]) for key in keys}
        if progress["precision"] != run.force.precision:
            run.take_double()
            held |= run.force.state_arrays()
        for key, array in held.items():
            array[:] = arrays[key]
        run.state = State(**progress["state"])
        if progress["earlier"] is not None:
            run.earlier = progress["earlier"], arrays["earlier"].copy()
        run.states = run.states_of([Moment(*moment) for moment in progress["moments"]])
        if run.damage is not None:
            run.damage.restore()
        run.break_again()
        self.resumable = True
        run.force.evaluations, run.force.pairs_outside = progress["evaluations"], 0 if run.ranks.rank else progress["outside"]
        return Checkpoint(identity, progress, arrays)

    def _held(self) -> dict[str, np.ndarray]:
        """Return the arrays that every checkpoint of the run holds."""
        run = self.run
        damage = {} if run.damage is None else {"broken": run.damage.broken, "recent": run.damage.recent}
        return {**run.arrays(), **damage}

    def _rows_of(self, key: str) -> Rows:
        """Return the rows of the whole body that an array of a checkpoint holds."""
        kind = "pairs" if key in ("broken", "recent") else self.run.force.state_rows.get(key.removeprefix(ACCEPTED), "points")
        return self._rows(kind)


class Record:
    """History, convergence and summary of a run in its folder, written as the run goes on.

    Parameters
    ----------
    run : Run
    """

    def __init__(self, run: Run) -> None:
        self._run, self._summary, self._began, self._earliest = run, None, 0.0, 0.0

    def begin(self, summary: dict) -> None:
        """Begin with the summary of the run as it begins; without one nothing is written."""
        self._summary, self._began = summary, time.monotonic()

    def keep_if_due(self, rest: float = SECONDS_BETWEEN_TABLES) -> None:
        """Write the tables if the last ones are older by `rest` than writing them allows."""
        run, state, began = self._run, self._run.state, time.monotonic()
        if self._summary is None or began < self._earliest + rest:
            return
        reached = {
            "n_force_evaluations": run.force.evaluations,
            "seconds_total": self._summary["seconds_total"] + began - self._began,
            "levels": state.levels,
            "states": len(run.states),
            **({"n_steps": state.steps} if "n_steps" in self._summary else {}),
            **({"critical_stretch": run.problem.critical_stretch, "crack": state.crack} if state.crack is not None else {}),
        }
        write_tables(run.folder, self._summary | reached, state.history, state.convergence, run.problem.units)
        ended = time.monotonic()
        self._earliest = ended + TABLES_SHARE * (ended - began)
