"""Speed against error for every force model, and cost against size: the tables and the figure of the README.

python pipelines/speed.py            print both tables, draw the figure (some three minutes)
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


def measure_size(n1: int, n2: int) -> dict:
    """Cost of one force evaluation on a sheet of n1 x n2 points; run in a process of its own, so that its memory is its own."""
    import resource
    import statistics
    import time

    import numba
    import numpy as np

    import pdsurrogate as pd
    from pdsurrogate.kernels.compile import thread_count

    began = time.perf_counter()
    body = pd.Body.rectangle(0.02 * n1, 0.02 * n2, 0.02, 0.063)
    force, law = pd.load_surrogate("neo-hookean"), pd.NeoHookean()
    n_bonds = body.bonds.n_directed
    positions, out = body.points * [1.5, 0.82], np.empty_like(body.points)
    found = {"points": len(body), "bonds": n_bonds}
    for threads in (1, numba.config.NUMBA_NUM_THREADS):
        with thread_count(threads):
            bound = force.bind(body, law, pd.ForceSettings())
            bound(positions, out)
            if threads == 1:
                found["setup_seconds"] = time.perf_counter() - began
            times = []
            for _ in range(7):
                calls = max(1, int(1e7 / n_bonds))
                began = time.perf_counter()
                for _ in range(calls):
                    bound(positions, out)
                times.append(1e9 * (time.perf_counter() - began) / calls / n_bonds)
            found[f"ns_{threads}"] = statistics.median(times)
            del bound
    found["gigabytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return found


def scaling_table() -> str:
    """Cost per bond and peak memory against the number of points."""
    rows = []
    for n1, n2 in SIZES:
        done = subprocess.run([sys.executable, __file__, "--size", str(n1), str(n2)], capture_output=True, text=True, check=True)
        found = json.loads(done.stdout)
        times = [value for key, value in found.items() if key.startswith("ns_")]
        rows.append(
            [
                f"{found['points']:,}",
                f"{found['bonds']:,}",
                f"{times[0]:.2f}",
                f"{times[-1]:.2f}",
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
        text = f"Processor: {machine['processor']}, {machine['threads']} threads, numba {machine['numba']}.\n\n"
        replace_block("speed", text + comparison)
        replace_block("scaling", sizes)


if __name__ == "__main__":
    main()
