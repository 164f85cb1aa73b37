"""Stages in explicit dynamics: what is held goes on in time, how cracks start and run, and where the work of what holds and loads goes."""

from __future__ import annotations

import logging
import math
import warnings
from contextlib import suppress
from dataclasses import asdict, dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from ..body.share import SERIAL
from ..forces import InvalidState
from ..problem import Stage
from ..results.checkpoint import Checkpoint
from ..solvers import Diverging, ExplicitDynamics
from ..solvers.conditions import Reactions
from ..solvers.dynamics import Power
from ..solvers.minimiser import EnergyMinimiser
from .interruption import Interrupted
from .rows import component_columns, forces_by_name, moments_by_name, output_row, place_columns, state_columns
from .run import Run

logger = logging.getLogger(__name__)

STEPS_PER_ROW = 20
"""Steps between rows of the history, which every output has as well.

Work and damped energy are summed in every step by the trapezoidal rule; in the plane, with grips and a force that has no energy, over
these rows, since no account can close.  The part of viscosity needs the forces at the positions.  They are evaluated in a row and, where
the force has an energy, in every step from a bond's breaking until as many steps later, because they change fast there, and while what is
held changes its velocity; in other steps they are followed (`ExplicitDynamics.elastic`)."""

MOST_ENERGY = 1.5
"""Motion and damping may take this share of the energy put in; more comes from an unstable step, or from a force that has no energy.
What it exceeds 1 by is allowed of the most that had been put in at any time.  A force map has no energy of its own, so that the account of
a body that is unloaded, and has given back nearly all it held, is off by a share of what it held, and not of what is left."""

MOST_STEPS = 1e9
"""A run of more steps, weeks even on the smallest body, is a slip in the units of the density or of the rate."""

CRACK_VISCOSITY = 0.7
"""Retardation time of scenes with fracture that give none, in spacings over the speed of shear waves.

Material that snaps back from a crack moves in waves as short as a bond, and this time takes their energy within a few steps.  Strips torn
by `bond-energy` close their accounts within 0.1 % with it; without it they gain half of the energy put in (`docs/guide/cracks.md`)."""

GAP_WARNED, GAP_FAILED = 0.01, 0.05
"""Shares of the energy put in: an account that is off by more than the first is warned of, and by more than the second is a failure."""

MEND_GAP = "a smaller dynamics.safety or more dynamics.viscosity mends it"
"""Advice where an account is off: within a shorter step forces are closer to linear, and viscosity takes motion as short as a bond."""

LEAST_UNEVENNESS = 0.01
"""Share of the way of what is held within the viscosity that may be off from its present velocity where elastic forces are followed: what
viscosity takes of the work of holders is off by as much."""

LEAST_RATIO = 0.1
"""det F, of areas in the plane, below which a point that has lost bonds counts as failed: intact rubber in a tear stays above 0.5."""


@dataclass
class Account:
    """State of the dynamics that a checkpoint keeps in addition to arrays.

    Attributes
    ----------
    time : float
        Since the stage began.
    initial_energy : float
        Motion and strain at the start, per unit thickness.
    work, damped_energy, released_energy : float
        Work of all that holds and loads the body, and energy taken by the damping and released by breaking bonds since then, per unit
        thickness.
    power, damped_power : list of float
        When they were last taken, see `Power`.
    rate_time, damped_time : float
        When that was: at the last row of the history or in a step since.
    row_time : float
        Of the last row.
    most_put_in : float
        Greatest sum of initial energy and work at any row.
    gap, greatest_gap : float
        By how much more energy there is at the last row than was put in; and where that is most, of either sign.
    on_planes, levers : list or None
        Reactions of planes at the positions, see `ExplicitDynamics.elastic`.
    last_break : int
        Step in which a bond last broke.
    outputs : int
        States written so far.
    """

    time: float = 0.0
    initial_energy: float = 0.0
    work: float = 0.0
    damped_energy: float = 0.0
    released_energy: float = 0.0
    power: list[float] = field(default_factory=lambda: [*Power()])
    damped_power: list[float] = field(default_factory=lambda: [*Power()])
    rate_time: float = 0.0
    damped_time: float = 0.0
    row_time: float = 0.0
    most_put_in: float = 0.0
    gap: float = 0.0
    greatest_gap: float = 0.0
    on_planes: list | None = None
    levers: list | None = None
    last_break: int = -STEPS_PER_ROW
    outputs: int = 0


