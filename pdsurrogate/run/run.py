"""Simulation in progress: the problem, its forces, and the state that the sequence of stages
advances.
"""

import copy
import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numba
import numpy as np

from ..body import Body, Cells, ReflectionPlane
from ..engine.threads import threads_for
from ..forces import ForceModel
from ..forces.internal_force import numbers_in_place
from ..problem import Problem, Stage, compile_scene
from ..problem.materials import scene_errors
from ..progress import event
from ..ranks import Communicator, communicator
from ..results import measures
from ..results.contents import contents_of
from ..results.states import Moment, States, StatesInFiles
from ..scenes import Mesh, Scene
from ..solvers.loads import LoadedForce
from .damage import Damage
from .interruption import Interruption
from .state import State

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


class Run:
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
    ranks : Communicator, optional
        Ranks that share the run; by default all.

    Attributes
    ----------
    interruption : Interruption
        Requests to end the run early, by a signal or a time limit; by default only by a signal.
    problem : Problem
    force : InternalForce
    loaded : InternalForce or LoadedForce
        Force that the solvers for equilibrium evaluate: `force` plus loads, supports at places
        between points, and rigid regions, if any.
    body, loading, loads, stages
        Attributes of the problem.
    whole : Body or None
        The whole body; None on ranks other than the first.
    positions : ndarray, shape (n, d)
    state : State
        Number of the present stage, loading parameter and recorded numbers, as stored in
        checkpoints.
    target : float
        Loading parameter of the next output.
    velocities : ndarray, shape (n, d), or None
        Velocities with which a stage in dynamics ended; None after equilibrium.
    earlier : tuple of float and ndarray, or None
        Parameter and positions of the equilibrium before the last, from which the next first guess
        may be extrapolated.
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
        ranks: Communicator | None = None,
    ) -> None:
        self.model, self.folder = models[0], folder
        self.interruption, self.ranks = Interruption(), ranks or communicator()
        self.problem = compile_scene(scene, models, self.ranks)
        self.contents = contents_of(scene, models)
        self.body, self.loading, self.loads = (
            self.problem.body,
            self.problem.loading,
            self.problem.loading.loads,
        )
        self.stages: tuple[Stage, ...] = self.problem.stages
        paying = threads_for(len(self.body.bonds.first))
        self.threads = (
            (threads or paying)
            if self.ranks.size == 1
            else _threads_of(self.ranks, threads, paying)
        )
        numba.set_num_threads(self.threads)
        if self.ranks.size > 1:
            _compile_first(self.ranks, self.model, self.problem)
        self.force, self.loaded = self.problem.bind()
        portion_of = self.force.portion_of
        if portion_of is not None:  # of the whole body
            portion_of = self.ranks.to_all(self.body.share.gather(portion_of[: len(self.body)]))
        with scene_errors(scene):
            self.probes = measures.Probes(
                self.problem.whole, scene.probes, portion_of, self.body.share
            )
        self.whole = None if self.ranks.rank else self.problem.whole

        self.positions = self.body.points.copy()
        self.state = State(self.loading.rest, self.loading.rest)
        self.target = self.loading.rest
        self.velocities: np.ndarray | None = None
        self.earlier: tuple[float, np.ndarray] | None = None
        self.residual: float | None = None
        critical = self.problem.critical_stretches
        self.damage = None if critical is None else Damage(self.body, critical.of_pairs())
        self.states = self.states_of()
        self.keep_tables: Callable[..., None] = lambda *_: None

    @property
    def measures_cracks(self) -> bool:
        """Whether the results have energy release rates: of a body with precuts, whose force has
        an energy.
        """
        return bool(self.problem.scene.precuts) and self.force.has_energy

    def warm_up(self) -> None:
        """Evaluate the force once, so that all kernels are compiled, and reset the clock of the
        evaluations.
        """
        self.force(self.positions, np.empty_like(self.positions))
        self.force.seconds, self.force.timed = 0.0, 0

    def arrays(self) -> dict[str, np.ndarray]:
        """Return, by name, the arrays that together define an equilibrium: the positions, the
        pushes of obstacles, and the state arrays of the force.
        """
        return {"positions": self.positions, **self.contact, **self.force.state_arrays}

    @property
    def contact(self) -> dict[str, np.ndarray]:
        """The pushes of obstacles by the name of their array, if there are any."""
        return {PUSHES: self.loads.pushes} if self.loads.obstacles else {}

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
        old = self.force
        self.force, self.loaded = self.problem.bind("float64")
        for key, array in self.force.state_arrays.items():
            array[:] = old.state_arrays[key]
        self.break_again()
        self.force.evaluations, self.force.pairs_outside, self.force.most_outside = (
            old.evaluations,
            old.pairs_outside,
            old.most_outside,
        )
        self.force.seconds, self.force.timed = old.seconds, old.timed

    def beside(self, scene: Scene, models: Sequence[ForceModel], parameter: float) -> "Run":
        """Return a run on the same body, in double precision, at a value of the loading
        parameter, for a scene as in `Problem.changed`.
        """
        other = self._of(self.problem.changed(scene, models), parameter)
        other.force, other.loaded = other.problem.bind("float64")
        return other

    def _of(self, problem: Problem, parameter: float) -> "Run":
        """Return a run of another problem on the same body, at the positions of this one, with
        its force still to be bound.
        """
        other = copy.copy(self)
        other.problem, other.positions, other.state = (
            problem,
            self.positions.copy(),
            State(parameter, parameter),
        )
        other.loading, other.loads = problem.loading, problem.loading.loads
        other.loads.pushes[:] = self.loads.pushes
        return other

    @contextmanager
    def lending_force(
        self, scene: Scene, models: Sequence[ForceModel], parameter: float
    ) -> Iterator["Run"]:
        """Provide a run as `beside` returns, which has the force of this run with other numbers
        until the end of a ``with`` block.

        The run binds a force of its own if the points of the materials differ, as where a change
        makes two like materials different.
        """
        other, numbers = (
            self._of(self.problem.changed(scene, models), parameter),
            np.arange(len(self.body)),
        )
        theirs, ours = (
            [numbers[portion.points] for portion in portions]
            for portions in (other.problem.portions, self.force.portions)
        )
        if len(theirs) != len(ours) or not all(map(np.array_equal, theirs, ours)):
            other.force, other.loaded = other.problem.bind("float64")
            yield other
            return
        other.loaded = LoadedForce(
            self.force, other.loads, other.loading.supports, self.loaded.rigid
        )
        with numbers_in_place(
            self.force, [(portion.law, portion.model) for portion in other.problem.portions]
        ):
            yield other

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
            event(stage, self.state.stage + min(share, 1.0), len(self.stages), **numbers)
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
        """Store the fields of the present state; in dynamics `time` is the time since the stage
        began.
        """
        damage = None if self.damage is None else self.damage.at_points()
        fields = measures.point_fields(measures.PointState(self.force, self.positions, damage))
        if not self._in_pieces:
            fields = {name: self.body.share.gather(values) for name, values in fields.items()}
        equilibria, since = (
            sum("time" not in level for level in self.state.levels),
            self.state.elapsed + time,
        )
        moment = Moment(
            **{
                "run_time": equilibria + since,
                "time": since,
                self.loading.parameter: self.state.parameter,
            }
        )
        self._count_beyond_data(moment)
        self.states.append(moment, fields)
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

    def strain_energy(self) -> float:
        """Return the body's strain energy in the state last evaluated, in two dimensions per
        unit thickness (`measures.strain_energy`).
        """
        return self.body.share.total(measures.strain_energy(self.force))

    def unsupported_points(self) -> int:
        """Return the number of points of the whole body that have too few bonds left for a
        deformation gradient.
        """
        return self.body.share.total(
            int(np.count_nonzero(~self.force.supported & self.body.share.own))
        )

    def counted_pairs(self) -> int:
        """Return the number of pairs whose first point this rank owns: in one process the number
        of all pairs.
        """
        return int(np.count_nonzero(self.body.share.own[self.body.bonds.first]))

    def directed_bonds(self) -> int:
        """Return the number of directed bonds at this rank's own points, without ghosts: an
        undirected bond counts at each end.
        """
        bonds, own = self.body.bonds, self.body.share.own
        within = bonds.second < len(self.body)
        return int(
            np.count_nonzero(own[bonds.first[within]]) + np.count_nonzero(own[bonds.second[within]])
        )


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


def _compile_first(ranks: Communicator, model: ForceModel, problem: Problem) -> None:
    """Compile the kernels on the first rank before the others, which then load them and do not
    compete for its cores.
    """
    if ranks.rank == 0:
        dimension = problem.body.dimension
        cells = Cells.filling(
            (0.0,) * dimension, (8.0 if dimension == 2 else 5.0,) * dimension, 1.0
        )
        points = cells.centers()
        planes = (ReflectionPlane(0, 0.0, -1, (-1,) * dimension),)
        body = Body(
            points,
            np.full(len(points), cells.volume),
            problem.body.horizon / problem.body.spacing,
            1.0,
            planes=planes,
        )
        force = model.bind(body, problem.law, problem.settings)
        force(points.copy(), np.empty_like(points))
    ranks.barrier()
