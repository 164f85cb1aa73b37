"""Programme of a run: its stages in turn, from the first or from where a checkpoint was written."""

from __future__ import annotations

import warnings

from ..results.checkpoint import CheckpointError
from ..solvers import EquilibriumSolver, TooSmall, Unstable
from .levels import Way, go_through, solver_of
from .run import Run
from .transient import Transient


class SinglePrecisionLeft(RuntimeWarning):
    """A run goes on in double precision, since single does not resolve its strains.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.run.simulate import SinglePrecisionLeft
    >>> issubclass(SinglePrecisionLeft, RuntimeWarning)
    True
    """


def go(run: Run, resume: bool) -> None:
    """Go through the stages of the programme that are left."""
    solver = solver_of(run)
    transient = _take_up(run, solver) if resume else None
    if run.record_of_folder is not None:
        run.record_of_folder.keep()
    while run.stage < len(run.stages) and not (run.crack is not None and run.crack["through"]):
        stage = run.stages[run.stage]
        if stage.inertia is None:
            try:
                follows = run.stage + 1 if go_through(run, solver, stage) else _dynamics_after(run)
            except TooSmall as error:
                if not run.takes_double():
                    raise
                _take_double(run, error)
                solver = solver_of(run)
                continue
            run.velocities = None
        else:
            if transient is None:
                transient = Transient(run, stage)
                transient.begin()
            transient.go()
            run.velocities, run.earlier, follows = transient.integrator.velocities, None, run.stage + 1
            run.elapsed += transient.account.time
            transient = None
        run.stage, run.outputs, run.begin = follows, 0, run.parameter


def _take_double(run: Run, error: TooSmall) -> None:
    """Go on in double precision, and warn of it."""
    reason = f"{error}: the forces are evaluated in double precision from here on"
    run.note(run.parameter, reason=reason)
    if run.ranks.rank == 0:
        warnings.warn(f"{run.loading.at(run.target)}: {reason}", SinglePrecisionLeft, stacklevel=4)
    run.take_double()
    run.loading.apply(run.parameter, run.loaded, run.positions)


def _dynamics_after(run: Run) -> int:
    """Return the number of the next stage in dynamics, which takes over where a bond would break in equilibrium.

    Raises
    ------
    Unstable
        If there is none.
    """
    following = [number for number, stage in enumerate(run.stages) if number > run.stage and stage.inertia is not None]
    if not following:
        raise Unstable(f"a bond would break between {run.loading.at(run.parameter)} and here: what follows is not in equilibrium")
    return following[0]


def _take_up(run: Run, solver: EquilibriumSolver) -> Transient | None:
    """Bring a run to where its checkpoint was written; return the dynamics if it was in them."""
    try:
        checkpoint = run.checkpoints.restore()
        if checkpoint.progress["phase"] == "dynamics":
            transient = Transient(run, run.stages[run.stage])
            transient.resume(checkpoint)
            return transient
        solver.gave_up = bool(checkpoint.progress["gave_up"])
        run.way = Way.resumed(run, checkpoint)
        run.loading.apply(run.parameter, run.loaded, run.positions)
        return None
    except CheckpointError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise CheckpointError(f"the checkpoint in {run.folder} is damaged ({error}); run without resume") from None
