"""Explicit time steps: steps that are too long must be detected, and very many must not heat up a body."""

from __future__ import annotations

import numpy as np

from ..forces import InvalidState
from ..kernels.steps import central_difference_step
from ..materials import homogeneous
from ..solvers import FrequencyEstimate
from .bodies import SPACING
from .case import INAPPLICABLE, PASS, WEAK, Case, Outcome, Subject

STEPS = 100_000


class Motion:
    """Motion of a body of unit density by central differences, with damping proportional to mass."""

    def __init__(self, force, positions: np.ndarray, free: np.ndarray, share_of_critical: float, damping: float = 0.0) -> None:
        self.force, self.positions, self.free = force, positions, free
        self.mass, self.damping = force.body.volumes, damping
        highest = FrequencyEstimate(self.mass, free)(force, positions)
        self.step = share_of_critical * 2 / np.sqrt(highest)
        self.load, self._forces = np.zeros_like(positions), np.empty_like(positions)
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
            self.force(self.positions, self._forces)
            self._forces += self.load
            central_difference_step[self.positions.shape[1]](
                self.positions, self.velocities, self._forces, self.free, self.mass, self.damping, self.step, self.step
            )


def time_step(subject: Subject) -> Outcome:
    """Test a hundred steps of 0.5, 0.9, 1.1 and 2 times the critical one, for a free body at rest with small random velocities.

    Above 1 a wave grows by a factor of 2.4 or more per step, its energy by 5.8, and the run must stop with a clear error. Below 1 the step
    length causes no growth; the energy that a non-conservative force adds (see `undamped_steps`) is tolerated up to a tenth of the kinetic
    energy per step.
    """
    body = subject.body({2: 10, 3: 5}[subject.dimension])
    for share in (0.5, 0.9):
        motion = Motion(subject.bind(body), body.points.copy(), np.ones_like(body.points), share)
        first = motion.kinetic_energy
        motion.advance(100)
        growth = (motion.kinetic_energy / first) ** 0.01
        if not growth < 1.1:
            return Outcome(WEAK, f"at {share} the energy grew {growth:.2g} times a step", growth, 1.1, "not conservative")
    notes = []
    for share in (1.1, 2.0):
        motion = Motion(subject.bind(body), body.points.copy(), np.ones_like(body.points), share)
        steps = _steps_until_caught(motion)
        if steps is None:
            return Outcome(WEAK, f"at {share} nothing was noticed in 100 steps", 100.0, 100.0, "accuracy")
        notes.append(f"{steps} at {share}")
    return Outcome(PASS, f"bounded below 1; caught after {', '.join(notes)}")


def _steps_until_caught(motion: Motion) -> int | None:
    """Return the number of steps until the force raises an error; None if a hundred pass without one."""
    for step in range(1, 101):
        try:
            motion.advance(1)
        except InvalidState:
            return step
    return None


def _held(subject: Subject) -> Motion:
    """Return the motion of a body held at both ends at stretch 1.5, with half of the critical step and the damping of `DampedExplicit`."""
    body, lateral = subject.body({2: 8, 3: (6, 4, 4)}[subject.dimension]), homogeneous.uniaxial(subject.law, 1.5).lateral_stretch
    free = np.ones_like(body.points)
    free[np.abs(body.points[:, 0] - body.points[:, 0].mean()) > np.ptp(body.points[:, 0]) / 2 - 1e-9] = 0
    length = np.ptp(body.points[:, 0]) + SPACING
    damping = 2 * np.pi / length * np.sqrt(3 * subject.law.shear_modulus)
    return Motion(subject.bind(body), body.points @ subject.gradient(np.diag([1.5, lateral])).T, free, 0.5, damping)


def damped_steps(subject: Subject) -> Outcome:
    """Test 10^5 explicit steps on a body held at stretch 1.5, damped at the rate of `DampedExplicit`: it must come to rest.

    The figure is the kinetic energy at the end over that at the start. At the damping rate c the slowest mode loses exp(-c t) of it until
    rounding is reached, 1e-13 squared of the speed of waves over 1e-3 squared; the limit is 1e-16.
    """
    motion = _held(subject)
    first = motion.kinetic_energy
    try:
        motion.advance(STEPS // 50 if subject.quick else STEPS)
    except InvalidState as error:
        return Outcome(WEAK, str(error), None, None, "loses stability")
    return Outcome.below(motion.kinetic_energy / first, 1e-16, "loses stability")


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
            return Outcome(WEAK, f"within {(len(energies) + 1) * steps} steps: {error}", None, None, "not conservative")
        energies.append(motion.kinetic_energy)
    growth = np.mean(energies[-pieces // 10 :]) / np.mean(energies[: pieces // 10])
    return Outcome.below(growth, 1.2, "not conservative", "{:.3g}")


def sudden_load(subject: Subject) -> Outcome:
    """Test a bar held at one end and suddenly loaded at the other by the balance of its energy.

    The load is a tenth of mu: waves run along the bar, and its end oscillates between rest and twice the static displacement. Stored and
    kinetic energy minus the work of the load vanish but for the error of the steps, half of the critical one, which stays bounded. The
    figure is the change of the sum between the first and the last tenth of 20,000 steps, some fifty oscillations, over the greatest work of
    the load; the limit is a hundredth.
    """
    body = subject.body({2: (16, 5), 3: (12, 3, 3)}[subject.dimension])
    force = subject.bind(body)
    if not force.has_energy:
        return Outcome(INAPPLICABLE, "has no energy")
    along = np.rint(body.points[:, 0] / SPACING - 0.5)
    free = np.ones_like(body.points)
    free[along == 0] = 0
    motion, pieces = Motion(force, body.points.copy(), free, 0.5), 2000 // (10 if subject.quick else 1)
    motion.velocities[:] = 0
    loaded = along == along.max()
    motion.load[loaded, 0] = 0.1 * subject.law.shear_modulus * body.volumes[loaded] / SPACING
    sums, works = [], []
    for _ in range(pieces):
        try:
            before = motion.velocities.copy()
            motion.advance(1)
            # The energy belongs to the positions at which the step began, between two velocities.
            middle = (before + motion.velocities) / 2
            positions = motion.positions - motion.step * motion.velocities
            kinetic, work = float((motion.mass[:, None] * middle**2).sum() / 2), float((motion.load * (positions - body.points)).sum())
            sums.append(kinetic + force.energy() - work)
            works.append(work)
            motion.advance(9)
        except InvalidState as error:
            return Outcome(WEAK, str(error), None, None, "not conservative")
    tenth = pieces // 10
    moved = abs(np.mean(sums[-tenth:]) - np.mean(sums[:tenth])) / max(works)
    return Outcome.below(moved, 0.01, "not conservative")


CASES = (
    Case("time step 0.5, 0.9, 1.1, 2 of critical", "bounded below 1, caught within 100 steps above", time_step),
    Case("10^5 damped explicit steps at stretch 1.5", "kinetic energy falls to 1e-16", damped_steps),
    Case("10^5 undamped explicit steps at stretch 1.5", "kinetic energy grows by 1.2 at the most", undamped_steps),
    Case("a load from one moment to the next", "the account of energy moves by 1 % at the most in 20,000 steps", sudden_load),
)
