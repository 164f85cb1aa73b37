"""Stages in equilibrium: outputs on the way, and increments of the loading parameter between them."""

from __future__ import annotations

import numpy as np

from ..forces import InvalidState
from ..scenes import SceneError
from ..solvers import SOLVERS, Diverging, Equilibrium, EquilibriumSolver, Increments, NotConverged, TooFar, Unstable
from ..solvers.branch import Branch
from .programme import Stage
from .rows import compare, force_columns, level_row, moment_columns, probe_columns
from .run import Run

HARD = 2.0
"""Evaluations of an increment, over the mean of those before it in its stage, beyond which the next one is not made longer."""


def solver_of(run: Run) -> EquilibriumSolver:
    """The solver that the scene asks for.

    Raises
    ------
    SceneError
        If it does not work with the run's force.
    """
    spec = run.scene.solver
    solver = SOLVERS[spec.method]
    if solver.needs_energy and not run.loaded.has_energy:
        missing = f", and {run.loaded.no_energy_because}" if run.force.has_energy else f"; {run.model.name} has none"
        raise SceneError(
            f"scene {run.scene.name}: solver.method={spec.method} needs a force that has an energy, as bond-energy does{missing}, so take "
            "another solver.method"
        )
    return solver(run.loading.free, run.body.volumes, spec.tolerance, spec.most_evaluations, run.reductions)


def go_through(run: Run, solver: EquilibriumSolver, stage: Stage) -> bool:
    """Go through the outputs of a stage that are left, each from the last; says whether its end was reached.

    Where an increment finds no equilibrium, or not the one looked for, it is taken back and shortened.  Where a bond would break the
    stage ends, and the body is put back to the last output: what follows is not in equilibrium.
    """
    branch = Branch(run.loading, run.loaded, run.reductions)
    values, evaluations = np.linspace(run.begin, stage.to, stage.outputs + 1), []
    while run.outputs < stage.outputs:
        value = float(values[run.outputs + 1])
        run.progress.level(run.stage, value)
        run.target = value
        last_output = run.positions.copy(), run.parameter
        equilibrium = _go_to(run, solver, branch, stage, evaluations)
        if equilibrium is None:
            run.positions[:], run.parameter = last_output
            run.loading.apply(run.parameter, run.loaded, run.positions)
            return False
        run.outputs += 1
        _record(run, equilibrium)
        run.checkpoint({"phase": "equilibrium", "gave_up": solver.gave_up}, {})
    return True


def _go_to(run: Run, solver: EquilibriumSolver, branch: Branch, stage: Stage, evaluations: list[int]):
    """Follow the equilibrium to the run's target; None where a bond would break on the way."""
    largest = run.loading.largest_increment(run.positions, run.parameter, run.target, stage.largest_increment)
    increments, wasted = Increments(run.parameter, run.target, largest), 0
    while not increments.finished:
        accepted, began = _Accepted(run, solver), run.force.evaluations
        try:
            equilibrium = _follow(run, solver, branch, increments)
        except (NotConverged, Diverging, InvalidState, TooFar, Unstable) as error:
            wasted += run.force.evaluations - began
            _take_back(run, solver, accepted, increments, error, wasted)
            continue
        if run.loading.adaptive:
            run.earlier = accepted.parameter, accepted.positions
            _lengthen(run, increments, evaluations, run.force.evaluations - began)
        else:
            increments.accept()
        if run.damage is not None and run.reductions.any(len(run.damage.overstretched(run.force.positions)) > 0):
            return None
    return equilibrium


def _lengthen(run: Run, increments: Increments, evaluations: list[int], taken: int) -> None:
    """Go on after an increment that took so many evaluations, with a longer one if it was easy."""
    easy = not evaluations or taken <= HARD * np.mean(evaluations)
    evaluations.append(taken)
    if increments.accept(easy):
        reason = f"increments of {increments.size:.3g} again, after one of {taken} evaluations"
        row = {run.loading.parameter: run.target, "increment": run.parameter, "evaluation": run.force.evaluations, "reason": reason}
        run.history.append(row)


