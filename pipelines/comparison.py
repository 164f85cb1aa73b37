"""Speed and error of every force model, timed in turns of milliseconds, with a table and a figure
of the comparison.

python pipelines/comparison.py                     all models, in some minutes python
pipelines/comparison.py --quick --law gent  fewer models and shorter timings, not for publication,
for a law python pipelines/comparison.py --force mine        chosen models, as for `pdsurrogate
run`, next to NOSB and BA-NOSB
"""

import argparse
import itertools
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import matplotlib
import numba
import numpy as np
from clock import UNDISTURBED, TimedModel, measure_speed, sheet
from matplotlib.figure import Figure
from pages import markdown_table

from pdsurrogate import learning
from pdsurrogate.artifacts import load_surrogate
from pdsurrogate.body import Body
from pdsurrogate.engine.threads import most_threads, thread_count
from pdsurrogate.forces import (
    FORCES,
    BANOSBForce,
    EnergySurrogate,
    ForceModel,
    ForceSurrogate,
    NOSBForce,
)
from pdsurrogate.forces.kernel_values import kernel_bond_force, kernel_energy
from pdsurrogate.learning.sobolev import SobolevRegressor
from pdsurrogate.materials import LAWS, Law, NeoHookean
from pdsurrogate.progress import part
from pdsurrogate.results.figures import STYLE
from pdsurrogate.results.provenance import processor
from pdsurrogate.run.simulate import SimulationFailed, SimulationInterrupted, simulate
from pdsurrogate.scenes import load_scene

RIVAL, REFERENCE = BANOSBForce.name, NOSBForce.name
"""Names of the two models with which the cost of every model is compared."""

SHIPPED = {("symmetric", 20): "neo-hookean@1", ("isochoric", 4): "neo-hookean@2"}
"""Shipped artifacts of Neo-Hookean rubber, used instead of a fit, by their feature set and
number of hidden units.
"""


class Plan(NamedTuple):
    """Force model to be compared: its title, a function that loads or fits it, its precisions, and
    changes to the scene of `measure_scene`.

    ``{size}`` in the title stands for `ForceModel.size`; a change is a text KEY=VALUE.
    """

    title: str
    made: Callable[[], ForceModel]
    precisions: tuple[str, ...] = ("float32",)
    changes: tuple[str, ...] = ()


