"""Checks of the time steps that dynamics would take, before a run begins, and the choice whether
bonds break in dynamics or in equilibrium.
"""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ..scenes import Scene
from ..solvers.conditions import Loading
from ..solvers.increments import Motion
from .program import Stage

MOST_STEPS = 1e9
"""Maximum number of steps of a stage: more would run for weeks even on the smallest body, and
indicate wrong units of density or rate.
"""

SLOW = 1e-3
"""Speed of held parts, divided by that of shear waves, below which bonds break in equilibrium
unless the scene says otherwise. Chosen: a quarter of the speed at which the peaks of dynamics are
those of equilibrium, and half of that at which 8,000 points take as long in both
(docs/validation/slow-tears.md); laboratories tear at 1e-7 to 1e-5.
"""


def process_of(
    scene: Scene, loading: Loading, stages: tuple[Stage, ...], modulus: float
) -> tuple[str, str]:
    """Return the process by which bonds of a scene with fracture break, "dynamics" or
    "quasi-static", and the reason; `stages` are those that the scene states, and `modulus` is the
    least shear modulus.
    """
    assert scene.fracture is not None
    if scene.fracture.process is not None:
        return scene.fracture.process, "as the scene says"
    moving = list(_in_dynamics(loading, stages))
    if not moving:
        return "quasi-static", "since the scene has no dynamics"
    if scene.loads or scene.obstacles:
        return "dynamics", "since loads or obstacles drive the body"
    if not scene.stretched and len(moving) == len(stages):
        return "dynamics", "since no step is in equilibrium"  # in which the body may drift
    speed = max(
        _greatest_speed(loading, motion) / wave_of(stage, modulus) for stage, motion in moving
    )
    if speed == 0:
        return "dynamics", "since no held part moves"
    why = f"since held parts move at {speed:.2g} times the speed of shear waves"
    return ("quasi-static", f"{why}, less than {SLOW:g}") if speed < SLOW else ("dynamics", why)


def wave_of(stage: Stage, modulus: float) -> float:
    """Return the speed of shear waves in a stage in dynamics."""
    return math.sqrt(modulus / stage.inertia.density)


def _in_dynamics(loading: Loading, stages: tuple[Stage, ...]) -> Iterator[tuple[Stage, Motion]]:
    for begin, stage in zip([loading.rest, *(stage.to for stage in stages)], stages, strict=False):
        if stage.inertia is not None:
            yield stage, stage.motion(begin)


def check_dynamics(
    scene: Scene, loading: Loading, stages: tuple[Stage, ...], modulus: float
) -> None:
    """Raise ValueError if held parts move apart faster than shear waves in a stage in dynamics, or
    it needs more than `MOST_STEPS` time steps for sure; `modulus` is the least shear modulus.

    With such speeds the result would depend on the motion at the start. The estimate of the steps
    is generous, as the horizon is longer than the waves that limit the step, and pressure waves are
    faster than shear waves.
    """
    units = scene.units
    unit = f" {units.length}/{units.time}" if units.length and units.time else ""
    for stage, motion in _in_dynamics(loading, stages):
        wave = wave_of(stage, modulus)
        speed = _greatest_speed(loading, motion)
        if speed > wave:
            if stage.inertia.pace == "stretch_rate":
                what = "the grips"
                slowest = f"the greatest possible rate is {motion.rate * wave / speed:.4g}"
            else:
                what = "parts that are held"
                least = units.amount(motion.duration * speed / wave, "time", ".4g")
                slowest = f"the shortest possible duration is {least}"
            raise ValueError(
                f"{stage.key}.{stage.inertia.pace}: {what} would move apart at {speed:.4g}{unit},"
                f" faster than shear waves at {wave:.4g}{unit}; {slowest}"
            )
        # time of a shear wave through a horizon
        crossing = loading.body.horizon / wave
        damped = 2 * (stage.inertia.viscosity or 0.0)
        step = stage.inertia.safety * min(crossing, crossing * crossing / (damped or crossing))
        if motion.duration > MOST_STEPS * step:
            raise ValueError(
                f"{stage.key}: a duration of {motion.duration:.3g} in time steps of less than"
                f" {step:.1g} needs more than {MOST_STEPS:.0e} steps; check {stage.key}.density,"
                f" {stage.key}.{stage.inertia.pace}, {stage.key}.viscosity and {stage.key}.safety"
                " and their units"
            )


def _greatest_speed(loading: Loading, motion: Motion) -> float:
    """Return the greatest difference of velocity between two held points, in any component,
    during a stage in dynamics.
    """
    share = loading.body.share
    places = loading.body.points[loading.point]
    fastest = 0.0
    for begin, end in pairwise(np.linspace(0, motion.duration, 17)):
        changes = loading.moves(motion.at(end), places) - loading.moves(motion.at(begin), places)
        for component in range(loading.body.dimension):
            own = changes[loading.component == component]
            apart = share.greatest(own.max(initial=-np.inf)) + share.greatest(
                -own.min(initial=np.inf)
            )
            fastest = max(fastest, apart / (end - begin))
    return fastest
