"""Simulation of a scene with a force model by `simulate`, from the checks of its arguments to
the result, and the errors it raises.
"""

from __future__ import annotations

import logging
import math
import time
import warnings
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from .. import artifacts
from ..arguments import check_kind, check_path, check_seconds, check_whole_number
from ..engine.compile import compilation_clock
from ..engine.threads import thread_count
from ..forces import (
    ForceModel,
    InvalidState,
    OutsideDomain,
    OutsideDomainWarning,
    OwnBondForce,
    OwnForceFailed,
    OwnForceInvalid,
    is_own_force,
)
from ..problem.materials import checked_models, scene_errors
from ..progress import COMPILING, event
from ..ranks import Communicator, communicator
from ..results import Result
from ..results.checkpoint import checkpoint_in
from ..results.contents import contents_of
from ..results.files import remove_leftovers
from ..results.folder import (
    DONE,
    FAILED,
    INTERRUPTED,
    RUNNING,
    check_room,
    claim,
    occupied,
)
from ..results.tables import write_tables
from ..scenes import Scene, SceneError, load_scene
from ..solvers.conditions import FoldedOver
from ..solvers.equilibrium import (
    Diverging,
    NotConverged,
    RanAway,
    TooFar,
    TooSmall,
    Unbalanced,
    Unstable,
)
from ..solvers.obstacles import Obstructed
from .checkpoints import Record
from .interruption import Interrupted, Interruption
from .outcome import result_of
from .run import Run
from .stages import SinglePrecisionLeft, go, ready

if TYPE_CHECKING:
    from sklearn.base import BaseEstimator

logger = logging.getLogger(__name__)

__all__ = ["SimulationFailed", "SimulationInterrupted", "SinglePrecisionLeft", "simulate"]


class SimulationFailed(RuntimeError):
    """Error for a run that stopped before its end.

    Parameters
    ----------
    message : str
        Reason, with time or stretch, place and what to change.
    result : Result
        Outputs that the run reached, which the error has as its attribute ``result``.

    See Also
    --------
    pdsurrogate.simulate : raises the error.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> scene = pds.load_scene("uniaxial", {"spacing": 0.25, "solver.most_evaluations": 2})
    >>> try:
    ...     pds.simulate(scene, "neo-hookean")
    ... except pds.SimulationFailed as failure:
    ...     print(len(failure.result.levels))
    0
    """

    def __init__(self, message: str, result: Result) -> None:
        super().__init__(message)
        self.result = result


class SimulationInterrupted(SimulationFailed):
    """Error for a run that was stopped by Ctrl-C or at its time limit; with a folder, this contains
    a checkpoint of the run.

    Parameters
    ----------
    message : str
        What stopped the run, and how to resume it.
    result : Result
        Outputs that the run reached, which the error has as its attribute ``result``.
    out_of_time : bool
        Whether the time limit `max_time` of the run had passed; also an attribute.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> issubclass(pds.SimulationInterrupted, pds.SimulationFailed)
    True
    """

    def __init__(self, message: str, result: Result, out_of_time: bool = False) -> None:
        super().__init__(message, result)
        self.out_of_time = out_of_time


UNDER_WAY = "the run is under way, or was ended from without"
"""Entry `failure` of the summary of a run that has not ended."""


