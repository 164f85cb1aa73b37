"""Energy account of a stage in dynamics: work of supports and loads, kinetic energy, and energy
lost in damping and breaking bonds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..solvers.conditions import Motions
from ..solvers.dynamics import Balance, ExplicitDynamics
from ..solvers.equilibrium import Diverging
from ..solvers.increments import Motion
from ..solvers.quasi_newton import EnergyMinimizer
from ..solvers.reactions import Reactions, support_reactions
from ..solvers.step_runs import Taken
from .rows import dissipated_columns
from .run import Run

STEPS_PER_ROW = 20
"""Steps between rows of the history; every output has a row as well. Chosen: waves take longer than
twenty steps to cross a few horizons.

Work and damped energy are summed in every step by the trapezoidal rule. The energy dissipated by
viscosity follows from the elastic forces at the present positions. These forces are evaluated in
each row and, if the force has an energy, in every step for this number of steps after a bond
breaks, because they then change fast, while held parts change their velocity, and where an
approximation is too inaccurate (`MOST_DRIFT`); in other steps they are approximated
(`ExplicitDynamics.elastic`).
"""

MOST_ENERGY = 1.5
"""Greatest ratio of kinetic plus damped energy to the supplied energy; a greater one indicates an
unstable step, or a force that has no energy. Half of the supplied energy covers the errors of the
trapezoidal rule and of the points' own strain energy.

The part above 1 is relative to the greatest energy supplied so far: a force map has no energy, so
that the account of a body that has been unloaded and has returned nearly all its energy has an
error in proportion to the energy that it held, not to the remaining energy.
"""

MOST_DRIFT = 2e-3
"""Part of the supplied energy by which approximated elastic forces may change the account of a
stage with fracture.

When the last ligament has snapped, the parts of the body retract for hundreds of steps in which no
bond breaks, and strains change so much within the retardation time that approximated forces would
leave a gap of up to 0.6 %. The elastic forces are therefore evaluated in every step where the
approximation would exceed this part until the next row. Chosen: less than half of the gap at which
a run warns; with a part half as large, a tear in plane strain took 3 % more evaluations.
"""

GAP_WARNED = 0.005
GAP_FAILED = 0.05
"""Gaps of the energy account relative to the supplied energy: beyond the first the run warns,
beyond the second it fails. Chosen: accounts of torn strips close within 0.1 % with the default
viscosity (`CRACK_VISCOSITY`), and are off by half without it.
"""

MEND_GAP = "use a smaller dynamics.safety or more dynamics.viscosity"
"""Advice for an energy account that does not close: forces are closer to linear within a shorter
step, and viscosity damps short waves.
"""

LEAST_UNEVENNESS = 0.01
"""Change of velocity of held parts within the retardation time, relative to that velocity, beyond
which elastic forces are evaluated.

