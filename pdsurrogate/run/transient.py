"""Stages in explicit dynamics: time stepping with moving supports, rows of the history, outputs,
and cracks that start and grow.
"""

import math
import warnings
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from ..forces import InvalidState
from ..problem import Stage
from ..results.checkpoint import Checkpoint
from ..solvers.bond_strains import NONE
from ..solvers.dynamics import ExplicitDynamics
from ..solvers.equilibrium import Diverging
from ..solvers.increments import Motion
from ..solvers.reactions import support_reactions
from ..solvers.step_runs import can_run
from .account import STEPS_PER_ROW, Bookkeeping
from .checkpoints import Checkpoints
from .interruption import Interrupted
from .quick_steps import QuickSteps
from .rows import (
    component_columns,
    crack_rows,
    forces_by_name,
    moments_by_name,
    output_row,
    place_columns,
    state_columns,
)
from .run import Run
from .running_cracks import RunningCracks

CRACK_VISCOSITY = 0.7
"""Default viscosity (retardation time) of scenes with fracture, in units of the spacing divided by
the speed of shear waves.

Material that unloads behind a crack moves in waves as short as a bond, and this viscosity
dissipates their energy within a few steps. Energy accounts of strips torn with `bond-energy` close
within 0.1 % with it; without it they gain half of the supplied energy (`docs/guide/cracks.md`).
"""


INTEGRATOR = ("time_step", "last_step", "steps")
"""Names of the integrator's attributes that a checkpoint contains."""


