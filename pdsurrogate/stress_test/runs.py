"""Hard cases that run small bodies in equilibrium and in motion.

Loads, moduli and lengths are very small or very large; forces and energy must balance, and some bodies have parts of very different
stiffness. Explicit steps that are too long must be detected, and many steps must not add energy to a body. Unlike the properties of forces
alone, these cases involve the solver, the precision, the loads and the integrator as well.
"""

from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np

from ..forces import InternalForce, InvalidState
from ..forces.settings import WHERE
from ..kernels.steps import central_difference_step
from ..materials import PLANES, Law
from ..run.levels import MOST_OFF
from ..scenes import Scene
from ..solvers.stability import FrequencyEstimate
from .bodies import SPACING
from .case import PASS, WEAK, Ended, Outcome, Subject, case, cases_of, forces_at, off, required
from .deformations import force_densities

STEPS = 100_000
"""Number of explicit time steps of a held body in `damped_steps` and `undamped_steps`. Chosen: a relative gain of energy of 2e-6 a step
adds up to the limit of 1.2 of `undamped_steps`, which fewer steps would not show. The default is a fiftieth of them."""


class Motion:
    """Explicit motion of a body of unit density by central differences, with a `damping` rate proportional to mass.

    The time step is `share_of_critical` times the critical step. A displacement component moves where `free`, shape (n, d), is 1. By
    default all points are free and begin at their undeformed positions; velocities begin small and random.
    """

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

    def advance(self, steps: int) -> None:
        for _ in range(steps):
            forces = forces_at(self.force, self.positions) + self.load
            scheme = self.free, self.mass, self.damping, self.step, self.step
            central_difference_step(self.positions, self.velocities, forces, *scheme)


SIDES = (1.2, 0.8), (1.0, 0.8, 0.8)
"""Sides of the body of `_loaded`, in the plane and in three dimensions; its points are 0.2 apart. Chosen: four to six points a side, few
enough for runs under five loads and in four systems of units."""

DIRECTION = (1.0, 0.1, 0.0)
"""Components of the traction on the free end, divided by the size of the load: it pulls, and bends a little."""

OFF_BALANCE = 2e-3
"""Greatest permitted sum of loads and reactions, divided by the load.

The solver bounds this sum by 5e-4 of what drives the body, here the magnitudes of the reactions of single points: at a clamped end these
pull across as well, and their magnitudes add up to four times the load at most.
"""

OFF_PROPORTION = 2e-3
"""Greatest permitted relative difference of two equilibria that should be equal, in displacements or reactions; each may leave unbalanced
forces of a thousandth of its load."""

LOADS = (1e-9, 1e-7, 1e-5, 1e-2, 1.0)
"""Tractions on the free end in shear moduli; under loads up to 1e-5, strains and departures from linear elasticity are at most some
1e-5."""

LINEAR = LOADS[2]
"""Greatest of the `LOADS` under which displacements must be proportional to the load."""

POWERS = (-9, 9)
"""Exponents of ten in the units of stress and length of `scale_of_units`. Chosen wider than any units in use."""


def _why_no_equilibrium(subject: Subject) -> str:
    return "zero-energy modes" if subject.reference == "nosb" else "does not converge"


def _loaded(subject: Subject, load: float, stress: float = 1.0, length: float = 1.0, amplitude: str | list = "ramp", **changes) -> Scene:
    """Return the scene of a body held at its left face, with a traction on its right face of `load` shear moduli times `DIRECTION`.

    All moduli and the traction are multiplied by `stress`, all lengths by `length`, as by a change of units. `amplitude` is the course of
    the load in time, and `changes` are other keys of the scene.
    """
    law, size = subject.law.scaled(stress), load * stress * subject.law.shear_modulus
    loads = [{"region": "right", "traction": [size * part for part in DIRECTION[: subject.dimension]], "amplitude": amplitude}]
    described = {"spacing": 0.2 * length, "material": law.describe(), "prescribed": [subject.held_at("left")], "steps": [1.0]}
    return subject.scene(tuple(length * side for side in subject.sized(*SIDES)), loads=loads, **described | changes)


@cache
def _level(subject: Subject, load: float, stress: float = 1.0, length: float = 1.0) -> dict:
    """Return the last entry of ``levels`` of a run of the `_loaded` scene, computed only once for each subject, load and units."""
    scene = _loaded(subject, load, stress, length)
    return subject.run(scene, where=f"{load:g} mu: ", weakness=_why_no_equilibrium(subject)).levels[-1]


def _moved(level: dict) -> np.ndarray:
    return np.array(level["displacements"]["right"])


