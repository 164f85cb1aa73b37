"""Runs of small held bodies: loads, moduli and lengths of every scale, the balance of forces, the account of energy, and stiff contrasts.

The other properties are those of forces alone; these are properties of whole runs, in which the solver, the precision, the loads and the
integrator take part as well.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from ..forces.settings import WHERE
from ..materials import PLANES, Law
from ..scenes import MaterialSpec, Scene
from .case import Outcome, Subject, case, required
from .deformations import force_densities
from .dynamics import Motion

SIDES = (1.2, 0.8), (1.0, 0.8, 0.8)
"""Sides of the held body, in the plane and in three dimensions; its points are a fifth apart."""

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


def _loaded(subject: Subject, load: float, stress: float = 1.0, length: float = 1.0, amplitude: str | list = "ramp", **changes) -> Scene:
    """Return a body in other units, held at its left face, with a load on its right face; its size is in shear moduli."""
    law, size = in_units_of(subject.law, stress), load * stress * subject.law.shear_modulus
    loads = [{"region": "right", "traction": [size * part for part in DIRECTION[: subject.dimension]], "amplitude": amplitude}]
    described = {"spacing": 0.2 * length, "material": law.describe(), "prescribed": [subject.held_at("left")], "steps": [1.0]}
    return subject.scene(tuple(length * side for side in subject.sized(*SIDES)), loads=loads, **described | changes)


def _level(subject: Subject, load: float, stress: float = 1.0, length: float = 1.0) -> dict:
    """Return the equilibrium under a load, computed once for a subject."""
    run = partial(subject.run, where=f"{load:g} mu: ", weakness=_why_no_equilibrium(subject))
    return subject.once(("held", load, stress, length), lambda: run(_loaded(subject, load, stress, length)).levels[-1])


def _moved(level: dict) -> np.ndarray:
    return np.array(level["displacements"]["right"])


def _off_balance(level: dict) -> float:
    """Return the sum of load and reaction over the load, by the sums of their components' sizes."""
    load, reaction = (np.array(level["forces"][face]) for face in ("right", "left"))
    return float(np.abs(load + reaction).sum() / np.abs(load).sum())


@case("loads of 1e-9 to 1e-5 mu", "displacements in proportion, 0.2 %")
def small_loads(subject: Subject) -> Outcome:
    """Test loads of 1e-9 to 1e-5 shear moduli by their displacements, which must be in proportion to them.

    The figure is the greatest difference of displacement over load from that under the greatest of these loads.
    """
    over = np.array([_moved(_level(subject, load)) / load for load in LOADS if load <= LINEAR])
    off = np.abs(over - over[-1]).max() / np.abs(over[-1]).max()
    return Outcome.below(off, OFF_PROPORTION, _why_inaccurate_at_rest(subject))


def _why_inaccurate_at_rest(subject: Subject) -> str:
    """Return the weakness of a force that small loads are added to."""
    body = subject.body(6, 4)
    return "accuracy" if np.abs(force_densities(subject.bind(body), body.points)).max() < 1e-9 else "force at rest"


@case("loads of 1e-9 to 1 mu, a free body in motion", "forces balance to 0.1 % of the load, momentum is kept", failing="not conservative")
def force_balance(subject: Subject) -> Outcome:
    """Test the balance of load and reaction under loads of 1e-9 to 1 shear moduli, and the momentum of a free body that moves.

    The figure is the greatest part of a load that the sum of both is, or twice the balance that the run states, of what drives the body. Of
    a free body without damping the momentum after 100 steps may differ by rounding alone, 1e-12 of the sum of the sizes of all momenta.
    """
    errors = {}
    for load in LOADS:
        level = _level(subject, load)
        errors[f"{load:g} mu"] = max(_off_balance(level), OFF_BALANCE / MOST_OFF * level["force_balance"])
    balance = Outcome.below(errors, OFF_BALANCE, _why_inaccurate_at_rest(subject))
    if balance.weakness:
        return balance
    motion = Motion(subject.bind(subject.body(6, 4)))
    before = motion.momenta.sum(axis=0)
    motion.advance(100)
    lost = np.abs(motion.momenta.sum(axis=0) - before).max() / np.abs(motion.momenta).sum()
    return Outcome.of_all(Outcome.below(lost, 1e-12, "accuracy", "momentum off by {:.1e}"), balance)


@case("equilibrium in units of stress and length of 1e-9 and 1e9", "the same, 0.2 %")
def scale_of_units(subject: Subject) -> Outcome:
    """Test an equilibrium under a load of 0.01 mu in units of stress and length of 1e-9 and 1e9 by its displacements and reactions."""
    expected, errors = _level(subject, 1e-2), {}
    for stress, length in product(POWERS, POWERS):
        level = _level(subject, 1e-2, 10.0**stress, 10.0**length)
        moved = np.abs(_moved(level) / 10.0**length - _moved(expected)).max() / np.abs(_moved(expected)).max()
        unit = 10.0**stress * (10.0**length) ** (subject.dimension - 1)
        left, before = np.array(level["forces"]["left"]), np.array(expected["forces"]["left"])
        errors[f"stress 1e{stress}, length 1e{length}"] = max(moved, np.abs(left / unit - before).max() / np.abs(before).max())
    return Outcome.below(errors, OFF_PROPORTION, _why_no_equilibrium(subject))


