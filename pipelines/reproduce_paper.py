"""Section 6 of the paper, every table and figure, beside the paper's numbers and independent
references.

python pipelines/reproduce_paper.py                 everything: about 25 minutes on two cores
python pipelines/reproduce_paper.py --part hole     one part (see --help)
python pipelines/reproduce_paper.py --docs        and put the tables into the documentation

Figures go to docs/figures, numbers of each part to docs/figures/reproduction.json, so that parts
can be run one by one.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import matplotlib
import numpy as np
from clock import TimedModel, measure_speed, sheet
from matplotlib.figure import Figure
from pages import FIGURES, markdown_table, replace_block
from rich.console import Console

import pdsurrogate as pds
from pdsurrogate.results.figures import STYLE, colors_of, draw_cells, limits_of, save
from pdsurrogate.results.files import write_json
from pdsurrogate.results.measures import edge_displacements

console = Console()
DATA = json.loads((Path(__file__).parent / "data" / "fem_fields.json").read_text())
NUMBERS = FIGURES / "reproduction.json"

# Chen, Yang, Liu 2024: Table 1, Table 2, sections 6.2 to 6.4 and 6.7.
PAPER_STRESS = {1.5: 1.09, 2.0: 1.80, 2.5: 2.40}
PAPER_LATERAL = {1.5: 0.0915, 2.0: 0.145, 2.5: 0.182}
PAPER_SPEED_RATIO = "12.4 to 13.2"
PAPER_PURE_SHEAR_U1 = 0.211
PAPER_HOLE_U1 = 0.16
PAPER_GENT = {"u2": 0.145, "stress": 1.83}

FRACTURE_ENERGY = 274.0
"""kPa cm: the energy release rate at which the tear scene's crack runs at the paper's critical
stretch and spacing.
"""


def row(
    part: str,
    quantity: str,
    found: float,
    reference: float | None,
    source: str,
    paper: float | None = None,
) -> dict:
    return {
        "part": part,
        "quantity": quantity,
        "found": found,
        "reference": reference,
        "source": source,
        "paper": paper,
    }


def figure_of(width: float, height: float, rows: int = 1, columns: int = 1, **options):
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, **options)


def draw_field(axis, grid: dict, component: str, limits) -> None:
    """A finite element field on the deformed body."""
    x1, x2 = np.meshgrid(grid["x1"], grid["x2"], indexing="ij")
    u1, u2 = (np.array(grid[key], dtype=float) for key in ("u1", "u2"))
    value = u1 if component == "u1" else u2
    axis.pcolormesh(
        x1 + np.nan_to_num(u1),
        x2 + np.nan_to_num(u2),
        np.ma.masked_invalid(value),
        **colors_of(limits),
        shading="gouraud",
        rasterized=True,
    )
    axis.set(aspect="equal")
    axis.set_axis_off()


def fields_figure(panels, component: str, titles: list[str]) -> Figure:
    """Displacement fields side by side: results, and finite element grids."""
    index = int(component == "u2")
    limits = limits_of(
        np.concatenate(
            [result.displacement()[:, index] for result in panels if not isinstance(result, dict)]
        )
    )
    with matplotlib.rc_context(STYLE):
        figure, axes = figure_of(7.2, 2.6, 1, len(panels))
        for axis, panel, title in zip(axes, panels, titles, strict=True):
            if isinstance(panel, dict):
                draw_field(axis, panel, component, limits)
            else:
                drawn = draw_cells(axis, *panel.cells(), panel.displacement()[:, index], limits)
                axis.set_axis_off()
            axis.set_title(title)
        figure.colorbar(drawn, ax=axes, label=f"{component[0]}{'₁₂'[index]} (cm)", fraction=0.02)
        return figure


def uniaxial() -> list[dict]:
    """6.2: Tables 1 and 2, Fig. 6."""
    result, rival = (
        pds.simulate(pds.load_scene("uniaxial"), force) for force in ("neo-hookean", "ba-nosb")
    )
    with matplotlib.rc_context(STYLE):
        figure, axes = figure_of(7.2, 2.8, 3, 2, sharex=True, sharey=True)
        for column, (run, title) in enumerate(((result, "surrogate"), (rival, "BA-NOSB"))):
            for number, (axis, (moment, fields)) in enumerate(
                zip(axes[:, column], run.states, strict=True)
            ):
                drawn = draw_cells(
                    axis, *run.cells(number), fields["displacement"][:, 1], (-0.19, 0.19)
                )
                axis.set_axis_off()
                axis.set_title(f"{title}, stretch {moment.stretch:g}")
        axis.set(xlim=(0, 7.6), ylim=(0, 1))
        figure.colorbar(drawn, ax=axes, label="u₂ (cm)", fraction=0.02)
    save(figure, FIGURES / "figure-06.png")
    rows = []
    for level in result.levels:
        stretch = level["stretch"]
        exact = "exact, compressible"
        rows.append(
            row(
                "6.2, Table 1",
                f"nominal stress at {stretch:g} (kPa)",
                level["nominal_stress"],
                level["nominal_stress_reference"],
                exact,
                PAPER_STRESS[stretch],
            )
        )
        rows.append(
            row(
                "6.2, Table 1",
                f"u2 at {stretch:g} (cm)",
                level["lateral_displacement"],
                level["lateral_displacement_reference"],
                exact,
                PAPER_LATERAL[stretch],
            )
        )
    body = sheet()
    cases = [
        TimedModel(pds.forces.BANOSBForce(), "float64", body),
        TimedModel(pds.load_surrogate("neo-hookean"), "float32", body),
    ]
    slow, fast = measure_speed(cases, pds.materials.NeoHookean(), 20.0)
    ratio = slow["ns_per_directed_bond_1"] / fast["ns_per_directed_bond_1"]
    rows.append(
        row(
            "6.2, Table 2",
            f"cost of BA-NOSB / cost of the surrogate, per evaluation (paper: {PAPER_SPEED_RATIO})",
            ratio,
            None,
            "",
        )
    )
    return rows


def pure_shear() -> list[dict]:
    """6.3: Figs. 8 and 9."""
    stretches = [1.1, 1.25, 1.5, 1.75, 2.0, 2.25, 2.5]
    result, rival = (
        pds.simulate(pds.load_scene("pure-shear", stretches=stretches), force)
        for force in ("neo-hookean", "ba-nosb")
    )
    curve = np.array(DATA["pure_shear_curve"]["rows"])
    with matplotlib.rc_context(STYLE):
        figure, axis = figure_of(4.2, 3.0)
        axis.plot(curve[:, 0], curve[:, 1], color="black", lw=1, label="finite elements")
        axis.plot(
            stretches,
            [level["nominal_stress"] for level in result.levels],
            "o",
            mfc="none",
            label="surrogate",
        )
        axis.plot(
            stretches, [level["nominal_stress"] for level in rival.levels], "x", label="BA-NOSB"
        )
        axis.set(xlabel="stretch", ylabel="nominal stress (kPa)")
        axis.legend(frameon=False)
    save(figure, FIGURES / "figure-08.png")
    save(
        fields_figure(
            [result, rival, DATA["pure_shear_2.5"]],
            "u1",
            ["surrogate", "BA-NOSB", "finite elements"],
        ),
        FIGURES / "figure-09.png",
    )
    rows = []
    for level in result.levels:
        if "nominal_stress_reference" in level:
            stretch = level["stretch"]
            paper = PAPER_PURE_SHEAR_U1 if stretch == 2.5 else None
            rows.append(
                row(
                    "6.3, Fig. 8",
                    f"nominal stress at {stretch:g} (kPa)",
                    level["nominal_stress"],
                    level["nominal_stress_reference"],
                    "FEM",
                )
            )
            key = "greatest_lateral_displacement"
            rows.append(
                row(
                    "6.3, Fig. 9",
                    f"largest u1 at {stretch:g} (cm)",
                    level[key],
                    level[f"{key}_reference"],
                    "FEM",
                    paper,
                )
            )
    return rows


def hole() -> list[dict]:
    """6.4: Figs. 11 and 12."""
    result = pds.simulate(pds.load_scene("hole"))
    save(
        fields_figure([result, DATA["hole"]], "u2", ["surrogate", "finite elements"]),
        FIGURES / "figure-11.png",
    )
    x2, u1, _ = edge_displacements(result.body, result.displacement(), 0)
    edge = DATA["hole_left_edge"]
    order = np.argsort(edge["x2"])
    exact = np.interp(x2, np.array(edge["x2"])[order], np.array(edge["u1"])[order])
    with matplotlib.rc_context(STYLE):
        figure, axis = figure_of(4.2, 3.0)
        axis.plot(
            np.array(edge["x2"])[order],
            np.array(edge["u1"])[order],
            color="black",
            lw=1,
            label="finite elements",
        )
        axis.plot(x2[::5], u1[::5], "o", mfc="none", ms=4, label="surrogate")
        axis.set(xlabel="x₂ (cm)", ylabel="u₁ of the left edge (cm)")
        axis.legend(frameon=False)
    save(figure, FIGURES / "figure-12.png")
    level = result.levels[0]
    inner = np.abs(x2) <= 1.9
    profile = np.abs(u1 - exact)[inner].max() / exact.max()
    key = "greatest_lateral_displacement"
    return [
        row(
            "6.4",
            "nominal stress at 1.2 (kPa)",
            level["nominal_stress"],
            level["nominal_stress_reference"],
            "FEM",
        ),
        row(
            "6.4, Fig. 12",
            "largest u1 of the left edge (cm)",
            level[key],
            level[f"{key}_reference"],
            "FEM",
            PAPER_HOLE_U1,
        ),
        row(
            "6.4, Fig. 12",
            "u1 of the left edge up to 1.9 cm from its middle, largest error / largest u1",
            float(profile),
            None,
            "FEM",
        ),
    ]


def zero_energy() -> list[dict]:
    """Section 3: Fig. 2, the force that drives a single displaced point back."""
    spacing, law = 0.05, pds.materials.NeoHookean()
    body = pds.Body.rectangle(1.05, 1.05, spacing, 3.15 * spacing)
    center = int(np.argmin(np.linalg.norm(body.points - 0.525, axis=1)))
    moves = np.linspace(0.0, 0.5, 11)
    curves = {}
    for name in ("analytic", "neo-hookean", "ba-nosb", "nosb"):
        force, out, curve = (
            pds.load_surrogate(name).bind(body, law, pds.ForceSettings()),
            np.empty_like(body.points),
            [],
        )
        for move in moves:
            positions = body.points.copy()
            positions[center, 0] += move * spacing
            force(positions, out)
            curve.append(-out[center, 0] / body.volumes[center] * spacing)
        curves[name] = curve
    with matplotlib.rc_context(STYLE):
        figure, axis = figure_of(4.2, 3.0)
        for name, curve in curves.items():
            axis.plot(moves, curve, "--" if name == "analytic" else "-", label=name)
        axis.set(
            xlabel="displacement of one point (spacings)", ylabel="restoring force density (μ/dx)"
        )
        axis.legend(frameon=False)
    save(figure, FIGURES / "figure-02.png")
    return [
        row("3, Fig. 2", f"restoring force at half a spacing, {name} (μ/dx)", curve[-1], None, "")
        for name, curve in curves.items()
    ]


def tear_scene(spacing: float, **changes):
    # 0.03 does not divide 11 cm.
    length = round(11.0 / spacing) * spacing
    return pds.load_scene("tear", {"spacing": spacing, "body.size": [length, 3.0], **changes})


def tear() -> list[dict]:
    """6.5: Figs. 14 and 15, and what depends on the spacing."""
    rows, curves = [], []
    for title, changes in (
        ("critical stretch 3.5", {}),
        (f"fracture energy {FRACTURE_ENERGY:g} kPa cm", {"fracture": {"energy": FRACTURE_ENERGY}}),
    ):
        for spacing in (0.04, 0.03, 0.02):
            console.log(f"tear, {title}, spacing {spacing}")
            result = pds.simulate(tear_scene(spacing, **changes))
            summary = result.summary
            curves.append((f"{title}, spacing {spacing:g}", result))
            part = f"6.5, {title}, spacing {spacing:g}"
            history = [entry for entry in result.history if "time" in entry]
            peak = max(history, key=lambda entry: entry["nominal_stress"])
            rows.append(row(part, "peak nominal stress (kPa)", peak["nominal_stress"], None, ""))
            rows.append(row(part, "stretch at the peak", peak["stretch"], None, ""))
            rows.append(
                row(
                    part,
                    "stretch at the first broken bond",
                    summary["crack"]["start"]["stretch"],
                    None,
                    "",
                )
            )
            rows.append(row(part, "critical stretch", summary["critical_stretch"], None, ""))
            tips = np.array([tip for entry in summary["crack"]["tips"] for tip in entry["tips"]])
            rows.append(
                row(
                    part,
                    "largest distance of the crack from the line of the precut (cm)",
                    float(np.abs(tips[:, 1] - 1.5).max()),
                    None,
                    "",
                )
            )
            rows.append(row(part, "seconds", summary["seconds_total"], None, ""))
            if spacing == 0.02 and not changes:
                save(result.figure(), FIGURES / "figure-14.png")
                for level in result.levels:
                    if "nominal_stress_reference" in level:
                        quantity = f"precut, nominal stress at {level['stretch']:g} (kPa)"
                        rows.append(
                            row(
                                "6.5",
                                quantity,
                                level["nominal_stress"],
                                level["nominal_stress_reference"],
                                "FEM",
                            )
                        )
    uncut = pds.simulate(
        pds.load_scene(
            "tear",
            {"precuts": [], "fracture": None, "dynamics": None, "stretches": [1.1, 1.25, 1.5, 2.0]},
        )
    )
    for level in uncut.levels:
        rows.append(
            row(
                "6.5",
                f"uncut, nominal stress at {level['stretch']:g} (kPa)",
                level["nominal_stress"],
                level["nominal_stress_reference"],
                "FEM",
            )
        )
    with matplotlib.rc_context(STYLE):
        figure, axes = figure_of(7.2, 3.0, 1, 2, sharey=True)
        for number, (title, result) in enumerate(curves):
            entries = [
                entry for entry in [*result.levels, *result.history] if "nominal_stress" in entry
            ]
            axis = axes[number // 3]
            axis.plot(
                [e["stretch"] for e in entries],
                [e["nominal_stress"] for e in entries],
                lw=1,
                label=title.rsplit(", ", 1)[1],
            )
            axis.set(title=title.rsplit(", ", 1)[0], xlabel="stretch")
        axes[0].set_ylabel("nominal stress (kPa)")
        axes[0].legend(frameon=False)
    save(figure, FIGURES / "figure-15.png")
    return rows


def voids() -> list[dict]:
    """6.6: Fig. 17."""
    result = pds.simulate(pds.load_scene("voids"))
    save(result.figure(), FIGURES / "figure-17.png")
    entries = result.summary["crack"]["tips"]
    radius = 0.25
    # A tip that stands on the central void's boundary, with nothing broken between it and the side
    # voids' cracks.
    near = [
        entry
        for entry in entries
        for tip in entry["tips"]
        if np.hypot(*tip) < radius + result.body.horizon
    ]
    reached = [
        entry
        for entry in entries
        for tip in entry["tips"]
        if 1.35 - result.body.horizon < abs(tip[0]) < 1.35 + 3 * result.body.horizon
    ]
    rows = [
        row(
            "6.6, Fig. 17",
            "stretch at which the cracks from the precuts reach the side voids",
            reached[-1]["stretch"],
            None,
            "",
        )
    ]
    rows.append(
        row(
            "6.6, Fig. 17",
            "stretch at which bonds break at the boundary of the central void",
            near[0]["stretch"],
            None,
            "",
        )
    )
    rows.append(
        row("6.6", "peak nominal stress (kPa)", result.summary["peak_nominal_stress"], None, "")
    )
    return rows


def gent() -> list[dict]:
    """6.7: Fig. 18."""
    result = pds.simulate(pds.load_scene("gent"))
    save(result.figure(), FIGURES / "figure-18.png")
    level = result.levels[0]
    return [
        row(
            "6.7, Fig. 18",
            "u2 at 2 (cm)",
            level["lateral_displacement"],
            level["lateral_displacement_reference"],
            "exact, compressible",
            PAPER_GENT["u2"],
        ),
        row(
            "6.7",
            "nominal stress at 2 (kPa)",
            level["nominal_stress"],
            level["nominal_stress_reference"],
            "exact, compressible",
            PAPER_GENT["stress"],
        ),
    ]


def convergence() -> list[dict]:
    """Errors against spacing at a fixed horizon of 3.15 spacings."""
    rows = []
    for scene, spacings in (("pure-shear", (0.05, 0.025, 0.0125)), ("hole", (0.05, 0.025, 0.0125))):
        for spacing in spacings:
            level = pds.simulate(
                pds.load_scene(
                    scene, spacing=spacing, stretches=[2.0 if scene == "pure-shear" else 1.2]
                ),
                "analytic",
            ).levels[0]
            for key, name in (
                ("nominal_stress", "nominal stress"),
                ("greatest_lateral_displacement", "largest lateral displacement"),
            ):
                part = f"{scene}, spacing {spacing:g}"
                rows.append(row(part, name, level[key], level[f"{key}_reference"], "FEM"))
    return rows


PARTS = {
    part.__name__.replace("_", "-"): part
    for part in (zero_energy, uniaxial, pure_shear, hole, tear, voids, gent, convergence)
}


def percent(value: float, reference: float) -> str:
    return f"{100 * (value / reference - 1):+.3f}"


def table(rows: list[dict]) -> str:
    cells = []
    for entry in rows:
        reference, paper = entry["reference"], entry["paper"]
        cells.append(
            [
                entry["part"],
                entry["quantity"],
                f"{entry['found']:.5g}",
                "" if reference is None else f"{reference:.5g} ({entry['source']})",
                "" if reference is None else percent(entry["found"], reference),
                "" if paper is None else f"{paper:g}",
                "" if paper is None or reference is None else percent(paper, reference),
            ]
        )
    return markdown_table(
        ["section", "quantity", "result", "reference", "error (%)", "paper", "paper's error (%)"],
        cells,
    )


def pivot(rows: list[dict]) -> str:
    """One row a part, one column a quantity."""
    parts, quantities = (
        list(dict.fromkeys(entry[key] for entry in rows)) for key in ("part", "quantity")
    )
    found = {(entry["part"], entry["quantity"]): f"{entry['found']:.4g}" for entry in rows}
    cells = [
        [part.removeprefix("6.5, "), *(found.get((part, quantity), "") for quantity in quantities)]
        for part in parts
    ]
    return markdown_table(["tear", *quantities], cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--part", choices=list(PARTS), action="append", help="one part only; may be repeated"
    )
    parser.add_argument("--docs", action="store_true", help="put the tables into the documentation")
    arguments = parser.parse_args()
    numbers = json.loads(NUMBERS.read_text()) if NUMBERS.exists() else {}
    for name in arguments.part or PARTS:
        console.log(name)
        numbers[name] = PARTS[name]()
        write_json(NUMBERS, numbers)
        console.print(table(numbers[name]), soft_wrap=True)
    if arguments.docs:
        static = [
            entry
            for name in ("zero-energy", "uniaxial", "pure-shear", "hole", "gent", "voids")
            for entry in numbers[name]
        ]
        static += [entry for entry in numbers["tear"] if entry["part"] == "6.5"]
        replace_block("section-6", table(static))
        replace_block("tear", pivot([entry for entry in numbers["tear"] if entry["part"] != "6.5"]))
        replace_block("convergence", table(numbers["convergence"]))


if __name__ == "__main__":
    main()
