"""Laws of rubber: identification from test data, and where a surrogate earns its keep.

python pipelines/materials_report.py            print the tables, and write them with the figure of
the fits to docs/figures python pipelines/materials_report.py --docs   and put them into the
documentation
"""

from __future__ import annotations

import argparse
from pathlib import Path

import comparison
import numpy as np
from clock import TimedModel, bench_positions, measure_speed, sheet
from pages import FIGURES, markdown_table, replace_block
from rich.console import Console
from rich.table import Table

import pdsurrogate as pds
from pdsurrogate.identification import figure, fitted_laws, held_out_modes, report
from pdsurrogate.learning import surrogate_of
from pdsurrogate.materials import plane_stress
from pdsurrogate.results import figures
from pdsurrogate.results.files import write_json
from pdsurrogate.results.provenance import processor

DEGREES = ((1, 0), (4, 2), (5, 2), (6, 3), (7, 3), (8, 3), (9, 3), (10, 3), (12, 6))
"""Of the polynomials that are tried, from cheap to dear."""

TOLERANCE = 2e-3
"""Relative RMS force error, on and off the surface, that a surrogate must keep."""

INCOMPRESSIBLE = 1e7
"""K/mu at which constants are compared with published ones, which are of rubber that keeps its
volume.
"""

console = Console(width=150)

PUBLISHED = (
    (
        "ogden",
        "all modes, weighted by scatter",
        {"shear modulus": 0.4225},
        "Ogden, Proc. R. Soc. A 326 (1972) 565",
    ),
    (
        "arruda-boyce",
        "all modes, weighted by scatter",
        {"chain links": 26.5},
        "Arruda, Boyce, J. Mech. Phys. Solids 41 (1993) 389",
    ),
    (
        "gent",
        "tension, equal weights",
        {"shear modulus": 0.24, "chain limit": 79.97},
        "Hyperelastics.jl, example treloar.jl",
    ),
    (
        "yeoh",
        "tension, equal weights",
        {"C10": 0.18, "C20": -2e-3, "C30": 5e-5},
        "Altair Radioss, RD-V: 0210",
    ),
)
"""Constants of Treloar's rubber, in MPa, as others give them: law, the data fitted to and their
weights, constants and source.
"""

CONSTANTS = {
    "shear modulus": lambda law: law.shear_modulus,
    "chain links": lambda law: law.chain_links,
    "chain limit": lambda law: law.chain_limit,
    "C10": lambda law: law.shear_modulus / 2,
    "C20": lambda law: law.shear_modulus / 2 * law.second,
    "C30": lambda law: law.shear_modulus / 2 * law.third,
}
"""The same of a law fitted here."""


def show(title: str, rows: list[dict]) -> None:
    """Print rows as a table."""
    table = Table(title=title, title_justify="left")
    for key in rows[0]:
        table.add_column(key, justify="left" if isinstance(rows[0][key], str) else "right")
    for row in rows:
        table.add_row(
            *(f"{value:.3g}" if isinstance(value, float) else str(value) for value in row.values())
        )
    console.print(table)


def as_markdown(rows: list[dict]) -> str:
    """The same rows for the documentation."""
    body = [
        [f"{value:.3g}" if isinstance(value, float) else str(value) for value in row.values()]
        for row in rows
    ]
    return markdown_table(list(rows[0]), body)


def identification(folder: Path) -> dict:
    """All laws on Treloar's data; Kawabata's grid predicted with the same parameters."""
    treloar, kawabata = pds.load_test_data("treloar"), pds.load_test_data("kawabata")
    models, rows, found = [], [], []
    for name in fitted_laws():
        model = pds.identification.LawRegressor(name).fit(
            treloar.stretches, treloar.nominal_stress, treloar.balanced_weights()
        )
        uniform = pds.identification.LawRegressor(name).fit(
            treloar.stretches, treloar.nominal_stress
        )
        models.append(model)
        found.append({**report(model, treloar), "uniform_weights": report(uniform, treloar)})
        predicted = model.predict(kawabata.stretches)
        pairs = zip(model.parameter_names_, model.parameters_, model.standard_errors_, strict=True)
        rows.append(
            {
                "law": name,
                "parameters (standard error)": ", ".join(
                    f"{key} {value:.4g} ({error:.1g})" for key, value, error in pairs
                ),
                **{f"R2 {mode}": f"{value:.4f}" for mode, value in found[-1]["r_squared"].items()},
                "R2 Kawabata": f"{kawabata.r_squared(predicted)['biaxial']:.4f}",
            }
        )
        found[-1]["r_squared_kawabata"] = kawabata.r_squared(predicted)["biaxial"]
    show(
        "Treloar's data, the three modes weighted alike; Kawabata's grid is predicted, not fitted",
        rows,
    )
    held_out = held_out_modes(
        [pds.identification.LawRegressor(name) for name in fitted_laws()], treloar, ["uniaxial"]
    )
    show(
        "Fitted to uniaxial tension alone",
        [
            {
                "law": row["law"],
                **{f"R2 {mode}": f"{value:.3f}" for mode, value in row["held_out"].items()},
                "RMS": row["relative_rms"],
            }
            for row in held_out
        ],
    )
    figures.save(
        figure([model for model in models if model.law in ("gent", "yeoh", "ogden")], treloar),
        folder / "identification.png",
    )
    return {"laws": found, "fitted_to_uniaxial": held_out, "table": rows}


