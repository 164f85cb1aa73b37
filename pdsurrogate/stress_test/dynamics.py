"""Explicit time steps: steps that are too long must be detected, and very many must not heat up a body."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ..forces import InternalForce, InvalidState
from ..kernels.steps import central_difference_step
from ..solvers.stability import FrequencyEstimate
from .bodies import SPACING
from .case import PASS, WEAK, Ended, Outcome, Subject, case, forces_at, required

STEPS = 100_000


class Motion:
    """Motion of a body of unit density by central differences, with damping proportional to mass; by default from rest, all points free."""

    def __init__(self, force: InternalForce, share_of_critical=0.5, positions=None, free=None, damping=0.0) -> None:
        self.force, self.mass, self.damping = force, force.body.volumes, damping
        self.positions = force.body.points.copy() if positions is None else positions
        self.free = np.ones_like(self.positions) if free is None else free
        self.step = share_of_critical * 2 / np.sqrt(FrequencyEstimate(self.mass, self.free)(force, self.positions))
        self.load = np.zeros_like(self.positions)
        self.shake()

    def shake(self) -> None:
        """Set random velocities of a thousandth of the speed of shear waves, which cause waves of small strain."""
        random = np.random.default_rng(0)
        self.velocities = 1e-3 * np.sqrt(self.force.law.shear_modulus) * random.standard_normal(self.positions.shape) * self.free

    @property
    def kinetic_energy(self) -> float:
        return float((self.mass[:, None] * self.velocities**2).sum() / 2)

    @property
    def momenta(self) -> np.ndarray:
        """Momenta of all points, shape (n, d)."""
        return self.mass[:, None] * self.velocities

    def advance(self, steps: int) -> None:
        for _ in range(steps):
            forces = forces_at(self.force, self.positions) + self.load
            central_difference_step[self.positions.shape[1]](
                self.positions, self.velocities, forces, self.free, self.mass, self.damping, self.step, self.step
            )


@case("time step 0.5, 0.9, 1.1, 2 of critical", "bounded below 1, caught within 100 steps above")
def time_step(subject: Subject) -> Outcome:
    """Test a hundred steps of 0.5, 0.9, 1.1 and 2 times the critical one, for a free body at rest with small random velocities.

    Above 1 a wave grows by a factor of 2.4 or more per step, its energy by 5.8, and the run must stop with a clear error. Below 1 the step
    length causes no growth; the energy that a non-conservative force adds (see `undamped_steps`) is tolerated up to a tenth of the kinetic
    energy per step.
    """
    body, notes = subject.body(10, 5), []
    for share in (0.5, 0.9):
        motion = Motion(subject.bind(body), share)
        first = motion.kinetic_energy
        motion.advance(100)
        growth = Outcome.below(
            (motion.kinetic_energy / first) ** 0.01, 1.1, "not conservative", f"at {share} the energy grew {{:.2g}} times a step"
        )
        if growth.weakness:
            return growth
    for share in (1.1, 2.0):
        motion, steps = Motion(subject.bind(body), share), 0
        with suppress(InvalidState):
            while steps < 100:
                steps += 1
                motion.advance(1)
            return Outcome(WEAK, f"at {share} nothing was noticed in 100 steps", 100.0, 100.0, "accuracy")
        notes.append(f"{steps} at {share}")
    return Outcome(PASS, f"bounded below 1; caught after {', '.join(notes)}")


def _held(subject: Subject) -> Motion:
    """Return the motion of a body held at both ends at stretch 1.5, with half of the critical step and the damping of `DampedExplicit`."""
    body = subject.body(8, (6, 4, 4))
    free = np.ones_like(body.points)
    free[np.abs(body.points[:, 0] - body.points[:, 0].mean()) > np.ptp(body.points[:, 0]) / 2 - 1e-9] = 0
    length = np.ptp(body.points[:, 0]) + SPACING
    damping = 2 * np.pi / length * np.sqrt(3 * subject.law.shear_modulus)
    return Motion(subject.bind(body), 0.5, body.points @ subject.uniaxial(1.5).T, free, damping)


@case("10^5 damped explicit steps at stretch 1.5", "kinetic energy falls to 1e-16", failing="loses stability")
def damped_steps(subject: Subject) -> Outcome:
    """Test 10^5 explicit steps on a body held at stretch 1.5, damped at the rate of `DampedExplicit`: it must come to rest.

    The figure is the kinetic energy at the end over that at the start. At the damping rate c the slowest mode loses exp(-c t) of it until
    rounding is reached, 1e-13 squared of the speed of waves over 1e-3 squared; the limit is 1e-16.
    """
    motion = _held(subject)
    first = motion.kinetic_energy
    motion.advance(STEPS // 50 if subject.quick else STEPS)
    return Outcome.below(motion.kinetic_energy / first, 1e-16, "loses stability")


@case("10^5 undamped explicit steps at stretch 1.5", "kinetic energy grows by 1.2 at the most")
def undamped_steps(subject: Subject) -> Outcome:
    """Test 10^5 steps without damping on the same body, after small random velocities, by the growth of its kinetic energy.

    The figure is the mean over the last tenth of the steps over that of the first tenth. Small waves share their energy evenly between
    motion and strain, so it is 1 within the scatter of some hundred modes; the limit is 1.2.
    """
    motion, pieces = _held(subject), 100
    steps = (STEPS // 50 if subject.quick else STEPS) // pieces
    energies = []
    motion.advance(2000)
    motion.damping = 0.0
    motion.shake()
    for _ in range(pieces):
        try:
            motion.advance(steps)
        except InvalidState as error:
            raise Ended(WEAK, f"within {(len(energies) + 1) * steps} steps: {error}", "not conservative") from error
        energies.append(motion.kinetic_energy)
    growth = np.mean(energies[-pieces // 10 :]) / np.mean(energies[: pieces // 10])
    return Outcome.below(growth, 1.2, "not conservative", "{:.3g}")


@case("a load from one moment to the next", "the account of energy moves by 1 % at the most in 20,000 steps", failing="not conservative")
def sudden_load(subject: Subject) -> Outcome:
    """Test a bar held at one end and suddenly loaded at the other by the balance of its energy.

    The load is a tenth of mu: waves run along the bar, and its end oscillates between rest and twice the static displacement. Stored and
    kinetic energy minus the work of the load vanish but for the error of the steps, half of the critical one, which stays bounded. The
    figure is the change of the sum between the first and the last tenth of 20,000 steps, some fifty oscillations, over the greatest work of
    the load; the limit is a hundredth.
    """
    body = subject.body((16, 5), (12, 3, 3))
    force = subject.bind(body)
    required(force.has_energy, "has no energy")
    along = np.rint(body.points[:, 0] / SPACING - 0.5)
    free = np.ones_like(body.points)
    free[along == 0] = 0
    motion, pieces = Motion(force, free=free), 2000 // (10 if subject.quick else 1)
    motion.velocities[:] = 0
    loaded = along == along.max()
    motion.load[loaded, 0] = 0.1 * subject.law.shear_modulus * body.volumes[loaded] / SPACING
    sums, works = [], []
    for _ in range(pieces):
        before = motion.velocities.copy()
        motion.advance(1)
        # The energy belongs to the positions at which the step began, between two velocities.
        middle = (before + motion.velocities) / 2
        positions = motion.positions - motion.step * motion.velocities
        works.append(float((motion.load * (positions - body.points)).sum()))
        sums.append(float((motion.mass[:, None] * middle**2).sum() / 2) + force.energy() - works[-1])
        motion.advance(9)
    tenth = pieces // 10
    moved = abs(np.mean(sums[-tenth:]) - np.mean(sums[:tenth])) / max(works)
    return Outcome.below(moved, 0.01, "not conservative")


CASES = (time_step, damped_steps, undamped_steps, sudden_load)
