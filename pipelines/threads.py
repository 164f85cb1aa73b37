"""How the kernels' threads wait, and when a second one pays: cost of an evaluation on free cores and beside other processes.

python pipelines/threads.py            print the table (about ten minutes)
python pipelines/threads.py --readme   and put it into the README

Every entry is the median over rounds of the mean cost of a directed bond within some tenths of a second; all settings take turns within a
round, each in a process of its own, since threads read how to wait when they start.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
from readme import markdown_table, replace_block
from rich.console import Console

import pdsurrogate as pd
from pdsurrogate.kernels.threads import SPIN_COUNT, thread_count
from pdsurrogate.reports.speed import bench_positions

console = Console()

WIDTHS = (10, 20, 50, 163)
"""Points across a sheet of 3 x 1: 300, 1,200, 7,500 and some 80,000 of them."""

SETTINGS = {
    "two threads as GNU OpenMP has them": (2, {"GOMP_SPINCOUNT": "300000"}),
    f"two threads, {SPIN_COUNT:,} turns (pdsurrogate's)": (2, {}),
    "two threads, 10,000 turns": (2, {"GOMP_SPINCOUNT": "10000"}),
    "two threads, 100 turns": (2, {"GOMP_SPINCOUNT": "100"}),
    "two threads that sleep at once": (2, {"OMP_WAIT_POLICY": "passive"}),
    "one thread": (1, {}),
}
"""Number of threads, and the variables that progress how they wait."""

BUSY = (0, 1, 2)
"""Other processes that take all they can get."""

ROUNDS = 7
SECONDS = 0.4


def measure(threads: int) -> list[float]:
    """Nanoseconds per directed bond of each body, on so many threads."""
    model, law, found = pd.load_surrogate("neo-hookean"), pd.NeoHookean(), []
    for width in WIDTHS:
        body = pd.Body.rectangle(3.0, 1.0, 1 / width, 3.15 / width)
        positions, out = bench_positions(body, law), np.empty_like(body.points)
        with thread_count(threads):
            force = model.bind(body, law, pd.ForceSettings())
            for _ in range(5):
                force(positions, out)
            began, count = time.perf_counter(), 0
            while time.perf_counter() - began < SECONDS:
                force(positions, out)
                count += 1
            found.append(1e9 * (time.perf_counter() - began) / count / body.bonds.n_directed)
    return found


@contextmanager
def busy(count: int):
    """Context in which other processes work without a pause."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def measure_all(rounds: int, progress) -> dict[tuple[str, int], np.ndarray]:
    """Costs by setting and number of other processes: an array of rounds and bodies."""
    inherited = {key: value for key, value in os.environ.items() if key not in ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")}
    found = {(setting, others): [] for setting in SETTINGS for others in BUSY}
    for number in range(rounds):
        progress(f"round {number + 1} of {rounds}")
        for others in BUSY:
            with busy(others):
                for setting, (threads, variables) in SETTINGS.items():
                    command = [sys.executable, __file__, "--threads", str(threads)]
                    environment = {**inherited, **variables, "NUMBA_NUM_THREADS": "2"}
                    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
                    found[setting, others].append(json.loads(done.stdout))
    return {key: np.array(values) for key, values in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--readme", action="store_true", help="put the table into the README")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--threads", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.threads:
        print(json.dumps(measure(arguments.threads)))
        return
    with console.status("Measuring") as status:
        costs = measure_all(arguments.rounds, status.update)
    points = " / ".join(f"{3 * width * width:,}" for width in WIDTHS)
    header = [f"ns per directed bond with {points} points", *(f"{others} other processes" for others in BUSY), "free cores, over the first"]
    rows, spinning = [], costs[next(iter(SETTINGS)), 0]
    for setting in SETTINGS:
        medians = [" / ".join(f"{cost:.3g}" for cost in np.median(costs[setting, others], axis=0)) for others in BUSY]
        ratios = " / ".join(f"{ratio:.2f}" for ratio in np.median(costs[setting, 0] / spinning, axis=0))
        rows.append([setting, *medians, ratios])
    table = markdown_table(header, rows)
    console.print(table, soft_wrap=True)
    if arguments.readme:
        replace_block("threads", table)


if __name__ == "__main__":
    main()
