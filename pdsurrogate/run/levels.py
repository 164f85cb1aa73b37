"""Stages in equilibrium: outputs on the way, and increments between them."""

import logging
from dataclasses import replace

import numpy as np

from ..forces import InternalForce, InvalidState
from ..forces.internal_force import settle
from ..problem import Stage
from ..results.checkpoint import Checkpoint
from ..scenes import SceneError
from ..scenes.amplitudes import turns_of
from ..scenes.model import entries_of
from ..solvers.bond_strains import RESOLVED, is_rigid, strain_of, strain_rounding
from ..solvers.equilibrium import (
    Equilibrium,
    EquilibriumSolver,
    NoEquilibrium,
    RanAway,
    TooSmall,
    Unbalanced,
    note_of_modes,
)
from ..solvers.increments import LEAST_SHARE, Increments
from ..solvers.methods import SOLVERS
from .checkpoints import Checkpoints
from .controlled import DisplacementPath
from .interruption import Interrupted
from .paths import ParameterPath
from .rows import equilibrium_columns, output_row
from .run import Run

logger = logging.getLogger(__name__)

FARTHEST = 0.5
"""Greatest distance by which loads may carry a point from the first guess of an increment, divided
by the extent of the body; beyond it the increment fails.

Where no equilibrium exists, a solver moves points that far within some ten evaluations, and would
need thousands to fail by itself; equilibria beyond this distance are found with shorter increments
too.
"""

FINE = 1e-3
COARSE = 1e-2
"""Tolerances of the solver in intermediate states, from which only the next increments start.
Chosen: the error of the start is then small compared with that of the extrapolation. The second
tolerance is for nearly incompressible bodies, whose preconditioner corrects the remaining error (a
fifth fewer evaluations of bonded blocks).
"""

MOST_ROUNDS = 20
"""Most searches for an equilibrium in which branches settle whose times depend on the overstress;
two or three are usual.
"""

PRECISION_NAMES = {"float32": "single", "float64": "double"}

FORCE_ROUNDING = {"float32": 1e-7, "float64": 0.0}
"""Strain whose stress equals the rounding error of the forces, by precision. In single, forces
at a strain of 1e-4 were 0.03 % off.
"""

MOST_OFF = 1e-3
"""Greatest permitted magnitude of the sum of all loads and reactions in equilibrium, divided by the
forces that drive the body: twice what a solver may leave (`UNBALANCED`), so that only a fault, and
not a converged state, exceeds it.
"""

FAILURES = NoEquilibrium, InvalidState
"""Errors of an increment that a shorter increment may avoid."""


def solver_of(run: Run) -> EquilibriumSolver:
    """Return the solver for equilibrium that the scene of a run names.

    Raises
    ------
    SceneError
        If the solver does not support the run's force.
    """
    spec = run.problem.scene.solver
    solver = SOLVERS[spec.method]
    if solver.needs_energy and not run.loaded.has_energy:
        why = (
            run.loaded.no_energy_because
            if run.force.has_energy
            else f"{run.model.name} defines none"
        )
        needs = (
            f"solver.method={spec.method} needs a force that defines an energy, such as"
            f" bond-energy, but {why}"
        )
        raise SceneError(f"scene {run.problem.scene.name}: {needs}; use another solver.method")
    if solver.needs_tangent and (run.force.precision != "float64" or run.ranks.size > 1):
        needs = f'solver.method={spec.method} needs precision = "float64" and one rank'
        raise SceneError(
            f"scene {run.problem.scene.name}: {needs}; add the precision, or use another"
            " solver.method"
        )
    return solver(
        run.loading.free, run.body.volumes, spec.tolerance, spec.most_evaluations, run.body.share
    )


