"""Energy release rates of cracks against theory: strip in pure shear, central crack, edge notch,
trouser tears and disc crack.

python pipelines/energy_release.py                       all parts
python pipelines/energy_release.py rate-strip rate-plate  some of them

On one core of 2 GHz all parts take some 25 minutes, 18 of them the trouser tears.
"""

from functools import cache

import numpy as np
from cases import listed, of_rows, percent, plane_strain_modulus, report, scene_of

import pdsurrogate as pds
from pdsurrogate.materials import homogeneous


def rate(level):
    """G of the only crack at an output."""
    (crack,) = level["cracks"]
    return crack["energy_release_rate"]


def strip(points):
    """A long crack in a clamped strip releases W h."""
    scene = scene_of("rate-strip", {"spacing": 2.0 / points})
    levels, law = pds.simulate(scene, "bond-energy").levels, scene.material.build()
    exact = [2 * homogeneous.pure_shear(law, level["stretch"]).energy_density for level in levels]
    yield points, *(percent(rate(level), g) for level, g in zip(levels, exact, strict=True))


def plate(plane, bulk, points):
    """Half of a plate with a central crack at small strain, against linear fracture mechanics."""
    changes = {"spacing": 1 / points, "plane": plane, "material.bulk_modulus": bulk}
    (level,) = pds.simulate(scene_of("rate-plate", changes), "bond-energy").levels
    modulus = 9 * bulk / (3 * bulk + 1) if plane == "stress" else plane_strain_modulus(1.0, bulk)
    exact = (level["forces"]["top"][1] / 4) ** 2 * np.pi / modulus / np.cos(np.pi / 8)
    yield f"plane {plane}, K = {bulk:g} μ", points, percent(rate(level), exact)


def notch(plane, bulk):
    """An edge notch of a fifth of the width, against differences of the energy."""
    spacing, levels = 0.02, []
    for step in (-1, 0, 1):
        # A cut that ends between the places where bonds cross it grows by whole spacings.
        changes = {"precuts.0.end.0": 0.402 + step * spacing, "material.bulk_modulus": bulk}
        scene = scene_of("rate-notch", changes | {"plane": plane})
        levels.append(pds.simulate(scene, "bond-energy").levels)
    for shorter, level, longer in zip(*levels, strict=True):
        difference = (shorter["energy"] - longer["energy"]) / (2 * spacing)
        yield f"plane {plane}", level["stretch"], rate(level), percent(rate(level), difference)


LEG, THICKNESS = 8.0, 2.0
"""Width of a leg of the trouser tear, and thickness, in mm."""


@cache
def torn(ratio, spacing, critical, length, begin, end, speed, steady):
    """A run of `TEARS`."""
    dynamics = {"duration": (end - begin) / speed, "density": 1e-3}
    dynamics |= {"damping": 0.1, "viscosity": 0.002}
    changes = {
        "spacing": spacing,
        "horizon_ratio": ratio,
        "body.size": [length, 2 * LEG, THICKNESS],
        "fracture": {"critical_stretch": critical},
        "steps": [{"to": begin}, {"to": end, "outputs": 40, "dynamics": dynamics}],
    }
    return pds.simulate(pds.load_scene("trousers", changes))


def along_the_tear():
    """G along the trouser tear, and the formula of Rivlin and Thomas."""
    result = torn(*TEARS[0])
    law = result.scene.material.build()
    for begin, end in ((17.8, 21.1), (21.1, 24.5), (24.5, 28.1)):
        levels = [level for level in result.levels if begin < level["t"] < end]
        force = float(np.mean([level["forces"]["one"][2] for level in levels]))
        found, ends = [rate(level) for level in levels], (levels[0], levels[-1])
        yield (
            "{:.1f} to {:.1f}".format(*(level["t"] for level in ends)),
            "{:.1f} to {:.1f}".format(*(level["cracks"][0]["length"] for level in ends)),
            np.mean(found),
            np.std(found, ddof=1),
            pds.tearing_energy(law, force, LEG, THICKNESS),
        )


def trousers(*tear):
    """Energy of a trouser tear by the force on its legs, and the diameter of the tip in
    psi(critical stretch) d.
    """
    (ratio, spacing, critical, *_, steady), result = tear, torn(*tear)
    law, horizon = result.scene.material.build(), result.body.horizon
    # In the last row the legs come to a halt.
    rows = [row for row in result.history if "time" in row][:-1]
    force = float(np.mean([row["force_one_3"] for row in rows if row["t"] > steady]))
    found = pds.tearing_energy(law, force, LEG, THICKNESS)
    tips = [entry["tip"][1] for entry in result.summary["crack"]["tips"] if entry["tip"]]
    diameter = found / homogeneous.uniaxial(law, critical).energy_density / horizon
    gap, stray = result.summary["dynamics"][-1]["greatest_energy_gap"], np.subtract(tips, LEG)
    size = len(result.body), result.summary["n_steps"]
    figures = force, found, diameter, np.abs(stray).max(), gap
    yield ratio, spacing, critical, *figures, *size


TEARS = listed("trousers")
"""Horizon and spacing, critical stretch, length of the strip, travels of the legs between which it
is torn, their speed (mm/ms), and the travel from which on the force is averaged: the legs are
straight, and the tear goes on.
"""

OPENED = 1.0350
"""Volume of the opened disc of the scene `penny` over Sneddon's in an endless body at the same mean
stress, by axisymmetric finite elements of nine nodes on half of the cylinder, graded toward the
edge of the crack: 1.0315, 1.0344 and 1.0350 on finer and finer meshes.
"""


def penny(points):
    """Volume of the opened disc, by what it takes off the force, over that of linear elasticity."""
    scene = pds.load_scene("penny", {"spacing": 1 / points})
    law, stretch, radius = scene.law(), scene.stretches[0], scene.precuts[0].radius
    uncut = homogeneous.uniaxial(law, stretch).nominal_stress
    stress = pds.simulate(scene).levels[-1]["nominal_stress"]
    area = np.pi * scene.body.radius**2
    volume = (1 - stress / uncut) * (stretch - 1) * scene.body.length * area
    modulus = plane_strain_modulus(law.shear_modulus, law.bulk_modulus)
    free = 16 * stress * radius**3 / (3 * modulus)
    grown = ((volume / free / OPENED) ** (1 / 3) - 1) * radius * points
    yield 1 / points, stress / uncut, volume / free, volume / free / OPENED, grown


NOTCHES = [("stress", 100.0), ("strain", 20.0)]
PLATES = [("stress", 2.0, 10), ("stress", 2.0, 20), ("strain", 20.0, 10), ("strain", 20.0, 20)]

if __name__ == "__main__":
    report(
        __doc__,
        of_rows("rate-strip", strip, (20, 40, 80)),
        of_rows("rate-plate", plate, PLATES),
        of_rows("rate-notch", notch, NOTCHES),
        of_rows("rate-trousers", along_the_tear),
        of_rows("trousers", trousers, TEARS),
        of_rows("penny", penny, (10, 15, 20)),
    )
