"""Stages in equilibrium: outputs on the way, and increments of the loading parameter between them."""

from __future__ import annotations

import logging
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ..forces import InvalidState
from ..problem import Stage
from ..results.checkpoint import Checkpoint
from ..scenes import SceneError
from ..solvers import (
    SOLVERS,
    Diverging,
    Equilibrium,
    EquilibriumSolver,
    Increments,
    NotConverged,
    RanAway,
    TooFar,
    TooSmall,
    Unbalanced,
    Unstable,
    told_of_zero_energy_modes,
)
from ..solvers.branch import Branch
from ..solvers.equilibrium import is_rigid, strain_of, strain_rounding
from .checkpoints import ACCEPTED
from .interruption import Interrupted
from .rows import equilibrium_columns, output_row
from .run import Run

logger = logging.getLogger(__name__)

HARD = 2.0
"""Evaluations of an increment, over the mean of those before it in its stage, beyond which the next one is not made longer."""

FARTHEST = 0.5
"""Of the undeformed body's extent: how far loads may carry a point from the first guess of an increment.  Where there is no equilibrium a
solver goes that far within some ten evaluations, and then takes thousands to fail; what comes to rest beyond is found with shorter
increments too."""

PATIENCE, LEAST_PATIENCE = 30, 2000
"""Evaluations for all increments that follow one that failed, until one succeeds, over the mean of those that succeeded before; and at
least.  Close below a greatest load the stiffness vanishes and solvers wander."""

MOST_WASTED = 5000
"""Evaluations of all increments of a run that fail, beyond which the next failure ends it: good runs take tens to some hundreds."""

FINE, COARSE = 1e-3, 1e-2
"""Residuals of states on the way to an output, which only bring the next start near; the second of nearly incompressible bodies, whose
preconditioner puts right what is left (a fifth fewer evaluations of bonded blocks)."""

PRECISION_NAMES = {"float32": "single", "float64": "double"}

RESOLVED = 1000
"""Least strain of the body's most strained bond, over that which rounding leaves: smaller ones would be off by more than 0.1 %."""

FORCE_ROUNDING = {"float32": 1e-7, "float64": 0.0}
"""Strain whose stress is what rounding of the forces leaves, by precision.  In single at a strain of 1e-4 forces were 0.03 % off."""

MOST_OFF = 1e-3
"""Sum of all loads and reactions of an equilibrium, over what drives the body."""

FAILURES = (NotConverged, Diverging, InvalidState, RanAway, TooFar, Unstable)
"""What a shorter increment may mend."""


def solver_of(run: Run) -> EquilibriumSolver:
    """The solver that the scene asks for.

    Raises
    ------
    SceneError
        If it does not work with the run's force.
    """
    spec = run.problem.solver
    solver = SOLVERS[spec.method]
    if solver.needs_energy and not run.loaded.has_energy:
        why = run.loaded.no_energy_because if run.force.has_energy else f"{run.model.name} has none"
        needs = f"solver.method={spec.method} needs a force that has an energy, as bond-energy does, and {why}"
        raise SceneError(f"scene {run.problem.name}: {needs}; take another solver.method")
    return solver(run.loading.free, run.body.volumes, spec.tolerance, spec.most_evaluations, run.body.share)


def go_through(run: Run, solver: EquilibriumSolver, stage: Stage) -> bool:
    """Go through the outputs of a stage that are left, each from the last; says whether its end was reached.

    Where an increment finds no equilibrium, or not the one looked for, it is taken back and shortened.  Where a bond would break the
    stage ends, and the body is put back to the last output: what follows is not in equilibrium.
    """
    branch = Branch(run.loading, run.loaded, solver)
    values, evaluations = np.linspace(run.begin, stage.to, stage.outputs + 1), [] if run.way is None else run.way.evaluations
    while run.outputs < stage.outputs:
        value = float(values[run.outputs + 1])
        run.report("level", run.stage, value)
        run.target = value
        last_output = (run.positions.copy(), run.parameter) if run.way is None else run.way.last_output
        way = run.way or Way.begun(run, stage, evaluations, last_output)
        equilibrium = _go_to(run, solver, branch, way)
        run.way = None
        if equilibrium is None:
            run.positions[:], run.parameter = last_output
            run.loading.apply(run.parameter, run.loaded, run.positions)
            return False
        run.outputs += 1
        _record(run, equilibrium)
        run.checkpoints.write({"phase": "equilibrium", "gave_up": solver.gave_up}, {})
    return True


