"""Tear tests: the steady force on the legs of trousers, and the stretch at which a cut across a
strip in pure shear grows.
"""

import numpy as np

from .plausible import AGREE
from .quantities import amount_in
from .readings import Readings
from .specimens import SHEAR_TEAR, TROUSER, Specimen, Tear

LEG, SPECIMEN = "leg", "specimen"
"""Whose width a file states, for users of files of trousers."""

LEAST_STEADY = 0.25
"""Least part of a test, to the end of the tear, in which the force is steady. Chosen: legs of usual
length are straight and stretched after a third of it; a force that rises until it falls is never
steady.
"""


def torn_legs(readings: Readings, modes: list[str] | None) -> list[Tear] | None:
    """Return the tears of a table of trouser tests, None for other tables."""
    if not modes or {*modes} != {TROUSER}:
        return None
    force, thickness = readings.numbers("force"), readings.size("thickness")
    width = leg_width(readings)
    if not readings.has_unit("force"):
        readings.missing.append("the force on the legs: --column force=HEADING, --unit force=N")
    if not thickness:
        readings.missing.append("the thickness of the legs: --thickness '2 mm'")
    if readings.missing:
        return []
    readings.unit = readings.facts.stress_unit or "MPa"
    groups = np.array(readings.text("specimen"))
    found = []
    for group in dict.fromkeys(groups.tolist()):
        rows = np.flatnonzero((groups == group) & np.isfinite(force))
        name = " ".join(filter(None, (readings.block.title, group))) or readings.where
        along = readings.numbers("extension")[rows]
        steady = steady_force(force[rows], along)
        if steady is None:
            readings.assumed.append(
                f"{name}: the force rises until it falls, as of legs that break: no tearing energy"
            )
            continue
        first, last, mean, deviation = steady
        readings.assumed.append(
            f"{name}: the force on the legs is {mean:.4g} N in the mean of rows {first + 1} to"
            f" {last + 1}, in which it varies by {100 * deviation / mean:.2g} %"
        )
        stress = float(readings.in_wanted_unit(np.array(mean / (width * thickness))))
        found.append(Tear(name, TROUSER, float(width), stress))
    return found


def leg_width(readings: Readings) -> float | None:
    """Return the width of a leg in mm, and say whose width the file's is; None, with a remark, if
    nobody says so.
    """
    stated, own = readings.facts.width, readings.block.facts.get("width")
    words = {LEG: 1, SPECIMEN: 2}
    if stated is None or (stated in words and own is None):
        asked = "the width of a leg: --width '7.5 mm'"
        whose = f"whose width the file's {own} is, of a leg or of both: --width {LEG}|{SPECIMEN}"
        readings.missing.append(whose if own else asked)
        return None
    readings.used.add("width")
    whole = amount_in(own, "mm", f"{readings.where}: the file's width") if own else None
    if whole and stated in words:
        width = whole / words[stated]
    else:
        width = amount_in(stated, "mm", f"{readings.where}: --width")
    if whole and not any(abs(whole - each * width) <= AGREE * whole for each in words.values()):
        raise ValueError(
            f"{readings.where}: --width {stated} is stated for a leg, but the file says {own},"
            " which is neither that of a leg nor that of both"
        )
    twice = f", half of the specimen's {whole:g} mm" if whole and whole > 1.5 * width else ""
    readings.assumed.append(f"the width of a leg is {width:g} mm{twice}")
    return width


def steady_force(force: np.ndarray, along: np.ndarray) -> tuple[int, int, float, float] | None:
    """Return the first and last row of the steady part of a test, the mean force over the
    extension `along` in it, and its deviation; None if no part of it is steady.

    It lasts to the last row in which the force reaches its own median, from the first one, or, if
    a greater force starts the tear, from where the force has fallen to the median. What follows the
    last row with half of the greatest force is no part of the test.
    """
    if not (np.diff(along) >= 0).all() or not np.ptp(along) > 0:
        along = np.arange(len(force), dtype=float)
    level = force.max() / 2
    if not level > 0:
        return None
    first, last = np.flatnonzero(force >= level)[[0, -1]]
    least = LEAST_STEADY * (along[last] - along[0])
    shares = np.gradient(along) if len(along) > 1 else np.zeros(1)
    while along[last] - along[first] >= max(least, np.finfo(float).tiny):
        part, places = force[first : last + 1], along[first : last + 1]
        order = np.argsort(part)
        below = np.cumsum(shares[first : last + 1][order])
        median = part[order][np.searchsorted(below, below[-1] / 2)]
        if median <= level:
            length = places[-1] - places[0]
            mean = float(np.trapezoid(part, places) / length)
            deviation = np.sqrt(np.trapezoid((part - mean) ** 2, places) / length)
            return int(first), int(last), mean, float(deviation)
        level = median
        first, last = np.flatnonzero(force >= level)[[0, -1]]
        over = np.append(force[first + 1 :] > level, False)
        first = min(first + int(over.argmin()) + bool(over[0]), len(force) - 1)
    return None


def cut_strip(readings: Readings, specimen: Specimen) -> list[Tear]:
    """Return the tear of a strip with a long cut in pure shear, which grows at the greatest force:
    none if it does not, with a remark.
    """
    at_break, height = specimen.at_break, readings.size("gauge length")
    if height is None:
        readings.missing.append("the height between the grips: --gauge-length '20 mm'")
        return []
    if at_break is None or at_break.no_strength:
        readings.assumed.append(f"{specimen.name}: the cut does not grow: no tearing energy")
        return []
    return [Tear(specimen.name, SHEAR_TEAR, height, at_break.nominal_stress, at_break.stretch)]
