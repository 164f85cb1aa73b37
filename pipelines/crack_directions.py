"""Direction, energy and G at the peak of cracks in strips that are turned by an angle, on the
lattice and on relaxed clouds.

python pipelines/crack_directions.py --lacking     tears what has no stored figures yet
python pipelines/crack_directions.py "space 15"    the tears that have all of these in their names

The strip and its grips are those of `tip_diameters.py`, with more spacings, in dynamics. The tears
in the plane take some two and a half hours of processor time on a core of 2 GHz, those in space
some 8 minutes.
"""

import time
import warnings
from functools import partial

import numpy as np
from cases import Study, report
from pages import markdown_table
from tip_diameters import ENERGY, LONG, PRECUT, cases, law_of, layers_of, strip

import pdsurrogate as pds
from pdsurrogate.materials import homogeneous
from pdsurrogate.scenes.tip_diameter import tip_diameters

ROWS, ROWS_IN_SPACE = 24, 14
"""Points per height of strips in the plane, and in space."""

MOVING = {"density": 1.0, "damping": 0.02}
RATE, TRAVELS, OUTPUTS = 0.02, (0.2, 0.75), 120
"""Speed of the grips over that of shear waves, travels between which dynamics last, and outputs on
their way.
"""

SAFER = 0.35
"""Part of the critical time step with which a tear is repeated that failed with the default of
0.7.
"""

FINER = {48: (ENERGY, (0.3, 0.75)), 64: (0.75 * ENERGY, (0.26, 0.58))}
"""Finer clouds: points per height, with G over shear modulus and height, and the travels of the
grip between which their dynamics last. Those of 64 points have the critical stretch of those of 48.
"""

WIDER = 0.16, 0.75
"""These travels in a repeated tear, of which a bond would break in equilibrium before the usual
ones, or whose crack has not passed the length along which it is measured when they end.
"""

STRETCH = 2.4
"""Critical stretch of strips in space."""

DIAMETER = {"lattice": 0.85, "relaxed": 1.0}
"""Tip diameters in horizons by which critical stretches of strips in the plane are chosen so
that G is near ENERGY.
"""

ADVANCE = {"stress": 5 / 3, "space": 12 / 7}
"""Advance of the crack, in heights of the strip, along which its direction and energy are measured:
40 spacings in strips of 24 rows, 24 in solids. Behind it the plane strip has half as much to its
free end.
"""

STARTED = 4
"""Advance in spacings from which on the energy is counted, so that the start of the crack is
left out.
"""


def advance_of(case):
    """Advance of the crack in spacings."""
    return round(ADVANCE[case["plane"]] * case["rows"])


def scene_of(case, travels=None, **dynamics):
    """The strip with more outputs than for a diameter, other travels between which its dynamics
    last, and other settings of them.
    """
    critical = STRETCH
    energy, usual = FINER.get(case["rows"], (ENERGY, TRAVELS))
    if case["plane"] != "space":
        law, horizon = law_of(case), case["ratio"] / case["rows"]
        critical = pds.critical_stretch_of(
            law, energy, horizon, DIAMETER[case.get("arrangement", "lattice")]
        )
    described = strip(case, critical).model_dump(mode="json", exclude_unset=True)
    start, end = travels or usual
    moving = {"duration": (end - start) / RATE, **MOVING, **dynamics}
    outputs = round((end - start) / (TRAVELS[1] - TRAVELS[0]) * OUTPUTS)
    described["steps"] = [{"to": start}, {"to": end, "outputs": outputs, "dynamics": moving}]
    return pds.Scene.model_validate(described)


class TooShort(ValueError):
    """The crack has not passed the length along which it is measured."""


