"""Running cracks in stretched sheets: speed and fronts, against the speeds of waves in the
stretched rubber.

python pipelines/running_cracks.py            prints the table, and draws the figure
python pipelines/running_cracks.py --docs     and puts it into docs/validation/experiments.md

A sheet of 2 x 2.4 is stretched by l2 across the crack and by l1 along it, homogeneously and in
equilibrium. A slit of 0.3 at its left edge then opens at once, and the crack from it runs between
the rows of points. Speeds are measured in the undeformed body, in units of sqrt(mu/rho).

On one core of 2 GHz all runs take about half a minute.
"""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from pages import FIGURES, markdown_table, report

import pdsurrogate as pds
from pdsurrogate.materials import plane_stress

LAW = pds.materials.NeoHookean(shear_modulus=1.0, bulk_modulus=100.0)
CRITICAL = 3.0
LENGTH, HEIGHT, SLIT = 2.0, 2.4, 0.3
"""Length along the crack, and height, of the undeformed sheet, and length of the slit."""

JOLT, JOLT_TIME = 3e-4, 0.2
"""Part by which the grips stretch the sheet further when the motion begins, which breaks the bonds
across the slit, and its duration. Chosen so small that its waves change the stretch by 0.3 % at
most.
"""

SAFETY = 0.3
"""Time step over the critical one. The step is estimated in the stretched sheet, and rubber that
retracts from a large stretch becomes several times as stiff: with the default of 0.7 half of six
trial runs failed, with 0.3 none.
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


class Sheet(NamedTuple):
    """Stretches along and across the crack, points per length, horizon in spacings, retardation
    time times sqrt(mu/rho)/horizon.
    """

    along: float
    across: float
    rows: float = 20
    ratio: float = 3.15
    viscosity: float = 0.3


LADDER = [Sheet(1.0, across) for across in (1.6, 2.0, 2.3, 2.6, 2.8)]


def wave_speeds(F: np.ndarray, normal) -> np.ndarray:
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


def scene(sheet: Sheet) -> pds.Scene:
    spacing, middle = 1 / sheet.rows, HEIGHT / 2
    duration = TRAVEL / (0.45 * sheet.across - 0.08)
    end = 1 + JOLT_TIME / duration
    material = {
        "law": LAW.name,
        "shear_modulus": LAW.shear_modulus,
        "bulk_modulus": LAW.bulk_modulus,
    }
    beside = {"material": material, "fracture": {"critical_stretch": CRITICAL}}
    weak = {"between": ["above", "below"], "critical_stretch": sheet.across * (1 + JOLT / 6)}
    dynamics = {
        "duration": duration,
        "density": 1.0,
        "safety": SAFETY,
        "viscosity": sheet.viscosity * sheet.ratio * spacing,
    }
    return pds.Scene.model_validate(
        {
            "name": "running-crack",
            "spacing": spacing,
            "horizon_ratio": sheet.ratio,
            "body": {"shape": "rectangle", "size": [LENGTH, HEIGHT]},
            "regions": {
                "above": {"box": [[0, middle], [SLIT, HEIGHT]]},
                "below": {"box": [[0, 0], [SLIT, middle]]},
            },
            "material": material,
            "materials": [{"region": "above"} | beside, {"region": "below"} | beside],
            "fracture": {"critical_stretch": CRITICAL, "interfaces": [weak]},
            "prescribed": [
                {"region": "left", "x1": 0.0},
                {
                    "region": "right",
                    "x1": (sheet.along - 1) * LENGTH,
                    "amplitude": [[0.0, 0.0], [1.0, 1.0]],
                },
                {"region": "bottom", "x2": 0.0},
                {
                    "region": "top",
                    "x2": (sheet.across - 1) * HEIGHT,
                    "amplitude": [[0.0, 0.0], [1.0, 1.0], [end, 1 + JOLT]],
                },
            ],
            "steps": [1.0, {"to": 2.0, "outputs": 96, "dynamics": dynamics}],
        }
    )


def measured(sheet: Sheet) -> dict:
    """Speeds of the crack and of waves, slope of the front, error of the energy balance, and the
    faces of the crack in space.
    """
    result = pds.simulate(scene(sheet), "bond-energy")
    points, spacing, summary = (
        result.field("position")[:, :2],
        result.summary["spacing"],
        result.summary,
    )
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
        raise ValueError(f"{sheet}: the tip does not come to {WINDOW[-1]}; give a longer TRAVEL")

    def speed(begin: float, end: float) -> float:
        chosen = (columns > begin) & (columns < end)
        return float(1 / np.polyfit(columns[chosen], arrivals[chosen], 1)[0])

    first, middle, last = WINDOW
    waves = wave_speeds(np.diag([sheet.along, sheet.across]), [1.0, 0.0])
    number = int(reached[columns < SHOWN].argmax(axis=1).max())
    state, tip = outputs[number], columns[reached[:, number]].max()
    stretch = result.field("deformation_gradient", state)[:, 1, 1]
    slope = front(points, stretch, tip, sheet.across, spacing)
    places = points + result.displacement(state)
    face = (
        (result.field("damage", state) > 0.2)
        & (result.field("damage", state) < 1)
        & (points[:, 0] < tip)
    )
    origin = [sheet.along * tip, places[:, 1].mean()]
    return {
        "speed": speed(first, last),
        "halves": (speed(first, middle), speed(middle, last)),
        "waves": waves.tolist(),
        "slope": slope,
        "gap": summary["dynamics"][-1]["greatest_energy_gap"],
        "failed": summary["crack"]["failed_points"],
        "points": summary["n_points"],
        "face": places[face] - origin,
        "stretch": (points - [tip, HEIGHT / 2], stretch),
    }


def front(
    points: np.ndarray, stretch: np.ndarray, tip: float, ahead: float, spacing: float
) -> float:
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


def row(sheet: Sheet, found: dict) -> list[str]:
    """A row of a table, which is also printed: speeds, Mach's relation (89), and the error of
    the energy balance.
    """
    speed, (shear, longitudinal) = found["speed"], found["waves"]
    angle = np.arctan(found["slope"])
    mach = "-"
    if np.isfinite(angle):
        normal = [np.sin(angle), np.cos(angle)]
        stretched = np.diag([sheet.along, sheet.across])
        slowest = wave_speeds(stretched, normal)[0]
        mach = f"{speed * np.sin(angle) / slowest:.2f}"
    cells = [
        f"{sheet.across:g}",
        f"{speed:.2f}",
        " / ".join(f"{half:.2f}" for half in found["halves"]),
        f"{speed / shear:.2f}",
        f"{speed / longitudinal:.2f}",
        mach,
    ]
    cells += [f"{found['gap']:+.2f}", f"{found['points']}"]
    print(cells, flush=True)
    return cells


def figure(found: list[dict]) -> Figure:
    """Speeds against the stretch, the stretch around the fastest crack, and the faces of the
    slowest and the fastest in space.
    """
    drawing = Figure(figsize=(10, 3.4), layout="constrained")
    speeds, body, faces = drawing.subplots(1, 3)
    stretches = [sheet.across for sheet in LADDER]
    speeds.plot(stretches, [one["speed"] for one in found], "o-", label="crack")
    for waves, style, name in zip(
        np.transpose([one["waves"] for one in found]),
        ("k-", "k--"),
        ("shear waves", "longitudinal waves"),
        strict=True,
    ):
        speeds.plot(stretches, waves, style, linewidth=1, label=name)
    speeds.set(
        xlabel="stretch across the crack",
        ylabel="speed in the undeformed body ($\\sqrt{\\mu/\\rho}$)",
    )
    speeds.legend()
    points, stretch = found[-1]["stretch"]
    drawn = body.scatter(
        *points.T, c=stretch, s=2, cmap="viridis", vmin=0, vmax=LADDER[-1].across, rasterized=True
    )
    slope = 1 / np.sqrt((found[-1]["speed"] / found[-1]["waves"][0]) ** 2 - 1)
    for side in (1, -1):
        body.plot([0, -1 / slope], [0, side], "r--", linewidth=1)
    body.set(
        xlabel="x1 from the tip, undeformed",
        ylabel="x2",
        aspect="equal",
        xlim=(-1.2, 0.6),
        ylim=(-1.2, 1.2),
    )
    drawing.colorbar(drawn, ax=body, label="stretch across the crack")
    for sheet, one, color in ((LADDER[0], found[0], "C1"), (LADDER[-1], found[-1], "C0")):
        faces.plot(
            *one["face"].T, ".", markersize=2, color=color, label=f"stretch {sheet.across:g}"
        )
    faces.set(xlabel="x1 from the tip, deformed", ylabel="x2", aspect="equal")
    faces.legend(loc="lower left")
    return drawing


def ladder() -> str:
    """All sheets, and the figure."""
    head = [
        "stretch across",
        "speed v",
        "first / second half",
        "v / shear waves",
        "v / longitudinal waves",
        "v sin(angle) / c",
    ]
    found = [measured(sheet) for sheet in LADDER]
    figure(found).savefig(FIGURES / "running-cracks.png", dpi=150)
    rows = [row(sheet, one) for sheet, one in zip(LADDER, found, strict=True)]
    return markdown_table([*head, "energy error (%)", "points"], rows)


if __name__ == "__main__":
    report(__doc__, {"running-cracks": ladder})
