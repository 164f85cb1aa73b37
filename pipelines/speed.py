"""Speed against error for every force model, and cost against size: the tables and the figure of the documentation.

python pipelines/speed.py            print both tables, draw the figure (five to eight minutes)
python pipelines/speed.py --docs   and put them into the documentation
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time

import numpy as np
from pages import FIGURES, markdown_table, replace_block
from rich.console import Console

import pdsurrogate as pds
from pdsurrogate.progress import listening
from pdsurrogate.reports import compare
from pdsurrogate.reports.speed import TimedModel, measure_speed
from pdsurrogate.results import tables
from pdsurrogate.results.figures import save
from pdsurrogate.results.files import write_text

console = Console()

SIZES = ((40, 25), (100, 100), (400, 250), (1000, 1000))
"""Points along x1 and x2 of the bodies whose cost is measured."""

PATIENCE = 100.0
"""Seconds of waiting for undisturbed timings of all sizes."""


def body_of(n1: int, n2: int) -> pds.Body:
    """A sheet of n1 x n2 points."""
    return pds.Body.rectangle(0.02 * n1, 0.02 * n2, 0.02, 0.063)


def measure_memory(n1: int, n2: int) -> dict:
    """Time and peak memory of one evaluation from nothing; run in a process of its own, so that its memory is its own."""
    began = time.perf_counter()
    body = body_of(n1, n2)
    force = pds.load_surrogate("neo-hookean").bind(body, pds.materials.NeoHookean(), pds.ForceSettings())
    force(body.points * [1.5, 0.82], np.empty_like(body.points))
    return {"setup_seconds": time.perf_counter() - began, "gigabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20}


def scaling_table() -> str:
    """Cost per directed bond and peak memory against the number of points."""
    force, cases, memory = pds.load_surrogate("neo-hookean"), [], []
    for size in SIZES:
        arguments = [sys.executable, __file__, "--size", *map(str, size)]
        memory.append(json.loads(subprocess.run(arguments, capture_output=True, text=True, check=True).stdout))
        cases.append(TimedModel(force, "float32", body_of(*size)))
    costs = measure_speed(cases, pds.materials.NeoHookean(), PATIENCE)
    rows = [
        [
            f"{len(case.body):,}",
            f"{case.body.bonds.n_directed:,}",
            f"{cost['ns_per_directed_bond_1']:.2f}",
            f"{cost['ns_per_directed_bond_all']:.2f}",
            f"{found['setup_seconds']:.1f}",
            f"{found['gigabytes']:.2f}",
        ]
        for case, cost, found in zip(cases, costs, memory, strict=True)
    ]
    table = markdown_table(
        ["points", "directed bonds", "ns/directed bond, one thread", "all threads", "setup (s)", "peak memory (GiB)"], rows
    )
    return f"{table}\n\n{compare.caution(costs)}".strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="put the tables and the figure into the documentation")
    parser.add_argument("--size", type=int, nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.size:
        print(json.dumps(measure_memory(*arguments.size)))
        return
    status = console.status("Comparing")
    with status, listening(lambda stage, done, total, **numbers: status.update(f"{stage}, {done:.0f} of {total} models")):
        report = compare.compare()
    comparison = "\n\n".join(f"{title}:\n\n{markdown_table(*compare.table(report, title))}" for title in compare.TABLES)
    console.print(comparison, soft_wrap=True)
    save(compare.pareto_figure(report), FIGURES / "speed.png")
    write_text(FIGURES / "speed.csv", tables.as_csv(report["models"]))
    sizes = scaling_table()
    if arguments.docs:
        machine = report["machine"]
        where = f"Processor: {machine['processor']}, {machine['threads']} threads, numba {machine['numba']}."
        text = f"{where} {compare.caution(report['models'])}".strip() + "\n\n"
        replace_block("speed", text + comparison)
        replace_block("scaling", sizes)


if __name__ == "__main__":
    main()