@dataclass
class Way:
    """The way to an output, as far as it has been gone: a checkpoint on it holds all of this.

    Attributes
    ----------
    increments : Increments
    evaluations : list of int
        Of every increment of the stage that succeeded.
    last_output : tuple of ndarray, shape (n, d), and float
        Positions and parameter at the output before.
    accepted : _Accepted or None
        The last equilibrium; None before the first increment.
    iterate : ndarray, shape (n, d), or None
        What the solver had come to on the way to the next one, of a run that is resumed.
    """

    increments: Increments
    evaluations: list[int]
    last_output: tuple[np.ndarray, float]
    accepted: _Accepted | None = None
    iterate: np.ndarray | None = None

    @classmethod
    def begun(cls, run: Run, stage: Stage, evaluations: list[int], last_output: tuple[np.ndarray, float]) -> Way:
        largest = run.loading.course.largest_increment(run.positions, run.parameter, run.target, stage.largest_increment)
        return cls(Increments(run.parameter, run.target, largest), evaluations, last_output)

    def checkpoint(self, run: Run, solver: EquilibriumSolver) -> None:
        """Write a checkpoint of what the solver has come to."""
        kept = {"increments": self.increments.describe(), "evaluations": self.evaluations, "last_output": self.last_output[1]}
        arrays = {ACCEPTED + key: array for key, array in self.accepted.arrays.items()}
        arrays |= {f"{ACCEPTED}positions": self.accepted.positions, "last_output": self.last_output[0]}
        run.checkpoints.write({"phase": "equilibrium", "gave_up": solver.gave_up, "way": kept}, arrays)

    @classmethod
    def resumed(cls, run: Run, checkpoint: Checkpoint) -> Way | None:
        """The way that a checkpoint was written on, with the run at its last equilibrium; None where it was written at an output."""
        kept, arrays = checkpoint.progress.get("way"), checkpoint.arrays
        if kept is None:
            return None
        stage, iterate = run.stages[run.stage], run.positions.copy()
        run.positions[:] = arrays[f"{ACCEPTED}positions"]
        for key, array in run.force.state_arrays().items():
            array[:] = arrays[ACCEPTED + key]
        end = float(np.linspace(run.begin, stage.to, stage.outputs + 1)[run.outputs + 1])
        increments, last_output = kept["increments"], (arrays["last_output"].copy(), kept["last_output"])
        way = Increments(increments["start"], end, increments["largest"], increments["done"], increments["share"])
        return cls(way, list(kept["evaluations"]), last_output, iterate=iterate)


def _go_to(run: Run, solver: EquilibriumSolver, branch: Branch, way: Way):
    """Follow the equilibrium to the run's target; None where a bond would break on the way."""
    increments, evaluations = way.increments, way.evaluations
    ran_away, patience = None, np.inf
    while not increments.finished:
        accepted, began = _Accepted(run, solver), run.force.evaluations
        way.accepted = accepted
        try:
            equilibrium = _follow(run, solver, branch, way, patience)
        except TooSmall:
            accepted.restore(run, solver)
            raise
        except FAILURES as error:
            taken = run.force.evaluations - began
            run.wasted += taken
            patience = min(patience - taken, max(LEAST_PATIENCE, PATIENCE * np.mean(evaluations or 0)))
            if isinstance(error, RanAway) and ran_away is None:
                ran_away = error  # with short increments from close below a greatest load solvers fail in other ways
            spent = patience <= 0 or run.wasted >= min(MOST_WASTED, run.problem.solver.most_evaluations)
            _take_back(run, solver, accepted, increments, error, ran_away or error, spent)
            continue
        ran_away, patience = None, np.inf
        if run.loading.course.adaptive:
            run.earlier = accepted.parameter, accepted.positions
            _lengthen(run, increments, evaluations, run.force.evaluations - began)
        else:
            increments.accept()
        if run.damage is not None and run.body.share.any(len(run.damage.overstretched(run.force.positions)) > 0):
            return None
    return equilibrium


