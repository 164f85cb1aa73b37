"""Runs of small held bodies: loads, moduli and lengths of every scale, the balance of forces, the account of energy, and stiff contrasts.

The other properties are those of forces alone; these are properties of whole runs, in which the solver, the precision, the loads and the
integrator take part as well.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from ..forces import InvalidState
from ..materials import PLANES, Law
from ..results import Result
from ..run.simulate import SimulationFailed, SimulationInterrupted, SinglePrecisionLeft, simulate
from ..scenes import MaterialSpec, Scene, SceneError
from .case import INAPPLICABLE, PASS, WEAK, Case, Outcome, Subject
from .deformations import force_densities
from .dynamics import Motion

SIDES = {2: (1.2, 0.8), 3: (1.0, 0.8, 0.8)}
"""Sides of the held body, by dimension; its points are a fifth apart."""

DIRECTION = (1.0, 0.1, 0.0)
"""Traction on the free end over its size: it pulls, and bends a little."""

OFF_BALANCE = 2e-3
"""Greatest part of a load that the sum of loads and reactions may be.

A run bounds it by 5e-4 of what drives the body, here the sizes of the reactions of single points: at a clamped end these pull across as
well, and are in sum up to four times the load.
"""

MOST_OFF = 1e-3
"""Greatest balance of forces that a run may state, over what drives the body."""

OFF_PROPORTION = 2e-3
"""Greatest relative difference of two equilibria that should be one, each of which may leave forces of a thousandth of its load."""

LOADS = (1e-9, 1e-7, 1e-5, 1e-2, 1.0)
"""Loads in shear moduli; up to 1e-5 strains are some 1e-5 at the most, and so is the departure from linear elasticity."""

LINEAR = 1e-5
"""Greatest of the loads for which displacements are in proportion to the load."""

POWERS = (-9, 9)
"""Powers of ten of the units of stress and length."""


def in_units_of(law: Law, stress: float) -> Law:
    """Return the material with every modulus multiplied by a factor."""
    described = law.describe()
    for key in described:
        if "modul" in key:
            described[key] = (np.asarray(described[key]) * stress).tolist()
    return MaterialSpec.model_validate(described).build()


def _why_no_equilibrium(subject: Subject) -> str:
    return "zero-energy modes" if subject.reference == "nosb" else "does not converge"


def _held(subject: Subject, stress: float = 1.0, length: float = 1.0, **changes) -> Scene:
    """Return a body in other units that is held at its left face."""
    d, law = subject.dimension, in_units_of(subject.law, stress)
    described = {
        "name": "held",
        "plane": subject.plane,
        "body": {"shape": "rectangle" if d == 2 else "box", "size": [length * side for side in SIDES[d]]},
        "spacing": 0.2 * length,
        "material": law.describe(),
        "prescribed": [{"region": "left", **{f"x{axis + 1}": 0.0 for axis in range(d)}}],
        "steps": [1.0],
    }
    return Scene(**described | changes)


def _traction(subject: Subject, load: float, stress: float = 1.0, **changes) -> dict:
    """Return a load on the right face; its size is in shear moduli."""
    size = load * stress * subject.law.shear_modulus
    return {"region": "right", "traction": [size * part for part in DIRECTION[: subject.dimension]], **changes}


def _run(subject: Subject, scene: Scene) -> Result | Outcome:
    """Return the run of a scene; or the outcome of one that failed."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SinglePrecisionLeft)
            return simulate(scene, subject.model)
    except SimulationInterrupted:
        raise KeyboardInterrupt from None
    except SimulationFailed as error:
        return Outcome(WEAK, str(error), None, None, _why_no_equilibrium(subject))


def _level(subject: Subject, load: float, stress: float = 1.0, length: float = 1.0) -> dict | Outcome:
    """Return the equilibrium under a load, once for a subject; or the outcome of a run that failed."""
    key = "held", load, stress, length
    if key not in subject.measured:
        run = _run(subject, _held(subject, stress, length, loads=[_traction(subject, load, stress)]))
        subject.measured[key] = run if isinstance(run, Outcome) else run.levels[-1]
    return subject.measured[key]


def _moved(level: dict) -> np.ndarray:
    return np.array(level["displacements"]["right"])


def _off_balance(level: dict) -> float:
    """Return the sum of load and reaction over the load, by the sums of their components' sizes."""
    load, reaction = (np.array(level["forces"][face]) for face in ("right", "left"))
    return float(np.abs(load + reaction).sum() / np.abs(load).sum())


