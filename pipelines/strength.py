"""Sheets without cuts, with cuts, holes and notches in tension, of a material with a strength and a
tearing energy: stretch at break against length, spacing and force.

python pipelines/strength.py            measures all tears; --help names other uses

Lengths are in l_c = G / W_b, of a neo-Hookean sheet that breaks at a stretch of 4. Grips are
rollers, so that a sheet without a cut is in uniaxial tension. Tears end past their peak. On one
core of 2 GHz all take some two hours, half an hour of it the finite elements.
"""

from functools import partial

import numpy as np
import strength_elements as elements
from cases import (
    CLAMPS,
    ROLLERS,
    Study,
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
from pdsurrogate.materials import homogeneous
from pdsurrogate.problem.tip_factor import factor_of

BULK, BREAK = elements.BULK, 4.0
LAW = pds.materials.NeoHookean(1.0, BULK)
WORK = homogeneous.uniaxial(LAW, BREAK).energy_density
RADIUS = factor_of(LAW, BREAK, "stress") / np.pi
"""Radius of the discs."""

UNCUT = listed("uncut sheets")
"""Force, arrangement of the points, horizon in spacings, and spacing of sheets without a cut."""

CUTS = {length: case for length, *case in listed("cuts")}
"""By length of an edge cut, sides of the sheet, stretch near the break, and columns of points that
the cut separates, at several spacings.
"""

HOLES = {radius: case for radius, *case in listed("holes")}
"""By radius of a hole, side of the sheet, stretch near the break, and spacings."""

NOTCHES = {radius: case for radius, *case in listed("notches")}
"""By radius of the round end of a notch, stretch near the break, and spacings."""
DEEP, WIDE = 3.0, 12.0
"""Depth of the notches, and sides of their sheets."""


def sheet(spacing, size, stretches, **changes):
    """The summary of a slow tear."""
    scene = {
        "name": "sheet",
        "spacing": spacing,
        "horizon_ratio": 2.2,
        "stretches": stretches,
        "body": {"shape": "rectangle", "size": size},
        "material": LAW.describe(),
        "grips": ROLLERS,
        "fracture": {"energy": WORK, "strength": {"stretch": BREAK}},
    }
    if "steps" in changes:
        del scene["grips"], scene["stretches"]
    force = changes.pop("force", "bond-energy")
    body = scene["body"] | changes.pop("body", {})
    with ending_at(max(12, round(1 / spacing))):
        scene = pds.Scene.model_validate(scene | {"body": body} | changes)
        result = pds.simulate(scene, force, threads=1)
    return result.summary if scene.fracture else result.levels[-1]


def figures_of(found):
    """What broke the first bond, its stretch and that at the peak, and error of the energy in
    percent.
    """
    crack = found["crack"]
    at = (one.get("stretch") or 1 + one["t"] for one in (crack["start"], crack["peak"]))
    return crack["start"].get("cause"), *at, found["quasi_static"]["greatest_energy_gap"]


def uncut(force, arrangement, horizon, spacing):
    """A sheet without a cut: stretch at the first broken bond over that at break."""
    body = {"arrangement": arrangement} | ({"seed": 1} if arrangement == "relaxed" else {})
    where = {"force": force, "body": body, "horizon_ratio": horizon}
    found = sheet(spacing, [1.3, 1.3], [3.8, 4.2], **where)
    radius = found["strength"][0]["radius_in_spacings"]
    cause, first, _, gap = figures_of(found)
    yield force, arrangement, horizon, spacing, radius, cause, first / BREAK, gap


def clamped(spacing):
    """Pure shear between clamps, without strength at them: break over that of pure shear."""
    work = [(one, homogeneous.pure_shear(LAW, one).energy_density) for one in (3.7, 3.8, 3.9, 4.0)]
    expected = float(np.interp(WORK, *np.transpose(work)[::-1]))
    fracture = {"energy": WORK, "strength": {"stretch": BREAK, "at_grips": False}}
    found = sheet(
        spacing, [6.0, 1.5], [0.94 * expected, 1.06 * expected], fracture=fracture, grips=CLAMPS
    )
    cause, first, _, gap = figures_of(found)
    yield spacing, cause, expected, first / expected, gap


def references(kind, length):
    """Finite elements: stretch at break by Griffith's law or the edge's own strength, by the rule,
    and by the coupled criterion.
    """
    if kind == "cut":
        size, near, _ = CUTS[length]
        body = elements.Sheet(elements.cut(length, size, min(0.05, length / 4)))
        tip, inside, cut = length, lambda at: at[:, 0] > 0, length
    elif kind == "hole":
        side, near, _ = HOLES[length]
        nodes = elements.notch(length, length, (side / 2, side), min(0.05, length / 8))
        body, cut = elements.Sheet(nodes, quarter=True), None
        tip, inside = length, lambda at: np.hypot(*at.T) > length
    else:
        near, _ = NOTCHES[length]
        body = elements.Sheet(elements.notch(DEEP, length, (WIDE, WIDE), min(0.05, length / 8)))
        tip, cut = DEEP, None

        def inside(at):
            x, y = at[:, 0] - DEEP + length, np.abs(at[:, 1])
            return (at[:, 0] > 0) & ((x > 0) | (y > length)) & (np.hypot(x, y) > length)

    levels = 1 + (near - 1) * np.array(
        [*([] if cut else [0.55, 0.7]), 0.85, 0.93, 1, 1.08, 1.17, 1.3]
    )
    levels = [*levels[levels < BREAK - 0.01], *([1.002 * BREAK] if levels[-1] > BREAK else [])]
    yield kind, length, *elements.onset(body, tip, levels, WORK, RADIUS, inside, cut)


FACTORS = listed("factors")
"""Plane, law and bulk modulus over the shear modulus of factors."""
BREAKS = (1.05, 1.2, 1.5, 2.0, 3.0, 4.0, 6.0)


def law_of(name, bulk):
    """A law with a shear modulus of 1."""
    return pds.materials.LAWS[name](shear_modulus=1.0, bulk_modulus=bulk)


def factors(plane, name, bulk):
    """Factors c of a law by stretch at break, from finite elements."""
    law = law_of(name, bulk)
    works = np.array([homogeneous.uniaxial(law, one).energy_density for one in BREAKS])
    yield plane, name, bulk, *elements.Tip(bulk, name, plane).factors(works)


def with_differences(figures):
    """Rows of factors with the greatest difference of those of the package."""
    for plane, name, bulk, *found in rows_of(figures):
        own = [factor_of(law_of(name, bulk), one, plane) for one in BREAKS]
        yield plane, name, bulk, *found, max(map(percent, own, found), key=abs)


def acting(columns):
    """By how many spacings an edge cut acts longer than it is drawn: it releases, while it grows by
    a spacing, the energy that finite elements release there.
    """
    size, stretch = CUTS[0.5][0], 1.5
    spacing = size[0] / (8 * columns)
    drawn = np.array([columns - 0.375, columns + 0.625]) * spacing
    lost = -np.diff(
        [
            sheet(
                spacing,
                size,
                [stretch],
                fracture=None,
                precuts=[{"start": [-1.0, size[1] / 2], "end": [one, size[1] / 2]}],
            )["energy"]
            for one in drawn
        ]
    )
    body = elements.Sheet(elements.cut(drawn[0], size, spacing / 16))
    ((x, ahead, free),) = elements.pulled(body, drawn[0], [stretch])
    grown = np.arange(2, 37, 2)
    freed = [elements.released(body, x, ahead[: one + 1], free) for one in grown]
    longer = (body.X[ahead[grown], 0] - drawn[0]) / spacing
    gained = np.interp(longer + 1, longer, freed, right=np.nan) - freed
    yield columns, spacing, float(np.interp(lost[0], gained[gained > 0], longer[gained > 0]))


def reference(kind, length):
    """Figures of `references`, if stored."""
    ((_, _, *found),) = stored("strength-references").get(f"{kind}, {length}", [[None] * 5])
    return found


def with_cut(length, columns, **changes):
    """Spacing of a sheet with an edge cut, which is drawn half a spacing shorter than it acts, and
    the summary of its tear; without fracture, the output at the only stretch.
    """
    size, near, _ = CUTS[length]
    spacing = length / (columns + 0.125)
    size = [2 * round(side / spacing / 2) * spacing for side in size]
    drawn = {"start": [-1.0, size[1] / 2], "end": [length - spacing / 2, size[1] / 2]}
    pull = {"stretches": [1 + 0.88 * (near - 1), 1 + 1.45 * (near - 1)], "precuts": [drawn]}
    pull |= changes
    return spacing, sheet(spacing, size, pull.pop("stretches"), **pull)


def cut(length, columns):
    """An edge cut."""
    spacing, found = with_cut(length, columns)
    yield length, spacing, *figures_of(found)


def compared(length):
    """A cut with a strength and without, and G at the peak over the one prescribed."""
    columns = round(length / 0.178)
    spacing, strong = with_cut(length, columns)
    _, weak = with_cut(length, columns, fracture={"energy": WORK})
    cause, _, peak, _ = figures_of(strong)
    _, _, other, _ = figures_of(weak)
    _, level = with_cut(length, columns, fracture=None, stretches=[peak])
    rate = level["cracks"][0]["energy_release_rate"]  # none where a cut is too short for it
    yield length, spacing, cause, peak, other, percent(peak, other), rate and rate / WORK


def hole(radius, spacing):
    """A quarter of a sheet with a round hole in its middle."""
    side, near, _ = HOLES[radius]
    half = round(side / 2 / spacing) * spacing
    supports = [
        {"region": "left", "x1": 0.0},
        {"region": "bottom", "x2": 0.0},
        {"region": "top", "x2": half},
    ]
    steps = [0.88 * (near - 1), 1.45 * (near - 1)]
    void = [{"shape": "circle", "center": [0.0, 0.0], "radius": radius}]
    where = {"holes": void, "prescribed": supports, "steps": steps}
    found = sheet(spacing, [half, half], [], body={"lower": [0.0, 0.0]}, **where)
    yield radius, spacing, *figures_of(found)


def notch(radius, spacing):
    """Half of a sheet with a notch of a round end."""
    near, _ = NOTCHES[radius]
    size = [round(side / spacing) * spacing for side in (WIDE, WIDE / 2)]
    void = [{"shape": "circle", "center": [DEEP - radius, 0.0], "radius": radius}]
    if radius < DEEP:
        flat = {"lower": [-1.0, -1.0], "size": [1 + DEEP - radius, 1 + radius]}
        void.append({"shape": "rectangle", **flat})
    stretches = [1 + 0.88 * (near - 1), 1 + 1.45 * (near - 1)]
    found = sheet(spacing, size, stretches, body={"lower": [0.0, 0.0]}, holes=void)
    yield radius, spacing, *figures_of(found)


def spacings(shapes):
    """Cases of a table: every length at all its spacings."""
    return [(length, one) for length, (*_, several) in shapes.items() for one in several]


def beside(kind, figures):
    """Rows with the figures of finite elements before the last column."""
    return [[*row[:-1], *reference(kind, row[0]), row[-1]] for row in rows_of(figures)]


def draw(axes):
    """Stretch at break against the length of a cut."""
    lengths = [one for one, (*_, columns) in CUTS.items() if columns]
    rows = np.array([reference("cut", one) for one in lengths], dtype=float)
    names = "Griffith", "rule, finite elements", "coupled criterion"
    for at, name, style in zip(rows.T, names, ("k--", "C0-", "C1-."), strict=True):
        axes.semilogx(lengths, at, style, label=name)
    tears = rows_of(stored("strength-cuts"))
    for number, (mark, name) in enumerate(zip("s^o", ("coarse", "medium", "fine"), strict=True)):
        at = [[row[0], row[4]] for row in tears if grade(row) == number]
        if at:
            axes.plot(*np.transpose(at), "C3" + mark, fillstyle="none", label=f"tears, {name}")
    axes.set(xlabel="length of the cut / l_c", ylabel="stretch at break", ylim=(1, 4.2))


def grade(row):
    """Number of the spacing of a cut, from coarse to fine."""
    length, spacing, *_ = row
    return CUTS[length][-1].index(round(length / spacing - 0.125))


if __name__ == "__main__":
    lengths = [one for one in CUTS if one >= 1]
    kinds = {"cut": CUTS, "hole": HOLES, "notch": NOTCHES}
    elementary = {
        f"{kind}, {one}": partial(references, kind, one)
        for kind, shapes in kinds.items()
        for one in shapes
    }
    report(
        __doc__,
        of_rows("strength-uncut", uncut, UNCUT),
        of_rows("strength-clamped", clamped, (0.18, 0.09, 0.06)),
        of_rows("strength-factor", factors, FACTORS, rows=with_differences),
        Study("strength-references", elementary, {}),
        of_rows("strength-acting", acting, (3, 5)),
        *(
            of_rows(name, one, spacings(kinds[kind]), rows=partial(beside, kind))
            for kind, name, one in (
                ("cut", "strength-cuts", cut),
                ("hole", "strength-holes", hole),
                ("notch", "strength-notches", notch),
            )
        ),
        of_rows("strength-long", compared, lengths),
    )
    with drawing("strength-cuts", (6.4, 4.0), 120) as axes:
        draw(axes)