def plans(law: Law, quick: bool, references: Sequence[str] | None = None) -> Iterator[Plan]:
    """Yield plans of the force models to be compared for a law: NOSB, BA-NOSB, and those of
    `references` or, by default, all others.

    These are the other models of `FORCES` for plane stress, and surrogates of several sizes: fitted
    to the law, except for the networks in `SHIPPED` and "neo-hookean-paper" for Neo-Hookean rubber.
    `quick` selects fewer models, smaller fits and, of a surrogate, single precision only.
    """
    both = ("float32",) if quick else ("float32", "float64")
    exact = (name for name, model in FORCES.items() if "stress" in model().honors["plane"])
    for name in dict.fromkeys((REFERENCE, RIVAL, *(exact if references is None else references))):
        yield Plan(name, partial(load_surrogate, name), ("float64",) if name in FORCES else both)
    if references is not None:
        return
    shipped = isinstance(law, NeoHookean)
    samples = learning.training_samples(
        law, 3000 if quick else 8000, learning.reachable_stretches(law), random_state=0
    )

    def fitted(features, regressor) -> ForceSurrogate:
        model = learning.surrogate_pipeline(regressor, features=features).fit(samples.X, samples.y)
        return learning.surrogate_of(model, law, samples)

    def network(features: str, units: int, precisions: tuple[str, ...] = ("float32",)) -> Plan:
        iterations = 150 if quick else 600
        regressor = learning.LevenbergMarquardtRegressor(
            (units,), "algebraic", max_iter=iterations, n_iter_no_change=100, random_state=0
        )
        artifact = SHIPPED.get((features, units)) if shipped else None
        made = (
            partial(fitted, features, regressor)
            if artifact is None
            else partial(load_surrogate, artifact)
        )
        return Plan(f"network, {features}, {units} units", made, precisions)

    def fitted_energy() -> EnergySurrogate:
        reach = learning.reachable_stretches(law, (0.5, 5.0))
        energies = learning.training_samples(
            law, 1000 if quick else 2000, reach, target="sheet-energy"
        )
        regressor = SobolevRegressor(12, max_iter=200 if quick else 1000, random_state=0)
        return learning.surrogate_of(
            learning.surrogate_pipeline(regressor, "sheet-energy").fit(energies.X, energies.y),
            law,
            energies,
        )

    if shipped and not quick:
        # Its domain is too small for the scene (theory, section 5): as in the paper, it is also
        # evaluated outside.
        paper = partial(load_surrogate, "neo-hookean-paper")
        yield Plan("network, paper's features, 20 units", paper, changes=("outside=extrapolate",))
    for units in (20 if shipped else 12,) if quick else (8, 12, 20, 40):
        yield network("symmetric", units, both if units == 20 else both[:1])
    yield Plan("bond-level energy, network, 12 units", fitted_energy, both)
    for units in (8,) if quick else (4, 8):
        yield network("isochoric", units)
    # The response of Neo-Hookean rubber does not depend on the isochoric features; other laws need
    # higher degrees.
    for degree in (4,) if shipped else (((10, 4),) if quick else ((8, 4), (10, 4), (12, 6))):
        yield Plan(
            "polynomial, isochoric, {size}",
            partial(fitted, "isochoric", learning.ChebyshevRegressor(degree)),
        )


def candidates(
    law: Law, quick: bool, body: Body, references: Sequence[str] | None = None
) -> list[TimedModel]:
    """Return the force models to be compared for a law, loaded or fitted, one for each precision,
    to be timed on `body`.

    `references` are the models to compare, see `plans`; raise ValueError if one does not describe
    sheets of this law in plane stress.
    """
    planned, found = list(plans(law, quick, references)), []
    for number, plan in enumerate(planned):
        what = plan.title.replace("{size}", "").removesuffix(", ")
        with part("fitting", number, len(planned), model=what):
            model = plan.made()
        if "stress" not in model.honors["plane"]:
            raise ValueError(
                f"{plan.title} does not describe plane stress, for which compare measures force"
                " models"
            )
        model.check_material(law)
        title = plan.title.replace("{size}", model.size)
        found += [
            TimedModel(model, precision, body, title, plan.changes) for precision in plan.precisions
        ]
    return found


def measure_error(entry: TimedModel, law: Law, n_samples: int) -> dict:
    """Return the errors of a learned model against the exact law at `n_samples` states; empty for
    other models.

    They are relative errors (RMS and greatest) of the compiled kernel in its own precision. A model
    of bond forces is tested at states that satisfy plane stress (``on_surface``) and at others
    (``off_surface``), an energy by its stresses at the former only. For bond forces ``least_slope``
    is added: the least derivative of the force along the bond by the bond stretch, in double
    precision.
    """
    if isinstance(entry.model, EnergySurrogate):
        # An energy gives the stress on the surface only, since C33 is not among its inputs.
        samples = learning.training_samples(
            law,
            n_samples,
            learning.reachable_stretches(law),
            0.25,
            1_000_003,
            target="sheet-energy",
        )
        errors = samples.target.errors(
            np.stack(kernel_energy(entry.model, law, entry.precision, *samples.X.T), axis=1),
            samples,
        )
        return {"rms_on_surface": errors["rms"], "max_on_surface": errors["max"]}
    if not isinstance(entry.model, ForceSurrogate):
        return {}
    reach = learning.reachable_stretches(law)
    report = learning.evaluate(
        kernel_bond_force(entry.model, law, entry.precision), law, reach, n_samples=n_samples
    )
    # Differences of single-precision forces would be noise: the slope is that of the same model in
    # double precision.
    slope = (
        report
        if entry.precision == "float64"
        else learning.evaluate(entry.model.bond_force, law, reach, n_samples=n_samples)
    )
    errors = {
        f"{kind}_{where}": report[where][kind]
        for where in ("on_surface", "off_surface")
        for kind in ("rms", "max")
    }
    return {**errors, "least_slope": slope["least_slope"]}