def torn(case, travels=None, **dynamics):
    """Figures of one tear: direction, energies per length over G, G at the peak."""
    began, scene = time.process_time(), scene_of(case, travels, **dynamics)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "a bond would break in equilibrium")
        result = pds.simulate(scene, case["model"], threads=1)
    turn = np.radians(case["angle"])
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    tip = PRECUT - LONG / 2
    center = np.zeros(2) if turn else np.array([LONG / 2, 0.5])

    places, damage = result.body.points[:, :2] - center, result.field("damage")
    advance = (places @ along - tip) * case["rows"]
    chosen = (damage > 0) & (advance > 0) & (advance < advance_of(case))
    if not (damage[advance >= advance_of(case)] > 0).any():
        raise TooShort(
            f"the crack does not advance by {advance_of(case)} spacings, along which it is measured"
        )
    # Damage lies on both sides of the crack alike, so that the line of least squares through it,
    # weighted by it, is that of the crack.
    slope = np.polyfit(
        advance[chosen], (places @ across)[chosen] * case["rows"], 1, w=np.sqrt(damage[chosen])
    )[0]

    rows = [row for row in result.history if "time" in row]
    load = np.array([[row["force_high_1"], row["force_high_2"]] for row in rows]) @ across
    times = [row["time"] for row in rows]
    levels = [level for level in result.levels if level.get("time") is not None and level["cracks"]]
    loads = np.interp([level["time"] for level in levels], times, load)
    peak = levels[int(loads.argmax())]["cracks"][0]["energy_release_rate"]

    tips = (
        np.array(
            [(np.array(level["cracks"][0]["tip"][:2]) - center) @ along - tip for level in levels]
        )
        * case["rows"]
    )
    tips, ends = np.maximum.accumulate(tips), (STARTED, advance_of(case))
    area = (
        (ends[1] - ends[0])
        / case["rows"]
        * (layers_of(case) / case["rows"] if case["plane"] == "space" else 1.0)
    )

    def per_area(*keys):
        """Increase of energies between both ends, per area of the crack."""
        totals = np.interp(
            [level["time"] for level in levels],
            times,
            [sum(row[key] for key in keys) for row in rows],
        )
        return float(np.diff(np.interp(ends, tips, totals))[0] / area)

    return {
        "direction": float(np.degrees(np.arctan(slope))),
        "dissipated": per_area("released_energy", "damped_energy"),
        "released": per_area("released_energy"),
        "peak": peak,
        "critical_stretch": result.summary["critical_stretch"],
        "length": float(tips[-1]),
        "account_percent": result.summary["dynamics"][-1]["energy_gap"],
        "seconds": time.process_time() - began,
        **dynamics,
    }


def tried(case):
    """A case with the figures of its tear: an unstable one is repeated with shorter time steps, a
    short one with wider travels.
    """
    try:
        yield case | torn(case)
    except pds.SimulationFailed:
        yield case | torn(case, safety=SAFER)
    except (UserWarning, TooShort):
        yield case | torn(case, WIDER)


def rms(values):
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def deviating(values, figures):
    """Mean and its standard error, for one value the value alone."""
    error = (
        f" ± {np.std(values, ddof=1) / np.sqrt(len(values)):{figures}}" if len(values) > 1 else ""
    )
    return f"{np.mean(values):{figures}}{error}"


def prescribed(tear):
    """The `fracture.energy` for which the package chooses the critical stretch of a tear in the
    plane; 1 for solids.
    """
    if tear["plane"] == "space":
        return 1.0
    critical, law = tear["critical_stretch"], law_of(tear)
    diameter = tip_diameters(
        tear["plane"], tear["ratio"], "bond energy", tear.get("arrangement", "lattice")
    ).at(critical)
    return (
        homogeneous.uniaxial(law, critical).energy_density * diameter * tear["ratio"] / tear["rows"]
    )


def row_of(label, tears):
    """Figures of several tears, to be averaged."""
    directions, units = (
        np.array([tear["direction"] for tear in tears]),
        np.array([prescribed(tear) for tear in tears]),
    )
    angles = (
        f"{directions.mean():+.1f}",
        f"{rms(directions):.1f}",
        f"{np.abs(directions).max():.1f}",
    )
    energies = [
        deviating([tear[key] for tear in tears] / units, ".3f")
        for key in ("dissipated", "released", "peak")
    ]
    return [label, str(len(tears)), *angles, *energies]


def table_of(plane, points, rows, figures):
    """Tears of a plane, arrangement and number of rows, by angle and all together."""
    tears = [
        tear
        for found in figures.values()
        for tear in found
        if (tear["plane"], tear.get("arrangement", "lattice"), tear["rows"])
        == (plane, points, rows)
    ]
    unit = "G" if plane != "space" else "μ h"
    head = [
        "angle (degrees)",
        "tears",
        "direction, mean (degrees)",
        "rms (degrees)",
        "greatest (degrees)",
    ]
    head += [f"dissipated / {unit}", f"released / {unit}", f"G at the peak / {unit}"]
    angles = sorted({tear["angle"] for tear in tears})
    lines = [
        row_of(f"{angle}", [tear for tear in tears if tear["angle"] == angle]) for angle in angles
    ]
    return markdown_table(head, [*lines, row_of("all", tears)])


TABLES = [
    *(("stress", "relaxed", rows) for rows in (ROWS, *FINER)),
    ("stress", "lattice", ROWS),
    ("space", "relaxed", ROWS_IN_SPACE),
    ("space", "lattice", ROWS_IN_SPACE),
]

if __name__ == "__main__":
    tables = {"directions-{}-{}-{}".format(*one): partial(table_of, *one) for one in TABLES}
    named = {name: partial(tried, case) for name, case in cases("crack-directions").items()}
    report(__doc__, Study("crack-directions", named, tables))