ADVICE = {
    NotConverged: (
        "increase solver.most_evaluations, decrease solver.largest_increment, or use another"
        " solver.method"
    ),
    Diverging: "use another solver.method",
    TooSmall: (
        "apply larger strains and scale the results, or describe the body nearer to the origin"
    ),
    Unbalanced: (
        "use a smaller solver.tolerance, or larger strains if they are below a millionth; for bond"
        " forces where two edges held by reflection meet, use force=bond-energy, support=points or"
        " a smaller spacing"
    ),
    TooFar: "use a smaller steps.largest_increment, or more outputs",
    Unstable: "compress the body less, or continue in dynamics",
    RanAway: (
        "the load may exceed its maximum, like the pressure in a balloon: prescribe displacements"
        " instead, or continue in dynamics"
    ),
    FoldedOver: (
        "contact is modeled at obstacles alone, and a smaller spacing folds earlier: add an"
        " obstacle that continues the plane (to prescribed and steps, not to grips), compress the"
        " body less, make the free side concave, or let the body slide there (do not prescribe the"
        " components along the plane)"
    ),
    Obstructed: (
        "let obstacles move less, or in smaller increments (steps.largest_increment), and not into"
        " held parts of the boundary"
    ),
    InvalidState: (
        "use a smaller spacing; if that does not help, the material cannot be deformed this far"
    ),
}
"""Advice for error messages by the type of error with which a stage in equilibrium fails."""

DYNAMICS_ADVICE = (
    "use a smaller dynamics.safety, more dynamics.viscosity or damping, or a smaller spacing"
)

ENERGY_ADVICE = "or a force with an energy (bond-energy)"

SINGLE_ADVICE = "or use precision=float64, which has smaller rounding errors"