@case("loads of 1e-9 to 1e-5 mu", "displacements proportional to the load, 0.2 %")
def small_loads(subject: Subject) -> Outcome:
    """Test that displacements are proportional to small loads, of 1e-9 to 1e-5 shear moduli.

    The compliance, displacement divided by load, is compared with the compliance under the greatest of these loads: the value is the
    greatest difference, divided by that compliance.
    """
    over = np.array([_moved(_level(subject, load)) / load for load in LOADS if load <= LINEAR])
    return Outcome.below(off(over, over[-1]), OFF_PROPORTION, _why_inaccurate_at_rest(subject))


def _why_inaccurate_at_rest(subject: Subject) -> str:
    """Return the weakness that explains errors under small loads: "force at rest" if the undeformed body has forces, else "accuracy"."""
    body = subject.body(6, 4)
    return "accuracy" if np.abs(force_densities(subject.bind(body), body.points)).max() < 1e-9 else "force at rest"


@case("loads of 1e-9 to 1 mu, a free body in motion", "forces balance to 0.1 % of the load, constant momentum", failing="not conservative")
def force_balance(subject: Subject) -> Outcome:
    """Test the balance of load and reaction under loads of 1e-9 to 1 shear moduli, and the momentum of a free body that moves.

    The value is the greater of the sum of load and reaction divided by the load, and twice the relative unbalanced force that the run
    itself reports (``force_balance``), whose own limit is half as large. Without damping the momentum of a free body may change in 100
    steps by rounding alone: 1e-12 of the sum of the magnitudes of the momenta of all points.
    """
    errors = {}
    for load in LOADS:
        level = _level(subject, load)
        right, left = (np.array(level["forces"][face]) for face in ("right", "left"))
        unbalanced = float(np.abs(right + left).sum() / np.abs(right).sum())
        errors[f"{load:g} mu"] = max(unbalanced, OFF_BALANCE / MOST_OFF * level["force_balance"])
    balance = Outcome.below(errors, OFF_BALANCE, _why_inaccurate_at_rest(subject))
    if balance.weakness:
        return balance
    motion = Motion(subject.bind(subject.body(6, 4)))
    before = motion.mass @ motion.velocities
    motion.advance(100)
    lost = np.abs(motion.mass @ motion.velocities - before).max() / (motion.mass @ np.abs(motion.velocities)).sum()
    return Outcome.of_all(Outcome.below(lost, 1e-12, "accuracy", "momentum off by {:.1e}"), balance)


@case("units of stress and length of 1e-9 and 1e9", "same equilibrium, 0.2 %")
def scale_of_units(subject: Subject) -> Outcome:
    """Test that displacements and reactions under a load of 0.01 mu are the same if the units of stress and length are 1e-9 and 1e9."""
    expected, errors = _level(subject, 1e-2), {}
    for stress, length in product(POWERS, POWERS):
        level = _level(subject, 1e-2, 10.0**stress, 10.0**length)
        unit = 10.0**stress * (10.0**length) ** (subject.dimension - 1)
        left = off(np.array(level["forces"]["left"]) / unit, np.array(expected["forces"]["left"]))
        errors[f"stress 1e{stress}, length 1e{length}"] = max(left, off(_moved(level) / 10.0**length, _moved(expected)))
    return Outcome.below(errors, OFF_PROPORTION, _why_no_equilibrium(subject))


@case("sudden load, undamped and damped", "energy error at most 1 %")
def energy_account(subject: Subject) -> Outcome:
    """Test the balance of energy under a sudden load of 0.1 mu, without damping, and with damping and viscosity.

    Shear waves have a speed of 1 in the units of the scene; in the duration of 4 they go along the body and back nearly twice in the plane,
    twice in a solid. The value is the greatest gap in the account of energy of the run's summary; a run warns of gaps above 1 %.
    """
    required(subject.bind(subject.body(6, 4)).has_energy, "has no energy")
    gaps, sudden = {}, [[0.0, 0.0], [1e-9, 1.0]]
    for name, losses in (("undamped", {}), ("damped", {"damping": 1.0, "viscosity": 0.02})):
        dynamics = {"duration": 4.0, "density": subject.law.shear_modulus, "safety": 0.5, **losses}
        steps = [{"to": 1.0, "outputs": 1, "dynamics": dynamics}]
        run = subject.run(_loaded(subject, 0.1, amplitude=sudden, precision="float64", steps=steps))
        gaps[name] = abs(run.summary["dynamics"][0]["greatest_energy_gap"]) / 100
    return Outcome.below(gaps, 0.01, "not conservative")


