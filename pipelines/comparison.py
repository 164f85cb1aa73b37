"""Speed and error of every force model of Neo-Hookean sheets, timed in turns of milliseconds:
`timings.py speed` makes tables and a figure of it.
"""

import itertools

import matplotlib
import numba
import numpy as np
from clock import TimedModel, measure_speed, sheet
from matplotlib.figure import Figure

import pdsurrogate as pds
from pdsurrogate import learning
from pdsurrogate.engine.threads import most_threads
from pdsurrogate.forces import FORCES, EnergySurrogate, ForceSurrogate
from pdsurrogate.forces.kernel_values import kernel_bond_force, kernel_energy
from pdsurrogate.learning.sobolev import SobolevRegressor
from pdsurrogate.results.figures import STYLE
from pdsurrogate.results.provenance import processor

LAW = pds.materials.NeoHookean()
REACH = learning.reachable_stretches(LAW)
BOTH = ("float32", "float64")
SAMPLES = 20_000
"""Number of states at which errors are measured."""


def candidates() -> list[TimedModel]:
    """Force models to be compared, shipped or fitted, one for each precision: the exact ones, NOSB
    and BA-NOSB first, and surrogates of several sizes.
    """
    samples = learning.training_samples(LAW, 8000, REACH, random_state=0)
    energies = learning.training_samples(
        LAW, 2000, learning.reachable_stretches(LAW, (0.5, 5.0)), target="sheet-energy"
    )

    def fitted(regressor, features: str, drawn=samples) -> pds.forces.ForceModel:
        model = learning.surrogate_pipeline(regressor, features).fit(drawn.X, drawn.y)
        return learning.surrogate_of(model, LAW, drawn)

    def network(features: str, units: int) -> pds.forces.ForceModel:
        regressor = learning.LevenbergMarquardtRegressor(
            (units,), "algebraic", max_iter=600, n_iter_no_change=100, random_state=0
        )
        return fitted(regressor, features)

    exact = [name for name in FORCES if "stress" in pds.load_surrogate(name).honors["plane"]]
    found = [
        (name, pds.load_surrogate(name), ("float64",))
        for name in dict.fromkeys(("nosb", "ba-nosb", *exact))
    ]
    # Its domain is too small for the scene (theory, section 5): as in the paper, it is also
    # evaluated outside.
    paper, outside = "network, paper's features, 20 units", "outside=extrapolate"
    found.append((paper, pds.load_surrogate("neo-hookean-paper"), BOTH[:1], outside))
    symmetric = {units: network("symmetric", units) for units in (8, 12, 40)}
    symmetric[20] = pds.load_surrogate("neo-hookean@1")
    for units, model in sorted(symmetric.items()):
        precisions = BOTH if units == 20 else BOTH[:1]
        found.append((f"network, symmetric, {units} units", model, precisions))
    energy = fitted(SobolevRegressor(12, max_iter=1000, random_state=0), "sheet-energy", energies)
    found.append(("bond-level energy, network, 12 units", energy, BOTH))
    default = pds.load_surrogate("neo-hookean@2"), BOTH[:1]
    found.append(("network, isochoric, 4 units", *default))
    found.append(("network, isochoric, 8 units", network("isochoric", 8), BOTH[:1]))
    polynomial = fitted(learning.ChebyshevRegressor(4), "isochoric")
    found.append(("polynomial, isochoric, degree 4", polynomial, BOTH[:1]))
    return [
        TimedModel(model, precision, sheet(), title, tuple(changes))
        for title, model, precisions, *changes in found
        for precision in precisions
    ]


def measure_error(entry: TimedModel) -> dict:
    """Relative errors (RMS and greatest) of a learned model against the exact law, of the compiled
    kernel in its own precision, and the least slope of the force by the bond stretch; empty for
    other models.

    A model of bond forces is tested at states that satisfy plane stress (``on_surface``) and at
    others (``off_surface``), an energy by its stresses at the former only.
    """
    if isinstance(entry.model, EnergySurrogate):
        samples = learning.training_samples(
            LAW, SAMPLES, REACH, 0.25, 1_000_003, target="sheet-energy"
        )
        found = kernel_energy(entry.model, LAW, entry.precision, *samples.X.T)
        errors = samples.target.errors(np.stack(found, axis=1), samples)
        return {"rms_on_surface": errors["rms"], "max_on_surface": errors["max"]}
    if not isinstance(entry.model, ForceSurrogate):
        return {}
    compiled = kernel_bond_force(entry.model, LAW, entry.precision)
    report = learning.evaluate(compiled, LAW, REACH, n_samples=SAMPLES)
    # Differences of single-precision forces would be noise: the slope is that of the same model in
    # double precision.
    slope = learning.evaluate(entry.model.bond_force, LAW, REACH, n_samples=SAMPLES)["least_slope"]
    errors = {
        f"{kind}_{where}": report[where][kind]
        for where in ("on_surface", "off_surface")
        for kind in ("rms", "max")
    }
    return {**errors, "least_slope": slope}