def _lengthen(run: Run, increments: Increments, evaluations: list[int], taken: int) -> None:
    """Go on after an increment that took so many evaluations, with a longer one if it was easy."""
    easy = not evaluations or taken <= HARD * np.mean(evaluations)
    evaluations.append(taken)
    if increments.accept(easy):
        run.note(run.parameter, reason=f"increments of {increments.size:.3g} again, after one of {taken} evaluations")


class _Accepted:
    """The equilibrium that the next increment starts from, and comes back to if it fails."""

    def __init__(self, run: Run, solver: EquilibriumSolver) -> None:
        self.parameter, self.positions, self.gave_up = run.parameter, run.positions.copy(), solver.gave_up
        self.arrays = {key: array.copy() for key, array in run.force.state_arrays().items()}

    def restore(self, run: Run, solver: EquilibriumSolver) -> None:
        run.parameter, solver.gave_up = self.parameter, self.gave_up
        run.positions[:] = self.positions
        for key, array in run.force.state_arrays().items():
            array[:] = self.arrays[key]
        run.loading.apply(run.parameter, run.loaded, run.positions)


def _follow(run: Run, solver: EquilibriumSolver, branch: Branch, way: Way, patience: float) -> Equilibrium:
    """Bring the run to equilibrium at the end of the present increment, within so many evaluations."""
    increments = way.increments
    target, spec = increments.target, run.problem.solver
    guess = _best(run, run.loading.course.guesses(run.positions, run.parameter, target, run.earlier), target)
    on_the_way = COARSE if run.loaded.nearly_incompressible else FINE
    tolerance = spec.tolerance if increments.ends else max(spec.tolerance, on_the_way)
    start, way.iterate = guess if way.iterate is None else _best(run, [guess, way.iterate], target), None
    run.loading.apply(target, run.loaded, start)
    run.positions[:] = start
    equilibrium = _solve(run, solver, target, tolerance, guess, patience, way)
    branch.check(run.parameter, target, guess, run.positions)
    if increments.ends:
        _check_resolved(run, target)
    run.parameter = target
    return equilibrium


def _check_resolved(run: Run, target: float) -> None:
    """Raise `TooSmall` where the strains of an equilibrium are so small that rounding is more than a thousandth of them."""
    if not _is_driven(run, target):
        return
    moduli = [law.shear_modulus for law, _ in run.force.laws]
    rounding = max(FORCE_ROUNDING[run.force.precision], strain_rounding(run.body)) * max(moduli) / min(moduli)
    strain = strain_of(run.loaded)
    if strain < RESOLVED * rounding:
        contrast = f" with moduli {max(moduli) / min(moduli):.3g} apart" if max(moduli) > min(moduli) else ""
        raise TooSmall(
            f"the greatest strain, {strain:.2g}, is too small for {PRECISION_NAMES[run.force.precision]} precision, which resolves "
            f"{RESOLVED * rounding:.1g}{contrast}"
        )


def _is_driven(run: Run, parameter: float) -> bool:
    """Return whether the body is strained at a value of the parameter: neither at rest nor, without loads, moved as a whole."""
    if run.loading.at_rest(parameter):
        return False
    loads = run.loaded.applied()
    if loads is not None and run.body.share.any(bool((loads * run.loading.free).any())):
        return True
    return not is_rigid(run.loaded)


def _best(run: Run, guesses: list[np.ndarray], target: float) -> np.ndarray:
    """The guess with the least residual force."""
    if len(guesses) == 1:
        return guesses[0]
    sizes = []
    for guess in guesses:
        forces = np.empty_like(guess)
        run.loading.apply(target, run.loaded, guess)
        try:
            run.loaded(guess, forces)
            forces *= run.loading.free
            sizes.append(run.body.share.dot(forces, forces))
        except InvalidState:
            sizes.append(np.inf)
    return guesses[int(np.argmin(sizes))]


