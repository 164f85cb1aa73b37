"""Running cracks in stretched sheets: speed and fronts, against the speeds of waves in the
stretched rubber.

python pipelines/running_cracks.py        measures all sheets, and draws the last
python pipelines/running_cracks.py 2.8    one of them; --help names other uses

A sheet of 2 x 2.4 is stretched by l2 across the crack and by l1 along it, homogeneously and in
equilibrium. A slit of 0.3 at its left edge then opens at once, and the crack from it runs between
the rows of points. Speeds are measured in the undeformed body, in units of sqrt(mu/rho).

On one core of 2 GHz all runs take about half a minute.
"""

import numpy as np
from cases import of_rows, report, scene_of
from matplotlib.figure import Figure
from pages import FIGURES

import pdsurrogate as pds
from pdsurrogate.materials import plane_stress

LAW = pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=100.0)
HEIGHT = 2.4
JOLT, JOLT_TIME = 3e-4, 0.2
"""Part by which the grips stretch the sheet further when the motion begins, which breaks the bonds
across the slit, and its duration. Chosen so small that its waves change the stretch by 0.3 % at
most.
"""

WINDOW = 0.7, 1.0, 1.3
"""Places of the tip between which speeds are measured, with the middle."""

TRAVEL = 1.5
"""What the crack would grow in a run at 0.45 l2 - 0.08, near the speeds that are found: its tip
passes the window, and the waves do not come back from the grips with the retracted rubber.
"""

SEPARATED = 0.35
"""Damage of points beside the crack: a row whose neighbor is gone across a plane half a spacing
away has 0.43.
"""

BEHIND = 0.1, 0.5
"""Distances behind the tip between which the slope of the front is fitted."""

SHOWN = 1.2
"""Place of the tip at which the front is measured and the crack drawn."""

DROP = 0.1
"""Part of the drop of the stretch that has taken place at the front. Chosen small, as the relation
to which it is compared is that of small waves.
"""


LADDER = 1.6, 2.0, 2.3, 2.6, 2.8


def wave_speeds(F, normal):
    """Speeds of plane waves of small amplitude along a unit vector in the stretched sheet, at a
    density of 1, in ascending order: theory (88), by differences of fourth order.
    """
    size = 1e-3 * np.linalg.norm(F, -2)
    shears = size * np.eye(2)[:, :, None] * np.asarray(normal)
    ahead, twice = (
        sum(side * plane_stress.first_piola_stress(LAW, F + side * by * shears) for side in (1, -1))
        for by in (1, 2)
    )
    tensor = (8 * ahead - twice) @ normal / (12 * size)
    return np.sqrt(np.linalg.eigvalsh((tensor + tensor.T) / 2))


def scene(across):
    duration = TRAVEL / (0.45 * across - 0.08)
    pull = [[0.0, 0.0], [1.0, 1.0], [1 + JOLT_TIME / duration, 1 + JOLT]]
    changes = {
        "fracture.interfaces.0.critical_stretch": across * (1 + JOLT / 6),
        "prescribed.3.x2": (across - 1) * HEIGHT,
        "prescribed.3.amplitude": pull,
        "steps.1.dynamics.duration": duration,
    }
    return scene_of("running-crack", changes)


def measured(across):
    """Speeds of the crack, over those of waves, Mach's relation (89) by the slope of the front, and
    error of the energy balance; the last sheet is drawn.
    """
    result = pds.simulate(scene(across), "bond-energy")
    points, spacing = result.field("position")[:, :2], result.summary["spacing"]
    outputs = [number for number, level in enumerate(result.levels) if "time" in level]
    times = np.array([result.levels[number]["time"] for number in outputs])
    beside = np.abs(points[:, 1] - HEIGHT / 2) < spacing
    separated = np.array([result.field("damage", number)[beside] > SEPARATED for number in outputs])
    columns = np.unique(points[beside, 0])
    reached = np.array(
        [separated[:, points[beside, 0] == column].any(axis=1) for column in columns]
    )
    arrivals = np.where(reached.any(axis=1), times[reached.argmax(axis=1)], np.inf)
    if arrivals[columns < WINDOW[-1]].max() == np.inf:
        raise ValueError(f"{across}: the tip does not come to {WINDOW[-1]}; give a longer TRAVEL")

    def speed(begin, end):
        chosen = (columns > begin) & (columns < end)
        return float(1 / np.polyfit(columns[chosen], arrivals[chosen], 1)[0])

    first, middle, last = WINDOW
    stretched, crack = np.diag([1.0, across]), speed(first, last)
    waves = wave_speeds(stretched, [1.0, 0.0])
    number = int(reached[columns < SHOWN].argmax(axis=1).max())
    state, tip = outputs[number], columns[reached[:, number]].max()
    stretch = result.field("deformation_gradient", state)[:, 1, 1]
    angle, mach = np.arctan(front(points, stretch, tip, across, spacing)), None
    if np.isfinite(angle):
        normal = [np.sin(angle), np.cos(angle)]
        slowest = wave_speeds(stretched, normal)[0]
        mach = crack * np.sin(angle) / slowest
    if across == LADDER[-1]:
        draw(points - [tip, HEIGHT / 2], stretch, across, crack / waves[0])
    halves, ratios = [speed(first, middle), speed(middle, last)], [crack / one for one in waves]
    gap = result.summary["dynamics"][-1]["greatest_energy_gap"]
    yield across, crack, halves, *ratios, mach, gap, len(points)


def front(points, stretch, tip, ahead, spacing):
    """Slope against the crack, in the undeformed body, of the line where the stretch across it
    has dropped by a tenth; NaN without one.
    """
    bound, behind, heights = ahead - DROP * (ahead - 1), [], []
    for distance in np.arange(*BEHIND, spacing):
        column = np.abs(points[:, 0] - (tip - distance)) < 0.6 * spacing
        for side in (1, -1):
            height = side * (points[column, 1] - HEIGHT / 2)
            order = np.argsort(-height)[: np.count_nonzero(height > 0)]
            height, value = height[order], stretch[column][order]
            below = np.flatnonzero(value < bound)
            if len(below) and below[0] > 0:
                pair = slice(below[0], below[0] - 2 if below[0] > 1 else None, -1)
                behind.append(distance)
                heights.append(np.interp(bound, value[pair], height[pair]))
    return float(np.polyfit(behind, heights, 1)[0]) if len(behind) > 9 else np.nan


def draw(points, stretch, across, mach):
    """The stretch around the fastest crack, by places from its tip, and Mach's lines."""
    drawing = Figure(figsize=(4.5, 3.6), layout="constrained")
    body, slope = drawing.subplots(), 1 / np.sqrt(mach**2 - 1)
    colors = {"c": stretch, "cmap": "viridis", "vmin": 0, "vmax": across}
    drawn = body.scatter(*points.T, s=2, rasterized=True, **colors)
    for side in (1, -1):
        body.plot([0, -1 / slope], [0, side], "r--", linewidth=1)
    limits = {"xlim": (-1.2, 0.6), "ylim": (-1.2, 1.2)}
    body.set(xlabel="x1 from the tip, undeformed", ylabel="x2", aspect="equal", **limits)
    drawing.colorbar(drawn, ax=body, label="stretch across the crack")
    drawing.savefig(FIGURES / "running-cracks.png", dpi=150)


if __name__ == "__main__":
    report(__doc__, of_rows("running-cracks", measured, LADDER))
