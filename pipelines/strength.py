"""Sheets with and without cuts in tension, of a material with a strength and a tearing energy:
stretch at the peak of the load against the cut's length, the spacing and the force.

python pipelines/strength.py            measures all tears; --help names other uses

Lengths are in l_c = G / W_b, of a neo-Hookean sheet that breaks at a stretch of 4. Grips are
rollers, so that a sheet without a cut is in uniaxial tension. On one core of 2 GHz all tears take
some 20 minutes.
"""

from cases import of_rows, report

import pdsurrogate as pds
from pdsurrogate.materials import homogeneous

BULK, BREAK = 20.0, 4.0
WORK = homogeneous.uniaxial(pds.materials.NeoHookean(1.0, BULK), BREAK).energy_density

UNCUT = [
    ("bond-energy", "lattice", 2.2, 0.18),
    ("bond-energy", "lattice", 2.2, 0.09),
    ("bond-energy", "lattice", 2.2, 0.045),
    ("bond-energy", "lattice", 3.0, 0.09),
    ("bond-energy", "relaxed", 2.2, 0.09),
    ("neo-hookean", "lattice", 2.2, 0.09),
]
"""Force, arrangement of the points, horizon in spacings, and spacing of sheets without a cut."""

CUTS = [
    (0.1, 0.1, 3.6),
    (0.1, 0.05, 3.6),
    (0.2, 0.1, 3.2),
    (0.2, 0.05, 3.2),
    (0.5, 0.18, 2.5),
    (0.5, 0.09, 2.5),
    (0.5, 0.06, 2.5),
    (1.0, 0.18, 1.9),
    (1.0, 0.09, 1.9),
    (2.0, 0.18, 1.5),
]
"""Length of the cut, spacing, and stretch at which the search for the first bond begins."""

FINITE_ELEMENTS = {
    0.1: (None, 3.87, 3.86),
    0.2: (None, 3.59, 3.68),
    0.5: (3.11, 2.87, 2.87),
    1.0: (2.34, 2.29, 2.26),
    2.0: (1.85, 1.84, 1.82),
}
"""Stretch at break of an edge cut in a wide incompressible sheet by Griffith's law, by the rule,
and by the coupled criterion, from finite elements, by the length of the cut.
"""


def sheet(spacing, size, stretches, **changes):
    """The summary of a slow tear."""
    scene = {
        "name": "sheet",
        "spacing": spacing,
        "stretches": stretches,
        "body": {"shape": "rectangle", "size": size},
        "material": {"law": "neo-hookean", "shear_modulus": 1.0, "bulk_modulus": BULK},
        "grips": [
            {"edge": "bottom", "holds": "normal"},
            {"edge": "top", "holds": "normal", "travel": 1.0},
        ],
        "fracture": {"energy": WORK, "strength": {"stretch": BREAK}},
    }
    force = changes.pop("force", "bond-energy")
    body = scene["body"] | changes.pop("body", {})
    scene = pds.Scene.model_validate(scene | {"body": body} | changes)
    return pds.simulate(scene, force).summary


def uncut(force, arrangement, horizon, spacing):
    """A sheet without a cut: stretch at the first broken bond over that at break."""
    body = {"arrangement": arrangement} | ({"seed": 1} if arrangement == "relaxed" else {})
    where = {"force": force, "body": body, "horizon_ratio": horizon}
    found = sheet(spacing, [1.3, 1.3], [3.8, 4.2], **where)
    start = found["crack"]["start"]
    radius = found["strength"][0]["radius_in_spacings"]
    gap = found["quasi_static"]["greatest_energy_gap"]
    peak = start["cause"], start["stretch"] / BREAK, gap
    yield force, arrangement, horizon, spacing, radius, *peak


def torn(length, spacing, start, side, **changes):
    """A slow tear of a square sheet with an edge cut."""
    cuts = [{"start": [-1.0, side / 2], "end": [length, side / 2]}]
    return sheet(spacing, [side, side], [start, 1.2 * BREAK], precuts=cuts, **changes)


def cut(length, spacing, start):
    """An edge cut: stretch at the peak of the load, and what broke the first bond."""
    found = torn(length, spacing, start, 10 * max(length, 0.3))
    crack = found["crack"]
    gap = found["quasi_static"]["greatest_energy_gap"]
    peak = crack["start"]["cause"], crack["peak"]["stretch"]
    yield length, spacing, *peak, *FINITE_ELEMENTS[length], gap


if __name__ == "__main__":
    columns = "force", "points", "horizon (spacings): g", "spacing (l_c): g", "R (spacings): .1f"
    cuts = "cut (l_c): g", "spacing (l_c): g"
    first, gap = "first bond by", "energy error (%): +.2f"
    at_peak = "stretch at the peak: .3f"
    elements = "Griffith: .2f", "rule: .2f", "coupled criterion: .2f"
    report(
        __doc__,
        of_rows("strength-uncut", uncut, UNCUT, *columns, first, "over break: .3f", gap),
        of_rows("strength-cuts", cut, CUTS, *cuts, first, at_peak, *elements, gap),
    )
