"""Files that a run writes while it runs: checkpoints to resume from, and tables of results so
far.
"""

import time
import weakref
from dataclasses import astuple
from functools import cache, partial

import numpy as np

from ..body import rows_of
from ..ranks import Rows
from ..results.checkpoint import ANEW, Checkpoint, CheckpointError
from ..results.folder import state_files
from ..results.tables import write_tables
from .run import PUSHES, Run
from .state import State

SECONDS_BETWEEN_CHECKPOINTS = 30.0
"""Least time between two checkpoints in seconds, which bounds the work that is lost when a run is
killed. Chosen: half a minute is little to repeat; shorter intervals would mostly write files.
"""

PAUSE_SHARE = 20
"""Least pause after writing a checkpoint, or the tables, divided by the time that the writing took:
a run spends at most about a twentieth of its time on either.
"""

SECONDS_BETWEEN_TABLES = 1.0
"""Seconds added to the pause after the tables were written; omitted when a state is recorded. A
watched file thus shows increments, but fast runs do not write for each one.
"""


class Checkpoints:
    """Writer and reader of the checkpoints of a run; for a run without a folder none is written.

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
        # With a circle of references the body would stay in memory until a collection of garbage.
        self.run = weakref.proxy(run)
        self._share = run.body.share
        self._rows = cache(partial(rows_of, run.body))
        self.resumable = False
        self._due = time.monotonic() + SECONDS_BETWEEN_CHECKPOINTS

    @property
    def late(self) -> bool:
        """Return whether the run has a folder and the time for its next checkpoint has come."""
        return self.run.folder is not None and time.monotonic() >= self._due

    @property
    def identity(self) -> dict:
        """Return the entries by which a checkpoint is recognized as one of this run: scene,
        force and sizes of the body.
        """
        run = self.run
        share = self._share
        pairs = share.total(int(share.own[run.body.bonds.first].sum()))
        return {**run.contents, "n_points": share.size, "n_pairs": pairs}

    def write(self, progress: dict, arrays: dict[str, np.ndarray]) -> None:
        """Write a checkpoint of the run, with the entries `progress` and the `arrays` of the
        present stage added.
        """
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
            "outside": self._share.total((run.force.pairs_outside, run.force.most_outside)),
        }
        held = {**self._held(), **arrays}
        if run.earlier is not None:
            held["earlier"] = run.earlier[1]
        whole = {key: self._rows_of(key).gather(array) for key, array in held.items()}
        identity = self.identity  # evaluated on all ranks, which compute its sums together
        if run.ranks.rank == 0:
            Checkpoint({**common, **progress}, whole).write(run.folder, identity)
        ended = time.monotonic()
        self.resumable = True
        self._due = ended + max(SECONDS_BETWEEN_CHECKPOINTS, PAUSE_SHARE * (ended - began))

    def restore(self) -> Checkpoint:
        """Restore the run from its checkpoint, except for the present stage and the states, and
        return the checkpoint with this rank's rows of arrays.
        """
        run = self.run
        held = self._held()
        identity = self.identity
        shapes = {
            key: ((self._rows_of(key).size, *array.shape[1:]), array.dtype)
            for key, array in held.items()
        }
        with run.ranks.together():
            whole = None if run.ranks.rank else Checkpoint.read(run.folder, identity, shapes)
            if whole:
                self._check_states(len(whole.progress["moments"]))
        progress, keys = run.ranks.to_all(whole and (whole.progress, list(whole.arrays)))
        arrays = {key: self._rows_of(key).hand_out(whole and whole.arrays[key]) for key in keys}
        if progress["precision"] != run.force.precision:
            run.take_double()
            held |= run.force.state_arrays
        for key, array in held.items():
            array[:] = arrays[key]
        run.force.elapse(0.0)
        run.state = State(**progress["state"])
        if progress["earlier"] is not None:
            run.earlier = progress["earlier"], arrays["earlier"].copy()
        if run.damage is not None:
            run.damage.restore()
        run.break_again()
        self.resumable = True
        run.force.evaluations = progress["evaluations"]
        run.force.pairs_outside, run.force.most_outside = (
            (0, 0) if run.ranks.rank else progress["outside"]
        )
        return Checkpoint(progress, arrays)

    def _check_states(self, most: int) -> None:
        """Raise CheckpointError if the file of one of the first `most` states is missing."""
        run = self.run
        name = run.problem.scene.name
        there = {path.stem for _, path in state_files(run.folder, name)}
        for number in range(most):
            file = f"{name}-{number:03d}"
            if file not in there:
                raise CheckpointError(
                    f"{run.folder} has a checkpoint, but not the file {file} (.vtu or .pvtu) of a"
                    f" state before it; {ANEW}"
                )

    def _held(self) -> dict[str, np.ndarray]:
        """Return the arrays, by name, that every checkpoint of the run contains: positions,
        pushes of obstacles, state of the force, and damage.
        """
        run = self.run
        damage = (
            {} if run.damage is None else {"broken": run.damage.broken, "recent": run.damage.recent}
        )
        return {**run.arrays(), **damage}

    def _rows_of(self, key: str) -> Rows:
        """Return the correspondence of local and whole-body rows for an array of a checkpoint, by
        its name.

        Rows of damage are pairs, rows of a state array are of the kind that `StateArray.rows`
        names, those of pushes are places on the boundary, other rows are points.
        """
        of_force = {array.name: array.rows for array in self.run.force.states}
        if key == PUSHES:  # on every rank all of them
            places = len(self.run.loads.pushes)
            leads = np.full(places, self._share.is_first)
            return Rows(self.run.ranks, np.arange(places), leads, places)
        kind = "pairs" if key in ("broken", "recent") else of_force.get(key, "points")
        return self._rows(kind)


class Record:
    """Writer of the tables of a run (history, convergence and summary) to its folder while it runs.

    Parameters
    ----------
    run : Run
    summary : dict
        Summary of the run at its start, of which later tables contain updated copies.
    """

    def __init__(self, run: Run, summary: dict) -> None:
        # With a circle of references the body would stay in memory until a collection of garbage.
        self._run = weakref.proxy(run)
        self._summary = summary
        self._began = time.monotonic()
        self._earliest = 0.0

    def keep_if_due(self, rest: float = SECONDS_BETWEEN_TABLES) -> None:
        """Write the tables if they are due.

        They are due after a pause of `PAUSE_SHARE` times the time that their last writing took, and
        `rest` seconds more.
        """
        run = self._run
        state = self._run.state
        began = time.monotonic()
        if began < self._earliest + rest:
            return
        reached = {
            "n_force_evaluations": run.force.evaluations,
            "seconds_total": self._summary["seconds_total"] + began - self._began,
            "levels": state.levels,
            "states": len(run.states),
            **({"n_steps": state.steps} if "n_steps" in self._summary else {}),
            **(
                run.problem.critical_stretches.summary | {"crack": state.crack}
                if state.crack is not None
                else {}
            ),
        }
        write_tables(
            run.folder,
            self._summary | reached,
            state.history,
            state.convergence,
            run.problem.scene.units,
        )
        ended = time.monotonic()
        self._earliest = ended + PAUSE_SHARE * (ended - began)
