"""Tests of the elastomer of "Nine circles of elastic brittle fracture" (Kamarei, Zeng, Dolbow,
Lopez-Pamies 2025, arXiv 2507.00266): where it breaks, against closed and asymptotic results.

python pipelines/nine_circles.py        measures all; --help names other uses

Lengths in mm, stresses in MPa. All tears are slow, with bond-energy.
"""

import math
import time

import numpy as np
import scipy
from cases import (
    CLAMPS,
    ROLLERS,
    drawing,
    ending_at,
    listed,
    of_rows,
    percent,
    report,
    rows_of,
    stored,
)

import pdsurrogate as pds
from pdsurrogate.materials import PLANES, homogeneous
from pdsurrogate.materials.tearing import stretch_at_stress
from pdsurrogate.run.run import Run

MU, LAME, ENERGY, UNIAXIAL, HYDROSTATIC = 0.52, 85.8, 0.041, 0.3, 1.0
"""Published: shear modulus, Lame's second constant, tearing energy, and two strengths."""

LAW = pds.materials.NeoHookean(MU, LAME + 2 * MU / 3)
EQUIBIAXIAL = 3 * HYDROSTATIC * UNIAXIAL / (3 * HYDROSTATIC + UNIAXIAL)
FRACTURE = {
    "energy": ENERGY,
    "strength": {"uniaxial": UNIAXIAL, "hydrostatic": HYDROSTATIC},
}
LENGTH = ENERGY / homogeneous.uniaxial(LAW, stretch_at_stress(LAW, UNIAXIAL)).energy_density


PAST_PEAK = 60
"""Broken bonds at which a tear ends: those of 12 spacings along a row of a sheet."""


def run(size, spacing, **keys):
    """The result of a rectangle or a box."""
    base = {"name": "circle", "spacing": spacing, "material": LAW.describe(), **keys}
    shape = "box" if len(size) == 3 else "rectangle"
    base |= {"body": {"shape": shape, "size": size}}
    return pds.simulate(pds.Scene.model_validate(base), "bond-energy", threads=1)


def torn(size, spacing, fracture=FRACTURE, **keys):
    """The summary of a slow tear."""
    ratio = 1.75 if len(size) == 3 else 2.2
    with ending_at(PAST_PEAK):
        return run(size, spacing, fracture=fracture, horizon_ratio=ratio, **keys).summary


def elastic(size, spacing, **keys):
    """The last output of the elastic body, and its energy release rate."""
    level = run(size, spacing, horizon_ratio=2.2, **keys).levels[-1]
    return level, level["cracks"][0]["energy_release_rate"]


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


def pure_shear(height, spacing, **keys):
    """A long cut in a strip between clamps: W h of the uncut part at the peak."""
    size = [2.6 * height, height]
    cut = [{"start": [-1, height / 2], "end": [1.1 * height, height / 2]}]

    def released(stretch):
        return height * homogeneous.pure_shear(LAW, stretch).energy_density

    grown = stretch_at(released, ENERGY)
    ends = [1 + 0.8 * (grown - 1), 1 + 1.1 * (grown - 1)]
    summary = torn(size, spacing, precuts=cut, grips=CLAMPS, stretches=ends, **keys)
    found = released(summary["crack"]["peak"]["stretch"])
    yield result(height, spacing, summary, found)


def result(size, spacing, summary, found):
    """A row of a test against Griffith."""
    crack = summary["crack"]
    gap = summary["quasi_static"]["greatest_energy_gap"]
    return size, spacing, crack["start"].get("cause"), found, percent(found, ENERGY), gap


def arms(height, spacing, length):
    """Keys of two arms with a cut of a length, moved apart."""
    half = height / 2
    off = half - spacing / 4
    return {
        "precuts": [{"start": [-1, half], "end": [length, half]}],
        "regions": {
            "up": {"box": [[-0.1, height - off], [0.2 * height, 2 * height]]},
            "down": {"box": [[-0.1, -0.1], [0.2 * height, off]]},
        },
        "prescribed": [
            {"region": "up", "x1": 0.0, "x2": 1.0},
            {"region": "down", "x1": 0.0, "x2": -1.0},
        ],
    }


def cantilever(height, spacing, **fracture):
    """Two arms moved apart: G of the elastic body with the force and the opening at which the force
    is greatest. Its cut, which gives both, is longer than that of the torn body, since the crack
    has grown by some spacings.
    """
    size = [2.5 * height, height]
    ends = [0.05 * height, {"to": 0.3 * height, "outputs": 5}]
    summary = torn(size, spacing, steps=ends, **arms(height, spacing, height), **fracture)
    peak = summary["crack"]["peak"]
    logs = []
    for length in (height, height + 4 * spacing):
        level, rate = elastic(size, spacing, steps=[peak["t"]], **arms(height, spacing, length))
        logs.append(np.log([level["forces"]["up"][1], rate]))
    # force and G are nearly powers of the length
    (force, rate), slope = logs[0], np.subtract(*logs)
    part = (math.log(peak["force"]) - force) / slope[0]
    yield result(height, spacing, summary, math.exp(rate + part * slope[1]))


