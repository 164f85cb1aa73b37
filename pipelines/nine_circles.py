"""Tests of the elastomer of "Nine circles of elastic brittle fracture" (Kamarei, Zeng, Dolbow,
Lopez-Pamies 2025, arXiv 2507.00266): where it breaks, against closed and asymptotic results.

python pipelines/nine_circles.py        measures all; --help names other uses

Lengths in mm, stresses in MPa. All tears are slow, with bond-energy.
"""

import math

import numpy as np
import scipy
from cases import of_rows, percent, report

import pdsurrogate as pds
from pdsurrogate.materials import PLANES, homogeneous

MU, LAME, ENERGY, UNIAXIAL, HYDROSTATIC = 0.52, 85.8, 0.041, 0.3, 1.0
"""Published: shear modulus, Lame's second constant, tearing energy, and two strengths."""

LAW = pds.materials.NeoHookean(MU, LAME + 2 * MU / 3)
EQUIBIAXIAL = 3 * HYDROSTATIC * UNIAXIAL / (3 * HYDROSTATIC + UNIAXIAL)
FRACTURE = {
    "energy": ENERGY,
    "strength": {"uniaxial": UNIAXIAL, "hydrostatic": HYDROSTATIC},
}
YOUNG = 9 * LAW.bulk_modulus * MU / (3 * LAW.bulk_modulus + MU)


def torn(size, spacing, **keys):
    """The summary of a slow tear of a rectangle or a box."""
    base = {"name": "circle", "spacing": spacing, "material": LAW.describe(), "fracture": FRACTURE}
    shape = "box" if len(size) == 3 else "rectangle"
    ratio = 1.75 if len(size) == 3 else 2.2
    base |= {"body": {"shape": shape, "size": size}, "horizon_ratio": ratio}
    return pds.simulate(pds.Scene.model_validate(base | keys), "bond-energy", threads=1).summary


def stretch_at(stress_at, stress):
    """The stretch at which a law has a nominal stress."""
    return scipy.optimize.brentq(lambda one: stress_at(one) - stress, 1 + 1e-9, 3.0)


def hydrostatic(stretch):
    """Nominal stress in equal tension in all directions."""
    return PLANES["space"].first_piola_stress(LAW, stretch * np.eye(3))[0, 0]


UNIFORM = {
    "uniaxial": (1, lambda one: homogeneous.uniaxial(LAW, one).nominal_stress, UNIAXIAL),
    "equibiaxial": (2, lambda one: homogeneous.equibiaxial(LAW, one).nominal_stress, EQUIBIAXIAL),
    "hydrostatic": (3, hydrostatic, HYDROSTATIC),
}
"""Number of directions in which a body is pulled, its nominal stress by the stretch, and strength.
"""

SIDES = [("left", "right"), ("bottom", "top"), ("back", "front")]


def uniform(state, spacing, dimension):
    """A square or a cube between rollers, pulled by its sides."""
    pulled, stress_at, strength = UNIFORM[state]
    side = 0.9 if dimension == 2 else 0.75
    travel = side * (stretch_at(stress_at, strength) - 1)
    conditions = []
    for axis in range(dimension):
        name = f"x{axis + 1}"
        conditions.append({"region": SIDES[axis][0], name: 0.0})
        if axis < pulled:
            conditions.append({"region": SIDES[axis][1], name: 1.0})
    ends = [0.93 * travel, {"to": 1.1 * travel, "outputs": 2}]
    summary = torn(dimension * [side], spacing, prescribed=conditions, steps=ends)
    start = summary["crack"]["start"]
    found = float(stress_at(1 + start["t"] / side))
    yield state, dimension, spacing, start["cause"], found, strength, percent(found, strength)


CLAMPS = [{"edge": "bottom"}, {"edge": "top", "travel": 1.0}]
ROLLERS = [{**one, "holds": "normal"} for one in CLAMPS]


def pure_shear(height, spacing, **keys):
    """A long cut in a strip between clamps: W h of the uncut part at the peak."""
    size = [2.6 * height, height]
    cut = [{"start": [-1, height / 2], "end": [1.1 * height, height / 2]}]

    def rate(stretch):
        return height * homogeneous.pure_shear(LAW, stretch).energy_density

    grown = stretch_at(rate, ENERGY)
    ends = [1 + 0.8 * (grown - 1), 1 + 1.1 * (grown - 1)]
    summary = torn(size, spacing, precuts=cut, grips=CLAMPS, stretches=ends, **keys)
    yield result("pure shear", height, spacing, summary, rate(summary["crack"]["peak"]["stretch"]))