class Transient:
    """Stage in explicit dynamics while it runs: its time steps, rows of the history and outputs.

    Parameters
    ----------
    run : Run
        Run with the positions of the end of the last stage, or of a checkpoint.
    stage : Stage
    checkpoints : Checkpoints
    """

    def __init__(self, run: Run, stage: Stage, checkpoints: Checkpoints) -> None:
        self.run = run
        self.stage = stage
        self.most_outputs = stage.outputs
        self._checkpoints = checkpoints
        spec = stage.inertia
        self.motion = stage.motion(run.state.begin)
        self.viscosity = spec.viscosity
        if self.viscosity is None:
            softest = min(law.shear_modulus for law, _ in run.force.laws)
            of_cracks = CRACK_VISCOSITY * run.body.spacing * math.sqrt(spec.density / softest)
            self.viscosity = 0.0 if run.damage is None else of_cracks
        at_rest = (
            run.positions,
            np.zeros_like(run.positions),
            run.loading.free,
            spec.density * run.body.volumes,
        )
        self.integrator = ExplicitDynamics(
            run.force,
            _holding(run, self.motion),
            *at_rest,
            damping=spec.damping,
            viscosity=self.viscosity,
            safety=spec.safety,
            loads=run.loads,
            broken=NONE if run.damage is None else run.damage.broken,
        )
        self._books = Bookkeeping(run, self.integrator, self.motion, self.viscosity)
        self.account = self._books.account
        self._cracks = (
            None if run.damage is None else RunningCracks(run, self.integrator, self.account)
        )
        self._passed: set[str] = set()
        self._quick = None
        if can_run(run.loaded, run.loading) and run.problem.strengths is None:
            search = None if run.damage is None else run.damage.search
            self._quick = QuickSteps(run, self.integrator, self._books, search, STEPS_PER_ROW)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays of the dynamics that a checkpoint contains, by name."""
        integrator = self.integrator
        held = {
            "velocities": integrator.velocities,
            "forces": integrator.forces,
            "mode": integrator.frequency.vector,
        }
        return held if self.viscosity == 0 else held | {"elastic": integrator.elastic}

    def begin(self) -> None:
        """Set the initial velocities, forces and time step of the stage, and add the first row to
        the history.

        After equilibrium the velocities are those of a body that follows its held points and planes
        quasi-statically, so that no shock is sent; after dynamics they are the last velocities, and
        held points and planes that change their velocity do send a shock.
        """
        run = self.run
        integrator = self.integrator
        motion = self.motion
        velocities = (
            run.loading.course.velocities(run.positions, motion)
            if run.velocities is None
            else run.velocities
        )
        integrator.velocities[:] = velocities * run.loading.free
        integrator.begin()
        self._limit_step()
        if run.velocities is None:
            integrator.center()
        run.state.dynamics.append({"step": run.state.stage, "viscosity": float(self.viscosity)})
        self._row(first=True)

    def resume(self, checkpoint: Checkpoint) -> None:
        """Restore the integrator, energy account and held parts of the stage from a checkpoint."""
        run = self.run
        integrator = self.integrator
        kept = checkpoint.progress["transient"]
        vars(self.account).update(kept["account"])
        for key in INTEGRATOR:
            setattr(integrator, key, kept[key])
        integrator.frequency.fresh = False
        for key, array in self.arrays().items():
            array[:] = checkpoint.arrays[key]
            run.body.share.clear(array)  # the owners of halo points move them
        self._limit_step()
        self._apply()

    def go(self) -> bool:
        """Advance to the end of the stage, or until the body has separated between its supports.

        Return True, as `Equilibria.go` does at the end of its stage: no other stage has to replace
        this one.
        """
        run = self.run
        account = self.account
        integrator = self.integrator
        through = False
        while account.outputs < self.most_outputs and not through:
            try:
                self.step()
                on_row = integrator.steps % STEPS_PER_ROW == 0
                if on_row:
                    self._check_inside()
            except InvalidState as error:
                if self.save_last_state():
                    self._say(f"{error}; the body had separated, and the run ends there")
                    break
                raise type(error)(f"time {account.time:.4g}: {error}") from None
            integrator.accept()
            run.loads.let_go(run.positions)
            if on_row:
                self._row()
            else:
                self._books.between_rows()
            due = self._due() or (on_row and self._torn())
            if due:
                through = self.output()
                self._books.check()
            # A checkpoint includes the row and the output of its step, but not the row that an
            # interruption adds.
            asked, late = run.body.share.total(
                (int(run.interruption.asked), int(self._checkpoints.late))
            )
            if not through and (due or asked or late):
                kept = {key: getattr(integrator, key) for key in INTEGRATOR} | {
                    "account": account.entries()
                }
                self._checkpoints.write({"transient": kept}, self.arrays())
            if not through and asked:
                self._last_row()
                raise Interrupted
        if self._books.closes and run.state.dynamics[-1]["remark"] and run.ranks.rank == 0:
            warnings.warn(run.state.dynamics[-1]["remark"], stacklevel=4)
        return True

    def _check_inside(self) -> None:
        """Check that no point has crossed a plane or entered an obstacle; what has been torn off
        a plane may cross it, which is said once.
        """
        run = self.run
        broken = None if run.damage is None else run.damage.broken
        passed = run.loading.check_inside(run.state.parameter, run.force, run.positions, broken)
        if new := set(passed) - self._passed:
            self._passed |= new
            names = " and the ".join(sorted(new))
            self._say(f"a piece torn off the {names} passes it: contact is not computed")

    def _say(self, what: str) -> None:
        """Warn of an event at the present time."""
        if self.run.ranks.rank == 0:
            warnings.warn(f"time {self.account.time:.4g}: {what}", stacklevel=5)

    def _time_due(self, outputs: int) -> float:
        """Return the time, since the stage began, at which an output is due after `outputs`
        earlier ones.
        """
        return self.motion.duration * ((outputs + 1) / self.most_outputs)

    def _due(self) -> bool:
        """Return whether the next output is due."""
        return self.account.time >= self._time_due(self.account.outputs)

    def _torn(self) -> bool:
        """Return whether the body has separated, in the first row of the history without a bond
        that broke since the last row.

        Chains of bonds are searched for there alone, since the search costs as much as some
        evaluations of the forces.
        """
        quiet = STEPS_PER_ROW <= self.integrator.steps - self.account.last_break < 2 * STEPS_PER_ROW
        return self._cracks is not None and quiet and self._cracks.separated()

    def save_last_state(self) -> bool:
        """Undo a failed time step, and record the state before the step unless it has been
        recorded.

        Return whether the recorded state ends the run: the body has separated, and its energy
        account closes. What its parts do then is no result of the tear.
        """
        run = self.run
        integrator = self.integrator
        run.force.elapse(0.0)
        run.positions -= integrator.last_step * integrator.velocities
        self.account.time -= integrator.last_step
        run.state.parameter = self.motion.at(self.account.time)
        recorded = run.states.moments[-1].time - run.state.elapsed if len(run.states) else -np.inf
        if self.account.time > recorded + 0.5 * integrator.last_step:
            with suppress(InvalidState, Diverging):
                self._apply()
                if self._cracks is None or not self._cracks.separated():
                    self._check_inside()
                integrator.evaluate_at_rest()
                through = self.output()
                self._books.check()
                return through
        return False

    def step(self) -> None:
        """Advance the body by one time step, after those that need no Python: move points and held
        parts, evaluate the forces, and break overstretched bonds.
        """
        run = self.run
        account = self.account
        integrator = self.integrator
        due = self._time_due(account.outputs)
        moved = None if self._quick is None else self._quick.take(due)
        left = due - account.time
        if moved is None:
            integrator.move()
        else:
            integrator.moved(moved)
        account.time = due if integrator.last_step == left else account.time + integrator.last_step
        run.state.steps += 1
        ended = account.time >= self.motion.duration
        # without rounding at the end
        run.state.parameter = run.target = (
            self.motion.end if ended else self.motion.at(account.time)
        )
        self._apply()
        if self._cracks is None:
            integrator.evaluate()
        else:
            self._cracks.evaluate_and_break()
        self._limit_step()

    def _limit_step(self) -> None:
        """Set the greatest length of the next time step, such that a step ends at every output."""
        # The remaining time is divided equally, so that no step before an output is much shorter
        # than the others.
        left = self._time_due(self.account.outputs + self._due()) - self.account.time
        self.integrator.longest = (
            self.integrator.part_of(left) if left > 0 else self.integrator.last_step
        )

    def _apply(self) -> None:
        """Move all held parts of the run to their places at the present time, and set the loads
        to their size then.
        """
        self.run.loading.apply(self.run.state.parameter, self.run.force, self.run.positions)

    def _last_row(self) -> None:
        """Add a row for the present time to the history, unless the last row is already for this
        time.
        """
        if self.account.time > self.account.row_time:
            self._row()

    def _row(self, first: bool = False) -> None:
        """Add a row for the present time to the history, after adding work and damped energy
        until then to the energy account.
        """
        run = self.run
        books = self._books
        stress = self.run.problem.measures.nominal_stress
        reactions = support_reactions(run.loading, run.loaded, self.integrator.forces)
        kinetic = books.kinetic_energy()
        forces = forces_by_name(run, reactions)
        books.advance(reactions, evaluate=True)
        strain = run.strain_energy()
        row = place_columns(run, run.state.elapsed + self.account.time)
        if stress is not None:
            row["nominal_stress"] = stress.of(reactions.forces)
        else:
            row |= component_columns("moment", moments_by_name(run, reactions))
        row |= (
            books.columns(kinetic, strain, first)
            | component_columns("force", forces)
            | state_columns(run)
        )
        if books.closes:
            row["released_energy"] = self.account.released_energy
        if run.state.crack is not None:
            row |= {
                "broken_bonds": run.state.crack["broken_bonds"],
                "free_points": run.body.share.count(~run.force.supported),
            }
        run.state.history.append(row)
        run.state.dynamics[-1] |= books.entries()
        energies = {"strain_energy": strain, "kinetic_energy": kinetic}
        broken = (
            {} if run.state.crack is None else {"broken_bonds": run.state.crack["broken_bonds"]}
        )
        share = self.account.time / self.motion.duration
        run.report(
            "dynamics",
            share,
            run.state.parameter,
            **broken,
            steps=self.integrator.steps,
            **energies,
        )

    def output(self) -> bool:
        """Record the present state as an output, with a row of the history; return whether the body
        has separated between its supports.

        Except for bodies between grips, whose nominal stress is in the history, the output also
        becomes a row of ``summary["levels"]``.
        """
        run = self.run
        account = self.account
        self._last_row()
        through = self._cracks is not None and self._cracks.output()
        self._apply()
        between_grips = run.problem.measures.nominal_stress is not None
        if not between_grips or (self._cracks is not None and run.measures_cracks):
            run.loaded(run.positions, np.empty_like(run.positions))
        if not between_grips:
            row = output_row(run, run.state.elapsed + account.time)
            run.state.levels.append(row | {"kinetic_energy": self._books.kinetic_energy()})
        elif self._cracks is not None and run.measures_cracks:
            run.state.crack["tips"][-1]["cracks"] = crack_rows(run)
        run.record(account.time)
        account.outputs += 1
        return through


def _holding(run: Run, motion: Motion) -> Callable[[np.ndarray, float], None]:
    """Return a function that moves held points, in positions (n, d), and reflection planes to their
    places a given time ahead.

    A method would refer to the integrator, which refers to this function, and the circle of
    references would keep the body in memory.
    """

    def hold(positions: np.ndarray, ahead: float) -> None:
        run.loading.hold(run.state.parameter + ahead * motion.rate, run.force, positions)

    return hold
