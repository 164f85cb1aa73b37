"""Simulation in progress: the problem, its forces, and the state that the sequence of stages
advances.
"""

import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numba
import numpy as np

from ..engine.threads import threads_for
from ..forces import ForceModel
from ..problem import Problem, compile_scene
from ..progress import event
from ..ranks import Communicator, communicator
from ..results import measures
from ..results.contents import contents_of
from ..results.states import Moment, States, StatesInFiles
from ..scenes import Mesh, Scene
from .damage import Damage
from .interruption import Interruption
from .system import System, bound

MOST_GATHERED = 500_000
"""Number of points of a body on several ranks (parallel processes) beyond which each rank writes
its own piece of a state.

Gathering the state of so many points costs the first rank 0.16 GB and 10 s of processor time, while
the others wait.
"""


PUSHES = "pushes"
"""Name of the array of `Loads.pushes` in checkpoints."""


class Oversubscribed(RuntimeWarning):
    """Warning that the ranks have more threads in total than there are cores: a waiting rank
    loops, on a core that another rank needs.
    """


class Run(System):
    """Simulation in progress, with its body, force, loading and recorded results.

    Parameters
    ----------
    scene : Scene
    models : sequence of ForceModel
        Force model of the body outside the regions of the scene's `materials`, then one for each of
        these, as from `checked_models`.
    folder : Path, optional
        Folder for states and checkpoints, written as they are reached.
    threads : int, optional
        Number of threads of the kernels; by default as many as speed up a body of this size.

    Attributes
    ----------
    interruption : Interruption
        Requests to end the run early, by a signal or a time limit; by default only by a signal.
    problem, force, loaded, probes, positions, state
        As of `System`.
    whole : Body or None
        The whole body; None on ranks other than the first.
    target : float
        Loading parameter of the next output.
    velocities : ndarray, shape (n, d), or None
        Velocities with which a stage in dynamics ended; None after equilibrium.
    earlier : tuple of float and ndarray, or None
        Parameter and positions of the equilibrium before the last, from which the next first guess
        may be extrapolated; or of the next one as far as single precision found it.
    damage : Damage or None
        None without fracture.
    residual : float or None
        Latest residual of the search for equilibrium.
    states : States
    keep_tables : callable
        ``keep_tables(rest)`` writes the tables in the folder if they are due, see
        `checkpoints.Record`; by default it does nothing.
    """

    def __init__(
        self,
        scene: Scene,
        models: Sequence[ForceModel],
        folder: Path | None = None,
        threads: int | None = None,
    ) -> None:
        ranks = communicator()
        problem = compile_scene(scene, models, ranks)
        paying = threads_for(len(problem.body.bonds.first))
        self.threads = (
            (threads or paying) if ranks.size == 1 else _threads_of(ranks, threads, paying)
        )
        numba.set_num_threads(self.threads)
        super().__init__(**vars(bound(problem)))
        self.model = models[0]
        self.folder = folder
        self.interruption = Interruption()
        self.contents = contents_of(scene, models)
        self.stages = problem.stages
        self.whole = None if ranks.rank else problem.whole
        self.target = self.loading.rest
        self.velocities: np.ndarray | None = None
        self.earlier: tuple[float, np.ndarray] | None = None
        self.followed: object = None
        self.residual: float | None = None
        critical = problem.critical_stretches
        self.damage = None if critical is None else damage_of(problem)
        self.states = self.states_of()
        self.keep_tables: Callable[..., None] = lambda *_: None

    def warm_up(self) -> None:
        """Evaluate the force once, so that all kernels are compiled, and reset the clock of the
        evaluations.
        """
        self.force(self.positions, np.empty_like(self.positions))
        self.force.seconds = 0.0
        self.force.timed = 0

    def arrays(self) -> dict[str, np.ndarray]:
        """Return, by name, the arrays that together define an equilibrium: the positions, the
        pushes of obstacles, and the state arrays of the force.
        """
        contact = {PUSHES: self.loads.pushes} if self.loads.obstacles else {}
        return {"positions": self.positions, **contact, **self.force.state_arrays}

    def accept(self) -> None:
        """Add the present equilibrium to the history of the force."""
        self.force.accept(self.positions)

    def takes_double(self) -> bool:
        """Return whether the run may change to double precision: the scene sets no precision,
        and all force models support it.
        """
        settings = self.problem.settings
        if settings.precision is not None or self.force.precision == "float64":
            return False
        return all(
            "float64" in model.honored(settings.plane)["precision"] for model in self.problem.models
        )

    def take_double(self) -> None:
        """Replace the force by one in double precision, with the same state, broken bonds and
        counters.
        """
        counters = ("evaluations", "pairs_outside", "most_outside", "seconds", "timed")
        counts = {name: vars(self.force)[name] for name in counters}
        arrays = self.force.state_arrays
        del self.force, self.loaded  # before the next one, which is as large
        self.force, self.loaded = self.problem.bind("float64")
        for key, array in self.force.state_arrays.items():
            array[:] = arrays[key]
        self.break_again()
        vars(self.force).update(counts)

    def break_again(self) -> None:
        """Remove all broken bonds of the run from its force again, after the force was bound to
        the body anew or a checkpoint was read.
        """
        if self.damage is not None and self.body.share.any(bool(self.damage.broken.any())):
            self.force.break_bonds(np.flatnonzero(self.damage.broken))

    def states_of(self, moments: list[Moment] | None = None) -> States:
        """Return the storage for states of the run, in memory or in its folder; `moments` are
        the times of states already recorded.
        """
        writer = self.body if self._in_pieces else self.whole
        if writer is None or self.folder is None:
            return States(moments)
        return StatesInFiles(self.folder, self.problem.scene.name, writer, moments)

    @property
    def _in_pieces(self) -> bool:
        """Return whether every rank writes the states of its own points, as for bodies that are
        too large for one rank to write.
        """
        large = self.body.share.size > MOST_GATHERED
        return (
            large
            and self.ranks.size > 1
            and self.folder is not None
            and not isinstance(self.problem.scene.body, Mesh)
        )

    def report(self, stage: str, share: float, parameter: float, **numbers) -> None:
        """Report the share done of the present stage, with numbers by name, and write the tables
        in the folder if they are due.
        """
        if not self.ranks.rank:
            numbers = {self.loading.parameter: parameter, **numbers}
            # Stages with more outputs mostly take longer.
            outputs = [one.outputs for one in self.stages]
            number = self.state.stage
            done = sum(outputs[:number]) + min(share, 1.0) * outputs[number]
            event(stage, done, sum(outputs), **numbers)
        self.keep_tables()

    def note(self, increment: float, **entries) -> None:
        """Add a row to the table of convergence, with the given entries.

        The row is about an increment on the way to the output at `target`, and `increment` is the
        loading parameter at the end of it.
        """
        place = {
            self.loading.parameter: self.target,
            "increment": increment,
            "evaluation": self.force.evaluations,
        }
        self.state.convergence.append(place | entries)

    def record(self, time: float = 0.0) -> None:
        """Store the fields of the present state, at a `time` since the stage began."""
        damage = None if self.damage is None else self.damage.at_points()
        state = measures.PointState(self.force, self.positions, damage)
        share = self.body.share
        gathers = share.divided and not self._in_pieces
        parts = measures.fields_by_part(state, len(self.body) if gathers else self.states.part)
        if gathers:
            parts = (
                {name: share.gather(values) for name, values in fields.items()} for fields in parts
            )
        equilibria = sum("time" not in level for level in self.state.levels)
        since = self.state.elapsed + time
        moment = Moment(
            **{
                "run_time": equilibria + since,
                "time": since,
                self.loading.parameter: self.state.parameter,
            }
        )
        self._count_beyond_data(moment)
        self.states.append(moment, parts)
        self.keep_tables(0.0 if len(self.states) > 1 else -np.inf)

    def _count_beyond_data(self, moment: Moment) -> None:
        """Add a row to ``state.beyond_data``: the fraction of bonds beyond the test data, and the
        greatest distance from these data.

        For an energy learned from test data the fraction is that of points. For a force that is not
        learned from test data no row is added.
        """
        beyond = self.force.learned.beyond_data()
        if beyond is None:
            return
        total, outside = (
            self.body.share.total(int(count))
            for count in (len(beyond), np.count_nonzero(beyond > 0))
        )
        farthest = self.body.share.greatest(float(beyond.max(initial=0.0)))
        row = {"run_time": moment.run_time, self.loading.parameter: self.state.parameter}
        self.state.beyond_data.append(
            row | {"share": outside / max(total, 1), "log_stretch": farthest}
        )


def damage_of(problem: Problem) -> Damage:
    """Return the damage of the body of a problem with fracture."""
    assert problem.critical_stretches is not None  # of a scene with fracture
    limits = problem.critical_stretches.of_pairs()
    if problem.strengths is None:
        return Damage(problem.body, limits)
    from .strength import StrongDamage  # loaded for scenes with a strength alone

    return StrongDamage(problem.body, limits, problem.strengths)


def _threads_of(ranks: Communicator, asked: int | None, paying: int) -> int:
    """Return this rank's number of threads, and warn if the ranks on this machine have more threads
    in total than there are cores.

    The number is `asked`, or without it `paying`, the most that speed up the run, limited to the
    rank's share of the cores.
    """
    here = ranks.here()
    cores = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    threads = asked or max(1, min(paying, cores // here))
    if here * threads > cores and ranks.rank == 0:
        what = f"{here} ranks of {threads} thread{'s' * (threads > 1)} each share {cores} cores"
        warnings.warn(
            f"{what}: waiting ranks slow the others down; do not start more ranks than cores",
            Oversubscribed,
            stacklevel=3,
        )
    return threads