def result(name, size, spacing, summary, found):
    """A row of a test against Griffith."""
    name += "" if "strength" in summary else ", no strength"
    crack = summary["crack"]
    gap = summary["quasi_static"]["greatest_energy_gap"]
    return name, size, spacing, crack["start"].get("cause"), found, percent(found, ENERGY), gap


def cantilever(height, spacing, **fracture):
    """Two arms moved apart: G of the elastic body with the same cut at the opening at which the
    load is greatest.
    """
    size = [2.5 * height, height]
    half = height / 2
    off = half - spacing / 4
    keys = {
        "precuts": [{"start": [-1, half], "end": [height, half]}],
        "regions": {
            "up": {"box": [[-0.1, height - off], [0.2 * height, 2 * height]]},
            "down": {"box": [[-0.1, -0.1], [0.2 * height, off]]},
        },
        "prescribed": [
            {"region": "up", "x1": 0.0, "x2": 1.0},
            {"region": "down", "x1": 0.0, "x2": -1.0},
        ],
    }
    ends = [0.05 * height, {"to": 0.3 * height, "outputs": 5}]
    summary = torn(size, spacing, steps=ends, **keys, **fracture)
    opening = summary["crack"]["peak"]["t"]
    base = {"name": "elastic", "spacing": spacing, "material": LAW.describe(), "steps": [opening]}
    base |= {"body": {"shape": "rectangle", "size": size}, "horizon_ratio": 2.2, **keys}
    elastic = pds.simulate(pds.Scene.model_validate(base), "bond-energy", threads=1)
    rates = elastic.levels[-1]["cracks"][0]["energy_release_rate"]
    yield result("double cantilever", height, spacing, summary, rates)


GRIFFITH = [
    ("pure shear", 5.3, 0.1325),
    ("pure shear, no strength", 5.3, 0.1325),
    ("pure shear", 5.3, 0.06625),
    ("pure shear, no strength", 5.3, 0.06625),
    ("double cantilever", 6.0, 0.13),
    ("double cantilever, no strength", 6.0, 0.13),
]
"""Name, height and spacing of tests of long cuts."""


def griffith(name, *given):
    """A row of a test by its name."""
    keys = {"fracture": {"energy": ENERGY}} if name.endswith("no strength") else {}
    return (pure_shear if name.startswith("pure") else cantilever)(*given, **keys)


def notched(length, spacing):
    """An edge cut in tension: nominal stress at the peak, Griffith's for small strains (with
    Tada's factor) and the strength.
    """
    side = max(4 * length, 1.6)
    part = length / side
    factor = math.sqrt(2 / (math.pi * part) * math.tan(math.pi * part / 2))
    factor *= 0.752 + 2.02 * part + 0.37 * (1 - math.sin(math.pi * part / 2)) ** 3
    factor /= math.cos(math.pi * part / 2)
    griffith = math.sqrt(YOUNG * ENERGY / (math.pi * length)) / factor
    cut = [{"start": [-1, side / 2], "end": [length, side / 2]}]
    least = stretch_at(
        lambda one: homogeneous.uniaxial(LAW, one).nominal_stress, 0.6 * min(griffith, UNIAXIAL)
    )
    summary = torn([side, side], spacing, precuts=cut, grips=ROLLERS, stretches=[least, 1.4])
    peak = summary["crack"]["peak"]["nominal_stress"]
    length_c = summary["strength"][0]["length"]
    gap = summary["quasi_static"]["greatest_energy_gap"]
    start = summary["crack"]["start"]["cause"]
    yield length / length_c, spacing, start, peak, griffith, UNIAXIAL * (1 - part), gap


if __name__ == "__main__":
    gap = "energy error (%): +.2f"
    first, spacing = "first bond by", "spacing: g"
    errors = "error (%): +.1f"
    report(
        __doc__,
        of_rows(
            "circles-uniform",
            uniform,
            [(state, one, 2) for state in ("uniaxial", "equibiaxial") for one in (0.1, 0.05)]
            + [(state, 0.125, 3) for state in UNIFORM],
            *("state", "dimension: d", spacing, first),
            *("nominal stress at break: .4f", "strength: .4f", errors),
        ),
        of_rows(
            "circles-griffith",
            griffith,
            GRIFFITH,
            *("test", "height: g", spacing, first, "G: .4f", errors, gap),
        ),
        of_rows(
            "circles-notch",
            notched,
            [(0.11, 0.055), (0.33, 0.11), (1.1, 0.11), (3.3, 0.11)],
            *("cut (l_c): .2f", spacing, first, "nominal stress at the peak: .4f"),
            *("Griffith: .4f", "strength of the ligament: .4f", gap),
        ),
    )
