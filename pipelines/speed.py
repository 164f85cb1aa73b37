"""Speed against error for every force model, and cost against size: the tables and the figure of the README.

python pipelines/speed.py            print both tables, draw the figure (four to six minutes)
python pipelines/speed.py --readme   and put them into the README
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys

from readme import FIGURES, markdown_table, replace_block
from rich.console import Console

from pdsurrogate.reports import presentation
from pdsurrogate.reports.compare import compare
from pdsurrogate.results.figures import save
from pdsurrogate.results.files import write_text

console = Console()

SIZES = ((40, 25), (100, 100), (400, 250), (1000, 1000))
"""Points along x1 and x2 of the bodies whose cost is measured."""

PATIENCE = 20.0
"""Seconds of waiting for an undisturbed time on each."""


def measure_size(n1: int, n2: int) -> dict:
    """Cost of one force evaluation on a sheet of n1 x n2 points; run in a process of its own, so that its memory is its own."""
    import resource
    import time

    import numpy as np

    import pdsurrogate as pd
    from pdsurrogate.reports.speed import measure_speed

    began = time.perf_counter()
    body = pd.Body.rectangle(0.02 * n1, 0.02 * n2, 0.02, 0.063)
    force, law = pd.load_surrogate("neo-hookean"), pd.NeoHookean()
    force.bind(body, law, pd.ForceSettings())(body.points * [1.5, 0.82], np.empty_like(body.points))
    setup = time.perf_counter() - began
    # Read before the cost is measured, for which the force is there twice.
    gigabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    (cost,) = measure_speed([(force, "float32")], law, body, PATIENCE)
    return {"points": len(body), "bonds": body.bonds.n_directed, "setup_seconds": setup, "gigabytes": gigabytes, **cost}


def scaling_table() -> str:
    """Cost per bond and peak memory against the number of points."""
    rows = []
    for n1, n2 in SIZES:
        done = subprocess.run([sys.executable, __file__, "--size", str(n1), str(n2)], capture_output=True, text=True, check=True)
        found = json.loads(done.stdout)
        rows.append(
            [
                f"{found['points']:,}",
                f"{found['bonds']:,}",
                f"{found['ns_per_bond_1']:.2f}",
                f"{found['ns_per_bond_all']:.2f}",
                f"{found['setup_seconds']:.1f}",
                f"{found['gigabytes']:.2f}",
            ]
        )
        console.print(found)
    return markdown_table(["points", "directed bonds", "ns/bond, one thread", "all threads", "setting up (s)", "peak memory (GiB)"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--readme", action="store_true", help="put the tables and the figure into the README")
    parser.add_argument("--size", type=int, nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.size:
        print(json.dumps(measure_size(*arguments.size)))
        return
    with console.status("Comparing") as status:
        report = compare(say=status.update)
    comparison = markdown_table(*presentation.table(report))
    console.print(comparison, soft_wrap=True)
    save(presentation.pareto_figure(report), FIGURES / "speed.png")
    write_text(FIGURES / "speed.csv", presentation.as_csv(report))
    sizes = scaling_table()
    if arguments.readme:
        machine = report["machine"]
        where = f"Processor: {machine['processor']}, {machine['threads']} threads, numba {machine['numba']}."
        text = f"{where} {presentation.caution(report)}".strip() + "\n\n"
        replace_block("speed", text + comparison)
        replace_block("scaling", sizes)


if __name__ == "__main__":
    main()