def small_loads(subject: Subject) -> Outcome:
    """Test loads of 1e-9 to 1e-5 shear moduli by their displacements, which must be in proportion to them.

    The figure is the greatest difference of displacement over load from that under the greatest of these loads.
    """
    loads = [load for load in LOADS if load <= LINEAR]
    found = [_level(subject, load) for load in loads]
    for load, level in zip(loads, found, strict=True):
        if isinstance(level, Outcome):
            return Outcome(WEAK, f"{load:g} mu: does not converge", None, None, level.weakness)
    over = np.array([_moved(level) / load for level, load in zip(found, loads, strict=True)])
    off = np.abs(over - over[-1]).max() / np.abs(over[-1]).max()
    return Outcome.below(off, OFF_PROPORTION, _why_inaccurate_at_rest(subject))


def _why_inaccurate_at_rest(subject: Subject) -> str:
    """Return the weakness of a force that small loads are added to."""
    body = subject.body({2: 6, 3: 4}[subject.dimension])
    return "accuracy" if np.abs(force_densities(subject.bind(body), body.points)).max() < 1e-9 else "force at rest"


def force_balance(subject: Subject) -> Outcome:
    """Test the balance of load and reaction under loads of 1e-9 to 1 shear moduli, and the momentum of a free body that moves.

    The figure is the greatest part of a load that the sum of both is, or twice the balance that the run states, of what drives the body. Of
    a free body without damping the momentum after 100 steps may differ by rounding alone, 1e-12 of the sum of the sizes of all momenta.
    """
    errors = {}
    for load in LOADS:
        level = _level(subject, load)
        if isinstance(level, Outcome):
            return Outcome(WEAK, f"{load:g} mu: does not converge", None, None, level.weakness)
        errors[load] = max(_off_balance(level), OFF_BALANCE / MOST_OFF * level["force_balance"])
    greatest = max(errors, key=errors.get)
    if errors[greatest] > OFF_BALANCE:
        figure = f"{errors[greatest]:.1e} of {greatest:g} mu"
        return Outcome(WEAK, figure, errors[greatest], OFF_BALANCE, _why_inaccurate_at_rest(subject))
    body = subject.body({2: 6, 3: 4}[subject.dimension])
    motion = Motion(subject.bind(body), body.points.copy(), np.ones_like(body.points), 0.5)
    before = motion.momenta.sum(axis=0)
    try:
        motion.advance(100)
    except InvalidState as error:
        return Outcome(WEAK, str(error), None, None, "not conservative")
    lost = np.abs(motion.momenta.sum(axis=0) - before).max() / np.abs(motion.momenta).sum()
    figure = f"{errors[greatest]:.1e} of {greatest:g} mu"
    if lost > 1e-12:
        return Outcome(WEAK, f"momentum off by {lost:.1e}", lost, 1e-12, "accuracy")
    return Outcome(PASS, figure, errors[greatest], OFF_BALANCE)


def scale_of_units(subject: Subject) -> Outcome:
    """Test an equilibrium under a load of 0.01 mu in units of stress and length of 1e-9 and 1e9 by its displacements and reactions."""
    expected, errors = _level(subject, 1e-2), {}
    for stress in POWERS:
        for length in POWERS:
            level = _level(subject, 1e-2, 10.0**stress, 10.0**length)
            for one in (expected, level):
                if isinstance(one, Outcome):
                    return one
            moved = np.abs(_moved(level) / 10.0**length - _moved(expected)).max() / np.abs(_moved(expected)).max()
            unit = 10.0**stress * (10.0**length) ** (subject.dimension - 1)
            left, before = np.array(level["forces"]["left"]), np.array(expected["forces"]["left"])
            errors[f"stress 1e{stress}, length 1e{length}"] = max(moved, np.abs(left / unit - before).max() / np.abs(before).max())
    place = max(errors, key=errors.get)
    return Outcome.below(errors[place], OFF_PROPORTION, _why_no_equilibrium(subject), f"{{:.1e}} ({place})")


def energy_account(subject: Subject) -> Outcome:
    """Test a sudden load of 0.1 mu, without damping and with damping and viscosity, by the account of the energy put in.

    Shear waves have a speed of 1, and go along the body and back twice. What a run itself warns of is an account off by 1 % at any time.
    """
    if not subject.bind(subject.body({2: 6, 3: 4}[subject.dimension])).has_energy:
        return Outcome(INAPPLICABLE, "has no energy")
    gaps, sudden = {}, [[0.0, 0.0], [1e-9, 1.0]]
    for name, losses in (("undamped", {}), ("damped", {"damping": 1.0, "viscosity": 0.02})):
        dynamics = {"duration": 4.0, "density": subject.law.shear_modulus, "safety": 0.5, **losses}
        scene = _held(
            subject,
            precision="float64",
            loads=[_traction(subject, 0.1, amplitude=sudden)],
            steps=[{"to": 1.0, "outputs": 1, "dynamics": dynamics}],
        )
        run = _run(subject, scene)
        if isinstance(run, Outcome):
            return run
        (told,) = run.summary["dynamics"]
        gaps[name] = abs(told["greatest_energy_gap"]) / 100
    greatest = max(gaps, key=gaps.get)
    return Outcome.below(gaps[greatest], 0.01, "not conservative", f"{{:.1e}} ({greatest})")


