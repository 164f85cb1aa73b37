"""Section 6 of the paper, beside the paper's numbers and independent references.

python pipelines/reproduce_paper.py                everything: about 25 minutes on two cores
python pipelines/reproduce_paper.py section-6.2    uniaxial tension with every force model
python pipelines/reproduce_paper.py "6.4, hole"    a case; --help names other uses

The paper is Chen, Yang, Liu, Int. J. Mech. Sci. 273 (2024) 109234. Pictures go to docs/figures.
"""

import json
from pathlib import Path

import matplotlib
import numpy as np
from cases import LISTED, Case, Study, at_spacings, listed, of_rows, percent, report
from matplotlib.figure import Figure
from pages import FIGURES

import pdsurrogate as pds
from pdsurrogate.results.figures import STYLE, colors_of, draw_cells, limits_of, save

FIELDS = json.loads((Path(__file__).parent / "data" / "fem_fields.json").read_text())

HELD = "support=points"
RUNS = listed("uniaxial")
"""Titles with a force model and changes of the scene `uniaxial`: with the paper's options one held
column of points at each end, the factor (24)-(25), and a network that is used wherever it is asked.
"""


def uniaxial(title, force, *changes):
    """6.2: errors against the exact slightly compressible solution at three stretches, and
    roughness at the last.
    """
    result = pds.simulate(pds.load_scene("uniaxial", changes), force)
    errors = (
        [100 * level[f"{key}_error"] for level in result.levels]
        for key in ("nominal_stress", "lateral_displacement")
    )
    if force == "neo-hookean@2":
        save(result.figure(), FIGURES / "uniaxial.png")
    yield title, *errors, result.levels[-1]["roughness"]


STILL = {"fracture": None, "dynamics": None}
STRESS, SIDE = "nominal stress at {:g} (kPa)", "largest u1 at {:g} (cm)"
SECTIONS = [tuple(case.values()) for case in LISTED["sections"]]
"""Section, scene, changes of it, quantity, and the paper's values by stretch. Sheets of section 6.5
do not break here.
"""

KEYS = {
    STRESS: "nominal_stress",
    SIDE: "greatest_lateral_displacement",
    "u2 at {:g} (cm)": "lateral_displacement",
}


def compared(section, scene, changes, quantity, paper):
    """Results at the stretches for which there is a reference."""
    key = KEYS[quantity]
    still = STILL if scene == "tear" else {}
    for level in pds.simulate(pds.load_scene(scene, still | changes)).levels:
        found, stretch, exact = level[key], level["stretch"], level.get(f"{key}_reference")
        if exact is not None:
            value = dict(paper).get(round(stretch, 6))
            row = section, quantity.format(stretch), found, exact, percent(found, exact), value
            yield *row, None if value is None else percent(value, exact)


CONVERGING = {"pure-shear": 2.0, "hole": 1.2}
"""Scenes of the convergence, with their stretches."""


def converging(scene):
    """Errors against spacing at a fixed horizon of 3.15 spacings."""

    def measure(spacing):
        changes = {"spacing": spacing, "stretches": CONVERGING[scene]}
        result = pds.simulate(pds.load_scene(scene, changes), "analytic")
        for name, key in (("nominal stress", KEYS[STRESS]), ("largest u1", KEYS[SIDE])):
            error, count = result.levels[0][f"{key}_error"], result.summary["n_force_evaluations"]
            yield name, 100 * error, count

    return Case(measure, (0.05, 0.025, 0.0125))


def restoring(force):
    """Section 3, Fig. 2: the force that drives a single displaced point back, in mu/dx."""
    spacing, law = 0.05, pds.materials.NeoHookean()
    body = pds.Body.rectangle(1.05, 1.05, spacing, 3.15 * spacing)
    center = int(np.argmin(np.linalg.norm(body.points - 0.525, axis=1)))
    positions, out = body.points.copy(), np.empty_like(body.points)
    positions[center, 0] += spacing / 2
    pds.load_surrogate(force).bind(body, law, pds.ForceSettings())(positions, out)
    yield force, -out[center, 0] / body.volumes[center] * spacing


TEARS = [
    (title, spacing)
    for title in ("critical stretch 3.5", "fracture energy 274 kPa cm")
    for spacing in (0.04, 0.03, 0.02)
]
"""The fracture energy is the energy release rate at which the scene's crack runs at the paper's
critical stretch and spacing.
"""