class Transient:
    """The dynamics of one stage of a run.

    Parameters
    ----------
    run : Run
        With its positions as the stage before left them, or as a checkpoint did.
    stage : Stage
    """

    def __init__(self, run: Run, stage: Stage) -> None:
        self.run, self.damage, self.spec, self.most_outputs = run, run.damage, stage.inertia, stage.outputs
        self.account, self.motion = Account(), self.spec.motion(run.begin, stage.to)
        self.viscosity = self._viscosity()
        self.integrator = ExplicitDynamics(
            run.force,
            self._hold,
            run.positions,
            np.zeros_like(run.positions),
            run.loading.free,
            self.spec.density * run.body.volumes,
            self.spec.damping,
            self.viscosity,
            self.spec.safety,
            run.loads,
        )
        self._keeps_account = run.force.has_energy
        # A stage that says its duration is to end, and to be recorded, when it says.  One at a rate goes to the first step past an output.
        self._timed = self.spec.duration is not None
        self._every_step = self._timed or run.body.dimension == 3 or self._keeps_account
        # Below this an energy is rounding: a body at rest holds none, and any motion would be more than was put in.
        modulus = max(law.shear_modulus for law, _ in run.force.laws)
        self._rounding = EnergyMinimiser.ROUNDING[run.force.precision] * modulus * run.body.share.sum(run.body.volumes)
        if self.damage is not None and run.crack is None:
            run.crack = {"start": None, "tips": [], "broken_bonds": 0, "failed_points": 0, "through": False}

    def _viscosity(self) -> float:
        """Return the retardation time of the stage: the scene's own, or by default the time that a crack needs."""
        if self.spec.viscosity is not None:
            return self.spec.viscosity
        if self.damage is None:
            return 0.0
        return CRACK_VISCOSITY * self.run.body.spacing * math.sqrt(self.spec.density / self.run.law.shear_modulus)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the entries of a checkpoint for the dynamics."""
        integrator = self.integrator
        held = {"velocities": integrator.velocities, "forces": integrator.forces, "mode": integrator.frequency.vector}
        return held if self.viscosity == 0 else held | {"elastic": integrator.elastic}

    def begin(self) -> None:
        """Start with the velocities that the stage before left.

        After equilibrium the body goes on as it followed its conditions slowly, so that they send no shock; after dynamics it goes on as it
        was, and where its conditions change their velocity they do send one.
        """
        run, integrator, motion = self.run, self.integrator, self.motion
        velocities = run.loading.course.velocities(run.positions, motion) if run.velocities is None else run.velocities
        integrator.velocities[:] = velocities * run.loading.free
        integrator.begin()
        self._limit_step()
        if self._every_step and run.velocities is None:
            integrator.centre()
        if motion.duration > MOST_STEPS * integrator.time_step:
            raise Diverging(
                f"the dynamics take {run.scene.units.amount(motion.duration, 'time', '.3g')} in steps of {integrator.time_step:.3g}, more "
                f"than {MOST_STEPS:.0e} of them; check the units of {self.spec.key}.density and {self.spec.key}.{self.spec.pace}"
            )
        run.dynamics.append({"step": run.stage, "viscosity": float(self.viscosity)})
        self._row(first=True)

    def resume(self, checkpoint: Checkpoint) -> None:
        """Take up what a checkpoint holds."""
        run, integrator, kept = self.run, self.integrator, checkpoint.progress["transient"]
        self.account = Account(**kept["account"])
        integrator.time_step, integrator.last_step, integrator.steps = kept["time_step"], kept["last_step"], kept["steps"]
        integrator.velocities[:], integrator.forces[:] = checkpoint.arrays["velocities"], checkpoint.arrays["forces"]
        if self.viscosity > 0:
            integrator.elastic[:] = checkpoint.arrays["elastic"]
        integrator.frequency.vector, integrator.frequency.fresh = checkpoint.arrays["mode"].copy(), False
        for array in self.arrays().values():
            run.body.share.clear(array)  # what others own they move
        self._limit_step()
        self._apply()

    def go(self) -> None:
        """Run to the end of the stage, or until the body has come apart."""
        run, account, integrator, motion = self.run, self.account, self.integrator, self.motion
        while account.outputs < self.most_outputs:
            try:
                self.step()
                if integrator.steps % STEPS_PER_ROW == 0:
                    self._check_inside()
            except InvalidState as error:
                self.save_last_state()
                raise type(error)(f"time {account.time:.4g}: {error}") from None
            if integrator.steps % STEPS_PER_ROW == 0:
                self._row()
                broken = run.crack["broken_bonds"] if run.crack else 0
                run.report("dynamics", min(1.0, account.time / motion.duration), run.parameter, broken)
            else:
                self._take_between_rows()
            due = self._due()
            if due:
                self._last_row()
                through = self._through()
                self.output()
                self._check_account()
                if through:
                    break
            # What is resumed from has the row and the output of its step; a row that an interruption asks for is not in it.
            asked, late = run.body.share.total((int(run.interruption.asked), int(run.checkpoints.late)))
            if due or asked or late:
                self._checkpoint()
            if asked:
                self._last_row()
                raise Interrupted
        if self._keeps_account and run.dynamics[-1]["remark"] and run.ranks.rank == 0:
            warnings.warn(run.dynamics[-1]["remark"], stacklevel=4)

    def _time_due(self, outputs: int) -> float:
        """When the output after so many is, in a stage that says its duration."""
        return self.motion.duration * ((outputs + 1) / self.most_outputs)

    def _due(self) -> bool:
        """Return whether the next output is due."""
        if self._timed:
            return self.account.time >= self._time_due(self.account.outputs)
        motion = self.motion
        due = motion.begin + (motion.end - motion.begin) * (self.account.outputs + 1) / self.most_outputs
        return motion.at(self.account.time) >= due - 1e-12 * (motion.end - motion.begin)

    def save_last_state(self) -> None:
        """Go back to before the step that failed, and record the state there unless it has been."""
        run, integrator = self.run, self.integrator
        run.positions -= integrator.last_step * integrator.velocities
        self.account.time -= integrator.last_step
        run.parameter = self.motion.at(self.account.time)
        recorded = run.states.moments[-1].time - run.elapsed if len(run.states) else -np.inf
        if self.account.time > recorded + 0.5 * integrator.last_step:
            with suppress(InvalidState, Diverging):
                self._apply()
                self._check_inside()
                integrator.evaluate_at_rest()
                self._last_row()
                self._through()
                self.output()

    def _check_account(self) -> None:
        """Raise Diverging where the account of energy is off by so much that the motion is not that of the body."""
        account = self.account
        if abs(account.gap) > GAP_FAILED * account.most_put_in + self._rounding:
            raise Diverging(f"time {account.time:.4g}: {self._words_for_gap(account.gap)}")

    def _words_for_gap(self, gap: float) -> str:
        put_in = max(self.account.most_put_in, self._rounding)
        told = self.run.scene.units.amount(put_in, "energy", ".3g")
        share, what = 100 * abs(gap) / put_in, "gained from nothing" if gap > 0 else "lost"
        return f"the account of energy is off by {share:.2g} %: {told} were put in, and {abs(gap):.3g} were {what}"

    def _check_inside(self) -> None:
        """Raise InvalidState if a point has passed through a plane of reflection."""
        self.run.loading.check_inside(self.run.parameter, self.run.force, self.run.positions)

    def step(self) -> None:
        run, account, integrator = self.run, self.account, self.integrator
        left = self._time_due(account.outputs) - account.time
        integrator.move()
        ended = self._timed and integrator.last_step == left
        account.time = self._time_due(account.outputs) if ended else account.time + integrator.last_step
        run.steps += 1
        run.parameter = run.target = self._parameter()
        self._apply()
        if self.damage is None:
            integrator.evaluate()
        else:
            self._evaluate_and_break()
        self._limit_step()
        if self._every_step and self.damage is not None:
            arriving, leaving = integrator.kept_energy(integrator.velocities_around())
            account.released_energy += arriving - leaving

    def _limit_step(self) -> None:
        """Say how long the next step may be.

        Where the account is taken in every step what is held has moved up to the end, and not for a part of a step.  No step passes two
        outputs.
        """
        account, integrator = self.account, self.integrator
        if self._timed:
            # Equal parts of what is left, so that no step before an output is much shorter than the others.
            left = self._time_due(account.outputs + self._due()) - account.time
            integrator.longest = integrator.part_of(left) if left > 0 else integrator.last_step
        else:
            left, apart = self.motion.duration - account.time, self.motion.duration / self.most_outputs
            integrator.longest = min(left, apart) if self._every_step and left > 0 else apart

    def _evaluate_and_break(self) -> None:
        """Break what is stretched too far, and what has lost its support, until the forces are those of what is left."""
        run, integrator = self.run, self.integrator
        run.force.place(run.positions)
        pairs = self.damage.overstretched(run.force.positions)
        if run.body.share.any(len(pairs) > 0):
            self._break(pairs)
        while True:
            try:
                integrator.evaluate()
                error = None
            except InvalidState as invalid:
                error = invalid
            failed = self._bonds_of_failed_points()
            if run.body.share.any(len(failed) > 0):
                # The evaluation was ahead by the viscosity.  What broke at these positions may have left a state that soon collapses, with
                # huge forces: they cancel in the sum of both releases where both are taken at the same positions.
                run.force.place(run.positions)
                self._break(failed)
            elif error is not None:
                raise error
            else:
                return

    def _parameter(self) -> float:
        """The loading parameter now; at the end the stage's own, without the rounding of rate by time."""
        ended = self._timed and self.account.time >= self.motion.duration
        return self.motion.end if ended else self.motion.at(self.account.time)

    def _apply(self) -> None:
        """Bring all that is held to where it is now, and the loads to their size."""
        self.run.loading.apply(self.run.parameter, self.run.force, self.run.positions)

    def _hold(self, positions: np.ndarray, ahead: float) -> None:
        """Bring all that is held to where it is a time `ahead` from now."""
        self.run.loading.hold(self.run.parameter + ahead * self.motion.rate, self.run.force, positions)

    def _bonds_of_failed_points(self) -> np.ndarray:
        """Intact pairs of points that have lost bonds and whose deformation gradient has collapsed.

        The few bonds that are left at a crack front or on a fragment need not make a deformation gradient that means
        anything: a point that they turn inside out, or press to a tenth of its area or volume, has lost its support, and they are broken.
        A point with all its bonds is not touched; there det F <= 0 is an error.
        """
        run = self.run
        bonds, n, mirror = run.body.bonds, len(run.body), run.body.ghosts.source
        F = run.force.deformation_gradients()
        ratio = F[:, 0, 0] * F[:, 1, 1] - F[:, 1, 0] * F[:, 0, 1] if F.shape[1] == 2 else np.linalg.det(F)
        collapsed, crushed, share = np.flatnonzero(~(ratio > LEAST_RATIO)), run.force.collapsed_pairs(), run.body.share
        if not share.any(len(collapsed) or len(crushed)):
            return collapsed
        broken = np.flatnonzero(self.damage.broken)
        failed = np.zeros(len(run.body.all_points), dtype=bool)
        failed[np.intersect1d(collapsed, np.concatenate([bonds.first[broken], bonds.second[broken]]))] = True
        share.fill(failed[:n])
        failed[n:] = failed[mirror]
        failing = failed[bonds.first] | failed[bonds.second]
        if share.any(len(crushed)):
            # A bond whose own gradient has collapsed is broken where an end of it has lost others.
            lost = np.zeros(len(run.body.all_points), dtype=bool)
            lost[bonds.first[broken]] = lost[bonds.second[broken]] = True
            share.fill(lost[:n])
            failing[crushed[lost[bonds.first[crushed]] | lost[bonds.second[crushed]]]] = True
        pairs = np.flatnonzero(failing & ~self.damage.broken)
        if share.any(len(pairs)):
            run.crack["failed_points"] += run.body.share.total(len(run.body.share.own_points(np.flatnonzero(failed[:n]))))
        return pairs

    def _break(self, pairs: np.ndarray) -> None:
        run, crack = self.run, self.run.crack
        crack["broken_bonds"] += run.body.share.total(len(self._counted(pairs)))
        self.damage.break_bonds(pairs)
        release = run.force.break_bonds(pairs)
        if release is not None:
            self.account.released_energy += run.body.share.total(release.energy)
            self.integrator.kick(release.forces)
        if crack["start"] is None:
            places = starts_of_cracks(*self.damage.in_order(pairs), run.body.horizon)
            start = {"event": "first bond broken", "time": run.elapsed + self.account.time, run.loading.parameter: run.parameter}
            if "nominal_stress" in run.history[-1]:
                start["nominal_stress"] = run.history[-1]["nominal_stress"]
            crack["start"] = start | {"x": places[0], "tips": places}
            logger.info("%s: the first bond broken is at %s", run.loading.at(run.parameter), places)
        self.account.last_break = self.integrator.steps

    def _last_row(self) -> None:
        """A row at the present state, unless there is one."""
        if self.account.time > self.account.row_time:
            self._row()

    def _row(self, first: bool = False) -> None:
        """A row of the history, and work and damped energy up to it."""
        run, account = self.run, self.account
        reactions = self._reactions()
        kinetic = self._kinetic_energy()
        if not np.isfinite(kinetic):
            raise Diverging("the kinetic energy is not finite")
        self._take_work(reactions)
        forces = forces_by_name(run, reactions)
        self._take_damping(evaluate=True)
        strain = run.strain_energy()
        account.row_time = account.time
        row, stress = place_columns(run, run.elapsed + account.time), run.problem.measures.nominal_stress
        if stress is not None:
            row["nominal_stress"] = stress.of(reactions.forces)
        else:
            row |= component_columns("moment", moments_by_name(run, reactions))
        row |= {
            "work": account.work,
            "kinetic_energy": kinetic,
            "damped_energy": account.damped_energy,
            "strain_energy": strain,
        }
        row |= component_columns("force", forces) | state_columns(run)
        if self._keeps_account:
            row["released_energy"] = account.released_energy
        if first:
            account.initial_energy = kinetic + strain
        put_in = account.initial_energy + account.work
        account.most_put_in = max(account.most_put_in, put_in)
        # Half as much again for what the trapezoidal rule and the points' own strain energy leave out.
        allowed = put_in + (MOST_ENERGY - 1) * account.most_put_in + self._rounding
        if not first and kinetic + account.damped_energy > allowed:
            raise Diverging(
                f"time {account.time:.4g}: the motion runs away: it and the damping have taken {kinetic + account.damped_energy:.3g} "
                f"of the {put_in:.3g} that was put in"
            )
        if self.damage is not None:
            row |= {"broken_bonds": run.crack["broken_bonds"], "free_points": run.unsupported_points()}
        run.history.append(row)
        self._tell_account(kinetic + strain - put_in)
        run.report("account", self.integrator.steps, kinetic, strain)

    def _tell_account(self, held: float) -> None:
        """Write the account into the summary's entry of the stage; `held` is the energy of motion and strain less the energy put in."""
        account, told = self.account, self.run.dynamics[-1]
        told["energy_put_in"] = float(account.most_put_in)
        if not self._keeps_account:
            told |= {"energy_gap": None, "greatest_energy_gap": None}
            told["remark"] = f"{self.run.model.name} has no energy: whether the motion keeps it is not known"
            return
        account.gap = held + account.damped_energy + account.released_energy
        account.greatest_gap = max(account.greatest_gap, account.gap, key=abs)
        scale = max(account.most_put_in, self._rounding)
        told |= {"energy_gap": float(100 * account.gap / scale), "greatest_energy_gap": float(100 * account.greatest_gap / scale)}
        wide = abs(account.greatest_gap) > GAP_WARNED * scale
        told["remark"] = f"{self._words_for_gap(account.greatest_gap)}; {MEND_GAP}" if wide else None

    def _kinetic_energy(self) -> float:
        """At the positions, where all other energies are; in the plane with grips that of the half step before."""
        integrator = self.integrator
        return integrator.kept_energy(integrator.velocities_around())[1] if self._every_step else integrator.kinetic_energy()

    def _reactions(self) -> Reactions:
        """Return the reactions of all supports, by the forces that move the body."""
        return self.run.loading.reactions(self.run.force, self.integrator.forces)

    def _take_between_rows(self) -> None:
        """Add what the account takes in steps that have no row."""
        if self._every_step:
            self._take_work(self._reactions())
            breaking = self._keeps_account and self.integrator.steps - self.account.last_break < STEPS_PER_ROW
            self._take_damping(evaluate=breaking or self._uneven())

    def _uneven(self) -> bool:
        """Return whether supports change velocity faster than the viscosity allows the elastic forces to be followed."""
        if self.viscosity == 0:
            return False
        time, step = self.account.time, self.integrator.last_step
        ahead = self.run.parameter + self.viscosity * self.motion.rate
        return self.run.loading.unevenness(self.motion.at(time - step), self.run.parameter, ahead) > LEAST_UNEVENNESS

    def _take_work(self, reactions: Reactions) -> None:
        """Add the work of what holds and loads since the last time it was taken; the force is still that which moves the body."""
        run, account = self.run, self.account
        power = self._held_power = self._power_of_holders(reactions)
        self._held_reactions = reactions
        if run.loads is not None:
            thickness, around = run.loaded.thickness(), self.integrator.velocities_around()
            loads = (run.body.share.total(run.loads.power(run.positions, velocities, thickness)) for velocities in around)
            power = power.plus(Power(*loads))
        # At the start, when the account is empty, no time has gone by.
        account.work += self._work_over(account.time - account.rate_time, Power(*account.power), power)
        account.power, account.rate_time = [*power], account.time

    def _power_of_holders(self, reactions: Reactions) -> Power:
        """Return the power of all supports, moving as over the last step, and as over a step of that length to come."""
        loading, time, step = self.run.loading, self.account.time, self.integrator.last_step
        before = loading.course.power(reactions, self.motion, time, step)
        after = loading.course.power(reactions, self.motion, time + step, step) if self._every_step else before
        return Power(before, 0.5 * (before + after), after)

    def _work_over(self, elapsed: float, last: Power, power: Power) -> float:
        """Return the work by the trapezoidal rule, over the time since the power was last computed."""
        if self._every_step and elapsed < 1.5 * self.integrator.last_step:
            return 0.5 * elapsed * (last.after + power.before)
        return 0.5 * elapsed * (last.now + power.now)

    def _take_damping(self, evaluate: bool) -> None:
        """Add the energy that the damping took since the last time it was taken.

        What viscosity takes follows from the forces at the positions, which are evaluated there, and the force is left so, or followed.
        """
        account, integrator = self.account, self.integrator
        if evaluate and self.viscosity > 0:
            integrator.find_elastic()
        power, elapsed, last = integrator.damped_power(), account.time - account.damped_time, Power(*account.damped_power)
        if self._every_step and self.viscosity > 0:
            # Viscosity takes its part of the work of what holds the body as well.
            elastic = self._power_of_holders(self._elastic_reactions(evaluate))
            power = power.plus(self._held_power).plus(elastic, -1.0)
        if self._keeps_account and account.last_break == integrator.steps:
            # Bonds that broke in this step have changed the power since the last one; before it stood as it was.
            quiet = max(0.0, elapsed - integrator.last_step)
            account.damped_energy += quiet * last.now
            elapsed -= quiet
        account.damped_energy += self._work_over(elapsed, last, power)
        account.damped_power, account.damped_time = [*power], account.time

    def _elastic_reactions(self, evaluated: bool) -> Reactions:
        """Return the forces of all holders without viscosity: of the force `evaluated` at the positions, or followed as `elastic` is."""
        account, loading, on_points = self.account, self.run.loading, self.integrator.elastic_with_loads()
        if evaluated:
            found = loading.reactions(self.run.force, on_points)
        else:
            held, share = self._held_reactions, self.integrator.followed
            planes = (account.on_planes, held.on_planes), (account.levers, held.levers)
            on_planes, levers = (None if now is None else (1 - share) * np.reshape(old, now.shape) + share * now for old, now in planes)
            found = loading.reactions_of(on_planes, levers, on_points)
        account.on_planes, account.levers = found.on_planes.tolist(), None if found.levers is None else found.levers.tolist()
        return found

    def _through(self) -> bool:
        """Return whether the body has come apart between its supports."""
        if self.damage is None:
            return False
        ends = self.run.loading.ends()
        self.run.crack["through"] = len(ends) > 1 and not all(self._connected(ends[0], others) for others in ends[1:])
        return self.run.crack["through"]

    def output(self) -> None:
        run, account = self.run, self.account
        self._apply()
        if self.damage is not None:
            entry = {"time": run.elapsed + account.time, run.loading.parameter: run.parameter, "broken_bonds": run.crack["broken_bonds"]}
            places, events = self.damage.take_recent()
            tips = crack_tips(places, run.body.horizon)
            if tips and not any(output["tips"] for output in run.crack["tips"]):
                # Now with cracks that began a little later.
                run.crack["start"]["tips"] = starts_of_cracks(places, events, run.body.horizon)
            # The tip of the largest crack stays where it was while nothing breaks.
            last = run.crack["tips"][-1]["tip"] if run.crack["tips"] else None
            run.crack["tips"].append({**entry, "tip": tips[0] if tips else last, "tips": tips})
        if run.problem.measures.nominal_stress is None:
            run.loaded(run.positions, np.empty_like(run.positions))
            row = output_row(run, run.elapsed + account.time)
            run.levels.append(row | {"kinetic_energy": self._kinetic_energy()})
        run.record(account.time)
        account.outputs += 1

    def _connected(self, some: np.ndarray, others: np.ndarray) -> bool:
        """Return whether intact bonds connect any of `some` points with any of the `others`."""
        _, piece = self.run.loading.pieces(~self.damage.broken)
        union = self.run.body.share.union
        return bool(np.isin(union(piece[some]), union(piece[others])).any())

    def _counted(self, pairs: np.ndarray) -> np.ndarray:
        """Return those of the given pairs that this rank counts."""
        counted = self.run.body.share.counted_pairs(self.run.body.bonds.first[pairs])
        return pairs if counted is None else pairs[counted]

    def _checkpoint(self) -> None:
        integrator = self.integrator
        kept = {
            "account": asdict(self.account),
            "time_step": integrator.time_step,
            "last_step": integrator.last_step,
            "steps": integrator.steps,
        }
        self.run.checkpoints.write({"phase": "dynamics", "transient": kept}, self.arrays())


