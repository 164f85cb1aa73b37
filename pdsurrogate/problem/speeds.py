"""Check of the speeds of held parts in dynamics against that of waves."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from ..scenes import Scene
from ..solvers.conditions import Loading, displaced
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
    share, dimension, fastest = loading.body.share, loading.body.dimension, 0.0
    for begin, end in pairwise(np.linspace(0, motion.duration, 17)):
        low, high = np.full(dimension, np.inf), np.full(dimension, -np.inf)
        changes = [(part, part.displacement(motion.at(end)) - part.displacement(motion.at(begin))) for part in loading.held]
        for plane, sources in zip(loading.planes, loading.beside_planes, strict=True):
            change = plane.motion(motion.at(end)) - plane.motion(motion.at(begin))
            changes.append((plane, displaced(change, loading.body.points[sources])))
        for part, change in changes:
            change = np.atleast_2d(change)
            for component in part.components:
                low[component] = min(low[component], change[:, component].min(initial=np.inf))
                high[component] = max(high[component], change[:, component].max(initial=-np.inf))
        low = -np.array([share.greatest(-value) for value in low])
        high = np.array([share.greatest(value) for value in high])
        spread = (high - low)[np.isfinite(low)]
        fastest = max(fastest, float(spread.max(initial=0.0)) / (end - begin))
    return fastest