def trousers(leg, spacing):
    """Legs three points thick, of a width and four times as long as what bends of them, pulled
    apart out of their plane: G by the mean force once the tear runs (Rivlin and Thomas).
    """
    thickness = 3 * spacing
    bend = thickness * math.sqrt(3 * MU * leg / (6 * ENERGY))  # of a beam that bears G h / 2
    length = round(4 * bend / spacing) * spacing
    cut = {"corner": [-1.0, leg, -1.0], "sides": [[1 + length, 0.0, 0.0], [0.0, 0.0, 3.0]]}
    supports = [{"region": side, "x2": 0.0} for side in SIDES[1]] + [{"region": "right", "x1": 0.0}]
    regions = {}
    for name, low, way in (("one", 0.0, 1.0), ("two", leg, -1.0)):  # a row across the end of a leg
        ends = [[0.0, low, 1.2 * spacing], [0.6 * spacing, low + leg, 1.8 * spacing]]
        regions[name] = {"box": ends}
        supports.append({"region": name, "x3": way})
    steps = [0.8 * length, {"to": length + 14 * spacing, "outputs": 10}]
    keys = {"precuts": [cut], "regions": regions, "prescribed": supports, "steps": steps}
    size = [length + 22 * spacing, 2 * leg, thickness]
    tear = run(size, spacing, fracture=FRACTURE, horizon_ratio=2.2, **keys)
    rows = [(row["t"], row["force_one_3"]) for row in tear.history]
    travel, force = np.transpose([row for row in rows if row[0] > length + 5 * spacing])
    mean = np.trapezoid(force, travel) / np.ptp(travel)
    found = pds.tearing_energy(LAW, mean, leg, thickness)
    yield result(leg, spacing, tear.summary, found)


GRIFFITH = listed("griffith")
"""Name, height (of trousers the width of a leg) and spacing of tests of long cuts."""


def griffith(name, *given):
    """A row of a test by its name."""
    keys = {"fracture": {"energy": ENERGY}} if name.endswith("no strength") else {}
    test = {"pure shear": pure_shear, "trousers": trousers}.get(name.split(",")[0], cantilever)
    for row in test(*given, **keys):
        yield name, *row


def cost(turns, spacing):
    """Processor time of a tear with two strengths, over that of the same without, in turn."""
    ratios = []
    for _ in range(turns + 1):  # the first one compiles
        times = []
        for fracture in (FRACTURE, {"energy": ENERGY}):
            began = time.process_time()
            list(pure_shear(5.3, spacing, fracture=fracture))
            times.append(time.process_time() - began)
        ratios.append(times[0] / times[1])
    yield (
        "pure shear",
        spacing,
        turns,
        min(ratios[1:]),
        float(np.median(ratios[1:])),
        max(ratios[1:]),
    )


def notched(plane, length, spacing):
    """An edge cut between rollers: nominal stress at the peak, that at which the elastic body has
    the tearing energy, by the square, and the strength of the ligament.
    """
    side = max(min(4 * length, 22.0), 1.6)
    keys = {
        "precuts": [{"start": [-1, side / 2], "end": [length, side / 2]}],
        "grips": ROLLERS,
        "plane": plane.split(",")[0],
    }
    fracture = {"energy": ENERGY} if "no strength" in plane else FRACTURE
    start = stretch_at(UNIFORM["uniaxial"][1], 0.04 / math.sqrt(max(length, 0.1)))
    summary = torn([side, side], spacing, stretches=[start, 1.4], fracture=fracture, **keys)
    peak = summary["crack"]["peak"]
    fine = min(spacing, length / 8)  # a shorter one has no region around its tip
    _, released = elastic([side, side], fine, stretches=[peak["stretch"]], **keys)
    griffith = peak["nominal_stress"] * math.sqrt(ENERGY / released)
    gap = summary["quasi_static"]["greatest_energy_gap"]
    cause = summary["crack"]["start"].get("cause")
    part = UNIAXIAL * (1 - length / side)
    yield plane, length / LENGTH, spacing, cause, peak["nominal_stress"], griffith, part, gap


