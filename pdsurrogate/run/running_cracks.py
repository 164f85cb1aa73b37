"""Bonds that break during a stage in dynamics, and the energy that they release."""

import math

import numpy as np

from ..forces import InvalidState
from ..solvers.dynamics import ExplicitDynamics
from .account import STEPS_PER_ROW, Account
from .cracks import Cracks
from .run import Run

PAUSE = 0.25
"""Time between two searches for bonds that break by strength, over the time in which a shear wave
crosses the radius of a disc; while such bonds break every step searches. Chosen: the mean over a
disc then changes by a few percent at most, and the searches cost a tenth of the evaluations.
"""


class RunningCracks(Cracks):
    """Breaking of bonds during a stage in dynamics, for a run with damage.

    Parameters
    ----------
    run : Run
    integrator : ExplicitDynamics
    account : Account
        Energy account, to which the energy released by broken bonds is added.
    """

    def __init__(self, run: Run, integrator: ExplicitDynamics, account: Account) -> None:
        super().__init__(run)
        self._integrator = integrator
        self._account = account
        strengths = run.problem.strengths
        self._pause = math.inf
        if strengths is not None:
            softest = min(law.shear_modulus for law, _ in run.force.laws)
            inertia = run.stages[run.state.stage].inertia
            least = min(zone.radius for zone in strengths.zones)
            self._pause = PAUSE * least * math.sqrt(inertia.density / softest)
        # Of the present step: stored energy and forces before bonds broke, None while none has, and
        # the energy released since.
        self._before: tuple[float, np.ndarray] | None = None
        self._released = 0.0

    @property
    def time(self) -> float:
        """Time since the stage began."""
        return self._account.time

    def evaluate_and_break(self) -> None:
        """Break overstretched bonds and the bonds of failed points, and evaluate the forces,
        until no more bonds break.
        """
        run = self.run
        integrator = self._integrator
        share = self.run.body.share
        self._before = None
        self._released = 0.0
        run.force.place(run.positions)
        due = self._pause < math.inf and self.time >= self._account.strength_due
        failing = self.damage.failing(run.force, due)
        if due:
            torn = share.any(bool(failing.by_strength.any()))
            self._account.strength_due = self.time + (0.0 if torn else self._pause)
        if share.any(len(failing.pairs) > 0):
            self.break_bonds(failing.pairs, failing.cause)
        while True:
            try:
                integrator.evaluate(integrator.steps - self._account.last_break < STEPS_PER_ROW)
                error = None
            except InvalidState as invalid:
                error = invalid
            failed = self.bonds_of_failed_points()
            if share.any(len(failed) > 0):
                # The evaluation was ahead by the viscosity.
                run.loading.apply(run.state.parameter, run.force, run.positions)
                run.force.place(run.positions)
                self.break_bonds(failed)
            elif error is not None:
                raise error
            else:
                return

    def break_bonds(self, pairs: np.ndarray, cause: str = "energy") -> None:
        """Break pairs, given by number, in one event, and count what the body loses.

        The force must be placed at the present positions.
        """
        force = self.run.force
        if force.has_energy and self._before is None:
            self._before = self._stored()
        super().break_bonds(pairs, cause)
        if force.has_energy:
            self._count_release()
        self._account.last_break = self._integrator.steps

    def _count_release(self) -> None:
        """Count the energy that the body has lost in all events of this step, and add the impulse
        of these bonds to the velocities.

        An event may leave a state without energy, of points that fail next. The sum over all events
        of a step then has one nevertheless.
        """
        energy, forces = self._before
        left, leaving = self._stored()
        share = self.run.body.share
        released = energy - left
        lost = forces - leaving
        if share.any(not (np.isfinite(released) and np.isfinite(lost).all())):
            released = 0.0
            lost = np.zeros_like(lost)
        total = share.total(released)
        self._account.released_energy += total - self._released
        self._released = total
        self._integrator.kick(lost)

    def _stored(self) -> tuple[float, np.ndarray]:
        """Return stored energy, NaN where it is undefined, and internal forces of the body at
        the positions last set.
        """
        forces = np.zeros_like(self.run.positions)
        self.run.force.pass_bonds(forces)
        return self.run.force.energy(), forces