If the elastic forces were approximated instead, the work of supports that viscosity dissipates
would have this relative error.
"""


@dataclass
class Account:
    """Running totals of the energy balance of a dynamic stage, saved in checkpoints; in two
    dimensions energies are per unit thickness.

    Attributes
    ----------
    time : float
        Time since the stage began.
    initial_energy : float
        Kinetic energy and strain energy at the start.
    dissipated_before : float
        Energy that branches and softening had dissipated at the start.
    work, damped_energy, released_energy : float
        Work of all supports and loads, energy dissipated by damping, and energy released by
        breaking bonds, since the start.
    power, damped_power : float
        Power of supports and loads, and of damping, as last computed, with the velocities of the
        step that followed.
    rate_time : float
        Time at which `power` and `damped_power` were computed.
    row_time : float
        Time of the last row of the history.
    most_put_in : float
        Greatest sum of initial energy and work at any row.
    gap, greatest_gap : float
        Energy at the last row, including dissipated and released energy, minus the supplied energy;
        and, of the values at all rows, the one of greatest magnitude.
    on_planes, levers : ndarray or None
        Part of the reactions that is due to the elastic forces alone (see
        `ExplicitDynamics.elastic`): the force of each reflection plane on the body, and the sum of
        the outer products f (x) y of the forces f that the plane exerts at the places y, which
        gives the power of a plane that turns. None until they are computed, and while no plane
        moves; `levers` stays None if no plane turns. After the account is read from a checkpoint
        they are lists.
    last_break : int
        Step in which a bond last broke.
    last_found, last_drift : int
        Steps in which elastic forces were last evaluated, and in which their approximation was last
        too inaccurate (`MOST_DRIFT`).
    drift : float
        Estimated energy by which approximated elastic forces have changed the account.
    outputs : int
        Number of outputs of the stage so far.
    strength_due : float
        Time at which bonds that break by strength are next searched for.
    """

    time: float = 0.0
    initial_energy: float = 0.0
    dissipated_before: float = 0.0
    work: float = 0.0
    damped_energy: float = 0.0
    released_energy: float = 0.0
    power: float = 0.0
    damped_power: float = 0.0
    rate_time: float = 0.0
    row_time: float = 0.0
    most_put_in: float = 0.0
    gap: float = 0.0
    greatest_gap: float = 0.0
    on_planes: np.ndarray | list | None = None
    levers: np.ndarray | list | None = None
    last_break: int = -STEPS_PER_ROW
    last_found: int = 0
    last_drift: int = -STEPS_PER_ROW
    drift: float = 0.0
    outputs: int = 0
    strength_due: float = 0.0

    def entries(self) -> dict:
        """Return the attributes as entries of a checkpoint."""
        lists = {
            key: None if one is None else np.asarray(one).tolist()
            for key, one in (("on_planes", self.on_planes), ("levers", self.levers))
        }
        return vars(self) | lists


class Supports(NamedTuple):
    """How supports move around the ends of k steps."""

    parameters: np.ndarray
    """Loading parameter at the end of the step before, at the k ends, and of the step after."""

    last: Motions
    now: Motions
    following: Motions
    ahead: Motions
    """Motions at the ends of the steps before, at those of the steps, at those of the next, and a
    retardation time after the ends.
    """

    planes_move: np.ndarray
    """Whether a reflection plane moves in a step, the next, or the retardation time, (k,);
    otherwise its reaction does no work in them.
    """

    uneven: np.ndarray
    """Whether supports change velocity between the retardation time before and that after by more
    than `LEAST_UNEVENNESS`, relatively, (k,); approximated forces forget within it.
    """

    def first(self, k: int) -> "Supports":
        """Return those around the first k ends."""
        return Supports(
            self.parameters[: k + 2],
            *(motions.at(slice(k)) for motions in self[1:5]),
            self.planes_move[:k],
            self.uneven[:k],
        )


@dataclass(eq=False)
class Bookkeeping:
    """Energy account of a stage in dynamics while it runs: sums work and losses, and checks that
    the account closes.

    Parameters
    ----------
    run : Run
    integrator : ExplicitDynamics
    motion : Motion
        Loading parameter as a function of time.
    viscosity : float
        Retardation time of the stage.
    account : Account
    """

    run: Run
    integrator: ExplicitDynamics
    motion: Motion
    viscosity: float
    account: Account = field(default_factory=Account)

    @property
    def closes(self) -> bool:
        """Whether the force has an energy, so that the account closes."""
        return self.run.force.has_energy

    @cached_property
    def _rounding(self) -> float:
        """Energy that is a rounding error: a body at rest has none, and any motion would exceed
        the supplied energy.
        """
        modulus = max(law.shear_modulus for law, _ in self.run.force.laws)
        rounding = EnergyMinimizer.ROUNDING[self.run.force.precision]
        return rounding * modulus * self.run.body.share.sum(self.run.body.volumes)

    def kinetic_energy(self) -> float:
        """Return the kinetic energy at the time of the positions; raise Diverging if it is not
        finite.
        """
        kinetic = self.integrator.balance().leaving
        if not np.isfinite(kinetic):
            raise Diverging("the kinetic energy is not finite")
        return kinetic

    def between_rows(self) -> None:
        """Add work and damped energy to the account after a time step without a row in the
        history.
        """
        last = max(self.account.last_break, self.account.last_drift)
        changing = self.closes and self.integrator.steps - last < STEPS_PER_ROW
        supports = self.supports([self.account.time], self.integrator.next_step())
        moving = bool(supports.planes_move[0])
        reactions = support_reactions(
            self.run.loading, self.run.loaded, self.integrator.forces, moving
        )
        unknown = moving and self.account.on_planes is None
        self.advance(reactions, changing or unknown or supports.uneven[0], supports)

    def supports(self, times: list[float], following: float) -> Supports:
        """Return how supports move around the ends of steps at `times`, the first of which ends the
        step after the account's last one; the last is followed by a step of a length.
        """
        at = self.motion.at
        loading = self.run.loading
        n = len(times)
        before = [self.account.rate_time, *times[:-1]]
        ends = np.array(list(map(at, [before[0], *times, times[-1] + following])))
        now = ends[1:-1]
        ahead = now + self.viscosity * self.motion.rate
        earlier = [
            at(max(0.0, min(last, time - self.viscosity)))
            for last, time in zip(before, times, strict=True)
        ]
        every = loading.motions(np.concatenate([ends, ahead, earlier]))
        last, present, then = (every.at(slice(k, k + n)) for k in range(3))
        viscous, past = (every.at(slice(n + 2 + k, 2 * n + 2 + k)) for k in (0, n))
        planes = present.of_planes
        moves = [one.of_planes != planes for one in (last, then, viscous)]
        uneven = np.zeros(n, dtype=bool)
        if self.viscosity > 0:
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = (ahead - now) / (now - earlier)
                off, *ways = loading.changes_of_rate(past, present, viscous, ratio[:, None])
                uneven = (now != earlier) & (off / np.maximum(*ways) > LEAST_UNEVENNESS)
        planes_move = np.any(moves, axis=(0, 2, 3, 4))
        return Supports(ends, last, present, then, viscous, planes_move, uneven)

    def _powers_of_loads(self, parameters: np.ndarray, spans: tuple[float, float]) -> list[float]:
        """Return the power of the loads with the velocities in the last step and in the next, of
        lengths `spans`, at whose ends the loading parameter has the given values.
        """
        run = self.run
        thickness = run.loaded.thickness()
        places = list(map(run.loading.planes_at, parameters.tolist()))
        of_planes = np.diff(places, axis=0) / np.reshape(spans, (2, 1))
        return [
            run.body.share.total(run.loads.power(run.positions, *velocities, thickness))
            for velocities in zip(self.integrator.velocities_around(), of_planes, strict=True)
        ]

    def advance(
        self, reactions: Reactions, evaluate: bool, supports: Supports | None = None
    ) -> None:
        """Add to the account the work of supports and loads, and the energy dissipated by damping
        and lost with broken bonds, since the last call, one time step ago.

        `reactions` are those of the supports to the forces that move the points, which include
        viscosity; without those of planes the planes do not move. The energy dissipated by
        viscosity follows from the difference between these forces and the elastic forces: with
        `evaluate` the elastic forces are evaluated at the present positions, otherwise
        `ExplicitDynamics.elastic` approximates them.
        """
        account = self.account
        integrator = self.integrator
        # At the start the account is empty, and no time has passed: the step has no other length.
        elapsed = account.time - account.rate_time
        spans = elapsed or 1.0, integrator.next_step()
        supports = supports or self.supports([account.time], spans[1])
        of_loads = [0.0, 0.0]
        if self.run.loads:
            of_loads = self._powers_of_loads(supports.parameters, spans)
        elastic = reactions
        if self.viscosity > 0:
            if evaluate:
                self._judge(integrator.find_elastic())
            elastic = self._elastic_reactions(reactions, evaluate)
        works = self._works(reactions, elastic, supports)
        self._add(account.time, spans[1], *works[0], integrator.balance(), of_loads)

    def _works(
        self, reactions: Reactions, elastic: Reactions, supports: Supports
    ) -> list[list[float]]:
        """Return, for each end of a step, the works of the `elastic` reactions in this step and in
        the next, and the power of the viscous part of the reactions, all of which viscosity
        dissipates.

        Viscous forces are those of supports that move from their present places to those a
        retardation time ahead (`ExplicitDynamics`), also where they begin or cease to move within
        that time: their power is that with this velocity.
        """
        works = self.run.loading.course.works
        now = supports.now
        found = np.zeros((3, len(supports.uneven)))
        found[0] = works(elastic, supports.last, now)
        found[1] = works(elastic, now, supports.following)
        if self.viscosity > 0:
            all_forces, of_elastic = (
                works(one, now, supports.ahead) for one in (reactions, elastic)
            )
            found[2] = (all_forces - of_elastic) / self.viscosity
        return found.T.tolist()

    def add_steps(
        self, times: list[float], spans: np.ndarray, taken: Taken, supports: Supports
    ) -> None:
        """Add steps to the account that end at `times` (k,), with their `spans` (k, 4) as of
        `StepRuns`; elastic forces are approximated.
        """
        account = self.account
        loading = self.run.loading
        reactions = Reactions(loading, -taken.on_points, taken.on_planes)
        elastic = reactions
        if self.viscosity > 0:
            on_planes = taken.on_planes
            if on_planes is not None:
                on_planes = np.empty_like(on_planes)
                for share, now, found in zip(spans[:, 3], taken.on_planes, on_planes, strict=True):
                    account.on_planes = found[:] = _followed(share, account.on_planes, now)
            else:
                account.on_planes = account.levers = None
            elastic = Reactions(loading, -taken.elastic, on_planes)
        works = self._works(reactions, elastic, supports)
        for time, following, work, balance in zip(
            times, spans[:, 2].tolist(), works, taken.balances, strict=True
        ):
            self._add(time, following, *work, balance)

    def _add(
        self,
        time: float,
        following: float,
        ended: float,
        begun: float,
        by_viscosity: float,
        balance: Balance,
        of_loads: Sequence[float] = (0.0, 0.0),
    ) -> None:
        """Add to the account the step that ends at a time, before a `following` one of a length;
        works and powers as of `_works` and `_powers_of_loads`.
        """
        account = self.account
        elapsed = time - account.rate_time
        powers = account.power + by_viscosity + of_loads[0]
        account.work += 0.5 * (ended + elapsed * powers)
        account.damped_energy += (
            0.5 * elapsed * (account.damped_power + by_viscosity + balance.taken_before)
        )
        if elapsed > 0 and self.run.damage is not None:
            account.released_energy += balance.arriving - balance.leaving
        account.power = begun / following + by_viscosity + of_loads[1]
        account.damped_power = by_viscosity + balance.taken_after
        account.rate_time = time

    def _judge(self, power: float) -> None:
        """Find from the power of an error of the approximated elastic forces whether to evaluate
        these forces in the next steps.

        The error decays by a factor in every step, and a like one is added: in a long series of
        steps it is the sum of a geometric series.
        """
        account = self.account
        integrator = self.integrator
        steps = integrator.steps - account.last_found
        account.last_found = integrator.steps
        if (
            self.run.damage is None or not steps or account.last_break == integrator.steps
        ):  # the error contains forces of broken bonds
            return
        in_step = (
            integrator.last_step
            * abs(power)
            / (1 - (1 - integrator.followed_in(integrator.last_step)) ** steps)
        )
        account.drift += (steps - 1) * in_step
        if (
            account.drift + STEPS_PER_ROW * in_step
            > MOST_DRIFT * (account.initial_energy + account.work) + self._rounding
        ):
            account.last_drift = integrator.steps

    def _elastic_reactions(self, held: Reactions, evaluated: bool) -> Reactions:
        """Return the reactions of the supports to the elastic forces alone.

        They are exact if the elastic forces were just `evaluated`, else approximated from `held`,
        the reactions to all forces, viscous ones included.
        """
        account = self.account
        run = self.run
        moving = held.on_planes is not None
        on_points = self.integrator.elastic_with_loads()
        found = support_reactions(run.loading, run.loaded, on_points, moving and evaluated)
        if moving and not evaluated:
            share = self.integrator.followed_in(self.integrator.last_step)
            followed = (
                None if now is None else _followed(share, old, now)
                for old, now in (
                    (account.on_planes, held.on_planes),
                    (account.levers, held.levers),
                )
            )
            found = Reactions(run.loading, found.at_held, *followed)
        account.on_planes = found.on_planes
        account.levers = found.levers
        return found

    def columns(self, kinetic: float, strain: float, first: bool) -> dict[str, float]:
        """Return the energies of a row of the history; raise Diverging if kinetic plus damped
        energy is too great.

        The bound is about `MOST_ENERGY` times the energy supplied by the initial state, supports
        and loads.

        `kinetic` and `strain` are the kinetic and strain energy at the row; `first` marks the first
        row of the stage, at which they are the initial energies.
        """
        account = self.account
        account.row_time = account.time
        lost = dissipated_columns(self.run)
        dissipated = sum(lost.values())
        if first:
            account.initial_energy = kinetic + strain
            account.dissipated_before = dissipated
        put_in = account.initial_energy + account.work
        account.most_put_in = max(account.most_put_in, put_in)
        allowed = put_in + (MOST_ENERGY - 1) * account.most_put_in + self._rounding
        # Damping that supplies energy must not conceal the motion that it drives.
        found = kinetic + max(account.damped_energy, 0.0)
        if not first and found > allowed:
            taken = f"kinetic and damped energy are {found:.3g}, but only {put_in:.3g} was put in"
            raise Diverging(f"time {account.time:.4g}: the motion is unstable: {taken}")
        if self.closes:
            account.gap = (
                kinetic + strain - put_in + account.damped_energy + account.released_energy
            ) + (dissipated - account.dissipated_before)
            account.greatest_gap = max(account.greatest_gap, account.gap, key=abs)
        return {
            "work": account.work,
            "kinetic_energy": kinetic,
            "damped_energy": account.damped_energy,
            "strain_energy": strain,
            **lost,
        }

    def entries(self) -> dict:
        """Return the entries of the run's summary about the energy account, see `entries_of`."""
        account = self.account
        gaps = account.gap, account.greatest_gap
        return entries_of(self.run, account.most_put_in, *gaps, MEND_GAP, self._rounding)

    def check(self) -> None:
        """Raise Diverging if the gap of the energy account is so large that the motion is wrong."""
        account = self.account
        if abs(account.gap) > GAP_FAILED * account.most_put_in + self._rounding:
            put_in = max(account.most_put_in, self._rounding)
            words = _words_for_gap(self.run, account.gap, put_in)
            raise Diverging(f"time {account.time:.4g}: {words}")