def simulate(
    scene: Scene | str | Path,
    force: str | Path | ForceModel | BaseEstimator | None = None,
    *,
    threads: int | None = None,
    folder: str | Path | None = None,
    resume: bool = False,
    overwrite: bool = False,
    max_time: float | None = None,
) -> Result:
    """Run a scene.

    Parameters
    ----------
    scene : Scene, str or path
        A scene, or the name or file of one, see `pdsurrogate.load_scene`.
    force : str, path, ForceModel, fitted pipeline or object, optional
        A force model, the name of an exact one such as "analytic", or an artifact: NAME,
        NAME@VERSION or a path; or a fitted `pdsurrogate.surrogate_pipeline`, or a scikit-learn
        search (such as GridSearchCV) over one; or an object with a ``bond_force`` or an ``energy``
        (`pdsurrogate.forces.OwnBondForce`), which is assumed to describe the scene's material. A
        built-in scene adopts the material of an artifact's card (stored description), see
        `pdsurrogate.artifacts.with_material`. By default `pdsurrogate.artifacts.default_force`
        chooses the model for the scene.
    threads : int, optional
        Number of threads of the kernels, at most the number that numba was started with; by default
        chosen by the size of the body. The result does not depend on it.
    folder : str or path, optional
        Folder for states, checkpoints, tables and the summary, all written during the run; without
        a folder states stay in memory. Results of the same run (this scene with this force) in the
        folder are replaced; to replace others, set `overwrite`.
    resume : bool
        Continue from the checkpoint in `folder`; the result is that of an uninterrupted run.
    overwrite : bool
        Remove the results of other runs in `folder`, and the checkpoint of this run if it was
        interrupted.
    max_time : float, optional
        Seconds after which the run ends at its next consistent state, with a checkpoint if it has a
        folder.

    Returns
    -------
    Result
        On several ranks (``mpiexec -n 4 python -m mpi4py ...``) only the first rank's result has
        the fields and the whole body.

    Raises
    ------
    TypeError
        If the scene or the force is of none of the accepted types.
    ArtifactError
        If the force cannot be found or read.
    ValueError
        If a pipeline is not fitted, was read from a file, or is too far from the scene's law; or
        for a wrong value of an argument.
    SceneError
        If the scene and the force model do not fit, or the body cannot be built.
    CheckpointError
        If there is nothing to resume from, or it belongs to another run; the folder is then left as
        it is.
    FolderTaken
        If `folder` holds results of another run, a checkpoint of this run from before an
        interruption, or, without a run, a file that has the name of one of a run's files; or if
        another run writes there.
    SimulationInterrupted
        After Ctrl-C or `max_time`, at the next consistent state; its `result` holds the outputs
        reached.
    SimulationFailed
        If an output does not converge, or the deformation leaves the states for which the material
        is defined; its `result` holds the outputs reached.

    See Also
    --------
    pdsurrogate.load_scene : loads a scene.
    pdsurrogate.load_surrogate : loads a force model.
    pdsurrogate.preview : draws the points, supports and loads of a scene before it runs.
    pdsurrogate.Result : what a simulation returns.
    pdsurrogate.study : runs a scene with many parameters.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> scene = pds.load_scene("uniaxial", spacing=0.25, stretches=[1.2, 1.5])
    >>> result = pds.simulate(scene, "neo-hookean")
    >>> result
    <Result of uniaxial with neo-hookean@2: 48 points, 2 states>
    >>> [abs(level["nominal_stress_error"]) < 1e-3 for level in result.levels]
    [True, True]
    """
    began = time.perf_counter()
    if isinstance(scene, str | Path):
        scene = load_scene(scene)
    check_kind(scene, Scene, "scene", "a Scene, or the name or file of one")
    scene, model = _model_of(force, scene)
    _check_arguments(threads, folder, max_time)
    if resume and folder is None:
        raise ValueError("resume: give the folder that contains the checkpoint (folder, or --out)")
    if resume and overwrite:
        raise ValueError(
            "resume and overwrite exclude each other: give one of them (--resume or --overwrite)"
        )
    ranks = communicator()
    if ranks.size > 1:
        _refuse_different(ranks, scene, model, folder, resume)
    with ranks.together():
        models = checked_models(scene, model)
    folder = None if folder is None else Path(folder)
    own = folder if ranks.rank == 0 else None  # of the rank that writes
    with ranks.together():  # before any work
        if own and resume:
            checkpoint_in(own)
        elif own:
            check_room(own, contents_of(scene, models), overwrite)
    # BLAS threads spin for a while after each call, on the cores that the kernels want next.
    held = occupied(own) if own else nullcontext()
    announce = None if ranks.rank else partial(event, COMPILING, 0, 1)
    with (
        held,
        thread_count(threads) as most,
        threadpool_limits(1, user_api="blas"),
        compilation_clock(announce) as clock,
    ):
        run = Run(scene, models, folder, threads and most)
        until = math.inf if max_time is None else began + max_time
        run.interruption = interruption = Interruption(until, ranks.size == 1)
        size = len(run.body), len(run.body.bonds.first), run.threads
        logger.info("%s with %s: %d points, %d bonds, threads: %d", scene.name, model.name, *size)
        run.warm_up()
        program = ready(run, resume)  # before the folder is changed: it may refuse to resume
        if folder is not None:
            begun = result_of(run, clock.seconds, began, UNDER_WAY, RUNNING).summary
            if own and resume:
                remove_leftovers(own)
            elif own:
                claim(own, begun, overwrite)
            if own:
                run.keep_tables = Record(run, begun).keep_if_due
                run.keep_tables(-math.inf)

        def ended(message: str | None, status: str) -> Result:
            result = result_of(run, clock.seconds, began, message, status)
            if own:
                write_tables(own, result.summary, result.history, result.convergence, scene.units)
            _warn_of_domain(run, result.summary["fraction_outside_domain"])
            return result

        try:
            with interruption:
                go(run, *program)
        except (Interrupted, KeyboardInterrupt) as error:
            if isinstance(error, KeyboardInterrupt) and not interruption.told:
                raise
            over = not interruption.told and interruption.out_of_time
            what = f"stopped after max_time, {max_time:g} s" if over else "interrupted"
            message = f"{run.loading.at(run.state.parameter)}: {what}"
            raise SimulationInterrupted(message, ended(message, INTERRUPTED), over) from None
        except (*ADVICE, OutsideDomain, OwnForceFailed) as error:
            message = "; ".join([f"{run.loading.at(run.target)}: {error}", *_advice(run, error)])
            logger.info("the run failed at %s", message)
            raise SimulationFailed(message, ended(message, FAILED)) from error
        logger.info(
            "%s ended: %d evaluations, %.3g s",
            scene.name,
            run.force.evaluations,
            time.perf_counter() - began,
        )
        return ended(None, DONE)


