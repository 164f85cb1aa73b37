"""Check of the speeds of held parts in dynamics against that of waves."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from ..scenes import Scene
from ..solvers.conditions import Loading
from ..solvers.motion import Motion
from .programme import Stage


def check_speeds(scene: Scene, loading: Loading, stages: tuple[Stage, ...], modulus: float) -> None:
    """Refuse held parts that move apart faster than the slowest shear waves: the result would depend on the motion at the start."""
    units = scene.units
    unit = f" {units.length}/{units.time}" if units.length and units.time else ""
    for begin, stage in zip([loading.rest, *(stage.to for stage in stages)], stages, strict=False):
        inertia = stage.inertia
        if inertia is None:
            continue
        speed, wave = _greatest_speed(loading, inertia.motion(begin, stage.to)), math.sqrt(modulus / inertia.density)
        if speed <= wave:
            continue
        if inertia.duration is None:
            what, slowest = "the grips", f"the greatest rate is {inertia.rate * wave / speed:.4g}"
        else:
            what, least = "parts that are held", units.amount(inertia.duration * speed / wave, "time", ".4g")
            slowest = f"the least duration is {least}"
        apart = f"{what} would move apart at {speed:.4g}{unit}, faster than shear waves at {wave:.4g}{unit}"
        raise ValueError(f"{inertia.key}.{inertia.pace}: {apart}; {slowest}")


def _greatest_speed(loading: Loading, motion: Motion) -> float:
    """Return the greatest difference of the velocities of any two held parts, in a component, during a stage in dynamics."""
    share, fastest = loading.body.share, 0.0
    for begin, end in pairwise(np.linspace(0, motion.duration, 17)):
        changes = loading.moves(motion.at(end)) - loading.moves(motion.at(begin))
        for component in range(loading.body.dimension):
            own = changes[loading.component == component]
            apart = share.greatest(own.max(initial=-np.inf)) + share.greatest(-own.min(initial=np.inf))
            fastest = max(fastest, apart / (end - begin))
    return fastest