class Equilibria:
    """Stage in equilibrium while it runs: its outputs in turn, and increments along a path between
    them.

    An increment that finds no equilibrium, or one that does not continue the last equilibrium, is
    undone and shortened.

    Parameters
    ----------
    run : Run
    stage : Stage
    solver : EquilibriumSolver
        Solver of stages that prescribe the loading parameter.
    checkpoints : Checkpoints

    Attributes
    ----------
    through : bool
        Whether the body has separated between its supports, which ends the stage.
    least : float
        Least part of a planned increment that is tried after failures.
    taken : dict
        What the row of the next output says of the increments to it.
    """

    through = False
    least = LEAST_SHARE

    def __init__(
        self, run: Run, stage: Stage, solver: EquilibriumSolver, checkpoints: Checkpoints
    ) -> None:
        self.run = run
        self.stage = stage
        self.solver = solver
        self._checkpoints = checkpoints
        self._path = (
            ParameterPath(run, stage, solver)
            if stage.control is None
            else DisplacementPath(run, stage)
        )
        self._outputs = np.linspace(run.state.begin, stage.to, stage.outputs + 1).tolist()
        self._farthest = FARTHEST * run.body.extent
        self.taken: dict[str, float | None] = {}

    def go(self) -> bool:
        """Compute and record the remaining outputs of the stage; return whether its end was
        reached.

        If a bond would break, the stage ends early and the body returns to the last output, since
        cracks grow out of equilibrium.
        """
        run = self.run
        state = self.run.state
        while state.outputs < self.stage.outputs and not self.through:
            goal = self._outputs[state.outputs + 1]
            run.target = self._path.parameter_at(goal)
            run.report("equilibrium", state.outputs / self.stage.outputs, run.target)
            self._last_output = Accepted(run, self.solver)
            self._telling = None
            due = (self.stage.duration or 0.0) * ((state.outputs + 1) / self.stage.outputs)
            for stop in [*self._turns_before(goal), goal]:
                way = goal - state.parameter
                share = 1.0 if stop == goal else (stop - state.parameter) / way
                equilibrium = self._go_to(stop, share * (due - state.time))
                if self.through:
                    break
                if equilibrium is None:
                    self._last_output.restore(run, self.solver)
                    return False
            state.outputs += 1
            state.time = state.time if self.through else due
            self._record(equilibrium)
            self._checkpoint()
        return True

    def resume(self, checkpoint: Checkpoint) -> None:
        """Restore the stage from a checkpoint, which was written at an output."""
        run = self.run
        self.solver.gave_up = bool(checkpoint.progress["gave_up"])
        run.loading.apply(run.state.parameter, run.loaded, run.positions)

    def _checkpoint(self) -> None:
        """Write a checkpoint of the last output."""
        self._checkpoints.write({"gave_up": self.solver.gave_up}, {})

    def _turns_before(self, goal: float) -> list[float]:
        """Return the values of t on the way to the next output at which amplitudes turn, if there
        is a history that depends on them: of the force, or of bonds that may break.
        """
        run = self.run
        if self.stage.control is not None or not (run.force.history or run.damage):
            return []
        begin = run.state.parameter
        entries = entries_of(run.problem.scene, "prescribed", "loads", "obstacles")
        turns = {
            turn
            for _, entry in entries
            for turn in turns_of(entry.amplitude, *sorted((begin, goal)))
        }
        return sorted(turns, reverse=goal < begin)

    def _go_to(self, stop: float, time: float) -> Equilibrium | None:
        """Return the equilibrium at `stop`, the end of the way to the next output or a turn on it,
        which takes a `time`; None if a bond would break on the way.
        """
        run = self.run
        increments = self._path.increments_to(stop, time)
        while not increments.finished:
            equilibrium, before = self._attempt(increments)
            self._accept(increments, before)
            if run.damage is not None and run.body.share.any(
                len(run.damage.failing(run.force).pairs) > 0
            ):
                return None
        return equilibrium

    def _attempt(self, increments: Increments) -> tuple[Equilibrium, "Accepted"]:
        """Find the equilibrium at the end of the present increment, which is shortened as often as
        needed; return it, and the state before it.
        """
        run = self.run
        while True:
            before = Accepted(run, self.solver)
            try:
                return self.follow(increments), before
            except TooSmall:
                reached = run.positions.copy()
                before.restore(run, self.solver)
                run.earlier = increments.target, reached
                raise
            except FAILURES as error:
                before.restore(run, self.solver)
                # After loads that carry the body away, shorter increments just below a limit load
                # fail in less telling ways.
                if not isinstance(self._telling, RanAway):
                    self._telling = error
                self._shorten(increments, self._telling, error)

    def _accept(self, increments: Increments, before: "Accepted") -> None:
        """Accept the equilibrium just found at the end of the present increment."""
        run = self.run
        run.accept()
        run.state.time += increments.duration
        taken = run.force.evaluations - before.evaluations
        run.earlier = before.parameter, before.arrays["positions"]
        if increments.accept():
            again = f"increments of {increments.size:.3g} again, after one of {taken} evaluations"
            run.note(run.state.parameter, reason=again)

    def follow(self, increments: Increments) -> Equilibrium:
        """Find and return the equilibrium at the end of the present increment.

        Raise an error if the equilibrium is unstable or does not continue the last one
        (`check_branch`), or if, at an output, its strains are too small for the precision.
        """
        run = self.run
        state = self.run.state
        target = increments.target
        run.force.elapse(increments.duration, state.before)
        before = run.positions.copy() if run.loads.obstacles else run.positions
        guesses = self._path.guesses(target)
        guess = self._best(guesses, target)
        # What single precision reached at the target may lie on another branch.
        continues = guesses[0] if run.earlier and run.earlier[0] == target else guess
        tolerance = run.problem.scene.solver.tolerance
        # A history is that of all states, an elastic state forgets the ones before it.
        if not (self._reports(increments) or run.force.history):
            tolerance = max(tolerance, self._coarse())
        self._path.force_at(target, guess)
        run.positions[:] = guess
        equilibrium = self._solve(target, tolerance, guess)
        reached = self._path.reached(target)
        run.loads.check_path(state.parameter, reached, before, run.positions)
        self._check(increments, reached, continues)
        state.parameter = reached
        return equilibrium

    def _note(self, target: float, residual: float) -> None:
        """Add a row about the search for the equilibrium at the end `target` of an increment to
        the table of convergence.
        """
        run = self.run
        energy = (
            {"energy": run.body.share.total(run.force.energy())} if run.force.has_energy else {}
        )
        run.note(target, residual=residual, **energy)

    def _numbers(self) -> dict[str, float]:
        """Return numbers for the report of progress that only this kind of stage has."""
        return {}

    def _columns(self) -> dict[str, float]:
        """Return the columns of a row of the history that only this kind of stage has."""
        return {}

    def _reports(self, increments: Increments) -> bool:
        """Return whether results report the equilibrium at the end of the present increment."""
        return increments.ends

    def _coarse(self) -> float:
        """Return the tolerance in intermediate states."""
        return COARSE if self.run.loaded.nearly_incompressible else FINE

    def _check(self, increments: Increments, reached: float, guess: np.ndarray) -> None:
        """Raise an error if the equilibrium just found at the parameter `reached` is not one, or
        not on the branch of its first `guess` (n, d).
        """
        self._path.check_branch(reached, guess)
        if increments.ends:
            _check_resolved(self.run, reached)

    def _best(self, guesses: list[np.ndarray], target: float) -> np.ndarray:
        """Return, of several first guesses (n, d), the one with the least residual force at the
        end `target` of an increment.
        """
        run = self.run

        def residual(guess: np.ndarray) -> float:
            forces = np.empty_like(guess)
            force = self._path.force_at(target, guess)
            try:
                force(guess, forces)
            except InvalidState:
                return np.inf
            forces *= run.loading.free
            return run.body.share.dot(forces, forces)

        return guesses[0] if len(guesses) == 1 else min(guesses, key=residual)

    def _shorten(self, increments: Increments, cause: Exception, error: Exception) -> None:
        """Shorten an increment that failed with an error and was undone, for another attempt, or
        else make the last equilibrium an output.

        `cause` is the error to report: `error`, or a more telling one of an earlier, longer
        increment.

        Raises
        ------
        NoEquilibrium, InvalidState
            If the increment is not shortened. The error has the type of `cause`; its message says
            which loading was reached.
        """
        run = self.run
        at = self.run.state.parameter
        size = increments.size
        run.note(increments.target, failure=str(error))
        logger.info(
            "increment to %s failed and is shortened: %s", self._path.at(increments.target), error
        )
        if increments.shorten(self.least):
            return
        last = f"the last equilibrium was found at {self._path.last()}"
        if self.stage.control is None and at != self._last_output.parameter:
            # A state accepted at a coarse tolerance just below a limit load need not be one.
            target, run.target = run.target, at
            try:
                self._record(self.follow(Increments(at, at, 1.0)))
            except FAILURES:
                last += " (only to the tolerance of increments)"
            run.target = target
        what = f"{last}, and none beyond with increments down to {size:.2g}"
        raise type(cause)(f"{cause}; {what} ({run.problem.reached(at)})") from cause

    def _solve(self, target: float, tolerance: float, guess: np.ndarray) -> Equilibrium:
        """Solve for equilibrium at the end `target` of an increment from `guess`, the first guess
        of the increment.

        Raise RanAway if loads carry a point farther than `FARTHEST` allows. On the way stop on
        request.
        """
        run = self.run
        began = self.run.force.evaluations
        outputs = run.state.outputs
        greatest = tolerance

        def report(evaluations: int, residual: float) -> None:
            nonlocal greatest
            run.residual = residual
            logger.debug("%d evaluations, residual %.3g", began + evaluations, residual)
            self._note(target, residual)
            # The residual falls over many decades: its logarithm says how much of the search is
            # done.
            greatest = max(greatest, residual)
            done = (
                np.log(greatest / max(residual, tolerance)) / np.log(greatest / tolerance)
                if greatest > tolerance
                else 1.0
            )
            done = float(outputs + done) / self.stage.outputs
            numbers = {"residual": residual, "evaluations": evaluations} | self._numbers()
            run.report("equilibrium", done, run.target, **numbers)
            self._stop_on_request()
            moved = (
                run.body.share.greatest(np.abs(run.positions - guess))
                if len(run.loads) > len(run.loads.obstacles)
                else 0.0
            )
            if moved > self._farthest:
                weak = note_of_modes(run.force, "so that small loads may already carry points away")
                raise RanAway(
                    f"the loads carry the body away: points moved by {moved:.3g} in one increment"
                    f" without equilibrium{weak}"
                )

        drive = self._path.least_drive(target)
        taken = 0
        # Branches settle as well at the tolerance of intermediate states.
        rough = any(term.settles for term in run.force.terms)
        for _ in range(MOST_ROUNDS):
            within = max(tolerance, FINE) if rough else tolerance
            found = self._path.solver.solve(run.loaded, run.positions, within, report, drive)
            taken += found.evaluations
            if not settle(run.force, run.positions):
                if within == tolerance:
                    return replace(found, evaluations=taken)
                rough = False
        raise NoEquilibrium("branches do not settle: their relaxation times depend on the state")

    def _stop_on_request(self) -> None:
        """Raise Interrupted in a run that should stop, back at the last output, of which there is
        a checkpoint then.
        """
        run = self.run
        if run.body.share.any(run.interruption.asked):
            self._last_output.restore(run, self.solver)
            self._last_output.forget_later(run.force)
            if not self._checkpoints.resumable:
                self._checkpoint()
            raise Interrupted

    def _record(self, equilibrium: Equilibrium) -> None:
        """Record an output in equilibrium; raise Unbalanced if loads and reactions are not in
        balance.
        """
        run = self.run
        state = self.run.state
        drive = (
            equilibrium.drive if _is_driven(run, state.parameter) else state.greatest_drive or None
        )
        if self.through:
            drive = None
        state.greatest_drive = max(state.greatest_drive, drive or 0.0)
        level = output_row(run, drive=drive)
        if self.stage.duration is not None:
            level["time"] = state.elapsed + state.time
        level |= {
            "residual": equilibrium.residual,
            "evaluations": equilibrium.evaluations,
            "method": equilibrium.method,
            **self.taken,
        }
        if self.stage.control is not None and "stability" in level:
            level["stability"] = "not checked"
        if drive and level["force_balance"] > MOST_OFF:
            off = (
                f"{100 * level['force_balance']:.2g} % of the forces that drive the body, more than"
                f" {100 * MOST_OFF:g} %"
            )
            raise Unbalanced(f"loads and reactions are not in balance: their sum is {off}")
        state.levels.append(level)
        reached = (
            run.loading.at(state.parameter),
            equilibrium.evaluations,
            equilibrium.residual,
            equilibrium.method,
        )
        logger.info("%s: equilibrium after %d evaluations, residual %.2g, by %s", *reached)
        state.history.append(equilibrium_columns(run, level) | self._columns())
        run.record(state.time)