class _Accepted:
    """The equilibrium that the next increment starts from, and comes back to if it fails."""

    def __init__(self, run: Run, solver: EquilibriumSolver) -> None:
        self.parameter, self.positions, self.gave_up = run.parameter, run.positions.copy(), solver.gave_up
        self._arrays = {key: array.copy() for key, array in run.force.state_arrays().items()}

    def restore(self, run: Run, solver: EquilibriumSolver) -> None:
        run.parameter, solver.gave_up = self.parameter, self.gave_up
        run.positions[:] = self.positions
        for key, array in run.force.state_arrays().items():
            array[:] = self._arrays[key]
        run.loading.apply(run.parameter, run.loaded, run.positions)


def _follow(run: Run, solver: EquilibriumSolver, branch: Branch, increments: Increments) -> Equilibrium:
    """Bring the run to equilibrium at the end of the present increment."""
    target, spec = increments.target, run.scene.solver
    guess = _best(run, run.loading.guesses(run.positions, run.parameter, target, run.earlier), target)
    # States on the way need not be exact: they only bring the next start near.
    tolerance = spec.tolerance if increments.ends else max(spec.tolerance, 1e-3)
    run.loading.apply(target, run.loaded, guess)
    run.positions[:] = guess
    equilibrium = _solve(run, solver, target, tolerance)
    branch.check(run.parameter, target, guess, run.positions)
    run.parameter = target
    return equilibrium


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
            sizes.append(run.reductions.dot(forces, forces))
        except InvalidState:
            sizes.append(np.inf)
    return guesses[int(np.argmin(sizes))]


def _take_back(run: Run, solver: EquilibriumSolver, accepted: _Accepted, increments: Increments, error: Exception, wasted: int) -> None:
    """Go back to before an increment that failed, and shorten it.

    Raises
    ------
    NotConverged, Diverging, InvalidState, TooFar, Unstable
        What failed, with how far the loading came, where the increment cannot be shorter, or the failures on the way to an output have
        taken as many evaluations as a solution may.
    """
    parameter = run.loading.parameter
    row = {parameter: run.target, "increment": increments.target, "evaluation": run.force.evaluations, "failure": str(error)}
    run.history.append(row)
    accepted.restore(run, solver)
    size, first = increments.size, increments.share == 1
    if wasted < run.scene.solver.most_evaluations and increments.shorten():
        return
    reached = run.loading.reached(run.parameter)
    if first and not reached:
        raise error
    what = f"equilibrium was followed to {run.loading.at(run.parameter)}, and not further with increments down to {size:.2g}"
    raise type(error)(f"{error}; {what} ({reached})" if reached else f"{error}; {what}") from error


def _solve(run: Run, solver: EquilibriumSolver, target: float, tolerance: float) -> Equilibrium:
    began = run.force.evaluations

    def report(evaluations: int, residual: float) -> None:
        run.residual = residual
        row = {run.loading.parameter: run.target, "increment": target, "evaluation": began + evaluations, "residual": residual}
        run.history.append(row | ({"energy": run.strain_energy()} if run.force.has_energy else {}))
        run.progress.residual(evaluations, residual, tolerance)
        run.interruption.check()

    return solver.solve(run.loaded, run.positions, tolerance, report)


def _record(run: Run, equilibrium: Equilibrium) -> None:
    """Record an output in equilibrium."""
    level = level_row(run)
    level |= {"residual": equilibrium.residual, "evaluations": equilibrium.evaluations, "method": equilibrium.method}
    compare(run, level)
    run.levels.append(level)
    if not run.scene.stretched:
        place = {"t": run.target, "increment": run.parameter, "evaluation": run.force.evaluations}
        run.history.append(place | force_columns(level["forces"]) | moment_columns(level["moments"]) | probe_columns(run))
    run.record()