def torn(title, spacing):
    """6.5: what depends on the spacing, and Figs. 14 and 15."""
    # 0.03 does not divide 11 cm.
    changes = {"spacing": spacing, "body.size": [round(11.0 / spacing) * spacing, 3.0]}
    if title != TEARS[0][0]:
        changes["fracture"] = {"energy": 274.0}
    result = pds.simulate(pds.load_scene("tear", changes))
    summary, history = result.summary, [entry for entry in result.history if "time" in entry]
    peak = max(history, key=lambda entry: entry["nominal_stress"])
    tips = [tip[1] for entry in summary["crack"]["tips"] for tip in entry["tips"]]
    if (title, spacing) == TEARS[2]:
        save(result.figure(), FIGURES / "figure-14.png")
    yield (
        f"{title}, spacing {spacing:g}",
        peak["nominal_stress"],
        peak["stretch"],
        summary["crack"]["start"]["stretch"],
        summary["critical_stretch"],
        float(np.abs(np.subtract(tips, 1.5)).max()),
    )


def voids():
    """6.6, Fig. 17: when the cracks from the precuts reach the side voids, and when bonds break at
    the boundary of the central void.
    """
    result = pds.simulate(pds.load_scene("voids"))
    save(result.figure(), FIGURES / "figure-17.png")
    horizon, entries = result.body.horizon, result.summary["crack"]["tips"]

    def where(met):
        return [entry["stretch"] for entry in entries if any(map(met, entry["tips"]))]

    # A tip on the central void, with nothing broken between it and the side voids' cracks.
    central = where(lambda tip: np.hypot(*tip) < 0.25 + horizon)
    side = where(lambda tip: 1.35 - horizon < abs(tip[0]) < 1.35 + 3 * horizon)
    yield side[-1], central[0], result.summary["peak_nominal_stress"]


def pictures():
    """u2 with NOSB beside the surrogate, and fields of 6.3 and 6.4 beside finite elements."""
    held = [pds.simulate(pds.load_scene("uniaxial", [HELD]), force) for force in ("nosb", None)]
    sheared = [pds.simulate(pds.load_scene("pure-shear"), force) for force in (None, "ba-nosb")]
    perforated = pds.simulate(pds.load_scene("hole"))
    drawn = {
        "zero-energy": (1, 0, dict(zip(("NOSB", "surrogate"), held, strict=True))),
        "figure-09": (
            0,
            -1,
            dict(zip(("surrogate", "BA-NOSB"), sheared, strict=True))
            | {"finite elements": FIELDS["pure_shear_2.5"]},
        ),
        "figure-11": (1, -1, {"surrogate": perforated, "finite elements": FIELDS["hole"]}),
    }
    for name, (axis, number, panels) in drawn.items():
        with matplotlib.rc_context(STYLE):
            save(fields(axis, number, panels), FIGURES / f"{name}.png")
    yield list(drawn)


def fields(component, number, panels):
    """Displacement fields side by side: results at an output, and finite element grids."""
    figure = Figure(figsize=(7.2, 2.6), layout="constrained")
    moved = [
        panel.displacement(number)[:, component]
        for panel in panels.values()
        if not isinstance(panel, dict)
    ]
    limits = limits_of(np.concatenate(moved))
    for axis, (title, panel) in zip(figure.subplots(1, len(panels)), panels.items(), strict=True):
        axis.set(title=title, aspect="equal")
        axis.set_axis_off()
        if isinstance(panel, dict):
            places = np.meshgrid(panel["x1"], panel["x2"], indexing="ij")
            u = [np.array(panel[key], dtype=float) for key in ("u1", "u2")]
            deformed = (x + np.nan_to_num(one) for x, one in zip(places, u, strict=True))
            value, colors = np.ma.masked_invalid(u[component]), colors_of(limits)
            axis.pcolormesh(*deformed, value, **colors, shading="gouraud", rasterized=True)
        else:
            field = panel.displacement(number)[:, component]
            drawn = draw_cells(axis, *panel.cells(number), field, limits)
    figure.colorbar(drawn, ax=figure.axes, label=f"{['u₁', 'u₂'][component]} (cm)", fraction=0.02)
    return figure


if __name__ == "__main__":
    report(
        __doc__,
        of_rows("section-6.2", uniaxial, RUNS),
        of_rows("section-6", compared, SECTIONS),
        of_rows(
            "restoring-force",
            restoring,
            ["analytic", "neo-hookean", "ba-nosb", "nosb"],
        ),
        of_rows("tear", torn, TEARS),
        of_rows("voids", voids),
        at_spacings("convergence", {scene: converging(scene) for scene in CONVERGING}),
        Study("pictures", {"": pictures}, {}),
    )