def measure_scene(entry: TimedModel) -> dict:
    """Greatest errors and cost of the paper's section 6.2 with a force model; empty if it fails."""
    scene = pds.load_scene("uniaxial", [f"precision={entry.precision}", *entry.changes])
    try:
        result = pds.simulate(scene, entry.model)
    except pds.SimulationFailed:
        return {}
    errors = {
        f"scene_{key}": 100 * max(abs(level[f"{key}_error"]) for level in result.levels)
        for key in ("nominal_stress", "lateral_displacement")
    }
    seconds = result.summary["seconds_total"] - result.summary["seconds_compile"]
    cost = {"scene_evaluations": result.summary["n_force_evaluations"], "scene_seconds": seconds}
    return errors | cost


def compare() -> dict:
    """Speed and error of force models: the ``machine``, and in ``models`` a row for each model and
    precision.
    """
    entries, rows = candidates(), []
    for entry, speed in zip(entries, measure_speed(entries, LAW), strict=True):
        described = {"model": f"{entry.title}, {entry.precision}"}
        rows.append(described | speed | measure_error(entry) | measure_scene(entry))
    nosb, rival = (rows[number]["ns_per_directed_bond_1"] for number in (0, 1))
    for row in rows:
        row["thread_speedup"] = row["ns_per_directed_bond_1"] / row["ns_per_directed_bond_all"]
        row["speedup_over_ba_nosb"] = rival / row["ns_per_directed_bond_1"]
        row["cost_over_nosb"] = row["ns_per_directed_bond_1"] / nosb
    machine = f"{processor()}, {most_threads()} threads, numba {numba.__version__}"
    return {"machine": machine, "models": rows}


TABLES = {
    "Cost of a force evaluation in ns per directed bond": {
        "1 thread": "{ns_per_directed_bond_1:.2f}",
        "all threads": "{ns_per_directed_bond_all:.2f}",
        "speed-up": "{thread_speedup:.2f}",
        "BA-NOSB / model": "{speedup_over_ba_nosb:.1f}",
        "model / NOSB": "{cost_over_nosb:.1f}",
    },
    "Error of the force, relative to the exact one": {
        "RMS, plane stress": "{rms_on_surface:.0e}",
        "RMS, other states": "{rms_off_surface:.0e}",
        "greatest, plane stress": "{max_on_surface:.0e}",
        "greatest, other states": "{max_off_surface:.0e}",
        "least slope": "{least_slope:.2f}",
    },
    "Uniaxial scene (section 6.2 of the paper)": {
        "stress error (%)": "{scene_nominal_stress:.2g}",
        "displacement error (%)": "{scene_lateral_displacement:.2g}",
        "force evaluations": "{scene_evaluations}",
        "time (s)": "{scene_seconds:.2f}",
    },
}
"""Titles of columns, with the formats by which their cells show a row of the report, by the title
of the table.
"""


def table(report: dict, title: str) -> tuple[list[str], list[list[str]]]:
    """Header and rows, as texts, of a table of a report by `compare`; a dash is in the place of
    what a row lacks.
    """
    columns = {"model": "{model}"} | TABLES[title]

    def cell(form: str, row: dict) -> str:
        try:
            return form.format(**row)
        except KeyError:
            return "failed" if "scene" in form else "-"

    return list(columns), [
        [cell(form, row) for form in columns.values()] for row in report["models"]
    ]


def pareto_figure(report: dict) -> Figure:
    """RMS force errors at states that do not satisfy plane stress, against the cost; a model
    without a measured error is a vertical line at its cost.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(8.6, 4.4), layout="constrained")
        axis, colors = figure.subplots(), matplotlib.colormaps["tab20"].colors
        for row, color in zip(report["models"], itertools.cycle(colors)):
            look, cost = {"color": color, "label": row["model"]}, row["ns_per_directed_bond_1"]
            if "rms_off_surface" in row:
                axis.plot(cost, max(row["rms_off_surface"], 1e-9), "o", ms=6, **look)
            else:
                axis.axvline(cost, lw=1.2, ls="--", **look)
        figure.legend(loc="outside right upper", fontsize=7, frameon=False)
        axis.set(
            xscale="log",
            yscale="log",
            xlabel="whole force evaluation, ns per directed bond, one thread",
            ylabel="relative RMS force error off the surface",
            title=report["machine"],
        )
        axis.grid(alpha=0.3)
        return figure