def _warn_of_domain(run: Run, share: float) -> None:
    """Warn if a `share` of the bond evaluations was outside the surrogate's domain, with the
    greatest number of bonds at once.
    """
    most = run.body.share.total(run.force.most_outside)
    policy = run.problem.settings.outside
    if most and policy != "raise" and run.ranks.rank == 0:
        instead = "the surrogate was extrapolated"
        if policy in (None, "fallback"):
            instead = (
                f"the exact {'energy' if run.force.has_energy else 'bond force'} was used instead"
            )
        what = (
            f"{100 * share:.2g} % of the bond evaluations were outside the surrogate's domain,"
            f" where {instead}"
        )
        warnings.warn(f"{what} (at most {most} bonds at once)", OutsideDomainWarning, stacklevel=4)


def _refuse_different(
    ranks: Communicator, scene: Scene, model: ForceModel, folder: str | Path | None, resume: bool
) -> None:
    """Check that all ranks were given the same input, since ranks with different input would wait
    for each other.

    Raises
    ------
    SceneError
        If the inputs differ; the message names the inputs that differ: scene, force, folder or
        resume.
    """
    given = {
        "scene": scene.model_dump_json(),
        "force": model.name,
        "folder": str(folder),
        "resume": resume,
    }
    others = ranks.everywhere(given)
    different = [what for what in given if any(other[what] != others[0][what] for other in others)]
    if different:
        what = f"the ranks have different arguments ({', '.join(different)})"
        raise SceneError(f"scene {scene.name}: {what}; start all ranks with one command")


def _check_arguments(threads: Any, folder: Any, max_time: Any) -> None:
    """Check the arguments of `simulate`, and raise an error for wrong types and values."""
    if folder is not None:
        check_path(folder, "folder")
        if not str(folder):
            raise ValueError("folder (--out): the name is empty; give a folder for the results")
    if max_time is not None:
        check_seconds(max_time, "max_time")
    if threads is not None:
        check_whole_number(threads, "threads")  # `thread_count` checks how many there are


def _advice(run: Run, error: Exception) -> list[str]:
    """Return advice to add to the message of an error of a run; none for an error in a user's
    own force, which names the cause itself.
    """
    if isinstance(error, OwnForceFailed | OwnForceInvalid):
        return []
    moving = run.stages[run.state.stage].inertia is not None and run.state.steps > 0
    advice = (
        [f"{DYNAMICS_ADVICE}{'' if run.force.has_energy else f', {ENERGY_ADVICE}'}"]
        if moving
        else [text for kind, text in ADVICE.items() if type(error) is kind]
    )
    single = (
        isinstance(error, NotConverged | Unstable | TooSmall) and run.force.precision == "float32"
    )
    return [*advice, SINGLE_ADVICE] if single else advice


def _model_of(force: Any, scene: Scene) -> tuple[Scene, ForceModel]:
    """Return the force model for the `force` argument of `simulate`, and the scene, which may
    adopt the material of an artifact.
    """
    if force is None or isinstance(force, str | Path):
        return artifacts.with_material(scene, force)
    scene = artifacts.sourced(scene)
    if isinstance(force, ForceModel):
        return scene, force
    if is_own_force(force):
        return scene, OwnBondForce(force)
    # Imported here: only those who have a pipeline have scikit-learn loaded.
    from sklearn.base import BaseEstimator

    wanted = "a force model, its name or path, a surrogate_pipeline, or have bond_force or energy"
    check_kind(force, BaseEstimator, "force", wanted)
    from ..learning.export import best_of
    from ..learning.fitting import force_model_of, stated_against

    law = scene.law()
    model = force_model_of(force, law)
    with scene_errors(scene):
        return scene, stated_against(model, law, best_of(force).training_inputs_)