CONTRASTS = (1e1, 1e3, 1e5)
"""Shear moduli of the stiff parts, divided by that of the soft layer between them. Chosen: rubber beside a stiffer rubber, beside a
plastic, and beside steel."""

SOFT, MOVED = 0.4, 1e-3
"""Thickness of the soft layer, of four points, in the middle of a body of height 1; and displacement of the top, small enough for linear
elasticity to be exact to 0.1 %."""


def _stiff(subject: Subject, contrast: float) -> Law:
    """Return the law of the stiff parts of a body, `contrast` times as stiff as the subject's law.

    Its bulk modulus is K = 2 mu, as stiff materials have, unless the model is fitted to one ratio of the moduli.
    """
    alike = subject.law.scaled(contrast)
    compressible = replace(alike, bulk_modulus=2 * alike.shear_modulus)
    return compressible if subject.describes(compressible) else alike


def _judged_contrasts(subject: Subject, direction: int, held: tuple[str, ...], contrasts: tuple[float, ...]) -> Outcome:
    """Return the outcome for a layered body whose top moves along an axis (`direction`): the force on the top must be within 5 %.

    `contrasts` are the tested ratios of stiff to soft shear moduli; the worst counts. Bottom and top are held in the components `held`;
    back and front are held in x3; left and right are held in x2 under shear (`direction` 0), in x1 under tension (`direction` 1). Every
    layer is then homogeneous: the exact force is that of springs in series with the stiffnesses of the laws, since the strains are some
    thousandths at the most.
    """
    required(subject.plane in subject.model.several_materials, f"takes bodies of one material only{WHERE[subject.plane]}")
    d, width, across, still = subject.dimension, 0.4, f"x{2 - direction}", dict.fromkeys(held, 0.0)
    sides = [("left", across), ("right", across), ("back", "x3"), ("front", "x3")][: 2 * (d - 1)]
    bottom, top = {"region": "bottom", **still}, {"region": "top", **still, f"x{1 + direction}": MOVED}
    prescribed = [bottom, top, *({"region": face, component: 0.0} for face, component in sides)]
    low, high = np.tile([[-1.0], [2.0]], (2, 1, d))
    low[1, 1], high[0, 1] = (1 - SOFT) / 2, (1 + SOFT) / 2
    F, errors = np.eye(d), {}
    F[direction, 1] += 1e-6
    for ratio in contrasts:
        stiff = _stiff(subject, ratio)
        parts = [{"region": {"box": box.tolist()}, "material": stiff.describe()} for box in (low, high)]
        loading = {"prescribed": prescribed, "steps": [1.0], "solver": {"most_evaluations": 1500}}
        scene = subject.scene((width, 1.0, width), spacing=SOFT / 4, materials=parts, **loading)
        run = subject.run(scene, where=f"{ratio:g} times: ", weakness=_why_no_equilibrium(subject))
        soft, hard = (PLANES[subject.plane].first_piola_stress(law, F)[direction, 1] / 1e-6 for law in (subject.law, stiff))
        expected = MOVED / (SOFT / soft + (1 - SOFT) / hard)
        errors[ratio] = run.levels[-1]["forces"]["top"][direction] / width ** (d - 1) / expected - 1
    worst = max(errors, key=lambda ratio: abs(errors[ratio]))
    return Outcome.below(abs(errors[worst]), 0.05, "stiff contrasts", f"{100 * errors[worst]:+.2g} % ({worst:g} times)")


@case("sheared layer between parts 10 to 10^5 times as stiff", "force within 5 %, four points across")
def sheared_layer(subject: Subject) -> Outcome:
    """Test the force on a body under shear with a soft layer, four points thick, between parts 10 to 10^5 times as stiff.

    The left and right sides are held in x2, and in a solid the back and front in x3, so that every layer is sheared homogeneously.
    """
    return _judged_contrasts(subject, 0, ("x1", "x2", "x3")[: subject.dimension], CONTRASTS)


@case("confined layer between parts 10 and 10^5 times as stiff", "force within 5 %, four points across")
def confined_layer(subject: Subject) -> Outcome:
    """Test the force on a body in tension with a soft layer, four points thick, between parts 10 times, then 10^5 times as stiff.

    Rollers on the sides keep the width of the body constant.
    """
    return _judged_contrasts(subject, 1, ("x2",), (CONTRASTS[0], CONTRASTS[-1]))


