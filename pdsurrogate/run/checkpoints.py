"""Checkpoints of a run in its folder: their schedule, contents, writing and restoring."""

from __future__ import annotations

import time
from dataclasses import astuple
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from ..body import rows_of
from ..ranks import Rows
from ..results.checkpoint import Checkpoint
from ..results.states import Moment
from .sharing import together
from .state import State

if TYPE_CHECKING:
    from .run import Run

SECONDS_BETWEEN_CHECKPOINTS = 30.0
"""Time between two checkpoints, which bounds the work that is lost when a run is killed."""

CHECKPOINT_SHARE = 20
"""Least time between two checkpoints, over the time that writing one took."""

ACCEPTED = "accepted_"
"""Beginning of the names of arrays that belong to the last equilibrium on the way to an output."""


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
        """Read a checkpoint and restore the run, except for the integrator of a stage in dynamics."""
        run, held = self.run, self._held()
        found = self._read(held)
        progress = found.progress
        if progress["precision"] != run.force.precision:
            run.take_double()
            held |= run.force.state_arrays()
        for key, array in held.items():
            array[:] = found.arrays[key]
        run.state = State(**progress["state"])
        if progress["earlier"] is not None:
            run.earlier = progress["earlier"], found.arrays["earlier"].copy()
        run.states = run.states_of([Moment(*moment) for moment in progress["moments"]])
        if run.damage is not None:
            run.damage.restore()
        run.break_again()
        self.resumable = True
        run.force.evaluations, run.force.pairs_outside = progress["evaluations"], 0 if run.ranks.rank else progress["outside"]
        return found

    def _held(self) -> dict[str, np.ndarray]:
        """Return the arrays that every checkpoint of the run holds."""
        run = self.run
        damage = {} if run.damage is None else {"broken": run.damage.broken, "recent": run.damage.recent}
        return {"positions": run.positions, **run.force.state_arrays(), **damage}

    def _read(self, held: dict[str, np.ndarray]) -> Checkpoint:
        """Read a checkpoint on the first rank and return every rank's rows of it; the names of the present arrays are required."""
        run, identity = self.run, self.identity
        shapes = {key: ((self._rows_of(key).total, *array.shape[1:]), array.dtype) for key, array in held.items()}
        whole = together(run.ranks, lambda: None if run.ranks.rank else Checkpoint.read(run.folder, identity, shapes))
        progress, keys = run.ranks.to_all(whole and (whole.progress, list(whole.arrays)))
        return Checkpoint(identity, progress, {key: self._rows_of(key).hand_out(whole and whole.arrays[key]) for key in keys})

    def _rows_of(self, key: str) -> Rows:
        """Return the rows of the whole body that an array of a checkpoint holds."""
        kind = "pairs" if key in ("broken", "recent") else self.run.force.state_rows.get(key.removeprefix(ACCEPTED), "points")
        return self._rows(kind)