def _take_back(
    run: Run, solver: EquilibriumSolver, accepted: _Accepted, increments: Increments, error: Exception, cause: Exception, spent: bool
) -> None:
    """Go back to before an increment that failed with an error, and shorten it unless all evaluations that failures may take are spent.

    Raises
    ------
    NotConverged, Diverging, InvalidState, RanAway, TooFar, Unstable
        The cause of the failure, with how far the loading came, where the increment is not shortened.
    """
    run.note(increments.target, failure=str(error))
    logger.info("increment to %s taken back: %s", run.loading.at(increments.target), error)
    accepted.restore(run, solver)
    size, first = increments.size, increments.share == 1
    if not spent and increments.shorten():
        return
    reached = run.problem.reached(run.parameter)
    if first and not reached:
        raise cause
    if run.loading.course.adaptive and run.parameter not in (run.begin, *(level["t"] for level in run.levels[-1:])):
        _record_reached(run, solver)
    what = f"equilibrium was followed to {run.loading.at(run.parameter)}, and not further with increments down to {size:.2g}"
    raise type(cause)(f"{cause}; {what} ({reached})" if reached else f"{cause}; {what}") from cause


def _record_reached(run: Run, solver: EquilibriumSolver) -> None:
    """Record the last equilibrium on the way to an output that is not reached, if it can be made as exact as an output."""
    target, run.target = run.target, run.parameter
    # What a coarse tolerance let pass close below a greatest load need not be an equilibrium.
    with suppress(*FAILURES):
        _record(run, _solve(run, solver, run.parameter, run.problem.solver.tolerance, run.positions.copy(), LEAST_PATIENCE))
    run.target = target


def _solve(
    run: Run, solver: EquilibriumSolver, target: float, tolerance: float, guess: np.ndarray, patience: float, way: Way | None = None
) -> Equilibrium:
    """Equilibrium at a value of the parameter from where the run is, near a guess, within so many evaluations."""
    began = run.force.evaluations
    farthest = FARTHEST * run.body.extent

    def report(evaluations: int, residual: float) -> None:
        run.residual = residual
        logger.debug("%d evaluations, residual %.3g", began + evaluations, residual)
        energy = {"energy": run.strain_energy()} if run.force.has_energy else {}
        run.note(target, evaluation=began + evaluations, residual=residual, **energy)
        run.report("residual", evaluations, residual, tolerance)
        _keep_or_stop(run, solver, way)
        if evaluations > patience:
            raise NotConverged(f"no equilibrium within {evaluations} force evaluations, after a longer increment had failed")
        if run.loads is not None:
            moved = run.body.share.greatest(np.abs(run.positions - guess))
            if moved > farthest:
                weak = told_of_zero_energy_modes(run.force, "with which loads may carry points away long before their greatest value")
                raise RanAway(f"the loads carry the body away: by {moved:.3g} in one increment, with no equilibrium on the way{weak}")

    least_drive = run.greatest_drive or np.inf if run.loading.at_rest(target) else 0.0
    return solver.solve(run.loaded, run.positions, tolerance, report, least_drive)


def _keep_or_stop(run: Run, solver: EquilibriumSolver, way: Way | None) -> None:
    """Write a checkpoint where one is due, or where none exists yet, and stop a run that received a signal.

    A run that was interrupted goes on from its last output, to the same bits, where it has come to one and not long gone on since; one
    whose time is over goes on from here.
    """
    asked = run.interruption.asked
    due = run.checkpoints.late or (asked and (run.interruption.out_of_time or not run.checkpoints.resumable))
    asked, due = run.body.share.total((int(asked), int(due)))
    if due and way is not None:
        way.checkpoint(run, solver)
    if asked:
        raise Interrupted


def _record(run: Run, equilibrium: Equilibrium) -> None:
    """Record an output in equilibrium.

    Raises
    ------
    Unbalanced
        If loads and reactions are not in balance.
    """
    drive = equilibrium.drive if _is_driven(run, run.parameter) else run.greatest_drive or None
    run.greatest_drive = max(run.greatest_drive, drive or 0.0)
    level = output_row(run, drive=drive)
    level |= {"residual": equilibrium.residual, "evaluations": equilibrium.evaluations, "method": equilibrium.method}
    if drive and level["force_balance"] > MOST_OFF:
        off = f"{100 * level['force_balance']:.2g} % of what drives the body, and may leave {100 * MOST_OFF:g} %"
        raise Unbalanced(f"the sum of all loads and reactions is {off}")
    run.levels.append(level)
    reached = run.loading.at(run.parameter), equilibrium.evaluations, equilibrium.residual, equilibrium.method
    logger.info("%s: equilibrium after %d evaluations, residual %.2g, by %s", *reached)
    run.history.append(equilibrium_columns(run, level))
    run.record()