@case("energy of a sudden load, undamped and damped", "accounted for within 1 %")
def energy_account(subject: Subject) -> Outcome:
    """Test a sudden load of 0.1 mu, without damping and with damping and viscosity, by the account of the energy put in.

    Shear waves have a speed of 1, and go along the body and back twice. What a run itself warns of is an account off by 1 % at any time.
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
"""Shear moduli of the stiff parts over that of the soft layer between them."""

SOFT, MOVED = 0.4, 1e-3
"""Thickness of the soft layer in the middle of a body of height 1, of four points; and how far the top is moved."""


def _stiff(subject: Subject, contrast: float) -> Law:
    """Return the law of the stiff parts: with K = 2 mu, as stiff materials have, unless the model is fitted to one ratio of the moduli."""
    alike = in_units_of(subject.law, contrast)
    compressible = replace(alike, bulk_modulus=2 * alike.shear_modulus)
    return compressible if subject.describes(compressible) else alike


def _off_series(subject: Subject, stiff: Law, held: list[dict], direction: int, where: str) -> float:
    """Return the relative error of the force on a body of layers whose top is moved in a direction.

    The body is held so that every layer is deformed alike throughout: the exact force is that of springs in series, of the laws' own
    stiffnesses, since the strains are some thousandths at the most.
    """
    d, width = subject.dimension, 0.4
    low, high = np.tile([[-1.0], [2.0]], (2, 1, d))
    low[1, 1], high[0, 1] = (1 - SOFT) / 2, (1 + SOFT) / 2
    scene = subject.scene(
        (width, 1.0, width),
        spacing=SOFT / 4,
        materials=[{"region": {"box": box.tolist()}, "material": stiff.describe()} for box in (low, high)],
        prescribed=held,
        steps=[1.0],
        solver={"most_evaluations": 1500},
    )
    run = subject.run(scene, where=where, weakness=_why_no_equilibrium(subject))
    compliance, change = 0.0, np.zeros((d, d))
    change[direction, 1] = 1e-6
    for law, thickness in ((subject.law, SOFT), (stiff, 1 - SOFT)):
        sheared = PLANES[subject.plane].first_piola_stress(law, np.eye(d) + change)
        compliance += thickness * 1e-6 / sheared[direction, 1]
    return run.levels[-1]["forces"]["top"][direction] / width ** (d - 1) / (MOVED / compliance) - 1


def _judged_contrasts(subject: Subject, direction: int, held: tuple[str, ...], contrasts: tuple[float, ...]) -> Outcome:
    """Judge the force on the top, moved in a direction, at several contrasts by its greatest error, which must be within 5 %.

    Bottom and top are held in the components `held`, the sides across the direction that the top is moved in.
    """
    across = f"x{2 - direction}"
    sides = [("left", across), ("right", across), ("back", "x3"), ("front", "x3")][: 2 * (subject.dimension - 1)]
    still, errors = dict.fromkeys(held, 0.0), {}
    prescribed = [
        {"region": "bottom", **still},
        {"region": "top", **still, f"x{1 + direction}": MOVED},
        *({"region": face, component: 0.0} for face, component in sides),
    ]
    required(subject.plane in subject.model.several_materials, f"takes bodies of one material only{WHERE[subject.plane]}")
    for ratio in contrasts:
        errors[ratio] = _off_series(subject, _stiff(subject, ratio), prescribed, direction, f"{ratio:g} times: ")
    worst = max(errors, key=lambda ratio: abs(errors[ratio]))
    return Outcome.below(abs(errors[worst]), 0.05, "stiff contrasts", f"{100 * errors[worst]:+.2g} % ({worst:g} times)")


@case("sheared layer between parts 10 to 10^5 times as stiff", "force within 5 %, four points across")
def sheared_layer(subject: Subject) -> Outcome:
    """Test a soft layer of four points between parts 10 to 10^5 times as stiff under shear; points of the sides stay at their height."""
    return _judged_contrasts(subject, 0, ("x1", "x2", "x3")[: subject.dimension], CONTRASTS)


@case("confined layer between parts 10 and 10^5 times as stiff", "force within 5 %, four points across")
def confined_layer(subject: Subject) -> Outcome:
    """Test a soft layer of four points between parts 10 and 10^5 times as stiff that are pulled apart; rollers hold the width."""
    return _judged_contrasts(subject, 1, ("x2",), (CONTRASTS[0], CONTRASTS[-1]))


CASES = (sheared_layer, confined_layer)