class Accepted:
    """Copy of an equilibrium, to which the run returns if an increment fails, a bond would break,
    or the run is interrupted.
    """

    def __init__(self, run: Run, solver: EquilibriumSolver) -> None:
        self.parameter = run.state.parameter
        self.numbers = run.state.time, run.state.before, run.state.overstress
        self.earlier, self.followed = run.earlier, run.followed
        self.gave_up = solver.gave_up
        self.evaluations = run.force.evaluations
        self.outside = run.force.pairs_outside, run.force.most_outside
        self.arrays = {key: array.copy() for key, array in run.arrays().items()}

    def restore(self, run: Run, solver: EquilibriumSolver) -> None:
        """Bring a run and its solver back to this equilibrium."""
        run.state.parameter = self.parameter
        run.state.time, run.state.before, run.state.overstress = self.numbers
        run.earlier, run.followed = self.earlier, self.followed
        solver.gave_up = self.gave_up
        for key, array in run.arrays().items():
            array[:] = self.arrays[key]
        run.force.elapse(0.0)
        run.loading.apply(self.parameter, run.loaded, run.positions)

    def forget_later(self, force: InternalForce) -> None:
        """Take back the counts of evaluations since, which a resumed run repeats."""
        force.evaluations = self.evaluations
        force.pairs_outside, force.most_outside = self.outside