def measure_scene(entry: TimedModel, law: Law, spacing: float) -> dict:
    """Run the uniaxial scene of the paper's section 6.2 with a force model, and return its errors
    and cost as columns of a row.

    The columns are the greatest relative errors of nominal stress and lateral displacement over the
    stretches (against the exact uniaxial solution), the number of force evaluations, the seconds
    without compilation, and the solver's method; or else the reason of a failure.
    """
    changes = [f"spacing={spacing}", f"precision={entry.precision}", *entry.changes]
    scene = load_scene("uniaxial", changes, material=law.describe())
    try:
        result = simulate(scene, entry.model)
    except SimulationInterrupted:
        raise KeyboardInterrupt from None
    except SimulationFailed as error:
        return {"scene_failure": str(error)}
    return {
        "scene_stress_error": max(abs(level["nominal_stress_error"]) for level in result.levels),
        "scene_displacement_error": max(
            abs(level["lateral_displacement_error"]) for level in result.levels
        ),
        "scene_evaluations": result.summary["n_force_evaluations"],
        "scene_seconds": result.summary["seconds_total"] - result.summary["seconds_compile"],
        "scene_method": result.levels[-1]["method"],
    }


def compare(
    law: Law | None = None,
    quick: bool = False,
    threads: int | None = None,
    references: Sequence[str] | None = None,
) -> dict:
    """Measure the speed and the error of force models.

    Parameters
    ----------
    law : Law, optional
        Material of the comparison; by default Neo-Hookean rubber with K = 100 mu.
    quick : bool
        Coarser scene, fewer models, smaller fits and shorter timings: for a first look, not for
        quoting.
    threads : int, optional
        Greatest number of threads that is measured; by default all.
    references : sequence of str, optional
        Force models to compare with NOSB and BA-NOSB, as for `load_surrogate`; by default all exact
        ones, and surrogates of several sizes.

    Returns
    -------
    dict
        ``machine``, ``material``, ``settings``, and in ``models`` a list of rows, one for each
        model and precision.

    Raises
    ------
    ValueError
        If `threads` is greater than the number of available threads, or a model of `references`
        does not describe the law in plane stress.
    """
    law, body = law or NeoHookean(), sheet()
    spacing, patience, n_samples = (0.05, 10.0, 2000) if quick else (0.02, 200.0, 20_000)
    with thread_count(threads, limit=True):
        entries, rows = candidates(law, quick, body, references), []
        speeds = measure_speed(entries, law, patience)
        for number, (entry, speed) in enumerate(zip(entries, speeds, strict=True)):
            described = {
                "force": entry.title,
                "precision": entry.precision,
                "size": entry.model.size,
            }
            with part(
                "errors and uniaxial scene",
                number,
                len(entries),
                model=f"{entry.title}, {entry.precision}",
            ):
                rows.append(
                    {
                        **described,
                        **speed,
                        **measure_error(entry, law, n_samples),
                        **measure_scene(entry, law, spacing),
                    }
                )
        cost = {row["force"]: row["ns_per_directed_bond_1"] for row in rows}
        for row in rows:
            row["speedup_over_ba_nosb"] = cost[RIVAL] / row["ns_per_directed_bond_1"]
            row["cost_over_nosb"] = row["ns_per_directed_bond_1"] / cost[REFERENCE]
        return {
            "machine": {
                "processor": processor(),
                "threads": most_threads(),
                "numba": numba.__version__,
            },
            "material": law.describe(),
            "settings": {
                "quick": quick,
                "points": len(body),
                "patience": patience,
                "scene_spacing": spacing,
            },
            "models": rows,
        }


