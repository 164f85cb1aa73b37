"""Tables and figures of the comparison."""

import itertools

import matplotlib
from matplotlib.figure import Figure

from ..results.figures import STYLE
from .speed import UNDISTURBED

COLUMNS = {
    "force": "{force}, {precision}",
    "ns/directed bond, 1 thread": "{ns_per_directed_bond_1:.2f}",
    "its bond pass": "{ns_bond_pass_1:.2f}",
    "all threads": "{ns_per_directed_bond_all:.2f}",
    "gain, of arithmetic's": "{thread_speedup:.2f} of {arithmetic_speedup:.2f}",
    "BA-NOSB / this": "{speedup_over_ba_nosb:.1f}",
    "this / NOSB": "{cost_over_nosb:.1f}",
    "RMS error on / off surface": "{rms_on_surface:.0e} / {rms_off_surface:.0e}",
    "greatest error": "{max_on_surface:.0e} / {max_off_surface:.0e}",
    "least slope": "{least_slope:.2f}",
    "6.2: stress / displ. error (%)": "{scene_stress_error:.2g} / {scene_displacement_error:.2g}",
    "6.2: evaluations, s": "{scene_evaluations}, {scene_seconds:.2f}",
}
"""Title of each column of the comparison, and the form of its entries."""


def table(report: dict) -> tuple[list[str], list[list[str]]]:
    """Return the header and the rows of the comparison."""
    return list(COLUMNS), [[_cell(form, row) for form in COLUMNS.values()] for row in report["models"]]


def _cell(form: str, row: dict) -> str:
    """Return an entry, with errors of the scene in per cent; ``-`` for a figure that a model does not have."""
    percent = {key: 100 * row[key] for key in ("scene_stress_error", "scene_displacement_error") if key in row}
    try:
        return form.format(**{**row, **percent})
    except KeyError:
        return "failed" if "scene" in form else "-"


def caution(rows: list[dict]) -> str:
    """Return a warning if other work on the machine disturbed the timings; empty if not."""
    most = max(max(row["disturbance_1"], row["disturbance_all"]) for row in rows)
    if most <= UNDISTURBED:
        return ""
    return f"Other work used the cores: the reference arithmetic took up to {most:.2f} times its best; ratios are no more accurate."


def pareto_figure(report: dict) -> Figure:
    """Draw force error against cost; models without a bond force are drawn as vertical lines."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(8.6, 4.4), layout="constrained")
        axis, floor = figure.subplots(), 1e-9
        costs = [row["ns_per_directed_bond_1"] for row in report["models"]]
        for row, cost, colour in zip(report["models"], costs, itertools.cycle(matplotlib.colormaps["tab20"].colors)):
            label = f"{row['force']}, {row['precision']}"
            if "rms_off_surface" in row:
                marker = "s" if row["force"].startswith("analytic") else "o" if row["precision"] == "float32" else "^"
                axis.plot(cost, max(row["rms_off_surface"], floor), marker, ms=6, color=colour, label=label)
            else:
                axis.axvline(cost, color=colour, lw=1.2, ls="--", label=label)
        figure.legend(loc="outside right upper", fontsize=7, frameon=False)
        low, high = 0.8 * min(costs), 2.0 * max(costs)
        axis.set(
            xscale="log",
            yscale="log",
            xlim=(low, high),
            xlabel="whole force evaluation, ns per directed bond, one thread",
            ylabel="relative RMS force error off the surface",
            title=f"{report['material']['law']}, {report['machine']['processor']}",
        )
        ticks = [tick for tick in (1, 2, 3, 5, 10, 20, 50, 100, 200, 500) if low < tick < high]
        axis.set_xticks(ticks, map(str, ticks))
        axis.set_xticks([], minor=True)
        axis.grid(alpha=0.3)
        return figure