@case("time step of 0.5, 0.9, 1.1, 2 times the critical one", "bounded below 1; above 1 an error within 100 steps")
def time_step(subject: Subject) -> Outcome:
    """Test explicit time steps of 0.5, 0.9, 1.1 and 2 times the critical step, a hundred each, on a free body with small random velocities.

    Above the critical step a wave grows by a factor of 2.4 or more per step, its energy by 5.8, and the force must raise a clear error.
    Below it the step length causes no growth; the energy that a non-conservative force adds (see `undamped_steps`) is tolerated up to a
    tenth of the kinetic energy per step.
    """
    body, notes = subject.body(10, 5), []
    for share in (0.5, 0.9):
        motion = Motion(subject.bind(body), share)
        first = motion.kinetic_energy
        motion.advance(100)
        a_step, figure = (motion.kinetic_energy / first) ** 0.01, f"at {share} the energy grew {{:.2g}} times a step"
        growth = Outcome.below(a_step, 1.1, "not conservative", figure)
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
    return Outcome(PASS, f"bounded below 1; error after {', '.join(notes)}")


def _held(subject: Subject) -> Motion:
    """Return the `Motion` of a body held at both ends at stretch 1.5, with half the critical step and the damping of `DampedExplicit`."""
    body = subject.body(8, (6, 4, 4))
    free = np.ones_like(body.points)
    free[np.abs(body.points[:, 0] - body.points[:, 0].mean()) > np.ptp(body.points[:, 0]) / 2 - 1e-9] = 0
    length = np.ptp(body.points[:, 0]) + SPACING
    damping = 2 * np.pi / length * np.sqrt(3 * subject.law.shear_modulus)
    return Motion(subject.bind(body), 0.5, body.points @ subject.uniaxial(1.5).T, free, damping)


@case("10^5 damped explicit steps at stretch 1.5", "kinetic energy falls to 1e-16", failing="loses stability")
def damped_steps(subject: Subject) -> Outcome:
    """Test that a body held at stretch 1.5 comes to rest in 10^5 explicit steps, damped at the rate of `DampedExplicit`.

    The value is the kinetic energy at the end divided by that at the start; the limit is 1e-16. At the damping rate c the energy of the
    slowest mode decreases as exp(-c t) until rounding remains: velocities of 1e-13 times the speed of waves, after 1e-3 at the start.
    """
    motion = _held(subject)
    first = motion.kinetic_energy
    motion.advance(STEPS if subject.full else STEPS // 50)
    return Outcome.below(motion.kinetic_energy / first, 1e-16, "loses stability")


@case("10^5 undamped explicit steps at stretch 1.5", "kinetic energy grows at most 1.2 times")
def undamped_steps(subject: Subject) -> Outcome:
    """Test that the kinetic energy of a body held at stretch 1.5 does not grow in 10^5 undamped steps, after small random velocities.

    The value is the mean kinetic energy in the last tenth of the steps divided by the mean in the first tenth. Small waves share their
    energy evenly between motion and strain, so the value is 1 within the scatter of some hundred modes; the limit is 1.2.
    """
    motion, pieces = _held(subject), 100
    steps = (STEPS if subject.full else STEPS // 50) // pieces
    energies = []
    motion.advance(2000)
    motion.damping = 0.0
    motion.shake()
    for _ in range(pieces):
        try:
            motion.advance(steps)
        except InvalidState as error:
            within = f"within {(len(energies) + 1) * steps} steps: {error}"
            raise Ended(Outcome(WEAK, within, weakness="not conservative")) from error
        energies.append(motion.kinetic_energy)
    growth = np.mean(energies[-pieces // 10 :]) / np.mean(energies[: pieces // 10])
    return Outcome.below(growth, 1.2, "not conservative", "{:.3g}")


@case("sudden load on a bar", "energy balance changes by at most 1 % in 20,000 steps", failing="not conservative")
def sudden_load(subject: Subject) -> Outcome:
    """Test the balance of energy of a bar that is held at one end and suddenly loaded at the other.

    The load is a tenth of mu: waves run along the bar, and its end oscillates between its undeformed position and twice the static
    displacement. The sum of stored and kinetic energy minus the work of the load is zero except for the error of time steps of half the
    critical length, which stays bounded. The value is the change of this sum between the first and the last tenth of 20,000 steps (some
    fifty oscillations), divided by the greatest work of the load; the limit is a hundredth.
    """
    body = subject.body((16, 5), (12, 3, 3))
    force = subject.bind(body)
    required(force.has_energy, "has no energy")
    along = np.rint(body.points[:, 0] / SPACING - 0.5)
    free = np.ones_like(body.points)
    free[along == 0] = 0
    motion, pieces = Motion(force, free=free), 2000 // (1 if subject.full else 10)
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


CASES = cases_of(globals())