def _check_resolved(run: Run, target: float) -> None:
    """Raise `TooSmall` if the strains of an equilibrium are so small that rounding errors exceed
    a thousandth of them.
    """
    if not _is_driven(run, target):
        return
    laws = [law for law, _ in run.force.laws]
    moduli = [law.shear_modulus for law in laws]
    contrast = max(moduli) / min(moduli)
    stiffness = (
        1.0
        if run.force.plane == "stress"
        else max(1.0, *(law.bulk_modulus / law.shear_modulus for law in laws))
    )
    rounding = stiffness * strain_rounding(run.body, run.positions)
    least = RESOLVED * max(FORCE_ROUNDING[run.force.precision], rounding) * contrast
    strain = strain_of(run.loaded)
    if strain < least:
        apart = (
            f" with shear moduli that differ by a factor of {contrast:.3g}" if contrast > 1 else ""
        )
        away = (
            f" at coordinates of up to {run.body.share.greatest(np.abs(run.positions)):.1g}"
            if run.force.precision == "float64"
            else ""
        )
        resolved = (
            f"{PRECISION_NAMES[run.force.precision]} precision, which resolves"
            f" {least:.1g}{apart}{away}"
        )
        raise TooSmall(f"the greatest strain, {strain:.2g}, is too small for {resolved}")


def _is_driven(run: Run, parameter: float) -> bool:
    """Return whether the body is strained at a value of the loading parameter: False if it is
    undeformed, or unloaded and moved rigidly.
    """
    if run.loading.at_rest(parameter):
        return False
    if run.body.share.any(bool((run.loaded.applied() * run.loading.free).any())) or not is_rigid(
        run.loaded
    ):
        return True
    return run.loading.deforms(parameter, run.positions)