def beside_published() -> list[dict]:
    """Constants found here and by others."""
    data = pds.load_test_data("treloar")
    tension = data.of("uniaxial")
    fits = {
        "all modes, weighted by scatter": (
            data.stretches,
            data.nominal_stress,
            data.balanced_weights(),
        ),
        "tension, equal weights": (tension.stretches, tension.nominal_stress),
    }
    rows = []
    for name, fitted_to, constants, source in PUBLISHED:
        law = (
            pds.identification.LawRegressor(name, bulk_ratio=INCOMPRESSIBLE)
            .fit(*fits[fitted_to])
            .law_
        )
        for constant, value in constants.items():
            found = {
                "this package": CONSTANTS[constant](law),
                "published": f"{value:g}",
                "source": source,
            }
            rows.append({"law": name, "fitted to": fitted_to, "constant": constant, **found})
    show("Treloar's rubber, in MPa", rows)
    return rows


def surrogate(law, degree):
    """Polynomial surrogate of a law."""
    samples = pds.training_samples(law, 8000, pds.learning.reachable_stretches(law), random_state=0)
    model = pds.surrogate_pipeline(
        pds.learning.ChebyshevRegressor(degree), features="isochoric"
    ).fit(samples.X, samples.y)
    return surrogate_of(model, law, samples)


def errors_of(model, law) -> tuple[float, float]:
    """Relative RMS force error on and off the surface."""
    found = pds.evaluate(model.bond_force, law, pds.learning.reachable_stretches(law))
    return found["on_surface"]["rms"], found["off_surface"]["rms"]


def cheapest(law):
    """The smallest polynomial within the tolerance."""
    return next(
        model
        for model in (surrogate(law, degree) for degree in DEGREES)
        if max(errors_of(model, law)) <= TOLERANCE
    )


def scene_errors(law, model) -> tuple[float, float]:
    """Relative errors of nominal stress and lateral displacement in the uniaxial scene at
    stretch 2.
    """
    scene = pds.load_scene(
        "uniaxial", {"spacing": 0.05, "stretches": [2.0]}, material=law.describe()
    )
    level = pds.simulate(scene, model).levels[-1]
    return abs(level["nominal_stress_error"]), abs(level["lateral_displacement_error"])


def thickness_error(model, law, precision: str) -> float:
    """Greatest relative error of J3 from the learned force in the waved state of the comparison;
    NaN where the law is solved.
    """
    from pdsurrogate.forces import ForceSettings

    body = pds.Body.rectangle(3.0, 1.0, 0.05, 3.15 * 0.05)
    positions = bench_positions(body, law)
    force = model.bind(body, law, ForceSettings(precision=precision))
    force(positions, np.empty_like(positions))
    if not force.learned_thickness:
        return float("nan")
    trace, J = plane_stress.invariants(force.deformation_gradients())
    return float(np.abs(force.volume_ratios() / plane_stress.volume_ratio(law, trace, J) - 1).max())


def speed(quick: bool) -> tuple[list[dict], str]:
    """Cost of the exact bond force and of its surrogate for every law, and how far to trust it."""
    rows, costs, body = [], [], sheet()
    for law in (law() for law in pds.materials.LAWS.values()):
        model, finer = cheapest(law), surrogate(law, DEGREES[-1])
        cases = [
            TimedModel(pds.AnalyticBondForce(law), "float64", body),
            TimedModel(model, "float32", body),
        ]
        exact, learned = measure_speed(cases, law, 2.0 if quick else 40.0)
        costs += [exact, learned]
        slope = pds.evaluate(
            pds.AnalyticBondForce(law).bond_force, law, pds.learning.reachable_stretches(law), 5000
        )["least_slope_exact"]
        errors = [errors_of(candidate, law) for candidate in (model, finer)]
        stress, displacement = scene_errors(law, model)
        ratio = exact["ns_per_directed_bond_1"] / learned["ns_per_directed_bond_1"]
        thickness = thickness_error(model, law, "float32")
        rows.append(
            {
                "law": law.name,
                "exact ns/directed bond": exact["ns_per_directed_bond_1"],
                "exact, bond pass only": exact["ns_bond_pass_1"],
                "surrogate ns/directed bond": learned["ns_per_directed_bond_1"],
                "exact / surrogate": ratio,
                "degrees of the surrogate": model.size.removeprefix("degrees "),
                "RMS on / off": f"{errors[0][0]:.0e} / {errors[0][1]:.0e}",
                "RMS on / off, degrees 12 and 6": f"{errors[1][0]:.0e} / {errors[1][1]:.0e}",
                "J3 error": "exact" if np.isnan(thickness) else f"{thickness:.0e}",
                "scene uniaxial at 2: error of stress, displacement (%)": (
                    f"{100 * stress:.3f}, {100 * displacement:.3f}"
                ),
                "least slope": f"{slope:.2f}",
                "better": (
                    "surrogate"
                    if ratio > 1.2
                    else "exact"
                    if ratio < 1 / 1.2
                    else "exact, at the same cost"
                ),
            }
        )
        console.print(f"{law.name}: {ratio:.2f}")
    show(f"Whole force evaluation, one thread, {processor()}", rows)
    caution = comparison.caution(costs)
    console.print(caution)
    return rows, caution


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="put the tables into the documentation")
    parser.add_argument("--quick", action="store_true", help="fewer repeats, not for quoting")
    arguments = parser.parse_args()
    costs, caution = speed(arguments.quick)
    found = {
        "identification": identification(FIGURES),
        "published": beside_published(),
        "speed": costs,
    }
    write_json(FIGURES / "materials.json", found)
    if arguments.docs:
        replace_block("identification", as_markdown(found["identification"]["table"]))
        replace_block("published", as_markdown(found["published"]))
        replace_block("laws", f"{as_markdown(costs)}\n\n{caution}".strip())


if __name__ == "__main__":
    main()
