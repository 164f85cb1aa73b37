"""Section 6.2 of the paper: uniaxial tension with every force model, against the exact solution and
the paper's Table 1.

python pipelines/section_6_2.py            print the tables, draw the figures
python pipelines/section_6_2.py --docs   and put both into the documentation
"""

from __future__ import annotations

import matplotlib
from matplotlib.figure import Figure
from pages import FIGURES, markdown_table, report

import pdsurrogate as pds
from pdsurrogate.results.figures import STYLE, draw_cells, save

PAPERS_OPTIONS = ["support=points", "correction=scalar", "outside=extrapolate"]
"""One held column of points at each end, the factor (24)-(25), and a network that is used
wherever it is asked.
"""

RUNS = [
    ("analytic bond force", "analytic", []),
    ("surrogate, isochoric features (default)", "neo-hookean@2", []),
    ("surrogate, symmetric features (version 1)", "neo-hookean@1", []),
    ("surrogate, the paper's features and options", "neo-hookean-paper", PAPERS_OPTIONS),
    ("NOSB, held columns", "nosb", ["support=points"]),
    ("surrogate, held columns", "neo-hookean", ["support=points"]),
]

# Chen, Yang, Liu 2024, Table 1 and section 6.2: nominal stress (kPa) and u2 (cm) at stretches 1.5,
# 2.0, 2.5.
PAPER = [
    ("paper, network (Table 1)", (1.09, 1.80, 2.40), (0.0915, 0.145, 0.182)),
    ("paper, BA-NOSB", (1.06, 1.75, 2.32), (0.091, 0.145, 0.181)),
]


def percent(value: float) -> str:
    return f"{100 * value:+.4f}" if abs(value) < 5e-4 else f"{100 * value:+.2f}"


def table(results, exact) -> str:
    """Errors against the exact slightly compressible solution at the three stretches, and the
    roughness at the last.
    """
    rows = []
    for title, result in results:
        stress = [percent(level["nominal_stress_error"]) for level in result.levels]
        lateral = [percent(level["lateral_displacement_error"]) for level in result.levels]
        rows.append(
            [
                title,
                " / ".join(stress),
                " / ".join(lateral),
                f"{result.levels[-1]['roughness']:.1e}",
            ]
        )
    for title, stresses, laterals in PAPER:
        stress = [
            percent(value / level["nominal_stress_reference"] - 1)
            for value, level in zip(stresses, exact, strict=True)
        ]
        lateral = [
            percent(value / level["lateral_displacement_reference"] - 1)
            for value, level in zip(laterals, exact, strict=True)
        ]
        rows.append([title, " / ".join(stress), " / ".join(lateral), ""])
    return markdown_table(
        [
            "force",
            "nominal stress, error (%)",
            "lateral displacement, error (%)",
            "roughness of u2",
        ],
        rows,
    )


def zero_energy_figure(smooth, rough) -> Figure:
    """u2 along the upper edge and over the sheet, NOSB beside the surrogate, both with one held
    column of points.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 2.9), layout="constrained")
        axes = figure.subplots(2, 2, gridspec_kw={"height_ratios": [1, 1.2]})
        greatest = max(abs(result.displacement(0)[:, 1]).max() for result in (smooth, rough))
        for column, (result, title) in enumerate(((rough, "NOSB"), (smooth, "surrogate"))):
            points, moved = result.body.points, result.displacement(0)
            sheet, line = axes[:, column]
            drawn = draw_cells(sheet, *result.cells(0), moved[:, 1], (-greatest, greatest))
            sheet.set_axis_off()
            sheet.set_title(f"{title}, stretch 1.5: roughness {result.levels[0]['roughness']:.1e}")
            upper = points[:, 1] > points[:, 1].max() - 1e-9
            line.plot(points[upper, 0], moved[upper, 1], lw=0.8)
            line.set(xlabel="x₁ (cm)", ylim=(-0.15, -0.04))
        axes[1, 0].set_ylabel("u₂ of the upper row (cm)")
        figure.colorbar(drawn, ax=axes[0, :], label="u₂ (cm)", fraction=0.02)
        return figure


def section() -> str:
    """Run all, and draw the figures."""
    results = [
        (title, pds.simulate(pds.load_scene("uniaxial", changes), force))
        for title, force, changes in RUNS
    ]
    named = dict(results)
    save(named["surrogate, isochoric features (default)"].figure(), FIGURES / "uniaxial.png")
    save(
        zero_energy_figure(named["surrogate, held columns"], named["NOSB, held columns"]),
        FIGURES / "zero-energy.png",
    )
    return table(results, results[0][1].levels)


if __name__ == "__main__":
    report(__doc__, {"section-6.2": section})
