"""A scene and a force model in, a result out: picks what this scene needs and runs it."""

from __future__ import annotations

import logging
import math
import time
import warnings
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from .. import artifacts
from ..arguments import check_is, check_path, check_seconds, check_whole_number
from ..engine.compile import compilation_clock
from ..engine.threads import thread_count
from ..forces import ForceModel, InvalidState, OutsideDomain, OwnBondForce, OwnForceFailed, OwnForceInvalid, is_own_force
from ..ranks import communicator
from ..results import Result
from ..results.checkpoint import CheckpointError
from ..results.contents import Contents
from ..results.files import remove_leftovers
from ..results.folder import DONE, FAILED, INTERRUPTED, RUNNING, check_names, check_room, make_room, occupied
from ..results.provenance import provenance
from ..results.result import write_tables
from ..scenes import Scene, SceneError, load_scene
from ..scenes.model import RIGID
from ..solvers import Diverging, NotConverged, RanAway, TooFar, TooSmall, Unbalanced, Unstable
from ..solvers.conditions import FoldedOver
from .interruption import Interrupted, Interruption
from .levels import Way, go_through, solver_of
from .materials import checked_models, models_of
from .record import Record
from .run import Progress, Run, Silent

if TYPE_CHECKING:
    from sklearn.base import BaseEstimator

logger = logging.getLogger(__name__)

__all__ = ["Progress", "SimulationFailed", "SimulationInterrupted", "simulate"]


class SimulationFailed(RuntimeError):
    """A run that did not reach its end; what it did reach is in `result`.

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


class SinglePrecisionLeft(RuntimeWarning):
    """A run takes double precision, since single does not resolve its strains.

    Examples
    --------
    >>> import pdsurrogate as pds
    >>> from pdsurrogate.run.simulate import SinglePrecisionLeft
    >>> issubclass(SinglePrecisionLeft, RuntimeWarning)
    True
    """


class SimulationInterrupted(SimulationFailed):
    """A run that was stopped by Ctrl-C, or because its time was over; with a folder, its checkpoint is in it.

    Attributes
    ----------
    out_of_time : bool
        Whether its `max_time` was over.

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
"""What a summary says in the place of a failure while its run goes on."""


ADVICE = {
    NotConverged: "allow more solver.most_evaluations, take a smaller solver.largest_increment, or another solver.method",
    Diverging: "take another solver.method",
    TooSmall: "take larger strains, of which smaller ones are a part, or precision=float64 if it is single",
    Unbalanced: "take a smaller solver.tolerance",
    TooFar: "take a smaller steps.largest_increment, or more outputs",
    Unstable: "push it less far, or follow it in dynamics",
    RanAway: "a load may have a maximum, as the pressure in a balloon has: to go beyond it prescribe displacements in its place, or follow "
    "it in dynamics",
    FoldedOver: "contact is not followed, and a finer spacing shows the fold sooner: push it less far, make the free side hollow, or let "
    "the body slide there, with the components along the plane left free",
    InvalidState: "take a finer spacing; or the material itself does not reach this far",
}
"""What to change, by what went wrong between levels in equilibrium."""

DYNAMICS_ADVICE = "take a smaller dynamics.safety, more dynamics.viscosity or damping, or a finer spacing"