def first(name, spacing, state, at_first, found):
    """A row of a test whose first bond breaks by strength somewhere: what the exact fields give
    for the state there, and what was found.
    """
    start = state["crack"]["start"]
    gap = state["quasi_static"]["greatest_energy_gap"]
    return name, spacing, start["cause"], start["x"], found, at_first, percent(found, at_first), gap


def equivalent(stresses):
    """The uniaxial stress as near to break as principal nominal stresses."""
    share = UNIAXIAL / (3 * HYDROSTATIC)
    stresses = np.asarray(stresses)
    mises = math.sqrt(1.5 * np.square(stresses - stresses.mean()).sum())
    return (1 - share) * mises + share * stresses.sum()


CHIP = 0.0231
"""Strain at which the middle of the bonded strip reaches the surface, by finite elements (FElupe
11.3.0, 70 x 14 biquadratic elements; 0.0229 with 30 x 6, 0.0231 with 50 x 10).
"""


def chip(width, height, spacing):
    """Half of a strip in plane strain, bonded to plates: strain at the first break."""
    strength = {**FRACTURE["strength"], "at_grips": False}
    keys = {
        "plane": "strain",
        "fracture": {**FRACTURE, "strength": strength},
        "prescribed": [
            {"region": "left", "x1": 0.0},
            {"region": "bottom", "x1": 0.0, "x2": 0.0},
            {"region": "top", "x1": 0.0, "x2": height},
        ],
    }
    steps = [0.5 * CHIP, {"to": 1.6 * CHIP, "outputs": 4}]
    found = torn([width / 2, height], spacing, steps=steps, **keys)
    yield first(
        "poker chip, plane strain: strain", spacing, found, CHIP, found["crack"]["start"]["t"]
    )


def rod(radius, length, spacing):
    """A rod in simple torsion of an incompressible material, no equilibrium: shear at the surface
    at which a ball has the strength, and that at which the surface has it.
    """

    def load(shear):
        squares, stress = 1 + shear**2 / 2 + shear * math.sqrt(1 + shear**2 / 4), []
        for square in (squares, 1 / squares, 1.0):
            stress.append(MU * (square - 1) / math.sqrt(square))
        return equivalent(stress)

    expected = scipy.optimize.brentq(lambda one: load(one) - UNIAXIAL, 1e-6, 2.0)
    held = {"region": {"box": [[-9, -9, -1], [9, 9, spacing]]}, "x1": 0.0, "x2": 0.0, "x3": 0.0}
    scene = {"name": "rod", "spacing": spacing, "material": LAW.describe(), "steps": [1.0]}
    scene |= {"body": {"shape": "cylinder", "radius": radius, "length": length}}
    scene |= {"prescribed": [held], "loads": [{"region": "front", "pressure": 0.01}]}
    scene = pds.Scene.model_validate(scene | {"fracture": FRACTURE, "horizon_ratio": 1.75})
    run = Run(scene, [pds.load_surrogate("bond-energy")])
    x, y, z = run.body.points.T

    def greatest(shear):
        angle = shear / radius * z
        turned = (x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z)
        run.force.place(np.stack(turned, axis=1))
        return run.damage.greatest_load(run.force)

    found = scipy.optimize.brentq(
        lambda one: greatest(one) - 1, 0.8 * expected, 1.4 * expected, xtol=1e-4
    )
    yield (
        f"torsion, radius {radius:g}: shear",
        spacing,
        "strength",
        None,
        found,
        expected,
        percent(found, expected),
        None,
    )


def fields(name, *given):
    """A row of a test by its name."""
    return (chip if name == "chip" else rod)(*given)


def draw(axes):
    """Stress at the peak against the length of the notch."""
    rows = [row[1:] for row in rows_of(stored("circles-notch")) if row[0] == "stress"]
    lengths, _, _, found, griffith, strength, _ = zip(*rows, strict=True)
    axes.loglog(lengths, found, "o-", label="found")
    axes.loglog(lengths, [one or np.nan for one in griffith], "--", label="Griffith")
    axes.loglog(lengths, strength, ":", label="strength of the ligament")
    axes.set(xlabel="length of the notch / l_c", ylabel="nominal stress at the peak (MPa)")


if __name__ == "__main__":
    pulled = [(state, one, 2) for state in ("uniaxial", "equibiaxial") for one in (0.1, 0.05)]
    pulled += [(state, 0.125, 3) for state in UNIFORM]
    report(
        __doc__,
        of_rows("circles-uniform", uniform, pulled),
        of_rows("circles-griffith", griffith, GRIFFITH),
        of_rows("circles-cost", cost, [(5, 0.1325)]),
        of_rows("circles-fields", fields, listed("circles")),
        of_rows("circles-notch", notched, listed("notched circles")),
    )
    with drawing("nine-circles", (4.5, 3.2)) as axes:
        draw(axes)
