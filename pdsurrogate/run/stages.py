"""Loop over the stages of a run's program, from the first stage or from a checkpoint, with a
change to double precision if needed.
"""

import warnings

from ..results.checkpoint import CheckpointError
from ..results.states import Moment
from ..solvers.equilibrium import EquilibriumSolver, TooSmall, Unstable
from .checkpoints import Checkpoints
from .controlled import displacement_of, prepare
from .levels import Equilibria, solver_of
from .run import Run
from .transient import Transient


class SinglePrecisionLeft(RuntimeWarning):
    """Warning that a run continues in double precision, since single precision does not resolve its
    strains.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.run.simulate import SinglePrecisionLeft
    >>> issubclass(SinglePrecisionLeft, RuntimeWarning)
    True
    """


def ready(
    run: Run, resume: bool
) -> tuple[EquilibriumSolver, Checkpoints, Equilibria | Transient | None]:
    """Return the solver, the checkpoints and, with `resume`, the present stage of a run, which is
    restored from its checkpoint; nothing is written before the checkpoint is accepted.

    Raise CheckpointError if the run cannot resume from its folder.
    """
    prepare(run)
    solver = solver_of(run)
    checkpoints = Checkpoints(run)
    return solver, checkpoints, _resumed(run, solver, checkpoints) if resume else None


def go(
    run: Run,
    solver: EquilibriumSolver,
    checkpoints: Checkpoints,
    current: Equilibria | Transient | None,
) -> None:
    """Run the remaining stages of the program, see `ready`."""
    state = run.state
    while state.stage < len(run.stages) and not (
        state.crack is not None and state.crack["through"]
    ):
        if current is None:
            current = _stage_of(run, solver, checkpoints)
            if isinstance(current, Transient):
                current.begin()
        lost = ""
        try:
            follows = state.stage + 1 if current.go() else _dynamics_after(run)
        except TooSmall as error:
            if not run.takes_double():
                raise
            lost = str(error)
        if lost:  # here nothing holds the search that failed any more
            current = None
            _take_double(run, lost)
            solver = solver_of(run)
            continue
        if isinstance(current, Transient):
            run.velocities = current.integrator.velocities
            run.earlier = None
            state.elapsed += current.account.time
        else:
            run.velocities = None
            state.elapsed += state.time
            state.time = 0.0
        state.stage = follows
        state.outputs = 0
        current = None
        state.begin = _begin(run)


def _stage_of(
    run: Run, solver: EquilibriumSolver, checkpoints: Checkpoints
) -> Equilibria | Transient:
    """Return a new object for the present stage of a run, in equilibrium or in dynamics."""
    stage = run.stages[run.state.stage]
    if stage.inertia is not None:
        return Transient(run, stage, checkpoints)
    if stage.tears:
        from .tearing import Tearing  # what most scenes do not need

        return Tearing(run, stage, solver, checkpoints)
    if stage.duration is not None and any(law.memory.branches for law, _ in run.force.laws):
        from .relaxing import Relaxing  # what most scenes do not need

        return Relaxing(run, stage, solver, checkpoints)
    return Equilibria(run, stage, solver, checkpoints)


def _begin(run: Run) -> float:
    """Return where the present stage begins: the loading parameter, or the displacement that the
    stage controls.
    """
    stage = run.stages[run.state.stage] if run.state.stage < len(run.stages) else None
    return (
        run.state.parameter
        if stage is None or stage.control is None
        else displacement_of(run, stage.control, run.positions)
    )


def _take_double(run: Run, lost: str) -> None:
    """Change a run to double precision, since single precision does not resolve the strains as
    `lost` says, and warn of it.
    """
    reason = f"{lost}: from here on, forces are evaluated in double precision"
    run.note(run.state.parameter, reason=reason)
    if run.ranks.rank == 0:
        warnings.warn(f"{run.loading.at(run.target)}: {reason}", SinglePrecisionLeft, stacklevel=4)
    run.take_double()
    run.loading.apply(run.state.parameter, run.loaded, run.positions)


def _dynamics_after(run: Run) -> int:
    """Return the number of the next stage in dynamics, and warn that the run continues with it
    since a bond would break in equilibrium.

    Raises
    ------
    Unstable
        If no stage in dynamics follows.
    """
    following = [
        number
        for number, stage in enumerate(run.stages)
        if number > run.state.stage and stage.inertia is not None
    ]
    if not following:
        raise Unstable(
            f"a bond breaks after {run.loading.at(run.state.parameter)}: add a step in dynamics,"
            " which a running crack needs"
        )
    if run.ranks.rank == 0:
        begin = run.loading.at(run.state.parameter)
        warnings.warn(
            f"a bond would break in equilibrium between {begin} and {run.loading.at(run.target)}:"
            f" the dynamics start at {begin}, the last output; add outputs before the break to"
            " start closer to it",
            stacklevel=4,
        )
    return following[0]


def _resumed(
    run: Run, solver: EquilibriumSolver, checkpoints: Checkpoints
) -> Equilibria | Transient | None:
    """Restore a run and its present stage from its checkpoint, and return the stage; raise
    CheckpointError for a damaged checkpoint.
    """
    try:
        checkpoint = checkpoints.restore()
        stage = _stage_of(run, solver, checkpoints)
        stage.resume(checkpoint)
        moments = [Moment(*moment) for moment in checkpoint.progress["moments"]]
        run.states = run.states_of(moments)  # last, as it writes the index of the states
        return stage
    except CheckpointError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise CheckpointError(
            f"the checkpoint in {run.folder} is damaged ({error}); run without --resume"
        ) from None
