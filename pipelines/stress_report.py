"""Hard cases for every force model, the fallback outside a surrogate's domain, and the cost of checking the domain.

python pipelines/stress_report.py                      print the tables
python pipelines/stress_report.py --docs               and put them into the documentation
python pipelines/stress_report.py --docs --plane space the cases of solids only
"""

from __future__ import annotations

import argparse
import dataclasses
import statistics
import time

import numpy as np
from pages import markdown_table, replace_block
from rich.console import Console

import pdsurrogate as pds
from pdsurrogate.engine.threads import thread_count
from pdsurrogate.forces import Domain, ForceSettings
from pdsurrogate.learning import surrogate_of
from pdsurrogate.progress import listening
from pdsurrogate.reports.speed import sheet
from pdsurrogate.stress_test.report import BODIES, count, stress_test, table

console = Console()

SHORT = {"pass": "", "WEAK": "**weak** "}


def hard_cases(plane: str) -> str:
    """Table of all cases and models of a plane, and explanations of the weaknesses in it."""
    began = time.perf_counter()
    status = console.status("Starting")
    with status, listening(lambda stage, done, total, **numbers: status.update(f"{done:.0f} of {total} cases, now {numbers.get('case')}")):
        report = stress_test(full=True, planes=[plane])
    minutes = (time.perf_counter() - began) / 60
    header, rows = table(report, plane)
    body = [[row[0], row[1], *(_short(cell) for cell in row[2:])] for row in rows]
    counts = [count(model) for model in report["models"]]
    body.append(["passed / weak / does not apply", "", *(f"{one['pass'] + one['stops']} / {one['weak']} / {one['-']}" for one in counts)])
    weaknesses = "\n".join(f"- *{name}*: {what}." for name, what in report["weaknesses"].items())
    return f"Made in {minutes:.0f} minutes.\n\n{markdown_table(header, body)}\n\n{weaknesses}"


def _short(cell: str) -> str:
    word, _, rest = cell.partition(" ")
    return f"{SHORT.get(word, f'{word} ')}{rest}".strip()


def fallback() -> str:
    """Section 6.2 with a surrogate trained to stretch 1.5 only, against the analytic bond force."""
    law = pds.materials.NeoHookean()
    samples = pds.training_samples(law, 8000, (0.8, 1.5), random_state=0)
    network = pds.LevenbergMarquardtRegressor((20,), "algebraic", max_iter=600, n_iter_no_change=100, random_state=0)
    with console.status("Fitting a surrogate to stretch 1.5"):
        model = pds.surrogate_pipeline(network).fit(samples.X, samples.y)
    small = surrogate_of(model, law, samples)
    with console.status("Section 6.2"):
        mine, exact = (pds.simulate(pds.load_scene("uniaxial"), force) for force in (small, "analytic"))
    rows = []
    for level, reference in zip(mine.levels, exact.levels, strict=True):
        errors = [100 * (level[key] / reference[key] - 1) for key in ("nominal_stress", "lateral_displacement")]
        rows.append([f"{level['stretch']:g}", *(f"{error:+.5f}" for error in errors), str(level["evaluations"])])
    text = markdown_table(["stretch", "nominal stress (%)", "lateral displacement (%)", "evaluations"], rows)
    return f"{text}\n\n{100 * mine.summary['fallback_fraction']:.0f} % of the bond evaluations used the exact bond force."


def overhead() -> str:
    """Cost of the guard where no bond is outside: the whole evaluation with and without, interleaved, on one thread."""
    body = sheet()
    model, law = pds.load_surrogate("neo-hookean"), pds.materials.NeoHookean()
    positions, out = body.points @ np.diag([1.5, 0.82]), np.empty_like(body.points)
    lines = []
    for precision in ("float32", "float64"):
        with thread_count(1):
            guarded = model.bind(body, law, ForceSettings(precision=precision))
            free = dataclasses.replace(model, domain=None).bind(body, law, ForceSettings(precision=precision))
            ratios = []
            for _ in range(200):
                seconds = []
                for force in (guarded, free, free, guarded):
                    began = time.perf_counter()
                    for _ in range(4):
                        force(positions, out)
                    seconds.append(time.perf_counter() - began)
                ratios.append((seconds[0] + seconds[3]) / (seconds[1] + seconds[2]))
        assert guarded.fraction_outside == 0
        lines.append(f"{precision}: {100 * (statistics.median(ratios) - 1):+.1f} %")
    return "The check of the domain adds to the time of an evaluation, with all bonds inside: " + ", ".join(lines) + "."


def jump() -> str:
    """Evaluations with the paper's network where its box ends within the body, with the band and with a jump in its place."""
    rows = []
    interior = Domain.interior
    scenes = (
        ("pure-shear", ["spacing=0.04", "stretches=1.5,2.0"]),
        ("uniaxial", ["spacing=0.04", "support=points", "stretches=1.45,1.56,1.6"]),
    )
    for name, changes in scenes:
        cells = []
        for band in (False, True):
            Domain.interior = interior if band else property(lambda domain: domain)
            try:
                result = pds.simulate(pds.load_scene(name, [*changes, "solver.most_evaluations=8000"]), "neo-hookean-paper")
                cells.append(" / ".join(str(level["evaluations"]) for level in result.levels))
            except pds.SimulationFailed as error:
                cells.append(f"not converged: {str(error).split(';')[0]}")
            finally:
                Domain.interior = interior
        rows.append([f"{name}, {', '.join(changes)}", *cells])
    return markdown_table(["scene", "without a band", "with a band"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="put the tables into the documentation")
    parser.add_argument("--plane", choices=list(BODIES), help="the cases of these bodies alone")
    arguments = parser.parse_args()
    for mark, make in (("guard", overhead), ("jump", jump), ("fallback", fallback)) if arguments.plane is None else ():
        text = make()
        console.print(f"{mark}\n{text}\n", soft_wrap=True, markup=False)
        if arguments.docs:
            replace_block(mark, text)
    for plane in [arguments.plane] if arguments.plane else BODIES:
        text = hard_cases(plane)
        console.print(f"{text}\n", soft_wrap=True, markup=False)
        if arguments.docs:
            replace_block(f"hard-cases-{plane}", text)


if __name__ == "__main__":
    main()
