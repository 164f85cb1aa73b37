"""Stages in equilibrium: outputs on the way, and increments between them."""

import logging
from contextlib import suppress

import numpy as np

from ..forces import InvalidState
from ..problem import Stage
from ..results.checkpoint import Checkpoint
from ..scenes import SceneError
from ..solvers.equilibrium import (
    Equilibrium,
    EquilibriumSolver,
    NoEquilibrium,
    OutOfPatience,
    RanAway,
    TooSmall,
    Unbalanced,
    note_of_modes,
)
from ..solvers.increments import Increments
from ..solvers.methods import SOLVERS
from ..solvers.nearest_bonds import RESOLVED, is_rigid, strain_of, strain_rounding
from .checkpoints import ACCEPTED, LAST_OUTPUT, Checkpoints
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

BUDGET = 7
"""Force evaluations of an output after its first failed attempt, divided by the mean for an output
of the run so far, from which on an increment that fails is halved no further. The first attempt may
take any number: outputs just below a limit load do.
"""

USUAL = 200
"""Force evaluations assumed for an output of a run that has none yet."""

FINE, COARSE = 1e-3, 1e-2
"""Tolerances of the solver in intermediate states, from which only the next increments start.
Chosen: the error of the start is then small compared with that of the extrapolation. The second
tolerance is for nearly incompressible bodies, whose preconditioner corrects the remaining error (a
fifth fewer evaluations of bonded blocks).
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
    undone and shortened. A checkpoint between outputs contains the increments and the state of the
    solver.

    Parameters
    ----------
    run : Run
    stage : Stage
    solver : EquilibriumSolver
        Solver of stages that prescribe the loading parameter.
    checkpoints : Checkpoints
    """

    def __init__(
        self, run: Run, stage: Stage, solver: EquilibriumSolver, checkpoints: Checkpoints
    ) -> None:
        self.run, self.stage, self.solver, self._checkpoints = run, stage, solver, checkpoints
        self._path = (
            ParameterPath(run, stage, solver)
            if stage.control is None
            else DisplacementPath(run, stage)
        )
        self._outputs = np.linspace(run.state.begin, stage.to, stage.outputs + 1).tolist()
        self._farthest = FARTHEST * run.body.extent
        self._last_output = self._at_output()
        self._increments: Increments | None = None
        self._accepted: _Accepted | None = None  # start of the present increment
        self._iterate: np.ndarray | None = None  # state of the solver of a resumed run

    def go(self) -> bool:
        """Compute and record the remaining outputs of the stage; return whether its end was
        reached.

        If a bond would break, the stage ends early and the body returns to the last output, since
        cracks grow out of equilibrium.
        """
        run, state = self.run, self.run.state
        while state.outputs < self.stage.outputs:
            goal = self._outputs[state.outputs + 1]
            run.target = self._path.parameter_at(goal)
            run.report("equilibrium", state.outputs / self.stage.outputs, run.target)
            if self._increments is None:
                self._last_output, state.failed, state.begun = (
                    self._at_output(),
                    None,
                    run.force.evaluations,
                )
                self._increments = self._path.increments_to(goal)
            equilibrium, self._increments = self._go_to_output(self._increments), None
            if equilibrium is None:
                arrays, state.parameter = self._last_output
                for key, array in self._output_arrays().items():
                    array[:] = arrays[key]
                run.loading.apply(state.parameter, run.loaded, run.positions)
                return False
            state.outputs += 1
            state.costs.append(run.force.evaluations - state.begun)
            self._record(equilibrium)
            self.checkpoint()
        return True

    def resume(self, checkpoint: Checkpoint) -> None:
        """Restore the stage from a checkpoint that was written at an output or between two
        outputs.
        """
        run, kept, arrays = self.run, checkpoint.progress["way"], checkpoint.arrays
        self.solver.gave_up = bool(checkpoint.progress["gave_up"])
        if kept is not None:
            self._iterate = run.positions.copy()
            self._last_output = (
                {key: arrays[key].copy() for key in self._output_arrays()},
                kept["last_output"],
            )
            self._increments = Increments(
                end=self._outputs[run.state.outputs + 1], **kept["increments"]
            )
            for key, array in run.arrays().items():
                array[:] = arrays[ACCEPTED + key]
        run.loading.apply(run.state.parameter, run.loaded, run.positions)

    def checkpoint(self, increments: Increments | None = None) -> None:
        """Write a checkpoint: at an output, or with `increments` between two outputs."""
        kept, arrays = None, {}
        if increments is not None:
            kept = {"increments": increments.describe(), "last_output": self._last_output[1]}
            arrays = {
                ACCEPTED + key: array for key, array in self._accepted.arrays.items()
            } | self._last_output[0]
        self._checkpoints.write({"gave_up": self.solver.gave_up, "way": kept}, arrays)

    def _output_arrays(self) -> dict[str, np.ndarray]:
        """Return the positions, the pushes of obstacles and the history of the force, by the names
        that they have in a checkpoint as those of the last output.
        """
        others = self.run.contact | self.run.force.history
        return {LAST_OUTPUT: self.run.positions} | {
            f"{LAST_OUTPUT}_{name}": array for name, array in others.items()
        }

    def _at_output(self) -> tuple[dict[str, np.ndarray], float]:
        """Return copies of positions and history, and the loading parameter, by which the body
        can return to the present state.
        """
        return {
            key: array.copy() for key, array in self._output_arrays().items()
        }, self.run.state.parameter

    def _go_to_output(self, increments: Increments) -> Equilibrium | None:
        """Return the equilibrium at the next output, reached in increments; None if a bond would
        break on the way.
        """
        run, state, told, usual = self.run, self.run.state, None, self._usual()
        while not increments.finished:
            self._accepted, began = _Accepted(run, self.solver), run.force.evaluations
            left = np.inf if state.failed is None else BUDGET * usual + state.failed - began
            try:
                equilibrium = self._follow(increments, max(left, usual))
            except TooSmall:
                self._accepted.restore(run, self.solver)
                raise
            except FAILURES as error:
                state.failed, spent = (
                    state.failed or run.force.evaluations,
                    left < run.force.evaluations - began,
                )
                # After loads that carry the body away, shorter increments just below a limit load
                # fail in less telling ways.
                told = (
                    told
                    if isinstance(told, RanAway)
                    or (told is not None and isinstance(error, OutOfPatience))
                    else error
                )
                self._take_back(increments, told, error, spent)
                continue
            run.force.accept(run.positions)
            taken = run.force.evaluations - began
            run.earlier = self._accepted.parameter, self._accepted.arrays["positions"]
            if increments.accept():
                again = (
                    f"increments of {increments.size:.3g} again, after one of {taken} evaluations"
                )
                run.note(state.parameter, reason=again)
            if run.damage is not None and run.body.share.any(
                len(run.damage.overstretched(run.force.positions)) > 0
            ):
                return None
        return equilibrium

    def _usual(self) -> float:
        """Return the mean number of force evaluations for an output of the run so far, or
        `USUAL` before the first one.
        """
        return float(np.mean(self.run.state.costs or USUAL))

    def _follow(self, increments: Increments, most: float) -> Equilibrium:
        """Find and return the equilibrium at the end of the present increment, within `most` force
        evaluations.

        Raise an error if the equilibrium is unstable or does not continue the last one
        (`check_branch`), or if, at an output, its strains are too small for the precision.
        """
        run, state, target = self.run, self.run.state, increments.target
        before = run.positions.copy()
        guess = self._best(self._path.guesses(target), target)
        tolerance = run.problem.scene.solver.tolerance
        if not increments.ends:
            tolerance = max(tolerance, COARSE if run.loaded.nearly_incompressible else FINE)
        start, self._iterate = (
            (guess if self._iterate is None else self._best([guess, self._iterate], target)),
            None,
        )
        self._path.force_at(target, start)
        run.positions[:] = start
        equilibrium = self._solve(target, tolerance, guess, most, increments)
        reached = self._path.reached(target)
        run.loads.check_path(state.parameter, reached, before, run.positions)
        self._path.check_branch(reached, guess)
        if increments.ends:
            _check_resolved(run, reached)
        state.parameter = reached
        return equilibrium

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

    def _take_back(
        self, increments: Increments, cause: Exception, error: Exception, spent: bool
    ) -> None:
        """Undo an increment that failed with an error, and shorten it for another attempt unless
        the `BUDGET` is `spent`.

        `cause` is the error to report: `error`, or a more telling one of an earlier, longer
        increment.

        Raises
        ------
        NoEquilibrium, InvalidState
            If the increment is not shortened. The error has the type of `cause`; its message says
            which loading was reached.
        """
        run, state = self.run, self.run.state
        run.note(increments.target, failure=str(error))
        logger.info(
            "increment to %s failed and is shortened: %s", self._path.at(increments.target), error
        )
        self._accepted.restore(run, self.solver)
        size = increments.size
        if not spent and increments.shorten():
            return
        if self._path.records_last:
            self._record_reached()
        what = (
            f"the last equilibrium was found at {self._path.last()}, and none beyond with"
            f" increments down to {size:.2g}"
        )
        if spent:
            what += (
                f" in the force evaluations of {BUDGET} outputs (more outputs come closer to the"
                " limit)"
            )
        raise type(cause)(f"{cause}; {what} ({run.problem.reached(state.parameter)})") from cause

    def _record_reached(self) -> None:
        """Solve further for the last equilibrium of a failed run, to the tolerance of an output,
        and record it if the solver converges.

        An equilibrium that is an output or the beginning of the stage is recorded already.
        """
        run, state = self.run, self.run.state
        if state.parameter in (
            state.begin,
            *(level[run.loading.parameter] for level in state.levels[-1:]),
        ):
            return
        target, run.target = run.target, run.state.parameter
        # A state accepted at a coarse tolerance just below a limit load need not be an equilibrium.
        with suppress(*FAILURES):
            before = run.positions.copy()
            equilibrium = self._solve(
                run.target, run.problem.scene.solver.tolerance, before, BUDGET * self._usual()
            )
            run.loads.check_path(run.target, run.target, before, run.positions)
            self._path.check_branch(run.target, before)
            self._record(equilibrium)
        run.target = target

    def _solve(
        self,
        target: float,
        tolerance: float,
        guess: np.ndarray,
        most: float,
        increments: Increments | None = None,
    ) -> Equilibrium:
        """Solve for equilibrium at the end `target` of an increment from the present positions,
        within `most` force evaluations.

        Raise RanAway if loads carry a point farther than `FARTHEST` allows from `guess`, the first
        guess of the increment. On the way write checkpoints and stop on request.
        """
        run, began = self.run, self.run.force.evaluations
        outputs, greatest = run.state.outputs, tolerance

        def report(evaluations: int, residual: float) -> None:
            nonlocal greatest
            run.residual = residual
            logger.debug("%d evaluations, residual %.3g", began + evaluations, residual)
            energy = {"energy": run.strain_energy()} if run.force.has_energy else {}
            run.note(target, residual=residual, **energy)
            # The residual falls over many decades: its logarithm says how much of the search is
            # done.
            greatest = max(greatest, residual)
            done = (
                np.log(greatest / max(residual, tolerance)) / np.log(greatest / tolerance)
                if greatest > tolerance
                else 1.0
            )
            done = float(outputs + done) / self.stage.outputs
            run.report("equilibrium", done, run.target, residual=residual, evaluations=evaluations)
            self._keep_or_stop(increments)
            taken = run.force.evaluations - began
            if taken >= most:
                raise OutOfPatience(
                    f"no equilibrium was found within {taken} force evaluations, after a longer"
                    " increment had failed"
                )
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

        return self._path.solver.solve(
            run.loaded, run.positions, tolerance, report, self._path.least_drive(target)
        )

    def _keep_or_stop(self, increments: Increments | None) -> None:
        """Write a checkpoint if one is due, and raise Interrupted in a run that should stop.

        Ctrl-C makes a checkpoint due only if none exists yet: a run that resumes from an older one
        repeats some work and has bitwise the same results. A time limit that has passed makes one
        due, so that the run resumes from its present state.
        """
        run = self.run
        asked = run.interruption.asked
        due = self._checkpoints.late or (
            asked and (run.interruption.out_of_time or not self._checkpoints.resumable)
        )
        asked, due = run.body.share.total((int(asked), int(due)))
        if due and increments is not None:
            self.checkpoint(increments)
        if asked:
            raise Interrupted

    def _record(self, equilibrium: Equilibrium) -> None:
        """Record an output in equilibrium; raise Unbalanced if loads and reactions are not in
        balance.
        """
        run, state = self.run, self.run.state
        drive = (
            equilibrium.drive if _is_driven(run, state.parameter) else state.greatest_drive or None
        )
        state.greatest_drive = max(state.greatest_drive, drive or 0.0)
        level = output_row(run, drive=drive)
        level |= {
            "residual": equilibrium.residual,
            "evaluations": equilibrium.evaluations,
            "method": equilibrium.method,
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
        state.history.append(equilibrium_columns(run, level))
        run.record()


class _Accepted:
    """Copy of the equilibrium from which an increment starts, and to which the run returns if
    the increment fails.
    """

    def __init__(self, run: Run, solver: EquilibriumSolver) -> None:
        self.parameter, self.gave_up = run.state.parameter, solver.gave_up
        self.arrays = {key: array.copy() for key, array in run.arrays().items()}

    def restore(self, run: Run, solver: EquilibriumSolver) -> None:
        """Bring a run and its solver back to this equilibrium."""
        run.state.parameter, solver.gave_up = self.parameter, self.gave_up
        for key, array in run.arrays().items():
            array[:] = self.arrays[key]
        run.loading.apply(self.parameter, run.loaded, run.positions)


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