def _followed(share: float, old: np.ndarray | list, now: np.ndarray) -> np.ndarray:
    """Return the part of reactions that is due to elastic forces, as `ExplicitDynamics.elastic`."""
    return (1 - share) * np.asarray(old) + share * now


def entries_of(
    run: Run, put_in: float, gap: float, greatest_gap: float, advice: str, least: float = 0.0
) -> dict:
    """Return the entries of a run's summary about an energy account.

    They are the energy supplied, the last and the greatest gap in percent of it, or of the `least`
    energy that is no rounding error, and a `remark`: a warning with `advice` if the gap exceeds
    `GAP_WARNED`, a note if the force has no energy, so that no gap can be computed, else None.
    """
    found = {"energy_put_in": float(put_in)}
    if not run.force.has_energy:
        remark = (
            f"{run.model.name} defines no energy, so energy conservation cannot be checked, and"
            " broken bonds release none"
        )
        return found | {"energy_gap": None, "greatest_energy_gap": None, "remark": remark}
    scale = max(put_in, least) or 1.0
    wide = abs(greatest_gap) > GAP_WARNED * scale
    return found | {
        "energy_gap": float(100 * gap / scale),
        "greatest_energy_gap": float(100 * greatest_gap / scale),
        "remark": f"{_words_for_gap(run, greatest_gap, scale)}; {advice}" if wide else None,
    }


def _words_for_gap(run: Run, gap: float, put_in: float) -> str:
    amount = run.problem.scene.units.amount(put_in, "energy", ".3g")
    share = 100 * abs(gap) / put_in
    what = "created" if gap > 0 else "lost"
    return (
        f"the energy balance has an error of {share:.2g} %: {amount} were put in, and"
        f" {abs(gap):.3g} were {what} numerically"
    )