MODEL = {"model": "{force}, {precision}"}

TABLES = {
    "Cost of a force evaluation in ns per directed bond": {
        "1 thread": "{ns_per_directed_bond_1:.2f}",
        "bond pass": "{ns_bond_pass_1:.2f}",
        "all threads": "{ns_per_directed_bond_all:.2f}",
        "speed-up": "{thread_speedup:.2f}",
        "ideal": "{arithmetic_speedup:.2f}",
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
        "stress error (%)": "{scene_stress_error:.2g}",
        "displacement error (%)": "{scene_displacement_error:.2g}",
        "force evaluations": "{scene_evaluations}",
        "time (s)": "{scene_seconds:.2f}",
    },
}
"""Tables of a comparison: for each title the titles of its columns, with the formats by which their
cells show a row of the report.

``ideal`` is the speed-up of arithmetic that needs no memory; ``bond pass`` is the part of an
evaluation on one thread that runs over bonds.
"""


def table(report: dict, title: str) -> tuple[list[str], list[list[str]]]:
    """Return the header and the rows, as texts, of a table (`TABLES`) of a report by `compare`:
    a row for each model and precision.
    """
    columns = MODEL | TABLES[title]
    return list(columns), [
        [_cell(form, row) for form in columns.values()] for row in report["models"]
    ]


def _cell(form: str, row: dict) -> str:
    """Return the text of a table cell from a format and a row of the report.

    If the row lacks the value, the text is "failed" for a column about the run of a scene, and
    ``-`` for any other column.
    """
    percent = {
        key: 100 * row[key]
        for key in ("scene_stress_error", "scene_displacement_error")
        if key in row
    }
    try:
        return form.format(**{**row, **percent})
    except KeyError:
        return "failed" if "scene" in form else "-"


def caution(rows: list[dict]) -> str:
    """Return the text of a warning if other work on the machine disturbed the timings of a
    report's rows; empty if not.
    """
    most = max(max(row["disturbance_1"], row["disturbance_all"]) for row in rows)
    if most <= UNDISTURBED:
        return ""
    slower = f"the reference arithmetic took up to {most:.2f} times its shortest time"
    return f"Other processes used the cores: {slower}, so the costs may be off by the same factor."


def pareto_figure(report: dict) -> Figure:
    """Return a figure of the models' RMS force errors at states that do not satisfy plane stress,
    against their cost.

    `report` is a result of `compare`. A model without a measured error is drawn as a vertical line
    at its cost.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(8.6, 4.4), layout="constrained")
        axis, floor = figure.subplots(), 1e-9
        costs = [row["ns_per_directed_bond_1"] for row in report["models"]]
        for row, cost, color in zip(
            report["models"], costs, itertools.cycle(matplotlib.colormaps["tab20"].colors)
        ):
            label = f"{row['force']}, {row['precision']}"
            if "rms_off_surface" in row:
                marker = (
                    "s" if row["force"] in FORCES else "o" if row["precision"] == "float32" else "^"
                )
                axis.plot(
                    cost, max(row["rms_off_surface"], floor), marker, ms=6, color=color, label=label
                )
            else:
                axis.axvline(cost, color=color, lw=1.2, ls="--", label=label)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer models and shorter timings")
    parser.add_argument(
        "--law",
        default="neo-hookean",
        choices=sorted(LAWS),
        help="law, with its default parameters",
    )
    parser.add_argument(
        "--force", action="append", help="force model; may be repeated (default: all)"
    )
    parser.add_argument("--threads", type=int, help="greatest number of threads (default: all)")
    arguments = parser.parse_args()
    report = compare(LAWS[arguments.law](), arguments.quick, arguments.threads, arguments.force)
    for title in TABLES:
        print(f"{title}:\n\n{markdown_table(*table(report, title))}\n")
    print(caution(report["models"]))


if __name__ == "__main__":
    main()