CONTRASTS = (1e1, 1e3, 1e5)
"""Shear moduli of the stiff parts over that of the soft layer between them."""

SOFT, MOVED = 0.4, 1e-3
"""Thickness of the soft layer in the middle of a body of height 1, of four points; and how far the top is moved."""


def _stiff(subject: Subject, contrast: float) -> Law:
    """Return the law of the stiff parts: with K = 2 mu, as stiff materials have, unless the model is fitted to one ratio of the moduli."""
    alike = in_units_of(subject.law, contrast)
    compressible = replace(alike, bulk_modulus=2 * alike.shear_modulus)
    return compressible if subject.describes(compressible) else alike


def _off_series(subject: Subject, stiff: Law, held: list[dict], direction: int) -> float | Outcome:
    """Return the relative error of the force on a body of layers whose top is moved in a direction; or a failed outcome.

    The body is held so that every layer is deformed alike throughout: the exact force is that of springs in series, of the laws' own
    stiffnesses, since the strains are some thousandths at the most.
    """
    d, width = subject.dimension, 0.4
    low, high = np.tile([[-1.0], [2.0]], (2, 1, d))
    low[1, 1], high[0, 1] = (1 - SOFT) / 2, (1 + SOFT) / 2
    described = {
        "name": "layers",
        "plane": subject.plane,
        "spacing": SOFT / 4,
        "body": {"shape": "rectangle" if d == 2 else "box", "size": [width, 1.0, width][:d]},
        "material": subject.law.describe(),
        "materials": [{"region": {"box": box.tolist()}, "material": stiff.describe()} for box in (low, high)],
        "prescribed": held,
        "steps": [1.0],
        "solver": {"most_evaluations": 1500},
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of contrasts that bond forces are not for
        run = _run(subject, Scene(**described))
    if isinstance(run, Outcome):
        return run
    compliance = 0.0
    for law, thickness in ((subject.law, SOFT), (stiff, 1 - SOFT)):
        change = np.zeros((d, d))
        change[direction, 1] = 1e-6
        sheared = PLANES[subject.plane].first_piola_stress(law, np.eye(d) + change)
        compliance += thickness * 1e-6 / sheared[direction, 1]
    return run.levels[-1]["forces"]["top"][direction] / width ** (d - 1) / (MOVED / compliance) - 1


def _judged_contrasts(subject: Subject, held: list[dict], direction: int, contrasts: tuple[float, ...]) -> Outcome:
    """Judge a way of moving the top at several contrasts by the greatest error of the force, which must be within 5 %."""
    errors = {}
    for ratio in contrasts:
        try:
            found = _off_series(subject, _stiff(subject, ratio), held, direction)
        except SceneError as error:
            return Outcome(INAPPLICABLE, str(error).split(": ")[1].split(";")[0])
        if isinstance(found, Outcome):
            return Outcome(WEAK, f"{ratio:g} times: does not converge", None, None, found.weakness)
        errors[ratio] = found
    worst = max(errors, key=lambda ratio: abs(errors[ratio]))
    return Outcome.below(abs(errors[worst]), 0.05, "stiff contrasts", f"{100 * errors[worst]:+.2g} % ({worst:g} times)")


def sheared_layer(subject: Subject) -> Outcome:
    """Test a soft layer of four points between parts 10 to 10^5 times as stiff under shear; points of the sides stay at their height."""
    still = dict.fromkeys(["x1", "x2", "x3"][: subject.dimension], 0.0)
    sides = [("left", "x2"), ("right", "x2"), ("back", "x3"), ("front", "x3")][: 2 * (subject.dimension - 1)]
    held = [{"region": "bottom", **still}, {"region": "top", **still, "x1": MOVED}, *({"region": face, x: 0.0} for face, x in sides)]
    return _judged_contrasts(subject, held, 0, CONTRASTS)


def confined_layer(subject: Subject) -> Outcome:
    """Test a soft layer of four points between parts 10 and 10^5 times as stiff that are pulled apart; rollers hold the width."""
    sides = [("left", "x1"), ("right", "x1"), ("back", "x3"), ("front", "x3")][: 2 * (subject.dimension - 1)]
    held = [{"region": "bottom", "x2": 0.0}, {"region": "top", "x2": MOVED}, *({"region": face, x: 0.0} for face, x in sides)]
    return _judged_contrasts(subject, held, 1, (CONTRASTS[0], CONTRASTS[-1]))


CASES = (
    Case("sheared layer between parts 10 to 10^5 times as stiff", "force within 5 %, four points across", sheared_layer),
    Case("confined layer between parts 10 and 10^5 times as stiff", "force within 5 %, four points across", confined_layer),
)