def simulate(
    scene: Scene | str | Path,
    force: str | Path | ForceModel | BaseEstimator | None = None,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
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
        A force model, the name of one ("analytic", "nosb"), an artefact: NAME, NAME@VERSION or a path; or a fitted
        `pdsurrogate.surrogate_pipeline` or `pdsurrogate.surrogate_pipeline`, or a search over one, or an object with a
        ``bond_force`` or an ``energy`` (`pdsurrogate.forces.OwnBondForce`), taken to describe the scene's material.
        An artefact brings the material of its card into a built-in scene, see `pdsurrogate.artifacts.with_material`.  By default the one
        for the scene, see `pdsurrogate.artifacts.default_force`.
    threads : int, optional
        Threads of the kernels, by default as many as pay for the body, at most all that numba was started with.  The result does not
        depend on it.
    progress : Progress, optional
        Where to report progress.
    folder : str or path, optional
        Where states are written the moment they are reached, checkpoints beside them, and the tables and the summary as the run goes on;
        without it states stay in memory.
        Results of the same run there, of this scene with this force, are replaced; what else there is needs `overwrite`.
    resume : bool
        Go on from the checkpoint in `folder`, to the result that the run would have had without the interruption.
    overwrite : bool
        Remove what other runs left in `folder`, and what the same one left that was ended before its time.
    max_time : float, optional
        Seconds after which the run ends at the next place where its state is whole, with a checkpoint if it has a folder.

    Returns
    -------
    Result
        On several ranks (``mpiexec -n 4 python -m mpi4py ...``) the fields and the whole body are those of the first rank's.

    Raises
    ------
    TypeError
        If the scene or the force is none of these.
    ArtifactError
        If the force cannot be found or read.
    ValueError
        If a pipeline is not fitted, or the kernels do not evaluate its function.
    SceneError
        If the scene and the force model do not fit, or the body cannot be built.
    CheckpointError
        If there is nothing to resume from, or it belongs to another run.
    FolderTaken
        If `folder` holds results of another run, or a checkpoint of this one that was interrupted, or a file called like one of a run's
        that no run wrote, or another run writes there.
    SimulationInterrupted
        After Ctrl-C, or at the end of `max_time`, at the next place where the state is whole; the part that was reached is kept.
    SimulationFailed
        If a level does not converge, or the deformation leaves the states that the material has; the part that was reached is kept.

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
    elif not isinstance(scene, Scene):
        raise TypeError(f"scene must be a Scene, or the name or file of one, not {scene!r}")
    scene, model = _model_of(force, scene)
    if progress is not None:
        check_is(progress, Progress, "progress", "an object with the methods of pdsurrogate.run.simulate.Progress")
    progress = progress or Silent()
    if folder is not None:
        check_path(folder, "folder")
    if max_time is not None:
        check_seconds(max_time, "max_time")
    if threads is not None:
        check_whole_number(threads, "threads")  # how many there are is told by `thread_count`
    if resume and folder is None:
        raise ValueError("a run is resumed from the folder of its results: give it")
    if resume and overwrite:
        raise ValueError("a run is either resumed or begun anew: give resume or overwrite, not both")
    if folder is not None and not str(folder):
        raise ValueError("a folder is needed for the results, and its name is empty")
    ranks = communicator()
    if ranks.size > 1:
        # Imported here: a run of one process knows nothing of others.
        from .sharing import refuse_different, together

        refuse_different(ranks, scene, model, folder, resume)
        together(ranks, lambda: checked_models(scene, model))
        if ranks.rank:
            progress = Silent()
    folder = None if folder is None else Path(folder)
    writes = folder is not None and ranks.rank == 0

    def look_into_folder() -> None:
        if writes and resume:
            check_names(folder, scene.name, resumed=True)
            remove_leftovers(folder)
        elif writes:
            check_room(folder, Contents.of(scene, [model, *models_of(scene, model)]), overwrite)

    # Before any work.
    if ranks.size == 1:
        look_into_folder()
    else:
        together(ranks, look_into_folder)
    # BLAS threads spin for a while after each call, on the cores that the kernels want next.
    held = occupied(folder) if writes else nullcontext()
    with held, thread_count(threads) as most, threadpool_limits(1, user_api="blas"), compilation_clock(progress.compiling) as clock:
        interruption = Interruption(math.inf if max_time is None else began + max_time, ranks.size == 1)
        run = Run(scene, model, progress, folder, threads and most, interruption=interruption)
        size = len(run.body), len(run.body.bonds.first), run.threads
        logger.info("%s with %s: %d points, %d bonds, threads: %d", scene.name, model.name, *size)
        run.warm_up()
        if writes and not resume:
            make_room(folder, run.contents, overwrite)
        if folder is not None:
            begun = _result(run, clock.seconds, began, UNDER_WAY, RUNNING)
            if writes:
                run.progress = run.record_of_folder = Record(run, begun.summary)

        def ended(message: str | None, status: str) -> Result:
            result = _result(run, clock.seconds, began, message, status)
            if writes:
                write_tables(folder, result.summary, result.history, result.convergence, scene.units)
            return result

        try:
            with run.interruption:
                _go(run, resume)
        except (Interrupted, KeyboardInterrupt) as error:
            if isinstance(error, KeyboardInterrupt) and not interruption.told:
                raise
            over = not interruption.told and interruption.out_of_time
            what = f"stopped after max_time, {max_time:g} s" if over else "interrupted"
            message = f"{run.loading.at(run.parameter)}: {what}"
            raise SimulationInterrupted(message, ended(message, INTERRUPTED), over) from None
        except (NotConverged, Diverging, RanAway, TooFar, TooSmall, Unstable, InvalidState, OutsideDomain, OwnForceFailed) as error:
            inertia = run.stages[run.stage].inertia is not None and run.steps > 0
            advice = DYNAMICS_ADVICE if inertia else ADVICE.get(type(error))
            if isinstance(error, OwnForceFailed | OwnForceInvalid):
                advice = None  # its message says what is wrong, and no smaller step mends it
            if isinstance(error, NotConverged | Unstable) and run.force.precision == "float32":
                advice += "; or take precision=float64, whose rounding leaves less of a residual and disturbs less"
            message = f"{run.loading.at(run.target)}: {error}" + (f"; {advice}" if advice else "")
            logger.info("the run failed at %s", message)
            raise SimulationFailed(message, ended(message, FAILED)) from error
        logger.info("%s ended: %d evaluations, %.3g s", scene.name, run.force.evaluations, time.perf_counter() - began)
        return ended(None, DONE)


def _model_of(force, scene: Scene) -> tuple[Scene, ForceModel]:
    """The force model that is meant by the `force` of `simulate`, and the scene with the material that comes with it."""
    if force is None:
        return scene, artifacts.default_force(scene)
    if isinstance(force, str | Path):
        return artifacts.with_material(scene, force)
    if isinstance(force, ForceModel):
        return scene, force
    if is_own_force(force):
        return scene, OwnBondForce(force)
    # Imported here: only those who have a pipeline have scikit-learn loaded.
    from sklearn.base import BaseEstimator

    if isinstance(force, BaseEstimator):
        from ..learning.export import best_of
        from ..learning.fitting import stated_against
        from ..learning.surrogates import force_model_of

        law = scene.law()
        model = force_model_of(force, law)
        try:
            return scene, stated_against(model, law, best_of(force).training_inputs_)
        except ValueError as error:
            raise SceneError(f"scene {scene.name}: {error}") from None
    raise TypeError(
        "force must be a force model, the name of one, an artefact (NAME, NAME@VERSION or a path), a fitted "
        f"surrogate_pipeline, or an object with a bond_force or an energy, not {force!r}"
    )


def _go(run: Run, resume: bool) -> None:
    """Go through the stages of the programme that are left."""
    if run.scene.fracture is not None:
        # Imported here: a scene without damage compiles none.
        from .fracture import Damage, critical_stretch_in

        run.critical_stretch = critical_stretch_in(run.scene, run.law, run.body.horizon, run.model.family)
        run.damage = Damage(run.body, run.critical_stretch)
    solver, transient = solver_of(run), None
    if resume:
        transient = _take_up(run, solver)
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
            transient = transient or _begun(run)
            transient.go()
            run.velocities, run.earlier, follows = transient.integrator.velocities, None, run.stage + 1
            run.elapsed += transient.account.time
            transient = None
        run.stage, run.outputs, run.begin = follows, 0, run.parameter


def _take_double(run: Run, error: TooSmall) -> None:
    """Go on in double precision, and say so."""
    reason = f"{error}: the forces are evaluated in double precision from here on"
    row = {run.loading.parameter: run.target, "increment": run.parameter, "evaluation": run.force.evaluations, "reason": reason}
    run.convergence.append(row)
    if run.ranks.rank == 0:
        warnings.warn(f"{run.loading.at(run.target)}: {reason}", SinglePrecisionLeft, stacklevel=4)
    run.take_double()
    run.loading.apply(run.parameter, run.loaded, run.positions)


def _dynamics_after(run: Run) -> int:
    """The next stage in dynamics, which takes over where a bond would break in equilibrium.

    Raises
    ------
    Unstable
        If there is none.
    """
    following = [number for number, stage in enumerate(run.stages) if number > run.stage and stage.inertia is not None]
    if not following:
        raise Unstable(f"a bond would break between {run.loading.at(run.parameter)} and here: what follows is not in equilibrium")
    return following[0]


def _transient(run: Run):
    """The dynamics of the run's present stage."""
    from .transient import Transient

    return Transient(run, run.stages[run.stage])


def _begun(run: Run):
    transient = _transient(run)
    transient.begin()
    return transient


def _take_up(run: Run, solver):
    """Put a run where its checkpoint left it; returns the dynamics if it was in them."""
    try:
        checkpoint = run.restore()
        if checkpoint.progress["phase"] == "dynamics":
            transient = _transient(run)
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


def _peak(history: list[dict]) -> dict | None:
    """Return the row of the greatest nominal stress, which is the load that a body with a crack bears; None without rows."""
    highest = max(history, key=lambda row: row["nominal_stress"], default=None)
    return highest and {key: highest[key] for key in ("time", "stretch", "nominal_stress") if key in highest}


def _result(run: Run, seconds_compile: float, began: float, failure: str | None, status: str) -> Result:
    """Return the result that the run has reached so far."""
    force, scene = run.force, run.scene
    residuals = [level["residual"] for level in run.levels if "residual" in level]
    if failure is not None and run.residual is not None and np.isfinite(run.residual):
        residuals.append(run.residual)
    outside = force.fraction_outside
    total, total_size = run.body.share.total, run.body.share.size
    directed = total(run.directed_bonds())
    summary = {
        "scene": scene.name,
        "force": run.contents.force,
        "material": run.law.describe(),
        "plane": force.plane,
        "thickness": 1.0,
        "n_points": total_size(len(run.body)),
        "n_bonds": total(run.counted_pairs()),
        "n_directed_bonds": directed,
        "n_ghost_points": total(int(run.body.share.counted(np.ones(len(run.body)))[run.body.ghosts.source].sum())),
        "spacing": run.body.spacing,
        "cell_size": run.body.cell.tolist(),
        "horizon": run.body.horizon,
        "precision": force.precision,
        "correction": force.correction,
        "support": scene.support,
        **({"ranks": run.ranks.size} if run.ranks.size > 1 else {}),
        "threads": run.threads,
        "status": status,
        "converged": failure is None,
        "interrupted": status == INTERRUPTED,
        "failure": failure,
        "residual": max(residuals, default=None),
        "n_force_evaluations": force.evaluations,
        "seconds_total": time.perf_counter() - began,
        "seconds_compile": seconds_compile,
        "ns_per_directed_bond": 1e9 * force.seconds / max(1, force.timed * directed),
        "fallback_fraction": outside if scene.outside in (None, "fallback") else 0.0,
        "fraction_outside_domain": outside,
        **({"beyond_data": run.beyond_data} if run.beyond_data else {}),
        "unsupported_points": run.unsupported_points(),
        "units": {**scene.units.model_dump(), "force": scene.units.force, "energy": scene.units.energy},
        **({"grip_areas": run.grip_areas} if scene.stretched else {}),
        "levels": run.levels,
        **run.contents.describe(),
        "provenance": provenance(),
    }
    if scene.materials:
        summary["materials"] = [
            {"region": part["region"], "material": law, **({} if law["law"] == RIGID else {"force": model.name})}
            for part, law, model in zip(
                scene.model_dump(mode="json", include={"materials"}, exclude_none=True, by_alias=True)["materials"],
                [{"law": RIGID} if part.rigid else part.material.build().describe() for part in scene.materials],
                run.models[1:],
                strict=True,
            )
        ]
    if any(stage.inertia is not None for stage in run.stages):
        if scene.stretched:
            stresses = [row["nominal_stress"] for row in [*run.levels, *run.history] if "nominal_stress" in row]
            summary["peak_nominal_stress"] = max(stresses, default=None)
        summary["n_steps"] = run.steps
        summary["dynamics"] = run.dynamics
    if run.crack is not None:
        summary["critical_stretch"] = run.critical_stretch
        summary["crack"] = run.crack | ({"peak": _peak(run.history)} if scene.stretched else {})
    return Result(scene, run.body if run.whole is None else run.whole, summary, run.history, run.states, run.convergence)
