"""Checks of what dynamics would take, before a run begins."""

import math
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
    for begin, stage in zip([loading.rest, *(stage.to for stage in stages)], stages, strict=False):
        if stage.inertia is None:
            continue
        motion = stage.motion(begin)
        wave = math.sqrt(modulus / stage.inertia.density)
        speed = _greatest_speed(loading, motion)
        if speed > wave:
            if stage.inertia.pace == "stretch_rate":
                what = "the grips"
                slowest = f"the greatest possible rate is {motion.rate * wave / speed:.4g}"
            else:
                what = "parts that are held"
                least = units.amount(motion.duration * speed / wave, "time", ".4g")
                slowest = f"the shortest possible duration is {least}"
            apart = (
                f"{what} would move apart at {speed:.4g}{unit}, faster than shear waves at"
                f" {wave:.4g}{unit}"
            )
            raise ValueError(f"{stage.key}.{stage.inertia.pace}: {apart}; {slowest}")
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