def crack_tips(places: np.ndarray, horizon: float) -> list[list[float]]:
    """Return the places where cracks have grown: the mean place of each group of recently broken pairs within a horizon, largest first.

    Parameters
    ----------
    places : ndarray, shape (k, d)
        Middles of the pairs, in the order in which they broke.
    horizon : float
    """
    if not len(places):
        return []
    # The front of a group is where its latest bonds broke: the last tenth of it, in the order of breaking.
    tips = []
    for members in _groups(places, horizon):
        tips.append(places[members[-max(1, len(members) // 10) :]].mean(axis=0).tolist())
    return tips


def starts_of_cracks(places: np.ndarray, batches: np.ndarray, horizon: float) -> list[list[float]]:
    """Return the places where cracks began: one for each group of broken pairs that are joined by distances of up to a horizon.

    Parameters
    ----------
    places : ndarray, shape (k, d)
        Middles of the pairs.
    batches : ndarray of int, shape (k,)
        Of pairs that broke together, rising.
    horizon : float

    Returns
    -------
    list of list of float
        For each group the middle of a pair: of those that broke first the nearest to their mean.  Groups stand in the order in which they
        began, the largest first of those that began together.
    """
    found = []
    for members in _groups(places, horizon):
        first = members[batches[members] == batches[members].min()]
        off = places[first] - places[first].mean(axis=0)
        found.append((batches[first[0]], places[first[np.einsum("kc,kc->k", off, off).argmin()]].tolist()))
    return [place for _, place in sorted(found, key=lambda start: start[0])]


def _groups(places: np.ndarray, horizon: float) -> list[np.ndarray]:
    """Numbers of places (k, d) that are joined by distances of up to a horizon, the largest group first."""
    near = cKDTree(places).query_pairs(horizon, output_type="ndarray")
    count, group = SERIAL.pieces(len(places), *near.T)
    order = np.argsort(-np.bincount(group), kind="stable")[:count]
    return [np.flatnonzero(group == number) for number in order]
